"""e^x and the hyperbolic functions.

x = n ln 2 + r with |r| ≤ ln 2/2 and e^x = 2^n (1 + q), q = r + r² Q(r), Q minimax for an error
relative to q (Remez). q itself is e^r − 1 without cancellation, from which sinh and tanh follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from .arithmetic import (
    BIAS,
    LN2,
    at_least,
    at_most,
    nearest,
    polynomial,
    power_of_two,
    reduced,
)
from .emitter import Emitter


@dataclass(frozen=True)
class _Range:
    """Where e^x begins and ends to be a number, and e^|x|/2 and tanh to be one and ±1."""

    zero: float
    subnormal: float
    lift: int
    infinite: float
    half_infinite: float
    tanh_one: float
    sinh_linear: float


_RANGE: Final[Mapping[int, _Range]] = {
    64: _Range(-746.0, -700.0, 100, 710.0, 710.48, 40.0, 2.0**-28),
    32: _Range(-104.0, -80.0, 32, 89.0, 89.42, 20.0, 2.0**-13),
}

_EXP: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(0.5000000000000006, 0.16666666666666685, 0.04166666666657362, 0.008333333333314574),
        *(0.0013888888932379845, 0.0001984126990306003, 2.4801504344444794e-05),
        *(2.7557227932341277e-06, 2.7626327223654287e-07, 2.511447888806998e-08),
    ),
    32: (0.5, 0.166665435, 0.0416662805, 0.00836658385, 0.00139464485),
}


def exp(e: Emitter, x: str) -> str:
    """Return e^x; 0 below −745.14 (−103.98), ∞ above 709.79 (88.73), subnormals between."""
    return exp_of_sum(e.like(), x, None)


def exp_of_sum(e: Emitter, x: str, rest: str | None) -> str:
    """Return e^(x + rest), |rest| small beside 1."""
    limits = _RANGE[e.bits]
    x = at_most(e, at_least(e, x, limits.zero), limits.infinite)
    q, shifted = _part(e, x, rest, BIAS[e.bits] - 1)
    low = e.compare("olt", x, e.constant(limits.subnormal))
    lift = e.select(low, e.constant(limits.lift), e.constant(0.0))
    drop = e.select(low, e.constant(2.0 ** (1 - limits.lift)), e.constant(2.0))
    scale = power_of_two(e, e.add(shifted, lift))
    return e.multiply(e.multiply(e.add(q, e.constant(1.0)), scale), drop)


def _part(e: Emitter, x: str, rest: str | None, low: int) -> tuple[str, str]:
    """Return q = e^(x − n ln 2) − 1 and a number with n + low in its low bits."""
    n, shifted = nearest(e, x, 1.4426950408889634, low)
    r = reduced(e, x, n, LN2[e.bits])
    if rest is not None:
        r = e.add(r, rest)
    return e.fma(e.multiply(r, r), polynomial(e, r, _EXP[e.bits]), r), shifted


def _quarter(e: Emitter, x: str) -> tuple[str, str, str]:
    """Return |x|, q, and s so that e^|x|/4 = s(1 + q), which does not overflow too early."""
    size = e.absolute(x)
    bounded = at_most(e, size, _RANGE[e.bits].half_infinite)
    q, shifted = _part(e, bounded, None, BIAS[e.bits] - 2)
    return size, q, power_of_two(e, shifted)


def cosh(e: Emitter, x: str) -> str:
    """Return cosh x = E + 1/(4E), E = e^|x|/2."""
    e = e.like()
    _, q, scale = _quarter(e, x)
    quarter = e.fma(scale, q, scale)
    half = e.add(quarter, quarter)
    return e.add(half, e.divide(e.constant(0.25), half))


def sinh(e: Emitter, x: str) -> str:
    """Return sinh x = (u + u/(u + 1))/2, u = e^|x| − 1, with the sign of x."""
    e = e.like()
    size, q, scale = _quarter(e, x)
    quarter = e.fma(scale, q, e.subtract(scale, e.constant(0.25)))
    whole = e.fma(quarter, e.constant(4.0), e.constant(1.0))
    half = e.add(quarter, e.divide(quarter, whole))
    linear = e.compare("olt", size, e.constant(_RANGE[e.bits].sinh_linear))
    return e.copysign(e.select(linear, size, e.add(half, half)), x)


def tanh(e: Emitter, x: str) -> str:
    """Return tanh x = u/(u + 2), u = e^(2|x|) − 1, with the sign of x."""
    e = e.like()
    size = e.absolute(x)
    double = at_most(e, e.add(size, size), _RANGE[e.bits].tanh_one)
    q, shifted = _part(e, double, None, BIAS[e.bits])
    scale = power_of_two(e, shifted)
    u = e.fma(scale, q, e.subtract(scale, e.constant(1.0)))
    return e.copysign(e.divide(u, e.add(u, e.constant(2.0))), x)
