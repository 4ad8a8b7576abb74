"""A tape run by mpmath or by Python: the oracle of what engines print and of what series say."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import mpmath

from extremum.engines.lanes.tape import Tape

Leaves = Mapping[tuple[str, int], Any]


def run(tape: Tape, leaves: Leaves, library: Any = mpmath.mp) -> list[Any]:
    """Return every value of the tape that its leaves decide, None for the others."""
    found: list[Any] = []
    for operation in tape.operations:
        if operation.name == "constant":
            found.append(operation.number)
        elif not operation.operands:
            found.append(leaves.get((operation.name, int(operation.number))))
        else:
            operands = [found[o] for o in operation.operands]
            known = all(o is not None for o in operands)
            found.append(function(operation.name, library)(*operands) if known else None)
    return found


def function(name: str, library: Any) -> Callable[..., Any]:
    """Return what an operation does."""
    plain: dict[str, Callable[..., Any]] = {
        "add": operator.add,
        "subtract": operator.sub,
        "multiply": operator.mul,
        "divide": lambda a, b: a / b if b else a * math.inf,
        "negative": operator.neg,
        "absolute": abs,
        "maximum": max,
        "minimum": min,
        "unit": lambda x: min(max(x, 0), 1),
        "positive": lambda x, a, b: a if x > 0 else b,
        "logarithm": lambda a, b: math.log2(a / b),
        "power of two": lambda x: 2.0**x,
        "pow": operator.pow,
    }
    return plain.get(name) or getattr(library, name)
