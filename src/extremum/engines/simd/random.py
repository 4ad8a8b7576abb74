"""Philox4x32-10 as LLVM instructions: what `lanes.random` says in NumPy.

A 32-bit word stands in the lower half of a 64-bit lane; what is above it is of no account, because
a product of two words reads the lower halves only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from ..lanes.random import BELOW_ONE, INCREMENTS, MULTIPLIERS, NORMAL, ROUNDS, UNIFORM
from .angles import sine_of_turns
from .emitter import Emitter
from .logarithms import log_of_positive

_WORD: Final = 0xFFFFFFFF
_ONE: Final = 0x3FF0000000000000
_WHOLE: Final = 2.0**52
"""Added to a whole number below 2³² it leaves it in the low bits."""


def philox(e: Emitter, counter: Sequence[str], key: Sequence[str]) -> tuple[str, ...]:
    """Return the four words of a counter and a key; see `lanes.random.philox`."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for turn in range(ROUNDS):
        if turn:
            k0, k1 = (
                e.integral("add", k, e.integer(w))
                for k, w in zip((k0, k1), INCREMENTS, strict=True)
            )
        first, second = (
            e.integral("mul", e.integral("and", c, e.integer(_WORD)), e.integer(m))
            for c, m in zip((c0, c2), MULTIPLIERS, strict=True)
        )
        c0, c1 = _mixed(e, second, c1, k0), second
        c2, c3 = _mixed(e, first, c3, k1), first
    return c0, c1, c2, c3


def _mixed(e: Emitter, product: str, word: str, key: str) -> str:
    high = e.integral("lshr", product, e.integer(32))
    return e.integral("xor", e.integral("xor", high, word), key)


def _words(e: Emitter, number: str) -> tuple[str, str]:
    """Return the two words of a whole number from 0 to 2⁵³."""
    high = e.floor(e.multiply(number, e.constant(2.0**-32)))
    low = e.fma(high, e.constant(-(2.0**32)), number)
    return tuple(e.as_bits(e.add(word, e.constant(_WHOLE))) for word in (low, high))  # pyright: ignore[reportReturnType]


def _drawn(e: Emitter, seed: str, step: str, stream: int, kind: int) -> tuple[str, ...]:
    counter = (*_words(e, step), e.integer(stream // 2), e.integer(kind))
    return philox(e, counter, _words(e, seed))


def _fraction(e: Emitter, low: str, high: str) -> str:
    """Return (n + ½) 2⁻⁵², n the upper 52 of the 64 bits."""
    top = e.integral("shl", high, e.integer(32))
    bits = e.integral("or", top, e.integral("and", low, e.integer(_WORD)))
    bits = e.integral("or", e.integral("lshr", bits, e.integer(12)), e.integer(_ONE))
    return e.subtract(e.from_bits(bits), e.constant(BELOW_ONE))


def uniform(e: Emitter, seed: str, step: str, stream: int) -> str:
    """Return a number between 0 and 1."""
    e = e.like()
    words = _drawn(e, seed, step, stream, UNIFORM)
    return _fraction(e, *(words[2:] if stream % 2 else words[:2]))


def normal(e: Emitter, seed: str, step: str, stream: int) -> str:
    """Return a normally distributed number, mean 0, variance 1."""
    e = e.like()
    words = _drawn(e, seed, step, stream, NORMAL)
    u, v = _fraction(e, *words[:2]), _fraction(e, *words[2:])
    radius = e.root(e.multiply(e.constant(-2.0), log_of_positive(e, u)))
    return e.multiply(radius, sine_of_turns(e, v, 0 if stream % 2 else 1))


RANDOM: Final[Mapping[str, Callable[..., str]]] = {"uniform": uniform, "normal": normal}
"""By name; called with an emitter, the names of seed and step, and the stream."""
