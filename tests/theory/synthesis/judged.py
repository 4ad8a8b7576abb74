"""A design judged by exact loops of its own numbers, hand-written, at points of its box.

Of a design only the controller's numbers are taken: α, φ, c, C(s), ψ, ω_i and h. Vehicle, map and
force come from the problem's own numbers. Nothing of the package's theory is used.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from .. import oracle
from ..plain import Axis, Complex, Loop, Polynomials, Quadratic, Vector
from .exactly import polynomials

Point = Mapping[str, float]

LINEAR: Final = 0.1
"""c q r/ω of a displacement that counts as small."""
SETTLED: Final = 0.02
GRANTED: Final = 1.5
"""Settling times within which a small displacement must have settled."""
PER_PERIOD: Final = 48
"""Samples of a run for each period of the fastest dither; its means are exact to rounding."""


def random_points(box: Mapping[str, tuple[float, float]], count: int, seed: int) -> list[Point]:
    """Return points of a box: three corners, no middle of anything, the rest uniform."""
    rng = np.random.default_rng([41, seed])
    ends = np.array(list(box.values()), dtype=float).reshape(-1, 2)
    share = rng.random((count, len(ends)))
    share[:3] = np.round(share[:3])
    drawn = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    return [dict(zip(box, row.tolist(), strict=True)) for row in drawn]


def plant(axis: Mapping[str, Any], pole: float) -> Polynomials:
    """Return an axis' numerator and denominator with its unknown pole at a value."""
    slow = {
        "1/s": (1.0, 0.0),
        "1/s^2": (1.0, 0.0, 0.0),
        "1/(s(s + d))": (1.0, pole, 0.0),
        "1/(s - eps)": (1.0, -pole),
    }[axis["kind"]]
    below = np.array(slow)
    for tau in axis["lags"]:
        below = np.polymul(below, (tau, 1.0))
    return (1.0,), tuple(below.tolist())


def hand_written(numbers: Mapping[str, Any], controller: Any, point: Point) -> Loop:
    """Return the oracle's loop of a problem under a controller, at a point of the box."""
    size = len(numbers["axes"])
    matrix = np.zeros((size, size))
    for i, (low, _) in enumerate(numbers["curvature"]):
        matrix[i, i] = point.get(f"field.q.{i}", point.get(f"field.q.{i}.{i}", low))
        for j in range(i):
            matrix[i, j] = matrix[j, i] = point.get(f"field.q.{j}.{i}", 0.0)
    axes = []
    for i, (axis, channel) in enumerate(zip(numbers["axes"], controller.channels, strict=True)):
        low, high = axis["pole"]
        name = "epsilon" if axis["kind"] == "1/(s - eps)" else "d"
        here = point.get(f"vehicle.axes.{i}.parameters.{name}", low)
        axes.append(
            Axis(
                vehicle=plant(axis, here),
                amplitude=channel.dither.amplitude,
                gain=channel.gain,
                compensator=polynomials(channel.compensator.law()),
                phase=channel.dither.phase,
                reference=channel.reference.phase,
                ratio=channel.ratio,
                through=plant(axis, (low + high) / 2),
                force=point.get(f"vehicle.disturbance.{i}", 0.0),
            )
        )
    source = tuple(point.get(f"field.source.{i}", 0.0) for i in range(size))
    washout = controller.washout
    return Loop(tuple(axes), controller.frequency, washout, Quadratic(matrix), source)


def reach(loop: Loop) -> float:
    """Return the displacement r (m) with c q r/ω = 0.1 on the axis where that is least."""
    curvature = np.diag(loop.field.Q)  # pyright: ignore[reportAttributeAccessIssue]
    gains = np.array([abs(axis.gain) for axis in loop.axes])
    return float((LINEAR * loop.frequencies / (gains * curvature)).min())


def multipliers(orbit: oracle.Orbit) -> Complex:
    """Return the Floquet multipliers; exponents of those that rounding makes 0 are infinite."""
    return 1 + np.linalg.eigvals(orbit.change).astype(complex)


def settled(times: Vector, offset: Vector, mean: Vector, r: float, period: float) -> float:
    """Return the start (s) of the first window from which all period means stay near, or infinity.

    Near is within 2 % of r of the orbit's mean. `offset` is position − source at equispaced times,
    a whole number to the period.
    """
    per = round(period / (times[1] - times[0]))
    swept = np.cumsum(np.vstack([np.zeros(offset.shape[1]), offset]), axis=0)
    means = (swept[per:] - swept[:-per]) / per
    far = np.linalg.norm(means - mean, axis=1) > SETTLED * r
    if far[-1]:
        return math.inf
    return float(times[len(far) - np.argmax(far[::-1])]) if far.any() else 0.0


def times_of(loop: Loop, duration: float) -> Vector:
    """Return times over at least a duration and whole common periods, whole numbers to each."""
    each = PER_PERIOD * math.ceil(loop.period * loop.frequencies.max() / (2 * np.pi))
    cycles = math.ceil(duration / loop.period)
    return np.linspace(0.0, cycles * loop.period, cycles * each + 1)


def on_dither(loop: Loop, position: Vector) -> Vector:
    """Return the state on the dither at a position, compensators empty, the washout settled."""
    steady = loop.steady(0.0)
    start = oracle.at_rest(loop, position - loop.matrices[3] @ steady) + steady
    start[-1] = loop.field.value(position - np.array(loop.source))
    return start


def read(name: str, text: str) -> Any:
    """Return the value that a refusal proposes for an entry of the requirements."""
    if name != "uncertain":
        return ast.literal_eval(text)
    pairs = re.findall(r"([\w.]+): (\([^)]*\))", text)
    return {path: ast.literal_eval(ends) for path, ends in pairs}
