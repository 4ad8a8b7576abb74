"""A machine printed as a Python function of plain floats."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from math import inf, nan
from typing import Any, Final

from .machine import TURN, Machine

DEEP: Final = 12
"""Operations within one expression."""

_BINARY: Final = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}


class Lines:
    """The tape's values as Python statements, those used once inside of what uses them.

    Parameters
    ----------
    machine
        What is printed.
    wanted
        The values that are asked for.
    leaves
        Leaf → its name.
    """

    def __init__(
        self, machine: Machine, wanted: list[int], leaves: Mapping[tuple[str, int], str]
    ) -> None:
        self.tape, self.leaves = machine.tape, leaves
        self.lines: list[str] = []
        self.text: dict[int, str] = {}
        self.depth: dict[int, int] = {}
        needed = self.tape.needed(wanted)
        uses = Counter(o for v in needed for o in self.tape.operations[v].operands)
        uses.update(wanted)
        for value in needed:
            self._print(value, uses[value])

    def _print(self, value: int, uses: int) -> None:
        operation = self.tape.operations[value]
        if operation.name == "constant":
            number = operation.number
            self.text[value], self.depth[value] = f"({number!r})" if number < 0 else repr(number), 0
            return
        if not operation.operands:
            self.text[value] = self.leaves[operation.name, int(operation.number)]
            self.depth[value] = 0
            return
        if operation.name in ("maximum", "minimum"):
            for operand in operation.operands:
                self._name(operand)
        a = [self.text[operand] for operand in operation.operands]
        depth = 1 + max(self.depth[operand] for operand in operation.operands)
        self.text[value], self.depth[value] = _expression(operation.name, a), depth
        if uses > 1 or depth >= DEEP:
            self._name(value)

    def _name(self, value: int) -> None:
        if self.depth[value]:
            self.lines.append(f"v{value} = {self.text[value]}")
            self.text[value], self.depth[value] = f"v{value}", 0


def _expression(name: str, a: list[str]) -> str:
    if name in _BINARY:
        return f"({a[0]} {_BINARY[name]} {a[1]})"
    if name == "positive":
        return f"({a[1]} if {a[0]} > 0.0 else {a[2]})"
    if name == "maximum":
        return f"({a[0]} if {a[0]} > {a[1]} else {a[1]})"
    if name == "minimum":
        return f"({a[0]} if {a[0]} < {a[1]} else {a[1]})"
    if name == "negative":
        return f"(-{a[0]})"
    return f"{_CALLS[name]}({', '.join(a)})"


_CALLS: Final = {"absolute": "abs", "sqrt": "sqrt", "log": "log"}


def stepper(machine: Machine, state: type) -> Callable[..., Any]:
    """Return (state, J) → (outputs, state) as a function; `state` is a named tuple's class."""
    names = [f"s{i}" for i, _ in enumerate(machine.states)]
    phases = [f"p{i}" for i, _ in enumerate(machine.oscillators)]
    leaves = {("state", i): name for i, name in enumerate(names)}
    leaves |= {("turn", i): f"t{i}" for i, _ in enumerate(phases)}
    body = Lines(machine, [*machine.following, *machine.outputs], {**leaves, ("sample", 0): "J"})
    lines = [
        "def step(state, J):",
        "if J.__class__ is not float: J = number(J)",
        f"{''.join(f'{name}, ' for name in (*names, *phases))}= state",
        *(f"t{i} = p{i} * {1 / TURN!r}" for i, _ in enumerate(phases)),
        *body.lines,
    ]
    for phase, oscillator in zip(phases, machine.oscillators, strict=True):
        lines += [
            f"{phase} += {oscillator.increment}",
            f"if {phase} >= {TURN // 2}: {phase} -= {TURN}",
        ]
    outputs = "".join(f"{body.text[value]}, " for value in machine.outputs)
    states = "".join(f"{body.text[value]}, " for value in machine.following)
    after = "".join(f"{phase}, " for phase in phases)
    lines.append(f"return ({outputs}), new(State, ({states}{after}))")
    return _compiled("step", lines, state)


def starter(machine: Machine, state: type) -> Callable[..., Any]:
    """Return J → state as a function."""
    body = Lines(machine, list(machine.start), {("sample", 0): "J"})
    states = "".join(f"{body.text[value]}, " for value in machine.start)
    zeros = "0, " * len(machine.oscillators)
    lines = [
        "def init(J):",
        "if J.__class__ is not float: J = number(J)",
        *body.lines,
        f"return new(State, ({states}{zeros}))",
    ]
    return _compiled("init", lines, state)


def _compiled(name: str, lines: list[str], state: type) -> Callable[..., Any]:
    import math

    text = "\n    ".join(lines)
    around = {
        "new": tuple.__new__,
        "State": state,
        "number": _number,
        "sqrt": math.sqrt,
        "log": math.log,
        "inf": inf,
        "nan": nan,
    }
    exec(compile(text, f"<{name} of a discrete controller>", "exec"), around)  # of our own making
    return around[name]


def _number(sample: Any) -> float:
    from ..errors import InvalidDescription, shown

    if sample is None:
        return nan
    try:
        if isinstance(sample, str | bytes):
            raise TypeError
        return float(sample)
    except (TypeError, ValueError):
        raise InvalidDescription(
            "J", "must be a number, or None where the sample is missing", shown(sample)
        ) from None
    except OverflowError:
        return inf
