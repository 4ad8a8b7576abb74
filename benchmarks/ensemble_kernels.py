"""How soon a kernel is ready, what a second thread brings, and how much memory many loops take."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ensemble_ours import asked
from ensemble_problems import PROBLEMS, T_END
from report import Table, Target, environment, figure, interleaved

from extremum.engines.simd import integrate

TWICE = 1.8
KERNEL = {"new": 3.0, "process": 0.1, "disk": 0.5}
"""Seconds until a kernel has run, by who knows it."""

SAME = 1.1
"""Peak memory of 10⁷ loops over that of 10⁵."""

SIDES = (316, 1000, 3162)
FEW = 8

FIRST = f"""
import json, sys, time
from ensemble_ours import asked
from ensemble_problems import PROBLEMS
from extremum.engines.simd import integrate
problem, seconds = PROBLEMS[sys.argv[1]], []
for change in (1.0, 1.1):
    loop = problem.loop.replace({{"controller.washout": change}})
    begin = time.perf_counter()
    integrate(asked(problem, problem.columns({FEW}), 1e-6, "float64"))
    seconds.append(time.perf_counter() - begin)
print(json.dumps(seconds))
"""

MANY = """
import sys
import numpy as np
import xarray as xr
import extremum as es
from extremum.papers import zhang2007
side, folder = int(sys.argv[1]), sys.argv[2]
loop = zhang2007.scenario("fig4").loop
over = {
    f"start.{i}": xr.DataArray(np.linspace(-0.5, 0.5, side), dims=f"start_{i}") for i in (0, 1)
}
es.ensemble(loop, 0.4, over=over, into=folder)
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(int(status["VmHWM"].split()[0]) / 1024)
"""


def threads(quick: bool) -> Table:
    """Time one thread and two on the same loops."""
    loops = 1 << 20
    problem = PROBLEMS["quadratic"]
    work = asked(problem, problem.columns(loops), 1e-6, "float64")
    runs: dict[str, Any] = {str(n): lambda n=n: integrate(work, threads=n) for n in (1, 2)}
    times = interleaved(runs, 3 if quick else 5)
    one, two = (min(times[name].seconds) for name in runs)
    known = (os.cpu_count() or 1) > 1
    return Table(
        f"Threads: {problem.words}, {loops} loops over {T_END:g} s, wall time",
        ("threads", "best (s)", "range (s)", "kloops/s"),
        [
            (name, figure(min(taken.seconds)), taken.text("s")[1], figure(loops / best / 1e3))
            for (name, taken), best in zip(times.items(), (one, two), strict=True)
        ],
        [] if known else ["One core only: nothing to compare."],
        [Target("two threads against one", one / two, TWICE, "×", True)] if known else [],
        {"loops": loops, "one_s": one, "two_s": two},
    )


def ready() -> Table:
    """Time the first run of each structure in fresh processes, the import not counted."""
    rows, worst = [], dict.fromkeys(KERNEL, 0.0)
    for name, problem in PROBLEMS.items():
        with TemporaryDirectory() as folder:
            new, again = json.loads(_script(FIRST, name, XDG_CACHE_HOME=folder))
            disk, _ = json.loads(_script(FIRST, name, XDG_CACHE_HOME=folder))
        taken = dict(zip(KERNEL, (new, again, disk), strict=True))
        worst = {who: max(worst[who], taken[who]) for who in KERNEL}
        rows.append((problem.title, *(figure(1e3 * taken[who]) for who in KERNEL)))
    words = {"new": "new", "process": "known to the process", "disk": "known to the disk"}
    return Table(
        f"Until {FEW} loops have run, ms",
        ("structure", *words.values()),
        rows,
        [
            "From the equations, in a fresh process after the imports; the second time",
            "the loop has other numbers.",
        ],
        [Target(f"kernel {words[who]}", worst[who], limit, "s") for who, limit in KERNEL.items()],
        {"worst_s": worst},
    )


def memory(quick: bool) -> Table:
    """Measure the peak memory of processes that stream 10⁵ to 10⁷ loops into a store."""
    used: dict[int, float] = {}
    for side in SIDES[:2] if quick else SIDES:
        with TemporaryDirectory() as folder:
            used[side**2] = float(_script(MANY, str(side), str(Path(folder) / "loops.zarr")))
    growth = used[max(used)] / used[min(used)]
    return Table(
        "Peak memory of a process that streams its loops into a Zarr store",
        ("loops", "MiB"),
        [(f"{loops:.0e}", figure(mib)) for loops, mib in used.items()],
        targets=[Target(f"memory, {max(used):.0e} over {min(used):.0e} loops", growth, SAME, "×")],
        data={"mib": used},
    )


def _script(text: str, *arguments: str, **changes: str) -> str:
    here = str(Path(__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", text, *arguments],
        env=environment(PYTHONPATH=here, **changes),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return done.stdout
