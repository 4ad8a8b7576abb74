"""The exact loops of designs: orbits by an oracle, settling and arrival by genuine runs."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import extremum as es
from extremum.theory.synthesis.confirmation import Arrival, Confirmed, confirmed, reach
from extremum.theory.synthesis.search import _far, _Search
from extremum.theory.synthesis.shapes import Wish

from .. import oracle
from . import exactly
from .asked import ASKED, EPSILON, designed, required, unstable
from .test_design import QUICK, random_points, rule

# --- the exact loop ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ASKED)
def test_confirmations_are_the_oracle_s_orbits(name: str) -> None:
    """Largest exponent and mean offset, at six of the points looked at."""
    design = designed(name)
    rng = np.random.default_rng(5)
    seen = [design.confirmations[k] for k in rng.permutation(len(design.confirmations))[:6]]
    for found in seen:
        orbit = oracle.orbit(exactly.plain_of(design.loop.replace(found.point)))
        assert found.exponent == pytest.approx(orbit.exponents.real.max(), abs=1e-9)
        assert found.offset == pytest.approx(np.linalg.norm(orbit.offset), abs=1e-11)
        assert found.stable
        if ASKED[name].zero_bias:
            assert found.offset < 1e-9


def test_confirmations_are_periodic_orbit_s() -> None:
    design = designed("forces")
    for found in design.confirmations[:3]:
        orbit = es.periodic_orbit(design.loop.replace(found.point))
        assert found.exponent == pytest.approx(float(orbit.exponents[0].real), rel=1e-9)
        assert found.outcome == orbit.outcome == "found"


@pytest.mark.parametrize("name", ASKED)
def test_corners_midpoints_and_centre_were_looked_at(name: str) -> None:
    design = designed(name)
    box = {path: box for path, box in design.box.items() if path in design.confirmations[0].point}
    ends = [(low, (low + high) / 2, high) for low, high in box.values()]
    expected = {
        tuple(e[k] for e, k in zip(ends, node, strict=True))
        for node in itertools.product((0, 1, 2), repeat=len(ends))
        if node.count(1) <= 1 or node.count(1) == len(node)
    }
    found = {tuple(c.point[path] for path in box) for c in design.confirmations}
    assert found == expected
    left_out = set(design.box) - set(box)
    loads = {path for path in design.box if path.startswith(("field.source.", "vehicle.dist"))}
    assert left_out == (set() if name == "biased" else loads)


@pytest.mark.parametrize("name", ["unstable", "forces", "spring"])
def test_exponents_do_not_depend_on_the_load_that_integrators_take_up(name: str) -> None:
    """Why the source's place and the force are left out of the points: by the oracle."""
    design = designed(name)
    here = {path: ends[0] for path, ends in design.box.items()}
    there = here | {
        path: 0.3 * ends[1]
        for path, ends in design.box.items()
        if path not in design.confirmations[0].point
    }
    assert here != there
    rates = [
        oracle.orbit(exactly.plain_of(design.loop.replace(point))).exponents.real.max()
        for point in (here, there)
    ]
    assert rates[0] == pytest.approx(rates[1], abs=1e-9)


@pytest.mark.parametrize("name", ["coupled", "coupled alike", "unstable", "lagged"])
def test_the_exact_loop_is_stable_at_points_that_were_not_looked_at(name: str) -> None:
    design = designed(name)
    for point in random_points(name, 8):
        orbit = oracle.orbit(exactly.plain_of(design.loop.replace(point)))
        assert orbit.exponents.real.max() < 0
        assert np.abs(orbit.offset).max() < 1e-9


PLACES = [
    ("gain", (0.5,)),
    ("gain", (2.0,)),
    ("forces", (0.5, 1.0)),
    ("forces", (1.0, 0.5)),
    ("unstable", (1.0, 0.5, 0.0)),
]


def looked_at(design: es.Design, values: tuple[float, ...]) -> Confirmed:
    """What was confirmed at a point: its curvatures, then its uncertain numbers."""
    return next(c for c in design.confirmations if tuple(c.point.values()) == values)


