"""The real-time runner: how it ends, its watchdog, and briefly the real clock."""

from __future__ import annotations

import math
import signal
import statistics
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from hand_clock import MS, SAFE, Counter, HandClock, Plant, State, run
from loops import velocity_actuated

import extremum as es
from extremum.deploy.realtime import RealtimeFailure, RealtimeReport, run_realtime

# --- the end -----------------------------------------------------------------------------------


def test_an_event_ends_it() -> None:
    stop = threading.Event()
    plant = Plant(HandClock(), {4: stop.set})
    report = run(plant, stop=stop)
    assert (report.reason, report.steps) == ("stop", 5)
    assert plant.commands[-2:] == [(4.0, 4.0), SAFE]
    assert plant.log[-1][0] == 40 * MS, "it does not wait for the next instant"


@pytest.mark.parametrize("which", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_and_finds_its_old_handler_again(which: signal.Signals) -> None:
    before = signal.getsignal(which)
    plant = Plant(HandClock(), {4: lambda: signal.raise_signal(which)})
    report = run(plant)
    assert (report.reason, report.steps) == (which.name, 5)
    assert plant.commands[-2:] == [(4.0, 4.0), SAFE]
    assert signal.getsignal(which) == before


def test_a_second_signal_gets_out_of_a_read_that_hangs() -> None:
    def hanging() -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("not reached")

    before = signal.getsignal(signal.SIGINT)
    plant = Plant(HandClock(), {2: hanging})
    with pytest.raises(KeyboardInterrupt):
        run(plant)
    assert plant.commands == [(0.0, 0.0), (1.0, 1.0), SAFE]
    assert signal.getsignal(signal.SIGINT) == before


def test_a_signal_does_not_keep_the_safe_output_from_being_sent() -> None:
    plant = Plant(HandClock())
    attempts: list[tuple[float, ...]] = []

    def write(commands: tuple[float, ...]) -> None:
        if commands == SAFE:
            attempts.append(commands)
            if len(attempts) == 1:
                signal.raise_signal(signal.SIGINT)
                raise AssertionError("not reached")

    report = run_realtime(Counter(), plant.read, write, steps=2, clock=plant.clock)
    assert len(attempts) == 2
    assert (report.reason, report.safe_sent) == ("steps", True)


def test_signals_at_the_very_end_change_nothing() -> None:
    class Interrupting(HandClock):
        def watch(self, seconds: float, check: Callable[[], None]) -> Callable[[], None]:
            def close() -> None:
                signal.raise_signal(signal.SIGINT)
                signal.raise_signal(signal.SIGINT)

            return close

    plant = Plant(Interrupting(), {1: lambda: signal.raise_signal(signal.SIGTERM)})
    report = run(plant)
    assert (report.reason, report.safe_sent) == ("SIGTERM", True)
    assert plant.commands[-1] == SAFE


def test_beside_the_main_thread_it_runs_without_signals() -> None:
    plant = Plant(HandClock())
    reports: list[RealtimeReport] = []
    thread = threading.Thread(target=lambda: reports.append(run(plant, steps=3)))
    thread.start()
    thread.join()
    assert [report.reason for report in reports] == ["steps"]


def test_an_error_of_write_ends_it_after_the_safe_output() -> None:
    plant = Plant(HandClock())
    written: list[tuple[float, ...]] = []

    def write(commands: tuple[float, ...]) -> None:
        if commands[0] == 2.0:
            raise OSError("bus")
        written.append(commands)

    with pytest.raises(RealtimeFailure, match=r"write, which raised OSError: bus") as caught:
        run_realtime(Counter(), plant.read, write, clock=plant.clock)
    assert written == [(0.0, 0.0), (1.0, 1.0), SAFE]
    assert caught.value.report.safe_sent
    assert caught.value.report.steps == 3


def test_a_safe_output_that_fails_is_tried_again_and_reported() -> None:
    plant = Plant(HandClock())
    attempts = []

    def write(commands: tuple[float, ...]) -> None:
        if commands == SAFE:
            attempts.append(commands)
            raise OSError("bus")

    with pytest.raises(RealtimeFailure, match="writing the safe output raised OSError") as caught:
        run_realtime(Counter(), plant.read, write, steps=2, clock=plant.clock)
    assert len(attempts) == 3
    assert not caught.value.report.safe_sent
    assert "COULD NOT BE SENT" in str(caught.value)


def test_an_error_of_the_controller_is_raised_as_it_is_after_the_safe_output() -> None:
    class Broken(Counter):
        def step(self, state: State, sample: float) -> tuple[tuple[float, ...], State]:
            if state.instant == 2:
                raise ZeroDivisionError("a bug")
            return super().step(state, sample)

    plant = Plant(HandClock())
    with pytest.raises(ZeroDivisionError):
        run(plant, Broken())
    assert plant.commands == [(0.0, 0.0), (1.0, 1.0), SAFE]
    assert not plant.clock.watchers, "the watchdog has been dismissed"

    def write(commands: tuple[float, ...]) -> None:
        if commands == SAFE:
            raise OSError("bus")

    with pytest.raises(ZeroDivisionError) as caught:
        run_realtime(Broken(), Plant(HandClock()).read, write, clock=HandClock())
    assert caught.value.__notes__ == ["The safe output could not be sent."]


# --- the watchdog ------------------------------------------------------------------------------


def test_the_watchdog_sends_the_safe_output_while_read_hangs() -> None:
    clock = HandClock()
    plant = Plant(clock, {3: lambda: clock.advance(2000 * MS)})
    with pytest.raises(RealtimeFailure, match=r"watchdog: read took longer than 400 ms") as caught:
        run(plant, timeout=0.4)
    sent = [at for at, commands in plant.log if commands == SAFE]
    assert len(sent) == 2, "once by the watchdog, once at the end"
    assert 430 * MS < sent[0] <= 540 * MS, "between the timeout and a quarter more"
    assert sent[1] == 2030 * MS
    assert plant.commands[-3:] == [(2.0, 2.0), SAFE, SAFE], "what came of the hung read is not sent"
    assert (caught.value.report.steps, caught.value.report.safe_sent) == (3, True)
    assert not clock.watchers


def test_the_watchdog_sends_the_safe_output_while_write_hangs() -> None:
    clock = HandClock()
    plant = Plant(clock)

    def write(commands: tuple[float, ...]) -> None:
        if commands == (2.0, 2.0):
            clock.advance(3000 * MS)
        plant.write(commands)

    with pytest.raises(RealtimeFailure, match=r"watchdog: write took longer than 500 ms"):
        run_realtime(Counter(), plant.read, write, clock=clock)
    assert plant.commands[-3:] == [SAFE, (2.0, 2.0), SAFE], "the late command is taken back"


def test_a_watchdog_whose_write_fails_tries_again() -> None:
    clock = HandClock()
    plant = Plant(clock, {3: lambda: clock.advance(2000 * MS)})
    attempts = []

    def write(commands: tuple[float, ...]) -> None:
        if commands == SAFE:
            attempts.append(clock.now())
            if len(attempts) < 3:
                raise OSError("busy")
        plant.write(commands)

    with pytest.raises(RealtimeFailure, match="watchdog"):
        run_realtime(Counter(), plant.read, write, timeout=0.4, clock=clock)
    assert np.diff(attempts[:3]).tolist() == [100 * MS, 100 * MS]
    assert len(attempts) == 4


def test_the_watchdog_does_not_mind_long_sleeps_nor_overruns() -> None:
    controller = Counter()
    controller.dt = 3.0
    clock = HandClock()
    plant = Plant(clock, {2: lambda: clock.advance(7000 * MS)})
    assert run(plant, controller, steps=5).overruns == 1, "ten periods by default"
    plant = Plant(clock, {2: lambda: clock.advance(40_000 * MS)})
    with pytest.raises(RealtimeFailure, match="longer than 30 s"):
        run(plant, controller, steps=5)
    assert run(Plant(clock), controller, steps=5, timeout=0.5).reason == "steps"
    plant = Plant(clock, {2: lambda: clock.advance(40_000 * MS)})
    assert run(plant, controller, steps=5, timeout=math.inf).skipped == 12


# --- the real clock ----------------------------------------------------------------------------


def test_on_the_real_clock_the_steps_come_at_their_instants() -> None:
    controller = Counter()
    controller.dt = 0.002
    times: list[float] = []
    begin = time.perf_counter()
    report = run_realtime(
        controller, lambda: 1.0, lambda _: times.append(time.perf_counter()), duration=0.5
    )
    assert report.steps + report.skipped == 250
    assert 0.5 <= report.elapsed <= time.perf_counter() - begin
    if report.skipped == 0:
        late = [at - times[0] - 0.002 * k for k, at in enumerate(times[:-1])]
        assert abs(statistics.median(late)) < 0.01
    assert 0 < report.late.mean <= report.late.largest
    assert 0 < report.work.mean <= report.work.largest


def test_on_the_real_clock_another_thread_sends_the_safe_output_while_read_hangs() -> None:
    let_go = threading.Event()
    written: list[tuple[tuple[float, ...], str]] = []
    reads = iter(range(100))

    def read() -> float:
        if next(reads) == 5:
            assert let_go.wait(30), "nobody sent the safe output"
        return 1.0

    def write(commands: tuple[float, ...]) -> None:
        written.append((commands, threading.current_thread().name))
        if commands == SAFE:
            let_go.set()

    with pytest.raises(RealtimeFailure, match="watchdog: read took longer than 50 ms"):
        run_realtime(Counter(), read, write, timeout=0.05)
    assert written[-2:] == [(SAFE, "extremum watchdog"), (SAFE, threading.current_thread().name)]


def test_on_the_real_clock_a_thread_ends_it() -> None:
    controller = Counter()
    controller.dt = 1.0
    stop = threading.Event()
    threading.Timer(0.05, stop.set).start()
    begin = time.perf_counter()
    report = run_realtime(controller, lambda: 1.0, lambda _: None, stop=stop)
    assert report.reason == "stop"
    assert time.perf_counter() - begin < 1.0, "within a slice of sleep, not a period"


def test_a_discrete_controller_is_made_before_the_first_instant() -> None:
    """That takes some 20 ms."""
    loop = velocity_actuated(**{"controller.frequency": 29.0})
    controller = es.discretize(loop.controller, 0.001, vehicle=loop.vehicle)
    made: list[bool] = []
    written: list[tuple[float, ...]] = []

    def read() -> float:
        made.append({"init", "step"} <= vars(controller).keys())
        return 1.0

    run_realtime(controller, read, written.append, steps=5)
    assert all(made)
    assert written[0] == pytest.approx((0.08 * 29, 0.0))
    assert written[-1] == controller.safe == (0.0, 0.0)
