"""What each command does."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from .. import plots
from ..errors import InvalidDescription
from ..loop import Loop
from ..papers import zhang2007
from ..requirements import load_requirements
from ..sampled.loop import SampledLoop
from ..scenario import Scenario, format_scenario, load_scenario
from .files import Files
from .inputs import in_file, load, suffixed
from .progress import Bar
from .report import summary

if TYPE_CHECKING:
    import xarray
    from rich.console import Console

FIGURES = (".png", ".pdf", ".svg")
ANIMATIONS = (".gif", ".mp4")
WIDTH = 120
"""Columns of a table that is not printed on a terminal."""


def run(options: argparse.Namespace) -> int:
    """Simulate a scenario file; print, and write what was asked for."""
    scenario = load(options.scenario, load_scenario)
    wanted = {
        "data": suffixed(options.output, (".nc",), "-o"),
        "plot": suffixed(options.plot, FIGURES, "--plot"),
        "animation": suffixed(options.animation, ANIMATIONS, "--animation"),
    }
    if wanted["animation"]:
        plots.check_animation(wanted["animation"])
    with Files({key: path for key, path in wanted.items() if path}, options.force) as files:
        status = _simulated(scenario, files)
        files.commit()
    _report_written(files)
    return status


def paper(options: argparse.Namespace) -> int:
    """Reproduce one scenario of the paper, or all; without a name, list them."""
    if options.name is None:
        for name in zhang2007.NAMES:
            print(f"{name:<16}{zhang2007.scenario(name).title}")
        return 0
    if options.name == "errata":
        return _errata()
    names = zhang2007.NAMES if options.name == "all" else (options.name,)
    sources = {name: zhang2007.path(name) for name in names}
    folder = Path(options.output)
    if folder.exists() and not folder.is_dir():
        raise InvalidDescription("", f"{folder} is a file; -o names the folder to write into")
    endings = {"data": ".nc", "plot": ".png", "scenario": ".toml"}
    outputs = {
        name: Files({key: folder / f"{name}{end}" for key, end in endings.items()}, options.force)
        for name in names
    }
    folder.mkdir(parents=True, exist_ok=True)
    status = 0
    for name, source in sources.items():
        with outputs[name] as files:
            status = max(status, _simulated(zhang2007.scenario(name), files))
            files["scenario"].write_bytes(source.read_bytes())
            files.commit()
        _report_written(files)
    return status


def design(options: argparse.Namespace) -> int:
    """Design a controller for a requirements file; print the report, and write the scenario."""
    from ..theory.synthesis import design as designed
    from ..theory.synthesis.table import rendered

    requirements = load(options.requirements, load_requirements)
    wanted = {
        "scenario": suffixed(options.output, (".toml",), "-o"),
        "plot": suffixed(options.plot, FIGURES, "--plot"),
    }
    target = wanted["scenario"]
    if target is not None and target.resolve() == Path(options.requirements).resolve():
        raise InvalidDescription("", f"-o {options.output}: would replace the requirements")
    with Files({key: path for key, path in wanted.items() if path}, options.force) as files:
        try:
            found = designed(requirements)
        except InvalidDescription as error:
            raise in_file(error, options.requirements) from None
        if "scenario" in files:
            files["scenario"].write_text(format_scenario(found.scenario()), encoding="utf-8")
        if "plot" in files:
            plots.design(found).savefig(files["plot"], dpi=150)
        console = _console()
        console.print(rendered(found, console.width))
        files.commit()
    _report_written(files)
    return 0


def _errata() -> int:
    from ..papers.zhang2007.errata import report

    print(report())
    return 0


def equations(options: argparse.Namespace) -> int:
    """Print a scenario's equations."""
    with _about(options.scenario) as scenario:
        if options.average:
            from ..theory.averaging import average

            averaged = average(_continuous(scenario.loop, sys.stderr if options.latex else None))
            print(averaged.latex() if options.latex else averaged.text())
            return 0
        loop = scenario.loop
        print(loop.system.latex() if options.latex else loop.system.text(loop.values.tolist()))
    return 0


def stability(options: argparse.Namespace) -> int:
    """Print a loop's verdict and the evidence for it."""
    from ..theory.verdict import stability as judge

    with _about(options.scenario) as scenario:
        verdict = judge(_continuous(scenario.loop, sys.stderr if options.json else None))
    if options.json:
        print(json.dumps(verdict.data(), indent=2, ensure_ascii=False))
    else:
        from ..theory.table import rendered

        console = _console()
        if scenario.title:
            console.print(scenario.title, markup=False, highlight=False)
        console.print(rendered(verdict, console.width))
    text, stable = _sampled(scenario.loop)
    if text and not options.json:
        print(f"\n{text}")
    return 0 if verdict.stable and stable else 1


def _continuous(loop: Loop, notes: TextIO | None = None) -> Loop:
    """Return a loop as theory takes it; say on `notes`, or standard output, what is left out."""
    if isinstance(loop, SampledLoop):
        print("[sampling] is left out: this is the continuous loop", file=notes)
        return loop.continuous
    return loop


def _sampled(loop: Loop) -> tuple[str, bool]:
    """Return what a sampled loop's average says, or why there is none; whether it is stable."""
    from ..theory.sampled import sampled_loop_gain

    if not loop.sampled:
        return "", True
    try:
        gain = sampled_loop_gain(loop)
    except InvalidDescription as error:
        return f"No averaged sampled loop: {error}", True
    return str(gain), gain.stable


def _console() -> Console:
    """Return standard output, as wide as its terminal."""
    from rich.console import Console

    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(width=None if known else WIDTH)


@contextmanager
def _about(path: str) -> Iterator[Scenario]:
    """Load a scenario; name its file in whatever is refused about its loop."""
    scenario = load(path, load_scenario)
    try:
        yield scenario
    except InvalidDescription as error:
        raise in_file(error, path) from None


def _simulated(scenario: Scenario, files: Files) -> int:
    from ..simulation import simulate

    begun = time.perf_counter()
    with Bar(scenario.title or "simulating", scenario.run.t_end, " s") as bar:
        result = simulate(
            scenario.loop,
            scenario.run.t_end,
            samples=scenario.run.samples,
            title=scenario.title,
            progress=bar,
        )
    print(summary(scenario, result, time.perf_counter() - begun))
    _write(scenario, result, files)
    return 0 if result.attrs["outcome"] == "completed" else 1


def _write(scenario: Scenario, result: xarray.Dataset, files: Files) -> None:
    if "data" in files:
        result.to_netcdf(files["data"], engine="h5netcdf")
    if "plot" in files:
        plots.overview(result, scenario.view).savefig(files["plot"], dpi=150)
    if "animation" in files:
        with Bar("drawing the animation", 1.0, "") as bar:
            plots.animate(result, files["animation"], view=scenario.view, progress=bar)


def _report_written(files: Files) -> None:
    if files.paths:
        print(f"wrote {', '.join(str(path) for path in files.paths.values())}\n")
