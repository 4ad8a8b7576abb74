"""What a description's fields declare: numbers, parts and structure, each once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass
from fractions import Fraction
from typing import Any


@dataclass(frozen=True)
class Meta:
    """What a field's declaration says."""

    kind: str
    symbol: str = ""
    unit: str = ""
    shape: str = "scalar"
    positive: bool = False
    per_axis: bool = False
    literal: Callable[[Any], bool] | None = None
    converter: Callable[[Any], Any] | None = None
    role: type | None = None
    usual: type | None = None
    doc: str = ""


def value(
    symbol: str,
    unit: str,
    doc: str,
    *,
    default: Any = MISSING,
    shape: str = "scalar",
    positive: bool = False,
    literal: Callable[[Any], bool] | None = None,
    converter: Callable[[Any], Any] | None = None,
    role: type | None = None,
) -> Any:
    """Declare a number, or a tuple of numbers, that is a parameter of the equations.

    Parameters
    ----------
    symbol
        Name of its symbol in the equations; ``{axis}`` stands for the axis' letter, otherwise the
        letter is appended where the value belongs to an axis.
    unit
        SI unit; ``{input}`` stands for the unit of the axis' input.
    shape
        ``"scalar"``, ``"vector"`` (one number per axis), ``"vector or matrix"`` (symmetric),
        ``"scalar or vector"``, or ``"table"`` (names to numbers).
    positive
        Whether every number must be greater than zero.
    literal
        Says which values are structure rather than numbers (``"signal"``, None, a quarter turn).
    converter
        Makes what a user may write into the stored value, before validation.
    role
        The class of description that may stand instead of numbers.
    """
    meta = Meta("value", symbol, unit, shape, positive, False, literal, converter, role, doc=doc)
    return dataclasses.field(default=default, metadata={"extremum": meta})


def part(
    role: type,
    doc: str,
    *,
    default: Any = MISSING,
    usual: type | None = None,
    per_axis: bool = False,
    converter: Callable[[Any], Any] | None = None,
    literal: Callable[[Any], bool] | None = None,
) -> Any:
    """Declare a nested description of class `role`, or a tuple with one per axis.

    `usual` is the class that a scenario need not name.
    """
    meta = Meta(
        "part",
        per_axis=per_axis,
        literal=literal,
        converter=converter,
        role=role,
        usual=usual,
        doc=doc,
    )
    return dataclasses.field(default=default, metadata={"extremum": meta})


def structure(
    doc: str, *, default: Any = MISSING, converter: Callable[[Any], Any] | None = None
) -> Any:
    """Declare a field that decides the form of the equations and never becomes a symbol."""
    meta = Meta("structure", converter=converter, doc=doc)
    return dataclasses.field(default=default, metadata={"extremum": meta})


class Table(Mapping[str, Any]):
    """An immutable mapping of names to numbers that compares and hashes by content."""

    def __init__(self, items: Mapping[str, Any]) -> None:
        self._items = dict(items)

    def __getitem__(self, key: str) -> Any:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __hash__(self) -> int:
        return hash(frozenset(self._items.items()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mapping) and self._items == dict(other)

    def __repr__(self) -> str:
        return repr(self._items)


_DECLARED: dict[type, dict[str, Meta]] = {}


def declarations(cls: type) -> dict[str, Meta]:
    """Return the declared fields of a description's class, in order."""
    if cls not in _DECLARED:
        _DECLARED[cls] = {
            field.name: field.metadata["extremum"]
            for field in dataclasses.fields(cls)
            if "extremum" in field.metadata
        }
    return _DECLARED[cls]


def is_none(given: Any) -> bool:
    """Return whether an entry is left out."""
    return given is None


def is_number(item: Any, meta: Meta, varied: bool) -> bool:
    """Return whether an entry of a field is a parameter of the equations.

    A number that is structure because of its value (a quarter turn, a fraction) is one if it is
    `varied`.
    """
    if not isinstance(item, float | Fraction) or meta.kind != "value":
        return False
    return varied or meta.literal is None or not meta.literal(item)


def is_matrix(item: Any, meta: Meta) -> bool:
    """Return whether a field's tuple is a symmetric matrix."""
    return meta.shape == "vector or matrix" and isinstance(item[0], tuple)
