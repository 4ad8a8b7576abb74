"""The averaged sampled loop: exact transfer functions, modes and margins."""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import s
from extremum.theory.linear import loop_gain
from extremum.theory.sampled import critical_delay, sampled_loop_gain
from extremum.theory.sampled.held import held, realised, tustin

from .sampled_plain import Plain

APART: Any = {"controller.channels.1.ratio": "3/2"}
"""Two frequencies: axes that do not see each other."""


def polynomials(*given: list[float]) -> tuple[np.ndarray, ...]:
    return tuple(np.array(p) for p in given)


# --- hold, delay, Tustin -------------------------------------------------------------------------


def test_integrator_chains_are_those_of_the_textbook() -> None:
    """(1 − f/dt) z + f/dt over z (z − 1), and dt² (z + 1)/(2 (z − 1)²)."""
    dt, z = 0.3, np.array([1.2 + 0.4j, 0.3 - 0.9j])
    single = realised(*polynomials([1.0], [1.0, 0.0]))
    double = realised(*polynomials([1.0], [1.0, 0.0, 0.0]))
    assert held(single, dt, 0.0).at(z) == pytest.approx(dt / (z - 1))
    assert held(double, dt, 0.0).at(z) == pytest.approx(dt**2 * (z + 1) / (2 * (z - 1) ** 2))
    f = 0.2
    wanted = ((dt - f) * z + f) / (z * (z - 1)) / z**2
    assert held(single, dt, 2 * dt + f).at(z) == pytest.approx(wanted)


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.37, 1.3])
def test_the_held_plant_is_the_sum_of_its_aliases(delay: float) -> None:
    """G_d(e^(jω dt)) = Σ_m hold(jω_m) G(jω_m) e^(−jω_m T), ω_m = ω + 2πm/dt: Poisson's formula."""
    dt, w = 0.4, 1.7
    top, bottom = polynomials([2.0, 3.0], [1.0, 1.3, 0.0, 0.7])
    turns = 1j * (w + 2 * math.pi / dt * np.arange(-200_000, 200_001))
    hold = -np.expm1(-turns * dt) / (turns * dt)
    wanted = (
        hold * np.polyval(top, turns) / np.polyval(bottom, turns) * np.exp(-turns * delay)
    ).sum()
    found = held(realised(top, bottom), dt, delay).at(np.array([cmath.exp(1j * w * dt)]))
    assert found[0] == pytest.approx(wanted, rel=1e-9)


def test_tustin_is_exact_at_zero_and_at_its_frequency() -> None:
    dt, w = 0.02, 40.0
    top, bottom = polynomials([5.0, 2.5, 1.0], [1.0, 3.0, 0.5])
    law = tustin(realised(top, bottom), dt, w)
    z = np.array([1.0, cmath.exp(1j * w * dt), 0.4 + 0.8j])
    warped = w / math.tan(w * dt / 2) * (z - 1) / (z + 1)
    assert warped[1] == pytest.approx(1j * w)
    assert law.at(z) == pytest.approx(np.polyval(top, warped) / np.polyval(bottom, warped))


# --- what arrives of the dither ------------------------------------------------------------------


def test_the_dither_arrives_through_the_hold() -> None:
    """1/s: x/sin x e^(−jx); 1/s²: x² cos x/sin² x e^(−jx), x = ω dt/2."""
    dt = 0.01
    x = 30 * dt / 2
    single = sampled_loop_gain(velocity_actuated(), dt).received
    assert single.dither == pytest.approx([x / math.sin(x) * cmath.exp(-1j * x)] * 2)
    double = sampled_loop_gain(force_actuated(), dt).received
    wanted = x**2 * math.cos(x) / math.sin(x) ** 2 * cmath.exp(-1j * x)
    assert double.dither == pytest.approx([wanted] * 2)
    assert single.leads == pytest.approx(
        [math.atan(1 / 30) - x] * 2
    )  # the washout's and the hold's
    held_back = sampled_loop_gain(velocity_actuated(), dt, practice=es.Practice(delay=0.0))
    assert held_back.received.leads == pytest.approx([math.atan(1 / 30)] * 2)


def test_a_delay_turns_the_dither_and_the_references_may_follow() -> None:
    dt, delay, lag = 0.002, 0.0131, 0.02
    known = sampled_loop_gain(
        velocity_actuated(), dt, delay=delay, lag=lag, practice=es.Practice(delay=delay, lag=lag)
    )
    unknown = sampled_loop_gain(velocity_actuated(), dt, delay=delay, lag=lag)
    late = 30 * (dt / 2 + delay) + math.atan(30 * lag)
    assert unknown.received.leads[0] == pytest.approx(math.atan(1 / 30) - late, abs=1e-4)
    assert known.received.leads[0] == pytest.approx(math.atan(1 / 30), abs=1e-4)
    assert abs(known.received.dither[0]) == pytest.approx(1 / math.hypot(1, 30 * lag), rel=1e-3)


