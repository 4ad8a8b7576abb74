"""The characteristic polynomial of the averaged loop, with letters for uncertain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import sympy
from sympy import Expr, Poly

from ...errors import InvalidDescription, shown
from ...rational import ratio
from ...symbols import decimals_exact, s
from ..linear import polynomial


def characteristic(plant: Expr, compensator: Expr, gain: Expr | float) -> Poly:
    """Return D D_c + g N N_c in `s`, for one axis 1 + g C(s) G(s) = 0 of the averaged loop.

    G = N/D and C = N_c/D_c are each cancelled, as they are realised, but not with one another: a
    pole of the plant that is a zero of the compensator is a root. Multiplied by what makes its
    coefficients polynomials in the letters.

    Parameters
    ----------
    plant, compensator
        Rational functions of `s`, with letters for uncertain numbers.
    gain
        g = α c q m: dither amplitude, gain, curvature q = −½ ∂²J/∂x², and m = ω/√(ω² + h²) where
        the reference corrects the washout's phase.

    Raises
    ------
    InvalidDescription
        If one is no rational function of `s`.
    """
    return coupled([plant], [compensator], [[gain]], [[1]])


def coupled(
    plants: Sequence[Expr],
    compensators: Sequence[Expr],
    gains: Sequence[Sequence[Expr | float]],
    curvature: Sequence[Sequence[Expr | float]],
) -> Poly:
    """Return det(diag(DᵢD_ci) + diag(NᵢN_ci) K) in `s`, K = gains · curvature.

    The roots of the averaged loop of several axes, J = peak − x̃ᵀQx̃. A letter Q_ij = Q_ji is one
    symbol: the polynomial is quadratic in it, and the Bernstein coefficients that `prove` takes
    for low², low · high and high² lie in the convex hull that two independent letters would have,
    but stay together where the box is cut.

    Parameters
    ----------
    plants, compensators
        As for `characteristic`, one per axis.
    gains
        2 diag(c) M, (axes, axes): diag(c α m) where no axes are mixed.
    curvature
        Q, symmetric, (axes, axes), with letters for uncertain numbers.

    Raises
    ------
    InvalidDescription
        If a transfer function is none, or the sizes differ.
    """
    n = len(plants)
    k, q = (sympy.Matrix([list(row) for row in rows]) for rows in (gains, curvature))
    if {len(compensators), *k.shape, *q.shape} != {n}:
        raise InvalidDescription(
            "compensators, gains, curvature",
            f"must be {n} and {n} × {n} for {n} plants",
            shown((len(compensators), k.shape, q.shape)),
        )
    if n > 1 and not q.is_symmetric():
        raise InvalidDescription("curvature", "must be symmetric", shown(curvature))
    parts = [_parts(_exact(g), _exact(c)) for g, c in zip(plants, compensators, strict=True)]
    below, above = (sympy.diag(*column) for column in zip(*parts, strict=True))
    found: Any = below + above * (k * q).applyfunc(_exact)
    return Poly(found.det(method="berkowitz"), s)


def _parts(plant: Expr, compensator: Expr) -> tuple[Expr, Expr]:
    """Return D D_c and N N_c without fractions of letters."""
    pair = ratio(plant), ratio(compensator)
    below, above = sympy.Integer(1), sympy.Integer(1)
    for g in pair:
        factor = sympy.lcm_list([sympy.denom(c) for c in (*g.numerator, *g.denominator)])
        below *= polynomial([sympy.cancel(factor * c) for c in g.denominator])
        above *= polynomial([sympy.cancel(factor * c) for c in g.numerator])
    return below, above


def _exact(expression: Any) -> Expr:
    return decimals_exact(cast(Expr, sympy.sympify(expression, strict=True)))
