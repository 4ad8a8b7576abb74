"""One trajectory by SciPy's DOP853: opaque fields, platforms without heyoka, and the oracle."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..system import System
from .trajectory import COMPLETED, LEFT, UNDEFINED, Progress, Trajectory, broken_off

STEPS_PER_PERIOD: Final = 20
MIN_RTOL: Final = 3e-14


def integrate(
    system: System,
    values: Sequence[float],
    times: NDArray[np.float64],
    *,
    tol: float,
    state: Sequence[float] | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Return the solution of ẋ = f(x, p, t) at `times`; see `taylor.integrate`.

    The step is capped at a twentieth of the fastest dither period, because a step-size control
    that sees only its own stages can step over the dither.
    """
    from scipy.integrate import DOP853

    values = [float(v) for v in values]
    start = np.array(system.start(values) if state is None else state, dtype=float)
    period = system.fastest_period(values)
    solver = DOP853(
        _rates(system, values),
        float(times[0]),
        start,
        float(times[-1]),
        rtol=max(tol, MIN_RTOL),
        atol=max(tol, MIN_RTOL),
        max_step=period / STEPS_PER_PERIOD if period else np.inf,
    )
    guard = _guard(system, values)
    states = np.empty((len(times), len(start)))
    states[0], count = start, 1
    while count < len(times):
        before, last = float(solver.t), np.array(solver.y)
        with np.errstate(all="ignore"):
            solver.step()
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            outcome = broken_off(system, before, list(last), values)
            return Trajectory(times[:count], states[:count], outcome, before, last)
        dense = solver.dense_output()
        reached = int(np.searchsorted(times, solver.t, side="right"))
        inside = times[count:reached]
        if len(inside):
            states[count:reached] = dense(inside).T
        for time in (*inside, float(solver.t)):
            if guard(time, dense(time)) < 0:
                edge = _edge(partial(_along, guard, dense), before, float(time))
                count += int(np.searchsorted(inside, edge, side="right"))
                return Trajectory(times[:count], states[:count], LEFT, edge, dense(edge))
        count = reached
        if progress is not None:
            progress(float(solver.t))
    return Trajectory(times, states, COMPLETED, float(times[-1]), states[-1])


def _rates(system: System, values: list[float]) -> Callable[[float, NDArray[np.float64]], Any]:
    rates, broken = system.rates, np.full(len(system.states), np.nan)

    def evaluate(time: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        try:
            return np.array(rates(time, state.tolist(), values), dtype=float)
        except UNDEFINED:
            return broken

    return evaluate


def _guard(system: System, values: list[float]) -> Callable[[float, NDArray[np.float64]], float]:
    if not system.guards:
        return lambda time, state: math.inf
    return lambda time, state: min(system.margins(time, state.tolist(), values))


def _along(guard: Any, dense: Any, time: float) -> float:
    return guard(time, dense(time))


def _edge(guard: Callable[[float], float], inside: float, outside: float) -> float:
    """Return the last time before the guard turns negative."""
    while (middle := (inside + outside) / 2) not in (inside, outside):
        if guard(middle) < 0:
            outside = middle
        else:
            inside = middle
    return inside
