"""The CPU ensemble engine: its instructions, its steps, what it watches, what it keeps."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import tapes
from loops import force_actuated, velocity_actuated
from scipy.integrate import simpson
from systems import system
from test_mathematics import DTYPE, WIDE, compiled

import extremum as es
from extremum.engines import simd, taylor
from extremum.engines.lanes import choosing
from extremum.engines.lanes.asked import Asked, Ended
from extremum.engines.lanes.schemes import RK4, Taylor
from extremum.engines.lanes.tape import STEP, Tape
from extremum.engines.lanes.watch import Watch
from extremum.engines.simd import running
from extremum.engines.simd.emitter import Emitter
from extremum.engines.simd.printing import Names, printed
from extremum.loop import varied
from extremum.symbols import FUNCTIONS, parse, t

FIELDS = ("states", "outcome", "end_time", "mean", "last_mean", "maxima", "beyond", "samples")


def asked(loop: es.Loop, over: dict[str, Any], t_end: float, **options: Any) -> Asked:
    """Loops of one structure; `over` is dotted path → numbers."""
    made, values, places = varied(loop, list(over))
    return Asked(made, values, places, np.array(list(over.values()), dtype=float), t_end, **options)


def watching(made: Any, **expressions: tuple[str, ...]) -> Watch:
    """A watch of text in the system's states and signals."""
    known = {str(x): x for x in (*made.states, *(s for s, _ in made.signals), t)}
    return Watch(**{k: tuple(parse(e, known) for e in v) for k, v in expressions.items()})


def reference(question: Asked, index: int, times: np.ndarray | None = None) -> Any:
    values = question.values.copy()
    values[list(question.swept)] = question.columns[:, index]
    times = np.array([0.0, question.t_end]) if times is None else times
    return taylor.integrate(question.system, values.tolist(), times, tol=1e-15)


def errors(question: Asked, ended: Ended) -> np.ndarray:
    """Largest |x − exact|/(1 + |exact|) of every loop."""
    exact = np.array([reference(question, i).end_state for i in range(question.count)]).T
    return np.abs((ended.states - exact) / (1 + np.abs(exact))).max(axis=0)


def same(a: Ended, b: Ended, loops: Any = slice(None), into: Any = slice(None)) -> None:
    """Refuse a single different bit."""
    assert np.array_equal(a.steps[loops], b.steps[into])
    for name in FIELDS:
        x, y = getattr(a, name)[..., loops], getattr(b, name)[..., into]
        assert np.array_equal(x, y, equal_nan=True), name


def starts(count: int, seed: int = 1) -> dict[str, np.ndarray]:
    """Starts, gains and frequencies; most loops with a negative gain escape."""
    rng = np.random.default_rng(seed)
    return {
        "start.0": rng.uniform(-2, 2, count),
        "start.1": rng.uniform(-2, 2, count),
        "controller.channels.0.gain": rng.uniform(-25, 14, count),
        "controller.frequency": rng.uniform(20, 40, count),
    }


def closer(count: int, path: str = "start") -> dict[str, np.ndarray]:
    """Starts of stable loops."""
    return {
        f"{path}.0": np.linspace(-0.5, 1.5, count),
        f"{path}.1": np.linspace(1.2, -0.4, count),
    }


# --- instructions ------------------------------------------------------------------------------

OPERATIONS = (
    *("add", "subtract", "multiply", "divide", "negative", "absolute", "maximum", "minimum"),
    *("unit", "positive", "logarithm", "power of two", "pow", *FUNCTIONS),
)


def printing(tape: Tape, value: int) -> Callable[..., tuple[str, ...]]:
    """Writes one operation of a tape whose first values are its operands."""

    def body(e: Emitter, *loaded: str) -> tuple[str, ...]:
        return (printed(e, tape.operations[value], Names(tape, dict(enumerate(loaded))), {}),)

    return body


