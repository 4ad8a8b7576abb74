"""`animate`: a run as a moving picture."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

import numpy as np

from ..errors import InvalidDescription, shown
from ..scenario import View
from . import panels
from .scenes import Array, checked, field_of, is_still, label, motion, profile, unit_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

DPI: Final = 100


def animate(
    run: xarray.Dataset,
    path: Path | str,
    *,
    view: View | None = None,
    seconds: float = 8.0,
    frames_per_second: int = 25,
) -> None:
    """Write an animation: the vehicle over the field as in `trajectory`, and J beside it.

    The file appears when it is complete; if anything fails, what was there before stays.

    Parameters
    ----------
    run
        What `simulate` returned.
    path
        A file that ends in ``.gif``, or in ``.mp4`` where ffmpeg is installed.
    view
        Ranges of the axes; what it leaves out is chosen from the data.
    seconds
        Duration of the animation (s).
    frames_per_second
        Its frames per second.

    Raises
    ------
    InvalidDescription
        For another suffix, an MP4 without ffmpeg, a folder that does not exist, a duration or rate
        that is not positive, and as `trajectory` does.
    """
    import matplotlib
    from matplotlib.animation import FFMpegWriter, PillowWriter

    path = Path(path)
    kind = {".gif": PillowWriter, ".mp4": FFMpegWriter}.get(path.suffix.lower())
    if kind is None:
        raise InvalidDescription("path", "must end in .gif or .mp4", shown(str(path)))
    if not kind.isAvailable():
        raise InvalidDescription(
            "path",
            "needs the program ffmpeg, which is not installed here; install it (apt install "
            "ffmpeg, brew install ffmpeg), or write a .gif",
            shown(str(path)),
        )
    if not path.parent.is_dir():
        raise InvalidDescription("path", "lies in a folder that does not exist", shown(str(path)))
    for name, given in (("seconds", seconds), ("frames_per_second", frames_per_second)):
        if not 0 < given < np.inf:
            raise InvalidDescription(name, "must be a finite number greater than 0", shown(given))

    times = np.linspace(0.0, float(run.time[-1]), max(1, round(seconds * frames_per_second)))
    figure, show = _film(run, checked(view, run), times)
    with (
        TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder,
        matplotlib.rc_context({"savefig.bbox": None}),
    ):
        part = Path(folder) / path.name
        writer = kind(fps=frames_per_second)
        writer.setup(figure, str(part), DPI)
        try:
            for now in times:
                show(now)
                writer.grab_frame()
        except BaseException:
            with suppress(Exception):  # a writer cut short fails too, which would hide the reason
                writer.finish()
            raise
        writer.finish()
        os.replace(part, path)


def _film(run: xarray.Dataset, view: View, times: Array) -> tuple[Figure, Callable[[float], None]]:
    """Return the figure, and what brings it to a time."""
    field = field_of(run)
    scene = profile(run, view, field) if run.sizes["axis"] == 1 else motion(run, view)
    figure = panels.empty_figure(run, 9.6, 4.8)
    grid = figure.add_gridspec(1, 2)
    axes, output = panels.stage(figure, grid[0, 0], scene), figure.add_subplot(grid[0, 1])

    samples, text = run.time.values, label("J", unit_of(run.J))
    grounds = [panels.ground(scene, field, time) for time in times[:: len(times) // 8 or 1]]
    heights = panels.levels(grounds)
    painted = panels.paint(axes, grounds[0], heights)
    panels.colour_bar(axes, painted, text)
    panels.source_paths(axes, scene)
    tails = panels.tracks(axes, scene)
    panels.over_time(output, run, run.J.values, text, view.signal)
    panels.legend(figure, axes, output)
    stars = scene.sources if scene.kind != "time" else []
    marks = [(panels.mark(axes, path[0], **panels.STAR), path) for path in stars]
    marks += [
        (panels.mark(axes, track[0], **panels.SQUARE), track) for track in scene.tracks.values()
    ]
    clock = output.axvline(0.0, color="black", linewidth=1)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once: the panels stay where they are

    def at(now: float, curve: Array) -> Array:
        return np.array([[np.interp(now, samples, column) for column in curve.T]])

    def show(now: float) -> None:
        count = int(np.searchsorted(samples, now, side="right"))
        for mark, path in marks:
            panels.move(mark, at(now, path))
        for line, track in zip(tails, scene.tracks.values(), strict=True):
            panels.move(line, np.vstack([track[:count], at(now, track)]))
        clock.set_xdata([now, now])
        output.set_title(f"$t$ = {now:.2f} s", loc="left", fontsize=10)
        if field is not None and not is_still(field, run.sizes["axis"]):
            while painted:
                painted.pop().remove()
            painted.extend(panels.paint(axes, panels.ground(scene, field, now), heights))

    return figure, show
