"""ln x, the inverse hyperbolic functions and powers.

x = 2^k m with √½ ≤ m < √2, f = m − 1, s = f/(2 + f), and ln m = 2s + s z P(z), z = s²: the series
of ln((1 + s)/(1 − s)), P minimax (Remez). Powers take ln x as a sum of two numbers, to 2^-62 of
itself (2^-33), because y ln x is up to 745 (104).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, nan
from typing import Final

from .arithmetic import (
    BIAS,
    LN2,
    MANTISSA,
    polynomial,
    product_and_error,
    sign_flipped,
    sum_and_error,
)
from .emitter import Emitter
from .exponentials import exp_of_sum

_ONE: Final = {64: 0x3FF0000000000000, 32: 0x3F800000}
_HALF_ROOT: Final = {64: 0x3FE6A09E667F3BCD, 32: 0x3F3504F3}
_LEAST_NORMAL: Final = {64: 2.0**-1022, 32: 2.0**-126}
_LOGARITHMIC: Final = {64: 2.0**28, 32: 2.0**13}
"""From here on, asinh x and acosh x are ln 2x."""

_BEYOND_EXP: Final = {64: 800.0, 32: 200.0}

_LOG: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(0.6666666666666734, 0.39999999999414326, 0.2857142874247397, 0.2222219856356161),
        *(0.18183564863109616, 0.15314035921736296, 0.1479610460099186),
    ),
    32: (0.666667759, 0.399775356, 0.298718631),
}

_TWO_THIRDS: Final = {
    64: (0.6666666666666666, 3.700743415417188e-17),
    32: (0.66666668653488159, -1.9868215517249155e-08),
}

_LOG_BEYOND_TWO_THIRDS: Final[Mapping[int, tuple[float, ...]]] = {
    64: (
        *(0.40000000000002256, 0.28571428570099433, 0.222222225199489, 0.18181784364827294),
        *(0.15386757437457554, 0.13256815263719954, 0.13196351848496068),
    ),
    32: (0.400001526, 0.28547129, 0.234186962),
}


@dataclass(frozen=True)
class _Split:
    """x = 2^k (1 + f)."""

    k: str
    f: str


def _split(e: Emitter, x: str) -> _Split:
    """Split a positive normal number."""
    digits, one, half_root = MANTISSA[e.bits], _ONE[e.bits], _HALF_ROOT[e.bits]
    shifted = e.integral("add", e.as_bits(x), e.integer(one - half_root))
    exponent = e.integral("lshr", shifted, e.integer(digits))
    whole = 2.0**digits
    stored = (digits + BIAS[e.bits]) << digits
    number = e.from_bits(e.integral("or", exponent, e.integer(stored)))
    k = e.subtract(number, e.constant(whole + BIAS[e.bits]))
    fraction = e.integral("and", shifted, e.integer(2**digits - 1))
    m = e.from_bits(e.integral("add", fraction, e.integer(half_root)))
    return _Split(k, e.subtract(m, e.constant(1.0)))


def _normal_split(e: Emitter, x: str) -> _Split:
    """Split a positive number, subnormal or not."""
    digits = MANTISSA[e.bits] + 2
    tiny = e.compare("olt", x, e.constant(_LEAST_NORMAL[e.bits]))
    split = _split(e, e.select(tiny, e.multiply(x, e.constant(2.0**digits)), x))
    less = e.select(tiny, e.constant(digits), e.constant(0.0))
    return _Split(e.subtract(split.k, less), split.f)


def _logarithm(e: Emitter, split: _Split, rest: str | None = None) -> str:
    """Return k ln 2 + ln(1 + f) + rest."""
    f, (high, low) = split.f, LN2[e.bits]
    s = e.divide(f, e.add(f, e.constant(2.0)))
    z = e.multiply(s, s)
    half_square = e.multiply(e.multiply(f, f), e.constant(0.5))
    series = e.fma(z, polynomial(e, z, _LOG[e.bits]), half_square)
    small = e.multiply(split.k, e.constant(low))
    if rest is not None:
        small = e.add(small, rest)
    small = e.fma(s, series, small)
    main = e.subtract(f, e.subtract(half_square, small))
    return e.fma(split.k, e.constant(high), main)


def _ends(e: Emitter, x: str, inside: str) -> str:
    """Return `inside` for 0 < x < ∞, −∞ at 0, ∞ at ∞, NaN elsewhere."""
    zero = e.constant(0.0)
    finite = e.select(e.compare("olt", x, e.constant(inf)), inside, x)
    rest = e.select(e.compare("oeq", x, zero), e.constant(-inf), e.constant(nan))
    return e.select(e.compare("ogt", x, zero), finite, rest)


def log(e: Emitter, x: str) -> str:
    """Return ln x; −∞ at ±0, NaN for x < 0."""
    e = e.like()
    return _ends(e, x, _logarithm(e, _normal_split(e, x)))


def log_of_positive(e: Emitter, x: str) -> str:
    """Return ln x of positive normal numbers."""
    e = e.like()
    return _logarithm(e, _split(e, x))


def _log_of_sum(e: Emitter, high: str, low: str, doublings: str | None = None) -> str:
    """Return ln(2^doublings (high + low)), |low| at most half an ulp of high."""
    split = _split(e, high)
    k = split.k if doublings is None else e.add(split.k, doublings)
    inside = _logarithm(e, _Split(k, split.f), e.divide(low, high))
    return _ends(e, high, inside)


def _log_of_one_and(e: Emitter, y: str, size: str) -> str:
    """Return ln(1 + y), and ln(2 size) where size is so large that it is the same."""
    large = e.compare("ogt", size, e.constant(_LOGARITHMIC[e.bits]))
    zero, one = e.constant(0.0), e.constant(1.0)
    high, low = _one_and(e, y)
    high, low = e.select(large, size, high), e.select(large, zero, low)
    return _log_of_sum(e, high, low, e.select(large, one, zero))


def _one_and(e: Emitter, y: str) -> tuple[str, str]:
    """Return 1 + y rounded and the error, exact, whichever of 1 and |y| is the larger."""
    one = e.constant(1.0)
    total = e.add(one, y)
    part = e.subtract(total, one)
    missing = e.subtract(one, e.subtract(total, part))
    return total, e.add(missing, e.subtract(y, part))


def asinh(e: Emitter, x: str) -> str:
    """Return asinh x = ln(1 + a + a²/(1 + √(1 + a²))), a = |x|, with the sign of x."""
    e = e.like()
    a, one = e.absolute(x), e.constant(1.0)
    square = e.multiply(a, a)
    beyond = e.divide(square, e.add(one, e.root(e.add(square, one))))
    return e.copysign(_log_of_one_and(e, e.add(a, beyond), a), x)


def acosh(e: Emitter, x: str) -> str:
    """Return acosh x = ln(1 + t + √(t² + 2t)), t = x − 1; NaN for x < 1."""
    e = e.like()
    t = e.subtract(x, e.constant(1.0))
    y = e.add(t, e.root(e.fma(t, t, e.add(t, t))))
    below = e.compare("olt", x, e.constant(1.0))
    return e.select(below, e.constant(nan), _log_of_one_and(e, y, x))


def atanh(e: Emitter, x: str) -> str:
    """Return atanh x = ln(1 + 2a/(1 − a))/2, a = |x|, with the sign of x; NaN for a > 1."""
    e = e.like()
    a = e.absolute(x)
    y = e.divide(e.add(a, a), e.subtract(e.constant(1.0), a))
    high, low = _one_and(e, y)
    return e.copysign(e.multiply(_log_of_sum(e, high, low), e.constant(0.5)), x)


# --- powers -----------------------------------------------------------------------------------


def power(e: Emitter, base: str, exponent: str) -> str:
    """Return base^exponent with C's special values: NaN for base < 0 unless exponent is whole."""
    e = e.like()
    size = e.absolute(base)
    high, low = _double_log(e, size)
    large, small = product_and_error(e, exponent, high)
    small = e.fma(exponent, low, small)
    within = e.compare("olt", e.absolute(large), e.constant(_BEYOND_EXP[e.bits]))
    raised = exp_of_sum(e, large, e.select(within, small, e.constant(0.0)))
    return _signed(e, base, exponent, _at_one(e, base, exponent, raised))


