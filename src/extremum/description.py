"""Descriptions: immutable dataclasses whose field metadata is their only declaration.

A description is a frozen dataclass of plain numbers. Each field is declared once, as a `value`
(a number or a tuple of numbers: a parameter of the equations), a `part` (another description) or
`structure` (anything else). From that declaration follow validation, the parameters' symbols and
units, dotted paths, the scenario schema and the error messages:

- `flatten` splits a description into its skeleton (structure: a nested tuple that is compared by
  equality) and its values (a flat list of floats);
- `parameters.symbolic` gives the same description with a SymPy symbol in place of every value, so
  that a law is written once as an ordinary method and is read as an equation;
- `Description.replace` changes entries by dotted path.
"""

from __future__ import annotations

import dataclasses
from abc import ABC
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self, dataclass_transform

from .declarations import (
    Meta,
    Table,
    declarations,
    is_matrix,
    is_number,
    part,
    structure,
    value,
)
from .errors import InvalidDescription, shown, suggestion
from .validation import accept

__all__ = [
    "Description",
    "declarations",
    "flatten",
    "joined",
    "located",
    "numbers",
    "part",
    "structure",
    "value",
]


@dataclass_transform(
    frozen_default=True, field_specifiers=(value, part, structure, dataclasses.field)
)
class Description(ABC):  # noqa: B024 - its roles, Field and so on, have the abstract methods
    """Base of all descriptions; a subclass is made a frozen dataclass by being defined.

    Two descriptions are equal if their classes, structure and numbers are.
    """

    registry: ClassVar[dict[str, type[Description]]] = {}
    root: ClassVar[bool] = False
    """Whether dotted paths start here, so that messages need not name the class."""

    def __init_subclass__(cls, *, abstract: bool = False, **options: Any) -> None:
        super().__init_subclass__(**options)
        dataclass(frozen=True)(cls)
        if abstract:
            return
        bare = [f.name for f in dataclasses.fields(cls) if "extremum" not in f.metadata]  # pyright: ignore[reportArgumentType]
        if bare:
            raise TypeError(
                f"{cls.__name__}.{bare[0]}: declare it with value(), part() or structure()"
            )
        known = Description.registry.get(cls.__name__)
        if known is not None and known.__module__ != cls.__module__:
            raise TypeError(f"{known.__module__} has a class {cls.__name__}; take another name")
        Description.registry[cls.__name__] = cls

    def __post_init__(self) -> None:
        for name, meta in declarations(type(self)).items():
            given = getattr(self, name)
            try:
                object.__setattr__(self, name, accept(given, meta, Description.registry))
            except InvalidDescription as error:
                raise self._owned(error, name) from None
        try:
            self.check()
        except InvalidDescription as error:
            raise self._owned(error, "") from None

    def _owned(self, error: InvalidDescription, name: str) -> InvalidDescription:
        inner = error.within(name)
        owner = "" if self.root else type(self).__name__
        return InvalidDescription(inner.path, inner.reason, inner.value, owner)

    def __getstate__(self) -> dict[str, Any]:
        """Go to other processes without what is kept for speed."""
        return {name: getattr(self, name) for name in declarations(type(self))}

    def check(self) -> None:  # noqa: B027 - most classes have nothing to add
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
        for path in changes:
            if not isinstance(path, str):
                raise InvalidDescription("", f"a dotted path must be text, got {shown(path)}")
        return _changed(self, {tuple(path.split(".")): new for path, new in changes.items()})


def flatten(
    description: Description, varied: Container[str] = ()
) -> tuple[tuple[Any, ...], list[float]]:
    """Return the skeleton (structure, hashable, compared by equality) and the flat values.

    The numbers at the `varied` paths are values whatever they are.
    """
    values: dict[str, float] = {}
    return _skeleton(description, "", values, varied), list(values.values())


def numbers(description: Description, varied: Container[str] = ()) -> dict[str, float]:
    """Return every value by its dotted path, in `flatten`'s order."""
    values: dict[str, float] = {}
    _skeleton(description, "", values, varied)
    return values


