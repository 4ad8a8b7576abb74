"""`design`: what a design's loop does over the whole box, the exact loop over the averaged one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..errors import InvalidDescription, shown
from .panels import COLOURS, PALE, VERMILION, curve, dress
from .scenes import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..theory.synthesis import Design
    from ..theory.synthesis.bands import Band, Plant
    from ..theory.synthesis.witnesses import Witness

WIDTH: Final = 13.5
ROW: Final = 3.7
LEGEND: Final = 1.15
VIEW: Final = 1.3
"""Bandwidths of the closed loop within which roots are shown."""
DECIBELS: Final = 38.0
THINNED: Final = 3
DECADES: Final = 3.0
"""Decades of gain that a locus goes on for, on either side of the curvature's range."""
STEPS: Final = 100
"""Gains per decade of a locus."""
PEAK: Final = 2.0
"""The |S(jω)| that the Nichols chart marks."""
SETTLED: Final = 0.02
ROOM: Final = 0.35
"""Part of the means' range that is shown of the dither above and below them."""

_BOX: Final[dict[str, Any]] = {"color": PALE, "linewidth": 5, "solid_capstyle": "round"}
_ALONG: Final[dict[str, Any]] = {"color": COLOURS[0], "linewidth": 1.6}
_LOCUS: Final[dict[str, Any]] = {"color": "0.55", "linewidth": 0.7}
_POINT: Final[dict[str, Any]] = {"linestyle": "", "color": COLOURS[0], "markersize": 5}
_LOW: Final[dict[str, Any]] = _POINT | {"marker": "v"}
_HIGH: Final[dict[str, Any]] = _POINT | {"marker": "^"}
_POLE: Final[dict[str, Any]] = {"linestyle": "", "color": "black", "marker": "x", "markersize": 7}
_ZERO: Final[dict[str, Any]] = _POLE | {"marker": "o", "markerfacecolor": "none"}
_EXACT: Final[dict[str, Any]] = _POLE | {
    "marker": "D",
    "markerfacecolor": "none",
    "markeredgecolor": VERMILION,
    "markeredgewidth": 1.3,
}
_LIMIT: Final[dict[str, Any]] = {"color": "black", "linestyle": (0, (4, 2)), "linewidth": 1.2}
_RUNS: Final = (("lowest q", VERMILION, "-"), ("highest q", COLOURS[2], "--"))
_PEAKED: Final = "#f6cdb8"


def design(design: Design) -> Figure:
    """Show what a design's loop does over the whole box: its roots, margins and responses.

    One row of panels for each axis.

    - Roots of the averaged loop 1 + L(s) = 0 (1/s): all over the box, along the curvature's range
      where the uncertain numbers are at their ends, and on for other gains. With them the proved
      bound Re λ < −σ, and the exact loop's Floquet exponents at the ends of the box.
    - Nichols chart, |L(jω)| (dB) over arg L(jω) (°): the band that L fills over the box, its least
      margins, and the region of |S| > 2. The curve, with its frequencies, is L in the middle.
    - Mean of the position relative to the source (m) over time (s), displaced as far as in
      ``design.scenario()``: the averaged loop's responses all over the box, and over them runs of
      the exact loop with every curvature at one end and every uncertain number at its highest.
      Source distance and force are 0, as they are for a loop whose integrators hold them already.

    Where axes are coupled, the curvature's range is that of all the Hessians' eigenvalues, and the
    exact loop is one without coupling.

    Parameters
    ----------
    design
        What `extremum.design` returned.

    Returns
    -------
    matplotlib.figure.Figure
        To be saved with ``figure.savefig``.

    Raises
    ------
    InvalidDescription
        If `design` is no `Design`.
    """
    from matplotlib.figure import Figure

    from ..theory.synthesis import Design
    from ..theory.synthesis.bands import band
    from ..theory.synthesis.witnesses import witnesses

    if not isinstance(design, Design):
        reason = "must be a Design, as extremum.design returns it"
        raise InvalidDescription("design", reason, shown(design))
    pairs = zip(design.plan.families, design.plan.shapes, strict=True)
    omegas = design.controller.frequencies()
    bands = tuple(
        band(design.requirements, *pair, omega) for pair, omega in zip(pairs, omegas, strict=True)
    )
    seen = witnesses(design)
    radius = VIEW * max(shape.fastest for shape in design.plan.shapes)
    exponents = [witness.exponents(bands, radius) for witness in seen]

    figure = Figure(figsize=(WIDTH, ROW * len(bands) + LEGEND), layout="constrained")
    figure.suptitle(design.scenario().title, fontsize=11)
    heights = [ROW] * len(bands) + [LEGEND]
    grid = figure.add_gridspec(len(heights), 3, height_ratios=heights)
    panels = []
    for row, here in enumerate(bands):
        roots, nichols, response = (figure.add_subplot(grid[row, k]) for k in range(3))
        _show_roots(roots, design, here, [found[row] for found in exponents], radius)
        _show_nichols(nichols, here)
        _show_responses(response, design, here, [w for w in seen if w.ends[1]])
        panels.append((roots, nichols, response))
    for letter, axes in zip("abcdefghijklmnopqrstuvwxyz", np.ravel(panels).tolist(), strict=False):
        axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left", fontsize=10)
    for k in range(3):
        _legend(figure.add_subplot(grid[-1, k]), [row[k] for row in panels])
    return figure


