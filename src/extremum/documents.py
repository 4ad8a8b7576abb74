"""Files of TOML text that state a description, and descriptions as such text, without loss.

The keys are the names of the descriptions' fields and the tables nest as they do; a text stands
wherever mathematics may (``"1/s"``, ``"-pi/2"``). Nothing in a file is evaluated as code.
"""

from __future__ import annotations

import dataclasses
import os
import tomllib
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from .declarations import Meta, Table
from .description import Description, declarations
from .errors import InvalidDescription, shown, suggestion
from .gridded import Grid
from .lti import Transfer, transfer
from .starts import InState

# --- reading ----------------------------------------------------------------------------------


def opened(path: Path | str) -> tuple[str, Path]:
    """Return a file's text, and the folder that it is in.

    Raises
    ------
    InvalidDescription
        If the file is missing or unreadable.
    """
    try:
        path = Path(path)
    except TypeError:
        raise InvalidDescription("", "must be a path", shown(path)) from None
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidDescription("", f"{path} is not text (UTF-8)") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidDescription("", f"cannot read {path}: {reason}") from None
    return text, path.parent


def parsed(text: str, known: Iterable[str]) -> dict[str, Any]:
    """Return TOML text as nested tables; at the top it may have only the `known` keys.

    Raises
    ------
    InvalidDescription
        If it is no TOML, or has another key.
    """
    if not isinstance(text, str):
        raise InvalidDescription("", "must be text", shown(text))
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InvalidDescription("", f"this is not TOML: {error}") from None
    except RecursionError:
        raise InvalidDescription("", "this TOML is nested too deeply") from None
    for key in data:
        if key not in known:
            raise InvalidDescription(key, f"there is no such entry; {suggestion(key, known)}")
    return data


def table(data: Mapping[str, Any], key: str, default: Any = None) -> Mapping[str, Any]:
    """Return a table of the data; `default` where it is missing and may be."""
    found = data.get(key, default)
    if found is None:
        raise InvalidDescription(key, "is missing")
    if not isinstance(found, Mapping):
        raise InvalidDescription(key, "must be a table", shown(found))
    return found


class Reader:
    """Builds descriptions from tables; relative file names are looked up in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def build(self, cls: type[Description], table: Mapping[str, Any], path: str) -> Any:
        """Return the description of a class that a table states, `path` its dotted path."""
        known = declarations(cls)
        for key in table:
            if key not in known and key != "type":
                hint = suggestion(key, known)
                raise InvalidDescription(
                    ".".join(filter(None, (path, key))), f"there is no such entry; {hint}"
                )
        given = {}
        for name, meta in known.items():
            where = ".".join(filter(None, (path, name)))
            if name in table:
                given[name] = self._entry(table[name], meta, where)
            elif _defaults(cls)[name] is dataclasses.MISSING:
                raise InvalidDescription(where, f"is missing ({meta.doc})")
        try:
            return cls(**given)
        except InvalidDescription as error:
            raise error.within(path) from None

    def _entry(self, given: Any, meta: Meta, path: str) -> Any:
        if meta.kind == "structure" and isinstance(given, Mapping) and "file" in given:
            return {**given, "file": self._located(given["file"])}
        if meta.kind == "part" and meta.per_axis:
            if not isinstance(given, list):
                raise InvalidDescription(path, "must be an array, one entry per axis", shown(given))
            return [self._part(item, meta, f"{path}.{i}") for i, item in enumerate(given)]
        if meta.kind == "part":
            return self._part(given, meta, path)
        if isinstance(given, Mapping) and meta.shape != "table" and meta.role is not None:
            return self._part(given, meta, path)
        return given

    def _part(self, given: Any, meta: Meta, path: str) -> Any:
        if not isinstance(given, Mapping):
            return given
        name = given.get("type")
        if name is None and meta.usual is not None:
            return self.build(meta.usual, given, path)
        choices = {
            name: cls
            for name, cls in Description.registry.items()
            if meta.role is None or issubclass(cls, meta.role)
        }
        if name is None and len(choices) == 1:
            return self.build(next(iter(choices.values())), given, path)
        if name is None and meta.kind == "value":
            return given
        if not isinstance(name, str) or name not in choices:
            reason = "is missing" if name is None else "there is no such type"
            hint = suggestion(str(name or ""), choices)
            raise InvalidDescription(
                f"{path}.type", f"{reason}; {hint}", "" if name is None else shown(name)
            )
        return self.build(choices[name], given, path)

    def _located(self, file: Any) -> Any:
        if not isinstance(file, str) or file.startswith("matplotlib:"):
            return file
        return os.path.abspath(self.folder / file)  # a run may be read from another folder


@cache
def _defaults(cls: type[Description]) -> dict[str, Any]:
    return {field.name: field.default for field in dataclasses.fields(cls)}  # pyright: ignore[reportArgumentType]


# --- writing ----------------------------------------------------------------------------------


def entries(description: Description) -> dict[str, Any]:
    """Return what differs from the defaults, as nested tables of what TOML can hold."""
    defaults = _defaults(type(description))
    found = {}
    for name, meta in declarations(type(description)).items():
        item, default = getattr(description, name), defaults[name]
        if default is None and item == {}:
            continue
        if item != default or type(item) is not type(default):  # 1.0 == Fraction(1)
            found[name] = written(item, meta)
    return found


@lru_cache(maxsize=512)
def _is_faithful(item: Transfer) -> bool:
    """Return whether its text states it: not with common factors, a gain of 0 or beyond 1e±300."""
    text = item.text()
    try:
        return text is not None and transfer(text) == item
    except InvalidDescription:
        return False


def written(item: Any, meta: Meta | None = None) -> Any:
    """Return an entry as what TOML can hold; `meta` is its declaration."""
    if isinstance(item, Transfer) and _is_faithful(item):
        return item.text()
    if isinstance(item, InState):
        return dict(item.states)
    if isinstance(item, Grid):
        return item.table()
    if isinstance(item, Description):
        usual = meta is not None and type(item) in (meta.usual, meta.role)
        return {**({} if usual else {"type": type(item).__name__}), **entries(item)}
    if isinstance(item, tuple):
        return [written(entry, meta) for entry in item]
    if isinstance(item, Table):
        return {key: written(entry) for key, entry in item.items()}
    if isinstance(item, Fraction):
        return item.numerator if item.denominator == 1 else str(item)
    if isinstance(item, str | float | int):
        return item
    raise InvalidDescription("", f"{shown(item)} cannot be written to a file")
