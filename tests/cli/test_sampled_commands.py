"""`extremum stability` and `extremum equations --average` of a scenario that is sampled."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import extremum as es
from extremum.cli.main import main
from extremum.papers import zhang2007

FORCE = zhang2007.path("constant_force").read_text()
SAMPLING = """
[sampling]
dt = 0.001

[sampling.sensor]
delay = 0.004
"""
NOTE = "[sampling] is left out: this is the continuous loop"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plain.toml").write_text(FORCE)
    Path("case.toml").write_text(FORCE + SAMPLING)
    return tmp_path


def printed(capsys, *command):
    """Exit status, standard output and standard error."""
    status = main(list(command))
    told = capsys.readouterr()
    return status, told.out, told.err


def test_stability_is_that_of_the_continuous_loop_and_then_of_the_average(folder, capsys):
    plain = printed(capsys, "stability", "plain.toml")
    status, out, err = printed(capsys, "stability", "case.toml")
    report = str(es.sampled_loop_gain(es.load_scenario("case.toml").loop))
    assert out == f"{NOTE}\n{plain[1]}\n{report}\n"
    assert (status, err) == (plain[0], "") == (0, "")
    assert "dt = 0.001 s, delay 0.004 s" in report


def test_json_stays_json(folder, capsys):
    plain = printed(capsys, "stability", "plain.toml", "--json")
    status, out, err = printed(capsys, "stability", "case.toml", "--json")
    assert json.loads(out) == json.loads(plain[1])
    assert (status, err) == (0, f"{NOTE}\n")
    assert plain[2] == ""


def test_the_averaged_equations_are_those_of_the_continuous_loop(folder, capsys):
    plain = printed(capsys, "equations", "plain.toml", "--average")
    assert printed(capsys, "equations", "case.toml", "--average") == (0, f"{NOTE}\n{plain[1]}", "")
    latex = printed(capsys, "equations", "plain.toml", "--average", "--latex")
    found = printed(capsys, "equations", "case.toml", "--average", "--latex")
    assert found == (0, latex[1], f"{NOTE}\n")


def test_without_average_they_are_the_difference_equations(folder, capsys):
    status, out, err = printed(capsys, "equations", "case.toml")
    assert (status, err) == (0, "")
    assert NOTE not in out


def test_where_no_average_can_be_made_it_says_why(folder, capsys):
    slow = SAMPLING + "lag = { rise = 0.1, decay = 0.3 }\n"
    Path("case.toml").write_text(FORCE + slow)
    status, out, _ = printed(capsys, "stability", "case.toml")
    assert status == 0
    assert out.splitlines()[-1].startswith(
        "No averaged sampled loop: sampling.sensor.lag.decay = 0.3: differs from rise = 0.1 s"
    )


@pytest.mark.parametrize(("delay", "status"), [(0.004, 0), (0.06, 1)])
def test_the_exit_status_is_that_of_both_loops(folder, delay, status):
    Path("case.toml").write_text(FORCE + SAMPLING.replace("0.004", str(delay)))
    assert es.sampled_loop_gain(es.load_scenario("case.toml").loop).stable is (status == 0)
    assert main(["stability", "case.toml"]) == status
