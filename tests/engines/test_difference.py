"""Difference equations on the ensemble engine, against the same equations written as a loop."""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
import sympy
from questions import same
from recursions import (
    PARAMETERS,
    J,
    a,
    asked,
    b,
    dt,
    noisily,
    noisy,
    sampled,
    seed,
    w,
    x,
    y,
    z,
)
from sympy import Integer, cos, sin

import extremum as es
from extremum.engines import cuda, simd
from extremum.engines.lanes import choosing, random
from extremum.engines.lanes.difference import Difference, check_steps
from extremum.engines.lanes.watch import Watch
from extremum.engines.simd import running
from extremum.logic import normal, positive
from extremum.symbols import t
from extremum.system import Oracle, Table

# --- states -----------------------------------------------------------------------------------


def test_a_noisy_loop_against_its_equations_written_as_a_loop() -> None:
    lanes = {seed: np.array([0.0, 1, 2, 2, 9e15]), w: np.array([7.0, 7, 9, 11, 13]), a: 0.4}
    ended = simd.integrate(asked(noisy(), 300, lanes, samples=31))
    assert ended.scheme == "difference equations"
    assert (ended.outcome == 0).all()
    assert (ended.steps == 300).all()
    for i in range(5):
        lane = {p: float(np.broadcast_to(n, 5)[i]) for p, n in lanes.items()}
        states, _ = noisily(300, lane)
        assert ended.states[:, i] == pytest.approx(states[-1], abs=1e-12)
        assert ended.samples[:, :, i] == pytest.approx(states[::10], abs=1e-12)
    assert len(np.unique(ended.states[0])) == 5


def test_a_quadratic_map_against_its_closed_form() -> None:
    """x(k+1) = 2 x (1 − x): 1 − 2x is squared by every step."""
    begun = np.linspace(0.001, 0.999, 40)
    ended = simd.integrate(asked(sampled({x: 2 * x * (1 - x)}, {x: b}), 9, {b: begun}))
    assert ended.states[0] == pytest.approx((1 - (1 - 2 * begun) ** 2.0**9) / 2, abs=1e-13)


def test_a_rotation_against_its_closed_form_after_a_million_steps() -> None:
    turn = {x: x * cos(a) - y * sin(a), y: x * sin(a) + y * cos(a)}
    angles = np.linspace(0.01, 3, 10)
    ended = simd.integrate(asked(sampled(turn, {x: 1, y: 0}), 1_000_000, {a: angles}))
    exact = np.array([[math.cos(1e6 * angle), math.sin(1e6 * angle)] for angle in angles]).T
    assert ended.states == pytest.approx(exact, abs=2e-9)  # 1e6 roundings of angle and of size


def test_the_start_may_be_random_too() -> None:
    made = sampled({x: x}, {x: a + J}, (J, normal(seed, Integer(0))))
    seeds = np.arange(5.0)
    ended = simd.integrate(asked(made, 3, {seed: seeds}))
    assert ended.states[0] == pytest.approx(0.5 + random.normal(seeds, 0, 0), rel=1e-15)


# --- time -------------------------------------------------------------------------------------


def test_every_duration_takes_its_whole_number_of_steps() -> None:
    """However t_end/dt is rounded, and between samples too."""
    rng, counted = np.random.default_rng(5), sampled({x: x + 1, y: t}, {x: 0, y: 0})
    for _ in range(60):
        lengths = np.round(rng.uniform(1e-4, 0.3), 4) / rng.choice([1, 3, 7, 10], 24)
        for length in np.unique(lengths):
            parts, per = int(rng.integers(1, 6)), int(rng.integers(1, 400))
            steps = parts * per
            for t_end in (
                steps * length,
                math.nextafter(steps * length, 0),
                float(f"{steps * length:.11g}"),
            ):
                question = asked(counted, 0, {dt: np.array([length])}, t_end=t_end)
                ended = simd.integrate(replace(question, samples=parts + 1))
                assert ended.steps[0] == ended.states[0, 0] == steps
                assert np.array_equal(ended.samples[:, 0, 0], np.arange(parts + 1) * per)
                assert ended.states[1, 0] == (steps - 1) * length
                assert ended.end_time[0] == t_end


