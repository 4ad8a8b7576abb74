"""What every benchmark file shares: tables, targets, and how a time is taken."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table as RichTable

PACKAGES = ("extremum", "heyoka", "numpy", "scipy", "sympy", "xarray", "matplotlib", "control")


@dataclass(frozen=True)
class Target:
    """A figure that the project promises.

    Attributes
    ----------
    name
        What is measured.
    measured, limit
        In `unit`.
    unit
        Such as ``"ms"``.
    at_least
        Whether `limit` is a lower bound.
    """

    name: str
    measured: float
    limit: float
    unit: str
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether the promise holds."""
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit


@dataclass(frozen=True)
class Table:
    """One table of results, and the targets that it decides.

    Attributes
    ----------
    title, columns, rows
        What is printed; every cell is text.
    notes
        Sentences printed below.
    targets
        The promises that these measurements decide.
    data
        The plain numbers, for ``--json``.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()
    targets: Sequence[Target] = ()
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Times:
    """Times of repeated runs, in seconds."""

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """The median (s)."""
        return median(self.seconds)

    def text(self, unit: str = "ms") -> tuple[str, str]:
        """Return the median and the range as text."""
        scale = {"ms": 1e3, "s": 1.0}[unit]
        low, high = min(self.seconds) * scale, max(self.seconds) * scale
        return figure(self.median * scale), f"{figure(low)} – {figure(high)}"

    def data(self) -> dict[str, Any]:
        """Return the numbers for ``--json``."""
        return {
            "median_s": self.median,
            "min_s": min(self.seconds),
            "max_s": max(self.seconds),
            "runs": len(self.seconds),
        }


def figure(number: float) -> str:
    """Return three significant digits."""
    return f"{number:.0f}" if abs(number) >= 100 else f"{number:#.3g}"


def interleaved(
    runs: dict[str, Callable[[], object]],
    rounds: int,
    repeats: dict[str, int] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Times]:
    """Time every run in each round, so that a busy machine slows all of them alike.

    A run named in `repeats` is timed that often in a round; every time counts.
    """
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            for _ in range((repeats or {}).get(name, 1)):
                begin = clock()
                run()
                taken[name].append(clock() - begin)
    return {name: Times(tuple(seconds)) for name, seconds in taken.items()}


def environment(**changes: str) -> dict[str, str]:
    """Return the environment of a fresh process whose bytecode is kept, as after an installation.

    The first run of several writes it, also where ``PYTHONDONTWRITEBYTECODE`` is set.
    """
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {**kept, **changes}


def machine() -> dict[str, str]:
    """Return the machine and the versions, in general terms."""
    facts = {
        "cpu": _cpu(),
        "cores": str(os.cpu_count()),
        "system": platform.system(),
        "python": platform.python_version(),
    }
    for package in PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "absent"
    return facts


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    known = dict(line.split("\t:", 1) for line in lines if "\t:" in line)
    facts = {key.strip(): text.strip() for key, text in known.items()}
    name = facts.get("model name", platform.machine())
    vector = next((v for v in ("avx512f", "avx2") if v in facts.get("flags", "").split()), "")
    return f"{name}, family {facts.get('cpu family', '?')}" + (f", {vector}" if vector else "")


def show(table: Table, console: Console) -> None:
    """Print one table."""
    console.print(table.title, style="bold", markup=False, highlight=False)
    printed = RichTable()
    for index, column in enumerate(table.columns):
        printed.add_column(column, justify="left" if index == 0 else "right")
    for row in table.rows:
        printed.add_row(*row)
    console.print(printed)
    for note in table.notes:
        console.print(f"  {note}", markup=False, highlight=False)
    console.print()


def verdict(targets: Iterable[Target]) -> Table:
    """Return the table of promises."""
    rows = [
        (
            target.name,
            f"{figure(target.measured)} {target.unit}",
            f"{'≥' if target.at_least else '≤'} {target.limit:g} {target.unit}",
            "met" if target.met else "MISSED",
        )
        for target in targets
    ]
    return Table("Targets", ("figure", "measured", "target", ""), rows)


def as_data(table: Table) -> dict[str, Any]:
    """Return a table for ``--json``."""
    targets = [{**asdict(target), "met": target.met} for target in table.targets]
    return {"title": table.title, "targets": targets, **table.data}
