"""The ε = 0.5 loop on maps whose curvature nobody knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..engines.trajectory import Progress
from ..ensembles import ensemble
from ..loop import Loop
from ..papers import zhang2007
from ..plots.panels import COLOURS, STAR, VERMILION
from ..theory import average, periodic_orbit
from ..theory.demodulation import gradient
from .common import counted, empty_figure, packed

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = NDArray[np.float64]

TITLE: Final = "Unstable poles ε = 0.5 on maps of unknown curvature"
LOOPS: Final = 100_000
LEAST: Final = 10
SPREAD: Final = 10.0
"""Each curvature lies between a tenth and ten times the scenario's."""
T_END: Final = 200.0
RADIUS: Final = 0.5
"""What of the source is near (m): the dither takes the vehicle 0.2 m from it."""
NEAR: Final = 0.05
"""Where the mean position must end to have converged (m)."""
NODES: Final = 33
"""Curvatures of each axis at which theory is asked."""
BINS: Final = 40
POLE: Final = "vehicle.axes.0.parameters.epsilon"
SEED: Final = 2007

CONVERGED, CIRCLING, ESCAPED = range(3)


def study(loops: int = LOOPS, *, progress: Progress | None = None) -> xarray.Dataset:
    """Draw both curvatures log-uniformly and run the loop; ask theory on a grid.

    Returns
    -------
    xarray.Dataset
        ``q_x(draw)``, ``q_y(draw)`` (1/m²); ``fate(draw)``: 0 converged, 1 still at a distance,
        2 escaped; ``distance`` of the mean position to the source over the last period and
        ``settling_time``; ``exponent(grid_y, grid_x)``, the largest real part of the Floquet
        exponents (1/s), and ``averaged(grid_y, grid_x)``, that of the averaged loop.
    """
    import xarray

    count = counted(loops, LEAST)
    loop = zhang2007.scenario("unstable").loop
    nominal = np.array([_number(loop, f"field.q.{i}") for i in (0, 1)])
    draws = np.random.default_rng(SEED).uniform(-1.0, 1.0, (2, count))
    q = nominal[:, None] * SPREAD**draws
    found = ensemble(
        loop,
        T_END,
        over={f"field.q.{i}": xarray.DataArray(q[i], dims="draw") for i in (0, 1)},
        keep=("distance", "settling_time"),
        radius=RADIUS,
        progress=progress,
    )
    fate = np.where(found.distance < NEAR, CONVERGED, CIRCLING)
    fate[found.outcome == 1] = ESCAPED
    lines = nominal[:, None] * np.geomspace(1 / SPREAD, SPREAD, NODES)
    exponent, averaged = theory(loop, *lines)
    kept = found[["distance", "settling_time"]]
    kept = kept.rename({"field.q.0": "q_x", "field.q.1": "q_y"}).assign(
        fate=("draw", fate.astype(np.int8)),
        exponent=(("grid_y", "grid_x"), exponent, {"units": "1/s"}),
        averaged=(("grid_y", "grid_x"), averaged, {"units": "1/s"}),
    )
    kept = kept.assign_coords(grid_x=lines[0], grid_y=lines[1])
    kept.fate.attrs |= {
        "flag_values": np.arange(3, dtype=np.int8),
        "flag_meanings": "converged circling escaped",
    }
    stable = predicted(kept, q[0], q[1])
    shares = [float((fate == kind).mean()) for kind in (CONVERGED, CIRCLING, ESCAPED)]
    lost = float((fate == ESCAPED)[stable].mean())
    finding = (
        f"{shares[0]:.1%} converge, {shares[1]:.1%} keep circling at a distance, {shares[2]:.1%} "
        f"escape; stable by Floquet multipliers are {stable.mean():.1%}, of which {lost:.1%} "
        "escape from the scenario's start"
    )
    return packed(kept, title=f"{TITLE}: {count:,} loops", finding=finding)


