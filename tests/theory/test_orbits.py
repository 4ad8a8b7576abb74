from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import pi, s
from extremum.engines import reference, taylor
from extremum.papers.zhang2007 import scenario
from extremum.theory import excursion
from extremum.theory.floquet import match
from extremum.theory.orbits import Orbit, periodic_orbit


def with_leads(zero: float, pole: float, gain: float = 5.0, **changes: Any) -> es.Loop:
    lead = es.Lead(gain, zero, pole)
    return force_actuated(
        **{f"controller.channels.{i}.compensator": lead for i in (0, 1)}, **changes
    )


def unstable_poles(
    compensator: Any,
    gains: tuple[float, float],
    frequency: float,
    *,
    amplitude: float = 0.05,
    source: tuple[float, float] = (1.0, -1.0),
    through: Any = None,
) -> es.Loop:
    """The paper's Fig. 3 with ε = 0.5 and h = 1."""
    return es.Loop(
        field=es.Quadratic(source=source, q=(1.0, 0.5), peak=1.0),
        vehicle=es.PointMass((1 / (s - 0.5), 1 / (s - 0.5))),
        controller=es.GradientES(
            frequency,
            1.0,
            tuple(
                es.Channel(
                    es.Dither(amplitude, phase=phase, through=through),
                    gain=gain,
                    compensator=compensator,
                )
                for phase, gain in zip((0.0, -pi / 2), gains, strict=True)
            ),
        ),
        start=(0, 0),
    )


def nodes(orbit: Orbit) -> int:
    assert orbit.closed is not None
    return len(orbit.closed.nodes)


def largest(orbit: Orbit) -> float:
    assert orbit.found, orbit.outcome
    return float(orbit.exponents[0].real)


# --- the numbers of the errata and of the traps -----------------------------------------------


@pytest.mark.parametrize(
    ("zero", "pole", "expected"),
    [
        (-2.0, -1.5, (0.1544, 0.1518, 0.1515)),
        (-0.5, -3.0, (-0.4561, -0.4551, -0.4550)),
        (-2.0, -10.0, (-0.1014, -0.1015, -0.1015)),
        (-1.2, -1.1, (0.0419, 0.0394, 0.0392)),
    ],
)
def test_first_erratum(zero: float, pole: float, expected: tuple[float, ...]) -> None:
    for frequency, rate in zip((30, 100, 400), expected, strict=True):
        loop = with_leads(zero, pole, **{"controller.frequency": frequency})
        assert largest(periodic_orbit(loop)) == pytest.approx(rate, abs=6e-5)


@pytest.mark.parametrize(
    ("frequency", "rate"), [(100, -0.157), (1600, -0.528), (25600, -0.742), (409600, -0.789)]
)
def test_second_erratum_and_how_slowly_averaging_comes_true(frequency: float, rate: float) -> None:
    orbit = periodic_orbit(unstable_poles(es.Lead(4, -3, -2.5), (10, 10), frequency))
    assert largest(orbit) == pytest.approx(rate, abs=1e-3)
    assert orbit.uncertainty < 1e-10
    if frequency == 25600:
        assert orbit.offset[0] == pytest.approx(0.26318, abs=1e-5)


def test_an_orbit_off_the_peak_that_the_printed_formulas_call_unstable() -> None:
    loop = unstable_poles(
        es.Lead(1, -0.8, -1), (10, 20), 6400, amplitude=0.1, source=(0.05, 0.05), through=1 / s
    )
    orbit = periodic_orbit(loop)
    assert largest(orbit) == pytest.approx(-0.23765, abs=1e-5)
    assert orbit.offset[0] == pytest.approx(0.0833, abs=5e-5)


@pytest.mark.parametrize("frequency", [100, 3200])
@pytest.mark.parametrize("source", [(0.05, -0.05), (1.0, -1.0)])
def test_integral_action_leaves_no_offset(frequency: float, source: tuple[float, float]) -> None:
    loop = unstable_poles((s + 0.25) / s, (20, 30), frequency, amplitude=0.1, source=source)
    orbit = periodic_orbit(loop)
    assert orbit.stable
    assert np.abs(orbit.offset).max() < 1e-12
    limit = [-1.0, *np.roots([1, 1.5, 0.5]), *np.roots([1, 1.0, 0.375])]  # s² + (g − ε)s + g/4
    assert match(limit, orbit.exponents, frequency).worst < 0.5 / frequency


