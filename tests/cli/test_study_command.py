"""`extremum study`: what it writes and prints, and what it refuses."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import xarray
from PIL import Image
from refusals import refused

from extremum.cli.main import main
from extremum.studies import NAMES, cloud


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_without_a_name_they_are_listed(capsys):
    assert main(["study"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(NAMES)
    assert all(" loops   " in line for line in lines)
    assert os.listdir() == []


def test_a_study_writes_data_and_figure(capsys):
    assert main(["study", "basin", "--loops", "150", "-o", "made/here"]) == 0
    assert sorted(os.listdir("made/here")) == ["basin.nc", "basin.png"]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("144 starts")
    assert " converge, " in lines[1]
    assert "wrote made/here/basin.nc, made/here/basin.png" in lines
    with xarray.open_dataset("made/here/basin.nc", engine="h5netcdf") as found:
        assert found.fate.shape == (12, 12)
        assert found.attrs["loops"] == 144
        assert found.start_x.attrs["units"] == "m"


def test_the_cloud_is_an_animation_too(monkeypatch):
    monkeypatch.setattr(cloud, "PICTURES", 3)
    assert main(["study", "cloud", "--loops", "100"]) == 0
    assert sorted(os.listdir()) == ["cloud.gif", "cloud.nc", "cloud.png"]
    with Image.open("cloud.gif") as film:
        film.seek(3)


def test_existing_files_are_kept_unless_forced(capsys):
    Path("basin.png").write_text("mine")
    assert "basin.png exists; --force overwrites it" in refused(capsys, "study", "basin")
    assert Path("basin.png").read_text() == "mine"
    assert main(["study", "basin", "--loops", "100", "--force"]) == 0
    assert Path("basin.png").read_bytes().startswith(b"\x89PNG")


def test_wrong_arguments_are_refused_before_anything_runs(capsys):
    assert "did you mean 'basin'" in refused(capsys, "study", "basn")
    assert "loops = 3: must be a whole number, at least 4" in refused(
        capsys, "study", "basin", "--loops", "3"
    )
    assert "at least 24" in refused(capsys, "study", "all", "--loops", "20")
    assert "loops = 0" in refused(capsys, "study", "cloud", "--loops", "0")
    Path("file").write_text("")
    assert "file is a file; -o names the folder" in refused(capsys, "study", "basin", "-o", "file")


def test_an_interrupt_leaves_nothing_behind(capsys, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(cloud, "study", interrupted)
    assert main(["study", "cloud"]) == 130
    assert os.listdir() == []
    assert capsys.readouterr().err == "interrupted\n"