def test_demodulation_is_what_a_plain_loop_demodulates() -> None:
    """diag(c) M H against the mean of c ξ sin over whole periods, the position wobbling about x̃.

    26 samples a period, 8.7 of them late; one axis' reference knows, the other's does not.
    """
    dt, delay, count = 2 * math.pi / (30 * 26), 0.07, 26
    loop = velocity_actuated(**{"field.q": ((1.0, 0.3), (0.3, 0.5))})
    found = sampled_loop_gain(loop, dt, delay=delay, practice=es.Practice(delay=0.03))
    plain = Plain(dt, q=((1.0, 0.3), (0.3, 0.5)), delay=delay, known=0.03)
    # the first samples of an open loop (gain 0): the position stays on the dither about its start
    still = Plain(dt, q=plain.q, delay=delay, gain=(0.0, 0.0))
    offset = np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.2]])
    steps = zip(range(700 * count), still.steps(offset), strict=False)
    position = np.array([x for _, x in steps])
    t = np.arange(len(position)) * dt
    whole, part = divmod(delay, dt)
    u = np.diff(position, axis=0) / dt  # held: the way between samples is straight
    base = int(whole) + 1
    seen = position[:-base] + u[: len(position) - base] * (dt - part)
    J = -np.einsum("kli,ij,klj->kl", seen, np.array(plain.q), seen)  # noqa: N806
    xi = np.zeros_like(J)
    warped = 30 / math.tan(15 * dt)
    for k in range(1, len(J)):
        xi[k] = ((warped - 1) * xi[k - 1] + warped * (J[k] - J[k - 1])) / (warped + 1)
    angle = 30 * t[base:, None] + np.array(plain.phase) - 30 * (dt / 2 + 0.03)
    last = slice(-100 * count, None)
    mean = 10 * np.einsum("kl,ki->li", xi[last], np.sin(angle[last])) / (100 * count)
    slope = (mean[1:] - mean[0]).T / 0.2
    assert found.slope == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_a_sensor_is_heard_at_its_frequency() -> None:
    tau = 0.05
    loop = velocity_actuated(sensor=1 / (tau * s + 1))
    with_sensor, without = (sampled_loop_gain(x, 0.004) for x in (loop, velocity_actuated()))
    heard = with_sensor.received.dither / without.received.dither
    assert heard == pytest.approx([1 / (30j * tau + 1)] * 2)


def test_a_probe_is_an_input() -> None:
    """α ω cos ωt through the held 1/s, stated as a probe or as a dither."""
    probe = {"controller.channels.0.dither": es.Probe(0.08 * 30, phase=np.pi / 2),
             "controller.channels.0.reference": es.Reference(0.0)}  # fmt: skip
    stated = sampled_loop_gain(velocity_actuated(**probe), 0.005)
    assert stated.slope == pytest.approx(sampled_loop_gain(velocity_actuated(), 0.005).slope)


# --- the loop gain -------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [velocity_actuated, force_actuated])
def test_fast_sampling_gives_the_continuous_loop(make: Any) -> None:
    """L_d(e^(jω dt)) − L(jω) e^(−jω dt/2) is of order dt² where the references know the hold."""
    loop, known = make(**{"controller.washout": 1e-9}), es.Practice(delay=0.0)
    errors = []
    for dt in (0.02, 0.01, 0.005):
        half = cmath.exp(-0.7j * dt / 2)
        errors.append(
            np.abs(
                sampled_loop_gain(loop, dt, practice=known).at(0.7) / half - loop_gain(loop).at(0.7)
            ).max()
        )
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert slopes == pytest.approx([2, 2], abs=0.05)


def test_the_formula_for_plots_lacks_only_the_aliases() -> None:
    loop = force_actuated(**{"controller.channels.0.compensator": 1, **APART})
    gain = sampled_loop_gain(loop, 0.003, delay=0.0475, lag=0.1)
    turn = 2.0j
    wanted = -gain.slope[0, 0] / turn**2 / (0.1 * turn + 1) * cmath.exp(-turn * (0.0475 + 0.0015))
    assert gain.approximate(2.0)[0, 0] == pytest.approx(wanted, rel=1e-5)
    assert gain.at(2.0)[0, 0] == pytest.approx(wanted, rel=1e-5)


