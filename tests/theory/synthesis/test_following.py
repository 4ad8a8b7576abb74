"""Sources that move, forces that push and noise that shakes: what designs for them leave."""

from __future__ import annotations

import math

import numpy as np
import pytest

import extremum as es
from extremum import s
from extremum.requirements import Requirements

from ..plain import Loop, Vector
from . import by_hand, exactly
from .asked import designed, on, required, unstable
from .test_design import rule

SPEED = 0.02


def paced(loop: es.Loop, omega: float) -> es.Loop:
    """The same averaged loop with another dither: h/ω stays, and with it every reference."""
    controller = loop.controller
    assert isinstance(controller, es.GradientES)
    h = controller.washout * omega / controller.frequency
    return loop.replace({"controller.frequency": omega, "controller.washout": h})


def moving(loop: es.Loop, path: es.Path) -> es.Loop:
    return loop.replace({"field": es.Moving(loop.field, path)})


def lag(design: es.Design, velocity: tuple[float, ...], duration: float) -> Vector:
    """The mean of position − source over the last period of a run, at four times ω."""
    loop = moving(paced(design.loop, 4 * design.frequency), es.Line(velocity))
    period, axes, each = math.pi / (2 * design.frequency), len(velocity), 24
    periods = math.ceil(duration / period)
    times = np.append(0.0, (periods + np.arange(each) / each) * period)
    run = es.simulate(loop, times[-1], samples=times, tol=1e-10)
    return (run.position - run.source).values[1:].reshape(each, axes).mean(axis=0)


# --- a ramp -----------------------------------------------------------------------------------


def test_a_ramp_is_followed_without_a_lag_by_a_design_for_it() -> None:
    """Without: v/K_v behind, K_v = g for a gain on 1/s. With: nothing that a mean could show."""
    velocity = (SPEED, -SPEED)
    wanted = required(**on(1 / s, 1 / s))
    plain, ramped = es.design(wanted), es.design(wanted.replace({"motion": es.Ramp()}))
    behind = lag(plain, velocity, 10.0)
    gain = plain.plan.shapes[0].gain
    assert behind == pytest.approx(np.array(velocity) / -gain, rel=0.05)
    assert np.abs(lag(ramped, velocity, 20.0)).max() < 1e-6


def test_a_ramp_on_an_unstable_pole_takes_two_integrators() -> None:
    """The holding input −ε x* grows with time: a PI follows it a constant behind."""
    wanted = required(unstable(0.3), settling_time=6.0, dither_limit=0.2, curvature=((0.5, 1.0),))
    plain, ramped = es.design(wanted), es.design(wanted.replace({"motion": es.Ramp()}))
    assert [d.plan.families[0].integrators for d in (plain, ramped)] == [1, 2]
    shape = plain.plan.shapes[0]
    slope = shape.gain * shape.above[-1]  # s C(s) at 0: x̃ = D(0) v/(g lim s C)
    expected = 0.3 * SPEED / slope
    assert lag(plain, (SPEED,), 25.0)[0] == pytest.approx(expected, rel=0.03)
    assert abs(lag(ramped, (SPEED,), 30.0)[0]) < 1e-5


# --- a period ---------------------------------------------------------------------------------

OMEGA = 0.3


@pytest.fixture(scope="module")
def pair() -> tuple[es.Design, es.Design]:
    """Two axes without and with resonators at Ω and 2Ω."""
    wanted = required(**on(1 / s, 1 / s)).replace({"curvature": ((0.8, 1.2),) * 2})
    resonant = wanted.replace({"motion": es.Periodic(OMEGA, up_to=2 * OMEGA)})
    return es.design(wanted), es.design(resonant)


def errors(design: es.Design, path: es.Path, omega: float) -> Vector:
    """|x̃| at Ω on the first axis and at 2Ω on the second, ω taken to a multiple of Ω."""
    near = paced(design.loop, omega * round(3 * design.frequency / omega))
    orbit = es.periodic_orbit(moving(near, path))
    assert orbit.stable
    return np.abs([orbit.harmonic(omega)[0], orbit.harmonic(2 * omega)[1]])


