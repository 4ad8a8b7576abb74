"""`animate`: a run as a moving picture."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidDescription, shown
from ..scenario import View
from . import panels
from .scenes import Array, checked, field_of, is_still, label, over_field, unit_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure
    from PIL import Image


def animate(
    run: xarray.Dataset,
    path: Path | str,
    *,
    view: View | None = None,
    seconds: float = 8.0,
    frames_per_second: int = 25,
    progress: Callable[[float], object] | None = None,
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
    progress
        Called with the part that is done, 0 … 1, after every frame.

    Raises
    ------
    InvalidDescription
        For another suffix, an MP4 without ffmpeg, a folder that does not exist, a duration or rate
        that is not positive, and as `trajectory` does.
    """
    path = Path(path)
    check_animation(path)
    if not path.parent.is_dir():
        raise InvalidDescription("path", f"there is no folder {path.parent}", shown(path.name))
    for name, given in (("seconds", seconds), ("frames_per_second", frames_per_second)):
        if not 0 < given < np.inf:
            raise InvalidDescription(name, "must be a finite number greater than 0", shown(given))
    times = np.linspace(0.0, float(run.time[-1]), max(1, round(seconds * frames_per_second)))
    film = _film(run, checked(view, run), times)
    if progress is not None:
        film = _reported(film, len(times), progress)
    write = _WRITERS[path.suffix.lower()]
    with TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder:
        part = Path(folder) / path.name
        write(film, times, part, frames_per_second)
        os.replace(part, path)


def check_animation(path: Path | str) -> None:
    """Raise `InvalidDescription` if no animation of this name can be written here."""
    from matplotlib.animation import FFMpegWriter

    path = Path(path)
    if path.suffix.lower() not in _WRITERS:
        raise InvalidDescription("path", "must end in .gif or .mp4", shown(path.name))
    if path.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise InvalidDescription(
            "path",
            "needs the program ffmpeg, which is not installed here; install it (apt install "
            "ffmpeg, brew install ffmpeg), or write a .gif",
            shown(path.name),
        )


@dataclass(frozen=True)
class _Film:
    """A figure, and what brings it to a time."""

    figure: Figure
    show: Callable[[float], None]


def _write_gif(film: _Film, times: Array, path: Path, rate: int) -> None:
    """Write frames in the last one's commonest 255 colours; few pixels change, the file is small.

    Pillow looks colours up by their upper six bits, so it is asked with those, one colour for each;
    the 256th it needs for "unchanged".
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(film.figure)

    def picture(now: float) -> Image.Image:
        film.show(now)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    cells: dict[tuple[int, ...], tuple[int, ...]] = {}
    for colour in _commonest_first(picture(times[-1])):
        cells.setdefault(tuple(c & 0xFC for c in colour), colour)
    asked, given = (list(chain(*colours))[: 3 * 255] for colours in (cells, cells.values()))
    palette = Image.new("P", (1, 1))
    palette.putpalette(asked)

    def indexed(now: float) -> Image.Image:
        frame = picture(now).quantize(palette=palette, dither=Image.Dither.NONE)
        frame.putpalette(given)
        return frame

    frames = map(indexed, times)
    with path.open("wb") as file:
        next(frames).save(
            file,
            format="GIF",
            save_all=True,
            append_images=frames,
            duration=round(1000 / rate),
            loop=0,
            optimize=True,
        )


def _commonest_first(picture: Image.Image) -> list[tuple[int, ...]]:
    colours, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    return [tuple(colour) for colour in colours[np.argsort(-counts)].tolist()]


def _write_mp4(film: _Film, times: Array, path: Path, rate: int) -> None:
    from matplotlib import rc_context
    from matplotlib.animation import FFMpegWriter

    writer = FFMpegWriter(fps=rate)
    with rc_context({"savefig.bbox": None}):
        writer.setup(film.figure, path)
        try:
            for now in times:
                film.show(now)
                writer.grab_frame()
        except BaseException:
            with suppress(Exception):  # it fails too when cut short, which would hide the reason
                writer.finish()
            raise
        writer.finish()


_WRITERS = {".gif": _write_gif, ".mp4": _write_mp4}


def _reported(film: _Film, count: int, progress: Callable[[float], object]) -> _Film:
    done = iter(range(1, count + 2))

    def show(now: float) -> None:
        film.show(now)
        progress(min(1.0, next(done) / count))

    return _Film(film.figure, show)


def _film(run: xarray.Dataset, view: View, times: Array) -> _Film:
    field = field_of(run)
    scene = over_field(run, view, field)
    still = field is None or is_still(field, run.sizes["axis"])
    samples, text = run.time.values, label("J", unit_of(run.J))
    decimals = max(0, 2 - int(np.floor(np.log10(times[-1] or 1.0))))

    figure = panels.empty_figure(run, 9.6, 4.8)
    figure.set_dpi(100)
    grid = figure.add_gridspec(1, 2)
    axes, output = panels.stage(figure, grid[0, 0], scene), figure.add_subplot(grid[0, 1])
    panels.over_time(output, run, run.J.values, text, view.signal)
    clock = output.axvline(0.0, color="black", linewidth=1)
    moments = times[:1] if still else times[:: len(times) // 8 or 1]
    grounds = [panels.ground(scene, field, now) for now in moments]
    heights = panels.levels(grounds)
    painted = panels.paint(axes, grounds[0], heights)
    panels.colour_bar(axes, painted, text)
    tails = panels.tracks(axes, scene)
    panels.source_paths(axes, scene)
    sources = [] if scene.kind == "time" else scene.sources
    marks = [(panels.mark(axes, c[:1], **panels.STAR, label="source"), c) for c in sources]
    marks += [(panels.mark(axes, c[:1], **panels.VEHICLE), c) for c in scene.tracks.values()]
    panels.legend(figure, axes, output)

    def at(now: float, curve: Array) -> Array:
        return np.array([[np.interp(now, samples, column) for column in curve.T]])

    def show(now: float) -> None:
        count = int(np.searchsorted(samples, now, side="right"))
        for mark, curve in marks:
            panels.move(mark, at(now, curve))
        for line, curve in zip(tails, scene.tracks.values(), strict=True):
            panels.move(line, np.vstack([curve[:count], at(now, curve)]))
        clock.set_xdata([now, now])
        output.set_title(f"$t$ = {now:.{decimals}f} s", loc="left", fontsize=10)
        if not still:
            while painted:
                painted.pop().remove()
            painted.extend(panels.paint(axes, panels.ground(scene, field, now), heights))

    show(0.0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once: the panels stay where they are
    return _Film(figure, show)
