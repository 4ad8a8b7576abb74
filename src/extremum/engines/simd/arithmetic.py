"""What the functions share: polynomials, sums and products without error, whole numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from .emitter import Emitter

MANTISSA: Final[Mapping[int, int]] = {64: 52, 32: 23}
"""Bits of a number after the point."""

BIAS: Final[Mapping[int, int]] = {64: 1023, 32: 127}
"""What is added to the exponent of 2 before it is stored."""

LN2: Final[Mapping[int, tuple[float, float]]] = {
    64: (0.6931471805599453, 2.3190468138462996e-17),
    32: (0.693147182, -1.90465421e-09),
}
"""ln 2 as a sum of two numbers."""


def polynomial(e: Emitter, x: str, coefficients: Sequence[float]) -> str:
    """Return Σ c_k x^k by Estrin's scheme: the depth grows with the logarithm of the degree."""
    terms = [e.constant(c) for c in coefficients]
    while len(terms) > 1:
        pairs = [e.fma(high, x, low) for low, high in zip(terms[::2], terms[1::2], strict=False)]
        terms = pairs + terms[2 * len(pairs) :]
        if len(terms) > 1:
            x = e.multiply(x, x)
    return terms[0]


def sum_and_error(e: Emitter, a: str, b: str) -> tuple[str, str]:
    """Return a + b rounded and the error, exact where |a| ≥ |b| or a = 0."""
    total = e.add(a, b)
    return total, e.subtract(b, e.subtract(total, a))


def product_and_error(e: Emitter, a: str, b: str) -> tuple[str, str]:
    """Return a b rounded and the error, exact."""
    product = e.multiply(a, b)
    return product, e.fma(a, b, e.negative(product))


def nearest(e: Emitter, x: str, scale: float, low: int = 0) -> tuple[str, str]:
    """Return n, the whole number nearest to x·scale, and a number whose low bits are n + low.

    Adding 1.5·2^p, p the bits after the point, leaves no room for a fraction.
    """
    shift = e.constant(1.5 * 2.0 ** MANTISSA[e.bits] + low)
    shifted = e.fma(x, e.constant(scale), shift)
    return e.subtract(shifted, shift), shifted


def reduced(e: Emitter, x: str, n: str, parts: Sequence[float]) -> str:
    """Return x − n·(sum of the parts), each product unrounded."""
    for part in parts:
        x = e.fma(n, e.constant(-part), x)
    return x


def power_of_two(e: Emitter, shifted: str) -> str:
    """Return 2^(k − bias) where k > 0 stands in the low bits of a number."""
    return e.from_bits(e.integral("shl", e.as_bits(shifted), e.integer(MANTISSA[e.bits])))


def at_most(e: Emitter, x: str, limit: float) -> str:
    """Return min(x, limit); NaN stays."""
    bound = e.constant(limit)
    return e.select(e.compare("olt", bound, x), bound, x)


def at_least(e: Emitter, x: str, limit: float) -> str:
    """Return max(x, limit); NaN stays."""
    bound = e.constant(limit)
    return e.select(e.compare("ogt", bound, x), bound, x)


def sign_flipped(e: Emitter, x: str, *bits: str) -> str:
    """Return x with its sign flipped once for every integer whose top bit is set."""
    flips = bits[0]
    for more in bits[1:]:
        flips = e.integral("xor", flips, more)
    top = e.integral("and", flips, e.integer(-(2 ** (e.bits - 1))))
    return e.from_bits(e.integral("xor", e.as_bits(x), top))
