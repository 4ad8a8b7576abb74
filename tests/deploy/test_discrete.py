"""`discretize`: what it makes, and what it refuses."""

from __future__ import annotations

import math
import pickle
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import extremum as es
from extremum import pi, s
from extremum.deploy.machine import TURN, polynomial
from extremum.papers import zhang2007

FIG4 = zhang2007.scenario("fig4").loop
FIG5 = zhang2007.scenario("fig5").loop


def fig4(dt: float = 1e-3) -> es.DiscreteController:
    return es.discretize(FIG4.controller, dt, vehicle=FIG4.vehicle)


def test_a_step_is_a_pure_function() -> None:
    ctrl = fig4()
    state = ctrl.init(1.0)
    first, again = ctrl.step(state, 0.7), ctrl.step(state, 0.7)
    assert first == again
    assert isinstance(hash(state), int)
    assert fig4() == ctrl
    assert ctrl.inputs == ("v_x", "v_y")
    assert state._fields == ctrl.state_names


def test_samples_may_be_any_number_and_none() -> None:
    ctrl = fig4()
    state = ctrl.init(np.float64(1.0))
    wanted, _ = ctrl.step(state, 2.0)
    for sample in (2, np.float32(2.0), np.int64(2), Fraction(2)):
        u, after = ctrl.step(state, sample)  # pyright: ignore[reportArgumentType]
        assert u == wanted
        assert all(type(x) is float for x in u)
        assert type(after.xi_last) is float
    assert ctrl.step(state, None)[0] == ctrl.step(state, math.nan)[0]
    assert ctrl.step(state, 10**400)[0] == ctrl.step(state, math.inf)[0]
    with pytest.raises(es.InvalidDescription, match="None where the sample is missing"):
        ctrl.step(state, "2.0")  # pyright: ignore[reportArgumentType]


def test_controllers_and_states_go_to_other_processes_and_come_back() -> None:
    ctrl = fig4()
    _, state = ctrl.step(ctrl.init(1.0), 0.7)
    other, same = pickle.loads(pickle.dumps((ctrl, state)))
    assert other == ctrl
    assert same == state
    assert type(same) is type(state)
    assert other.step(same, 0.3) == ctrl.step(state, 0.3)


def test_step_and_init_say_what_they_do_and_refuse_other_states() -> None:
    ctrl = fig4()
    assert "the next state" in (ctrl.step.__doc__ or "")
    assert "the first sample" in (ctrl.init.__doc__ or "")
    for state in (None, (1.0, 2.0), 3):
        with pytest.raises(es.InvalidDescription, match="not one of this controller"):
            ctrl.step(state, 1.0)


def test_the_equations_are_printed() -> None:
    text = str(fig4())
    assert "K = ω/tan(dt ω/2)" in " ".join(text.split())
    assert "ξ_last⁺ = ξ" in text
    assert "controller.channels.0.gain = 10" in text
    assert "{J_{last}}^+ &= J_{held}" in fig4().system.latex()


def test_the_signal_starts_the_washout_or_its_start_does() -> None:
    of = es.GradientES(
        frequency=30, washout=1, channels=(es.Channel(es.Dither(0.1, through=1 / s), gain=1),)
    )
    starts = {
        start: es.discretize(of.replace({"washout_start": start}), 1e-3)
        for start in ("signal", "zero", 4.0)
    }
    xi = {}
    for start, ctrl in starts.items():
        _, state = ctrl.step(ctrl.init(5.0), 5.0)
        xi[start] = state.xi_last
    # what Tustin's s/(s + h) makes of a first change: K/(K + h)
    share = 1 / (1 + math.tan(30 * 1e-3 / 2) / 30)
    assert xi == pytest.approx({"signal": 0.0, "zero": 5 * share, 4.0: share}, rel=1e-14)


@pytest.mark.parametrize("precision", [64, 32])
def test_the_sines_polynomial(precision: int) -> None:
    terms = polynomial(precision)
    largest = 0.0
    for x in np.linspace(-0.25, 0.25, 2001).tolist():
        with mpmath.workdps(40):
            value = sum(mpmath.mpf(c) * mpmath.mpf(x) ** (2 * i + 1) for i, c in enumerate(terms))
            largest = max(largest, abs(float(value - mpmath.sin(2 * mpmath.pi * x))))
    assert largest < {64: 4e-16, 32: 2e-8}[precision]


def test_an_oscillator_goes_all_the_way_round() -> None:
    of = es.GradientES(
        frequency=7.0,
        washout=0.1,
        channels=tuple(
            es.Channel(es.Probe(1.0, phase), gain=0.0, reference=0.0, ratio=ratio)
            for phase, ratio in ((0.0, 1), (-pi / 2, 1), (0.3, Fraction(2, 3)), (0.0, 0.77))
        ),
    )
    ctrl = es.discretize(of, 0.0123)
    u = ctrl.run([0.0] * 5000)
    times = 0.0123 * np.arange(5000)
    expected = [
        np.sin(7 * times),
        -np.cos(7 * times),
        np.sin(14 / 3 * times + 0.3),
        np.sin(7 * 0.77 * times),
    ]
    assert np.abs(u.T - np.array(expected)).max() < 3e-13


