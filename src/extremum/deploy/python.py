"""A machine printed as a Python function of plain floats."""

from __future__ import annotations

import math
from collections.abc import Callable
from math import inf, nan
from typing import Any, Final

from ..errors import InvalidDescription, shown
from .machine import TURN, Machine
from .statements import ARITHMETIC, Language, statements

LANGUAGE: Final = Language(
    number=repr,
    forms={
        **ARITHMETIC,
        "absolute": "abs({0})",
        "maximum": "{0} if {0} > {1} else {1}",
        "minimum": "{0} if {0} < {1} else {1}",
        "positive": "{1} if {0} > 0.0 else {2}",
        "sqrt": "sqrt({0})",
        "log": "log({0})",
    },
    declaration="{name} = {value}",
)
"""Python's expressions; an infinite constant is named ``inf``."""


def stepper(machine: Machine, state: type) -> Callable[..., Any]:
    """Return (state, J) → (outputs, state) as a function; `state` is a named tuple's class."""
    names = [f"s{i}" for i, _ in enumerate(machine.states)]
    phases = [f"p{i}" for i, _ in enumerate(machine.oscillators)]
    leaves = {("state", i): name for i, name in enumerate(names)}
    leaves |= {("turn", i): f"t{i}" for i, _ in enumerate(phases)}
    leaves[("sample", 0)] = "J"
    wanted = (*machine.outputs, *machine.following)
    body = statements(machine.tape, wanted, leaves, LANGUAGE)
    sent, following = body.results[: len(machine.outputs)], body.results[len(machine.outputs) :]
    lines = [
        "def step(state, J):",
        "if J.__class__ is not float: J = number(J)",
        "try:",
        f"    {''.join(f'{name}, ' for name in (*names, *phases))}= state",
        "except (TypeError, ValueError):",
        "    raise foreign(state) from None",
        *(f"t{i} = p{i} * {1 / TURN!r}" for i, _ in enumerate(phases)),
        *body.lines,
    ]
    for phase, oscillator in zip(phases, machine.oscillators, strict=True):
        lines += [
            f"{phase} += {oscillator.increment}",
            f"if {phase} >= {TURN // 2}: {phase} -= {TURN}",
        ]
    outputs = "".join(f"{value}, " for value in sent)
    states = "".join(f"{value}, " for value in following)
    after = "".join(f"{phase}, " for phase in phases)
    lines.append(f"return ({outputs}), new(State, ({states}{after}))")
    return _compiled("step", lines, state, STEP)


def starter(machine: Machine, state: type) -> Callable[..., Any]:
    """Return J → state as a function."""
    body = statements(machine.tape, machine.start, {("sample", 0): "J"}, LANGUAGE)
    states = "".join(f"{value}, " for value in body.results)
    zeros = "0, " * len(machine.oscillators)
    lines = [
        "def init(J):",
        "if J.__class__ is not float: J = number(J)",
        *body.lines,
        f"return new(State, ({states}{zeros}))",
    ]
    return _compiled("init", lines, state, INIT)


STEP: Final = """Return what is sent, and the next state.

J may be missing: None, NaN, infinite, or outside of what `Validity` believes.
"""

INIT: Final = """Return the state before the first step; J is the first sample, or None.

A washout that starts otherwise than at the signal does not use it.
"""


def _compiled(name: str, lines: list[str], state: type, doc: str) -> Callable[..., Any]:
    text = "\n    ".join(lines)
    around = {
        "new": tuple.__new__,
        "State": state,
        "number": _number,
        "foreign": _foreign,
        "sqrt": math.sqrt,
        "log": math.log,
        "inf": inf,
        "nan": nan,
    }
    exec(compile(text, f"<{name} of a discrete controller>", "exec"), around)  # of our own making
    around[name].__doc__ = doc
    return around[name]


def _foreign(state: Any) -> InvalidDescription:
    return InvalidDescription(
        "state", "is not one of this controller: take what init and step return", shown(state)
    )


def _number(sample: Any) -> float:
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
