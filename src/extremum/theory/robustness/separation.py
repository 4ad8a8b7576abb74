"""Half-planes that keep a family's values apart from 0, looked for in floats.

They are proposals: what is proved with them is decided in integers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .families import Family, Ranges, halves, roots
from .searches import Member, corners, unstable

STRAIGHT: Final = math.pi - 1e-3
"""Values within less than this angle are taken to lie in a half-plane."""
MARGIN: Final = 1e-6
"""How far from 0 a half-plane must keep them, relative to their mean."""
LARGEST: Final = 10.0
"""A separating polynomial's coefficients, relative to the mean's."""
DECADES: Final = 1.5
"""How far below and above the roots' moduli frequencies are looked at, …"""
FREQUENCIES: Final = 160
"""… at so many, …"""
PEAKS: Final = 600
"""… and at most so many near the roots."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a family's box, and the polynomials whose convex hull contains the family there.

    Attributes
    ----------
    family, ranges
        The part.
    decay
        In 1/s.
    """

    family: Family
    ranges: Ranges
    decay: Fraction

    @cached_property
    def _controls(self) -> NDArray[np.float64]:
        return self.family.rough_controls(self.ranges)

    @cached_property
    def _hull(self) -> NDArray[np.float64]:
        return np.unique(self._controls.reshape(-1, self._controls.shape[-1]), axis=0)

    @cached_property
    def _mean(self) -> NDArray[np.float64]:
        return self._hull.mean(axis=0)

    @cached_property
    def _powers(self) -> NDArray[np.complex128]:
        """Powers of s, the highest first, at s = jω − decay: (degree + 1, frequencies)."""
        usual = self._hull[self._hull[:, 0] != 0]
        decay = float(self.decay)
        places = 1j * _frequencies(roots(usual) + decay) - decay
        powers = places ** np.arange(len(self._mean) - 1, -1, -1)[:, None]
        return powers.astype(np.complex128)

    @cached_property
    def _values(self) -> NDArray[np.complex128]:
        return self._hull @ self._powers

    @cached_property
    def _angles(self) -> NDArray[np.float64]:
        """The values' angles from their mean, (polynomials, frequencies)."""
        return np.angle(self._values * (self._mean @ self._powers).conj())

    @cached_property
    def separable(self) -> bool:
        """Whether all values seem to lie in an open half-plane at every jω − decay."""
        leading = self._hull[:, 0]
        if not ((leading > 0).all() or (leading < 0).all()):
            return False
        if (roots(self._mean) + float(self.decay)).real.max() >= 0:
            return False
        spread = np.ptp(self._angles, axis=0).max()
        return bool(self._values.all()) and bool(spread < STRAIGHT)

    def separating(self) -> list[Fraction] | None:
        """Return a polynomial C with Re P(s) C(s)* > 0 at s = jω − decay for all P of the hull.

        By linear programming over frequencies, for the two values of the largest and the smallest
        angle at each; None if there is none of the family's degree.
        """
        from scipy.optimize import linprog

        columns = np.arange(self._powers.shape[1])
        ends = (self._angles.argmax(axis=0), self._angles.argmin(axis=0))
        values = np.concatenate([self._values[end, columns] for end in ends])
        terms = np.tile(self._powers.T * self._mean, (2, 1))
        sizes = np.tile(abs(self._mean @ self._powers), 2)[:, None]
        directions = (values / abs(values))[:, None]
        apart = (directions.conj() * terms).real / sizes
        degree = len(self._mean) - 1
        found = linprog(
            [*[0.0] * (degree + 1), -1.0],
            A_ub=np.hstack([-apart, np.ones((len(apart), 1))]),
            b_ub=np.zeros(len(apart)),
            bounds=[*[(-LARGEST, LARGEST)] * (degree + 1), (None, 1.0)],
        )
        if found.status != 0 or found.x[-1] < MARGIN:
            return None
        return [Fraction(f"{c:.8e}") for c in found.x[:-1] * self._mean]

    def halves(self) -> list[Part]:
        """Return the part cut in two across the entangled symbol that changes the family most."""
        sizes = np.maximum(abs(self._values).max(axis=0), np.finfo(float).tiny)

        def change(axis: int) -> float:
            differences = self._controls - self._controls.take([0], axis=axis)
            return float((abs(differences @ self._powers) / sizes).max())

        axis = max(self.family.entangled, key=change)
        return [Part(self.family, part, self.decay) for part in halves(self.ranges, axis)]


def separable_parts(todo: Sequence[Part], most: int) -> list[Part] | Member | None:
    """Return parts of the given ones that seem separable.

    Or an unstable member that was met, or None if they would be more than `most`.
    """
    todo, found = list(todo), []
    while todo:
        if len(todo) + len(found) > most:
            return None
        part = todo.pop()
        if part.separable:
            found.append(part)
            continue
        at = corners(len(part.ranges))
        if member := unstable(part.family, part.decay, part.ranges, at):
            return member
        todo += part.halves()
    return found


def _frequencies(found: Any) -> NDArray[np.float64]:
    """Return 0 and frequencies about the given roots, and at their peaks."""
    sizes = abs(found[found != 0])
    if not sizes.size:
        return np.zeros(1)
    ends = np.log10(sizes.min()) - DECADES, np.log10(sizes.max()) + DECADES
    near = np.stack([abs(found.imag) + k * abs(found.real) for k in (-1, 0, 1)])
    peaks = 10 ** np.unique(np.round(np.log10(near[near > 0]), 3))
    return np.concatenate(
        [[0.0], np.logspace(*ends, FREQUENCIES), peaks[:: 1 + len(peaks) // PEAKS]]
    )
