"""Relative coordinates are exact: the same loop, integrated in both, moves alike."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import s
from extremum.engines import reference
from extremum.papers.zhang2007 import scenario
from extremum.theory.frame import relative


def third_order() -> es.Loop:
    """Three axes with zeros in the plant, a symbolic phase, a Probe and separate frequencies."""
    return es.Loop(
        field=es.Moving(
            es.Quadratic(source=(0.2, -0.1, 0.3), q=((1, 0.2, 0), (0.2, 0.7, 0.1), (0, 0.1, 0.5))),
            ("0.3*sin(0.5*t)", "0.1*t", "0"),
        ),
        vehicle=es.PointMass(
            axes=((s + 3) / (s**2 + s), 1 / (s**2 + 0.4 * s + 1), 1 / (s - 0.2)),
            disturbance=(0.1, -0.2, 0.05),
        ),
        controller=es.GradientES(
            frequency=20,
            washout=1.5,
            channels=(
                es.Channel(es.Dither(0.1, phase=0.3), 2, (s + 1) / (s + 4), ratio=2),
                es.Channel(es.Dither(0.08, phase=-1.1), 3, es.Lead(4, -1, -6), ratio=3),
                es.Channel(es.Probe(2.0, phase=1.0), 4, reference=-0.5, ratio=Fraction(5, 2)),
            ),
        ),
        start=(0.3, 0.1, 0.2),
    )


LOOPS = {
    "velocity": velocity_actuated(),
    "force": force_actuated(),
    "third order": third_order(),
    "unstable": scenario("unstable").loop,
    "moving": scenario("fig6").loop,
    "expression": velocity_actuated(field=es.Expression("1 - (x + 1)**2 - 0.5*(y + 1)**2 - x*y/9")),
    "state": force_actuated(start={"x": 0.1, "v_x": 1.0, "y": -0.2, "v_y": 0.3}),
}


@pytest.mark.parametrize("name", LOOPS)
def test_the_same_motion_in_both_coordinates(name: str) -> None:
    loop = LOOPS[name]
    run = es.simulate(loop, 1.5, samples=301)
    frame = relative(loop)
    ours = reference.integrate(frame.system, frame.values, run.time.values, tol=1e-12)
    outputs = frame.system.evaluate(ours.times, ours.states, frame.values)
    for output in ("position", "input"):
        assert outputs[output] == pytest.approx(run[output].values, rel=1e-8, abs=1e-8)
    assert outputs["J"][:, 0] == pytest.approx(run.J.values, rel=1e-8, abs=1e-8)
    if "source" in run:
        assert outputs["source"] == pytest.approx(run.source.values, abs=1e-12)


@pytest.mark.parametrize("name", LOOPS)
def test_the_steady_response_to_the_probe_is_gone(name: str) -> None:
    """No rate holds a sine of the dither but where it multiplies a signal or a state."""
    loop = LOOPS[name]
    equations = relative(loop).equations
    waves = {x for o in equations.oscillators for x in (o.sine, o.cosine)}
    moving = {*equations.states, *(x for x, _ in equations.signals)}
    for rate in equations.rates[: len(loop.vehicle.state_names())]:
        for term in sympy.Add.make_args(sympy.expand(rate)):
            assert not term.free_symbols & waves or term.free_symbols & moving, term


def test_offset_is_position_minus_source_minus_dither() -> None:
    loop = LOOPS["third order"]
    frame = relative(loop)
    times = np.linspace(0, 1, 50)
    ours = reference.integrate(frame.system, frame.values, times, tol=1e-12)
    outputs = frame.system.evaluate(ours.times, ours.states, frame.values)
    dither = outputs["position"] - outputs["source"] - outputs["offset"]
    assert dither[:, 0] == pytest.approx(0.1 * np.sin(40 * times + 0.3), abs=1e-12)
    assert dither[:, 1] == pytest.approx(0.08 * np.sin(60 * times - 1.1), abs=1e-12)
    response = 2 * np.exp(1j * (50 * times + 1)) / (50j - 0.2)  # the Probe through 1/(s - 0.2)
    assert dither[:, 2] == pytest.approx(response.imag, abs=1e-12)


def test_states_are_named_as_in_the_paper() -> None:
    names = [str(x) for x in relative(force_actuated()).equations.states]
    assert names == ["xtilde", "vtilde_x", "ytilde", "vtilde_y", "e", "zeta_x", "zeta_y"]


def test_a_parameter_that_is_called_e_keeps_its_name() -> None:
    plant = es.Rational("1/(s + e)", parameters={"e": 0.3})
    loop = velocity_actuated(**{"vehicle.axes.0": plant, "field": es.Gaussian((0, 0))})
    named = velocity_actuated(field=es.Expression("-e*x**2 - y**2", parameters={"e": 1.0}))
    assert len({str(x) for x in relative(loop).equations.states}) == 3
    assert "etatilde" in {str(x) for x in relative(named).equations.states}


@pytest.mark.parametrize(
    ("name", "period"),
    [
        ("fig4", (2 * math.pi / 30, 1)),
        ("fig5", (2 * math.pi / 0.1, 300)),
        ("three_d", (2 * math.pi / 10, 4)),
        ("commensurate", (2 * math.pi / 0.25, 120)),
        ("incommensurate", None),
    ],
)
def test_the_common_period(name: str, period: tuple[float, int] | None) -> None:
    found = relative(scenario(name).loop).period()
    if period is None:
        assert found is None
    else:
        assert found is not None
        assert found[0] == pytest.approx(period[0], rel=1e-12)
        assert found[1] == period[1]


def test_time_other_than_by_sines_has_no_period() -> None:
    fading = es.Moving(es.Quadratic((0, 0), (1, 1)), ("exp(-t)", "0"))
    ramp = es.Moving(es.Quadratic((0, 0), (1, 1)), es.Line((0.1, 0.2)))
    assert relative(velocity_actuated(field=fading)).period() is None
    assert relative(velocity_actuated(field=ramp)).period() is not None  # ẋ* is constant


def test_the_probes_ramp_is_left_out_and_said() -> None:
    loop = velocity_actuated(**{"controller.probe_ramp": 2.0})
    assert "ramp" in relative(loop).notes[0]


def changed(**changes: Any) -> es.Loop:
    return velocity_actuated(start=(0.9, 0.1), **changes)


def test_the_source_of_an_expression_is_found_uphill() -> None:
    field = es.Expression("exp(-(x - 1)**2 - 2*(y - 0.3)**2)")
    frame = relative(changed(field=field))
    assert frame.values[-2:] == pytest.approx([1.0, 0.3], abs=1e-10)
    assert "states no source" in frame.notes[0]


def test_an_opaque_field_is_replaced_by_its_local_quadratic() -> None:
    field = es.Opaque(lambda p, t: float(np.exp(-((p[0] - 1) ** 2) - p[0] * p[1] - 2 * p[1] ** 2)))
    frame = relative(changed(field=field))
    exact = sympy.exp(sympy.sympify("-(x - 1)**2 - x*y - 2*y**2"))
    place = [8 / 7, -2 / 7]  # where the gradient of the exponent vanishes
    at = dict(zip(sympy.symbols("x y"), place, strict=True))
    hessian = np.array(sympy.hessian(exact, sympy.symbols("x y")).subs(at).tolist(), dtype=float)
    local = frame.loop.field
    assert isinstance(local, es.Quadratic)
    assert local.source == pytest.approx(place, abs=1e-8)
    assert -2 * np.array(local.q) == pytest.approx(hessian, rel=1e-7)
    assert local.peak == pytest.approx(float(exact.subs(at)), rel=1e-12)
    assert "Richardson" in frame.notes[0]


def test_a_moving_opaque_field_keeps_moving() -> None:
    field = es.Moving(es.Opaque(lambda p, t: float(-(p @ p))), es.Circle(1.0, 0.5))
    frame = relative(changed(field=field))
    assert isinstance(frame.loop.field, es.Moving)


def test_a_flat_field_rests_where_it_starts() -> None:
    frame = relative(changed(field=es.Expression("0*x + 3")))
    assert frame.values[-2:] == [0.9, 0.1]
    assert frame.equations.hessian == sympy.zeros(2, 2)


@pytest.mark.parametrize("formula", ["x + 2*y", "exp(x + y)", "x**2 + y**2", "log(x) + y"])
def test_a_field_without_a_maximum_is_refused(formula: str) -> None:
    with pytest.raises(es.InvalidDescription, match="no maximum uphill from the start"):
        relative(changed(field=es.Expression(formula)))
    with pytest.raises(es.InvalidDescription, match="no maximum uphill"):
        relative(changed(field=es.Opaque(lambda p, t: float(p[0] + 2 * p[1]))))
