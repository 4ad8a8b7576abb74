from __future__ import annotations

import numpy as np
import pytest
from loops import velocity_actuated

import extremum as es
from extremum import s
from extremum.simulation import simulate


def test_a_slow_loop_with_a_fast_dither_is_not_stepped_over() -> None:
    """With h = c = 0.01 nothing but the dither asks for small steps; the cap provides them."""
    loop = velocity_actuated(
        **{
            "controller.frequency": 200.0,
            "controller.washout": 0.01,
            "controller.channels.0.gain": 0.01,
            "controller.channels.1.gain": 0.01,
        }
    )
    run = simulate(loop, 2.0, engine="reference", tol=1e-3)
    exact = simulate(loop, 2.0)
    assert np.abs(run.position.values - exact.position.values).max() < 1e-6


def test_a_run_ends_where_the_data_end() -> None:
    """Climbing a plane J = x, the vehicle leaves the grid through x = 2, and not before."""
    x = np.linspace(-1, 2, 7)
    loop = es.Loop(
        field=es.Gridded(es.Grid((x,), x)),
        vehicle=es.PointMass((1 / s,)),
        controller=es.GradientES(20.0, 1.0, (es.Channel(es.Dither(0.1), gain=20.0),)),
        start=(0.0,),
    )
    run = simulate(loop, 20.0)
    assert run.attrs["outcome"] == "left the data"
    assert run.attrs["end_state"][0] == pytest.approx(2.0, abs=1e-9)
    assert run.x.values.max() <= 2.0
    analytic = simulate(loop.replace({"field": es.Expression("x")}), run.attrs["end_time"])
    assert analytic.x.values[-1] == pytest.approx(2.0, abs=1e-8)
