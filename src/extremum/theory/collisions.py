"""Frequencies that collide: what several dithers make of each other through the field.

Products of the dithers with a field of degree m hold every frequency Σ n_k ω_k with
Σ |n_k| ≤ m + 1 once they are demodulated. Where such a sum is zero the axes are coupled, at every
ω; where it is small against ω but within reach of the loop, it is a slow forcing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import sympy
from sympy import Expr, Symbol

from ..controllers import Probe
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
        names = axis_names(len(self.combination))
        sides: tuple[list[str], list[str]] = ([], [])
        for n, name in zip(self.combination, names, strict=True):
            if n:
                sides[n < 0].append(f"{'' if abs(n) == 1 else f'{abs(n)} '}ω_{name}")
        left, right = (" + ".join(side) or "0" for side in sides)
        if self.frequency == 0:
            return f"{left} = {right}"
        return f"{left} and {right} differ by {self.frequency:.4g} rad/s"


@lru_cache(maxsize=64)
def _combinations(count: int, size: int) -> tuple[tuple[int, ...], ...]:
    """Return the primitive integer vectors of at least two entries ≠ 0 with Σ|n| ≤ size.

    Of n and −n only that with the first nonzero entry positive.
    """

    def grown(length: int, left: int) -> Iterator[tuple[int, ...]]:
        if length == 0:
            yield ()
            return
        for n in range(-left, left + 1):
            for rest in grown(length - 1, left - abs(n)):
                yield (n, *rest)

    mixed = (n for n in grown(count, size) if sum(map(bool, n)) > 1 and math.gcd(*n) == 1)
    return tuple(n for n in mixed if next(i for i in n if i) > 0)


def resonances_of(frame: Frame, degree: int | None, bandwidth: float) -> tuple[Resonance, ...]:
    """Return the combinations that collide, and those within ten `bandwidth` (rad/s) of it."""
    channels = gradient(frame.loop.twin).frequencies()
    by_frequency = {o.frequency: o for o in frame.equations.oscillators}
    turning = [by_frequency[f] for f in channels]
    rates = [float(f) for f in gradient(frame.loop).frequencies()]
    near = min(REACH * bandwidth, SMALL * min(rates))
    found = []
    for n in _combinations(len(rates), (SMOOTH if degree is None else degree) + 1):
        size = len(turning[0].harmonic)
        harmonic = tuple(
            sum(c * o.harmonic[i] for c, o in zip(n, turning, strict=True)) for i in range(size)
        )
        beat = (
            abs(sum(c * rate for c, rate in zip(n, rates, strict=True))) if any(harmonic) else 0.0
        )
        if not any(harmonic) or beat < near:
            sign = -1 if next((k for k in harmonic if k), 1) < 0 else 1
            found.append(Resonance(n, beat, tuple(sign * k for k in harmonic)))
    return tuple(found)


def coupling(loop: Loop) -> dict[Symbol, Expr]:
    """Return what the collisions add to the averaged rates (per second), by state.

    The average of the loop minus that of the same loop with every channel at a frequency of its
    own, collided with no other: exact, for fields that are polynomials of position; nothing is
    said of channels with a `Probe`.
    """
    frame = relative(loop)
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
