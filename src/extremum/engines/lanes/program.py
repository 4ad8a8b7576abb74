"""A system as a program that takes one step: what every ensemble engine runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

import sympy
from sympy import Expr, Symbol

from ...system import System
from .reading import Plain
from .tape import LOOP, STEP, UNIFORM, Operation, Tape
from .watch import Watch

FUNCTION: Final = 20
"""Operations of exp, sin and their like."""

_SIMPLE: Final = ("add", "subtract", "multiply", "divide", "sqrt")
_FREE: Final = (
    *("state", "time", "step", "part", "left", "negative", "absolute", "maximum", "minimum"),
    *("logarithm", "power of two", "finite"),
)


LIMITED: Final = (sympy.log, sympy.asin, sympy.acos, sympy.acosh, sympy.atanh)
"""Functions that have no value at some numbers."""


@dataclass(frozen=True)
class Stepped:
    """What a scheme records.

    Attributes
    ----------
    states
        The states after the step.
    part
        The length of the next step in units of H that keeps the tolerance; None: 1.
    means
        ∫ e dt/H over the step, of ``watch.mean``.
    last
        The same over the part of the step in the last window, of ``watch.last_mean``.
    maxima
        The largest value seen within the step, of ``watch.maxima``.
    beyond
        The last look at which e > 0, in units of H from the step's beginning, −1 if none; of
        ``watch.beyond``.
    """

    states: tuple[int, ...]
    part: int | None
    means: tuple[int, ...]
    last: tuple[int, ...]
    maxima: tuple[int, ...]
    beyond: tuple[int, ...]

    def outputs(self) -> tuple[int, ...]:
        """Return what is computed at every step; what the last window asks for is not."""
        return (*self.states, *self.means, *self.maxima, *self.beyond)


@dataclass(frozen=True)
class Program:
    """One step of a loop and how it begins; numbers name values on the tape.

    Leaves of the tape: ``value`` i is a parameter, ``state`` i; ``sine`` and ``cosine`` of
    oscillator i at the step's beginning; ``time`` there (s), and ``step``, the same in units of H,
    whole where every step has the length H; ``part`` the step's length in units of H, ``left`` the
    time from there to the last window in units of H; ``tol``; ``length`` is H where the caller
    says it.

    Attributes
    ----------
    tape
        The operations.
    start
        The states at t = 0.
    unit
        H (s).
    angles
        ωH of every oscillator.
    step
        The step.
    guards
        Not negative after the step while the field has a value there: every table is asked inside
        its data, no logarithm of what is negative. A step whose length is `part` is tried again
        with half of it, others end the loop.
    """

    tape: Tape
    start: tuple[int, ...]
    unit: int
    angles: tuple[int, ...]
    step: Stepped
    guards: tuple[int, ...]

    def flops(self) -> int:
        """Return about how many operations one step of one loop takes; a function counts as many.

        What does not vary from step to step is not computed at every step, and does not count.
        """
        part = () if self.step.part is None else (self.step.part,)
        wanted = self.tape.needed([*self.step.states, *part])
        operations = [self.tape.operations[value] for value in wanted]
        return sum(_flops(o) for o in operations if o.rate == STEP)


class Scheme(Protocol):
    """A way to take one step."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    @property
    def order(self) -> int:
        """The error is about (step)^order."""
        ...

    @property
    def paced(self) -> bool:
        """Whether H is the loop's own, 1/ω; otherwise it is the step and the caller's."""
        ...

    def steps(self, ground: Ground, watch: Watch) -> Stepped:
        """Record one step."""
        ...


