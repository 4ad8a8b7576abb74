"""Stores of sweeps: what is in them, and that nothing but the study decides it."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import closed_form
import numpy as np
import pytest
import xarray
from closed_form import DRAWN, GRID, contents, refusal, study
from full_disk import Disk

import extremum as es
from extremum import stores
from extremum.papers import zhang2007
from extremum.sweeps import distribution, jobs, layout, running, sampling

HERE = Path(__file__).parent


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    closed_form.small_jobs(monkeypatch=monkeypatch)
    return tmp_path


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
        assert found[name].attrs == {k: stores.plain(v) for k, v in variable.attrs.items()}
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
    for kill in range(5):
        with script(store, module="kill_me.py") as process:
            assert process.stdout is not None
            for _ in range(random.integers(1, 4)):
                assert process.stdout.readline()
            if kill < 4:
                time.sleep(random.uniform(0, 0.06))
                process.kill()
            process.stdout.read()
        assert process.returncode == (-signal.SIGKILL if kill < 4 else 0)
    assert contents(store) == contents(folder / "whole.zarr")


@pytest.mark.skipif(os.name != "posix", reason="needs fork")
@pytest.mark.parametrize("stride", [71, pytest.param(3, marks=pytest.mark.slow)])
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


# --- what is refused --------------------------------------------------------------------------

OTHER = {
    "a number": (("low = -3", "low = -4"), "sweep.axes.start.0.low is -3.0 there and -4.0 here"),
    "points": (("points = 20", "points = 21"), "sweep.axes.start.0.points is 20 there and 21 here"),
    "a duration": (("[sweep]", "[run]\nt_end = 3\n[sweep]"), "run.t_end is 4.0 there and 3.0 here"),
    "less kept": (('["distance"]', "[]"), "sweep.keep.0 is 'distance' there and left out here"),
    "more kept": (("keep =", "radius = 1\nkeep ="), "sweep.radius is left out there and 1.0 here"),
    "another loop": (("fig4", "fig5"), "is "),
}


@pytest.mark.parametrize("name", OTHER)
@pytest.mark.parametrize("complete", [True, False])
def test_another_study_is_refused_and_nothing_changes(name, complete, folder):
    store = folder / "s.zarr"
    if complete:
        run(store)
    else:
        interrupted(store, 3)
    before = contents(store)
    change, part = OTHER[name]
    message = refusal(lambda: run(store, GRID.replace(*change)))
    assert "s.zarr holds another study: " in message
    assert part in message
    assert contents(store) == before


def test_the_order_of_the_axes_belongs_to_the_study(folder):
    run(folder / "s.zarr", DRAWN)
    lines = DRAWN.splitlines()
    swapped = "\n".join([*lines[:-2], lines[-1], lines[-2]])
    assert "the order of sweep.axes" in refusal(lambda: run(folder / "s.zarr", swapped))


def test_titles_do_not_make_another_study(folder):
    store = folder / "s.zarr"
    interrupted(store, 3)
    run(store, GRID.replace("[sweep]", "title = 'T'\nnote = 'N'\n[sweep]"))
    assert jobs.kept(store) == 60


def test_data_that_moved_do_not_make_another_study(folder):
    x = np.linspace(-9, 9, 19)
    values = -np.add.outer(x**2, x**2)
    (folder / "there").mkdir()
    text = GRID.replace('scenario = "paper:fig4"', _gridded("a.npz"))
    np.savez("a.npz", x=x, y=x, J=values)
    np.savez("there/b.npz", x=x, y=x, J=values)
    np.savez("c.npz", x=x, y=x, J=values + 1)
    interrupted(folder / "s.zarr", 3, text)
    Path("a.npz").unlink()
    other = GRID.replace('scenario = "paper:fig4"', _gridded("c.npz"))
    assert "field.grid.digest" in refusal(lambda: run(folder / "s.zarr", other))
    moved = GRID.replace('scenario = "paper:fig4"', _gridded("there/b.npz"))
    assert run(folder / "s.zarr", moved).attrs["complete"]


def _gridded(file: str) -> str:
    text = zhang2007.path("fig4").read_text()
    field = text[text.index("[field]") : text.index("[vehicle]")]
    text = text.replace(field, f'[field]\ntype = "Gridded"\n[field.grid]\nfile = "{file}"\n')
    return text[: text.index("[view]")]


def test_folders_that_are_no_store_of_a_sweep(folder):
    (folder / "empty.zarr").mkdir()
    (folder / "file.zarr").write_text("precious")
    (folder / "json.zarr").mkdir()
    (folder / "json.zarr" / "zarr.json").write_text("[1, 2")
    xarray.Dataset({"x": 1.0}).to_zarr("other.zarr", zarr_format=3, consolidated=False)
    xarray.Dataset({"x": 1.0}).to_zarr("old.zarr", zarr_format=2, consolidated=False)
    shutil.copytree(folder / "other.zarr" / "x", folder / "array.zarr")
    before = contents(folder)
    for name, part in {
        "empty.zarr": "is a folder, but no store of Zarr 3",
        "old.zarr": "is a folder, but no store of Zarr 3",
        "json.zarr": "is a folder, but no store of Zarr 3",
        "file.zarr": "is a file",
        "other.zarr": "is no sweep's store",
        "array.zarr": "is one array of Zarr 3",
        "no/s.zarr": "there is no folder",
        "file.zarr/s.zarr": "there is no folder",
    }.items():
        message = refusal(lambda name=name: run(folder / name))
        assert part in message
        assert name in message
    assert contents(folder) == before


def test_a_store_of_a_newer_or_another_version(folder, monkeypatch):
    store = folder / "s.zarr"
    interrupted(store, 3)
    monkeypatch.setattr(es, "__version__", "99.0")
    assert "was begun by extremum 0.1.0, this is 99.0" in refusal(lambda: run(store))
    stores.set_attributes(store, {"format": 7})
    assert "has format 7, this version knows 1; a newer version" in refusal(lambda: run(store))
    monkeypatch.undo()


def test_two_processes_at_once(folder):
    store = folder / "s.zarr"
    messages = []

    def compute(given, over, **options):
        if store.exists():
            messages.append(refusal(lambda: run(store)))
        return closed_form.ensemble(given, over, **options)

    run(store, compute=compute)
    assert re.search(r"s\.zarr is being written by process \d+ on \S+; wait", messages[0])
    assert len(messages) == 8 + 2


def test_the_lock_of_a_dead_process_is_taken_over(folder):
    store = folder / "s.zarr"
    interrupted(store, 3)
    assert (store / "jobs" / "lock").exists()
    run(store)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98])
def test_a_full_disk_is_one_message_and_keeps_what_is_done(share, folder):
    """Writing fails from the n-th file on; with room again it goes on."""
    store, whole = folder / "s.zarr", folder / "whole.zarr"
    with Disk(whole) as disk:
        run(whole)
    with Disk(store, int(share * disk.files)):
        message = refusal(lambda: run(store))
    assert message == f"cannot write {store}: No space left on device"
    if store.exists():
        assert [file for file in (store / "jobs").iterdir() if file.suffix == ".part"] == []
    kept = jobs.kept(store)
    assert (kept == 0) == (share <= 0.1), kept
    run(store)
    assert contents(store) == contents(whole)


def test_a_store_that_must_not_be_written(folder):
    store = folder / "s.zarr"
    interrupted(store, 3)
    before = contents(store)
    with Disk(store, 0, errno.EROFS):
        assert refusal(lambda: run(store)) == f"cannot write {store}: Read-only file system"
    assert contents(store) == before
    run(store)
    with Disk(store, 0, errno.EROFS):
        assert run(store).attrs["complete"]


def test_arguments_that_cannot_be(folder):
    given = study()
    cases: list[tuple[dict[str, Any], str]] = [
        ({"workers": 0}, "workers = 0: must be a whole number, at least 1"),
        ({"workers": 1.5}, "workers = 1.5"),
        ({"threads": 0}, "threads = 0"),
        ({"workers": 2, "scheduler": "tcp://a:1"}, "workers = 2: or scheduler, one of the two"),
    ]
    for options, part in cases:
        assert part in refusal(lambda options=options: es.sweep(given, "s.zarr", **options))
    assert "must be a Study" in refusal(lambda: es.sweep("study.toml", "s.zarr"))  # pyright: ignore
    assert "store = 5: must be a path" in refusal(lambda: es.sweep(given, 5))  # pyright: ignore
    assert os.listdir() == []


def test_what_an_ensemble_refuses_is_named_as_in_the_study(folder):
    def refuse(path):
        def compute(*arguments, **options):
            raise es.InvalidDescription(path, "is wrong", "'x'")

        return refusal(lambda: run(folder / "s.zarr", compute=compute))

    assert refuse("keep") == "sweep.keep = 'x': is wrong"
    assert refuse("controller.channels.1.gain") == "sweep.axes.gain = 'x': is wrong"
    assert refuse("field") == "field = 'x': is wrong"
    assert os.listdir() == []