@pytest.mark.parametrize(("name", "values"), PLACES)
def test_settling_is_what_the_exact_loop_does(name: str, values: tuple[float, ...]) -> None:
    """Integrators charged: the orbit's own state, and the vehicle moved by a reach r."""
    design = designed(name)
    seen = looked_at(design, values)
    loop = design.loop.replace(seen.point)
    plain, r = exactly.plain_of(loop), reach(loop)
    orbit = oracle.orbit(plain)
    periods = math.ceil(2 * seen.settling / plain.period)
    times = np.arange(periods + 1) * plain.period
    still = exactly.run(plain, orbit.start, times[:2])[0]
    offset = plain.dither.imag
    found = 0.0
    for axis, sign in itertools.product(range(len(plain.axes)), (1, -1)):
        moved = sign * r * np.eye(len(plain.axes))[axis]
        start = orbit.start + exactly.displaced(plain, moved)
        start[-1] += plain.field.value(offset + moved) - plain.field.value(offset)
        deviation = exactly.run(plain, start, times) - still
        beyond = np.linalg.norm(deviation, axis=1) > 0.02 * r
        found = max(found, float(times[np.flatnonzero(beyond)[-1]]))
    assert seen.settling == pytest.approx(found, abs=1.01 * plain.period, rel=0.05)


@pytest.mark.parametrize(("name", "values"), PLACES)
def test_charging_is_what_a_run_from_an_empty_controller_does(
    name: str, values: tuple[float, ...]
) -> None:
    """Means over each period of `simulate`, started on the dither a reach r from the source."""
    design = designed(name)
    seen = looked_at(design, values)
    loop = design.loop.replace(seen.point)
    r, period = reach(loop), 2 * math.pi / design.frequency
    periods, each, found = math.ceil(2 * seen.charging / period), 32, 0.0
    axes = len(design.plan.families)
    for axis, sign in itertools.product(range(axes), (1, -1)):
        moved = tuple(sign * r * (i == axis) for i in range(axes))
        times = np.linspace(0, periods * period, periods * each + 1)
        run = es.simulate(design.at(seen.point, moved), times[-1], samples=times, tol=1e-9)
        error = (run.position - run.source).values[:-1]
        means = error.reshape(periods, each, axes).mean(axis=1)
        beyond = np.linalg.norm(means, axis=1) > 0.02 * r
        found = max(found, (np.flatnonzero(beyond)[-1] + 0.5) * period)
    assert seen.charging == pytest.approx(found, abs=1.6 * period, rel=0.08)


@pytest.mark.parametrize("name", ["unstable", "spring"])
def test_it_charges_in_time_in_every_corner_of_the_load(name: str) -> None:
    """Source and force at all their ends: some of them push the same way, some do not."""
    design, wanted = designed(name), ASKED[name]
    period, axes = 2 * math.pi / design.frequency, len(design.plan.families)
    allowed = 1.5 * float(wanted.settling_time or math.inf)
    loads = {path: e for path, e in design.box.items() if path.startswith(("field.s", "vehicle.d"))}
    periods, each = math.ceil(1.5 * allowed / period), 24
    times = np.linspace(0, periods * period, periods * each + 1)
    for ends in itertools.product(*loads.values()):
        point = {path: high for path, (_, high) in design.box.items()}
        point |= dict(zip(loads, ends, strict=True))
        loop = design.loop.replace(point)
        r = reach(loop)
        run = es.simulate(design.at(point, (r,) * axes), times[-1], samples=times, tol=1e-9)
        assert run.attrs["outcome"] == "completed"
        means = (run.position - run.source).values[:-1].reshape(periods, each, axes).mean(axis=1)
        beyond = np.flatnonzero(np.linalg.norm(means, axis=1) > 0.02 * r)
        assert (beyond[-1] + 0.5) * period < allowed + period
        limit = wanted.per_axis("input_limit")[0]
        if limit is not None:
            assert max(-run.input.attrs["min"][0], run.input.attrs["max"][0]) < limit


