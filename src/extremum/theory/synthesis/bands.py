"""What an axis' averaged loop may be: roots, L(jω) and responses over a lattice of its box."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ...requirements import Requirements
from . import polynomials as poly
from .family import Family, Plant, pade, plants, uncertain
from .polynomials import Complex, Vector
from .responses import modes, responses
from .shapes import Shape

NODES: Final = {1: 33, 2: 5, 3: 3}
"""Nodes of the lattice along each of so many uncertain numbers; along more, their two ends."""
GAINS: Final = 9
FREQUENCIES: Final = 1500
ON_AXIS: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Band:
    """One axis' averaged loops P = D D_c D_p + g N N_c N_p over a lattice of its box.

    Attributes
    ----------
    family, shape
        The axis, and its compensator.
    plants
        G at the nodes, the corners of the uncertain numbers' ranges among them.
    gains
        g = α c q m |F| at the nodes of the curvature's range, from its low end to its high end.
    """

    family: Family
    shape: Shape
    plants: tuple[Plant, ...]
    gains: Vector

    @property
    def decibels(self) -> Vector:
        """|g| in dB, low end first."""
        return 20 * np.log10(np.abs(self.gains))

    def roots(self, plant: Plant, gains: Vector) -> Complex:
        """Return the closed loop's roots (1/s) at one plant, (gains, degree)."""
        above, below = self._compensator
        return modes(self.family, plant, above, below, gains)

    def branches(self, plant: Plant, gains: Vector) -> Complex:
        """Return the same, each root followed from a gain to the next, (degree, gains)."""
        from scipy.optimize import linear_sum_assignment

        roots = self.roots(plant, gains)
        for before, after in itertools.pairwise(roots):
            _, places = linear_sum_assignment(np.abs(after[None, :] - before[:, None]))
            after[:] = after[places]
        return roots.T

    def responses(self, times: Vector) -> Vector:
        """Return x̃(t) from 1 m at rest, the integrators charged, (plants, gains, times)."""
        above, below = self._compensator
        here = [responses(self.family, p, above, below, self.gains, times) for p in self.plants]
        return np.array([free for free, _ in here])

    def singular(self, plant: Plant) -> tuple[Complex, Complex]:
        """Return the zeros and the poles (1/s) of L(s)."""
        above, below = self._compensator
        early, late = pade(self.family.delay)
        return (
            _roots(plant.numerator, above, early),
            _roots(plant.denominator, below, late),
        )

    def curve(self, plant: Plant, omega: Vector) -> tuple[Vector, Vector]:
        """Return the phase (°) and the size (dB) of L(jω) at |g| = 1, (ω,) each.

        The phase is continuous but at poles and zeros on the imaginary axis, which are passed on
        the right. It lies in (−360, 0] at the highest frequency with |L| = 1, q = √(q_low q_high).
        """
        above, below = self._compensator
        early, late = pade(self.family.delay)
        point = 1j * omega
        value = np.sign(self.shape.gain) * poly.at(
            poly.product(plant.heard * plant.numerator, above, early), point
        )
        value = value / poly.at(poly.product(plant.denominator, below, late), point)
        size = 20 * np.log10(np.abs(value))
        zeros, poles = self.singular(plant)
        phase = _angles(omega, zeros) - _angles(omega, poles)
        phase += 180 * round(float(np.degrees(np.angle(value[0])) - phase[0]) / 180)
        crossed = np.flatnonzero(size + 20 * np.log10(abs(self.shape.gain)) >= 0)
        place = phase[crossed[-1]] if crossed.size else phase[0]
        return phase - 360 * np.ceil(place / 360), size

    @property
    def frequencies(self) -> Vector:
        """The grid (rad/s) for `curve`."""
        w = self.shape.crossover
        return np.geomspace(w / 300, w * 300, FREQUENCIES)

    @property
    def _compensator(self) -> tuple[Vector, Vector]:
        return np.array(self.shape.above), np.array(self.shape.below)


def band(requirements: Requirements, family: Family, shape: Shape, omega: float) -> Band:
    """Return an axis' averaged loops over a lattice of its box, with a dither at ω (rad/s)."""
    count = NODES.get(len(uncertain(requirements, family.axis)), 2)
    nodes = tuple(family.hearing(p, omega) for p in plants(requirements, family.axis, count))
    gains = shape.gain * np.geomspace(*family.gains, GAINS)
    return Band(family, shape, nodes, gains)


@dataclass(frozen=True)
class Margins:
    """The least margins of a band: what L may still gain, lose or lag before −1 is met.

    Attributes
    ----------
    up, down
        Gain margins (dB) upwards and downwards; infinite where L is never real below, above −1.
    phase
        Phase margin (°), of either sign: the phase of L + 180° where |L| = 1 comes nearest to −1.
    """

    up: float
    down: float
    phase: float


def margins(found: Band) -> Margins:
    """Return the least margins of a band, read off its curves."""
    up, down, phases = [np.inf], [np.inf], [np.inf]
    low, high = found.decibels[0], found.decibels[-1]
    for plant in found.plants:
        phase, size = found.curve(plant, found.frequencies)
        beyond = (phase + 360) % 360 - 180
        level = _where_zero(beyond, size)
        up += [-(x + high) for x in level if x + high < 0]
        down += [x + low for x in level if x + low > 0]
        for gain in found.decibels:
            phases += _where_zero(size + gain, beyond)
    return Margins(float(min(up)), float(min(down)), float(min(phases, key=abs)))


def _where_zero(column: Vector, other: Vector) -> list[float]:
    """Return `other` wherever `column` passes through zero, and does not jump."""
    steps = np.diff(column)
    passes = np.flatnonzero((column[:-1] * column[1:] <= 0) & (np.abs(steps) < 90) & (steps != 0))
    parts = -column[passes] / steps[passes]
    return (other[passes] + parts * (other[passes + 1] - other[passes])).tolist()


def _roots(*polynomials: Vector) -> Complex:
    return np.concatenate([np.roots(p) for p in polynomials]).astype(complex)


def _angles(omega: Vector, roots: Any) -> Vector:
    """Return Σ arg(jω − r) (°), each continuous in ω but where jω = r."""
    total = np.zeros_like(omega)
    for root in roots:
        along = omega - root.imag
        right = root.real > ON_AXIS * abs(root)
        angle = np.degrees(np.arctan2(along, abs(root.real)))
        total += 180 - angle if right else angle
    return total
