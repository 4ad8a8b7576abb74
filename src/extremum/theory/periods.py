"""Which frequencies occur in a system's equations, and what they have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final

import sympy
from sympy import Expr

from ..symbols import substituted
from ..symbols import t as time
from ..system import System

MAX_CYCLES: Final = 20_000
"""Dither cycles within which a loop must repeat to be called periodic."""


def common(numbers: Sequence[Fraction]) -> Fraction:
    """Return the largest number of which all are multiples."""
    above, below = zip(*(n.as_integer_ratio() for n in numbers), strict=True)
    return Fraction(math.gcd(*above), math.lcm(*below))


def fraction(number: float) -> Fraction:
    """Return the simple fraction that a float is to rounding, or the float itself."""
    simple = Fraction(number).limit_denominator(MAX_CYCLES)
    return simple if abs(float(simple) - number) <= 4 * math.ulp(number) else Fraction(number)


@lru_cache(maxsize=256)
def slow_frequencies(system: System) -> tuple[Expr, ...] | None:
    """Return the frequencies of the sines that are no dither's; None if time enters otherwise."""
    found: dict[Expr, None] = {}
    wanted: set[Any] = set().union(*(e.free_symbols for e in system.rhs))
    entering = list(system.rhs)
    for symbol, expression in reversed(system.signals):
        if symbol in wanted:
            wanted |= expression.free_symbols
            entering.append(expression)
    for expression in entering:
        calls = [c for c in expression.atoms(sympy.sin, sympy.cos) if c.has(time)]
        if substituted(expression, {call: sympy.Dummy() for call in calls}).has(time):
            return None
        for call in calls:
            angle = sympy.expand(call.args[0])
            frequency = angle.coeff(time)
            if (angle - frequency * time).has(time):
                return None
            if frequency not in system.carriers:
                found[frequency] = None
    return tuple(found)
