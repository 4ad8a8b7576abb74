"""Descriptions: immutable dataclasses whose field metadata is their only declaration.

A description is a frozen dataclass of plain numbers. Each field is declared once, as a `value`
(a number or a tuple of numbers: a parameter of the equations), a `part` (another description) or
`structure` (anything else). From that declaration follow validation, the parameters' symbols and
units, dotted paths, the scenario schema and the error messages:

- `flatten` splits a description into its skeleton (structure: a nested tuple that is compared by
  equality) and its values (a flat list of floats);
- `symbolic` gives the same description with a SymPy symbol in place of every value, so that a law
  is written once as an ordinary method and is read as an equation;
- `replace` changes entries by dotted path.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass
from fractions import Fraction
from typing import Any, ClassVar, Self, dataclass_transform

import sympy

from .errors import InvalidDescription, shown, suggestion
from .symbols import axis_names, is_name, parse_number


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
    """
    meta = Meta("value", symbol, unit, shape, positive, False, literal, converter, doc=doc)
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
        return hash(tuple(self._items.items()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mapping) and self._items == dict(other)

    def __repr__(self) -> str:
        return repr(self._items)


@dataclass(frozen=True)
class Parameter:
    """A value of a description as a symbol of its equations."""

    symbol: sympy.Symbol
    path: str
    unit: str


@dataclass_transform(
    frozen_default=True, field_specifiers=(value, part, structure, dataclasses.field)
)
class Description:
    """Base of all descriptions; a subclass is made a frozen dataclass by being defined.

    Two descriptions are equal if their classes, structure and numbers are.
    """

    registry: ClassVar[dict[str, type[Description]]] = {}

    def __init_subclass__(cls, *, abstract: bool = False, **options: Any) -> None:
        super().__init_subclass__(**options)
        dataclass(frozen=True)(cls)
        if not abstract:
            Description.registry[cls.__name__] = cls

    def __post_init__(self) -> None:
        for name, meta in declarations(type(self)).items():
            given = getattr(self, name)
            try:
                object.__setattr__(self, name, _accept(given, meta))
            except InvalidDescription as error:
                raise self._owned(error, name) from None
        try:
            self.check()
        except InvalidDescription as error:
            raise self._owned(error, "") from None

    def _owned(self, error: InvalidDescription, name: str) -> InvalidDescription:
        inner = error.within(name)
        owner = "" if type(self).__name__ == "Loop" else type(self).__name__
        return InvalidDescription(inner.path, inner.reason, inner.value, owner)

    def check(self) -> None:
        """Raise `InvalidDescription` where fields do not fit each other."""

    def replace(self, changes: Mapping[str, Any]) -> Self:
        """Return a copy with the entries at the given dotted paths changed.

        All changes are applied together and validated once:
        ``loop.replace({"controller.channels.0.gain": 12, "field.peak": 2})``.

        Raises
        ------
        InvalidDescription
            For a path that does not exist (the nearest one is named) or a value that is refused.
        """
        if not isinstance(changes, Mapping):
            raise InvalidDescription(
                "", f"replace takes a mapping of dotted paths to values, got {shown(changes)}"
            )
        return _changed(self, {tuple(path.split(".")): new for path, new in changes.items()})


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


def flatten(description: Description) -> tuple[tuple[Any, ...], list[float]]:
    """Return the skeleton (structure, hashable, compared by equality) and the flat values."""
    values: list[float] = []
    return _skeleton(description, values), values


def symbolic(
    description: Description,
    dimension: int,
    units: Mapping[str, str],
    reserved: frozenset[str] = frozenset(),
) -> tuple[Any, tuple[Parameter, ...]]:
    """Return the description with symbols for values, and the parameters in `flatten`'s order.

    `dimension` gives the axes their letters, `units` says each axis' input unit, and no symbol
    takes a `reserved` name.
    """
    names = _Names(dimension, units, reserved)
    twin = names.twin(description, "", None)
    return twin, tuple(names.parameters)


# --- validation -------------------------------------------------------------------------------


def _accept(given: Any, meta: Meta) -> Any:
    if meta.converter is not None:
        given = meta.converter(given)
    if meta.literal is not None and meta.literal(given):
        return given
    if meta.kind == "value":
        return _SHAPES[meta.shape](given, meta)
    if meta.kind == "part":
        return _parts(given, meta) if meta.per_axis else _part(given, meta)
    return given


def _part(given: Any, meta: Meta) -> Any:
    assert meta.role is not None
    if not isinstance(given, meta.role):
        raise InvalidDescription("", f"must be {_article(meta.role)}", shown(given))
    return given


def _parts(given: Any, meta: Meta) -> tuple[Any, ...]:
    if isinstance(given, Description) or not _is_sequence(given):
        raise InvalidDescription("", "must be a tuple with one entry per axis", shown(given))
    if not len(given):
        raise InvalidDescription("", "must have at least one entry", "()")
    parts = []
    for index, item in enumerate(given):
        try:
            parts.append(_part(item, meta))
        except InvalidDescription as error:
            raise error.within(str(index)) from None
    return tuple(parts)


def _article(role: type) -> str:
    known = sorted(
        name
        for name, cls in Description.registry.items()
        if issubclass(cls, role) and not name.startswith("_")
    )
    return f"a {role.__name__}" + (f" ({', '.join(known)})" if known != [role.__name__] else "")


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
    return result


def _scalar(given: Any, meta: Meta) -> float:
    result = number(given)
    if meta.positive and result <= 0:
        raise InvalidDescription("", "must be greater than 0", repr(result))
    return result


def _is_sequence(given: Any) -> bool:
    return not isinstance(given, str | bytes | Mapping) and hasattr(given, "__len__")


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
    return _vector(given, meta) if len(given) else ()


_SHAPES: dict[str, Callable[[Any, Meta], Any]] = {
    "scalar": _scalar,
    "vector": _vector,
    "vector or matrix": _vector_or_matrix,
    "scalar or vector": _scalar_or_vector,
    "coefficients": _coefficients,
    "table": _table,
}


# --- structure and numbers --------------------------------------------------------------------


def _is_number(item: Any, meta: Meta) -> bool:
    if not isinstance(item, float) or meta.kind != "value":
        return False
    return meta.literal is None or not meta.literal(item)


def _is_matrix(item: Any, meta: Meta) -> bool:
    return meta.shape == "vector or matrix" and isinstance(item[0], tuple)


def _skeleton(item: Any, values: list[float], meta: Meta | None = None) -> Any:
    if isinstance(item, Description):
        cls = type(item)
        return (
            cls,
            *(_skeleton(getattr(item, name), values, m) for name, m in declarations(cls).items()),
        )
    assert meta is not None
    if isinstance(item, tuple):
        if meta.kind == "value" and _is_matrix(item, meta):
            values.extend(item[i][j] for i in range(len(item)) for j in range(i, len(item)))
            return ("symmetric", len(item))
        return tuple(_skeleton(entry, values, meta) for entry in item)
    if isinstance(item, Table):
        return tuple((key, _skeleton(entry, values, meta)) for key, entry in item.items())
    if _is_number(item, meta):
        values.append(item)
        return float
    return item


class _Names:
    """Gives every value its symbol, unique, in the order in which `flatten` lists the values."""

    def __init__(self, dimension: int, units: Mapping[str, str], reserved: frozenset[str]) -> None:
        self.axes = axis_names(dimension)
        self.units = units
        self.parameters: list[Parameter] = []
        self.taken = set(reserved)

    def twin(self, item: Any, path: str, axis: str | None, meta: Meta | None = None) -> Any:
        if isinstance(item, Description):
            copy = object.__new__(type(item))
            for name, inner in declarations(type(item)).items():
                entry = self.twin(getattr(item, name), _join(path, name), axis, inner)
                object.__setattr__(copy, name, entry)
            return copy
        assert meta is not None
        if isinstance(item, tuple):
            return self.entries(item, path, axis, meta)
        if isinstance(item, Table):
            return Table(
                {
                    key: self.symbol(_join(path, key), key, axis, meta)
                    if _is_number(entry, meta)
                    else entry
                    for key, entry in item.items()
                }
            )
        if _is_number(item, meta):
            return self.symbol(path, meta.symbol, axis, meta)
        return item

    def entries(self, item: tuple[Any, ...], path: str, axis: str | None, meta: Meta) -> Any:
        if meta.kind == "value" and _is_matrix(item, meta):
            size = len(item)
            upper = {
                (i, j): self.symbol(
                    f"{path}.{i}.{j}", meta.symbol, self.axes[i] + self.axes[j], meta
                )
                for i in range(size)
                for j in range(i, size)
            }
            return tuple(
                tuple(upper[min(i, j), max(i, j)] for j in range(size)) for i in range(size)
            )
        per_axis = (meta.kind == "value" and axis is None) or meta.per_axis
        return tuple(
            self.twin(entry, f"{path}.{i}", self.label(i) if per_axis else axis, meta)
            if per_axis
            else self.twin(entry, f"{path}.{i}", f"{axis}{i}", meta)
            for i, entry in enumerate(item)
        )

    def label(self, index: int) -> str:
        return self.axes[index] if index < len(self.axes) else str(index)

    def symbol(self, path: str, template: str, axis: str | None, meta: Meta) -> sympy.Symbol:
        if "{axis}" in template:
            name = template.format(axis=axis)
        elif axis is not None:
            name = f"{template}{axis}" if template.endswith("_") else f"{template}_{axis}"
        else:
            name = template
        if name in self.taken:
            name = f"{name}_{path.split('.')[0]}"
        count = 2
        while name in self.taken:
            name, count = f"{name.rstrip('0123456789')}{count}", count + 1
        self.taken.add(name)
        symbol = sympy.Symbol(name, real=True, positive=True if meta.positive else None)
        unit = meta.unit.format(input=self.units.get(axis or "", "1"))
        self.parameters.append(Parameter(symbol, path, unit))
        return symbol


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


# --- changes by dotted path -------------------------------------------------------------------


def _grouped(changes: Mapping[tuple[str, ...], Any]) -> dict[str, dict[tuple[str, ...], Any]]:
    groups: dict[str, dict[tuple[str, ...], Any]] = {}
    for path, new in changes.items():
        groups.setdefault(path[0], {})[path[1:]] = new
    return groups


def _changed(item: Any, changes: Mapping[tuple[str, ...], Any], meta: Meta | None = None) -> Any:
    if () in changes:
        if len(changes) > 1:
            raise InvalidDescription("", "is replaced as a whole and in part at the same time")
        return changes[()]
    if isinstance(item, Description):
        known = declarations(type(item))
        updates = {
            name: _within(name, getattr(item, name, None), inner, known, known.get(name))
            for name, inner in _grouped(changes).items()
        }
        return type(item)(**{name: getattr(item, name) for name in known} | updates)
    if isinstance(item, tuple):
        entries = list(item)
        mirrored = meta is not None and meta.kind == "value" and _is_matrix(item, meta)
        if mirrored:
            changes = {**{path[::-1]: new for path, new in changes.items()}, **changes}
        known_indices = {str(i): None for i in range(len(entries))}
        for name, inner in _grouped(changes).items():
            old = entries[int(name)] if name in known_indices else None
            entry_meta = dataclasses.replace(meta, shape="vector") if mirrored and meta else meta
            new = _within(name, old, inner, known_indices, entry_meta)
            entries[int(name)] = new
        return tuple(entries)
    if isinstance(item, Table):
        updates = {
            name: _within(name, item.get(name), inner, item, meta)
            for name, inner in _grouped(changes).items()
        }
        return Table({**item, **updates})
    raise InvalidDescription(next(iter(changes))[0], f"{shown(item)} has no parts")


def _within(
    name: str,
    old: Any,
    changes: Mapping[tuple[str, ...], Any],
    known: Mapping[str, Any],
    meta: Meta | None,
) -> Any:
    if name not in known:
        raise InvalidDescription(name, f"there is no such entry; {suggestion(name, known)}")
    try:
        return _changed(old, changes, meta)
    except InvalidDescription as error:
        raise error.within(name) from None


def as_fraction(given: Any) -> Any:
    """Return integers and fractions ("2/3") as `Fraction`, floats as they are."""
    if isinstance(given, bool):
        return given
    if isinstance(given, numbers.Rational):
        return Fraction(int(given.numerator), int(given.denominator))
    if isinstance(given, sympy.Rational):
        return Fraction(int(given.p), int(given.q))
    if isinstance(given, str):
        try:
            return Fraction(given)
        except (ValueError, ZeroDivisionError):
            return parse_number(given)
    return given
