"""A result that is streamed to a Zarr store is the one in memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from loops import velocity_actuated

import extremum as es
from extremum.ensembles import regions
from extremum.ensembles.keeping import STATISTICS

START = xarray.DataArray(
    np.linspace(-1, 1, 5), dims="begin", coords={"begin": list("abcde"), "far": 3.0}
)
PHASE = xarray.DataArray([-np.pi / 2, -1.0, 0.3], dims="phase", attrs={"source": "a test"})
OVER = {"start.0": START, "controller.channels.1.dither.phase": PHASE, "field.peak": 0.5}
ASKED: dict[str, Any] = {"over": OVER, "keep": tuple(STATISTICS), "radius": 1.0, "samples": 4}


def test_the_store_is_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "LIMIT", 6)
    memory = es.ensemble(velocity_actuated(), 0.5, **ASKED)
    path = tmp_path / "result.zarr"
    lazy = es.ensemble(velocity_actuated(), 0.5, **ASKED, into=path)
    assert not isinstance(lazy.x.variable._data, np.ndarray)
    xarray.testing.assert_equal(lazy, memory)
    assert list(lazy.data_vars) == list(memory.data_vars)
    assert set(lazy.coords) == set(memory.coords)
    assert lazy.attrs == memory.attrs
    again = xarray.open_zarr(path, chunks=None, consolidated=False)
    xarray.testing.assert_equal(again.sel(axis="x", begin="c"), memory.sel(axis="x", begin="c"))
    assert again.outcome.attrs["flag_values"] == [0, 1, 2]


def test_a_chunk_is_a_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "LIMIT", 6)
    es.ensemble(velocity_actuated(), 0.1, **ASKED, into=tmp_path / "result.zarr")
    group = zarr.open_group(tmp_path / "result.zarr", mode="r")
    chunk = regions.chunked((5, 3), 6)
    assert chunk == (2, 3)
    for name, inner in (("x", ()), ("sampled_position", (4, 2)), ("outcome", ())):
        array: Any = group[name]
        assert array.chunks == (*chunk, *inner)


def test_what_was_run_before_an_interrupt_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(regions, "LIMIT", 3)
    path = tmp_path / "result.zarr"

    def interrupt(fraction: float) -> None:
        if fraction > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        es.ensemble(velocity_actuated(), 0.1, **ASKED, into=path, progress=interrupt)
    found = xarray.open_zarr(path, chunks=None, consolidated=False)
    assert set(np.unique(found.outcome)) == {-1, 0}
    assert np.array_equal(found.outcome == -1, np.isnan(found.x))


def test_a_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(zarr.Array, "__setitem__", full)
    with pytest.raises(es.InvalidDescription, match=r"into.*cannot be written.*No space left"):
        es.ensemble(velocity_actuated(), 0.1, **ASKED, into=tmp_path / "result.zarr")


def test_memory_does_not_grow_with_the_number_of_loops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In memory the largest result is 16 MB."""
    monkeypatch.setattr(regions, "LIMIT", 2**13)
    peaks = []
    for count in (50, 200, 500):
        start = np.linspace(-1, 1, count)
        over = {"start.0": start[:, None], "start.1": start}
        tracemalloc.start()
        es.ensemble(velocity_actuated(), 0.02, over=over, into=tmp_path / f"{count}.zarr")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] - peaks[1] < 2e6
