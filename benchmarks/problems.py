"""Figures 4 and 5 of Zhang et al. (2007), written by hand, and their solution by a third method.

Nothing here comes from `extremum`: the equations are the paper's, the right-hand side is what a
careful user of SciPy writes, and the reference is Gragg–Bulirsch–Stoer extrapolation, a method
that neither heyoka (Taylor) nor SciPy's DOP853, RK45 and LSODA use.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rates = Callable[[float, NDArray[np.float64]], Sequence[float]]

OMEGA, WASHOUT, PEAK, Q_X, Q_Y = 30.0, 1.0, 1.0, 1.0, 0.5
START = (1.0, 1.0, 0.0)
PERIOD = 2 * pi / OMEGA
STEPS = (2, 4, 6, 8, 10, 12, 14)


@dataclass(frozen=True)
class Problem:
    """One loop: position (x, y), washout η; ẋ = αω cos ωt + cξ sin ωt, ẏ = αω sin ωt − cξ cos ωt.

    Attributes
    ----------
    name
        The scenario's.
    t_end
        Duration (s).
    amplitude, gain
        α (m) and c.
    moving
        Whether the source moves on the figure eight (sin 0.1t, sin 0.2t); it is (−1, −1) else.
    """

    name: str
    t_end: float
    amplitude: float
    gain: float
    moving: bool

    @property
    def times(self) -> NDArray[np.float64]:
        """The output times (s): 2000 intervals."""
        return np.linspace(0.0, self.t_end, 2001)

    def rates(self, gain: float) -> Rates:
        """Return (t, state) → ẋ with x's gain changed; plain floats, constants folded."""
        speed, c_y = self.amplitude * OMEGA, self.gain

        def still(time: float, state: NDArray[np.float64]) -> Sequence[float]:
            x, y, eta = state.tolist()
            sine, cosine = sin(OMEGA * time), cos(OMEGA * time)
            x += 1.0
            y += 1.0
            xi = PEAK - Q_X * x * x - Q_Y * y * y - eta
            return (
                speed * cosine + gain * xi * sine,
                speed * sine - c_y * xi * cosine,
                WASHOUT * xi,
            )

        def moving(time: float, state: NDArray[np.float64]) -> Sequence[float]:
            x, y, eta = state.tolist()
            sine, cosine = sin(OMEGA * time), cos(OMEGA * time)
            x -= sin(0.1 * time)
            y -= sin(0.2 * time)
            xi = PEAK - Q_X * x * x - Q_Y * y * y - eta
            return (
                speed * cosine + gain * xi * sine,
                speed * sine - c_y * xi * cosine,
                WASHOUT * xi,
            )

        return moving if self.moving else still

    def results(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rows x, y and J from states (3, times)."""
        x, y, _ = states
        times = self.times
        a, b = (np.sin(0.1 * times), np.sin(0.2 * times)) if self.moving else (-1.0, -1.0)
        return np.stack([x, y, PEAK - Q_X * (x - a) ** 2 - Q_Y * (y - b) ** 2])

    def reference(self, parts: int = 1) -> NDArray[np.float64]:
        """Return x, y and J at the output times, each interval taken in `parts` steps."""
        rates = self.rates(self.gain)
        states = [np.array(START)]
        times = self.times
        for begin, end in pairwise(times):
            state, step = states[-1], (end - begin) / parts
            for part in range(parts):
                state = extrapolated(rates, float(begin + part * step), state, float(step))
            states.append(state)
        return self.results(np.stack(states, axis=1))


def extrapolated(
    rates: Any, time: float, state: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Return the state a step later: modified midpoint rule, Aitken–Neville in 1/n², order 14."""
    slope = np.array(rates(time, state))
    table: list[NDArray[np.float64]] = []
    for row, count in enumerate(STEPS):
        small = step / count
        before, here = state, state + small * slope
        for i in range(1, count):
            ahead = before + 2 * small * np.array(rates(time + i * small, here))
            before, here = here, ahead
        last = np.array(rates(time + step, here))
        previous, table = table, [0.5 * (before + here + small * last)]
        for column in range(row):
            ratio = (count / STEPS[row - 1 - column]) ** 2
            table.append(table[-1] + (table[-1] - previous[column]) / (ratio - 1))
    return table[-1]


FIG4 = Problem("fig4", 4.0, amplitude=0.08, gain=10.0, moving=False)
FIG5 = Problem("fig5", 30.0, amplitude=0.05, gain=15.0, moving=True)