def _at_one(e: Emitter, base: str, exponent: str, raised: str) -> str:
    """Return 1 for x^0, 1^y and (−1)^±∞, else `raised`."""
    one = e.constant(1.0)
    endless = e.compare("oeq", e.absolute(exponent), e.constant(inf))
    minus = e.both(endless, e.compare("oeq", base, e.constant(-1.0)))
    plain = e.either(e.compare("oeq", base, one), e.compare("oeq", exponent, e.constant(0.0)))
    return e.select(e.either(plain, minus), one, raised)


def _signed(e: Emitter, base: str, exponent: str, raised: str) -> str:
    """Return `raised` with the sign of base^exponent, or NaN where it is not real."""
    half = e.multiply(exponent, e.constant(0.5))
    broken = e.compare("one", e.rounded(exponent), exponent)
    odd = e.compare("one", e.rounded(half), half)
    flipped = e.select(odd, sign_flipped(e, raised, e.as_bits(base)), raised)
    finite = e.compare("olt", e.absolute(base), e.constant(inf))
    negative = e.both(finite, e.compare("olt", base, e.constant(0.0)))
    whole = e.select(broken, raised, flipped)
    return e.select(e.both(broken, negative), e.constant(nan), whole)


def _double_log(e: Emitter, x: str) -> tuple[str, str]:
    """Return ln x, x ≥ 0, as a sum of two numbers; where the first is ∓∞, the other is nothing."""
    split = _normal_split(e, x)
    s, s_low = _double_quotient(e, split.f)
    z, z_low = product_and_error(e, s, s)
    z_low = e.fma(e.add(s, s), s_low, z_low)
    cube, cube_low = product_and_error(e, z, s)
    cube_low = e.add(cube_low, e.fma(z, s_low, e.multiply(z_low, s)))
    third, third_low = (e.constant(number) for number in _TWO_THIRDS[e.bits])
    tail = e.multiply(z, polynomial(e, z, _LOG_BEYOND_TWO_THIRDS[e.bits]))
    slope, slope_low = sum_and_error(e, third, tail)
    slope_low = e.add(slope_low, third_low)
    curve, curve_low = product_and_error(e, cube, slope)
    curve_low = e.add(curve_low, e.fma(cube, slope_low, e.multiply(cube_low, slope)))
    ln2, ln2_low = (e.constant(number) for number in LN2[e.bits])
    octaves, octaves_low = product_and_error(e, split.k, ln2)
    octaves_low = e.fma(split.k, ln2_low, octaves_low)
    main, main_low = sum_and_error(e, e.add(s, s), curve)
    total, total_low = sum_and_error(e, octaves, main)
    lows = e.add(e.add(s_low, s_low), e.add(curve_low, main_low))
    high, low = sum_and_error(e, total, e.add(total_low, e.add(lows, octaves_low)))
    return _ends(e, x, high), low


def _double_quotient(e: Emitter, f: str) -> tuple[str, str]:
    """Return s = f/(2 + f) as a sum of two numbers."""
    below, below_low = sum_and_error(e, e.constant(2.0), f)
    inverse = e.divide(e.constant(1.0), below)
    s = e.multiply(f, inverse)
    missing = e.fma(e.negative(s), below, f)
    return s, e.multiply(e.fma(e.negative(s), below_low, missing), inverse)
