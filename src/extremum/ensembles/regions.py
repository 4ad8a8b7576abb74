"""An ensemble's shape cut into blocks that fit into memory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import Final

LIMIT: Final = 2**16
"""Most loops of a block."""

Region = tuple[slice, ...]


def chunked(shape: tuple[int, ...], limit: int) -> tuple[int, ...]:
    """Return a block's shape: at most `limit` entries, even, whole along the last dimensions."""
    sizes: list[int] = []
    room = limit
    for size in reversed(shape):
        parts = math.ceil(size / max(1, room))
        sizes.append(math.ceil(size / parts))
        room //= sizes[-1]
    return tuple(reversed(sizes))


def regions(shape: tuple[int, ...], chunk: tuple[int, ...]) -> Iterator[Region]:
    """Return the blocks of a shape in C order; those at the ends may be smaller."""
    lines = [
        [slice(first, min(first + step, size)) for first in range(0, size, step)]
        for size, step in zip(shape, chunk, strict=True)
    ]
    return product(*lines)


def extent(region: Region) -> tuple[int, ...]:
    """Return a block's shape."""
    return tuple(part.stop - part.start for part in region)
