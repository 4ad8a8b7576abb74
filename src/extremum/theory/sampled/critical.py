"""The largest delay, the slowest sampling at which the averaged sampled loop is stable."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from ...errors import InvalidDescription, shown
from ...loop import Loop
from ...sampled.controlling import FEWEST
from ...sampled.practice import Practice
from ...validation import positive
from ..frame import Frame, relative
from .asked import asked
from .gain import gain_of
from .received import Timing, frequencies, not_negative

STEPS: Final = 32
"""How many parts the interval is divided into at first."""

TURN: Final = 12
"""And how many each turn of the dither's phase, where the references do not follow it."""

CLOSEST: Final = 1e-6
"""Crossings nearer to each other than this part of the interval are not told apart."""

BENT: Final = 0.25
PRECISION: Final = 1e-10
SPAN: Final = 50
"""The slowest admissible dt over the fastest that `critical_dt` looks at by default."""


class SampledCrossing(NamedTuple):
    """Where the averaged sampled loop gains or loses stability.

    Attributes
    ----------
    value
        The delay or dt (s).
    mode
        ln(z)/dt of the mode whose |z| goes through 1 there, imaginary part in [0, π/dt] (1/s).
    kind
        ``"complex pair"``, ``"real, +1"`` or ``"real, -1"``: where on the unit circle.
    stable_below, stable_above
        Whether the loop is stable at a slightly smaller, a slightly larger value.
    """

    value: float
    mode: complex
    kind: str
    stable_below: bool
    stable_above: bool

    def __str__(self) -> str:
        side = "below" if self.stable_below else "above" if self.stable_above else "on neither side"
        turning = f" at {self.mode.imag:.5g} rad/s" if self.kind == "complex pair" else ""
        return f"{self.value:.7g} s: {self.kind}{turning}; stable {side}"


@dataclass(frozen=True, eq=False)
class StabilityLimit:
    """The stability of the averaged sampled loop along an interval.

    Made by `critical_delay` and `critical_dt`.

    Attributes
    ----------
    quantity
        ``"delay"`` or ``"dt"``.
    low, high
        The interval looked at (s).
    crossings
        Every crossing found, rising; possibly none.
    stable
        Intervals in which the loop is stable, (low, high) each, rising.
    values, leading
        Where modes were computed, rising, and the largest real part of ln(z)/dt there (1/s).
    notes
        What was taken for granted, in sentences.
    """

    quantity: str
    low: float
    high: float
    crossings: tuple[SampledCrossing, ...]
    stable: tuple[tuple[float, float], ...]
    values: tuple[float, ...]
    leading: tuple[float, ...]
    notes: tuple[str, ...]

    @property
    def largest(self) -> float:
        """The value (s) up to which the loop is stable from `low` on; NaN if not even there.

        It is `high` where there is no crossing: the limit lies beyond.
        """
        if not self.stable or self.stable[0][0] != self.low:
            return math.nan
        return self.stable[0][1]

    def text(self) -> str:
        """Return crossings and stable intervals as text."""
        name = self.quantity
        lines = [f"{name} = {crossing}" for crossing in self.crossings]
        if not lines:
            lines.append(f"no crossing for {self.low:.7g} ≤ {name} ≤ {self.high:.7g} s")
        lines += [f"stable for {low:.7g} ≤ {name} ≤ {high:.7g} s" for low, high in self.stable]
        if not self.stable:
            lines.append("stable nowhere in the interval")
        elif self.quantity == "dt" and self.low < self.largest < self.high:
            lines.append(f"slowest sampling rate {1 / self.largest:.7g} 1/s")
        return "\n".join([*lines, *(f"Note: {note}." for note in self.notes)])

    __str__ = __repr__ = text


class _Point(NamedTuple):
    value: float
    leading: float
    mode: complex


def critical_delay(
    loop: Loop,
    dt: float | None = None,
    low: float = 0.0,
    high: float | None = None,
    *,
    lag: float | None = None,
    practice: Practice | None = None,
    known: bool = False,
) -> StabilityLimit:
    """Return every delay at which the averaged sampled loop gains or loses stability.

    max |z_i(T)| = 1, z_i the eigenvalues of `sampled_loop_gain` with T = `delay`: what a delay does
    to the demodulation's phase, −ω T, and what it does in the slow loop, e^(−sT), both. Where the
    references do not account for it the first is what counts, and stability comes back after every
    period of the dither until the second ends it.

    Parameters
    ----------
    loop
        A `Loop`, or a `SampledLoop`; `low` … `high` takes the place of the delays it has.
    dt
        Time between two samples (s).
    low, high
        The interval (s). Left out, `high` is a period of the slowest dither, or, if the references
        account for every delay, twice the slow loop's delay margin.
    lag, practice
        As in `sampled_loop_gain`.
    known
        Whether the references account for each delay, whatever ``practice.delay`` is.

    Raises
    ------
    InvalidDescription
        If the interval is none; where `sampled_loop_gain` refuses.
    """
    low = not_negative("low", low)
    high = None if high is None else _above(high, low)
    given = asked(loop, dt, None, lag, practice)

    def timing(delay: float) -> Timing:
        return given.timing(delay=delay, known=known)

    timing(low)
    frame = relative(given.loop)
    if high is None:
        late = gain_of(frame, timing(low)).margins.delay if known else 0.0
        period = 2 * math.pi / min(frequencies(frame))
        high = low + max(2 * late if math.isfinite(late) else 0.0, period)
    turns = 0.0 if known else (high - low) * max(frequencies(frame)) / (2 * math.pi)
    return _limit("delay", frame, timing, np.linspace(low, high, STEPS + int(TURN * turns) + 1))


