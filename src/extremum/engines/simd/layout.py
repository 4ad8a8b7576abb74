"""Where the numbers of a block of loops lie while it runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

from ..lanes.program import Program
from ..lanes.tape import LOOP, STEP, UNIFORM

BLOCK: Final = 24 * 1024
"""Bytes of a block: it stays in the first-level cache for the whole run."""

MOST_VECTORS: Final = 32


@dataclass(frozen=True)
class Layout:
    """The slots of a vector of loops; those of a block follow each other.

    Parameters
    ----------
    program
        What runs.
    swept
        The parameters that vary from loop to loop.
    width
        Loops in a vector.
    bits
        Of a number: 64 or 32. Times and angles have 64.
    """

    program: Program
    swept: tuple[int, ...]
    width: int
    bits: int

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

    @cached_property
    def offsets(self) -> dict[str, int]:
        """Byte offset of every slot."""
        times = ["time", "until", "unit", *(["begin"] if self.program.step.last else [])]
        angles = [f"angle {i}" for i, _ in enumerate(self.program.angles)]
        numbers = [*self.left, *(f"constant {value}" for value in self.constants)]
        offsets, at = {}, 0
        for names, size in (([*times, *angles], 8), (numbers, self.bits // 8)):
            for name in names:
                offsets[name], at = at, at + self.width * size
        return {**offsets, "": at}

    @property
    def size(self) -> int:
        """Bytes of a vector of loops."""
        return self.offsets[""]

    @property
    def vectors(self) -> int:
        """Vectors of a block."""
        return max(1, min(MOST_VECTORS, BLOCK // self.size))
