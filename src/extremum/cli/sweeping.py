"""The command `sweep`."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..errors import InvalidDescription
from ..sweeps import Study, load_study
from ..sweeps import sweep as swept
from ..sweeps.jobs import kept
from .inputs import in_file, load, suffixed
from .progress import Bar

if TYPE_CHECKING:
    import xarray

INTERRUPTED: Final = 130
OUTCOMES: Final = ("completed", "escaped", "left the field's data")


class _Tally:
    """How many loops were done at first and at last."""

    def __init__(self, bar: Bar) -> None:
        self.bar, self.first, self.last = bar, 0.0, 0.0
        self.called = False

    def __call__(self, loops: float) -> None:
        """Pass on to the bar how many are done."""
        self.first = self.first if self.called else loops
        self.last, self.called = loops, True
        self.bar(loops)


def sweep(options: argparse.Namespace) -> int:
    """Run a study's loops into its store, or those that are missing there."""
    study = load(options.study, load_study)
    store = suffixed(options.output, (".zarr",), "-o") or Path(f"{Path(options.study).stem}.zarr")
    begun = time.perf_counter()
    with Bar(_title(study), study.sweep.count(), " loops", rate=True) as bar:
        tally = _Tally(bar)
        try:
            found = swept(
                study,
                store,
                workers=options.workers,
                scheduler=options.scheduler,
                threads=options.threads,
                progress=tally,
            )
        except InvalidDescription as error:
            raise (
                in_file(error, options.study) if error.path.startswith("sweep.") else error
            ) from None
        except KeyboardInterrupt:
            print(_kept(study, store), file=sys.stderr)
            return INTERRUPTED
    print(_summary(study, found, store, tally, time.perf_counter() - begun))
    return 0


def _title(study: Study) -> str:
    return study.scenario.title or "sweeping"


def _kept(study: Study, store: Path) -> str:
    done = f"{kept(store):,} of {study.sweep.count():,} loops are kept in {store}"
    return f"interrupted: {done}; the same command goes on"


def _accuracy(found: xarray.Dataset) -> list[str]:
    """Return what half the step changed, as text; nothing where no loop completed."""
    attrs = found.attrs
    if attrs["error"] is None or attrs["typical_error"] is None:
        return []
    largest, typical = f"{attrs['error']:.1e}", f"{attrs['typical_error']:.1e}"
    return [
        f"half the step changes the end by {largest} at most, typically {typical}, and "
        f"{attrs['doubtful']} outcomes (some loops of each job)"
    ]


def _summary(
    study: Study, found: xarray.Dataset, store: Path, tally: _Tally, seconds: float
) -> str:
    """Return what was run, how it ended and how fast, as text."""
    total = study.sweep.count()
    shares = [
        f"{100 * count / total:.3g} % {outcome}"
        for outcome, count in zip(OUTCOMES, found.attrs["outcomes"], strict=True)
        if count
    ]
    lines = [study.scenario.title] if study.scenario.title else []
    lines.append(f"{total:,} loops: {', '.join(shares)}")
    lines += _accuracy(found)
    if not tally.called:
        return "\n".join([*lines, f"{store} is complete; there is nothing to do"])
    run = tally.last - tally.first
    rest = f", {tally.first:,.0f} were there" if tally.first else ""
    rate = float(f"{run / seconds:.3g}")
    lines.append(f"ran {run:,.0f} in {seconds:.3g} s: {rate:,.0f} loops/s{rest}")
    return "\n".join([*lines, f"wrote {store}"])
