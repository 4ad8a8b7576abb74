"""Scenario files: TOML ⇄ `Loop`, without loss; see `documents`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from .description import Description, part, structure, value
from .documents import Reader, entries, opened, parsed, table, written
from .errors import InvalidDescription, shown
from .loop import Loop
from .sampled.loop import SampledLoop
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
        The loop; a `SampledLoop` where the file has a table ``[sampling]``.
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


_LOOP = ("field", "vehicle", "controller", "start", "sensor", "sampling")
TOP: Final = ("title", "note", "run", *_LOOP, "view")
"""The keys at the top of a scenario file."""


def parse_scenario(text: str, folder: Path | str = ".") -> Scenario:
    """Return the scenario that TOML text states; relative file names are looked up in `folder`.

    Raises
    ------
    InvalidDescription
        With the dotted path, the value and what would be right.
    """
    try:
        return stated(parsed(text, TOP), Path(folder))
    except RecursionError:
        raise InvalidDescription("", "this scenario is nested too deeply") from None


def stated(data: Mapping[str, Any], folder: Path) -> Scenario:
    """Return the scenario that nested tables state."""
    reader = Reader(folder)
    loop = {key: data[key] for key in _LOOP if key in data}
    rest = {key: data[key] for key in ("title", "note") if key in data}
    return Scenario(
        loop=reader.build(SampledLoop if "sampling" in loop else Loop, loop, ""),
        run=reader.build(Run, table(data, "run"), "run"),
        view=reader.build(View, table(data, "view", {}), "view"),
        **rest,
    )


def load_scenario(path: Path | str) -> Scenario:
    """Return the scenario in a TOML file.

    Raises
    ------
    InvalidDescription
        If the file is missing or unreadable, or states no scenario.
    """
    return parse_scenario(*opened(path))


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
    return tomli_w.dumps(as_tables(scenario))


def as_tables(scenario: Scenario) -> dict[str, Any]:
    """Return the scenario as nested tables of what TOML can hold."""
    data: dict[str, Any] = {key: getattr(scenario, key) for key in ("title", "note")}
    data = {key: text for key, text in data.items() if text}
    data |= {"start": written(scenario.loop.start)}
    data |= {"run": entries(scenario.run)}
    data |= entries(scenario.loop)
    if scenario.view != View():
        data["view"] = entries(scenario.view)
    return data
