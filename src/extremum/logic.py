"""What sampled equations decide and draw by chance: choices, limits and random numbers.

SymPy's own relations may be turned round or negated, which changes what they say of NaN. These
functions stay as they are written: each is an operation of the engines, with the same name.
"""

from __future__ import annotations

from typing import Any, ClassVar

import sympy
from sympy import Expr


class _Operation(sympy.Function):
    """A function that is an operation of the engines."""

    def __new__(cls, *operands: Any) -> Any:
        return super().__new__(cls, *operands)


class _Choice(_Operation):
    """One of two operands: the second of `parts` where the first holds, else the third."""

    parts: ClassVar[tuple[str, str, str]]

    def _chosen(self, printer: Any) -> list[str]:
        operands = [printer._print(operand) for operand in self.args]
        return [part.format(*operands) for part in self.parts]

    def _numpycode(self, printer: Any) -> str:
        condition, a, b = self._chosen(printer)
        return f"numpy.where({condition}, {a}, {b})"

    def _pythoncode(self, printer: Any) -> str:
        condition, a, b = self._chosen(printer)
        return f"(({a}) if {condition} else ({b}))"


class positive(_Choice):  # noqa: N801 - printed in equations
    """positive(x, a, b) is a where x > 0, else b, also where x is NaN."""

    nargs = 3
    parts = ("({0}) > 0", "{1}", "{2}")


class maximum(_Choice):  # noqa: N801
    """maximum(a, b) is a where a > b, else b, also where a is NaN."""

    nargs = 2
    parts = ("({0}) > ({1})", "{0}", "{1}")


class minimum(_Choice):  # noqa: N801
    """minimum(a, b) is a where a < b, else b, also where a is NaN."""

    nargs = 2
    parts = ("({0}) < ({1})", "{0}", "{1}")


class absolute(_Operation):  # noqa: N801
    """absolute(x) is |x|."""

    nargs = 1

    def _numpycode(self, printer: Any) -> str:
        return f"numpy.absolute({printer._print(self.args[0])})"

    def _pythoncode(self, printer: Any) -> str:
        return f"abs({printer._print(self.args[0])})"


class nearest(_Operation):  # noqa: N801
    """nearest(x) is the whole number next to x, of two the even one."""

    nargs = 1

    def _numpycode(self, printer: Any) -> str:
        return f"numpy.rint({printer._print(self.args[0])})"

    def _pythoncode(self, printer: Any) -> str:
        return f"float(round({printer._print(self.args[0])}))"


class normal(_Operation):  # noqa: N801
    """normal(seed, i) is a random number of this sample, normally distributed: mean 0, variance 1.

    i = 0, 1, 2, … names the stream; it depends on the seed, the stream and the sample's number.
    """

    nargs = 2


class uniform(_Operation):  # noqa: N801
    """uniform(seed, i) is a random number of this sample in 0 … 1; see `normal`."""

    nargs = 2


def clamped(expression: Expr, low: Any, high: Any) -> Expr:
    """Return the expression cut to low … high."""
    return maximum(minimum(expression, high), low)
