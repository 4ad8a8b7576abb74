"""A discrete controller as a machine: a straight line of operations with its numbers put in.

Every export prints this line, in its order: that is why they agree to the last bit. The only thing
beside it are the oscillators' phases, counted in 2⁻⁶⁴ turns: they neither drift nor lose digits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from math import isfinite, lcm
from typing import Any, Final

import sympy
from sympy import Expr, Symbol

from ..engines.lanes.reading import Plain
from ..engines.lanes.tape import STEP, Tape
from ..errors import InvalidDescription
from ..system import System

TURN: Final = 2**64
"""Of the phases' counts."""

OPERATIONS: Final = (
    *("add", "subtract", "multiply", "divide", "negative"),
    *("absolute", "maximum", "minimum", "positive", "sqrt", "log"),
)
"""What a machine computes with."""

TERMS: Final = {64: 8, 32: 5}
"""Of the sine's polynomial: an error of 2e-16, or 7e-9."""


@dataclass(frozen=True)
class Oscillator:
    """A phase that grows by `increment`·2⁻⁶⁴ turns a sample.

    Attributes
    ----------
    name
        Of the state that counts it, modulo 2⁶⁴.
    increment
        round(ω dt/2π · 2⁶⁴); exact multiples of each other where the frequencies are.
    """

    name: str
    increment: int


@dataclass(frozen=True, eq=False)
class Machine:
    """One step of a discrete controller; numbers name values on the tape.

    Leaves of the tape: ``sample`` 0, J as it came; ``state`` i; ``turn`` i, the phase of oscillator
    i at the step's beginning as a signed share of a turn, −½ … ½.

    Attributes
    ----------
    dt
        The time between two samples (s).
    precision
        Bits of a number, 64 or 32: what the sine's polynomial is made for.
    tape
        The operations.
    oscillators
        The phases.
    states, start, following
        The other states' names, their values by `init`, which knows the first sample, and after a
        step.
    output_names, outputs
        What is sent.
    clocks
        The states (by place) that count samples up to 2²⁴, also while no step is taken.
    units
        Name → unit, of states and outputs.
    signals
        Value → what it is: a signal of the equations, or an oscillator's sine or cosine.
    """

    dt: float
    precision: int
    tape: Tape
    oscillators: tuple[Oscillator, ...]
    states: tuple[str, ...]
    start: tuple[int, ...]
    following: tuple[int, ...]
    output_names: tuple[str, ...]
    outputs: tuple[int, ...]
    clocks: tuple[int, ...]
    units: Mapping[str, str]
    signals: Mapping[int, str]

    def needed(self) -> list[int]:
        """Return the values of a step, in order."""
        return self.tape.needed([*self.following, *self.outputs])


def machine(
    system: System,
    values: Sequence[float],
    dt: float,
    given: Mapping[Symbol, Expr],
    precision: int = 64,
) -> Machine:
    """Return the machine of a discrete controller's equations, their numbers put in.

    Parameters
    ----------
    given
        States that start otherwise where the first sample is known.
    """
    return _Builder(system, values, dt, precision).built(given)