def _number(loop: Loop, path: str) -> float:
    paths = [parameter.path for parameter in loop.system.parameters]
    return float(loop.values[paths.index(path)])


def theory(loop: Loop, q_x: Vector, q_y: Vector) -> tuple[Vector, Vector]:
    """Return the largest real parts (1/s), Floquet's and the averaged loop's, (q_y, q_x)."""
    exact, averaged = np.full((2, len(q_y), len(q_x)), np.nan)
    for place in np.ndindex(exact.shape):
        changed = loop.replace({"field.q.0": q_x[place[1]], "field.q.1": q_y[place[0]]})
        orbit = periodic_orbit(changed)
        averaged[place] = average(changed).eigenvalues.real.max()
        if orbit.found:
            exact[place] = orbit.exponents[0].real
    return exact, averaged


def predicted(found: xarray.Dataset, q_x: Vector, q_y: Vector) -> NDArray[np.bool_]:
    """Return whether the exact orbit is stable, its exponents interpolated in ln q."""
    from scipy.interpolate import RegularGridInterpolator

    lines = np.log(found.grid_y.values), np.log(found.grid_x.values)
    exponent = RegularGridInterpolator(lines, found.exponent.values)
    return exponent(np.log(np.column_stack([q_y, q_x]))) < 0


# --- the figure -------------------------------------------------------------------------------

FATES: Final = (
    ("converges", "#0072B2"),
    ("keeps circling at a distance", "#d9d9d9"),
    ("escapes", "#E69F00"),
)


def figure(found: xarray.Dataset) -> Figure:
    """Draw the share that converges in the plane of curvatures, and all against the smaller one."""
    drawn = empty_figure(found, 11.0, 7.8)
    panels: Any = drawn.subplots(2, 2)
    _plane(panels[0, 0], found)
    smaller = np.minimum(found.q_x.values, found.q_y.values)
    edges = np.geomspace(smaller.min(), smaller.max(), BINS + 1)
    place = np.clip(np.digitize(smaller, edges) - 1, 0, BINS - 1)
    _shares(panels[0, 1], edges, [found.fate.values[place == k] for k in range(BINS)])
    for axes, name, last in (
        (panels[1, 0], "distance", CIRCLING),
        (panels[1, 1], "settling_time", CONVERGED),
    ):
        values = found[name].where(found.fate <= last).values
        _quantiles(axes, edges, [values[place == k] for k in range(BINS)])
    panels[1, 0].set(yscale="log", ylabel="distance of the mean position\nto the source (m)")
    panels[1, 1].set(yscale="log", ylim=(1, T_END), ylabel=f"time until {RADIUS:g} m near (s)")
    limits = _limits(found)
    for axes in panels.flat[1:]:
        axes.set(xscale="log", xlim=(edges[0], edges[-1]))
        axes.set_xlabel("the smaller of $q_x$ and $q_y$ (1/m²)")
        axes.axvspan(*limits, color="black", alpha=0.75, linewidth=0, label="exact limit")
        axes.axvline(_averaged_limit(found), color=VERMILION, linestyle="--", label=AVERAGED)
        axes.legend(fontsize=8, loc="best")
    headings = (
        "share that converges",
        "outcomes",
        "where those end that do not escape",
        "settling time of those that converge",
    )
    for letter, axes, text in zip("abcd", panels.flat, headings, strict=True):
        axes.set_title(f"({letter}) {text}", loc="left", fontsize=10)
    return drawn


NOBODY: Final = "#e8c9a0"
"""Colour of cells into which no loop was drawn."""

FEW: Final = 20
"""Quantiles of fewer loops say little."""
AVERAGED: Final = "averaged condition α c q > ε"


