"""Loop gains and static errors: closed forms by hand, python-control, the exact orbit's mean."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import pi, s
from extremum.papers.zhang2007 import NAMES, scenario
from extremum.theory.averaging import average
from extremum.theory.linear import hidden_modes, loop_gain
from extremum.theory.offsets import bias
from extremum.theory.orbits import periodic_orbit

LEAD = es.Lead(5, -0.5, -3)


def put(expression: Any, **numbers: float) -> float:
    """Evaluate an expression by its symbols' names."""
    return float(expression.subs({x: numbers[x.name] for x in expression.free_symbols}))


def test_one_formula_behind_all_three_schemes() -> None:
    for loop in (velocity_actuated(), force_actuated(), scenario("unstable").loop):
        gain = loop_gain(loop)
        assert gain.axes is not None
        twin: Any = loop.twin
        for i, (law, q) in enumerate(zip(gain.axes, twin.field.q, strict=True)):
            channel = twin.controller.channels[i]
            wanted = channel.dither.amplitude * channel.gain * q
            wanted *= channel.compensator.law() * twin.vehicle.axes[i].law()
            assert sympy.simplify(law - wanted) == 0


@pytest.mark.parametrize("name", NAMES)
def test_its_closed_loop_poles_are_the_averaged_eigenvalues(name: str) -> None:
    loop: Any = scenario(name).loop
    numbers = loop_gain(loop).numbers
    poles = sympy.Integer(1)  # of G and C, which det(I + L) has below
    for axis, channel in zip(loop.vehicle.axes, loop.controller.channels, strict=True):
        poles *= sympy.denom(sympy.together(axis.law())) * sympy.denom(channel.compensator.law())
    closed = sympy.cancel(sympy.expand(poles) * (sympy.eye(numbers.rows) + numbers).det())
    roots = np.array([complex(r) for r in sympy.Poly(closed, s).nroots(n=20, maxsteps=200)])
    washout = loop.controller.washout
    wanted = np.poly(np.append(roots, -washout)).real
    bent = 0.05 if name == "nonquadratic" else 1e-9  # its curvature varies over the dither
    assert np.poly(average(loop).eigenvalues).real == pytest.approx(wanted, rel=bent)


def test_coupled_axes_give_a_matrix() -> None:
    gain = loop_gain(scenario("nondiagonal").loop)
    assert gain.axes is None
    assert gain.matrix.shape == (2, 2)
    loop: Any = scenario("nondiagonal").loop
    c, a = loop.controller.channels[0].gain, loop.controller.channels[0].dither.amplitude
    q = np.array(loop.field.q)
    assert gain.at(0.7) == pytest.approx(a * c * q / 0.7j)
    assert gain.sensitivity(0.7) == pytest.approx(np.linalg.inv(np.eye(2) + a * c * q / 0.7j))


def test_python_control_takes_it() -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    gain = loop_gain(force_actuated())
    found = gain.control(0)
    assert found(0.3j) == pytest.approx(gain.at(0.3)[0, 0])
    _, phase_margin, *_ = control.margin(found)
    w = control.margin(found)[3]
    response = 5 * (1j * w + 0.5) / ((1j * w) ** 2 * (1j * w + 3))  # g = α c k q = 5
    assert abs(response) == pytest.approx(1)
    assert phase_margin == pytest.approx(180 + np.degrees(np.angle(response)))
    coupled = loop_gain(scenario("nondiagonal").loop)
    assert coupled.control()(1j) == pytest.approx(coupled.at(1.0))
    with pytest.raises(es.InvalidDescription, match="coupled"):
        coupled.control(0)
    with pytest.raises(es.InvalidDescription, match="0 … 1"):
        gain.control(2)


def test_a_hidden_mode_is_found_and_stays_in_the_average() -> None:
    loop = velocity_actuated(
        **{
            "vehicle.axes.0": 1 / (s - 0.5),
            "controller.channels.0.compensator": (s - 0.5) / (s + 2),
        }
    )
    assert loop_gain(loop).hidden == (("x", pytest.approx(0.5)),)
    assert "hidden on x" in str(loop_gain(loop))
    assert average(loop).eigenvalues[0] == pytest.approx(0.5)
    assert hidden_modes(average(force_actuated()).frame) == ()


