"""The largest delay and the slowest sampling: closed forms, and runs on both sides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum.theory.sampled import critical_delay, critical_dt, sampled_loop_gain

from .sampled_plain import Plain

APART: Any = {"controller.channels.1.ratio": "3/2"}
LEAD = (5.0, -0.5, -3.0)
EQUAL = ((1.0, 0.0), (0.0, 1.0))

PAIRS: Any = {
    "velocity": (velocity_actuated, Plain(0.004, omega=(100.0, 100.0)), 25.0),
    "velocity, equal axes": (velocity_actuated, Plain(0.004, omega=(100.0, 100.0), q=EQUAL), 25.0),
    "force": (force_actuated, Plain(0.004, 2, (100.0, 100.0), alpha=0.1, lead=LEAD), 25.0),
    "force, equal axes": (
        force_actuated,
        Plain(0.004, 2, (100.0, 100.0), alpha=0.1, lead=LEAD, q=EQUAL),
        25.0,
    ),
    "two frequencies": (
        velocity_actuated,
        Plain(0.004, omega=(100.0, 150.0)),
        25.0,
    ),
}


def described(name: str) -> es.Loop:
    """The package's loop that a plain one is."""
    make, plain, _ = PAIRS[name]
    first, second = plain.omega
    return make(
        **{
            "controller.frequency": first,
            "controller.channels.1.ratio": second / first,
            "field.q": tuple(np.diag(plain.q)),
        }
    )


# --- runs on both sides --------------------------------------------------------------------------


@pytest.mark.parametrize("name", PAIRS)
def test_a_delay_that_the_references_ignore(name: str) -> None:
    """The limit is that of the phase error; 5 % to either side a run decays or grows."""
    _, plain, duration = PAIRS[name]
    first = critical_delay(described(name), plain.dt).crossings[0]
    assert (first.stable_below, first.stable_above) == (True, False)
    below, above = (plain.growth(duration, delay=k * first.value) for k in (0.95, 1.05))
    assert below < 0 < above
    predicted = sampled_loop_gain(described(name), plain.dt, delay=0.95 * first.value)
    assert below == pytest.approx(predicted.modes[0].real, rel=0.25)


@pytest.mark.parametrize("name", ["velocity", "force"])
def test_a_delay_that_the_references_account_for(name: str) -> None:
    """The limit is that of the slow loop, e^(−sT): ten and more periods of the dither."""
    _, plain, duration = PAIRS[name]
    limit = critical_delay(described(name), plain.dt, known=True)
    assert limit.largest > 6 * 2 * math.pi / 100
    growth = []
    for k in (0.93, 1.07):
        late = k * limit.largest
        growth.append(plain.growth(2 * duration, delay=late, known=late))
    assert growth[0] < 0 < growth[1]


@pytest.mark.parametrize(("name", "samples"), [("force", 1), ("velocity, equal axes", 2)])
def test_a_sensor_that_is_whole_samples_late(name: str, samples: int) -> None:
    """Six and more samples a period; 6 % to either side of the slowest sampling."""
    _, plain, _ = PAIRS[name]
    (crossing,) = critical_dt(described(name), samples=samples).crossings
    assert crossing.stable_below
    for factor, sign in ((0.94, -1), (1.06, 1)):
        dt = factor * crossing.value
        found = plain.growth(25.0, dt=dt, delay=samples * dt)
        assert found * sign > 0


# --- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 7, 60])
def test_one_integrator_with_whole_samples_of_delay(n: int) -> None:
    """z^n (z − 1) + g dt has roots on the circle at g dt = 2 sin(π/(2 (2n + 1)))."""
    dt = 0.005
    loop = velocity_actuated(**APART)
    start = sampled_loop_gain(loop, dt, delay=n * dt, practice=es.Practice(delay=n * dt))
    wanted = 2 * math.sin(math.pi / (2 * (2 * n + 1))) / dt
    loop = loop.replace({"controller.channels.0.gain": -10 * wanted / float(start.slope[0, 0])})
    limit = critical_delay(loop, dt, high=(n + 3) * dt, known=True)
    assert limit.largest == pytest.approx(n * dt, rel=1e-9)
    crossing = limit.crossings[0]
    assert crossing.mode.imag == pytest.approx(math.pi / (2 * n + 1) / dt, rel=1e-6)
    assert crossing.kind == "complex pair"


