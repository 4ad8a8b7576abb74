"""The exact loop at the ends of the box: its Floquet exponents, and its way from a displacement."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ...simulation import simulate
from ..floquet import nearest
from ..orbits import periodic_orbit
from .bands import Band
from .building import is_diagonal
from .confirmation import reach
from .polynomials import Complex, Vector

if TYPE_CHECKING:
    import xarray

    from .report import Design

SAMPLES: Final = 48
"""Samples per common period of the dithers."""


@dataclass(frozen=True, eq=False)
class Witness:
    """The exact loop at one end of all curvatures and one end of all uncertain numbers.

    Attributes
    ----------
    design
        The design.
    ends
        0 or 1, the low or the high end: of the curvatures, and of the uncertain numbers.
    """

    design: Design
    ends: tuple[int, int]

    @property
    def point(self) -> dict[str, float]:
        """Where it is in the box; without source distance, force and coupling."""
        found = {}
        for path, limits in self.design.box.items():
            if path.startswith(("field.source.", "vehicle.disturbance.")) or (
                path.startswith("field.q.") and not is_diagonal(path)
            ):
                found[path] = 0.0
            else:
                found[path] = limits[self.ends[not path.startswith("field.q.")]]
        return found

    @cached_property
    def displacement(self) -> float:
        """How far from the source it starts along each axis (m): as the design's scenario does."""
        design = self.design
        axes = len(design.plan.families)
        return max(design.requirements.start_distance, reach(design.loop)) / math.sqrt(axes)

    @property
    def horizon(self) -> float:
        """How long it runs (s): twice the settling time."""
        return 2 * self.design.duration

    @cached_property
    def run(self) -> xarray.Dataset:
        """What `simulate` returns from there, over `horizon`."""
        loop = self.design.at(self.point, (self.displacement,) * len(self.design.plan.families))
        period = loop.system.common_period(loop.values.tolist())
        assert period is not None
        cycles = math.ceil(self.horizon / period) + 1
        return simulate(loop, cycles * period, samples=cycles * SAMPLES + 1)

    def path(self, axis: int) -> tuple[Vector, Vector]:
        """Return the times (s) and x̃ (m) of the run."""
        return self.run.time.values, (self.run.position - self.run.source).values[:, axis]

    def mean(self, axis: int) -> tuple[Vector, Vector]:
        """Return the times (s) and the mean of x̃ (m) over the period about each."""
        times, path = self.path(axis)
        parts = (path[1:] + path[:-1]) / 2
        total = np.concatenate([[0.0], np.cumsum(parts)])
        half = SAMPLES // 2
        return times[half:-half], (total[SAMPLES:] - total[:-SAMPLES]) / SAMPLES

    def exponents(self, bands: tuple[Band, ...], radius: float) -> tuple[Complex, ...]:
        """Return each axis' Floquet exponents (1/s): those nearest to its averaged roots.

        Averaged roots farther from 0 than `radius` (1/s) are left out, and what belongs to them.
        """
        orbit = periodic_orbit(self.design.at(self.point))
        roots = [self._averaged(band) for band in bands]
        slow = [r[np.abs(r) <= radius] for r in roots]
        found, _ = nearest(np.concatenate(slow), orbit.exponents, orbit.frequency)
        return tuple(np.split(found, np.cumsum([len(r) for r in slow])[:-1]))

    def _averaged(self, band: Band) -> Complex:
        curvature, uncertain = self.ends
        limits = self.design.requirements.curvature[band.family.axis]
        gain = band.shape.gain * limits[curvature] / math.sqrt(limits[0] * limits[1])
        return band.roots(band.plants[-uncertain], np.array([gain]))[0]


def witnesses(design: Design) -> tuple[Witness, ...]:
    """Return the exact loop where all curvatures and all uncertain numbers are at an end."""
    ends: Any = itertools.product((0, 1), (0, 1) if design.requirements.uncertain else (1,))
    return tuple(Witness(design, pair) for pair in ends)
