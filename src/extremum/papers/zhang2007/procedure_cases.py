"""The procedures followed to the letter and simulated: what they allow and should not, and do.

Each case is judged by `stability`, in its four columns, and by a run started on the dither beside
the source. The numbers are those of errata 1 and 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ...loop import Loop
from ...simulation import simulate
from ...theory.verdict import Verdict, stability
from .evidence import RATE
from .procedures import (
    DoubleIntegrators,
    Procedure,
    UnstablePoles,
    for_double_integrators,
    for_unstable_poles,
)
from .schemes import CURVATURES
from .tables import Cell, Table

if TYPE_CHECKING:
    import xarray

Vector = NDArray[np.float64]

SAMPLES: Final = 20
"""Samples of a run in each dither period."""


@dataclass(frozen=True, eq=False)
class Case:
    """A procedure followed, on the paper's map with q = (1, 0.5) and the source at the origin.

    Attributes
    ----------
    name
        What it is an example of.
    procedure
        Bounds, choices, steps.
    frequency
        ω (rad/s).
    start
        Where the run starts, on the dither (m).
    periods
        How many dither periods it lasts.
    """

    name: str
    procedure: UnstablePoles | DoubleIntegrators
    frequency: float
    start: tuple[float, float]
    periods: int

    @property
    def loop(self) -> Loop:
        """The loop, its poles at ε_high where it has any."""
        return self.procedure.loop(self.frequency, q=CURVATURES, start=self.start)

    @cached_property
    def verdict(self) -> Verdict:
        """Conditions as printed and as corrected, averaged eigenvalues, Floquet exponents."""
        return stability(self.loop)

    @cached_property
    def run(self) -> xarray.Dataset:
        """The simulation, up to the escape if it escapes."""
        end = 2 * math.pi / self.frequency * self.periods
        return simulate(self.loop, end, samples=SAMPLES * self.periods + 1)

    @property
    def distance(self) -> tuple[Vector, Vector]:
        """Time (s) and distance of the mean position over each whole dither period (m)."""
        whole = (len(self.run.time) - 1) // SAMPLES * SAMPLES
        shape = (-1, SAMPLES)
        times = self.run.time.values[:whole].reshape(shape)
        means = self.run.position.values[:whole].reshape(*shape, 2).mean(axis=1)
        return times.mean(axis=1), np.linalg.norm(means, axis=1)

    @property
    def ended(self) -> str:
        """How the run ended, in words."""
        _, distance = self.distance
        if self.run.attrs["outcome"] == "escaped":
            return f"escapes at {self.run.attrs['end_time']:.1f} s"
        far = f"{distance[-1]:.2g} m" if distance[-1] > 1e-3 else "below 1 mm"
        return f"{far} after {self.run.attrs['end_time']:.0f} s"


def _poles(name: str, washout: float, zero: float) -> Case:
    procedure = for_unstable_poles(0.5, 0.5, washout=washout, gain=20.0, zero=zero)
    return Case(name, procedure, 400.0, (0.1, 0.0), 2500)


def _integrators(name: str, zero: float, pole: float | None) -> Case:
    procedure = for_double_integrators(0.5, 0.1, gain=10.0, k=5.0, zero=zero, pole=pole)
    return Case(name, procedure, 100.0, (0.3, 0.2), 950)


CASES: Final = (
    _poles("1/(s − ε), z < −h to the letter, h < ε_high", 0.1, -0.2),
    _poles("the same numbers, z < −ε_high", 0.1, -0.9),
    _poles("h > ε_high, −h < z < −ε_high", 1.0, -0.8),
    _integrators("1/s², z < −h, p < z + h to the letter", -2.0, -1.5),
    _integrators("the same numbers, p < z − 2σ", -2.0, None),
    _integrators("−h < z < 0, p < z − 2σ", -0.5, -3.0),
)


def table() -> Table:
    """Return every case: what each rule says, largest real parts, and how its run ended."""
    rows: list[tuple[Cell, ...]] = []
    for index, case in enumerate(CASES, 1):
        procedure: Procedure = case.procedure
        lead = procedure.lead
        says = ("yes" if met else "no" for met in (procedure.as_printed, procedure.as_corrected))
        rates = (column.rate for column in case.verdict.evidence)
        rows.append(
            (
                str(index),
                case.name,
                procedure.washout,
                lead.zero,
                lead.pole,
                *says,
                *rates,
                case.ended,
            )
        )
    columns = (
        ("", ""),
        ("case", ""),
        ("h", "g"),
        ("z", "g"),
        ("p", "g"),
        ("printed steps met", ""),
        ("corrected steps met", ""),
        ("printed (31), (59)", RATE),
        ("corrected", RATE),
        ("averaged", RATE),
        ("Floquet", RATE),
        ("run: distance from the source", ""),
    )
    return Table(columns, tuple(rows))
