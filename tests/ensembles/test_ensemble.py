"""The verb: ends, outcomes, and that a loop's fate is its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum.engines import simd
from extremum.ensembles import ensembling, regions
from extremum.ensembles.keeping import STATISTICS

KEEP = tuple(STATISTICS)


def simulated(loop: es.Loop, t_end: float, **over: float) -> xarray.Dataset:
    return es.simulate(loop.replace(over), t_end)


def test_each_loop_ends_where_its_own_simulation_does() -> None:
    rng = np.random.default_rng(1)
    over = {
        "start.position.0": rng.uniform(-1, 1, 6),
        "field.q.1": rng.uniform(0.4, 0.8, 6),
        "controller.frequency": rng.uniform(25, 40, 6),
        "controller.channels.0.compensator.pole": rng.uniform(-4, -2, 6),
    }
    loop = force_actuated()
    found = es.ensemble(loop, 2.0, over=over, tol=1e-9)
    for index in range(6):
        run = simulated(loop, 2.0, **{path: float(n[index]) for path, n in over.items()})
        assert np.abs(found.position[index] - run.position[-1]).max() < 1e-6
        assert abs(found.J[index] - run.J[-1]) < 1e-6
        for state in map(str, loop.system.states):
            assert abs(found[state][index] - run[state][-1]) < 1e-5
    assert (found.outcome == 0).all()
    assert (found.end_time == 2.0).all()


def test_an_escape_is_an_outcome_and_its_neighbours_do_not_notice() -> None:
    """Fig. 4 with J − 5 and a washout that starts at zero escapes at 0.064 s."""
    loop = velocity_actuated(**{"controller.washout_start": "zero"})
    over = {"field.peak": [1.0, -4.0, 1.1]}
    found = es.ensemble(loop, 4.0, over=over, keep=KEEP, radius=1.0, samples=5, tol=1e-9)
    assert found.outcome.values.tolist() == [0, 1, 0]
    assert found.outcome.attrs["flag_meanings"].split()[1] == "escaped"
    assert found.end_time[1] == pytest.approx(0.064, abs=5e-4)
    gone = found.isel(loop=1)
    for state in map(str, loop.system.states):
        assert np.isfinite(gone[state])
    for statistic in ("mean_position", "distance", "settling_time"):
        assert np.isnan(gone[statistic]).all()
    assert np.isfinite(gone.sampled_position[0]).all()
    assert np.isnan(gone.sampled_position[1:]).all()
    assert np.isnan(gone.sampled_J[1:]).all()
    over = {"field.peak": [1.0, 1.1]}
    without = es.ensemble(loop, 4.0, over=over, keep=KEEP, radius=1.0, samples=5, tol=1e-9)
    for name in ("x", "eta", *KEEP):
        assert np.array_equal(found[name][::2], without[name])


def gridded() -> es.Loop:
    line = np.linspace(-2.5, 2.5, 41)
    x, y = np.meshgrid(line, line, indexing="ij")
    grid = es.Grid((line, line), 1 - (x + 0.5) ** 2 - 0.5 * (y + 0.5) ** 2)
    return velocity_actuated(field=es.Gridded(grid))


def test_a_gridded_field_runs_and_a_loop_that_leaves_it_ends_there() -> None:
    """Cubic splines are exact for a quadratic; with the gain reversed the vehicle flees."""
    gain = {"controller.channels.0.gain": [10.0, -30.0]}
    found = es.ensemble(gridded(), 2.0, over=gain, samples=5, keep=("max_J",), tol=1e-9)
    assert found.outcome.values.tolist() == [0, 2]
    quadratic = velocity_actuated(**{"field.source": (-0.5, -0.5)})
    run = es.simulate(quadratic, 2.0)
    assert np.abs(found.position[0] - run.position[-1]).max() < 1e-5
    left = es.simulate(gridded().replace({"controller.channels.0.gain": -30.0}), 2.0)
    assert left.attrs["outcome"] == "left the data"
    assert found.end_time[1] == pytest.approx(left.attrs["end_time"], abs=1e-3)
    assert np.abs(found.position[1]).max() == pytest.approx(2.5, abs=0.02)
    assert np.isfinite(found.J[1])
    assert np.isnan(found.sampled_J[1, -1])


OVER: dict[str, Any] = {
    "start.0": np.linspace(-2, 2, 5)[:, None],
    "controller.channels.1.dither.phase": np.array([-np.pi / 2, -1.0, 0.3]),
    "field.peak": 0.5,
}


def test_blocks_and_threads_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments: dict[str, Any] = {"over": OVER, "keep": KEEP, "radius": 1.0, "samples": 4}
    whole = es.ensemble(velocity_actuated(), 1.0, **arguments, threads=1)
    monkeypatch.setattr(regions, "LIMIT", 4)
    parts = es.ensemble(velocity_actuated(), 1.0, **arguments, threads=2)
    xarray.testing.assert_identical(whole, parts)
    index = {"loop_0": slice(1, 3), "loop_1": slice(1, 3)}
    few = {
        "start.0": OVER["start.0"][1:3],
        "controller.channels.1.dither.phase": OVER["controller.channels.1.dither.phase"][1:],
    }
    alone = es.ensemble(velocity_actuated(), 1.0, **{**arguments, "over": {**OVER, **few}})
    xarray.testing.assert_equal(whole.isel(index), alone)


def ran(monkeypatch: pytest.MonkeyPatch, count: int, samples: int | None = None) -> list[int]:
    """How many loops an ensemble runs, call by call."""
    counts: list[int] = []

    def engine(asked: Any, **arguments: Any) -> Any:
        counts.append(asked.count)
        return simd.integrate(asked, **arguments)

    over = {"start.0": np.linspace(-1, 0, count)}
    with monkeypatch.context() as patch:
        patch.setattr(ensembling, "integrator", lambda device: engine)
        es.ensemble(velocity_actuated(), 0.1, over=over, samples=samples)
    return counts


def test_a_few_loops_are_run_again_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run itself is what the one with half the steps is compared with."""
    assert ran(monkeypatch, 256) == [256, 256]
    assert ran(monkeypatch, 257) == [256, 256, 257]
    assert ran(monkeypatch, 4, samples=3) == [4, 4, 4]
    monkeypatch.setattr(regions, "LIMIT", 4)
    assert ran(monkeypatch, 8) == [8, 8, 4, 4]


