"""The one kind of error a user can cause: a value that cannot be what it says it is."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class InvalidDescription(ValueError):
    """A description that cannot be built: where, which value, why, and what would be right.

    Parameters
    ----------
    path
        Dotted path of the offending entry, relative to `owner` (``"dither.amplitude"``).
    reason
        The condition that is violated and the smallest change that satisfies it.
    value
        The offending value as text; omitted from the message if empty.
    owner
        Class the path starts from; empty when the path starts at the scenario's root.
    """

    def __init__(self, path: str, reason: str, value: str = "", owner: str = "") -> None:
        self.path, self.reason, self.value, self.owner = path, reason, value, owner
        where = ".".join(part for part in (owner, path) if part)
        shown = f" = {value}" if value else ""
        super().__init__(f"{where}{shown}: {reason}" if where else reason)

    def __reduce__(self) -> tuple[type[InvalidDescription], tuple[str, ...]]:
        """Come back whole from another process."""
        return InvalidDescription, (self.path, self.reason, self.value, self.owner)

    def within(self, prefix: str) -> InvalidDescription:
        """Return the same error seen from an outer description."""
        path = ".".join(part for part in (prefix, self.path) if part)
        return InvalidDescription(path, self.reason, self.value)


def shown(value: object, limit: int = 60) -> str:
    """Return `value` as it may stand in a message: its repr, cut to `limit` characters."""
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return "did you mean …?" with the nearest known name, or the list of known names."""
    names = sorted(known)
    near = get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"known: {', '.join(names)}" if names else "nothing can be set here"
