"""The others: C++ by hand, NumPy over lanes, prange with a scalar body, JAX, looping solve_ivp."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from ensemble_problems import LANES, T_END, Columns, Library, Problem, Rates, error, reference
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

SOURCE = Path(__file__).with_name("ensemble.cpp")
OPTIONS = ("-std=c++17", "-O3", "-march=native", "-ffast-math", "-shared", "-fPIC")
REAL = {"float64": "double", "float32": "float"}
ORDERS = {"quadratic": 8, "force": 10, "wavy": 8}
"""Of the Taylor steps in C++."""

STEPS = tuple(round(20 * 1.02**k) for k in range(290))
TOLERANCES = tuple(10.0 ** (-k / 20) for k in range(40, 240))
AT_BEST = {"float64": 1024, "float32": 16384}
"""Loops with which JAX is fastest."""

Run = Callable[[NDArray[np.float64], Any], NDArray[Any]]
"""(columns, setting) → the states at the end, (states, loops)."""


@dataclass(frozen=True)
class Candidate:
    """One way to run a problem's loops on one core.

    Attributes
    ----------
    title
        What the tables call it.
    run
        Runs loops with a setting: a number of steps, or a tolerance.
    loops
        A number of loops that keeps it busy for some hundredths of a second.
    settings
        From the coarsest to the finest.
    """

    title: str
    run: Run
    loops: int
    settings: Sequence[float] = STEPS


def rivals(problem: Problem, dtype: str) -> Iterator[Candidate]:
    """Yield those that are installed."""
    library = _library(dtype)
    if library is not None:
        order = ORDERS[problem.name]
        for scheme, words in (("taylor", f"Taylor, order {order}"), ("rk4", "RK4")):
            function = getattr(library, f"{problem.name}_{scheme}")
            yield Candidate(f"C++ {words}", _compiled(problem, function, dtype), 1 << 14)
    if find_spec("jax") is not None:
        yield Candidate("JAX vmap, RK4", _jax(problem, dtype), AT_BEST[dtype])
    if find_spec("numba") is not None:
        yield Candidate("prange, scalar, RK4", _prange(problem, dtype), 512)
    yield Candidate("NumPy, RK4", _numpy(problem, dtype), 4096)
    if dtype == "float64":
        yield Candidate("looping solve_ivp", _looping(problem), 8, TOLERANCES)


def absent() -> list[str]:
    """Return a note for each rival that is not here."""
    notes = []
    if _compiler() is None:
        notes.append("No C++ compiler (g++, clang++ or c++): the hand-written version is left out.")
    for name, what in (("numba", "prange"), ("jax", "JAX vmap")):
        if find_spec(name) is None:
            notes.append(f"{name} is not installed: {what} is left out.")
    return notes


def fitted(candidate: Candidate, problem: Problem, wanted: float) -> tuple[float, float] | None:
    """Return the coarsest setting with an error of at most `wanted`, and the error then.

    None if no setting reaches it: rounding.
    """
    columns, known = problem.columns(LANES), reference(problem.name)
    settings = candidate.settings

    @cache
    def reached(place: int) -> float:
        return error(candidate.run(columns, settings[place]), known)

    place = bisect_left(range(len(settings)), True, key=lambda k: reached(k) <= wanted)
    return None if place == len(settings) else (settings[place], reached(place))


# --- C++ --------------------------------------------------------------------------------------


def _compiler() -> str | None:
    return next(filter(None, map(shutil.which, ("g++", "clang++", "c++"))), None)


@cache
def _library(dtype: str) -> Any:
    """Return the compiled source, or None without a compiler."""
    compiler = _compiler()
    if compiler is None:
        return None
    with TemporaryDirectory() as folder:
        target = Path(folder) / "ensemble.so"
        options = (*OPTIONS, f"-DREAL={REAL[dtype]}", "-o", str(target), str(SOURCE))
        subprocess.run((compiler, *options), check=True)
        return ctypes.CDLL(str(target))


def _compiled(problem: Problem, function: Any, dtype: str) -> Run:
    function.restype = None
    function.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_long] * 2 + [ctypes.c_double]
    states = len(problem.loop.system.states)

    def run(columns: NDArray[np.float64], steps: int) -> NDArray[Any]:
        loops = columns.shape[1]
        out = np.empty((states + 1, loops), dtype)  # the last row: until when they were finite
        function(columns.ctypes.data, out.ctypes.data, loops, steps, T_END)
        return out[:states]

    return run


# --- RK4 by hand in Python: sin ωt and cos ωt by rotation in double precision ------------------


def _stepped(
    rates: Rates, waves: Any, turn: Any, states: Any, columns: Columns, h: Any, half: Any
) -> Any:
    """Return the states and the waves a Runge–Kutta step later."""
    kind = columns.dtype
    turned = [waves, _turned(waves, turn), _turned(_turned(waves, turn), turn)]
    first, mid, last = ([wave.astype(kind) for wave in pair] for pair in turned)
    a = rates(*first, states, columns)
    b = rates(*mid, [x + half * k for x, k in zip(states, a, strict=True)], columns)
    c = rates(*mid, [x + half * k for x, k in zip(states, b, strict=True)], columns)
    d = rates(*last, [x + h * k for x, k in zip(states, c, strict=True)], columns)
    sixth = h / 6
    slopes = zip(states, a, b, c, d, strict=True)
    return [x + sixth * (k + 2 * (m + n) + o) for x, k, m, n, o in slopes], turned[2]


def _turned(waves: Any, turn: Any) -> Any:
    (s, c), (sine, cosine) = waves, turn
    return s * cosine + c * sine, c * cosine - s * sine


def _turn(columns: NDArray[np.float64], steps: int) -> tuple[Any, Any]:
    angle = columns[6] * (T_END / steps / 2)
    return np.sin(angle), np.cos(angle)


def _numpy(problem: Problem, dtype: str) -> Run:
    kind = np.dtype(dtype).type
    rates = problem.law(Library(np.cos, np.exp, kind))

    def run(columns: NDArray[np.float64], steps: int) -> NDArray[Any]:
        mine, turn = columns.astype(dtype), _turn(columns, steps)
        states, h, half = problem.began(mine), kind(T_END / steps), kind(T_END / steps / 2)
        waves: Any = (0 * columns[6], 0 * columns[6] + 1)
        for _ in range(steps):
            states, waves = _stepped(rates, waves, turn, states, mine, h, half)
        return np.stack(states)

    return run


def _prange(problem: Problem, dtype: str) -> Run:
    import numba
    from numba.cpython.unsafe.tuple import tuple_setitem
    from numba.np.unsafe.ndarray import to_fixed_tuple

    kind, size = np.dtype(dtype).type, len(problem.loop.system.states)
    fast: Any = numba.njit(fastmath=True)
    whole: Any = numba.njit(fastmath=True, parallel=True)
    replaced: Any = tuple_setitem
    tuple_of: Any = to_fixed_tuple
    law = fast(problem.law(Library(math.cos, math.exp, kind)))
    two, six = kind(2), kind(6)

    @fast
    def moved(state: Any, h: Any, slope: Any) -> Any:
        for j in range(size):
            state = replaced(state, j, state[j] + h * slope[j])
        return state

    @fast
    def turned(s: Any, c: Any, turn: Any) -> Any:
        return s * turn[1] + c * turn[0], c * turn[1] - s * turn[0]

    @whole
    def every(columns: Any, turns: Any, states: Any, steps: int, h: Any, half: Any) -> None:
        for i in numba.prange(columns.shape[1]):
            column, x = tuple_of(columns[:, i], 8), tuple_of(states[:, i], size)
            turn = tuple_of(turns[:, i], 2)
            s, c = 0.0, 1.0
            for _ in range(steps):
                first = law(kind(s), kind(c), x, column)
                s, c = turned(s, c, turn)
                second = law(kind(s), kind(c), moved(x, half, first), column)
                third = law(kind(s), kind(c), moved(x, half, second), column)
                s, c = turned(s, c, turn)
                fourth = law(kind(s), kind(c), moved(x, h, third), column)
                slope = moved(moved(first, two, second), two, third)
                x = moved(x, h / six, moved(slope, kind(1), fourth))
            for j in range(size):
                states[j, i] = x[j]

    def run(columns: NDArray[np.float64], steps: int) -> NDArray[Any]:
        numba.set_num_threads(1)
        mine, h = columns.astype(dtype), T_END / steps
        states = np.stack(problem.began(mine))
        every(mine, np.stack(_turn(columns, steps)), states, steps, kind(h), kind(h / 2))
        return states

    return run


def _jax(problem: Problem, dtype: str) -> Run:
    import jax  # pyright: ignore[reportMissingImports] - only where it is installed
    import jax.numpy as jnp  # pyright: ignore[reportMissingImports]

    jax.config.update("jax_enable_x64", True)
    kind = np.dtype(dtype).type
    rates = problem.law(Library(jnp.cos, jnp.exp, kind))

    def one(states: Any, column: Any, turn: Any, steps: Any, h: Any, half: Any) -> Any:
        def step(_: Any, now: Any) -> Any:
            return _stepped(rates, now[1], turn, now[0], column, h, half)

        waves = (jnp.zeros(()), jnp.ones(()))
        return jax.lax.fori_loop(0, steps, step, (states, waves))[0]

    every = jax.jit(jax.vmap(one, in_axes=(0, 1, 0, None, None, None)))

    def run(columns: NDArray[np.float64], steps: int) -> NDArray[Any]:
        mine, h = columns.astype(dtype), T_END / steps
        began = problem.began(mine)
        return np.stack(every(began, mine, _turn(columns, steps), steps, kind(h), kind(h / 2)))

    return run


# --- SciPy ------------------------------------------------------------------------------------


def _looping(problem: Problem) -> Run:
    law = problem.law(Library(math.cos, math.exp))

    def rates(time: float, state: NDArray[np.float64], p: list[float]) -> tuple[Any, ...]:
        return law(math.sin(p[6] * time), math.cos(p[6] * time), state.tolist(), p)

    def run(columns: NDArray[np.float64], tol: float) -> NDArray[np.float64]:
        ends = []
        for column in columns.T:
            numbers = column.tolist()
            start = [float(x) for x in problem.start(numbers)]
            solved = solve_ivp(
                rates,
                (0.0, T_END),
                start,
                "DOP853",
                (T_END,),
                rtol=tol,
                atol=tol,
                args=(numbers,),
            )
            ends.append(solved.y[:, -1])
        return np.stack(ends, axis=1)

    return run
