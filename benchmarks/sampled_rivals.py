"""Fig. 4's controller sampled, and its loop, as one would write them without `extremum`.

Plain floats, NumPy arrays, `scipy.signal.lfilter` one sample at a time, and a discrete system of
python-control. The washout is Tustin's, pre-warped at ω. None of them looks at what a sample is:
one NaN, and they answer NaN for ever.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter, lfilter_zi

OMEGA, AMPLITUDE, WASHOUT = 30.0, 0.08, 1.0
SPEED = AMPLITUDE * OMEGA
PEAK, Q_X, Q_Y = 1.0, 1.0, 0.5

Step = Callable[[float], Any]
"""J → the two commands; what it remembers is its own."""


def washout(dt: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return numerator and denominator in z of s/(s + h), exact at ω."""
    warped = OMEGA / math.tan(OMEGA * dt / 2)
    numerator = np.array([warped, -warped]) / (warped + WASHOUT)
    return numerator, np.array([1.0, (WASHOUT - warped) / (warped + WASHOUT)])


def plain(dt: float, first: float, gain: float = 10.0) -> Step:
    """Return a step in floats."""
    (g, _), (_, a) = (part.tolist() for part in washout(dt))
    xi, last, count = 0.0, first, 0
    sin, cos = math.sin, math.cos

    def step(sample: float) -> tuple[float, float]:
        nonlocal xi, last, count
        xi = g * (sample - last) - a * xi
        last = sample
        angle = OMEGA * (count * dt)
        count += 1
        sine, cosine = sin(angle), cos(angle)
        return SPEED * cosine + gain * xi * sine, SPEED * sine - 10.0 * xi * cosine

    return step


def arrays(dt: float, first: float, gain: float = 10.0) -> Step:
    """Return a step in NumPy arrays, an entry per axis."""
    (g, _), (_, a) = washout(dt)
    phases, gains = np.array([0.0, -np.pi / 2]), np.array([gain, 10.0])
    xi, last, count = 0.0, first, 0

    def step(sample: float) -> NDArray[np.float64]:
        nonlocal xi, last, count
        xi = g * (sample - last) - a * xi
        last = sample
        angles = OMEGA * (count * dt) + phases
        count += 1
        return SPEED * np.cos(angles) + gains * (xi * np.sin(angles))

    return step


def filtered(dt: float, first: float) -> Step:
    """Return a step whose washout is `lfilter`, fed one sample at a time."""
    b, a = washout(dt)
    memory = lfilter_zi(b, a) * first
    phases, gains = np.array([0.0, -np.pi / 2]), np.array([10.0, 10.0])
    count = 0

    def step(sample: float) -> NDArray[np.float64]:
        nonlocal memory, count
        xi, memory = lfilter(b, a, [sample], zi=memory)
        angles = OMEGA * (count * dt) + phases
        count += 1
        return SPEED * np.cos(angles) + gains * (xi * np.sin(angles))

    return step


def discrete_system(dt: float, first: float) -> Step:
    """Return a step of a discrete-time input-output system of python-control."""
    (g, _), (_, a) = washout(dt)
    phases, gains = np.array([0.0, -np.pi / 2]), np.array([10.0, 10.0])

    def washed(x: Any, u: Any) -> Any:
        return g * (u[0] - x[1]) - a * x[0]

    def update(t: float, x: Any, u: Any, _: Any) -> Any:
        return [washed(x, u), u[0]]

    def output(t: float, x: Any, u: Any, _: Any) -> Any:
        angles = OMEGA * t + phases
        return SPEED * np.cos(angles) + gains * (washed(x, u) * np.sin(angles))

    system = control.nlsys(update, output, inputs=1, outputs=2, states=2, dt=dt)
    state, count = np.array([0.0, first]), 0

    def step(sample: float) -> Any:
        nonlocal state, count
        entering, time = np.array([sample]), count * dt
        count += 1
        sent = system.output(time, state, entering)
        state = system.dynamics(time, state, entering)
        return sent

    return step


# --- the loop ----------------------------------------------------------------------------------


def floats_loop(dt: float, steps: int, gain: float) -> NDArray[np.float64]:
    """Return positions (steps + 1, 2) from a loop over floats."""
    x = y = 1.0
    step = plain(dt, PEAK - Q_X * 4 - Q_Y * 4, gain)
    rows = [(x, y)]
    for _ in range(steps):
        u, v = step(PEAK - Q_X * (x + 1) ** 2 - Q_Y * (y + 1) ** 2)
        x, y = x + dt * u, y + dt * v
        rows.append((x, y))
    return np.array(rows)


def arrays_loop(dt: float, steps: int, gain: float) -> NDArray[np.float64]:
    """Return positions from a loop over NumPy arrays."""
    q, place = np.array([Q_X, Q_Y]), np.ones(2)
    step = arrays(dt, PEAK - Q_X * 4 - Q_Y * 4, gain)
    rows = np.empty((steps + 1, 2))
    rows[0] = place
    for k in range(steps):
        place = place + dt * step(PEAK - float(q @ (place + 1) ** 2))
        rows[k + 1] = place
    return rows


def between_samples(dt: float, steps: int, gain: float) -> NDArray[np.float64]:
    """Return positions of a vehicle that `solve_ivp` moves from sample to sample."""
    place = np.ones(2)
    step = arrays(dt, PEAK - Q_X * 4 - Q_Y * 4, gain)
    rows = np.empty((steps + 1, 2))
    rows[0] = place
    for k in range(steps):
        x, y = place
        held = step(PEAK - Q_X * (x + 1) ** 2 - Q_Y * (y + 1) ** 2)
        place = solve_ivp(lambda t, p, u=held: u, (0.0, dt), place, first_step=dt).y[:, -1]
        rows[k + 1] = place
    return rows


def many(loops: int, steps: int, dt: float, sigma: float) -> NDArray[np.float64]:
    """Return the last positions (2, loops) of loops with white noise, in NumPy over the loops.

    Philox makes the random numbers, a generator of the same family as ours.
    """
    draw = np.random.Generator(np.random.Philox(1)).standard_normal
    (g, _), (_, a) = (part.tolist() for part in washout(dt))
    x, y, xi = np.ones(loops), np.ones(loops), np.zeros(loops)
    last, noise, work = np.empty(0), np.empty(loops), np.empty(loops)
    for k in range(steps):
        sample = np.add(x, 1.0)
        sample *= sample
        np.add(y, 1.0, out=work)
        work *= work
        work *= Q_Y
        sample += work
        np.subtract(PEAK, sample, out=sample)
        draw(out=noise)
        noise *= sigma
        sample += noise
        xi *= -a
        if k:
            np.subtract(sample, last, out=work)
            work *= g
            xi += work
        last = sample
        sine, cosine = math.sin(OMEGA * k * dt), math.cos(OMEGA * k * dt)
        np.multiply(xi, 10.0 * dt * sine, out=work)
        work += SPEED * dt * cosine
        x += work
        np.multiply(xi, -10.0 * dt * cosine, out=work)
        work += SPEED * dt * sine
        y += work
    return np.stack([x, y])