@dataclass
class Ground:
    """A system's leaves on a tape: parameters, states, time and oscillators.

    Parameters
    ----------
    system
        The equations.
    swept
        The parameters that vary from loop to loop.
    paced
        Whether H = 1/ω, ω the first dither's frequency.
    """

    system: System
    swept: Sequence[int]
    paced: bool
    tape: Tape = field(default_factory=Tape)
    angles: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        tape, system = self.tape, self.system
        self.parameters = {
            symbol: tape.leaf("value", i, LOOP if i in self.swept else UNIFORM)
            for i, symbol in enumerate(system.symbols)
        }
        self.states = {x: tape.leaf("state", i, STEP) for i, x in enumerate(system.states)}
        self.time = tape.leaf("time", 0, STEP)
        self.part = tape.leaf("part", 0, STEP)
        symbols = frozenset(self.parameters)
        begun = None if system.dt is None else tape.constant(0.0)
        self.constants = Plain(tape, self.parameters, system.time, symbols, _timeless, begun)
        self.pace = 1 / system.carriers[0] if self.paced and system.carriers else None
        if system.dt is not None:
            self.unit = self.parameters[system.dt]
        elif self.pace is not None:
            self.unit = self.constants.read(self.pace)
        else:
            self.unit = tape.leaf("length", 0, LOOP)
        self._oscillators: dict[Expr, int] = {}

    def left(self) -> int:
        """Return the time from the step's beginning to the last window, in units of H."""
        return self.tape.leaf("left", 0, STEP)

    def oscillator(self, frequency: Expr) -> tuple[int, tuple[int, int]]:
        """Return ωH, and sin ωt and cos ωt at the step's beginning."""
        if frequency not in self._oscillators:
            self._oscillators[frequency] = len(self.angles)
            self.angles.append(self._angle(frequency))
        index = self._oscillators[frequency]
        sine, cosine = (self.tape.leaf(name, index, STEP) for name in ("sine", "cosine"))
        return self.angles[index], (sine, cosine)

    def _angle(self, frequency: Expr) -> int:
        if self.pace is not None:
            return self.constants.read(sympy.cancel(frequency * self.pace))
        return self.tape.multiply(self.constants.read(frequency), self.unit)

    def at(self, states: Sequence[int], fraction: int) -> Plain:
        """Return a reading of states at a fraction of H after t, with the signals bound."""
        tape = self.tape
        elapsed = tape.multiply(fraction, self.unit)

        def waves(frequency: Expr) -> tuple[int, int]:
            angle, (sine, cosine) = self.oscillator(frequency)
            if tape.known(fraction) == 0:
                return sine, cosine
            turned = tape.multiply(angle, fraction)
            s, c = tape.call("sin", turned), tape.call("cos", turned)
            return (
                tape.convolution([(sine, c), (cosine, s)]),
                tape.subtract(tape.multiply(cosine, c), tape.multiply(sine, s)),
            )

        bound: dict[Symbol, int] = {
            **self.parameters,
            **dict(zip(self.system.states, states, strict=True)),
            self.system.time: tape.add(self.time, elapsed),
        }
        step = None
        if self.system.dt is not None:
            step = tape.add(tape.leaf("step", 0, STEP), fraction)
        reading = Plain(tape, bound, self.system.time, frozenset(self.parameters), waves, step)
        for symbol, expression in self.system.signals:
            reading.bind(symbol, expression)
        return reading

    def guards(self, states: Sequence[int]) -> tuple[int, ...]:
        """Return what is negative after the step where the field has no value.

        Where the system says which signals are essential, only those count: difference equations
        say themselves what they make of a sample that is no number.
        """
        if self.system.guards:
            reading = self.at(states, self.tape.constant(1.0))
            return tuple(reading.read(guard) for guard in self.system.guards)
        limited = undefinable(self.system)
        if not limited:
            return ()
        reading = self.at(states, self.part if self.system.dt is None else self.tape.constant(1.0))
        return tuple(self.tape.call("finite", reading.read(symbol)) for symbol in limited)


def undefinable(system: System) -> list[Symbol]:
    """Return the signals that may have no value and end a loop then."""
    found = [symbol for symbol, e in system.signals if _is_limited(e)]
    essential = system.essential
    return found if essential is None else [symbol for symbol in found if symbol in essential]


def _is_limited(expression: Expr) -> bool:
    """Return whether there may be numbers at which an expression has no value."""
    powers = expression.atoms(sympy.Pow)
    return expression.has(*LIMITED) or any(not power.exp.is_Integer for power in powers)


def _timeless(frequency: Expr) -> tuple[int, int]:
    raise TypeError(f"a parameter depends on time: {frequency}")


def _flops(operation: Operation) -> int:
    if operation.name in _SIMPLE:
        return 1
    return 0 if operation.name in _FREE else FUNCTION


def program(system: System, swept: Sequence[int], scheme: Scheme, watch: Watch) -> Program:
    """Return one step of a system as a program; `swept` parameters vary from loop to loop."""
    ground = Ground(system, swept, scheme.paced)
    step = scheme.steps(ground, watch)
    start = tuple(ground.constants.read(e) for e in system.begun)
    guards = ground.guards(step.states)
    return Program(ground.tape, start, ground.unit, tuple(ground.angles), step, guards)
