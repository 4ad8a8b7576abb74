"""A straight-line program: every value computed once, and no more often than it varies.

The engines print it: as vector instructions, as Python for a GPU.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from typing import Final

UNIFORM: Final = 0
LOOP: Final = 1
STEP: Final = 2
"""What a value varies with: with nothing; with the loop; with every step of a loop."""


@dataclass(frozen=True, slots=True)
class Operation:
    """One value: an operation and its operands, which come before it on the tape.

    `name` is an operation, a function's name, ``"constant"``, or a leaf (see `program`), whose
    index is `number`.
    """

    name: str
    operands: tuple[int, ...] = ()
    number: float = 0.0
    rate: int = UNIFORM


class Tape:
    """Records operations; equal ones are recorded once, and what is known is computed at once.

    An exact zero times anything is zero here, whatever the other factor becomes: it is structure.
    """

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._known: dict[tuple[str, tuple[int, ...], float], int] = {}

    def rate(self, value: int) -> int:
        """Return what a value varies with: `UNIFORM`, `LOOP` or `STEP`."""
        return self.operations[value].rate

    def constant(self, number: float) -> int:
        """Record a number."""
        return self._record("constant", (), float(number), UNIFORM)

    def leaf(self, name: str, index: int, rate: int) -> int:
        """Record what the program is given."""
        return self._record(name, (), float(index), rate)

    def known(self, value: int) -> float | None:
        """Return the number that a value always is, None if it is computed."""
        operation = self.operations[value]
        return operation.number if operation.name == "constant" else None

    def add(self, a: int, b: int) -> int:
        """Record a + b."""
        x, y = self.known(a), self.known(b)
        if x is not None and y is not None:
            return self.constant(x + y)
        if x == 0 or y == 0:
            return b if x == 0 else a
        for one, other in ((a, b), (b, a)):
            if self.operations[other].name == "negative":
                return self.subtract(one, self.operations[other].operands[0])
        return self._compute("add", *sorted((a, b)))

    def subtract(self, a: int, b: int) -> int:
        """Record a − b."""
        x, y = self.known(a), self.known(b)
        if x is not None and y is not None:
            return self.constant(x - y)
        if y == 0:
            return a
        if x == 0:
            return self.negative(b)
        if self.operations[b].name == "negative":
            return self.add(a, self.operations[b].operands[0])
        return self._compute("subtract", a, b)

    def multiply(self, a: int, b: int) -> int:
        """Record a b."""
        x, y = self.known(a), self.known(b)
        if x is not None and y is not None:
            return self.constant(x * y)
        if x == 0 or y == 0:
            return self.constant(0.0)
        for number, other in ((x, b), (y, a)):
            if number is not None and abs(number) == 1:
                return other if number == 1 else self.negative(other)
        return self._compute("multiply", *sorted((a, b)))

    def divide(self, a: int, b: int) -> int:
        """Record a/b."""
        x, y = self.known(a), self.known(b)
        if y is not None and y != 0:
            return self.multiply(a, self.constant(1 / y))
        if x == 0:
            return self.constant(0.0)
        return self._compute("divide", a, b)

    def negative(self, a: int) -> int:
        """Record −a."""
        known = self.known(a)
        if known is not None:
            return self.constant(-known)
        operation = self.operations[a]
        if operation.name == "negative":
            return operation.operands[0]
        return self._compute("negative", a)

    def call(self, name: str, *operands: int) -> int:
        """Record a function's value."""
        numbers = [self.known(a) for a in operands]
        if name in _FOLDED and None not in numbers:
            try:
                return self.constant(_FOLDED[name](*numbers))
            except (ValueError, OverflowError, ZeroDivisionError):
                pass  # NaN or infinite: left to the engine
        return self._compute(name, *operands)

    def total(self, values: Iterable[int]) -> int:
        """Record a sum, of what varies least first."""
        return reduce(self.add, sorted(values, key=self.rate), self.constant(0.0))

    def product(self, values: Iterable[int]) -> int:
        """Record a product, of what varies least first."""
        return reduce(self.multiply, sorted(values, key=self.rate), self.constant(1.0))

    def convolution(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Record Σ a b, added up in the order given: what is known last should come last."""
        result = self.constant(0.0)
        for a, b in pairs:
            result = self.add(result, self.multiply(a, b))
        return result

    def needed(self, outputs: Iterable[int]) -> list[int]:
        """Return the values that the outputs depend on, themselves included, in order."""
        wanted = set(outputs)
        for value in range(max(wanted, default=-1), -1, -1):
            if value in wanted:
                wanted.update(self.operations[value].operands)
        return sorted(wanted)

    def _compute(self, name: str, *operands: int) -> int:
        rate = max(self.operations[operand].rate for operand in operands)
        return self._record(name, operands, 0.0, rate)

    def _record(self, name: str, operands: tuple[int, ...], number: float, rate: int) -> int:
        key = (name, operands, number)
        if key not in self._known:
            self._known[key] = len(self.operations)
            self.operations.append(Operation(name, operands, number, rate))
        return self._known[key]


_FUNCTIONS: Final = (
    *("exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "pow"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)

_FOLDED: Final = {
    **{name: getattr(math, name) for name in _FUNCTIONS},
    "absolute": abs,
    "maximum": lambda a, b: a if a > b else b,
    "minimum": lambda a, b: a if a < b else b,
    "positive": lambda x, a, b: a if x > 0 else b,
}
