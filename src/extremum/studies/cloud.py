"""A cloud of vehicles on a real landscape: each senses only the altitude under it."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..engines.trajectory import Progress
from ..ensembles import ensemble
from ..gridded import Grid, Gridded
from ..loop import Loop
from ..papers import zhang2007
from .common import counted, empty_figure, packed

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = NDArray[np.float64]

TITLE: Final = "Vehicles that sense only the altitude under them, on a real landscape"
LOOPS: Final = 100_000
LEAST: Final = 1
PICTURES: Final = 120
EVERY: Final = 2
"""How many dither periods are between two pictures."""
MARGIN: Final = 500.0
"""How far from the edge of the data the vehicles start at least (m)."""
CELL: Final = 300.0
"""Side of the cells in which vehicles are counted (m)."""
APART: Final = 150.0
"""Vehicles that arrived in cells of this side that touch stand on the same summit (m)."""
ARRIVED: Final = 0.5
"""What moves less than this between the last two pictures has arrived (m)."""
TOLERANCE: Final = 1e-5
SEED: Final = 2007


def landscape() -> tuple[Loop, Grid]:
    """Return the loop on the landscape, and the landscape."""
    loop = zhang2007.scenario("landscape").loop
    assert isinstance(loop.field, Gridded)
    return loop, loop.field.grid


def study(loops: int = LOOPS, *, progress: Progress | None = None) -> xarray.Dataset:
    """Scatter vehicles evenly over the map and let each climb.

    Returns
    -------
    xarray.Dataset
        ``start(vehicle, axis)`` and ``position(vehicle, axis)``, the mean over the last period (m);
        ``outcome(vehicle)`` as of `ensemble`; ``summit(vehicle)``, which one it has reached, −1 for
        none; ``vehicles(time, y, x)``, how many are in each cell; ``summit_position(top, axis)``,
        ``summit_altitude(top)`` (m) and ``summit_vehicles(top)``, the fullest first.
    """
    import xarray

    count = counted(loops, LEAST)
    loop, grid = landscape()
    low, high = (np.array([line[end] for line in grid.axes]) for end in (0, -1))
    fine, coarse = (
        [np.arange(a, b + d, d) for a, b in zip(low, high, strict=True)] for d in (APART, CELL)
    )
    start = np.random.default_rng(SEED).uniform(low + MARGIN, high - MARGIN, (count, 2))
    found = ensemble(
        loop,
        PICTURES * EVERY * 2 * pi / float(loop.controller.base()),
        over={f"start.{i}": xarray.DataArray(start[:, i], dims="vehicle") for i in (0, 1)},
        keep=("mean_position",),
        samples=PICTURES + 1,
        tol=TOLERANCE,
        progress=progress,
    )
    seen, mean = found.sampled_position.values, found.mean_position.values
    moved = np.linalg.norm(seen[:, -1] - seen[:, -2], axis=1)
    summit, tops, sizes = gathered(mean, moved < ARRIVED, fine)
    altitudes = loop.field.at(*tops.T)
    kept = xarray.Dataset(
        {
            "start": (("vehicle", "axis"), start, {"units": "m"}),
            "position": found.mean_position,
            "outcome": found.outcome,
            "summit": ("vehicle", summit),
            "vehicles": (("time", "y", "x"), _pictures(seen, coarse)),
            "summit_position": (("top", "axis"), tops, {"units": "m"}),
            "summit_altitude": ("top", altitudes, {"units": "m"}),
            "summit_vehicles": ("top", sizes),
        },
        {"time": found.time, "axis": found.axis, **_middles(coarse)},
        found.attrs,
    ).drop_vars(["start.0", "start.1"])
    heights = f" of {altitudes.min():.0f} to {altitudes.max():.0f} m" if len(tops) else ""
    finding = (
        f"{(summit >= 0).mean():.1%} have arrived, at {len(tops)} summits{heights}; "
        f"{float((found.outcome == 2).mean()):.1%} have left the map"
    )
    return packed(kept, title=f"{TITLE}: {count:,} loops", finding=finding)


def gathered(
    places: Vector, arrived: NDArray[np.bool_], edges: list[Vector]
) -> tuple[NDArray[np.int64], Vector, NDArray[np.int64]]:
    """Return the summits that vehicles stand on: each vehicle's, their places and their vehicles.

    Vehicles in cells that touch, at a corner too, stand on the same summit. The fullest is first;
    vehicles that have not arrived have −1.
    """
    from scipy.ndimage import label

    which = np.full(len(places), -1, dtype=np.int64)
    cells = tuple(np.digitize(places[arrived, i], line) - 1 for i, line in enumerate(edges))
    full = np.zeros([len(line) for line in edges], dtype=bool)
    full[cells] = True
    labelled: Any = label(full, np.ones((3, 3)))
    found = labelled[0][cells] - 1
    sizes = np.bincount(found)
    order = np.argsort(-sizes, kind="stable")
    which[arrived] = np.argsort(order)[found]
    tops = [places[which == k].mean(axis=0) for k in range(len(order))]
    return which, np.reshape(tops, (-1, 2)), sizes[order]


def _pictures(seen: Vector, edges: list[Vector]) -> NDArray[np.int32]:
    """Return how many vehicles are in each cell at each time, (time, y, x)."""
    rows = (seen[:, k, ::-1] for k in range(seen.shape[1]))
    pictures = [np.histogram2d(*row.T, bins=edges[::-1])[0] for row in rows]
    return np.array(pictures, dtype=np.int32)


def _middles(edges: list[Vector]) -> dict[str, Any]:
    middles = [(line[1:] + line[:-1]) / 2 for line in edges]
    return {n: (n, v, {"units": "m"}) for n, v in zip("xy", middles, strict=True)}


# --- the figures ------------------------------------------------------------------------------


def figure(found: xarray.Dataset) -> Figure:
    """Draw the summits reached, and how high those came that started at each place."""
    drawn = empty_figure(found, 11.0, 5.7)
    left, right = drawn.subplots(1, 2, sharey=True)
    for axes in (left, right):
        _terrain(axes)
    heights, many = found.summit_altitude.values, found.summit_vehicles.values
    colours: dict[str, Any] = {"cmap": "viridis"}
    if len(heights):
        colours |= {"vmin": heights.min(), "vmax": heights.max()}
    area = LARGEST * many / many.max(initial=1)
    left.scatter(
        *found.summit_position.values.T / 1000,
        **{"s": area, "c": heights, "edgecolors": "black", "linewidths": 0.5, **colours},
    )
    end = float(found.time[-1])
    left.set_title(f"(a) after {end:.0f} s: summits, area ∝ vehicles", loc="left", fontsize=10)
    shown = {"extent": _extent(found), "origin": "lower", "interpolation": "none"}
    painted = right.imshow(_reached(found), **shown, **colours, alpha=0.75)
    right.set_title("(b) where they started", loc="left", fontsize=10)
    right.set_ylabel("")
    drawn.colorbar(painted, ax=[left, right], shrink=0.85, label="altitude reached (m)")
    return drawn


DENSITY: Final = "plasma"
LARGEST: Final = 120.0
"""Area of the circle of the fullest summit (pt²)."""
HEIGHTS: Final = 8


def _terrain(axes: Axes) -> None:
    """Draw the landscape in grey, lit from the north-west, with contours; axes in km."""
    from matplotlib.colors import LightSource

    _, grid = landscape()
    x, y = (line / 1000 for line in grid.axes)
    steps = [1000 * float(line[1] - line[0]) for line in (x, y)]
    shade = LightSource(315, 45).hillshade(grid.values.T, vert_exag=3, dx=steps[0], dy=steps[1])
    extent = (x[0], x[-1], y[0], y[-1])
    axes.imshow(0.55 + 0.45 * shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent)
    axes.contour(x, y, grid.values.T, HEIGHTS, colors="black", linewidths=0.3, alpha=0.5)
    axes.set(xlabel="$x$ (km)", ylabel="$y$ (km)", aspect="equal", xlim=extent[:2], ylim=extent[2:])
    axes.autoscale(enable=False)


def _cells(axes: Axes, found: xarray.Dataset) -> Any:
    from matplotlib.colors import LogNorm

    most = max(10, int(found.vehicles.max()))
    return axes.imshow(
        _shown(found.vehicles.values[0]),
        extent=_extent(found),
        origin="lower",
        cmap=DENSITY,
        zorder=3,
        norm=LogNorm(1, most),
        interpolation="none",
    )


def _shown(vehicles: NDArray[Any]) -> Any:
    return np.ma.masked_equal(vehicles, 0)


def _extent(found: xarray.Dataset) -> tuple[float, float, float, float]:
    x, y = found.x.values, found.y.values
    half = CELL / 2
    left, right, bottom, top = (
        float(v) / 1000 for v in (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    )
    return left, right, bottom, top


def _reached(found: xarray.Dataset) -> Any:
    """Return the mean altitude reached from each cell, masked where none has arrived."""
    arrived = found.summit.values >= 0
    x, y = found.start.values[arrived].T
    heights = found.summit_altitude.values[found.summit.values[arrived]]
    edges = [np.append(v - CELL / 2, v[-1] + CELL / 2) for v in (found.y.values, found.x.values)]
    count = np.histogram2d(y, x, edges)[0]
    total = np.histogram2d(y, x, edges, weights=heights)[0]
    return np.ma.masked_array(total / count.clip(1), count == 0)


def _palette() -> Any:
    """Return an image with the colours of the pictures: the density's and greys."""
    from matplotlib import colormaps
    from PIL import Image

    density = colormaps[DENSITY](np.linspace(0, 1, 128))[:, :3]
    greys = np.linspace(0, 1, 127)[:, None] * np.ones(3)
    image = Image.new("P", (1, 1))
    image.putpalette((255 * np.concatenate([density, greys])).round().astype(int).ravel().tolist())
    return image


