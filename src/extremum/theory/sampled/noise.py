"""Residual error caused by noise: the position's covariance in the averaged sampled loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import sympy
from sympy import Expr, Symbol

from ...controllers import GradientES
from ...errors import InvalidDescription, shown
from ...loop import Loop, checked
from ...printing import aligned, expression_text
from ...sampled.loop import SampledLoop
from ...sampled.practice import Practice
from ...symbols import axis_names, s
from ...validation import positive
from ..demodulation import gradient
from ..linear import Linear, linear
from .gain import SampledLoopGain, sampled_loop_gain
from .held import Complex, Matrix
from .received import frequencies, not_negative, washout

FIRST: Final = 1 << 10
LAST: Final = 1 << 20
"""Points on the unit circle, at first and at most."""

SETTLED: Final = 1e-9
"""Part of the variance by which twice the points may differ."""

NODES: Final = 64

LETTERS: Final = tuple(Symbol(name, positive=True) for name in ("sigma", "dt", "tau_n"))


@dataclass(frozen=True, eq=False)
class NoiseVariance:
    """What noise on the samples makes of the position; made by `noise_variance`.

    Attributes
    ----------
    gain
        The averaged sampled loop.
    sigma, correlation_time
        The noise's standard deviation (unit of J), and its correlation time (s), 0 if white.
    covariance
        Of the position's slow part at an instant, (axes, axes) (m²).
    period_covariance
        Of its mean over one period of the controller's ω (m²).
    law
        The variance of each axis in closed form, for fast sampling (dt → 0 with σ² dt kept),
        ω → ∞ and no delay: in the loop's symbols, σ and dt, and τ_n in the factor S_n(ω dt)/σ² of
        noise that is not white. None where axes are coupled.
    """

    gain: SampledLoopGain
    sigma: float
    correlation_time: float
    covariance: Matrix
    period_covariance: Matrix
    law: tuple[Expr, ...] | None

    @property
    def deviation(self) -> Matrix:
        """The standard deviation of each axis at an instant (m)."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def period_deviation(self) -> Matrix:
        """The standard deviation of each axis' mean over one period (m)."""
        return np.sqrt(self.period_covariance.diagonal())

    @property
    def closed_form(self) -> Matrix | None:
        """`law` in numbers (m²)."""
        if self.law is None:
            return None
        numbers = (self.sigma, self.gain.dt, self.correlation_time)
        table: Any = dict(zip(LETTERS, numbers, strict=True))
        return self.gain.frame.numbers([e.subs(table) for e in self.law])

    def within(self, radius: float) -> float:
        """Return the probability that a period's mean is within `radius` (m) of where it rests.

        Of a Gaussian with `period_covariance`, integrated axis by axis along its principal axes.
        """
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(self.period_covariance), 0.0))
        return _inside(positive("radius", radius), [float(x) for x in spread if x > 0])

    def text(self) -> str:
        """Return closed forms and standard deviations as text."""
        names = axis_names(len(self.covariance))
        colour = f", correlated over {self.correlation_time:g} s," if self.correlation_time else ""
        lines = [
            f"Residual error from noise, σ = {self.sigma:g}{colour} in a sample every "
            f"{self.gain.dt:g} s"
        ]
        if self.law is None:
            lines.append("  the axes are coupled: no closed form")
        else:
            laws = zip(names, self.law, strict=True)
            lines += aligned([(f"var {name}", expression_text(law)) for name, law in laws])
        closed = self.closed_form
        for i, name in enumerate(names):
            known = "" if closed is None else f"; in closed form {math.sqrt(closed[i]):.4g} m"
            lines.append(
                f"  {name}: standard deviation {self.deviation[i]:.4g} m, "
                f"of a period's mean {self.period_deviation[i]:.4g} m{known}"
            )
        lines += self._correlations(names)
        return "\n".join([*lines, *(f"  Note: {note}." for note in self.gain.notes)])

    __str__ = __repr__ = text

    def _correlations(self, names: tuple[str, ...]) -> list[str]:
        scaled = self.covariance / np.outer(self.deviation, self.deviation)
        pairs = [(i, j) for i in range(len(names)) for j in range(i) if abs(scaled[i, j]) > 0.005]
        return [f"  {names[j]} and {names[i]}: correlation {scaled[i, j]:+.3f}" for i, j in pairs]


