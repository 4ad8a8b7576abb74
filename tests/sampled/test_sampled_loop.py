"""Sampled loops as descriptions: files, the command line, and what is refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from loops import velocity_actuated

import extremum as es
from extremum import s
from extremum.cli import main
from extremum.diagram import Diagram
from extremum.vehicles import Body


def sampled(sampling: es.Sampling, **changes: Any) -> es.SampledLoop:
    return es.SampledLoop.of(velocity_actuated(**changes), sampling)


SAMPLINGS = [
    es.Sampling(1e-3),
    es.Sampling(1 / 300, seed=2**53),
    es.Sampling(1e-3, es.Sensor(lag=es.TGS2620, delay=0.1 + 0.2, noise=0.6)),
    es.Sampling(
        1e-3,
        es.Sensor(lag=0.3, coloured=es.ColouredNoise(0.1, 2), low=-9, step=0.1, dropout=1 / 3),
        es.Actuator(low=(-3, -4), high=5, rate=(1, 2), delay=0.01, lag=0.2),
        es.Practice(
            delay=0.01, limits=es.Limits(low=(-3, -3), high=(3, 3)), scale=es.RunningScale(0.5, 0.1)
        ),
        seed=17,
    ),
]


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_every_sampled_loop_comes_back_from_its_text(sampling: es.Sampling) -> None:
    loop = sampled(sampling, sensor=1 / (0.02 * s + 1))
    scenario = es.Scenario(loop, es.Run(1.0))
    again = es.parse_scenario(es.format_scenario(scenario))
    assert again == scenario
    assert again.loop == loop != loop.continuous
    assert again.loop.values.tobytes() == loop.values.tobytes()
    assert again.loop.system is loop.system
    assert es.format_scenario(again) == es.format_scenario(scenario)


def test_a_table_makes_a_loop_sampled() -> None:
    text = es.format_scenario(es.Scenario(velocity_actuated(), es.Run(1.0)))
    assert "sampling" not in text
    loop = es.parse_scenario(text + "\n[sampling]\ndt = 0.002\nsensor = { lag = 2.96 }\n").loop
    assert loop == sampled(es.Sampling(2e-3, es.Sensor(lag=2.96)))
    assert loop.continuous == velocity_actuated()
    with pytest.raises(es.InvalidDescription, match=r"sampling\.dt: is missing"):
        es.parse_scenario(text + "\n[sampling]\n")
    with pytest.raises(es.InvalidDescription, match=r"did you mean 'noise'"):
        es.parse_scenario(text + "\n[sampling]\ndt = 0.002\nsensor = { nois = 1 }\n")


def test_the_command_line_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    loop = sampled(SAMPLINGS[2])
    Path("noisy.toml").write_text(es.format_scenario(es.Scenario(loop, es.Run(0.5))))
    assert main(["run", "noisy.toml", "-o", "noisy.nc"]) == 0
    assert "[sampled every 0.001 s" in capsys.readouterr().out
    import xarray

    with xarray.open_dataset("noisy.nc", engine="h5netcdf") as stored:
        assert np.array_equal(stored.sensed, es.simulate(loop, 0.5).sensed)


def test_a_run_carries_the_text_that_reproduces_it() -> None:
    run = es.simulate_sampled(
        velocity_actuated(), 1e-3, 0.3, sensor=es.Sensor(noise=0.6), seed=9, samples=31
    )
    scenario = es.parse_scenario(run.attrs["scenario"])
    again = es.simulate(scenario.loop, scenario.run.t_end, samples=scenario.run.samples)
    assert again.identical(run)


def test_structure_is_shared_and_whole_delays_are_structure() -> None:
    one, same, other = (
        sampled(es.Sampling(1e-3, es.Sensor(delay=delay))) for delay in (3.1e-3, 3.9e-3, 4e-3)
    )
    assert one.system is same.system
    assert one.system is not other.system
    assert len(other.system.states) == len(one.system.states) + 1
    assert one.replace({"sampling.dt": 0.5e-3}).system is not one.system
    assert one.replace({"sampling.seed": 3, "field.peak": 2}).system is one.system


@pytest.mark.parametrize("order", [1, 2, 3])
def test_integrators_move_by_polynomials(order: int) -> None:
    """x⁺ = Σ dtⁱ x⁽ⁱ⁾/i! + dtⁿ u/n!, Taylor's series: no derived numbers."""
    loop = velocity_actuated(**{"vehicle.axes": (1 / s**order, 1 / s**order)})
    system = es.SampledLoop.of(loop, es.Sampling(1e-3)).system
    assert system.derived is None
    dt: Any = system.dt
    derivatives = [*system.states[:order], system.inputs[0]]
    for first, found in enumerate(system.rhs[:order]):
        if first == 0:  # unless J is beyond all that is believed
            found = found.args[2]
        series = (x * dt**i / sympy.factorial(i) for i, x in enumerate(derivatives[first:]))
        assert sympy.expand(found - sympy.Add(*series)) == 0


