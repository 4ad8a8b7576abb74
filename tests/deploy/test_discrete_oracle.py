"""`DiscreteController.step` against a sampled controller written by hand with SciPy's filters.

The oracle's derivation: each rational G(s) becomes G(K (z − 1)/(z + 1)), K = ω/tan(ω dt/2), by
`scipy.signal.bilinear` at the sampling frequency K/2 in place of 1/dt; a probe is the wanted motion
through 1/G(jω). What is sent at t_k acts half a sample later on average, so that the dither in the
sample of t_k is that of t_k − dt/2 − delay, where a delay is to be accounted for. Phases are those
of exact arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from loops import force_actuated, velocity_actuated
from numpy.typing import NDArray
from scipy import signal

import extremum as es
from extremum import s

pytestmark = pytest.mark.filterwarnings("ignore:.*samples in a period:UserWarning")

H = 1.0
"""The washouts' corner (rad/s)."""


# --- the oracle --------------------------------------------------------------------------------


def turns(omega: float, dt: float, steps: int) -> float:
    """Return ω dt n/2π modulo 1, rounded once."""
    with mpmath.workdps(60):
        exact = mpmath.mpf(omega) * mpmath.mpf(dt) * steps / (2 * mpmath.pi)
        return float(exact - mpmath.floor(exact))


def warped(omega: float, dt: float) -> float:
    """Return the sampling frequency with which SciPy's bilinear rule is exact at ω."""
    return omega / math.tan(omega * dt / 2) / 2


class Filter:
    """A transfer function's difference equation, by polynomials and a transposed direct form."""

    def __init__(self, num: Any, den: Any, omega: float, dt: float, settled_on: float = 0.0):
        self.b, self.a = map(np.asarray, signal.bilinear(num, den, warped(omega, dt)))
        self.memory = [0.0] * (len(self.a) - 1)
        if settled_on:
            self.memory = list(signal.lfilter_zi(self.b, self.a) * settled_on)

    def __call__(self, entering: float) -> float:
        leaving = self.b[0] * entering + self.memory[0]
        padded = [*self.memory[1:], 0.0]
        self.memory = [
            m + b * entering - a * leaving
            for m, b, a in zip(padded, self.b[1:], self.a[1:], strict=True)
        ]
        return leaving

    def response(self, omega: float, dt: float) -> complex:
        z = np.exp(1j * omega * dt)
        return complex(np.polyval(self.b, z) / np.polyval(self.a, z))


@dataclass(frozen=True)
class Axis:
    """One channel: ω, α, φ, c, 1/G(jω), the polynomials of C(s), ψ if it is not φ."""

    omega: float
    amplitude: float
    phase: float
    gain: float
    inverse: complex
    compensator: tuple[list[float], list[float]] | None = None
    reference: float | None = None


def expected(
    axes: list[Axis],
    base: float,
    dt: float,
    samples: NDArray[np.float64],
    delay: float | None = None,
    lag: float = 0.0,
    start: float | None = None,
    ramp: float | None = None,
) -> NDArray[np.float64]:
    """Return the commands (steps, axes)."""
    first = float(samples[0]) if start is None else start
    washout = Filter([1, 0], [1, H], base, dt, first)
    filters = [
        None if axis.compensator is None else Filter(*axis.compensator, axis.omega, dt)
        for axis in axes
    ]
    late = []
    for axis in axes:
        exact = 1j * axis.omega / (1j * axis.omega + H)
        lead = np.angle(washout.response(axis.omega, dt)) - np.angle(exact)
        held = 0.0 if delay is None else axis.omega * (dt / 2 + delay)
        late.append(held + math.atan(axis.omega * lag) - lead)
    found = np.empty((len(samples), len(axes)))
    for k, sample in enumerate(samples):
        xi = washout(float(sample))
        envelope = 1.0 if ramp is None else -math.expm1(-k * dt / ramp)
        for i, axis in enumerate(axes):
            angle = 2 * math.pi * turns(axis.omega, dt, k)
            psi = axis.phase if axis.reference is None else axis.reference
            fed = axis.gain * xi * math.sin(angle + psi - late[i])
            drawn = filters[i]
            fed = fed if drawn is None else drawn(fed)
            size, turned = abs(axis.inverse), float(np.angle(axis.inverse))
            found[k, i] = (
                envelope * axis.amplitude * size * math.sin(angle + axis.phase + turned) + fed
            )
    return found