def noise_variance(
    loop: Loop,
    dt: float | None = None,
    sigma: float | None = None,
    *,
    correlation_time: float | None = None,
    delay: float | None = None,
    lag: float | None = None,
    practice: Practice | None = None,
) -> NoiseVariance:
    """Return the covariance of the position that noise on the samples of J causes.

    A sample's noise n_k, demodulated, is m_i = c_i W[n] sin(ω_i t_k + ψ_i). Averaged over the
    dither's phase its spectrum is

    S_ij(θ) = c_i c_j/4 (e^(j(ψ_i − ψ_j)) S_n(θ − ω dt) + e^(−j(ψ_i − ψ_j)) S_n(θ + ω dt))

    for axes of one frequency, S_n with the washout's |W|² in it, and 0 otherwise: what is slow in
    it is the noise around ω, and axes in quadrature get different parts of that. The averaged loop
    makes of it

    cov = 1/2π ∫ F S F* dθ,  F = (I + L_d(e^(jθ)))⁻¹ G_d C_d,

    the solution of its discrete Lyapunov equation. As dt → 0 with σ² dt kept and each axis by
    itself that is a rational function of the loop's letters, `law`: c σ² dt/(4 α q) for C = 1 and
    G = 1/s, whatever the gain of the loop otherwise.

    Parameters
    ----------
    loop
        A `Loop`, or a `SampledLoop`, as in `sampled_loop_gain`.
    dt
        Time between two samples (s).
    sigma
        Standard deviation of the noise in a sample (unit of J); that of a `SampledLoop`'s sensor,
        white or coloured, if left out.
    correlation_time
        τ_n (s), given with `sigma`: n_(k+1) = e^(−dt/τ_n) n_k + white noise; white if left out.
    delay, lag, practice
        As in `sampled_loop_gain`.

    Raises
    ------
    InvalidDescription
        For a loop that is not stable or too close to it, or without noise; where
        `sampled_loop_gain` refuses.

    Notes
    -----
    The noise is small: its square does not move the mean, as the field's curvature is that at the
    source. Sources: Åström, Introduction to Stochastic Control Theory (1970), chapter 5, for the
    integrals in closed form; Parseval's theorem for the rest.
    """
    sigma, correlation_time = _noise(loop, sigma, correlation_time)
    gain = sampled_loop_gain(loop, dt, delay=delay, lag=lag, practice=practice)
    if not gain.stable:
        raise InvalidDescription(
            "loop",
            f"is not stable when sampled: its slowest mode is {gain.modes[0]:.4g} 1/s, so that the "
            "error grows without bound; see sampled_loop_gain",
        )
    instant, period = _covariances(gain, _memory(gain.dt, correlation_time))
    parts = linear(gain.frame.equations, gain.frame.loop.twin)
    return NoiseVariance(
        gain=gain,
        sigma=sigma,
        correlation_time=correlation_time,
        covariance=sigma**2 * instant,
        period_covariance=sigma**2 * period,
        law=_law(parts, gradient(gain.frame.loop.twin), white=not correlation_time),
    )


def _noise(loop: Loop, sigma: Any, correlation_time: Any) -> tuple[float, float]:
    """Return σ and τ_n as given, or those of a sampled loop's sensor."""
    if correlation_time is not None:
        correlation_time = not_negative("correlation_time", correlation_time)
    if sigma is not None:
        return positive("sigma", sigma), correlation_time or 0.0
    if correlation_time is not None:
        raise InvalidDescription("sigma", "must be given with a correlation_time")
    loop = checked(loop, sampled=True)
    if not isinstance(loop, SampledLoop):
        raise InvalidDescription(
            "sigma", "must be given: how noisy its samples are only a SampledLoop says itself"
        )
    sensor: Any = loop.sampling.sensor
    white, coloured = sensor.noise or 0.0, sensor.coloured
    if coloured is None or not coloured.deviation:
        if not white:
            raise InvalidDescription("sigma", "must be given: the sensor of this loop has no noise")
        return white, 0.0
    if white:
        raise InvalidDescription(
            "sampling.sensor.coloured",
            "comes with white noise, and this is about one of them: give sigma, and then sigma and "
            "correlation_time, and add the covariances",
            shown(coloured),
        )
    return coloured.deviation, coloured.time


def _memory(dt: float, correlation_time: float) -> float:
    return math.exp(-dt / correlation_time) if correlation_time else 0.0


def _coloured(theta: Matrix, memory: float) -> Matrix:
    """Return S_n(θ)/σ² of a first-order autoregressive noise with standard deviation σ."""
    return (1 - memory**2) / np.abs(1 - memory * np.exp(-1j * theta)) ** 2


