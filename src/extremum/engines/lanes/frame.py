"""What every engine's frame around a step has in common: its rows, its leaves and its limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

from .program import Program
from .tape import LOOP, STEP, UNIFORM

HUGE: Final = {64: 1e100, 32: 1e18}
"""A state beyond this has escaped; its square is still a number."""

SHORTEST: Final = 2.0**-24
"""Steps shorter than this, in units of H, go nowhere: the solution ends there."""

LAST: Final = 1.5
"""A step of length 1 is the last one if less than this is left: t_end/H is whole but for
rounding."""

TWO_PI: Final = (6.283185307179586, 2.4492935982947064e-16)
"""2π as a sum."""

TIMES: Final = ("mean", "last", "beyond")
"""Rows of what is left that are in units of H while a loop runs, and in s afterwards."""

WIDE: Final = ("steps", "mean", "last")
"""Rows that are summed up in double precision whatever the states have."""

UNCAPPED: Final = 1e9
"""Longest step, in units of H, as long as none has failed."""

TAIL: Final = ("time", "completed")
"""The last rows of what is left at the end: t (s), and 1 where it is t_end."""


@dataclass(frozen=True)
class Frame:
    """What a step is given and what it leaves.

    Parameters
    ----------
    program
        What runs.
    swept
        The parameters that vary from loop to loop.
    """

    program: Program
    swept: tuple[int, ...]

    @property
    def tries_again(self) -> bool:
        """Whether a step that ends where the field has no value is tried again with half of it."""
        return self.program.step.part is not None and bool(self.program.guards)

    @cached_property
    def columns(self) -> dict[tuple[str, int], int]:
        """The rows of what varies: a leaf's name and index → its row."""
        rows = [("value", index) for index in self.swept]
        unit = self.program.tape.operations[self.program.unit]
        rows += [("length", 0)] if unit.name == "length" else []
        rows += [("begin", 0)] if self.program.step.last else []
        return {leaf: row for row, leaf in enumerate(rows)}

    @cached_property
    def left(self) -> tuple[str, ...]:
        """The names of the slots that are written out at the end, in order."""
        step = self.program.step
        counted = {
            "state": step.states,
            "mean": step.means,
            "last": step.last,
            "maximum": step.maxima,
            "beyond": step.beyond,
        }
        return ("steps", *(f"{name} {i}" for name, vs in counted.items() for i in range(len(vs))))

    @cached_property
    def inside(self) -> tuple[int, ...]:
        """The values that are computed at every step, those of the last window included."""
        program = self.program
        part = () if program.step.part is None else (program.step.part,)
        wanted = [*program.step.outputs(), *part, *program.guards, *program.step.last]
        tape = program.tape
        return tuple(v for v in tape.needed(wanted) if tape.rate(v) == STEP)

    def _used(self, rate: int) -> tuple[int, ...]:
        tape, step = self.program.tape, self.program.step
        used = {o for value in self.inside for o in tape.operations[value].operands}
        used |= {*step.outputs(), *step.last, *self.program.guards}
        return tuple(v for v in sorted(used) if tape.rate(v) == rate and tape.known(v) is None)

    @cached_property
    def constants(self) -> tuple[int, ...]:
        """The values that vary with the loop only and that a step needs."""
        return self._used(LOOP)

    @cached_property
    def uniform(self) -> tuple[int, ...]:
        """The values that are the same everywhere and that a step needs."""
        return self._used(UNIFORM)
