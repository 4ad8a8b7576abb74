"""Scenario files: every loop comes back from its own text, to the last bit."""

from __future__ import annotations

import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import extremum as es
from extremum import pi, s
from extremum.papers import zhang2007

AWKWARD = (0.1 + 0.2, 1 / 3, 5e-324, 2.2250738585072014e-308, 1e-5, 1e16, 2.0**53 + 2, 1e22, 0.0)
NUMBERS = st.sampled_from([*AWKWARD, -0.0, 1.7976931348623157e308]) | st.floats(
    allow_nan=False, allow_infinity=False
)
MODERATE = st.sampled_from([0.1 + 0.2, 1 / 3, 1e-5, 1e5, 1.0]) | st.floats(1e-3, 1e3)
SIGNED = st.builds(lambda size, sign: size * sign, MODERATE, st.sampled_from([-1.0, 1.0]))
PHASES = NUMBERS | st.sampled_from([0.0, *(k * float(pi) / 2 for k in (-3, -1, 1, 2, 3))])
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
PARAMETERS = st.fixed_dictionaries({"k": MODERATE, "d": MODERATE})


@st.composite
def transfers(draw: st.DrawFn, excess: int = 0) -> es.Transfer:
    kind = draw(st.integers(0, 3))
    if kind == 0 and not excess:
        return es.Lead(draw(SIGNED), draw(SIGNED), draw(SIGNED))
    if kind == 1:
        return es.Rational(f"k/(s**{1 + excess} + d*s)", draw(PARAMETERS))
    coefficients = st.sampled_from([0.0, -0.0, 1.0]) | SIGNED
    degree = draw(st.integers(0, 2))
    num = draw(st.lists(coefficients, min_size=degree, max_size=degree))
    order = degree + excess
    den = draw(st.lists(coefficients, min_size=order, max_size=order + 1))
    return es.TransferFunction(draw(SIGNED | st.just(1.0)), tuple(num), tuple(den))


@st.composite
def fields(draw: st.DrawFn, n: int, moving: bool = True) -> es.Field:
    vector = st.lists(NUMBERS, min_size=n, max_size=n).map(tuple)
    widths = st.lists(MODERATE, min_size=n, max_size=n).map(tuple)
    kind = draw(st.integers(0, 6 if moving and n == 2 else 5))
    if kind == 0:
        return es.Quadratic(draw(vector), draw(vector), draw(NUMBERS))
    if kind == 1:
        entries = [[draw(NUMBERS) for _ in range(n)] for _ in range(n)]
        q = [[entries[min(i, j)][max(i, j)] for j in range(n)] for i in range(n)]
        return es.Quadratic(draw(vector), q)
    if kind == 2:
        return es.Gaussian(draw(vector), draw(MODERATE | widths), draw(NUMBERS))
    if kind == 3:
        return es.InverseSquare(draw(vector), draw(MODERATE), draw(NUMBERS))
    if kind == 4:
        return es.Expression("-k*x**2 + 0.1*d\n + cos(t)", draw(PARAMETERS))
    if kind == 5:
        axis = np.cumsum(draw(st.lists(MODERATE, min_size=4, max_size=4)))
        numbers = draw(st.lists(MODERATE, min_size=4**n, max_size=4**n))
        return es.Gridded(es.Grid([axis] * n, np.reshape(numbers, (4,) * n)))
    paths = st.one_of(
        st.builds(es.FigureEight, NUMBERS, MODERATE, PHASES),
        st.builds(es.Circle, MODERATE, NUMBERS, PHASES),
        st.builds(es.Line, vector),
        st.builds(es.Along, st.just(("k*t", "sin(d*t)/3")), PARAMETERS),
    )
    return es.Moving(draw(fields(n, moving=False)), draw(paths))


