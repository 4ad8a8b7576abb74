"""Ensembles that the GPU engine must run like the CPU engine.

As a script, ``python lane_cases.py FILE`` runs all of them on numba's CUDA simulator and writes
what became of them; numba reads the switch to the simulator when it is imported.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from systems import system

import extremum as es
from extremum.engines.lanes.asked import Asked, Ended
from extremum.engines.lanes.program import Scheme
from extremum.engines.lanes.schemes import RK4
from extremum.engines.lanes.watch import Watch
from extremum.papers import zhang2007

FUNCTIONS = (
    "sin(x)*cos(2*x) + tan(x/2) + asin(x/3) - acos(x/3) + atan(x) + atan2(x, 2) + sinh(x)"
    " + cosh(x) - tanh(x) + asinh(x) + acosh(2 + x**2) + atanh(x/4) + exp(-x) + log(1 + x**2)"
    " + sqrt(2 + x) + (1 + x**2)**a - 9*x + b*sin(w*t)"
)
CHANNELS = "controller.channels"


def asked(loop: es.Loop, t_end: float, over: dict[str, Any], **more: Any) -> Asked:
    """Loops of one structure whose numbers at some dotted paths vary."""
    paths = [parameter.path for parameter in loop.system.parameters]
    swept = tuple(paths.index(path) for path in over)
    columns = np.array(np.broadcast_arrays(*over.values()), dtype=float)
    return Asked(loop.system, loop.values, swept, columns, t_end, **more)


def drawn(low: float, high: float, count: int, seed: int) -> Any:
    return np.random.default_rng(seed).uniform(low, high, count)


@cache
def paper(name: str) -> es.Loop:
    return zhang2007.scenario(name).loop


def quadratic(**more: Any) -> Asked:
    """Fig. 4, everything that an optimiser would turn varied, ω and h included."""
    over = {
        "start.0": drawn(-1, 1, 4, 1),
        f"{CHANNELS}.0.dither.amplitude": drawn(0.06, 0.1, 4, 2),
        f"{CHANNELS}.1.gain": drawn(6, 10, 4, 3),
        "controller.frequency": drawn(25, 35, 4, 4),
        "controller.washout": drawn(0.8, 1.2, 4, 5),
    }
    return asked(paper("fig4"), 2.0, over, **more)


def watched(**more: Any) -> Asked:
    """Every entry of a watch, a last window of each loop's own, and samples."""
    system = paper("fig4").system
    (level,), (x, y) = system.outputs["J"], system.outputs["position"]
    watch = Watch(
        (level, x * y), (x, y), (level, -x, -1 - x**2), ((x + 1) ** 2 + (y + 1) ** 2 - 1,)
    )
    over = {"start.0": drawn(-1, 1, 3, 6), "start.1": drawn(-1, 1, 3, 7)}
    window = np.array([0.2, 0.7, 9.0])
    return asked(paper("fig4"), 2.0, over, watch=watch, window=window, samples=5, **more)


def force() -> Asked:
    """Fig. 2 with a constant force, seven states, started on the dither."""
    over = {"start.position.0": np.array([0.8, 1.0])}
    return asked(paper("constant_force"), 1.5, over)


def moving() -> Asked:
    """Time itself stands in the equations."""
    loop = paper("fig4")
    field = es.Moving(loop.field, ("sin(0.3*t)", "0.1*t**2"))
    return asked(es.Loop(field, loop.vehicle, loop.controller, loop.start), 2.0, _starts(8))


def wavy() -> Asked:
    loop = paper("fig4")
    field = es.Expression("exp(-a*(x**2 + y**2))*cos(b*x)", parameters={"a": 0.1, "b": 0.5})
    return asked(es.Loop(field, loop.vehicle, loop.controller, loop.start), 2.0, _starts(9))


def escaping() -> Asked:
    """Ascent turned into descent for two of the loops, which escape; one is not swept."""
    gains = np.array([10.0, -40.0, -60.0])
    over = {f"{CHANNELS}.0.gain": gains, f"{CHANNELS}.1.gain": gains}
    (level,) = paper("fig4").system.outputs["J"]
    watch = Watch(mean=(level,), last_mean=(level,), maxima=(-level,), beyond=(-level,))
    return asked(paper("fig4"), 2.0, over, watch=watch, window=np.full(3, 0.5), samples=7)


def alone() -> Asked:
    """Nothing varies."""
    loop = paper("fig4")
    return Asked(loop.system, loop.values, (), np.empty((0, 1)), 1.0)


def calm() -> Asked:
    """No dither, so no period to measure steps by."""
    return Asked(system("-a*x"), np.zeros(3), (0,), np.array([[1.0, 2.0]]), 1.5)


def functions(**more: Any) -> Asked:
    """All functions, their series included, of what stays within their domains."""
    columns = np.array([[0.3, 0.5, 0.7]])
    values = np.array([0.0, 0.8, 5.0])
    rates = system("f", carriers="w", f=FUNCTIONS)
    return Asked(rates, values, (0,), columns, 1.0, **more)


def _starts(seed: int) -> dict[str, Any]:
    return {"start.0": drawn(-1, 1, 2, seed), "start.1": drawn(-1, 1, 2, seed + 1)}


CASES: dict[str, Callable[[], tuple[Asked, Scheme | None]]] = {
    "quadratic": lambda: (quadratic(), None),
    "quadratic, tight": lambda: (quadratic(tol=1e-11), None),
    "quadratic, float32": lambda: (quadratic(tol=1e-5, dtype="float32"), None),
    "watched": lambda: (watched(), None),
    "watched, float32": lambda: (watched(tol=1e-5, dtype="float32"), None),
    "watched, RK4": lambda: (watched(tol=1e-3), RK4),
    "force": lambda: (force(), None),
    "moving": lambda: (moving(), None),
    "wavy": lambda: (wavy(), None),
    "escaping": lambda: (escaping(), None),
    "alone": lambda: (alone(), None),
    "calm": lambda: (calm(), None),
    "functions": lambda: (functions(), None),
    "functions, float32": lambda: (functions(tol=1e-5, dtype="float32"), None),
}


def numbers(ended: Ended) -> dict[str, Any]:
    return {field.name: getattr(ended, field.name) for field in fields(ended)}


def main() -> None:
    from extremum.engines import cuda
    from extremum.engines.cuda import running

    warnings.simplefilter("ignore", RuntimeWarning)  # overflow, which a GPU does not report
    kept = {}
    for name, case in CASES.items():
        asked, scheme = case()
        ended = cuda.integrate(asked, scheme=scheme)
        kept |= {f"{name}/{field}": value for field, value in numbers(ended).items()}
    running.THREADS = running.MOST = 2
    shares: list[float] = []
    small = quadratic()
    some = replace(small, columns=small.columns[:, :3])
    ended = cuda.integrate(some, progress=shares.append)
    kept |= {f"in pieces/{field}": value for field, value in numbers(ended).items()}
    np.savez(Path(sys.argv[1]), shares=shares, **kept)


if __name__ == "__main__":
    assert os.environ["NUMBA_ENABLE_CUDASIM"] == "1"
    main()
