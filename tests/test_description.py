"""Descriptions: paths that replace, the skeleton that decides what is rebuilt, the order."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import extremum as es
from extremum import pi, s
from extremum.description import flatten
from extremum.papers import zhang2007


def make(field: Any = None, vehicle: Any = None, start: Any = (1, 1), **controller: Any) -> es.Loop:
    """A plane loop whose parts can be exchanged."""
    given = {
        "frequency": 30,
        "washout": 1.0,
        "channels": (
            es.Channel(es.Dither(0.08), 10),
            es.Channel(es.Dither(0.08, -pi / 2), 10),
        ),
        **controller,
    }
    return es.Loop(
        field=field or es.Quadratic((-1, -1), (1.0, 0.5), 1.0),
        vehicle=vehicle or es.PointMass((1 / s, 1 / s)),
        controller=es.GradientES(**given),
        start=start,
    )


def rich() -> es.Loop:
    """A loop with a value of every shape."""
    return make(
        es.Moving(
            es.Expression("a*x - 2*b*y**2", {"b": 2, "a": 1.5}), es.FigureEight(1, 0.1, phase=0.3)
        ),
        es.PointMass(
            (3 * (s + 2) / (s**3 + 4 * s**2), es.Rational("k/(s**2 + d*s)", {"d": 2, "k": 3})),
            disturbance=(0.1, 0.2),
        ),
        (0.5, 0.6),
        washout_start=0.7,
        probe_ramp=0.2,
        channels=(
            es.Channel(es.Dither(0.1, 0.4, 1 / s), 9, es.Lead(5, -0.5, -3), es.Reference(0.2)),
            es.Channel(es.Dither(0.2, 0.5), 8, ratio=1.25),
        ),
    )


MATRIX = es.Quadratic((-1, -1), [[1.0, 0.1], [0.1, 0.5]], 1.0)
LOOPS = {
    **{name: zhang2007.scenario(name).loop for name in zhang2007.NAMES},
    "matrix": make(MATRIX),
    "matrix of three": zhang2007.scenario("three_d").loop.replace(
        {"field.q": ((1.0, 0.1, 0.2), (0.1, 0.5, 0.3), (0.2, 0.3, 0.8))}
    ),
    "rich": rich(),
    "state": make(es.Gaussian((0, 0), width=(1, 2)), start={"y": 1.0, "x": 2.0}),
    "circle": make(es.Moving(es.InverseSquare((0, 0)), es.Circle(1, 0.1, 0.2))),
    "line": make(es.Moving(MATRIX, es.Line((0.1, 0.2)))),
    "along": make(es.Moving(MATRIX, es.Along(("v*t", "sin(w*t)"), {"w": 1, "v": 2}))),
}


def read(item: Any, path: str) -> Any:
    """Walk a dotted path the plain way."""
    for part in path.split("."):
        if isinstance(item, tuple):
            item = item[int(part)]
        elif hasattr(item, part):
            item = getattr(item, part)
        else:
            item = getattr(item, "states", item)[part]
    return item


@pytest.mark.parametrize("name", LOOPS)
def test_values_stand_in_the_order_of_the_parameters(name):
    loop = LOOPS[name]
    paths = [parameter.path for parameter in loop.system.parameters]
    assert [read(loop, path) for path in paths] == list(loop.values)
    assert len(set(paths)) == len(set(loop.system.symbols)) == len(paths)


@settings(deadline=None, max_examples=100)
@given(st.data())
def test_a_changed_value_keeps_the_equations_and_changes_one_number(data):
    loop = LOOPS[data.draw(st.sampled_from(sorted(LOOPS)))]
    index = data.draw(st.integers(0, len(loop.values) - 1))
    number = data.draw(st.floats(0.02, 0.98))
    path = loop.system.parameters[index].path
    assume(loop.values[index] != number)
    changed = loop.replace({path: number})
    assert changed.system is loop.system
    assert np.flatnonzero(changed.values != loop.values).tolist() == [index]
    assert changed.values[index] == number
    assert changed != loop
    assert changed.replace({path: loop.values[index]}) == loop


THIRD = {"controller.channels.1.ratio": 3}
STRUCTURE = {
    "class of the field": (make(), {"field": es.InverseSquare((-1, -1))}),
    "vector to matrix": (make(), {"field.q": ((1.0, 0.0), (0.0, 0.5))}),
    "class of the start": (make(), {"start": es.OnDither((1, 1))}),
    "state start": (make(), {"start": {"x": 1, "y": 1}}),
    "pole leaves the origin": (make(), {"vehicle.axes.0.den.0": 0.5}),
    "gain leaves one": (make(), {"vehicle.axes.0.gain": 2}),
    "order": (make(), {"vehicle.axes.0": 1 / s**2}),
    "numerator": (make(), {"controller.channels.0.compensator": (s + 1) / (s + 2)}),
    "disturbance": (make(), {"vehicle.disturbance": (0, 0)}),
    "phase leaves the quarter turn": (make(), {"controller.channels.1.dither.phase": 0.3}),
    "another quarter turn": (make(), {"controller.channels.1.dither.phase": pi}),
    "through": (make(), {"controller.channels.0.dither.through": 1 / s}),
    "reference": (make(), {"controller.channels.0.reference": 0}),
    "ratio": (make(), THIRD),
    "ratio to a fraction": (make().replace(THIRD), {"controller.channels.1.ratio": Fraction(5, 2)}),
    "ratio to a float": (make().replace(THIRD), {"controller.channels.1.ratio": 3.0}),
    "washout from zero": (make(), {"controller.washout_start": "zero"}),
    "washout from a number": (make(), {"controller.washout_start": 0}),
    "probe ramp": (make(), {"controller.probe_ramp": 1}),
    "literal in a text": (make(es.Expression("-x**2-2*y")), {"field.formula": "-x**2-3*y"}),
    "integer exponent": (make(es.Expression("-x**2-2*y")), {"field.formula": "-x**4-2*y"}),
    "widths": (make(es.Gaussian((0, 0))), {"field.width": (1.0, 1.0)}),
}


@pytest.mark.parametrize("name", STRUCTURE)
def test_changed_structure_has_its_own_equations(name):
    loop, changes = STRUCTURE[name]
    other = loop.replace(changes)
    assert other.system is not loop.system
    assert flatten(other)[0] != flatten(loop)[0]


def test_zero_gain_and_zero_curvature_stay_values():
    loop = make()
    zero = loop.replace({"controller.channels.0.gain": 0, "field.q.0": 0, "field.source.1": 0})
    assert zero.system is loop.system


def test_equations_do_not_depend_on_which_numbers_came_first():
    def loop(a: float) -> es.Loop:
        axis = es.Rational("1/(a*s**2 + b_first*s)", {"a": a, "b_first": 1})
        return make(vehicle=es.PointMass((axis, 1 / s)))

    try:
        first = loop(0.0).system
    except es.InvalidDescription:
        first = loop(1.0).system
    assert [str(symbol) for symbol in first.inputs] == ["u_x", "v_y"]
    assert not set(first.states) & {symbol for symbol, _ in first.signals}


def test_a_pole_cancelled_by_numbers_keeps_its_state():
    axis = es.Rational("(s - z_same)/(s*(s - p_same))", {"z_same": 1, "p_same": 1})
    vehicle = es.PointMass((axis, 1 / s))
    assert vehicle.state_names() == ("x", "x_2", "y")
    system = make(vehicle=vehicle, start={"x": 1, "x_2": 0, "y": 1}).system
    assert [str(state) for state in system.states] == ["x", "x_2", "y", "eta"]


# --- replace ----------------------------------------------------------------------------------


def test_changes_are_applied_together():
    loop = make()
    third = es.Channel(es.Dither(0.1), 5, ratio=2)
    changed = loop.replace(
        {
            "field": es.Quadratic((0, 0, 0), (1, 1, 1)),
            "vehicle": es.PointMass((1 / s, 1 / s, 1 / s)),
            "controller.channels": (*loop.controller.channels, third),  # pyright: ignore
            "start": (1, 1, 1),
        }
    )
    assert len(changed.system.inputs) == 3
    with pytest.raises(es.InvalidDescription):
        loop.replace({"field": es.Quadratic((0, 0, 0), (1, 1, 1))})
    assert loop == make()


def test_entries_mirrored_in_a_matrix_are_one():
    loop = make(MATRIX)
    upper, lower = (loop.replace({f"field.q.{path}": 0.3}) for path in ("0.1", "1.0"))
    both = loop.replace({"field.q.0.1": 0.3, "field.q.1.0": 0.3})
    assert upper == lower == both
    assert upper.field.q == ((1.0, 0.3), (0.3, 0.5))  # pyright: ignore
    rows = loop.replace({"field.q.0": (2, 0.3), "field.q.1": (0.3, 3)})
    assert rows.field.q == ((2.0, 0.3), (0.3, 3.0))  # pyright: ignore
    assert len([p for p in loop.system.parameters if p.path.startswith("field.q")]) == 3


def test_entries_of_every_container_can_be_replaced():
    loop = rich()
    changes = {
        "field.field.parameters.a": 7,
        "vehicle.axes.0.den.0": 5,
        "vehicle.axes.1.parameters.k": 6,
        "vehicle.disturbance.1": 0.5,
        "start.0": 4,
        "controller.channels.0.reference.phase": 0.9,
    }
    changed = loop.replace(changes)
    assert {path: read(changed, path) for path in changes} == changes
    state = LOOPS["state"].replace({"start.states.x": 5})
    assert read(state, "start.states.x") == 5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"feild.peak": 1}, "feild: there is no such entry; did you mean 'field'?"),
        ({"field.peek": 1}, "field.peek: there is no such entry; did you mean 'peak'?"),
        ({"field.q.5.0": 1}, "field.q.5: there is no such entry"),
        ({"field.q.2.0": 1}, "field.q.2: there is no such entry"),
        ({"field.q.1.x": 1}, "field.q.1.x: there is no such entry"),
        ({"field.peak.x": 1}, "field.peak.x: 1.0 has no parts"),
        ({"controller.channels.2.gain": 1}, "controller.channels.2: there is no such entry"),
        ({"controller.channels.0.gian": 1}, "did you mean 'gain'?"),
        ({"": 1}, "there is no such entry"),
        ({3: 1}, "3"),
        ("field", "mapping"),
        ({"field.peak": float("nan")}, "field.peak = nan: must be a finite number"),
        ({"field.q.0.1": "x"}, "field.q.0.1 = 'x'"),
        ({"controller.washout": 0}, "controller.washout = 0.0: must be greater than 0"),
        ({"field": MATRIX, "field.peak": 2}, "field: is replaced as a whole and in part"),
        ({"start": (1, 2), "start.0": 2}, "start: is replaced as a whole and in part"),
        ({"field.q.1.0": 0.2, "field.q.0.1": 0.3}, "field.q.1.0 = 0.2"),
    ],
)
def test_a_refused_change_names_its_path(changes, message):
    with pytest.raises(es.InvalidDescription) as refused:
        make(MATRIX).replace(changes)
    assert message in str(refused.value)


# --- validation -------------------------------------------------------------------------------


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: es.Dither(0), "Dither.amplitude = 0.0: must be greater than 0"),
        (lambda: es.Dither(-1), "Dither.amplitude = -1.0"),
        (lambda: es.Dither(0.1, NAN), "Dither.phase = nan: must be a finite number"),
        (lambda: es.Dither(0.1, INF), "Dither.phase = inf: must be a finite number"),
        (lambda: es.Reference(NAN), "Reference.phase = nan"),
        (lambda: es.Circle(1, 1, INF), "Circle.phase = inf"),
        (lambda: es.Dither(True), "Dither.amplitude = True: must be a number"),
        (lambda: es.Dither("x"), "Dither.amplitude = 'x': unknown name"),  # pyright: ignore
        (lambda: es.Quadratic((1, NAN), (1, 1)), "Quadratic.source.1 = nan"),
        (lambda: es.Quadratic((1, 10**400), (1, 1)), "Quadratic.source.1"),
        (lambda: es.Quadratic((1, 1), (1,)), "Quadratic.q = (1.0,)"),
        (lambda: es.Quadratic((1, 1), [[1, 2], [3, 1]]), "Quadratic.q.1.0 = 3.0: differs"),
        (lambda: es.Quadratic((1, 1), [[1, 2]]), "Quadratic.q.0: has 2 entries, must have 1"),
        (lambda: es.Quadratic((1, 1), np.zeros((2, 2, 2))), "Quadratic.q.0.0"),
        (lambda: es.Quadratic((), ()), "Quadratic.source"),
        (lambda: es.Gaussian((1, 1), width=(1, 0)), "Gaussian.width.1 = 0.0"),
        (lambda: es.Expression("a*x", {"a": INF}), "Expression.parameters.a = inf"),
        (lambda: es.Expression("a*x", {"x": 1}), "Expression.parameters.x: is the name of"),
        (lambda: es.Expression("a*x", {"2a": 1}), "Expression.parameters.2a: is no name"),
        (lambda: es.PointMass((s,)), "PointMass.axes.0 = 's': is improper"),
        (lambda: es.PointMass(((s + 1) / (s + 2),)), "PointMass.axes.0"),
        (lambda: es.PointMass(1 / s), "must be a tuple with one transfer function per axis"),
        (lambda: es.PointMass((1 / s,), (1, 2)), "PointMass.disturbance = (1.0, 2.0)"),
        (lambda: es.TransferFunction(den=3), "TransferFunction.den = 3"),  # pyright: ignore
        (lambda: es.Channel(0.1, 10), "Channel.dither = 0.1: must be a"),  # pyright: ignore
        (lambda: es.Channel(es.Dither(1), 1, ratio=0), "Channel.ratio = 0: must be greater"),
        (lambda: es.Channel(es.Dither(1), 1, ratio=10**400), "Channel.ratio"),
        (lambda: es.Channel(es.Dither(1), 1, ratio="1e9999999"), "Channel.ratio"),  # pyright: ignore
        (lambda: es.Channel(es.Probe(1), 1), "Channel.reference = None: must be given"),
        (lambda: make(washout_start="now"), "GradientES.washout_start = 'now'"),
        (lambda: make(channels=()), "GradientES.channels = ()"),
        (lambda: make(start=(1, 1, 1)), "start = (1.0, 1.0, 1.0): has 3 coordinates"),
        (lambda: make(start={"x": 1}), "start: lacks y"),
        (lambda: make(start={"x": 1, "y": 1, "z": 1}), "start.z: is no vehicle state"),
        (lambda: make(es.Quadratic((1,), (1,))), "field: has 1 coordinates"),
        (lambda: make(es.Expression("x + z")), "unknown name 'z'"),
        (lambda: make(frequency=1e300, vehicle=es.PointMass((1 / s**2,) * 2)), "channels.0.dither"),
    ],
)
def test_what_cannot_be_is_refused_with_path_and_value(build, message):
    with pytest.raises(es.InvalidDescription) as refused:
        build()
    assert message in str(refused.value)


def test_a_ratio_in_text_is_exact_however_it_is_spaced():
    for text in ("2/3", "2 / 3", " 2/3 "):
        channel = es.Channel(es.Dither(1), 1, ratio=text)  # pyright: ignore[reportArgumentType]
        assert channel.ratio == Fraction(2, 3)
        assert isinstance(channel.ratio, Fraction)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_of_other_kinds_are_the_same_numbers(number):
    for kind in (float, np.float64, sympy.Float, lambda n: sympy.Rational(*n.as_integer_ratio())):
        assert es.Line((kind(number),)).velocity == (number,)  # pyright: ignore[reportArgumentType]


def test_descriptions_are_values():
    loop = rich()
    assert loop == rich()
    assert hash(loop) == hash(rich())
    with pytest.raises(AttributeError):
        loop.start = (2, 2)  # pyright: ignore[reportAttributeAccessIssue]


def test_a_field_of_a_class_cannot_be_left_undeclared() -> None:
    """Otherwise it would be neither structure nor number, and two laws would share one system."""
    with pytest.raises(TypeError, match=r"Power\.power: declare it"):

        class Power(es.Field):
            power: int = 2


def test_a_class_of_another_module_cannot_take_a_known_name() -> None:
    with pytest.raises(TypeError, match="take another name"):

        class Gaussian(es.Field):
            pass


def test_what_loops_share_cannot_be_changed() -> None:
    system = make().system
    for shared in (system.units, system.outputs, system.oracles):
        with pytest.raises(TypeError):
            shared["J"] = ()  # pyright: ignore[reportIndexIssue]
    grid = es.Grid(([0, 1, 2, 3],), [0, 1, 2, 3])
    with pytest.raises(AttributeError):
        grid.values = grid.values  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match="read-only"):
        grid.values[0] = 1


def test_tables_that_are_equal_hash_equally() -> None:
    one = es.Expression("a*x + b", {"a": 1, "b": 2})
    other = es.Expression("a*x + b", {"b": 2, "a": 1})
    assert one == other
    assert hash(one) == hash(other)


def test_units_follow_from_the_vehicle() -> None:
    vehicle = es.PointMass((1 / s**3, (s + 2) / (s * (s + 0.7))))
    lead = es.Rational("(s + a)**2/((s + 3)*(s + 4))", {"a": 1})
    channel = es.Channel(es.Dither(0.1), 1, lead)
    system = make(None, vehicle, channels=(channel, channel)).system
    units = {str(symbol): unit for symbol, unit in system.units.items()}
    assert [units[x] for x in ("x", "v_x", "a_x")] == ["m", "m/s", "m/s^2"]
    assert [units[x] for x in ("y", "y_2")] == ["m", "m/s"]
    assert [units[x] for x in ("zeta_x_1", "zeta_x_2", "u_x")] == ["m/s^3", "m/s^4", "m/s^3"]
    by_path = {p.path: p.unit for p in system.parameters}
    assert by_path["controller.channels.0.gain"] == "m/s^3"
    assert by_path["vehicle.axes.1.den.0"] == "1/s"
    assert by_path["field.q.0"] == "1/m^2"


def test_eleven_axes_do_not_collide() -> None:
    """Axis 1's second compensator state and axis 11's first have names of their own."""
    second = es.Channel(es.Dither(0.1), 1, "(s + 1)/((s + 2)*(s + 3))")  # pyright: ignore
    loop = es.Loop(
        es.Quadratic((0,) * 11, (1,) * 11),
        es.PointMass((1 / s,) * 11),
        es.GradientES(30, 1, (second,) * 11),
        (0,) * 11,
    )
    states = loop.system.states
    assert len({str(x) for x in states}) == len(states) == 11 + 22 + 1
