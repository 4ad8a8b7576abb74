"""A run's numbers, for the terminal."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..engines import taylor
from ..printing import symbol_text
from ..scenario import Scenario

if TYPE_CHECKING:
    import xarray


def summary(scenario: Scenario, run: xarray.Dataset, seconds: float) -> str:
    """Return the outcome, the range of every output and the distance to the source as text."""
    lines = [scenario.title] if scenario.title else []
    if scenario.note:
        lines += [fill(scenario.note, 88), ""]
    lines += [_outcome(run, seconds), "", f"  {'':14}{'min':>12}{'max':>12}{'end':>12}"]
    rows = [("J", *_bounds(run, "J", ()), run.J.attrs["units"], run.J.values[-1])]
    for name, variable in (("axis", "position"), ("names", "input")):
        data = run[variable]
        labels = data.attrs["names"] if name == "names" else [str(a) for a in run.axis.values]
        units = str(data.attrs["units"]).split(", ")
        rows += [
            (label, *_bounds(run, variable, (i,)), units[i % len(units)], data.values[-1, i])
            for i, label in enumerate(labels)
        ]
    for label, low, high, unit, end in rows:
        shown = symbol_text(label) + ("" if unit == "1" else f" ({unit})")
        lines.append(f"  {shown:<14}{low:>12.6g}{high:>12.6g}{end:>12.6g}")
    lines += ["", *_distance(scenario, run)]
    return "\n".join(lines)


def _bounds(run: xarray.Dataset, name: str, index: tuple[int, ...]) -> tuple[float, float]:
    low, high = (np.asarray(run[name].attrs[key])[index] for key in ("min", "max"))
    return float(low), float(high)


def _outcome(run: xarray.Dataset, seconds: float) -> str:
    outcome, end = run.attrs["outcome"], run.attrs["end_time"]
    words = {
        "completed": f"completed: {end:g} s",
        "escaped": f"escaped to infinity at t = {end:.6g} s; the run ends there",
        "left the data": f"left the field's data at t = {end:.6g} s; the run ends there",
    }[outcome]
    if run.attrs["engine"] == "sampled":
        return f"{words}   [sampled every {run.attrs['dt']:g} s, {seconds:.2g} s]"
    engine = {"taylor": "Taylor (heyoka)", "reference": "DOP853 (SciPy)"}[run.attrs["engine"]]
    if not taylor.available():
        engine += "; heyoka is not installed, so every run uses it"
    return f"{words}   [{engine}, {seconds:.2g} s]"


def _distance(scenario: Scenario, run: xarray.Dataset) -> list[str]:
    if "source" not in run:
        return []
    distance = np.linalg.norm(run.position.values - run.source.values, axis=1)
    lines = [
        f"  distance to the source: {distance[0]:.4g} m at the start, "
        f"{distance[-1]:.4g} m at the end"
    ]
    period = scenario.loop.system.common_period(scenario.loop.values.tolist())
    if period and run.attrs["outcome"] == "completed" and run.time.values[-1] > period:
        far = float(np.linalg.norm(_last_mean(run, period)))
        lines.append(f"  mean over the last period of the dither: {far:.4g} m from the source")
    return lines


def _last_mean(run: xarray.Dataset, period: float) -> NDArray[np.float64]:
    """Return the mean offset from the source over exactly one period, by the trapezoidal rule."""
    times, offset = run.time.values, run.position.values - run.source.values
    begin = times[-1] - period
    inside = times > begin
    first = [np.interp(begin, times, column) for column in offset.T]
    whole = np.concatenate([[first], offset[inside]])
    return np.trapezoid(whole, np.concatenate([[begin], times[inside]]), axis=0) / period
