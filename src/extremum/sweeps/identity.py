"""Whose results a store holds: the same study, run by the same version."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from .. import stores
from ..errors import InvalidDescription, shown
from .study import Study, format_study

FORMAT: Final = 1
SHOWN: Final = ("title", "note", "view", "run.samples")
"""Entries of a study that its results do not depend on."""


def identity(text: str, chunk: tuple[int, ...]) -> dict[str, Any]:
    """Return the attributes of a new store that say whose results it holds."""
    from .. import __version__

    return {
        "format": FORMAT,
        "version": __version__,
        "study": text,
        "chunk": chunk,
        "complete": 0,  # NetCDF has no truth
    }


def is_complete(store: Path, study: Study) -> bool:
    """Return whether a store has all of a study's results.

    Raises
    ------
    InvalidDescription
        If it is no sweep's store, or holds another study, or another version's results.
    """
    from .. import __version__

    attrs = stores.attributes(store)
    if not {"format", "version", "study", "chunk", "complete"} <= set(attrs):
        raise InvalidDescription("", f"{store} is no sweep's store; choose another name")
    if attrs["format"] != FORMAT:
        reason = f"{store} has format {shown(attrs['format'])}, this version knows {FORMAT}"
        raise InvalidDescription("", f"{reason}; a newer version of extremum can go on with it")
    try:
        there = _entries(attrs["study"])
    except (tomllib.TOMLDecodeError, KeyError, TypeError):
        reason = f"{store} does not say which study it holds; choose another name"
        raise InvalidDescription("", reason) from None
    here = _entries(format_study(study))
    for path in {**here, **there}:
        if there.get(path) != here.get(path):
            raise InvalidDescription(
                "",
                f"{store} holds another study: {path} is {_said(there, path)} there and "
                f"{_said(here, path)} here; choose another name",
            )
    if attrs["complete"]:
        return True
    if attrs["version"] != __version__:
        reason = f"{store} was begun by extremum {attrs['version']}, this is {__version__}"
        raise InvalidDescription(
            "", f"{reason}; the same version must finish it, or choose another name"
        )
    return False


def _entries(text: str) -> dict[str, Any]:
    """Return dotted path → entry of what a study's results depend on."""
    data = tomllib.loads(text)
    found = {
        path: entry
        for path, entry in _leaves(data, "")
        if not any(path == shown or path.startswith(f"{shown}.") for shown in SHOWN)
    }
    return {**found, "the order of sweep.axes": list(data["sweep"]["axes"])}


def _leaves(item: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(item, dict) and "digest" in item:
        item = {"digest": item["digest"]}  # of the data; the file may have moved
    if isinstance(item, list):
        item = {str(k): entry for k, entry in enumerate(item)}
    if not isinstance(item, dict):
        yield path, item
        return
    for key, entry in item.items():
        yield from _leaves(entry, f"{path}.{key}" if path else key)


def _said(entries: dict[str, Any], path: str) -> str:
    return shown(entries[path]) if path in entries else "left out"
