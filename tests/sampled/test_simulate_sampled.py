"""`simulate_sampled` against loops written by hand, and its limit dt → 0."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from by_hand import DRAGGED, INTEGRATOR, ZERO, Actuator, ByHand, Numbers, Seeker
from loops import velocity_actuated

import extremum as es
from extremum import s
from extremum.papers import zhang2007
from extremum.sampled.simulating import told


def quadratic(p: Numbers) -> float:
    return 1 - (p[0] + 1) ** 2 - 0.5 * (p[1] + 1) ** 2


def rich(**changes: Any) -> es.Loop:
    """Axes with drag, a zero and a disturbance, whose motion is no polynomial of time."""
    return velocity_actuated(
        **{
            "vehicle.axes": (1 / (s * (s + 0.7)), (s + 3) / (s**2 + s + 1)),
            "vehicle.disturbance": (0.1, 0.2),
            **changes,
        }
    )


def test_it_is_the_loop_written_by_hand() -> None:
    dt, steps = 2e-3, 750
    axes = (INTEGRATOR, INTEGRATOR)
    positions, _ = ByHand(axes, quadratic, Seeker(dt, axes)).run((1, 1), steps)
    run = es.simulate_sampled(velocity_actuated(), dt, steps * dt)
    assert run.time.values == pytest.approx(np.arange(steps + 1) * dt, abs=1e-15)
    assert run.position.values == pytest.approx(positions, abs=1e-9)
    assert run.J.values == pytest.approx([quadratic(p) for p in positions], abs=1e-9)
    assert np.array_equal(run.sensed, run.J)


IMPERFECT = {
    "ideal": ({}, {}, 0.0),
    "within a sample": ({"delay": 0.9e-3}, {"delay": 0.7e-3}, 0.048),
    "switch first": ({"delay": 1.6e-3}, {"delay": 0.3e-3}, 0.057),
    "whole samples": ({"delay": 0.004}, {"delay": 0.006}, 0.3),
    "limits": ({}, {"low": -40.0, "high": 30.0, "rate": 900.0}, 0.0),
    "lag": ({}, {"lag": 0.02}, 0.54),
    "all": (
        {"delay": 0.0137},
        {"low": -40.0, "high": 30.0, "rate": 900.0, "delay": 0.0033, "lag": 0.02},
        30 * (0.0137 + 0.0033) + np.arctan(0.6),
    ),
}


@pytest.mark.parametrize("name", IMPERFECT)
def test_delays_limits_and_lags_are_those_written_by_hand(name: str) -> None:
    sensor, actuator, late = IMPERFECT[name]
    dt, steps = 2e-3, 300
    axes = (DRAGGED, ZERO)
    seeker = Seeker(dt, axes, late=late + 30 * dt / 2)
    hand = ByHand(axes, quadratic, seeker, Actuator(**actuator), sensor.get("delay", 0.0))
    positions, samples = hand.run((1, 1), steps)
    run = es.simulate_sampled(
        rich(),
        dt,
        steps * dt,
        sensor=es.Sensor(**sensor),
        actuator=es.Actuator(**actuator),
        practice=es.Practice(delay=late / 30),
    )
    assert run.sensed.values == pytest.approx(samples, abs=1e-8)
    assert run.position.values == pytest.approx(positions, abs=1e-8)
    if "low" in actuator:
        assert run.input.min() >= -40
        assert run.input.max() <= 30
        assert abs(run.input).max() > 25


def test_python_takes_the_same_steps() -> None:
    """Every equation, imperfections and random numbers included, on floats one by one."""
    sampled = everything()
    system, values, dt = told(sampled.system), sampled.values.tolist(), sampled.sampling.dt
    step, states = system.function(system.rhs, vector=False), [list(system.start(values))]
    for k in range(400):
        states.append(step(k * dt, states[-1], values))
    run = es.simulate(sampled, 400 * dt)
    ours = np.stack([run[str(x)].values for x in system.states], axis=-1)
    assert ours == pytest.approx(np.array(states, dtype=float), abs=1e-10)


def everything() -> es.SampledLoop:
    loop = rich(sensor=1 / (0.02 * s + 1))
    sampling = es.Sampling(
        2e-3,
        es.Sensor(
            lag=es.Lag(0.05, 0.2),
            delay=0.0137,
            noise=0.1,
            coloured=es.ColouredNoise(0.2, 0.5),
            low=-8,
            high=0.9,
            step=0.01,
            dropout=0.1,
        ),
        es.Actuator(low=-80, high=(90, 85), rate=5000, delay=0.0033, lag=0.02),
        es.Practice(delay=0.017, lag=0.02),
        seed=3,
    )
    return es.SampledLoop.of(loop, sampling)


DTS = (4e-3, 2e-3, 1e-3, 0.5e-3, 0.25e-3)


def errors(loop: es.Loop, dts: tuple[float, ...]) -> list[float]:
    exact = es.simulate(loop, 4.0, samples=1001).position.values
    runs = (es.simulate_sampled(loop, dt, 4.0, samples=1001) for dt in dts)
    return [float(np.abs(run.position.values - exact).max()) for run in runs]


@pytest.mark.parametrize("start", ["signal", "zero"])
def test_it_converges_to_the_continuous_loop(start: str) -> None:
    """Fig. 4: first order, as a hold has."""
    loop = zhang2007.scenario("fig4").loop.replace({"controller.washout_start": start})
    slope = np.polyfit(np.log(DTS), np.log(errors(loop, DTS)), 1)[0]
    assert 0.9 < slope < 1.1


@pytest.mark.parametrize("start", ["position", "on the dither"])
def test_a_force_actuated_loop_converges_too(start: str) -> None:
    from loops import force_actuated

    loop = force_actuated() if start == "on the dither" else force_actuated(start=(1, 1))
    found = errors(loop, DTS[:3])
    assert np.polyfit(np.log(DTS[:3]), np.log(found), 1)[0] > 0.9


# --- what comes back --------------------------------------------------------------------------


def test_a_run_tells_what_simulate_does() -> None:
    run = es.simulate_sampled(velocity_actuated(), 1e-3, 1.0, title="a title")
    ideal = es.simulate(velocity_actuated(), 1.0)
    assert run.attrs["outcome"] == "completed"
    assert set(ideal.attrs) - {"tol"} <= set(run.attrs)
    assert run.attrs["end_time"] == 1.0
    assert run.attrs["end_state"][0] == run.x.values[-1]
    assert run.attrs["title"] == "a title"
    for name in ("position", "J", "input"):
        assert run[name].attrs["units"] == ideal[name].attrs["units"]
        assert np.array_equal(run[name].attrs["max"], run[name].max("time"))
    assert run.input.attrs["names"] == ["v_x", "v_y"]


def test_the_input_is_what_reaches_the_vehicle() -> None:
    """x_{k+1} = x_k + dt v_k, also behind a delay of whole samples and limits."""
    actuator = es.Actuator(delay=0.003, low=-2, high=2)
    for chosen in (None, actuator):
        run = es.simulate_sampled(velocity_actuated(), 1e-3, 0.5, actuator=chosen)
        steps = np.diff(run.position.values, axis=0) / 1e-3
        assert steps == pytest.approx(run.input.values[:-1], abs=1e-10)
    assert np.all(run.input.values[:3] == 0)
    assert run.input.values[3, 0] == 2


def test_samples_are_some_of_all() -> None:
    whole = es.simulate_sampled(velocity_actuated(), 1e-3, 1.0, sensor=es.Sensor(noise=0.1))
    some = es.simulate_sampled(
        velocity_actuated(), 1e-3, 1.0, sensor=es.Sensor(noise=0.1), samples=11
    )
    assert some.drop_attrs().identical(whole.isel(time=slice(None, None, 100)).drop_attrs())


def test_a_run_that_escapes_ends_there() -> None:
    """e^(60 t) by itself has squared beyond 1e18 after 0.35 s: no sample is believed any more."""
    loop = velocity_actuated(**{"vehicle.axes.0": 1 / (s - 60)})
    run = es.simulate_sampled(loop, 1e-3, 6.0)
    assert run.attrs["outcome"] == "escaped"
    assert 0.1 < run.attrs["end_time"] < 0.4
    assert abs(run.J[:-1]).max() <= 1e18 < abs(run.J[-1])
    assert np.isfinite(run.position).all()
    assert run.time.values[-1] <= run.attrs["end_time"]


def test_what_escapes_with_a_late_reference_escapes_in_an_ensemble_too() -> None:
    """Fig. 4 at dt = 4 ms from the brim; from (0, 1) it converges."""
    late = es.Sampling(4e-3, practice=es.Practice(delay=0.0))
    loop = es.SampledLoop.of(zhang2007.scenario("fig4").loop, late)
    ran = es.ensemble(loop, 20.0, over={"start.0": [0.0, 1.0]}, keep=("distance",))
    assert ran.outcome.values.tolist() == [0, 1]
    assert ran.distance[0] < 0.05
    assert ran.end_time[1] == es.simulate(loop, 20.0).attrs["end_time"]


def test_a_run_that_leaves_the_data_ends_there() -> None:
    axis = np.linspace(-2, 1.02, 40)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    grid = es.Grid([axis, axis], 1 - (x + 1) ** 2 - 0.5 * (y + 1) ** 2)
    ideal = es.simulate_sampled(velocity_actuated(), 1e-3, 2.0).position
    run = es.simulate_sampled(velocity_actuated(field=es.Gridded(grid)), 1e-3, 2.0)
    assert run.attrs["outcome"] == "left the data"
    assert abs(run.position - ideal[: len(run.time)]).max() < 1e-4
    assert (ideal[: len(run.time)] < 1.021).all()
    assert (ideal[: len(run.time) + 2] > 1.0199).any()


def test_a_run_that_leaves_a_formulas_domain_ends_there() -> None:
    """Where √ has no value; an ensemble's lane says the same."""
    hill = es.Expression("sqrt(1.0 - 0.1*x**2 - 0.1*y**2) + 3*x")
    loop = velocity_actuated(field=hill)
    ideal = es.simulate(loop, 4.0)
    run = es.simulate_sampled(loop, 1e-3, 4.0, sensor=es.Sensor(noise=1e-3))
    assert run.attrs["outcome"] == ideal.attrs["outcome"] == "left the data"
    assert run.attrs["end_time"] == pytest.approx(ideal.attrs["end_time"], abs=0.1)
    assert np.isfinite(run.J).all()
    assert (run.position**2).sum("axis")[-1] == pytest.approx(10, abs=0.5)
    noisy = es.SampledLoop.of(loop, es.Sampling(1e-3, es.Sensor(noise=1e-3)))
    lanes = es.ensemble(noisy, 4.0, over={"sampling.seed": [0]})
    assert lanes.outcome.values.tolist() == [2]
    assert lanes.end_time.values[0] == run.attrs["end_time"]
    with pytest.raises(es.InvalidDescription, match="start: the field has no finite value there"):
        es.simulate_sampled(loop.replace({"start": (3, 3)}), 1e-3, 4.0)