def animate(found: xarray.Dataset, path: Path, *, progress: Progress | None = None) -> None:
    """Write the cloud as a GIF, its pictures whole dither periods apart: only the means move."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    drawn = empty_figure(found, 6.4, 6.2)
    drawn.set_dpi(100)
    axes = drawn.add_subplot()
    _terrain(axes)
    cells = _cells(axes, found)
    drawn.colorbar(cells, ax=axes, shrink=0.85, label="vehicles in a cell of 300 m × 300 m")
    canvas = FigureCanvasAgg(drawn)

    def picture(index: int) -> Image.Image:
        cells.set_data(_shown(found.vehicles.values[index]))
        axes.set_title(f"$t$ = {float(found.time[index]):.0f} s", loc="left", fontsize=10)
        canvas.draw()
        if progress is not None:
            progress((index + 1) / found.sizes["time"])
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    picture(0)
    drawn.set_layout_engine("none")
    palette = _palette()
    frames = (
        picture(k).quantize(palette=palette, dither=Image.Dither.NONE)
        for k in range(found.sizes["time"])
    )
    with path.open("wb") as file:
        next(frames).save(
            *(file, "GIF"),
            save_all=True,
            append_images=frames,
            duration=FRAME,
            loop=0,
            optimize=True,
        )


FRAME: Final = 60
"""How long a picture is shown (ms)."""
