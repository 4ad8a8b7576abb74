"""One axis of the averaged loop as a state space, NumPy and SciPy only, and how it moves.

Vehicle G = N/D, compensator C and dead time in a row, closed with the gain g about the source:

    u = d - g C(s) P(s)[x - x*],  x = G(s)[u],  P(s) = e^(-sT) in the form that SciPy makes of it.

Nothing is shared with ``extremum``: a step in time is a matrix exponential, not a residue.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import pade
from scipy.linalg import solve_continuous_lyapunov

from ..plain import canonical

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]
Fraction = tuple[ArrayLike, ArrayLike]


class Axis(NamedTuple):
    """N, D of the vehicle, of the compensator, the gain g and the dead time (s)."""

    plant: Fraction
    compensator: Fraction
    gain: float
    delay: float = 0.0


def dead_time(delay: float, order: int = 2) -> Fraction:
    """Return e^(-sT), from its Taylor series."""
    if not delay:
        return [1.0], [1.0]
    taylor = [(-delay) ** k / math.factorial(k) for k in range(2 * order + 1)]
    above, below = pade(taylor, order)
    return above.coeffs, below.coeffs


def matrices(axis: Axis) -> tuple[Vector, Vector, Vector, Vector]:
    """Return A, B of a force, B of -x*, and C of the position, of the closed loop."""
    plant, law, late = (
        canonical((tuple(np.atleast_1d(above)), tuple(np.atleast_1d(below))))
        for above, below in (axis.plant, axis.compensator, dead_time(axis.delay))
    )
    a_g, b_g, c_g, d_g = plant
    assert d_g == 0
    a_p, b_p, c_p, d_p = late
    a_c, b_c, c_c, d_c = law
    n, p, m = len(a_g), len(a_p), len(a_c)
    a = np.zeros((n + p + m,) * 2)
    # e = x - x* into the dead time, its output into the compensator, its output into the vehicle
    a[:n, :n] = a_g - axis.gain * d_c * d_p * b_g @ c_g
    a[:n, n : n + p] = -axis.gain * d_c * b_g @ c_p
    a[:n, n + p :] = -axis.gain * b_g @ c_c
    a[n : n + p, :n] = b_p @ c_g
    a[n : n + p, n : n + p] = a_p
    a[n + p :, :n] = d_p * b_c @ c_g
    a[n + p :, n : n + p] = b_c @ c_p
    a[n + p :, n + p :] = a_c
    force = np.concatenate([b_g.ravel(), np.zeros(p + m)])
    error = np.concatenate([-axis.gain * d_c * d_p * b_g.ravel(), b_p.ravel(), d_p * b_c.ravel()])
    return a, force, error, np.concatenate([c_g.ravel(), np.zeros(p + m)])


def at_rest(axis: Axis) -> Vector:
    """Return the closed loop's state with the vehicle at rest at 1 m, nothing else charged."""
    a = matrices(axis)[0]
    a_g, _, c_g, _ = canonical(tuple(tuple(np.atleast_1d(f)) for f in axis.plant))  # pyright: ignore[reportArgumentType]
    n = len(a_g)
    seen = np.array([(c_g @ np.linalg.matrix_power(a_g, k)).ravel() for k in range(n)])
    return np.concatenate([np.linalg.solve(seen, np.eye(n)[0]), np.zeros(len(a) - n)])


def moved(
    axis: Axis, times: Vector, *, start: float, force: float = 0.0, source: float = 0.0
) -> Vector:
    """Return x - x* at equispaced times; at t = 0 at rest at x* + start, the controller empty."""
    a, by_force, by_error, c = matrices(axis)
    step = float(times[1] - times[0])
    assert np.allclose(np.diff(times), step)
    assert times[0] == 0
    driven = by_force * force - by_error * source
    wide = np.zeros((len(a) + 1,) * 2)
    wide[:-1, :-1], wide[:-1, -1] = a, driven
    turn = exponential(wide * step)
    states = np.append(at_rest(axis) * (source + start), 1.0)[None]
    while len(states) < len(times):
        states = np.vstack([states, states @ turn.T])
        turn = turn @ turn
    return states[: len(times), :-1] @ c - source


def exponential(matrix: Vector) -> Vector:
    """Return e^A, by Taylor's series of A/2^k squared k times; SciPy's starts threads."""
    halvings = max(0, math.ceil(math.log2(np.abs(matrix).sum(axis=1).max() + 1e-300)) + 3)
    term = found = np.eye(len(matrix))
    for k in range(1, 14):
        term = term @ matrix / (k * 2.0**halvings)
        found = found + term
    for _ in range(halvings):
        found = found @ found
    return found


def settled(error: Vector, times: Vector, bound: float) -> float:
    """Return the last time at which the error is beyond its bound; infinite if at the end."""
    beyond = np.flatnonzero(np.abs(error) > bound)
    if not beyond.size:
        return 0.0
    return float("inf") if beyond[-1] == len(times) - 1 else float(times[beyond[-1]])


def slowest(axis: Axis) -> float:
    """Return the largest Re λ of the closed loop (1/s)."""
    return float(np.linalg.eigvals(matrices(axis)[0]).real.max())


def sensitivity(axis: Axis, omega: Vector) -> Complex:
    """Return 1/(1 + L(jω)), with the true dead time."""
    s = 1j * omega
    plant, law = (np.polyval(a, s) / np.polyval(b, s) for a, b in (axis.plant, axis.compensator))  # pyright: ignore[reportArgumentType, reportCallIssue]
    return 1 / (1 + axis.gain * plant * law * np.exp(-s * axis.delay))


def spread(axis: Axis) -> float:
    """Return the variance of x under white noise on the error of the two-sided density 1."""
    a, _, error, c = matrices(axis)
    covariance = solve_continuous_lyapunov(a, -np.outer(error, error))
    return float(c @ covariance @ c)


def poles(axis: Axis) -> Complex:
    """Return the closed loop's poles."""
    return np.linalg.eigvals(matrices(axis)[0]).astype(complex)
