"""Designs under a dead time and behind a sensor, on loops that truly have them, by hand."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import extremum as es
from extremum import s

from ..plain import Loop, Vector
from . import by_hand, exactly
from .asked import on, required
from .test_design import rule

STEPS = 40
"""Steps of Runge and Kutta's method per dither period, at least."""


def delayed_run(loop: Loop, delay: float, displacement: Vector, duration: float) -> Vector:
    """Means of x̃ over each dither period of a loop whose controller receives J(t − T).

    Fixed steps, T a whole number of them; J between two stored samples by the cubic through four.
    """
    behind = math.ceil(STEPS * delay / loop.period)
    step = delay / behind
    a, f, _, p = loop.matrices
    start = loop.steady(0.0) + exactly.displaced(loop, displacement)
    start += exactly.displaced(loop, np.array(loop.source, dtype=float))
    first = float(loop.field.value(p @ start - loop.source))
    start[-1] = first
    heard = [first] * (behind + 2)  # J at −T − step, −T, … 0

    def rate(t: float, y: Vector, signal: float) -> Vector:
        turn = np.exp(1j * loop.frequencies * t)
        pushed = f @ ((loop.probes * turn).imag + loop.forces)
        return a @ y + pushed + loop.directions(turn) * (signal - y[-1])

    y, found = start, []
    for k in range(math.ceil(duration / step)):
        t = k * step
        before, now, after, later = heard[k : k + 4]
        between = (9 * (now + after) - before - later) / 16
        slope = rate(t, y, now)
        second = rate(t + step / 2, y + step / 2 * slope, between)
        third = rate(t + step / 2, y + step / 2 * second, between)
        last = rate(t + step, y + step * third, after)
        y = y + step / 6 * (slope + 2 * second + 2 * third + last)
        if not np.isfinite(y).all() or np.abs(y).max() > 1e6:
            return np.full((1, len(p)), np.inf)
        heard.append(float(loop.field.value(p @ y - loop.source)))
        dither = (loop.dither * np.exp(1j * loop.frequencies * (t + step))).imag
        found.append(p @ y - loop.source - dither)
    per = round(loop.period / step)
    path = np.array(found)
    periods = len(path) // per
    return path[: periods * per].reshape(periods, per, -1).mean(axis=1)


def uncorrected(loop: Loop, turn: float) -> Loop:
    """The same loop with a phase taken out of every reference."""
    axes = tuple(axis._replace(reference=(axis.reference or 0.0) - turn) for axis in loop.axes)
    return replace(loop, axes=axes)


@pytest.mark.parametrize(
    ("delay", "settling", "axes"),
    [(0.1, 4.0, 1), (0.2, 2.0, 1), pytest.param(0.15, 4.0, 2, marks=pytest.mark.slow)],
)
def test_a_loop_with_a_true_dead_time_settles(delay: float, settling: float, axes: int) -> None:
    wanted = required(**on(*(1 / s,) * axes), delay=delay, settling_time=settling).replace(
        {"curvature": ((0.7, 1.0),) * axes}
    )
    design = es.design(wanted)
    for q in (0.7, 1.0):
        point = {f"field.q.{i}": q for i in range(axes)}
        plain = exactly.plain_of(design.loop.replace(point))
        r = 0.1 * plain.frequencies[0] / (abs(plain.axes[0].gain) * q)
        means = delayed_run(plain, delay, np.full(axes, r / math.sqrt(axes)), 3 * settling)
        far = np.flatnonzero(np.linalg.norm(means, axis=1) > 0.02 * r)
        assert (far[-1] + 1) * plain.period < 1.5 * settling + plain.period
        assert np.abs(means[-1]).max() < 2e-3 * r


def test_references_that_are_not_corrected_for_it_lose_the_loop() -> None:
    """ωT near 220° for T = 0.2 s: demodulated the wrong way round, it runs away."""
    wanted = required(delay=0.2, settling_time=2.0, curvature=((0.7, 1.0),))
    design = es.design(wanted)
    plain = exactly.plain_of(design.loop)
    turn = design.frequency * 0.2
    assert math.cos(turn) < -0.5
    r = 0.02
    right = delayed_run(plain, 0.2, np.array([r]), 4.0)
    wrong = delayed_run(uncorrected(plain, -turn), 0.2, np.array([r]), 4.0)
    assert np.abs(right[-1]).max() < 0.02 * r
    assert np.abs(wrong[-1]).max() > 5 * r