def test_every_channel_demodulates_at_the_continuous_washouts_phase() -> None:
    """Also channels whose frequency is not the one at which the washout is exact."""
    h, omega, dt = 10.0, 6.0, 2 * math.pi / 9.0 / 24  # 24 samples of the faster one
    pairs = [(ratio, phase) for ratio in (Fraction(1), Fraction(3, 2)) for phase in (0.0, -pi / 2)]
    channels = tuple(
        es.Channel(es.Probe(1e-9), gain=1.0, reference=phase, ratio=ratio) for ratio, phase in pairs
    )
    of = es.GradientES(frequency=omega, washout=h, channels=channels)
    ctrl = es.discretize(of, dt)
    count = 36 * 40
    for ratio in (Fraction(1), Fraction(3, 2)):
        w = float(ratio) * omega
        u = ctrl.run([math.sin(w * k * dt) for k in range(2 * count)])[-count:].mean(axis=0)
        response = 1j * w / (1j * w + h)
        first = 2 * [r for r, _ in pairs].index(ratio) // 2
        along, across = u[first], u[first + 1]
        assert math.atan2(-across, along) == pytest.approx(np.angle(response), abs=1e-9)
        if ratio == 1:
            assert math.hypot(along, across) == pytest.approx(abs(response) / 2, rel=1e-9)


@pytest.mark.parametrize("b", [3.0, 50.0])
def test_elsewhere_the_washout_errs_as_it_is_stated(b: float) -> None:
    """What it should do at b it does at b (1 + (ω² − b²) dt²/12); −h decays at h (1 + …)."""
    h, omega, dt = 8.0, 20.0, 5e-3
    of = es.GradientES(
        frequency=omega, washout=h, channels=(es.Channel(es.Probe(1e-9), gain=0.0, reference=0),)
    )
    ctrl = es.discretize(of, dt)
    there = b * (1 + (omega**2 - b**2) * dt**2 / 12)
    state, seen, times = ctrl.init(0.0), [], dt * np.arange(6000)
    for t in times:
        _, state = ctrl.step(state, math.sin(there * t))
        seen.append(state.xi_last)
    late = slice(3000, None)
    waves = np.stack([np.sin(there * times[late]), np.cos(there * times[late])], axis=1)
    along, across = np.linalg.lstsq(waves, np.array(seen)[late], rcond=None)[0]
    assert complex(along, across) == pytest.approx(1j * b / (1j * b + h), abs=1e-4)
    assert abs(1j * there / (1j * there + h) - 1j * b / (1j * b + h)) > 2e-4
    xi = state.xi_last
    for _ in range(100):
        _, state = ctrl.step(state, None)
    rate = -math.log(state.xi_last / xi) / (100 * dt)
    assert rate == pytest.approx(h * (1 + (omega**2 + h**2) * dt**2 / 12), rel=3e-6)
    assert rate != pytest.approx(h, rel=1e-4)


def test_a_ramp_is_exact_at_the_samples() -> None:
    of = FIG4.controller.replace({"probe_ramp": 0.3, "channels.0.gain": 0.0})
    u = es.discretize(of, 1e-3, vehicle=FIG4.vehicle).run([1.0] * 2000)[:, 0]
    times = 1e-3 * np.arange(2000)
    assert np.abs(u - (1 - np.exp(-times / 0.3)) * 2.4 * np.cos(30 * times)).max() < 1e-12


def test_commensurate_oscillators_never_part() -> None:
    channels = tuple(
        es.Channel(es.Probe(1.0), gain=0.0, reference=0.0, ratio=ratio)
        for ratio in (Fraction(2, 3), 1, Fraction(5, 4))
    )
    ctrl = es.discretize(es.GradientES(frequency=11.0, washout=1.0, channels=channels), 1e-3)
    state = ctrl.skip(ctrl.init(0.0), 10**15)
    two, three, five = (o.increment for o in ctrl.machine.oscillators)
    assert 3 * two == 2 * three
    assert 5 * three == 4 * five
    assert (state.phase_1 * 3 - state.phase_2 * 2) % TURN == 0


def test_skipping_is_as_many_steps_for_the_phase_and_the_age() -> None:
    ctrl = fig4()
    state = ctrl.init(1.0)
    _, state = ctrl.step(state, 0.5)
    stepped = state
    for _ in range(1234):
        _, stepped = ctrl.step(stepped, None)
    skipped = ctrl.skip(state, 1234)
    assert skipped.phase == stepped.phase
    assert skipped.age == pytest.approx(stepped.age)
    assert skipped.xi_last == state.xi_last
    assert ctrl.skip(state, 0) == state
    assert ctrl.skip(state, 10**400).age == 2.0**24


