"""Delays of any length as states: a line of what is past, one state for each sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import sympy
from sympy import Expr, Symbol

from ..logic import nearest, positive
from ..symbols import exact
from .diagram import SampledDiagram

LONGEST: Final = 500
"""Most samples in a delay."""

ROUNDING: Final = 1e-9
"""Share of a sample by which a delay may miss a whole number of them and still be that."""

NESTED: Final = 16
"""So many choices stand in one expression."""


def whole(delay: float | None, dt: float) -> int:
    """Return how many whole samples are in a delay."""
    return 0 if delay is None else int(delay / dt + ROUNDING)


def line(
    diagram: SampledDiagram, name: str, unit: str, initial: Expr | float, length: int
) -> list[Symbol]:
    """Draw states each of which takes the value of the one before; the first is not yet fed."""
    names = [name if length == 1 else f"{name}_{i + 1}" for i in range(length)]
    states = [diagram.state(own, unit, initial) for own in names]
    for before, state in pairwise(states):
        diagram.follow(state, before)
    return states


@dataclass(frozen=True)
class Late:
    """A delay as it is drawn.

    Attributes
    ----------
    longest
        The most whole samples that may be in it.
    whole
        How many are: `longest`, or an expression of delay and dt where these vary.
    rest
        What is left of the delay, less than dt (s).
    """

    longest: int
    whole: Expr
    rest: Expr

    @classmethod
    def of(cls, delay: Any, dt: Any, longest: int, varies: bool) -> Late:
        """Return a delay; where it `varies`, with at most `longest` whole samples."""
        count: Any = sympy.Integer(longest)
        if varies:
            count = nearest(delay / dt + exact(ROUNDING) - sympy.Rational(1, 2))
        return cls(longest, count, delay - count * dt)

    def entry(
        self, diagram: SampledDiagram, name: str, unit: str, past: Sequence[Expr], later: int = 0
    ) -> Expr:
        """Return entry `whole` + `later` of what is past, newest first."""
        if self.whole.is_Integer:
            return past[int(self.whole) + later]
        found = past[self.longest + later]
        for j in range(self.longest + later - 1, later - 1, -1):
            found = positive(self.whole + later - j - sympy.Rational(1, 2), found, past[j])
            if j % NESTED == 0:
                found = diagram.signal(f"{name}_{j}", found, unit)
        return found