def test_lanes_with_sampling_times_of_their_own() -> None:
    lengths = np.tile([0.1, 0.05, 0.02, 0.001], 20)
    question = asked(sampled({x: x * (1 - dt)}, {x: 1}), 0, {dt: lengths}, t_end=2.0)
    ended = simd.integrate(question)
    assert choosing.paces(question) == pytest.approx(ended.steps / 2)
    assert np.array_equal(ended.steps, np.rint(2 / lengths))
    assert ended.states[0] == pytest.approx((1 - lengths) ** (2 / lengths), rel=1e-12)


def test_neither_count_nor_phase_drifts_in_ten_million_steps() -> None:
    made = sampled({x: x + 1, y: sin(w * t + b), z: t}, {x: 0, y: 0, z: 0}, carriers=(w,))
    count = 10_000_000
    ended = simd.integrate(asked(made, 0, {w: np.array([30.0])}, t_end=count * 1e-2))
    assert ended.states[0, 0] == count
    assert ended.states[2, 0] == (count - 1) * 1e-2
    with mpmath.workdps(40):
        exact = mpmath.sin(30 * mpmath.mpf(0.01) * (count - 1) + 0.25)
    assert ended.states[1, 0] == pytest.approx(float(exact), abs=2e-9)


@pytest.mark.parametrize("t_end", [0.0124, 2.005, 3.000011e-2, 1e-9])
def test_a_duration_that_is_no_whole_number_of_steps_is_refused(t_end: float) -> None:
    question = asked(noisy(), 0, {seed: np.arange(3.0)}, t_end=t_end)
    with pytest.raises(es.InvalidDescription, match=r"is .* sampling times of 0\.01 s") as e:
        simd.integrate(question)
    fix = float(str(e.value).split("such as ")[1].split(" s")[0])
    simd.integrate(replace(question, t_end=fix))


def test_the_rounding_of_a_long_duration_is_no_fraction_of_a_step() -> None:
    for length in (1e-3, 0.7e-3, 1 / 3):
        for count in (10**6, 10**9, 123_456_789_012):
            check_steps(count * length, length, 0)
            with pytest.raises(es.InvalidDescription, match="must be a whole number"):
                check_steps((count + 1e-3) * length, length, 0)


def test_samples_between_steps_are_refused() -> None:
    question = asked(noisy(), 12, {seed: np.arange(3.0)}, samples=6)
    with pytest.raises(es.InvalidDescription, match="divides 12 sampling times") as e:
        simd.integrate(question)
    assert "such as 5" in str(e.value)
    simd.integrate(replace(question, samples=5))


# --- what is watched --------------------------------------------------------------------------


def test_what_is_watched_against_the_samples() -> None:
    made, steps = noisy(), 400
    watch = Watch(
        mean=(J, x * cos(w * t)),
        last_mean=(J, t),
        maxima=(J, -J, x, z, sin(w * t)),
        beyond=(x - 0.2, Integer(1) + x**2, -1 - x**2, J - 0.2),
    )
    window = np.array([0.5, 0.987, 99.0])
    lanes = {seed: np.array([3.0, 4, 5]), w: np.array([7.0, 9, 3])}
    ended = simd.integrate(asked(made, steps, lanes, watch=watch, window=window))
    for i in range(3):
        frequency = lanes[w][i]
        states, level = noisily(steps, {seed: lanes[seed][i], w: frequency})
        k = np.arange(steps + 1)
        times, place = k * 0.01, states[:, 0]
        wave = place * np.cos(frequency * times)
        assert ended.mean[:, i] == pytest.approx([level[:-1].mean(), wave[:-1].mean()], abs=1e-12)
        begin = steps - min(window[i] / 0.01, steps)
        weight = np.clip(k[:-1] + 1 - begin, 0, 1)  # a sample stands for the step after it
        last = [(weight * row[:-1]).sum() / weight.sum() for row in (level, times)]
        assert ended.last_mean[:, i] == pytest.approx(last, abs=1e-11)
        rows = (level, -level, place, states[:, 2], np.sin(frequency * times))
        assert ended.maxima[:, i] == pytest.approx([row.max() for row in rows], abs=1e-12)
        seen = [times[found[-1]] if len(found := np.flatnonzero(row > 0)) else 0.0
                for row in (place - 0.2, 1 + k, -1 - k, level - 0.2)]  # fmt: skip
        assert ended.beyond[:, i] == pytest.approx(seen, abs=1e-12)
        assert seen[1:3] == [times[-1], 0]
        assert 0 < seen[3] < times[-1]


