"""The slowest root over a box of polynomials, looked for in floats; nothing is proved by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .families import Family, Ranges, edges, roots
from .segments import along, is_hurwitz

CLOSE: Final = 1e-6
"""A root this close to the limit, relative to its size, may lie on it."""
FINE: Final = 65
"""How many points of an edge are looked at beside those where a root crosses."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Member:
    """A point of the box and the root there that has the largest real part."""

    point: tuple[Fraction, ...]
    root: complex


def corners(symbols: int) -> Array:
    """Return a box' corners, (2ⁿ, symbols), 0 at low and 1 at high."""
    return np.array([*product((0.0, 1.0), repeat=symbols)])


def skeleton(symbols: int, steps: int) -> Array:
    """Return a box' corners, the points that cut its edges into `steps` parts, and its centre."""
    between = np.linspace(0, 1, steps + 1)[1:-1]
    cuts = [
        (1 - part) * np.array(low) + part * np.array(high)
        for low, high in edges((2,) * symbols)
        for part in between
    ]
    return np.array([*corners(symbols), *cuts, np.full(symbols, 0.5)])


def slowest(family: Family, ranges: Ranges, where: Array) -> Member | None:
    """Return the member with the slowest root at the given places; None if none has a degree."""
    low = np.array([float(least) for least, _ in ranges])
    width = np.array([float(most - least) for least, most in ranges])
    polynomials = family.rough_at(low + width * where)
    full = polynomials[:, 0] != 0
    if not full.any():
        return None
    found = roots(polynomials[full])
    worst = np.unravel_index(np.argmax(found.real), found.shape)
    place = where[full][worst[0]]
    point = tuple(
        least + Fraction(float(x)) * (most - least)
        for x, (least, most) in zip(place, ranges, strict=True)
    )
    root = complex(found[worst])
    return Member(point, complex(root.real, abs(root.imag)))


def unstable(family: Family, decay: Fraction, ranges: Ranges, where: Array) -> Member | None:
    """Return the slowest member at the given places if exactly it has a root Re λ ≥ −decay."""
    member = slowest(family, ranges, where)
    if member is None or member.root.real + float(decay) < -CLOSE * abs(member.root):
        return None
    return None if is_hurwitz(family.at(member.point, decay)) else member


def on_edge(
    family: Family, decay: Fraction, low: Sequence[int], high: Sequence[int]
) -> Member | None:
    """Return the slowest member on the box's edge between two corners, given by 0s and 1s."""
    crossings = sorted({0.0, 1.0, *_crossings(family, decay, low, high)})
    between = [(a + b) / 2 for a, b in pairwise(crossings)]
    parts = np.array([*crossings, *between, *np.linspace(0, 1, FINE)])[:, None]
    return slowest(family, family.ranges, (1 - parts) * np.array(low) + parts * np.array(high))


def _crossings(
    family: Family, decay: Fraction, low: Sequence[int], high: Sequence[int]
) -> list[float]:
    """Return where on an edge, from 0 to 1, a root crosses or touches Re λ = −decay."""
    whole = family.controls(family.ranges, decay)
    _, imaginary = along(whole[tuple(low)], whole[tuple(high)])
    largest = max(map(abs, imaginary), default=1)
    squares = np.roots([c / largest for c in reversed(imaginary)])
    real = (squares.real > 0) & (abs(squares.imag) <= math.sqrt(CLOSE) * abs(squares))
    places = 1j * np.sqrt(squares.real[real]) / decay.denominator - float(decay)
    controls = family.rough_controls(family.ranges)
    a, b = (np.polyval(controls[tuple(end)], places) for end in (low, high))
    opposite = (a * b.conj()).real <= 0
    sizes = abs(a[opposite]), abs(b[opposite])
    return [float(x / (x + y)) for x, y in zip(*sizes, strict=True) if x + y > 0]
