"""A sweep's jobs: the chunks of its results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from ..ensembles.regions import chunked
from .study import Study

SMALLEST: Final = 2**14
LARGEST: Final = 2**16
WANTED: Final = 16
"""Jobs that a sweep has at least, where they are not smaller than SMALLEST."""
MEMORY: Final = 2**28
"""Bytes of samples that a job may hold."""


@dataclass(frozen=True)
class Layout:
    """How the results, one number a loop, are cut into jobs.

    Parameters
    ----------
    dims
        Names of the results' dimensions.
    shape
        Loops along each of them.
    chunk
        Loops of one job along each of them.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @property
    def sizes(self) -> dict[str, int]:
        """Dimension → loops along it."""
        return dict(zip(self.dims, self.shape, strict=True))

    @property
    def chunks(self) -> dict[str, int]:
        """Dimension → loops of a job along it."""
        return dict(zip(self.dims, self.chunk, strict=True))

    @property
    def jobs(self) -> int:
        """Number of jobs."""
        return math.prod(self._grid())

    def _grid(self) -> tuple[int, ...]:
        return tuple(-(-n // c) for n, c in zip(self.shape, self.chunk, strict=True))

    def region(self, job: int) -> dict[str, slice]:
        """Return dimension → the indices of a job's loops."""
        found = {}
        for dim, n, c, count in reversed(
            list(zip(self.dims, self.shape, self.chunk, self._grid(), strict=True))
        ):
            job, k = divmod(job, count)
            found[dim] = slice(k * c, min(n, (k + 1) * c))
        return {dim: found[dim] for dim in self.dims}


def loops(region: Mapping[str, slice]) -> int:
    """Return the number of loops in a region."""
    return math.prod(part.stop - part.start for part in region.values())


def planned(study: Study) -> Layout:
    """Return the layout of a study's results."""
    sweep = study.sweep
    size = min(LARGEST, max(SMALLEST, sweep.count() // WANTED))
    if sweep.samples is not None:
        numbers = sweep.samples * (study.scenario.loop.vehicle.dimension() + 1)
        size = max(1, min(size, MEMORY // (8 * numbers)))
    return Layout(sweep.dims(), sweep.shape(), chunked(sweep.shape(), size))
