"""An ensemble engine that is slow and exact: one loop after the other, as `simulate` runs it.

The oracle of the fast engines. Means are integrals carried along as states; maxima and crossings
are looked for on a fine grid and refined by parabolas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import sympy

from extremum.engines.choice import ENGINES, usual
from extremum.engines.lanes.asked import OUTCOMES, Asked, Ended
from extremum.engines.lanes.watch import Watch
from extremum.system import System

PER_PERIOD = 400
TOL = 1e-13


@lru_cache(maxsize=64)
def followed(system: System, watch: Watch) -> tuple[System, Any]:
    """The system with an integral for each mean, and what else is watched as a function."""
    means = (*watch.mean, *watch.last_mean)
    zero = (sympy.Integer(0),) * len(means)
    wider = replace(
        system,
        states=(*system.states, *(sympy.Symbol(f"I_{i}", real=True) for i in range(len(means)))),
        rhs=(*system.rhs, *means),
        initial=(*system.initial, *zero),
    )
    return wider, system.function((*watch.maxima, *watch.beyond), vector=True)


def peak(times: np.ndarray, values: np.ndarray) -> float:
    """The largest value of a smooth function of which equispaced samples are known."""
    at = int(np.argmax(values))
    if not 0 < at < len(values) - 1:
        return float(values[at])
    before, here, after = values[at - 1 : at + 2]
    bend = before - 2 * here + after
    return float(here - (after - before) ** 2 / (8 * bend)) if bend else float(here)


def last_positive(times: np.ndarray, values: np.ndarray) -> float:
    """The last time at which a smooth function is positive, 0 if it never is."""
    above = np.flatnonzero(values > 0)
    if not len(above):
        return 0.0
    at = int(above[-1])
    if at == len(values) - 1:
        return float(times[-1])
    first = max(0, min(at - 1, len(values) - 4))
    part = slice(first, first + 4)
    roots = np.roots(np.polyfit(times[part] - times[at], values[part], 3))
    real = roots.real[np.abs(roots.imag) < 1e-9]
    inside = real[(real >= -1e-12) & (real <= times[at + 1] - times[at] + 1e-12)]
    return float(times[at] + inside.max())


def one(asked: Asked, index: int) -> dict[str, Any]:
    values = asked.values.copy()
    values[list(asked.swept)] = asked.columns[:, index]
    numbers = values.tolist()
    system, count = asked.system, len(asked.system.states)
    wider, judged = followed(system, asked.watch)
    engine, tol = ENGINES[usual(wider)], TOL if usual(wider) == "taylor" else 1e-10
    period = system.fastest_period(numbers) or asked.t_end
    steps = int(np.ceil(asked.t_end / period * PER_PERIOD)) + 4
    start = wider.start(numbers)
    times = np.linspace(0, asked.t_end, steps)
    run = engine.integrate(wider, numbers, times, tol=tol, state=start)
    completed = run.outcome == "completed"
    means, lasts = len(asked.watch.mean), len(asked.watch.last_mean)
    last = np.full(lasts, np.nan)
    if completed and lasts:
        assert asked.window is not None
        length = float(asked.window[index])
        edge = max(asked.t_end - length, 0.0)
        begun = (
            start
            if edge == 0
            else engine.integrate(
                wider, numbers, np.array([0.0, edge]), tol=tol, state=start
            ).states[-1]
        )
        last = (run.states[-1] - begun)[count + means :] / length
    with np.errstate(all="ignore"):
        curves = judged(run.times, list(run.states.T[:count]), numbers)
    curves = [np.broadcast_to(c, len(run.times)) for c in curves]
    tops = len(asked.watch.maxima)
    sampled = np.full((asked.samples, count), np.nan)
    if asked.samples:
        wanted = np.linspace(0, asked.t_end, asked.samples)
        kept = engine.integrate(system, numbers, wanted, tol=tol).states
        sampled[: len(kept)] = kept
    with np.errstate(all="ignore"):
        mean = run.end_state[count : count + means] / run.end_time if run.end_time else np.nan
    return {
        "states": run.end_state[:count],
        "outcome": OUTCOMES.index(run.outcome),
        "end_time": run.end_time,
        "mean": np.broadcast_to(mean, means),
        "last_mean": last,
        "maxima": [peak(run.times, c) for c in curves[:tops]],
        "beyond": [last_positive(run.times, c) for c in curves[tops:]],
        "samples": sampled,
        "steps": steps,
    }


def integrate(
    asked: Asked,
    *,
    threads: int = 1,
    progress: Callable[[float], object] | None = None,
    scheme: object = None,
) -> Ended:
    runs = [one(asked, i) for i in range(asked.count)]
    if progress is not None:
        progress(1.0)
    stacked = {name: np.stack([np.asarray(r[name]) for r in runs], axis=-1) for name in runs[0]}
    stacked["outcome"] = stacked["outcome"].astype(np.int8)
    return Ended(**stacked, scheme="slow and exact")
