"""`extremum design`: a report and a scenario that runs, or one message that says why not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from refusals import refused
from rich.cells import cell_len

import extremum as es
from extremum.cli.main import main

WANTED = """
settling_time = 6
curvature = [[0.5, 2]]
dither_limit = 0.1
input_limit = 50
source_distance = 1

[vehicle]
axes = [{ type = "Rational", formula = "1/(s - epsilon)", parameters = { epsilon = 0.25 } }]

[uncertain]
"vehicle.axes.0.parameters.epsilon" = [0, 0.5]
"""
EXAMPLE = Path(__file__).parents[2] / "docs" / "requirements.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wanted.toml").write_text(WANTED)
    return tmp_path


# --- what is written --------------------------------------------------------------------------


def test_the_report_and_a_scenario_that_runs_to_the_source(folder, capsys):
    assert main(["design", "wanted.toml", "-o", "loop.toml"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    expected = es.design(es.parse_requirements(WANTED))
    for words in ("Proved in exact arithmetic", "integrators x", "settling x", "exponents, exact"):
        assert words in printed.out
    assert re.search(r"settling x .* ✓ ≤ 5\.\d", printed.out)
    assert re.search(rf"fastest dither .* {expected.frequency:g} rad/s", printed.out)
    assert "wrote loop.toml" in printed.out
    assert es.load_scenario("loop.toml") == expected.scenario()
    assert main(["run", "loop.toml"]) == 0
    far = re.search(r"last period of the dither: (\S+) m from the source", capsys.readouterr().out)
    assert far is not None
    assert float(far[1]) < 1e-3
    assert main(["stability", "loop.toml"]) == 0


def test_the_example_of_the_documentation(folder, capsys):
    assert main(["design", str(EXAMPLE), "-o", "scenario.toml", "--plot", "design.png"]) == 0
    assert "wrote scenario.toml, design.png" in capsys.readouterr().out
    with Image.open("design.png") as picture:
        assert picture.width == 2025
    scenario = es.load_scenario("scenario.toml")
    end, loop = scenario.run.t_end, scenario.loop
    period = loop.system.common_period(loop.values.tolist())
    assert period is not None
    run = es.simulate(loop, end, samples=np.linspace(end - period, end, 65)[1:])
    assert np.abs((run.position - run.source)[1:].mean("time")).max() < 2e-3


def test_without_an_output_nothing_is_written(folder, capsys):
    assert main(["design", "wanted.toml"]) == 0
    assert "wrote" not in capsys.readouterr().out
    assert [path.name for path in folder.iterdir()] == ["wanted.toml"]


def test_force_overwrites(folder, capsys):
    Path("loop.toml").write_text("old")
    assert "loop.toml exists; --force" in refused(
        capsys, "design", "wanted.toml", "-o", "loop.toml"
    )
    assert main(["design", "wanted.toml", "-o", "loop.toml", "--force"]) == 0
    assert es.load_scenario("loop.toml")


@pytest.mark.parametrize("width", [80, 100, 120, 160])
def test_the_report_fits_the_terminal(width, folder, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    assert main(["design", "wanted.toml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(cell_len, lines)) <= width
    beside = [line for line in lines if "│loop gain x" in line]
    below = [line for line in lines if line.startswith("loop gain x")]
    assert len(beside) == 1
    assert ("L(s) = g C(s) G(s)" in beside[0]) == (width >= 150)
    assert bool(below) == (width < 150)
    assert "…" not in "".join(lines)


def test_the_text_of_a_design_names_every_rule_with_its_equation():
    design = es.design(es.parse_requirements(WANTED))
    text = re.sub(r"\s+", " ", str(design))
    for rule in design.rules:
        assert text.count(rule.name) >= 2
        assert re.sub(r"\s+", " ", rule.equation) in text
        assert rule.note in text
    assert max(map(cell_len, str(design).splitlines())) <= 100


# --- what is refused --------------------------------------------------------------------------

CONTENT: dict[str, tuple[str | bytes, list[str]]] = {
    "empty": ("", ["vehicle: is missing"]),
    "binary": (b"\x89PNG\r\n\x1a\n\0", ["is not text"]),
    "broken": ("[vehicle\n", ["not TOML", "line 1"]),
    "deep": ("a = " + "[" * 5000 + "]" * 5000, ["nested too deeply"]),
    "deep tables": ("[vehicle" + ".vehicle" * 3000 + "]\nx = 1", ["there is no such entry"]),
}
ENTRIES = {
    # what is replaced, what by, and what the message must say
    "unknown key": ("curvature", "curvatur", ["curvatur: there is no", "'curvature'?"]),
    "scenario's key": ("[uncertain]", "[field]", ["field: there is no such entry; known: "]),
    "type at the top": ("settling_time = 6", "type = 'x'", ["type: there is no such entry"]),
    "inner key": ("axes = [", "axs = [", ["vehicle.axs: there is no", "'axes'?"]),
    "letter": ("epsilon = 0.25", "epsilom = 0.25", ["vehicle.axes.0", "epsilom"]),
    "missing": ("dither_limit = 0.1\n", "", ["dither_limit: is missing"]),
    "text for a number": ("limit = 50", "limit = 'x'", ["input_limit = 'x': unknown name"]),
    "truth for a number": ("limit = 50", "limit = true", ["input_limit = True: must be a number"]),
    "NaN": ("limit = 50", "limit = nan", ["input_limit = nan", "finite"]),
    "negative": ("limit = 50", "limit = -50", ["input_limit = -50.0: must be greater than 0"]),
    "immense": ("limit = 50", "limit = 1e99", ["input_limit = 1e+99: must lie between"]),
    "two speeds": ("limit = 50", "limit = 50\nbandwidth = 1", ["settling_time: or bandwidth"]),
    "no speed": ("settling_time = 6\n", "", ["settling_time: or bandwidth", "none is"]),
    "upside down": ("[[0.5, 2]]", "[[2, 0.5]]", ["curvature.0: its low end 2 exceeds"]),
    "no maximum": ("[[0.5, 2]]", "[[0, 2]]", ["curvature.0 = (0.0, 2.0): must be greater than 0"]),
    "two axes": ("[[0.5, 2]]", "[1, 2]", ["curvature: has 2 ranges, the vehicle has 1 axes"]),
    "axis as text": ("[{ type", "'1/s' #", ["vehicle.axes = '1/s': must be an array"]),
    "improper": ("1/(s - e", "s/(s - e", ["vehicle.axes.0 = ", "straight through"]),
    "no formula": ("1/(s - e", "open('made')/(s - e", ["vehicle.axes.0.formula", "'open' is not"]),
    "path without quotes": (
        '"vehicle.axes.0.parameters.epsilon"',
        "vehicle.axes.0.parameters.epsilon",
        ["uncertain.vehicle = {", "in quotes"],
    ),
    "wrong path": ('epsilon" =', 'epsilo" =', ["uncertain.vehicle.axes.0", "'epsilon'?"]),
    "three ends": ("[0, 0.5]", "[0, 0.5, 1]", ["epsilon = [0, 0.5, 1]: must be two numbers"]),
    "motion as text": ("[vehicle]", "motion = 'Ramp'\n[vehicle]", ["motion = 'Ramp': must be a"]),
    "motion's type": ("[vehicle]", "[motion]\ntype = 'Rampe'\n[vehicle]", ["'Ramp'?"]),
    "deaf sensor": ("[vehicle]", "sensor = '0'\n[vehicle]", ["sensor = 0: lets nothing pass"]),
    "growing sensor": (
        "[vehicle]",
        "sensor = '1/(s - 1)'\n[vehicle]",
        ["sensor = 1/(s - 1.0): is not stable"],
    ),
    "one factor too many": ("[vehicle]", "include = ['1', '1']\n[vehicle]", ["include: has 2"]),
    "no such truth": ("[vehicle]", "zero_bias = 'no'\n[vehicle]", ["zero_bias = 'no': must be"]),
    # what no controller can do
    "zero at the origin": (
        "1/(s - epsilon)",
        "s/((s + 1)*(s - epsilon))",
        ["vehicle.axes.0: G(s) has a zero at s = 0"],
    ),
    "dead time": ("[vehicle]", "delay = 30\n[vehicle]", ["delay: ", "e^(pT)"]),
    "no authority": ("limit = 50", "limit = 0.4", ["input_limit: ", "|x*|", "Smallest change"]),
    "slow dither": ("[vehicle]", "frequency_limit = 3\n[vehicle]", ["frequency_limit: ", "ω"]),
    "noise": (
        "[vehicle]",
        "noise = 2e-3\naccuracy = 5e-3\n[vehicle]",
        ["accuracy: on axis x noise", "Smallest change"],
    ),
}


@pytest.mark.parametrize("name", CONTENT)
def test_files_that_are_no_requirements(name, folder, capsys):
    content, parts = CONTENT[name]
    Path("wanted.toml").write_bytes(content if isinstance(content, bytes) else content.encode())
    message = refused(capsys, "design", "wanted.toml", "-o", "loop.toml", "--plot", "out.png")
    assert message.startswith("extremum: error: wanted.toml")
    assert [part for part in parts if part not in message] == [], message


@pytest.mark.parametrize("name", ENTRIES)
def test_requirements_that_cannot_be_met(name, folder, capsys):
    old, new, parts = ENTRIES[name]
    assert old in WANTED
    Path("wanted.toml").write_text(WANTED.replace(old, new, 1))
    message = refused(capsys, "design", "wanted.toml", "-o", "loop.toml", "--plot", "out.png")
    assert message.startswith("extremum: error: wanted.toml: ")
    assert [part for part in parts if part not in message] == [], message
    assert not Path("made").exists()


@pytest.mark.parametrize("path", ["nosuch.toml", ".", "nosuch/wanted.toml", "a\0b", "fig4"])
def test_files_that_cannot_be_opened(path, folder, capsys):
    assert path.partition("\0")[0] in refused(capsys, "design", path)


OUTPUTS = {
    "missing folder": (["-o", "nosuch/loop.toml"], "nosuch/loop.toml"),
    "ending": (["-o", "loop.nc"], "-o loop.nc: the name must end in .toml"),
    "plot ending": (["--plot", "design.gif"], "design.gif: the name must end in .png"),
    "the requirements": (["-o", "wanted.toml", "--force"], "would replace the requirements"),
    "existing": (["--plot", "old.png"], "old.png exists; --force"),
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_outputs_that_cannot_be_written(name, folder, capsys):
    arguments, part = OUTPUTS[name]
    Path("old.png").write_text("precious")
    assert part in refused(capsys, "design", "wanted.toml", *arguments)
    assert Path("old.png").read_text() == "precious"
    assert Path("wanted.toml").read_text() == WANTED


def test_the_requirements_are_kept_by_whatever_name(folder, capsys):
    path = str(folder / "wanted.toml")
    assert "would replace" in refused(capsys, "design", "wanted.toml", "-o", path, "--force")


def test_requirements_are_no_scenario_and_say_so(folder, capsys):
    assert "settling_time: there is no such entry" in refused(capsys, "run", "wanted.toml")


def test_an_interrupt_leaves_nothing(folder, capsys, monkeypatch):
    def interrupted(figure, path, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", interrupted)
    assert main(["design", "wanted.toml", "-o", "loop.toml", "--plot", "out.png"]) == 130
    assert [path.name for path in folder.iterdir()] == ["wanted.toml"]
