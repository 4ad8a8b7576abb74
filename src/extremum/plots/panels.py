"""What every figure is made of: axes, curves, marks and contours, drawn with matplotlib."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from ..fields import Field
from .scenes import Array, Interval, Scene, early_end, label, padded, span, unit_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# Okabe and Ito's colours, which the colour-blind tell apart; in print the markers do.
COLOURS: Final = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#000000")
MARKERS: Final = "osD^vPX"
VERMILION: Final = "#D55E00"
STAR: Final = {"marker": "*", "markersize": 14, "color": VERMILION, "markeredgecolor": "black"}
CIRCLE: Final = {"marker": "o", "markersize": 6.5, "color": "white", "markeredgecolor": "black"}
SQUARE: Final = {"marker": "s", "markersize": 5, "color": "black", "markeredgecolor": "white"}
VEHICLE: Final = SQUARE | {"markersize": 8}
CROSS: Final = {"marker": "X", "markersize": 8, "color": "black", "markeredgecolor": "white"}
PALE: Final = "#a3c2e0"
EQUAL_UP_TO: Final = 4.0
LEVELS: Final = 12


def empty_figure(run: xarray.Dataset, width: float, height: float) -> Figure:
    """Return a figure with the run's title, wrapped, and how the run ended if it ended early."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    lines = textwrap.wrap(run.attrs.get("title", ""), int(12.5 * width))
    if early_end(run):
        lines.append(f"{early_end(run)} at t = {run.attrs['end_time']:.4g} s")
    if lines:
        figure.suptitle("\n".join(lines), fontsize=11, parse_math=False)
    return figure


def over_time(
    axes: Axes, run: xarray.Dataset, column: Array, text: str, limits: Interval | None
) -> None:
    """Draw one quantity over time."""
    dress(axes, [label("t", unit_of(run.time)), text], [span(run), limits or padded(run, column)])
    curve(axes, np.column_stack([run.time.values, column]))
    mark_early_end(axes, run)


def samples(axes: Axes, run: xarray.Dataset, *, free: bool) -> None:
    """Draw what a sampled loop's controller received behind J, where that is another thing.

    `free` says that the axes may be widened for it.
    """
    if "sensed" in run and not run.sensed.equals(run.J):
        axes.plot(
            run.time.values, run.sensed.values, color="0.72", lw=0.5, zorder=1, label="received"
        )
        if free:
            low, high = axes.get_ylim()
            least, most = float(run.sensed.min()), float(run.sensed.max())
            axes.set_ylim(min(low, least), max(high, most))


def stage(figure: Figure, place: Any, scene: Scene) -> Axes:
    """Return axes for a scene, still without curves."""
    widths = [high - low for low, high in scene.limits]
    equal = scene.kind == "space" and max(widths) <= EQUAL_UP_TO * min(widths)
    if len(widths) == 3:
        space = cast(Any, figure.add_subplot(place, projection="3d", computed_zorder=False))
        space.set_box_aspect(widths if equal else None, zoom=0.9)
        space.locator_params(nbins=4)
        dress(space, scene.labels, scene.limits)
        space.tick_params(pad=2)
        for axis in (space.xaxis, space.yaxis, space.zaxis):
            axis.labelpad = 4
        return space
    axes = figure.add_subplot(place)
    dress(axes, scene.labels, scene.limits)
    axes.locator_params(nbins=6)
    if equal:
        axes.locator_params(axis="x", nbins=max(3, round(6 * min(1.0, widths[0] / widths[1]))))
    axes.set_aspect("equal" if equal else "auto")
    return axes


def dress(axes: Any, labels: list[str], limits: list[Interval]) -> None:
    """Set every coordinate's label and range."""
    for name, text, (low, high) in zip("xyz", labels, limits, strict=False):
        axes.set(**{f"{name}label": text, f"{name}lim": (low, high)})
    axes.tick_params(labelsize=9)
    axes.grid(visible=True, color="0.88", linewidth=0.5)
    axes.set_axisbelow(True)


def curve(axes: Axes, points: Array, **style: Any) -> Line2D:
    """Draw a curve, a single point as a dot."""
    style = {"color": COLOURS[0], "linewidth": 0.8} | style
    if len(points) == 1:
        style |= {"marker": ".", "markersize": 8}
    return axes.plot(*points.T, **style)[0]


def move(line: Any, points: Array) -> None:
    """Give a curve other points."""
    (line.set_data_3d if points.shape[1] == 3 else line.set_data)(*points.T)


