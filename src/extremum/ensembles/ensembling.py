"""`ensemble`: many runs of a loop whose numbers vary, as an `xarray.Dataset`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from ..engines.lanes.accuracy import estimate
from ..engines.lanes.asked import Ended
from ..engines.trajectory import Progress
from ..errors import InvalidDescription, shown
from ..loop import Loop
from ..simulation import scenario_text
from . import regions
from .streaming import new
from .tasks import prepared

if TYPE_CHECKING:
    import xarray

ENGINES: Final = {"cpu": "simd", "cuda": "cuda"}


def ensemble(
    loop: Loop,
    t_end: float,
    *,
    over: Mapping[str, ArrayLike | xarray.DataArray],
    keep: Sequence[str] = (),
    radius: float | None = None,
    samples: int | None = None,
    tol: float | None = None,
    device: str = "cpu",
    dtype: str = "float64",
    threads: int | None = None,
    into: str | Path | None = None,
    progress: Progress | None = None,
) -> xarray.Dataset:
    """Integrate many loops of one structure from t = 0 to `t_end` and return what became of them.

    ẋ_i = f(x_i, p_i, t), the equations that ``print(loop.system)`` shows, with a column p_i of
    numbers for each loop i. What becomes of a loop depends on its own numbers only: not on the
    other loops, nor on `threads` or `into`.

    Parameters
    ----------
    loop
        The loop; its numbers hold where `over` says nothing else. The field must be a formula or
        gridded data, not `Opaque`. A `SampledLoop` takes steps of ``sampling.dt``, exactly: means
        are then over its samples, and maxima and crossings those of the samples.
    t_end
        Duration (s); of a sampled loop a whole number of sampling times.
    over
        Dotted path of a number → its values. Arrays broadcast as in NumPy, over dimensions called
        ``loop`` (one) or ``loop_0``, ``loop_1``, …; `xarray.DataArray` s broadcast by the names of
        their dimensions, which the result keeps with their coordinates. A number that is structure
        of the loop because of its value, such as a phase of −π/2, may vary like any other.
    keep
        Statistics, D being the dimensions of `over`:

        - ``"mean_J"`` (D): (1/T) ∫ J dt over the run, T = `end_time`;
        - ``"max_J"`` (D): the largest J of the run;
        - ``"mean_position"`` (D, axis): (1/P) ∫ p dt over the last period P (m);
        - ``"distance"`` (D): |(1/P) ∫ (p − p*) dt| over the last period (m), p* the source;
        - ``"settling_time"`` (D): the last time at which |p − p*| > `radius` (s), 0 if it never
          was; NaN if the run did not complete, or ends outside;
        - ``"peak_input"`` (D, input): the largest |u_i| of the run.

        P is the time after which all dithers repeat; where their frequencies have no common
        measure (a ratio that is a float, or is in `over`), the slowest dither's period; `t_end`
        where that is shorter. Over the last period of a run that did not complete, statistics are
        NaN.
    radius
        For ``"settling_time"`` (m).
    samples
        How many equispaced times, 0 and `t_end` among them, trajectories are kept at; None for
        none. Of a sampled loop they must be sampling instants.
    tol
        Each step may err by a thirtieth of it, relative to 1 + |x|; what that comes to at the end
        is measured, see ``error`` below. In gridded fields it sets the step's length. None: 1e-6,
        in ``"float32"`` 1e-4; there at least 1e-5. Sampled loops have no use for it.
    device
        ``"cpu"``, or ``"cuda"`` for an NVIDIA GPU, which does not run sampled loops yet.
    dtype
        ``"float64"`` or ``"float32"``, not for sampled loops: what is computed with, and returned.
    threads
        How many threads of the CPU; None for all that the process may use.
    into
        Path of a new Zarr store, to which the result is written as it is computed, so that memory
        does not grow with the number of loops; the result is this store, opened lazily. It is made
        with its first block; loops that were not run (after Ctrl-C) have the outcome −1 in it.
    progress
        Called with the fraction of loops done, now and then.

    Returns
    -------
    xarray.Dataset
        Every state by name (D) and ``position`` (D, axis) (m) and ``J`` (D) at the end; ``outcome``
        (D), 0 completed, 1 escaped (to infinity in finite time), 2 left the data; ``end_time`` (D)
        (s), `t_end` or, where the outcome is not 0, the last step inside the domain; what `keep`
        names; with `samples` ``sampled_position`` (D, time, axis) and ``sampled_J`` (D, time), NaN
        after a loop's end. Every path of `over` is a coordinate. The attrs hold ``t_end``,
        ``tol``, ``dtype``, ``device``, ``scheme``, ``loops``, ``steps`` (of all loops) and
        ``scenario``, the text of `loop`. Up to 256 loops are run once more with half the step:
        ``error`` and ``typical_error`` are the largest and the median change of their final
        states, relative to 1 + |x|, and ``doubtful`` says how many of them then had another
        outcome; all 0 for sampled loops, whose steps are no approximations.

    Raises
    ------
    InvalidDescription
        For a path that names no number, values that cannot be right (with the index of the first),
        shapes that do not broadcast, arguments that do not fit each other, results that do not
        fit into memory, coordinates that no store can hold, and for sampled loops durations or
        samples between sampling instants, and delays of different numbers of whole samples.

    Notes
    -----
    The method is a Taylor step of fixed order, see ``docs/ensembles.md``; the loops are those of
    Zhang, Siranosian and Krstić (2007), equation (2) and Figs. 1 to 3.
    """
    integrate = integrator(device)
    task = prepared(loop, t_end, over, keep, radius, samples, tol, dtype)
    cores = _threads(threads)
    _check_progress(progress)
    chunk = task.chunk()
    known = {
        "t_end": task.t_end,
        "tol": task.tol,
        "dtype": task.dtype,
        "device": device,
        "loops": task.lanes.count,
        "scenario": scenario_text(loop, task.t_end),
    }
    target = task.target(None if into is None else new(into), chunk, known)
    accuracy = None if task.tells(chunk) else task.accuracy(integrate)
    steps, done, scheme = 0, 0, ""
    for region in regions.regions(task.lanes.shape, chunk):
        part = task.asked(task.lanes.columns(region))
        ended = integrate(
            part, threads=cores, progress=_within(progress, done, part.count, task.lanes.count)
        )
        accuracy = accuracy or estimate(part, ended, integrate)
        target.write(region, task.results(part, ended))
        steps, scheme = steps + int(ended.steps.sum()), ended.scheme
        done += part.count
        if progress is not None:
            progress(done / task.lanes.count)
    assert accuracy is not None
    return target.finished(
        {
            "scheme": scheme,
            "steps": steps,
            "error": accuracy.largest,
            "typical_error": accuracy.typical,
            "doubtful": accuracy.doubtful,
        }
    )


def integrator(device: Any) -> Callable[..., Ended]:
    """Return the engine of a device: `Asked` → `Ended`."""
    if not isinstance(device, str) or device not in ENGINES:
        raise InvalidDescription("device", 'must be "cpu" or "cuda"', shown(device))
    return import_module(f"..engines.{ENGINES[device]}", __package__).integrate


def _threads(threads: Any) -> int:
    if threads is None:
        if hasattr(os, "sched_getaffinity"):
            return len(os.sched_getaffinity(0))
        return os.cpu_count() or 1
    whole = isinstance(threads, int | np.integer) and not isinstance(threads, bool)
    if not whole or threads < 1:
        raise InvalidDescription("threads", "must be a whole number, at least 1", shown(threads))
    return int(threads)


def _check_progress(progress: Any) -> None:
    if progress is not None and not callable(progress):
        reason = "must be a function that takes the fraction of loops done"
        raise InvalidDescription("progress", reason, shown(progress))


def _within(
    progress: Progress | None, done: int, count: int, total: int
) -> Callable[[float], object] | None:
    """Return the progress of a block as progress of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress((done + fraction * count) / total)
