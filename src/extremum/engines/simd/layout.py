"""Where the numbers of a block of loops lie while it runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

from ..lanes.frame import WIDE, Frame

BLOCK: Final = 12 * 1024
"""Bytes of a block: it stays in the first-level cache for the whole run."""

MOST_VECTORS: Final = 32


@dataclass(frozen=True)
class Layout(Frame):
    """The slots of a vector of loops; those of a block follow each other.

    Parameters
    ----------
    program, swept
        See `Frame`.
    width
        Loops in a vector.
    bits
        Of a number: 64 or 32. Times and angles have 64.
    """

    width: int
    bits: int

    @cached_property
    def offsets(self) -> dict[str, int]:
        """Byte offset of every slot."""
        times = ["time", "until", "unit", *(["begin"] if self.program.step.last else [])]
        angles = [f"angle {i}" for i, _ in enumerate(self.program.angles)]
        wide = [name for name in self.left if name.startswith(WIDE)]
        numbers = [name for name in self.left if not name.startswith(WIDE)]
        numbers += ["cap"] if self.tries_again else []
        numbers += [f"constant {value}" for value in self.constants]
        offsets, at = {}, 0
        for names, size in (([*times, *angles, *wide], 8), (numbers, self.bits // 8)):
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
