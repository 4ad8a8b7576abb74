"""Rational functions of `s`: their cancelled form and their value on the imaginary axis.

Working out a fraction can take for ever; its size is bounded before anything is multiplied.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, cast

import sympy
from sympy import Expr, Poly

from .errors import InvalidDescription, shown
from .symbols import s

MAX_DEGREE: Final = 32
MAX_TERMS: Final = 2000


@dataclass(frozen=True)
class Ratio:
    """Numerator and denominator of a cancelled transfer function, highest power first, monic."""

    numerator: tuple[Expr, ...]
    denominator: tuple[Expr, ...]

    @property
    def order(self) -> int:
        """The number of states."""
        return len(self.denominator) - 1

    @property
    def numerator_degree(self) -> int:
        """The numerator's degree."""
        return len(self.numerator) - 1

    def __str__(self) -> str:
        num, den = (Poly(list(c), s).as_expr() for c in (self.numerator, self.denominator))
        return str(num / den)


@lru_cache(maxsize=512)
def ratio(expression: Expr) -> Ratio:
    """Return the transfer function as a ratio of coprime polynomials, the denominator monic."""
    if not expression.is_rational_function(s):
        raise InvalidDescription("", "must be a rational function of s", shown(str(expression)))
    _check_size(_size(expression), expression)
    numerator, denominator = sympy.fraction(sympy.cancel(sympy.Mul(*_fraction(expression))))
    num, den = (Poly(p, s).all_coeffs() for p in (numerator, denominator))
    if max(len(num), len(den)) > MAX_DEGREE + 1:
        raise InvalidDescription("", f"has a degree beyond {MAX_DEGREE}", shown(str(expression)))
    leading = den[0]
    num, den = ([sympy.factor_terms(sympy.cancel(c / leading)) for c in cs] for cs in (num, den))
    return Ratio(tuple(num), tuple(den))


@lru_cache(maxsize=512)
def at_frequency(expression: Expr, frequency: float) -> complex:
    """Return G(jω) at ω = `frequency` (rad/s) for an expression without free parameters."""
    form = ratio(expression)
    try:
        numerator, denominator = (
            sum(complex(c) * (1j * frequency) ** i for i, c in enumerate(reversed(cs)))
            for cs in (form.numerator, form.denominator)
        )
    except OverflowError:
        return complex("inf")
    return complex(numerator / denominator) if denominator else complex("inf")


def vanishes(expression: Expr) -> bool:
    """Return whether a rational function of its letters is 0 whatever they are.

    Judged in exact arithmetic at a place drawn at random, each letter one of 2⁶³ integers: one that
    is not 0 is so there with a probability of its degree over 2⁶³ (Schwartz and Zippel). A sum that
    cancels as a whole is seen without being worked out.
    """
    draw = random.Random(0)
    letters = sorted(expression.free_symbols, key=str)
    place = {x: sympy.Integer(draw.getrandbits(63) + 1) for x in letters}
    return expression.xreplace(cast(Any, place)) == 0


def response_parts(expression: Expr, frequency: Expr) -> tuple[Expr, Expr]:
    """Return Re G(jω) and Im G(jω) as real expressions of ω and the parameters."""
    numerator, denominator = sympy.fraction(sympy.cancel(sympy.together(expression)))
    (a, b), (c, d) = (_even_odd(p, frequency) for p in (numerator, denominator))
    size = c**2 + d**2
    return tuple(sympy.factor(sympy.cancel(e / size)) for e in (a * c + b * d, b * c - a * d))  # pyright: ignore[reportReturnType]


def _even_odd(polynomial: Expr, frequency: Expr) -> tuple[Expr, Expr]:
    real, imaginary = sympy.Integer(0), sympy.Integer(0)
    for (power,), coefficient in Poly(polynomial, s).terms():
        term = coefficient * frequency**power * (-1) ** (power // 2)
        real, imaginary = (real, imaginary + term) if power % 2 else (real + term, imaginary)
    return real, imaginary


@dataclass(frozen=True)
class _Size:
    """Bounds on a fraction before it is worked out: degrees in s, and terms with letters."""

    up: int = 0
    down: int = 0
    above: int = 1
    below: int = 1

    def __mul__(self, other: _Size) -> _Size:
        return _Size(
            self.up + other.up,
            self.down + other.down,
            self.above * other.above,
            self.below * other.below,
        )

    def __add__(self, other: _Size) -> _Size:
        return _Size(
            max(self.up + other.down, other.up + self.down),
            self.down + other.down,
            self.above * other.below + other.above * self.below,
            self.below * other.below,
        )

    def to_the(self, power: int, letters: bool) -> _Size:
        count = abs(power)
        terms = (min(n**count, 10**9) if letters else 1 for n in (self.above, self.below))
        raised = _Size(self.up * count, self.down * count, *terms)
        if power > 0:
            return raised
        return _Size(raised.down, raised.up, raised.below, raised.above)


def _size(expression: Expr) -> _Size:
    letters = bool(expression.free_symbols - {s})
    if not expression.has(s):
        return _Size(above=2 if letters and expression.is_Add else 1)
    if expression == s:
        return _Size(1)
    first, *rest = (_size(cast(Expr, part)) for part in expression.args)
    size = first
    if isinstance(expression, sympy.Pow):
        size = first.to_the(int(expression.exp), letters)
    for part in () if isinstance(expression, sympy.Pow) else rest:
        size = size * part if expression.is_Mul else size + part
    _check_size(size, expression)
    return size


def _check_size(size: _Size, expression: Expr) -> None:
    if max(size.up, size.down) > 2 * MAX_DEGREE:
        raise InvalidDescription("", f"has a degree beyond {MAX_DEGREE}", shown(str(expression)))
    if expression.free_symbols - {s} and max(size.above, size.below) > MAX_TERMS:
        raise InvalidDescription(
            "", f"has more than {MAX_TERMS} terms when multiplied out", shown(str(expression))
        )


def _fraction(expression: Expr) -> tuple[Expr, Expr]:
    """Return numerator and 1/denominator, numbers expanded on the way."""
    if expression == s or not expression.has(s):
        return expression, sympy.Integer(1)
    if isinstance(expression, sympy.Pow):
        top, bottom = _fraction(cast(Expr, expression.base))
        power = int(expression.exp)
        return (top**power, bottom**power) if power > 0 else (1 / bottom**-power, top**power)
    top, bottom = sympy.Integer(0 if expression.is_Add else 1), sympy.Integer(1)
    for part in expression.args:
        above, below = _fraction(cast(Expr, part))
        if expression.is_Mul:
            top, bottom = top * above, bottom * below
        else:
            top, bottom = sympy.expand(top / below + above / bottom), bottom * below
    return sympy.expand(top), bottom
