from __future__ import annotations

import pytest
from loops import velocity_actuated

import extremum as es
from extremum.papers.zhang2007 import scenario
from extremum.theory.lyapunov import lyapunov
from extremum.theory.orbits import periodic_orbit


def test_incommensurate_motion_has_lyapunov_exponents() -> None:
    loop = scenario("incommensurate").loop
    orbit = periodic_orbit(loop)
    assert not orbit.found
    assert not orbit.stable
    assert "0.1414" in orbit.outcome
    assert "40" in orbit.outcome
    assert len(orbit.exponents) == 0
    found = lyapunov(loop, 300.0)
    assert found.outcome == "completed"
    assert found.stable
    sum_of_the_average = -1.0 - 1.5 - 3.0
    assert found.exponents.sum() == pytest.approx(sum_of_the_average, rel=0.02)


def test_lyapunov_exponents_of_a_periodic_loop_are_the_real_parts() -> None:
    loop = scenario("commensurate").loop
    orbit = periodic_orbit(loop)
    found = lyapunov(loop, 4 * orbit.period, transient=2 * orbit.period)
    assert found.exponents == pytest.approx(orbit.exponents.real, abs=1e-9)
    assert found.uncertainty < 1e-9


def test_lyapunov_of_an_escaping_loop_is_an_outcome() -> None:
    loop = velocity_actuated(**{"controller.channels.0.ratio": 2**0.5})
    away = loop.replace({"controller.channels.1.gain": -40.0})
    assert lyapunov(loop, 60.0).stable
    found = lyapunov(away.replace({"vehicle.disturbance": (0.1, 0.1)}), 60.0)
    assert found.outcome == "escaped"
    assert not found.stable


def test_times_that_are_none_are_refused() -> None:
    loop = velocity_actuated()
    for window, transient, path in ((0.0, 1.0, "window"), (10.0, -1.0, "transient")):
        with pytest.raises(es.InvalidDescription, match="greater than 0") as refused:
            lyapunov(loop, window, transient=transient)
        assert refused.value.path == path
    with pytest.raises(es.InvalidDescription, match="must be a Loop"):
        lyapunov("fig4", 1.0)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("window", [1e-3, 1e7])
def test_a_window_that_says_nothing_or_takes_for_ever_is_refused(window: float) -> None:
    with pytest.raises(es.InvalidDescription, match=r"window = .*cycles of the fastest dither"):
        es.lyapunov(velocity_actuated(), window)
