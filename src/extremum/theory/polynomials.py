"""Polynomials in floats: their values, and what of rough solutions is a solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESIDUAL: Final = 1e-14
"""A point solves an equation whose value is smaller than this, relative to the terms' sizes."""
ZERO: Final = 1e-16
"""Smaller steps and unknowns, in units in which the coefficients are close to 1, are zero."""
SINGULAR: Final = 1e-6
"""A solution counts as a multiple one if its Jacobian's smallest singular value is below this,
per unit of the terms' sizes."""
BETWEEN: Final = (5**0.5 - 2, 2**0.5 - 1, 3**0.5 - 1)
"""Where between two points to look; solutions in rational positions do not lie there."""
NEWTON_STEPS: Final = 60


@dataclass(frozen=True)
class Numeric:
    """Polynomials as sums of coefficients × monomials, in floats.

    `coefficients` has shape (polynomial, monomial), `slopes` (unknown, polynomial, monomial).
    """

    exponents: NDArray[np.int64]
    coefficients: Array
    slopes: Array

    @staticmethod
    def of(polynomials: Sequence[Any]) -> Numeric:
        """Return elements of one SymPy polynomial ring in floats."""
        gens = polynomials[0].ring.gens
        slopes = [[p.diff(x) for p in polynomials] for x in gens]
        every = [*polynomials, *(p for row in slopes for p in row)]
        monomials = sorted({m for p in every for m in p.monoms()} | {(0,) * len(gens)})
        place = {monomial: j for j, monomial in enumerate(monomials)}

        def table(rows: Sequence[Any]) -> Array:
            numbers = np.zeros((len(rows), len(monomials)))
            for row, p in zip(numbers, rows, strict=True):
                for powers, c in p.terms():
                    row[place[powers]] = float(c)
            return numbers

        return Numeric(
            np.array(monomials), table(polynomials), np.array([table(row) for row in slopes])
        )

    def _monomials(self, point: Any) -> Any:
        return np.prod(point**self.exponents, axis=1)

    def values(self, point: Any) -> Any:
        """Return the polynomials' values."""
        return self.coefficients @ self._monomials(point)

    def _sizes(self, point: Any) -> Array:
        return abs(self.coefficients) @ self._monomials(np.maximum(abs(point), 1.0))

    def residual(self, point: Any) -> float:
        """Return the largest value relative to its terms' sizes (at unknowns of at least 1)."""
        with np.errstate(all="ignore"):
            return float(np.max(abs(self.values(point)) / self._sizes(point)))

    def polished(self, start: Any) -> Any:
        """Return where Newton's method comes closest (Gauss–Newton's where it is singular).

        Real from a real start, complex from a complex one.
        """
        point = best = start
        lowest = self.residual(start)
        for _ in range(NEWTON_STEPS):
            with np.errstate(all="ignore"):
                monomials = self._monomials(point)
                values, slopes = self.coefficients @ monomials, (self.slopes @ monomials).T
            if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
                break
            step = np.linalg.lstsq(slopes, -values, rcond=None)[0]
            point = point + step
            residual = self.residual(point)
            if residual < lowest:
                best, lowest = point, residual
            if np.linalg.norm(step) <= ZERO * max(1.0, float(np.linalg.norm(point))):
                break
        return best

    def distinct(self, points: Sequence[Any]) -> list[Any]:
        """Return the points that solve the equations, once each.

        Two are the same if all between them solves the equations as well.
        """
        residuals = [self.residual(point) for point in points]
        kept: list[Any] = []
        for i in np.argsort(residuals, stable=True):
            solves = residuals[i] <= RESIDUAL
            if solves and not any(self._linked(points[i], other) for other in kept):
                kept.append(points[i])
        return kept

    def _linked(self, one: Any, other: Any) -> bool:
        between = (one + part * (other - one) for part in BETWEEN)
        return all(self.residual(point) <= RESIDUAL for point in between)

    def leads_everywhere(self, candidates: NDArray[np.complex128]) -> bool:
        """Return whether as many solutions as candidates are found from them.

        Several may lead to one solution only if that is a multiple one.
        """
        ends = [self.polished(start) for start in candidates]
        count = 0
        for point in self.distinct(ends):
            with np.errstate(all="ignore"):
                slopes = (self.slopes @ self._monomials(point)).T * np.maximum(abs(point), 1.0)
            smallest = np.linalg.svd(slopes / self._sizes(point)[:, None], compute_uv=False)[-1]
            simple = smallest > SINGULAR
            count += 1 if simple else sum(self._linked(point, end) for end in ends)
        return count >= len(candidates)

    def centred(self, point: Array, candidates: NDArray[np.complex128]) -> Array:
        """Return the mean of the candidates that are the same as a point, else the point itself.

        Newton's method gives an m-fold solution with 1/m of the digits; the m candidates around it
        are off by as much, but their mean is not.
        """
        cluster = [candidate for candidate in candidates if self._linked(candidate, point)]
        return np.mean(cluster, axis=0).real if len(cluster) > 1 else point
