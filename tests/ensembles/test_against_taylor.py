"""The CPU ensemble engine against the Taylor engine, on random loops of all kinds.

A loop is compared where the reference itself is not in doubt: its end moves by at most `STIFF`
times a disturbance of its start.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from random_structures import FORMULAS, Case, random_case

from extremum.engines import simd, taylor
from extremum.engines.lanes.asked import OUTCOMES, Ended
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
    nudged: int
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
    numbers, system = case.numbers(column), case.asked().system
    start = np.array(system.start(numbers), dtype=float)
    signs = np.where(np.arange(len(start)) % 2, 1, -1)

    def run(state: np.ndarray) -> Any:
        times = np.array([0.0, case.t_end])
        return taylor.integrate(system, numbers, times, tol=1e-14, state=state.tolist())

    exact, nudged = run(start), run(start + NUDGE * (1 + np.abs(start)) * signs)
    outcome = OUTCOMES.index(exact.outcome)

    def apart(outcome: int, states: np.ndarray, time: float) -> float:
        if outcome:
            return abs(time - exact.end_time)
        return float(np.abs((states - exact.end_state) / (1 + np.abs(exact.end_state))).max())

    return Found(
        seed,
        column,
        outcome,
        OUTCOMES.index(nudged.outcome),
        apart(outcome, nudged.end_state, nudged.end_time) / NUDGE,
        {d: int(e.outcome[column]) for d, e in ended.items()},
        {d: apart(outcome, e.states[:, column], e.end_time[column]) for d, e in ended.items()},
    )
