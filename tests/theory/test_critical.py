from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import pi, s
from extremum.papers.zhang2007 import scenario
from extremum.theory import branch, critical
from extremum.theory.averaging import average
from extremum.theory.critical import critical_frequency
from extremum.theory.floquet import match
from extremum.theory.orbits import periodic_orbit

from .test_orbits import largest, near_the_fold, started_on, with_leads


def at(loop: es.Loop, frequency: float) -> es.Loop:
    return loop.replace({"controller.frequency": frequency})


def grows(loop: es.Loop, cycles: int) -> bool:
    """Whether a run that starts beside the orbit gets further away in its last third."""
    orbit = periodic_orbit(loop)
    begun = started_on(loop, orbit)
    x = np.array(begun.start)
    times = orbit.period * np.arange(cycles + 1)
    run = es.simulate(begun.replace({"start": tuple(x + 1e-7)}), times[-1], samples=times)
    assert run.attrs["outcome"] == "completed"
    away = np.linalg.norm(run.position.values - x, axis=1)
    second, third = np.array_split(away[cycles // 3 :], 2)
    return bool(third.max() > second.max())


def test_there_may_be_none() -> None:
    """Fig. 4's loop at its peak is stable at every ω from 30 down to 0.1."""
    found = critical_frequency(scenario("fig4").loop, 0.1, 30)
    assert found.outcome == "completed"
    assert found.crossings == ()
    assert found.stable == ((0.1, 30.0),)
    assert found.reached == 0.1
    assert (found.leading < 0).all()
    assert (np.diff(found.frequencies) > 0).all()
    text = found.text()
    assert "no crossing from ω = 30 down to 0.1 rad/s" in text
    assert "beyond ω = 30 rad/s the claim rests on averaging" in text


@pytest.mark.parametrize("frequency", [0.3, 1.0, 6.0])
def test_low_frequencies_are_judged_as_the_simulation_does(frequency: float) -> None:
    loop = at(scenario("fig4").loop, frequency)
    assert largest(periodic_orbit(loop)) < 0
    assert not grows(loop, 10)


def test_boundary_of_the_double_integrator() -> None:
    """The pole −2.0126 is critical at ω = 400; a digit of it is worth 0.8 % of ω."""
    loop = with_leads(-2, -2.0126, gain=1, **{"controller.channels.1.gain": 20})
    found = critical_frequency(loop, 100, 5000)
    (crossing,) = found.crossings
    assert crossing.frequency == pytest.approx(400, rel=4e-3)
    assert crossing.kind == "Neimark–Sacker"
    assert crossing.stable_above
    assert not crossing.stable_below
    assert crossing.exponent.imag == pytest.approx(1, rel=0.01)  # s³ + 2s² + s + 2 at p = −2
    assert found.stable == ((crossing.frequency, 5000.0),)
    for side in (-1, 1):
        beside = at(loop, crossing.frequency * (1 + side * 1e-6))
        assert (largest(periodic_orbit(beside)) < 0) == (side > 0)


@pytest.mark.parametrize(
    ("name", "kind", "cycles"),
    [("fig7", "period doubling", 45), ("turned", "Neimark–Sacker", 150)],
)
def test_simulations_on_both_sides(name: str, kind: str, cycles: int) -> None:
    loop = turned() if name == "turned" else scenario(name).loop
    found = critical_frequency(loop, 1, 300)
    first = found.crossings[0]
    assert first.kind == kind
    assert first.stable_above
    assert not grows(at(loop, 1.03 * first.frequency), cycles)
    assert grows(at(loop, 0.97 * first.frequency), cycles)


def turned() -> es.Loop:
    """References 80° late; the washout's lead atan(h/ω) of the signal, larger at low ω, adds."""
    late = {f"controller.channels.{i}.reference": -1.4 - i * pi / 2 for i in (0, 1)}
    return velocity_actuated(
        **late, field=es.Quadratic((0, 0), (1.0, 1.0), 1.0), **{"controller.washout": 3.0}
    )


def test_the_orbit_may_end() -> None:
    """With ε > 0 and the source far off, a fold; at the source itself, no crossing at all."""
    found = critical_frequency(near_the_fold(100.0), 20, 25600)
    (crossing,) = found.crossings
    assert crossing.kind == "fold"
    assert crossing.stable_above
    assert not crossing.stable_below
    assert found.reached == crossing.frequency
    assert f"the branch ends at ω = {found.reached:.7g} rad/s" in found.outcome
    assert found.outcome in found.text()
    rates = [
        largest(periodic_orbit(near_the_fold(crossing.frequency * (1 + d)))) for d in (1e-5, 4e-5)
    ]
    assert rates[1] / rates[0] == pytest.approx(2, rel=0.03)  # λ ∝ √(ω − ω_f)
    centred = near_the_fold(100.0).replace({"field.source": (0.0, 0.0)})
    assert critical_frequency(centred, 20, 25600).crossings == ()


def test_a_real_multiplier_through_1() -> None:
    """One axis, 1/(s − ε), at the peak: the washout leaves α c q ω²/(ω² + h²) of the gain.

    The orbit is its own mirror image; where that gain falls below ε it goes on, unstable.
    """
    epsilon, h, gain = 0.5, 200.0, 2.0
    loop = es.Loop(
        field=es.Quadratic((0.0,), (1.0,), 1.0),
        vehicle=es.PointMass((1 / (s - epsilon),)),
        controller=es.GradientES(300.0, h, (es.Channel(es.Dither(0.1), gain=gain / 0.1),)),
        start=(0.0,),
    )
    found = critical_frequency(loop, 20, 10000)
    (crossing,) = found.crossings
    assert crossing.kind == "real, +1"
    assert crossing.exponent.imag == 0
    assert crossing.frequency == pytest.approx(h * math.sqrt(epsilon / (gain - epsilon)), rel=0.01)
    assert found.reached == 20.0
    for side in (-1, 1):
        assert grows(at(loop, crossing.frequency * (1 + side * 0.02)), 400) == (side < 0)


@dataclass
class Fake:
    """A point of a branch whose largest real part is a formula."""

    frequency: float

    @property
    def leading(self) -> float:
        return -((math.log(self.frequency) - CENTRE) ** 2) + HALF**2

    @property
    def exponents(self) -> np.ndarray:
        return np.array([self.leading + 1j, self.leading - 1j, -1e-6])

    orbit = SimpleNamespace(period=1.0)


CENTRE, HALF = 1.2345, 2e-5


def test_close_pairs_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A parabola that reaches 4e-10 above 0, for 4e-5 of ω, between two points 0.17 apart."""
    monkeypatch.setattr(branch, "near", lambda _, wanted: Fake(wanted))
    walk: Any = [Fake(math.exp(u)) for u in np.arange(3.0, 0.0, -0.1733)]
    points = critical._refined(walk)
    found = critical._crossings(points, branch.Branch(tuple(walk), ""))
    logarithms = [math.log(crossing.frequency) for crossing in found]
    assert logarithms == pytest.approx([CENTRE + HALF, CENTRE - HALF], abs=1e-7)
    assert [c.stable_above for c in found] == [True, False]


def test_agreement_at_the_upper_end() -> None:
    loop = force_actuated()
    found = critical_frequency(loop, 10, 200)
    top = at(loop, 200)
    orbit = periodic_orbit(top)
    expected = match(average(top).eigenvalues, orbit.exponents, 200)
    assert found.agreement is not None
    assert found.agreement.worst == pytest.approx(expected.worst, rel=1e-6)
    assert f"within {expected.worst:.3g} 1/s" in found.text()


def test_where_average_and_orbit_disagree_at_the_upper_end_it_is_said() -> None:
    """p = −2.0126, critical at ω = 400: at 300 the average still says stable."""
    loop = with_leads(-2, -2.0126, gain=1, **{"controller.channels.1.gain": 20})
    found = critical_frequency(loop, 100, 300)
    assert found.crossings == ()
    assert found.stable == ()
    assert "stable nowhere in the interval" in found.text()
    assert "cannot be trusted" in found.text()
    assert "rests on averaging" not in found.text()


def test_a_probe_is_scaled_so_that_the_position_moves_as_before() -> None:
    """For 1/s², a = αω² at every ω, and the demodulation turned by π: the same crossing."""
    loop = force_actuated()
    changes = {
        f"controller.channels.{i}": es.Channel(
            dither=es.Probe(0.1 * 30**2, phase=math.pi + phase),
            gain=10,
            compensator=es.Lead(gain=5, zero=-0.5, pole=-3),
            reference=phase,
        )
        for i, phase in ((0, 0.0), (1, -math.pi / 2))
    }
    probed = es.Loop(
        field=loop.field,
        vehicle=loop.vehicle,
        controller=es.GradientES(30, 1.0, tuple(changes.values())),
        start=(0, 0),
    )
    expected = critical_frequency(loop, 1, 100).crossings
    found = critical_frequency(probed, 1, 100).crossings
    assert len(expected) == len(found) == 1
    assert found[0].frequency == pytest.approx(expected[0].frequency, rel=1e-7)


def test_no_orbit_at_the_upper_end() -> None:
    found = critical_frequency(near_the_fold(100.0), 5, 30)
    assert found.outcome.startswith("no orbit at ω = 30 rad/s: the branch ends at ω = 33.47")
    assert found.crossings == found.stable == ()
    assert found.agreement is None
    assert found.outcome in found.text()


def test_what_is_not_periodic_at_every_frequency_is_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="moves"):
        critical_frequency(scenario("fig5").loop, 1, 30)
    loop = velocity_actuated(**{"controller.channels.0.ratio": 2**0.5})
    with pytest.raises(es.InvalidDescription, match="without a common period"):
        critical_frequency(loop, 1, 30)


@pytest.mark.parametrize(
    ("low", "high", "path"),
    [(30, 30, "high"), (40, 30, "high"), (0, 30, "low"), (-1, 30, "low"), (1, math.inf, "high")],
)
def test_an_interval_that_is_none_is_refused(low: float, high: float, path: str) -> None:
    with pytest.raises(es.InvalidDescription) as refused:
        critical_frequency(velocity_actuated(), low, high)
    assert refused.value.path == path
    with pytest.raises(es.InvalidDescription, match="must be a Loop"):
        critical_frequency("fig4", 1, 2)  # pyright: ignore[reportArgumentType]
