"""Loop shaping: the compensator with the least noise bandwidth that does what is wished.

What is wished must be done at every vertex of the box; the simplest structure that can is taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from .candidates import Candidates, candidates
from .family import Family, Plant
from .polynomials import Vector
from .responses import (
    frequencies,
    highest_passed,
    modes,
    noise_bandwidth,
    sensitivity,
    settling_times,
)

MAX_LEADS: Final = 2
MARGIN: Final = 0.95
"""Part of the allowed settling times that the averaged loop may take."""
CHARGING: Final = 1.5
"""Settling times allowed to a start with empty integrators far from where the vehicle rests."""
SLOWEST: Final = 2.0
"""No mode is slower than this over T_s, however little a displacement excites it."""
PATIENCE: Final = 20.0
"""What stands for T_s there where only a bandwidth is wished, times 1/Ω_B."""
PEAK: Final = 2.0
"""Largest |S(jω)| of a good loop: gain margins 2/3 and 2, phase margin 29° at least."""
WORST_PEAK: Final = 3.0
"""Largest |S(jω)| accepted where nothing better settles in time: 3/4 and 1.5, 19°."""
FRAGILE: Final = 3.0
"""How much less noise makes up for max |S| above 2."""


@dataclass(frozen=True)
class Wish:
    """What the averaged loop must do.

    Attributes
    ----------
    settling
        T_s (s), or infinity.
    bandwidth
        Ω_B (rad/s) below which |S| ≤ 1/√2, or 0.
    """

    settling: float
    bandwidth: float

    @property
    def speed(self) -> float:
        """The speed (rad/s) about which to look."""
        return self.bandwidth or 4.0 / self.settling

    @property
    def slowest(self) -> float:
        """The decay rate (1/s) that every mode must have."""
        horizon = self.settling if math.isfinite(self.settling) else PATIENCE / self.bandwidth
        return SLOWEST / horizon


@dataclass(frozen=True)
class Shape:
    """One axis' compensator and loop gain, with what they do at the worst vertex.

    Attributes
    ----------
    crossover
        ω_c (rad/s), where |L| = 1 at the nominal gain.
    leads
        How many leads C has.
    above, below
        C's numerator and denominator, highest power first; |C(jω_c)| = 1.
    gain
        g = α c q m at q = √(q_low q_high), with the sign that the loop needs.
    missed
        The largest factor by which it misses what is wished; at most 1 where it does not.
    abscissa
        max Re λ (1/s).
    settling, charging
        Settling time (s) of the averaged loop, with its integrators charged and empty.
    peak
        max |S(jω)|.
    noise
        ‖T‖₂² (rad/s).
    fastest
        The highest frequency (rad/s) that the closed loop passes.
    error
        max |S| √2 below the wanted bandwidth.
    """

    crossover: float
    leads: int
    above: tuple[float, ...]
    below: tuple[float, ...]
    gain: float
    missed: float
    abscissa: float
    settling: float
    charging: float
    peak: float
    noise: float
    fastest: float
    error: float


def shapes(family: Family, wish: Wish) -> Iterator[Shape]:
    """Yield the shapes that do what is wished: the simplest robust ones first.

    Among those with max |S| ≤ 2 fewer leads come first, then less noise. What is less robust comes
    first only where it passes a third of the noise.
    """
    fragile: list[Shape] = []
    for leads in range(MAX_LEADS + 1):
        found = sorted(judged(family, wish, leads, allowed=1.0), key=lambda shape: shape.noise)
        robust = [shape for shape in found if shape.peak <= PEAK]
        fragile += [shape for shape in found if shape.peak > PEAK]
        if robust:
            quiet = [shape for shape in fragile if shape.noise * FRAGILE < robust[0].noise]
            yield from sorted(quiet, key=lambda shape: shape.noise)
            yield from robust
            fragile = [shape for shape in fragile if shape not in quiet]
    yield from sorted(fragile, key=lambda shape: shape.noise)


def nearest(family: Family, wish: Wish) -> Shape | None:
    """Return the stable shape that misses what is wished by the smallest factor, None if none."""
    found = [
        shape
        for leads in range(MAX_LEADS + 1)
        for shape in judged(family, wish, leads, allowed=math.inf)
    ]
    return min(found, key=lambda shape: shape.missed, default=None)


def judged(family: Family, wish: Wish, leads: int, allowed: float) -> list[Shape]:
    """Return the stable candidates that miss what is wished by no more than a factor.

    Candidates are dropped as soon as one measure says so, the cheapest measure first.
    """
    found = candidates(family, max(wish.speed, family.unstable), leads)
    gains = sorted({family.gains[0], 1.0, family.gains[1]})
    for measure in (_modes, _margins, _times):
        if not found.count:
            return []
        seen = [
            measure(family, wish, plant, found, found.gain * factor)
            for plant in family.vertices
            for factor in gains
        ]
        worst = {key: np.max([values[key] for values in seen], axis=0) for key in seen[0]}
        found = found.measured(worst, allowed)
    return [Shape(leads=leads, **row) for row in found.rows()]


def _modes(
    family: Family, wish: Wish, plant: Plant, found: Candidates, gain: Vector
) -> dict[str, Vector]:
    abscissa = modes(family, plant, found.above, found.below, gain).real.max(axis=-1)
    stable = abscissa < 0
    return {
        "abscissa": abscissa,
        "missed": np.where(stable, wish.slowest / np.where(stable, -abscissa, 1), np.nan),
    }


def _margins(
    family: Family, wish: Wish, plant: Plant, found: Candidates, gain: Vector
) -> dict[str, Vector]:
    speed = max(wish.speed, family.unstable)
    omega = frequencies(speed, wish.bandwidth, family.resonances)
    s = sensitivity(family, plant, found.above, found.below, gain, omega)
    peak = np.abs(s).max(axis=-1)
    below = np.abs(s[:, omega <= wish.bandwidth])
    error = math.sqrt(2) * below.max(axis=-1, initial=0.0)
    return {
        "peak": peak,
        "noise": noise_bandwidth(1 - s, omega),
        "fastest": highest_passed(1 - s, omega),
        "error": error,
        "missed": np.maximum(peak / WORST_PEAK, error),
    }


def _times(
    family: Family, wish: Wish, plant: Plant, found: Candidates, gain: Vector
) -> dict[str, Vector]:
    if math.isinf(wish.settling):
        nothing = np.zeros(found.count)
        return {"settling": nothing, "charging": nothing, "missed": nothing}
    load = family.load / family.reach(found.measures["fastest"], np.abs(found.gain))
    here = family, plant, found.above, found.below, gain
    settling, charging = settling_times(*here, wanted=wish.settling, relative_load=load)
    late = np.maximum(settling, charging / CHARGING) / (MARGIN * wish.settling)
    return {"settling": settling, "charging": charging, "missed": late}
