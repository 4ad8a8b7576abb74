"""The procedures as a figure: what is printed and what is right, judged by Floquet and by runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ...loop import Loop
from ...plots.panels import COLOURS, VERMILION
from ...theory.orbits import periodic_orbit
from .procedure_cases import CASES, Case
from .procedures import for_double_integrators, for_unstable_poles
from .schemes import CURVATURES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

Pair = tuple[float, float]

_SAFE, _FORBIDDEN = "#cfe8dd", "#cfe3f3"
_WRONG = "#f6cdb8"
_REGIONS: Final = (
    (_SAFE, "allowed by both"),
    (_WRONG, "allowed as printed, unstable"),
    (_FORBIDDEN, "forbidden as printed, stable"),
    ("white", "allowed by neither"),
)
_STABLE: Final[dict[str, Any]] = {"marker": "o", "color": COLOURS[2], "markeredgecolor": "black"}
_UNSTABLE: Final[dict[str, Any]] = {"marker": "X", "color": VERMILION, "markeredgecolor": "black"}
_PRINTED: Final[dict[str, Any]] = {"color": "black", "linestyle": ":", "linewidth": 1.5}
_CORRECTED: Final[dict[str, Any]] = {"color": "black", "linestyle": "-", "linewidth": 1.2}
_RUNS: Final = ((VERMILION, "-"), (COLOURS[2], "-"), (COLOURS[0], "--"))


def plot() -> Figure:
    """Show where each procedure's rules allow a compensator, and where the loop is stable.

    Above, over the choices that differ, z/ε_high and h/ε_high for unstable poles at the worst
    corner, z/h and p/h for double integrators: the four regions that the printed and the corrected
    rules make, with exact loops judged by their Floquet exponents. Below, the distance of the
    period mean from the source (m) over time (s) in the runs of `CASES`, numbered above.

    Returns
    -------
    matplotlib.figure.Figure
        To be saved with ``figure.savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 9), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 0.09, 0.72))
    _poles(figure.add_subplot(grid[0, 0]))
    _integrators(figure.add_subplot(grid[0, 1]))
    _legend(figure.add_subplot(grid[1, :]))
    _runs(figure.add_subplot(grid[2, 0]), CASES[:3], 0)
    _runs(figure.add_subplot(grid[2, 1]), CASES[3:], 3)
    for axes, letter in zip(_panels(figure), "abcd", strict=True):
        axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left", fontsize=10)
    return figure


def _panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def _poles(axes: Axes) -> None:
    """Draw (a): z/ε_high across, h/ε_high up, at q_low = ε_high = 0.5 and K = 2."""

    def loop(z: float, h: float) -> Loop:
        procedure = for_unstable_poles(0.5, 0.5, washout=0.5 * h, gain=20.0, zero=0.5 * z)
        return procedure.loop(400.0, q=CURVATURES)

    z, h = np.meshgrid(np.linspace(-2.4, 0, 481), np.linspace(0, 2.4, 481))
    _regions(axes, z, h, z < -h, z < -1)
    axes.plot([-2.4, 0], [2.4, 0], **_PRINTED)
    axes.plot([-1, -1], [0, 2.4], **_CORRECTED)
    points = [(a, b) for a in (-2.1, -1.1, -0.9, -0.4) for b in (0.6, 1.35, 2.25)]
    _judged(axes, points, loop)
    _numbered(axes, [(c.procedure.lead.zero / 0.5, c.procedure.washout / 0.5) for c in CASES[:3]])
    axes.set(xlabel="z/ε_high", ylabel="h/ε_high", xlim=(-2.4, 0), ylim=(0, 2.4))
    axes.locator_params(nbins=5)
    axes.set_title("1/(s − ε), at q = q_low and ε = ε_high", loc="left")
    axes.text(-1.75, 1.78, "z = −h", fontsize=9, va="bottom")
    axes.text(-0.97, 0.04, "z = −ε_high", fontsize=9, va="bottom")


