"""A machine as one plain Python file, for MicroPython and for computers without `extremum`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from ..sampled.adapting import LARGEST
from ..sampled.validity import LONG
from .c99 import VERDICTS, WANTED, changes, kept
from .machine import TURN
from .python import LANGUAGE
from .statements import operations_of, spelled, statements

if TYPE_CHECKING:
    from .machine import Machine

_METHODS: Final = ("init", "step", "reset", "skip", "change", "status")
_IMPORTED: Final = ("log", "sqrt")


def _number(number: float) -> str:
    return "INFINITE" if number == math.inf else repr(number)


_LANGUAGE: Final = replace(LANGUAGE, number=_number, remark="  # {}")


def module(machine: Machine, safe: Sequence[float], about: Sequence[str]) -> str:
    """Return a machine as a Python file with a class `Controller`.

    Parameters
    ----------
    machine
        What is printed.
    safe
        The safe output.
    about
        Lines of the comment at the top.
    """
    return _Module(machine).text(safe, about)


class _Module:
    """The parts of a file."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        taken = ("self", "J", "u", "abs", "float", "INFINITE", *_METHODS, *_IMPORTED)
        self.phases, self.states, self.turns, self.leaves = spelled(machine, taken)

    def text(self, safe: Sequence[float], about: Sequence[str]) -> str:
        """Return the file."""
        machine = self.machine
        results = (*machine.start, *machine.following, *machine.outputs)
        imported = sorted(operations_of(machine.tape, results) & {*_IMPORTED})
        lines = [
            *(f"# {line}".rstrip() for line in about),
            "",
            *([f"from math import {', '.join(imported)}", ""] if imported else []),
            'INFINITE = float("inf")',
            "",
            "",
            "class Controller:",
            f"    INPUTS = {machine.output_names!r}",
            f"    SAFE = {tuple(safe)!r}",
            f"    DT = {machine.dt!r}  # s between two steps",
            *(
                f"    {verdict} = {i}"
                for i, verdict in enumerate(VERDICTS)
                if "status" in machine.states
            ),
        ]
        for head, says, body in self._functions():
            lines += ["", f"    def {head}:", f"        # {says}", *(f"        {x}" for x in body)]
        return "\n".join([*lines, ""])

    def _functions(self) -> list[tuple[str, str, list[str]]]:
        """Return every method's head, what it does, and its lines."""
        held = ", ".join(f"self.{self.states[i]}" for i in kept(self.machine))
        reset = [f"kept = {held}", "self.init(J)", f"{held} = kept"] if held else ["self.init(J)"]
        methods = [
            (
                "__init__(self, J=None)",
                "J: a first sample; None if there is none yet",
                ["self.init(J)"],
            ),
            ("init(self, J=None)", "begin with a first sample", self._init()),
            ("step(self, J)", "a sample in, None if it is missing; the commands out", self._step()),
            ("reset(self, J=None)", "begin again, the gain and amplitude as they are", reset),
            (
                "skip(self, steps)",
                "instants at which no step ran: the dither goes on",
                self._skip(),
            ),
        ]
        if changes(self.machine):
            methods.append(self._change())
        if "status" in self.machine.states:
            field = self.states[self.machine.states.index("status")]
            says = "as of the last step: SEEKING, ARRIVED or LOST"
            methods.append(("status(self)", says, [f"return int(self.{field})"]))
        return methods

    def _sample(self) -> list[str]:
        return ["J = INFINITE if J is None else float(J)"]

    def _init(self) -> list[str]:
        printed = statements(self.machine.tape, self.machine.start, self.leaves, _LANGUAGE)
        return [
            *self._sample(),
            *printed.lines,
            *(f"self.{phase} = 0" for phase in self.phases),
            *(f"self.{x} = {y}" for x, y in zip(self.states, printed.results, strict=True)),
        ]

    def _step(self) -> list[str]:
        machine, count = self.machine, len(self.machine.outputs)
        results = (*machine.outputs, *machine.following)
        printed = statements(machine.tape, results, self.leaves, _LANGUAGE, machine.signals)
        commands, following = printed.results[:count], printed.results[count:]
        lines = [
            *self._sample(),
            *(f"{x} = self.{x}" for x in self.states),
            *(
                f"{turn} = self.{phase} * {1 / TURN!r}"
                for turn, phase in zip(self.turns, self.phases, strict=True)
            ),
            *printed.lines,
            *(
                f"self.{x} = {value}"
                for x, value in zip(self.states, following, strict=True)
                if x != value
            ),
        ]
        for phase, oscillator in zip(self.phases, machine.oscillators, strict=True):
            lines.append(f"self.{phase} = {_wrapped(f'self.{phase} + {oscillator.increment}')}")
        return [*lines, f"return ({''.join(f'{value}, ' for value in commands)})"]

    def _skip(self) -> list[str]:
        machine = self.machine
        lines = ["steps = max(int(steps), 0)"]
        lines += [
            f"self.{phase} = {_wrapped(f'self.{phase} + steps * {oscillator.increment}')}"
            for phase, oscillator in zip(self.phases, machine.oscillators, strict=True)
        ]
        clocks = [f"self.{self.states[i]}" for i in machine.clocks]
        return [*lines, *(f"{x} = max({x}, min({x} + steps, {LONG!r}))" for x in clocks)]

    def _change(self) -> tuple[str, str, list[str]]:
        lines: list[str] = []
        for name, states in WANTED.items():
            field, left = (self.states[self.machine.states.index(state)] for state in states)
            least = "<=" if name == "gain" else "<"
            lines += [
                f"if {name} is not None and 0.0 {least} {name} <= {LARGEST!r}:",
                f"    self.{left} += {name} - self.{field}",
                f"    self.{field} = float({name})",
            ]
        return (
            "change(self, gain=None, amplitude=None)",
            "change the factors of all gains and of all amplitudes, both 1 at first",
            lines,
        )


def _wrapped(count: str) -> str:
    """Return a phase brought to −½ … ½ turn."""
    return f"({count} + {TURN // 2}) % {TURN} - {TURN // 2}"
