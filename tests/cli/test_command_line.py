"""The commands: exit statuses, what they print and write, and Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray

import extremum as es
from extremum.cli import commands, interrupts
from extremum.cli.main import main
from extremum.papers import zhang2007

FIG4 = zhang2007.path("fig4").read_text()
SHORT = FIG4.replace("t_end = 4", "t_end = 0.2")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def extremum(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "extremum", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, **options)


def test_a_completed_run_writes_its_data(folder, capsys):
    Path("case.toml").write_text(SHORT)
    assert main(["run", "case.toml", "-o", "out.nc"]) == 0
    assert sorted(os.listdir()) == ["case.toml", "out.nc"]
    printed = capsys.readouterr()
    assert "completed" in printed.out
    assert "wrote out.nc" in printed.out
    assert printed.err == ""
    with xarray.open_dataset("out.nc") as written:
        expected = es.simulate(es.parse_scenario(SHORT).loop, 0.2)
        np.testing.assert_allclose(written.position, expected.position, atol=1e-12)
        assert es.parse_scenario(written.attrs["scenario"]).loop == es.parse_scenario(SHORT).loop


def test_an_escape_is_exit_status_1_and_is_written(folder, capsys):
    Path("case.toml").write_text(FIG4.replace("gain = 10", "gain = 300"))
    assert main(["run", "case.toml", "-o", "out.nc"]) == 1
    printed = capsys.readouterr().out
    assert "escaped" in printed
    with xarray.open_dataset("out.nc") as written:
        assert written.attrs["outcome"] == "escaped"
        assert written.attrs["end_time"] < 4
        assert np.isfinite(written.J.values).all()


@pytest.mark.parametrize(
    "change", [("gain = 10", "gain = 1e300"), ("washout = 1", "washout = 1e300")]
)
def test_a_loop_that_overflows_at_once_has_escaped(change, folder, capsys):
    Path("case.toml").write_text(SHORT.replace(*change))
    assert main(["run", "case.toml"]) == 1
    assert "escaped" in capsys.readouterr().out


def test_leaving_the_data_is_exit_status_1(folder, capsys):
    x = np.linspace(0, 2, 5)
    np.savez("map.npz", x=x, y=x, J=20 * np.add.outer(x, x))
    field = SHORT[SHORT.index("[field]") : SHORT.index("[vehicle]")]
    new = "[field]\ntype = 'Gridded'\ngrid = { file = 'map.npz' }\n"
    Path("case.toml").write_text(SHORT.replace(field, new).replace("t_end = 0.2", "t_end = 9"))
    assert main(["run", "case.toml"]) == 1
    assert "left the field's data" in capsys.readouterr().out


def test_existing_files_are_overwritten_by_force(folder, capsys):
    Path("case.toml").write_text(SHORT)
    Path("out.nc").write_text("old")
    assert main(["run", "case.toml", "-o", "out.nc", "--force"]) == 0
    assert Path("out.nc").stat().st_size > 1000
    assert sorted(os.listdir()) == ["case.toml", "out.nc"]


def test_equations_are_printed_as_text_and_latex(folder, capsys):
    Path("case.toml").write_text(FIG4)
    assert main(["equations", "case.toml"]) == 0
    text = capsys.readouterr().out
    assert "dx/dt" in text
    assert "controller.channels.0.gain = 10" in text
    assert main(["equations", "case.toml", "--latex"]) == 0
    latex = capsys.readouterr().out
    assert latex.startswith("\\begin{aligned}")
    assert "\\dot{x} &=" in latex
    assert latex.count("{") == latex.count("}")


@pytest.mark.parametrize("verb", [[], ["run"], ["paper"], ["equations"]])
def test_help_gives_an_example(verb, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*verb, "--help"])
    assert ended.value.code == 0
    assert f"extremum {verb[0] if verb else 'run'} " in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [[], ["rum"], ["run"], ["run", "a", "b"], ["run", "a", "-x"]])
def test_wrong_arguments_are_exit_status_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "error: " in capsys.readouterr().err


def test_paper_lists_its_scenarios(folder, capsys):
    assert main(["paper"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(zhang2007.NAMES)
    assert os.listdir() == []


def test_paper_writes_figure_data_and_scenario(folder, capsys):
    assert main(["paper", "fig4", "-o", "new/figures"]) == 0
    assert sorted(os.listdir("new/figures")) == ["fig4.nc", "fig4.png", "fig4.toml"]
    assert Path("new/figures/fig4.toml").read_text() == FIG4
    assert Path("new/figures/fig4.png").read_bytes().startswith(b"\x89PNG")


def test_the_module_and_the_exit_status(folder):
    Path("case.toml").write_text(SHORT)
    run = extremum("run", "case.toml")
    assert (run.returncode, run.stderr) == (0, "")
    wrong = extremum("run", "nosuch.toml")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.count("\n") == 1
    assert extremum("--version").stdout == f"extremum {es.__version__}\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_a_full_disk_is_one_message(folder):
    Path("case.toml").write_text(SHORT)
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "extremum", "run", "case.toml"]
        run = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert run.returncode == 2
    assert run.stderr.startswith("extremum: error: ")
    assert "Traceback" not in run.stderr


@pytest.mark.skipif(os.name != "posix", reason="needs SIGINT")
def test_ctrl_c_leaves_nothing_behind(folder):
    long = FIG4.replace("t_end = 4", "t_end = 2e6\nsamples = 1000")
    Path("case.toml").write_text(long)
    command = [sys.executable, "-m", "extremum", "run", "case.toml"]
    process = subprocess.Popen(
        [*command, "-o", "out.nc", "--plot", "out.png"], stderr=subprocess.PIPE, text=True
    )
    begun = time.monotonic()
    while len(os.listdir()) < 3 and time.monotonic() < begun + 30:
        time.sleep(0.05)
    assert len(os.listdir()) == 3  # the scenario and two temporary files
    time.sleep(1.0)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=30)
    assert process.returncode == 130
    assert message.count("\n") == 1
    assert "interrupted" in message
    assert os.listdir() == ["case.toml"]


def test_an_interrupt_that_python_lost_is_noticed_before_anything_appears(folder, capsys):
    """KeyboardInterrupt raised in a garbage collector's callback is printed and forgotten."""
    Path("case.toml").write_text(SHORT)
    original = commands.load_scenario

    def lost(path: str) -> es.Scenario:
        interrupts._pending.set()
        return original(path)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(commands, "load_scenario", lost)
        assert main(["run", "case.toml", "-o", "case.nc"]) == 130
    assert signal.getsignal(signal.SIGTERM) == before
    assert sorted(path.name for path in Path().iterdir()) == ["case.toml"]


def test_the_printed_mean_over_the_last_period_is_the_mean(folder, capsys):
    """A constant force of 0.3 leaves d p/(g z) = 0.36 m; a sum that counts one end twice is off."""
    Path("case.toml").write_text(zhang2007.path("constant_force").read_text())
    assert main(["run", "case.toml"]) == 0
    line = next(x for x in capsys.readouterr().out.splitlines() if "last period" in x)
    loop = zhang2007.scenario("constant_force").loop
    period = 2 * np.pi / 30
    times = 30.0 - period + period * np.arange(65) / 64
    run = es.simulate(loop, 30.0, samples=times)
    offset = (run.position.values - run.source.values)[1:-1].mean(axis=0)
    assert float(line.split()[-5]) == pytest.approx(np.linalg.norm(offset), abs=2e-4)
