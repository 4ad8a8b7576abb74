"""What is drawn of a run, as numbers: curves, ranges, labels and the field around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import sympy
from numpy.typing import NDArray

from ..errors import InvalidDescription
from ..fields import Field
from ..printing import unit_text
from ..scenario import View, parse_scenario
from ..symbols import coordinates, t

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]
Interval = tuple[float, float]

_BEFORE_ESCAPE: Final = 0.98
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Scene:
    """The motion as curves in two or three coordinates.

    Attributes
    ----------
    tracks
        The vehicle's curves by name, arrays (sample, coordinate).
    sources
        The source's curves likewise.
    labels, limits
        Of each coordinate.
    kind
        ``"space"`` (every coordinate a position, to one scale), ``"profile"`` (J along x) or
        ``"time"`` (positions over time).
    averaged
        The averaged loop's curves, where they are to be drawn.
    """

    tracks: dict[str, Array]
    sources: list[Array]
    labels: list[str]
    limits: list[Interval]
    kind: Literal["space", "profile", "time"]
    averaged: Sequence[Array] = ()


def motion(run: xarray.Dataset, view: View, averaged: xarray.Dataset | None = None) -> Scene:
    """Return the path in the plane or in space; position over time for other dimensions."""
    count = run.sizes["axis"]
    source = _source(run)
    means = [] if averaged is None else [averaged.position.values]
    names, unit = [str(name) for name in run.axis.values], unit_of(run.position)
    labels, limits = [label(name, unit) for name in names], _limits(run, view)
    if count in (2, 3):
        if view.position is None:
            limits = _widened(limits)
        sources = [source] if source.size else []
        return Scene({"vehicle": run.position.values}, sources, labels, limits, "space", means)
    times = run.time.values
    tracks = {
        f"${sympy.latex(sympy.Symbol(name))}$": np.column_stack([times, x])
        for name, x in zip(names, run.position.values.T, strict=True)
    }
    sources = [np.column_stack([times, x]) for x in source.T]
    if averaged is not None:
        means = [np.column_stack([averaged.time.values, x]) for x in averaged.position.values.T]
    over = min(low for low, _ in limits), max(high for _, high in limits)
    quantity = labels[0] if count == 1 else f"position ({unit})"
    labels, limits = [label("t", unit_of(run.time)), quantity], [span(run), over]
    return Scene(tracks, sources, labels, limits, "time", means)


def over_field(run: xarray.Dataset, view: View, field: Field | None) -> Scene:
    """Return J along the only axis, otherwise as `motion`; a source needs the field for its J."""
    if run.sizes["axis"] != 1:
        return motion(run, view)
    x, source, J = run.position.values[:, 0], _source(run), run.J.values  # noqa: N806
    heights = [field.at(c, time=run.time.values) for c in source.T] if field else []
    return Scene(
        {"vehicle": np.column_stack([x, J])},
        [np.column_stack([source[:, 0], height]) for height in heights],
        [label(str(run.axis.values[0]), unit_of(run.position)), label("J", unit_of(run.J))],
        [*_limits(run, view), view.signal or padded(run, J, *heights)],
        "profile",
    )


def field_of(run: xarray.Dataset) -> Field | None:
    """Return the field that the run's scenario states, None if it states none that is here."""
    try:
        return parse_scenario(run.attrs["scenario"]).loop.field
    except (KeyError, InvalidDescription):
        return None  # an opaque field, data that have moved, a class of another session


def is_still(field: Field, dimension: int) -> bool:
    """Return whether J does not depend on time."""
    return t not in field.law(coordinates(dimension)).free_symbols


def early_end(run: xarray.Dataset) -> str:
    """Return how a run that was not completed ended, otherwise nothing."""
    outcome = run.attrs.get("outcome", "completed")
    return "" if outcome == "completed" else str(outcome)


def span(run: xarray.Dataset) -> Interval:
    """Return the range of time, with room for the mark of an early end."""
    end = float(run.attrs.get("end_time", run.time[-1])) or 1.0
    return 0.0, 1.04 * end if early_end(run) else end


def padded(run: xarray.Dataset, *columns: Array) -> Interval:
    """Return a range that holds the columns, but for an escape's last rush to infinity."""
    times = run.time.values
    last = times[-1] * (_BEFORE_ESCAPE if early_end(run) == "escaped" else 1.0)
    values = np.concatenate([column[times <= last].ravel() for column in columns])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    size = max(abs(low), abs(high))
    margin = 0.05 * (high - low if high - low > _ROUNDING * size else size) or 1.0
    return low - margin, high + margin


def checked(view: View | None, run: xarray.Dataset) -> View:
    """Return the view, an empty one for None.

    Raises
    ------
    InvalidDescription
        If it has not one range per axis or per input.
    """
    view = view or View()
    counts = {"position": run.position.shape[1], "inputs": run.input.shape[1]}
    for name, count in counts.items():
        ranges = getattr(view, name)
        if ranges is not None and len(ranges) != count:
            raise InvalidDescription(
                f"view.{name}", f"has {len(ranges)} ranges for {count}; give one for each"
            )
    return view


def checked_path(averaged: xarray.Dataset | None, run: xarray.Dataset) -> xarray.Dataset | None:
    """Return the averaged loop's path as it is.

    Raises
    ------
    InvalidDescription
        If it is no path of as many axes as the run.
    """
    count = run.sizes["axis"]
    if averaged is not None and getattr(averaged, "sizes", {}).get("axis") != count:
        raise InvalidDescription(
            "averaged",
            f"must be a path with the run's {count} axes, as average(loop).simulate(t_end) "
            "returns it",
            type(averaged).__name__,
        )
    return averaged


def unit_of(array: xarray.DataArray) -> str:
    """Return the unit that a variable states."""
    return str(array.attrs.get("units", "1"))


def label(name: str, unit: str) -> str:
    """Return a symbol and its unit, $v_{x}$ (m/s²); the unit 1 is not shown."""
    symbol = f"${sympy.latex(sympy.Symbol(name))}$"
    return f"{symbol} ({unit_text(unit)})" if unit_text(unit) else symbol


def _source(run: xarray.Dataset) -> Array:
    return run.source.values if "source" in run else np.empty((run.sizes["time"], 0))


def _limits(run: xarray.Dataset, view: View) -> list[Interval]:
    if view.position is not None:
        return list(view.position)
    position, source = run.position.values, _source(run)
    return [
        padded(run, position[:, axis], source[:, axis : axis + 1])
        for axis in range(position.shape[1])
    ]


def _widened(limits: Sequence[Interval]) -> list[Interval]:
    """Return ranges none of which is less than half as wide as the widest."""
    least = max(high - low for low, high in limits) / 2
    lacks = [max(0.0, least - (high - low)) / 2 for low, high in limits]
    return [(low - lack, high + lack) for (low, high), lack in zip(limits, lacks, strict=True)]
