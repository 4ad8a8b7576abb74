"""Random design problems: what is accepted does what was asked, where nobody looked before."""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np
import pytest

import extremum as es
from extremum.theory.synthesis import designing

from .. import oracle
from ..plain import Loop, Vector
from . import exactly
from .judged import (
    GRANTED,
    SETTLED,
    Point,
    hand_written,
    multipliers,
    on_dither,
    random_points,
    reach,
    read,
    settled,
    times_of,
)
from .random_requirements import random_requirements, requirements

COUNT: Final = 300
POINTS: Final = 20
QUICK: Final = (1, 2, 3, 4, 6, 7, 9, 12, 15, 18, 21, 24)
SLOW: Final = range(0, COUNT, 10)
"""Run by ``pytest -m slow``; all of them by ``pytest -m sweep``."""


def _marks(seed: int) -> list[pytest.MarkDecorator]:
    often = [] if seed in QUICK else [pytest.mark.slow] if seed in SLOW else []
    return [*often, pytest.mark.sweep] if seed not in QUICK else often


EVERY: Final = [pytest.param(k, marks=_marks(k)) for k in range(COUNT)]
BY_HAND: Final = 6
"""Of so many problems the run of one is compared with SciPy's, which takes ten times as long."""
LOADS: Final = ("field.source.", "vehicle.disturbance.")
ACCEPTED: Final = "accepted"
CYCLES: Final = 40
"""Dither periods of a run that are compared with SciPy's."""

REFUSED: Final = (21, 30, 42)
"""Refused problems on one axis, whose remedies are soon found."""

verdicts: dict[int, str] = {}


def attempted(seed: int) -> es.Design | None:
    """The design of a random problem, None if it is refused; remedies are not looked for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(designing, "eased", lambda *_: [])
        try:
            design = es.design(requirements(random_requirements(seed)))
        except es.Infeasible as refusal:
            verdicts[seed] = refusal.condition
            return None
    verdicts[seed] = ACCEPTED
    return design


def unloaded(point: Point) -> dict[str, float]:
    """A point with the source where the vehicle rests and no force: nothing is to be charged."""
    return {path: 0.0 if path.startswith(LOADS) else x for path, x in point.items()}


@pytest.mark.parametrize("seed", EVERY)
def test_an_accepted_design_keeps_what_it_promises(seed: int) -> None:
    """At 20 points of its box, every other one with no load: multipliers, offset, settling.

    The orbit of one point is compared with a loop written by hand, and of some the run of another.
    """
    numbers = random_requirements(seed)
    design = attempted(seed)
    if design is None:
        return
    rng = np.random.default_rng([42, seed])
    for index, drawn in enumerate(random_points(design.box, POINTS, seed)):
        point = drawn if index % 2 else unloaded(drawn)
        orbit = es.periodic_orbit(design.at(point))
        assert orbit.found, orbit.outcome
        assert np.abs(orbit.multipliers).max() < 1
        if numbers["zero_bias"]:
            assert np.abs(orbit.offset).max() < 1e-9
        plain = hand_written(numbers, design.controller, point)
        if index == 0:
            check_orbit(orbit, oracle.orbit(plain))
        if numbers["settling_time"] is not None:
            r = reach(plain)
            moved = orbit.offset.copy()
            moved[rng.integers(len(moved))] += r * rng.choice((-1.0, 1.0))
            started = design.at(point, tuple(moved.tolist()))
            allowed = GRANTED * numbers["settling_time"] + 2 * np.pi / plain.frequencies.min()
            times = times_of(plain, 1.3 * allowed + 2 * plain.period)
            run = es.simulate(started, times[-1], samples=times, tol=1e-10)
            assert run.attrs["outcome"] == "completed"
            error = (run.position - run.source).values
            assert settled(times, error, orbit.offset, r, plain.period) < allowed
            if index == 1 and seed % BY_HAND == 0:
                check_run(plain, started, times, error, 0.05 * SETTLED * r)


def check_orbit(found: es.Orbit, exact: oracle.Orbit) -> None:
    """Compare characteristic polynomials of the monodromy matrices, whose clusters do not hurt."""
    assert np.abs(multipliers(exact)).max() < 1
    expected = np.poly(multipliers(exact))
    apart = np.abs(np.poly(found.multipliers) - expected).max()
    assert apart < 1e-5 * np.abs(expected).max()
    assert found.offset == pytest.approx(exact.offset, abs=1e-8)


def check_run(plain: Loop, loop: es.Loop, times: Vector, error: Vector, near: float) -> None:
    """Compare the beginning of a run with one by SciPy of the loop written by hand."""
    start = on_dither(plain, np.array(loop.start.position))
    times = times[times <= CYCLES * 2 * np.pi / plain.frequencies.max()]
    by_hand = exactly.run(plain, start, times)
    dither = (plain.dither * np.exp(1j * np.outer(times, plain.frequencies))).imag
    assert np.abs(error[: len(times)] - dither - by_hand).max() < near


@pytest.mark.sweep
def test_a_fair_part_is_accepted_and_refusals_are_of_many_kinds() -> None:
    """Run after all others, which leave their verdicts."""
    for seed in range(COUNT):
        if seed not in verdicts:
            attempted(seed)
    counts = Counter(verdicts.values())
    assert 0.5 * COUNT < counts[ACCEPTED] < 0.9 * COUNT
    assert len(counts) >= 4
    assert counts["proof"] <= 0.02 * COUNT


@pytest.mark.parametrize("seed", REFUSED)
def test_every_change_that_a_refusal_proposes_makes_it_feasible(seed: int) -> None:
    wanted = requirements(random_requirements(seed))
    with pytest.raises(es.Infeasible) as refused:
        es.design(wanted)
    assert len(refused.value.changes) > 1
    for name, value in refused.value.changes:
        eased = wanted.replace({name: read(name, value)})
        assert es.design(eased).confirmations
