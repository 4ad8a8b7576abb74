"""Signals of unknown scale made comparable before they are fed back."""

from __future__ import annotations

from typing import Any, Final

import sympy
from sympy import Expr

from ..description import Description, value
from ..errors import InvalidDescription
from ..logic import maximum, minimum, positive
from ..symbols import plain
from .diagram import SampledDiagram

LEAST: Final = 1e-18
"""The smallest number whose square is one in single precision too."""


COUNTED: Final = 2.0**24
"""Samples that are counted; single precision counts no further."""


class Scale(Description, abstract=True):
    """What makes the loop's gain independent of the signal's scale."""

    def before(self, sample: Expr) -> Expr:
        """Return the sample after its scale; a number whatever the sample is."""
        return sample

    def after(self, diagram: SampledDiagram, xi: Expr, good: Expr) -> Expr:
        """Return ξ after its scale; `good` is positive where the sample counts."""
        return xi


class LogScale(Scale):
    """The logarithm of a positive signal, ln max(J, floor).

    Averaged: ∇ ln J = ∇J/J, so that the loop gain α c q C G is divided by J at the vehicle's
    position: a signal that is twice as strong everywhere is followed in the same way, and near the
    peak the loop has the curvature q/J*. Where J ∝ r^−n the gradient is n/r, however weak J is.
    Below `floor` the signal counts as flat. Whatever else speaks of the signal then speaks of ln J:
    the washout's start, and level, background and response of detector and shrinking dither.

    Parameters
    ----------
    floor
        Smallest signal that is told from nothing (unit of J).
    """

    floor: float = value("J_0", "1", "smallest signal", positive=True)

    def before(self, sample: Expr) -> Expr:
        """Return ln max(J, floor)."""
        return sympy.log(maximum(sample, plain(self.floor)))  # pyright: ignore[reportReturnType]


class RunningScale(Scale):
    """ξ divided by its own running size, ν = ξ/√(σ² + floor²), σ² the mean of ξ² over `time`.

    σ²_k = σ²_(k−1) + max(1 − e^(−dt/T), 1/k) (ξ_k² − σ²_(k−1)),

    over the samples k = 1, 2, … that count: a plain mean at first, so that there is no kick.

    Averaged over the dither, with one axis and J = −q x̃²: σ² = α²q²(2 x̃² + α²/8), so that

    x̃' = −c α q x̃ C G/√(α²q²(2 x̃² + α²/8) + floor²).

    Far away 1/s moves at the speed v = c/√2 whatever q is, as long as that is less than hα: the
    slope's drift through the washout, v/h, adds to σ, v² (α²/2 + v²/h²) = c²α²/4. At the peak the
    loop gain is c 2√2/α C G, which does not depend on q, as long as `floor` is less than α²q/√8; a
    larger floor gives back c α q/floor. On several axes that share a frequency in quadrature the
    ripple at the peak is that of q_x − q_y: where that is 0, `floor` alone bounds the gain there.

    Parameters
    ----------
    time
        T (s): many dither periods, and less than the loop's own time.
    floor
        Size of ξ below which it counts as noise (unit of J).
    """

    time: float = value("T_s", "s", "T of the running mean of ξ²", positive=True)
    floor: float = value("xi_0", "1", "size of ξ that is noise", positive=True)

    def check(self) -> None:
        """Refuse a floor whose square is 0 in single precision."""
        if self.floor < LEAST:
            raise InvalidDescription(
                "floor", f"must be at least {LEAST:g}, or its square is 0", repr(self.floor)
            )

    def after(self, diagram: SampledDiagram, xi: Expr, good: Expr) -> Expr:
        """Draw σ² and return ν."""
        past, seen = diagram.state("sigma2", "1", 0), diagram.state("seen", "1", 0)
        count = diagram.signal("samples", positive(good, minimum(seen + 1, COUNTED), seen), "1")
        diagram.follow(seen, count)
        share = maximum(diagram.share(plain(self.time)), 1 / maximum(count, 1))
        mean: Any = past + positive(good, share, 0) * (xi * xi - past)
        now = diagram.signal("size2", mean, "1")
        diagram.follow(past, now)
        floor = plain(self.floor)
        return diagram.signal("nu", xi / sympy.sqrt(now + floor * floor), "1")
