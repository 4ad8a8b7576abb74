"""The basin of attraction of Fig. 4: what becomes of every start in the plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ..engines.trajectory import Progress
from ..ensembles import ensemble
from ..papers import zhang2007
from ..plots.panels import CIRCLE, STAR
from .common import counted, empty_figure, key, packed, side

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

TITLE: Final = "Basin of attraction of the paper's Fig. 4"
LOOPS: Final = 1_000_000
LEAST: Final = 4
RANGES: Final = ((-7.0, 11.0), (-14.0, 4.0))
"""Starts in x and y (m)."""
T_END: Final = 20.0
RADIUS: Final = 0.2
"""What of the source is near (m): the dither takes the vehicle 0.08 m from it."""

CONVERGED, ESCAPED, OTHER = range(3)


def study(loops: int = LOOPS, *, progress: Progress | None = None) -> xarray.Dataset:
    """Run Fig. 4 from a square grid of starts.

    Returns
    -------
    xarray.Dataset
        ``fate(start_y, start_x)``: 0 converged (within 0.2 m of the source at the end), 1 escaped,
        2 neither; ``settling_time``, ``end_time`` (s), the escape's where it escaped.
    """
    import xarray

    loop = zhang2007.scenario("fig4").loop
    count = side(counted(loops, LEAST))
    lines = [np.linspace(*ends, count) for ends in RANGES]
    x, y = (xarray.DataArray(v, dims=f"start_{n}") for v, n in zip(lines, "xy", strict=True))
    found = ensemble(
        loop,
        T_END,
        over={"start.1": y, "start.0": x},
        keep=("settling_time",),
        radius=RADIUS,
        progress=progress,
    )
    near = np.isfinite(found.settling_time)
    fate = xarray.where(near, CONVERGED, xarray.where(found.outcome == 1, ESCAPED, OTHER))
    shares = [float((fate == kind).mean()) for kind in (CONVERGED, ESCAPED, OTHER)]
    area = float(np.prod(np.ptp(RANGES, axis=1)))
    last = float(found.end_time.where(fate == ESCAPED).max())
    gaps = [v - u for v, u in zip((x, y), loop.start, strict=True)]
    margin = float(np.sqrt(gaps[0] ** 2 + gaps[1] ** 2).where(fate == ESCAPED).min())
    finding = (
        f"{shares[0]:.2%} of the starts converge, {shares[0] * area:.1f} m² of the {area:.0f} m² "
        f"shown; {shares[1]:.2%} escape, all within {last:.2g} s; {shares[2]:.2%} do neither; the "
        f"paper's start is {margin:.2g} m from one that escapes"
    )
    kept = xarray.Dataset(
        {
            "fate": fate.astype("int8").assign_attrs(
                flag_values=np.arange(3, dtype=np.int8),
                flag_meanings="converged escaped neither",
                long_name="what became of the loop",
            ),
            "settling_time": found.settling_time,
            "end_time": found.end_time,
        },
        attrs=found.attrs,
    )
    kept = kept.assign_coords(start_x=("start_x", lines[0], {"units": "m"}))
    kept = kept.assign_coords(start_y=("start_y", lines[1], {"units": "m"}))
    title = f"{TITLE}: {found.attrs['loops']:,} starts"
    return packed(kept.drop_vars(["start.0", "start.1"]), title=title, finding=finding)


def figure(found: xarray.Dataset) -> Figure:
    """Draw the plane of starts.

    Blue converges, the darker the later; orange escapes, the darker the sooner; grey does neither.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, NullFormatter

    drawn = empty_figure(found, 7.6, 6.4)
    axes = drawn.add_subplot()
    x, y, fate = found.start_x.values, found.start_y.values, found.fate.values
    extent = (x[0], x[-1], y[0], y[-1])
    escape = np.where(fate == ESCAPED, found.end_time.values, np.nan)
    shown = {"extent": extent, "origin": "lower", "interpolation": "none"}
    axes.set_facecolor("0.6")
    scale = LogNorm() if np.isfinite(escape).any() else None
    late = axes.imshow(escape, cmap="YlOrBr_r", norm=scale, **shown)
    settled = axes.imshow(found.settling_time.values, cmap="Blues", vmin=0, **shown)
    if 0 < (fate == CONVERGED).mean() < 1:
        axes.contour(x, y, fate == CONVERGED, [0.5], colors="black", linewidths=0.6)
    loop = zhang2007.scenario("fig4").loop
    for point, text, style in (
        (loop.field.source, "source", STAR),  # pyright: ignore[reportAttributeAccessIssue]
        (loop.start, "the paper's start", CIRCLE),
    ):
        axes.plot(*point, linestyle="", label=text, **style)
    axes.plot([], [], color="black", linewidth=0.6, label="boundary of the basin")
    if (fate == OTHER).any():
        axes.plot([], [], "s", color="0.6", label="neither")
    axes.set(xlabel="start in $x$ (m)", ylabel="start in $y$ (m)")
    drawn.colorbar(settled, ax=axes, shrink=0.9, label="converges: time until 0.2 m near (s)")
    bar = drawn.colorbar(late, ax=axes, shrink=0.9, label="escapes: time until then (s)")
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    key(drawn, axes, 4)
    return drawn
