"""A polynomial in s whose coefficients are polynomials of uncertain numbers, over a box of them."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Final, cast

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Poly, Symbol

from ...errors import InvalidDescription, shown
from ...symbols import decimals_exact, s
from .segments import shifted

MAX_POLYNOMIALS: Final = 4096
"""A family is refused that needs more polynomials than this to bound it."""

Range = tuple[Fraction, Fraction]
Ranges = tuple[Range, ...]
Exact = tuple[int, ...]
Roots = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Family:
    """P(s) = Σ a_kj p₁^k₁ … pₙ^kₙ s^j, with rational numbers a_kj.

    Attributes
    ----------
    symbols
        p₁ … pₙ, those with a range that P depends on.
    ranges
        The box: low and high of each.
    tensor
        a_kj, (d₁ + 1, …, dₙ + 1, degree + 1), of fractions; the highest power of s first.
    box
        The range of every symbol that was given one.
    """

    symbols: tuple[Symbol, ...]
    ranges: Ranges
    tensor: NDArray[Any]
    box: Mapping[Symbol, Range]

    @property
    def degrees(self) -> tuple[int, ...]:
        """dᵢ, the highest power of each symbol."""
        return tuple(size - 1 for size in self.tensor.shape[:-1])

    @cached_property
    def entangled(self) -> tuple[int, ...]:
        """Which symbols occur in a product or a power; the family is affine if none does."""
        powers = np.argwhere((self.tensor != 0).any(axis=-1))
        return tuple(int(i) for i in np.flatnonzero(powers[powers.sum(axis=1) > 1].any(axis=0)))

    @cached_property
    def rough(self) -> NDArray[np.float64]:
        """`tensor` in floats."""
        return self.tensor.astype(float)

    def controls(self, ranges: Ranges, decay: Fraction) -> NDArray[Any]:
        """Return the Bernstein coefficients of P(s − decay) in integers, up to positive factors.

        (d₁ + 1, …, dₙ + 1) lists of integers. P's image of the box lies in their convex hull, those
        at the box's corners being images; where dᵢ = 1, all of them are.
        """
        found = self.tensor * math.lcm(*(c.denominator for c in self.tensor.flat))
        for axis, (degree, limits) in enumerate(zip(self.degrees, ranges, strict=True)):
            weights = bernstein(degree, limits)
            weights = weights * math.lcm(*(c.denominator for c in weights.flat))
            found = _applied(weights, found, axis)
        rate = decay.as_integer_ratio()
        whole = np.empty(found.shape[:-1], dtype=object)
        for index in np.ndindex(whole.shape):
            polynomial = shifted([int(c) for c in found[index]], rate)
            divisor = math.gcd(*polynomial) or 1
            whole[index] = tuple(c // divisor for c in polynomial)
        return whole

    def rough_controls(self, ranges: Ranges) -> NDArray[np.float64]:
        """Return the Bernstein coefficients of P in floats, (d₁ + 1, …, dₙ + 1, degree + 1)."""
        found = self.rough
        for axis, (degree, limits) in enumerate(zip(self.degrees, ranges, strict=True)):
            found = _applied(bernstein(degree, limits).astype(float), found, axis)
        return found

    def at(self, point: Sequence[Fraction], decay: Fraction) -> Exact:
        """Return P(s − decay) at a point of the box, in integers, up to a positive factor."""
        return self.controls(tuple((p, p) for p in point), decay)[(0,) * len(point)]

    def named(self, point: Sequence[Fraction]) -> dict[Symbol, float]:
        """Return a point of the box by symbols; what P does not depend on has its low value."""
        everything = {symbol: low for symbol, (low, _) in self.box.items()}
        everything |= dict(zip(self.symbols, point, strict=True))
        return {symbol: float(value) for symbol, value in everything.items()}

    def rough_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return P in floats at points, (points, symbols), of the box: (points, degree + 1)."""
        found = np.broadcast_to(self.rough, (len(points), *self.rough.shape))
        for axis, degree in enumerate(self.degrees):
            powers = points[:, axis, None] ** np.arange(degree + 1)
            found = np.einsum("pk,pk...->p...", powers, found)
        return found