def test_verbs_of_continuous_loops_say_so() -> None:
    loop = sampled(es.Sampling(1e-3))
    for verb in (es.average, es.stability, es.periodic_orbit, es.bias):
        with pytest.raises(es.InvalidDescription, match=r"is sampled.*loop\.continuous"):
            verb(loop)


# --- refusals ---------------------------------------------------------------------------------


def given(what: Any) -> Any:
    """Something that a type checker would refuse too."""
    return what


REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: es.Sensor(delay=-1e-3), "Sensor.delay = -0.001: must not be negative"),
    (lambda: es.Sensor(noise=-0.1), "Sensor.noise = -0.1: must not be negative"),
    (lambda: es.Sensor(dropout=1.01), "Sensor.dropout = 1.01: is a probability: it must lie"),
    (lambda: es.Sensor(dropout=-0.01), "Sensor.dropout = -0.01: is a probability"),
    (lambda: es.Sensor(low=1, high=1), "Sensor.low = 1.0: must be less than high = 1.0"),
    (lambda: es.Sensor(step=0), "Sensor.step = 0.0: must be greater than 0"),
    (lambda: es.Sensor(lag=-2.0), "Sensor.lag.rise = -2.0: must be greater than 0"),
    (lambda: es.Sensor(lag=es.Lag(1, 0)), "Lag.decay = 0.0: must be greater than 0"),
    (lambda: es.Sensor(lag="slow"), "slow"),
    (lambda: es.Sensor(coloured=given(0.3)), "Sensor.coloured = 0.3: must be a ColouredNoise"),
    (lambda: es.ColouredNoise(-1, 1), "ColouredNoise.deviation = -1.0: must not be negative"),
    (lambda: es.ColouredNoise(1, 0), "ColouredNoise.time = 0.0: must be greater than 0"),
    (lambda: es.Sensor(noise=float("nan")), "Sensor.noise = nan: must be a finite number"),
    (lambda: es.Actuator(delay=-1), "Actuator.delay = -1.0: must not be negative"),
    (lambda: es.Actuator(lag=0), "Actuator.lag = 0.0: must be greater than 0"),
    (lambda: es.Actuator(rate=(1, -1)), "Actuator.rate.1 = -1.0: must be greater than 0"),
    (lambda: es.Actuator(low=2, high=1), "Actuator.low = 2.0: must be less than high = 1.0"),
    (lambda: es.Actuator(low=(0, 2), high=(1, 1)), "Actuator.low.1 = 2.0: must be less than"),
    (lambda: es.Sampling(0), "Sampling.dt = 0.0: must be greater than 0"),
    (lambda: es.Sampling(-1e-3), "Sampling.dt = -0.001: must be greater than 0"),
    (lambda: es.Sampling(1e-3, seed=-1), "Sampling.seed = -1.0: must be a whole number from 0"),
    (lambda: es.Sampling(1e-3, seed=0.5), "Sampling.seed = 0.5: must be a whole number"),
    (lambda: es.Sampling(1e-3, seed=2**53 + 2), "Sampling.seed = "),
    (lambda: es.Sampling(1e-3, es.Sensor(delay=2)), "sensor.delay = 2.0: is 2,000 samples"),
    (lambda: es.Sampling(1e-3, actuator=es.Actuator(delay=0.502)), "dt of 0.001 s or more"),
    (lambda: es.Sampling(1e-3, sensor=given(0.6)), "Sampling.sensor = 0.6: must be a Sensor"),
    (lambda: sampled(es.Sampling(0.04)), "sampling.dt = 0.04: leaves 5.24 samples in a period"),
    (
        lambda: sampled(es.Sampling(1e-3, actuator=es.Actuator(low=(-1, -1, -1)))),
        "sampling.actuator.low = (-1.0, -1.0, -1.0): has 3 entries for 2 inputs",
    ),
    (lambda: sampled(given(None)), "sampling = None: must be a Sampling"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED, ids=[words[:40] for _, words in REFUSED])
