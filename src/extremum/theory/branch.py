"""The periodic orbit as the dither's frequency varies: continuation in ω.

At a high ω the averaged equilibrium is an accurate guess; from there the orbit is followed, each
one extrapolated from those before it. The position's dither keeps its amplitude α, and the source
its place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..controllers import Probe
from ..engines import shooting
from ..engines.shooting import Closed
from ..loop import Loop
from ..rational import at_frequency
from . import floquet
from .averaging import Average, average
from .demodulation import gradient
from .frame import Frame
from .periods import slow_frequencies

Vector = NDArray[np.float64]

BEGINNINGS: Final = 10
"""How often ω is made four times as large in search of one whose orbit the average predicts."""

LARGEST: Final = math.log(2)
SMALLEST: Final = 1e-7
FOLDED: Final = 0.02

RATE: Final = 4.0
MAX_PARTS: Final = 4096
"""A segment is at most as long as the fastest mode takes to change by e^RATE, but no shorter than
one part in 4096 of a cycle."""


@dataclass(frozen=True, eq=False)
class Point:
    """The orbit at one ω.

    Attributes
    ----------
    frequency
        ω, ``controller.frequency`` (rad/s).
    frame
        The loop's equations with that ω in the values.
    orbit
        The orbit in the frame's coordinates.
    """

    frequency: float
    frame: Frame
    orbit: Closed

    @cached_property
    def exponents(self) -> floquet.Complex:
        """The Floquet exponents (1/s), the least stable first."""
        return floquet.exponents(self.orbit.factors, self.orbit.period)

    @property
    def leading(self) -> float:
        """The largest real part (1/s)."""
        return float(self.exponents[0].real)


@dataclass(frozen=True, eq=False)
class Branch:
    """The orbits met on the way from one ω to another.

    Attributes
    ----------
    points
        In the order in which they were met.
    end
        Why the orbit could not be followed to where it was wanted; empty if it could.
    folded
        Whether the branch turns back there: a real multiplier comes to +1.
    """

    points: tuple[Point, ...]
    end: str
    folded: bool = False


# --- where it begins --------------------------------------------------------------------------


def rests(frame: Frame) -> bool:
    """Return whether time enters the rates by the dithers only: the source rests, or ramps."""
    return slow_frequencies(frame.system) == ()


def frequency(loop: Loop) -> float:
    """Return ω of the loop (rad/s)."""
    return float(loop.controller.base())


def changes(loop: Loop, wanted: float) -> dict[str, float]:
    """Return what ω = `wanted` changes so that the position's dither stays as it is.

    A `Dither` states that; a `Probe`'s amplitude is scaled with 1/|G(jω)|. References keep their
    phases.
    """
    controller = gradient(loop)
    changed = {"controller.frequency": wanted}
    for axis, channel in enumerate(controller.channels):
        if isinstance(channel.dither, Probe):
            before = controller.frequencies()[axis]
            plant = loop.vehicle.dynamics()[axis]
            assert plant is not None
            after = before * wanted / controller.frequency
            scale = abs(at_frequency(plant, before) / at_frequency(plant, after))
            path = f"controller.channels.{axis}.dither.amplitude"
            changed[path] = channel.dither.amplitude * scale
    return changed


def reached(predicted: Average, cycle: tuple[float, int]) -> Branch:
    """Return the branch from where the averaged equilibrium leads to it, to the loop's own ω."""
    loop = predicted.frame.loop
    wanted = frequency(loop)
    for k in range(BEGINNINGS + 1):
        if k:
            predicted = average(loop.replace(changes(loop, wanted * 4.0**k)))
        again = predicted.frame.period() if k else cycle
        if again is None or predicted.equilibrium is None:
            break
        nodes = guess(predicted, again)
        start = _point(wanted * 4.0**k, predicted.frame, again[0], nodes)
        if start is not None:
            return followed(start, wanted) if k else Branch((start,), "")
    end = "the averaged equilibrium leads to no orbit, at no higher ω either"
    return Branch((), end)


