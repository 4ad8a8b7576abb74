"""Stability of one polynomial and of a segment of polynomials, decided in integers.

A polynomial is a sequence of integers, the highest power first; polynomials with rational
coefficients are multiplied by a positive number first, which moves no root. Nothing is rounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Integers = list[int]


def is_hurwitz(polynomial: Sequence[int]) -> bool:
    """Return whether every root has Re λ < 0, by Routh's array in integers.

    Each row is multiplied by positive numbers only, so that its signs are those of the array.
    """
    sign = 1 if polynomial[0] > 0 else -1
    signed = [sign * c for c in polynomial]
    if min(signed) <= 0:
        return False
    above, row = signed[::2], signed[1::2] or [1]
    for _ in range(len(signed) - 2):
        if row[0] <= 0:
            return False
        padded = [*row, 0]
        following = [row[0] * a - above[0] * b for a, b in zip(above[1:], padded[1:], strict=False)]
        above, row = row, _primitive(following)
    return True  # the last row is the constant term times positive numbers


def crosses(first: Sequence[int], second: Sequence[int]) -> bool:
    """Return whether (1 − λ) P₀ + λ P₁ has an imaginary root for some λ in [0, 1].

    P₀ has none, and both leading coefficients have one sign. With P(jω) = E(ω²) + jω O(ω²),

        P₀(jω) P₁(−jω) = R(ω²) + jω I(ω²),   R = E₀E₁ + ω² O₀O₁,   I = O₀E₁ − E₀O₁,

    and a root is jω for some λ if and only if that product is real and ≤ 0. So R(0) must be > 0,
    and R must be > 0 wherever I = 0 at ω² > 0: Sturm's theorem counts those places, Tarski's
    adds up the signs of R there.

    Source: Basu, Pollack and Roy, Algorithms in Real Algebraic Geometry, theorem 2.61.
    """
    real, imaginary = along(first, second)
    if real[0] <= 0:
        return True
    if not imaginary:
        return _positive_roots(_trimmed(real)) > 0
    imaginary = imaginary[next(i for i, c in enumerate(imaginary) if c) :]
    most = _changes(imaginary)  # Descartes: as many positive roots or fewer
    if not most:
        return False
    signs = _tarski(imaginary, real)
    return signs != most and signs != _positive_roots(imaginary)


def apart(first: Sequence[int], second: Sequence[int]) -> bool:
    """Return whether Re P₀(jω) P₁(−jω) > 0 at every ω, the leading coefficients' signs alike."""
    real = along(first, second)[0]
    return real[0] > 0 and not _positive_roots(_trimmed(real))


def along(first: Sequence[int], second: Sequence[int]) -> tuple[Integers, Integers]:
    """Return R and I of `crosses`, the lowest power of ω² first; I may be empty, which is 0."""
    even, odd = _parts(first)
    other_even, other_odd = _parts(second)
    real = _sum(_product(even, other_even), [0, *_product(odd, other_odd)])
    imaginary = _sum(_product(odd, other_even), [-c for c in _product(even, other_odd)])
    return real, _trimmed(imaginary)


def shifted(polynomial: Sequence[int], decay: tuple[int, int]) -> Integers:
    """Return bⁿ P((t − a)/b) for the decay rate a/b: Hurwitz iff the roots of P have Re < −a/b."""
    a, b = decay
    found = [c * b**i for i, c in enumerate(polynomial)]
    for last in range(len(found) - 1, 0, -1):
        for i in range(last):
            found[i + 1] -= a * found[i]
    return found


# From here on polynomials in ω² have the lowest power first.


def _parts(polynomial: Sequence[int]) -> tuple[Integers, Integers]:
    rising = polynomial[::-1]
    even, odd = ([-c if i % 2 else c for i, c in enumerate(rising[start::2])] for start in (0, 1))
    return even, odd or [0]


def _product(a: Sequence[int], b: Sequence[int]) -> Integers:
    found = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] += x * y
    return found


def _sum(a: Sequence[int], b: Sequence[int]) -> Integers:
    short, long = sorted((a, b), key=len)
    return [x + y for x, y in zip(short, long, strict=False)] + list(long[len(short) :])


def _primitive(numbers: Sequence[int]) -> Integers:
    divisor = math.gcd(*numbers) or 1
    return [c // divisor for c in numbers]


def _trimmed(polynomial: Integers) -> Integers:
    while polynomial and not polynomial[-1]:
        polynomial.pop()
    return polynomial


def _remainder(a: Sequence[int], b: Sequence[int]) -> Integers:
    """Return a positive multiple of what a leaves when divided by b."""
    rest = _trimmed(list(a))
    while len(rest) >= len(b):
        common = math.gcd(rest[-1], b[-1])
        lead, factor = b[-1] // common, rest[-1] // common
        if lead < 0:
            lead, factor = -lead, -factor
        gap = len(rest) - len(b)
        rest = [lead * c for c in rest[:gap]] + [
            lead * c - factor * d for c, d in zip(rest[gap:-1], b, strict=False)
        ]
        _trimmed(rest)
    return _primitive(rest)


def _tarski(polynomial: Sequence[int], query: Sequence[int]) -> int:
    """Return Σ sign(query) over the distinct positive roots of a polynomial that is not 0 at 0."""
    slope = [i * c for i, c in enumerate(polynomial)][1:]
    a, b = list(polynomial), _remainder(_product(slope, query), polynomial)
    chain = [a]
    while b:
        chain.append(b)
        a, b = b, [-c for c in _remainder(a, b)]
    return _changes([p[0] for p in chain]) - _changes([p[-1] for p in chain])


def _positive_roots(polynomial: Sequence[int]) -> int:
    most = _changes(polynomial)
    return most if most < 2 else _tarski(polynomial, [1])


def _changes(numbers: Sequence[int]) -> int:
    signs = [c > 0 for c in numbers if c]
    return sum(a != b for a, b in pairwise(signs))
