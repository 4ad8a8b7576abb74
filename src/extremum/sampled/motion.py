"""A linear vehicle between two samples, exactly.

ẋ = A x + B w + e with w constant until a switch and from it on:

x(T) = Φ(T) x + (Γ(T) − Γ(T₂)) w_old + Γ(T₂) w_new + Γ_e(T), T₂ = max(T − switch, 0),

[[Φ, Γ], [0, 1]] = exp([[A, B], [0, 0]] T). Where A is nilpotent, as a chain of integrators is, that
is a polynomial in T and stands in the equations; otherwise its entries are derived parameters.
Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems (1998), section 4.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, ImmutableMatrix, Symbol

from ..diagram import Diagram
from ..errors import InvalidDescription
from ..logic import maximum
from ..parameters import Parameter
from ..symbols import t
from ..system import Derived
from ..vehicles import Body, Vehicle
from .actuators import Arriving

Numbers = NDArray[np.float64]

TERMS: Final = 16
"""Of the series of e^M for |M| ≤ 1/2: the next one is below 3e-20."""


@dataclass(frozen=True)
class Linear:
    """ẋ = A x + B w + e, and what the vehicle's diagram says of the states.

    Attributes
    ----------
    states, units, initial
        The states.
    a, b, e
        The matrices, of parameters alone.
    body
        Where the vehicle and its sensor are.
    """

    states: tuple[Symbol, ...]
    units: tuple[str, ...]
    initial: tuple[Expr, ...]
    a: ImmutableMatrix
    b: ImmutableMatrix
    e: ImmutableMatrix
    body: Body

    def behind(self, lag: Expr, names: Sequence[str], units: Sequence[str]) -> Linear:
        """Return the vehicle behind a lag τ ẇ = u − w of each input, whose states have `names`."""
        count, order = len(names), len(self.states)
        pole = sympy.eye(count) / lag
        a = ImmutableMatrix.vstack(
            ImmutableMatrix.hstack(self.a, self.b),
            ImmutableMatrix.hstack(sympy.zeros(count, order), -pole),
        )
        return Linear(
            (*self.states, *(Symbol(name, real=True) for name in names)),
            (*self.units, *units),
            (*self.initial, *(sympy.Integer(0) for _ in names)),
            a,
            ImmutableMatrix.vstack(ImmutableMatrix(sympy.zeros(order, count)), pole),
            ImmutableMatrix.vstack(self.e, ImmutableMatrix(sympy.zeros(count, 1))),
            self.body,
        )


def linear(vehicle: Vehicle, inputs: Sequence[Symbol], initial: Sequence[Expr]) -> Linear:
    """Return a vehicle's equations as matrices.

    Raises
    ------
    InvalidDescription
        If they are not linear with constant coefficients.
    """
    diagram = Diagram()
    body = vehicle.compose(diagram, tuple(inputs), initial)
    rates, states = ImmutableMatrix(diagram.rhs), ImmutableMatrix(diagram.states)
    a, b = rates.jacobian(states), rates.jacobian(ImmutableMatrix(inputs))
    e = (rates - a * states - b * ImmutableMatrix(inputs)).applyfunc(sympy.expand)
    moving = {*diagram.states, *inputs, t, *(symbol for symbol, _ in diagram.signals)}
    if any(m.free_symbols & moving for m in (a, b, e)):
        raise InvalidDescription(
            "vehicle",
            f"{type(vehicle).__name__} is not linear with constant coefficients; only such a "
            "vehicle can be moved exactly from sample to sample",
        )
    return Linear(
        states=tuple(diagram.states),
        units=tuple(diagram.units[x] for x in diagram.states),
        initial=tuple(diagram.initial),
        a=ImmutableMatrix(a),
        b=ImmutableMatrix(b),
        e=ImmutableMatrix(e),
        body=body,
    )


@dataclass(frozen=True)
class Block:
    """States that move independently of the others, and the columns of [B, e] that drive them."""

    states: tuple[int, ...]
    columns: tuple[int, ...]
    a: ImmutableMatrix
    b: ImmutableMatrix


def blocks(vehicle: Linear) -> list[Block]:
    """Return the parts of a vehicle that do not depend on each other, such as its axes."""
    count, drive = len(vehicle.states), ImmutableMatrix.hstack(vehicle.b, vehicle.e)
    group = list(range(count))
    for i in range(count):
        for j in range(count):
            if vehicle.a[i, j] != 0 and group[i] != group[j]:
                old, new = group[j], group[i]
                group = [new if g == old else g for g in group]
    found = []
    for g in dict.fromkeys(group):
        own = [i for i in range(count) if group[i] == g]
        columns = [j for j in range(drive.cols) if any(drive[i, j] != 0 for i in own)]
        a, b = vehicle.a.extract(own, own), drive.extract(own, columns)
        found.append(Block(tuple(own), tuple(columns), ImmutableMatrix(a), ImmutableMatrix(b)))
    return found


@dataclass
class Exponentials:
    """exp([[A, B], [0, 0]] T) of blocks at some times, as expressions.

    Parameters
    ----------
    parameters
        What A, B and T are made of.
    paths
        Where in the loop those numbers are.
    """

    parameters: tuple[Parameter, ...]
    paths: frozenset[str]
    _known: dict[tuple[Block, Expr], ImmutableMatrix] = field(default_factory=dict)
    _named_symbols: set[Any] = field(default_factory=set)

    def at(self, block: Block, time: Expr) -> ImmutableMatrix:
        """Return [Φ(T), Γ(T)]."""
        key = (block, time)
        if key not in self._known:
            self._known[key] = self._polynomial(block, time) or self._named(block, time)
        return self._known[key]

    def _polynomial(self, block: Block, time: Expr) -> ImmutableMatrix | None:
        order, power = block.a.rows, sympy.eye(block.a.rows)
        phi, gamma = sympy.zeros(order), sympy.zeros(order, block.b.cols)
        for i in range(order):
            phi += power * time**i / sympy.factorial(i)
            gamma += power * block.b * time ** (i + 1) / sympy.factorial(i + 1)
            power = power * block.a
        return ImmutableMatrix.hstack(phi, gamma) if power.is_zero_matrix else None

    def _named(self, block: Block, time: Expr) -> ImmutableMatrix:
        order, width = block.b.rows, block.b.rows + block.b.cols
        matrix = sympy.zeros(order, width)
        number = len(self._known) + 1
        taken = {parameter.symbol.name for parameter in self.parameters}
        for i, j in ((i, j) for i in range(order) for j in range(width) if _reaches(block, i, j)):
            letter, column = ("Phi", j + 1) if j < order else ("Gamma", j - order + 1)
            name = f"{letter}{number}_{i + 1}{column}"
            while name in taken:
                name += "_"
            matrix[i, j] = Symbol(name, real=True)
            self._named_symbols.add(matrix[i, j])
        return ImmutableMatrix(matrix)

    def finished(self, expressions: Iterable[Expr]) -> tuple[tuple[Parameter, ...], Derived | None]:
        """Return the derived parameters that the expressions contain, and what computes them."""
        used: set[Any] = set().union(*(e.free_symbols for e in expressions))
        kept: list[Parameter] = []
        evaluations: list[tuple[Any, int, list[tuple[int, int]]]] = []
        symbols = [parameter.symbol for parameter in self.parameters]
        for (block, time), known in self._known.items():
            matrix: Any = known
            places = [(i, j) for i in range(matrix.rows) for j in range(matrix.cols)]
            own = [(i, j) for i, j in places if matrix[i, j] in self._named_symbols & used]
            if own:
                whole = [*ImmutableMatrix.hstack(block.a, block.b) * time]
                evaluate = sympy.lambdify([symbols], whole, "numpy", dummify=True)
                evaluations.append((evaluate, block.b.rows, own))
                kept += [Parameter(matrix[place], "", "") for place in own]
        if not kept:
            return (), None

        def computed(given: Numbers) -> Numbers:
            rows: list[Any] = []
            for evaluate, order, own in evaluations:
                flat = [np.broadcast_to(n, given.shape[1]) for n in evaluate(list(given))]
                width = len(flat) // order
                generator = np.zeros((given.shape[1], width, width))
                generator[:, :order] = np.stack(flat, -1).reshape(-1, order, width)
                found = exponential(generator, order)
                rows += [found[:, i, j] for i, j in own]
            return np.array(rows)

        return tuple(kept), Derived(len(kept), self.paths, computed)


def exponential(generators: Numbers, order: int) -> Numbers:
    """Return exp(M) of many matrices M = [[A, B], [0, 0]], (n, width, width).

    A Taylor series of exp(M/2^k), |A| ≤ 2^(k − 1), squared k times; each matrix has its own k, so
    that its result does not depend on the others'. SciPy's `expm` takes them one by one, fifty
    times slower. Source: Moler and Van Loan, Nineteen dubious ways to compute the exponential of a
    matrix, twenty-five years later (2003), methods 1 and 3.

    Parameters
    ----------
    generators
        The matrices.
    order
        The size of A.
    """
    size = np.abs(generators[:, :order, :order]).sum(axis=1).max(axis=1)
    halvings = np.maximum(np.frexp(size)[1] + 1, 0)
    scaled = generators * np.ldexp(1.0, -halvings)[:, None, None]
    unit = np.eye(generators.shape[1])
    found = np.broadcast_to(unit, generators.shape)
    for n in range(TERMS, 0, -1):
        found = unit + scaled @ found / n
    for k in range(int(halvings.max(initial=0))):
        found = np.where((halvings > k)[:, None, None], found @ found, found)
    return found


def _reaches(block: Block, i: int, j: int) -> bool:
    """Return whether state or column j acts on state i at all."""
    order = block.a.rows
    reached = {j} if j < order else {k for k in range(order) if block.b[k, j - order] != 0}
    while True:
        more = {k for k in range(order) if any(block.a[k, r] != 0 for r in reached)} | reached
        if more == reached:
            return i in reached
        reached = more


def moved(
    vehicle: Linear, exponentials: Exponentials, inputs: Arriving, time: Expr
) -> tuple[Expr, ...]:
    """Return the states at t_k + `time`, at most a sample later."""
    count = len(inputs.new)
    later: list[Any] = [sympy.Integer(0)] * len(vehicle.states)
    for block in blocks(vehicle):
        order = len(block.states)
        whole = exponentials.at(block, time)
        rest: Any = whole
        if inputs.switch is not None:
            remaining = time - inputs.switch
            if time != 0 and remaining != 0:
                remaining = maximum(remaining, 0)
            rest = exponentials.at(block, remaining)  # pyright: ignore[reportArgumentType]
        for row, place in enumerate(block.states):
            total: Any = sum(
                (whole[row, i] * vehicle.states[k] for i, k in enumerate(block.states)),
                sympy.Integer(0),
            )
            for column, source in enumerate(block.columns, order):
                if source >= count:
                    total += whole[row, column]
                    continue
                new = rest[row, column]
                total += new * inputs.new[source]
                if inputs.switch is not None:
                    total += (whole[row, column] - new) * inputs.old[source]
            later[place] = total
    return tuple(later)