def test_the_value_at_the_end_counts_for_maxima_not_for_means() -> None:
    made = sampled({x: x + 1}, {x: 0})
    watch = Watch(
        mean=(x,), last_mean=(x,), maxima=(x, normal(seed, Integer(0))), beyond=(x - 9.5,)
    )
    seeds = np.arange(50.0)
    question = asked(made, 10, {seed: seeds}, watch=watch, window=np.full(50, 0.03))
    ended = simd.integrate(question)
    assert ended.mean[0] == pytest.approx(4.5)
    assert ended.last_mean[0] == pytest.approx(8)
    assert (ended.maxima[0] == 10).all()
    drawn = random.normal(seeds[:, None], np.arange(11), 0)
    assert ended.maxima[1] == pytest.approx(drawn.max(axis=1), rel=1e-14)
    assert (drawn.argmax(axis=1) == 10).any()
    assert ended.beyond[0] == pytest.approx(0.1)


# --- ends -------------------------------------------------------------------------------------


def test_a_lane_that_grows_without_bound_escapes() -> None:
    factors = np.array([0.5, 2.0, 10.0, -10.0])
    ended = simd.integrate(asked(sampled({x: a * x}, {x: 1}), 500, {a: factors}, samples=6))
    assert ended.outcome.tolist() == [0, 1, 1, 1]
    last = [500, 332, 99, 99]  # 2^332 < 1e100 < 2^333; 1e100 is the limit itself
    assert ended.steps.tolist() == last
    assert ended.end_time == pytest.approx(np.array(last) * 0.01)
    assert np.abs(ended.states[0, 1:]) == pytest.approx([2.0**332, 1e99, 1e99])
    assert np.isnan(ended.samples[1:, 0, 2]).all()
    assert np.isfinite(ended.samples[:4, 0, 1]).all()


def test_a_state_that_is_no_number_ends_a_lane_a_signal_does_not() -> None:
    """What a lost sample means is for the equations to say."""
    held = sampled({x: positive(J, J, x)}, {x: 3}, (J, sympy.log(a - t)))
    through = sampled({x: J}, {x: 3}, (J, sympy.log(a - t)))
    limits = np.array([1.205, 10.0])
    ended = simd.integrate(asked(held, 300, {a: limits}))
    assert ended.outcome.tolist() == [0, 0]
    assert ended.states[0] == pytest.approx([math.log(1.205 - 0.2), math.log(10 - 2.99)])
    ended = simd.integrate(asked(through, 300, {a: limits}))
    assert ended.outcome.tolist() == [1, 0]
    assert ended.steps.tolist() == [121, 300]


def test_a_lane_that_leaves_a_table_has_left_the_data() -> None:
    lines = np.linspace(-1, 1, 9)
    field = sympy.Function("field")
    made = sampled(
        {x: a * x + 0 * J},
        {x: b},
        (J, field(x)),
        oracles={
            "field": Oracle(lambda p: p, (-1.0,), (1.0,), table=Table((lines,), lines**2)),
        },
    )
    watch = Watch(mean=(J,))
    question = asked(made, 20, {a: np.array([1.1, 0.9])}, watch=watch)
    ended = simd.integrate(question)
    assert ended.outcome.tolist() == [2, 0]
    assert ended.states[0, 0] == pytest.approx(0.25 * 1.1**14)  # 0.25 · 1.1^15 > 1
    assert ended.mean[0, 1] == pytest.approx((0.25**2 * 0.9 ** (2 * np.arange(20))).mean())


