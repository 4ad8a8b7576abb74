"""What is said of loops where a step goes wrong: domains' edges, fast poles, accuracy by state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import extremum as es
from extremum.papers import zhang2007

CALM = {"controller.washout_start": "signal"}


def fig4(**changes: Any) -> es.Loop:
    return zhang2007.scenario("fig4").loop.replace({**CALM, **changes})


def hill(lines: int = 41) -> es.Gridded:
    axis = np.linspace(-4.0, 4.0, lines)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    return es.Gridded(es.Grid((axis, axis), 1 - (x + 1) ** 2 - (y + 1) ** 2 / 2))


@pytest.mark.parametrize(
    ("formula", "top"), [("acos(x/2) - y**2", np.pi), ("asin(x/2) - y**2", np.pi / 2)]
)
def test_a_loop_ends_inside_its_fields_domain(formula: str, top: float) -> None:
    start = {"field": es.Expression(formula), "start": (0.3, 0.1)}
    loop = fig4(**start)
    gains = np.linspace(-30, 30, 13)
    found = es.ensemble(loop, 3.0, over={"controller.channels.0.gain": gains}, keep=("max_J",))
    left = found.outcome.values == 2
    assert left.any()
    assert np.isfinite(found.J).all()
    assert float(found.max_J.max()) <= top
    for index in np.flatnonzero(left):
        one = es.simulate(loop.replace({"controller.channels.0.gain": gains[index]}), 3.0)
        assert one.attrs["outcome"] == "left the data"
        assert abs(float(found.end_time[index]) - one.attrs["end_time"]) < 1e-5


def test_the_error_is_relative_to_each_state() -> None:
    """Metres are not measured by a washout at J = 1e5."""
    over = {"field.peak": np.linspace(0.9e5, 1.1e5, 40)}
    found = es.ensemble(fig4(), 4.0, over=over, tol=1e-4)
    exact = es.ensemble(fig4(), 4.0, over=over, tol=1e-10)
    error = float((abs(found.position - exact.position) / (1 + abs(exact.position))).max())
    assert 0.3 * error < found.attrs["error"] < 10 * error


@pytest.mark.parametrize("fast", [{"sensor": "5000/(s + 5000)"}, {"controller.washout": 3e3}])
def test_a_pole_that_is_fast_beside_the_dither_is_followed_on_a_grid(fast: dict[str, Any]) -> None:
    loop = fig4(field=hill(), **fast)
    found = es.ensemble(loop, 0.2, over={"start.0": [1.0, 0.9]})
    assert (found.outcome == 0).all()
    one = es.simulate(loop, 0.2)
    assert np.abs(found.position[0] - one.position[-1]).max() < 1e-4


def test_half_a_step_is_half_in_single_precision_too() -> None:
    loop = fig4(field=hill(), start=(0.9, 0.9))
    found = es.ensemble(loop, 1.0, over={"start.0": [0.9, 0.8]}, dtype="float32", tol=1e-5)
    assert found.attrs["error"] > 0


def test_a_loop_without_a_step_has_no_largest_value() -> None:
    loop = fig4(field=es.Expression("log(4 - (x + 1)**2 - (y + 1)**2)"), start=(0, 0))
    over = {"start.0": [0.0, 5.0]}
    found = es.ensemble(loop, 0.1, over=over, keep=("max_J", "mean_J", "peak_input"))
    assert found.outcome.values.tolist() == [0, 2]
    for name in ("max_J", "mean_J", "peak_input"):
        assert np.isfinite(found[name][0]).all()
        assert np.isnan(found[name][1]).all()


def test_means_do_not_drift_in_single_precision() -> None:
    loop = fig4(**{"field.peak": 1000.0})
    single, double = (
        es.ensemble(loop, 2000.0, over={"start.0": [1.0]}, keep=("mean_J", "max_J"), dtype=dtype)
        for dtype in ("float32", "float64")
    )
    assert abs(float(single.mean_J[0]) - float(double.mean_J[0])) < 1e-3
    assert single.attrs["steps"] > 30_000


def test_on_a_grid_the_largest_value_is_not_below_the_last() -> None:
    over = {"start.0": np.linspace(-0.9, 0.9, 7)}
    found = es.ensemble(fig4(field=hill()), 0.05, over=over, keep=("max_J",))
    assert (found.max_J >= found.J - 1e-9).all()
