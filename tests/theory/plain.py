"""Extremum seeking loops in plain numbers, NumPy and SciPy only; `oracle` analyses them.

Nothing is shared with ``extremum``, not even the states. A loop of
axes i with vehicle G_i(s) and compensator C_i(s), field J and washout h is, in raw coordinates::

    u_i = probe_i(t) + d_i + C_i(s)[c_i xi sin(w_i t + psi_i)],  xi = J(p - p*) - eta,
    p_i = G_i(s) u_i,  d eta/dt = h xi,  probe_i = Im[alpha_i e^{j(w_i t + phi_i)} / T_i(j w_i)],

T_i = G_i unless a scheme sends its probe through something else. Both transfer functions are
realised in controllable canonical form, C_i as direct term plus strictly proper part, so that with
y = (vehicle and compensator states axis after axis, eta) the loop is linear but for one scalar::

    dy/dt = A y + b(t) + w(t) xi,   xi = J(P y - p*) - y_n,
    d Phi/dt = [A + w(t) (grad J P - e_n)] Phi,

w(t) holding the demodulated input directions and h, b(t) the probes and the constant forces d.
"""

# ruff: noqa: N806  (matrices, and J, are capitals)
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]
Polynomials = tuple[tuple[float, ...], tuple[float, ...]]  # numerator, denominator


class Field(Protocol):
    """J as a function of the offset from the source, positions in the last dimension."""

    def value(self, offset: Vector) -> Vector: ...

    def gradient(self, offset: Vector) -> Vector: ...


class Quadratic(NamedTuple):
    """J = peak - offset' Q offset."""

    Q: Vector
    peak: float = 0.0

    def value(self, offset: Vector) -> Vector:
        return self.peak - ((offset @ self.Q) * offset).sum(axis=-1)

    def gradient(self, offset: Vector) -> Vector:
        return -2.0 * (offset @ self.Q)


class Polynomial(NamedTuple):
    """J = sum over terms of coefficient prod_i offset_i^power_i."""

    terms: dict[tuple[int, ...], float]

    def value(self, offset: Vector) -> Vector:
        return np.sum(
            [c * np.prod(offset ** np.array(k), axis=-1) for k, c in self.terms.items()], axis=0
        )

    def gradient(self, offset: Vector) -> Vector:
        slopes = np.zeros(np.shape(offset))
        for powers, c in self.terms.items():
            for i, power in enumerate(powers):
                if power:
                    lower = np.array(powers)
                    lower[i] -= 1
                    slopes[..., i] += c * power * np.prod(offset**lower, axis=-1)
        return slopes


class Gaussian(NamedTuple):
    """J = peak exp(-sum_i offset_i^2/(2 width_i^2))."""

    width: Vector
    peak: float = 1.0

    def value(self, offset: Vector) -> Vector:
        return self.peak * np.exp(-0.5 * ((offset / self.width) ** 2).sum(axis=-1))

    def gradient(self, offset: Vector) -> Vector:
        return -self.value(offset)[..., None] * offset / self.width**2


class Axis(NamedTuple):
    """One axis: G, alpha, c, C, phi, psi (None: phi), w_i/w, T (None: G) and the force d."""

    vehicle: Polynomials
    amplitude: float
    gain: float
    compensator: Polynomials = ((1.0,), (1.0,))
    phase: float = 0.0
    reference: float | None = None
    ratio: Fraction = Fraction(1)
    through: Polynomials | None = None
    force: float = 0.0


def response(function: Polynomials, frequency: float) -> complex:
    """Return the transfer function at j times the frequency."""
    numerator, denominator = (np.polyval(p, 1j * frequency) for p in function)
    return complex(numerator / denominator)


def canonical(function: Polynomials) -> tuple[Vector, Vector, Vector, float]:
    """Return A, B, C, D of a proper transfer function in controllable canonical form."""
    numerator, denominator = (np.array(p, dtype=float) / function[1][0] for p in function)
    order = len(denominator) - 1
    padded = np.concatenate([np.zeros(order + 1 - len(numerator)), numerator])
    A = np.eye(order, k=-1)
    A[:1] = -denominator[1:]
    C = (padded[1:] - padded[0] * denominator[1:])[None]
    return A, np.eye(order, 1), C, float(padded[0])


class Path(NamedTuple):
    """A displacement of the source over time, repeating after so many common dither periods."""

    at: Callable[[float], Vector]
    periods: int


