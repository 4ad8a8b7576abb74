"""A number that varies is a letter of the equations whatever its value is."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import pi, s
from extremum.engines import taylor
from extremum.loop import Loop, varied

TIMES = np.linspace(0.0, 1.5, 40)


def run(loop: Loop, path: str, number: float) -> np.ndarray:
    """The position when the number at a path is put into the equations in which it varies."""
    system, values, (place,) = varied(loop, (path,))
    values[place] = number
    states = taylor.integrate(system, values.tolist(), TIMES, tol=1e-14).states
    return system.evaluate(TIMES, states, values.tolist())["position"]


def rich() -> Loop:
    """A loop whose structure hides a number of every kind."""
    channels = ("controller.channels.0", "controller.channels.1")
    return velocity_actuated(
        **{
            "field": es.Moving(es.Quadratic((0, 0), ((1.0, 0.2), (0.2, 0.5))), es.Circle(0.1, 0.5)),
            "vehicle.axes": (1 / s, 1 / (s + 0.2)),
            "vehicle.disturbance": (0.1, 0.0),
            f"{channels[0]}.compensator": (s + 1) / (s**2 + 3 * s + 2.5),
            f"{channels[1]}.reference": -pi / 2,
            f"{channels[1]}.ratio": Fraction(3, 2),
            "controller.washout_start": 0.5,
            "sensor": 1 / (0.02 * s + 1),
        }
    )


def lettered() -> Loop:
    """A loop with tables of letters."""
    return velocity_actuated(
        **{
            "field": es.Expression("-a*x**2 - b*y**2", {"b": 0.5, "a": 1.0}),
            "vehicle.axes.1": es.Rational("k/(s + d)", {"k": 1.0, "d": 0.0}),
            "start": {"y": 1, "x": 1},
        }
    )


VARIED = [
    (lettered, "field.parameters.a", 1.0, 0.0),
    (lettered, "vehicle.axes.1.parameters.d", 0.0, 0.3),
    (lettered, "start.states.x", 1.0, -0.5),
    (velocity_actuated, "controller.channels.0.dither.phase", 0.0, 0.7),
    (velocity_actuated, "controller.channels.1.dither.phase", -pi / 2, 0.7),
    (velocity_actuated, "vehicle.axes.0.gain", 1.0, 1.3),
    (velocity_actuated, "vehicle.axes.1.den.0", 0.0, 0.4),
    (velocity_actuated, "controller.channels.0.ratio", Fraction(1), 1.7),
    (velocity_actuated, "controller.channels.0.compensator.gain", 1.0, 0.6),
    (velocity_actuated, "sensor.gain", 1.0, 0.6),
    (force_actuated, "controller.channels.1.compensator.pole", -3.0, -2.0),
    (force_actuated, "start.position.0", 1.0, 0.8),
    (rich, "controller.channels.1.reference.phase", -pi / 2, -1.0),
    (rich, "controller.channels.1.ratio", Fraction(3, 2), 2.0),
    (rich, "controller.channels.0.compensator.num.0", 1.0, 0.0),
    (rich, "controller.washout_start", 0.5, 0.0),
    (rich, "field.path.phase", 0.0, 1.0),
    (rich, "field.field.q.1.0", 0.2, -0.1),
    (rich, "vehicle.disturbance.1", 0.0, -0.2),
    (rich, "sensor.den.0", 50.0, 20.0),
]


@pytest.mark.parametrize(("make", "path", "old", "new"), VARIED, ids=lambda v: str(v)[:40])
def test_a_varied_number_gives_what_the_replaced_loop_does(
    make: Any, path: str, old: Any, new: float
) -> None:
    """At the value it had as structure, and at one that it could not have had."""
    loop = make()
    for number, given in ((old, old), (new, new)):
        replaced = es.simulate(loop.replace({path: given}), TIMES[-1], samples=TIMES)
        assert np.abs(run(loop, path, float(number)) - replaced.position.values).max() < 1e-9


def test_numbers_vary_together() -> None:
    loop = rich()
    changes = {
        "controller.frequency": 25.0,
        "controller.channels.0.dither.phase": 0.3,
        "controller.channels.1.ratio": 2.0,
        "vehicle.axes.0.den.0": 0.1,
    }
    system, values, places = varied(loop, tuple(changes))
    assert [system.parameters[i].path for i in places] == list(changes)
    values[list(places)] = list(changes.values())
    states = taylor.integrate(system, values.tolist(), TIMES, tol=1e-14).states
    ours = system.evaluate(TIMES, states, values.tolist())["position"]
    theirs = es.simulate(loop.replace(changes), TIMES[-1], samples=TIMES).position.values
    assert np.abs(ours - theirs).max() < 1e-9


def test_the_equations_are_shared_and_nothing_else_changes() -> None:
    loop = velocity_actuated()
    before, phase = loop.system, "controller.channels.0.dither.phase"
    assert varied(loop, ("field.peak", "start.0"))[0] is before
    first = varied(loop, (phase,))[0]
    assert first is not before
    assert varied(loop.replace({"controller.frequency": 20}), (phase,))[0] is first
    assert loop.replace({phase: 0.3}).system is first
    assert velocity_actuated().system is before
    assert np.array_equal(varied(loop, ("field.peak",))[1], loop.values)


def test_a_zero_that_cancels_by_its_value_keeps_its_state_when_it_varies() -> None:
    """s/(s² + s/2) is 1/(s + 1/2) until its last coefficient may be something else."""
    axis = es.TransferFunction(num=(0.0,), den=(0.5, 0.0))
    loop = velocity_actuated(**{"vehicle.axes.0": axis})
    assert [str(x) for x in loop.system.states] == ["x", "y", "eta"]
    system, *_ = varied(loop, ("vehicle.axes.0.den.1",))
    assert [str(x) for x in system.states] == ["x", "x_2", "y", "eta"]
    assert [str(u) for u in system.inputs] == ["u_x", "v_y"]
    full = loop.replace({"start": {"x": 1, "y": 1}})
    with pytest.raises(es.InvalidDescription, match="start: lacks x_2"):
        varied(full, ("vehicle.axes.0.den.1",))


REFUSED = {
    "field.peek": "field.peek: there is no such number; did you mean 'field.peak'?",
    "feild.peak": "did you mean 'field.peak'?",
    "field.q": "field.q: is not one number; inside it are field.q.0, field.q.1",
    "start": "start: is not one number; inside it are start.0, start.1",
    "controller.channels.0.dither": "inside it are controller.channels.0.dither.amplitude",
    "field.q.2": "field.q.2: there is no such number",
    "field.q.0.0": "field.q.0.0: there is no such number",
    "field.peak.x": "there is no such number; did you mean 'field.peak'?",
    "vehicle.disturbance": "vehicle.disturbance = None: must be given first: "
    "replace({'vehicle.disturbance': …})",
    "vehicle.disturbance.1": "vehicle.disturbance = None: must be given first",
    "controller.probe_ramp": "controller.probe_ramp = None: must be given first",
    "controller.washout_start": "controller.washout_start = 'signal': must be given first",
    "controller.channels.0.reference.phase": "controller.channels.0.reference = None: must be",
    "": "there is no such number",
}


@pytest.mark.parametrize("path", REFUSED)
def test_a_path_without_a_number_is_refused_with_the_way_out(path: str) -> None:
    with pytest.raises(es.InvalidDescription) as refused:
        varied(velocity_actuated(), (path,))
    assert REFUSED[path] in str(refused.value)


def test_structure_and_mirrored_entries_are_refused() -> None:
    loop = velocity_actuated(field=es.Expression("-x**2 - y**2"))
    with pytest.raises(es.InvalidDescription, match=r"field\.formula: is structure"):
        varied(loop, ("field.formula",))
    with pytest.raises(es.InvalidDescription, match=r"field\.field\.q\.1\.0: is the same number"):
        varied(rich(), ("field.field.q.0.1", "field.field.q.1.0"))