def test_long_runs_keep_some_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    from extremum.sampled import simulating

    monkeypatch.setattr(simulating, "MOST", 6000)
    seen: list[float] = []
    run = es.simulate_sampled(velocity_actuated(), 1e-3, 2.0, progress=seen.append)
    assert run.time.values == pytest.approx(np.arange(1001) * 2e-3, abs=1e-12)
    assert seen[-1] == 2.0
    with pytest.raises(es.InvalidDescription, match="4,001 samples, of which not every second"):
        es.simulate_sampled(velocity_actuated(), 1e-3, 4.001)
    given = es.simulate_sampled(velocity_actuated(), 1e-3, 4.001, samples=4002)
    assert len(given.time) == 4002


def test_seeds_reproduce_and_differ() -> None:
    sensor = es.Sensor(noise=0.6)
    first, again, other = (
        es.simulate_sampled(velocity_actuated(), 1e-3, 1.0, sensor=sensor, seed=seed)
        for seed in (7, 7, 8)
    )
    assert first.identical(again)
    assert abs(first.sensed - other.sensed).max() > 1


def test_a_lane_of_an_ensemble_is_the_run_of_its_seed() -> None:
    base = everything()
    seeds = np.arange(40)
    lanes = es.ensemble(base, 0.4, over={"sampling.seed": seeds}, samples=3)
    for seed in (0, 17, 39):
        run = es.simulate(base.replace({"sampling.seed": seed}), 0.4)
        lane = lanes.isel(loop=seed)
        assert lane.position.values == pytest.approx(run.position.values[-1], abs=1e-12)
        middle = lane.sampled_position.values[1]
        assert middle == pytest.approx(run.position.values[100], abs=1e-12)
    one = es.ensemble(base, 0.4, over={"sampling.seed": seeds}, samples=3, threads=1)
    part = es.ensemble(base, 0.4, over={"sampling.seed": seeds[11:13]}, samples=3)
    assert one.equals(lanes)
    assert np.array_equal(part.x, lanes.x[11:13])


