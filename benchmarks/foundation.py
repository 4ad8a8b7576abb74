"""Import, cold start, and a warm change of one number."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from report import Table, Target, Times, environment, figure, interleaved

import extremum as es
from extremum.papers import zhang2007

GAIN = "controller.channels.0.gain"
IMPORT = "import time; b = time.perf_counter(); import {}; print(time.perf_counter() - b)"


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    yield imports(5 if quick else 15)
    yield cold_start(2 if quick else 7)
    yield warm_change(50 if quick else 500)


def imports(rounds: int) -> Table:
    """Compare ``import extremum`` with ``import sympy``, each in a fresh interpreter."""
    taken: dict[str, list[float]] = {"sympy": [], "extremum": []}
    for round_ in range(rounds + 1):
        for name, seconds in taken.items():
            command = [sys.executable, "-c", IMPORT.format(name)]
            done = subprocess.run(
                command, env=environment(), capture_output=True, text=True, check=True
            )
            if round_:  # the first fills the file cache and writes bytecode
                seconds.append(float(done.stdout))
    times = {name: Times(tuple(seconds)) for name, seconds in taken.items()}
    added = times["extremum"].median - times["sympy"].median
    rows = [(f"import {name}", *t.text()) for name, t in times.items()]
    return Table(
        "Import, fresh interpreter",
        ("", "median (ms)", "range (ms)"),
        [*rows, ("added by extremum", figure(added * 1e3), "")],
        [f"{rounds} alternating pairs; bytecode is compiled, as after an installation."],
        [Target("import extremum, beyond import sympy", added, 0.25, "s")],
        {"times": {name: t.data() for name, t in times.items()}, "added_s": added},
    )


def cold_start(rounds: int) -> Table:
    """Time ``extremum paper fig4 -o DIR`` in a fresh process with no compiled code kept."""
    program = shutil.which("extremum", path=str(Path(sys.executable).parent))
    command = [program] if program else [sys.executable, "-m", "extremum"]
    nothing, fonts = "nothing kept at all", "matplotlib's font list kept"
    kinds = {nothing: False, fonts: True}
    taken: dict[str, list[float]] = {kind: [] for kind in kinds}
    with tempfile.TemporaryDirectory() as scratch:
        kept = Path(scratch, "matplotlib")
        _figure(command, Path(scratch, "first"), kept)  # makes the font list
        for round_ in range(rounds):
            for kind, keep in kinds.items():
                place = Path(scratch, f"{round_}{keep}")
                taken[kind].append(_figure(command, place, kept if keep else None))
    times = {kind: Times(tuple(seconds)) for kind, seconds in taken.items()}
    return Table(
        "Cold start: extremum paper fig4 -o DIR, with the figure; XDG_CACHE_HOME empty",
        ("", "median (s)", "range (s)"),
        [(kind, *t.text("s")) for kind, t in times.items()],
        [
            f"{rounds} fresh processes each. heyoka's compiled code and matplotlib's font list lie",
            "below XDG_CACHE_HOME; in the second row MPLCONFIGDIR is a folder with the font list.",
        ],
        [Target("cold start of fig4 with its figure", times[nothing].median, 3.0, "s")],
        {"times": {kind: t.data() for kind, t in times.items()}},
    )


def _figure(command: list[str], place: Path, fonts: Path | None) -> float:
    cache = place / "cache"
    cache.mkdir(parents=True)
    around = environment(XDG_CACHE_HOME=str(cache))
    around.pop("MPLCONFIGDIR", None)
    if fonts is not None:
        around["MPLCONFIGDIR"] = str(fonts)
    else:
        around["XDG_CONFIG_HOME"] = str(place / "configuration")
    begin = time.perf_counter()
    done = subprocess.run(
        [*command, "paper", "fig4", "-o", str(place / "out")],
        env=around,
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - begin
    if done.returncode:
        raise SystemExit(f"extremum paper fig4 failed:\n{done.stdout}{done.stderr}")
    if not any(path.stat().st_size for path in place.glob("out/**/*.png")):
        raise SystemExit("extremum paper fig4 made no figure")
    return seconds


def warm_change(rounds: int) -> Table:
    """Change one number of Fig. 4 and simulate it again."""
    scenario = zhang2007.scenario("fig4")
    loop, t_end = scenario.loop, scenario.run.t_end
    gains = iter(range(10**9))
    changed = [loop]

    def replace() -> None:
        changed[0] = loop.replace({GAIN: 10 + 1e-6 * next(gains)})

    def simulate() -> None:
        es.simulate(changed[0], t_end, samples=2000)

    for _ in range(10):
        replace()
        simulate()
    times = interleaved({"replace": replace, "simulate": simulate}, rounds)
    both = zip(times["replace"].seconds, times["simulate"].seconds, strict=True)
    times = {"both": Times(tuple(a + b for a, b in both)), **times}
    return Table(
        "Warm: one number of fig4 changed, 2000 samples, default tolerance",
        ("", "median (ms)", "range (ms)"),
        [(name, *t.text()) for name, t in times.items()],
        [f"{rounds} runs, each with a gain that was never used before."],
        [Target("warm change of fig4", times["both"].median * 1e3, 3.0, "ms")],
        {"times": {name: t.data() for name, t in times.items()}},
    )
