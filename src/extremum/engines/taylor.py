"""One trajectory by Taylor's method (heyoka): any tolerance, compiled once for each structure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from typing import Any, Final, cast

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ..symbols import substituted
from ..system import System
from .kept import Kept
from .trajectory import COMPLETED, Progress, Trajectory, broken_off

CHUNKS: Final = 100
MAX_LAST_STEPS: Final = 100_000


@cache
def available() -> bool:
    """Return whether heyoka is installed (its wheels exist for Linux)."""
    return find_spec("heyoka") is not None


def integrate(
    system: System,
    values: Sequence[float],
    times: NDArray[np.float64],
    *,
    tol: float,
    state: Sequence[float] | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Return the solution of ẋ = f(x, p, t) at `times`.

    The integrator is compiled for the system and the tolerance and kept, one for each thread;
    other values cost no compilation.

    Parameters
    ----------
    values
        The parameters' values, in the order of ``system.parameters``.
    times
        Increasing; the first is where the run starts.
    tol
        Relative tolerance of the Taylor method for each step.
    state
        The state at ``times[0]``; None for the system's own initial state.
    progress
        Called with the time reached, now and then.
    """
    integrator = _KEPT.get(system, tol)
    start = system.start(values) if state is None else state
    chunks = [times]
    if progress is not None:
        chunks = [times[max(part[0] - 1, 0) : part[-1] + 1] for part in _parts(len(times))]
    reached: list[NDArray[np.float64]] = []
    broken = False
    for index, chunk in enumerate(chunks):
        integrator.time = float(chunk[0])
        integrator.state[:] = reached[-1][-1] if reached else start
        integrator.pars[:] = values[: len(integrator.pars)]  # up to the last one that occurs
        *_, found = integrator.propagate_grid(chunk, callback=_always)
        if not np.isfinite(found).all():
            found = found[: int(np.argmin(np.isfinite(found).all(axis=1)))]
        reached.append(found if index == 0 else found[1:])
        if progress is not None:
            progress(float(integrator.time))
        if len(found) < len(chunk):
            broken = True
            break
    states = reached[0] if len(reached) == 1 else np.concatenate(reached)
    if not len(states):  # the very first step overflows
        states = np.array([start], dtype=float)
    count = len(states)
    if not broken:
        return Trajectory(times, states, COMPLETED, float(times[-1]), states[-1])
    end_time, end_state = last_finite(integrator, float(times[count - 1]), states[-1])
    outcome = broken_off(system, end_time, list(end_state), values)
    return Trajectory(times[:count], states, outcome, end_time, end_state)


def _always(_: Any) -> bool:
    return True  # called between steps, where Python sees Ctrl-C


def _parts(count: int) -> list[NDArray[np.int64]]:
    return [part for part in np.array_split(np.arange(count), CHUNKS) if len(part)]


def last_finite(
    integrator: Any, time: float, state: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Return the last finite state on the way from a state into infinity, and its time."""
    integrator.time = time
    integrator.state[:] = state
    for _ in range(MAX_LAST_STEPS):
        integrator.step()
        if not np.isfinite(integrator.state).all():
            break
        time, state = float(integrator.time), integrator.state.copy()
    return time, state


def _compile(system: System, tol: float) -> Any:
    import heyoka

    equations = list(zip(_variables(system), translated(system, system.rhs), strict=True))
    count = len(system.states)
    return heyoka.taylor_adaptive(equations, [0.0] * count, tol=tol, compact_mode=count > 24)


_KEPT = Kept(_compile)


def _variables(system: System) -> list[Any]:
    import heyoka

    return [heyoka.expression(f"x{i}") for i in range(len(system.states))]


def translated(system: System, expressions: Sequence[Expr]) -> list[Any]:
    """Return expressions of the system as heyoka's, the parameters as ``par[i]``."""
    import heyoka

    table: dict[Any, Any] = dict(zip(system.states, _variables(system), strict=True))
    table |= {symbol: heyoka.par[i] for i, symbol in enumerate(system.symbols)}
    table[system.time] = heyoka.time
    for symbol, expression in system.signals:
        table[symbol] = _translate(expression, table)
    return [_translate(expression, table) for expression in expressions]


def _translate(expression: Expr, table: Mapping[Any, Any]) -> Any:
    import heyoka

    powers = {
        power: sympy.Dummy()
        for power in expression.atoms(sympy.Pow)
        if power.exp.is_Integer and power.exp > 2
    }
    products = {
        product: _power(_translate(cast(Expr, power.base), table), int(power.exp))
        for power, product in powers.items()
    }
    return heyoka.from_sympy(_floats(substituted(expression, powers)), {**table, **products})


def _power(base: Any, exponent: int) -> Any:
    """Return a power as products: heyoka's own, whose series divides by the base, is NaN at 0."""
    if exponent == 1:
        return base
    half = _power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half


def _floats(expression: Expr) -> Expr:
    """Return the expression with the constants that heyoka does not take written as floats."""
    fractions = {
        r: sympy.Float(float(r)) for r in expression.atoms(sympy.Rational) if r.q & (r.q - 1)
    }
    return substituted(expression, {**fractions, sympy.E: sympy.Float(float(sympy.E))})
