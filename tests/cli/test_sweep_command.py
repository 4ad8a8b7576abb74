"""`extremum sweep`: exit statuses, what it prints, and that it goes on where it was."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import closed_form
import pytest
from closed_form import GRID, contents
from refusals import refused

from extremum.cli.main import main
from extremum.sweeps import running

STUDY = f'title = "Fig. 4 and its gain"\n{GRID}'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(running, "ensembled", closed_form.ensemble)
    Path("case.toml").write_text(STUDY)
    return tmp_path


def interrupt(monkeypatch, after: int) -> None:
    left = [after]

    def compute(*arguments, **options):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        return closed_form.ensemble(*arguments, **options)

    monkeypatch.setattr(running, "ensembled", compute)


def test_a_sweep_is_run_once(folder, capsys):
    assert main(["sweep", "case.toml"]) == 0
    assert sorted(os.listdir()) == ["case.toml", "case.zarr"]
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert lines[0] == "Fig. 4 and its gain"
    assert lines[1] == "60 loops: 16.7 % completed, 83.3 % escaped"
    assert lines[2].startswith("ran 60 in ")
    assert lines[2].endswith(" loops/s")
    assert lines[3] == "wrote case.zarr"
    assert printed.err == ""
    before = contents(folder / "case.zarr")
    assert main(["sweep", "case.toml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "60 loops: 16.7 % completed, 83.3 % escaped"
    assert lines[2] == "case.zarr is complete; there is nothing to do"
    assert contents(folder / "case.zarr") == before


def test_an_interrupted_sweep_goes_on(folder, capsys, monkeypatch):
    closed_form.small_jobs(monkeypatch=monkeypatch)
    assert main(["sweep", "case.toml", "-o", "whole.zarr"]) == 0
    capsys.readouterr()
    with monkeypatch.context() as patch:
        interrupt(patch, 4)
        assert main(["sweep", "case.toml", "-o", "s.zarr", "--threads", "1"]) == 130
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == (
        "interrupted: 18 of 60 loops are kept in s.zarr; the same command goes on\n"
    )
    assert main(["sweep", "case.toml", "-o", "s.zarr"]) == 0
    assert "ran 42 in " in (out := capsys.readouterr().out)
    assert ", 18 were there" in out
    assert contents(folder / "s.zarr") == contents(folder / "whole.zarr")


def test_a_bar_starts_where_the_store_does(folder, capsys, monkeypatch):
    """On a terminal: what is left is judged by what this run did, not by what was there."""
    from extremum.cli import progress

    closed_form.small_jobs(monkeypatch=monkeypatch)
    with monkeypatch.context() as patch:
        interrupt(patch, 4)
        assert main(["sweep", "case.toml"]) == 130
    capsys.readouterr()
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(running, "ensembled", closed_form.slow_ensemble)
    assert main(["sweep", "case.toml"]) == 0
    shown = capsys.readouterr().err
    assert "18 of 60 loops" in shown
    assert "60 of 60 loops" in shown
    assert "/s" in shown


def test_the_help_gives_an_example(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["sweep", "--help"])
    assert ended.value.code == 0
    assert "extremum sweep basin.toml" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [["case.toml", "--workers", "2", "--scheduler", "tcp://a:1"], ["case.toml", "--threads", "x"]],
)
def test_wrong_arguments_are_exit_status_2(arguments, folder, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["sweep", *arguments])
    assert ended.value.code == 2


CASES = {
    # what of the study is replaced, what by, the options, and what the message must say
    "unknown key": ("keep =", "kep =", [], ["case.toml: sweep.kep", "'keep'?"]),
    "no sweep": ("[sweep]", "[run]", [], ["case.toml"]),
    "a scenario": (STUDY[STUDY.index("[sweep]") :], "", [], ["case.toml: sweep: is missing"]),
    "no file": ("", "", ["-o", "x.zarr"], []),
    "ending": ("", "", ["-o", "out.nc"], ["-o out.nc: the name must end in .zarr"]),
    "no folder": ("", "", ["-o", "no/out.zarr"], ["no/out.zarr: there is no folder"]),
    "a file": ("", "", ["-o", "file.zarr"], ["file.zarr is a file"]),
    "a folder": ("", "", ["-o", "folder.zarr"], ["folder.zarr is a folder, but no store"]),
    "no workers": ("", "", ["--workers", "0"], ["workers = 0: must be a whole number"]),
    "no threads": ("", "", ["--threads", "-1"], ["threads = -1: must be a whole number"]),
    "another study": ("low = -3", "low = -2", ["-o", "old.zarr"], ["holds another study", "-2.0"]),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_refused(name, folder, capsys):
    Path("folder.zarr").mkdir()
    Path("file.zarr").write_text("precious")
    assert main(["sweep", "case.toml", "-o", "old.zarr"]) == 0
    capsys.readouterr()
    old, new, options, parts = CASES[name]
    Path("case.toml").write_text(STUDY.replace(old, new, 1) if old else STUDY)
    study = "nosuch.toml" if name == "no file" else "case.toml"
    message = refused(capsys, "sweep", study, *options)
    assert [part for part in parts if part not in message] == [], message


def test_what_the_ensemble_refuses_names_the_file(folder, capsys, monkeypatch):
    monkeypatch.setattr(running, "ensembled", closed_form.refusing)
    Path("case.toml").write_text(STUDY.replace("low = -3", "low = 1"))
    message = refused(capsys, "sweep", "case.toml")
    assert message == "extremum: error: case.toml: sweep.keep = 'x': cannot be kept\n"


@pytest.mark.skipif(os.name != "posix", reason="needs SIGINT")
@pytest.mark.parametrize("options", [[], pytest.param(["--workers", "2"], marks=pytest.mark.slow)])
def test_ctrl_c_keeps_what_is_done(options, folder):
    """A terminal sends SIGINT to all processes of the command."""
    scenario = 'scenario = "paper:fig4"\n[run]\nt_end = 100\n[sweep.axes]\n'
    axes = '"start.0" = { low = 0, high = 1, points = 1000 }\n'
    Path("case.toml").write_text(f"{scenario}{axes}{axes.replace('0', '1', 1)}")
    command = [sys.executable, "-m", "extremum", "sweep", "case.toml", *options]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stderr=pipe, text=True, start_new_session=True) as process:
        begun = time.monotonic()
        while not list(Path().glob("case.zarr/jobs/[0-9]*.json")) and time.monotonic() < begun + 60:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)
        _, message = process.communicate(timeout=30)
    assert process.returncode == 130
    match = re.fullmatch(
        r"interrupted: ([\d,]+) of 1,000,000 loops are kept in case.zarr; the same command goes on",
        message.strip(),
    )
    assert match is not None, message
    assert 0 < int(match[1].replace(",", "")) < 1_000_000
