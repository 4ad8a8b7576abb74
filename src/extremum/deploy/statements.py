"""A machine's straight line as statements of a language, every operation in the tape's order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from ..engines.lanes.tape import Tape
from .naming import Names

if TYPE_CHECKING:
    from .machine import Machine

LONGEST: Final = 30
"""Characters of an operand that is written where it is used, if it is used once."""

ARITHMETIC: Final = {
    "add": "{0} + {1}",
    "subtract": "{0} - {1}",
    "multiply": "{0} * {1}",
    "divide": "{0} / {1}",
    "negative": "-{0}",
}
"""What C and Python write alike."""

_TWICE: Final = ("maximum", "minimum")


@dataclass(frozen=True)
class Language:
    """How a language writes what a tape holds.

    Attributes
    ----------
    number
        A constant as text.
    forms
        Operation → its text, with ``{0}``, ``{1}``, … for the operands.
    declaration
        ``{name}`` gets ``{value}``.
    remark
        ``{}`` behind a statement.
    """

    number: Callable[[float], str]
    forms: Mapping[str, str]
    declaration: str
    remark: str = ""


class Spelling(NamedTuple):
    """A machine's names in a language: of phases, states and turns, and of every leaf."""

    phases: tuple[str, ...]
    states: tuple[str, ...]
    turns: tuple[str, ...]
    leaves: dict[tuple[str, int], str]


def spelled(machine: Machine, taken: Iterable[str]) -> Spelling:
    """Return names that differ from those that are `taken`; the sample is J."""
    names = Names(taken)
    phases = tuple(names.fresh(o.name) for o in machine.oscillators)
    states = tuple(names.fresh(name) for name in machine.states)
    turns = tuple(names.fresh(f"{phase}_turn") for phase in phases)
    leaves = {("state", i): name for i, name in enumerate(states)}
    leaves |= {("turn", i): name for i, name in enumerate(turns)}
    return Spelling(phases, states, turns, {("sample", 0): "J", **leaves})


@dataclass(frozen=True)
class Printed:
    """What `statements` prints: the statements in order, then the results as expressions."""

    lines: tuple[str, ...]
    results: tuple[str, ...]


def statements(
    tape: Tape,
    results: Sequence[int],
    leaves: Mapping[tuple[str, int], str],
    language: Language,
    remarks: Mapping[int, str] = MappingProxyType({}),
) -> Printed:
    """Print what the results need.

    Every operation stands in brackets of its own or in a statement of its own: the order in which
    numbers are added and multiplied is the tape's, in every language.

    Parameters
    ----------
    tape
        The operations.
    results
        Values on the tape.
    leaves
        (name, index) of a leaf → what it is called.
    language
        How to write.
    remarks
        Value → what is said of it behind its statement.
    """
    needed = tape.needed(results)
    uses = Counter(results)
    repeated: set[int] = set()
    for value in needed:
        operation = tape.operations[value]
        uses.update(operation.operands)
        if operation.name in _TWICE:
            repeated.update(operation.operands)
    texts: dict[int, str] = {}
    lines: list[str] = []
    for value in needed:
        operation = tape.operations[value]
        if operation.name == "constant":
            number = language.number(operation.number)
            texts[value] = f"({number})" if number.startswith("-") else number
        elif not operation.operands:
            texts[value] = leaves[operation.name, int(operation.number)]
        else:
            text = language.forms[operation.name].format(*(texts[a] for a in operation.operands))
            if uses[value] > 1 or value in repeated or len(text) > LONGEST:
                name = f"v{len(lines) + 1}"
                remark = language.remark.format(remarks[value]) if value in remarks else ""
                lines.append(language.declaration.format(name=name, value=text) + remark)
                texts[value] = name
            else:
                texts[value] = f"({text})"
    return Printed(tuple(lines), tuple(_bare(texts[value]) for value in results))


def leaves_of(tape: Tape, results: Iterable[int]) -> set[tuple[str, int]]:
    """Return the leaves that the results need, as (name, index)."""
    found = (tape.operations[value] for value in tape.needed(results))
    return {(o.name, int(o.number)) for o in found if not o.operands and o.name != "constant"}


def operations_of(tape: Tape, results: Iterable[int]) -> set[str]:
    """Return the names of the operations that the results need."""
    return {tape.operations[value].name for value in tape.needed(results)}


def _bare(text: str) -> str:
    """Return a text without the brackets around all of it."""
    if not text.startswith("("):
        return text
    depth = 0
    for place, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth == 0:
            return text[1:-1] if place == len(text) - 1 else text
    return text
