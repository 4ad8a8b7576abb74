"""What the theory must find, found otherwise: an oracle for `plain` loops, NumPy and SciPy only.

Periodic orbits by Newton shooting with DOP853 and its variational equations in raw coordinates;
averages by quadrature over many points; the loop gain's roots by polynomials. Nothing is shared
with ``extremum``.
"""

# ruff: noqa: N803, N806  (matrices are capitals)
from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment

from .plain import Complex, Loop, Vector, response

STEPS_PER_SHORTEST_PERIOD = 40

# --- the exact flow and its periodic orbit ----------------------------------------------------


class Flow(NamedTuple):
    """Where a state goes: the state, Phi - 1 and the integral of the position's offset."""

    state: Vector
    change: Vector
    swept: Vector


def flow(loop: Loop, y: Vector, start: float, duration: float) -> Flow:
    """Integrate the loop and its variational equations with DOP853, steps capped.

    Psi = Phi - 1 is what is integrated: at a high frequency it is small, and 1 would drown it.
    """
    A, _, _, P = loop.matrices
    n, unit = len(A), np.eye(len(A))

    def rates(t: float, packed: Vector) -> Vector:
        rate, w, slope, offset = loop.slopes(t, packed[:n])
        Phi = unit + packed[n : n + n * n].reshape(n, n)
        change = A @ Phi + w[:, None] * (slope @ Phi)
        return np.concatenate([rate, change.ravel(), offset])

    begin = np.concatenate([y, np.zeros(n * n + len(P))])
    cap = 2 * np.pi / loop.frequencies.max() / STEPS_PER_SHORTEST_PERIOD
    solution = solve_ivp(
        rates, (start, start + duration), begin, "DOP853", rtol=1e-13, atol=1e-16, max_step=cap
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    end = solution.y[:, -1]
    return Flow(end[:n], end[n : n + n * n].reshape(n, n), end[n + n * n :])


class Orbit(NamedTuple):
    """A periodic orbit: its period, start, multipliers - 1, and the mean of p - p* - a(t)."""

    period: float
    start: Vector
    change: Vector
    offset: Vector

    @property
    def exponents(self) -> Complex:
        """log(multipliers)/period, imaginary parts within half the orbit's frequency."""
        return log1p(np.linalg.eigvals(self.change).astype(complex)) / self.period

    @property
    def conditions(self) -> Vector:
        """The condition number of each multiplier, 1/|cos| between left and right vectors."""
        _, right = np.linalg.eig(self.change)
        left = np.linalg.inv(right)
        return np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0)


def log1p(z: Complex) -> Complex:
    """Return log(1 + z) for complex z, accurately for small z."""
    real = 0.5 * np.log1p(2 * z.real + z.real**2 + z.imag**2)
    return real + 1j * np.arctan2(z.imag, 1 + z.real)


def orbit(loop: Loop, guess: Vector | None = None, iterations: int = 30) -> Orbit:
    """Find the periodic orbit by Newton shooting from the averaged equilibrium or a guess."""
    y = average(loop).state + loop.steady(0.0) if guess is None else guess
    period = loop.period * (1 if loop.path is None else loop.path.periods)
    best = size = np.inf
    for _ in range(iterations):
        step = flow(loop, y, 0.0, period)
        correction = -np.linalg.solve(step.change, step.state - y)
        size = float(np.abs(correction).max() / (1e-300 + np.abs(y).max()))
        if size < 1e-9 and size >= best / 2:  # rounding is all that is left
            return Orbit(period, y, step.change, step.swept / period)
        best = min(best, size)
        y = y + correction
    message = f"Newton has not converged: the last step was {size:.1e}"
    raise RuntimeError(message)


def contraction(loop: Loop, start: Vector, periods: int, cycles: int = 2) -> Vector:
    """Return the real parts of a long orbit's exponents, by QR over its dither periods.

    Multipliers as small as 1e-57 are lost in the product of the transition matrices, but not in
    the logarithms of the triangular factors; `cycles` times around lets Q settle.
    """
    Q, y, grown = np.eye(len(start)), start, np.zeros(len(start))
    factors = []
    for k in range(periods):
        step = flow(loop, y, k * loop.period, loop.period)
        factors.append(np.eye(len(start)) + step.change)
        y = step.state
    for cycle in range(cycles):
        for factor in factors:
            Q, R = np.linalg.qr(factor @ Q)
            if cycle == cycles - 1:
                grown += np.log(np.abs(np.diag(R)))
    return grown / (periods * loop.period)


# --- averages ----------------------------------------------------------------------------------


class Average(NamedTuple):
    """An equilibrium of the averaged loop in y - steady(t), and the Jacobian there."""

    state: Vector
    matrix: Vector
    offset: Vector

    @property
    def eigenvalues(self) -> Complex:
        return np.linalg.eigvals(self.matrix).astype(complex)


