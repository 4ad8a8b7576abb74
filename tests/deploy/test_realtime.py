"""The real-time runner on a clock that tests turn by hand: instants, samples, the report."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest
from hand_clock import MS, SAFE, Counter, HandClock, Plant, State, raising, run

import extremum as es
from extremum import InvalidDescription
from extremum.deploy.realtime import RealtimeFailure, run_realtime
from extremum.deploy.timing import Gauge, readable

# --- instants ----------------------------------------------------------------------------------


def test_every_instant_has_its_step_and_the_safe_output_comes_last() -> None:
    plant = Plant(HandClock())
    report = run(plant, duration=0.1)
    assert [at for at, _ in plant.log] == [k * 10 * MS for k in range(11)]
    assert plant.commands == [(float(k), float(k)) for k in range(10)] + [SAFE]
    assert (report.reason, report.steps, report.overruns, report.skipped) == ("duration", 10, 0, 0)
    assert report.elapsed == pytest.approx(0.1, abs=1e-9)
    assert report.safe_sent
    assert report.state == State(10, 9.0)


def test_an_end_after_steps_holds_the_last_command_for_its_period() -> None:
    plant = Plant(HandClock())
    report = run(plant, steps=3)
    assert report.reason == "steps"
    assert plant.log[-1] == (30 * MS, SAFE)
    assert report.steps == 3


def test_instants_do_not_drift_when_every_sleep_is_too_long() -> None:
    """Deadlines are absolute: with sleeps 0.3 ms too long step 1000 is as late as step 1."""
    plant = Plant(HandClock(overshoot=300_000))
    report = run(plant, steps=1000)
    assert plant.log[999][0] == 999 * 10 * MS + 300_000
    assert report.late.largest == pytest.approx(0.3e-3)
    assert report.skipped == report.overruns == 0


def test_instants_do_not_drift_if_dt_is_no_whole_number_of_nanoseconds() -> None:
    controller = Counter()
    controller.dt = 1 / 3000
    plant = Plant(HandClock())
    run(plant, controller, steps=3001)
    assert plant.log[3000][0] == 1_000_000_000


def test_a_period_longer_than_a_slice_of_sleep() -> None:
    controller = Counter()
    controller.dt = 0.33
    plant = Plant(HandClock())
    run(plant, controller, steps=3)
    assert [at for at, _ in plant.log] == [0, 330 * MS, 660 * MS, 990 * MS]


# --- overruns ----------------------------------------------------------------------------------


def test_a_step_that_overruns_a_little_delays_the_next_one_only() -> None:
    clock = HandClock()
    plant = Plant(clock, {2: lambda: clock.advance(14 * MS)})
    report = run(plant, steps=5)
    assert [at // MS for at, _ in plant.log] == [0, 10, 34, 34, 40, 50]
    assert [first for first, _ in plant.commands[:-1]] == [0, 1, 2, 3, 4]
    assert (report.overruns, report.skipped) == (1, 0)
    assert report.late.largest == pytest.approx(4e-3)
    assert report.work.largest == pytest.approx(14e-3)


def test_instants_that_have_passed_are_skipped_so_that_the_phase_is_that_of_real_time() -> None:
    clock = HandClock()
    plant = Plant(clock, {2: lambda: clock.advance(57 * MS)})
    report = run(plant, duration=0.12)
    assert [at // MS for at, _ in plant.log] == [0, 10, 77, 77, 80, 90, 100, 110, 120]
    instants = [first for first, _ in plant.commands[:-1]]
    assert instants == [0, 1, 2, 7, 8, 9, 10, 11], "the number of the instant is its time / dt"
    assert (report.steps, report.overruns, report.skipped) == (8, 1, 4)


def test_an_operating_system_that_does_not_wake_us_costs_instants_too() -> None:
    plant = Plant(HandClock(overshoot=25 * MS))
    report = run(plant, duration=0.2)
    instants = [first for first, _ in plant.commands[:-1]]
    times = [at / (10 * MS) for at, _ in plant.log[:-1]]
    assert all(0 <= at - instant < 1 for at, instant in zip(times, instants, strict=True))
    assert report.steps + report.skipped == 20
    assert report.overruns == 0


def test_instants_that_pass_at_the_end_are_counted_no_further_than_the_end() -> None:
    clock = HandClock()
    plant = Plant(clock, {5: lambda: clock.advance(400 * MS)})
    report = run(plant, duration=0.1)
    assert (report.steps, report.skipped) == (6, 4)
    assert plant.log[-1] == (450 * MS, SAFE)


# --- samples -----------------------------------------------------------------------------------


def test_missing_samples_reach_the_controller_as_nan() -> None:
    plant = Plant(HandClock())
    answers = iter([0.0, math.nan, None, math.inf, np.float64(2.5), 7])
    plant.read = lambda: next(answers)  # pyright: ignore[reportAttributeAccessIssue]
    plant.began = plant.clock.now()
    report = run(plant, steps=6)
    got = [second for _, second in plant.commands[:-1]]
    np.testing.assert_array_equal(got, [0.0, math.nan, math.nan, math.inf, 2.5, 7.0])
    assert (report.missing, report.read_errors, report.reason) == (3, 0, "steps")


def test_errors_of_read_are_missing_samples_until_there_are_too_many_in_a_row() -> None:
    failing = raising(OSError("no answer"))
    plant = Plant(HandClock(), dict.fromkeys((0, 1, 2, 4, 5, 6, 7, 8), failing))
    with pytest.raises(RealtimeFailure, match="read, which raised 4 times in a row") as caught:
        run(plant, read_errors=3)
    report = caught.value.report
    assert isinstance(caught.value.__cause__, OSError)
    assert (report.steps, report.missing, report.read_errors) == (7, 7, 7)
    assert plant.commands[3] == (3.0, 3.0)
    assert plant.commands[-1] == SAFE
    assert len(plant.commands) == 8, "the fourth error in a row ends it before anything is written"


def test_read_may_be_forbidden_to_raise() -> None:
    plant = Plant(HandClock(), {2: raising(TimeoutError("serial"))})
    with pytest.raises(RealtimeFailure, match="TimeoutError: serial"):
        run(plant, read_errors=0)
    assert [c[0] for c in plant.commands] == [0.0, 1.0, 0.0]


def test_what_is_no_number_counts_as_an_error_of_read() -> None:
    plant = Plant(HandClock(), {1: lambda: "3,4"})
    report = run(plant, steps=3)
    assert (report.missing, report.read_errors) == (1, 1)


# --- what is reported --------------------------------------------------------------------------


def test_the_spread_of_times_is_that_of_numpy_within_a_bin() -> None:
    times = np.random.default_rng(1).lognormal(np.log(80e3), 0.8, 20_000).astype(int)
    gauge = Gauge()
    for one in times:
        gauge.add(int(one))
    spread = gauge.spread()
    assert spread.mean == pytest.approx(times.mean() * 1e-9, rel=1e-12)
    assert spread.std == pytest.approx(times.std() * 1e-9, rel=1e-12)
    assert spread.largest == times.max() * 1e-9
    exact = np.quantile(times, 0.99, method="inverted_cdf") * 1e-9
    assert exact <= spread.percentile_99 <= exact * 10**0.02


def test_the_spread_of_equal_times_is_a_point() -> None:
    gauge = Gauge()
    for _ in range(1000):
        gauge.add(300_000)
    spread = gauge.spread()
    assert (spread.mean, spread.std) == (pytest.approx(3e-4), 0.0)
    assert spread.percentile_99 == spread.largest == pytest.approx(3e-4)
    assert Gauge().spread().largest == 0.0


def test_a_report_reads_well_and_is_frozen() -> None:
    clock = HandClock(overshoot=70_000)
    plant = Plant(clock, {2: lambda: clock.advance(57 * MS), 4: raising(OSError("x"))})
    report = run(plant, duration=0.2)
    assert str(report).splitlines() == [
        "ended by duration after 200 ms; the safe output was sent",
        "steps, every 10 ms: 16; overruns: 1; instants skipped: 4",
        "samples missing: 1; errors of read: 1",
        f"begun late: {report.late}",
        f"work of a step: {report.work}",
    ]
    assert str(report.work) == "mean 3.56 ms, std 13.8 ms, 99 % 57 ms, largest 57 ms"
    with pytest.raises(AttributeError):
        report.steps = 3  # pyright: ignore[reportAttributeAccessIssue]
    assert pickle.loads(pickle.dumps(report)) == report
    assert pickle.loads(pickle.dumps(RealtimeFailure(report))).report == report


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 µs"),
        (6.15e-5, "61.5 µs"),
        (2e-3, "2 ms"),
        (0.75, "750 ms"),
        (86400.0, "8.64e+04 s"),
    ],
)
def test_times_are_readable(seconds: float, text: str) -> None:
    assert readable(seconds) == text


# --- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dt": 0.02}, r"dt = 0\.02: differs from the controller's, 0\.01 s"),
        ({"dt": "fast"}, "dt = 'fast': "),
        ({"duration": 0.0}, "duration = 0.0: must be a finite number greater than 0"),
        ({"steps": 0}, "steps = 0: must be an integer, at least 1"),
        ({"steps": 2.5}, "steps = 2.5: must be an integer"),
        ({"timeout": -1}, "timeout = -1: must be a finite number greater than 0"),
        ({"timeout": math.nan}, "timeout = nan: must be a finite number"),
        ({"read_errors": -1}, "read_errors = -1: must be an integer, at least 0"),
    ],
)
def test_arguments_are_checked_before_anything_moves(options: dict[str, Any], message: str) -> None:
    plant = Plant(HandClock())
    with pytest.raises(InvalidDescription, match=message):
        run(plant, **options)
    assert plant.reads == 0


def test_read_and_write_must_be_functions() -> None:
    with pytest.raises(InvalidDescription, match=r"read = 3\.0: must be a function"):
        run_realtime(Counter(), 3.0, print, steps=1)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InvalidDescription, match="write = None: must be a function"):
        run_realtime(Counter(), lambda: 1.0, None, steps=1)  # pyright: ignore[reportArgumentType]


def test_a_controller_that_is_not_sampled_is_refused() -> None:
    with pytest.raises(InvalidDescription, match="must be a DiscreteController; make one with"):
        run(Plant(HandClock()), controller=es.Dither(0.1), steps=1)


def test_a_dt_that_is_the_controllers_but_for_rounding_is_accepted() -> None:
    assert run(Plant(HandClock()), dt=0.1 * 0.1, steps=1).steps == 1
