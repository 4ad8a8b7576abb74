"""Scenario files: TOML ⇄ `Loop`, without loss.

The keys are the names of the descriptions' fields and the tables nest as they do; a text stands
wherever mathematics may (``"1/s"``, ``"-pi/2"``). Nothing in a file is evaluated as code.
"""

from __future__ import annotations

import dataclasses
import os
import tomllib
from collections.abc import Mapping
from fractions import Fraction
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from .declarations import Meta, Table
from .description import Description, declarations, part, structure, value
from .errors import InvalidDescription, shown, suggestion
from .gridded import Grid
from .loop import InState, Loop
from .lti import Transfer, transfer
from .validation import number


def _count(given: Any) -> Any:
    if given is None or (isinstance(given, int) and not isinstance(given, bool) and given >= 2):
        return given
    raise InvalidDescription("", "must be a whole number, at least 2", shown(given))


class Run(Description):
    """How long and how finely a scenario runs.

    Parameters
    ----------
    t_end
        Duration (s).
    samples
        Number of samples; None for `simulate`'s default.
    """

    t_end: float = value("t_end", "s", "duration", positive=True)
    samples: int | None = structure(
        "number of samples; by default 2000 or 20 per period", default=None, converter=_count
    )


def _interval(given: Any, path: str) -> tuple[float, float]:
    if isinstance(given, str | Mapping):
        raise InvalidDescription(path, "must be two numbers, low and high", shown(given))
    try:
        low, high = (number(v) for v in list(given))
    except (TypeError, ValueError):
        reason = "must be two finite numbers, low and high"
        raise InvalidDescription(path, reason, shown(given)) from None
    if not low < high:
        raise InvalidDescription(path, "must be low, high with low < high", shown(given))
    return low, high


def _one(given: Any) -> Any:
    return given if given is None else _interval(given, "")


def _many(given: Any) -> Any:
    if given is None:
        return given
    if not isinstance(given, list | tuple):
        raise InvalidDescription("", "must be one pair of numbers per axis", shown(given))
    return tuple(_interval(item, str(index)) for index, item in enumerate(given))


class View(Description):
    """The ranges of a figure's axes; what is left out is chosen from the data.

    Parameters
    ----------
    signal
        Range of J.
    position
        Range of each coordinate (m).
    inputs
        Range of each input.
    """

    signal: tuple[float, float] | None = structure("range of J", default=None, converter=_one)
    position: Any = structure("range of each coordinate (m)", default=None, converter=_many)
    inputs: Any = structure("range of each input", default=None, converter=_many)


def _text(given: Any) -> Any:
    if not isinstance(given, str):
        raise InvalidDescription("", "must be text", shown(given))
    return given


class Scenario(Description):
    """A loop, how long it runs, and how it is shown: the content of a scenario file.

    Parameters
    ----------
    loop
        The loop.
    run
        `Run`: duration and samples.
    title, note
        Shown with the results.
    view
        `View`: ranges of the figure's axes.
    """

    root = True

    loop: Loop = part(Loop, "the loop")
    run: Run = part(Run, "duration and samples")
    title: str = structure("title of the figure", default="", converter=_text)
    note: str = structure(
        "what it shows, and where its numbers come from", default="", converter=_text
    )
    view: View = part(View, "ranges of the figure's axes", default=View())

    def check(self) -> None:
        """Refuse a view that has not one range for each axis and input."""
        vehicle = self.loop.vehicle
        counts = {"position": vehicle.dimension(), "inputs": len(vehicle.input_names())}
        for name, count in counts.items():
            ranges = getattr(self.view, name)
            if ranges is not None and len(ranges) != count:
                raise InvalidDescription(
                    f"view.{name}", f"has {len(ranges)} ranges for {count}; give one for each"
                )


_TOP = ("title", "note", "run", "field", "vehicle", "controller", "start", "view")


def parse_scenario(text: str, folder: Path | str = ".") -> Scenario:
    """Return the scenario that TOML text states; relative file names are looked up in `folder`.

    Raises
    ------
    InvalidDescription
        With the dotted path, the value and what would be right.
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
        if key not in _TOP:
            raise InvalidDescription(key, f"there is no such entry; {suggestion(key, _TOP)}")
    reader = _Reader(Path(folder))
    loop = {key: data[key] for key in ("field", "vehicle", "controller", "start") if key in data}
    rest = {key: data[key] for key in ("title", "note") if key in data}
    try:
        return Scenario(
            loop=reader.build(Loop, loop, ""),
            run=reader.build(Run, _table(data, "run"), "run"),
            view=reader.build(View, _table(data, "view", {}), "view"),
            **rest,
        )
    except RecursionError:
        raise InvalidDescription("", "this scenario is nested too deeply") from None


def load_scenario(path: Path | str) -> Scenario:
    """Return the scenario in a TOML file.

    Raises
    ------
    InvalidDescription
        If the file is missing or unreadable, or states no scenario.
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
    return parse_scenario(text, path.parent)


