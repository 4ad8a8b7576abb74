"""The paper's schemes and zero-bias designs side by side: what is left of the error, over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ...loop import Loop
from ...lti import Lead, Rational, transfer
from ...plots.panels import COLOURS
from ...requirements import Requirements
from ...simulation import simulate
from ...starts import OnDither
from ...theory.offsets import bias
from ...theory.synthesis import design
from ...vehicles import PointMass
from .schemes import CURVATURES, double_integrators, unstable_poles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = NDArray[np.float64]

_DITHER: Final = 0.2
_POLE: Final = 0.5
_SOURCE: Final = (1.0, -1.0)
_FORCE: Final = (0.3, -0.3)
_SETTLING: Final = 6.0
_START: Final = 1.5
_DURATION: Final = 15.0
_SAMPLES: Final = 32
_PREDICTED: Final = "the bias predicted for the paper's scheme"
_SCHEMES: Final = (("the paper's scheme", COLOURS[1]), ("zero-bias design", COLOURS[0]))


@dataclass(frozen=True, eq=False)
class Comparison:
    """One problem under both controllers.

    Attributes
    ----------
    title
        What would leave a bias.
    law
        The bias that the paper's scheme keeps, as it is read of an ``{axis}``.
    loops
        The paper's scheme and the zero-bias design, on the same map from the same start.
    """

    title: str
    law: str
    loops: tuple[Loop, Loop]


def comparisons() -> tuple[Comparison, ...]:
    """Return the two problems: ε = 0.5 with the source at (1, −1), and a constant force on 1/s².

    Both controllers dither with 0.2 m on q = (1, 0.5). The paper's schemes have α c q = 2 without a
    compensator, and its phase lead 5 (s + 0.5)/(s + 3) with α c = 2; the designs are asked to
    settle within 6 s, from up to 1.5 m away.
    """
    pole = Rational("1/(s - epsilon)", parameters={"epsilon": _POLE})
    mass = transfer("1/s**2")
    vanishing = design(_wanted(PointMass(axes=(pole, pole)), source_distance=1.0))
    pushed = design(_wanted(PointMass(axes=(mass, mass)), force=abs(_FORCE[0])))
    scheme = unstable_poles(40.0, _DITHER, (10.0, 20.0), _POLE, source=_SOURCE)
    lead = double_integrators(40.0, _DITHER, 10.0, Lead(5, -0.5, -3), force=_FORCE)
    ours = {f"field.source.{i}": x for i, x in enumerate(_SOURCE)}
    forced = {f"vehicle.disturbance.{i}": d for i, d in enumerate(_FORCE)}
    return (
        Comparison(
            f"1/(s − {_POLE:g}), source at (1, −1)",
            "ε {axis}*/(α c q − ε)",
            (_started(scheme, (0.0, 0.0)), _started(vanishing.at(ours), (0.0, 0.0))),
        ),
        Comparison(
            "1/s², constant force (0.3, −0.3)",
            "d p/(g z)",
            (_started(lead, (0.3, 0.3)), _started(pushed.at(forced), (0.3, 0.3))),
        ),
    )


def _wanted(vehicle: PointMass, **load: float) -> Requirements:
    return Requirements(
        vehicle=vehicle,
        curvature=tuple((q, q) for q in CURVATURES),
        dither_limit=_DITHER,
        settling_time=_SETTLING,
        start_distance=_START,
        **load,  # pyright: ignore[reportArgumentType]
    )


def _started(loop: Loop, position: tuple[float, float]) -> Loop:
    """Return the loop started on its dither about a position."""
    channels: Any = loop.controller.channels  # pyright: ignore[reportAttributeAccessIssue]
    swings = (c.dither.amplitude * np.sin(c.dither.phase) for c in channels)
    start = tuple(float(x + swing) for x, swing in zip(position, swings, strict=True))
    return loop.replace({"start": OnDither(start)})


def bias_comparison() -> Figure:
    """Show the mean error x̃ (m) of either axis over time (s), under both controllers.

    A column for each of `comparisons`, a row for each axis. Lines are means of position − source
    over one dither period; dashed is the bias that theory predicts for the paper's scheme,
    ε x*/(α c q − ε) and d p/(g z). The designs integrate and keep none.

    Returns
    -------
    matplotlib.figure.Figure
        To be saved with ``figure.savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.6), layout="constrained")
    panels: Any = figure.subplots(2, 2, sharex=True)
    for column, shown in enumerate(comparisons()):
        _column(panels[:, column], shown)
    for axes, letter in zip(panels.flat, "abcd", strict=True):
        axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left", fontsize=10)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _column(panels: Any, shown: Comparison) -> None:
    paper = shown.loops[0]
    kept = bias(paper).total
    runs = [mean_error(loop, _DURATION) for loop in shown.loops]
    for row, (axes, name) in enumerate(zip(panels, "xy", strict=True)):
        _panel(axes)
        above = kept[row] > 0
        value = f"{kept[row]:.3f}".replace("-", "−")
        axes.annotate(
            f"{shown.law.format(axis=name)} = {value} m",
            (_DURATION, kept[row]),
            xytext=(-4, 6 if above else -6),
            textcoords="offset points",
            ha="right",
            va="bottom" if above else "top",
            fontsize=9,
        )
        for (times, errors), (label, colour) in zip(runs, _SCHEMES, strict=True):
            axes.plot(times, errors[:, row], color=colour, label=label, linewidth=1.3)
        axes.axhline(kept[row], color="black", linestyle="--", linewidth=1.0, label=_PREDICTED)
        axes.set_ylabel(f"mean of ${name} - {name}^*$ (m)")
        axes.set_title(f"{shown.title}: {name}", loc="left")
    panels[-1].set_xlabel("time (s)")


def _panel(axes: Axes) -> None:
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.grid(visible=True, color="0.9", linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_xlim(0, _DURATION)
    axes.margins(y=0.12)


def mean_error(loop: Loop, duration: float) -> tuple[Vector, Vector]:
    """Return the mean of position − source (m) over the dither period about each time (s).

    Returns
    -------
    times, errors
        (samples,) and (samples, axes).
    """
    period = 2 * np.pi / loop.controller.base()
    count = int(np.ceil(duration / period)) + 1
    run = simulate(loop, count * period, samples=count * _SAMPLES + 1)
    offset = (run.position - run.source).values
    swept = np.cumsum(np.vstack([np.zeros(offset.shape[1]), offset]), axis=0)
    means = (swept[_SAMPLES:] - swept[:-_SAMPLES]) / _SAMPLES
    times = run.time.values[: len(means)] + period / 2
    return times, means
