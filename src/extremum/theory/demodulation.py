"""The demodulation matrix: what each channel's reference makes of each axis' dither."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import sympy
from sympy import Expr, ImmutableMatrix

from ..controllers import GradientES
from ..errors import InvalidDescription
from ..loop import Loop
from ..symbols import s, sine
from ..symbols import t as time
from .fourier import passed, turned
from .frame import Relative


@lru_cache(maxsize=256)
def demodulation(equations: Relative, twin: Loop, *, limit: bool) -> ImmutableMatrix:
    """Return M_ij = ⟨reference_i · (F(s) s/(s + h))[a_j(t)]⟩, a_j the position's steady dither.

    The averaged loop is −diag(c) C G M H with H the Hessian. In the ideal M = ½ diag(α): one
    frequency per axis, or two axes in quadrature, with references in phase with the dithers. At
    finite ω the washout turns every entry by atan(h/ω); a phase error in a reference turns its row;
    axes that share a frequency out of quadrature couple. A sensor F turns and shrinks column j by
    F(jω_j), which is what the references are to be corrected by, ψ = φ + atan(h/ω) + arg F(jω).

    Parameters
    ----------
    equations, twin
        Of one structure: ``frame.equations`` and ``frame.loop.twin``.
    limit
        Whether to take the limit ω → ∞, in which the washout passes the dither unchanged. The
        sensor does not: F(jω_j) stays as it is at the loop's ω.

    Raises
    ------
    InvalidDescription
        For a controller that does not demodulate.
    """
    controller = gradient(twin)
    washout = sympy.Integer(1) if limit else s / (s + controller.washout)
    passing = twin.sensor.law() * washout
    swings = equations.dither_limit if limit else equations.dither
    rows = []
    for channel, frequency in zip(controller.channels, controller.frequencies(), strict=True):
        phase = (channel.reference or channel.dither).phase
        reference = sympy.expand(turned(sine(frequency * time, phase), equations.oscillators))
        rows.append([_mean(reference, sympy.expand(a), passing, equations) for a in swings])
    return ImmutableMatrix(rows)


def gradient(loop: Loop) -> GradientES:
    """Return the loop's controller, refusing one that does not demodulate."""
    if not isinstance(loop.controller, GradientES):
        kind = type(loop.controller).__name__
        raise InvalidDescription("controller", "does not demodulate: it is no GradientES", kind)
    return loop.controller


def _mean(reference: Any, swing: Any, passing: Expr, equations: Relative) -> Expr:
    parts = []
    for o in equations.oscillators:
        heard = passed(passing, o.frequency, swing.coeff(o.cosine), swing.coeff(o.sine))
        weights = (reference.coeff(o.cosine), reference.coeff(o.sine))
        parts += [w * a for w, a in zip(weights, heard, strict=True)]
    return sympy.factor(sympy.cancel(sympy.Add(*parts) / 2))  # pyright: ignore[reportReturnType]