def test_what_cannot_be_is_refused(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(es.InvalidDescription) as refused:
        make()
    assert words in str(refused.value)


RUNS: list[tuple[dict[str, Any], str]] = [
    ({"t_end": 1.0005}, "t_end = 1.0005: is 1000.5 sampling times of 0.001 s"),
    ({"t_end": -1}, "t_end = -1: must be a finite number greater than 0"),
    ({"t_end": 4e-4}, "t_end = 0.0004: is 0.4 sampling times"),
    ({"t_end": None}, "t_end = None: must be a number"),
    ({"dt": 0.05, "t_end": 1}, "leaves 4.19 samples in a period of the fastest dither"),
    ({"dt": "fast"}, "dt = 'fast'"),
    ({"dt": None}, "dt = None: must be a number"),
    ({"seed": 1.5}, "seed = 1.5: must be a whole number"),
    ({"seed": "a"}, "seed = 'a'"),
    ({"sensor": 0.6}, "sensor = 0.6: must be a Sensor"),
    ({"actuator": es.Sensor()}, "must be an Actuator"),
    ({"practice": 3}, "must be a Practice"),
    ({"samples": 1}, "samples = 1: must be a whole number, at least 2"),
    ({"samples": [0, 1]}, "samples = [0, 1]: must be a whole number"),
    ({"samples": 8}, "samples = 8: divides 1,000 sampling times"),
    ({"loop": None}, "loop = NoneType: must be a Loop"),
]


@pytest.mark.parametrize(("changes", "words"), RUNS, ids=[words[:40] for _, words in RUNS])
def test_what_cannot_run_is_refused(changes: dict[str, Any], words: str) -> None:
    given = {"loop": velocity_actuated(), "dt": 1e-3, "t_end": 1.0, **changes}
    with pytest.raises(es.InvalidDescription) as refused:
        es.simulate_sampled(**given)
    assert words in str(refused.value)


def test_a_whole_number_of_samples_is_meant_within_rounding() -> None:
    assert len(es.simulate_sampled(velocity_actuated(), 1e-3, 0.3 * (1 + 1e-10)).time) == 301


def test_few_samples_a_period_are_warned_of() -> None:
    with pytest.warns(UserWarning, match=r"leaves 10\.5 samples in a period"):
        es.simulate_sampled(velocity_actuated(), 0.02, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        es.simulate_sampled(velocity_actuated(), 0.01, 1.0)


def test_opaque_fields_and_options_of_continuous_runs_are_refused() -> None:
    opaque = velocity_actuated(field=es.Opaque(lambda p, t: -float(p @ p)))
    with pytest.raises(es.InvalidDescription, match="known by its values only"):
        es.simulate_sampled(opaque, 1e-3, 1.0)
    loop = sampled(es.Sampling(1e-3))
    with pytest.raises(es.InvalidDescription, match="tol = 1e-06: is for continuous loops"):
        es.simulate(loop, 1.0, tol=1e-6)
    with pytest.raises(es.InvalidDescription, match="engine = 'taylor': is for continuous"):
        es.simulate(loop, 1.0, engine="taylor")
    with pytest.raises(es.InvalidDescription, match=r"loop = SampledLoop: .*`simulate` runs a"):
        es.simulate_sampled(loop, 1e-3, 1.0)


class Boat(es.PointMass, abstract=True):  # which keeps it out of the registry
    """A vehicle whose drag is quadratic."""

    def compose(self, diagram: Diagram, inputs: Sequence[Any], initial: Sequence[Any]) -> Body:
        body = super().compose(diagram, inputs, initial)
        diagram.rhs[0] -= diagram.states[0] ** 2
        return body


def test_a_vehicle_that_is_not_linear_is_refused() -> None:
    loop = velocity_actuated(vehicle=Boat((1 / s, 1 / s)))
    with pytest.raises(es.InvalidDescription, match="vehicle: Boat is not linear with constant"):
        es.simulate_sampled(loop, 1e-3, 1.0)


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ({"sampling.seed": [0, 0.5]}, "must be a whole number"),
        ({"sampling.seed": [0, -1]}, "must be a whole number"),
        ({"sampling.sensor.noise": [0.1, 0.2]}, "must be given first"),
        ({"sampling.dt": [1e-3, 0.7e-3]}, "whole number"),
    ],
)
def test_an_ensemble_refuses_the_same(over: dict[str, Any], words: str) -> None:
    with pytest.raises(es.InvalidDescription, match=words):
        es.ensemble(sampled(es.Sampling(1e-3)), 1.0, over=over)
