"""asin, acos, atan and atan2.

atan(a/b) for a, b ≥ 0 is π/2 − atan(b/a), π/4 + atan((a − b)/(a + b)) or itself, so that the
argument is at most tan(π/8); asin beyond ½ is π/2 − 2 asin √((1 − |x|)/2). Polynomials in the
square of the argument are minimax for a relative error (Remez).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, pi
from typing import Final

from .arithmetic import polynomial
from .emitter import Emitter

_TAN_EIGHTH: Final = 0.41421356237309503
_LARGE: Final = {64: 2.0**1000, 32: 2.0**120}
_PI: Final = {64: (pi, 1.2246467991473532e-16), 32: (3.14159274, -8.74227766e-08)}

_ATAN: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(-0.333333333333332, 0.19999999999954, -0.14285714280239722, 0.11111110785677801),
        *(-0.09090897822693292, 0.07692061383964868, -0.06663117418366156, 0.05847986747834325),
        *(-0.05039743149688621, 0.038075661402814834, -0.017919306120939827),
    ),
    32: (-0.333333164, 0.199984878, -0.142438263, 0.105958246, -0.0608298331),
}

_ASIN: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(0.16666666666665375, 0.07500000000344811, 0.044642856821965934, 0.030381959395783316),
        *(0.022371751934063832, 0.017359795648157674, 0.013884350776361725),
        *(0.012174938482516252, 0.006503541875983348, 0.019594271638703902),
        *(-0.01632657076168584, 0.031981598695188046),
    ),
    32: (0.166667536, 0.0749523267, 0.045478344, 0.024140995, 0.0422305278),
}


def _odd(e: Emitter, x: str, z: str, coefficients: tuple[float, ...]) -> str:
    """Return x + x z P(z), z = x²."""
    return e.fma(e.multiply(x, z), polynomial(e, z, coefficients), x)


def _angle(e: Emitter, a: str, b: str) -> str:
    """Return the angle in [0, π/2] of a/b, a ≥ 0, b ≥ 0, not both 0 nor both ∞."""
    high, low = (e.constant(part) for part in _PI[e.bits])
    steep = e.compare("ogt", a, e.multiply(b, e.constant(2 + _TAN_EIGHTH)))
    middle = e.compare("ogt", a, e.multiply(b, e.constant(_TAN_EIGHTH)))
    above = e.select(middle, e.subtract(a, b), a)
    below = e.select(middle, e.add(a, b), b)
    t = e.divide(e.select(steep, e.negative(b), above), e.select(steep, a, below))
    quarter, half, none = e.constant(0.25), e.constant(0.5), e.constant(0.0)
    turn = e.select(steep, half, e.select(middle, quarter, none))
    arc = _odd(e, t, e.multiply(t, t), _ATAN[e.bits])
    return e.fma(turn, high, e.fma(turn, low, arc))


def atan(e: Emitter, x: str) -> str:
    """Return atan x."""
    e = e.like()
    return e.copysign(_angle(e, e.absolute(x), e.constant(1.0)), x)


def atan2(e: Emitter, y: str, x: str) -> str:
    """Return the angle of the point (x, y) in [−π, π]; at the origin and at ∞ as C does."""
    e = e.like()
    zero, one = e.constant(0.0), e.constant(1.0)
    a, b = _in_range(e, e.absolute(y), e.absolute(x))
    endless = e.both(*(e.compare("oeq", side, e.constant(inf)) for side in (a, b)))
    a, b = e.select(endless, one, a), e.select(endless, one, b)
    origin = e.both(e.compare("oeq", a, zero), e.compare("oeq", b, zero))
    angle = _angle(e, a, e.select(origin, one, b))
    high, low = (e.constant(part) for part in _PI[e.bits])
    behind = e.add(e.subtract(high, angle), low)
    left = e.compare("olt", e.copysign(one, x), zero)
    return e.copysign(e.select(left, behind, angle), y)


def _in_range(e: Emitter, a: str, b: str) -> tuple[str, str]:
    """Return a and b scaled so that a + b does not overflow nor both are subnormal."""
    large, largest = _LARGE[e.bits], e.maximum(a, b)
    up = e.select(
        e.compare("olt", largest, e.constant(1 / large)), e.constant(large), e.constant(1.0)
    )
    scale = e.select(e.compare("ogt", largest, e.constant(large)), e.constant(0.25), up)
    return e.multiply(a, scale), e.multiply(b, scale)


def _arcsine(e: Emitter, x: str) -> tuple[str, str]:
    """Return asin |x| for |x| ≤ ½, else asin √((1 − |x|)/2); and a mask where |x| > ½."""
    size, half = e.absolute(x), e.constant(0.5)
    far = e.compare("ogt", size, half)
    rest = e.fma(size, e.constant(-0.5), half)
    z = e.select(far, rest, e.multiply(size, size))
    root = e.select(far, e.root(rest), size)
    return _odd(e, root, z, _ASIN[e.bits]), far


def asin(e: Emitter, x: str) -> str:
    """Return asin x; NaN for |x| > 1."""
    e = e.like()
    arc, far = _arcsine(e, x)
    high, low = (e.constant(part / 2) for part in _PI[e.bits])
    beyond = e.add(e.subtract(high, e.add(arc, arc)), low)
    return e.copysign(e.select(far, beyond, arc), x)


def acos(e: Emitter, x: str) -> str:
    """Return acos x; NaN for |x| > 1."""
    e = e.like()
    arc, far = _arcsine(e, x)
    high, low = (e.constant(part) for part in _PI[e.bits])
    half, half_low = (e.constant(part / 2) for part in _PI[e.bits])
    double, zero = e.add(arc, arc), e.constant(0.0)
    negative = e.compare("olt", x, zero)
    behind = e.add(e.subtract(high, double), low)
    near = e.add(half, e.subtract(half_low, e.copysign(arc, x)))
    return e.select(far, e.select(negative, behind, double), near)