@st.composite
def channels(draw: st.DrawFn) -> es.Channel:
    dither = draw(
        st.builds(es.Dither, MODERATE, PHASES, st.none() | transfers(1))
        | st.builds(es.Probe, MODERATE, PHASES)
    )
    reference = st.builds(es.Reference, PHASES)
    return es.Channel(
        dither,
        draw(NUMBERS),
        draw(transfers()),
        draw(reference if isinstance(dither, es.Probe) else st.none() | reference),
        draw(st.integers(1, 9) | st.fractions(Fraction(1, 9), 9, max_denominator=99) | MODERATE),
    )


@st.composite
def starts(draw: st.DrawFn, vehicle: es.PointMass) -> Any:
    n = vehicle.dimension()
    position = tuple(draw(st.lists(NUMBERS, min_size=n, max_size=n)))
    return draw(
        st.sampled_from(
            [
                position,
                position,
                es.OnDither(position),
                {name: draw(NUMBERS) for name in vehicle.state_names()},
            ]
        )
    )


@st.composite
def scenarios(draw: st.DrawFn) -> es.Scenario:
    n = draw(st.integers(1, 3))
    several = st.lists(transfers(1), min_size=n, max_size=n)
    push = st.none() | st.lists(NUMBERS, min_size=n, max_size=n)
    spans = st.tuples(st.floats(-9, -1), st.floats(1, 9))
    try:
        vehicle = es.PointMass(tuple(draw(several)), draw(push))  # pyright: ignore
        loop = es.Loop(
            field=draw(fields(n)),
            vehicle=vehicle,
            controller=es.GradientES(
                frequency=draw(MODERATE),
                washout=draw(MODERATE),
                channels=tuple(draw(st.lists(channels(), min_size=n, max_size=n))),
                washout_start=draw(st.sampled_from(["signal", "zero"]) | NUMBERS),
                probe_ramp=draw(st.none() | MODERATE),
            ),
            start=draw(starts(vehicle)),
        )
    except es.InvalidDescription:
        assume(False)
        raise
    return es.Scenario(
        loop=loop,
        run=es.Run(draw(MODERATE), draw(st.none() | st.integers(2, 9999))),
        title=draw(TEXT),
        note=draw(TEXT),
        view=es.View(
            draw(st.none() | spans), draw(st.none() | st.lists(spans, min_size=n, max_size=n))
        ),
    )


def bits(scenario: es.Scenario) -> bytes:
    return scenario.loop.values.tobytes()


@settings(deadline=None, max_examples=120)
@given(scenarios())
def test_every_scenario_comes_back_from_its_text(scenario):
    again = es.parse_scenario(es.format_scenario(scenario))
    assert again == scenario
    assert bits(again) == bits(scenario)
    assert again.loop.system is scenario.loop.system
    assert es.format_scenario(again) == es.format_scenario(scenario)


@pytest.mark.parametrize("name", zhang2007.NAMES)
def test_the_papers_scenarios_come_back(name):
    scenario = zhang2007.scenario(name)
    again = es.parse_scenario(es.format_scenario(scenario))
    assert again == scenario
    assert bits(again) == bits(scenario)


@pytest.mark.parametrize(
    "compensator",
    [
        es.TransferFunction(0.0, (), (2.0,)),
        es.TransferFunction(1.0, (1.0,), (1.0,)),
        es.TransferFunction(2.0, (0.0,), (0.0, 0.0)),
        es.TransferFunction(1.0, (), (1e-310,)),
        es.TransferFunction(1e305, (), (1.0,)),
        es.TransferFunction(0.1 + 0.2, (1 / 3,), (2 / 3, 1e-9)),
    ],
    ids=str,
)
def test_transfer_functions_keep_their_form(compensator):
    base = zhang2007.scenario("fig4")
    loop = base.loop.replace({"controller.channels.0.compensator": compensator})
    scenario = es.Scenario(loop, base.run)
    assert es.parse_scenario(es.format_scenario(scenario)) == scenario


