"""The paper's loops against hand-written equations and the figures it prints."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
import xarray
from numpy.typing import NDArray

import extremum as es
from extremum import s
from extremum.papers.zhang2007 import NAMES, path, scenario


def simulated(name: str, t_end: float | None = None) -> xarray.Dataset:
    wanted = scenario(name)
    return es.simulate(wanted.loop, t_end or wanted.run.t_end)


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_is_right_to_1e_8(name: str) -> None:
    """Against a right-hand side written by hand, DOP853 at rtol 1e-12 (landscape: metres/1e4)."""
    run = simulated(name)
    every = slice(None, None, 25)
    exact = oracle.solve(name, run.time.values[every])
    size = 1e4 if name == "landscape" else 1.0
    for signal in ("position", "J", "input"):
        assert np.abs(run[signal].values[every] - exact[signal]).max() < 1e-8 * size, signal


def test_the_oracle_knows_every_scenario() -> None:
    assert set(oracle.SCENARIOS) == set(NAMES)


def extremes(run: xarray.Dataset, name: str) -> list[float]:
    attrs = run[name].attrs
    pairs = zip(np.atleast_1d(attrs["min"]), np.atleast_1d(attrs["max"]), strict=True)
    return [float(bound) for pair in pairs for bound in pair]


def test_fig4_has_the_printed_extremes() -> None:
    run = simulated("fig4")
    assert extremes(run, "J")[0] == pytest.approx(-10.24, abs=5e-3)
    assert extremes(run, "position") == pytest.approx([-4.15, 1.00, -1.94, 3.19], abs=5e-3)
    assert extremes(run, "input") == pytest.approx([-76.9, 32.4, -91.7, 58.0], abs=5e-2)
    assert run.position.values[-1] == pytest.approx([-0.922, -1.221], abs=5e-4)


def test_fig5_has_the_printed_extremes_and_a_source_that_starts_at_the_origin() -> None:
    run = simulated("fig5")
    assert extremes(run, "input") == pytest.approx([-9.2, 8.4, -11.3, 8.8], abs=6e-2)
    assert run.source.values[0] == pytest.approx([0.0, 0.0], abs=1e-15)


def test_fig5_with_the_scanned_phase_diverges() -> None:
    loop = scenario("fig5").loop.replace({"field.path.phase": 3.0})
    assert es.simulate(loop, 30.0).attrs["outcome"] == "escaped"


def test_fig6_keeps_within_the_printed_inputs_and_follows_the_source() -> None:
    run = simulated("fig6")
    assert max(map(abs, extremes(run, "input"))) < 100
    late = run.time.values > 15
    error = (run.position - run.source).values[late]
    assert np.abs(error).max() < 0.25


def test_fig7_from_a_zero_washout_start_escapes_at_017() -> None:
    loop = scenario("fig7").loop.replace({"controller.washout_start": "zero"})
    run = es.simulate(loop, 5.0)
    assert run.attrs["outcome"] == "escaped"
    assert run.attrs["end_time"] == pytest.approx(0.17, abs=5e-3)
    assert simulated("fig7").attrs["outcome"] == "completed"


def period_means(name: str, t_end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means over [t, t + T] of the position, by the trapezoidal rule, and the times t."""
    loop = scenario(name).loop
    period = loop.system.fastest_period(loop.values.tolist())
    assert period is not None
    per = 64
    run = es.simulate(loop, t_end, samples=np.arange(0, int(t_end / period) * per) * period / per)
    position = run.position.values
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum((position[1:] + position[:-1]) / 2, axis=0)])
    return run.time.values[:-per], (sums[per:] - sums[:-per]) / per


def settling(name: str, t_end: float, limit: NDArray[np.float64] | None = None) -> float:
    times, means = period_means(name, t_end)
    far = np.linalg.norm(means - (means[-1] if limit is None else limit), axis=1) > 0.1
    return float(times[far][-1])


def test_with_a_compensator_a_pole_ten_times_faster_settles_sooner_and_without_bias() -> None:
    """Fig. 7's loop comes within 0.1 of its own, biased limit at 10.65 s."""
    assert settling("fig7", 60.0) == pytest.approx(10.65, abs=0.02)
    source = np.array([1.0, -1.0])
    assert settling("unstable", 60.0, source) < 4.0
    assert np.linalg.norm(period_means("unstable", 60.0)[1][-1] - source) < 1e-8
    # equation (43): x̃ = ε x*/(α c q − ε), up to O(1/ω)
    bias = [0.05 * c / (0.05 * 10 * q - 0.05) for c, q in zip(source, (1.0, 0.5), strict=True)]
    assert period_means("fig7", 60.0)[1][-1] - source == pytest.approx(bias, abs=0.02)


def test_a_constant_force_biases_the_mean_by_the_static_error_of_the_loop() -> None:
    """d p/(g z), with g = α c k q = 5 in x."""
    _, means = period_means("constant_force", 60.0)
    assert means[-1, 0] + 1.0 == pytest.approx(0.3 * -3.0 / (5.0 * -0.5), abs=2e-3)


def test_moving_sources_are_tracked_with_the_sensitivity_of_the_averaged_loop() -> None:
    """Error amplitude |S(jω_m)| per unit of the source's, S = s/(s + αcq) for 1/s."""
    run = simulated("commensurate")
    late = run.time.values > run.time.values[-1] - 2 * np.pi / 0.25
    error = (run.position - run.source).values[late]
    times = run.time.values[late]
    for axis, q in enumerate((1.0, 0.5)):
        phasor = 2 * np.mean(error[:, axis] * np.exp(-0.25j * times))
        assert abs(phasor) == pytest.approx(abs(0.25j / (0.25j + 0.1 * 20 * q)), rel=0.03)


def test_drag_is_stabilised_by_gain_alone_and_a_double_integrator_is_not() -> None:
    loop = scenario("drag").loop
    frictionless = loop.replace({f"vehicle.axes.{i}.parameters.b": 0.0 for i in (0, 1)})
    assert np.abs(simulated("drag").position.values[-500:] + 1).max() < 0.2
    run = es.simulate(frictionless, 20.0)
    assert run.attrs["outcome"] != "completed" or np.abs(run.position.values[-500:] + 1).max() > 1


def test_the_vehicle_climbs_to_the_highest_summit_of_the_landscape() -> None:
    run = simulated("landscape")
    grid = scenario("landscape").loop.field.grid  # pyright: ignore[reportAttributeAccessIssue]
    i, j = np.unravel_index(int(grid.values.argmax()), grid.values.shape)
    summit = np.array([grid.axes[0][i], grid.axes[1][j]])
    last = run.time.values > run.time.values[-1] - 2 * np.pi / 0.2
    assert run.J.values[0] == pytest.approx(378.4, abs=0.1)
    assert np.linalg.norm(run.position.values[last].mean(axis=0) - summit) < 100
    assert run.J.values[last].mean() > grid.values.max() - 50


def test_every_scenario_says_whose_numbers_it_has() -> None:
    for name in NAMES:
        title = scenario(name).title
        owned = "our own" in title or name in ("fig4", "fig5", "landscape")
        assert owned, title
        assert path(name).read_text(encoding="utf-8").startswith("title")


def test_an_axis_given_as_text_or_expression_is_the_same_vehicle() -> None:
    assert es.PointMass(("1/s", "1/s")) == es.PointMass((1 / s, 1 / s))