def test_one_integrator_with_a_delay_has_the_roots_of_its_polynomial() -> None:
    """z^n (z − 1) + g dt for whole samples, z^(n+1) (z − 1) + g ((dt − f) z + f) between."""
    dt = 0.004
    for n, f in ((0, 0.0), (3, 0.0), (3, 0.0015), (150, 0.001)):
        gain = sampled_loop_gain(
            velocity_actuated(**APART), dt, delay=n * dt + f, practice=es.Practice(delay=n * dt + f)
        )
        found = gain.modes
        for g in -gain.slope.diagonal():
            polynomial = np.zeros(n + 3)
            polynomial[:2] = 1, -1
            polynomial[-2:] += g * (dt - f), g * f
            roots = np.roots(np.trim_zeros(polynomial, "b"))
            leading = np.log(roots[np.argsort(-np.abs(roots))][:3]) / dt
            assert np.abs(found[:, None] - leading).min(axis=0).max() < 1e-6


def test_double_integrators_have_the_roots_of_their_polynomial() -> None:
    """(z − 1)² (…) with the lead's Tustin form, written out."""
    dt, w = 0.01, 30.0
    gain = sampled_loop_gain(force_actuated(**APART), dt)
    g = -float(gain.slope[0, 0])
    warped = w / math.tan(w * dt / 2)
    lead = 5 * np.array([warped + 0.5, -(warped - 0.5)]), np.array([warped + 3, -(warped - 3)])
    plant = dt**2 / 2 * np.array([1.0, 1.0]), np.array([1.0, -2.0, 1.0])
    closed = np.polyadd(np.polymul(lead[1], plant[1]), g * np.polymul(lead[0], plant[0]))
    modes = np.log(np.roots(closed).astype(complex)) / dt
    assert np.abs(gain.modes[:, None] - modes).min(axis=0) == pytest.approx([0] * 3, abs=1e-6)


def test_a_mode_hidden_between_compensator_and_vehicle_is_seen() -> None:
    loop = velocity_actuated(
        **{
            "vehicle.axes.0": 1 / (s - 0.5),
            "controller.channels.0.compensator": (s - 0.5) / (s + 2),
        }
    )
    gain = sampled_loop_gain(loop, 1e-3)
    assert not gain.stable
    assert gain.modes[0] == pytest.approx(0.5, rel=1e-3)
    assert math.isnan(gain.margins.phase)
    resting = velocity_actuated(**{"controller.channels.0.compensator": s / (s + 2)})
    for delay in (0.0, 0.013, 0.4):  # its mode at z = 1 is neither observable nor controllable
        assert not sampled_loop_gain(resting, 1e-3, delay=delay).stable
    assert critical_delay(resting, 0.01, known=True, high=1.0).stable == ()


# --- margins -------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, APART, {"field.q": ((1.0, 0.3), (0.3, 0.6))}])
def test_at_its_gain_margin_the_loop_is_on_the_boundary(changes: Any) -> None:
    late: Any = {"delay": 0.2, "practice": es.Practice(delay=0.2)}

    def scaled(factor: float) -> es.Loop:
        gains = {f"controller.channels.{i}.gain": 10 * factor for i in (0, 1)}
        return force_actuated(**changes, **gains)

    low, high = sampled_loop_gain(force_actuated(**changes), 0.004, **late).margins.gain
    assert low == 0.0
    assert sampled_loop_gain(scaled(high * 0.9999), 0.004, **late).stable
    assert not sampled_loop_gain(scaled(high * 1.0001), 0.004, **late).stable


def test_an_unstable_pole_has_a_gain_margin_downwards() -> None:
    """1/(s − ε): αcq > ε, to the factor by which the washout reduces the gain."""
    pole = {"vehicle.axes.0": 1 / (s - 0.2), "controller.channels.0.dither.through": 1 / s}
    loop = velocity_actuated(**APART, **pole)
    low, _ = sampled_loop_gain(loop, 1e-3).margins.gain
    assert low == pytest.approx(0.2 / 0.8, rel=2e-3)


