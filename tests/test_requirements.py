"""Requirements: files lose nothing, and whatever contradicts itself is refused in words."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from schema import documented

import extremum as es
from extremum import pi, s
from extremum.description import Description

ROOT = Path(__file__).parents[1]
EPSILON = "vehicle.axes.0.parameters.epsilon"

SIZES = st.sampled_from([0.1 + 0.2, 1 / 3, 1e-5, 2.0**20 + 2**-30]) | st.floats(1e-6, 1e6)
SIGNED = st.builds(lambda size, sign: size * sign, SIZES, st.sampled_from([-1.0, 1.0]))
OPTIONAL = st.none() | SIZES


@st.composite
def axes(draw: st.DrawFn) -> es.Transfer:
    kind = draw(st.integers(0, 2))
    if kind == 0:
        return es.Rational("k/(s*(s + d))", {"k": draw(SIGNED), "d": draw(SIGNED)})
    den = draw(st.lists(SIGNED | st.just(0.0), min_size=1, max_size=3))
    num = draw(st.lists(SIGNED, max_size=len(den) - 1))
    return es.TransferFunction(draw(SIGNED | st.just(1.0)), tuple(num), tuple(den))


@st.composite
def motions(draw: st.DrawFn) -> es.SourceMotion | None:
    frequency = draw(SIZES)
    up_to = draw(st.none() | st.floats(1.0, 4.0).map(lambda k: k * frequency))
    return draw(st.sampled_from([None, es.Ramp(), es.Periodic(frequency, up_to)]))


@st.composite
def requirements(draw: st.DrawFn) -> es.Requirements:
    n = draw(st.integers(1, 3))
    per_axis = SIZES | st.lists(SIZES, min_size=n, max_size=n).map(tuple)
    vehicle = es.PointMass(tuple(draw(st.lists(axes(), min_size=n, max_size=n))))
    ends = st.tuples(SIZES, SIZES).map(lambda pair: (min(pair), max(pair)))
    uncertain = {}
    for index, axis in enumerate(vehicle.axes):
        path = f"vehicle.axes.{index}." + ("parameters.d" if isinstance(axis, es.Rational) else "")
        if draw(st.booleans()) and isinstance(axis, es.Rational):
            uncertain[path] = draw(ends)
    settling = draw(OPTIONAL)
    noise = draw(st.just(0.0) | SIZES)
    factors = st.sampled_from(["1", "(s + 0.25)/(s + 3)", "1/(0.5*s + 1)"]) | st.just(
        es.Lead(2.0, -1.0, -3.0)
    )
    try:
        return es.Requirements(
            vehicle=vehicle,
            curvature=tuple(draw(st.lists(ends, min_size=n, max_size=n))),
            dither_limit=draw(per_axis),
            settling_time=settling,
            bandwidth=draw(SIZES) if settling is None else None,
            coupling=draw(st.just(0.0) | SIZES),
            uncertain=uncertain,
            input_limit=draw(st.none() | per_axis),
            frequency_limit=draw(OPTIONAL),
            source_distance=draw(st.just(0.0) | per_axis),
            start_distance=draw(st.just(0.0) | SIZES),
            force=draw(st.just(0.0) | per_axis),
            zero_bias=draw(st.booleans()),
            motion=draw(motions()),
            noise=noise,
            accuracy=draw(OPTIONAL) if noise else None,
            sensor=draw(st.sampled_from([1, 1 / (s + 3), es.Lead(1.0, -0.5, -0.25)])),
            delay=draw(st.just(0.0) | SIZES),
            include=draw(st.none() | st.lists(factors, min_size=n, max_size=n).map(tuple)),
            quadrature=draw(st.booleans()),
        )
    except es.InvalidDescription:
        assume(False)
        raise


@settings(deadline=None, max_examples=100)
@given(requirements())
def test_requirements_come_back_from_their_text(wanted):
    text = es.format_requirements(wanted)
    again = es.parse_requirements(text)
    assert again == wanted
    assert es.format_requirements(again) == text
    for name in ("curvature", "dither_limit", "uncertain", "motion", "include", "sensor"):
        assert repr(getattr(again, name)) == repr(getattr(wanted, name))


FILE = f"""
settling_time = 8
curvature = [[0.5, "2"], 1]
dither_limit = [0.1, "1/20"]
source_distance = 1
zero_bias = false
motion = {{ type = "Periodic", frequency = "pi/10", up_to = 1 }}
sensor = "1/(0.1*s + 1)"
include = ["1", {{ type = "Lead", gain = 2, zero = -1, pole = -3 }}]

[vehicle]
axes = [
    {{ type = "Rational", formula = "1/(s - epsilon)", parameters = {{ epsilon = 0.25 }} }},
    "1/s**2",
]