def _plane(axes: Axes, found: xarray.Dataset) -> None:
    ends = found.grid_x.values[[0, -1]], found.grid_y.values[[0, -1]]
    edges = [np.geomspace(low, high, BINS + 1) for low, high in ends]
    places = found.q_x.values, found.q_y.values
    every = np.histogram2d(*places, bins=edges)[0]

    def share(kind: int) -> Vector:
        there = (found.fate.values == kind).astype(float)
        with np.errstate(invalid="ignore"):
            return (np.histogram2d(*places, bins=edges, weights=there)[0] / every).T

    good = share(CONVERGED)
    axes.set_facecolor(NOBODY)
    painted = axes.pcolormesh(*edges, good, cmap="Blues", vmin=0, vmax=1, rasterized=True)
    middles = [np.sqrt(e[1:] * e[:-1]) for e in edges]
    axes.contourf(
        *middles, np.nan_to_num(share(ESCAPED)), [0.5, 1.0], colors="none", hatches=["////"]
    )
    axes.fill([], [], facecolor="none", edgecolor="black", hatch="////", label="most escape")
    if not every.all():
        axes.fill([], [], facecolor=NOBODY, label="no loop")
    figure: Any = axes.figure
    figure.colorbar(painted, ax=axes, label="share that converges")
    grid = found.grid_x.values, found.grid_y.values
    axes.contour(*grid, found.exponent.values, [0.0], colors="black", linewidths=1.8)
    axes.plot([], [], color="black", label="exact limit (Floquet multipliers)")
    dashed = {"colors": VERMILION, "linestyles": "--", "linewidths": 1.6}
    axes.contour(*grid, found.averaged.values, [0.0], **dashed)
    axes.plot([], [], color=VERMILION, linestyle="--", label=AVERAGED)
    nominal = np.sqrt(np.prod(ends, axis=1))
    axes.plot(*nominal, linestyle="", label="the scenario's curvatures", **STAR)
    axes.set(xscale="log", yscale="log", xlabel="$q_x$ (1/m²)", ylabel="$q_y$ (1/m²)")
    axes.legend(fontsize=8, loc="center right", framealpha=1)


def _shares(axes: Axes, edges: Vector, fates: list[NDArray[Any]]) -> None:
    table = [[(fate == kind).mean() if len(fate) else 0.0 for fate in fates] for kind in range(3)]
    base = np.zeros(len(fates))
    for (text, colour), row in zip(FATES, table, strict=True):
        axes.stairs(base + row, edges, baseline=base, fill=True, color=colour, label=text)
        base = base + row
    axes.set(ylim=(0, 1), ylabel="share of the loops")


def _quantiles(axes: Axes, edges: Vector, samples: list[Vector]) -> None:
    """Draw median, quartiles and 5 % to 95 % of each bin's finite values."""
    finite = [s[np.isfinite(s)] for s in samples]
    wanted = (0.05, 0.25, 0.5, 0.75, 0.95)
    nothing = np.full(len(wanted), np.nan)
    table = np.array([np.quantile(s, wanted) if len(s) > FEW else nothing for s in finite]).T
    for low, high, colour, text in (
        (table[0], table[4], "#cfe0f0", "5 % … 95 %"),
        (table[1], table[3], "#8fb8de", "25 % … 75 %"),
    ):
        axes.stairs(high, edges, baseline=low, fill=True, color=colour, label=text)
    axes.stairs(table[2], edges, baseline=None, color=COLOURS[0], linewidth=1.8, label="median")


def _limits(found: xarray.Dataset) -> tuple[float, float]:
    """Return the least and greatest smaller curvature along the exact limit."""
    from contourpy import contour_generator

    lines = contour_generator(found.grid_x, found.grid_y, found.exponent).lines(0.0)
    smaller = np.concatenate([np.asarray(line).min(axis=1) for line in lines])
    return float(smaller.min()), float(smaller.max())


def _averaged_limit(found: xarray.Dataset) -> float:
    loop = zhang2007.scenario("unstable").loop
    channel = gradient(loop).channels[0]
    return _number(loop, POLE) / (channel.gain * channel.dither.amplitude)
