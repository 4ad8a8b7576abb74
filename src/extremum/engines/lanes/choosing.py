"""Which scheme takes the steps, how long they are, and why a loop came to no end."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...system import Compiled, System
from .asked import Asked, Numbers
from .difference import Difference
from .program import Scheme, program, undefinable
from .schemes import RK4, Taylor
from .watch import Watch

SHARE: Final = 1 / 30
"""Of the tolerance that one step may take."""

ORDERS: Final = range(6, 22, 2)

LONG: Final = 850
LONGER: Final = 1.12
"""Operations of a step beyond which its code is too long, and what each of them then costs."""

FINEST: Final = {"float64": 0.0, "float32": 1e-5}
"""Tolerance below which a fixed step is not made shorter."""

STEEP: Final = 1e3
"""Growth per radian of the dither beyond which a loop that came to no end has escaped."""

AHEAD: Final = (1e-6, 1e-4, 1e-2)
"""Radians of the dither, straight on, within which a field that ends is found to end."""

HUGE: Final = {"float64": 1e90, "float32": 1e9}
"""A state beyond which a loop that came to no end has escaped."""


def usual(asked: Asked) -> Scheme:
    """Return Taylor's method of the order that costs least; RK4 for tables.

    Difference equations are their own scheme.

    The coefficients of a series that converges within ρ fall like ρ^−k, so that the step is
    ρ tol^(1/p): a unit of time costs flops(p) tol^(−1/p), and a little more where the code of a
    step is too long to stay in the first-level cache.
    """
    if asked.system.dt is not None:
        return Difference()
    if asked.system.oracles:
        return RK4

    def cost(order: int) -> float:
        flops = _flops(asked.system, asked.swept, order)
        return flops * (LONGER if flops > LONG else 1.0) * (asked.tol * SHARE) ** (-1 / order)

    best = ORDERS[0]
    for order in ORDERS[1:]:
        if cost(order) > cost(best):
            break
        best = order
    return Taylor(best)


def tolerance(asked: Asked, scheme: Scheme) -> float:
    """Return what one step may err, relative to 1 + |x|."""
    return asked.tol * SHARE * asked.shorter**-scheme.order


@lru_cache(maxsize=512)
def _flops(system: System, swept: tuple[int, ...], order: int) -> int:
    return program(system, swept, Taylor(order), Watch()).flops()


def numbers(asked: Asked, part: slice = slice(None)) -> list[Any]:
    """Return the parameters of some of the loops: arrays for those that vary."""
    values: list[Any] = list(asked.values)
    for row, index in enumerate(asked.swept):
        values[index] = asked.columns[row, part]
    return values


def paces(asked: Asked) -> Numbers:
    """Return numbers to which every loop's number of steps is about proportional."""
    return fastest(asked) if asked.system.dt is None else 1 / sampling(asked)


def sampling(asked: Asked) -> Numbers:
    """Return every loop's sampling time (s); for difference equations."""
    assert asked.system.dt is not None
    place = asked.system.symbols.index(asked.system.dt)
    return np.broadcast_to(np.asarray(numbers(asked)[place], float), asked.count)


def fastest(asked: Asked) -> Numbers:
    """Return every loop's fastest dither frequency (rad/s), 1 without a dither."""
    if not asked.system.carriers:
        return np.ones(asked.count)
    found = [np.broadcast_to(f, asked.count) for f in _carriers(asked.system)(numbers(asked))]
    return np.abs(np.array(found, dtype=float)).max(axis=0)


@lru_cache(maxsize=64)
def _carriers(system: System) -> Compiled:
    import sympy

    return sympy.lambdify([list(system.symbols)], list(system.carriers), "numpy", dummify=True)


@lru_cache(maxsize=64)
def _vector_rates(system: System) -> Compiled:
    return system.function(system.rhs, vector=True)