# --- static errors -------------------------------------------------------------------------------


def test_closed_forms_of_the_static_errors() -> None:
    a, c, q, k, z, p, eps, x, d = 0.1, 7.0, 1.0, 5.0, -0.5, -3.0, 0.2, 1.5, 0.3
    g = a * c * q * k
    lead = es.Lead(k, z, p)

    def total(plant: Any, compensator: Any = 1, **changes: Any) -> float:
        loop = velocity_actuated(
            **{
                "field.source": (x, 0.0),
                "vehicle.axes.0": plant,
                "vehicle.disturbance": (0.0, 0.0),
                "controller.channels.0.dither.amplitude": a,
                "controller.channels.0.gain": c,
                "controller.channels.0.compensator": compensator,
                **changes,
            }
        )
        return float(bias(loop).total[0])

    force = {"vehicle.disturbance": (d, 0.0)}
    assert total(1 / (s - eps)) == pytest.approx(eps * x / (a * c * q - eps))  # (43)
    assert total(1 / (s - eps), lead) == pytest.approx(p * eps * x / (g * z - p * eps))  # (54)
    assert total(1 / s, **force) == pytest.approx(d / (a * c * q))
    assert total(1 / s**2, lead, **force) == pytest.approx(d * p / (g * z))
    integral = (s + 0.25) / s
    assert total(1 / (s - eps), integral, **force) == 0
    both = total(1 / (s - eps), **force)
    assert both == pytest.approx((eps * x + d) / (a * c * q - eps))


def test_a_ramping_source() -> None:
    """Type 1 follows a ramp at −V/K_v, type 2 without error, type 0 not at all."""
    ramp = es.Moving(es.Quadratic((0, 0), (1.0, 0.5)), es.Line((0.1, 0.2)))
    first = bias(velocity_actuated(field=ramp))
    assert first.total == pytest.approx([-0.1 / 0.8, -0.2 / 0.4])
    assert "V_x" in str(first)
    assert bias(force_actuated(field=ramp)).total == pytest.approx([0, 0], abs=1e-15)
    held = bias(velocity_actuated(**{"field": ramp, "vehicle.axes.1": 1 / (s + 0.1)}))
    assert held.total[1] == -np.inf
    assert "not followed" in str(held)


def test_the_mean_of_the_orbit_comes_to_the_bias() -> None:
    """For every cause: the distance halves as ω doubles, or is rounding already."""
    loops = {
        "force": scenario("constant_force").loop,
        "pole": scenario("fig7").loop.replace({"field.source": (0.3, -0.2)}),
        "ramp": velocity_actuated(
            field=es.Moving(es.Quadratic((0, 0), (1.0, 0.5)), es.Line((0.1, 0.2)))
        ),
        "asymmetry": velocity_actuated(
            field=es.Expression("1 - x**2 - y**2 + x**3/5 + x*y**2/4"), start=(0.1, 0.1)
        ),
    }
    for name, loop in loops.items():
        predicted = bias(loop).total
        errors = []
        for frequency in (400, 800):
            orbit = periodic_orbit(loop.replace({"controller.frequency": frequency}))
            errors.append(float(np.abs(orbit.offset - predicted).max()))
        small = 2e-3 * np.abs(predicted).max()  # of second order in the asymmetry
        assert errors[0] / errors[1] == pytest.approx(2, rel=0.2) or errors[1] < small, name
        assert errors[1] < 0.05 * np.abs(predicted).max(), name


def test_asymmetry_by_quadrature_is_a_number() -> None:
    field = es.Expression("exp(-x**2 - y**2 + x**3/5)")
    loop = velocity_actuated(field=field, start=(0.1, 0.1))
    found = bias(loop)
    assert found.total == pytest.approx(average(loop).offset, abs=1e-15)
    assert found.total[0] > 1e-4
    assert "(nonlinearity)" in str(found)


def test_no_static_error_is_said() -> None:
    assert str(bias(velocity_actuated())).endswith("none")
    assert bias(velocity_actuated()).total == pytest.approx([0, 0], abs=0)