@pytest.mark.parametrize("bits", [64, 32])
@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_printed_as_what_it_does(name: str, bits: int) -> None:
    inputs = {"positive": 3, "atan2": 2, "pow": 2, "logarithm": 2}.get(name, 1)
    inputs = 2 if name in OPERATIONS[:4] or name in ("maximum", "minimum") else inputs
    rng = np.random.default_rng(3)
    arrays = [rng.uniform(-0.95, 0.95, 40).astype(DTYPE[bits]) for _ in range(inputs)]
    if name in ("log", "sqrt", "acosh", "pow", "logarithm"):
        arrays = [np.abs(a) + (1 if name == "acosh" else 0.1) for a in arrays]
    if name == "unit":
        arrays = [a * 3 for a in arrays]
    tape = Tape()
    leaves = [tape.leaf("state", i, STEP) for i in range(inputs)]
    value = tape.call(name, *leaves)
    found = compiled(printing(tape, value), inputs, Emitter(WIDE[bits], bits, contract=True))(*arrays)
    plain = tapes.function(name, math)
    wanted = np.array([plain(*map(float, row)) for row in zip(*arrays, strict=True)])
    if name == "logarithm":
        assert np.abs(found - wanted).max() < 0.09
    elif name == "power of two":
        assert np.abs(found / wanted - 1).max() < 0.065
    else:
        eps = np.finfo(DTYPE[bits]).eps
        assert np.abs(found - wanted).max() <= 4 * eps * np.abs(wanted).max()


def test_the_steps_own_logarithm_of_what_is_no_number_is_large() -> None:
    """So that the next step is short, and the loop ends there."""
    for bits in (64, 32):
        tape = Tape()
        value = tape.call("logarithm", tape.leaf("state", 0, STEP), tape.leaf("state", 1, STEP))
        f = compiled(printing(tape, value), 2, Emitter(WIDE[bits], bits))
        found = f([np.nan, np.inf, 0.0], [1.0, 2.0, 1.0])
        most = 1000 if bits == 64 else 120
        assert (found[:2] > most).all()
        assert found[2] < -most


# --- schemes -----------------------------------------------------------------------------------


def slope(question: Asked, scheme: Any, tols: tuple[float, ...]) -> float:
    """d log(error)/d log(steps)."""
    runs = [(replace(question, tol=tol), scheme) for tol in tols]
    ended = [simd.integrate(q, scheme=scheme) for q, _ in runs]
    wrong = [np.median(errors(question, e)) for e in ended]
    steps = [e.steps.mean() for e in ended]
    return float(np.polyfit(np.log(steps), np.log(wrong), 1)[0])


@pytest.mark.parametrize(
    ("scheme", "order", "tols"),
    [
        (RK4, 4, (1e-3, 1e-4, 1e-5, 1e-6)),
        (Taylor(8), 8, (1e-4, 1e-5, 1e-6, 1e-7)),
        (Taylor(12), 12, (1e-5, 1e-6, 1e-7, 1e-8)),
    ],
    ids=["RK4", "Taylor 8", "Taylor 12"],
)
def test_the_order_of_convergence(scheme: Any, order: int, tols: tuple[float, ...]) -> None:
    question = asked(velocity_actuated(), closer(24), 2.0)
    assert slope(question, scheme, tols) == pytest.approx(-order, abs=0.08 * order)


@pytest.mark.parametrize("make", [velocity_actuated, force_actuated])
def test_the_error_is_proportional_to_the_tolerance(make: Callable[[], es.Loop]) -> None:
    tols = np.logspace(-4, -11, 8)
    path = "start" if make is velocity_actuated else "start.position"
    question = asked(make(), closer(16, path), 2.0)
    found = np.array(
        [errors(question, simd.integrate(replace(question, tol=tol))).max() for tol in tols]
    )
    assert (found < tols).all()
    assert (found > tols / 1e4).all()
    assert np.polyfit(np.log(tols), np.log(found), 1)[0] == pytest.approx(1, abs=0.1)


def test_float32_comes_to_its_floor() -> None:
    question = asked(velocity_actuated(), closer(32), 2.0, dtype="float32", tol=1e-5)
    ended = simd.integrate(question)
    assert ended.states.dtype == np.float32
    assert errors(question, ended).max() < 2e-5


def test_the_scheme_fits_the_tolerance() -> None:
    question = asked(velocity_actuated(), closer(2), 0.1)
    names = [choosing.usual(replace(question, tol=tol)).name for tol in (1e-3, 1e-6, 1e-9, 1e-30)]
    orders = [int(name.removeprefix("Taylor, order ")) for name in names]
    assert orders == sorted(orders)
    assert (orders[0], orders[-1]) == (8, 20)
    assert simd.integrate(question).scheme == names[1]
    assert simd.integrate(question, scheme=RK4).scheme == "RK4"


