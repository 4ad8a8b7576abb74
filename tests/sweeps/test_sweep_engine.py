"""Sweeps with the engine: each loop is what `simulate` says, to the bit the same however it ran."""

from __future__ import annotations

from pathlib import Path

import closed_form
import numpy as np
import pytest
import xarray

import extremum as es
from extremum.papers import zhang2007

STARTS = es.Study(
    scenario=zhang2007.scenario("fig4"),
    sweep=es.Sweep(
        axes={"start.0": es.Axis(-5, 5, 30), "start.1": es.Axis(-5, 5, 20)},
        keep=("distance", "max_J", "peak_input"),
        samples=5,
    ),
)
MAPS = es.Study(
    scenario=zhang2007.scenario("fig5"),
    sweep=es.Sweep(
        method="sobol",
        loops=8,
        seed=11,
        axes={
            "field.field.q.0": es.Axis(0.5, 2, distribution="log-uniform"),
            "gain": es.Axis(
                distribution="normal",
                mean=5,
                std=0.5,
                low=4,
                paths=("controller.channels.0.gain", "controller.channels.1.gain"),
            ),
        },
        samples=9,
    ),
)


def test_every_loop_is_what_simulate_says(tmp_path):
    found = es.sweep(MAPS, tmp_path / "s.zarr")
    completed = 0
    for i in range(8):
        one = found.isel(loop=i)
        numbers = {
            path: float(one[path]) for path in ("field.field.q.0", *MAPS.sweep.paths("gain"))
        }
        run = es.simulate(MAPS.scenario.loop.replace(numbers), found.attrs["t_end"], samples=9)
        assert (run.attrs["outcome"] == "completed") == (one.outcome == 0)
        if one.outcome == 0:
            completed += 1
            np.testing.assert_allclose(one.sampled_position, run.position, atol=1e-5)
            np.testing.assert_allclose(one.sampled_J, run.J, atol=1e-5)
    assert completed > 0


def test_neither_jobs_nor_threads_change_a_bit(tmp_path, monkeypatch):
    whole = es.sweep(STARTS, tmp_path / "a.zarr", threads=1)
    closed_form.small_jobs(64, monkeypatch)
    cut = es.sweep(STARTS, tmp_path / "b.zarr", threads=2)
    assert cut.attrs["chunk"] != whole.attrs["chunk"]
    xarray.testing.assert_equal(cut, whole)
    assert 0 < whole.attrs["outcomes"][0] < 600


def test_what_the_ensemble_refuses_is_named_as_in_the_study(tmp_path):
    for change, part in (
        ({"keep": ("max_j",)}, r"sweep\.keep = 'max_j': cannot be kept; did you mean 'max_J'"),
        ({"keep": ("settling_time",)}, r"sweep\.radius"),
        ({"tol": 1e-15}, r"sweep\.tol = 1e-15: must lie between"),
        ({"dtype": "float32", "tol": 1e-8}, r"sweep\.tol = 1e-08: must lie between"),
    ):
        study = STARTS.replace({f"sweep.{name}": entry for name, entry in change.items()})
        with pytest.raises(es.InvalidDescription, match=part):
            es.sweep(study, tmp_path / "s.zarr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_processes_do_not_change_a_bit(tmp_path: Path, monkeypatch):
    pytest.importorskip("distributed")
    whole = es.sweep(STARTS, tmp_path / "a.zarr")
    closed_form.small_jobs(64, monkeypatch)
    cut = es.sweep(STARTS, tmp_path / "b.zarr", workers=2)
    xarray.testing.assert_equal(cut, whole)
