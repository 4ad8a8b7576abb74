"""Vectors of neighbouring numbers turned into vectors of loops."""

from __future__ import annotations

from collections.abc import Sequence

from .emitter import Emitter


def transposed(e: Emitter, rows: Sequence[str], kind: str) -> list[str]:
    """Return the columns of a square whose rows are vectors of a kind, swapping blocks of it."""
    result, size = list(rows), len(rows)
    block = size // 2
    while block:
        for i in (i for i in range(size) if not i & block):
            a, b = result[i], result[i + block]
            low = [k + size - block if k & block else k for k in range(size)]
            high = [k + size if k & block else k + block for k in range(size)]
            result[i], result[i + block] = (_shuffled(e, a, b, kind, p) for p in (low, high))
        block //= 2
    return result


def joined(e: Emitter, parts: Sequence[str], size: int, kind: str) -> str:
    """Return vectors of so many elements one behind the other."""
    while len(parts) > 1:
        pairs = zip(parts[::2], parts[1::2], strict=True)
        parts = [_shuffled(e, a, b, f"<{size} x {kind}>", range(2 * size)) for a, b in pairs]
        size *= 2
    return parts[0]


def _shuffled(e: Emitter, a: str, b: str, kind: str, places: Sequence[int]) -> str:
    mask = ", ".join(f"i32 {place}" for place in places)
    return e.value(f"shufflevector {kind} {a}, {kind} {b}, <{len(places)} x i32> <{mask}>")
