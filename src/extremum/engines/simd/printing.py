"""A tape's operations as an emitter's instructions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, Self

from ..lanes.tape import Operation, Tape
from .arithmetic import BIAS, MANTISSA
from .emitter import Emitter
from .mathematics import FUNCTIONS
from .random import RANDOM


class Names(dict[int, str]):
    """The names of a tape's values in a function; what is missing is fetched when first asked for.

    Parameters
    ----------
    tape
        The values.
    known
        Names to begin with.
    fallback
        Writes what makes a missing value available.
    """

    def __init__(
        self,
        tape: Tape,
        known: Mapping[int, str] | None = None,
        fallback: Callable[[int], str] | None = None,
    ) -> None:
        super().__init__(known or {})
        self.tape, self.fallback = tape, fallback

    def __missing__(self, value: int) -> str:
        if self.fallback is None:
            raise KeyError(value)
        self[value] = self.fallback(value)
        return self[value]

    def copy(self) -> Self:
        """Return the same names, to which others can be added."""
        return type(self)(self.tape, self, self.fallback)

    def operand(self, emitter: Emitter, value: int) -> str:
        """Return a value as an instruction's operand."""
        number = self.tape.known(value)
        return self[value] if number is None else emitter.constant(number)


def spread(emitter: Emitter, number: str) -> str:
    """Return one number in every lane."""
    if emitter.width == 1:
        return number
    first = emitter.value(f"insertelement {emitter.type} poison, {emitter.element} {number}, i64 0")
    lanes = f"<{emitter.width} x i32> zeroinitializer"
    return emitter.value(f"shufflevector {emitter.type} {first}, {emitter.type} poison, {lanes}")


def printed(
    emitter: Emitter,
    operation: Operation,
    names: Names,
    tables: Mapping[str, Callable[..., str]] = MappingProxyType({}),
) -> str:
    """Write an operation, one of `tables` if it is named there; return the name of its result."""
    name = operation.name
    if name == "constant":
        return emitter.constant(operation.number)
    if name in RANDOM:
        *given, stream = operation.operands
        which = names.tape.known(stream)
        assert which is not None
        return RANDOM[name](emitter, *(names.operand(emitter, v) for v in given), int(which))
    operands = [names.operand(emitter, value) for value in operation.operands]
    known = tables.get(name) or _DIRECT.get(name) or FUNCTIONS.get(name, _unknown)
    return known(emitter, *operands)


def _unknown(emitter: Emitter, *operands: str) -> str:
    raise TypeError("the tape has an operation that no instruction is known for")


def _logarithm(emitter: Emitter, a: str, b: str) -> str:
    """Return log₂(a/b) of positive numbers within 0.09; large for ∞ and NaN.

    The bits of a number, read as an integer, are its logarithm but for the curvature of the
    mantissa.
    """
    bits = emitter.integral("sub", emitter.as_bits(a), emitter.as_bits(b))
    return emitter.multiply(
        emitter.to_number(bits), emitter.constant(2.0 ** -MANTISSA[emitter.bits])
    )


def _power(emitter: Emitter, x: str) -> str:
    """Return 2^x within 6 per cent for results that are neither too small nor too large."""
    scale = emitter.constant(2.0 ** MANTISSA[emitter.bits])
    offset = emitter.constant(BIAS[emitter.bits] * 2.0 ** MANTISSA[emitter.bits])
    result = emitter.fma(x, scale, offset)
    return emitter.from_bits(emitter.value(f"fptosi {emitter.type} {result} to {emitter.integers}"))


def _larger(emitter: Emitter, a: str, b: str) -> str:
    """Return a where a > b, else b."""
    return emitter.select(emitter.compare("ogt", a, b), a, b)


def _smaller(emitter: Emitter, a: str, b: str) -> str:
    """Return a where a < b, else b."""
    return emitter.select(emitter.compare("olt", a, b), a, b)


def _unit(emitter: Emitter, x: str) -> str:
    """Return x cut to 0 … 1."""
    return _smaller(emitter, _larger(emitter, x, emitter.constant(0.0)), emitter.constant(1.0))


def _finite(emitter: Emitter, x: str) -> str:
    """Return 1 for numbers, −1 for ±∞ and NaN."""
    known = emitter.compare("oeq", emitter.subtract(x, x), emitter.constant(0.0))
    return emitter.select(known, emitter.constant(1.0), emitter.constant(-1.0))


def _positive(emitter: Emitter, x: str, a: str, b: str) -> str:
    """Return a where x > 0, else b."""
    return emitter.select(emitter.compare("ogt", x, emitter.constant(0.0)), a, b)


_DIRECT: Final[Mapping[str, Callable[..., str]]] = {
    "add": Emitter.add,
    "subtract": Emitter.subtract,
    "multiply": Emitter.multiply,
    "divide": Emitter.divide,
    "negative": Emitter.negative,
    "absolute": Emitter.absolute,
    "maximum": _larger,
    "minimum": _smaller,
    "logarithm": _logarithm,
    "power of two": _power,
    "unit": _unit,
    "finite": _finite,
    "positive": _positive,
    "nearest": Emitter.rounded,
}