def _show_roots(
    axes: Axes, design: Design, here: Band, exact: Sequence[Any], radius: float
) -> None:
    proofs = design.proofs
    decay = proofs[min(here.family.axis, len(proofs) - 1)].decay
    for plant in here.plants:
        _branches(axes, here, plant, 0.0, label="averaged, all over the box", **_BOX)
    inside: list[Any] = []
    for plant in here.family.vertices:
        _branches(axes, here, plant, DECADES, label="averaged, other gains", **_LOCUS)
        _branches(axes, here, plant, 0.0, label="averaged, along q", **_ALONG)
        inside.append(here.roots(plant, here.gains).ravel())
        ends = here.roots(plant, here.gains[[0, -1]])
        zeros, poles = here.singular(plant)
        for points, text, style in (
            (ends[0], "lowest q", _LOW),
            (ends[1], "highest q", _HIGH),
            (poles, "pole of L(s)", _POLE),
            (zeros, "zero of L(s)", _ZERO),
        ):
            axes.plot(points.real, points.imag, label=text, zorder=3, **style)
    for found in exact:
        axes.plot(found.real, found.imag, label="exact (Floquet exponents)", zorder=4, **_EXACT)
    axes.axvline(-decay, label="proved: Re λ < −σ", zorder=2.5, **_LIMIT)
    _cross(axes, 0.0)
    everything: Any = np.concatenate([*inside, [-decay]])
    seen = everything[np.abs(everything) <= max(radius, 2 * decay)]
    left, high = 1.2 * float(seen.real.min()), 1.5 * float(seen.imag.max())
    high = max(high, -0.3 * left)
    dress(axes, ["Re λ (1/s)", "Im λ (rad/s)"], [(left, -0.25 * left), (-high, high)])
    least = float(everything.real.min())
    if least < left:
        text = f"← averaged roots down to −{-least:.3g} 1/s"
        axes.text(0.02, 0.02, text, transform=axes.transAxes, fontsize=8)
    axes.set_title(f"{here.family.name}: roots of 1 + L(s), σ = {decay:.3g} 1/s", loc="left")


def _branches(axes: Axes, here: Band, plant: Plant, decades: float, **style: Any) -> None:
    """Draw the roots over the curvature's range, and decades of gain beyond it, as lines."""
    low, high = here.gains[[0, -1]] * 10.0 ** np.array([-decades, decades])
    steps = int(STEPS * (np.log10(high / low) + 1))
    for branch in here.branches(plant, np.geomspace(low, high, steps)):
        axes.plot(branch.real, branch.imag, **style)


def _show_nichols(axes: Axes, here: Band) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.ticker import MultipleLocator

    low, high = here.decibels[[0, -1]]
    omega = here.frequencies
    phases, patches = [-225.0, -135.0], []
    for plant in here.plants:
        phase, size = here.curve(plant, omega[::THINNED])
        seen = (size + high > -DECIBELS) & (size + low < DECIBELS)
        phases += phase[seen].tolist()
        lower, upper = (np.column_stack([phase, size + end]) for end in (low, high))
        cells = np.stack([lower[:-1], upper[:-1], upper[1:], lower[1:]], axis=1)
        patches.append(cells[(np.abs(np.diff(phase)) < 90) & seen[1:]])
    band = PolyCollection(np.concatenate(patches), color=PALE, label="L(jω), all over the box")  # pyright: ignore[reportArgumentType]
    axes.add_collection(band)
    phase, size = here.curve(here.family.nominal, omega)
    size += float(20 * np.log10(abs(here.shape.gain)))
    axes.plot(phase, size, label="L(jω), in the middle", **_ALONG)
    least, most = min(phases), max(phases)
    before = (np.inf, np.inf)
    for w in 10.0 ** np.arange(np.ceil(np.log10(omega[0])), np.log10(omega[-1])):
        place = float(np.interp(w, omega, phase)), float(np.interp(w, omega, size))
        apart = abs(place[0] - before[0]) > 0.2 * (most - least) or abs(place[1] - before[1]) > 6
        if apart and abs(place[1]) < 0.9 * DECIBELS:
            axes.plot(*place, marker=".", markersize=8, color=COLOURS[0])
            _named(axes, place, f"{w:g} rad/s")
            before = place
    limits = least - 10, most + 10 + 0.16 * (most - least)
    _show_peak(axes, limits)
    _show_margins(axes, here)
    _cross(axes, -180.0)
    dress(axes, ["arg L(jω) (°)", "|L(jω)| (dB)"], [limits, (-DECIBELS, DECIBELS)])
    axes.xaxis.set_major_locator(MultipleLocator(45 if limits[1] - limits[0] < 400 else 90))
    title = f"{here.family.name}: Nichols chart, max |S(jω)| = {here.shape.peak:.3g}"
    axes.set_title(title, loc="left")


