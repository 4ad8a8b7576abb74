"""Block diagrams of what runs at sampling instants t_k = k dt: blocks become difference equations.

A transfer function is discretised by Tustin's rule, pre-warped at a frequency ω,

s → K (z − 1)/(z + 1), K = ω/tan(ω dt/2),

which is exact at 0 and at ω: there, z = e^(jω dt) makes it jω. It is drawn in δ = z − 1,
s → K δ/(δ + 2), whose coefficients keep their digits however small dt is. Source: Middleton and
Goodwin, Digital Control and Estimation (1990).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import sympy
from sympy import Expr, Symbol

from ..diagram import Diagram
from ..lti import realise
from ..rational import ratio
from ..symbols import s, substituted

DT: Final = Symbol("dt", real=True, positive=True)
"""The time between two samples (s)."""


@dataclass(frozen=True)
class Filter:
    """A filter as drawn: its states, 1, a_1, … of its denominator in δ, where it is exact."""

    states: tuple[Symbol, ...]
    denominator: tuple[Expr, ...]
    exact_at: Expr | None


class SampledDiagram(Diagram):
    """Collects states that hold between samples; `rhs` are their values at the next one.

    Parameters
    ----------
    dt
        The time between two samples (s).

    Attributes
    ----------
    given
        States that start otherwise where the first sample is known beforehand, in its terms.
    """

    def __init__(self, dt: Expr = DT) -> None:
        super().__init__()
        self.dt = dt
        self.filters: list[Filter] = []
        self.given: dict[Symbol, Expr] = {}
        self._warps: dict[Expr, Symbol] = {}

    def state(self, name: str, unit: str, initial: Expr | float) -> Symbol:
        """Add a state that stays as it is, until `follow` says otherwise."""
        symbol = Symbol(name, real=True)
        self._add(symbol, unit)
        self.states.append(symbol)
        self.initial.append(sympy.sympify(initial))
        self.rhs.append(symbol)
        return symbol

    def follow(self, state: Symbol, following: Expr | float) -> None:
        """Say what a state is at the next sample."""
        self.rhs[self.states.index(state)] = sympy.sympify(following)

    def follows(self, state: Symbol) -> Expr:
        """Return what a state is at the next sample."""
        return self.rhs[self.states.index(state)]

    def begin(self, state: Symbol, initial: Expr) -> None:
        """Say what a state is at t = 0, whatever the first sample is."""
        self.initial[self.states.index(state)] = initial
        self.given.pop(state, None)

    def share(self, time: Expr) -> Expr:
        """Return 1 − e^(−dt/T): what a first-order lag of time constant T covers in a sample."""
        return 1 - sympy.exp(-self.dt / time)

    def warp(self, frequency: Expr | None) -> Expr:
        """Return K, ω/tan(ω dt/2), or 2/dt without a frequency."""
        if frequency is None:
            return 2 / self.dt
        if frequency not in self._warps:
            number = len(self._warps) + 1 if self._warps else ""
            warped = frequency / sympy.tan(frequency * self.dt / 2)
            self._warps[frequency] = self.signal(f"K{number}", warped, "1/s")
        return self._warps[frequency]

    def tustin(self, transfer: Expr, exact_at: Expr | None) -> Expr:
        """Return G discretised as a rational function of δ, written `s`."""
        if not transfer.has(s):
            return transfer
        return substituted(transfer, {s: self.warp(exact_at) * s / (s + 2)})

    def filter(
        self,
        transfer: Expr,
        entering: Expr,
        names: Sequence[str],
        unit: str,
        initial: Sequence[Expr] | None = None,
        exact_at: Expr | None = None,
    ) -> Expr:
        """Draw a transfer function; return its output.

        Its states, of the output's unit, are those of the observer form in δ; `initial` are their
        values at t = 0 (default 0).
        """
        if not names:
            return realise(transfer, entering, ()).output
        law = self.tustin(transfer, exact_at)
        begun = initial if initial is not None else [sympy.Integer(0)] * len(names)
        states = tuple(
            self.state(name, unit, value) for name, value in zip(names, begun, strict=True)
        )
        block = realise(law, entering, states)
        for state, change in zip(states, block.rates, strict=True):
            self.follow(state, state + change)
        self.filters.append(Filter(states, ratio(law).denominator, exact_at))
        return block.output

    def track(self, drawn: Filter, time: Expr, missed: Expr) -> None:
        """Let a filter follow what was sent instead of its output, `missed` more.

        x⁺ = A x + B m + L (v − u), L_i = binomial(n, i) λ^i − a_i, λ = 1 − e^(−dt/T): then all
        eigenvalues of A − L C are e^(−dt/T).
        """
        order, share = len(drawn.states), self.share(time)
        for i, (state, a) in enumerate(zip(drawn.states, drawn.denominator[1:], strict=True), 1):
            gain = sympy.binomial(order, i) * share**i - a
            self.follow(state, self.follows(state) + gain * missed)