def test_a_loop_that_holds_the_mean_nowhere_is_refused() -> None:
    in_phase = velocity_actuated(**{"controller.channels.1.dither.phase": 0.0})
    with pytest.raises(es.InvalidDescription, match="does not hold the mean"):
        bias(in_phase)
    with pytest.raises(es.InvalidDescription, match="a gain is 0"):
        bias(velocity_actuated(**{"controller.channels.0.gain": 0.0}))
    with pytest.raises(es.InvalidDescription, match="flat to second order"):
        bias(velocity_actuated(field=es.Expression("-x**4 - y**2"), start=(0.0, 0.1)))
    with pytest.raises(es.InvalidDescription, match="zero at s = 0"):
        bias(velocity_actuated(**{"controller.channels.0.compensator": s / (s + 1)}))


def test_tracking_of_a_swinging_source_is_the_sensitivity() -> None:
    """S predicts 0.132 and 0.471, the exact orbit has 0.131 and 0.467."""
    loop = scenario("fig5").loop
    slow, fast = bias(loop).tracking
    assert (slow.frequency, fast.frequency) == pytest.approx((0.1, 0.2))
    assert abs(slow.error[0]) == pytest.approx(0.132, abs=5e-4)
    assert abs(fast.error[1]) == pytest.approx(0.471, abs=5e-4)
    orbit = periodic_orbit(loop)
    assert abs(orbit.harmonic(0.1)[0]) == pytest.approx(0.131, abs=5e-4)
    assert abs(orbit.harmonic(0.2)[1]) == pytest.approx(0.467, abs=5e-4)
    quick = loop.replace({"controller.frequency": 300})
    for swing, axis in ((slow, 0), (fast, 1)):
        exact = periodic_orbit(quick).harmonic(swing.frequency)[axis]
        # cos ω_m t is Re[1 e^{jω_m t}]: amplitudes are compared with their phases
        assert exact == pytest.approx(swing.error[axis], rel=2e-3)


def test_every_swing_of_a_path_is_tracked_by_itself() -> None:
    """Also beside a ramp, and where the frequencies have nothing in common."""
    still = es.Quadratic((0, 0), (1, 0.5))
    ramped = bias(velocity_actuated(field=es.Moving(still, ("0.1*t + sin(0.2*t)", "0"))))
    (swing,) = ramped.tracking
    assert abs(swing.error[0]) == pytest.approx(abs(0.2j / (0.2j + 0.8)))
    assert ramped.total == pytest.approx([-0.125, 0])
    free = ("sin(0.2*t)", "cos(0.1*sqrt(2)*t)")
    slow, fast = bias(velocity_actuated(field=es.Moving(still, free))).tracking
    assert abs(fast.error) == pytest.approx([abs(0.2j / (0.2j + 0.8)), 0])
    w = 0.1j * 2**0.5
    assert abs(slow.error) == pytest.approx([0, abs(w / (w + 0.4))])


def test_the_sensitivity_at_a_pole_of_the_loop_gain() -> None:
    gain = loop_gain(velocity_actuated())
    assert gain.sensitivity(0) == pytest.approx(np.zeros((2, 2)))
    assert gain.sensitivity(0.3) == pytest.approx(np.linalg.inv(np.eye(2) + gain.at(0.3)))


def test_a_turning_source_out_of_phase() -> None:
    path = es.Circle(1.0, 0.25, phase=float(pi / 3))
    found = bias(velocity_actuated(field=es.Moving(es.Quadratic((0, 0), (1, 0.5)), path)))
    (swing,) = found.tracking
    response = -0.25j / (0.25j + 0.8)  # −S(jω) of L = 0.8/s
    assert swing.error[0] == pytest.approx(response * np.exp(1j * np.pi / 3))
    back = es.Circle(1.0, -0.25, phase=float(pi / 3))  # cos and sin of π/3 − ω_m t
    (swing,) = bias(
        velocity_actuated(field=es.Moving(es.Quadratic((0, 0), (1, 0.5)), back))
    ).tracking
    assert swing.frequency == 0.25
    wanted = np.exp(-1j * np.pi / 3) * np.array([1, 1j])
    assert swing.source == pytest.approx(wanted)
    assert "tracking" in str(found)