def format_scenario(scenario: Scenario) -> str:
    """Return the scenario as TOML text; `parse_scenario` returns an equal one.

    Raises
    ------
    InvalidDescription
        For a loop with an `Opaque` field, which no text can state.
    """
    import tomli_w

    if not isinstance(scenario, Scenario):
        reason = "must be a Scenario: Scenario(loop=…, run=Run(t_end=…))"
        raise InvalidDescription("", reason, type(scenario).__name__)
    data: dict[str, Any] = {key: getattr(scenario, key) for key in ("title", "note")}
    data = {key: text for key, text in data.items() if text}
    data |= {"start": _written(scenario.loop.start, None)}
    data |= {"run": _entries(scenario.run)}
    data |= _entries(scenario.loop)
    if scenario.view != View():
        data["view"] = _entries(scenario.view)
    return tomli_w.dumps(data)


# --- reading ----------------------------------------------------------------------------------


def _table(data: Mapping[str, Any], key: str, default: Any = None) -> Mapping[str, Any]:
    table = data.get(key, default)
    if table is None:
        raise InvalidDescription(key, "is missing")
    if not isinstance(table, Mapping):
        raise InvalidDescription(key, "must be a table", shown(table))
    return table


class _Reader:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def build(self, cls: type[Description], table: Mapping[str, Any], path: str) -> Any:
        known = declarations(cls)
        for key in table:
            if key not in known and key != "type":
                hint = suggestion(key, known)
                raise InvalidDescription(
                    ".".join(filter(None, (path, key))), f"there is no such entry; {hint}"
                )
        entries = {}
        for name, meta in known.items():
            where = ".".join(filter(None, (path, name)))
            if name in table:
                entries[name] = self.entry(table[name], meta, where)
            elif _defaults(cls)[name] is dataclasses.MISSING:
                raise InvalidDescription(where, f"is missing ({meta.doc})")
        try:
            return cls(**entries)
        except InvalidDescription as error:
            raise error.within(path) from None

    def entry(self, given: Any, meta: Meta, path: str) -> Any:
        if meta.kind == "structure" and isinstance(given, Mapping) and "file" in given:
            return {**given, "file": self.located(given["file"])}
        if meta.kind == "part" and meta.per_axis:
            if not isinstance(given, list):
                raise InvalidDescription(path, "must be an array, one entry per axis", shown(given))
            return [self.part(item, meta, f"{path}.{i}") for i, item in enumerate(given)]
        if meta.kind == "part":
            return self.part(given, meta, path)
        if isinstance(given, Mapping) and meta.shape != "table" and meta.role is not None:
            return self.part(given, meta, path)
        return given

    def part(self, given: Any, meta: Meta, path: str) -> Any:
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

    def located(self, file: Any) -> Any:
        if not isinstance(file, str) or file.startswith("matplotlib:"):
            return file
        return os.path.abspath(self.folder / file)  # a run may be read from another folder


@cache
def _defaults(cls: type[Description]) -> dict[str, Any]:
    return {field.name: field.default for field in dataclasses.fields(cls)}  # pyright: ignore[reportArgumentType]


# --- writing ----------------------------------------------------------------------------------


def _entries(description: Description) -> dict[str, Any]:
    defaults = _defaults(type(description))
    entries = {}
    for name, meta in declarations(type(description)).items():
        item, default = getattr(description, name), defaults[name]
        if item != default or type(item) is not type(default):  # 1.0 == Fraction(1)
            entries[name] = _written(item, meta)
    return entries


@lru_cache(maxsize=512)
def _is_faithful(item: Transfer) -> bool:
    """Return whether its text states it: not with common factors, a gain of 0 or beyond 1e±300."""
    text = item.text()
    try:
        return text is not None and transfer(text) == item
    except InvalidDescription:
        return False


def _written(item: Any, meta: Meta | None) -> Any:
    if isinstance(item, Transfer) and _is_faithful(item):
        return item.text()
    if isinstance(item, InState):
        return dict(item.states)
    if isinstance(item, Grid):
        return item.table()
    if isinstance(item, Description):
        usual = meta is not None and type(item) in (meta.usual, meta.role)
        return {**({} if usual else {"type": type(item).__name__}), **_entries(item)}
    if isinstance(item, tuple):
        return [_written(entry, meta) for entry in item]
    if isinstance(item, Table):
        return dict(item)
    if isinstance(item, Fraction):
        return item.numerator if item.denominator == 1 else str(item)
    if isinstance(item, str | float | int):
        return item
    raise InvalidDescription("", f"{shown(item)} cannot be written to a scenario file")