def test_a_record_is_placed_at_its_instants() -> None:
    ctrl = fig4()
    record = [1.0, 0.9, 0.7, 0.8]
    late = ctrl.run(record, times=[5.0, 5.0011, 5.0039, 5.005])
    assert np.array_equal(late, ctrl.run([1.0, 0.9, None, None, 0.7, 0.8]))
    assert ctrl.run([]).shape == (0, 2)
    assert ctrl.run([], times=[]).shape == (0, 2)


def test_plants_are_taken_from_the_vehicle() -> None:
    of = FIG5.controller.replace(
        {"channels.0.dither.through": None, "channels.1.dither.through": None}
    )
    ctrl = es.discretize(of, 1e-3, vehicle=FIG5.vehicle)
    same = es.discretize(FIG5.controller, 1e-3, vehicle=FIG5.vehicle)
    samples = np.random.default_rng(0).normal(size=100).tolist()
    assert np.array_equal(ctrl.run(samples), same.run(samples))
    with pytest.raises(es.InvalidDescription, match=r"channels\.0\.dither\.through.*vehicle=loop"):
        es.discretize(of, 1e-3)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: fig4(0.0), "dt = 0.0: must be greater than 0"),
        (lambda: fig4(-1e-3), "must be greater than 0"),
        (lambda: fig4(math.nan), "finite"),
        (lambda: fig4(0.035), "leaves 5.98 samples in a period of the fastest dither"),
        (lambda: es.discretize(FIG4, 1e-3), "must be a Controller"),  # pyright: ignore[reportArgumentType]
        (lambda: es.discretize(FIG4.controller, 1e-3, vehicle=3), "must be a Vehicle"),  # pyright: ignore[reportArgumentType]
        (
            lambda: es.discretize(FIG4.controller, 1e-3, vehicle=es.PointMass((1 / s,) * 3)),
            "has 3 inputs, the controller drives 2",
        ),
        (lambda: fig4().skip(fig4().init(1.0), -1), "time does not go back"),
        (lambda: fig4().skip(fig4().init(1.0), 1.5), "whole number"),  # pyright: ignore[reportArgumentType]
        (lambda: fig4().change(fig4().init(1.0), gain=2), "changes=Changes(time=1.0)"),
        (lambda: fig4().status(fig4().init(1.0)), "practice.detector"),
        (lambda: fig4().run([1.0, 2.0], times=[0.0, -1.0]), "sample 1 at -1.0 s comes before"),
        (lambda: fig4().run([1.0, 2.0], times=[0.0, 0.0004]), "belong to the same instant"),
        (lambda: fig4(1e-12), "at most 1e+09 make sense"),
        (lambda: fig4().run(3.0), "must be a list of numbers"),  # pyright: ignore[reportArgumentType]
        (lambda: fig4().run([1.0, 2.0], times=["a", "b"]), "one finite time"),  # pyright: ignore[reportArgumentType]
        (lambda: fig4().run([1.0, 2.0], times=[0.0, 1e30]), "span more than 1e+08"),
        (
            lambda: es.DiscreteController(controller=FIG4.controller, dt=1e-3),
            "must have 2 names and units; use discretize",
        ),
        (
            lambda: (
                es.discretize(
                    FIG4.controller, 1e-3, vehicle=FIG4.vehicle, practice=es.Practice(delay=1e308)
                ).machine
            ),
            "so large or so small",
        ),
        (lambda: fig4().run([1.0, 2.0], times=[0.0]), "one finite time (s) for each"),
    ],
)
def test_what_cannot_be_is_refused(build, message: str) -> None:
    with pytest.raises(es.InvalidDescription) as caught:
        build()
    assert message in str(caught.value)


def test_few_samples_are_warned_of() -> None:
    with pytest.warns(UserWarning, match=r"leaves 10\.5 samples in a period"):
        fig4(0.02)


def test_a_factor_cannot_be_nothing() -> None:
    ctrl = es.discretize(
        FIG4.controller, 1e-3, vehicle=FIG4.vehicle, practice=es.Practice(changes=es.Changes(1.0))
    )
    state = ctrl.init(1.0)
    assert ctrl.change(state, gain=0).gain_wanted == 0
    with pytest.raises(es.InvalidDescription, match="nothing is sought"):
        ctrl.change(state, amplitude=0)
    with pytest.raises(es.InvalidDescription, match="finite"):
        ctrl.change(state, gain=math.inf)
    with pytest.raises(es.InvalidDescription, match="must be at most 1e"):
        ctrl.change(state, gain=1e7)
