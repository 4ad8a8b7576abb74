"""The CPU ensemble engine: what it watches of a run, and how runs end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from loops import velocity_actuated
from questions import asked, closer, errors, reference, same, starts, watching
from scipy.integrate import simpson
from systems import system

import extremum as es
from extremum.engines import simd
from extremum.engines.lanes import choosing
from extremum.engines.lanes.asked import OUTCOMES, Asked
from extremum.engines.lanes.schemes import RK4
from extremum.engines.simd import running
from extremum.loop import varied

# --- what is watched ---------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [None, RK4], ids=["Taylor", "RK4"])
def test_what_is_watched_against_quadrature(scheme: Any) -> None:
    loop, count, t_end = velocity_actuated(), 12, 2.0
    made, *_ = varied(loop, list(closer(1)))
    texts = {
        "mean": ("J", "x*cos(7*t)"),
        "last_mean": ("x", "y", "t"),
        "maxima": ("v_x", "x", "-J", "-2 - x**2"),
        "beyond": ("(x + 1)**2 + (y + 1)**2 - 0.5", "-1 - x**2", "1 + x**2"),
    }
    window = np.linspace(0.1, 2.5, count)
    question = asked(
        loop, closer(count), t_end, watch=watching(made, **texts), window=window, tol=1e-8
    )
    ended = simd.integrate(question, scheme=scheme)
    times = np.linspace(0, t_end, 20001)
    watch = question.watch
    function = made.function(
        [*watch.mean, *watch.last_mean, *watch.maxima, *watch.beyond], vector=True
    )
    for i in range(count):
        run = reference(question, i, times)
        values = question.values.copy()
        values[list(question.swept)] = question.columns[:, i]
        curves = [np.broadcast_to(c, times.shape) for c in function(times, run.states.T, values)]
        mean = [simpson(c, x=times) / t_end for c in curves[:2]]
        assert ended.mean[:, i] == pytest.approx(mean, abs=1e-7)
        length = min(window[i], t_end)
        inside = np.linspace(t_end - length, t_end, 4001)
        last = [simpson(np.interp(inside, times, c), x=inside) / length for c in curves[2:5]]
        assert ended.last_mean[:, i] == pytest.approx(last, abs=2e-6)
        for found, curve in zip(ended.maxima[:, i], curves[5:9], strict=True):
            assert found == pytest.approx(curve.max(), abs=1e-4 * np.ptp(curve))
        beyond, never, always = ended.beyond[:, i]
        exact = times[np.flatnonzero(curves[9] > 0)[-1]] if (curves[9] > 0).any() else 0.0
        assert beyond == pytest.approx(exact, abs=2e-3)
        assert (never, always) == (0, pytest.approx(t_end, abs=1e-3))


def test_the_mean_of_a_loop_that_escapes_is_over_its_life() -> None:
    loop = velocity_actuated()
    gains = {"controller.channels.0.gain": [10.0, -10.0]}
    made, *_ = varied(loop, list(gains))
    watch = watching(made, mean=("t", "1"), last_mean=("t",), maxima=("t",))
    question = asked(loop, gains, 2.0, watch=watch, window=np.array([0.5, 0.5]))
    ended = simd.integrate(question)
    assert ended.outcome.tolist() == [0, 1]
    assert ended.mean[0] == pytest.approx(ended.end_time / 2, rel=1e-6)
    assert ended.mean[1] == pytest.approx(1, rel=1e-9)
    assert ended.maxima[0] == pytest.approx(ended.end_time, rel=1e-6)
    assert ended.last_mean[0, 0] == pytest.approx(1.75)
    assert np.isnan(ended.last_mean[0, 1])


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_samples_are_the_states_at_their_times(dtype: str) -> None:
    over = starts(20)
    question = asked(velocity_actuated(), over, 1.5, samples=7, dtype=dtype, tol=1e-5)
    ended = simd.integrate(question)
    times = np.linspace(0, 1.5, 7)
    assert ended.samples.shape == (7, 3, 20)
    limit = 5e-5 if dtype == "float64" else 5e-4
    for i in range(20):
        run = reference(question, i, times)
        known = len(run.states)
        assert np.isnan(ended.samples[known:, :, i]).all()
        found = ended.samples[:known, :, i]
        if run.outcome == "completed":
            assert np.abs((found - run.states) / (1 + np.abs(run.states))).max() < limit
    done = ended.outcome == 0
    assert 0 < done.sum() < 20
    assert np.array_equal(ended.samples[-1][:, done], ended.states[:, done])
    plain = simd.integrate(replace(question, samples=0))
    assert plain.samples.shape[0] == 0
    assert np.array_equal(plain.outcome, ended.outcome)


def test_progress_rises_to_1(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "PIECE", 128)
    seen: list[float] = []
    simd.integrate(asked(velocity_actuated(), closer(600), 0.2), threads=2, progress=seen.append)
    assert seen == sorted(seen)
    assert len(seen) >= 4
    assert seen[-1] == 1


# --- ends --------------------------------------------------------------------------------------


def test_a_dead_loop_stays_as_it_was() -> None:
    """However long the others run on."""
    loop, over = velocity_actuated(), starts(100)
    made, *_ = varied(loop, list(over))
    watch = watching(made, mean=("x",), maxima=("x", "y"), beyond=("t - 0.01",))
    short = simd.integrate(asked(loop, over, 2.0, watch=watch))
    long = simd.integrate(asked(loop, over, 20.0, watch=watch))
    dead = short.outcome == 1
    assert 5 < dead.sum() < 95
    same(short, long, dead, dead)
    assert np.isfinite(short.states).all()
    assert (short.end_time[dead] < 2).all()
    assert not np.array_equal(short.states[:, ~dead], long.states[:, ~dead])


def test_escape_times_against_the_taylor_engine() -> None:
    question = asked(velocity_actuated(), starts(60), 2.0, tol=1e-12)
    ended = simd.integrate(question)
    assert 5 < (ended.outcome == 1).sum() < 55
    for i in range(60):
        run = reference(question, i)
        assert (run.outcome == "escaped") == (ended.outcome[i] == 1)
        assert ended.end_time[i] == pytest.approx(run.end_time, abs=3e-8)


def test_a_field_that_ends_is_left_where_it_ends() -> None:
    field = es.Expression("-sqrt(a + x) - y**2", parameters={"a": 0.5})
    loop = velocity_actuated(field=field, start=(0.3, 0.2))
    question = asked(loop, {"field.parameters.a": [0.2, 9.0]}, 3.0)
    edge = reference(question, 0)
    assert edge.outcome == "left the data"
    for tol, limit in ((1e-6, 1e-4), (1e-10, 3e-7)):
        ended = simd.integrate(replace(question, tol=tol))
        assert ended.outcome.tolist() == [2, 0]
        assert ended.end_time[0] == pytest.approx(edge.end_time, abs=limit)
        assert ended.states[0, 0] == pytest.approx(-0.2, abs=limit)


def test_a_pole_at_the_edge_of_a_field_is_an_escape() -> None:
    """The loop climbs into it, ever faster; a field that ends gently is left."""
    for formula, outcome in (("(a + x)**(-3/2)", "escaped"), ("log(a + x)/9", "left the data")):
        field = es.Expression(f"{formula} - y**2", parameters={"a": 0.5})
        sign = 1 if outcome == "escaped" else -1
        loop = velocity_actuated(field=field, start=(0.3, 0.2))
        question = asked(loop, {"controller.channels.0.gain": [sign * 20.0]}, 30.0)
        run, ended = reference(question, 0), simd.integrate(question)
        assert run.outcome == OUTCOMES[ended.outcome[0]] == outcome
        assert ended.end_time[0] == pytest.approx(run.end_time, abs=1e-5)


def test_starts_that_are_no_numbers() -> None:
    over = {"start.0": [1.0, np.nan, np.inf, -np.inf, 1e200], "start.1": [1.0] * 5}
    for dtype in ("float64", "float32"):
        loop = velocity_actuated()
        ended = simd.integrate(asked(loop, over, 0.5, dtype=dtype, tol=1e-4))
        assert ended.outcome[0] == 0
        assert (ended.outcome[1:] > 0).all()
        assert (ended.end_time[1:] == 0).all()
        assert (ended.steps[1:] == 0).all()


@pytest.mark.parametrize("t_end", [1e-300, 1e-12, 1e-6])
def test_a_run_that_is_over_at_once(t_end: float) -> None:
    question = asked(velocity_actuated(), closer(5), t_end, samples=3)
    ended = simd.integrate(question)
    assert (ended.outcome == 0).all()
    assert (ended.steps == 2).all()  # a step for each segment between samples
    assert (ended.end_time == t_end).all()
    assert errors(question, ended).max() < 1e-14


def test_the_phase_after_a_million_radians() -> None:
    """ẋ = a (sin ωt − x) settles on a/(a² + ω²) (a sin ωt − ω cos ωt)."""
    a, frequency, t_end = 300.0, 1000.0, 1e3
    made = system("a*(sin(w*t) - x)", carriers="w")
    question = Asked(made, np.array([a, 0, frequency]), (0,), np.array([[a]]), t_end, tol=1e-12)
    found = simd.integrate(question).states[0, 0]
    with mpmath.workdps(30):
        angle = mpmath.mpf(frequency) * t_end
        wave = a * mpmath.sin(angle) - frequency * mpmath.cos(angle)
        exact = float(a / (a**2 + frequency**2) * wave)
    assert found == pytest.approx(exact, abs=1e-9)


def test_rk4_takes_a_whole_number_of_steps() -> None:
    """Rounding of t_end/H neither adds a step nor swallows one."""
    loop, rng = velocity_actuated(), np.random.default_rng(8)
    over = {"controller.frequency": rng.uniform(20, 40, 64)}
    for t_end in rng.uniform(0.01, 0.3, 40):
        question = asked(loop, over, float(t_end), tol=1e-3, samples=int(rng.integers(0, 5)) + 2)
        steps = question.t_end / choosing.lengths(question)
        assert np.array_equal(simd.integrate(question, scheme=RK4).steps, np.rint(steps))


def test_a_run_of_hours() -> None:
    """48,000 periods: the dither's phase is kept to the end, in float32 too."""
    for dtype, tol, limit in (("float64", 1e-6, 1e-6), ("float32", 1e-4, 1e-4)):
        question = asked(velocity_actuated(), closer(2), 1e4, dtype=dtype, tol=tol)
        ended = simd.integrate(question)
        assert (ended.steps > 1e5).all()
        assert errors(question, ended).max() < limit
