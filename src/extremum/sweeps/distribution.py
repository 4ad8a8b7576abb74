"""Jobs on Dask: processes of this machine, or a cluster."""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from ..errors import InvalidDescription

if TYPE_CHECKING:
    from distributed import Client

ATTEMPTS: Final = 3
"""How often a job may be given out anew after Dask gave it up."""
FAILURES: Final = 10
"""How many of its workers may die before Dask gives a job up."""
PATIENCE: Final = 10.0


def distribute(
    task: Callable[[int], int],
    todo: Mapping[int, int],
    done: Callable[[int], object],
    workers: int | None,
    scheduler: str | None,
) -> None:
    """Run jobs on Dask's workers; a job whose worker dies is run again by another.

    Parameters
    ----------
    task
        Runs a job and returns how many loops it had.
    todo
        Job → how many loops it has.
    done
        Called with that number as each job ends.
    workers
        Processes to start here.
    scheduler
        Or the address of a scheduler.

    Raises
    ------
    InvalidDescription
        If Dask is not installed, the scheduler is not reached, or a job kills every worker.
    """
    try:
        import distributed
    except ImportError:
        reason = 'need Dask, which is not installed: pip install "extremum[distributed]"'
        raise InvalidDescription("workers or scheduler", reason) from None
    attempts = dict.fromkeys(todo, 0)
    with _connected(workers, scheduler) as client:
        running = distributed.as_completed()
        jobs: dict[Any, int] = {}

        def give_out(job: int) -> None:
            future = client.submit(task, job, pure=False)
            jobs[future] = job
            running.add(future)

        for job in todo:
            give_out(job)
        for future in running:
            job = jobs.pop(future)
            try:
                done(future.result())
            except distributed.KilledWorker:
                attempts[job] += 1
                if attempts[job] > ATTEMPTS:
                    reason = "killed every worker that ran it; is there enough memory?"
                    raise InvalidDescription("", f"job {job} {reason}") from None
                give_out(job)


@contextmanager
def _connected(workers: int | None, scheduler: str | None) -> Iterator[Client]:
    from dask import config
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            reason = f"cannot be reached: {str(error) or type(error).__name__}"
            raise InvalidDescription("scheduler", reason.partition("\n")[0], scheduler) from None
        with client:
            yield client
        return
    with config.set({"distributed.scheduler.allowed-failures": FAILURES}):
        with _deaf():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=None,
                dashboard_address=None,  # pyright: ignore[reportArgumentType]
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def _deaf() -> Iterator[None]:
    """Block SIGINT in what is begun inside: Ctrl-C is for this process, not for its workers.

    One that comes meanwhile is delivered at the end.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # begun later, it would unblock SIGINT again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
