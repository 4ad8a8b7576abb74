"""Frequencies that collide: what several dithers make of each other through the field.

Products of the dithers with a field of degree m hold every frequency Σ n_k ω_k with
Σ |n_k| ≤ m + 1 once they are demodulated. Where such a sum is zero the axes are coupled, at every
ω; where it is small against ω but within reach of the loop, it is a slow forcing.
"""

from __future__ import annotations

import itertools
import math
import numbers
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Symbol

from ..controllers import Probe
from ..errors import InvalidDescription, shown
from ..loop import Loop
from ..symbols import axis_names
from .averaged import averaged
from .demodulation import gradient
from .fourier import Harmonic
from .frame import Frame, relative

REACH: Final = 10
"""Loop bandwidths within which Σ n_k ω_k is felt by the loop."""

SMALL: Final = 0.25
"""|Σ n_k ω_k| over the slowest dither's ω below which it is slow at all."""

SMOOTH: Final = 3
"""Degree up to which fields that are no polynomials are looked at."""

MAX_COMBINATIONS: Final = 1_000_000
"""Combinations Σ n_k ω_k that are looked through."""

ROUNDING: Final = 1e-9
"""|Σ n_k ω_k| over the slowest dither's ω up to which frequencies known in floats collide."""


@dataclass(frozen=True)
class Resonance:
    """An integer combination of the dithers' frequencies that is zero or slow.

    Attributes
    ----------
    combination
        n_k, one per channel.
    frequency
        |Σ n_k ω_k| (rad/s); 0 for a collision.
    harmonic
        The same combination as a multiple of the independent frequencies.
    """

    combination: tuple[int, ...]
    frequency: float
    harmonic: Harmonic

    def __str__(self) -> str:
        return relation(self.combination, self.frequency)


def relation(combination: Sequence[int], beat: float) -> str:
    """Return "2 ω_x = ω_y", or by how much (rad/s) the two sides differ."""
    sides: tuple[list[str], list[str]] = ([], [])
    for n, name in zip(combination, axis_names(len(combination)), strict=True):
        if n:
            sides[n < 0].append(f"{'' if abs(n) == 1 else f'{abs(n)} '}ω_{name}")
    left, right = (" + ".join(side) or "0" for side in sides)
    return f"{left} and {right} differ by {beat:.4g} rad/s" if beat else f"{left} = {right}"


@lru_cache(maxsize=64)
def combinations(count: int, size: int) -> NDArray[np.int64]:
    """Return the primitive integer vectors of at least two entries ≠ 0 with Σ|n| ≤ size, as rows.

    Of n and −n only that with the first nonzero entry positive; the shortest first.
    """
    blocks = [np.empty((0, count), dtype=np.int64)]
    for entries in range(2, min(count, size) + 1):
        places = np.array(list(itertools.combinations(range(count), entries)))
        patterns = np.array([p for p in _patterns(entries, size) if p[0] > 0 and math.gcd(*p) == 1])
        block = np.zeros((len(patterns), len(places), count), dtype=np.int64)
        np.put_along_axis(block, places[None], patterns[:, None], axis=2)
        blocks.append(block.reshape(-1, count))
    rows = np.concatenate(blocks)
    return rows[np.argsort(np.abs(rows).sum(axis=1), kind="stable")]


def _patterns(length: int, left: int) -> Iterator[tuple[int, ...]]:
    """Yield the vectors of `length` entries ≠ 0 with Σ|n| ≤ left."""
    if length == 0:
        yield ()
        return
    most = left - length + 1
    for n in range(-most, most + 1):
        if n:
            for rest in _patterns(length - 1, left - abs(n)):
                yield (n, *rest)


def field_degree(given: Any, count: int) -> int:
    """Return a field's degree for so many frequencies, refusing what cannot be looked through."""
    if not isinstance(given, numbers.Integral) or isinstance(given, bool) or given < 2:
        raise InvalidDescription(
            "degree",
            "must be an integer of at least 2: a field of lower degree has no maximum",
            shown(given),
        )
    size = int(given) + 1
    looked = sum(2**k * math.comb(count, k) * math.comb(size, k) for k in range(1, size + 1)) // 2
    if looked > MAX_COMBINATIONS:
        raise InvalidDescription(
            "degree",
            f"makes {looked:,} combinations of {count} frequencies, at most {MAX_COMBINATIONS:,} "
            "are looked through; terms of degree d move the mean by α^(d − 1) only: take a lower "
            "degree, or quadrature pairs, which need half as many frequencies",
            shown(given),
        )
    return int(given)


def reach(rates: Sequence[float], bandwidth: float) -> float:
    """Return the |Σ n_k ω_k| (rad/s) below which a loop of that bandwidth (rad/s) feels it."""
    return min(REACH * bandwidth, SMALL * min(rates))


def felt(
    rates: Sequence[float], size: int, bandwidth: float
) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield every n with Σ|n| ≤ size whose |Σ n_k ω_k| is 0 or within reach, and that beat."""
    table = combinations(len(rates), size)
    beats = np.abs(table @ np.asarray(rates, dtype=float))
    near = max(reach(rates, bandwidth), ROUNDING * min(rates))
    for row in np.flatnonzero(beats < near):
        yield tuple(table[row].tolist()), float(beats[row])


def resonances_of(frame: Frame, degree: int | None, bandwidth: float) -> tuple[Resonance, ...]:
    """Return the combinations that collide, and those within ten `bandwidth` (rad/s) of it."""
    channels = gradient(frame.loop.twin).frequencies()
    by_frequency = {o.frequency: o for o in frame.equations.oscillators}
    turning = [by_frequency[f].harmonic for f in channels]
    rates = [float(f) for f in gradient(frame.loop).frequencies()]
    found = []
    for n, beat in felt(rates, (SMOOTH if degree is None else degree) + 1, bandwidth):
        harmonic = tuple(int(k) for k in np.array(n) @ np.array(turning))
        sign = -1 if next((k for k in harmonic if k), 1) < 0 else 1
        found.append(
            Resonance(n, beat if any(harmonic) else 0.0, tuple(sign * k for k in harmonic))
        )
    return tuple(found)


def coupling(loop: Loop) -> dict[Symbol, Expr]:
    """Return what the collisions add to the averaged rates (per second), by state.

    The average of the loop minus that of the same loop with every channel at a frequency of its
    own, collided with no other: exact, for fields that are polynomials of position; nothing is
    said of channels with a `Probe`, or of a loop with a sensor.
    """
    frame = relative(loop)
    if frame.equations.sensing:
        return {}  # at another frequency it passes another dither
    if any(isinstance(c.dither, Probe) for c in gradient(frame.loop).channels):
        return {}  # a probe makes another dither at another frequency
    apart = frame.loop.replace(
        {
            f"controller.channels.{i}.ratio": float(sympy.sqrt(sympy.prime(i + 1)))
            for i in range(frame.loop.controller.inputs())
        }
    )
    here, alone = averaged(frame.equations, 1), averaged(relative(apart).equations, 1)
    if here.moments is not None:
        return {}
    added = {
        x: sympy.factor_terms(sympy.expand(a - b))
        for x, a, b in zip(here.equations.states, here.rates, alone.rates, strict=True)
    }
    return {x: e for x, e in added.items() if e != 0}