def test_a_system_without_a_dither() -> None:
    made = system("-a*x, b*y", names="x,y")
    question = Asked(made, np.array([1.0, 2.0, 1.0]), (0,), np.array([[0.5, 1.0, 2.0]]), 1.5)
    for scheme in (None, RK4):
        ended = simd.integrate(question, scheme=scheme)
        assert ended.states[0] == pytest.approx(np.exp(-1.5 * question.columns[0]), abs=1e-6)
        assert ended.states[1] == pytest.approx(np.exp([3.0] * 3), rel=1e-6)


# --- nothing but its own column ----------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("scheme", [None, RK4], ids=["Taylor", "RK4"])
def test_a_loop_depends_on_its_own_numbers_only(
    monkeypatch: pytest.MonkeyPatch, dtype: str, scheme: Any
) -> None:
    """Whatever its neighbours, the threads, the pieces of work and how many loops there are."""
    over, count = starts(600), 600
    over["start.0"][[3, 77]] = np.nan, np.inf
    loop = velocity_actuated()
    made, *_ = varied(loop, list(over))
    watch = watching(
        made, mean=("J",), last_mean=("x*y", "x"), maxima=("v_x",), beyond=("x**2 + y**2 - 4",)
    )
    window = np.random.default_rng(5).uniform(0.05, 1.5, count)
    question = asked(
        loop, over, 1.3, watch=watch, window=window, samples=4, tol=1e-4, dtype=dtype
    )
    whole = simd.integrate(question, scheme=scheme)
    assert set(whole.outcome) == {0, 1, 2}

    def some(loops: np.ndarray) -> Asked:
        return replace(question, columns=question.columns[:, loops], window=window[loops])

    order = np.random.default_rng(6).permutation(count)
    same(whole, simd.integrate(some(order), scheme=scheme), order)
    for few in (np.array([5]), np.array([3, 5, 9]), np.arange(50, 117)):
        same(whole, simd.integrate(some(few), scheme=scheme), few)
    monkeypatch.setattr(running, "PIECE", 128)
    same(whole, simd.integrate(question, scheme=scheme, threads=2))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_the_width_of_the_vectors_changes_no_bit(
    monkeypatch: pytest.MonkeyPatch, dtype: str
) -> None:
    question = asked(force_actuated(), closer(70, "start.position"), 1.0, dtype=dtype, tol=1e-4)
    found = []
    for registers in (1, 2, 4):
        monkeypatch.setattr(running, "MOST_REGISTERS", registers)
        monkeypatch.setattr(running, "_KERNELS", running.OrderedDict())
        found.append(simd.integrate(question))
    same(found[0], found[1])
    same(found[0], found[2])


def test_any_number_of_loops_and_of_parameters() -> None:
    loop = velocity_actuated()
    question = asked(loop, closer(9), 0.5)
    nothing = simd.integrate(replace(question, columns=np.empty((2, 0))))
    assert nothing.states.shape == (3, 0)
    assert nothing.outcome.shape == nothing.steps.shape == (0,)
    made, values, _ = varied(loop, [])
    still = simd.integrate(Asked(made, values, (), np.empty((0, 3)), 0.5))
    assert (still.states == still.states[:, :1]).all()
    assert errors(Asked(made, values, (), np.empty((0, 1)), 0.5), still)[0] < 1e-6


