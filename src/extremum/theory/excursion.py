"""The orbit about a moving source: from the averaged loop's, or as the source's excursion grows."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ..engines import shooting
from ..engines.shooting import Closed
from ..parameters import Parameter
from ..symbols import substituted
from ..system import System
from . import branch
from .averaging import Average

Vector = NDArray[np.float64]

FIRST: Final = 0.25
LEAST: Final = 1e-4

PART: Final = Parameter(sympy.Dummy("lambda", real=True), "", "1")
"""λ: how much of its excursion the source makes, 0 at rest in the middle, 1 all of it."""


def orbit_about(predicted: Average, cycle: tuple[float, int]) -> Closed | float:
    """Return the orbit about a moving source, or up to which part of the excursion there was one.

    At other dither frequencies the loop would have no common period with the source, so that the
    orbit cannot be followed in ω as about a source at rest.
    """
    frame, length = predicted.frame, cycle[0]
    rest = branch.guess(predicted, cycle)
    if not predicted.system.oracles:
        slow = shooting.close(predicted.system, predicted.values, length, rest)
        if slow.converged:
            closed = shooting.close(frame.system, frame.values, length, slow.nodes)
            if closed.converged:
                return closed
    return _grown(carried(frame.system), frame.values, length, rest)


def _grown(system: System, values: list[float], length: float, rest: Vector) -> Closed | float:
    """Follow the orbit in λ from 0 to 1, each extrapolated from the two before."""
    parts, nodes, step = [], [], FIRST
    part, guess = 0.0, rest
    while True:
        closed = shooting.close(system, [*values, part], length, guess)
        if closed.converged:
            if part == 1.0:
                return closed
            parts, nodes = [*parts[-1:], part], [*nodes[-1:], closed.nodes]
            step *= 1.5
        else:
            step /= 2
        if not parts or step < LEAST:
            return parts[-1] if parts else 0.0
        part, guess = min(parts[-1] + step, 1.0), nodes[-1]
        if len(parts) == 2:
            guess = guess + (part - parts[1]) / (parts[1] - parts[0]) * (nodes[1] - nodes[0])


@lru_cache(maxsize=64)
def carried(system: System) -> System:
    """Return the system with every sine of the source's multiplied by λ, its last parameter."""
    signals = [(x, _part(e, system) if e.has(system.time) else e) for x, e in system.signals]
    return replace(system, signals=tuple(signals), parameters=(*system.parameters, PART))


def _part(expression: Expr, system: System) -> Expr:
    dithers = [carrier * system.time for carrier in system.carriers]
    waves = [c for c in expression.atoms(sympy.sin, sympy.cos) if c.has(system.time)]
    slow = {c: PART.symbol * c for c in waves if c.args[0] not in dithers}
    return substituted(expression, slow)
