"""Ensembles on a GPU: million steps per second, against what its multiply-adds could do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ensemble_ours import Work, asked
from ensemble_problems import LANES, PROBLEMS, T_END, error, reference
from report import Table, figure, interleaved

from extremum.engines import cuda
from extremum.engines.lanes.asked import Asked

TOLERANCES = {"float64": 1e-6, "float32": 1e-5}
LONG = 10
"""Times the usual duration: copies to and from the GPU count little then."""

UNITS = {
    (7, 0): (64, 32),
    (7, 5): (64, 2),
    (8, 0): (64, 32),
    (8, 6): (128, 2),
    (8, 9): (128, 2),
    (9, 0): (128, 64),
    (10, 0): (128, 64),
    (12, 0): (128, 2),
}
"""Compute capability → multiply-adds per clock of a multiprocessor, in single and in double
precision. Source: CUDA C++ Programming Guide, throughput of native arithmetic instructions."""


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    if not cuda.available():
        notes = ["No GPU can be used here (numba-cuda and an NVIDIA driver are needed): not run."]
        yield Table("Ensembles on a GPU", ("loop",), [], notes)
        return
    for dtype in TOLERANCES:
        yield speed(dtype, 1 << (18 if quick else 20), 3 if quick else 10)


def device() -> Any:
    from numba.cuda import get_current_device

    return get_current_device()


def peak(dtype: str) -> float | None:
    """Return the flops per second of the multiply-adds alone; None for a GPU not listed."""
    gpu = device()
    units = UNITS.get(tuple(gpu.compute_capability))
    if units is None:
        return None
    each = units[dtype == "float64"]
    return 2.0 * each * gpu.MULTIPROCESSOR_COUNT * gpu.CLOCK_RATE * 1e3


def speed(dtype: str, loops: int, rounds: int) -> Table:
    """Time whole calls, copies included: from arrays in memory to arrays in memory."""
    works: dict[str, Asked] = {}
    for name, problem in PROBLEMS.items():
        once = asked(problem, problem.columns(loops), TOLERANCES[dtype], dtype)
        works |= {name: once, f"{name}, long": replace(once, t_end=LONG * T_END)}
    steps = {name: float(cuda.integrate(work).steps.sum()) for name, work in works.items()}
    runs: dict[str, Any] = {n: lambda w=w: cuda.integrate(w) for n, w in works.items()}
    taken = interleaved(runs, rounds)
    most = peak(dtype)
    rows, data = [], {}
    for name, times in taken.items():
        problem = PROBLEMS[name.split(",")[0]]
        rate = steps[name] / times.median
        flops = Work(problem, TOLERANCES[dtype], dtype).flops()
        share = None if most is None else 100 * flops * rate / most
        few = asked(problem, problem.columns(LANES), TOLERANCES[dtype], dtype)
        reached = error(cuda.integrate(few).states, reference(problem.name))
        rows.append(
            (
                f"{problem.title}, {works[name].t_end:g} s",
                f"{reached:.1e}",
                figure(rate / 1e6),
                figure(loops / times.median / 1e3),
                f"{flops:.0f}",
                "" if share is None else figure(share),
            )
        )
        data[name] = {"steps_per_s": rate, "error": reached, "percent_of_peak": share}
    words = "unknown" if most is None else f"{most / 1e12:.1f} TFlop/s"
    return Table(
        f"Ensembles, {dtype}, {loops} loops on a GPU; its multiply-add peak is {words}",
        ("loop", "error after 4 s", "Msteps/s", "kloops/s", "flop/step", "% peak"),
        rows,
        [
            "Peak: multiprocessors · units · clock · 2, from the GPU's own properties.",
            "flop/step: those of the same program on the CPU. Copies are in the time.",
        ],
        data={"dtype": dtype, "loops": loops, "peak_flops_per_s": most, "problems": data},
    )