def critical_dt(
    loop: Loop,
    low: float | None = None,
    high: float | None = None,
    *,
    delay: float | None = None,
    samples: float = 0.0,
    lag: float | None = None,
    practice: Practice | None = None,
    known: bool = False,
) -> StabilityLimit:
    """Return every dt at which the averaged sampled loop gains or loses stability.

    As `critical_delay`, along the time between samples: 1/dt is the sampling rate. The hold delays
    by dt/2, and a computation or a sensor is often late by whole samples; where the references
    account for neither that turns the demodulation by ω (dt/2 + T).

    Parameters
    ----------
    loop
        A `Loop`, or a `SampledLoop`; `low` … `high` takes the place of the dt it has.
    low, high
        The interval (s). Left out, `high` leaves six samples in a period of the fastest dither, the
        fewest there may be, and `low` is a fiftieth of it.
    delay, samples
        T = delay + samples · dt.
    lag, practice
        As in `sampled_loop_gain`.
    known
        Whether the references account for all of T, whatever ``practice.delay`` is.

    Raises
    ------
    InvalidDescription
        If the interval is none; where `sampled_loop_gain` refuses.
    """
    low = None if low is None else positive("low", low)
    high = None if high is None else _above(high, low or 0.0)
    samples = not_negative("samples", samples)
    given = asked(loop, None, delay, lag, practice)
    frame = relative(given.loop)
    slowest = 2 * math.pi / (FEWEST * max(frequencies(frame)))
    high = slowest if high is None else high
    low = high / SPAN if low is None else low
    high = _above(high, low)

    def timing(dt: float) -> Timing:
        return given.timing(dt=dt, delay=given.delay + samples * dt, known=known)

    return _limit("dt", frame, timing, np.geomspace(low, high, STEPS + 1))


def _above(high: float, low: float) -> float:
    high = positive("high", high)
    if low >= high:
        raise InvalidDescription("high", f"must be greater than low = {low:g}", shown(high))
    return high


def _limit(
    quantity: str, frame: Frame, timing: Callable[[float], Timing], grid: Any
) -> StabilityLimit:
    def at(value: float) -> _Point:
        gain = gain_of(frame, timing(value))
        mode = complex(gain.modes[0])
        return _Point(value, gain.leading, complex(mode.real, abs(mode.imag)))

    first = [at(float(value)) for value in grid]
    room = CLOSEST * (first[-1].value - first[0].value)
    points = [first[0]]
    for a, b in pairwise(first):
        points += [*_between(at, a, b, room), b]
    crossings = tuple(_crossings(at, timing, points))
    edges = [points[0].value, *(c.value for c in crossings), points[-1].value]
    good = [points[0].leading < 0, *(c.stable_above for c in crossings)]
    return StabilityLimit(
        quantity=quantity,
        low=points[0].value,
        high=points[-1].value,
        crossings=crossings,
        stable=tuple(ends for ends, held in zip(pairwise(edges), good, strict=True) if held),
        values=tuple(p.value for p in points),
        leading=tuple(p.leading for p in points),
        notes=frame.notes + timing(points[0].value).notes,
    )


def _between(at: Callable[[float], _Point], a: _Point, b: _Point, room: float) -> Iterator[_Point]:
    """Yield points between two, so close that the height is nearly straight, or far from 0."""
    if b.value - a.value < room:
        return
    middle = at((a.value + b.value) / 2)
    first, centre, last = a.leading, middle.leading, b.leading
    bend = abs(centre - (first + last) / 2)
    crossed = (first < 0) != (last < 0)
    clear = abs(first - last) if crossed else min(abs(first), abs(centre), abs(last))
    if bend > BENT * clear or ((first < 0) == (last < 0) != (centre < 0)):
        yield from _between(at, a, middle, room)
        yield middle
        yield from _between(at, middle, b, room)
    else:
        yield middle


def _crossings(
    at: Callable[[float], _Point], timing: Callable[[float], Timing], points: Sequence[_Point]
) -> Iterator[SampledCrossing]:
    from scipy.optimize import brentq

    for a, b in pairwise(points):
        if (a.leading < 0) == (b.leading < 0):
            continue
        root: Any = brentq(
            lambda value: at(value).leading, a.value, b.value, xtol=PRECISION * b.value
        )
        mode = at(root).mode
        angle = mode.imag * timing(root).dt
        kind = "real, -1" if math.isclose(angle, math.pi) else "complex pair"
        kind = "real, +1" if mode.imag == 0 else kind
        yield SampledCrossing(root, mode, kind, a.leading < 0, b.leading < 0)