def test_a_figure_eight_is_followed_by_resonators(pair: tuple[es.Design, es.Design]) -> None:
    """On the exact orbit: |S(jΩ)| a without them, and far less with them."""
    path = es.FigureEight(amplitude=0.05, frequency=OMEGA, phase=1.5 * math.pi)
    without, with_them = (errors(design, path, OMEGA) for design in pair)
    gain = pair[0].plan.shapes[0].gain
    expected = [0.05 * w / math.hypot(w, gain) for w in (OMEGA, 2 * OMEGA)]
    assert without == pytest.approx(expected, rel=0.04)
    assert (with_them < 0.01 * without).all()


def test_a_circle_of_another_frequency_is_not_followed_as_well(
    pair: tuple[es.Design, es.Design],
) -> None:
    """S vanishes at Ω, and not at 1.4 Ω."""
    at, beside = (errors(pair[1], es.Circle(0.05, f), f)[0] for f in (OMEGA, 1.4 * OMEGA))
    assert at < 0.02 * beside


def test_following_does_not_ask_for_more_than_the_input_has() -> None:
    """A ramp as fast as stated, and sines as wide: |u| stays below its limit."""
    wanted = required(**on(1 / s, 1 / s), input_limit=3.0)
    for motion, path in (
        (es.Ramp(velocity=0.5), es.Line((0.5, -0.5))),
        (es.Periodic(0.5, amplitude=0.8), es.Along(("0.8*sin(0.5*t)", "-0.8*sin(0.5*t)"))),
    ):
        design = es.design(wanted.replace({"motion": motion}))
        authority = rule(design, "authority x")
        assert authority.value <= authority.limit == 3.0
        run = es.simulate(moving(design.loop, path), 30.0, tol=1e-9)
        assert run.attrs["outcome"] == "completed"
        late = run.input.values[run.time > 15.0]
        assert np.abs(late).max() <= 3.0


# --- a constant force, and what stays without integral action ---------------------------------


def test_a_force_leaves_no_error() -> None:
    """The mean over the last period of a run from the source, force at its ends."""
    design = designed("forces")
    period, each = 2 * math.pi / design.frequency, 24
    times = np.append(0.0, (math.ceil(30 / period) + np.arange(each) / each) * period)
    for sign in (1, -1):
        point = {"vehicle.disturbance.0": 0.1 * sign, "vehicle.disturbance.1": 0.2}
        run = es.simulate(design.at(point), times[-1], samples=times, tol=1e-10)
        error = (run.position - run.source).values[1:].mean(axis=0)
        assert np.abs(error).max() < 1e-6


def test_a_force_leaves_an_error_without_an_integrator() -> None:
    """d/g on 1/s."""
    design = es.design(required(force=0.1, zero_bias=False))
    gain = design.plan.shapes[0].gain
    orbit = es.periodic_orbit(paced(design.loop, 4 * design.frequency))
    assert orbit.offset[0] == pytest.approx(0.1 / gain, rel=0.01)
    assert rule(design, "bias x").value == pytest.approx(0.1 / (gain / 2))


# --- noise ------------------------------------------------------------------------------------

RUNS = 1500


def shaken(loop: Loop, noise: float, step: float, duration: float, seed: int) -> Vector:
    """Many runs of the exact loop under noise that is constant over each step: x̃ at the end.

    Runge and Kutta's fourth order, from the state on the dither at the source.
    """
    rng = np.random.default_rng(seed)
    a, f, _, p = loop.matrices
    state = np.tile(loop.steady(0.0), (RUNS, 1))
    state[:, -1] = loop.field.value(loop.dither.imag)
    probes, omegas = loop.probes, loop.frequencies

    def rate(t: float, y: Vector, shake: Vector) -> Vector:
        turn = np.exp(1j * omegas * t)
        xi = loop.field.value(y @ p.T - loop.source) + shake - y[:, -1]
        pushed = f @ ((probes * turn).imag + loop.forces)
        return y @ a.T + pushed + xi[:, None] * loop.directions(turn)

    steps = math.ceil(duration / step)
    for k in range(steps):
        t, shake = k * step, noise / math.sqrt(step) * rng.standard_normal(RUNS)
        first = rate(t, state, shake)
        second = rate(t + step / 2, state + step / 2 * first, shake)
        third = rate(t + step / 2, state + step / 2 * second, shake)
        last = rate(t + step, state + step * third, shake)
        state = state + step / 6 * (first + 2 * second + 2 * third + last)
    dither = (loop.dither * np.exp(1j * omegas * steps * step)).imag
    return state @ p.T - loop.source - dither


