"""The CPU ensemble engine against the Taylor engine, on random loops of all kinds.

A loop is compared where the reference itself is not in doubt: its end moves by at most `STIFF`
times a disturbance of its start.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pytest
from random_structures import FORMULAS, Case, random_case

from extremum.engines import simd, taylor
from extremum.engines.lanes.asked import OUTCOMES, Ended
from extremum.engines.trajectory import Trajectory
from extremum.symbols import FUNCTIONS

NUDGE = 1e-9
PRECISIONS = {"float64": (1e-6, 1e-6), "float32": (1e-5, 1e-4)}
"""Tolerance asked for, error allowed."""

AMPLIFIED = 10.0
"""A loop whose end moves by more than this times a disturbance of its start is unstable over the
run: its error may be larger by as much."""


@dataclass(frozen=True)
class Found:
    """One loop: the reference's outcome, how it amplifies, and what each precision made of it."""

    seed: int
    column: int
    outcome: int
    amplified: float
    outcomes: dict[str, int]
    errors: dict[str, float]

    def __str__(self) -> str:
        made = ", ".join(f"{d}: {OUTCOMES[o]}, {self.errors[d]:.1e}" for d, o in self.outcomes.items())
        return (
            f"structure {self.seed}, column {self.column}: {OUTCOMES[self.outcome]}, "
            f"a disturbance grows {self.amplified:.1e} times; {made}"
        )


def compared(seeds: Iterable[int], columns: int) -> list[Found]:
    """Run structures by both engines."""
    found = []
    for seed in seeds:
        case = random_case(seed, columns)
        ended = {
            dtype: simd.integrate(case.asked(dtype=dtype, tol=tol))
            for dtype, (tol, _) in PRECISIONS.items()
        }
        found += [_one(case, seed, column, ended) for column in range(columns)]
    return found


def _one(case: Case, seed: int, column: int, ended: dict[str, Ended]) -> Found:
    system, numbers = case.asked().system, case.numbers(column)

    def run(times: np.ndarray, state: np.ndarray) -> Trajectory:
        return taylor.integrate(system, numbers, times, tol=1e-14, state=state.tolist())

    start = np.array(system.start(numbers), dtype=float)
    whole = run(np.array([0.0, case.t_end]), start)
    outcome = OUTCOMES.index(whole.outcome)
    quarters = np.linspace(0, whole.end_time, 5)[:-1]
    exact = run(np.append(quarters, case.t_end), start)
    begun = list(zip(quarters, exact.states, strict=False))

    def apart(run: Trajectory) -> float:
        return _apart(outcome, exact, run.end_state, run.end_time)

    nudged = [
        run(np.array([time, case.t_end]), state + NUDGE * (1 + np.abs(state)) * sign)
        for time, state in begun
        for sign in (1, (-1) ** np.arange(len(state)))
    ]
    return Found(
        seed,
        column,
        outcome,
        max(apart(other) for other in nudged) / NUDGE,
        {d: int(e.outcome[column]) for d, e in ended.items()},
        {
            d: _apart(outcome, exact, e.states[:, column], e.end_time[column])
            for d, e in ended.items()
        },
    )


def _apart(outcome: int, exact: Trajectory, states: np.ndarray, time: float) -> float:
    """How far apart two runs end: |x − y|/(1 + |y|), or seconds where they break off."""
    if outcome:
        return abs(time - exact.end_time)
    return float(np.abs((states - exact.end_state) / (1 + np.abs(exact.end_state))).max())
