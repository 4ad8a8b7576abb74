"""SymPy expressions read into a tape: plainly, or as power series (see `series`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import sympy
from sympy import Expr, Symbol
from sympy.core.function import AppliedUndef

from ...logic import normal, uniform
from .tape import Tape

V = TypeVar("V")

Waves = Callable[[Expr], tuple[int, int]]


class Reading(ABC, Generic[V]):
    """Reads expressions into values of some kind, each subexpression once.

    Parameters
    ----------
    tape
        Where the operations are recorded.
    bound
        What the symbols are.
    time
        The symbol of time.
    parameters
        The symbols that are constant; sin(a t + b) is an oscillator's if a is made of them.
    """

    def __init__(
        self, tape: Tape, bound: Mapping[Symbol, V], time: Symbol, parameters: frozenset[Symbol]
    ) -> None:
        self.tape, self.time, self.parameters = tape, time, parameters
        self._read: dict[Any, V] = dict(bound)

    def bind(self, symbol: Symbol, expression: Expr) -> None:
        """Let a symbol stand for an expression."""
        self._read[symbol] = self.read(expression)

    def read(self, expression: Any) -> V:
        """Return the value of an expression."""
        if expression not in self._read:
            self._read[expression] = self._fresh(expression)
        return self._read[expression]

    def _fresh(self, expression: Any) -> V:
        if expression.is_Number or expression.is_NumberSymbol:
            return self.number(float(expression))
        if expression.is_Add:
            return self.total([self.read(term) for term in expression.args])
        if expression.is_Mul:
            return self.product([self.read(factor) for factor in expression.args])
        if isinstance(expression, sympy.exp):  # before Pow: e^x is printed as one
            return self.call("exp", [self.read(expression.args[0])])
        if expression.is_Pow:
            return self._power(expression.base, expression.exp)
        if isinstance(expression, sympy.sin | sympy.cos):
            wave = _wave(expression.args[0], self.time)
            if wave is not None and wave[0].free_symbols <= self.parameters:
                return self._shifted(type(expression) is sympy.sin, *wave)
        if isinstance(expression, AppliedUndef):
            arguments = [self.read(a) for a in expression.args]
            return self.oracle(expression.func.__name__, arguments)
        if isinstance(expression, normal | uniform):
            return self.random(expression)
        if expression.is_Function:
            return self.call(type(expression).__name__, [self.read(a) for a in expression.args])
        raise TypeError(f"no engine has {expression}, a {type(expression).__name__}")

    def _shifted(self, is_sine: bool, frequency: Expr, phase: Expr) -> V:
        """Return sin(ωt + φ) or its cosine, as a sum of the oscillator's two."""
        sine, cosine = self.oscillator(frequency)
        if phase == 0:
            return sine if is_sine else cosine
        s, c = (self.read(f(phase)) for f in (sympy.sin, sympy.cos))
        if is_sine:
            return self.total([self.product([c, sine]), self.product([s, cosine])])
        minus = self.number(-1.0)
        return self.total([self.product([c, cosine]), self.product([minus, s, sine])])

    def _power(self, base: Expr, exponent: Expr) -> V:
        if exponent.is_Integer:
            whole = self._whole(self.read(base), abs(int(exponent)))
            return whole if exponent.is_positive else self.reciprocal(whole)
        if exponent == sympy.Rational(1, 2):
            return self.call("sqrt", [self.read(base)])
        if exponent == -sympy.Rational(1, 2):
            return self.reciprocal(self.read(sympy.sqrt(base)))
        return self.call("pow", [self.read(base), self.read(exponent)])

    def _whole(self, base: V, exponent: int) -> V:
        if exponent == 1:
            return base
        half = self._whole(base, exponent // 2)
        square = self.square(half)
        return self.product([square, base]) if exponent % 2 else square

    def random(self, expression: Expr) -> V:
        """Return a random number."""
        raise TypeError(
            f"only the samples of difference equations have random numbers: {expression}"
        )

    @abstractmethod
    def number(self, number: float) -> V:
        """Return a number."""

    @abstractmethod
    def total(self, values: Sequence[V]) -> V:
        """Return a sum."""

    @abstractmethod
    def product(self, values: Sequence[V]) -> V:
        """Return a product."""

    @abstractmethod
    def square(self, value: V) -> V:
        """Return a square."""

    @abstractmethod
    def reciprocal(self, value: V) -> V:
        """Return 1 over a value."""

    @abstractmethod
    def call(self, name: str, arguments: Sequence[V]) -> V:
        """Return a function's value."""

    @abstractmethod
    def oscillator(self, frequency: Expr) -> tuple[V, V]:
        """Return sin ωt and cos ωt."""

    @abstractmethod
    def oracle(self, name: str, arguments: Sequence[V]) -> V:
        """Return a tabulated function's value."""


def _wave(angle: Any, time: Symbol) -> tuple[Expr, Expr] | None:
    """Return ω and φ of an angle ωt + φ, neither depending on t; None if it is no such angle."""
    if not angle.has(time):
        return None
    frequency = angle.diff(time)
    phase = sympy.expand(angle - frequency * time)
    if frequency.has(time) or phase.has(time):
        return None
    return frequency, phase


class Plain(Reading[int]):
    """Reads expressions into single values of the tape.

    Parameters
    ----------
    oscillators
        ω → (sin ωt, cos ωt) at this reading's time.
    step
        The number of the step that this is read at, on which random numbers depend; None where
        there are none.
    """

    def __init__(
        self,
        tape: Tape,
        bound: Mapping[Symbol, int],
        time: Symbol,
        parameters: frozenset[Symbol],
        oscillators: Waves,
        step: int | None = None,
    ) -> None:
        super().__init__(tape, bound, time, parameters)
        self._oscillators, self._step = oscillators, step

    def random(self, expression: Expr) -> int:
        """Record a random number of the step."""
        if self._step is None:
            return super().random(expression)
        seed, stream = expression.args
        if not (isinstance(stream, sympy.Integer) and stream >= 0):
            raise TypeError(f"a stream of random numbers is 0, 1, 2, …: {expression}")
        which = self.tape.constant(int(stream))
        return self.tape.call(type(expression).__name__, self.read(seed), self._step, which)

    def number(self, number: float) -> int:
        """Record a number."""
        return self.tape.constant(number)

    def total(self, values: Sequence[int]) -> int:
        """Record a sum."""
        return self.tape.total(values)

    def product(self, values: Sequence[int]) -> int:
        """Record a product."""
        return self.tape.product(values)

    def square(self, value: int) -> int:
        """Record a square."""
        return self.tape.multiply(value, value)

    def reciprocal(self, value: int) -> int:
        """Record 1 over a value."""
        return self.tape.divide(self.tape.constant(1.0), value)

    def call(self, name: str, arguments: Sequence[int]) -> int:
        """Record a function's value."""
        return self.tape.call(name, *arguments)

    def oscillator(self, frequency: Expr) -> tuple[int, int]:
        """Return sin ωt and cos ωt."""
        return self._oscillators(frequency)

    def oracle(self, name: str, arguments: Sequence[int]) -> int:
        """Record a tabulated function's value."""
        return self.tape.call(f"table {name}", *arguments)