[uncertain]
"{EPSILON}" = [0, 0.5]
"""


def stated() -> es.Requirements:
    slow = es.Rational("1/(s - epsilon)", {"epsilon": 0.25})
    return es.Requirements(
        vehicle=es.PointMass((slow, 1 / s**2)),
        curvature=((0.5, 2), (1, 1)),
        dither_limit=(0.1, 0.05),
        settling_time=8,
        source_distance=1,
        zero_bias=False,
        motion=es.Periodic(pi / 10, 1),
        sensor=1 / (s / 10 + 1),
        include=(1, es.Lead(2, -1, -3)),
        uncertain={EPSILON: (0, 0.5)},
    )


def test_a_file_states_what_python_does(tmp_path):
    assert es.parse_requirements(FILE) == stated()
    path = tmp_path / "wanted.toml"
    path.write_bytes(b"\xef\xbb\xbf" + FILE.replace("\n", "\r\n").encode())
    assert es.load_requirements(path) == stated()


def test_written_files_are_plain_toml_without_what_is_left_out():
    data = tomllib.loads(es.format_requirements(stated()))
    assert data["uncertain"] == {EPSILON: [0.0, 0.5]}
    assert data["include"][1] == {"type": "Lead", "gain": 2.0, "zero": -1.0, "pole": -3.0}
    assert data["motion"] == {"type": "Periodic", "frequency": float(pi / 10), "up_to": 1.0}
    least = es.Requirements(es.PointMass((1 / s,)), ((1, 2),), 0.1, settling_time=3)
    data = tomllib.loads(es.format_requirements(least))
    assert list(data) == ["curvature", "dither_limit", "settling_time", "vehicle"]


def test_what_are_no_requirements_cannot_be_written():
    with pytest.raises(es.InvalidDescription, match="must be Requirements"):
        es.format_requirements({})  # pyright: ignore[reportArgumentType]


def test_the_example_is_the_one_of_the_documentation():
    slow = es.Rational("1/(s - epsilon)", {"epsilon": 0.25})
    assert es.load_requirements(ROOT / "docs" / "requirements.toml") == es.Requirements(
        vehicle=es.PointMass(axes=(slow, slow)),
        uncertain={EPSILON: (0, 0.5), EPSILON.replace("0", "1"): (0, 0.5)},
        curvature=((0.5, 1.0), (0.25, 0.5)),
        dither_limit=0.2,
        input_limit=80,
        source_distance=1.0,
        start_distance=1.5,
        settling_time=6.0,
    )


def test_every_key_of_requirements_is_documented_as_it_is_declared():
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    for name, cls in Description.registry.items():
        if cls.__module__ == "extremum.requirements":
            assert f"### {name}\n" in text
            for row in documented(cls):
                assert row in text, row


# --- what is refused --------------------------------------------------------------------------

CHANGES: dict[str, tuple[dict[str, Any], str]] = {
    "a range upside down": (
        {"curvature": ((2, 1), 1)},
        r"curvature\.0: its low end 2 exceeds its high end 1",
    ),
    "no maximum": ({"curvature": ((0, 1), 1)}, r"curvature\.0 = \(0\.0, 1\.0\): must be greater"),
    "three ends": ({"curvature": ((0, 1, 2), 1)}, r"curvature\.0 = \(0, 1, 2\): must be two"),
    "text in a range": ({"curvature": ((0, "a"), 1)}, r"curvature\.0\.1 = 'a': unknown name"),
    "a range that is none": ({"curvature": ((0.5, None), 1)}, r"curvature\.0\.1 = None: must be a"),
    "one range": ({"curvature": ((1, 2),)}, "curvature: has 1 ranges, the vehicle has 2 axes"),
    "no range": ({"curvature": 1}, r"curvature = 1: must be one pair of numbers per axis"),
    "two speeds": ({"bandwidth": 1}, "settling_time: or bandwidth must be given.*both are"),
    "no speed": ({"settling_time": None}, "settling_time: or bandwidth must be.*none is"),
    "a negative force": ({"force": (1, -1)}, r"force = \(1\.0, -1\.0\): must not be negative"),
    "a negative dither": ({"dither_limit": (1, -1)}, r"dither_limit\.1 = -1\.0: must be greater"),
    "too many dithers": ({"dither_limit": (1, 1, 1)}, "dither_limit: has 3 entries for 2 axes"),
    "no truth": ({"zero_bias": 1}, "zero_bias = 1: must be true or false"),
    "no quadrature": ({"quadrature": "yes"}, "quadrature = 'yes': must be true or false"),
    "one factor": ({"include": ("1",)}, "include: has 1 factors for 2 axes; give 1 where"),
    "an improper factor": ({"include": ("1", "s")}, r"include\.1 = 's': is improper"),
    "a factor of nothing": ({"include": ("1", "0")}, r"include\.1 = 0: lets nothing pass"),
    "an accuracy without noise": ({"accuracy": 1}, "accuracy = 1.0: bounds what noise does"),
    "a path of the map": (
        {"uncertain": {"field.q.0": (1, 2)}},
        r"uncertain\.field\.q\.0: must begin with vehicle; .*`curvature`",
    ),
    "a path that is not there": (
        {"uncertain": {EPSILON[:-1]: (0, 1)}},
        r"uncertain\.vehicle\.axes\.0\.parameters\.epsilo: .*did you mean 'epsilon'\?",
    ),
    "a path beyond the axes": (
        {"uncertain": {"vehicle.axes.7.gain": (0, 1)}},
        r"uncertain\.vehicle\.axes\.7\.gain: .*known: 0, 1",
    ),
    "no path": ({"uncertain": 3}, "uncertain = 3: must map dotted paths to low and high"),
    "a table for a path": (
        {"uncertain": {"vehicle": {"axes": 1}}},
        r"uncertain\.vehicle = \{'axes': 1\}: is a table; a dotted path is one key, in quotes",
    ),
    "no motion": (
        {"motion": "Ramp"},
        r"motion = 'Ramp': must be a SourceMotion \(Periodic, Ramp\)",
    ),
    "a deaf sensor": ({"sensor": "0"}, "sensor = 0: lets nothing pass"),
    "an immense lag": ({"sensor": "1/(1e200*s + 1)"}, "sensor = .*: must lie"),
    "an immense dither": ({"dither_limit": 1e200}, "dither_limit = 1e[+]200: must lie"),
    "an immense range": (
        {"curvature": ((1e-200, 1), 1)},
        r"curvature = .*: must lie",
    ),
    "an immense uncertainty": ({"uncertain": {EPSILON: (0, 1e200)}}, "uncertain.*: must lie"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_contradicts_itself_is_refused(name):
    changes, message = CHANGES[name]
    with pytest.raises(es.InvalidDescription, match=message):
        stated().replace(changes)


def test_a_force_belongs_to_the_requirements():
    vehicle = es.PointMass((1 / s,), disturbance=(1,))
    with pytest.raises(
        es.InvalidDescription, match=r"vehicle\.disturbance: is one force; .*`force`"
    ):
        es.Requirements(vehicle, ((1, 2),), 0.1, settling_time=3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.0, 0.5), r"up_to = 0\.5: must not be below the fundamental 1"),
        ((1.0, 9.0), r"up_to = 9\.0: asks for 9 resonators, at most 4 are made; lower it to 4"),
        ((0.0,), r"frequency = 0\.0: must be greater than 0"),
    ],
)
def test_a_periodic_motion_has_few_sines(arguments, message):
    with pytest.raises(es.InvalidDescription, match=message):
        es.Periodic(*arguments)


def test_the_sines_of_a_periodic_motion():
    assert es.Periodic(0.1).frequencies() == (0.1,)
    assert np.allclose(es.Periodic(0.1, 0.3).frequencies(), [0.1, 0.2, 0.3])


FILES = {
    "unknown key": ("settling_time", "settling_tim", "settling_tim: there is no such entry; did"),
    "type at the top": ("zero_bias", 'type = "x"\nzero_bias', "type: there is no such entry"),
    "missing": ("dither_limit = [", "# = [", r"dither_limit: is missing \(largest amplitude"),
    "no vehicle": ("[vehicle]", "[vehicl]", r"vehicl: there is no such entry; did .*'vehicle'\?"),
    "inner key": ("axes = [", "axs = [", r"vehicle\.axs: there is no such entry; did.*'axes'\?"),
    "motion's type": ('"Periodic"', '"periodic"', r"motion\.type = 'periodic': .*'Periodic'\?"),
    "motion's key": ("up_to", "upto", r"motion\.upto: there is no such entry; did.*'up_to'\?"),
    "path without quotes": (f'"{EPSILON}"', EPSILON, r"uncertain\.vehicle = \{'axes'.*in quotes"),
    "text for a factor list": ("include = [", "include = '1' # [", "include = '1': must be an arr"),
    "not TOML": ("[vehicle]", "[vehicle", r"this is not TOML: .*line"),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_are_no_requirements(name):
    old, new, message = FILES[name]
    assert old in FILE
    text = FILE.replace(old, new, 1)
    if name == "text for a factor list":
        text = text.replace(', { type = "Lead", gain = 2, zero = -1, pole = -3 }]', "")
    with pytest.raises(es.InvalidDescription, match=message):
        es.parse_requirements(text)


@pytest.mark.parametrize("path", ["nosuch.toml", ".", "a\0b"])
def test_files_that_cannot_be_opened(path):
    with pytest.raises(es.InvalidDescription, match="cannot read"):
        es.load_requirements(path)