def test_a_dead_time_turns_the_reference_and_slows_the_loop() -> None:
    wanted = required(delay=0.1, curvature=((0.7, 1.0),))
    design = es.design(wanted)
    channel = design.controller.channels[0]
    assert channel.reference is not None
    omega, h = design.frequency, design.controller.washout
    turned = cmath.phase(1j * omega / (1j * omega + h) * cmath.exp(-0.1j * omega))
    assert channel.reference.phase == pytest.approx(turned, abs=1e-8)
    assert rule(design, "reference x").decided_by == "washout, delay"
    assert math.degrees(turned) == pytest.approx(rule(design, "reference x").value, abs=1e-6)
    gain = design.plan.shapes[0].gain
    loop = by_hand.Axis(((1.0,), (1.0, 0.0)), ((1.0,), (1.0,)), gain * math.sqrt(1 / 0.7), 0.1)
    sensitivity = by_hand.sensitivity(loop, np.geomspace(0.1, 200, 4000))
    assert rule(design, "sensitivity x").value == pytest.approx(np.abs(sensitivity).max(), rel=0.03)


def test_a_sensor_is_turned_back_and_made_up_for() -> None:
    """Behind 1/(0.1 s + 1): ψ − φ = atan(h/ω) − atan(0.1 ω), c larger by √(1 + (0.1 ω)²)."""
    plain, sensed = (es.design(required(sensor=f)) for f in (1, 1 / (0.1 * s + 1)))
    omega, h = sensed.frequency, sensed.controller.washout
    channel = sensed.controller.channels[0]
    assert channel.reference is not None
    assert channel.reference.phase == pytest.approx(
        math.atan2(h, omega) - math.atan(0.1 * omega), abs=1e-8
    )
    ratio = channel.gain / plain.controller.channels[0].gain
    same = sensed.plan.shapes[0].gain / plain.plan.shapes[0].gain
    assert ratio == pytest.approx(same * math.hypot(1, 0.1 * omega), rel=1e-4)
    assert sensed.loop.sensor.poles == pytest.approx((-10.0,))


def test_a_loop_with_a_sensor_settles() -> None:
    """f' = (J − f)/τ beside the loop's own equations, DOP853."""
    design = es.design(required(sensor=1 / (0.1 * s + 1)))
    for q in (0.5, 2.0):
        plain = exactly.plain_of(design.loop.replace({"field.q.0": q}))
        a, f, _, p = plain.matrices
        r = 0.1 * design.frequency / (abs(plain.axes[0].gain) * q)

        def rate(t: float, y: Vector) -> Vector:
            turn = np.exp(1j * plain.frequencies * t)  # noqa: B023
            signal = plain.field.value(p @ y[:-1])  # noqa: B023
            pushed = f @ (plain.probes * turn).imag  # noqa: B023
            own = a @ y[:-1] + pushed + plain.directions(turn) * (y[-1] - y[-2])  # noqa: B023
            return np.append(own, (signal - y[-1]) / 0.1)

        start = plain.steady(0.0) + exactly.displaced(plain, np.array([r]))
        start[-1] = signal = float(plain.field.value(p @ start))
        periods = math.ceil(8.0 / plain.period)
        times = np.linspace(0, periods * plain.period, periods * 24 + 1)
        run = solve_ivp(
            rate, (0, times[-1]), [*start, signal], "DOP853", t_eval=times, rtol=1e-9, atol=1e-12
        )
        x = (p @ run.y[:-1])[0]
        means = x[:-1].reshape(periods, 24).mean(axis=1)
        far = np.flatnonzero(np.abs(means) > 0.02 * r)
        assert (far[-1] + 1) * plain.period < 1.5 * 4.0 + plain.period
        assert abs(means[-1]) < 2e-3 * r


@pytest.mark.slow
def test_exponents_behind_a_badly_scaled_sensor_are_those_confirmed() -> None:
    """The states of a dead time's Padé form differ by many orders, over 768 segments."""
    design = es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=(1 / s, 1 / s)),
            curvature=((1, 1), (0.5, 0.5)),
            dither_limit=0.1,
            settling_time=8,
            sensor=1 / (0.2 * s + 1),
            delay=0.03,
            quadrature=False,
        )
    )
    orbit = es.periodic_orbit(design.loop)
    assert orbit.stable
    assert orbit.exponents[0].real == pytest.approx(design.confirmations[0].exponent, rel=1e-6)
