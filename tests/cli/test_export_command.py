"""`extremum export c`: what it writes and prints, and what it refuses."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from refusals import refused

import extremum as es
from extremum.cli.main import main
from extremum.deploy import exporting
from extremum.deploy.exporting import export_c
from extremum.papers import zhang2007

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

SAMPLING = "\n[sampling]\ndt = 0.004\npractice.delay = 0.003\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("fig4.toml").write_bytes(zhang2007.path("fig4").read_bytes())
    return tmp_path


def written(folder: str) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in Path(folder).iterdir()}


def test_it_writes_what_export_c_writes(capsys):
    assert main(["export", "c", "fig4.toml", "--dt", "1e-3", "-o", "made/here"]) == 0
    said = "wrote made/here/esc.h, made/here/esc.py, made/here/README.md\n"
    assert capsys.readouterr() == (said, "")
    loop = zhang2007.scenario("fig4").loop
    ctrl = es.discretize(loop.controller, 1e-3, vehicle=loop.vehicle)
    export_c(ctrl, "same")
    assert written("made/here") == written("same")


def test_prefix_and_precision():
    arguments = ["fig4.toml", "--dt", "1e-3", "-o", "s", "--prefix", "seek", "--single"]
    assert main(["export", "c", *arguments]) == 0
    assert set(written("s")) == {"seek.h", "seek.py", "README.md"}
    assert "void seek_step(seek_t *self, float J, float u[SEEK_INPUTS]);" in written("s")["seek.h"]


def test_a_scenario_may_say_how_it_is_sampled():
    text = Path("fig4.toml").read_text(encoding="utf-8")
    Path("sampled.toml").write_text(text + SAMPLING, encoding="utf-8")
    assert main(["export", "c", "sampled.toml", "-o", "its"]) == 0
    assert "#define ESC_DT 0.004 " in written("its")["esc.h"]
    assert "practice.delay" in written("its")["esc.h"]
    assert main(["export", "c", "sampled.toml", "-o", "mine", "--dt", "0.002"]) == 0
    assert "#define ESC_DT 0.002 " in written("mine")["esc.h"]
    assert "practice.delay" in written("mine")["esc.h"]


def test_a_warning_is_one_line(capsys):
    assert main(["export", "c", "fig4.toml", "--dt", "0.02", "-o", "slow"]) == 0
    message = capsys.readouterr().err
    assert message.startswith("extremum: warning: dt = 0.02 s leaves 10.5 samples in a period")
    assert message.count("\n") == 1


def test_existing_files_are_kept_unless_forced(capsys):
    Path("README.md").write_text("mine")
    arguments = ["export", "c", "fig4.toml", "--dt", "1e-3"]
    assert "README.md exists; --force overwrites it" in refused(capsys, *arguments)
    assert Path("README.md").read_text() == "mine"
    assert main([*arguments, "--force"]) == 0
    assert Path("README.md").read_text(encoding="utf-8").startswith("# esc: an extremum seeking")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "dt: must be given, the time between two samples in s"),
        (["--dt", "0"], "dt = 0.0: must be greater than 0"),
        (["--dt=-1e-3"], "dt = -0.001: must be greater than 0"),
        (["--dt", "nan"], "dt = nan"),
        (["--dt", "0.1"], "dt = 0.1: leaves 2.09 samples in a period"),
        (["--dt", "1e-3", "--prefix", "int"], "prefix = 'int': is a keyword of C or C++"),
        (["--dt", "1e-3", "--prefix", "a-b"], "prefix = 'a-b': is no identifier of C"),
        (["--dt", "1e-3", "--prefix", "_a"], "prefix = '_a': begins with an underscore"),
        (["--dt", "1e-3", "-o", "fig4.toml"], "fig4.toml is a file; -o names the folder"),
        (["--dt", "1e-3", "-o", "fig4.toml/x"], "fig4.toml/x: Not a directory"),
    ],
)
def test_wrong_arguments_are_refused(arguments, reason, capsys):
    assert reason in refused(capsys, "export", "c", "fig4.toml", *arguments)


def test_a_file_that_is_none_is_refused(capsys):
    arguments = ("--dt", "1e-3")
    assert "fig9.toml" in refused(capsys, "export", "c", "fig9.toml", *arguments)
    assert "extremum paper fig5" in refused(capsys, "export", "c", "fig5", *arguments)


def test_arguments_that_cannot_be_read_are_refused(capsys):
    for wrong in (["c", "fig4.toml", "--dt", "fast"], ["rust", "fig4.toml"], ["c"], []):
        with pytest.raises(SystemExit) as ended:
            main(["export", *wrong])
        assert ended.value.code == 2
        assert "Traceback" not in capsys.readouterr().err


def test_an_interrupt_leaves_nothing_behind(capsys, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(exporting.c99, "header", interrupted)
    assert main(["export", "c", "fig4.toml", "--dt", "1e-3"]) == 130
    assert os.listdir() == ["fig4.toml"]
    assert capsys.readouterr().err == "interrupted\n"
