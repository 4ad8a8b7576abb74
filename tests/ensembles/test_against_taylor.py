"""The CPU ensemble engine against the Taylor engine, on random loops of all kinds.

How exactly a loop's end can be known is the reference's to say: A is how much a disturbance of its
state, at the start or on the way, has grown by the end. A loop with A ≤ 1 forgets; some are
unstable, with A up to 10⁴, and an error made early grows with them. So errors are compared with
1 + A.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pytest
from random_structures import FORMULAS, Case, random_case

from extremum.engines import simd, taylor
from extremum.engines.lanes.asked import OUTCOMES, Ended
from extremum.engines.trajectory import Trajectory
from extremum.symbols import FUNCTIONS

NUDGE: Final = 1e-9
TOLERANCES: Final = {"float64": 1e-6, "float32": 1e-5}
ERRORS: Final = {"float64": 1e-6, "float32": 1e-4}
"""Allowed of |x − exact|/(1 + |exact|), times 1 + A."""

SECONDS: Final = {"float64": (1e-5, 1e-5), "float32": (1e-3, 0.1)}
"""Allowed of the time of an escape, or of the edge of the field, times 1 + A: for nine of ten
loops, and for all. Where dynamics are thousands of times faster than the dither, single precision
ends early: it cannot hold the derivatives that a step takes."""

CALM: Final = 10.0
FEW: Final = (*range(5, 75, 7), 92)


@dataclass(frozen=True)
class Found:
    """One loop: the reference's outcome, A, and what each precision made of it."""

    seed: int
    column: int
    outcome: int
    amplified: float
    outcomes: dict[str, int]
    errors: dict[str, float]

    def __str__(self) -> str:
        made = [f"{d}: {OUTCOMES[o]}, {self.errors[d]:.1e}" for d, o in self.outcomes.items()]
        return (
            f"structure {self.seed}, column {self.column}: {OUTCOMES[self.outcome]}, "
            f"A = {self.amplified:.1e}; {'; '.join(made)}"
        )


def compared(seeds: Iterable[int], columns: int) -> list[Found]:
    """Run structures on both engines."""
    found = []
    for seed in seeds:
        case = random_case(seed, columns)
        ended = {
            dtype: simd.integrate(case.asked(dtype=dtype, tol=tol))
            for dtype, tol in TOLERANCES.items()
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
    on_the_way = np.linspace(0, 1, 12)[:-1] ** 0.9 * whole.end_time
    exact = run(np.append(on_the_way, case.t_end), start)

    def apart(states: np.ndarray, time: float) -> float:
        if outcome:
            return abs(time - exact.end_time)
        return float(np.abs((states - exact.end_state) / (1 + np.abs(exact.end_state))).max())

    signs = (np.ones(len(start)), (-1.0) ** np.arange(len(start)))
    nudged = [
        run(np.array([time, case.t_end]), state + NUDGE * (1 + np.abs(state)) * sign)
        for time, state in zip(on_the_way, exact.states, strict=False)
        for sign in signs
    ]
    return Found(
        seed,
        column,
        outcome,
        max(apart(other.end_state, other.end_time) for other in nudged) / NUDGE,
        {d: int(e.outcome[column]) for d, e in ended.items()},
        {d: apart(e.states[:, column], e.end_time[column]) for d, e in ended.items()},
    )


def check(found: list[Found]) -> None:
    """Refuse another outcome, and errors that are too large."""
    for dtype in TOLERANCES:
        other = [f for f in found if f.outcomes[dtype] != f.outcome]
        assert not other, "\n".join(map(str, other))
        done = [f for f in found if f.outcome == 0]
        wrong = [f for f in done if f.errors[dtype] > ERRORS[dtype] * (1 + f.amplified)]
        assert not wrong, "\n".join(map(str, wrong))
        calm = np.array([f.errors[dtype] for f in done if f.amplified <= CALM])
        assert calm.max() < ERRORS[dtype]
        times = np.array([f.errors[dtype] / (1 + f.amplified) for f in found if f.outcome])
        most, all_ = SECONDS[dtype]
        assert np.quantile(times, 0.9) < most
        assert times.max() < all_


def test_some_random_loops() -> None:
    check(compared(FEW, 6))


@pytest.mark.slow
def test_a_thousand_random_loops() -> None:
    found = compared(range(125), 8)
    check(found)
    for dtype, limit in ERRORS.items():
        calm = [f.errors[dtype] for f in found if f.outcome == 0 and f.amplified <= CALM]
        assert len(calm) > 400
        assert np.median(calm) < limit / 10
    outcomes = Counter(f.outcome for f in found)
    assert len(found) == 1000
    assert min(outcomes[o] for o in range(len(OUTCOMES))) >= 30


def test_the_random_loops_are_of_all_kinds() -> None:
    text = "".join(str(formula) for formula in FORMULAS)
    assert all(f"{name}(" in text for name in FUNCTIONS)
    loops: list[Any] = [random_case(seed).loop for seed in range(30)]
    channels = [channel for loop in loops for channel in loop.controller.channels]
    kinds: dict[str, Iterable[object]] = {
        "fields": {type(loop.field).__name__ for loop in loops},
        "axes": {len(loop.vehicle.axes) for loop in loops},
        "starts": {type(loop.start).__name__ for loop in loops},
        "excitations": {type(channel.dither).__name__ for channel in channels},
        "ratios": {type(channel.ratio).__name__ for channel in channels},
        "references": {channel.reference is None for channel in channels},
        "ramps": {loop.controller.probe_ramp is None for loop in loops},
        "disturbances": {loop.vehicle.disturbance is None for loop in loops},
        "washouts": {loop.controller.washout_start for loop in loops},
    }
    expected = {"fields": 5, "axes": 3, "starts": 3, "washouts": 3}
    assert {name: len(set(kind)) for name, kind in kinds.items()} == dict.fromkeys(
        kinds, 2
    ) | expected
