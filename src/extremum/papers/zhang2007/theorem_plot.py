"""A theorem's orders as a figure: measured points, fitted lines, printed slopes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ...plots.panels import COLOURS, MARKERS
from .orders import Fit
from .theorems import Theorem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ABSCISSAE: Final = {
    "1/ω": "1/ω (s/rad)",
    "α": "α (m)",
    "ε": "ε (1/s)",
    "all": "all small numbers in proportion, relative",
}
_RESIDUAL: Final = "lim sup |f − f*|"
_WIDTH: Final = 4.4
_HEIGHT: Final = 4.3


def plot(result: Theorem) -> Figure:
    """Show every fit of a theorem in log–log scale.

    One panel for the distance from the averaged equilibrium over 1/ω (s/rad), one for each small
    number in which lim sup |f − f*| is fitted. Points are exact orbits; lines are the fits, solid
    and filled in quadrature, dashed and hollow with separate frequencies; where the measured order
    is not the printed one, a dotted line has the printed slope.

    Returns
    -------
    matplotlib.figure.Figure
        To be saved with ``figure.savefig``.
    """
    from matplotlib.figure import Figure

    groups = _grouped(result.fits)
    across = 2 if len(groups) <= 4 else 3
    rows = -(-len(groups) // across)
    figure = Figure(figsize=(_WIDTH * across, _HEIGHT * rows + 0.6), layout="constrained")
    lines = f"Theorem {result.number}: {result.claim}".split("; ")
    figure.suptitle("\n".join(lines), fontsize=11)
    for index, (title, fits) in enumerate(groups.items()):
        axes = figure.add_subplot(rows, across, index + 1)
        axes.set_title(f"({chr(ord('a') + index)}) {title}", loc="left", fontsize=10)
        _panel(axes, fits)
    figure.supxlabel(
        "points: exact periodic orbits; lines: fits; dotted: the printed order where it is not "
        "what is measured",
        fontsize=9,
    )
    return figure


def _grouped(fits: tuple[Fit, ...]) -> dict[str, list[Fit]]:
    groups: dict[str, list[Fit]] = {}
    for fit in fits:
        residual = fit.quantity.startswith(_RESIDUAL)
        words = "with all numbers" if fit.small == "all" else f"in {fit.small}"
        name = _RESIDUAL if residual else "distance from the averaged equilibrium"
        title = f"{name} {words}"
        groups.setdefault(title, []).append(fit)
    return groups


def _panel(axes: Axes, fits: list[Fit]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    residual = fits[0].quantity.startswith(_RESIDUAL)
    outputs = ", w in m/s" if any("w" in fit.quantity for fit in fits) else ""
    unit = "unit of J" if residual else f"m; e in the unit of J{outputs}"
    axes.set(xscale="log", yscale="log", xlabel=_ABSCISSAE[fits[0].small], ylabel=unit)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, color="0.88", linewidth=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9)
    names = list(dict.fromkeys(fit.quantity for fit in fits))
    for fit in fits:
        index = names.index(fit.quantity)
        _line(axes, fit, COLOURS[index], MARKERS[index])
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(-0.1, -0.16),
        fontsize=8,
        frameon=False,
        borderaxespad=0.0,
    )


def _named(fit: Fit) -> str:
    """Return what tells a fit from the others of its panel."""
    name = fit.quantity.removeprefix(_RESIDUAL).strip()
    return f"{name}, {fit.dithers}" if name else fit.dithers


def _line(axes: Axes, fit: Fit, colour: str, marker: str) -> None:
    quadrature = fit.dithers == "quadrature"
    slope = fit.slope
    middle = np.exp(np.log(fit.x).mean()), np.exp(np.log(fit.y).mean())
    style: dict[str, Any] = {"color": colour, "linewidth": 1.0}
    axes.plot(
        fit.x,
        middle[1] * (fit.x / middle[0]) ** slope,
        linestyle="-" if quadrature else "--",
        **style,
    )
    axes.plot(
        fit.x,
        fit.y,
        linestyle="",
        marker=marker,
        markersize=5,
        markerfacecolor=colour if quadrature else "white",
        label=f"{_named(fit)}: order {slope:.2f}, printed {fit.printed}",
        **style,
    )
    if not fit.as_printed:
        end = int(np.argmax(fit.x))
        axes.plot(fit.x, fit.y[end] * (fit.x / fit.x[end]) ** fit.printed, linestyle=":", **style)