def _skeleton(
    item: Any, path: str, values: dict[str, float], varied: Container[str], meta: Meta | None = None
) -> Any:
    if isinstance(item, Description):
        cls = type(item)
        return (
            cls,
            *(
                _skeleton(getattr(item, name), joined(path, name), values, varied, m)
                for name, m in declarations(cls).items()
            ),
        )
    assert meta is not None
    if isinstance(item, tuple):
        if meta.kind == "value" and is_matrix(item, meta):
            size = len(item)
            upper = ((i, j) for i in range(size) for j in range(i, size))
            values.update({f"{path}.{i}.{j}": item[i][j] for i, j in upper})
            return ("symmetric", size)
        return tuple(
            _skeleton(entry, f"{path}.{i}", values, varied, meta) for i, entry in enumerate(item)
        )
    if isinstance(item, Table):
        return tuple(
            (key, _skeleton(entry, f"{path}.{key}", values, varied, meta))
            for key, entry in item.items()
        )
    if is_number(item, meta, path in varied):
        values[path] = float(item)
        return float
    try:
        hash(item)
    except TypeError:
        return ("the same object", id(item))  # which the system keeps alive
    return item


def joined(path: str, name: str) -> str:
    """Return the dotted path of an entry."""
    return f"{path}.{name}" if path else name


# --- numbers by dotted path -------------------------------------------------------------------


class _Every(Container[str]):
    def __contains__(self, path: object) -> bool:
        return True


def located(description: Description, path: str) -> str:
    """Return the path of the number that `path` names, one for mirrored entries of a matrix.

    Raises
    ------
    InvalidDescription
        If there is no number: with the nearest path, the numbers inside, or what must be given one.
    """
    known = numbers(description, _Every())
    parts = path.split(".")
    mirrored = ".".join([*parts[:-2], *parts[:-3:-1]])
    for name in (path, mirrored):
        if name in known:
            return name
    inside = [name for name in known if name.startswith(f"{path}.")]
    if inside:
        raise InvalidDescription(path, f"is not one number; inside it are {', '.join(inside)}")
    raise _no_number(description, path, known)


def _no_number(description: Description, path: str, known: Iterable[str]) -> InvalidDescription:
    item: Any = description
    meta, reached = None, ""
    for name in path.split("."):
        inside = _entries(item)
        if name not in inside:
            break
        meta = declarations(type(item))[name] if isinstance(item, Description) else meta
        item, reached = inside[name], joined(reached, name)
    if meta is not None and meta.kind == "structure":
        return InvalidDescription(reached, "is structure; only numbers of the equations can vary")
    if item is None or isinstance(item, str):
        return InvalidDescription(
            reached, f"must be given first: replace({{{reached!r}: …}})", shown(item)
        )
    return InvalidDescription(path, f"there is no such number; {suggestion(path, known)}")


def _entries(item: Any) -> Mapping[str, Any]:
    if isinstance(item, Description):
        return {name: getattr(item, name) for name in declarations(type(item))}
    if isinstance(item, tuple):
        return {str(index): entry for index, entry in enumerate(item)}
    return item if isinstance(item, Table) else {}


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
        return _entries_changed(item, changes, meta)
    if isinstance(item, Table):
        updates = {
            name: _within(name, item.get(name), inner, item, meta)
            for name, inner in _grouped(changes).items()
        }
        return Table({**item, **updates})
    raise InvalidDescription(
        next(iter(changes))[0], f"{shown(item)} has no parts; replace it as a whole"
    )


def _entries_changed(
    item: tuple[Any, ...], changes: Mapping[tuple[str, ...], Any], meta: Meta | None
) -> tuple[Any, ...]:
    entries = list(item)
    known: dict[str, None] = {str(i): None for i in range(len(entries))}
    if meta is not None and meta.kind == "value" and is_matrix(item, meta):
        pairs = {path: new for path, new in changes.items() if len(path) == 2}
        inside = {path: new for path, new in pairs.items() if set(path) <= set(known)}
        changes = {**{path[::-1]: new for path, new in inside.items()}, **changes}
        meta = dataclasses.replace(meta, shape="vector")
    for name, inner in _grouped(changes).items():
        old = entries[int(name)] if name in known else None
        changed = _within(name, old, inner, known, meta)
        entries[int(name)] = changed
    return tuple(entries)


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