def average(loop: Loop, guess: Vector | None = None, *, leading: bool = False) -> Average:
    """Average over many points of the common period, source held; Newton for the equilibrium.

    In y = steady(t) + r every term of the size of w is gone: dr/dt = A r + F d + w(t) xi with
    xi = J(P r + a(t) - p*) - r_n; the mean over t at fixed r is what counts.
    `leading` takes a(t) as w grows: the two differ by O(1/w) where the probe is not sent through G.
    """
    A, F, _, P = loop.matrices
    source = loop.source_at(0.0)
    shortest = 2 * np.pi / loop.frequencies.max()
    points = 64 * round(loop.period / shortest) + 1
    turns = np.exp(1j * np.outer(np.arange(points) * loop.period / points, loop.frequencies))
    swing = ((loop.leading_dither if leading else loop.dither) * turns).imag
    directions = loop.directions(turns)
    r = at_rest(loop, source) if guess is None else guess
    matrix = A
    for _ in range(60):
        offset = P @ r + swing - source
        xi = loop.field.value(offset) - r[-1]
        rate = A @ r + F @ loop.forces + (directions * xi[:, None]).mean(axis=0)
        slope = loop.field.gradient(offset) @ P
        slope[:, -1] -= 1.0
        matrix = A + directions.T @ slope / points
        step = np.linalg.solve(matrix, -rate)
        r = r + step
        if np.abs(step).max() < 1e-13 * max(1.0, np.abs(r).max()):
            return Average(r, matrix, P @ r - source)
    raise RuntimeError("Newton has not converged on the average")


def at_rest(loop: Loop, position: Vector) -> Vector:
    """Return the state at rest at a position, the washout started at the J sensed there.

    Of all states with that position it is the least one, without velocity for 1/s, 1/(s - eps) and
    1/s^2, compensators empty.
    """
    P = loop.matrices[3]
    state = np.linalg.pinv(P) @ position
    state[-1] = loop.field.value(position - loop.source_at(0.0))
    return state


def demodulation(loop: Loop, *, finite: bool = False) -> Vector:
    """M_ij, the mean of reference_i times what the washout passes of dither_j.

    As w grows that is all of its limit; `finite` takes both at the loop's own frequencies.
    """
    passed = loop.leading_dither
    if finite:
        passed = loop.dither / (1 + loop.washout / (1j * loop.frequencies))
    references = loop.references / gains(loop)
    same = np.isclose(loop.frequencies[:, None], loop.frequencies)
    return np.where(same, 0.5 * (references[:, None] * passed.conj()).real, 0.0)


def gains(loop: Loop) -> Vector:
    """Return c per axis."""
    return np.array([axis.gain for axis in loop.axes])


def linear_roots(loop: Loop, Q: Vector) -> Complex:
    """Return the roots of prod(den) det(I + diag(c C G) M 2Q) (s + h), by polynomials.

    With one axis, or a diagonal Q, that is 1 + alpha c q C(s) G(s) = 0 per axis.
    """
    K = gains(loop)[:, None] * demodulation(loop) @ (2 * Q)
    above = [np.polymul(axis.vehicle[0], axis.compensator[0]) for axis in loop.axes]
    below = [np.polymul(axis.vehicle[1], axis.compensator[1]) for axis in loop.axes]
    total = np.zeros(1)
    for order in permutations(range(len(K))):
        term = np.array([np.linalg.det(np.eye(len(K))[list(order)])])
        for i, j in enumerate(order):
            entry = K[i, j] * above[i]
            term = np.polymul(term, np.polyadd(entry, below[i]) if i == j else entry)
        total = np.polyadd(total, term)
    return np.append(np.roots(total), -loop.washout).astype(complex)


def sensitivity(loop: Loop, Q: Vector, frequency: float) -> Complex:
    """Return S(jw) = (I + diag(c C G) M 2Q)^-1: the mean offset is -S times the source's path."""
    forward = [
        response(axis.vehicle, frequency) * response(axis.compensator, frequency)
        for axis in loop.axes
    ]
    L = np.diag(gains(loop) * np.array(forward)) @ demodulation(loop) @ (2 * Q)
    return np.linalg.inv(np.eye(len(L)) + L).astype(complex)


def matched(found: ArrayLike, expected: ArrayLike, frequency: float = 0.0) -> tuple[Vector, Vector]:
    """Pair two sets of exponents, imaginary parts modulo a frequency (0: none).

    Returns the distances in the order of `expected`, and the indices into `found`.
    """
    apart: Complex = np.subtract.outer(
        np.asarray(expected, dtype=complex), np.asarray(found, dtype=complex)
    )
    if frequency:
        apart = apart - 1j * frequency * np.round(apart.imag / frequency)
    rows, columns = linear_sum_assignment(np.abs(apart))
    return np.abs(apart)[rows, columns], columns