def tracks(axes: Axes, scene: Scene) -> list[Line2D]:
    """Draw the vehicle's curves: one per axis over time, told apart by their markers."""
    lines, count = [], len(scene.tracks)
    for index, (name, points) in enumerate(scene.tracks.items()):
        style: dict[str, Any] = {"color": COLOURS[index % len(COLOURS)], "label": name}
        if count > 1:
            step = len(points) // 8 or 1
            style |= {"marker": MARKERS[index % len(MARKERS)], "markersize": 5}
            style |= {"markevery": (step * index // count, step)}
        lines.append(curve(axes, points, **style))
    return lines


def source_paths(axes: Axes, scene: Scene) -> None:
    """Draw where the source moves, dashed, in its axis' colour where there are several."""
    dashed = {"linestyle": (0, (4, 2)), "linewidth": 1.3, "zorder": 3}
    colours = ("black",) if len(scene.tracks) == 1 else COLOURS
    for index, points in enumerate(scene.sources):
        if is_moving(points):
            text = "source" if index == 0 else None
            curve(axes, points, color=colours[index % len(colours)], label=text, **dashed)


def averaged_paths(axes: Axes, scene: Scene) -> None:
    """Draw the averaged loop's path, dash-dotted, in its axis' colour where there are several."""
    style = {"linestyle": "-.", "linewidth": 1.6, "zorder": 3.5}
    colours = (VERMILION,) if len(scene.tracks) == 1 else COLOURS
    for index, points in enumerate(scene.averaged):
        text = "averaged" if index == 0 else None
        curve(axes, points, color=colours[index % len(colours)], label=text, **style)


def marks(axes: Axes, scene: Scene, run: xarray.Dataset) -> None:
    """Mark where source and vehicle start and end."""
    if scene.kind == "time":
        mark_early_end(axes, run)
        return
    (track,) = scene.tracks.values()
    places = []
    for path in scene.sources:
        moving = is_moving(path)
        if moving:
            places.append((path[0], "source at the start", STAR | {"color": "white"}))
        places.append((path[-1], "source at the end" if moving else "source", STAR))
    places.append((track[0], "start", CIRCLE))
    places.append((track[-1], "end", CROSS if early_end(run) else SQUARE))
    for point, text, style in places:
        limits = zip(point, scene.limits, strict=True)
        outside = not all(low <= x <= high for x, (low, high) in limits)
        mark(axes, point[None], label=f"{text} (outside)" if outside else text, **style)


def mark(axes: Axes, point: Array, **style: Any) -> Line2D:
    """Draw a marker at a point, an array (1, coordinate)."""
    return axes.plot(*point.T, linestyle="", zorder=5, **style)[0]


def mark_early_end(axes: Axes, run: xarray.Dataset) -> None:
    """Draw a line at the time when the run ended early."""
    if early_end(run):
        axes.axvline(run.attrs["end_time"], color="black", linestyle=":", label=early_end(run))


def is_moving(points: Array) -> bool:
    """Return whether a curve is more than one point."""
    return bool(np.ptp(points, axis=0).any())


def ground(scene: Scene, field: Field | None, time: float) -> list[Array]:
    """Return the field over the scene at a time: coordinates and J; nothing where none is drawn."""
    if field is None or scene.kind == "time" or len(scene.labels) == 3:
        return []
    lines = [np.linspace(low, high, 121) for low, high in scene.limits]
    mesh = lines[:1] if scene.kind == "profile" else np.meshgrid(*lines)
    return [*mesh, field.at(*mesh, time=time)]


def levels(grounds: list[list[Array]]) -> Array | None:
    """Return contours' values of J that serve all these times; None where J is constant."""
    from matplotlib.ticker import MaxNLocator

    values = np.concatenate([around[-1].ravel() for around in grounds if around] or [np.empty(0)])
    values = values[np.isfinite(values)]
    if not values.size or values.min() == values.max():
        return None
    return np.asarray(MaxNLocator(LEVELS).tick_values(values.min(), values.max()))


def paint(axes: Axes, around: list[Array], heights: Array | None) -> list[Any]:
    """Draw the field: a curve along one axis, contours in the plane, the filled ones first."""
    if len(around) == 2:
        return axes.plot(*around, color="0.6", linewidth=3, zorder=1, label="field")
    if not around or heights is None:
        return []
    from matplotlib.colors import LinearSegmentedColormap

    axes.grid(visible=False)
    pale = LinearSegmentedColormap.from_list("pale", ["#ffffff", PALE])
    return [
        axes.contourf(*around, heights, cmap=pale, zorder=0),
        axes.contour(
            *around, heights, colors="0.5", linewidths=0.4, linestyles="solid", zorder=0.5
        ),
    ]


def colour_bar(axes: Axes, painted: list[Any], text: str) -> None:
    """Say what the filled contours mean, where there are any."""
    if len(painted) == 2:
        bar = axes.figure.colorbar(painted[0], cax=axes.inset_axes((1.04, 0, 0.04, 1)))
        bar.ax.set_title(text, fontsize=10)
        bar.ax.tick_params(labelsize=9)


def legend(figure: Figure, *panels: Axes) -> None:
    """Name what the panels show, once and below them all."""
    named: dict[str, Any] = {}
    for axes in panels:
        for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(text, handle)
    lines = -(-len(named) // int(figure.get_figwidth() / 1.5))
    figure.legend(
        list(named.values()),
        list(named),
        loc="outside lower center",
        ncols=-(-len(named) // lines),
        fontsize=9,
        frameon=False,
    )
