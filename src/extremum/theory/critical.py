"""`critical_frequency`: the ω̄ of the theorems, where the exact loop gains or loses stability."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidDescription, shown
from ..loop import Loop, checked
from ..validation import positive
from . import branch
from .averaging import average
from .branch import Branch, Point
from .floquet import Match, match

Vector = NDArray[np.float64]

STEP: Final = math.log(2) / 4
"""The largest step of the first walk, in ln ω."""

CLOSEST: Final = 1e-6
"""Crossings nearer to each other than this, relative to ω, are not told apart."""

PRECISION: Final = 1e-8
BENT: Final = 0.25
MARGIN: Final = 1e-10


@dataclass(frozen=True)
class Crossing:
    """Where the largest real part of the Floquet exponents goes through 0.

    Attributes
    ----------
    frequency
        ω (rad/s).
    exponent
        The mode that crosses, its imaginary part in [0, π/T] (1/s).
    kind
        ``"Neimark–Sacker"`` (a complex pair: Hopf's bifurcation in the average), ``"real, +1"``,
        ``"period doubling"`` (multiplier −1), or ``"fold"`` (the orbit itself ends).
    stable_above, stable_below
        Whether the orbit is stable at a slightly larger, a slightly smaller ω; below a fold there
        is none.
    """

    frequency: float
    exponent: complex
    kind: str
    stable_above: bool
    stable_below: bool

    def __str__(self) -> str:
        side = "above" if self.stable_above else "below" if self.stable_below else "on neither side"
        turning = f", Im λ = {self.exponent.imag:.5g} rad/s" if self.exponent.imag else ""
        return f"ω = {self.frequency:.7g} rad/s: {self.kind}{turning}; stable {side}"


@dataclass(frozen=True, eq=False)
class Critical:
    """The stability boundary in ω between `low` and `high`; made by `critical_frequency`.

    Attributes
    ----------
    low, high
        The interval asked for (rad/s).
    outcome
        ``"completed"``, or a sentence: why there is no orbit at `high`, or where the branch ends.
    reached
        The lowest ω to which the orbit could be followed (rad/s); `high` if there is none there.
    crossings
        Every crossing found, the highest ω first; possibly none.
    stable
        Intervals of ω in which the orbit is stable, (low, high) each, the highest first.
    agreement
        The averaged eigenvalues beside the exponents at `high`; None without an orbit there.
    frequencies, leading
        Every ω at which the orbit was computed, rising, and its largest real part (1/s).
    notes
        What was replaced, in sentences.
    """

    low: float
    high: float
    outcome: str
    reached: float
    crossings: tuple[Crossing, ...]
    stable: tuple[tuple[float, float], ...]
    agreement: Match | None
    frequencies: Vector
    leading: Vector
    notes: tuple[str, ...]

    def text(self) -> str:
        """Return crossings, stable intervals and what rests on averaging, as text."""
        lines = [str(crossing) for crossing in self.crossings]
        if not lines and self.agreement is not None:
            lines.append(f"no crossing from ω = {self.high:g} down to {self.reached:g} rad/s")
        for low, high in self.stable:
            lines.append(f"stable for {low:.7g} ≤ ω ≤ {high:.7g} rad/s")
        if not self.stable:
            lines.append("stable nowhere in the interval")
        if self.outcome != "completed":
            lines.append(self.outcome)
        return "\n".join([*lines, *self._beyond(), *self.notes])

    __str__ = __repr__ = text

    def _beyond(self) -> Iterator[str]:
        if self.agreement is None:
            return
        largest = float(np.abs(self.agreement.averaged).max())
        signs = {bool(modes.real.max() < 0) for modes in self._modes()}
        yield (
            f"at ω = {self.high:g} rad/s the Floquet exponents are within "
            f"{self.agreement.worst:.3g} 1/s of the averaged eigenvalues, "
            f"{100 * self.agreement.worst / largest:.2g} % of the largest"
        )
        if len(signs) > 1:
            yield "there the average says otherwise and cannot be trusted yet; raise `high`"
        else:
            yield f"beyond ω = {self.high:g} rad/s the claim rests on averaging"

    def _modes(self) -> tuple[Any, Any]:
        assert self.agreement is not None
        return self.agreement.averaged, self.agreement.exponents


def critical_frequency(loop: Loop, low: float, high: float) -> Critical:
    """Return every ω in [low, high] at which the loop's periodic orbit gains or loses stability.

    max_i Re λ_i(ω) = 0, λ_i the Floquet exponents of the orbit, which is followed from `high` to
    `low` with the position's dither kept at α and the source where it is. Where the largest real
    part is bent so that it might touch 0 between two orbits, there are more between them, so that
    close pairs of crossings are found; each is located by Brent's method to 1e-8 of ω.

    Theorems 1 to 3 of Zhang, Siranosian and Krstić (2007) say "for all sufficiently large ω": what
    is found here is how large. It may be none: the loop of Fig. 4 is stable at every ω. With
    ε > 0 it depends on where the source is.

    Parameters
    ----------
    low, high
        The interval of ω, ``controller.frequency`` (rad/s). At `high` the exponents are compared
        with the averaged eigenvalues; beyond it the claim rests on averaging.

    Raises
    ------
    InvalidDescription
        If the interval is none, or the loop is not periodic at every ω (a source that moves, dither
        frequencies without a common period).

    Notes
    -----
    A `Probe`'s amplitude is scaled with 1/|G(jω)|; references keep their phases.
    """
    low, high = positive("low", low), positive("high", high)
    if low >= high:
        raise InvalidDescription("high", f"must be greater than low = {low:g}", shown(high))
    top = checked(loop).replace(branch.changes(loop, high))
    predicted = average(top)
    frame = predicted.frame
    if not branch.rests(frame):
        raise InvalidDescription(
            "field",
            "moves: with another ω the loop has no common period with its path. Ask for "
            "periodic_orbit at single frequencies, or let the source rest",
        )
    cycle = frame.period()
    if cycle is None:
        listed = ", ".join(f"{f:g}" for f in frame.frequencies())
        raise InvalidDescription(
            "controller.channels",
            "have frequencies without a common period, so that there is no periodic orbit; make "
            "each ratio an integer or a Fraction",
            f"{listed} rad/s",
        )
    reached = branch.reached(predicted, cycle)
    if reached.end:
        nothing = np.empty(0)
        outcome = f"no orbit at ω = {high:g} rad/s: {reached.end}"
        return Critical(low, high, outcome, high, (), (), None, nothing, nothing, frame.notes)
    start = reached.points[-1]
    walk = branch.followed(start, low, largest=STEP)
    points = _refined(walk.points)
    crossings = _crossings(points, walk)
    return Critical(
        low=low,
        high=high,
        outcome=walk.end or "completed",
        reached=points[-1].frequency,
        crossings=crossings,
        stable=_intervals(points, crossings),
        agreement=match(predicted.eigenvalues, start.exponents, 2 * math.pi / start.orbit.period),
        frequencies=np.array([p.frequency for p in reversed(points)]),
        leading=np.array([p.leading for p in reversed(points)]),
        notes=frame.notes,
    )


def _height(point: Point) -> float:
    """Return the largest real part, taken as above 0 where it is 0 to rounding."""
    return point.leading + MARGIN * float(np.abs(point.exponents.real).max())


def _refined(points: Sequence[Point]) -> list[Point]:
    """Return the points with others between them wherever a crossing could hide."""
    refined = [points[0]]
    for a, b in pairwise(points):
        refined += [*_between(a, b), b]
    return refined


def _between(a: Point, b: Point) -> list[Point]:
    """Return points between two, so close that the height is nearly straight, or far from 0."""
    if abs(math.log(a.frequency / b.frequency)) < CLOSEST:
        return []
    middle = branch.near((a, b), math.sqrt(a.frequency * b.frequency))
    if middle is None:
        return []
    first, centre, last = (_height(point) for point in (a, middle, b))
    bend = abs(centre - (first + last) / 2)
    crossed = (first < 0) != (last < 0)
    room = abs(first - last) if crossed else min(abs(first), abs(centre), abs(last))
    if (first < 0) == (last < 0) != (centre < 0) or bend > BENT * room:
        return [*_between(a, middle), middle, *_between(middle, b)]
    return [middle]


def _crossings(points: Sequence[Point], walk: Branch) -> tuple[Crossing, ...]:
    found = []
    for a, b in pairwise(points):
        if (_height(a) < 0) != (_height(b) < 0):
            found.append(_located(a, b))
    if walk.folded:
        last = points[-1]
        real = last.exponents[last.exponents.imag == 0]
        exponent = complex(real[np.argmin(np.abs(real.real))])
        found.append(Crossing(last.frequency, exponent, "fold", _height(last) < 0, False))
    return tuple(found)


def _located(above: Point, below: Point) -> Crossing:
    """Return the crossing between two points of different signs."""
    from scipy.optimize import brentq

    bracket = [above, below]

    def height(logarithm: float) -> float:
        ends = [math.log(point.frequency) for point in bracket]
        if logarithm in ends:
            return _height(bracket[ends.index(logarithm)])
        wanted = math.exp(logarithm)
        point = branch.near(bracket, wanted)
        if point is None:  # a multiplier of 1 is near, and with it another orbit: small steps
            point = branch.followed(bracket[0], wanted).points[-1]
        bracket[int((_height(point) < 0) == (_height(below) < 0))] = point
        return _height(point)

    ends = [math.log(point.frequency) for point in bracket]
    root: Any = brentq(height, ends[1], ends[0], xtol=PRECISION)
    point = min(bracket, key=lambda p: abs(_height(p)))
    mode = complex(point.exponents[0])
    mode = complex(mode.real, abs(mode.imag))
    half = math.pi / point.orbit.period
    kind = "real, +1" if mode.imag == 0 else "Neimark–Sacker"
    if math.isclose(mode.imag, half, rel_tol=1e-12):
        kind = "period doubling"
    return Crossing(math.exp(root), mode, kind, _height(above) < 0, _height(below) < 0)


def _intervals(
    points: Sequence[Point], crossings: Sequence[Crossing]
) -> tuple[tuple[float, float], ...]:
    edges = [points[0].frequency, *(c.frequency for c in crossings), points[-1].frequency]
    stable = [_height(points[0]) < 0, *(c.stable_below for c in crossings)]
    return tuple(
        (low, high)
        for (high, low), good in zip(pairwise(edges), stable, strict=True)
        if good and low < high
    )
