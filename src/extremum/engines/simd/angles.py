"""sin, cos and tan.

x = nπ + r (sin), (n + ½)π + r (cos) or nπ/2 + r (both, tan), with n π subtracted in three parts of
full length: every product is unrounded (fma) and the first difference exact. Polynomials are
minimax for a relative error (Remez). Beyond |x| = 10¹² (10⁵), and at ±∞, the result is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import nan, pi
from typing import Final

from .arithmetic import MANTISSA, nearest, polynomial, reduced, sign_flipped
from .emitter import Emitter

_FARTHEST: Final = {64: 1e12, 32: 1e5}

_HALF_PI: Final[Mapping[int, tuple[float, ...]]] = {
    64: (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33),
    32: (1.57079637, -4.37113883e-08, -1.71512451e-15),
}

_PI: Final = {bits: tuple(2 * part for part in parts) for bits, parts in _HALF_PI.items()}

_SIN_TO_HALF_PI: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(-0.16666666666666666, 0.008333333333333194, -0.00019841269841209142),
        *(2.7557319211124e-06, -2.5052106871561144e-08, 1.605893964226769e-10),
        *(-7.642989801763275e-13, 2.7211568659784325e-15),
    ),
    32: (-0.166666597, 0.00833306648, -0.000198095891, 2.60574984e-06),
}

_SIN_TO_QUARTER_PI: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(-0.16666666666666632, 0.008333333333322413, -0.00019841269829807808),
        *(2.755731369191568e-06, -2.50507581150146e-08, 1.5896795654054653e-10),
    ),
    32: (-0.166666552, 0.008332178, -0.000195172339),
}

_COS_TO_QUARTER_PI: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(0.0416666666666666, -0.0013888888888874125, 2.480158728948221e-05),
        *(-2.755731435233907e-07, 2.0875723273959373e-09, -1.1359647836554039e-11),
    ),
    32: (0.0416666456, -0.00138873665, 2.44383791e-05),
}


def _near(e: Emitter, x: str) -> str:
    """Return |x|, NaN where it is too large."""
    size = e.absolute(x)
    near = e.compare("ole", size, e.constant(_FARTHEST[e.bits]))
    return e.select(near, size, e.constant(nan))


def _sine(e: Emitter, r: str) -> str:
    """Return sin r, |r| ≤ π/2, the cubic term apart: its error counts where |sin r| is near 1."""
    z, (cubic, *rest) = e.multiply(r, r), _SIN_TO_HALF_PI[e.bits]
    cube = e.multiply(r, z)
    beyond = e.multiply(cube, e.multiply(z, polynomial(e, z, rest)))
    return e.add(r, e.fma(cube, e.constant(cubic), beyond))


def _bit_to_sign(e: Emitter, shifted: str, bit: int, more: int = 0) -> str:
    """Return an integer whose top bit is the given one of the low bits plus `more`."""
    bits = e.as_bits(shifted)
    if more:
        bits = e.integral("add", bits, e.integer(more))
    return e.integral("shl", bits, e.integer(e.bits - 1 - bit))


def sin(e: Emitter, x: str) -> str:
    """Return sin x."""
    e = e.like()
    size = _near(e, x)
    n, shifted = nearest(e, size, 0.3183098861837907)
    r = reduced(e, size, n, _PI[e.bits])
    value = _sine(e, r)
    return sign_flipped(e, value, _bit_to_sign(e, shifted, 0), e.as_bits(x))


def cos(e: Emitter, x: str) -> str:
    """Return cos x = ±sin(x − (n + ½)π), − for even n."""
    e = e.like()
    size, half = _near(e, x), e.constant(0.5)
    turns = e.fma(size, e.constant(0.3183098861837907), e.constant(-0.5))
    shift = e.constant(1.5 * 2.0 ** MANTISSA[e.bits] + 1)
    shifted = e.add(turns, shift)
    n = e.add(e.subtract(shifted, shift), half)
    r = reduced(e, size, n, _PI[e.bits])
    value = _sine(e, r)
    return sign_flipped(e, value, _bit_to_sign(e, shifted, 0))


def _quarters(e: Emitter, x: str) -> tuple[str, str, str, str]:
    """Return sin r, cos r, whether n is odd (a mask), a number with n in its low bits."""
    n, shifted = nearest(e, size := _near(e, x), 0.6366197723675814)
    r = reduced(e, size, n, _HALF_PI[e.bits])
    return *_to_quarter_pi(e, r), _is_odd(e, shifted), shifted


def _to_quarter_pi(e: Emitter, r: str) -> tuple[str, str]:
    """Return sin r and cos r, |r| ≤ π/4."""
    z = e.multiply(r, r)
    sine = e.fma(e.multiply(r, z), polynomial(e, z, _SIN_TO_QUARTER_PI[e.bits]), r)
    parabola = e.fma(z, e.constant(-0.5), e.constant(1.0))
    cosine = e.fma(e.multiply(z, z), polynomial(e, z, _COS_TO_QUARTER_PI[e.bits]), parabola)
    return sine, cosine


def _is_odd(e: Emitter, shifted: str) -> str:
    last = e.integral("and", e.as_bits(shifted), e.integer(1))
    return e.compare_integers("ne", last, e.integer(0))


def sincos(e: Emitter, x: str) -> tuple[str, str]:
    """Return sin x and cos x, which share their reduction; dearer than one, cheaper than two."""
    e = e.like()
    sine, cosine, odd, shifted = _quarters(e, x)
    ups = _bit_to_sign(e, shifted, 1)
    return (
        sign_flipped(e, e.select(odd, cosine, sine), ups, e.as_bits(x)),
        sign_flipped(e, e.select(odd, sine, cosine), _bit_to_sign(e, shifted, 1, more=1)),
    )


def sine_of_turns(e: Emitter, u: str, ahead: int) -> str:
    """Return sin 2π(u + ahead/4), 0 ≤ u ≤ 1; no rounding in the reduction."""
    e = e.like()
    n, shifted = nearest(e, u, 4.0, low=ahead)
    r = e.fma(n, e.constant(-0.25), u)
    sine, cosine = _to_quarter_pi(e, e.multiply(r, e.constant(2 * pi)))
    value = e.select(_is_odd(e, shifted), cosine, sine)
    return sign_flipped(e, value, _bit_to_sign(e, shifted, 1))


def tan(e: Emitter, x: str) -> str:
    """Return tan x = sin r/cos r, or −cos r/sin r for odd n."""
    e = e.like()
    sine, cosine, odd, shifted = _quarters(e, x)
    above, below = e.select(odd, cosine, sine), e.select(odd, sine, cosine)
    quotient = e.divide(above, below)
    return sign_flipped(e, quotient, _bit_to_sign(e, shifted, 0), e.as_bits(x))
