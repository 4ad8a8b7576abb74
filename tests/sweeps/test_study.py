"""Study files: every study comes back from its own text, and what cannot be is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest
from closed_form import DRAWN, GRID, study
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from schema import documented

import extremum as es
from extremum.description import Description
from extremum.papers import zhang2007
from extremum.sweeps import Axis, Study, Sweep, format_study, load_study, parse_study

ROOT = Path(__file__).parents[2]
PATHS = ("start.0", "start.1", "field.q.0", "controller.frequency", "controller.channels.0.gain")
NUMBERS = st.sampled_from([0.1 + 0.2, 1 / 3, 1e-5, 1e5]) | st.floats(1e-3, 1e3)
RANGES = st.tuples(NUMBERS, NUMBERS).map(sorted).filter(lambda ends: ends[0] < ends[1])


@st.composite
def axes(draw: st.DrawFn, grid: bool) -> Axis:
    kind = draw(st.integers(0, 2 if grid else 3))
    if kind == 0:
        return Axis(values=tuple(draw(st.lists(NUMBERS, min_size=1, max_size=4))))
    low, high = draw(RANGES)
    if grid:
        return Axis(low, high, draw(st.integers(2, 9)), draw(st.sampled_from(["linear", "log"])))
    if kind == 1:
        return Axis(distribution="normal", mean=low, std=high, low=low / 2, high=low * 2)
    return Axis(low, high, distribution=draw(st.sampled_from(["uniform", "log-uniform"])))


@st.composite
def studies(draw: st.DrawFn) -> Study:
    method = draw(st.sampled_from(["grid", "random", "latin hypercube", "sobol"]))
    names = draw(st.lists(st.sampled_from(PATHS), min_size=1, max_size=4, unique=True))
    sweep = Sweep(
        axes={name: draw(axes(method == "grid")) for name in names},
        method=method,
        loops=None if method == "grid" else 2 ** draw(st.integers(0, 20)),
        seed=draw(st.integers(0, 2**63 - 1)),
        keep=tuple(draw(st.lists(st.sampled_from(["mean_J", "max_J"]), unique=True))),
        radius=draw(st.none() | NUMBERS),
        samples=draw(st.none() | st.integers(2, 99)),
        tol=draw(st.floats(1e-9, 1e-3)),
        dtype=draw(st.sampled_from(["float64", "float32"])),
        device=draw(st.sampled_from(["cpu", "cuda"])),
    )
    name = draw(st.sampled_from(["fig4", "fig5", "drag", "landscape"]))
    try:
        return Study(zhang2007.scenario(name), sweep)
    except es.InvalidDescription:
        assume(False)
        raise


@settings(deadline=None, max_examples=60)
@given(studies())
def test_every_study_comes_back_from_its_text(given):
    again = parse_study(format_study(given))
    assert again == given
    assert list(again.sweep.axes) == list(given.sweep.axes)
    assert format_study(again) == format_study(given)


def test_a_scenario_is_stated_or_named(tmp_path):
    fig4 = zhang2007.path("fig4").read_text()
    (tmp_path / "loop.toml").write_text(fig4)
    rest = '[sweep.axes]\n"start.0" = { values = ["pi", 1] }\n'
    (tmp_path / "study.toml").write_text(f'scenario = "loop.toml"\n{rest}')
    named = load_study(tmp_path / "study.toml")
    assert named == parse_study(f"{fig4}\n{rest}")
    assert named == parse_study(f'scenario = "paper:fig4"\n{rest}')
    assert named.scenario == es.parse_scenario(fig4)
    other = parse_study(f'scenario = "paper:fig4"\ntitle = "T"\n[run]\nt_end = 9\n{rest}')
    assert other.scenario.replace({"title": named.scenario.title, "run.t_end": 4}) == named.scenario


def test_what_a_study_says_of_its_results():
    grid, drawn = study(GRID).sweep, study(DRAWN).sweep
    assert (grid.dims(), grid.shape(), grid.count()) == (("start.0", "gain"), (20, 3), 60)
    assert (drawn.dims(), drawn.shape(), drawn.count()) == (("loop",), (60,), 60)


def test_an_error_survives_another_process():
    error = es.InvalidDescription("sweep.keep", "is wrong", "'x'", "Study")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.path, again.value) == (str(error), error.path, error.value)


@pytest.mark.parametrize("name", ["Study", "Sweep", "Axis"])
def test_every_key_of_a_study_is_documented_as_it_is_declared(name):
    text = (ROOT / "docs" / "sweeps.md").read_text(encoding="utf-8")
    if name != "Study":
        assert f"### {name}\n" in text
        for row in documented(Description.registry[name]):
            assert row in text, row


# --- what is refused --------------------------------------------------------------------------

START = '"start.0" = { low = -3, high = 3, points = 20 }'
PAIR = '["controller.channels.0.gain", "controller.channels.1.gain"]'
CHANGES = {
    # what is replaced, what by, and what the message must say
    "no sweep": ("[sweep]\n", "[swep]\n", ["swep: there is no such entry", "'sweep'?"]),
    "no axes": (GRID[GRID.index("[sweep.axes]") :], "", ["sweep.axes: is missing"]),
    "empty axes": (GRID[GRID.index('"start.0"') :], "", ["sweep.axes = {}", "at least one"]),
    "axis of no table": (START, '"start.0" = [-3, 3]', ["sweep.axes.start.0 = [-3, 3]", "table"]),
    "unquoted path": (START, "start.0 = { low = 1, high = 2 }", ["sweep.axes.start", "in quotes"]),
    "unknown key": (", points", ", pionts", ["sweep.axes.start.0.pionts", "'points'?"]),
    "unknown sweep key": ("keep =", "kept =", ["sweep.kept: there is no", "'keep'?"]),
    "unknown path": ('"start.0"', '"start.7"', ["sweep.axes.start.7", "no such"]),
    "a path of no number": ('"start.0"', '"field"', ["sweep.axes.field"]),
    "a whole vector": ('"start.0"', '"start"', ["sweep.axes.start"]),
    "a typing error": (
        '"start.0"',
        '"controler.frequency"',
        ["there is no such number", "'controller.frequency'?"],
    ),
    "name of a result": ("gain =", "J =", ["sweep.axes.J: is the name of a result"]),
    "name of a state": ("gain =", "x =", ["sweep.axes.x: is the name of a result"]),
    "name with a blank": ("gain =", '"my gain" =', ["sweep.axes = 'my gain'", "no name"]),
    "name of the parent": ("gain =", '".." =', ["sweep.axes = '..'", "no name"]),
    "hidden name": ("gain =", '".gain" =', ["sweep.axes = '.gain'", "no name"]),
    "Zarr's name": ("gain =", '"__gain" =', ["sweep.axes = '__gain'", "no name"]),
    "Zarr's file": ("gain =", '"zarr.json" =', ["sweep.axes.zarr.json: is the name of"]),
    "name with a slash": ("gain =", '"a/b" =', ["sweep.axes = 'a/b'", "no name"]),
    "upside down": ("low = -3, high = 3", "low = 3, high = -3", ["start.0.low = 3.0", "less than"]),
    "no width": ("low = -3", "low = 3", ["sweep.axes.start.0.low = 3.0: must be less than"]),
    "no high": (" high = 3,", "", ["sweep.axes.start.0.high: is missing"]),
    "no points": (", points = 20", "", ["sweep.axes.start.0.points: is missing"]),
    "one point": ("points = 20", "points = 1", ["sweep.axes.start.0.points = 1", "at least 2"]),
    "part of a point": ("points = 20", "points = 2.5", ["points = 2.5", "whole number"]),
    "too many": ("points = 20", "points = 10_000_000_000", ["30,000,000,000 loops, at most"]),
    "NaN": ("low = -3", "low = nan", ["sweep.axes.start.0.low = nan", "finite"]),
    "infinity": ("high = 3", "high = inf", ["sweep.axes.start.0.high = inf", "finite"]),
    "text": ("high = 3", "high = 'far'", ["sweep.axes.start.0.high = 'far'"]),
    "log of a negative": ("points = 20", "points = 20, scale = 'log'", ["never reaches 0"]),
    "unknown scale": ("points = 20", "points = 20, scale = 'lin'", ["scale = 'lin'", "'linear'"]),
    "values and a range": ("values =", "low = 1, values =", ["gain.low: is a range's"]),
    "values and a scale": ("values =", "scale = 'log', values =", ["gain.scale: is a range's"]),
    "no values": ("[1, 5, 7]", "[]", ["sweep.axes.gain.values = []"]),
    "no paths": (PAIR, "[]", ["sweep.axes.gain.paths: names nothing"]),
    "paths as text": (PAIR, "'x'", ["sweep.axes.gain.paths = 'x'"]),
    "one number twice": (PAIR, '["start.0"]', ["sweep.axes.gain: sets start.0, which 'start.0'"]),
    "one path twice": (PAIR, '["start.1", "start.1"]', ["gain.paths", "twice"]),
    "refused by the loop": (
        '"start.0"',
        '"controller.washout"',
        ["washout", "-3.0: must be greater"],
    ),
    "distribution in a grid": ("points = 20", 'distribution = "log-uniform"', ["start.0", "log"]),
    "loops of a grid": ("keep =", "loops = 9\nkeep =", ["sweep.loops = 9", "this grid has 60"]),
    "unknown method": ("keep =", "method = 'gird'\nkeep =", ["sweep.method = 'gird'", "'grid'"]),
    "keep as text": ('["distance"]', '"distance"', ["sweep.keep = 'distance'"]),
    "negative seed": ("keep =", "seed = -1\nkeep =", ["sweep.seed = -1", "at least 0"]),
    "no radius": ("keep =", "radius = 0\nkeep =", ["sweep.radius = 0.0: must be greater"]),
    "one sample": ("keep =", "samples = 1\nkeep =", ["sweep.samples = 1", "at least 2"]),
    "dtype": ("keep =", "dtype = 'f64'\nkeep =", ["sweep.dtype = 'f64'", "'float64'"]),
    "device": ("keep =", "device = 'gpu'\nkeep =", ["sweep.device = 'gpu'", "'cuda'"]),
    "unknown scenario": ("paper:fig4", "paper:fig44", ["scenario = 'paper:fig44'", "'fig4'?"]),
    "missing scenario": ("paper:fig4", "no.toml", ["scenario = 'no.toml'", "cannot read"]),
    "scenario as a table": ('"paper:fig4"', "{}", ["scenario = {}", "at the top"]),
    "stated twice": ("[sweep]", "sensor = '1/(s+1)'\n[sweep]", ["sensor: is stated by scenario"]),
    "bad run": ("[sweep]", "[run]\nt_end = 0\n[sweep]", ["run.t_end = 0.0"]),
    "no TOML": ("[sweep]", "[sweep", ["not TOML"]),
}
LOW = "{ low = -3, high = 3 }"
DRAWS = {
    "no loops": ("loops = 60\n", "", ["sweep.loops: is missing", '"random"']),
    "zero loops": ("loops = 60", "loops = 0", ["sweep.loops = 0", "at least 1"]),
    "too many loops": ("loops = 60", "loops = 10_000_000_001", ["sweep.loops", "10,000,000,000"]),
    "Sobol's balance": ('"random"', '"sobol"', ["sweep.loops = 60", "power of two", "32 or 64"]),
    "too much Sobol": (
        '"random"\nloops = 60',
        '"sobol"\nloops = 4_294_967_296',
        ["at most 1,073,741,824 with 'sobol'", '"random" has no such limit'],
    ),
    "too large a cube": (
        '"random"\nloops = 60',
        '"latin hypercube"\nloops = 100_000_000',
        ["at most 67,108,864 with 'latin hypercube'"],
    ),
    "points of a draw": (
        LOW,
        "{ low = -3, high = 3, points = 5 }",
        ["start.0.points = 5", "loops"],
    ),
    "scale of a draw": (LOW, "{ low = 1, high = 3, scale = 'log' }", ["start.0.scale = 'log'"]),
    "log-uniform through 0": ("low = 0.1", "low = 0", ["field.q.0.low = 0.0", "greater than 0"]),
    "no mean": (LOW, "{ distribution = 'normal', std = 1 }", ["start.0.mean: is missing"]),
    "no std": (LOW, "{ distribution = 'normal', mean = 1 }", ["start.0.std: is missing"]),
    "mean of a range": (LOW, "{ low = 1, high = 2, mean = 1 }", ["start.0.mean: needs"]),
    "std of 0": (LOW, "{ distribution = 'normal', mean = 1, std = 0 }", ["start.0.std = 0.0"]),
    "nothing left": (
        LOW,
        "{ distribution = 'normal', mean = 0, std = 1, low = 9 }",
        ["start.0.low = 9.0", "cuts off"],
    ),
    "a tail where none may be": (
        f'"start.0" = {LOW}',
        '"controller.frequency" = { distribution = "normal", mean = 30, std = 10 }',
        ["controller.frequency: its normal distribution goes as far as -53", "cut it off by low"],
    ),
}


@pytest.mark.parametrize("name", [*CHANGES, *DRAWS])
def test_studies_that_cannot_be(name):
    base, (old, new, parts) = (GRID, CHANGES[name]) if name in CHANGES else (DRAWN, DRAWS[name])
    assert old in base
    with pytest.raises(es.InvalidDescription) as refused:
        parse_study(base.replace(old, new, 1))
    message = str(refused.value)
    assert [part for part in parts if part not in message] == [], message
    assert len(message) < 500


def test_what_is_no_study():
    with pytest.raises(es.InvalidDescription, match="must be a Study"):
        format_study(zhang2007.scenario("fig4"))  # pyright: ignore
    with pytest.raises(es.InvalidDescription, match=r"Sweep\.axes"):
        Sweep(axes={})