NOISY: dict[str, Requirements] = {
    "gain": required(noise=4e-4),
    "lead": required(1 / s**2, noise=2e-4, settling_time=8.0),
    "wide": required(noise=4e-4, curvature=((0.3, 3.0),), force=0.2),
    "three": required(**on(1 / s, 1 / s, 1 / s), noise=4e-4),
}


def at_lowest(name: str) -> tuple[es.Design, Loop]:
    design = es.design(NOISY[name])
    lowest = {f"field.q.{i}": low for i, (low, _) in enumerate(NOISY[name].curvature)}
    return design, exactly.plain_of(design.loop.replace(lowest))


@pytest.mark.parametrize("name", NOISY)
def test_the_noise_rule_is_what_many_noisy_runs_show(name: str) -> None:
    """At the lowest curvature, where noise shakes most; the sample deviation is known to 2 %."""
    design, plain = at_lowest(name)
    step = 2 * math.pi / plain.frequencies.max() / 16
    ends = shaken(plain, design.requirements.noise, step, 2.0 * design.duration, seed=7)
    for axis in range(len(plain.axes)):
        found = rule(design, f"noise {'xyz'[axis]}").value
        assert found == pytest.approx(ends[:, axis].std(), rel=0.09)


@pytest.mark.parametrize("name", NOISY)
def test_the_noise_rule_is_lyapunov_s_variance(name: str) -> None:
    """n² ‖T‖₂²/(2 (α q)²): washed out with the signal, the noise takes the same m."""
    design, plain = at_lowest(name)
    for i, axis in enumerate(plain.axes):
        q = float(plain.field.Q[i, i])  # pyright: ignore[reportAttributeAccessIssue]
        m = plain.frequencies[i] / math.hypot(plain.frequencies[i], plain.washout)
        loop = by_hand.Axis(axis.vehicle, axis.compensator, axis.amplitude * axis.gain * q * m)
        expected = design.requirements.noise * math.sqrt(by_hand.spread(loop) / 2)
        found = rule(design, f"noise {'xyz'[i]}").value
        assert found == pytest.approx(expected / (axis.amplitude * q), rel=0.02)


def test_the_noise_rule_of_a_gain_is_the_known_formula() -> None:
    """Var = c σ² Δt/(4 α q) for C = 1, G = 1/s, c demodulating what the washout leaves."""
    design = es.design(NOISY["gain"])
    channel = design.controller.channels[0]
    h, omega = design.controller.washout, design.frequency
    m = omega / math.hypot(omega, h)
    expected = math.sqrt(channel.gain * m * 4e-4**2 / (4 * 0.1 * 0.5))
    assert rule(design, "noise x").value == pytest.approx(expected, rel=0.015)


def test_what_a_sensor_takes_away_is_missed_in_the_noise() -> None:
    """The noise comes after F: rms x̃ grows by 1/|F(jω)|."""
    plain, sensed = (
        es.design(required(noise=4e-4, settling_time=4.0, sensor=f)) for f in (1, 1 / (0.2 * s + 1))
    )
    assert plain.plan.shapes == sensed.plan.shapes
    ratio = rule(sensed, "noise x").value / rule(plain, "noise x").value
    assert ratio == pytest.approx(math.hypot(1, 0.2 * sensed.frequency), rel=1e-6)


def test_an_accuracy_limits_the_noise() -> None:
    design = es.design(required(noise=4e-4, accuracy=0.02))
    found = rule(design, "noise x")
    assert (found.limit, found.decided_by) == (0.02, "accuracy")
    assert found.value < 0.02
    free = rule(es.design(required(noise=4e-4)), "noise x")
    assert (free.limit, free.decided_by) == (math.inf, "noise")
    assert free.value == found.value