def test_a_force_is_taken_up_by_an_integrator_and_not_by_a_lead_alone() -> None:
    changes: dict[str, Any] = {
        "vehicle.disturbance": (0.3, 0.0),
        "controller.frequency": 400,
        "controller.channels.0.gain": 1.0,
        "controller.channels.1.gain": 1.5,
    }
    channels = (f"controller.channels.{i}.compensator" for i in (0, 1))
    integrating = dict.fromkeys(channels, 100 * (s + 0.3) ** 2 / (s * (s + 10)))
    orbit = periodic_orbit(force_actuated(**changes, **integrating))
    assert largest(orbit) == pytest.approx(-0.199, abs=5e-4)
    assert np.abs(orbit.offset).max() < 1e-12
    forced = scenario("constant_force").loop.replace({"controller.frequency": 400})
    assert periodic_orbit(forced).offset[0] == pytest.approx(0.36, abs=1e-3)


@pytest.mark.parametrize(
    ("zero", "frequency", "pole"), [(-2, 400, -2.0126), (-2, 1600, -2.0031), (-0.5, 1600, -0.5008)]
)
def test_stability_boundary_of_the_double_integrator(
    zero: float, frequency: float, pole: float
) -> None:
    """The exponent changes sign within half a digit of the pole stated."""
    rates = []
    for step in (-6e-5, 6e-5):
        changes = {"controller.frequency": frequency, "controller.channels.1.gain": 20}
        rates.append(largest(periodic_orbit(with_leads(zero, pole + step, gain=1, **changes))))
    assert rates[0] < 0 < rates[1]


# --- moving sources ---------------------------------------------------------------------------


def test_tracking_error_of_the_figure_eight() -> None:
    """Measured 0.131 and 0.467 in the source's own frequencies, 0.1 and 0.2 rad/s."""
    orbit = periodic_orbit(scenario("fig5").loop)
    assert orbit.period == pytest.approx(20 * math.pi)
    assert abs(orbit.harmonic(0.1)[0]) == pytest.approx(0.131, abs=5e-4)
    assert abs(orbit.harmonic(0.2)[1]) == pytest.approx(0.467, abs=5e-4)
    assert orbit.stable
    assert np.abs(orbit.multipliers).min() < 1e-24


@pytest.mark.parametrize("name", ["fig5", "commensurate"])
def test_the_simulated_loop_comes_to_the_orbit_about_the_moving_source(name: str) -> None:
    loop = scenario(name).loop.replace({"controller.washout_start": "signal"})
    orbit = periodic_orbit(loop)
    wanted = orbit.dataset(16 * nodes(orbit) + 1).isel(time=slice(0, 400))
    waited = math.ceil(45 / orbit.period) * orbit.period
    times = waited + wanted.time.values
    run = es.simulate(loop, times[-1], samples=[0, *times])
    assert run.position.values[1:] == pytest.approx(wanted.position.values, abs=1e-6)
    assert run.J.values[1:] == pytest.approx(wanted.J.values, abs=1e-6)