FILE = """
start = [1, 1]
[run]
t_end = 1
[field]
type = "Quadratic"
source = [-1, "pi/2"]
q = [1, 0.5]
[vehicle]
type = "PointMass"
axes = ["1/s", "1/(s*(s + 0.7))"]
[controller]
type = "GradientES"
frequency = "30*sqrt(2)"
washout = 1
[[controller.channels]]
gain = 10
dither = { amplitude = 0.1 }
ratio = "2/3"
[[controller.channels]]
gain = 10
dither = { type = "Probe", amplitude = 0.1, phase = "-pi/2" }
reference = "pi"
"""


def test_text_stands_wherever_mathematics_may():
    loop = es.parse_scenario(FILE).loop
    expected = es.Loop(
        field=es.Quadratic((-1, pi / 2), (1, 0.5)),
        vehicle=es.PointMass((1 / s, 1 / (s * (s + 0.7)))),
        controller=es.GradientES(
            frequency=30 * 2**0.5,
            washout=1,
            channels=(
                es.Channel(es.Dither(0.1), 10, ratio=Fraction(2, 3)),
                es.Channel(es.Probe(0.1, -pi / 2), 10, reference=es.Reference(pi)),
            ),
        ),
        start=(1, 1),
    )
    assert loop == expected
    assert loop.system is expected.system


def test_a_windows_byte_order_mark_and_line_ends_are_read(tmp_path):
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + FILE.replace("\n", "\r\n").encode())
    assert es.load_scenario(path) == es.parse_scenario(FILE)


def write_grid(folder: Path, height: float = 1.0) -> None:
    axis = np.linspace(-2, 2, 5)
    np.savez(folder / "map.npz", x=axis, y=axis, J=-height * np.add.outer(axis**2, axis**2))


GRIDDED = FILE.replace('source = [-1, "pi/2"]\nq = [1, 0.5]', 'grid = { file = "map.npz" }')
GRIDDED = GRIDDED.replace("Quadratic", "Gridded")


def test_file_names_are_relative_to_the_scenario(tmp_path, monkeypatch):
    folder = tmp_path / "sub"
    folder.mkdir()
    write_grid(folder)
    (folder / "case.toml").write_text(GRIDDED)
    monkeypatch.chdir(tmp_path)
    loaded = [es.load_scenario(p) for p in ("sub/case.toml", folder / "case.toml")]
    assert loaded[0] == loaded[1] == es.parse_scenario(GRIDDED, folder)
    for scenario in loaded:
        assert es.parse_scenario(es.format_scenario(scenario)) == scenario
    with pytest.raises(es.InvalidDescription, match=r"field\.grid\.file = .*no such file"):
        es.parse_scenario(GRIDDED)


def test_changed_data_are_noticed(tmp_path):
    write_grid(tmp_path)
    text = es.format_scenario(es.parse_scenario(GRIDDED, tmp_path))
    assert es.parse_scenario(text)
    write_grid(tmp_path, height=1.0000001)
    with pytest.raises(es.InvalidDescription, match=r"field\.grid\.digest: .*data have changed"):
        es.parse_scenario(text)


def test_a_run_carries_the_text_that_reproduces_it():
    scenario = es.parse_scenario(FILE)
    run = es.simulate(scenario.loop, 0.1, title='a\n"b"')
    again = es.parse_scenario(run.attrs["scenario"])
    assert again.loop == scenario.loop
    assert (again.run.t_end, again.title) == (0.1, 'a\n"b"')


def test_what_no_text_can_state_is_refused():
    base = zhang2007.scenario("fig4")
    loop = base.loop.replace({"field": es.Opaque(lambda p, t: -float(p @ p))})
    with pytest.raises(es.InvalidDescription, match="cannot be written"):
        es.format_scenario(es.Scenario(loop, base.run))


def test_written_files_are_plain_toml():
    data = tomllib.loads(es.format_scenario(es.parse_scenario(FILE)))
    assert data["vehicle"]["axes"][0] == "1/s"
    assert data["controller"]["channels"][0]["ratio"] == "2/3"
