"""Run a sweep of slow small jobs into a store: kill_me.py STORE."""

from __future__ import annotations

import sys
from pathlib import Path

import closed_form
import zarr  # noqa: F401

from extremum.sweeps import running

closed_form.small_jobs()
running.run(
    closed_form.study(),
    Path(sys.argv[1]),
    closed_form.slow_ensemble,
    progress=lambda loops: print(loops, flush=True),
)
