"""A result that is streamed to a Zarr store is the one in memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray
import zarr
from loops import velocity_actuated
from zarr.storage import LocalStore

import extremum as es
from extremum.engines import simd
from extremum.ensembles import ensembling, regions
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
    assert again.outcome.attrs["flag_values"] == [-1, 0, 1, 2]
    assert again.outcome.attrs["flag_meanings"].split()[0] == "not_run"
    assert memory.outcome.attrs["flag_values"].tolist() == [0, 1, 2]


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
    asked = {"t_end": 0.1, "tol": 1e-6, "dtype": "float64", "device": "cpu", "loops": 15}
    assert asked.items() <= found.attrs.items()
    assert es.parse_scenario(found.attrs["scenario"]).loop == velocity_actuated()


@pytest.mark.parametrize("refused", [1, 2])
def test_a_refusal_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: int
) -> None:
    """Of the first block, or of the run that tells how accurate it is."""
    calls = 0

    def engine(asked: Any, **arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == refused:
            raise es.InvalidDescription("field", "these grid lines collide")
        return simd.integrate(asked, **arguments)

    arguments: dict[str, Any] = {"over": {"start.0": [0.0, 1.0]}, "into": tmp_path / "result.zarr"}
    with monkeypatch.context() as patch:
        patch.setattr(ensembling, "integrator", lambda device: engine)
        with pytest.raises(es.InvalidDescription, match="collide"):
            es.ensemble(velocity_actuated(), 0.1, **arguments)
    assert not list(tmp_path.iterdir())
    assert (es.ensemble(velocity_actuated(), 0.1, **arguments).outcome == 0).all()


def labelled(values: Any, name: str = "n") -> xarray.DataArray:
    return xarray.DataArray([0.0, 1.0], dims="n", coords={name: ("n", values)})


STACKED = xarray.DataArray(np.eye(2), dims=("p", "q"), coords={"p": [1, 2]}).stack(n=("p", "q"))
SLASHED = xarray.DataArray([0.0, 1.0], dims="a/b", coords={"a/b": [1, 2]})


@pytest.mark.parametrize(
    ("given", "name"),
    [
        (labelled(pd.Categorical(["a", "b"])), "n"),
        (STACKED, "n"),
        (labelled(np.array(["a", 2], dtype=object)), "n"),
        (labelled(np.array([1, 2], dtype=np.clongdouble)), "n"),
        (labelled([1, 2], "x/y"), "x/y"),
        (SLASHED, "a/b"),
        (labelled([1, 2], ".."), ".."),
        (labelled([1, 2]).assign_attrs(scale_factor=3.0), "start.0"),
        (labelled([1, 2]).assign_attrs(owner=object()), "start.0"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_coordinates_that_no_store_can_hold_are_refused_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: xarray.DataArray, name: str
) -> None:
    over = {"start.0": given}
    assert (es.ensemble(velocity_actuated(), 0.02, over=over).outcome == 0).all()
    monkeypatch.setattr(ensembling, "integrator", lambda device: None)
    with pytest.raises(
        es.InvalidDescription, match=r"into: the coordinate .* cannot be stored"
    ) as e:
        es.ensemble(velocity_actuated(), 0.02, over=over, into=tmp_path / "result.zarr")
    assert repr(name) in str(e.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "labels",
    [
        pd.date_range("2020", periods=2),
        pd.timedelta_range("1h", periods=2),
        [True, False],
        [1j, 2],
        [np.nan, 1.0],
        np.array(["a", "bc"], dtype=object),
    ],
    ids=str,
)
def test_other_coordinates_come_back(tmp_path: Path, labels: Any) -> None:
    over = {"start.0": labelled(labels)}
    memory = es.ensemble(velocity_actuated(), 0.02, over=over)
    stored = es.ensemble(velocity_actuated(), 0.02, over=over, into=tmp_path / "result.zarr")
    xarray.testing.assert_equal(stored, memory)


@pytest.mark.parametrize("name", ["a\0b", "a" * 300, "\ud800"])
def test_names_that_no_file_can_have_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(es.InvalidDescription, match=r"into = .*: cannot be the path of a store"):
        es.ensemble(velocity_actuated(), 0.1, over={"start.0": 0.0}, into=tmp_path / name)


def test_results_larger_than_memory_are_refused_with_the_way_out() -> None:
    """8 B for each of 4 states, position, J and end_time; 1 B for the outcome; a PB and more."""
    line = np.broadcast_to(0.0, 10**7)
    over = {"start.0": line[:, None], "start.1": line}
    loop = velocity_actuated()
    each = 8 * (len(loop.system.states) + 2 + 1 + 1) + 1
    expected = f"100,000,000,000,000 loops need {each * 1e14 / 2**30:,.1f} GiB"
    with pytest.raises(es.InvalidDescription, match=f"into: .*{expected}.*Zarr store"):
        es.ensemble(loop, 0.1, over=over)


def test_a_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put = zarr.Array.__setitem__

    def full(array: Any, *arguments: Any) -> None:
        if isinstance(array.store, LocalStore):
            raise OSError(28, "No space left on device")
        put(array, *arguments)

    monkeypatch.setattr(zarr.Array, "__setitem__", full)
    with pytest.raises(es.InvalidDescription, match=r"into.*cannot be written.*No space left"):
        es.ensemble(velocity_actuated(), 0.1, **ASKED, into=tmp_path / "result.zarr")
    assert not list(tmp_path.iterdir())


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
