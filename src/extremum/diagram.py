"""Block diagrams: what a vehicle and a controller are, before they are given states.

A controller states its diagram once, with filters and oscillators as blocks. A `Diagram` turns
blocks into states as they are drawn: this one into differential equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import sympy
from sympy import Expr, Symbol

from .lti import realise
from .rational import response_parts
from .symbols import cosine, s, sine, t

RESERVED: Final = frozenset(("position", "input", "source", "sensor", "time", "axis", "t", "s"))
"""Names that results and expressions give a meaning to."""


class Motion(NamedTuple):
    """An axis' probe: α sin(ωt + φ) through 1/G.

    `through` is G, None for the axis' own, whose position then moves as α sin(ωt + φ).
    """

    amplitude: Any
    frequency: Any
    phase: Any
    through: Expr | None


def per_second(unit: str, count: int) -> str:
    """Return a unit divided by s^count: m, m/s, m/s^2, …."""
    if not count:
        return unit
    base, _, power = unit.partition("/s")
    total = count + (int(power.lstrip("^") or 1) if "/s" in unit else 0)
    return f"{base}/s" if total == 1 else f"{base}/s^{total}"


class Diagram:
    """Collects states and signals; draws each transfer function as ẋ = A x + B u, y = C x + D u."""

    def __init__(self) -> None:
        self.states: list[Symbol] = []
        self.rhs: list[Expr] = []
        self.initial: list[Expr] = []
        self.signals: list[tuple[Symbol, Expr]] = []
        self.units: dict[Symbol, str] = {}
        self.carriers: list[Expr] = []

    def signal(self, name: str, expression: Expr, unit: str) -> Symbol:
        """Name an expression and return its symbol."""
        symbol = Symbol(name, real=True)
        self.signals.append((symbol, expression))
        self._add(symbol, unit)
        return symbol

    def _add(self, symbol: Symbol, unit: str) -> None:
        if symbol in self.units or symbol.name in RESERVED:
            raise ValueError(f"the name {symbol} is taken; a state or signal needs one of its own")
        self.units[symbol] = unit

    def filter(
        self,
        transfer: Expr,
        entering: Expr,
        names: Sequence[str],
        unit: str,
        initial: Sequence[Expr] | None = None,
        exact_at: Expr | None = None,
    ) -> Expr:
        """Draw a transfer function; return its output, whose unit is `unit`.

        `names` name its states, the first of which has the output's unit, the next that per second
        and so on; `initial` are their values at t = 0 (default 0). `exact_at` is the frequency
        (rad/s) at which a diagram that approximates must not.
        """
        states = tuple(Symbol(name, real=True) for name in names)
        block = realise(transfer, entering, states)
        self.states += states
        self.rhs += block.rates
        self.initial += initial if initial is not None else [sympy.Integer(0)] * len(states)
        for index, state in enumerate(states):
            self._add(state, per_second(unit, index))
        return block.output

    def washout(self, corner: Expr, signal: Symbol, start: Expr, frequency: Expr) -> Symbol:
        """Draw ξ = s/(s + h)[J] as J − η, η = h/(s + h)[J], η(0) = `start`; return ξ.

        `frequency` is the one (rad/s) at which it must be exact.
        """
        eta = self.filter(corner / (s + corner), signal, ["eta"], "1", [start], frequency)
        return self.signal("xi", signal - eta, "1")

    def reference(self, frequency: Expr, phase: Expr | float) -> Expr:
        """Draw what demodulates; return sin(ωt + ψ)."""
        return self.sine(frequency, phase)

    def envelope(self, ramp: Expr | None) -> Expr:
        """Draw what the probe is multiplied by; return 1 − e^(−t/T), T = `ramp`, 1 without it."""
        return sympy.Integer(1) if ramp is None else 1 - sympy.exp(-t / ramp)

    def sine(self, frequency: Expr, phase: Expr | float, response: Expr | None = None) -> Expr:
        """Draw an oscillator; return sin(ωt + φ) after the transfer function `response`.

        In the steady state that is Re R(jω) sin(ωt + φ) + Im R(jω) cos(ωt + φ).
        """
        if frequency not in self.carriers:
            self.carriers.append(frequency)
        angle = frequency * t
        if response is None:
            return sine(angle, phase)
        real, imaginary = response_parts(response, frequency)
        return real * sine(angle, phase) + imaginary * cosine(angle, phase)
