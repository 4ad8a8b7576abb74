"""The CPU ensemble engine: its instructions, its steps, what it keeps."""

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
from questions import asked, closer, errors, same, starts, watching
from systems import system
from test_mathematics import DTYPE, WIDE, compiled

import extremum as es
from extremum.engines import simd
from extremum.engines.lanes import choosing, kernels
from extremum.engines.lanes.accuracy import estimate
from extremum.engines.lanes.asked import Asked
from extremum.engines.lanes.kernels import Kernels
from extremum.engines.lanes.schemes import RK4, Taylor
from extremum.engines.lanes.tape import STEP, Tape
from extremum.engines.simd import running
from extremum.engines.simd.emitter import Emitter
from extremum.engines.simd.printing import Names, printed
from extremum.loop import varied
from extremum.symbols import FUNCTIONS

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
    found = compiled(printing(tape, value), inputs, Emitter(WIDE[bits], bits, contract=True))(
        *arrays
    )
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


def test_the_error_is_estimated_by_halving_the_steps() -> None:
    question = asked(velocity_actuated(), closer(60), 2.0, tol=1e-5)
    ended = simd.integrate(question)
    found, wrong = estimate(question, ended, simd.integrate), errors(question, ended)
    assert (found.loops, found.doubtful) == (60, 0)
    assert found.largest == pytest.approx(wrong.max(), rel=0.5)
    assert found.typical == pytest.approx(np.median(wrong), rel=0.5)


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
        assert ended.states[1] == pytest.approx(np.exp([3.0] * 3), rel=1e-5)


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
    question = asked(loop, over, 1.3, watch=watch, window=window, samples=4, tol=1e-4, dtype=dtype)
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
        monkeypatch.setattr(running, "KERNELS", Kernels(running.compiled))
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
    monkeypatch.setattr(running, "KERNELS", Kernels(running.compiled))
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


def test_only_so_many_kernels_are_kept(monkeypatch: pytest.MonkeyPatch, counted: list[Any]) -> None:
    monkeypatch.setattr(kernels, "KEPT", 2)
    question = asked(velocity_actuated(), closer(1), 0.1)
    for tol in (1e-4, 1e-6, 1e-4, 1e-9):  # the longest unused, 1e-6, makes room
        simd.integrate(replace(question, tol=tol))
    counted.clear()
    simd.integrate(replace(question, tol=1e-4))
    simd.integrate(replace(question, tol=1e-9))
    assert not counted
    simd.integrate(replace(question, tol=1e-6))
    assert counted


def test_two_threads_compile_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    questions = [
        asked(velocity_actuated(sensor=f"1/(0.1{k}*s + 1)"), closer(9), 0.2, tol=tol)
        for k, tol in ((1, 1e-4), (2, 1e-4), (3, 1e-6), (3, 1e-6))
    ]
    monkeypatch.setattr(running, "KERNELS", Kernels(running.compiled))
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
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background
    before = threading.active_count()
    timer = threading.Timer(0.3, lambda: signal.pthread_kill(main, signal.SIGINT))
    timer.start()
    clock = time.perf_counter()
    try:
        with pytest.raises(KeyboardInterrupt):
            simd.integrate(question, threads=2)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert time.perf_counter() - clock < 3
    timer.join()
    assert threading.active_count() == before