def test_the_estimate_does_not_depend_on_which_run_it_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = es.ensemble(velocity_actuated(), 1.0, over=OVER)
    monkeypatch.setattr(regions, "LIMIT", 4)
    assert es.ensemble(velocity_actuated(), 1.0, over=OVER).attrs == whole.attrs


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_what_is_infinite_is_no_warning(dtype: str) -> None:
    over = {"start.0": [0.0, 1e10, 1e200, -1e308]}
    keep: dict[str, Any] = {"keep": KEEP, "radius": 1.0, "samples": 3, "dtype": dtype}
    found = es.ensemble(velocity_actuated(), 0.1, over=over, **keep)
    assert found.outcome[0] == 0
    assert np.isfinite(found.isel(loop=0).J)


def test_attrs_tell_what_was_run() -> None:
    loop = velocity_actuated()
    found = es.ensemble(loop, 1.0, over=OVER, tol=1e-7)
    attrs = found.attrs
    assert (attrs["t_end"], attrs["tol"], attrs["loops"]) == (1.0, 1e-7, 15)
    assert (attrs["device"], attrs["dtype"]) == ("cpu", "float64")
    assert attrs["steps"] >= 15
    assert 0 <= attrs["error"] < 1e-4
    assert es.parse_scenario(attrs["scenario"]).loop == loop


def test_single_precision_is_returned_as_such() -> None:
    over = {"start.0": [0.0, 1.0]}
    keep: dict[str, Any] = {"keep": KEEP, "radius": 1.0}
    found = es.ensemble(velocity_actuated(), 1.0, over=over, dtype="float32", tol=1e-4, **keep)
    assert found.x.dtype == found.max_J.dtype == np.float32
    exact = es.ensemble(velocity_actuated(), 1.0, over=over, tol=1e-9, **keep)
    assert np.abs(found.position - exact.position).max() < 1e-3


def test_progress_is_told_and_an_interrupt_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regions, "LIMIT", 4)
    told: list[float] = []
    es.ensemble(velocity_actuated(), 0.2, over=OVER, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert len(told) >= 4

    def interrupt(fraction: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        es.ensemble(velocity_actuated(), 0.2, over=OVER, progress=interrupt)
