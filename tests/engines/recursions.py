"""Difference equations that several tests run, and one of them written as a loop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import sympy
from sympy import Integer, Symbol, cos, sin

from extremum.engines.lanes import random
from extremum.engines.lanes.asked import Asked
from extremum.logic import maximum, minimum, normal, uniform
from extremum.parameters import Parameter
from extremum.symbols import t
from extremum.system import System

dt, seed, w, a, b = sympy.symbols("dt seed w a b", real=True)
x, y, z = sympy.symbols("x y z", real=True)
J = Symbol("J", real=True)
PARAMETERS = (dt, seed, w, a, b)
VALUES = {dt: 0.01, seed: 0.0, w: 7.0, a: 0.5, b: 0.25}


def sampled(
    following: dict[Symbol, Any], initial: dict[Symbol, Any], *signals: Any, **more: Any
) -> System:
    """Difference equations: state → its next value, and its first."""
    return System(
        states=tuple(following),
        rhs=tuple(map(sympy.sympify, following.values())),
        initial=tuple(sympy.sympify(initial[state]) for state in following),
        inputs=(),
        outputs={},
        signals=signals,
        parameters=tuple(Parameter(p, str(p), "1") for p in PARAMETERS),
        units={},
        dt=dt,
        **{"carriers": (), "essential": (), **more},
    )


def asked(system: System, steps: int, over: dict[Symbol, Any], **more: Any) -> Asked:
    values = np.array([VALUES[p] for p in PARAMETERS])
    swept = tuple(PARAMETERS.index(p) for p in over)
    columns = np.array(np.broadcast_arrays(*over.values()), dtype=float)
    t_end = more.pop("t_end", steps * VALUES[dt])
    return Asked(system, values, swept, columns, t_end, **more)


def noisy() -> System:
    """A loop in small: a field, two random numbers, a washout, a dither and a clipped input."""
    u = Symbol("u", real=True)
    return sampled(
        {x: x + dt * u, y: y + a * (J - y), z: u},
        {x: b, y: -(b**2), z: 0},
        (J, -(x**2) + 0.1 * normal(seed, Integer(1)) + 0.01 * uniform(seed, Integer(2))),
        (u, maximum(minimum(cos(w * t + sympy.pi / 3) + 5 * (J - y) * sin(w * t), 1), -1)),
        carriers=(w,),
    )


def noisily(steps: int, lane: dict[Symbol, float]) -> tuple[np.ndarray, np.ndarray]:
    """`noisy` as a loop: the states at 0 … steps and J there."""
    v = {**VALUES, **lane}
    p, m, held = v[b], -(v[b] ** 2), 0.0
    states, signals = [], []
    for k in range(steps + 1):
        noise = float(random.normal(v[seed], k, 1))
        level = -(p**2) + 0.1 * noise + 0.01 * float(random.uniform(v[seed], k, 2))
        states.append((p, m, held))
        signals.append(level)
        angle = v[w] * k * v[dt]
        command = math.cos(angle + math.pi / 3) + 5 * (level - m) * math.sin(angle)
        held = min(max(command, -1.0), 1.0)
        p, m = p + v[dt] * held, m + v[a] * (level - m)
    return np.array(states), np.array(signals)
