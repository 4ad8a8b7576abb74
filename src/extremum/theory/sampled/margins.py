"""Margins of the averaged sampled loop, from its characteristic loci λ(L_d(e^(jθ)))."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .gain import SampledLoopGain

POINTS: Final = 2000
"""Angles θ at which the loci are computed, evenly in ln θ."""

LOWEST: Final = 1e-3
"""The lowest θ over the slowest mode's |ln z|."""

PRECISION: Final = 1e-12
"""Of the θ of a crossing, relative."""


@dataclass(frozen=True)
class Margins:
    """How far a stable loop is from instability; made by `SampledLoopGain.margins`.

    A change that all axes share, as det(I + k L) = Π (1 + k λ_i): of coupled axes the margins are
    those of the characteristic loci λ_i, and exact in the same sense.

    Attributes
    ----------
    gain
        Factors (low, high) between which k L stays stable; low is 0 where no smaller gain harms.
    phase
        The smallest phase (rad) whose e^(−jφ) or e^(jφ) in all loops ends stability.
    delay
        The smallest further delay (s) in the slow loop that does, φ/ω, the demodulation's phase
        being kept right; `critical_delay` is about the whole effect.
    crossover
        The frequencies (rad/s) of `phase` and `delay`.
    """

    gain: tuple[float, float]
    phase: float
    delay: float
    crossover: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.gain
        if math.isnan(high):
            return "not stable: no margins"
        smaller = f"{low:.4g} … " if low else "up to "
        phase = f"phase {math.degrees(self.phase):.4g}° at {self.crossover[0]:.4g} rad/s"
        delay = f"delay {self.delay:.4g} s at {self.crossover[1]:.4g} rad/s"
        return f"margins: gain × {smaller}{high:.4g}, {phase}, {delay}"


def margins(gain: SampledLoopGain) -> Margins:
    """Return the margins of a stable loop; NaN and an empty interval of one that is not."""
    if not gain.stable:
        return Margins((math.nan, math.nan), math.nan, math.nan, (math.nan, math.nan))
    factors = [k for block in gain.blocks for k in _factors(gain, block)]
    crossed = [point for block in gain.blocks for point in _crossovers(gain, block)]
    late = [((cmath.phase(value) + math.pi) % (2 * math.pi), theta) for theta, value in crossed]
    either = [(min(phi, 2 * math.pi - phi), theta) for phi, theta in late]
    none = (math.inf, math.nan)
    phase, first = min(either, default=none)
    delay, second = min(((phi / theta, theta) for phi, theta in late), default=none)
    return Margins(
        gain=(
            max((k for k in factors if k < 1), default=0.0),
            min((k for k in factors if k > 1), default=math.inf),
        ),
        phase=phase,
        delay=delay * gain.dt,
        crossover=(first / gain.dt, second / gain.dt),
    )


def _angles(gain: SampledLoopGain) -> NDArray[np.float64]:
    speeds = np.abs(gain.modes[np.isfinite(gain.modes)]) * gain.dt
    return np.geomspace(min(LOWEST * float(speeds.min()), 0.1), math.pi, POINTS)


def _loci(gain: SampledLoopGain, block: Sequence[int], z: Any) -> NDArray[np.complex128]:
    """Return a block's characteristic loci, (N, axes), at points (N,)."""
    return np.linalg.eigvals(gain.response(np.asarray(z, complex), block)).astype(complex)


def _crossovers(gain: SampledLoopGain, block: Sequence[int]) -> Iterator[tuple[float, complex]]:
    """Yield (θ, λ) wherever |λ| = 1: the loci in the order of |λ| are continuous in that."""

    def sorted_by_size(thetas: Any) -> NDArray[np.complex128]:
        loci = _loci(gain, block, np.exp(1j * np.asarray(thetas)))
        return np.take_along_axis(loci, np.argsort(np.abs(loci), axis=1), axis=1)

    yield from _zeros(sorted_by_size, lambda loci: np.log(np.abs(loci)), _angles(gain))


def _factors(gain: SampledLoopGain, block: Sequence[int]) -> Iterator[float]:
    """Yield every k > 0 for which k L_d has a closed-loop pole on the unit circle."""

    def sorted_by_side(thetas: Any) -> NDArray[np.complex128]:
        loci = _loci(gain, block, np.exp(1j * np.asarray(thetas)))
        return np.take_along_axis(loci, np.argsort(loci.imag, axis=1), axis=1)

    inner = _angles(gain)[:-1]
    found = [value for _, value in _zeros(sorted_by_side, lambda loci: loci.imag, inner)]
    poles = np.concatenate([np.linalg.eigvals(gain.plants[i].transition) for i in block])
    inside = [np.linalg.eigvals(gain.compensators[i].a) for i in block]
    settled = all(np.abs(np.concatenate([poles, *inside]) - 1) > 1e-9)
    found += [*_loci(gain, block, [-1.0])[0], *(_loci(gain, block, [1.0])[0] if settled else ())]
    yield from (-1 / value.real for value in found if value.real < 0)


def _zeros(
    loci: Callable[[Any], NDArray[np.complex128]],
    height: Callable[[NDArray[np.complex128]], NDArray[np.float64]],
    thetas: NDArray[np.float64],
) -> Iterator[tuple[float, complex]]:
    """Yield (θ, λ) of every zero of the loci's height between given angles."""
    from scipy.optimize import brentq

    heights = height(loci(thetas))
    for column in range(heights.shape[1]):
        crossed = np.flatnonzero(np.diff(heights[:, column] < 0))
        for a, b in zip(thetas[crossed], thetas[crossed + 1], strict=True):
            root: Any = brentq(
                lambda x, i=column: height(loci([x]))[0, i], a, b, xtol=PRECISION * a
            )
            yield root, complex(loci([root])[0, column])
