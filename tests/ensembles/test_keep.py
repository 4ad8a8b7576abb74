"""Every statistic against the dense trajectory that `simulate` returns."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import xarray
from loops import force_actuated, velocity_actuated
from scipy.integrate import simpson

import extremum as es
from extremum.ensembles.keeping import STATISTICS
from extremum.papers import zhang2007

KEEP = tuple(STATISTICS)
T_END = 3.0
RADIUS = 0.6


def moving(**changes: Any) -> es.Loop:
    """A source that goes in circles, sensed with a lag, two frequencies, a disturbance."""
    still = velocity_actuated()
    return still.replace(
        {
            "field": es.Moving(still.field, es.Circle(0.2, 0.5)),
            "sensor": "1/(0.01*s + 1)",
            "controller.channels.1.ratio": Fraction(3, 2),
            "vehicle.disturbance": (0.1, -0.1),
            "start": (-0.5, -0.5),
            **changes,
        }
    )


CASES: dict[str, tuple[es.Loop, dict[str, Any], float]] = {
    "velocity": (
        velocity_actuated(),
        {"start.0": [-0.7, -1.2], "controller.frequency": [30.0, 25.0]},
        2 * np.pi,
    ),
    "force": (force_actuated(), {"controller.channels.0.gain": [10.0, 8.0]}, 2 * np.pi),
    "moving": (moving(), {"field.field.peak": [1.0, -2.0]}, 4 * np.pi),
    "almost periodic": (
        velocity_actuated(**{"controller.channels.1.ratio": 2**0.5}),
        {"field.q.0": [1.0, 0.7]},
        2 * np.pi,
    ),
    "swept ratio": (
        velocity_actuated(**{"controller.channels.1.ratio": 2}),
        {"controller.channels.1.ratio": [0.75, 1.3]},
        np.nan,
    ),
}


def expected(loop: es.Loop, period: float) -> dict[str, Any]:
    """The statistics, from `simulate`."""
    run = es.simulate(loop, T_END)
    times = np.linspace(0, T_END, 20001)
    dense = es.simulate(loop, T_END, samples=times)
    lasts = np.concatenate(([0.0], np.linspace(T_END - period, T_END, 2001)))
    last = es.simulate(loop, T_END, samples=lasts).isel(time=slice(1, None))
    offset = dense.position - dense.source
    away = np.sqrt((offset.values**2).sum(axis=1))
    outside = np.flatnonzero(away > RADIUS)
    if not len(outside):
        settled = 0.0
    elif outside[-1] == len(times) - 1:
        settled = np.nan
    else:
        edge = slice(outside[-1], outside[-1] + 2)
        settled = float(np.interp(-RADIUS, -away[edge], times[edge]))
    relative = (last.position - last.source).values
    mean = np.asarray(simpson(relative, last.time.values, axis=0)) / period
    largest = np.maximum(np.abs(run.input.attrs["min"]), np.abs(run.input.attrs["max"]))
    return {
        "mean_J": simpson(dense.J.values, times) / T_END,
        "max_J": run.J.attrs["max"],
        "mean_position": simpson(last.position.values, last.time.values, axis=0) / period,
        "distance": np.sqrt((mean**2).sum()),
        "settling_time": settled,
        "peak_input": largest,
    }


def close(statistic: str, ours: Any, theirs: Any, period: Any) -> bool:
    """Whether two statistics agree; maxima and crossings are looked for at points of each step."""
    rtol = 1e-5 if statistic in ("max_J", "peak_input") else 1e-6
    atol = period / 2000 if statistic == "settling_time" else 1e-6
    return bool(np.isclose(ours, theirs, rtol=rtol, atol=atol, equal_nan=True).all())


@pytest.mark.parametrize("name", CASES)
def test_statistics_are_those_of_the_dense_trajectory(name: str) -> None:
    loop, over, angle = CASES[name]
    found = es.ensemble(loop, T_END, over=over, keep=KEEP, radius=RADIUS, tol=1e-9)
    assert (found.outcome == 0).all()
    for index in range(2):
        single = loop.replace({path: numbers[index] for path, numbers in over.items()})
        frequency = single.controller.base()
        if name == "swept ratio":
            slowest = min(1.0, over["controller.channels.1.ratio"][index])
            period = 2 * np.pi / (slowest * frequency)
        else:
            period = angle / frequency
        for statistic, value in expected(single, period).items():
            ours = found[statistic][index].values
            assert close(statistic, ours, value, 2 * np.pi / frequency), statistic


def test_what_is_kept_is_named_and_has_units() -> None:
    over = {"start.0": [0.0, 1.0]}
    none = es.ensemble(velocity_actuated(), 0.5, over=over)
    assert not set(STATISTICS) & set(none.data_vars)
    assert "input" not in none.coords
    some = es.ensemble(velocity_actuated(), 0.5, over=over, keep=["peak_input", "mean_position"])
    assert some.peak_input.attrs["units"] == "m/s"
    assert some.peak_input.input.values.tolist() == ["v_x", "v_y"]
    assert some.mean_position.axis.values.tolist() == ["x", "y"]


@pytest.mark.parametrize("engine", ["usual", "slow"])
def test_a_period_longer_than_the_run_is_the_run(
    engine: str, request: pytest.FixtureRequest
) -> None:
    if engine == "slow":
        request.getfixturevalue("slowly")
    loop = velocity_actuated()
    found = es.ensemble(loop, 0.1, over={"start.0": [1.0]}, keep=("mean_position",), tol=1e-9)
    run = es.simulate(loop, 0.1, samples=2001)
    mean = simpson(run.position.values, run.time.values, axis=0) / 0.1
    assert np.abs(found.mean_position[0].values - mean).max() < 1e-6


def test_settling_is_judged_at_the_end() -> None:
    """At the source from the start: 0; never near it: NaN; far away on the way: in between."""
    loop = velocity_actuated(**{"controller.channels.0.gain": 0, "controller.channels.1.gain": 0})
    over = {"start.0": [-1.0, 2.0]}
    found = es.ensemble(loop, 1.0, over=over | {"start.1": -1.0}, keep=KEEP, radius=0.5)
    assert found.settling_time[0] == 0.0
    assert np.isnan(found.settling_time[1])


def test_trajectories_are_those_of_simulate() -> None:
    over = {"start.0": xarray.DataArray([1.0, 0.5, -1.0], dims="begin")}
    found = es.ensemble(moving(), 2.0, over=over, samples=9, tol=1e-9)
    assert found.sampled_position.dims == ("begin", "time", "axis")
    assert np.array_equal(found.time, np.linspace(0, 2, 9))
    for index, x in enumerate(over["start.0"].values):
        run = es.simulate(moving().replace({"start.0": x}), 2.0, samples=9)
        assert np.abs(found.sampled_position[index] - run.position).max() < 1e-6
        assert np.abs(found.sampled_J[index] - run.J).max() < 1e-5
    assert np.abs(found.sampled_position[:, -1] - found.position).max() < 1e-12


def test_three_axes_have_a_mean_and_inputs_each() -> None:
    loop = zhang2007.scenario("three_d").loop
    found = es.ensemble(loop, 0.5, over={"start.2": [0.0, 0.1]}, keep=KEEP, radius=9.0)
    assert found.mean_position.shape == found.peak_input.shape == (2, 3)
