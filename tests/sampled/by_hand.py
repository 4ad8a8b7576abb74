"""A sampled loop written by hand: SciPy integrates the vehicle from sample to sample."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """q̇ = A q + B (u + d), p = C q, and q where it is at rest at p = 1."""

    a: Sequence[Sequence[float]]
    b: Sequence[float]
    c: Sequence[float]
    rest: Sequence[float]
    response: Callable[[complex], complex]
    force: float = 0.0


INTEGRATOR = Axis([[0]], [1], [1], [1], lambda s: 1 / s)
DRAGGED = Axis([[0, 1], [0, -0.7]], [0, 1], [1, 0], [1, 0], lambda s: 1 / (s * (s + 0.7)), 0.1)
ZERO = Axis(  # (s + 3)/(s² + s + 1), controllable form; ṗ = 0 where q₁ = 2 q₂
    [[0, 1], [-1, -1]],
    [0, 1],
    [3, 1],
    [2 / 7, 1 / 7],
    lambda s: (s + 3) / (s**2 + s + 1),
    0.2,
)


@dataclass
class Seeker:
    """The paper's Fig. 1 in discrete time: s → K (z − 1)/(z + 1), K = ω/tan(ω dt/2).

    `late` is the phase (rad) by which the references lag, half a sample included.
    """

    dt: float
    axes: Sequence[Axis]
    late: float = 0.0
    omega: float = 30.0
    corner: float = 1.0
    gain: float = 10.0
    alpha: float = 0.08
    phases: tuple[float, float] = (0.0, -math.pi / 2)
    xi: float = 0.0
    last: float | None = None

    def command(self, k: int, sample: float) -> Numbers:
        warped = self.omega / math.tan(self.omega * self.dt / 2)
        before = sample if self.last is None else self.last
        change = warped * (sample - before)
        self.xi = ((warped - self.corner) * self.xi + change) / (warped + self.corner)
        self.last = sample
        t, out = k * self.dt, []
        for axis, phase in zip(self.axes, self.phases, strict=True):
            turned = np.exp(1j * (self.omega * t + phase)) / axis.response(1j * self.omega)
            reference = math.sin(self.omega * t + phase - self.late)
            out.append(self.alpha * turned.imag + self.gain * self.xi * reference)
        return np.array(out)


@dataclass
class Actuator:
    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf
    delay: float = 0.0
    lag: float | None = None


@dataclass
class ByHand:
    """The closed loop; `moves` are the pieces of the motion, as functions of time."""

    axes: Sequence[Axis]
    field: Callable[[Numbers], float]
    seeker: Seeker
    actuator: Actuator = dataclasses.field(default_factory=Actuator)
    late: float = 0.0
    moves: list[tuple[float, Callable[[float], Numbers]]] = dataclasses.field(default_factory=list)

    def run(self, start: Sequence[float], steps: int) -> tuple[Numbers, Numbers]:
        """Return the positions and samples at t_k."""
        dt, sent = self.seeker.dt, [np.zeros(len(self.axes))]
        state = np.concatenate(
            [p * np.array(a.rest) for p, a in zip(start, self.axes, strict=True)]
        )
        state = np.concatenate([state, np.zeros(len(self.axes))])
        self.first = self.field(self.place(state))
        positions, samples = [self.place(state)], []
        for k in range(steps):
            samples.append(self.sensed(k * dt, state))
            command = self.seeker.command(k, samples[-1])
            command = np.clip(command, self.actuator.low, self.actuator.high)
            most = self.actuator.rate * dt
            sent.append(sent[-1] + np.clip(command - sent[-1], -most, most))
            state = self.moved(k, state, sent)
            positions.append(self.place(state))
        samples.append(self.sensed(steps * dt, state))
        return np.array(positions), np.array(samples)

    def place(self, state: Numbers) -> Numbers:
        found, rest = [], state
        for axis in self.axes:
            own, rest = rest[: len(axis.b)], rest[len(axis.b) :]
            found.append(np.dot(axis.c, own))
        return np.array(found)

    def sensed(self, t: float, state: Numbers) -> float:
        if not self.late:
            return self.field(self.place(state))
        then = t - self.late
        if then <= 0:
            return self.first
        begin, move = next(m for m in reversed(self.moves) if m[0] <= then + 1e-12)
        return self.field(self.place(move(max(then, begin))))

    def moved(self, k: int, state: Numbers, sent: list[Numbers]) -> Numbers:
        """Integrate over a sample; what was sent at t_j arrives at t_j + delay."""
        dt, delay = self.seeker.dt, self.actuator.delay
        begin, end = k * dt, (k + 1) * dt
        whole = math.floor(delay / dt + 1e-9)
        switch = begin + delay - whole * dt
        new, old = (sent[max(0, k + 1 - whole - i)] for i in (0, 1))
        pieces = [(begin, switch, old), (switch, end, new)] if delay else [(begin, end, new)]
        for left, right, u in pieces:
            if right - left > 1e-12:
                run = solve_ivp(
                    self.rates,
                    (left, right),
                    state,
                    "DOP853",
                    args=(u,),
                    rtol=1e-12,
                    atol=1e-13,
                    dense_output=True,
                )
                self.moves.append((left, run.sol))
                state = run.y[:, -1]
        return state

    def rates(self, t: float, state: Numbers, u: Numbers) -> Numbers:
        count, lag = len(self.axes), self.actuator.lag
        reaching = u if lag is None else state[-count:]
        found, rest = [], state
        for axis, w in zip(self.axes, reaching, strict=True):
            own, rest = rest[: len(axis.b)], rest[len(axis.b) :]
            found += [np.dot(axis.a, own) + np.array(axis.b) * (w + axis.force)]
        slow = np.zeros(count) if lag is None else (u - state[-count:]) / lag
        return np.concatenate([*found, slow])
