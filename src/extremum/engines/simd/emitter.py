"""LLVM instructions on vectors of loops, written as text one by one.

Vector types are explicit, `<8 x double>`, so that nothing depends on a compiler's willingness to
vectorise. Nothing is reassociated and no value is assumed finite: what is written is what runs.
"""

from __future__ import annotations

import struct
from itertools import count
from typing import Final

_ELEMENT: Final = {64: "double", 32: "float"}
_SUFFIX: Final = {64: "f64", 32: "f32"}


class Emitter:
    """Writes the instructions of one function; operands and results are the names of values.

    Parameters
    ----------
    width
        Lanes of a vector; 1 for plain numbers.
    bits
        64 or 32.
    contract
        Whether a product that is only added may be fused with the addition (one rounding less).
    """

    def __init__(self, width: int, bits: int, *, contract: bool = False) -> None:
        self.width, self.bits = width, bits
        self.lines: list[str] = []
        self.intrinsics: dict[str, str] = {}
        self._numbers = count()
        self._fused = "contract " if contract else ""
        self.element = _ELEMENT[bits]
        self.type = self._vector(self.element)
        self.integers = self._vector(f"i{bits}")
        self.masks = self._vector("i1")

    def like(self, *, width: int | None = None, bits: int | None = None) -> Emitter:
        """Return an emitter of another type that writes into the same function, uncontracted."""
        other = Emitter(width or self.width, bits or self.bits)
        other.lines, other.intrinsics = self.lines, self.intrinsics
        other._numbers = self._numbers
        return other

    def _vector(self, element: str) -> str:
        return element if self.width == 1 else f"<{self.width} x {element}>"

    def line(self, text: str) -> None:
        """Write an instruction without a result."""
        self.lines.append("  " + text)

    def value(self, text: str) -> str:
        """Write an instruction; return the name of its result."""
        name = f"%v{next(self._numbers)}"
        self.lines.append(f"  {name} = {text}")
        return name

    # --- numbers ------------------------------------------------------------------------------

    def constant(self, number: float) -> str:
        """Return a number, rounded to the type, in every lane."""
        if self.bits == 32:
            number = struct.unpack("f", struct.pack("f", number))[0]
        text = f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"
        return text if self.width == 1 else f"splat ({self.element} {text})"

    def add(self, a: str, b: str) -> str:
        """Return a + b."""
        return self.value(f"fadd {self._fused}{self.type} {a}, {b}")

    def subtract(self, a: str, b: str) -> str:
        """Return a − b."""
        return self.value(f"fsub {self._fused}{self.type} {a}, {b}")

    def multiply(self, a: str, b: str) -> str:
        """Return a b."""
        return self.value(f"fmul {self._fused}{self.type} {a}, {b}")

    def divide(self, a: str, b: str) -> str:
        """Return a/b."""
        return self.value(f"fdiv {self.type} {a}, {b}")

    def negative(self, a: str) -> str:
        """Return −a."""
        return self.value(f"fneg {self.type} {a}")

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a b + c, rounded once."""
        return self._call("fma", a, b, c)

    def absolute(self, a: str) -> str:
        """Return |a|."""
        return self._call("fabs", a)

    def root(self, a: str) -> str:
        """Return √a."""
        return self._call("sqrt", a)

    def rounded(self, a: str) -> str:
        """Return the nearest whole number, ties to even."""
        return self._call("roundeven", a)

    def floor(self, a: str) -> str:
        """Return the largest whole number that is not above a."""
        return self._call("floor", a)

    def minimum(self, a: str, b: str) -> str:
        """Return the smaller one; the other one where one is NaN."""
        return self._call("minnum", a, b)

    def maximum(self, a: str, b: str) -> str:
        """Return the larger one; the other one where one is NaN."""
        return self._call("maxnum", a, b)

    def copysign(self, a: str, sign: str) -> str:
        """Return |a| with the sign of `sign`."""
        return self._call("copysign", a, sign)

    def _call(self, name: str, *arguments: str) -> str:
        lanes = "" if self.width == 1 else f"v{self.width}"
        full = f"@llvm.{name}.{lanes}{_SUFFIX[self.bits]}"
        types = ", ".join([self.type] * len(arguments))
        self.intrinsics[full] = f"declare {self.type} {full}({types})"
        given = ", ".join(f"{self.type} {a}" for a in arguments)
        return self.value(f"call {self.type} {full}({given})")

    # --- truth --------------------------------------------------------------------------------

    def compare(self, relation: str, a: str, b: str) -> str:
        """Return a mask; `relation` is LLVM's: "olt", "ole", "oeq", "une", "uno" (NaN), …."""
        return self.value(f"fcmp {relation} {self.type} {a}, {b}")

    def both(self, a: str, b: str) -> str:
        """Return a and b, masks."""
        return self.value(f"and {self.masks} {a}, {b}")

    def either(self, a: str, b: str) -> str:
        """Return a or b, masks."""
        return self.value(f"or {self.masks} {a}, {b}")

    def select(self, mask: str, a: str, b: str) -> str:
        """Return a where the mask is true, else b."""
        return self.value(f"select {self.masks} {mask}, {self.type} {a}, {self.type} {b}")

    # --- bits ---------------------------------------------------------------------------------

    def integer(self, number: int) -> str:
        """Return an integer as wide as the numbers, in every lane."""
        return str(number) if self.width == 1 else f"splat (i{self.bits} {number})"

    def as_bits(self, a: str) -> str:
        """Return the bits of numbers as integers."""
        return self.value(f"bitcast {self.type} {a} to {self.integers}")

    def from_bits(self, a: str) -> str:
        """Return the numbers whose bits these integers are."""
        return self.value(f"bitcast {self.integers} {a} to {self.type}")

    def to_integer(self, a: str) -> str:
        """Return whole numbers as integers; nonsense, but no trap, beyond their range."""
        intrinsic = f"@llvm.fptosi.sat.{self._suffix('i')}.{self._suffix('f')}"
        self.intrinsics[intrinsic] = f"declare {self.integers} {intrinsic}({self.type})"
        return self.value(f"call {self.integers} {intrinsic}({self.type} {a})")

    def _suffix(self, letter: str) -> str:
        return f"{'' if self.width == 1 else f'v{self.width}'}{letter}{self.bits}"

    def to_number(self, a: str) -> str:
        """Return integers as numbers."""
        return self.value(f"sitofp {self.integers} {a} to {self.type}")

    def integral(self, operation: str, a: str, b: str) -> str:
        """Return an integer operation's result: "add", "sub", "and", "or", "shl", "ashr", …."""
        return self.value(f"{operation} {self.integers} {a}, {b}")

    def compare_integers(self, relation: str, a: str, b: str) -> str:
        """Return a mask; `relation` is LLVM's: "eq", "ne", "slt", …."""
        return self.value(f"icmp {relation} {self.integers} {a}, {b}")
