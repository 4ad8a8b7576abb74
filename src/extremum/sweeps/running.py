"""`sweep`: a study's loops, run job by job into a Zarr store."""

from __future__ import annotations

import os
import shutil
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from .. import stores
from ..ensembles.streaming import FLAGS
from ..errors import InvalidDescription, shown
from . import jobs, sampling
from .distribution import distribute
from .identity import identity, is_complete
from .jobs import Compute, Progress, ensembled
from .layout import loops, planned
from .locking import alone
from .study import Study, format_study

if TYPE_CHECKING:
    import xarray

LOCK: Final = "lock"


def sweep(
    study: Study,
    store: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> xarray.Dataset:
    """Run a study's loops into a Zarr store; go on where an earlier call was ended.

    The loops are cut into jobs, one chunk of every variable each. A job's chunks are renamed into
    place when all are written, then its record is. Killed at any moment and called again, it runs
    the jobs without a record; the store ends with the same bytes as without the interruption.
    What happens to a loop depends on the study and its index only.

    Parameters
    ----------
    study
        The study.
    store
        The store's folder; made if it does not exist.
    workers
        Run the jobs in so many processes of this machine (Dask). By default they run one after
        another in this process, each on `threads` threads.
    scheduler
        Address of a Dask scheduler whose workers run the jobs; they must see the store's folder
        under the same name.
    threads
        Threads of each job; by default as many as the machine has, shared among the `workers`.
    progress
        Called with the number of loops done, those of earlier calls included.

    Returns
    -------
    xarray.Dataset
        The store, opened lazily: what `ensemble` returns, over the axes of a grid or over ``loop``.
        In its attrs, ``outcomes`` counts the loops that completed, escaped and left the data;
        ``error`` is the largest of the jobs', ``typical_error`` their median, ``doubtful`` their
        sum, up to 256 loops of each job having been run again; ``study`` is the text of `study`.

    Raises
    ------
    InvalidDescription
        If the study cannot be run, or the store holds another study, is being written by another
        process or cannot be written. What is done is kept.
    """
    if not isinstance(study, Study):
        raise InvalidDescription(
            "study", "must be a Study, such as load_study(path) returns", shown(study)
        )
    if not isinstance(store, str | Path) or not str(store):
        raise InvalidDescription("store", "must be a path", shown(store))
    folder = Path(store).absolute()
    workers, threads = _counts(workers, scheduler, threads)
    run(study, folder, ensembled, workers, scheduler, threads, progress)
    return stores.opened(folder)


def _counts(
    workers: int | None, scheduler: str | None, threads: int | None
) -> tuple[int | None, int | None]:
    for name, given in (("workers", workers), ("threads", threads)):
        if given is not None and (not isinstance(given, int) or given < 1):
            raise InvalidDescription(name, "must be a whole number, at least 1", shown(given))
    if workers is not None and scheduler is not None:
        raise InvalidDescription("workers", "or scheduler, one of the two", shown(workers))
    if threads is None and scheduler is not None:
        threads = 1
    if threads is None and workers is not None:
        threads = max(1, (os.cpu_count() or 1) // workers)
    return workers, threads


def run(
    study: Study,
    store: Path,
    compute: Compute,
    workers: int | None = None,
    scheduler: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Do what `sweep` does, with any function that computes a job's loops."""
    if not store.exists():
        _begin(study, store, compute)
    if is_complete(store, study):
        shutil.rmtree(store / stores.JOBS, ignore_errors=True)
        return
    with alone(store, store / stores.JOBS / LOCK):
        if is_complete(store, study):
            return
        _tidy(store)
        stores.set_attributes(store, {"study": format_study(study)})  # its files may have moved
        layout = jobs.laid_out(stores.attributes(store))
        records = jobs.records(store, layout)
        counter = _Counter(progress, sum(loops(layout.region(job)) for job in records))
        todo = {job: loops(layout.region(job)) for job in range(layout.jobs) if job not in records}
        if workers is None and scheduler is None:
            for job, size in todo.items():
                counter.add(jobs.finish(str(store), job, compute, threads, counter.within(size)))
        elif todo:
            task = partial(jobs.finish, str(store), compute=compute, threads=threads)
            distribute(task, todo, counter.add, workers, scheduler)
        whole = jobs.total(jobs.records(store, layout))
        stores.set_attributes(store, {**whole, "complete": 1})
        shutil.rmtree(store / stores.JOBS, ignore_errors=True)


def _begin(study: Study, store: Path, compute: Compute) -> None:
    """Make the store, from the results of the first loop."""
    if not store.parent.is_dir():
        raise InvalidDescription("", f"cannot write {store}: there is no folder {store.parent}")
    layout, text = planned(study), format_study(study)
    first = jobs.results(study, {dim: slice(0, 1) for dim in layout.dims}, compute)
    constant = [name for name, v in first.variables.items() if not set(layout.dims) & set(v.dims)]
    whole = first[constant]
    if study.sweep.method == "grid":
        numbers = sampling.over(study.sweep, {dim: slice(None) for dim in layout.dims})
        for path, array in numbers.items():
            whole = whole.assign_coords({**array.coords, path: array.variable})
            whole[path].attrs.update(first[path].attrs)
    whole.attrs = {key: item for key, item in first.attrs.items() if key not in jobs.TOTALS}
    whole.attrs |= {"loops": study.sweep.count(), **identity(text, layout.chunk)}
    growing = first.drop_vars([name for name in first.variables if name in whole.variables])
    growing["outcome"].attrs |= FLAGS
    stores.create(store, growing, layout.sizes, layout.chunks, whole)


class _Counter:
    """Tells how many loops are done."""

    def __init__(self, progress: Progress | None, done: int) -> None:
        self._progress, self._done = progress, done
        self.add(0)

    def add(self, loops: int) -> None:
        """Count the loops of a job that is done."""
        self._done += loops
        self._tell(self._done)

    def within(self, loops: int) -> Progress:
        """Return what is called with the share of a running job's loops that is done."""
        return lambda share: self._tell(self._done + share * loops)

    def _tell(self, done: float) -> None:
        if self._progress is not None:
            self._progress(done)


def _tidy(store: Path) -> None:
    """Remove what a killed process was preparing."""
    for place in (store / stores.JOBS).glob("*.part"):
        if place.is_dir():
            shutil.rmtree(place, ignore_errors=True)
        else:
            place.unlink(missing_ok=True)
