"""A sensor in the theory: the exact frame, the average at finite ω, M, L, bias and the verdict."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import extremum as es
from extremum import s
from extremum.engines import reference
from extremum.theory.averaging import Average, average
from extremum.theory.demodulation import gradient
from extremum.theory.floquet import match
from extremum.theory.frame import relative
from extremum.theory.linear import loop_gain
from extremum.theory.offsets import bias
from extremum.theory.orbits import periodic_orbit
from extremum.theory.verdict import stability

GAS = "1/(2.96*s + 1)"
RINGING = "(20*s + 900)/(s**2 + 30*s + 900)"
ALLPASS = "(1 - 0.02*s)/(1 + 0.02*s)"


def response(loop: es.Loop, frequency: float) -> complex:
    """F(jω), from the sensor's text."""
    return complex(eval(str(loop.sensor), {"s": 1j * frequency}))


def corrected(loop: es.Loop, *, washout: bool = True) -> es.Loop:
    """The references turned by arg F(jω) and, if asked, by the washout's atan(h/ω)."""
    controller, changes = gradient(loop), dict[str, Any]()
    for i, channel in enumerate(controller.channels):
        w = controller.frequencies()[i]
        lead = math.atan(controller.washout / w) if washout else 0.0
        phase = channel.dither.phase + lead + np.angle(response(loop, w))
        changes[f"controller.channels.{i}.reference"] = es.Reference(float(phase))
    return loop.replace(changes)


def boosted(loop: es.Loop, factor: float = 1.0) -> es.Loop:
    """The gains times factor/|F(jω)|."""
    channels = enumerate(gradient(loop).channels)
    sizes = [abs(response(loop, w)) for w in gradient(loop).frequencies()]
    return loop.replace(
        {f"controller.channels.{i}.gain": factor * c.gain / sizes[i] for i, c in channels}
    )


def distances(loop: es.Loop) -> np.ndarray:
    """|averaged eigenvalue − exponent|, the eigenvalue of the least size first."""
    orbit = periodic_orbit(loop)
    assert orbit.found
    pairs = match(average(loop).eigenvalues, orbit.exponents, orbit.frequency)
    return pairs.distances[np.argsort(np.abs(pairs.averaged))]


def said(verdict: es.Verdict, words: str) -> bool:
    return any(words in remark for remark in verdict.remarks)


# --- the exact loop ----------------------------------------------------------------------------


@pytest.mark.parametrize("sensor", [GAS, RINGING, ALLPASS, 2.5, s / (s + 0.3)])
@pytest.mark.parametrize(
    "field",
    [
        es.Quadratic((-1, -1), (1.0, 0.5), 1.0),
        es.Moving(es.Gaussian((-1, -1), 1.5), es.FigureEight(0.3, 0.5)),
        es.Expression("1 + 0.5*sin(0.7*t) - (x + 1)**2 - (y + 1)**2/2"),
    ],
)
def test_the_frame_is_exact(sensor: Any, field: es.Field) -> None:
    loop = velocity_actuated(field=field, sensor=sensor, start=(-0.8, -0.9))
    frame, times = relative(loop), np.linspace(0, 2, 41)
    ours = reference.integrate(frame.system, frame.values, times, tol=1e-11)
    found = frame.system.evaluate(ours.times, ours.states, frame.values)
    run = es.simulate(loop, 2.0, samples=times, tol=1e-11, engine="reference")
    assert found["position"] == pytest.approx(run.position.values, abs=1e-8)
    assert found["J"][:, 0] == pytest.approx(run.J.values, abs=1e-8)


def test_at_rest_everything_is_zero() -> None:
    """Without dither and gain the frame's origin is the source, the sensor settled on F(0) f*."""
    quiet = {f"controller.channels.{i}.gain": 0.0 for i in (0, 1)}
    tiny = {f"controller.channels.{i}.dither.amplitude": 1e-150 for i in (0, 1)}
    frame = relative(velocity_actuated(sensor=RINGING, **quiet, **tiny))
    rates = frame.system.rates(0.0, [0.0] * len(frame.system.states), frame.values)
    assert rates == pytest.approx([0] * len(rates), abs=1e-12)


