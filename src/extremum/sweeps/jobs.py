"""One job of a sweep: its loops run, its chunks and then its record written."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from .. import stores
from ..errors import InvalidDescription
from . import sampling
from .layout import Layout, loops
from .study import Study, parse_study

if TYPE_CHECKING:
    import xarray

OUTCOMES: Final = 3
TOTALS: Final = {"steps": sum, "error": max, "typical_error": median, "doubtful": sum}
"""How the attributes of all jobs' ensembles make those of the sweep."""
Progress = Callable[[float], object]
Compute = Callable[..., "xarray.Dataset"]
"""(study, {path: numbers}, threads=…, progress=…) → what `ensemble` returns."""


def ensembled(
    study: Study, over: Mapping[str, Any], *, threads: int | None, progress: Progress | None
) -> xarray.Dataset:
    """Run the loops of a study that have these numbers."""
    from ..ensembles import ensemble

    sweep = study.sweep
    return ensemble(
        study.scenario.loop.covering(sweep.ends),
        study.scenario.run.t_end,
        over=over,
        keep=sweep.keep,
        radius=sweep.radius,
        samples=sweep.samples,
        tol=sweep.tol,
        device=sweep.device,
        dtype=sweep.dtype,
        threads=threads,
        progress=progress,
    )


def results(
    study: Study,
    region: Mapping[str, slice],
    compute: Compute,
    threads: int | None = None,
    progress: Progress | None = None,
) -> xarray.Dataset:
    """Return a region's results, with the axes' numbers as coordinates.

    Raises
    ------
    InvalidDescription
        If the ensemble refuses the study.
    """
    over = sampling.over(study.sweep, region)
    try:
        found = compute(study, over, threads=threads, progress=progress)
    except InvalidDescription as error:
        raise _of_study(error, study) from None
    units = {path: found[path].attrs for path in over if path in found.coords}
    labels = {
        str(name): coordinate.variable
        for path, array in over.items()
        for name, coordinate in {**array.coords, path: array}.items()
    }
    found = found.drop_vars(["loop", *over], errors="ignore").assign_coords(labels)
    for path, attrs in units.items():
        found[path].attrs.update(attrs)
    return found


def _of_study(error: InvalidDescription, study: Study) -> InvalidDescription:
    first = error.path.partition(".")[0]
    if first in ("keep", "radius", "samples", "tol", "dtype", "device", "threads"):
        return error if first == "threads" else error.within("sweep")
    path = error.path.removeprefix("over.")
    for name in study.sweep.axes:
        if path in study.sweep.paths(name):
            return InvalidDescription(f"sweep.axes.{name}", error.reason, error.value)
    return error


def finish(
    store: str,
    job: int,
    compute: Compute,
    threads: int | None = None,
    progress: Progress | None = None,
) -> int:
    """Run a job of a store and write its results; return how many loops it had.

    A job is done when its record, written last, is there.

    Raises
    ------
    InvalidDescription
        If the store is not there or cannot be written.
    """
    folder = Path(store)
    attrs = stores.attributes(folder)
    study, layout = parsed(attrs["study"]), laid_out(attrs)
    region = layout.region(job)
    found = results(study, region, compute, threads, progress)
    part = found.drop_vars(found.coords) if study.sweep.method == "grid" else found
    stores.put(folder, part, region, str(job))
    stores.write_text(folder, record(folder, job), json.dumps(_summary(found)))
    return loops(region)


parsed = lru_cache(maxsize=4)(parse_study)
"""The study that a store's text states; jobs of one store share it."""


def laid_out(attrs: Mapping[str, Any]) -> Layout:
    """Return the layout that a store was made with."""
    sweep = parsed(attrs["study"]).sweep
    return Layout(sweep.dims(), sweep.shape(), tuple(attrs["chunk"]))


def record(store: Path, job: int) -> Path:
    """Return the file that says that a job is done."""
    return store / stores.JOBS / f"{job}.json"


def _summary(found: xarray.Dataset) -> dict[str, Any]:
    counts = np.bincount(found["outcome"].values.ravel().astype(int), minlength=OUTCOMES)
    numbers = {name: stores.plain(found.attrs[name]) for name in TOTALS}
    known = {name: None if number != number else number for name, number in numbers.items()}
    return {"outcomes": counts.tolist(), **known}


def records(store: Path, layout: Layout) -> dict[int, dict[str, Any]]:
    """Return job → what its record says, for those that are done."""
    found = {}
    for file in (store / stores.JOBS).glob("[0-9]*.json"):
        try:
            found[int(file.stem)] = json.loads(file.read_text(encoding="utf-8"))
        except ValueError:
            continue  # cut off when the power failed: the job is done again
    return {job: found[job] for job in range(layout.jobs) if job in found}


def kept(store: Path) -> int:
    """Return how many loops of a store are done."""
    if not store.exists():
        return 0
    attrs = stores.attributes(store)
    layout = laid_out(attrs)
    if attrs["complete"]:
        return math.prod(layout.shape)
    return sum(loops(layout.region(job)) for job in records(store, layout))


def total(records: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the attributes that follow from all records."""
    found = {"outcomes": np.sum([r["outcomes"] for r in records.values()], axis=0).tolist()}
    for name, combine in TOTALS.items():
        known = [record[name] for record in records.values() if record[name] is not None]
        found[name] = combine(known) if known else None
    return found