def test_the_averaged_loop_s_orbit_leads_straight_to_a_slow_source(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(excursion, "_grown")
    assert periodic_orbit(scenario("fig6").loop).stable


def test_a_fast_source_is_reached_as_its_excursion_grows() -> None:
    """At ω_m = 0.5 the averaged loop's orbit is no guess; the simulated loop comes to ours."""
    loop = scenario("fig5").loop.replace(
        {"field.path.frequency": 0.5, "controller.washout_start": "signal", "start": (0, 0)}
    )
    orbit = periodic_orbit(loop)
    assert orbit.stable
    run = es.simulate(loop, 9 * orbit.period, samples=9 * orbit.period * np.arange(9) / 8)
    first = orbit.dataset(2).position.values[0]
    assert run.position.values[-1] == pytest.approx(first, abs=1e-6)


def test_a_source_too_fast_to_be_followed() -> None:
    """Six times that excursion: the loop escapes at once, and the outcome says how far it goes."""
    loop = scenario("fig5").loop.replace(
        {
            "field.path.frequency": 0.5,
            "field.path.amplitude": 6.0,
            "controller.washout_start": "signal",
            "start": (0, 0),
        }
    )
    assert es.simulate(loop, 5.0).attrs["outcome"] == "escaped"
    orbit = periodic_orbit(loop)
    assert not orbit.found
    assert "of the source's excursion" in orbit.outcome


def test_a_ramping_source_is_followed_with_the_error_of_a_type_1_loop() -> None:
    """1/s: x̃ = −V/(α c q); the source's place drops out of the equations, so there is an orbit."""
    velocity = np.array([0.02, -0.01])
    moving = es.Moving(es.Quadratic((0, 0), (1.0, 0.5)), es.Line(tuple(velocity)))
    orbit = periodic_orbit(velocity_actuated(field=moving, **{"controller.frequency": 4000}))
    assert orbit.offset == pytest.approx(-velocity / (0.08 * 10 * np.array([1, 0.5])), rel=1e-3)
    type_2 = periodic_orbit(force_actuated(field=moving))
    assert np.abs(type_2.offset).max() < 1e-12


# --- the orbit itself -------------------------------------------------------------------------


def started_on(loop: es.Loop, orbit: Orbit) -> es.Loop:
    """The loop started on the orbit, for vehicles whose state is the position."""
    position = orbit.dataset(2).position.values[0]
    names = [str(x) for x in orbit.frame.system.states]
    eta = orbit.start[names.index("e")] + 1.0
    return loop.replace({"start": tuple(position), "controller.washout_start": float(eta)})


@pytest.mark.parametrize("gain", [10.0, -10.0, -40.0])
@pytest.mark.parametrize("frequency", [2.0, 30.0])
def test_a_run_from_the_orbit_stays_on_it(gain: float, frequency: float) -> None:
    """Simulated in its own coordinates by another integrator, stable or not."""
    loop = velocity_actuated(
        **{"controller.channels.1.gain": gain, "controller.frequency": frequency}
    )
    orbit = periodic_orbit(loop)
    assert orbit.found
    assert orbit.stable == (gain > 0)
    longer = 1.5 * orbit.period
    run = es.simulate(started_on(loop, orbit), longer, samples=193, engine="reference")
    wanted = orbit.dataset(129)
    assert run.position.values[:129] == pytest.approx(wanted.position.values, abs=1e-9)
    assert run.J.values[:129] == pytest.approx(wanted.J.values, abs=1e-9)
    assert run.position.values[128:] == pytest.approx(run.position.values[:65], abs=1e-9)
    low, high = run.position.attrs["min"], run.position.attrs["max"]
    assert orbit.amplitude == pytest.approx((high - low) / 2, abs=1e-8)
    assert orbit.J_range == pytest.approx((run.J.attrs["min"], run.J.attrs["max"]), abs=1e-8)
    assert orbit.mean == pytest.approx(wanted.position.values[:-1].mean(axis=0), abs=1e-12)
    assert orbit.J_mean == pytest.approx(wanted.J.values[:-1].mean(), abs=1e-12)


def test_a_perturbation_grows_as_the_exponent_says() -> None:
    """Ten cycles of the unstable mode, in simulation: e^{λt}, once the others have died away."""
    loop = velocity_actuated(**{"controller.channels.1.gain": -10.0})
    orbit = periodic_orbit(loop)
    start = started_on(loop, orbit)
    x, y = start.start
    times = orbit.period * np.array([0, 20, 30])
    runs = [
        es.simulate(start.replace({"start": (x, y + sign * 1e-5)}), times[-1], samples=times)
        for sign in (1, -1)
    ]
    apart = runs[0].position.values[:, 1] - runs[1].position.values[:, 1]
    growth = math.exp(largest(orbit) * (times[2] - times[1]))
    assert apart[2] / apart[1] == pytest.approx(growth, rel=1e-5)


@pytest.mark.parametrize("frequency", [30.0, 31.2345678901234])
def test_several_frequencies(frequency: float) -> None:
    """2 : 3, and an ω whose decimals are no ratio of small numbers; the run comes to the orbit."""
    loop = velocity_actuated(
        **{"controller.channels.0.ratio": Fraction(2, 3), "controller.frequency": frequency}
    )
    orbit = periodic_orbit(loop)
    assert orbit.period == pytest.approx(2 * 2 * math.pi / (2 / 3 * frequency))
    assert orbit.stable
    waited = 200 * orbit.period
    run = es.simulate(loop, waited + orbit.period, samples=waited + orbit.period * EIGHTH)
    assert run.position.values[1:] == pytest.approx(orbit.dataset(9).position.values, abs=1e-7)


EIGHTH = np.arange(9) / 8


def test_many_cycles_in_one_period() -> None:
    """100 : 101 repeats after 100 cycles only; the beat couples the axes slowly."""
    loop = velocity_actuated(**{"controller.channels.0.ratio": Fraction(101, 100)})
    orbit = periodic_orbit(loop)
    assert nodes(orbit) == 100
    assert orbit.residual < 1e-13
    run = es.simulate(started_on(loop, orbit), orbit.period, samples=2)
    assert run.position.values[-1] == pytest.approx(run.position.values[0], abs=1e-9)


# --- hard to reach, or not there --------------------------------------------------------------


def near_the_fold(frequency: float) -> es.Loop:
    return unstable_poles(es.Lead(4, -3, -2.5), (10, 10), frequency, through=1 / s)


def test_the_orbit_is_followed_from_a_high_frequency() -> None:
    """Near a fold Newton's method from the averaged equilibrium fails; continuation arrives."""
    orbit = periodic_orbit(near_the_fold(33.6))
    assert orbit.found
    assert "continuation" in orbit.notes[-1]
    frame, start, times = orbit.frame, orbit.start.tolist(), np.array([0.0, orbit.period])
    once = reference.integrate(frame.system, frame.values, times, tol=1e-13, state=start)
    assert once.states[1] == pytest.approx(start, abs=1e-10)


def test_where_the_branch_ends_the_outcome_says_so() -> None:
    """Below the fold nothing is left: the loop, started at the source, escapes."""
    loop = near_the_fold(30.0).replace({"start": (1.0, -1.0)})
    assert es.simulate(loop, 200.0).attrs["outcome"] == "escaped"
    orbit = periodic_orbit(near_the_fold(30.0))
    assert not orbit.found
    assert "fold" in orbit.outcome
    assert "ω = 33.47" in orbit.outcome
    assert math.isnan(orbit.J_mean)
    assert len(orbit.mean) == len(orbit.amplitude) == len(orbit.multipliers) == 0
    with pytest.raises(es.InvalidDescription, match="fold"):
        orbit.dataset()


def test_at_a_fold_the_exponent_vanishes_as_a_square_root() -> None:
    """λ ∝ √(ω − ω_f): two orbits merge where the outcome says."""
    end = float(periodic_orbit(near_the_fold(30.0)).outcome.split("ω = ")[1].split(" ")[0])
    rates = [largest(periodic_orbit(near_the_fold(end * (1 + d)))) for d in (1e-4, 4e-4)]
    assert rates[1] / rates[0] == pytest.approx(2, rel=0.02)


def test_without_an_averaged_equilibrium_there_is_an_outcome() -> None:
    """g = α c q = ε in the second axis: the averaged offset ε x*/(g − ε) is infinite."""
    orbit = periodic_orbit(unstable_poles(1, (20, 20), 60))
    assert not orbit.found
    assert "no equilibrium" in orbit.outcome


def test_without_heyoka_the_same_orbit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = scenario("fig7").loop
    ours = periodic_orbit(loop)
    monkeypatch.setattr(taylor, "available", lambda: False)
    theirs = periodic_orbit(loop)
    assert theirs.start == pytest.approx(ours.start, abs=1e-10)
    assert theirs.exponents == pytest.approx(ours.exponents, abs=1e-8)
    assert theirs.amplitude == pytest.approx(ours.amplitude, abs=1e-9)


def test_the_dataset_is_one_period_of_the_loop() -> None:
    loop = scenario("constant_force").loop
    orbit = periodic_orbit(loop)
    found = orbit.dataset(33)
    assert found.time.values[[0, -1]] == pytest.approx([0, orbit.period])
    assert found.attrs["period"] == orbit.period
    ends = found.isel(time=[0, -1])
    for name in ("position", "J", "input", "xtilde", "zeta_x"):
        first, last = ends[name].values
        assert last == pytest.approx(first, abs=1e-11)
    x, y = found.position.values.T
    assert found.J.values == pytest.approx(loop.field.at(x, y), abs=1e-13)
    swing = found.position - found.source - found.offset
    wave = 0.1 * np.stack([np.sin(30 * found.time), -np.cos(30 * found.time)], axis=1)
    assert swing.values == pytest.approx(wave, abs=1e-12)


def test_an_orbit_prints() -> None:
    text = periodic_orbit(scenario("fig4").loop).text()
    assert "period 0.2094395 s, stable" in text
    assert "mean position (-1, -1) m" in text
    assert "amplitude (0.0799" in text
    assert "Floquet exponents (-0.40106, -0.79759, -1.0013) 1/s" in text
    missing = str(periodic_orbit(near_the_fold(30.0)))
    assert missing.startswith("no periodic orbit: the branch ends at ω = 33.47")
    assert "(-0.45608+0.6264j, -0.45608-0.6264j, " in str(periodic_orbit(force_actuated()))


def test_only_a_loop_has_an_orbit() -> None:
    with pytest.raises(es.InvalidDescription, match="must be a Loop"):
        periodic_orbit("fig4")  # pyright: ignore[reportArgumentType]
