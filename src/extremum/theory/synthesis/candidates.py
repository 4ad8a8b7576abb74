"""The grid of compensators among which a design chooses.

C(s) = k Π (s + a)/s · Π ((s + a)² + Ω²)/(s² + Ω²) · ((s + ω_l/√γ)/(s + ω_l√γ))ⁿ · what is included:
integrators and resonators by need, n leads where the phase asks for them. The crossover ω_c, the
rate a, the leads' centre ω_l and spread γ lie on a grid; k makes |C(jω_c)| = 1.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from . import polynomials as poly
from .family import Family
from .polynomials import Vector

CROSSOVERS: Final = 2.0 ** np.arange(-2.0, 6.0, 1 / 3)
RATES: Final = (0.03, 0.06, 0.12, 0.22, 0.35, 0.5)
CENTRES: Final = (1.0, 2.5)
SPREADS: Final = (4.0, 9.0, 20.0, 50.0, 120.0, 300.0)
DIGITS: Final = 3


@dataclass(frozen=True, eq=False)
class Candidates:
    """Compensators, and what has been measured of them at the worst vertex.

    Attributes
    ----------
    crossover
        ω_c (rad/s), (candidates,).
    above, below
        C's numerators and denominators, (candidates, degree + 1).
    gain
        g of the nominal loop, (candidates,).
    measures
        Name → (candidates,).
    """

    crossover: Vector
    above: Vector
    below: Vector
    gain: Vector
    measures: Mapping[str, Vector]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.gain)

    def measured(self, found: Mapping[str, Vector], allowed: float) -> Candidates:
        """Return those with ``missed`` up to `allowed`, and not NaN, with their new measures."""
        known = self.measures.get("missed", found["missed"])
        merged = {**self.measures, **found, "missed": np.maximum(known, found["missed"])}
        kept = merged["missed"] <= allowed
        return Candidates(
            self.crossover[kept],
            self.above[kept],
            self.below[kept],
            self.gain[kept],
            {key: values[kept] for key, values in merged.items()},
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield every candidate by names."""
        for i in range(self.count):
            yield {
                "crossover": float(self.crossover[i]),
                "above": tuple(self.above[i].tolist()),
                "below": tuple(self.below[i].tolist()),
                "gain": float(self.gain[i]),
                **{key: float(values[i]) for key, values in self.measures.items()},
            }


def candidates(family: Family, speed: float, leads: int) -> Candidates:
    """Return the grid for loops of about a speed (rad/s), with so many leads."""
    rates = RATES if family.integrators or family.resonances else (0.0,)
    turning = tuple(itertools.product(CENTRES, SPREADS)) if leads else ((1.0, 1.0),)
    grid = [
        (w, w * a, w * centre, spread)
        for w in speed * CROSSOVERS
        for a in rates
        for centre, spread in turning
    ]
    crossover, rate, centre, spread = np.array(grid).T
    above, below = _compensators(family, rounded(rate), leads, centre, spread)
    passed = np.abs(poly.at(above, 1j * crossover) / poly.at(below, 1j * crossover))
    above = rounded(1 / passed)[:, None] * above
    return Candidates(crossover, above, below, _gains(family, above, below, crossover), {})


def rounded(values: Any, digits: int = DIGITS) -> Vector:
    """Return numbers rounded to so many significant digits, as they are written down."""
    given = np.asarray(values, dtype=float)
    return np.array([float(f"{x:.{digits}g}") for x in given.ravel()]).reshape(given.shape)


def _compensators(
    family: Family, rate: Vector, leads: int, centre: Vector, spread: Vector
) -> tuple[Vector, Vector]:
    """Return C/k's numerators and denominators, (candidates, degree + 1)."""
    one = np.ones_like(rate)
    above, below = (np.broadcast_to(part, (len(one), len(part))) for part in family.include)
    for _ in range(family.integrators):
        above = poly.product(above, np.stack([one, rate], axis=1))
        below = poly.product(below, [1.0, 0.0])
    for omega in family.resonances:
        above = poly.product(above, np.stack([one, 2 * rate, rate**2 + omega**2], axis=1))
        below = poly.product(below, [1.0, 0.0, omega**2])
    zero, pole = rounded(centre / np.sqrt(spread)), rounded(centre * np.sqrt(spread))
    for _ in range(leads):
        above = poly.product(above, np.stack([one, zero], axis=1))
        below = poly.product(below, np.stack([one, pole], axis=1))
    return above, below


def _gains(family: Family, above: Vector, below: Vector, crossover: Vector) -> Vector:
    """Return g with |g C G| = 1 at the crossover of the nominal plant."""
    point = 1j * crossover
    plant = poly.at(family.nominal.numerator, point) / poly.at(family.nominal.denominator, point)
    loop = plant * poly.at(above, point) / poly.at(below, point)
    return family.sign * rounded(1 / np.abs(loop))