def family_of(polynomial: Expr | Poly, box: Mapping[Symbol, tuple[float, float]]) -> Family:
    """Return the polynomial in `s` as a family over a box.

    Floats are the decimals that they state: 0.1 is 1/10.

    Raises
    ------
    InvalidDescription
        If it is no polynomial in `s` and the box's symbols with rational numbers, does not depend
        on `s`, needs more than 4096 polynomials to bound it, or if a range is none.
    """
    ranges = {symbol: _range(symbol, limits) for symbol, limits in box.items()}
    expression = polynomial.as_expr() if isinstance(polynomial, Poly) else polynomial
    if not isinstance(expression, Expr):
        raise InvalidDescription("polynomial", "must be a SymPy expression", shown(polynomial))
    fixed = {p: sympy.Rational(low) for p, (low, high) in ranges.items() if low == high}
    expression = sympy.expand(decimals_exact(expression).xreplace(cast(Any, fixed)))
    free = cast(set[Symbol], expression.free_symbols)
    if unknown := sorted(p.name for p in free - {s} - set(ranges)):
        alike = set(unknown) & {p.name for p in ranges}
        hint = "its letter there has other assumptions (real, positive)" if alike else "add it"
        raise InvalidDescription("box", f"states no range of {', '.join(unknown)}; {hint}")
    if s not in free:
        raise InvalidDescription("polynomial", "does not depend on s", shown(str(expression)))
    symbols = tuple(p for p in ranges if p in free)
    try:
        poly = Poly(expression, s, *symbols)
    except sympy.PolynomialError:
        poly = None
    if poly is None or not (poly.domain.is_QQ or poly.domain.is_ZZ):
        raise InvalidDescription(
            "polynomial",
            "must be a polynomial in s and the box's symbols with rational numbers; state others, "
            "such as pi, as floats",
            shown(str(expression)),
        )
    order, *degrees = (int(d) for d in np.max(poly.monoms(), axis=0))
    if (size := math.prod(d + 1 for d in degrees)) > MAX_POLYNOMIALS:
        raise InvalidDescription(
            "box",
            f"its {len(symbols)} symbols need {size:,} polynomials to bound the family; at most "
            f"{MAX_POLYNOMIALS:,} are tested: fix a symbol, or prove it on parts of its range",
        )
    tensor = np.full([*(d + 1 for d in degrees), order + 1], Fraction(0), dtype=object)
    for (power, *powers), c in poly.terms():
        tensor[(*powers, order - power)] = Fraction(int(c.p), int(c.q))
    return Family(symbols, tuple(ranges[p] for p in symbols), tensor, ranges)


def fraction(path: str, number: Any) -> Fraction:
    """Return a finite real number exactly, a float as the decimal that it states."""
    if isinstance(number, numbers.Rational):
        return Fraction(int(number.numerator), int(number.denominator))
    try:
        return Fraction(repr(float(number)))
    except (TypeError, ValueError):
        raise InvalidDescription(path, "must be a finite number", shown(number)) from None


def _range(symbol: Symbol, limits: tuple[float, float]) -> Range:
    """Return the range of a symbol in fractions."""
    path = f"box.{symbol.name}"
    try:
        low, high = limits
    except (TypeError, ValueError):
        raise InvalidDescription(path, "must be (low, high)", shown(limits)) from None
    least, most = fraction(path, low), fraction(path, high)
    if least > most:
        raise InvalidDescription(path, f"must be (low, high); write ({high}, {low})", shown(limits))
    return least, most


def bernstein(degree: int, limits: Range) -> NDArray[Any]:
    """Return b with Bernstein coefficients b @ a of Σ aₖ pᵏ on [low, high].

    b_ik is the mean of the products of k out of d − i times low and i times high.
    Source: Zettler and Garloff (1998), IEEE Transactions on Automatic Control 43(3), 425–431.
    """
    low, high = limits
    found = np.empty((degree + 1, degree + 1), dtype=object)
    for i, k in np.ndindex(found.shape):
        products = sum(
            math.comb(i, j) * math.comb(degree - i, k - j) * high**j * low ** (k - j)
            for j in range(min(i, k) + 1)
        )
        found[i, k] = Fraction(products) / math.comb(degree, k)
    return found


def roots(polynomials: NDArray[np.float64]) -> Roots:
    """Return the roots of polynomials, (…, degree + 1), that begin with no 0: (…, degree)."""
    degree = polynomials.shape[-1] - 1
    companions = np.zeros((*polynomials.shape[:-1], degree, degree))
    companions[..., 0, :] = -polynomials[..., 1:] / polynomials[..., :1]
    companions[..., range(1, degree), range(degree - 1)] = 1
    return np.linalg.eigvals(companions).astype(np.complex128)


def edges(shape: Sequence[int]) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return the box's edges as pairs of indices of corners, for `shape` (2, …, 2)."""
    return [
        (low, (*low[:axis], 1, *low[axis + 1 :]))
        for axis in range(len(shape))
        for low in np.ndindex(*(1 if i == axis else size for i, size in enumerate(shape)))
    ]


def halves(ranges: Ranges, axis: int) -> list[Ranges]:
    """Return a box cut in two across one axis."""
    low, high = ranges[axis]
    middle = (low + high) / 2
    parts: list[Range] = [(low, middle), (middle, high)]
    return [(*ranges[:axis], part, *ranges[axis + 1 :]) for part in parts]


def _applied(weights: NDArray[Any], tensor: NDArray[Any], axis: int) -> NDArray[Any]:
    return np.moveaxis(np.tensordot(weights, tensor, axes=(1, axis)), 0, axis)