def test_derived_numbers_follow_what_is_swept() -> None:
    """Φ and Γ of each lane are its own: drag, lag and a delay's fraction vary."""
    base = everything()
    over = {
        "vehicle.axes.0.den.0": np.array([0.7, 0.2, 1.5]),
        "sampling.actuator.lag": np.array([0.02, 0.05, 0.01]),
        "sampling.actuator.delay": np.array([0.0033, 0.0021, 0.0039]),
        "sampling.sensor.delay": np.array([0.0137, 0.0121, 0.0139]),
        "vehicle.disturbance.1": np.array([0.2, -0.3, 0.0]),
    }
    lanes = es.ensemble(base, 0.4, over=over)
    for lane in range(3):
        changed = {path: float(numbers[lane]) for path, numbers in over.items()}
        run = es.simulate(base.replace(changed), 0.4)
        found = lanes.position.values[lane]
        assert found == pytest.approx(run.position.values[-1], abs=1e-11)


def test_only_what_moves_the_vehicle_derives_numbers_again() -> None:
    derived = everything().system.derived
    assert derived is not None
    for path in ("sampling.seed", "sampling.sensor.noise", "controller.frequency", "start.0"):
        assert not derived.depends(path)
    for path in ("vehicle.axes.0.den.0", "sampling.dt", "sampling.actuator.lag"):
        assert derived.depends(path)


