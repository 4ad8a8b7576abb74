"""An ensemble whose results are known, for sweeps that are tested without an engine."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import xarray

import extremum as es
from extremum.sweeps import Study, layout, parse_study

GRID = """
scenario = "paper:fig4"
[sweep]
keep = ["distance"]
[sweep.axes]
"start.0" = { low = -3, high = 3, points = 20 }
gain = { paths = ["controller.channels.0.gain", "controller.channels.1.gain"], values = [1, 5, 7] }
"""
DRAWN = """
scenario = "paper:fig4"
[sweep]
method = "random"
loops = 60
seed = 3
[sweep.axes]
"start.0" = { low = -3, high = 3 }
"field.q.0" = { low = 0.1, high = 10, distribution = "log-uniform" }
"""
FAR = 1.8
"""Jobs all of whose sums are larger do not know their error."""
JOB = 8
"""Loops of a job in these tests."""


def study(text: str = GRID) -> Study:
    return parse_study(text)


def small_jobs(size: int = JOB, monkeypatch=None) -> None:
    """Make jobs of so many loops; for good, or until the test ends."""
    for name in ("SMALLEST", "LARGEST"):
        (monkeypatch.setattr if monkeypatch else setattr)(layout, name, size)


def ensemble(study, over, *, threads=None, progress=None) -> xarray.Dataset:
    """x = cos(Σ k a_k) over all swept numbers a_k; it escapes where the sum is above 5."""
    arrays = xarray.broadcast(*over.values())
    dims, total = arrays[0].dims, np.zeros(arrays[0].shape)
    for k, array in enumerate(arrays):
        total += (k + 1) * array.values
    end = np.where(total > 5, 1.0, study.scenario.run.t_end)
    nearest = float(np.abs(total).min())
    accuracy = {"error": nearest if nearest < FAR else np.nan, "typical_error": 1e-9, "doubtful": 1}
    found = xarray.Dataset(
        {
            "x": (dims, np.cos(total), {"units": "m"}),
            "position": ((*dims, "axis"), np.stack([total, -total], -1), {"units": "m"}),
            "J": (dims, -(total**2), {"units": "1"}),
            "outcome": (dims, (total > 5).astype(np.int8), {"flag_values": np.arange(3)}),
            "end_time": (dims, end, {"units": "s"}),
        },
        {"axis": ["x", "y"], **{path: array.variable for path, array in over.items()}},
        {"t_end": study.scenario.run.t_end, "steps": 3 * total.size, **accuracy},
    )
    for path in over:
        found[path].attrs["units"] = "m"
    if progress is not None:
        progress(0.5)
    return found


def slow_ensemble(study, over, *, threads=None, progress=None) -> xarray.Dataset:
    time.sleep(0.05)
    return ensemble(study, over)


def contents(store: Path) -> dict[str, bytes]:
    """Return every file of a store."""
    return {
        str(file.relative_to(store)): file.read_bytes()
        for file in sorted(store.rglob("*"))
        if file.is_file()
    }


def refusal(action) -> str:
    """Return the message that an action is refused with."""
    try:
        action()
    except es.InvalidDescription as error:
        return str(error)
    raise AssertionError("it was not refused")


def refusing(study, over, **options) -> xarray.Dataset:
    """Refuse all but the first job that is left."""
    if over["start.0"].values.min() > 0.5:
        raise es.InvalidDescription("keep", "cannot be kept", "'x'")
    return ensemble(study, over)


def deadly(study, over, **options) -> xarray.Dataset:
    """End the process, as the system does to one that takes too much memory."""
    os._exit(1)