def test_exponents_against_a_monodromy_matrix_by_hand() -> None:
    """Raw coordinates, SciPy, Newton and transition matrix by differences; F = 1/(τs + 1)."""
    tau, h, gain, omega = 0.05, 1.0, 10.0, 30.0

    def rates(t: float, state: np.ndarray) -> list[float]:
        x, y, sigma, eta = state
        sine, cosine, xi = np.sin(omega * t), np.cos(omega * t), sigma - eta
        field = 1 - (x + 1) ** 2 - 0.5 * (y + 1) ** 2
        moving = [2.4 * cosine + gain * xi * sine, 2.4 * sine - gain * xi * cosine]
        return [*moving, (field - sigma) / tau, h * xi]

    def turned(state: np.ndarray) -> np.ndarray:
        span = (0, 2 * np.pi / omega)
        return solve_ivp(rates, span, state, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]

    start = fsolve(lambda x: turned(x) - x, [-1, -1.08, 1, 1], xtol=1e-13)
    steps = 1e-5 * np.eye(4)
    monodromy = np.stack([(turned(start + e) - turned(start - e)) / 2e-5 for e in steps], axis=1)
    by_hand = np.log(np.linalg.eigvals(monodromy).astype(complex)) * omega / (2 * np.pi)
    orbit = periodic_orbit(velocity_actuated(sensor="1/(0.05*s + 1)"))
    assert match(by_hand, orbit.exponents, omega).worst < 1e-5


# --- the average: harmonics at their own frequency ----------------------------------------------


def by_fft(found: Average, state: np.ndarray, beat: float = 0.0) -> np.ndarray:
    """Mean of the exact rates at a frozen state, times 2 cos(beat t) if asked; J passed by FFT.

    Each harmonic of J is multiplied with F(jν); what is sensed of the mean comes from the states.
    """
    frame, count = found.frame, 1 << 14
    system, values = frame.system, frame.values
    period = frame.period()
    assert period is not None
    times = period[0] * np.arange(count) / count
    states = np.tile(state, (count, 1))
    field = system.evaluate(times, states, values)["J"][:, 0]
    spectrum = np.fft.rfft(field)
    shares = 2j * np.pi / period[0] * np.arange(len(spectrum))
    waves = np.array([0, *(complex(eval(str(frame.loop.sensor), {"s": w})) for w in shares[1:])])
    xi = np.fft.irfft(waves * spectrum, count)  # the mean of ξ falls out with the references'
    weight = 2 * np.cos(beat * times) if beat else np.ones(count)
    means = []
    controller = gradient(frame.loop)
    for i, channel in enumerate(controller.channels):
        w = controller.frequencies()[i]
        turn = (channel.reference or channel.dither).phase
        means.append(np.mean(weight * channel.gain * xi * np.sin(w * times + turn)))
    return np.array(means)


CUBIC = es.Expression("1 - x**2 - 0.7*y**2 + 0.2*x**3 - 0.3*x*y**2 + 0.1*x**2*y - 0.05*y**4")


@pytest.mark.parametrize("sensor", [GAS, RINGING, ALLPASS])
@pytest.mark.parametrize(
    ("field", "ratio"),
    [
        (es.Quadratic((-1, -1), ((1.0, 0.2), (0.2, 0.5))), 1),
        (CUBIC, 2),
        (es.Gaussian((0.1, 0.2), width=(0.3, 0.4)), 2),
    ],
)
def test_every_harmonic_passes_at_its_own_frequency(sensor: str, field: Any, ratio: int) -> None:
    loop = velocity_actuated(
        **{
            "field": field,
            "sensor": sensor,
            "start": (0.1, 0.1),
            "controller.channels.0.reference": 0.4,
            "controller.channels.1.ratio": ratio,
        }
    )
    found, rng = average(loop), np.random.default_rng(2)
    assert found.exact == (not isinstance(field, es.Gaussian))
    for _ in range(3):
        state = rng.uniform(-0.3, 0.3, len(found.states))
        rates = found.system.rates(0.0, state.tolist(), found.values)
        assert rates[:2] == pytest.approx(by_fft(found, state), rel=1e-9, abs=1e-12)


def test_a_slow_beat_is_kept_and_passes_the_sensor_too() -> None:
    loop = velocity_actuated(
        **{"field": CUBIC, "sensor": RINGING, "controller.channels.1.ratio": "33/32"},
        start=(0.1, 0.1),
    )
    found = average(loop)
    assert [r.frequency for r in found.resonances] == pytest.approx([30 / 32])
    state = np.array([0.2, -0.1, *[0.0] * (len(found.states) - 2)])
    law: Any = sympy.Matrix(found.averaged.forcing[:2]).subs(es.t, 0)  # the cosines' coefficients
    symbols = [*found.frame.system.symbols, *found.states]
    beats = law.subs(dict(zip(symbols, [*found.values, *state], strict=True)))
    wanted = by_fft(found, state, 30 / 32)
    assert [float(e) for e in beats] == pytest.approx(wanted, rel=1e-8)