SWEPT: list[dict[str, Any]] = [
    {"sampling.sensor.delay": np.linspace(0.0, 0.0483, 7)},
    {"sampling.actuator.delay": np.array([0.0, 0.002, 0.0079, 0.04])},
    {"sampling.dt": np.array([0.4, 2.0, 3.2, 1.0]) * 1e-3},
    {
        "sampling.dt": np.array([1.0, 4.0, 4.0]) * 1e-3,
        "sampling.sensor.delay": np.array([0.0, 0.04, 0.0019]),
        "sampling.actuator.delay": np.array([0.0111, 0.0, 0.0119]),
    },
]


@pytest.mark.parametrize("over", SWEPT, ids=lambda over: str(list(over)))
def test_delays_of_different_numbers_of_samples_run_together(over: dict[str, Any]) -> None:
    base = everything()
    lanes = es.ensemble(base, 0.16, over=over)
    for lane in range(len(lanes.loop)):
        changed = {path: float(numbers[lane]) for path, numbers in over.items()}
        run = es.simulate(base.replace(changed), 0.16)
        found = lanes.position.values[lane]
        assert found == pytest.approx(run.position.values[-1], abs=1e-11)


# --- the number -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gain", "t_end", "within", "share"), [(10.0, 15.0, 0.5, 0.995), (5.0, 30.0, 0.3, 0.985)]
)
def test_fig4_finds_its_source_through_noise(
    gain: float, t_end: float, within: float, share: float
) -> None:
    """σ = 0.6 at 1 kHz; the variance of the mean position is c σ² dt/(4 α q)."""
    loop = zhang2007.scenario("fig4").loop.replace(
        {"controller.washout_start": "signal"}
        | {f"controller.channels.{i}.gain": gain for i in (0, 1)}
    )
    noisy = es.SampledLoop.of(loop, es.Sampling(1e-3, es.Sensor(noise=0.6)))
    seeds = {"sampling.seed": np.arange(10_000)}
    runs = es.ensemble(noisy, t_end, over=seeds, keep=("distance", "mean_position"))
    assert (runs.outcome == 0).all()
    assert (runs.distance < within).mean() >= share
    spread = runs.mean_position.values.std(axis=0)
    expected = np.sqrt(gain * 0.6**2 * 1e-3 / (4 * 0.08 * np.array([1.0, 0.5])))
    assert spread == pytest.approx(expected, rel=0.05)
