"""What a sweep refuses: one message, and what is done is kept."""

from __future__ import annotations

import errno
import os
import re
import shutil
from pathlib import Path
from typing import Any

import closed_form
import numpy as np
import pytest
import xarray
from closed_form import DRAWN, GRID, contents, refusal, study
from full_disk import Disk
from small_sweeps import interrupted, run

import extremum as es
from extremum import stores
from extremum.papers import zhang2007
from extremum.sweeps import jobs

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
    stores.set_attributes(store, {"format": 1, "study": "[sweep"})
    assert "does not say which study it holds" in refusal(lambda: run(store))


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
