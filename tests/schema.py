"""The rows that document a description's class, from its declarations."""

from __future__ import annotations

import dataclasses
from typing import Any

from extremum.description import Description, declarations

HEAD = ["| key | kind | unit | default | meaning |", "|---|---|---|---|---|"]


def documented(cls: type[Description]) -> list[str]:
    rows = []
    for field in dataclasses.fields(cls):  # pyright: ignore[reportArgumentType]
        meta = declarations(cls)[field.name]
        kind = {
            "value": meta.shape,
            "part": (meta.role.__name__ if meta.role else "") + " per axis" * meta.per_axis,
            "structure": "—",
        }[meta.kind]
        unit = meta.unit.format(input="unit of the input")
        doc = (meta.doc + " (> 0)" * meta.positive).replace("|", "\\|")
        rows.append(f"| `{field.name}` | {kind} | {unit} | {_default(field.default)} | {doc} |")
    return rows


def _default(given: Any) -> str:
    if given is dataclasses.MISSING:
        return ""
    if isinstance(given, bool | int | float):
        return str(given).lower()
    if str(given).startswith(f"{type(given).__name__}("):  # with its own defaults
        return f"{type(given).__name__}()"
    return str(given or "none")
