"""The exact loop at points of the box: its orbit's exponents, how it settles, how it arrives."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...engines.choice import ENGINES, usual
from ...engines.trajectory import COMPLETED
from ...loop import Loop
from ..floquet import leading, monodromy
from ..orbits import Orbit, periodic_orbit
from .building import centred
from .family import LINEAR
from .responses import SETTLED

Vector = NDArray[np.float64]

SAMPLES: Final = 72
"""Samples per period of a run."""
TOLERANCE: Final = 1e-9
PATIENCE: Final = 4.0
"""Wanted settling times after which a loop counts as not settling."""


@dataclass(frozen=True)
class Confirmed:
    """What the exact loop does at one point of the box.

    Attributes
    ----------
    point
        Dotted path → value.
    exponent
        The largest real part of the Floquet exponents (1/s); NaN without an orbit.
    settling, charging
        The last whole period's end (s) at which a displacement r with c q r/ω = 0.1 has not yet
        fallen to 2 % of itself: with the integrators charged, and with an empty controller and
        source and force at their farthest; infinite if never, NaN where it was not asked.
    offset
        |mean of x̃| on the orbit (m).
    outcome
        What `periodic_orbit` says.
    """

    point: Mapping[str, float]
    exponent: float
    settling: float
    charging: float
    offset: float
    outcome: str

    @property
    def stable(self) -> bool:
        """Whether there is an orbit and every exponent has a negative real part."""
        return self.exponent < 0


def confirmed(loop: Loop, point: Mapping[str, float], wanted: float) -> Confirmed:
    """Return what the exact loop does at a point; `wanted` is the settling time (s) or infinity."""
    here = loop.replace(dict(point))
    orbit = periodic_orbit(here)
    if orbit.closed is None:
        return Confirmed(point, math.nan, math.inf, math.inf, math.nan, orbit.outcome)
    exponent = leading(orbit.closed.factors, orbit.period)
    if exponent >= 0:
        return Confirmed(point, exponent, math.inf, math.inf, math.nan, orbit.outcome)
    times = settlings(here, orbit, wanted) if math.isfinite(wanted) else (math.nan, math.nan)
    offset = float(np.linalg.norm(orbit.offset))
    return Confirmed(point, exponent, *times, offset, orbit.outcome)


def reach(loop: Loop) -> float:
    """Return the displacement r (m) with c q r/ω = 0.1 on the axis where that is least."""
    controller: Any = loop.controller
    q = np.array(loop.field.q)  # pyright: ignore[reportAttributeAccessIssue]
    curvature = np.diag(q) if q.ndim == 2 else q
    rates = zip(controller.frequencies(), controller.channels, curvature, strict=True)
    return min(float(LINEAR * w / abs(channel.gain * k)) for w, channel, k in rates)


def settlings(loop: Loop, orbit: Orbit, wanted: float) -> tuple[float, float]:
    """Return the longest exact settling times (s) from ±r along each axis, charged and empty.

    To first order about the orbit the deviation after k periods is Mᵏ δ, M the monodromy matrix; δ
    is the start on the dither, minus the same start without r, and minus the orbit at t = 0.
    """
    assert orbit.closed is not None
    turn = monodromy(orbit.closed.factors)
    system, r = orbit.frame.system, reach(loop)
    places = [system.states.index(x) for x in system.outputs["offset"]]
    still, *moved = (np.array(system.start(values)) for values in _starts(loop, orbit, r))
    count = math.ceil(PATIENCE * wanted / orbit.period)
    deviation = np.array([x - origin for origin in (still, orbit.start) for x in moved]).T
    outside = np.empty((count, deviation.shape[1]), dtype=bool)
    for k in range(count):
        outside[k] = np.linalg.norm(deviation[places], axis=0) > SETTLED * r
        deviation = turn @ deviation
    last = np.where(outside[-1], np.inf, count - 1.0 - np.argmax(outside[::-1], axis=0))
    charged, empty = np.split(np.where(outside.any(axis=0), last, 0.0) * orbit.period, 2)
    return float(charged.max()), float(empty.max())


def _starts(loop: Loop, orbit: Orbit, r: float) -> list[list[float]]:
    """Return the frame's values with a start centred at the source, and ±r along each axis."""
    controller: Any = loop.controller
    source = loop.field.source  # pyright: ignore[reportAttributeAccessIssue]
    paths = [p.path for p in orbit.frame.system.parameters]
    found = []
    for axis, step in ((0, 0.0), *itertools.product(range(len(source)), (r, -r))):
        centre = tuple(x + step * (i == axis) for i, x in enumerate(source))
        values = list(orbit.frame.values)
        for i, x in enumerate(centred(controller, centre)):
            values[paths.index(f"start.position.{i}")] = x
        found.append(values)
    return found


@dataclass(frozen=True)
class Arrival:
    """A run of the exact loop from far away.

    Attributes
    ----------
    outcome
        As of `simulate`.
    distance
        Distance of the last period's mean from the orbit's (m); infinite if the run broke off.
    input
        The largest |input| on each axis.
    """

    outcome: str
    distance: float
    input: tuple[float, ...]


def arrival(
    loop: Loop, point: Mapping[str, float], displacement: Sequence[float], duration: float
) -> Arrival:
    """Run the exact loop from a displacement (m) for a duration (s)."""
    here = loop.replace(dict(point))
    orbit = periodic_orbit(here)
    if not orbit.found:
        return Arrival(orbit.outcome, math.inf, (0.0,) * len(displacement))
    system, values = orbit.frame.system, list(orbit.frame.values)
    source = here.field.source  # pyright: ignore[reportAttributeAccessIssue]
    paths = [p.path for p in system.parameters]
    start = tuple(x + d for x, d in zip(source, displacement, strict=True))
    for i, x in enumerate(centred(here.controller, start)):  # pyright: ignore[reportArgumentType]
        values[paths.index(f"start.position.{i}")] = x
    cycles = math.ceil(duration / orbit.period)
    times = np.linspace(0.0, cycles * orbit.period, cycles * SAMPLES + 1)
    run = ENGINES[usual(system)].integrate(
        system, values, times, tol=TOLERANCE, state=system.start(values)
    )
    outputs = system.evaluate(run.times, run.states, values)
    pushed = tuple(np.abs(outputs["input"]).max(axis=0).tolist())
    if run.outcome != COMPLETED:
        return Arrival(run.outcome, math.inf, pushed)
    mean = outputs["offset"][-SAMPLES:].mean(axis=0)
    return Arrival(run.outcome, float(np.linalg.norm(mean - orbit.offset)), pushed)
