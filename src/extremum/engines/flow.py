"""The flow of a `System` and its derivative by the start: the state-transition matrices.

    ẋ = f(x, p, t),   Φ̇ = (∂f/∂x) Φ,   Φ(t₀) = I.

heyoka's variational equations, or SciPy's DOP853 on equations derived symbolically, for functions
known by their values only and on platforms without heyoka.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Symbol
from sympy.core.function import AppliedUndef

from ..symbols import substituted
from ..system import Oracle, System
from . import reference, taylor
from .choice import usual
from .kept import KEPT, Kept
from .trajectory import COMPLETED, broken_off

Vector = NDArray[np.float64]

TOLERANCE: Final = 1e-16
"""Of each step: what is wanted is Φ − I, small where the loop is slow against the dither."""

MAX_STEPS: Final = 100_000


@dataclass(frozen=True)
class Flow:
    """Where the flow leads over consecutive segments, and how that depends on the start.

    Attributes
    ----------
    times, states
        The segments' ends that were reached, after the start, (k + 1,), and the states there,
        (k + 1, n); all finite.
    factors
        Φ over each segment that was completed, (k, n, n): ∂x_{j+1}/∂x_j.
    outcome
        ``"completed"``, ``"escaped"`` or ``"left the data"``, as in a `Trajectory`.
    """

    times: Vector
    states: Vector
    factors: Vector
    outcome: str

    @property
    def completed(self) -> bool:
        """Whether every segment was completed."""
        return self.outcome == COMPLETED

    @property
    def state(self) -> Vector:
        """The last state that was reached, (n,)."""
        return self.states[-1]

    @property
    def matrix(self) -> Vector:
        """Φ over all segments, Φ_k … Φ₂ Φ₁, (n, n).

        Over many segments the product keeps only the largest multipliers; see `theory.floquet`.
        """
        product = np.eye(self.states.shape[1])
        for factor in self.factors:
            product = factor @ product
        return product


def transition(
    system: System,
    values: Sequence[float],
    state: Sequence[float] | Vector,
    start: float,
    end: float,
    *,
    tol: float = TOLERANCE,
    engine: str | None = None,
) -> Flow:
    """Return the flow over the one segment from `start` to `end` (s); see `transitions`."""
    return transitions(system, values, state, (start, end), tol=tol, engine=engine)


def transitions(
    system: System,
    values: Sequence[float],
    state: Sequence[float] | Vector,
    times: Sequence[float] | Vector,
    *,
    tol: float = TOLERANCE,
    engine: str | None = None,
) -> Flow:
    """Return the states at `times` and the transition matrix over each segment between them.

    The integrator is compiled once for the system and the tolerance and kept, one for each thread.

    Parameters
    ----------
    values
        The parameters' values, in the order of ``system.parameters``.
    state
        The state at ``times[0]``, (n,): every segment starts where the one before it ended; or a
        start for each segment, (k, n), as multiple shooting wants.
    times
        Increasing (s), (k + 1,).
    tol
        Tolerance of each step; SciPy's is at least 3e-14.
    engine
        ``"taylor"`` (heyoka), ``"reference"`` (SciPy's DOP853, its step capped at a twentieth of
        the fastest dither period) or None to choose.
    """
    if engine is None:
        engine = usual(system)
    segment = _taylor(system, values, tol) if engine == "taylor" else _dop853(system, values, tol)
    times, given = np.asarray(times, dtype=float), np.array(state, dtype=float)
    starts = given if given.ndim == 2 else None
    now, count = given if starts is None else given[0], len(system.states)
    states, factors, outcome = [now], [], COMPLETED
    for index, (start, end) in enumerate(pairwise(times.tolist())):
        now = now if starts is None else starts[index]
        now, factor, outcome = segment(now, start, end)
        if outcome != COMPLETED:
            break
        states.append(now)
        factors.append(factor)
    return Flow(
        times[: len(states)],
        np.array(states),
        np.array(factors).reshape(len(factors), count, count),
        outcome,
    )


Segment = Callable[[Vector, float, float], tuple[Vector, Vector, str]]


# --- heyoka -----------------------------------------------------------------------------------


def _taylor(system: System, values: Sequence[float], tol: float) -> Segment:
    integrator, count = _KEPT.get(system, tol), len(system.states)
    identity = np.eye(count).ravel()
    integrator.pars[:] = values[: len(integrator.pars)]  # up to the last one that occurs

    def segment(state: Vector, start: float, end: float) -> tuple[Vector, Vector, str]:
        integrator.time = start
        integrator.state[:count] = state
        integrator.state[count:] = identity
        integrator.propagate_until(end, max_steps=MAX_STEPS)
        reached = integrator.state.copy()
        outcome = COMPLETED
        if integrator.time != end or not np.isfinite(reached).all():
            time, reached = taylor.last_finite(integrator, start, np.concatenate([state, identity]))
            outcome = broken_off(system, time, reached[:count].tolist(), values)
        return reached[:count], reached[count:].reshape(count, count), outcome

    return segment


def _compile(system: System, tol: float) -> Any:
    import heyoka

    names, rates = (taylor.translated(system, e) for e in (system.states, system.rhs))
    equations = list(zip(names, rates, strict=True))
    varied = heyoka.var_ode_sys(equations, heyoka.var_args.vars, order=1)
    return heyoka.taylor_adaptive(varied, [0.0] * len(names), tol=tol, compact_mode=True)


_KEPT = Kept(_compile)


# --- SciPy ------------------------------------------------------------------------------------


def _dop853(system: System, values: Sequence[float], tol: float) -> Segment:
    whole, count = variational(system), len(system.states)
    identity = np.eye(count).ravel()

    def segment(state: Vector, start: float, end: float) -> tuple[Vector, Vector, str]:
        run = reference.integrate(
            whole,
            values,
            np.array([start, end]),
            tol=tol,
            state=np.concatenate([state, identity]).tolist(),
        )
        last, factor = run.end_state[:count], run.end_state[count:].reshape(count, count)
        return last, factor, run.outcome

    return segment


@lru_cache(maxsize=KEPT)
def variational(system: System) -> System:
    """Return ẋ = f and Φ̇ = (∂f/∂x) Φ as one system, Φ row by row after the states, from I.

    The chain rule goes through the signals, which stay shared. A function known by its values only
    is differentiated by differences of fourth order.
    """
    count = len(system.states)
    slopes: dict[Any, list[Expr]] = {
        x: [sympy.Integer(int(i == j)) for j in range(count)] for i, x in enumerate(system.states)
    }
    signals: list[tuple[Symbol, Expr]] = []
    oracles = dict(system.oracles)

    def bind(name: str, expression: Expr) -> Expr:
        if expression.is_number:
            return expression
        signals.append((sympy.Dummy(name), expression))
        return signals[-1][0]

    def gradient(expression: Expr) -> list[Expr]:
        partial = {v: expression.diff(v) for v in expression.free_symbols & slopes.keys()}
        return [sympy.Add(*(d * slopes[v][j] for v, d in partial.items())) for j in range(count)]

    for symbol, expression in system.signals:
        calls: dict[Expr, Expr] = {}
        for call in expression.atoms(AppliedUndef):
            calls[call] = bind("f", call)
            slopes[calls[call]] = _through(call, gradient, oracles)
        direct = substituted(expression, calls)
        signals.append((symbol, direct))
        slopes[symbol] = [bind(f"d{symbol}", e) for e in gradient(direct)]
    jacobian = [[bind("A", e) for e in gradient(rate)] for rate in system.rhs]
    names = [[sympy.Dummy(f"Phi_{i}{j}") for j in range(count)] for i in range(count)]
    rates = [
        sympy.Add(*(a * names[k][j] for k, a in enumerate(row)))
        for row in jacobian
        for j in range(count)
    ]
    identity = [sympy.Integer(int(i == j)) for i in range(count) for j in range(count)]
    return replace(
        system,
        states=(*system.states, *(name for row in names for name in row)),
        rhs=(*system.rhs, *rates),
        initial=(*system.initial, *identity),
        signals=tuple(signals),
        oracles=oracles,
    )


def _through(
    call: Any, gradient: Callable[[Expr], list[Expr]], oracles: dict[str, Oracle]
) -> list[Expr]:
    """Return the gradient of an oracle's value; adds its partial derivatives to `oracles`."""
    name = call.func.__name__
    inner = [gradient(argument) for argument in call.args]
    partial = []
    for index in range(len(call.args)):
        derived = f"{name}_{index}"
        oracles.setdefault(derived, Oracle(_Difference(oracles[name], index)))
        partial.append(sympy.Function(derived)(*call.args))
    return [
        sympy.Add(*(f * d for f, d in zip(partial, column, strict=True)))
        for column in zip(*inner, strict=True)
    ]


@dataclass(frozen=True)
class _Difference:
    """A partial derivative by central differences of fourth order, inside the bounds."""

    oracle: Oracle
    index: int

    def __call__(self, *arguments: float) -> float:
        function, index, centre = self.oracle.function, self.index, arguments[self.index]
        step = float(np.finfo(float).eps) ** 0.2 * max(1.0, abs(centre))
        if self.oracle.lower:
            low, high = self.oracle.lower[index], self.oracle.upper[index]
            centre = min(max(centre, low + 2 * step), high - 2 * step)

        def at(steps: int) -> float:
            moved = (*arguments[:index], centre + steps * step, *arguments[index + 1 :])
            return function(*moved)

        return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)