def _integrators(axes: Axes) -> None:
    """Draw (b): z/h across, p/h up, at h = 1 and K = 5."""

    def loop(z: float, p: float) -> Loop:
        procedure = for_double_integrators(0.5, 0.1, gain=10.0, k=5.0, zero=z, pole=p)
        return procedure.loop(100.0, q=CURVATURES)

    z, p = np.meshgrid(np.linspace(-2.8, 0, 561), np.linspace(-5, 0, 561))
    _regions(axes, z, p, (z < -1) & (p < z + 1), p < z)
    axes.plot([-2.8, -1, -1], [-1.8, 0, -5], **_PRINTED)
    axes.plot([-2.8, 0], [-2.8, 0], **_CORRECTED)
    points = [(a, b) for a in (-2.5, -1.5, -0.5) for b in (a - 1.5, a - 0.3, a + 0.3)]
    _judged(axes, points, loop)
    _numbered(axes, [(c.procedure.lead.zero, c.procedure.lead.pole) for c in CASES[3:]], 3)
    axes.set(xlabel="z/h", ylabel="p/h", xlim=(-2.8, 0), ylim=(-5, 0))
    axes.locator_params(nbins=5)
    axes.set_title("1/s², at every q (σ → 0)", loc="left")
    axes.text(-2.72, -1.12, "p = z + h", fontsize=9)
    axes.text(-2.2, -2.5, "p = z", fontsize=9)
    axes.text(-0.98, -4.93, "z = −h", fontsize=9, va="bottom")


def _regions(axes: Axes, x: Any, y: Any, printed: Any, corrected: Any) -> None:
    from matplotlib.colors import ListedColormap

    kind = np.select([printed & corrected, printed, corrected], [0, 1, 2], 3)
    colours = ListedColormap([colour for colour, _ in _REGIONS])
    axes.pcolormesh(x, y, kind, cmap=colours, vmin=-0.5, vmax=3.5, shading="nearest")


def _judged(axes: Axes, points: Sequence[Pair], build: Any) -> None:
    for x, y in points:
        axes.plot(x, y, markersize=6, linestyle="", **_mark(build(x, y)))


def _mark(loop: Loop) -> dict[str, Any]:
    return _STABLE if periodic_orbit(loop).stable else _UNSTABLE


def _numbered(axes: Axes, places: Sequence[Pair], first: int = 0) -> None:
    for index, (x, y) in enumerate(places):
        case = CASES[first + index]
        axes.plot(x, y, markersize=9, linestyle="", **_mark(case.loop))
        axes.annotate(
            str(first + index + 1), (x, y), (6, 5), textcoords="offset points", fontweight="bold"
        )


def _legend(axes: Axes) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes.set_axis_off()
    marks: list[Patch | Line2D] = [
        Patch(facecolor=c, edgecolor="0.5", label=words) for c, words in _REGIONS
    ]
    marks += [
        Line2D([], [], label="printed rule", **_PRINTED),
        Line2D([], [], label="corrected rule", **_CORRECTED),
        Line2D([], [], linestyle="", label="stable by Floquet", **_STABLE),
        Line2D([], [], linestyle="", label="unstable by Floquet", **_UNSTABLE),
    ]
    axes.legend(handles=marks, ncols=4, loc="center", fontsize=9, frameon=False)


def _runs(axes: Axes, cases: Sequence[Case], first: int) -> None:
    for index, (case, (colour, line)) in enumerate(zip(cases, _RUNS, strict=True)):
        time, distance = case.distance
        words = f"{first + index + 1}: {case.name}"
        axes.plot(time, distance, line, color=colour, linewidth=1.2, label=words)
    axes.set(yscale="log", xlabel="t (s)", ylabel="distance of the period mean (m)")
    axes.set_ylim(1e-5, 1e2)
    axes.set_xlim(left=0)
    axes.grid(visible=True, color="0.9", linewidth=0.5)
    place = {"loc": "upper left", "bbox_to_anchor": (-0.02, -0.18), "borderaxespad": 0.0}
    axes.legend(fontsize=9, frameon=False, **place)
    axes.set_title(f"runs from the dither, ω = {cases[0].frequency:g} rad/s", loc="left")
