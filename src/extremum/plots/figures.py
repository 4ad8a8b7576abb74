"""`overview` and `trajectory`: a run as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..scenario import View
from . import panels
from .scenes import checked, checked_path, field_of, label, motion, over_field, unit_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


def overview(
    run: xarray.Dataset, view: View | None = None, *, averaged: xarray.Dataset | None = None
) -> Figure:
    """Show a run as the paper does: J, the trajectory and every input.

    Panel (a) is J over time (s), of a sampled loop with what its controller received; (b) the
    vehicle's path in the plane or in space (m) with the source, for one axis and for more than
    three the position over time; the others are the inputs over time, each in its unit. A run that
    ended early says so, and when.

    Parameters
    ----------
    run
        What `simulate` returned.
    view
        Ranges of the axes; what it leaves out is chosen from the data.
    averaged
        What ``average(loop).simulate(t_end)`` returned: drawn over the path in (b), dash-dotted.

    Returns
    -------
    matplotlib.figure.Figure
        To be saved with ``figure.savefig``.

    Raises
    ------
    InvalidDescription
        If `view` has not one range per axis and per input, or `averaged` is no path of as many
        axes.
    """
    view, averaged = checked(view, run), checked_path(averaged, run)
    names = [str(name) for name in np.atleast_1d(run.input.attrs["names"])]
    units = unit_of(run.input).split(", ")
    ranges = view.inputs or [None] * len(names)
    across = {1: 1, 2: 2, 4: 2}.get(len(names), 3)
    rows = 1 + -(-len(names) // across)
    figure = panels.empty_figure(run, 9.0, 3.5 * rows)
    grid = figure.add_gridspec(rows, 6)

    output = figure.add_subplot(grid[0, :3])
    panels.over_time(output, run, run.J.values, label("J", unit_of(run.J)), view.signal)
    panels.samples(output, run, free=view.signal is None)
    output.set_title("(a) output", loc="left", fontsize=10)

    scene = motion(run, view, averaged)
    path = panels.stage(figure, grid[0, 3:], scene)
    panels.tracks(path, scene)
    panels.source_paths(path, scene)
    panels.averaged_paths(path, scene)
    panels.marks(path, scene, run)
    path.set_title("(b) trajectory", loc="left", fontsize=10)

    width = 6 // across
    for index, (name, limits) in enumerate(zip(names, ranges, strict=True)):
        row, column = divmod(index, across)
        axes = figure.add_subplot(grid[1 + row, column * width : (column + 1) * width])
        text = label(name, units[index % len(units)])
        panels.over_time(axes, run, run.input.values[:, index], text, limits)
        axes.set_title(f"({chr(ord('c') + index)}) input", loc="left", fontsize=10)
    panels.legend(figure, path, output)
    return figure


def trajectory(run: xarray.Dataset, view: View | None = None) -> Figure:
    """Show where the vehicle went, over the field that it did not know.

    Two axes: the path (m) over contours of J, those of a moving field at the run's end. One axis:
    J along x, with the field's curve at the run's end. Three: the path in space. More: position (m)
    over time (s). Contours and curve need the scenario in ``run.attrs``, and end where a gridded
    field's data do.

    Parameters
    ----------
    run
        What `simulate` returned.
    view
        Ranges of the axes; what it leaves out is chosen from the data.

    Returns
    -------
    matplotlib.figure.Figure
        To be saved with ``figure.savefig``.

    Raises
    ------
    InvalidDescription
        If `view` has not one range per axis and per input, or the scenario in ``run.attrs`` names
        data that are no longer there.
    """
    view = checked(view, run)
    field = field_of(run)
    scene = over_field(run, view, field)
    figure = panels.empty_figure(run, 7.0, 6.0)
    axes = panels.stage(figure, 111, scene)
    around = panels.ground(scene, field, float(run.time[-1]))
    painted = panels.paint(axes, around, panels.levels([around]))
    panels.colour_bar(axes, painted, label("J", unit_of(run.J)))
    panels.tracks(axes, scene)
    panels.source_paths(axes, scene)
    panels.marks(axes, scene, run)
    panels.legend(figure, axes)
    return figure