class _Builder:
    def __init__(self, system: System, values: Sequence[float], dt: float, precision: int) -> None:
        self.system, self.dt, self.precision, self.tape = system, dt, precision, Tape()
        self.numbers = dict(zip(system.symbols, values, strict=True))
        self.turns = _increments(system, self.numbers, dt)
        self.waves: dict[Expr, tuple[int, int]] = {}
        self.said: dict[int, str] = {}

    def built(self, given: Mapping[Symbol, Expr]) -> Machine:
        system, tape = self.system, self.tape
        states = {x: tape.leaf("state", i, STEP) for i, x in enumerate(system.states)}
        sample = tape.leaf("sample", 0, STEP)
        parameters = {x: tape.constant(number) for x, number in self.numbers.items()}

        def reading(states: Mapping[Symbol, int]) -> Plain:
            bound = {**parameters, **states, system.inputs[0]: sample}
            made = Plain(tape, bound, system.time, frozenset(parameters), self.wave)
            for symbol, expression in system.signals:
                made.bind(symbol, expression)
            return made

        try:
            plain = Plain(tape, parameters, system.time, frozenset(parameters), self.wave)
            initial = {x: plain.read(e) for x, e in zip(system.states, system.initial, strict=True)}
            begun, step = reading(initial), reading(states)
            start = [begun.read(given[x]) if x in given else initial[x] for x in system.states]
            following = [step.read(e) for e in system.rhs]
            outputs = [step.read(e) for e in system.outputs["input"]]
        except TypeError as error:
            raise InvalidDescription(
                "controller", f"cannot run on samples: {error}; only sin(ωt + φ) may depend on time"
            ) from None
        self._check([*start, *following, *outputs])
        names = tuple(str(x) for x in system.states)
        commands = tuple(str(x) for x in system.outputs["input"])
        units = {str(x): unit for x, unit in system.units.items()}
        return Machine(
            dt=self.dt,
            precision=self.precision,
            tape=tape,
            oscillators=tuple(
                Oscillator(self.phase(i), n) for i, n in enumerate(self.turns.values())
            ),
            states=names,
            start=tuple(start),
            following=tuple(following),
            output_names=commands,
            outputs=tuple(outputs),
            clocks=tuple(i for i, name in enumerate(names) if name == "age"),
            units={name: units[name] for name in (*names, *commands)},
            signals=self.said | {step.read(x): str(x) for x, _ in system.signals},
        )

    def _check(self, wanted: list[int]) -> None:
        """Refuse numbers that cannot be computed with."""
        for value in self.tape.needed(wanted):
            operation = self.tape.operations[value]
            known = operation.name in OPERATIONS or not operation.operands
            if not known or not isfinite(operation.number):
                raise InvalidDescription(
                    "controller",
                    "has numbers so large or so small that a step cannot be computed: gains, "
                    "frequencies, time constants, delays and dt must lie within about 1e±150 of "
                    "each other",
                )

    def phase(self, index: int) -> str:
        """Return an oscillator's name."""
        return f"phase_{index + 1}" if len(self.turns) > 1 else "phase"

    def wave(self, frequency: Expr) -> tuple[int, int]:
        """Return sin ωt and cos ωt from the oscillator's phase."""
        if frequency not in self.waves:
            if frequency not in self.turns:
                raise TypeError(f"sin({frequency} t) is no oscillator of the diagram")
            tape, turn = self.tape, self.tape.leaf("turn", list(self.turns).index(frequency), STEP)
            quarter, half = tape.constant(0.25), tape.constant(0.5)
            above, below = tape.subtract(half, turn), tape.subtract(tape.negative(half), turn)
            inner = tape.call("positive", tape.subtract(tape.constant(-0.25), turn), below, turn)
            folded = tape.call("positive", tape.subtract(turn, quarter), above, inner)
            turned = tape.subtract(quarter, tape.call("absolute", turn))
            self.waves[frequency] = sine, cosine = self._sine(folded), self._sine(turned)
            name = self.phase(list(self.turns).index(frequency))
            self.said |= {sine: f"sin of {name}", cosine: f"cos of {name}"}
        return self.waves[frequency]

    def _sine(self, turn: int) -> int:
        """Return sin 2πx, |x| ≤ ¼, as x P(x²)."""
        tape = self.tape
        square = tape.multiply(turn, turn)
        *lower, result = (tape.constant(c) for c in polynomial(self.precision))
        for coefficient in reversed(lower):
            result = tape.add(coefficient, tape.multiply(result, square))
        return tape.multiply(turn, result)


@cache
def polynomial(precision: int) -> tuple[float, ...]:
    """Return P, lowest power first, with x P(x²) ≈ sin 2πx on |x| ≤ ¼: a Chebyshev interpolant."""
    import mpmath

    with mpmath.workdps(40):
        edge = mpmath.mpf(1) / 16

        def even(z: Any) -> Any:
            root = mpmath.sqrt(z)
            return mpmath.sin(2 * mpmath.pi * root) / root

        found = mpmath.chebyfit(even, [0, edge], TERMS[precision])
        return tuple(float(c) for c in reversed(found))  # pyright: ignore[reportArgumentType, reportCallIssue]


def _increments(system: System, numbers: Mapping[Symbol, float], dt: float) -> dict[Expr, int]:
    """Return every oscillator's increment; rational multiples of the first one's stay exact."""
    carriers = system.carriers
    if not carriers:
        return {}
    ratios: list[Any] = [sympy.cancel(carrier / carriers[0]) for carrier in carriers]
    whole = [ratio for ratio in ratios if ratio.is_Rational]
    parts = lcm(*(int(ratio.q) for ratio in whole))
    unit = _count(_number(carriers[0], numbers), dt, parts)
    return {
        carrier: unit * int(ratio * parts) % TURN
        if ratio.is_Rational
        else _count(_number(carrier, numbers), dt, 1) % TURN
        for carrier, ratio in zip(carriers, ratios, strict=True)
    }


def _number(expression: Expr, numbers: Mapping[Symbol, float]) -> Fraction:
    exact: dict[Any, Any] = {x: sympy.Rational(number) for x, number in numbers.items()}
    value: Any = expression.xreplace(exact)
    return Fraction(int(value.p), int(value.q)) if value.is_Rational else Fraction(float(value))


@lru_cache(maxsize=256)
def _count(frequency: Fraction, dt: float, parts: int) -> int:
    """Return ω dt/(2π parts) turns in units of 2⁻⁶⁴ turn, rounded."""
    import mpmath

    with mpmath.workdps(60):
        angle = frequency * Fraction(dt) / parts
        turns = mpmath.mpf(angle.numerator) / angle.denominator / (2 * mpmath.pi)
        return int(mpmath.nint(turns * TURN))