# --- lanes ------------------------------------------------------------------------------------


def test_a_lane_is_the_same_wherever_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among others, in other blocks and pieces, on any number of threads."""
    rng = np.random.default_rng(2)
    lanes = {seed: rng.integers(0, 2**53, 700), w: rng.uniform(3, 30, 700)}
    watch = Watch(mean=(J,), last_mean=(x,), maxima=(J,), beyond=(J,))
    question = asked(noisy(), 60, lanes, watch=watch, window=np.full(700, 0.3), samples=4)
    whole = simd.integrate(question)
    monkeypatch.setattr(running, "PIECE", 96)
    same(whole, simd.integrate(question, threads=3))
    for chosen in (rng.permutation(700), np.arange(699, 600, -7), np.array([123])):
        some = replace(
            question, columns=question.columns[:, chosen], window=np.full(len(chosen), 0.3)
        )
        same(whole, simd.integrate(some, threads=2), chosen, slice(None))
    twice = replace(question, columns=question.columns[:, [5, 5]], window=np.full(2, 0.3))
    assert len(np.unique(simd.integrate(twice).states[0])) == 1


def test_a_lane_alone_is_the_same_with_a_table() -> None:
    """A single lane has a kernel of its own, without lanes beside it."""
    rng = np.random.default_rng(4)
    lines = (np.sort(rng.uniform(-1, 1, 9)), np.linspace(-1, 1, 7))
    table = Table(lines, rng.normal(size=(9, 7)))
    low, high = (tuple(float(line[end]) for line in lines) for end in (0, -1))
    field = sympy.Function("field")(x, y)
    made = sampled(
        {x: x * cos(a) - y * sin(a) + 1e-3 * J, y: x * sin(a) + y * cos(a)},
        {x: b, y: 0},
        (J, field + normal(seed, Integer(0))),
        oracles={"field": Oracle(lambda p, q: p, low, high, table=table)},
    )
    angles = rng.uniform(-1, 1, 40)
    question = asked(made, 30, {a: angles}, watch=Watch(mean=(J,), maxima=(J,)), samples=11)
    whole = simd.integrate(question)
    assert (whole.outcome == 0).sum() > 10
    for i in range(40):
        alone = simd.integrate(replace(question, columns=question.columns[:, [i]]))
        same(whole, alone, [i], slice(None))


@pytest.mark.parametrize(
    ("count", "threads", "width", "pieces"),
    [(10_000, 2, 32, 4), (10_000, 3, 32, 3), (1, 2, 1, 1), (100, 2, 32, 2), (0, 2, 32, 0)],
)
def test_threads_share_the_lanes_evenly(count: int, threads: int, width: int, pieces: int) -> None:
    size = running._share(count, threads, width)
    assert size % width == 0
    assert size < running.PIECE + width
    assert len(range(0, count, size)) == pieces


def test_a_seed_that_is_not_swept_gives_the_same_numbers() -> None:
    swept = simd.integrate(asked(noisy(), 50, {seed: np.full(3, 77.0), w: np.arange(5.0, 8)}))
    question = asked(noisy(), 50, {w: np.arange(5.0, 8)})
    values = question.values.copy()
    values[PARAMETERS.index(seed)] = 77
    same(swept, simd.integrate(replace(question, values=values)))


# --- what cannot be -----------------------------------------------------------------------------


def test_single_precision_is_refused() -> None:
    question = asked(noisy(), 5, {seed: np.arange(3.0)}, dtype="float32")
    with pytest.raises(es.InvalidDescription, match="must be 'float64' for a sampled loop"):
        simd.integrate(question)


def test_a_gpu_is_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="a sampled loop does not run on a GPU yet"):
        cuda.integrate(asked(noisy(), 5, {seed: np.arange(3.0)}))


def test_difference_equations_are_their_own_scheme() -> None:
    assert choosing.usual(asked(noisy(), 5, {seed: np.arange(3.0)})) == Difference()
