"""Fig. 2 of Zhang et al. (2007) and its variational equations, written by hand.

Nothing here comes from `extremum`: it is what a careful user of NumPy and SciPy writes to know a
periodic orbit's Floquet exponents. The reference is extrapolation, as in `problems`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray
from problems import extrapolated

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flow = Callable[[Any, Vector, float], Vector]
"""(t, y) → dy/dt, y at 0 and the period → y there."""

OMEGA, WASHOUT, AMPLITUDE, GAIN = 100.0, 1.0, 0.1, 10.0
LEAD_GAIN, ZERO, POLE = 5.0, -0.5, -3.0
Q_X, Q_Y = 1.0, 0.5
PERIOD = 2 * pi / OMEGA
STATES = 7
STEPS = 64


@dataclass(frozen=True)
class Orbit:
    """The orbit and its transition matrix over one period.

    Attributes
    ----------
    start
        The state at t = 0: x, v_x, ζ_x, y, v_y, ζ_y, η.
    monodromy
        Φ(T), (states, states).
    """

    start: Vector
    monodromy: Vector

    @property
    def exponents(self) -> Complex:
        """The Floquet exponents (1/s), `in_order`."""
        multipliers: Complex = np.linalg.eigvals(self.monodromy).astype(np.complex128)
        return in_order((np.log(multipliers) / PERIOD).astype(np.complex128))


def in_order(exponents: Complex) -> Complex:
    """Return them by real part, conjugates by imaginary part."""
    return exponents[np.lexsort((exponents.imag, np.round(exponents.real, 6)))]


def rates(gain: float) -> Callable[[float, Vector], Vector]:
    """Return (t, state and Φ in one row) → their rates; `gain` is c in x.

    ẍ = −αω² sin ωt + w_x, w_x = ζ_x + k m_x, ζ̇_x = p ζ_x + k (p − z) m_x, m_x = c ξ sin ωt; in y
    with −cos for sin; ξ = −q_x x² − q_y y² − η, η̇ = h ξ. Φ̇ = A Φ + b(t) (∇ξ Φ).
    """
    constant = np.zeros((STATES, STATES))
    for first in (0, 3):
        constant[first, first + 1] = constant[first + 1, first + 2] = 1.0
        constant[first + 2, first + 2] = POLE
    direct, filtered, force = LEAD_GAIN, LEAD_GAIN * (POLE - ZERO), AMPLITUDE * OMEGA**2
    entering, slope = np.zeros(STATES), np.zeros(STATES)
    entering[6], slope[6] = WASHOUT, -1.0
    out = np.empty(STATES + STATES**2)

    def right(time: float, state: Vector) -> Vector:
        x, v_x, zeta_x, y, v_y, zeta_y, eta = state[:STATES].tolist()
        sine, cosine = sin(OMEGA * time), cos(OMEGA * time)
        m_x, m_y = gain * sine, -GAIN * cosine
        xi = -Q_X * x * x - Q_Y * y * y - eta
        out[:STATES] = (
            v_x,
            -force * sine + zeta_x + direct * m_x * xi,
            POLE * zeta_x + filtered * m_x * xi,
            v_y,
            force * cosine + zeta_y + direct * m_y * xi,
            POLE * zeta_y + filtered * m_y * xi,
            WASHOUT * xi,
        )
        entering[1], entering[2] = direct * m_x, filtered * m_x
        entering[4], entering[5] = direct * m_y, filtered * m_y
        slope[0], slope[3] = -2 * Q_X * x, -2 * Q_Y * y
        matrix = state[STATES:].reshape(STATES, STATES)
        out[STATES:] = (constant @ matrix + np.outer(entering, slope @ matrix)).ravel()
        return out.copy()

    return right


def orbit(gain: float, flow: Flow, tolerance: float) -> Orbit:
    """Return the periodic orbit by Newton's method from the averaged equilibrium.

    Parameters
    ----------
    flow
        Integrates over one period.
    tolerance
        The correction at which Newton's method ends (m, m/s, …).
    """
    right = rates(gain)
    start = np.array([0.0, AMPLITUDE * OMEGA, 0.0, -AMPLITUDE, 0.0, 0.0, 0.0])
    start[6] = -(AMPLITUDE**2) * (Q_X + Q_Y) / 2
    identity = np.eye(STATES)
    for _ in range(20):
        end = flow(right, np.concatenate([start, identity.ravel()]), PERIOD)
        monodromy = end[STATES:].reshape(STATES, STATES)
        step = np.linalg.solve(identity - monodromy, end[:STATES] - start).astype(np.float64)
        start += step
        if np.abs(step).max() < tolerance:
            return Orbit(start, monodromy)
    raise SystemExit("Newton's method does not converge")


def by_extrapolation(right: Any, state: Vector, period: float) -> Vector:
    """Integrate over one period by Gragg–Bulirsch–Stoer extrapolation."""
    step = period / STEPS
    for index in range(STEPS):
        state = extrapolated(right, index * step, state, step)
    return state
