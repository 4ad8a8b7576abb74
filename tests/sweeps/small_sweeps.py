"""Sweeps of 60 loops in jobs of at most 8."""

from __future__ import annotations

from pathlib import Path

import closed_form
import pytest
import xarray
from closed_form import GRID, study

from extremum import stores
from extremum.sweeps import running


def run(store: Path, text: str = GRID, compute=closed_form.ensemble, **options) -> xarray.Dataset:
    running.run(study(text), store, compute, **options)
    return stores.opened(store)


def interrupted(store: Path, after: int, text: str = GRID) -> None:
    """Run until so many jobs are done."""
    left = [after]

    def compute(*arguments, **options):
        left[0] -= 1
        if left[0] < -1:  # the first call is for the store's layout
            raise KeyboardInterrupt
        return closed_form.ensemble(*arguments, **options)

    with pytest.raises(KeyboardInterrupt):
        run(store, text, compute)
