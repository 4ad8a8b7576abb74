"""A tape's operations as Python statements that numba-cuda compiles.

Numbers are float32 or float64 throughout, those that are written out included: a double among
them would make a double of every result that depends on it. A product that is only added may be
fused with the addition, as on the CPU; nothing else is rearranged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from ..lanes.tape import Tape

MANTISSA: Final = {64: 52, 32: 23}
BIAS: Final = {64: 1023, 32: 127}


@dataclass
class Statements:
    """Writes values of a tape, each once, as assignments to local variables.

    Attributes
    ----------
    tape
        The values.
    prefix
        What the variables' names begin with.
    bits
        64 or 32.
    known
        The names of values that need no computing.
    literals
        Numbers in the text and their names: named once, they are compiled once.
    """

    tape: Tape
    prefix: str
    bits: int
    known: dict[int, str] = field(default_factory=dict)
    literals: dict[float, str] = field(default_factory=dict)

    @property
    def number(self) -> str:
        """The type's name in the text."""
        return f"float{self.bits}"

    def literal(self, number: float) -> str:
        """Return the name of a number of the type."""
        return self.literals.setdefault(number, f"{self.prefix}number{len(self.literals)}")

    def named(self) -> list[str]:
        """Return what gives the numbers their names."""
        return [f"{name} = {self.number}({k!r})" for k, name in self.literals.items()]

    def name(self, value: int) -> str:
        """Return a value as an operand."""
        number = self.tape.known(value)
        return self.known[value] if number is None else self.literal(number)

    def computed(self, values: Iterable[int]) -> list[str]:
        """Return what computes those of the values that are not known yet."""
        lines: list[str] = []
        for value in values:
            if value in self.known or self.tape.known(value) is not None:
                continue
            operation = self.tape.operations[value]
            if operation.name not in _FORMS:
                raise TypeError(f"the tape has an operation without a statement: {operation.name}")
            operands = [self.name(operand) for operand in operation.operands]
            self.known[value] = f"{self.prefix}{value}"
            lines.append(f"{self.known[value]} = {_FORMS[operation.name](self, *operands)}")
        return lines


def _called(name: str) -> Callable[..., str]:
    return lambda text, *operands: f"{text.number}(math.{name}({', '.join(operands)}))"


def _logarithm(text: Statements, a: str, b: str) -> str:
    """Return log₂(a/b) within 0.09: a number's bits, read as an integer, are nearly that."""
    whole, scale = f"int{text.bits}", text.literal(2.0 ** -MANTISSA[text.bits])
    return f"{text.number}({whole}({a}.view({whole}) - {b}.view({whole}))) * {scale}"


def _power(text: Statements, x: str) -> str:
    """Return 2^x within 6 per cent."""
    scale = 2.0 ** MANTISSA[text.bits]
    bits = f"cuda.fma({x}, {text.literal(scale)}, {text.literal(BIAS[text.bits] * scale)})"
    return f"int{text.bits}({bits}).view({text.number})"


def _unit(text: Statements, x: str) -> str:
    zero, one = text.literal(0.0), text.literal(1.0)
    return f"({zero} if {x} < {zero} else {one} if {x} > {one} else {x})"


_FORMS: Final[Mapping[str, Callable[..., str]]] = {
    "add": lambda _, a, b: f"{a} + {b}",
    "subtract": lambda _, a, b: f"{a} - {b}",
    "multiply": lambda _, a, b: f"{a} * {b}",
    "divide": lambda _, a, b: f"{a} / {b}",
    "negative": lambda _, a: f"-{a}",
    "absolute": lambda _, a: f"abs({a})",
    "maximum": lambda _, a, b: f"{a} if {a} > {b} else {b}",
    "minimum": lambda _, a, b: f"{a} if {a} < {b} else {b}",
    "unit": _unit,
    "finite": lambda text, x: (
        f"{text.literal(1.0)} if {x} - {x} == {text.literal(0.0)} else {text.literal(-1.0)}"
    ),
    "positive": lambda text, x, a, b: f"{a} if {x} > {text.literal(0.0)} else {b}",
    "logarithm": _logarithm,
    "power of two": _power,
    **{name: _called(name) for name in ("sqrt", "exp", "log", "pow", "sin", "cos", "tan")},
    **{name: _called(name) for name in ("asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh")},
    **{name: _called(name) for name in ("asinh", "acosh", "atanh")},
}
