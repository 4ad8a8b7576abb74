"""The one symbolic type: a small system of equations with named states and named parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Symbol
from sympy.core.function import AppliedUndef

from .logic import normal, uniform
from .parameters import Parameter
from .symbols import substituted
from .symbols import t as time

Compiled = Callable[..., Any]


@dataclass(frozen=True, eq=False)
class Table:
    """The tensor product of C² cubic splines (not-a-knot) through values on a grid.

    Attributes
    ----------
    lines
        Coordinates of the grid lines, increasing, one array per argument.
    values
        The function's values, (len(lines[0]), len(lines[1]), …).
    """

    lines: tuple[NDArray[np.float64], ...]
    values: NDArray[np.float64]

    @cached_property
    def nodes(self) -> NDArray[np.float64]:
        """The mixed first derivatives at the nodes, (*values.shape, 2^d), which determine it.

        Number Σ_k b_k 2^(d−1−k) of a node is ∂^b f, b_k = 0 or 1: in two dimensions
        f, ∂f/∂y, ∂f/∂x, ∂²f/∂x∂y.
        """
        from scipy.interpolate import make_interp_spline

        found = [self.values]
        for axis, line in enumerate(self.lines):
            slopes = [make_interp_spline(line, f, k=3, axis=axis)(line, nu=1) for f in found]
            found = [f for pair in zip(found, slopes, strict=True) for f in pair]
        return np.stack(found, axis=-1)


@dataclass(frozen=True, eq=False)
class Oracle:
    """A function that is known by its values only, as it stands in the equations.

    Attributes
    ----------
    function
        Takes the arguments as floats and returns a float.
    lower, upper
        Where it is defined, one bound per argument; empty if everywhere.
    many
        The same function of arrays; None where there is none.
    table
        The same function as a table; None if it is none.
    """

    function: Callable[..., float]
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()
    many: Compiled | None = None
    table: Table | None = None

    def vectorised(self) -> Compiled:
        """Return the function of arrays."""
        return self.many or np.vectorize(self.function, otypes=[float])

    def guards(self, arguments: Sequence[Any]) -> list[Expr]:
        """Return expressions of the arguments that are positive where the oracle is defined."""
        bounds = zip(arguments, self.lower, self.upper, strict=False)
        return [e for a, low, high in bounds for e in (a - sympy.Float(low), sympy.Float(high) - a)]


@dataclass(frozen=True, eq=False)
class Derived:
    """Numbers that are functions of the others, such as a matrix exponential's entries.

    Attributes
    ----------
    count
        How many: the last parameters of the system.
    paths
        What they depend on: the beginnings of dotted paths, such as ``"vehicle"``.
    function
        The other parameters' numbers, (P, n), in order → theirs, (count, n).
    """

    count: int
    paths: frozenset[str]
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]]

    def depends(self, path: str) -> bool:
        """Return whether they vary with the number at a dotted path."""
        return any(path == start or path.startswith(f"{start}.") for start in self.paths)


@dataclass(frozen=True, eq=False)
class System:
    """ẋ = f(x, p, t) with everything named; no numbers.

    With `dt` it is difference equations instead: `rhs` are the states a sampling time later, and
    signals and outputs hold at t = k dt.

    Two systems are the same if they are the same object: a `Loop` builds one for each structure
    and keeps it, and engines keep what they compile under it.

    Attributes
    ----------
    states, rhs, initial
        The state's symbols, their rates and their values at t = 0 (expressions of the parameters).
    inputs
        The symbols of the vehicle's inputs; each is bound by a signal.
    outputs
        Name → expressions: ``position``, ``sensor``, ``J``, ``input`` and, if known, ``source``.
    signals
        Ordered bindings (symbol, expression), each in terms of states, parameters and the signals
        before it: J, ξ, u. They are kept, not expanded: sharing and readability depend on them.
    parameters
        Symbol, dotted path and unit of every value, in the order of the vector of values.
    units
        Symbol → unit, of states and signals.
    carriers
        The dither frequencies ω_i (rad/s).
    oracles
        Undefined function's name → `Oracle`, for opaque and gridded fields.
    time
        The symbol of time.
    dt
        None for differential equations; the sampling time's symbol for difference equations.
    derived
        The last parameters, if they are functions of the others that no formula states.
    essential
        The signals without which a run ends; None: all that may have no value.
    """

    states: tuple[Symbol, ...]
    rhs: tuple[Expr, ...]
    initial: tuple[Expr, ...]
    inputs: tuple[Symbol, ...]
    outputs: Mapping[str, tuple[Expr, ...]]
    signals: tuple[tuple[Symbol, Expr], ...]
    parameters: tuple[Parameter, ...]
    units: Mapping[Symbol, str]
    carriers: tuple[Expr, ...]
    oracles: Mapping[str, Oracle] = field(default_factory=dict)
    time: Symbol = time
    dt: Symbol | None = None
    derived: Derived | None = None
    essential: tuple[Symbol, ...] | None = None

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        """The parameters' symbols, in the order of the vector of values."""
        return tuple(parameter.symbol for parameter in self.parameters)

    @cached_property
    def seeds(self) -> frozenset[Any]:
        """The symbols of the random numbers' seeds."""
        signals = (e for _, e in self.signals)
        outputs = (e for expressions in self.outputs.values() for e in expressions)
        everything = (*self.rhs, *self.initial, *signals, *outputs)
        calls: set[Any] = set().union(*(e.atoms(normal, uniform) for e in everything))
        return frozenset().union(*(call.args[0].free_symbols for call in calls))

    def completed(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the vector of values: those given, and those that are `derived` from them."""
        if self.derived is None:
            return values
        return np.concatenate([values, self.derived.function(values[:, None])[:, 0]])

    @cached_property
    def guards(self) -> tuple[Expr, ...]:
        """Expressions that stay positive while every oracle is asked where it is defined."""
        return tuple(
            guard
            for _, expression in self.signals
            for call in expression.atoms(AppliedUndef)
            for guard in self.oracles[call.func.__name__].guards(call.args)
        )

    @cached_property
    def margins(self) -> Compiled:
        """(t, state, values) → the guards' values, on floats."""
        return self.function(self.guards, vector=False)

    def function(self, expressions: Sequence[Expr], *, vector: bool) -> Compiled:
        """Return a callable (t, state, values) → list of the expressions' values.

        With `vector`, t and every state may be arrays of samples (NumPy); otherwise all are floats
        (the `math` module, the fastest for one evaluation). Signals are computed once, in order.
        """
        needed = self._needed(expressions)
        binding: dict[Expr, Expr] = {symbol: sympy.Dummy() for symbol, _ in needed}
        calls = self._calls([*(e for _, e in needed), *expressions])
        binding |= {call: sympy.Dummy() for call in calls}
        bound = [(binding[call], call) for call in calls]
        bound += [(binding[symbol], substituted(e, binding)) for symbol, e in needed]
        arguments = [self.time, list(self.states), list(self.symbols)]
        library = [
            {name: o.vectorised() if vector else o.function for name, o in self.oracles.items()},
            "numpy" if vector else "math",
        ]
        return sympy.lambdify(
            arguments,
            [substituted(e, binding) for e in expressions],
            modules=library,
            dummify=True,
            cse=lambda exprs: (bound, exprs),  # pyright: ignore[reportArgumentType] - SymPy takes one
        )

    def _calls(self, expressions: Sequence[Expr]) -> list[Expr]:
        """Return the calls, such as sin ωt, that can be computed once before the signals."""
        signals = {symbol for symbol, _ in self.signals}
        calls = set().union(*(e.atoms(sympy.sin, sympy.cos, sympy.exp) for e in expressions))
        simple = [call for call in calls if not call.free_symbols & signals]
        return [call for call in simple if len(call.atoms(sympy.Function)) == 1]

    def _needed(self, expressions: Sequence[Expr]) -> list[tuple[Symbol, Expr]]:
        wanted: set[Any] = set().union(*(e.free_symbols for e in expressions))
        kept: list[tuple[Symbol, Expr]] = []
        for symbol, expression in reversed(self.signals):
            if symbol in wanted:
                kept.append((symbol, expression))
                wanted |= expression.free_symbols
        return kept[::-1]

    @cached_property
    def rates(self) -> Compiled:
        """(t, state, values) → ẋ, on floats."""
        return self.function(self.rhs, vector=False)

    @cached_property
    def begun(self) -> tuple[Expr, ...]:
        """The states at t = 0 as expressions of the parameters alone."""
        known: dict[Expr, Expr] = {self.time: sympy.Integer(0)}
        pending = dict(zip(self.states, self.initial, strict=True))
        signals = {symbol for symbol, _ in self.signals}
        direct = {x: e for x, e in pending.items() if not e.free_symbols & signals}
        known |= direct
        for symbol, expression in self.signals:
            known[symbol] = substituted(expression, known)
            known |= {x: substituted(e, known) for x, e in pending.items() if e.has(symbol)}
        return tuple(known[x] for x in self.states)

    @cached_property
    def start(self) -> Callable[[Sequence[float]], list[float]]:
        """Values → the state at t = 0."""
        library = [{name: o.function for name, o in self.oracles.items()}, "math"]
        begun = list(self.begun)
        return sympy.lambdify([list(self.symbols)], begun, modules=library, dummify=True)

    @cached_property
    def _fastest(self) -> Compiled:
        return sympy.lambdify([list(self.symbols)], list(self.carriers), "math", dummify=True)

    def fastest_period(self, values: Sequence[float]) -> float | None:
        """Return the shortest dither period (s), or None without a dither."""
        frequencies = self._fastest(values)
        return 2 * float(np.pi) / max(map(abs, frequencies)) if frequencies else None

    def common_period(self, values: Sequence[float]) -> float | None:
        """Return the shortest time after which every dither repeats (s), None if there is none."""
        if not self.carriers:
            return None
        ratios = [sympy.cancel(carrier / self.carriers[0]) for carrier in self.carriers]
        if not all(ratio.is_Rational for ratio in ratios):
            return None
        base: Any = sympy.gcd_list(ratios)
        return 2 * float(np.pi) / (float(base) * self._fastest(values)[0])

    @cached_property
    def _sampled(self) -> Compiled:
        flat = [e for expressions in self.outputs.values() for e in expressions]
        return self.function(flat, vector=True)

    def evaluate(
        self, times: NDArray[np.float64], states: NDArray[np.float64], values: Sequence[float]
    ) -> dict[str, NDArray[np.float64]]:
        """Return every output along a trajectory: name → array (time, component).

        Overflow gives infinities and values outside a function's domain give NaN, silently.
        """
        with np.errstate(all="ignore"):
            flat = self._sampled(times, list(states.T), values)
        columns = iter(flat)
        outputs = {name: np.empty((len(times), len(es))) for name, es in self.outputs.items()}
        for output in outputs.values():
            for component in output.T:
                component[:] = next(columns)
        return outputs

    def text(self, values: Sequence[float] | None = None) -> str:
        """Return the equations as text in the paper's symbols, with the numbers if given."""
        from .printing import text

        return text(self, values)

    def __str__(self) -> str:
        return self.text()

    def latex(self) -> str:
        """Return the equations as a LaTeX ``aligned`` environment, in the paper's symbols."""
        from .printing import latex

        return latex(self)

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {self.latex()}$"
