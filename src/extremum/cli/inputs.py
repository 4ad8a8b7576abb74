"""Files that a command reads, and the names of those that it writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from ..errors import InvalidDescription
from ..papers import zhang2007

T = TypeVar("T")


def load(path: str, reader: Callable[[str], T]) -> T:
    """Return what a file states; whatever is refused names the file."""
    try:
        return reader(path)
    except InvalidDescription as error:
        if "\0" not in path and Path(path).is_file():
            raise in_file(error, path) from None
        if path in zhang2007.NAMES:
            hint = f"{path} is a scenario of the paper: extremum paper {path}"
            raise InvalidDescription("", f"there is no file {path}; {hint}") from None
        raise


def in_file(error: InvalidDescription, path: str) -> InvalidDescription:
    """Return the same error, naming the file."""
    shown = f" = {error.value}" if error.value else ""
    if not error.path:
        told = error.reason.startswith((path, f"cannot read {path}"))
        return error if told else InvalidDescription("", f"{path}: {error.reason}")
    return InvalidDescription("", f"{path}: {error.path}{shown}: {error.reason}")


def suffixed(given: str | None, known: tuple[str, ...], option: str) -> Path | None:
    """Return the path of an output; refuse a name without a known ending."""
    if given is None:
        return None
    path = Path(given)
    if path.suffix.lower() not in known:
        raise InvalidDescription("", f"{option} {given}: the name must end in {' or '.join(known)}")
    return path