# --- what is watched ---------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [None, RK4], ids=["Taylor", "RK4"])
def test_what_is_watched_against_quadrature(scheme: Any) -> None:
    loop, count, t_end = velocity_actuated(), 12, 2.0
    made, *_ = varied(loop, list(closer(1)))
    texts = {
        "mean": ("J", "x*cos(7*t)"),
        "last_mean": ("x", "y", "t"),
        "maxima": ("v_x", "x", "-J"),
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
        for found, curve in zip(ended.maxima[:, i], curves[5:8], strict=True):
            assert curve.max() - 0.01 * np.ptp(curve) < found < curve.max() + 1e-4
        beyond, never, always = ended.beyond[:, i]
        exact = times[np.flatnonzero(curves[8] > 0)[-1]] if (curves[8] > 0).any() else 0.0
        assert beyond == pytest.approx(exact, abs=0.02)
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


def test_a_run_of_hours() -> None:
    """48,000 periods: the dither's phase is kept to the end, in float32 too."""
    for dtype, tol, limit in (("float64", 1e-6, 1e-6), ("float32", 1e-4, 1e-4)):
        question = asked(velocity_actuated(), closer(2), 1e4, dtype=dtype, tol=tol)
        ended = simd.integrate(question)
        assert (ended.steps > 1e5).all()
        assert errors(question, ended).max() < limit


# --- compiling ---------------------------------------------------------------------------------


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is compiled, or read from disk."""
    made: list[Any] = []
    original = running.Kernel

    def counting(*arguments: Any) -> Any:
        made.append(arguments)
        return original(*arguments)

    monkeypatch.setattr(running, "Kernel", counting)
    monkeypatch.setattr(running, "_KERNELS", running.OrderedDict())
    return made


def test_a_changed_number_compiles_nothing(counted: list[Any]) -> None:
    question = asked(velocity_actuated(), closer(3), 0.2)
    simd.integrate(question)
    counted.clear()
    simd.integrate(replace(question, t_end=0.3, columns=question.columns + 1, tol=1.1e-6))
    simd.integrate(replace(question, values=question.values * 1.01, samples=5), threads=2)
    assert not counted
    changed: tuple[dict[str, Any], ...] = (
        {"dtype": "float32"},
        {"tol": 1e-9},
        {"watch": watching(question.system, mean=("J", "x"))},
        {"swept": question.swept[:1], "columns": question.columns[:1]},
    )
    for changes in changed:
        counted.clear()
        simd.integrate(replace(question, **changes))
        assert counted
        counted.clear()
        simd.integrate(replace(question, **changes))
        assert not counted


def test_only_so_many_kernels_are_kept(
    monkeypatch: pytest.MonkeyPatch, counted: list[Any]
) -> None:
    monkeypatch.setattr(running, "KEPT", 2)
    question = asked(velocity_actuated(), closer(1), 0.1)
    tols = (1e-4, 1e-6)
    for tol in (*tols, *tols, 1e-9):
        simd.integrate(replace(question, tol=tol))
    assert len(running._KERNELS) == 2
    counted.clear()
    simd.integrate(replace(question, tol=1e-6))
    assert not counted
    simd.integrate(replace(question, tol=1e-4))
    assert counted


def test_two_threads_compile_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    questions = [
        asked(velocity_actuated(sensor=f"1/(0.1{k}*s + 1)"), closer(9), 0.2, tol=tol)
        for k, tol in ((1, 1e-4), (2, 1e-4), (3, 1e-6), (3, 1e-6))
    ]
    monkeypatch.setattr(running, "_KERNELS", running.OrderedDict())
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(simd.integrate, questions))
    for question, ended in zip(questions, together, strict=True):
        same(ended, simd.integrate(question))
    same(together[2], together[3])


# --- Ctrl-C ------------------------------------------------------------------------------------


def test_an_exception_from_progress_leaves_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "PIECE", 128)
    question = asked(velocity_actuated(), closer(1280), 1.0)
    before, clock = threading.active_count(), time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        simd.integrate(replace(question, t_end=3e4), threads=2, progress=interrupted)
    assert threading.active_count() == before
    assert time.perf_counter() - clock < 20
    assert (simd.integrate(question, threads=2).outcome == 0).all()


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="needs POSIX signals")
def test_ctrl_c_in_the_middle_of_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run of minutes ends within a second."""
    main = threading.main_thread().ident
    assert main is not None
    question = asked(velocity_actuated(), closer(2000), 1e7)
    simd.integrate(replace(question, t_end=0.1))
    before = threading.active_count()
    timer = threading.Timer(0.3, lambda: signal.pthread_kill(main, signal.SIGINT))
    timer.start()
    clock = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        simd.integrate(question, threads=2)
    assert time.perf_counter() - clock < 3
    timer.join()
    assert threading.active_count() == before
