"""Draw loops per second over 10² to 10⁷ loops, and error over speed for several ways to step.

``python benchmarks/ensemble_plot.py`` writes ``docs/images/ensemble_scaling.png`` and
``ensemble_precision.png``; some minutes.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from ensemble import WANTED
from ensemble_ours import COARSE, ours
from ensemble_problems import LANES, PROBLEMS, Problem, error, reference
from ensemble_rivals import Candidate, fitted, rivals
from scipy.integrate import DOP853

from extremum.engines.lanes.schemes import RK4, RungeKutta, Taylor

IMAGES = Path(__file__).parent.parent / "docs" / "images"
MOST = 1 << 18
"""Loops of one call; more are run by several."""

PATIENCE = 30.0
"""Seconds that a run may be expected to take."""

SHORT = 1.0
"""Seconds below which a run is repeated."""

COLOURS = ("#000000", "#0072B2", "#D55E00", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "0.5")

SIZES = tuple(10**k for k in range(2, 8))
ORDERS = (6, 8, 10, 12, 16, 20)
LEVELS = (1e-4, 1e-6, 1e-9)
RANGE = (1e-12, 1e-2)
FINER = tuple(10.0 ** (-k / 2) for k in range(2, 25))
HUNDREDS = tuple(round(64 * 1.4**k) for k in range(16))
"""Steps of the C++ programs."""

RK8 = RungeKutta(
    "RK8, Dormand and Prince",
    tuple(tuple(map(float, row[:i])) for i, row in enumerate(DOP853.A)),
    tuple(map(float, DOP853.B)),
    8,
)
STYLE: Any = {
    "font.size": 9,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.alpha": 0.25,
    "legend.frameon": False,
}


def main() -> None:
    """Measure and draw both figures."""
    mpl.use("Agg")
    with mpl.rc_context(STYLE):
        scaling().savefig(IMAGES / "ensemble_scaling.png", dpi=160)
        precision().savefig(IMAGES / "ensemble_precision.png", dpi=160)


# --- how many loops ---------------------------------------------------------------------------


def scaling() -> Any:
    """Draw wall-clock loops per second of all candidates at the same error, Fig. 4's loop."""
    from matplotlib import pyplot as plt

    problem, wanted = PROBLEMS["quadratic"], WANTED["float64"]
    one = ours(problem, "float64", title="extremum, one thread")
    two = ours(problem, "float64", title="extremum, two threads", threads=2)
    figure, axes = plt.subplots(figsize=(7.2, 5), layout="constrained")
    axes.set_prop_cycle(color=COLOURS)
    for candidate in (two, one, *rivals(problem, "float64")):
        found = fitted(candidate, problem, wanted)
        if found is not None:
            line = list(_sizes(candidate, problem, found[0]))
            bold = candidate.title.startswith("extremum")
            _, speeds = zip(*line, strict=True)
            print(candidate.title, *(f"{speed:.3g}" for speed in speeds))
            style = {"marker": "o", "linewidth": 2} if bold else {"marker": ".", "linewidth": 1}
            axes.loglog(*zip(*line, strict=True), label=candidate.title, **style)
    axes.set_xlabel("loops")
    axes.set_ylabel("loops per second, one core unless stated")
    axes.set_title(f"Fig. 4 over 4 s, every loop with numbers of its own, error ≤ {wanted:.0e}")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _sizes(candidate: Candidate, problem: Problem, setting: float) -> Iterator[tuple[int, float]]:
    """Yield loops and loops per second, as long as patience lasts."""
    speed = 0.0
    for loops in SIZES:
        if speed and loops / speed > PATIENCE:
            return
        columns = problem.columns(min(loops, MOST))
        calls = [MOST] * (loops // MOST) + ([loops % MOST] if loops % MOST else [])
        best = np.inf
        for _ in range(1 if speed and loops / speed > SHORT else 5):
            begin = time.perf_counter()
            for count in calls:
                candidate.run(columns[:, :count], setting)
            best = min(best, time.perf_counter() - begin)
        speed = loops / best
        yield loops, speed


# --- how accurate -----------------------------------------------------------------------------


def precision() -> Any:
    """Draw loops per second of one core against the error reached."""
    from matplotlib import pyplot as plt

    figure, every = plt.subplots(1, 3, figsize=(11, 5), sharey=True, layout="constrained")
    for axes, problem in zip(every, PROBLEMS.values(), strict=True):
        for candidate, style in _schemes(problem):
            errors, speeds = zip(*_points(candidate, problem), strict=True)
            axes.loglog(errors, speeds, label=candidate.title, **style)
            known = (np.log(errors[::-1]), np.log(speeds[::-1]))
            at = np.exp(np.interp(np.log(LEVELS), *known, left=np.nan, right=np.nan))
            print(problem.name, candidate.title, *(f"{s:.3g} loops/s" for s in at), sep="; ")
        for level in LEVELS:
            axes.axvline(level, color="0.5", linewidth=0.5)
        axes.set_title(problem.words)
        axes.set_xlabel("largest error of 64 random loops after 4 s")
        axes.set_xlim(*RANGE)
        axes.set_xticks([1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
    every[0].set_ylabel("loops per second and core")
    handles, labels = every[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _schemes(problem: Problem) -> Iterator[tuple[Candidate, dict[str, Any]]]:
    shades = mpl.colormaps["viridis"](np.linspace(0, 0.9, len(ORDERS)))
    for order, colour in zip(ORDERS, shades, strict=True):
        title = f"Taylor, order {order}"
        one = ours(problem, "float64", title=title, scheme=Taylor(order), settings=FINER)
        yield one, {"color": colour, "linewidth": 1}
    for scheme, colour in ((RK4, "#D55E00"), (RK8, "#CC79A7")):
        one = ours(problem, "float64", title=scheme.name, scheme=scheme, settings=COARSE[::4])
        yield one, {"color": colour, "linestyle": "--", "linewidth": 1.2}
    title = "extremum as it comes"
    usual = ours(problem, "float64", title=title, settings=FINER)
    yield usual, {"color": "black", "marker": "o", "markersize": 3, "linewidth": 1.5}
    for rival in rivals(problem, "float64"):
        if rival.title.startswith("C++"):
            dotted = {"color": "0.4", "linestyle": ":" if "RK4" in rival.title else "-."}
            yield replace(rival, title=rival.title.split(", order")[0], settings=HUNDREDS), dotted


def _points(candidate: Candidate, problem: Problem) -> Iterator[tuple[float, float]]:
    """Yield the error and the loops per second of settings that reach something."""
    few, known = problem.columns(LANES), reference(problem.name)
    columns = problem.columns(1 << 12)
    least = np.inf
    for setting in candidate.settings:
        reached = error(candidate.run(few, setting), known)
        if not RANGE[0] < reached < min(RANGE[1], least):
            continue
        least, best = reached, np.inf
        for _ in range(3):
            begin = time.process_time()
            candidate.run(columns, setting)
            best = min(best, time.process_time() - begin)
        yield reached, columns.shape[1] / best


if __name__ == "__main__":
    main()
