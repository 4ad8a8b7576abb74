"""The sampled loop once more, in plain NumPy: integrator chains advanced exactly between samples.

Nothing of the package is used. Many lanes run at once; a lane is one loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plain:
    """Two axes of 1/s or 1/s² over J = −p̃ᵀ Q p̃, with or without a lead k (s − z)/(s − p)."""

    dt: float
    integrators: int = 1
    omega: tuple[float, float] = (30.0, 30.0)
    phase: tuple[float, float] = (0.0, -math.pi / 2)
    alpha: float = 0.08
    gain: tuple[float, float] = (10.0, 10.0)
    q: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 0.5))
    washout: float = 1.0
    lead: tuple[float, float, float] | None = None
    delay: float = 0.0  # the sensor's
    known: float | None = None  # of the delay, beside dt/2; None: not even that

    def steps(
        self, offset: Array, sigma: float = 0.0, correlation_time: float = 0.0, seed: int = 0
    ) -> Iterator[Array]:
        """Yield the position (lanes, 2) at t_k = k dt, from t = 0 on the dither about `offset`."""
        rng = np.random.default_rng(seed)
        correction = 0.0 if self.known is None else self.dt / 2 + self.known
        dt, omega, phase = self.dt, np.array(self.omega), np.array(self.phase)
        lanes, q = len(offset), np.array(self.q)
        whole, part = divmod(self.delay, dt)
        before = [self.dither(k) for k in range(-int(whole) - 1, 0)]
        past = [(offset + a, v, u) for a, v, u in before]  # the oldest first
        x, v, _ = self.dither(0)
        x = offset + x
        warped = omega / np.tan(omega * dt / 2)
        slow, corner = float(warped[0]), self.washout
        memory = math.exp(-dt / correlation_time) if correlation_time else 0.0
        noise = sigma * rng.standard_normal(lanes)
        xi, last, m, w = np.zeros(lanes), None, np.zeros_like(x), np.zeros_like(x)
        k = 0
        while True:
            yield x
            between = self._moved(*past[0], dt - part)[0]
            seen = between if part else past[1][0] if whole else x
            J = -((seen @ q) * seen).sum(axis=1) + noise  # noqa: N806 - the field's letter
            if last is not None:
                xi = ((slow - corner) * xi + slow * (J - last)) / (slow + corner)
            last = J
            angle = omega * (k * dt) + phase
            before, m = (
                m,
                np.array(self.gain) * xi[:, None] * np.sin(angle - omega * correction),
            )
            if self.lead is None:
                w = m
            else:
                size, zero, pole = self.lead
                entering = (warped - zero) * m - (warped + zero) * before
                w = (size * entering + (warped + pole) * w) / (warped - pole)
            u = self._probe(angle) + w
            past = [*past[1:], (x, v, u)]
            x, v = self._moved(x, v, u, dt)
            noise = memory * noise + math.sqrt(1 - memory**2) * sigma * rng.standard_normal(lanes)
            k += 1

    def dither(self, k: int) -> tuple[Array, Array, Array]:
        """Return position, velocity and probe at t_k when nothing but the probe is at work.

        α x/sin x (1/s) or α x² cos x/sin² x (1/s²) sin(ωt + φ − x), x = ω dt/2.
        """
        omega, phase = np.array(self.omega), np.array(self.phase)
        x = omega * self.dt / 2
        size = x / np.sin(x) if self.integrators == 1 else x**2 * np.cos(x) / np.sin(x) ** 2
        now, later = (
            self.alpha * size * np.sin(omega * i * self.dt + phase - x) for i in (k, k + 1)
        )
        u = self._probe(omega * k * self.dt + phase)
        return now, (later - now) / self.dt - self.dt / 2 * u, u

    def _probe(self, angle: Array) -> Array:
        omega = np.array(self.omega)
        if self.integrators == 1:
            return self.alpha * omega * np.cos(angle)
        return -self.alpha * omega**2 * np.sin(angle)

    def _moved(self, x: Array, v: Array, u: Array, duration: float) -> tuple[Array, Array]:
        if self.integrators == 1:
            return x + duration * u, v
        return x + duration * v + duration**2 / 2 * u, v + duration * u

    def growth(self, duration: float, **changes: object) -> float:
        """Return the rate (1/s) at which two runs a hair apart drift apart in the end."""
        loop = replace(self, **changes)  # pyright: ignore[reportArgumentType]
        offset = np.array([[0.0, 0.0], [1e-7, 0.7e-7]])
        count = round(duration / self.dt)
        apart = np.empty(count)
        for k, x in zip(range(count), loop.steps(offset), strict=False):
            apart[k] = np.hypot(*(x[1] - x[0]))
        early, late = apart[count // 4 : count * 5 // 8], apart[count * 5 // 8 :]
        return math.log(late.max() / early.max()) / (duration * 3 / 8)
