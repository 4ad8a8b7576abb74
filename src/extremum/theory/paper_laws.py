"""What the paper prints for its three schemes, and what is right, in one axis' letters.

With g = α c k q, the averaged loop is 1 + g C(s)/k · G(s) = 0, C/k = (s − z)/(s − p):

====================  =======================================  ====================================
scheme                printed                                  corrected
====================  =======================================  ====================================
1/s, C = k            λ + g                                    the same
1/s², lead            λ³ − pλ² + gλ − g(z + h), (27), (31)     λ³ − pλ² + gλ − gz
1/(s − ε), C = k      λ + g − ε                                the same
1/(s − ε), lead       λ² + (g − ε − p)λ + (g + p)ε − g(z + h)  λ² + (g − ε − p)λ + pε − gz
====================  =======================================  ====================================

Each has the washout's mode −h besides. The offsets are (43) and (54), or zero; the corrected ones
hold for a constant force d at the input, which the paper says is accommodated.
Source: Zhang, Siranosian and Krstić (2007), (27) to (64). Its errors are those of (27) and (52),
which average an equation that still holds terms of order ω.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Poly, Symbol

from .conditions import Condition
from .hurwitz import LAMBDA, summands


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the paper's formulas, printed or corrected, say of a loop as ω → ∞.

    Attributes
    ----------
    conditions
        The stability conditions, each under the paper's equation number and its axis.
    polynomials
        Per axis the averaged characteristic polynomial in λ (1/s), monic.
    offsets
        Per axis x̃ᵉ, the mean distance from the source (m); empty for a moving source.
    offset
        Their values; NaN where there is no equilibrium.
    eigenvalues
        The roots of all polynomials, and −h (1/s).
    """

    conditions: tuple[Condition, ...]
    polynomials: tuple[Expr, ...]
    offsets: tuple[Expr, ...]
    offset: NDArray[np.float64]
    eigenvalues: NDArray[np.complex128]

    @property
    def stable(self) -> bool:
        """Whether every condition holds."""
        return all(condition.holds for condition in self.conditions)

    @property
    def rate(self) -> float:
        """The largest real part of the eigenvalues (1/s)."""
        return float(self.eigenvalues.real.max())


@dataclass(frozen=True)
class Axis:
    """One axis' letters: g = α c k q, ε, z, p, x* and the constant force d at the input."""

    name: str
    g: Expr
    pole: Expr
    z: Expr
    p: Expr
    source: Expr
    force: Expr


Law = tuple[tuple[Expr, ...], Expr, tuple[Expr, Expr]]
"""Conditions (> 0), characteristic polynomial, numerator and denominator of x̃ᵉ."""


def printed(theorem: int, axis: Axis, h: Expr) -> Law:
    """Return what the paper prints for a theorem's scheme; `h` is the washout's corner."""
    g, e, z, p, lam = axis.g, axis.pole, axis.z, axis.p, LAMBDA
    zero, one = sympy.Integer(0), sympy.Integer(1)
    match theorem:
        case 2:
            conditions = (-p, g, -g * (z + h), -g * p + g * (z + h))
            return conditions, lam**3 - p * lam**2 + g * lam - g * (z + h), (zero, one)
        case 4:
            last = (g + p) * e - g * (z + h)
            polynomial = lam**2 + (g - e - p) * lam + last
            return (g - e - p, last), polynomial, (p * e * axis.source, g * (z - e + h) - p * e)
        case _:
            return (g - e,), lam + g - e, (e * axis.source, g - e)


def corrected(theorem: int, axis: Axis) -> Law:
    """Return what is right for a theorem's scheme."""
    g, e, z, p, lam = axis.g, axis.pole, axis.z, axis.p, LAMBDA
    push = e * axis.source + axis.force
    match theorem:
        case 2:
            conditions = (-p, g, -g * z, -g * p + g * z)
            return conditions, lam**3 - p * lam**2 + g * lam - g * z, (p * push, g * z)
        case 4:
            last = p * e - g * z
            polynomial = lam**2 + (g - e - p) * lam + last
            return (g - e - p, last), polynomial, (p * push, -last)
        case _:
            return (g - e,), lam + g - e, (push, g - e)


NUMBERS: Final = {
    1: (("(14)",), ("(14)",), "(14)"),
    2: (("(32)", "(33)", "(34)", "(35)"), ("(36)", "(37)", "(38)", "(39)"), "(40)"),
    3: (("(43)",), ("(43)",), "(14)"),
    4: (("(60)", "(61)"), ("(62)", "(63)"), "(64)"),
}
"""Per theorem the equation numbers of the conditions in x, in y, and of h > 0."""


@dataclass(frozen=True, eq=False)
class Formulas:
    """A `Prediction` before its numbers are put in; made by `formulas`."""

    named: tuple[tuple[str, Expr], ...]
    polynomials: tuple[Expr, ...]
    offsets: tuple[Expr, ...]
    compiled: Any

    def at(self, values: Sequence[float]) -> Prediction:
        """Return the prediction for the parameters' values."""
        sums, coefficients, offsets, washout = self.compiled(values)
        conditions = []
        for (name, expression), terms in zip(self.named, sums, strict=True):
            size, most = math.fsum(terms), math.fsum(map(abs, terms))
            conditions.append(Condition(name, expression, size, size / most if most else 0.0))
        roots = (np.roots(row) for row in coefficients)
        return Prediction(
            tuple(conditions),
            self.polynomials,
            self.offsets,
            np.array([top / bottom if bottom else math.nan for top, bottom in offsets]) + 0.0,
            np.concatenate([*roots, [-washout]]).astype(complex),
        )


def formulas(
    theorem: int,
    axes: Sequence[Axis],
    laws: Sequence[Law],
    washout: Expr,
    symbols: Sequence[Symbol],
    *,
    moving: bool,
) -> Formulas:
    """Return the laws of all axes together, ready for numbers.

    Parameters
    ----------
    symbols
        The parameters, in the order in which their values will come.
    moving
        Whether the source moves, so that there is no offset to speak of.
    """
    first, second, last = NUMBERS[theorem]
    named: list[tuple[str, Expr]] = []
    for index, (axis, (conditions, _, _)) in enumerate(zip(axes, laws, strict=True)):
        numbers = second if index == 1 else first
        named += [(f"{n} {axis.name}", e) for n, e in zip(numbers, conditions, strict=True)]
    named.append((f"{last} h", washout))
    polynomials = tuple(polynomial for _, polynomial, _ in laws)
    offsets = [] if moving else [offset for _, _, offset in laws]
    flat = [
        [list(summands(e)) for _, e in named],
        [Poly(p, LAMBDA).all_coeffs() for p in polynomials],
        [list(pair) for pair in offsets],
        washout,
    ]
    return Formulas(
        tuple(named),
        polynomials,
        tuple(top / bottom for top, bottom in offsets),
        sympy.lambdify([list(symbols)], flat, "math", dummify=True),
    )