def guess(predicted: Average, cycle: tuple[float, int]) -> Vector:
    """Return the averaged equilibrium at every node."""
    assert predicted.equilibrium is not None
    count = _segments(*cycle, np.abs(predicted.eigenvalues))
    return np.tile(predicted.equilibrium, (count, 1))


# --- following it -----------------------------------------------------------------------------


def followed(start: Point, target: float, *, largest: float = LARGEST) -> Branch:
    """Follow the orbit from `start` to ω = `target`.

    Steps are in ln ω: halved where Newton's method does not contract at once, so that no other
    orbit is taken for this one, down to 1e-7; that is where the branch ends.

    Parameters
    ----------
    largest
        The largest step.
    """
    points = [start]
    step, goal = largest, math.log(target)
    while points[-1].frequency != target:
        here = math.log(points[-1].frequency)
        way = goal - here
        last = abs(way) <= 1.01 * step
        point = near(points[-2:], target if last else math.exp(here + math.copysign(step, way)))
        if point is not None:
            points.append(point)
            step = min(1.6 * step, largest)
            continue
        step = min(step, abs(way)) / 2
        if step < SMALLEST:
            return _ended(points)
    return Branch(tuple(points), "")


def near(neighbours: Sequence[Point], wanted: float) -> Point | None:
    """Return the orbit at ω from one or two known ones, along the line through them in ln ω."""
    frame = _at(neighbours[-1].frame, wanted)
    cycle = frame.period()
    assert cycle is not None
    rates = np.concatenate([point.exponents.real for point in neighbours])
    count = _segments(*cycle, rates)
    nodes = [_divided(point, count) for point in neighbours]
    if len(nodes) == 1:
        return _point(wanted, frame, cycle[0], nodes[0])
    first, second = (math.log(point.frequency) for point in neighbours)
    fraction = (math.log(wanted) - first) / (second - first)
    return _point(wanted, frame, cycle[0], nodes[0] + fraction * (nodes[1] - nodes[0]))


def _at(frame: Frame, wanted: float) -> Frame:
    loop = frame.loop.replace(changes(frame.loop, wanted))
    numbers = loop.values.tolist()
    return replace(frame, loop=loop, values=[*numbers, *frame.values[len(numbers) :]])


def _point(wanted: float, frame: Frame, length: float, nodes: Vector) -> Point | None:
    orbit = shooting.close(frame.system, frame.values, length, nodes)
    return Point(wanted, frame, orbit) if orbit.converged else None


def _segments(length: float, cycles: int, rates: Vector) -> int:
    """Return how many segments: one for each cycle, times a power of two."""
    fastest = float(np.abs(rates[np.isfinite(rates)]).max(initial=0.0))
    wanted = min(max(length * fastest / (RATE * cycles), 1.0), MAX_PARTS)
    return cycles * 2 ** math.ceil(math.log2(wanted) - 1e-9)


def _divided(point: Point, count: int) -> Vector:
    """Return the orbit's nodes for another number of segments, a power of two times its own."""
    orbit, frame = point.orbit, point.frame
    have = len(orbit.nodes)
    if count <= have:
        return orbit.nodes[:: have // count]
    return shooting.sampled(frame.system, frame.values, orbit, count // have)[1]


def _ended(points: list[Point]) -> Branch:
    last = points[-1]
    found = last.exponents
    real = np.abs(found.real[np.abs(found.imag) <= 1e-9 * np.abs(found.real)])
    folded = bool(len(real)) and float(real.min()) < FOLDED * float(np.abs(found.real).max())
    why = "a fold: it meets another orbit" if folded else "as far as Newton's method finds it"
    return Branch(
        tuple(points), f"the branch ends at ω = {last.frequency:.7g} rad/s, {why}", folded
    )
