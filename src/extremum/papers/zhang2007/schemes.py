"""The paper's three schemes with two axes, for any numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Final, Literal

from ...controllers import Channel, Dither, GradientES
from ...fields import Field, Quadratic
from ...loop import Loop
from ...lti import Lead, Rational, Transfer, transfer
from ...vehicles import PointMass

Dithers = Literal["quadrature", "separate"]
Gain = float | tuple[float, float]
CURVATURES: Final = (1.0, 0.5)
"""q in all of the paper's figures."""


def two_axes(
    plant: Transfer,
    compensator: Transfer,
    frequency: float,
    amplitude: float,
    gain: Gain,
    *,
    dithers: Dithers = "quadrature",
    field: Field | None = None,
    washout: float = 1.0,
    force: tuple[float, float] | None = None,
    through: Transfer | None = None,
) -> Loop:
    """Return a loop with the same G(s) and C(s) in x and y, started at the origin.

    Parameters
    ----------
    frequency, amplitude, gain, washout
        ω (rad/s), α (m), c (one number or one per axis) and h (1/s).
    dithers
        ``"quadrature"``: sin ωt and −cos ωt, as in the paper's plane; ``"separate"``: sin ωt and
        sin 3ωt/2, one frequency per axis as the paper suggests in space.
    field
        The map; None for the quadratic with q = (1, 0.5), f* = 1, source at the origin.
    force
        A constant force at each input; None for none.
    through
        What the dither goes through; None for G.
    """
    gains: Sequence[float] = gain if isinstance(gain, tuple) else (gain, gain)
    phases = (0.0, -math.pi / 2) if dithers == "quadrature" else (0.0, 0.0)
    ratios = (1, 1) if dithers == "quadrature" else (1, Fraction(3, 2))
    channels = tuple(
        Channel(Dither(amplitude, phase, through), c, compensator, ratio=ratio)
        for phase, c, ratio in zip(phases, gains, ratios, strict=True)
    )
    return Loop(
        field=field or Quadratic(source=(0.0, 0.0), q=CURVATURES, peak=1.0),
        vehicle=PointMass(axes=(plant, plant), disturbance=force),
        controller=GradientES(frequency=frequency, washout=washout, channels=channels),
        start=(0.0, 0.0),
    )


def single_integrators(
    frequency: float,
    amplitude: float,
    gain: Gain,
    *,
    dithers: Dithers = "quadrature",
    field: Field | None = None,
    force: tuple[float, float] | None = None,
) -> Loop:
    """Return the loop of Fig. 1: ẋ = v, v = αω cos ωt + c ξ sin ωt; see `two_axes`."""
    return two_axes(
        *(transfer("1/s"), transfer(1.0), frequency, amplitude, gain),
        dithers=dithers,
        field=field,
        force=force,
    )


def double_integrators(
    frequency: float,
    amplitude: float,
    gain: Gain,
    lead: Lead,
    *,
    dithers: Dithers = "quadrature",
    force: tuple[float, float] | None = None,
) -> Loop:
    """Return the loop of Fig. 2: ẍ = u, u = −αω² sin ωt + C(s)[c ξ sin ωt]; see `two_axes`."""
    plant = transfer("1/s**2")
    return two_axes(plant, lead, frequency, amplitude, gain, dithers=dithers, force=force)


def unstable_poles(
    frequency: float,
    amplitude: float,
    gain: Gain,
    pole: float,
    lead: Lead | None = None,
    *,
    source: tuple[float, float] = (0.0, 0.0),
    dithers: Dithers = "quadrature",
    washout: float = 1.0,
) -> Loop:
    """Return the loop of Fig. 3: ẋ = εx + v, v = αω cos ωt + C(s)[c ξ sin ωt]; see `two_axes`.

    `pole` is ε (1/s), `lead` is C, None for 1, and `source` is where the map has its maximum.
    """
    return two_axes(
        Rational("1/(s - epsilon)", parameters={"epsilon": pole}),
        transfer(1.0) if lead is None else lead,
        *(frequency, amplitude, gain),
        dithers=dithers,
        field=Quadratic(source=source, q=CURVATURES, peak=1.0),
        washout=washout,
        through=transfer("1/s"),
    )
