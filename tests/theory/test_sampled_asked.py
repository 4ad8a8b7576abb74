"""A `SampledLoop` says itself what the theory of the sampled loop asks for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import s
from extremum.theory.sampled import (
    critical_delay,
    critical_dt,
    noise_variance,
    sampled_loop_gain,
)

KNOWN = es.Practice(delay=0.013, lag=0.02)
LATE: Any = {
    "sensor": es.Sensor(delay=0.01, noise=0.6),
    "actuator": es.Actuator(delay=0.003, lag=0.02),
    "practice": KNOWN,
}


def sampled(loop: es.Loop, dt: float = 0.002, **parts: Any) -> es.SampledLoop:
    return es.SampledLoop.of(loop, es.Sampling(dt, **parts))


def test_its_numbers_are_those_that_are_asked_for() -> None:
    """dt, both delays together, the lag, the practice and σ, as if they had been given by hand."""
    loop = sampled(velocity_actuated(), **LATE)
    by_hand: Any = {"lag": 0.02, "practice": KNOWN}
    late = {**by_hand, "delay": 0.013}
    plain = velocity_actuated()
    gain, wanted = sampled_loop_gain(loop), sampled_loop_gain(plain, 0.002, **late)
    assert gain.modes == pytest.approx(wanted.modes)
    assert str(gain) == str(wanted)
    assert str(critical_delay(loop)) == str(critical_delay(plain, 0.002, **by_hand))
    assert str(critical_dt(loop)) == str(critical_dt(plain, **late))
    assert str(noise_variance(loop)) == str(noise_variance(plain, 0.002, 0.6, **late))


def test_what_is_given_takes_their_place() -> None:
    loop = sampled(force_actuated(), **LATE)
    given: Any = {"delay": 0.0, "lag": 0.0, "practice": es.Practice()}
    assert str(sampled_loop_gain(loop, 0.004, **given)) == str(
        sampled_loop_gain(force_actuated(), 0.004)
    )
    assert str(noise_variance(loop, 0.004, 0.15, **given)) == str(
        noise_variance(force_actuated(), 0.004, 0.15)
    )


def test_a_lag_of_the_sensor_becomes_part_of_its_transfer_function() -> None:
    """At ω the dither arrives by 1/(1 + jωτ), and F(jω) besides."""
    own = {"sensor": 1 / (0.01 * s + 1)}
    plain = sampled_loop_gain(velocity_actuated(), 0.002).received.dither
    found = sampled_loop_gain(sampled(velocity_actuated(**own), sensor=es.Sensor(lag=0.03)))
    assert found.received.dither == pytest.approx(plain / (1 + 0.3j) / (1 + 0.9j))
    same = sampled(velocity_actuated(**own), sensor=es.Sensor(lag=es.Lag(0.03, 0.03)))
    assert sampled_loop_gain(same).modes == pytest.approx(found.modes)


def test_a_late_and_lagging_sensor_against_a_run() -> None:
    """The dither in the samples of a run: vehicle on the dither, gains of 0, J = J₀ + g·p."""
    dt, count = 2 * math.pi / (30 * 60), 60
    still = {f"controller.channels.{i}.gain": 1e-12 for i in (0, 1)}
    parts: Any = {"sensor": es.Sensor(lag=0.05, delay=0.02), "actuator": es.Actuator(delay=0.013)}
    loop = velocity_actuated(**still, start=(5, 5), **{"field.q": (1.0, 1e-9)})
    periods = 40
    run = es.simulate_sampled(loop, dt, periods * count * dt, **parts)
    heard = np.asarray(run.sensed)[-count - 1 : -1]
    k = np.arange((periods - 1) * count, periods * count)
    phasor = 2 * (heard * np.exp(-1j * 30 * k * dt)).mean() * 1j  # of α sin ωt: α
    centre = float(np.asarray(run.position)[-count - 1 : -1, 0].mean())
    wanted = sampled_loop_gain(sampled(loop, dt, **parts)).received.dither[0]
    assert phasor / (0.08 * -2 * (centre + 1)) == pytest.approx(wanted, rel=3e-3)


def test_coloured_noise_comes_from_the_sensor() -> None:
    coloured = es.Sensor(coloured=es.ColouredNoise(0.1, 0.02))
    wanted = noise_variance(velocity_actuated(), 0.002, 0.1, correlation_time=0.02)
    assert str(noise_variance(sampled(velocity_actuated(), sensor=coloured))) == str(wanted)
    white = noise_variance(sampled(velocity_actuated(), sensor=coloured), sigma=0.1)
    assert white.correlation_time == 0.0


def test_a_scenario_goes_straight_in(tmp_path: Path) -> None:
    path = tmp_path / "loop.toml"
    run = es.simulate_sampled(velocity_actuated(), 0.002, 0.1, **LATE)
    path.write_text(run.attrs["scenario"], encoding="utf-8")
    loop = es.load_scenario(path).loop
    wanted = sampled_loop_gain(sampled(velocity_actuated(), **LATE))
    assert str(sampled_loop_gain(loop)) == str(wanted)


def test_what_is_left_out_is_said() -> None:
    loop = sampled(
        velocity_actuated(),
        sensor=es.Sensor(noise=0.1, low=-9.0, high=9.0, step=0.01, dropout=0.05),
        actuator=es.Actuator(low=-6.0, high=6.0, rate=500.0),
        practice=es.Practice(limits=es.Limits(low=(-6.0, -6.0), high=(6.0, 6.0))),
    )
    note = (
        "Note: left out, but not by simulate_sampled: sampling.sensor.low, sampling.sensor.high, "
        "sampling.sensor.step, sampling.sensor.dropout, sampling.actuator.low, "
        "sampling.actuator.high, sampling.actuator.rate, sampling.practice.limits."
    )
    for found in (sampled_loop_gain(loop), critical_delay(loop), critical_dt(loop)):
        assert note in str(found)
    assert note in str(noise_variance(loop))
    plain = sampled_loop_gain(velocity_actuated(), 0.002, practice=loop.sampling.practice)
    assert plain.notes == ("left out, but not by simulate_sampled: practice.limits",)
    assert sampled_loop_gain(velocity_actuated(), 0.002).notes == ()


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"sensor": es.Sensor(es.Lag(0.03, 0.1), noise=0.1)},
            "sampling.sensor.lag.decay = 0.1: differs",
        ),
        (
            {"sensor": es.Sensor(noise=0.1), "practice": es.Practice(scale=es.LogScale(1.0))},
            "sampling.practice.scale = .*leave it",
        ),
        ({}, "sigma: must be given: the sensor of this loop has no noise"),
        (
            {"sensor": es.Sensor(noise=0.1, coloured=es.ColouredNoise(0.1, 0.02))},
            "sampling.sensor.coloured = .*: comes with white noise",
        ),
    ],
)
def test_what_is_refused(parts: Any, message: str) -> None:
    with pytest.raises(es.InvalidDescription, match=message):
        noise_variance(sampled(velocity_actuated(), **parts))