# --- the average against Floquet exponents -------------------------------------------------------


@pytest.mark.parametrize("make", [velocity_actuated, force_actuated])
def test_every_mode_is_met_at_the_second_order_behind_a_slow_sensor(make: Any) -> None:
    """References and gains corrected for F(jω): all modes, the sensor's own among them."""
    worst = []
    for frequency in (60.0, 120.0, 240.0):
        plain = make(**{"controller.frequency": frequency, "sensor": GAS})
        worst.append(distances(boosted(corrected(plain))).max())
    assert worst[0] < 0.02
    assert [a / b for a, b in pairwise(worst)] == pytest.approx([4, 4], rel=0.1)


def test_a_sensor_as_fast_as_the_dither() -> None:
    """τω = 1 at every ω: the loop's modes come at the first order, λ times the sensor's delay."""
    errors = []
    for frequency in (60.0, 120.0, 240.0):
        plain = velocity_actuated(
            **{"controller.frequency": frequency, "sensor": f"{frequency}/(s + {frequency})"}
        )
        errors.append(distances(boosted(corrected(plain)))[:3].max())
    assert errors[0] < 0.02
    assert [a / b for a, b in pairwise(errors)] == pytest.approx([2, 2], rel=0.15)


def test_the_mean_of_the_signal_makes_the_dither_ripple() -> None:
    """Behind a slow lag, corrected, a's trace is h + 1/τ − Σ g: above that the mean runs away."""
    limit = (1 + 1 / 2.96) / (0.8 + 0.4)  # Σ g = 0.8 + 0.4 at factor 1
    for factor, stable in ((0.97 * limit, True), (1.03 * limit, False)):
        loop = boosted(corrected(velocity_actuated(**{"controller.frequency": 120, "sensor": GAS})))
        loop = boosted(loop.replace({"sensor": 1}), factor).replace({"sensor": GAS})
        verdict = stability(loop)
        assert verdict.average.stable == verdict.stable == stable
        assert distances(loop).max() < 2e-3
    conditions = [c for c in verdict.average.conditions if not c.holds]
    assert [str(c.states[0]) for c in conditions] == ["zetatilde_J"]


def test_a_field_by_quadrature_has_the_same_modes() -> None:
    field = es.Gaussian((-1, -1), width=(0.8, 1.1))
    loop = velocity_actuated(field=field, sensor=GAS, start=(-0.9, -0.9))
    loop = boosted(corrected(loop.replace({"controller.frequency": 120})))
    assert not average(loop).exact
    assert distances(loop).max() < 4e-3  # (α/width)² and ω⁻²; 0.9 without what ξ̄ makes of J


def test_the_gas_sensor_passes_one_percent_of_the_dither_a_quarter_turn_late() -> None:
    found = average(velocity_actuated(sensor=GAS))
    ideal = average(velocity_actuated()).demodulation_limit
    passed = found.demodulation_limit[0, 0] + 1j * found.demodulation_limit[1, 0]  # y's is −cos
    assert abs(passed) / ideal[0, 0] == pytest.approx(0.01126, abs=5e-6)
    assert abs(math.degrees(np.angle(passed))) == pytest.approx(89.4, abs=0.05)


@pytest.mark.parametrize("limit", [False, True])
def test_the_demodulation_matrix_by_quadrature(limit: bool) -> None:
    loop = velocity_actuated(
        **{
            "sensor": RINGING,
            "controller.channels.0.reference": 0.7,
            "controller.channels.1.dither.phase": -0.9,
        }
    )
    found = average(loop).demodulation_limit if limit else average(loop).demodulation
    theta = 2 * np.pi * np.arange(512) / 512
    passing = response(loop, 30) * (1 if limit else 30j / (30j + 1))
    for i, psi in enumerate((0.7, -0.9)):
        for j, phi in enumerate((0.0, -0.9)):
            heard = 0.08 * np.imag(passing * np.exp(1j * (theta + phi)))
            assert found[i, j] == pytest.approx(np.mean(np.sin(theta + psi) * heard), abs=1e-15)


# --- correcting the reference --------------------------------------------------------------------


def late(**changes: Any) -> es.Loop:
    """Two equal axes in quadrature behind 1/(τs + 1)², which turns the dither by 2 atan(ωτ)."""
    return velocity_actuated(
        **{"field.q": (1.0, 1.0), "sensor": "1/(0.05*s + 1)**2", "start": (-0.8, -0.8), **changes}
    )


