"""The theory of the sampled loop against `simulate_sampled` and ensembles of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated
from scipy.optimize import brentq

import extremum as es
from extremum.theory.sampled import critical_delay, noise_variance, sampled_loop_gain

DT = 2 * math.pi / (100 * 21)
LONG = round(45 / DT) * DT


def force(**changes: Any) -> es.Loop:
    start = {"start": es.OnDither((0.02, 0.01))}
    return force_actuated(**{"controller.frequency": 100, **start, **changes})


def growth(run: Any) -> float:
    """Rate (1/s) at which the dither's centre leaves the source, from the run's later part."""
    position = np.asarray(run.position)
    window = np.ones(21) / 21
    centre = [np.convolve(position[:, i], window, "valid") for i in (0, 1)]
    distance = np.hypot(*centre)
    early, late = np.array_split(distance[len(distance) // 3 :], 2)
    return math.log(late.max() / early.max()) / (len(late) * DT)


@pytest.mark.parametrize("known", [False, True])
def test_runs_on_both_sides_of_the_critical_delay(known: bool) -> None:
    limit = critical_delay(force(), DT, known=known).largest
    for factor, sign in ((0.92, -1), (1.08, 1)):
        late = factor * limit
        practice = es.Practice(delay=late if known else None)
        run = es.simulate_sampled(
            force(), DT, LONG, sensor=es.Sensor(delay=late), practice=practice
        )
        assert growth(run) * sign > 0


def test_runs_on_both_sides_of_the_slowest_actuator() -> None:
    """An actuator 1/(τs + 1), 45° late at the limit; one twice as slow that is accounted for."""

    def leading(tau: float) -> float:
        return float(sampled_loop_gain(force(), DT, lag=tau).modes[0].real)

    limit: Any = brentq(leading, 1e-4, 3.0)
    for tau, known, sign in (
        (0.9 * limit, None, -1),
        (1.1 * limit, None, 1),
        (2 * limit, es.Practice(delay=0.0, lag=2 * limit), -1),
    ):
        actuator = es.Actuator(lag=tau)
        run = es.simulate_sampled(force(), DT, LONG, actuator=actuator, practice=known)
        assert growth(run) * sign > 0


def test_a_delay_of_the_actuator_is_one_of_the_sensor() -> None:
    """To the average: what counts is their sum."""
    limit = critical_delay(force(), DT).largest
    run = es.simulate_sampled(
        force(),
        DT,
        LONG,
        sensor=es.Sensor(delay=0.4 * limit),
        actuator=es.Actuator(delay=0.65 * limit),
    )
    assert growth(run) > 0


@pytest.mark.parametrize(("gain", "t_end", "radius"), [(10.0, 15.0, 0.5), (5.0, 30.0, 0.3)])
def test_ten_thousand_noisy_runs(gain: float, t_end: float, radius: float) -> None:
    """Fig. 4 with σ = 0.6 at 1 kHz: the last period's mean, its variance to 5 %, its percentage."""
    loop = velocity_actuated(**{f"controller.channels.{i}.gain": gain for i in (0, 1)})
    sampling = es.Sampling(dt=1e-3, sensor=es.Sensor(noise=0.6))
    sampled = es.SampledLoop(
        loop.field, loop.vehicle, loop.controller, loop.start, loop.sensor, sampling
    )
    runs = es.ensemble(
        sampled,
        t_end,
        over={"sampling.seed": np.arange(10_000)},
        keep=("distance", "mean_position"),
    )
    found = noise_variance(loop, 1e-3, 0.6)
    variance = np.asarray(runs.mean_position).var(axis=0)
    assert variance == pytest.approx(np.diag(found.period_covariance), rel=0.05)
    share = float((np.asarray(runs.distance) < radius).mean())
    predicted = found.within(radius)
    assert abs(share - predicted) < 4 * math.sqrt(predicted * (1 - predicted) / 10_000)


def test_the_theory_of_continuous_loops_refuses_a_sampled_one() -> None:
    sampled = es.SampledLoop.of(velocity_actuated(), es.Sampling(dt=0.01))
    with pytest.raises(es.InvalidDescription, match=r"take loop\.continuous"):
        es.loop_gain(sampled)
    assert sampled_loop_gain(sampled.continuous, 0.01).stable