@pytest.mark.parametrize("name", QUICK)
def test_it_arrives_from_far_away(name: str) -> None:
    design, wanted = designed(name), ASKED[name]
    rows = np.array([run.input for run in design.arrivals])
    starts = {1: 2, 2: 8}[len(design.plan.families)]
    assert len(rows) == 2 * starts * (2 if wanted.uncertain else 1)
    assert all(run.outcome == "completed" for run in design.arrivals)
    far = max(wanted.start_distance, reach(design.loop))
    assert max(run.distance for run in design.arrivals) <= far / 10
    for axis, letter in enumerate("xyz"[: rows.shape[1]]):
        assert rule(design, f"input {letter}, exact").value == rows[:, axis].max()


@pytest.mark.parametrize(("factor", "outcome"), [(-0.2, "found"), (0.0, "a mode at 0")])
def test_what_is_not_stable_is_not_confirmed(factor: float, outcome: str) -> None:
    """Climbing down, and not at all."""
    loop = designed("gain").loop
    gain = loop.controller.channels[0].gain  # pyright: ignore[reportAttributeAccessIssue]
    found = confirmed(loop.replace({"controller.channels.0.gain": factor * gain}), {}, 4.0)
    assert not found.stable
    assert outcome in found.outcome
    assert math.isinf(found.settling)
    assert math.isinf(found.charging)
    assert math.isnan(found.offset)
    if factor:
        assert found.exponent == pytest.approx(
            -factor * designed("gain").plan.shapes[0].gain, rel=0.1
        )


def test_source_and_force_push_the_same_way_in_the_runs() -> None:
    """|D(0)/N(0) x* − d|, at either end of a pole that may be stable or not."""
    wanted = required(unstable(0.0), uncertain={EPSILON: (-0.5, 0.4)}, source_distance=2, force=0.3)
    design = es.design(wanted)
    for point, _ in _far(design.plan, design.loop):
        here = exactly.plain_of(design.loop.replace(point))
        above, below = here.axes[0].vehicle
        held = below[-1] / above[-1] * here.source[0] - here.axes[0].force
        assert abs(held) == pytest.approx(abs(below[-1] / above[-1]) * 2 + 0.3)
    heavy = exactly.plain_of(designed("spring").loop)
    assert 1.0 * heavy.source[0] - heavy.axes[0].force == 4.0


def test_a_run_may_not_ask_for_more_than_the_input_has() -> None:
    design = designed("lagged")
    search = _Search(design.plan, Wish(5.0, 0.0))
    just, over = (Arrival("completed", 0.0, (u,)) for u in (59.9, 60.1))
    assert search._lost(design.plan, just, (0.2,), design.frequency) == ""
    with pytest.raises(es.Infeasible, match=r"0\.2 m away needs \|u\| = 60\.1.*limit is 60"):
        search._lost(design.plan, over, (0.2,), design.frequency)


@pytest.mark.parametrize(("distance", "lost"), [(0.019, False), (0.021, True), (math.inf, True)])
def test_a_start_must_come_to_a_tenth(distance: float, lost: bool) -> None:
    design = designed("gain")
    search = _Search(design.plan, Wish(4.0, 0.0))
    run = Arrival("completed" if math.isfinite(distance) else "escaped", distance, (1.0,))
    reason = search._lost(design.plan, run, (0.2,), design.frequency)
    assert bool(reason) is lost
    if lost:
        assert "from 0.2 m away" in reason
        assert ("0.021 m" if math.isfinite(distance) else "escaped") in reason


def test_an_arrival_is_what_simulate_shows() -> None:
    design = designed("gain")
    period = 2 * math.pi / design.frequency
    periods = math.ceil(2 * 4.0 / period)
    for found, q, sign in zip(design.arrivals, (0.5, 0.5, 2.0, 2.0), (1, -1, 1, -1), strict=True):
        times = np.linspace(0, periods * period, periods * 72 + 1)
        run = es.simulate(design.at({"field.q.0": q}, (0.5 * sign,)), times[-1], samples=times)
        assert found.input[0] == pytest.approx(np.abs(run.input.values).max(), rel=1e-6)
        mean = (run.position - run.source).values[-72:].mean()
        assert found.distance == pytest.approx(abs(mean), rel=1e-4, abs=1e-9)