def test_a_corrected_reference_stabilises_what_an_uncorrected_one_does_not() -> None:
    raw, mended = late(), corrected(late())  # −112.6° at ω = 30
    for loop, stable in ((raw, False), (mended, True)):
        verdict = stability(loop)
        assert verdict.average.stable == verdict.stable == stable
        assert said(verdict, "which the reference is not corrected by") == (not stable)
        run = es.simulate(loop, 25.0)
        last = run.position.values[-400:].mean(axis=0)
        assert (np.abs(last + 1).max() < 0.005) == stable
    assert said(stability(raw), "passes 30.8 % of the dither on x, turned by -112.6°")
    assert said(stability(raw), f"= {-math.radians(112.62) + math.atan(1 / 30):.3g}")


def test_a_reference_corrected_without_the_washout_is_not_blamed() -> None:
    loop = late(**{"controller.washout": 6.0})
    assert not said(stability(corrected(loop, washout=False)), "not corrected")
    assert not said(stability(velocity_actuated()), "sensor")


def test_the_critical_frequency_of_an_uncorrected_sensor() -> None:
    """A quadrature pair of equal axes bears 90°: 2 atan(ωτ) − atan(h/ω) = 90°, and a little."""
    found = es.critical_frequency(late(sensor="1/(0.02*s + 1)**2"), 25, 100)
    (crossing,) = found.crossings
    assert crossing.frequency == pytest.approx(50 * math.tan(math.pi / 4 + 0.01), rel=0.02)
    assert crossing.stable_below
    assert not crossing.stable_above


def test_a_sensor_that_lags_behind_the_loop_is_named() -> None:
    slow = "((s*0.3)**2 - 6*0.3*s + 12)/((s*0.3)**2 + 6*0.3*s + 12)"
    loop = velocity_actuated(**{"controller.frequency": 10, "sensor": slow})
    assert said(stability(corrected(loop)), "times the sensor's delay = 0.24")
    assert not said(stability(boosted(corrected(velocity_actuated(sensor=GAS)))), "delay")


# --- L, bias, order 2, the paper's columns -------------------------------------------------------


def test_the_loop_gains_roots_are_the_averaged_modes() -> None:
    loop = corrected(force_actuated(sensor=RINGING))
    matrix = loop_gain(loop).numbers
    closed = sympy.together((sympy.eye(2) + matrix).det())
    roots = np.array(sympy.Poly(sympy.fraction(closed)[0], s).nroots(), dtype=complex)
    modes = average(loop).eigenvalues
    assert len(modes) == len(roots) + 3  # the washout's and the sensor's two
    apart = np.abs(roots[:, None] - modes[None, :]).min(axis=1)
    assert apart.max() < 1e-6


def test_the_bias_of_a_cubic_field_and_of_a_force() -> None:
    field = es.Expression("1 - x**2 - y**2/2 + x**3/2")
    loop = velocity_actuated(
        **{"field": field, "sensor": RINGING, "vehicle.disturbance": (0.0, 0.01)}, start=(0.1, 0.1)
    )
    loop = boosted(corrected(loop.replace({"controller.frequency": 400})))
    found = bias(loop)
    assert found.parts["asymmetry"][0] > 5e-4
    assert found.total == pytest.approx(average(loop).offset, rel=0.01, abs=1e-5)
    assert found.total == pytest.approx(periodic_orbit(loop).offset, rel=0.03, abs=5e-5)


def test_the_second_order_is_refused_in_words() -> None:
    with pytest.raises(es.InvalidDescription, match="2 is not known for a loop with a sensor"):
        average(velocity_actuated(sensor=GAS), order=2)
    doubled = average(velocity_actuated(sensor=2), order=2)
    gains = {f"controller.channels.{i}.gain": 20.0 for i in (0, 1)}
    assert doubled.eigenvalues == pytest.approx(
        average(velocity_actuated(**gains), order=2).eigenvalues
    )


def test_a_sensor_is_not_in_the_paper() -> None:
    verdict = stability(velocity_actuated(sensor="1/(0.001*s + 1)"))
    assert "a sensor stands between" in verdict.evidence[0].silence
    assert verdict.stable


def test_the_sensors_own_modes_are_not_the_loops_bandwidth() -> None:
    found = average(velocity_actuated(sensor="1/(0.01*s + 1)"))
    assert found.bandwidth == pytest.approx(1.0)
    assert np.abs(found.eigenvalues).max() > 50


def test_it_prints() -> None:
    text = str(average(corrected(velocity_actuated(sensor=GAS))))
    assert "the limit ω → ∞ but for the sensor's F(jω)" in text
    assert "dζ̃_J/dτ" in text
    assert "(a_0² + ω²)" in text
