"""10² to 10⁷ loops at once: how much of the processor they get, and what others make of it.

Every candidate takes the coarsest setting with which the states of 64 random loops end within
`WANTED` of heyoka's at a tolerance of 1e-13. One core, CPU times, all candidates by turns, the best
of several: what else runs on the machine can only lengthen a run.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import ensemble_peak
import numpy as np
from ensemble_kernels import memory, ready, threads
from ensemble_ours import COARSE, LOOPS, Work, ours
from ensemble_problems import LANES, PROBLEMS, Problem, error, reference
from ensemble_rivals import TOLERANCES, Candidate, absent, fitted, rivals
from report import Table, Target, figure, interleaved

from extremum.engines.lanes.schemes import RK4

WANTED = {"float64": 1e-6, "float32": 3e-5}
USUAL = {"float64": 1e-6, "float32": 1e-5}
"""The default tolerance, and the least that is taken."""

PEAK_SHARE = {"quadratic": 55.0, "force": 55.0, "wavy": 33.0}
"""Per cent of the multiply-add peak, double precision."""

AGAINST_CPP = 1.2
"""Loops/s of C++ over ours."""


@dataclass(frozen=True)
class Entry:
    """A candidate with its setting, error and speed.

    Attributes
    ----------
    candidate
        What runs.
    setting, error
        The coarsest setting that reaches the error, and the error; NaN where none does.
    rate
        Loops per second of one core.
    """

    candidate: Candidate
    setting: float
    error: float
    rate: float

    @property
    def stepped(self) -> bool:
        """Whether the setting is a number of steps, rather than a tolerance."""
        return self.candidate.settings is not TOLERANCES


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    rounds = 3 if quick else 10
    for dtype in WANTED:
        yield share(dtype, rounds)
        for problem in PROBLEMS.values():
            yield compare(problem, dtype, rounds)
    yield threads(quick)
    yield ready()
    yield memory(quick)


def share(dtype: str, rounds: int) -> Table:
    """Measure our share of the peak: flops of the program over time, against nothing but flops."""
    bits = 64 if dtype == "float64" else 32
    works = dict(_works(dtype))
    columns = {key: work.problem.columns(LOOPS) for key, work in works.items()}
    runs: dict[Any, Any] = {key: lambda k=key: works[k].ended(columns[k]) for key in works}
    steps = {key: float(run().steps.sum()) for key, run in runs.items()}
    runs["peak"] = lambda: ensemble_peak.run(bits)
    times = interleaved(runs, rounds, clock=time.process_time)
    best = {key: min(taken.seconds) for key, taken in times.items()}
    peak = ensemble_peak.operations(bits) / best["peak"]
    rows, targets, data = [], [], {}
    for key, work in works.items():
        problem, count = work.problem, work.flops()
        used = count * steps[key] / best[key]
        percent = 100 * used / peak
        made = work.ended(problem.columns(LANES))
        reached = error(made.states, reference(problem.name))
        rows.append(
            (
                f"{problem.title}: {made.scheme}",
                f"{reached:.1e}",
                figure(steps[key] / LOOPS),
                figure(steps[key] / best[key] / 1e6),
                figure(LOOPS / best[key] / 1e3),
                f"{count:.0f}",
                figure(percent),
            )
        )
        data[key] = {
            "scheme": made.scheme,
            "error": reached,
            "steps_per_loop": steps[key] / LOOPS,
            "steps_per_s": steps[key] / best[key],
            "loops_per_s": LOOPS / best[key],
            "flops_per_step": count,
            "percent_of_peak": percent,
        }
        if bits == 64 and work.scheme is None:
            title = f"{problem.title}: share of the peak"
            targets.append(Target(title, percent, PEAK_SHARE[problem.name], "%", True))
    return Table(
        f"Ensembles, {dtype}, one core; its multiply-add peak is {peak / 1e9:.0f} GFlop/s",
        (
            "loop: scheme",
            "error",
            "steps",
            "Msteps/s",
            "kloops/s",
            "flop/step",
            "% peak",
        ),
        rows,
        [
            f"Taylor at the tolerance {USUAL[dtype]:g}, RK4 with steps for {WANTED[dtype]:g}.",
            "flop/step: additions, multiplications (a fused one is two), divisions, roots",
            "of one step of one loop in the kernel as it is written. Escape detection,",
            "masks and the call of the engine are in the time, not in the flops.",
        ],
        targets,
        {"dtype": dtype, "peak_flops_per_s": peak, "loops": data},
    )


def _works(dtype: str) -> Iterator[tuple[str, Work]]:
    for name, problem in PROBLEMS.items():
        yield name, Work(problem, USUAL[dtype], dtype)
        found = fitted(ours(problem, dtype, scheme=RK4, settings=COARSE), problem, WANTED[dtype])
        if found is not None:
            yield f"{name}, RK4", Work(problem, found[0], dtype, RK4)


def compare(problem: Problem, dtype: str, rounds: int) -> Table:
    """Time every candidate at the same achieved error."""
    entries = measured([ours(problem, dtype), *rivals(problem, dtype)], problem, dtype, rounds)
    mine = entries[0]
    rows = [
        (
            entry.candidate.title,
            (f"{entry.setting:.0f} steps" if entry.stepped else f"tol {entry.setting:.1e}")
            if entry.rate
            else f"does not reach {WANTED[dtype]:.0e}",
            f"{entry.error:.1e}",
            figure(entry.setting * entry.rate / 1e6) if entry.stepped else "",
            figure(entry.rate / 1e3),
            figure(entry.rate / mine.rate) if entry.rate / mine.rate > 1e-3 else "< 0.001",
        )
        for entry in entries
    ]
    by_hand = [e.rate / mine.rate for e in entries if e.candidate.title.startswith("C++")]
    targets = [
        Target(f"{problem.title}, {dtype}: C++/ours", ratio, AGAINST_CPP, "×")
        for ratio in [max(by_hand, default=None)]
        if ratio is not None
    ]
    return Table(
        f"{problem.words}, {dtype}: error ≤ {WANTED[dtype]:g} after 4 s, one core",
        ("", "setting", "error", "Msteps/s", "kloops/s", "× ours"),
        rows,
        [*absent(), "× ours: loops per second; above 1 it is faster than we are."],
        targets,
        {
            "problem": problem.name,
            "dtype": dtype,
            "candidates": {
                e.candidate.title: {"setting": e.setting, "error": e.error, "loops_per_s": e.rate}
                for e in entries
            },
        },
    )


def measured(candidates: list[Candidate], problem: Problem, dtype: str, rounds: int) -> list[Entry]:
    """Fit every candidate to the wanted error, and time them by turns."""
    settings = {c.title: fitted(c, problem, WANTED[dtype]) for c in candidates}
    runs = {}
    for candidate in candidates:
        found = settings[candidate.title]
        if found is not None:
            columns = problem.columns(candidate.loops)
            runs[candidate.title] = lambda c=candidate, n=columns, s=found[0]: c.run(n, s)
    for run in runs.values():
        run()
    times = interleaved(runs, rounds, clock=time.process_time)
    entries = []
    for candidate in candidates:
        setting, reached = settings[candidate.title] or (np.nan, np.nan)
        taken = times.get(candidate.title)
        rate = candidate.loops / min(taken.seconds) if taken else 0.0
        entries.append(Entry(candidate, setting, reached, rate))
    return entries
