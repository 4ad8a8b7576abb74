"""Routh's array and Hurwitz determinants of a polynomial with numbers for coefficients."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any, Final

import numpy as np

from ..errors import InvalidDescription, shown

MAX_EXPONENT: Final = 900
"""Determinants are multiplied back into powers of 1/s by at most 2^±900: no overflow, no 0."""


@dataclass(frozen=True)
class RouthArray:
    """Routh's array of a real polynomial and what its first column says.

    Attributes
    ----------
    table
        One row for each power of λ, the highest first, as computed (see `routh`).
    unstable
        How many roots have Re λ > 0: the changes of sign in the first column.
    imaginary
        How many roots lie on the imaginary axis.
    """

    table: tuple[tuple[float, ...], ...]
    unstable: int
    imaginary: int

    @property
    def stable(self) -> bool:
        """Whether all roots have Re λ < 0."""
        return self.unstable == 0 and self.imaginary == 0

    def text(self) -> str:
        """Return the array as lines of text, each with its power of λ."""
        rows = [[f"{entry:.6g}" for entry in row] for row in self.table]
        width = max(len(entry) for row in rows for entry in row)
        powers = [f"λ^{power}" for power in reversed(range(len(rows)))]
        return "\n".join(
            f"{power:<{len(powers[0])}} | {'  '.join(f'{entry:>{width}}' for entry in row)}"
            for power, row in zip(powers, rows, strict=True)
        )


def routh(coefficients: Sequence[float]) -> RouthArray:
    """Return Routh's array of the polynomial with these coefficients, highest power first.

    Worked out in exact fractions of the decimals that the floats state, so neither the scale of λ
    nor rounding matters: λ³ + 0.3 λ² + 0.7 λ + 0.21 = (λ + 0.3)(λ² + 0.7) has two roots on the
    imaginary axis. The two singular cases:

    - A row of zeros, where some roots lie symmetric about 0, is replaced by the derivative of the
      auxiliary polynomial, which the row above states.
    - A row that begins with m zeros has itself, shifted left by m and times (−1)ᵐ, added. On the
      imaginary axis that multiplies the row's polynomial by 1 + ω²ᵐ > 0: the count is that of the
      limit ε → 0+ of the textbooks, without ε. Source: Benidir and Picinbono (1990), IEEE
      Transactions on Automatic Control 35(2), 218–222.

    Raises
    ------
    InvalidDescription
        If a coefficient is not a finite real number, or all are 0.
    """
    exactly = [_fraction(c, i) for i, c in enumerate(coefficients)]
    leading = next((i for i, c in enumerate(exactly) if c), None)
    if leading is None:
        raise InvalidDescription("coefficients", "must not all be 0", shown(list(coefficients)))
    exactly = exactly[leading:]
    degree = len(exactly) - 1
    rows = [exactly[::2]]
    following = exactly[1::2]
    symmetric: int | None = None  # the degree of the first auxiliary polynomial
    for power in range(degree - 1, -1, -1):
        above = rows[-1]
        row = following
        if not any(row):
            symmetric = power + 1 if symmetric is None else symmetric
            row = [c * (power + 1 - 2 * j) for j, c in enumerate(above)][: power // 2 + 1]
        elif not row[0]:
            zeros = next(m for m, c in enumerate(row) if c)
            shifted = [*row[zeros:], *row[:zeros]]
            row = [a + (-1) ** zeros * b for a, b in zip(row, shifted, strict=True)]
        rows.append(row)
        padded = [*row, Fraction(0)]
        following = [
            above[j + 1] - above[0] * padded[j + 1] / row[0] for j in range((power + 1) // 2)
        ]
    unstable = _changes([row[0] for row in rows])
    imaginary = 0
    if symmetric is not None:
        imaginary = symmetric - 2 * _changes([row[0] for row in rows[degree - symmetric :]])
    return RouthArray(tuple(tuple(map(_float, row)) for row in rows), unstable, imaginary)


def _fraction(number: Any, index: int) -> Fraction:
    if not isinstance(number, numbers.Real) or not math.isfinite(number):
        raise InvalidDescription(f"coefficients.{index}", "must be a finite number", shown(number))
    return Fraction(repr(float(number)))


def _float(number: Fraction) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _changes(column: Sequence[Fraction]) -> int:
    return sum((a > 0) != (b > 0) for a, b in pairwise(column))


def hurwitz_rows(coefficients: Sequence[Any], order: int) -> list[list[Any]]:
    """Return the rows of a₂ⱼ₋ᵢ for i, j = 1 … order, with 0 outside a₀ … aₙ."""
    inside = range(len(coefficients))
    return [
        [coefficients[2 * j - i] if 2 * j - i in inside else 0 for j in range(1, order + 1)]
        for i in range(1, order + 1)
    ]


def hurwitz_determinant(coefficients: Sequence[float], order: int) -> tuple[float, float]:
    """Return Δₖ = det[a₂ⱼ₋ᵢ], i, j = 1 … k = `order`, and its margin.

    The first coefficient is 1. The margin, −1 … 1, is Δₖ over the sum of the absolute values of its
    products of entries (the permanent of |a₂ⱼ₋ᵢ|). Both are computed in a unit of time, a power
    of 2, in which no |aᵢ| exceeds 1.
    """
    rate = max((abs(a) ** (1 / i) for i, a in enumerate(coefficients[1:], 1)), default=0.0)
    if not 0 < rate < math.inf:
        return (0.0, 0.0) if rate == 0 else (math.nan, math.nan)
    unit = math.ceil(math.log2(rate))
    rows = hurwitz_rows([math.ldexp(a, -unit * i) for i, a in enumerate(coefficients)], order)
    value = float(np.linalg.det(np.array(rows, dtype=float)))
    size = permanent([[abs(a) for a in row] for row in rows])
    exponent = max(-MAX_EXPONENT, min(MAX_EXPONENT, unit * order * (order + 1) // 2))
    return math.ldexp(value, exponent), value / max(size, abs(value)) if value else 0.0


def permanent(rows: Sequence[Sequence[float]], enough: float = math.inf) -> float:
    """Return the sum of all products of one entry ≥ 0 from each row and column.

    Row by row over the sets of used columns, of which a banded matrix has few. The sum is broken
    off, and what is reached returned, once the products of the first rows exceed `enough`.
    """
    products: dict[int, float] = {0: 1}
    for row in rows:
        longer: dict[int, float] = {}
        for used, product in products.items():
            for j, entry in enumerate(row):
                key = used | 1 << j
                if entry and key != used:
                    longer[key] = longer.get(key, 0) + product * entry
        products = longer
        if sum(products.values()) > enough:
            break
    return sum(products.values())