@dataclass(frozen=True)
class Loop:
    """A loop in numbers, and its equations (module docstring) in matrices."""

    axes: tuple[Axis, ...]
    frequency: float
    washout: float
    field: Field
    source: tuple[float, ...]
    path: Path | None = None

    @cached_property
    def frequencies(self) -> Vector:
        """The axes' dither frequencies w_i."""
        return np.array([float(axis.ratio) * self.frequency for axis in self.axes])

    @cached_property
    def period(self) -> float:
        """The common period of all dithers."""
        ratios = [Fraction(axis.ratio) for axis in self.axes]
        below = math.lcm(*(ratio.denominator for ratio in ratios))
        above = math.gcd(*(int(ratio * below) for ratio in ratios))
        return 2 * np.pi * below / (above * self.frequency)

    @cached_property
    def matrices(self) -> tuple[Vector, Vector, Vector, Vector]:
        """A, F (from the inputs), E (from the demodulated signals) and P (to the positions)."""
        A, F, E, P = [], [], [], []
        for axis in self.axes:
            A_g, B_g, C_g, _ = canonical(axis.vehicle)
            A_c, B_c, C_c, D_c = canonical(axis.compensator)
            A.append(np.block([[A_g, B_g @ C_c], [np.zeros((len(A_c), len(A_g))), A_c]]))
            F.append(np.vstack([B_g, np.zeros((len(A_c), 1))]))
            E.append(np.vstack([B_g * D_c, B_c]))
            P.append(np.hstack([C_g, np.zeros((1, len(A_c)))]))
        state, inputs = np.zeros((1, 1)), np.zeros((1, 0))  # eta
        joined = [block_diag(*A, state), block_diag(*F, inputs), block_diag(*E, inputs)]
        return *(np.asarray(m) for m in joined), np.asarray(block_diag(*P, inputs.T))  # pyright: ignore[reportReturnType]

    @cached_property
    def probes(self) -> Complex:
        """The probes' complex amplitudes."""
        plants = [axis.vehicle for axis in self.axes]
        responses = [response(G, w) for G, w in zip(plants, self.frequencies, strict=True)]
        return self.dither / np.array(responses)

    @cached_property
    def dither(self) -> Complex:
        """Complex amplitudes a of the position's steady response, a_i(t) = Im[a_i e^{j w_i t}]."""
        return self._dither_at(1.0)

    @cached_property
    def leading_dither(self) -> Complex:
        """The limit of `dither` as w grows, which differs where T_i is not G_i."""
        return self._dither_at(1e12)

    def _dither_at(self, scale: float) -> Complex:
        swings = [
            axis.amplitude
            * np.exp(1j * axis.phase)
            * response(axis.vehicle, scale * frequency)
            / response(axis.through or axis.vehicle, scale * frequency)
            for axis, frequency in zip(self.axes, self.frequencies, strict=True)
        ]
        return np.array(swings)

    @cached_property
    def references(self) -> Complex:
        """Complex amplitudes of gain times reference."""
        psi = [axis.phase if axis.reference is None else axis.reference for axis in self.axes]
        return np.array([axis.gain for axis in self.axes]) * np.exp(1j * np.array(psi))

    @cached_property
    def forces(self) -> Vector:
        return np.array([axis.force for axis in self.axes])

    def source_at(self, t: float) -> Vector:
        """Return p*(t)."""
        source = np.array(self.source, dtype=float)
        return source if self.path is None else source + self.path.at(t)

    def steady(self, t: float) -> Vector:
        """Return the linear part's steady response to the probes, states at time t."""
        A, F, _, _ = self.matrices
        unit = np.eye(len(A) - 1)
        columns = [
            np.linalg.solve(1j * frequency * unit - A[:-1, :-1], F[:-1, i] * phasor)
            * np.exp(1j * frequency * t)
            for i, (frequency, phasor) in enumerate(zip(self.frequencies, self.probes, strict=True))
        ]
        return np.append(np.sum(columns, axis=0).imag, 0.0)

    def directions(self, turn: Complex) -> Vector:
        """Return w(t) for turn = e^{j w_i t}, times in the leading dimensions."""
        w = (self.references * turn).imag @ self.matrices[2].T
        w[..., -1] = self.washout
        return w

    def slopes(self, t: float, y: Vector) -> tuple[Vector, Vector, Vector, Vector]:
        """Return dy/dt, w(t), d xi/dy and the position's offset from the source."""
        A, F, _, P = self.matrices
        turn = np.exp(1j * self.frequencies * t)
        offset = P @ y - self.source_at(t)
        w = self.directions(turn)
        rate = A @ y + F @ ((self.probes * turn).imag + self.forces)
        slope = self.field.gradient(offset) @ P
        slope[-1] -= 1.0
        return rate + w * (self.field.value(offset) - y[-1]), w, slope, offset

    def rhs(self, t: float, y: Vector) -> Vector:
        """Return dy/dt."""
        return self.slopes(t, y)[0]
