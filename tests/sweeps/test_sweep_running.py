"""Stores of sweeps: what is in them, and that nothing but the study decides it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import closed_form
import numpy as np
import pytest
import xarray
from closed_form import DRAWN, GRID, contents, refusal, study
from small_sweeps import interrupted, run

import extremum as es
from extremum import stores
from extremum.ensembles.streaming import FLAGS
from extremum.sweeps import distribution, jobs, layout, sampling

HERE = Path(__file__).parent


# --- what a store holds -----------------------------------------------------------------------


@pytest.mark.parametrize("text", [GRID, DRAWN], ids=["grid", "drawn"])
def test_a_store_holds_what_one_ensemble_returns(text, folder):
    found = run(folder / "s.zarr", text)
    given = study(text)
    region = {dim: slice(0, n) for dim, n in layout.planned(given).sizes.items()}
    expected = closed_form.ensemble(given, sampling.over(given.sweep, region))
    for name, variable in expected.data_vars.items():
        assert found[name].dims == variable.dims
        assert (found[name].values == variable.values).all()
        assert found[name].dtype == variable.dtype
        flags = FLAGS if name == "outcome" else {}
        attrs = {k: stores.plain(v) for k, v in variable.attrs.items()}
        assert found[name].attrs == {**attrs, **flags}
    assert found.axis.values.tolist() == ["x", "y"]
    assert dict(found.sizes) == dict(expected.sizes)
    assert found.attrs["loops"] == 60
    assert found.attrs["steps"] == 180
    assert found.attrs["doubtful"] == layout.planned(given).jobs
    assert found.attrs["typical_error"] == 1e-9
    plan = layout.planned(given)
    sums = np.abs(expected.position.values[..., 0])
    nearest = [sums[tuple(plan.region(job).values())].min() for job in range(plan.jobs)]
    assert max(nearest) > closed_form.FAR
    assert found.attrs["error"] == max((n for n in nearest if n < closed_form.FAR), default=None)
    assert (
        found.attrs["outcomes"]
        == np.bincount(expected.outcome.values.ravel(), minlength=3).tolist()
    )
    assert es.sweeps.parse_study(found.attrs["study"]) == given  # pyright: ignore


def test_a_grids_dimensions_are_its_axes(folder):
    found = run(folder / "s.zarr")
    assert found.x.dims == ("start.0", "gain")
    assert found.gain.values.tolist() == [1, 5, 7]
    assert found["controller.channels.1.gain"].dims == ("gain",)
    assert found["start.0"].attrs["units"] == "m"
    assert found.x.sel({"gain": 5}).shape == (20,)
    assert (
        found.position.sel(axis="y").values.tolist()
        == (-found.position.sel(axis="x")).values.tolist()
    )


def test_draws_are_coordinates_of_the_loops(folder):
    given, found = study(DRAWN), run(folder / "s.zarr", DRAWN)
    for name, numbers in sampling.drawn(given.sweep, 0, 60).items():
        assert (found[name].values == numbers).all()
        assert found[name].dims == ("loop",)


def test_a_complete_store_is_pure_zarr_and_is_left_alone(folder):
    store = folder / "s.zarr"
    run(store)
    assert not (store / "jobs").exists()
    before, calls = contents(store), []
    run(store, compute=lambda *a, **k: calls.append(a))
    assert (contents(store), calls) == (before, [])


@pytest.mark.parametrize("text", [GRID, DRAWN], ids=["grid", "drawn"])
def test_numbers_do_not_depend_on_the_size_of_jobs(text, folder, monkeypatch):
    one = run(folder / "a.zarr", text)
    closed_form.small_jobs(1000, monkeypatch)
    other = run(folder / "b.zarr", text)
    assert one.attrs["chunk"] != other.attrs["chunk"]
    xarray.testing.assert_equal(one, other)


def test_jobs_have_at_most_so_many_loops():
    text = GRID.replace("points = 20", "points = 1000").replace("[1, 5, 7]", str([*range(1, 1001)]))
    for samples, most in ((None, 2**16), (1000, 2**28 // (8 * 3000))):
        given = study(text)
        given = given.replace({"sweep": given.sweep.replace({"samples": samples})})
        plan = layout.planned(given)
        assert most / 2 < np.prod(plan.chunk) <= most
        assert plan.chunk[-1] == 1000


def test_progress_counts_loops_of_earlier_runs(folder):
    store, seen = folder / "s.zarr", []
    interrupted(store, 3)
    run(store, progress=seen.append)
    assert seen == sorted(seen)
    assert 0 < seen[0] < seen[-1] == 60
    assert jobs.kept(store) == 60


# --- going on ---------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [GRID, DRAWN], ids=["grid", "drawn"])
def test_an_interrupted_sweep_runs_only_what_is_missing(text, folder):
    run(folder / "whole.zarr", text)
    store = folder / "s.zarr"
    interrupted(store, 3, text)
    kept, calls = jobs.kept(store), []
    assert 0 < kept < 60
    partly = stores.opened(store)
    assert ((partly.outcome >= 0).sum() == kept).item()
    assert np.isfinite(partly.x).sum() == kept

    def compute(given, over, **options):
        calls.append(1)
        return closed_form.ensemble(given, over, **options)

    run(store, text, compute)
    plan = jobs.laid_out(stores.attributes(store))
    assert len(calls) == plan.jobs - 3
    assert contents(store) == contents(folder / "whole.zarr")


def script(*arguments: str | Path, module: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(HERE / module), *map(str, arguments)]
    paths = os.pathsep.join([str(HERE.parent), *sys.path])
    return subprocess.Popen(
        command, text=True, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": paths}
    )


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_killed_at_random_moments_it_ends_with_the_same_bytes(folder):
    run(folder / "whole.zarr", compute=closed_form.slow_ensemble)
    store, random = folder / "s.zarr", np.random.default_rng(20070827)
    for kill in range(4):
        with script(store, module="kill_me.py") as process:
            assert process.stdout is not None
            for _ in range(random.integers(1, 4)):
                assert process.stdout.readline()
            if kill < 3:
                time.sleep(random.uniform(0, 0.06))
                process.kill()
            process.stdout.read()
        assert process.returncode == (-signal.SIGKILL if kill < 3 else 0)
    assert contents(store) == contents(folder / "whole.zarr")


@pytest.mark.skipif(os.name != "posix", reason="needs fork")
@pytest.mark.parametrize("stride", [119, pytest.param(3, marks=pytest.mark.slow)])
def test_killed_before_any_operation_on_files_it_ends_with_the_same_bytes(stride, folder):
    process = script(folder, str(stride), module="kill_points.py")
    out, _ = process.communicate(timeout=570)
    assert process.returncode == 0
    operations, kills = map(int, out.split())
    assert operations > 100
    assert kills == -(-operations // stride)


def test_what_a_killed_process_was_preparing_is_removed(folder):
    store = folder / "s.zarr"
    interrupted(store, 3)
    (store / "jobs" / "7.x.part").mkdir()
    (store / "jobs" / "x.part").write_text("half")

    def compute(*arguments, **options):
        assert list((store / "jobs").glob("*x.part")) == []
        return closed_form.ensemble(*arguments, **options)

    run(store, compute=compute)
    (store / "jobs").mkdir()  # killed between the last two operations
    run(store)
    assert not (store / "jobs").exists()


def test_a_record_cut_off_by_a_power_failure_is_no_record(folder):
    run(folder / "whole.zarr")
    store = folder / "s.zarr"
    interrupted(store, 3)
    (store / "jobs" / "1.json").write_text('{"outc')
    run(store)
    assert contents(store) == contents(folder / "whole.zarr")


# --- Dask -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_workers_may_die(folder):
    distributed = pytest.importorskip("distributed")
    run(folder / "whole.zarr", compute=closed_form.slow_ensemble)
    store, killed = folder / "s.zarr", []

    def progress(done: float) -> None:
        if done > 0 and len(killed) < 2:
            pids = distributed.default_client().run(os.getpid)
            killed.append(min(pids.values()))
            os.kill(killed[-1], signal.SIGKILL)

    run(store, compute=closed_form.slow_ensemble, workers=2, threads=1, progress=progress)
    assert len(set(killed)) == 2
    assert contents(store) == contents(folder / "whole.zarr")


@pytest.mark.slow
def test_a_schedulers_workers_run_the_same_jobs(folder):
    distributed = pytest.importorskip("distributed")
    run(folder / "whole.zarr")
    store = folder / "s.zarr"
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster:
        run(store, scheduler=cluster.scheduler_address)
        assert len(cluster.scheduler_info["workers"]) == 2  # it is not ours to close
    assert contents(store) == contents(folder / "whole.zarr")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_refusal_comes_back_from_a_worker(folder):
    pytest.importorskip("distributed")
    store = folder / "s.zarr"
    interrupted(store, 3)
    with pytest.raises(es.InvalidDescription, match=r"sweep\.keep = 'x': cannot be kept"):
        run(store, compute=closed_form.refusing, workers=1, threads=1)
    assert 0 < jobs.kept(store) < 60


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_job_that_kills_every_worker_is_named(folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(distribution, "FAILURES", 0)
    monkeypatch.setattr(distribution, "ATTEMPTS", 1)
    store = folder / "s.zarr"
    interrupted(store, 9)
    message = refusal(lambda: run(store, compute=closed_form.deadly, workers=1, threads=1))
    assert "job 9 killed every worker that ran it; is there enough memory?" in message
    assert jobs.kept(store) == 54


def test_a_scheduler_that_is_not_there(folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(distribution, "PATIENCE", 0.3)
    store = folder / "s.zarr"
    message = refusal(lambda: run(store, scheduler="tcp://127.0.0.1:1"))
    assert "scheduler = tcp://127.0.0.1:1: cannot be reached" in message
    assert "scheduler = nonsense: cannot be reached" in refusal(
        lambda: run(store, scheduler="nonsense")
    )


def test_without_dask(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "extremum[distributed]" in refusal(lambda: run(folder / "s.zarr", workers=2))
