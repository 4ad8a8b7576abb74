"""Whether a loop may shrink its dither: what `ShrinkingDither` needs for its proof."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import InvalidDescription, shown
from ..loop import Loop, checked
from ..sampled.adapting import ShrinkingDither
from .averaging import average
from .demodulation import gradient

FACTORS: Final = 33
"""How many factors are looked at, evenly in their logarithms."""


@dataclass(frozen=True)
class ShrinkingCheck:
    """What a loop does while its dither shrinks; made by `check_shrinking`.

    Attributes
    ----------
    factors
        a, from `least` to 1.
    rates
        The largest real part (1/s) of the averaged loop's modes at each of them.
    shrink
        Time constant (s) with which the dither shrinks.
    """

    factors: tuple[float, ...]
    rates: tuple[float, ...]
    shrink: float

    @property
    def stable(self) -> bool:
        """Whether the averaged loop is stable at every factor that was looked at."""
        return max(self.rates) < 0

    @property
    def slow(self) -> bool:
        """Whether the dither shrinks more slowly than the slowest loop converges, T > 1/|λ|."""
        return self.stable and self.shrink * -max(self.rates) > 1

    @property
    def holds(self) -> bool:
        """Whether averaging first, and letting the dither shrink second, is right."""
        return self.stable and self.slow

    def __str__(self) -> str:
        worst = int(np.argmax(self.rates))
        rate, factor = self.rates[worst], self.factors[worst]
        first = f"a = {self.factors[0]:.4g} … 1: the averaged loop's slowest mode"
        if not self.stable:
            return f"{first} grows at {rate:.4g} 1/s at a = {factor:.4g}; take a larger `least`"
        text = f"{first} is {rate:.4g} 1/s at a = {factor:.4g}; it is stable throughout\n"
        verdict = "longer" if self.slow else "too short: not longer"
        return f"{text}shrink = {self.shrink:.4g} s: {verdict} than 1/|λ| = {-1 / rate:.4g} s"

    __repr__ = __str__


def check_shrinking(loop: Loop, dither: ShrinkingDither) -> ShrinkingCheck:
    """Return whether a loop keeps the conditions under which its dither may shrink.

    The averaged loop must be stable with all amplitudes times a, for every a from `least` to 1, and
    converge faster than a shrinks: T_shrink > 1/|λ| for its slowest mode λ. Judged by its
    eigenvalues at 33 factors.

    Raises
    ------
    InvalidDescription
        For a loop that cannot be averaged (`average`), or a controller that does not demodulate.
    """
    if not isinstance(dither, ShrinkingDither):
        raise InvalidDescription("dither", "must be a ShrinkingDither", shown(dither))
    channels = gradient(checked(loop)).channels
    factors = np.geomspace(dither.least, 1.0, FACTORS)
    rates = []
    for factor in factors:
        smaller = {
            f"controller.channels.{i}.dither.amplitude": factor * channel.dither.amplitude
            for i, channel in enumerate(channels)
        }
        rates.append(float(average(loop.replace(smaller)).eigenvalues.real.max()))
    return ShrinkingCheck(tuple(factors.tolist()), tuple(rates), dither.shrink)
