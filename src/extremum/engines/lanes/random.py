"""Random numbers that are functions of a seed, a step's number and a stream, in NumPy.

Philox4x32-10 (Salmon, Moraes, Dror and Shaw, SC 2011; Random123) turns a counter of four 32-bit
words and a key of two into four words that look random. Here the counter is (low and high word of
the step's number, stream // 2, 0 for `uniform` or 1 for `normal`) and the key the two words of the
seed, so that a number depends on nothing else: not on the numbers asked for before. The two halves
of a result serve the streams 2p and 2p + 1. Seeds and steps are whole numbers from 0 to 2⁵³.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Words = NDArray[np.uint64]

MULTIPLIERS: Final = (0xD2511F53, 0xCD9E8D57)
INCREMENTS: Final = (0x9E3779B9, 0xBB67AE85)
ROUNDS: Final = 10

UNIFORM: Final = 0
NORMAL: Final = 1
"""The counter's last word."""

BELOW_ONE: Final = 1 - 2.0**-53
"""What a number in 1 … 2 with 52 random bits is lessened by, so that 0 < u < 1."""

LARGEST: Final = 2**53
"""Seed, and step, up to which every whole number is one of double precision."""

_WORD: Final = np.uint64(0xFFFFFFFF)
_HALF: Final = np.uint64(32)


def philox(counter: Sequence[ArrayLike], key: Sequence[ArrayLike]) -> tuple[Words, ...]:
    """Return the four words of a counter and a key, arrays of numbers below 2³² like theirs.

    A round takes (c₀, c₁, c₂, c₃) to (hi(M₁c₂) ⊕ c₁ ⊕ k₀, lo(M₁c₂), hi(M₀c₀) ⊕ c₃ ⊕ k₁, lo(M₀c₀));
    between two, the key grows by `INCREMENTS`.
    """
    c0, c1, c2, c3 = (np.asarray(word, np.uint64) for word in counter)
    k0, k1 = (np.asarray(word, np.uint64) for word in key)
    m0, m1 = map(np.uint64, MULTIPLIERS)
    for _ in range(ROUNDS):
        first, second = m0 * c0, m1 * c2
        c0, c1 = (second >> _HALF) ^ c1 ^ k0, second & _WORD
        c2, c3 = (first >> _HALF) ^ c3 ^ k1, first & _WORD
        k0, k1 = ((k + np.uint64(w)) & _WORD for k, w in zip((k0, k1), INCREMENTS, strict=True))
    return c0, c1, c2, c3


def uniform(seed: ArrayLike, step: ArrayLike, stream: int) -> NDArray[np.float64]:
    """Return a number between 0 and 1: an odd multiple of 2⁻⁵³, never 0 or 1."""
    words = _drawn(seed, step, stream, UNIFORM)
    return _fraction(*(words[2:] if stream % 2 else words[:2]))


def normal(seed: ArrayLike, step: ArrayLike, stream: int) -> NDArray[np.float64]:
    """Return a normally distributed number, mean 0, variance 1, |z| < 8.6.

    √(−2 ln u) cos 2πv in even streams and √(−2 ln u) sin 2πv in odd ones (Box and Muller, 1958).
    """
    words = _drawn(seed, step, stream, NORMAL)
    u, v = _fraction(*words[:2]), _fraction(*words[2:])
    quarters = np.rint(4 * v)
    angle = 2 * np.pi * (v - quarters / 4)
    turned = (quarters + (0 if stream % 2 else 1)).astype(np.int64)
    size = np.where(turned % 2, np.cos(angle), np.sin(angle))
    return np.sqrt(-2 * np.log(u)) * np.where(turned % 4 < 2, size, -size)


def _drawn(seed: ArrayLike, step: ArrayLike, stream: int, kind: int) -> tuple[Words, ...]:
    key, at = (np.asarray(number, float).astype(np.uint64) for number in (seed, step))
    counter = (at & _WORD, at >> _HALF, np.uint64(stream // 2), np.uint64(kind))
    return philox(counter, (key & _WORD, key >> _HALF))


def _fraction(low: Words, high: Words) -> NDArray[np.float64]:
    """Return (n + ½) 2⁻⁵², n the upper 52 of the 64 bits."""
    bits = (high << _HALF | low) >> np.uint64(12) | np.uint64(0x3FF0000000000000)
    return bits.view(np.float64) - BELOW_ONE


def evaluated(kind: Any, seed: Any, step: Any, stream: Any) -> Any:
    """Return `uniform` or `normal` of a tape's numbers."""
    return kind(seed, step, int(stream))[()]
