"""`extremum stability`, `extremum equations --average` and `extremum paper errata`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from extremum.cli.main import main
from extremum.papers import zhang2007

FIG4 = zhang2007.path("fig4").read_text()
FORCE = zhang2007.path("constant_force").read_text()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_stable_loop(folder, capsys):
    Path("case.toml").write_text(FORCE)
    assert main(["stability", "case.toml"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    for words in (
        "stable: largest Floquet exponent -0.456",
        "printed conditions",
        "corrected conditions",
        "averaged eigenvalues",
        "Floquet exponents",
        "the printed formula is wrong here",
        "mean offset from the source (0.3593",
    ):
        assert words in printed.out
    assert max(map(len, printed.out.splitlines())) <= 120


def test_a_narrow_terminal_gets_whole_lines(folder, capsys, monkeypatch):
    Path("case.toml").write_text(FORCE)
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["stability", "case.toml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "✓ α_x c_x k_x q_x z_x - α_x c_x k_x p_x q_x > 0  (12.5)" in lines
    assert any("-0.456146 +0.626433j  Δ 1.6e-03" in line for line in lines)


def test_an_unstable_loop_is_exit_status_1(folder, capsys):
    Path("case.toml").write_text(FIG4.replace("gain = 10", "gain = -10", 1))
    assert main(["stability", "case.toml"]) == 1
    assert "not stable: largest Floquet exponent +0.79" in capsys.readouterr().out


def test_json_is_for_programs(folder, capsys):
    Path("case.toml").write_text(FORCE)
    assert main(["stability", "case.toml", "--json"]) == 0
    read = json.loads(capsys.readouterr().out)
    assert [column["stable"] for column in read["evidence"]] == [False, True, True, True]
    assert read["orbit"]["offset"][0] == pytest.approx(0.3593, abs=5e-5)


def test_the_averaged_equations(folder, capsys):
    Path("case.toml").write_text(FIG4)
    assert main(["equations", "case.toml", "--average"]) == 0
    text = capsys.readouterr().out
    assert "dx̃/dτ = -α_x c_x q_x x̃/ω" in text
    assert "Stable if and only if" in text
    assert main(["equations", "case.toml", "--average", "--latex"]) == 0
    assert capsys.readouterr().out.startswith("\\begin{aligned}\n\\frac{d\\tilde{x}}{d\\tau}")


def test_the_errata(capsys):
    assert main(["paper", "errata"]) == 0
    text = capsys.readouterr().out
    assert "(27)" in text
    assert "-0.4561" in text


@pytest.mark.parametrize("command", [["stability"], ["equations", "--average"]])
@pytest.mark.parametrize("path", ["nosuch.toml", "fig4", "."])
def test_what_is_no_scenario_is_one_line(command, path, folder, capsys):
    assert main([command[0], path, *command[1:]]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1


def test_a_field_without_a_maximum_names_the_file(folder, capsys):
    begin, end = FIG4.index("[field]"), FIG4.index("[vehicle]")
    field = '[field]\ntype = "Expression"\nformula = "x + y"\n\n'
    Path("case.toml").write_text(FIG4[:begin] + field + FIG4[end:])
    assert main(["stability", "case.toml"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("extremum: error: case.toml: field: has no maximum uphill")
    assert len(told.splitlines()) == 1


EXTREMES = {
    "huge gain": ("gain = 10", "gain = 1e300"),
    "no gain": ("gain = 10", "gain = 0"),
    "tiny gain": ("gain = 10", "gain = 1e-300"),
    "huge washout": ("washout = 1", "washout = 1e300"),
    "tiny washout": ("washout = 1", "washout = 1e-300"),
    "huge frequency": ("frequency = 30", "frequency = 1e200"),
    "tiny frequency": ("frequency = 30", "frequency = 1e-200"),
    "huge amplitude": ("amplitude = 0.08", "amplitude = 1e200"),
    "tiny amplitude": ("amplitude = 0.08", "amplitude = 1e-200"),
    "huge curvature": ("q = [1.0, 0.5]", "q = [1e300, 0.5]"),
    "no curvature": ("q = [1.0, 0.5]", "q = [0, 0]"),
    "far source": ("source = [-1, -1]", "source = [1e300, -1]"),
    "high peak": ("peak = 1", "peak = 1e300"),
    "axes of different size": ('axes = ["1/s", "1/s"]', 'axes = ["1/s", "1/(s + 1e-9)**3"]'),
    "no pole at 0": ('axes = ["1/s", "1/s"]', 'axes = ["1/(s - 0.8)", "1/s"]'),
    "resonance": ('axes = ["1/s", "1/s"]', 'axes = ["1/(s**2 + 899)", "1/s"]'),
}


@pytest.mark.parametrize("name", EXTREMES)
def test_extreme_numbers_never_show_a_traceback(name, folder, capsys):
    Path("case.toml").write_text(FIG4.replace(*EXTREMES[name]))
    status = main(["stability", "case.toml"])
    printed = capsys.readouterr()
    assert status in (0, 1) or (status == 2 and len(printed.err.splitlines()) == 1)
    assert "Traceback" not in printed.out + printed.err
    assert "nan" not in printed.out.lower().replace("neimark", "")
