"""Three loops with numbers of their own in every lane, their equations by hand, and references."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import extremum as es
from extremum.engines import taylor
from extremum.papers import zhang2007

T_END = 4.0
LANES = 64
"""Random loops on which every candidate's error is measured."""

TIGHT = 1e-13
CHANNEL = "controller.channels"
SHARED = (
    f"{CHANNEL}.0.dither.amplitude",
    f"{CHANNEL}.1.dither.amplitude",
    f"{CHANNEL}.0.gain",
    f"{CHANNEL}.1.gain",
    "controller.frequency",
    "controller.washout",
)
DECAY, WAVE = 0.1, 0.5
FORMULA = "exp(-a*(x**2 + y**2))*cos(b*x)"

Columns = NDArray[Any]
"""(8, loops): start x, y; α_x, α_y; c_x, c_y; ω; h."""

Rates = Callable[..., tuple[Any, ...]]
"""(sin ωt, cos ωt, states, columns) → ẋ."""


@dataclass(frozen=True)
class Library:
    """The functions with which a law is written, and the type of its numbers."""

    cos: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    number: Callable[[float], Any] = float


@dataclass(frozen=True)
class Problem:
    """One loop of which 10² to 10⁷ run at once.

    Attributes
    ----------
    name, title, words
        What the files, and what the tables call it, briefly and at length.
    loop
        The description of which our kernel is made.
    starts
        Dotted paths of the start.
    low, high
        Ranges of the eight columns; all loops within stay bounded.
    law
        The equations by hand.
    start
        Columns → the states at t = 0, by hand.
    """

    name: str
    title: str
    words: str
    loop: Any
    starts: tuple[str, str]
    low: tuple[float, ...]
    high: tuple[float, ...]
    law: Callable[[Library], Rates]
    start: Callable[[Any], tuple[Any, ...]]

    @property
    def swept(self) -> tuple[int, ...]:
        """Places of the eight columns among the system's parameters."""
        paths = [parameter.path for parameter in self.loop.system.parameters]
        return tuple(paths.index(path) for path in (*self.starts, *SHARED))

    def columns(self, loops: int, seed: int = 1) -> NDArray[np.float64]:
        """Return random numbers for `loops` loops, (8, loops)."""
        drawn = np.random.default_rng(seed).random((len(self.low), loops))
        low, high = (np.array(bound)[:, None] for bound in (self.low, self.high))
        return np.ascontiguousarray(low + (high - low) * drawn)

    def began(self, columns: Columns) -> list[Columns]:
        """Return the states at t = 0, an array of the columns' type each."""
        shape, kind = columns[0].shape, columns.dtype
        return [np.array(np.broadcast_to(np.asarray(x, kind), shape)) for x in self.start(columns)]


def error(states: NDArray[Any], reference: NDArray[np.float64]) -> float:
    """Return the largest error of any state of any loop, relative to 1 + |x|."""
    kept = np.asarray(states, np.float64)[:, : reference.shape[1]]
    return float((np.abs(kept - reference) / (1 + np.abs(reference))).max())


@cache
def reference(name: str) -> NDArray[np.float64]:
    """Return the states at the end of the first `LANES` loops, by heyoka at a tight tolerance."""
    problem = PROBLEMS[name]
    system, values = problem.loop.system, problem.loop.values.copy()
    ends: list[NDArray[np.float64]] = []
    for column in problem.columns(LANES).T:
        values[list(problem.swept)] = column
        run = taylor.integrate(system, values.tolist(), np.array([0.0, T_END]), tol=TIGHT)
        ends.append(run.states[-1])
    return np.stack(ends, axis=1)


# --- equations by hand ------------------------------------------------------------------------


def quadratic(on: Library) -> Rates:
    """Fig. 4: ẋ = αω cos ωt + cξ sin ωt, ẏ = αω sin ωt − cξ cos ωt, η̇ = hξ; J is quadratic."""
    one, half = on.number(1), on.number(0.5)

    def rates(s: Any, c: Any, state: Any, p: Any) -> tuple[Any, ...]:
        x, y, eta = state
        u, v = x + one, y + one
        xi = one - u * u - half * v * v - eta
        return p[2] * p[6] * c + p[4] * xi * s, p[3] * p[6] * s - p[5] * xi * c, p[7] * xi

    return rates


def force(on: Library) -> Rates:
    """Fig. 2 on the same map: ẍ = d − αω² sin ωt + ζ + 5m, ζ̇ = −3ζ − 12.5m, m = cξ sin ωt."""
    one, half = on.number(1), on.number(0.5)
    push, direct, filtered, pole = (on.number(k) for k in (0.3, 5.0, -12.5, -3.0))

    def rates(s: Any, c: Any, state: Any, p: Any) -> tuple[Any, ...]:
        x, v_x, y, v_y, eta, zeta_x, zeta_y = state
        u, v = x + one, y + one
        xi = one - u * u - half * v * v - eta
        m_x, m_y = p[4] * xi * s, -p[5] * xi * c
        return (
            v_x,
            push - p[2] * p[6] * p[6] * s + zeta_x + direct * m_x,
            v_y,
            p[3] * p[6] * p[6] * c + zeta_y + direct * m_y,
            p[7] * xi,
            pole * zeta_x + filtered * m_x,
            pole * zeta_y + filtered * m_y,
        )

    return rates


def wavy(on: Library) -> Rates:
    """Fig. 4's controller on J = exp(−a (x² + y²)) cos bx."""
    cos, exp = on.cos, on.exp
    decay, wave = on.number(-DECAY), on.number(WAVE)

    def rates(s: Any, c: Any, state: Any, p: Any) -> tuple[Any, ...]:
        x, y, eta = state
        xi = exp(decay * (x * x + y * y)) * cos(wave * x) - eta
        return p[2] * p[6] * c + p[4] * xi * s, p[3] * p[6] * s - p[5] * xi * c, p[7] * xi

    return rates


def _still(p: Any) -> tuple[Any, ...]:
    return p[0], p[1], 0 * p[0]


def _on_dither(p: Any) -> tuple[Any, ...]:
    peak = 1 - (p[0] + 1) ** 2 - (p[1] + 1) ** 2 / 2
    return p[0], p[2] * p[6], p[1], 0 * p[0], peak, 0 * p[0], 0 * p[0]


def _wavy_loop() -> Any:
    loop = zhang2007.scenario("fig4").loop
    field = es.Expression(FORMULA, parameters={"a": DECAY, "b": WAVE})
    return es.Loop(field, loop.vehicle, loop.controller, start=loop.start)


STARTS = ("start.0", "start.1")
LOW = (-0.5, -0.5, 0.06, 0.06, 6.0, 6.0, 25.0, 0.8)
HIGH = (0.5, 0.5, 0.1, 0.1, 10.0, 10.0, 35.0, 1.2)
PROBLEMS = {
    problem.name: problem
    for problem in (
        Problem(
            "quadratic",
            "Fig. 4",
            "Fig. 4, quadratic, three states",
            zhang2007.scenario("fig4").loop,
            STARTS,
            LOW,
            HIGH,
            quadratic,
            _still,
        ),
        Problem(
            "force",
            "Fig. 2",
            "Fig. 2 with Lead compensators, seven states",
            zhang2007.scenario("constant_force").loop,
            ("start.position.0", "start.position.1"),
            LOW,
            HIGH,
            force,
            _on_dither,
        ),
        Problem(
            "wavy",
            "exp/cos",
            "exp/cos map, three states",
            _wavy_loop(),
            STARTS,
            LOW,
            HIGH,
            wavy,
            _still,
        ),
    )
}
