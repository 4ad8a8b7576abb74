"""Whatever is wrong in the input: one readable message, exit status 2, and nothing is written."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

SCENARIO = """
title = "T"
start = [1, 1]
[run]
t_end = 0.2
[field]
type = "Quadratic"
source = [-1, -1]
q = [1.0, 0.5]
peak = 1
[vehicle]
type = "PointMass"
axes = ["1/s", "1/s"]
[controller]
type = "GradientES"
frequency = 30
washout = 1
[[controller.channels]]
gain = 10
dither = { amplitude = 0.08, phase = 0 }
[[controller.channels]]
gain = 10
dither = { amplitude = 0.08, phase = "-pi/2" }
"""
FIELD = SCENARIO[SCENARIO.index("[field]") : SCENARIO.index("[vehicle]")]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refuse(capsys, content: str | bytes) -> str:
    """Write a scenario, run every command that reads one, return the message of `run`."""
    data = content if isinstance(content, bytes) else content.encode()
    Path("case.toml").write_bytes(data)
    return refused(capsys, "run", "case.toml", "-o", "out.nc", "--plot", "out.png")


def changed(old: str, new: str) -> str:
    assert old in SCENARIO
    return SCENARIO.replace(old, new, 1)


def with_field(text: str) -> str:
    return SCENARIO.replace(FIELD, f"[field]\n{text}\n")


CONTENT: dict[str, tuple[str | bytes, list[str]]] = {
    "empty": ("", ["case.toml", "field: is missing"]),
    "binary": (b"\x89PNG\r\n\x1a\n\0", ["case.toml is not text"]),
    "zeros": (bytes(100), ["case.toml", "not TOML"]),
    "Latin-1": (b"title = '\xe9'", ["case.toml is not text"]),
    "UTF-16": (SCENARIO.encode("utf-16"), ["case.toml is not text"]),
    "broken": ("[run\n", ["case.toml", "not TOML", "line 1"]),
    "unclosed": ("a = [1, 2", ["case.toml", "not TOML"]),
    "twice": ("[run]\n[run]", ["case.toml", "not TOML"]),
    "deep arrays": ("a = " + "[" * 5000 + "]" * 5000, ["case.toml", "nested too deeply"]),
    "deep arrays, unclosed": ("a = " + "[" * 100_000, ["case.toml", "nested too deeply"]),
    "deep tables": ("[field" + ".field" * 3000 + "]\nx = 1", ["field.type: is missing"]),
    "deep keys": (".".join(["a"] * 5000) + " = 1", ["a: there is no such entry"]),
}
ENTRIES = {
    # what is replaced, what by, and what the message must say
    "unknown table": ("[run]", "[runs]", ["runs: there is no", "did you mean 'run'?"]),
    "unknown key": ("peak =", "peek =", ["field.peek: there is no", "did you mean 'peak'?"]),
    "unknown inner key": ("phase = 0", "phse = 0", ["channels.0.dither.phse", "'phase'?"]),
    "unknown class": ('"Quadratic"', '"quadratic"', ["field.type = 'quadratic'", "'Quadratic'?"]),
    "class that is a list": ('"Quadratic"', '["a"]', ["field.type = ['a']"]),
    "class that is a table": ('"Quadratic"', "{}", ["field.type = {}"]),
    "class of another kind": ('"Quadratic"', '"PointMass"', ["field.type = 'PointMass'"]),
    "start of no class": (
        "start = [1, 1]",
        "start = { type = 'x' }",
        ["start.type = 'x'", "OnDither"],
    ),
    "missing key": ("t_end = 0.2", "", ["run.t_end: is missing"]),
    "missing table": ("[run]\nt_end = 0.2", "", ["run: is missing"]),
    "one channel as a table": ("gain = 10", "gain = []", ["controller.channels.0.gain = []"]),
    "text for a number": ("washout = 1", 'washout = "x"', ["controller.washout = 'x'"]),
    "truth for a number": ("washout = 1", "washout = true", ["controller.washout = True"]),
    "date for a number": ("washout = 1", "washout = 1979-05-27", ["controller.washout = "]),
    "number for a text": ('title = "T"', "title = 1", ["title = 1: must be text"]),
    "number for a list": ("start = [1, 1]", "start = 1", ["start = 1: must be"]),
    "number for a table": (
        "phase = 0 }",
        "phase = 0 }\nreference = [0]",
        ["reference.phase = [0]"],
    ),
    "number for a dither": (
        "dither = { amplitude = 0.08, phase = 0 }",
        "dither = 1",
        ["dither = 1"],
    ),
    "NaN": ("frequency = 30", "frequency = nan", ["controller.frequency = nan", "finite"]),
    "infinity": ("frequency = 30", "frequency = inf", ["controller.frequency = inf", "finite"]),
    "NaN phase": ("phase = 0", "phase = nan", ["controller.channels.0.dither.phase = nan"]),
    "infinite phase": ("phase = 0", "phase = -inf", ["controller.channels.0.dither.phase = -inf"]),
    "NaN in a list": ("source = [-1, -1]", "source = [nan, -1]", ["field.source.0 = nan"]),
    "negative frequency": ("frequency = 30", "frequency = -30", ["controller.frequency = -30.0"]),
    "zero frequency": ("frequency = 30", "frequency = 0", ["controller.frequency = 0.0"]),
    "zero washout": ("washout = 1", "washout = 0", ["controller.washout = 0.0"]),
    "negative amplitude": (
        "amplitude = 0.08",
        "amplitude = -1",
        ["channels.0.dither.amplitude = -1.0"],
    ),
    "zero amplitude": ("amplitude = 0.08", "amplitude = 0", ["channels.0.dither.amplitude = 0.0"]),
    "zero duration": ("t_end = 0.2", "t_end = 0", ["run.t_end = 0.0: must be greater than 0"]),
    "negative duration": ("t_end = 0.2", "t_end = -1", ["run.t_end = -1.0: must be greater"]),
    "endless": ("t_end = 0.2", "t_end = inf", ["run.t_end = inf"]),
    "too long": ("t_end = 0.2", "t_end = 1e300", ["samples"]),
    "one sample": ("t_end = 0.2", "t_end = 0.2\nsamples = 1", ["run.samples = 1"]),
    "part of a sample": ("t_end = 0.2", "t_end = 0.2\nsamples = 9.5", ["run.samples = 9.5"]),
    "too many samples": (
        "t_end = 0.2",
        "t_end = 0.2\nsamples = 10000000000",
        ["samples = 10000000000"],
    ),
    "washout start": (
        "washout = 1",
        "washout = 1\nwashout_start = 'now'",
        ["washout_start = 'now'"],
    ),
    "ratio of nothing": ("gain = 10", "gain = 10\nratio = 0", ["controller.channels.0.ratio = 0"]),
    "huge ratio": ("gain = 10", 'gain = 10\nratio = "1e9999999"', ["controller.channels.0.ratio"]),
    "large ratio": ("gain = 10", 'gain = 10\nratio = "1e400"', ["controller.channels.0.ratio"]),
    "axes for channels": ('["1/s", "1/s"]', '["1/s"]', ["controller.channels: has 2", "1 input"]),
    "axes as text": ('["1/s", "1/s"]', '"1/s"', ["vehicle.axes = '1/s': must be an array"]),
    "no axes": ('["1/s", "1/s"]', "[]", ["vehicle.axes"]),
    "improper": ('["1/s", ', '["s**2/(s+1)", ', ["vehicle.axes.0 = 's**2/(s+1)'", "improper"]),
    "feed-through": ('["1/s", ', '["(s+1)/(s+2)", ', ["vehicle.axes.0 = (s + 1.0)/(s + 2.0)"]),
    "no transfer function": ('["1/s", ', '["exp(-s)/s", ', ["vehicle.axes.0 = 'exp(-s)/s'"]),
    "letter": ('["1/s", ', '["1/(s+a)", ', ["vehicle.axes.0 = '1/(s+a)'", "'a'"]),
    "caret": ('["1/s", ', '["1/s^2", ', ["vehicle.axes.0 = '1/s^2'", "**"]),
    "list of coefficients": (
        '["1/s", ',
        '[{ type = "TransferFunction", den = 0 }, ',
        ["vehicle.axes.0.den = 0"],
    ),
    "many poles": (
        '["1/s", ',
        f'["{"+".join(f"1/(s+{i})" for i in range(1, 95))}", ',
        ["vehicle.axes.0", "degree"],
    ),
    "many letters": (
        '["1/s", ',
        '[{ type = "Rational", formula = "'
        + "+".join(f"1/(s+{letter})" for letter in "abcdefghijklm")
        + '", parameters = {'
        + ", ".join(f"{letter} = 1.5" for letter in "abcdefghijklm")
        + "} }, ",
        ["vehicle.axes.0.formula"],
    ),
    "force on one axis": ('"1/s"]', '"1/s"]\ndisturbance = [1]', ["vehicle.disturbance = (1.0,)"]),
    "probe alone": (
        "dither = { amplitude = 0.08, phase = 0 }",
        'dither = { type = "Probe", amplitude = 1 }',
        ["controller.channels.0.reference = None: must be given"],
    ),
    "resonance": (
        "phase = 0 }",
        'phase = 0, through = "1/(s**2 + 900)" }',
        ["controller.channels.0.dither", "30 rad/s"],
    ),
    "start of one coordinate": ("start = [1, 1]", "start = [1]", ["start = (1.0,)"]),
    "state that lacks one": ("start = [1, 1]", "start = { x = 1 }", ["start: lacks y"]),
    "far start": ("start = [1, 1]", "start = [1e200, 1]", ["start"]),
    "range upside down": ("[run]", "[view]\nsignal = [1, 0]\n[run]", ["view.signal = [1, 0]"]),
    "infinite range": ("[run]", "[view]\nsignal = [0, inf]\n[run]", ["view.signal = [0, inf]"]),
    "range in text": ("[run]", "[view]\nsignal = '01'\n[run]", ["view.signal = '01'"]),
    "source of one coordinate": ("source = [-1, -1]", "source = [-1]", ["field.q = (1.0, 0.5)"]),
    "source of three": (
        "source = [-1, -1]\nq = [1.0, 0.5]",
        "source = [1, 1, 1]\nq = [1, 1, 1]",
        ["field: has 3 coordinates, the vehicle moves in 2"],
    ),
    "not symmetric": (
        "q = [1.0, 0.5]",
        "q = [[1, 0.1], [0.2, 1]]",
        ["field.q.1.0 = 0.2", "0.1 = 0.1", "symmetric"],
    ),
    "not square": ("q = [1.0, 0.5]", "q = [[1, 0.1]]", ["field.q.0: has 2 entries"]),
}
FORMULAS = {
    "unknown name": ("x + w", ["unknown name 'w'"]),
    "third coordinate": ("x + z", ["'z'"]),
    "attribute": ("x.__class__", ["attribute access (.__class__)"]),
    "import": ("__import__('os').mkdir('made')", ["is not a known function"]),
    "call": ("open('made', 'w')", ["'open' is not a known function"]),
    "call of a coordinate": ("x(y)", ["'x' is not a known function"]),
    "10 MB": ("x" * 10_000_000, ["10,000,000 characters"]),
    "deep": ("(" * 10_000 + "x" + ")" * 10_000, ["20,001 characters"]),
    "deep within the limit": ("(" * 4_000 + "x" + ")" * 4_000, ["formula"]),
    "deep minus": ("-" * 4_000 + "x", ["nested too deeply"]),
    "tower": ("9**9**9", ["exponent"]),
    "huge": ("0x" + "f" * 9_000, ["1e±300"]),
    "empty": ("", ["formula = ''"]),
    "corner": ("sqrt(x**2)", ["formula = 'sqrt(x**2)'"]),
    "never real": ("sqrt(-1 - x**2)", ["start"]),
    "imaginary": ("sqrt(-x**2)", ["formula = 'sqrt(-x**2)'"]),
    "undefined at the start": ("log(x - 2)", ["start"]),
    "infinite at the start": ("1/(x - 1)", ["start"]),
    "overflow at the start": ("exp(exp(exp(exp(x))))", ["start"]),
    "complex at the start": ("(x - 2)**(1/3)", ["start"]),
}
GRIDS = {
    "missing file": ("file = 'no.nc'", ["field.grid.file = ", "no.nc': there is no such file"]),
    "NaN": ("file = 'nan.npz'", ["field.grid.values: 1 of 25 are NaN"]),
    "not monotonic": ("file = 'axis.npz'", ["field.grid.x: must be finite and strictly monotonic"]),
    "one row": ("file = 'row.npz'", ["field.grid.x: has 1 grid line(s)"]),
    "no data": ("file = 'empty.npz'", ["field.grid.variable"]),
    "not NetCDF": ("file = 'text.nc'", ["field.grid.file = ", "text.nc': cannot be read"]),
    "outside": ("file = 'far.npz'", ["start: lies 9 m outside"]),
    "changed": ("file = 'far.npz'\ndigest = '0'", ["field.grid.digest: differs"]),
    "unknown key": ("file = 'far.npz'\nvariabel = 'J'", ["variabel", "'variable'?"]),
}


@pytest.mark.parametrize("name", CONTENT)
def test_files_that_are_no_scenario(name, folder, capsys):
    content, parts = CONTENT[name]
    message = refuse(capsys, content)
    assert [part for part in parts if part not in message] == [], message


@pytest.mark.parametrize("name", ENTRIES)
def test_entries_that_cannot_be(name, folder, capsys):
    old, new, parts = ENTRIES[name]
    message = refuse(capsys, changed(old, new))
    assert [part for part in parts if part not in message] == [], message


@pytest.mark.parametrize("name", FORMULAS)
def test_formulas_that_are_refused(name, folder, capsys):
    formula, parts = FORMULAS[name]
    quoted = formula.replace("\\", "\\\\").replace('"', '\\"')
    message = refuse(capsys, with_field(f'type = "Expression"\nformula = "{quoted}"'))
    assert [part for part in parts if part not in message] == [], message
    assert not Path("made").exists()


@pytest.mark.parametrize("name", GRIDS)
def test_grids_that_are_refused(name, folder, capsys):
    x, values = np.arange(5.0), np.add.outer(np.arange(5.0), np.arange(5.0))
    np.savez("nan.npz", x=x, y=x, J=np.where(values == 8, np.nan, values))
    np.savez("axis.npz", x=[0, 2, 1, 3, 4], y=x, J=values)
    np.savez("row.npz", x=x[:1], y=x, J=values[:1])
    np.savez("far.npz", x=x + 10, y=x, J=values)
    np.savez("empty.npz")
    Path("text.nc").write_text("hello")
    text, parts = GRIDS[name]
    message = refuse(capsys, with_field(f'type = "Gridded"\n[field.grid]\n{text}'))
    assert [part for part in parts if part not in message] == [], message


@pytest.mark.parametrize("path", ["nosuch.toml", ".", "nosuch/case.toml", "/proc/self/mem", "a\0b"])
@pytest.mark.parametrize("verb", ["run", "equations"])
def test_scenarios_that_cannot_be_opened(verb, path, folder, capsys):
    assert path.partition("\0")[0] in refused(capsys, verb, path)


def test_a_papers_name_is_recognised(folder, capsys):
    assert "extremum paper fig4" in refused(capsys, "run", "fig4")


OUTPUTS = {
    "missing folder": (["-o", "nosuch/out.nc"], "nosuch/out.nc"),
    "a folder": (["-o", "folder.nc"], "folder.nc is a folder"),
    "in a file": (["-o", "case.toml/out.nc"], "case.toml/out.nc"),
    "in /proc": (["-o", "/proc/x.nc"], "/proc/x.nc"),
    "ending": (["-o", "out.txt"], "out.txt: the name must end in .nc"),
    "no name": (["-o", ""], "must end in .nc"),
    "plot ending": (["--plot", "out.nc"], "out.nc: the name must end in .png"),
    "animation ending": (["--animation", "out.png"], "out.png: the name must end in .gif"),
    "existing": (["-o", "old.nc"], "old.nc exists; --force"),
    "second existing": (["-o", "new.nc", "--plot", "old.png"], "old.png exists; --force"),
    "twice": (
        ["--plot", "x.png", "--animation", "folder.nc/../x.gif", "-o", "nosuch/a.nc"],
        "nosuch",
    ),
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_outputs_that_cannot_be_written(name, folder, capsys):
    arguments, part = OUTPUTS[name]
    Path("case.toml").write_text(SCENARIO)
    Path("folder.nc").mkdir()
    for old in ("old.nc", "old.png"):
        Path(old).write_text("precious")
    assert part in refused(capsys, "run", "case.toml", *arguments)
    assert Path("old.nc").read_text() == Path("old.png").read_text() == "precious"


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(folder, capsys):
    Path("case.toml").write_text(SCENARIO)
    Path("closed").mkdir(0o555)
    assert "closed/out.nc" in refused(capsys, "run", "case.toml", "-o", "closed/out.nc")


def test_papers_names_and_folders(folder, capsys):
    assert "did you mean 'fig4'?" in refused(capsys, "paper", "fig44")
    assert "known: " in refused(capsys, "paper", "nosuch")
    Path("file").write_text("")
    assert "file is a file" in refused(capsys, "paper", "fig4", "-o", "file")
    Path("fig5.png").write_text("precious")
    assert "fig5.png exists" in refused(capsys, "paper", "all")
