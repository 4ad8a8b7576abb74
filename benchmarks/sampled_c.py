"""The exported C: how large it is on small processors, and how long a step takes there and here."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from report import Table, Target, figure

import extremum as es
from extremum import s
from extremum.deploy.exporting import export_c
from extremum.deploy.measuring import PROCESSORS, avr_cycles, code_size, host_time
from extremum.papers import zhang2007

DT = 1e-3
AVR_CLOCK = 16e6
PAPER = "Fig. 4"

T = TypeVar("T")


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    with tempfile.TemporaryDirectory() as made:
        folders = exports(Path(made))
        yield sizes(folders)
        yield steps(folders, 2_000 if quick else 20_000)


def controllers() -> dict[str, es.DiscreteController]:
    """Return the controllers, from the paper's alone to one with nearly all of practice."""
    loop = zhang2007.scenario("fig4").loop
    lead = es.Lead(gain=5, zero=-0.5, pole=-3)
    channels = tuple(
        es.Channel(dither=es.Dither(0.1, phase=phase), gain=10, compensator=lead)
        for phase in (0, -es.pi / 2)
    )
    force = es.GradientES(frequency=30, washout=1.0, channels=channels)
    vehicle = es.PointMass(axes=(1 / s**2, 1 / s**2))
    validity = es.Validity(timeout=0.5, stuck=1.0)
    limits = es.Limits(low=(-200.0, -200.0), high=(200.0, 200.0))
    detector = es.Detector(level=0.2, time=1.0, response=2.5)
    return {
        PAPER: es.discretize(loop.controller, DT, vehicle=loop.vehicle),
        "double integrators, leads": es.discretize(force, DT, vehicle=vehicle),
        "the same, timeout and limits": es.discretize(
            force, DT, vehicle=vehicle, practice=es.Practice(validity=validity, limits=limits)
        ),
        "the same, log scale, changes, detector": es.discretize(
            force,
            DT,
            vehicle=vehicle,
            practice=es.Practice(
                validity=validity,
                limits=limits,
                scale=es.LogScale(floor=0.01),
                changes=es.Changes(time=1.0),
                detector=detector,
            ),
        ),
    }


def exports(folder: Path) -> dict[tuple[str, str], Path]:
    """Export every controller in both precisions: (name, precision) → folder."""
    found: dict[tuple[str, str], Path] = {}
    for i, (name, ctrl) in enumerate(controllers().items()):
        export_c(ctrl, folder / f"double{i}")
        export_c(ctrl, folder / f"single{i}", precision="single")
        found[name, "double"] = folder / f"double{i}"
        found[name, "single"] = folder / f"single{i}"
    return found


def sizes(folders: dict[tuple[str, str], Path]) -> Table:
    """Return code and constants with what they need of libraries, -Os."""
    rows, data = [], {}
    for (name, precision), folder in folders.items():
        found = {
            processor: _if(tools[0], lambda p=processor, f=folder: code_size(f, "esc", p))
            for processor, tools in PROCESSORS.items()
        }
        rows.append([name, precision, *(_shown(number) for number in found.values())])
        data[f"{name}, {precision}"] = found
    size = data[f"{PAPER}, single"]["Cortex-M4F"]
    targets = (
        [Target("Cortex-M4F, Fig. 4 in single precision", size, 1024, "bytes")] if size else []
    )
    return Table(
        title="Size of the exported C (bytes)",
        columns=["controller", "precision", *PROCESSORS],
        rows=rows,
        notes=["All functions, constants, and what they need of libgcc and libm; -Os, linked."],
        targets=targets,
        data=data,
    )


def steps(folders: dict[tuple[str, str], Path], count: int) -> Table:
    """Return the cycles of a step on an AVR, and its time here."""
    rows, data, targets = [], {}, []
    for (name, precision), folder in folders.items():
        cycles = _if("simavr", lambda f=folder: avr_cycles(f, "esc", count))
        here = _if("gcc", lambda f=folder: min(host_time(f, "esc") for _ in range(5)))
        worst = None if cycles is None else cycles[0]
        rows.append(
            [
                *(name, precision, _shown(worst), _shown(None if cycles is None else cycles[1])),
                "" if worst is None else figure(1e3 * worst / AVR_CLOCK),
                "" if here is None else figure(here * 1e9),
            ]
        )
        data[f"{name}, {precision}"] = {"cycles": cycles, "seconds": here}
        if name == PAPER and precision == "double" and here is not None:
            targets.append(Target("C step here, Fig. 4 in double precision", here * 1e9, 60, "ns"))
        if name == PAPER and precision == "single" and worst is not None:
            most = 1e3 * worst / AVR_CLOCK
            targets.append(Target("AVR step at 16 MHz, Fig. 4 in single precision", most, 1, "ms"))
    return Table(
        title="Time of a step of the exported C",
        columns=["controller", "precision", "AVR, most cycles", "mean", "ms at 16 MHz", "here, ns"],
        rows=rows,
        notes=[
            f"AVR: ATmega328P in simavr, the largest of {count:,} steps, one sample in eight of "
            "random bits; double has 32 bits there."
        ],
        targets=targets,
        data=data,
    )


def _if(tool: str, measure: Callable[[], T]) -> T | None:
    """Return a measurement, None where its tool is not installed."""
    return measure() if shutil.which(tool) else None


def _shown(number: float | None) -> str:
    return "not installed" if number is None else f"{number:,}"
