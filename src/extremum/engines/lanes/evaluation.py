"""A tape's values as NumPy computes them: plain, for single numbers or arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from . import random
from .tape import Tape


def evaluated(
    tape: Tape, wanted: Iterable[int], leaves: Mapping[tuple[str, int], Any]
) -> dict[int, Any]:
    """Return the values that `wanted` depend on, themselves included, in double precision.

    Parameters
    ----------
    tape
        The operations.
    wanted
        Values on it.
    leaves
        A leaf's name and index → its number, or an array of them. Overflow gives infinities and
        values outside a function's domain give NaN, silently.
    """
    found: dict[int, Any] = {}
    with np.errstate(all="ignore"):
        for value in tape.needed(wanted):
            operation = tape.operations[value]
            if operation.name == "constant":
                found[value] = np.float64(operation.number)
            elif operation.operands:
                operands = (found[operand] for operand in operation.operands)
                found[value] = _OPERATIONS[operation.name](*operands)
            else:
                found[value] = np.asarray(leaves[operation.name, int(operation.number)], float)[()]
    return found


def _logarithm(a: Any, b: Any) -> Any:
    """Return log₂(a/b) as the engines approximate it, from the bits of the numbers."""
    return (a.view(np.int64) - b.view(np.int64)) * 2.0**-52


def _power(x: Any) -> Any:
    """Return 2^x as the engines approximate it, by a number's bits."""
    return np.asarray(x * 2.0**52 + 1023 * 2.0**52).astype(np.int64).view(np.float64)[()]


_OPERATIONS: Final[Mapping[str, Callable[..., Any]]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "negative": np.negative,
    "absolute": np.abs,
    "maximum": lambda a, b: np.where(a > b, a, b)[()],
    "minimum": lambda a, b: np.where(a < b, a, b)[()],
    "finite": lambda x: np.where(np.isfinite(x), 1.0, -1.0)[()],
    "unit": lambda x: np.clip(x, 0.0, 1.0),
    "positive": lambda x, a, b: np.where(x > 0, a, b)[()],
    "nearest": np.rint,
    "logarithm": _logarithm,
    "power of two": _power,
    "uniform": lambda *numbers: random.evaluated(random.uniform, *numbers),
    "normal": lambda *numbers: random.evaluated(random.normal, *numbers),
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "pow": np.power,
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan", "tan2")},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("sinh", "cosh", "tanh")},
}
