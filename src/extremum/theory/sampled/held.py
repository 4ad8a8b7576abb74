"""What a controller at sampling instants sees of linear dynamics: exact, hold and delay included.

hold · G(s) · e^(−sT) between the instants t_k = k dt is, without any approximation,

X_(k+1) = Φ X_k + Γ₀ u_(k−n) + Γ₁ u_(k−n−1),  T = n dt + f, 0 ≤ f < dt,
Φ = e^(A dt), Γ₀ = ∫₀^(dt−f) e^(Aσ) dσ B, Γ₁ = e^(A(dt−f)) ∫₀^f e^(Aσ) dσ B,

whose transfer function is the modified z-transform of G. Source: Åström and Wittenmark,
Computer-Controlled Systems (1997), sections 2.3 and 2.6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[Any]
Complex = NDArray[Any]

WHOLE: Final = 1e-9
"""Part of a sample by which a delay may miss a whole number of samples and still be one."""


class StateSpace(NamedTuple):
    """ẋ = A x + B u, or the next x, and y = C x + D u."""

    a: Matrix
    b: Matrix
    c: Matrix
    d: float

    def at(self, z: Complex) -> Complex:
        """Return C (zI − A)⁻¹ B + D at points (N,)."""
        return through(self.a, self.b, self.c, z) + self.d


@dataclass(frozen=True, eq=False)
class Held:
    """hold · G · e^(−sT) at the sampling instants.

    Attributes
    ----------
    transition
        Φ, (n, n).
    early, late
        Γ₀ and Γ₁, (n, 1): what the input that arrives last and the one before leave in a sample.
    output
        C, (1, n).
    whole
        How many whole samples the delay has.
    """

    transition: Matrix
    early: Matrix
    late: Matrix
    output: Matrix
    whole: int

    def at(self, z: Complex) -> Complex:
        """Return G_d(z; T) at points (N,)."""
        entering = self.early + self.late / z[:, None, None]
        return through(self.transition, entering, self.output, z) / z**self.whole


def realised(numerator: Matrix, denominator: Matrix) -> StateSpace:
    """Return the controllable form of a proper transfer function, highest power first."""
    order = len(denominator) - 1
    numerator, denominator = numerator / denominator[0], denominator / denominator[0]
    padded = np.concatenate([np.zeros(order + 1 - len(numerator)), numerator])
    a = np.eye(order, k=1)
    b = np.zeros((order, 1))
    if order:
        a[-1] = -denominator[:0:-1]
        b[-1] = 1.0
    direct = float(padded[0])
    c = (padded[1:] - direct * denominator[1:])[::-1]
    return StateSpace(a, b, c.reshape(1, order), direct)


def tustin(system: StateSpace, dt: float, frequency: float) -> StateSpace:
    """Return C(z) by Tustin's rule, s → ω/tan(ω dt/2) (z − 1)/(z + 1), exact at 0 and at ω."""
    half = math.tan(frequency * dt / 2) / frequency
    unit = np.eye(len(system.a))
    inverse = np.linalg.inv(unit - half * system.a)
    entering = inverse @ system.b
    return StateSpace(
        inverse @ (unit + half * system.a),
        2 * half * entering,
        system.c @ inverse,
        system.d + half * float((system.c @ entering).sum()),
    )


def held(system: StateSpace, dt: float, delay: float) -> Held:
    """Return hold · G · e^(−sT) for a strictly proper G and T = `delay` (s)."""
    whole, part = divmod(delay / dt, 1.0)
    if part > 1 - WHOLE:
        whole, part = whole + 1, 0.0
    elif part < WHOLE:
        part = 0.0
    across, early = _stepped(system, (1 - part) * dt)
    if part == 0:
        return Held(across, early, np.zeros_like(early), system.c, int(whole))
    before, late = _stepped(system, part * dt)
    return Held(across @ before, early, across @ late, system.c, int(whole))


def through(a: Matrix, b: Matrix, c: Matrix, z: Complex) -> Complex:
    """Return c (zI − A)⁻¹ b at points (N,); b is one column or one per point."""
    if not len(a):
        return np.zeros(len(z), complex)
    resolvent = z[:, None, None] * np.eye(len(a)) - a
    column = np.broadcast_to(b, (len(z), len(a), 1))
    return (c @ np.linalg.solve(resolvent, column))[:, 0, 0]


def chained(compensator: StateSpace, plant: Held) -> tuple[Any, Any, Any]:
    """Return sparse A, B, C from the demodulated signal to the position as the samples show it.

    The states are the compensator's, the vehicle's, and the inputs on their way, the latest first.
    """
    from scipy.sparse import csc_array, dia_array

    inner, body = len(compensator.a), len(plant.transition)
    waiting = plant.whole + bool(plant.late.any())
    size = inner + body + waiting
    moving = slice(inner, inner + body)
    first = inner + body  # where u_(k-1) is
    now = np.zeros((1, size))  # what u_k is of the states
    now[:, :inner] = compensator.c
    a, b, c = np.zeros((first + 1, size + 1)), np.zeros((size, 1)), np.zeros((1, size))
    a[:inner, :inner], b[:inner] = compensator.a, compensator.b
    a[moving, moving] = plant.transition
    c[:, moving] = plant.output
    for column, behind in ((plant.early, plant.whole), (plant.late, plant.whole + 1)):
        if behind == 0:
            a[moving, :size] += column @ now
            b[moving] += compensator.d * column
        elif column.any():
            a[moving, first + behind - 1] += column[:, 0]
    if waiting:
        a[first, :size] = now
        b[first] = compensator.d
    rows = min(first + 1, size)
    top = csc_array(a[:rows, :size])
    top.resize((size, size))
    chain = np.zeros(size)
    chain[first : size - 1] = 1.0
    shift = dia_array((chain[None], [-1]), shape=(size, size))
    return csc_array(top + shift), csc_array(b), csc_array(c)


def _stepped(system: StateSpace, duration: float) -> tuple[Matrix, Matrix]:
    """Return e^(Ah) and ∫₀^h e^(Aσ) dσ B, h = `duration`."""
    from scipy.linalg import expm

    order = len(system.a)
    block = np.zeros((order + 1, order + 1))
    block[:order, :order], block[:order, order:] = system.a, system.b
    found = expm(block * duration)
    return found[:order, :order], found[:order, order:]