def commands(controller: Any, samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what `step` answers, (steps, axes)."""
    state = controller.init(float(samples[0]))
    rows = []
    for sample in samples:
        row, state = controller.step(state, float(sample))
        rows.append(row)
    return np.array(rows)


def noise(steps: int, seed: int = 1) -> NDArray[np.float64]:
    """Return samples of all sizes: a walk with white noise on it."""
    rng = np.random.default_rng(seed)
    return 3 + np.cumsum(rng.normal(0, 0.02, steps)) + rng.normal(0, 0.5, steps)


def quadrature(omega: float, amplitude: float, gain: float, **kind: Any) -> list[Axis]:
    return [Axis(omega, amplitude, phase, gain, **kind) for phase in (0.0, -math.pi / 2)]


LEAD = ([5.0, 2.5], [1.0, 3.0])
"""5 (s + 0.5)/(s + 3), the lead of `force_actuated`."""


def compared(controller: Any, axes: list[Axis], dt: float, **options: Any) -> float:
    """Return the largest difference over the largest command."""
    samples = noise(10_000)
    theirs = expected(axes, axes[0].omega, dt, samples, **options)
    return float(np.abs(commands(controller, samples) - theirs).max() / np.abs(theirs).max())


# --- step by step ------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [1e-3, 4e-3, 1e-2, 0.03])
def test_fig4(dt: float) -> None:
    ours = es.discretize(velocity_actuated().controller, dt, vehicle=velocity_actuated().vehicle)
    assert compared(ours, quadrature(30, 0.08, 10, inverse=30j), dt) < 1e-9


def test_fig4_with_a_washout_that_starts_at_zero_or_at_a_number() -> None:
    for start in (0.0, 2.5):
        changes = {"controller.washout_start": "zero" if start == 0 else start}
        loop = velocity_actuated(**changes)
        ours = es.discretize(loop.controller, 0.01, vehicle=loop.vehicle)
        axes = quadrature(30, 0.08, 10, inverse=30j)
        assert compared(ours, axes, 0.01, start=start) < 1e-9


@pytest.mark.parametrize(("delay", "lag"), [(0.0, None), (0.007, None), (0.007, 0.02)])
def test_the_references_lag_by_delay_and_lag(delay: float, lag: float | None) -> None:
    loop = velocity_actuated()
    practice = es.Practice(delay=delay, lag=lag)
    ours = es.discretize(loop.controller, 0.01, practice=practice, vehicle=loop.vehicle)
    axes = quadrature(30, 0.08, 10, inverse=30j)
    assert compared(ours, axes, 0.01, delay=delay, lag=lag or 0.0) < 1e-9
    assert compared(ours, axes, 0.01) > 0.1, "the oracle can tell"


@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_fig2_with_leads_and_a_ramp(dt: float) -> None:
    loop = force_actuated(**{"controller.probe_ramp": 2.0, "start": (1, 1)})
    ours = es.discretize(loop.controller, dt, vehicle=loop.vehicle)
    axes = quadrature(30, 0.1, 10, inverse=complex(-900), compensator=LEAD)
    assert compared(ours, axes, dt, ramp=2.0) < 1e-9


def test_a_compensator_of_third_order_with_complex_poles() -> None:
    text = "8*(s + 0.5)*(s**2 + 3*s + 70)/((s + 3)*(s**2 + 4*s + 200))"
    loop = velocity_actuated(**{"controller.channels.1.compensator": es.Rational(text)})
    ours = es.discretize(loop.controller, 0.01, vehicle=loop.vehicle)
    num = 8 * np.polymul([1, 0.5], [1, 3, 70])
    den = np.polymul([1, 3], [1, 4, 200])
    first, second = quadrature(30, 0.08, 10, inverse=30j)
    second = Axis(30, 0.08, second.phase, 10, 30j, (list(num), list(den)))
    assert compared(ours, [first, second], 0.01) < 1e-9


def two_to_three() -> tuple[es.Loop, list[Axis]]:
    """Return channels at ω and 3/2 ω on a lagging and a free axis, and the oracle's axes."""
    lagging = 1 / (s * (s / 20 + 1))
    loop = es.Loop(
        field=es.Quadratic(source=(0, 0), q=(1.0, 0.5), peak=1.0),
        vehicle=es.PointMass(axes=(lagging, 1 / s)),
        controller=es.GradientES(
            frequency=20,
            washout=H,
            channels=(
                es.Channel(dither=es.Dither(0.1, phase=0.4), gain=3),
                es.Channel(
                    dither=es.Dither(0.07, phase=-1.1),
                    gain=-4,
                    reference=0.3,
                    compensator=es.Lead(gain=5, zero=-0.5, pole=-3),
                    ratio=Fraction(3, 2),
                ),
            ),
        ),
        start=(1, 1),
    )
    return loop, [Axis(20, 0.1, 0.4, 3, 20j * (1 + 1j)), Axis(30, 0.07, -1.1, -4, 30j, LEAD, 0.3)]


@pytest.mark.parametrize("dt", [2e-3, 1e-2])
def test_channels_at_two_to_three(dt: float) -> None:
    loop, axes = two_to_three()
    ours = es.discretize(loop.controller, dt, vehicle=loop.vehicle)
    assert compared(ours, axes, dt) < 1e-9


# --- exact at the dither frequency -------------------------------------------------------------


def phasor(wave: NDArray[np.float64], omega: float, dt: float, first: int) -> complex:
    """Return A e^(jθ) of A sin(ω t_k + θ), by least squares; `first` is the first k."""
    angles = np.array([2 * math.pi * turns(omega, dt, first + k) for k in range(len(wave))])
    waves = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    (real, imaginary), *_ = np.linalg.lstsq(waves, wave, rcond=None)
    return complex(real, imaginary)


@pytest.mark.parametrize("dt", [2e-3, 1e-2, 0.03])
def test_the_washout_is_exact_at_the_dither_frequency(dt: float) -> None:
    """ξ is recovered from both commands, (c ξ sin a, −c ξ cos a), a = ωt."""
    omega, last = 30.0, 1000
    steps = round(45 / dt) + last
    loop = velocity_actuated()
    ours = es.discretize(loop.controller, dt, vehicle=loop.vehicle)
    angles = np.array([2 * math.pi * turns(omega, dt, k) for k in range(steps)])
    fed = commands(ours, np.sin(angles)) - commands(ours, np.zeros(steps))
    a = angles[-last:]
    xi = (fed[-last:, 0] * np.sin(a) - fed[-last:, 1] * np.cos(a)) / 10
    continuous = 1j * omega / (1j * omega + H)
    assert abs(phasor(xi, omega, dt, steps - last) / continuous - 1) < 1e-12


@pytest.mark.parametrize("dt", [1 / 512, 1 / 128, 1 / 32])
def test_the_compensators_are_exact_at_the_dither_frequency(dt: float) -> None:
    """J_k = k leaves a constant ξ = K/(2h), whose demodulated sine is all that C receives."""
    omega, last = 30.0, 1000
    steps = round(45 / dt) + last
    loop = force_actuated()
    ours = es.discretize(loop.controller, dt, vehicle=loop.vehicle)
    fed = commands(ours, np.arange(steps, dtype=float)) - commands(ours, np.zeros(steps))
    xi = omega / math.tan(omega * dt / 2) / 2 / H
    lead = 5 * (1j * omega + 0.5) / (1j * omega + 3)
    for axis, phase in enumerate((0.0, -math.pi / 2)):
        entering = 10 * xi * np.exp(1j * phase)
        leaving = phasor(fed[-last:, axis], omega, dt, steps - last)
        assert abs(leaving / (lead * entering) - 1) < 1e-12


# --- the oscillator ----------------------------------------------------------------------------

LONG = 10**9


@pytest.mark.parametrize(("omega", "dt"), [(30.0, 1e-3), (29.7, 0.01), (1 / 3, 0.1), (30.0, 0.03)])
def test_the_dither_has_its_phase_after_a_billion_steps(omega: float, dt: float) -> None:
    loop = velocity_actuated(**{"controller.frequency": omega})
    ours = es.discretize(loop.controller, dt, vehicle=loop.vehicle)
    state = ours.skip(ours.init(1.0), LONG)
    for k in range(3):
        found, state = ours.step(state, 1.0)
        angle = 2 * math.pi * turns(omega, dt, LONG + k)
        exact = [0.08 * omega * math.cos(angle), 0.08 * omega * math.sin(angle)]
        assert found == pytest.approx(exact, abs=1e-9 * 0.08 * omega)


def test_skipping_is_stepping_as_far_as_the_dither_goes() -> None:
    loop, _ = two_to_three()
    ours = es.discretize(loop.controller, 0.01, vehicle=loop.vehicle)
    skipped, stepped = ours.init(1.0), ours.init(1.0)
    for _ in range(1234):
        _, stepped = ours.step(stepped, 1.0)
    skipped = ours.skip(skipped, 1234)
    assert ours.step(skipped, 1.0)[0] == ours.step(stepped, 1.0)[0]


@pytest.mark.parametrize("dt", [1e-3, 0.01])
def test_the_increments_are_those_of_exact_arithmetic_and_keep_their_ratio(dt: float) -> None:
    loop, axes = two_to_three()
    ours = es.discretize(loop.controller, dt, vehicle=loop.vehicle)
    first, second = (oscillator.increment for oscillator in ours.machine.oscillators)
    assert Fraction(second, first) == Fraction(3, 2)
    with mpmath.workdps(60):
        for increment, axis in zip((first, second), axes, strict=True):
            exact = mpmath.mpf(axis.omega) * mpmath.mpf(dt) / (2 * mpmath.pi) * 2**64
            assert abs(increment - exact) <= 1.5


def test_in_single_precision_the_phase_after_a_billion_steps_is_right_to_a_float() -> None:
    """(float)(int32_t)(p >> 32) · 2⁻³², p = n · increment modulo 2⁶⁴."""
    loop = velocity_actuated()
    ours = es.discretize(loop.controller, 1e-3, vehicle=loop.vehicle)
    (oscillator,) = ours.machine.oscillators
    for steps in (1, 1000, LONG, LONG + 12345):
        phase = steps * oscillator.increment % 2**64 >> 32
        signed = phase - 2**32 if phase >= 2**31 else phase
        found = float(np.float32(signed) * np.float32(2.0**-32))
        exact = turns(30.0, 1e-3, steps)
        assert abs((found - exact + 0.5) % 1 - 0.5) < 2.0**-25 + 2.0**-32
