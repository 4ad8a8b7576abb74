"""What a description's fields accept, and what they say to what they do not."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import sympy

from .declarations import Meta, Table
from .errors import InvalidDescription, shown
from .symbols import is_name, parse_number


def accept(given: Any, meta: Meta, classes: Mapping[str, type]) -> Any:
    """Return what a field stores for what was given; `classes` are those known by name."""
    if meta.converter is not None:
        given = meta.converter(given)
    if meta.literal is not None and meta.shape != "coefficients" and meta.literal(given):
        return float(given) if type(given) is int else given
    if meta.kind == "value":
        return _SHAPES[meta.shape](given, meta)
    if meta.kind == "part":
        return _parts(given, meta, classes) if meta.per_axis else _part(given, meta, classes)
    return given


def _part(given: Any, meta: Meta, classes: Mapping[str, type]) -> Any:
    assert meta.role is not None
    if not isinstance(given, meta.role):
        raise InvalidDescription("", f"must be {_article(meta.role, classes)}", shown(given))
    return given


def _parts(given: Any, meta: Meta, classes: Mapping[str, type]) -> tuple[Any, ...]:
    if not _is_sequence(given):
        raise InvalidDescription("", "must be a tuple with one entry per axis", shown(given))
    if not len(given):
        raise InvalidDescription("", "must have at least one entry", "()")
    parts = []
    for index, item in enumerate(given):
        try:
            parts.append(_part(item, meta, classes))
        except InvalidDescription as error:
            raise error.within(str(index)) from None
    return tuple(parts)


def _article(role: type, classes: Mapping[str, type]) -> str:
    known = sorted(
        name for name, cls in classes.items() if issubclass(cls, role) and not name.startswith("_")
    )
    article = "an" if role.__name__[0] in "AEIOU" else "a"
    kinds = f" ({', '.join(known)})" if known != [role.__name__] else ""
    return f"{article} {role.__name__}{kinds}"


def number(given: Any) -> float:
    """Return a finite float from a Python, NumPy or SymPy number, or text such as ``"-pi/2"``."""
    if isinstance(given, str):
        return parse_number(given)
    if isinstance(given, sympy.Expr) and given.is_number and given.is_real:
        given = float(given)
    if isinstance(given, bool) or not isinstance(given, numbers.Real):
        raise InvalidDescription("", "must be a number", shown(given))
    try:
        result = float(given)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InvalidDescription("", "must be a finite number", shown(given))
    return result + 0.0  # -0.0 equals a default of 0.0 and would not come back from text


def positive(name: str, given: Any) -> float:
    """Return a finite float greater than 0; a refusal names the argument."""
    try:
        result = number(given)
    except InvalidDescription as error:
        raise error.within(name) from None
    if result <= 0:
        raise InvalidDescription(name, "must be a finite number greater than 0", shown(given))
    return result


def _scalar(given: Any, meta: Meta) -> float:
    result = number(given)
    if meta.positive and result <= 0:
        raise InvalidDescription("", "must be greater than 0", repr(result))
    return result


def _is_sequence(given: Any) -> bool:
    if isinstance(given, np.ndarray):
        return given.ndim > 0
    return isinstance(given, Sequence) and not isinstance(given, str | bytes)


def _vector(given: Any, meta: Meta) -> tuple[float, ...]:
    if not _is_sequence(given) or not len(given):
        raise InvalidDescription("", "must be a tuple of numbers, one per axis", shown(given))
    result = []
    for index, item in enumerate(given):
        try:
            result.append(_scalar(item, meta))
        except InvalidDescription as error:
            raise error.within(str(index)) from None
    return tuple(result)


def _vector_or_matrix(given: Any, meta: Meta) -> tuple[Any, ...]:
    if not _is_sequence(given) or not len(given) or not _is_sequence(given[0]):
        return _vector(given, meta)
    rows = []
    for index, row in enumerate(given):
        try:
            rows.append(_vector(row, meta))
        except InvalidDescription as error:
            raise error.within(str(index)) from None
    for i, row in enumerate(rows):
        if len(row) != len(rows):
            raise InvalidDescription(
                str(i), f"has {len(row)} entries, must have {len(rows)}: the matrix is square"
            )
    for i, row in enumerate(rows):
        for j in range(i):
            if row[j] != rows[j][i]:
                raise InvalidDescription(
                    f"{i}.{j}",
                    f"differs from entry {j}.{i} = {rows[j][i]!r}; the matrix must be symmetric "
                    f"(take (q + qᵀ)/2: both {(row[j] + rows[j][i]) / 2!r})",
                    repr(row[j]),
                )
    return tuple(rows)


def _scalar_or_vector(given: Any, meta: Meta) -> Any:
    return _vector(given, meta) if _is_sequence(given) else _scalar(given, meta)


def _table(given: Any, meta: Meta) -> Table:
    if given is None:
        return Table({})
    if not isinstance(given, Mapping):
        raise InvalidDescription("", "must map names to numbers", shown(given))
    items: dict[str, float] = {}
    for key, item in given.items():
        if not isinstance(key, str) or not is_name(key):
            raise InvalidDescription(
                str(key), "is no name for a parameter (letters, digits, _; not pi, s, t, sin, …)"
            )
        try:
            items[key] = _scalar(item, meta)
        except InvalidDescription as error:
            raise error.within(key) from None
    return Table(items)


def _coefficients(given: Any, meta: Meta) -> tuple[float, ...]:
    if not _is_sequence(given):
        raise InvalidDescription("", "must be a tuple of numbers", shown(given))
    return _vector(given, meta) if len(given) else ()


_SHAPES: dict[str, Callable[[Any, Meta], Any]] = {
    "scalar": _scalar,
    "vector": _vector,
    "vector or matrix": _vector_or_matrix,
    "scalar or vector": _scalar_or_vector,
    "coefficients": _coefficients,
    "table": _table,
}