def _demodulated(gain: SampledLoopGain, theta: Matrix, memory: float) -> Complex:
    """Return S(θ)/σ² of the demodulated noise, (N, axes, axes)."""
    frame, timing = gain.frame, gain.timing
    turning = np.array(frequencies(frame))
    gains = np.array([channel.gain for channel in gradient(frame.loop).channels])
    turned = np.exp(1j * gain.received.phases)
    matching = np.outer(gains, gains) * np.equal.outer(turning, turning) / 4
    found = np.zeros((len(theta), len(turning), len(turning)), complex)
    for side in (-1, 1):
        shifted = theta[:, None] + side * turning * gain.dt
        passed = np.abs(washout(frame, timing, shifted / gain.dt)) ** 2
        heard = passed * _coloured(shifted, memory)
        phases = np.outer(turned, turned.conj())
        found += matching * (phases if side < 0 else phases.conj()) * heard[:, None, :]
    return found


def _covariances(gain: SampledLoopGain, memory: float) -> tuple[Matrix, Matrix]:
    """Return both covariances over σ², by the trapezoidal rule on the unit circle.

    It converges geometrically there. A Möbius map of the circle to itself draws the points together
    near z = 1, so that slow modes are resolved by few.
    """
    speed = float(np.abs(gain.modes[np.isfinite(gain.modes)]).min()) * gain.dt
    ratio = min(math.sqrt(speed / 2), 1.0)
    samples = round(2 * math.pi / (float(gradient(gain.frame.loop).frequency) * gain.dt))
    unit = np.eye(len(gain.slope))
    before = np.full((2, *unit.shape), np.nan)
    points = FIRST
    while points <= LAST:
        phi = math.pi * (np.arange(points) + 0.5) / points
        theta = 2 * np.arctan(ratio * np.tan(phi / 2))
        weight = ratio / (np.cos(phi / 2) ** 2 + ratio**2 * np.sin(phi / 2) ** 2) / points
        z = np.exp(1j * theta)
        forward = gain.forward(z, range(len(unit)))[:, :, None]
        passing = np.linalg.solve(unit - forward * gain.slope, forward * unit)
        spectrum = passing @ _demodulated(gain, theta, memory) @ passing.conj().swapaxes(1, 2)
        mean = (np.sin(samples * theta / 2) / (samples * np.sin(theta / 2))) ** 2
        found = np.stack([np.tensordot(w, spectrum.real, 1) for w in (weight, weight * mean)])
        if np.abs(found - before).max() <= SETTLED * np.abs(found).max():
            return found[0], found[1]
        before, points = found, 2 * points
    raise InvalidDescription(
        "loop",
        f"is too close to instability for its variance to be computed: its slowest mode is "
        f"{gain.modes[0]:.4g} 1/s",
    )


def _law(parts: Linear, controller: GradientES, *, white: bool) -> tuple[Expr, ...] | None:
    """Return each axis' variance for fast sampling, in closed form."""
    if not parts.sensor.is_diagonal():
        return None
    sigma, dt, time = LETTERS
    kept = sympy.exp(-dt / time)
    turning = controller.frequencies()
    found = []
    for i, (above, below) in enumerate(zip(parts.above, parts.below, strict=True)):
        intensity = controller.channels[i].gain ** 2 * sigma**2 * dt / 2
        closed = sympy.Poly(sympy.expand(below + parts.sensor[i, i] * above), s)
        law: Any = sympy.factor(intensity * _energy(sympy.Poly(above, s), closed))
        heard = (1 - kept**2) / (1 - 2 * kept * sympy.cos(turning[i] * dt) + kept**2)
        found.append(law if white else law * heard)
    return tuple(found)


def _energy(above: Any, below: Any) -> Expr:
    """Return 1/2πj ∫ b(s) b(−s)/(a(s) a(−s)) ds of a stable b/a.

    With b(s) b(−s) = p(s) a(−s) + p(−s) a(s) it is p's coefficient of s^(n−1) over a's of s^n.
    """
    order = below.degree()
    letters = sympy.symbols(f"p0:{order}")
    p = sympy.Poly(list(letters), s)
    mirrored = [sympy.Poly(e.as_expr().subs(s, -s), s) for e in (above, below, p)]
    identity = above * mirrored[0] - p * mirrored[1] - mirrored[2] * below
    equations = [e for e in identity.all_coeffs() if e != 0]
    solved: Any = sympy.linsolve(equations, letters)
    (values,) = solved
    return values[0] / below.LC()


def _inside(radius: float, spread: list[float]) -> float:
    """Return P(Σ x_i² < r²) of independent Gaussians with the given standard deviations."""
    if not spread:
        return 1.0
    first, *others = spread
    if not others:
        return math.erf(radius / (first * math.sqrt(2)))
    reach = min(radius, 10 * first)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    x = reach * nodes
    density = np.exp(-((x / first) ** 2) / 2) / (first * math.sqrt(2 * math.pi))
    inner = np.array([_inside(left, others) for left in np.sqrt(radius**2 - x**2)])
    return float(reach * (weights * density * inner).sum())