def test_a_quarter_turn_of_the_dither_reverses_a_single_axis() -> None:
    """cos(atan(h/ω) − ω (dt/2 + T)) changes its sign, first for the faster axis, ω = 45."""
    limit = critical_delay(velocity_actuated(**APART), 1e-4, high=0.2)
    quarter = (math.pi / 2 + math.atan(1 / 45)) / 45 - 5e-5
    assert limit.largest == pytest.approx(quarter, rel=1e-5)
    assert [c.kind for c in limit.crossings] == ["real, +1"] * 3
    slow, fast = (
        [(k * math.pi / 2 + math.atan(1 / w)) / w - 5e-5 for k in (1, 3, 5)] for w in (30, 45)
    )
    assert [c.value for c in limit.crossings] == pytest.approx(
        [fast[0], slow[1], fast[2]], rel=1e-4
    )


@pytest.mark.parametrize(
    ("zero", "pole", "g", "degrees"), [(-0.5, -3.0, 5.0, 44.8), (-2.0, -2.2, 1.0, 2.1)]
)
def test_a_pair_of_double_integrators_turns_as_far_as_its_phase_margin(
    zero: float, pole: float, g: float, degrees: float
) -> None:
    """The known angles: a fast dither, so that the delay is all phase."""
    w = 4000.0
    changes = {"controller.frequency": w, "field.q": (1.0, 1.0)}
    for i in (0, 1):
        changes[f"controller.channels.{i}.compensator"] = es.Lead(1.0, zero, pole)
        changes[f"controller.channels.{i}.gain"] = g / 0.1
    limit = critical_delay(force_actuated(**changes), 5e-6)
    assert math.degrees(w * (limit.largest + 2.5e-6)) == pytest.approx(degrees, abs=0.06)


def test_the_limit_is_where_the_delay_margin_says() -> None:
    """C = 1, G = 1/s: T + dt/2 = π/(2g), g = αcq cos²(atan(h/ω)), the washout's."""
    limit = critical_delay(velocity_actuated(**APART), 2e-3, known=True)
    g = 0.8 / (1 + 1 / 30**2)
    assert limit.largest == pytest.approx(math.pi / (2 * g) - 0.001, rel=5e-4)


# --- every crossing, and none ---------------------------------------------------------------------


def test_every_crossing_is_found() -> None:
    """Against modes computed at 300 delays."""
    loop = force_actuated(**{"field.q": (1.0, 0.5)})
    limit = critical_delay(loop, 0.02, high=0.7)
    delays = np.linspace(0.0, 0.7, 300)
    stable = [sampled_loop_gain(loop, 0.02, delay=float(x)).stable for x in delays]
    changes = delays[1:][np.diff(stable)]
    found = np.array([c.value for c in limit.crossings])
    assert len(found) >= len(changes) >= 5
    assert np.abs(changes[:, None] - found).min(axis=1).max() < 0.7 / 299
    assert all(any(low <= x <= high for low, high in limit.stable) == good
               for x, good in zip(delays, stable, strict=True))  # fmt: skip


def test_what_is_printed() -> None:
    limit = critical_delay(force_actuated(), 0.004)
    text = str(limit)
    assert "complex pair at 1.18" in text
    assert "stable for 0 ≤ delay ≤ 0.0264" in text
    none = critical_dt(velocity_actuated())
    assert none.largest == none.high == pytest.approx(2 * math.pi / (6 * 30))
    assert "no crossing for 0.0006981317 ≤ dt ≤ 0.03490659 s" in str(none)
    assert "slowest sampling rate 52.7" in str(critical_dt(force_actuated(), samples=1))
    growing = critical_delay(
        velocity_actuated(**{"controller.channels.0.gain": -10}), 0.01, high=0.03
    )
    assert "stable nowhere in the interval" in str(growing)
    assert math.isnan(growing.largest)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"low": -1.0}, "low = -1.0: must not be negative"),
        ({"low": 0.2, "high": 0.1}, "high = 0.1: must be greater than low = 0.2"),
        ({"high": math.inf}, "high = inf: must be a finite number"),
    ],
)
def test_bad_intervals(arguments: Any, message: str) -> None:
    with pytest.raises(es.InvalidDescription, match=message):
        critical_delay(velocity_actuated(), 0.01, **arguments)


@pytest.mark.parametrize("name", ["samples", "delay", "lag"])
def test_what_is_negative_is_refused_by_its_own_name(name: str) -> None:
    given: Any = {name: -1}
    with pytest.raises(es.InvalidDescription, match=f"^{name} = -1: must not be negative"):
        critical_dt(velocity_actuated(), **given)


@pytest.mark.parametrize("name", ["low", "high"])
def test_a_dt_is_positive(name: str) -> None:
    given: Any = {name: 0}
    with pytest.raises(es.InvalidDescription, match=f"^{name} = 0: must be a finite number great"):
        critical_dt(velocity_actuated(), **given)