def lengths(asked: Asked) -> Numbers:
    """Return the step (s) of every loop for a scheme that has no step size of its own.

    A power law of the tolerance, and a whole number of steps between two samples. What is left to
    gain in single precision is lost in rounding.
    """
    per_period = 4 * max(asked.tol, FINEST[asked.dtype]) ** (-1 / 4)
    periods = asked.t_end * np.maximum(fastest(asked), _steepest(asked)) / (2 * math.pi)
    parts = max(asked.samples - 1, 1)
    return asked.t_end / (np.ceil(periods * per_period / parts) * parts * asked.shorter)


def _steepest(asked: Asked) -> Numbers:
    """Return a bound of |λ| (1/s) for every loop's linear part at t = 0, its field held still.

    ‖A¹⁶‖^(1/16), which is at most a few per cent too much.
    """
    size = len(asked.system.states)
    power = np.empty((asked.count, size, size))
    for i, row in enumerate(_linear_part(asked.system)(numbers(asked))):
        for j, entry in enumerate(row):
            power[:, i, j] = entry
    scale = np.maximum(np.linalg.norm(power, axis=(1, 2)), np.finfo(float).tiny)
    power /= scale[:, None, None]
    for _ in range(4):
        power = power @ power
    return scale * np.linalg.norm(power, axis=(1, 2)) ** (1 / 16)


@lru_cache(maxsize=64)
def _linear_part(system: System) -> Compiled:
    """Return the parameters' numbers → ∂ẋ/∂x, row by row, what tables say taken for constant."""
    import sympy
    from sympy.core.function import AppliedUndef

    bound: dict[Any, Any] = {}
    for symbol, expression in system.signals:
        still = expression.replace(lambda e: isinstance(e, AppliedUndef), lambda _: sympy.Dummy())
        bound[symbol] = still.xreplace(bound)
    rates: list[Any] = [rate.xreplace(bound) for rate in system.rhs]
    still = dict.fromkeys((*system.states, system.time), 0)
    rows = [[rate.diff(x).xreplace(still) for x in system.states] for rate in rates]
    return sympy.lambdify([list(system.symbols)], rows, "numpy", dummify=True)


def outcomes(
    asked: Asked, completed: NDArray[np.bool_], times: Numbers, states: NDArray[Any]
) -> NDArray[np.int8]:
    """Return 0 for loops that came to the end, 1 for those that escaped, 2 for the others.

    A loop that came to no end has escaped if a state is huge, or grows by `STEEP` of itself within
    a radian of the dither, or if the field has values further on (`AHEAD`). Difference equations
    come to an end by their states, or where the field has no value.
    """
    found = np.zeros(asked.count, dtype=np.int8)
    broken = np.flatnonzero(~completed)
    if not len(broken):
        return found
    there = states[:, broken].astype(float)
    size = np.abs(there).max(axis=0)
    escaped = size > HUGE[asked.dtype]
    if asked.system.dt is not None:
        escaped |= not (asked.system.guards or undefinable(asked.system))
    elif not asked.system.guards:
        rates = _rates(asked.system, asked, broken, times[broken], there)
        with np.errstate(invalid="ignore", over="ignore"):
            limit = STEEP * (1 + size) * fastest(asked)[broken]
            steep = (np.abs(rates) >= limit).any(axis=0)
            known = ~np.isnan(rates).any(axis=0)
            further = known.copy()
            for part in AHEAD:
                length = part / fastest(asked)[broken]
                later, beyond = times[broken] + length, there + length * rates
                further &= ~np.isnan(_rates(asked.system, asked, broken, later, beyond)).any(axis=0)
            escaped |= known & (steep | further)
    found[broken] = np.where(escaped, 1, 2)
    return found


def _rates(
    system: System,
    asked: Asked,
    loops: NDArray[np.intp],
    times: Numbers,
    states: NDArray[Any],
) -> NDArray[np.float64]:
    values = [v[loops] if isinstance(v, np.ndarray) else v for v in numbers(asked)]
    with np.errstate(all="ignore"):
        rates = _vector_rates(system)(times, list(states), values)
    return np.array([np.broadcast_to(rate, times.shape) for rate in rates], dtype=float)