def _show_peak(axes: Axes, limits: tuple[float, float]) -> None:
    """Fill the region of |S| = 1/|1 + L| > 2."""
    phase, size = np.meshgrid(np.linspace(*limits, 500), np.linspace(-10, 10, 200))
    distance = np.abs(1 + 10 ** (size / 20) * np.exp(1j * np.radians(phase)))
    axes.contourf(phase, size, distance, [-1.0, 1 / PEAK], colors=[_PEAKED], zorder=1.5)
    axes.contour(phase, size, distance, [1 / PEAK], colors=[VERMILION], linewidths=1, zorder=1.6)
    axes.fill([], [], facecolor=_PEAKED, edgecolor=VERMILION, label=f"|S(jω)| > {PEAK:g}")
    axes.plot(-180, 0, marker="+", color="black", markersize=10, linestyle="", label="L = −1")


def _show_margins(axes: Axes, here: Band) -> None:
    from ..theory.synthesis.bands import margins

    least = margins(here)
    ends = [
        (f"{least.up:.3g} dB", (-180.0, -least.up)),
        (f"{least.down:.3g} dB", (-180.0, least.down)),
        (f"{abs(least.phase):.3g}°", (-180.0 + least.phase, 0.0)),
    ]
    for text, end in ends:
        if np.isfinite(end).all():
            arrow = {"arrowstyle": "->", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", end, (-180, 0), arrowprops=arrow)
            _named(axes, ((end[0] - 180) / 2, end[1] / 2), text)
    axes.plot([], [], color="black", marker=r"$\rightarrow$", linestyle="", label="least margins")


def _show_responses(axes: Axes, design: Design, here: Band, runs: Sequence[Witness]) -> None:
    axis, name = here.family.axis, here.family.name
    r, horizon = runs[0].displacement, runs[0].horizon
    times = np.linspace(0.0, horizon, 401)
    found = r * here.responses(times)
    least, most = found.min(axis=(0, 1)), found.max(axis=(0, 1))
    axes.axhspan(
        -SETTLED * r, SETTLED * r, color="0.82", zorder=1.5, label="2 % of the displacement"
    )
    style = {"facecolor": PALE, "edgecolor": COLOURS[0], "linewidth": 0.8, "zorder": 2}
    axes.fill_between(times, least, most, label="averaged, all over the box", **style)
    path = np.column_stack(runs[0].path(axis))
    curve(axes, path, color="0.8", linewidth=0.5, zorder=1, label="exact, lowest q: position")
    means = [np.column_stack(run.mean(axis)) for run in runs]
    for mean, (words, colour, line) in zip(means, _RUNS, strict=True):
        style = {"color": colour, "linestyle": line, "linewidth": 1.6, "zorder": 3}
        curve(axes, mean, label=f"exact, {words}: mean", **style)
    means = np.concatenate([least, most, *(mean[:, 1] for mean in means)])
    room = ROOM * float(np.ptp(means))
    low = max(float(path[:, 1].min()), float(means.min()) - room)
    high = min(float(path[:, 1].max()), float(means.max()) + room)
    settling = design.requirements.settling_time
    if settling is not None:
        axes.axvline(settling, label="settling time wanted", **_LIMIT)
        _named(axes, (settling, low + 0.9 * (high - low)), f"$T_s$ = {settling:g} s")
    dress(axes, [label("t", "s"), f"${name} - {name}^*$ (m)"], [(0, horizon), (low, high)])
    axes.set_title(f"{name}: response from {r:.3g} m", loc="left")


def _cross(axes: Axes, across: float) -> None:
    for draw, place in ((axes.axvline, across), (axes.axhline, 0.0)):
        draw(place, color="0.3", linewidth=0.6, zorder=1)


def _named(axes: Axes, place: tuple[float, float], text: str) -> None:
    behind = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
    axes.annotate(
        text, place, (5, 4), textcoords="offset points", fontsize=8, bbox=behind, zorder=5
    )


def _legend(axes: Axes, panels: Sequence[Axes]) -> None:
    axes.set_axis_off()
    named: dict[str, Any] = {}
    for panel in panels:
        for handle, text in zip(*panel.get_legend_handles_labels(), strict=True):
            named.setdefault(text, handle)
    axes.legend(list(named.values()), list(named), ncols=2, loc="center", fontsize=9, frameon=False)