def test_margins_of_one_axis_are_those_of_python_control() -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    loop = force_actuated(**APART)
    gain = sampled_loop_gain(loop, 0.01, delay=0.125, practice=es.Practice(delay=0.125))
    w = np.geomspace(0.01, math.pi / 0.01, 3000)
    bode = [gain.control(axis)(np.exp(0.01j * w)) for axis in (0, 1)]
    parts = [(np.abs(L), np.degrees(np.unwrap(np.angle(L))), w) for L in bode]
    one = [control.stability_margins(part) for part in parts]
    margins = gain.margins
    assert margins.gain[1] == pytest.approx(min(m[0] for m in one), rel=1e-3)
    assert math.degrees(margins.phase) == pytest.approx(min(m[1] for m in one), rel=1e-3)
    whole = gain.control()
    z = cmath.exp(0.013j)
    assert whole(z) == pytest.approx(gain.response(np.array([z]))[0], rel=1e-9)
    assert whole.dt == 0.01
    with pytest.raises(es.InvalidDescription, match="coupled"):
        sampled_loop_gain(force_actuated(), 0.01).control(0)
    with pytest.raises(es.InvalidDescription, match="0 … 1"):
        gain.control(2)


def test_a_phase_lead_may_be_what_ends_stability() -> None:
    """A mass on a spring under s²/(s + 5)²: where |L| rises through 1 its phase is beyond 90°."""
    spring = {f"vehicle.axes.{i}": 1 / (s**2 + 0.1 * s + 1) for i in (0, 1)}
    law = {f"controller.channels.{i}.compensator": 8 * s**2 / (s + 5) ** 2 for i in (0, 1)}
    start = {"start": (0.0, 0.0), "field.q": (1.0, 1.0), "controller.washout": 1e-9}
    gain = sampled_loop_gain(
        force_actuated(**spring, **law, **start, **APART), 1e-3, practice=es.Practice(delay=0.0)
    )
    w = np.linspace(0.5, 3.0, 200_001)
    response = 8.0 * (1j * w) ** 2 / (1 - w**2 + 0.1j * w) / (1j * w + 5) ** 2
    crossed = np.flatnonzero(np.diff(np.abs(response) > 1))
    wanted = np.pi - np.abs(np.angle(response[crossed]))
    assert np.angle(response[crossed[0]]) > np.pi / 2  # a lead of less than 90° brings it to −1
    assert gain.margins.phase == pytest.approx(wanted.min(), rel=0.01)
    assert gain.margins.crossover[0] == pytest.approx(w[crossed[np.argmin(wanted)]], rel=0.01)


def test_a_delay_beyond_the_delay_margin_ends_stability() -> None:
    known = es.Practice(delay=0.0)
    gain = sampled_loop_gain(force_actuated(), 0.002, practice=known)
    late = gain.margins.delay
    for factor, stable in ((0.999, True), (1.001, False)):
        found = sampled_loop_gain(
            force_actuated(), 0.002, delay=factor * late, practice=es.Practice(delay=factor * late)
        )
        assert found.stable == stable


# --- words ---------------------------------------------------------------------------------------


def test_what_is_printed() -> None:
    known = es.Practice(delay=0.0)
    text = str(sampled_loop_gain(force_actuated(), 0.02, delay=0.01, practice=known))
    assert "dt = 0.02 s, delay 0.01 s; references account for the hold's 0.01 s and 0 s" in text
    assert "coupled axes: x and y" in text
    assert "10.5 samples per period of the fastest dither are few" in text
    assert "1/s: stable" in text
    assert "margins: gain × up to" in text
    unstable = str(sampled_loop_gain(force_actuated(), 0.02, delay=0.04))
    assert "delay 0.04 s; references account for none of it" in unstable
    assert "not stable" in unstable
    assert "margins" not in unstable
    growing = sampled_loop_gain(force_actuated(), 0.02, delay=0.04).margins
    assert str(growing) == "not stable: no margins"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dt": 0.0}, "dt = 0.0: must be a finite number greater than 0"),
        ({"dt": 0.04}, "dt = 0.04: gives 5.24 samples in a period .*take dt ≤ 0.03491 s"),
        ({"dt": 0.01, "delay": -1}, "delay = -1: must not be negative"),
        ({"dt": 0.01, "lag": -1}, "lag = -1: must not be negative"),
        ({"dt": 0.01, "delay": math.nan}, "delay = nan: must be a finite number"),
        ({}, "dt: must be given: .* only a SampledLoop says"),
        ({"dt": 0.01, "practice": 0.02}, "practice = 0.02: must be a Practice"),
        (
            {"dt": 0.01, "practice": es.Practice(scale=es.LogScale(1.0))},
            "practice.scale = .*leave it",
        ),
    ],
)
def test_bad_numbers(arguments: Any, message: str) -> None:
    with pytest.raises(es.InvalidDescription, match=message):
        sampled_loop_gain(velocity_actuated(), **arguments)
