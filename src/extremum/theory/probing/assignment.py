"""`assign_frequencies`: dithers that do not collide, and the nearest frequency that does not."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidDescription, shown
from ...symbols import axis_names
from ...validation import positive
from ..collisions import REACH, combinations, felt, field_degree, reach
from ..periods import MAX_CYCLES, common
from .dithers import Dithers, at_least_0

SHORT: Final = (8, 16, 32, 64)
"""Cycles within which a set with one frequency changed should repeat, tried in turn."""

MOST: Final = 300
"""Cycles of the slowest dither within which an assignment must repeat."""

TRIED: Final = 60
"""Cycles up to which a refusal looks for a limit that would do."""

STEPS: Final = 400
"""Partial sets that are tried for each number of cycles."""

WIDEST: Final = 64.0
"""Highest over lowest frequency up to which sets are looked for."""

OCTAVE: Final = 2.0
"""The usual limit: within an octave no frequency is twice another, nor the sum of two."""

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Assignment:
    """Frequencies and phases of n dithers that do not collide; made by `assign_frequencies`.

    Attributes
    ----------
    ratios
        ω_i over the slowest, one per axis: a channel's ``ratio``.
    phases
        φ_i (rad), one per axis: 0 and −π/2 for two that share a frequency, else 0.
    """

    ratios: tuple[Fraction, ...]
    phases: tuple[float, ...]

    @property
    def cycles(self) -> int:
        """Cycles of the slowest dither after which all repeat."""
        return int(1 / common(self.ratios))

    @property
    def highest(self) -> Fraction:
        """Highest over lowest frequency."""
        return max(self.ratios)

    def __str__(self) -> str:
        rows = [
            f"ω_{name} = {ratio} ω, φ_{name} = {'−π/2' if phase else '0'}"
            for name, ratio, phase in zip(
                axis_names(len(self.ratios)), self.ratios, self.phases, strict=True
            )
        ]
        count = f"{self.cycles} cycle{'s' if self.cycles > 1 else ''}"
        return "\n".join([*rows, f"repeating after {count} of the slowest"])


def assign_frequencies(
    axes: int,
    *,
    quadrature: bool = True,
    degree: int = 2,
    highest: float = OCTAVE,
    bandwidth: float = 0.0,
    half_wave: bool = False,
) -> Assignment:
    """Return ratios and phases for n axes, of which no Σ n_k ω_k with Σ|n_k| ≤ degree + 1 vanishes.

    The ratios are those of small integers: of all sets within the limit those with the shortest
    common period, and of these the one with the least highest frequency. (Without regard to the
    period there is no least: N : N + 1 comes as near to 1 as one likes, and beats as slowly.) Up
    to six frequencies, degree 3 and no bandwidth every set is looked at; beyond that the search is
    cut short, and a shorter period may exist.

    Parameters
    ----------
    axes
        n.
    quadrature
        Whether two axes share a frequency with phases 0 and −π/2, as in the paper: ⌈n/2⌉
        frequencies instead of n.
    degree
        The field's degree as a polynomial of position, at least 2.
    highest
        The bandwidth limit of actuators and sensor: highest frequency over the lowest.
    bandwidth
        Of the loop, over the lowest frequency: every |Σ n_k ω_k| stays above ten times that, or
        above a quarter of the lowest frequency.
    half_wave
        Whether all shall be odd multiples of one frequency. On a map that is even about the source
        the orbit's mean is then on the source at every ω, not only as ω → ∞; the period is up to
        twice as long.

    Raises
    ------
    InvalidDescription
        If no set fits under the limit, with the ratio that would do.
    """
    if not isinstance(axes, numbers.Integral) or isinstance(axes, bool) or axes < 1:
        raise InvalidDescription("axes", "must be an integer greater than 0", shown(axes))
    count = -(-axes // 2) if quadrature else axes
    size = field_degree(degree, count) + 1
    limit, speed = positive("highest", highest), at_least_0("bandwidth", bandwidth)
    found = _shortest(count, size, limit, speed, half_wave)
    if found is None:
        raise InvalidDescription(
            "highest", _refusal(count, size, limit, speed, half_wave), f"{limit:g}"
        )
    places = [i // 2 if quadrature else i for i in range(axes)]
    return Assignment(
        tuple(Fraction(found[k], found[0]) for k in places),
        tuple(-math.pi / 2 if quadrature and i % 2 else 0.0 for i in range(axes)),
    )


def _shortest(
    count: int, size: int, highest: float, bandwidth: float, odd: bool
) -> tuple[int, ...] | None:
    """Return the set of integers with the least smallest, and of these the least largest."""
    for lowest in range(1, MOST + 1, 1 + odd):
        top = math.floor(min(highest, WIDEST) * lowest * (1 + 1e-12))
        found = _within(count, size, lowest, top, bandwidth, odd)
        if found is not None:
            return found
    return None


def _within(
    count: int, size: int, lowest: int, top: int, bandwidth: float, odd: bool
) -> tuple[int, ...] | None:
    """Return the set from `lowest` up to `top` at most with the least largest, if there is one."""
    near = max(1, math.ceil(lowest * reach([1.0], bandwidth) * (1 - 1e-12)))
    step = 1 + odd
    best: tuple[int, ...] | None = None
    steps = 0

    def grow(chosen: tuple[int, ...], candidates: Integers) -> None:
        nonlocal best, steps
        steps += 1
        wanted = count - len(chosen)
        if wanted == 0:
            best = chosen
            return
        for place, f in enumerate(candidates[: len(candidates) - wanted + 1].tolist()):
            if steps > STEPS or (best and f + step * (wanted - 1) >= best[-1]):
                return
            grow((*chosen, f), _allowed((*chosen, f), candidates[place + 1 :], size, near))

    every = np.arange(lowest + step, top + 1, step)
    grow((lowest,), _allowed((lowest,), every, size, near))
    return best


def _allowed(chosen: tuple[int, ...], candidates: Integers, size: int, near: int) -> Integers:
    """Return the candidates that make no combination below `near` with the last one chosen."""
    table = _joining(len(chosen) + 1, size)
    known = table[:, :-1] @ np.array(chosen)
    beats = np.abs(known[:, None] + table[:, -1:] * candidates)
    return candidates[(beats >= near).all(axis=0)]


@lru_cache(maxsize=64)
def _joining(count: int, size: int) -> Integers:
    """Return the combinations in which the last two frequencies both take part."""
    table = combinations(count, size)
    return table[(table[:, -2:] != 0).all(axis=1)]


def _refusal(count: int, size: int, highest: float, bandwidth: float, odd: bool) -> str:
    """Return why no set fits, which limit would do, and which bandwidth."""
    widest, wide = WIDEST, None
    places = range(1, TRIED, 1 + odd) if bandwidth else [MOST - odd]
    for lowest in places:
        found = _within(count, size, lowest, math.ceil(widest * lowest) - 1, bandwidth, odd)
        if found is not None:
            widest, wide = found[-1] / lowest, found
    least = f"at least {reach([1.0], bandwidth):.3g} of the slowest" if bandwidth else "above 0"
    reason = (
        f"is too low for {count} frequencies that repeat within {MOST} cycles of the slowest and "
        f"keep every |Σ n_k ω_k| with Σ|n_k| ≤ {size} {least}: "
    )
    if wide is None:
        reason += f"not even {WIDEST:g} would do"
    else:
        reason += f"{_upwards(wide[-1] / wide[0])} would do ({' : '.join(map(str, wide))})"
    slow = _shortest(count, size, highest if bandwidth else OCTAVE, 0.0, odd)
    if slow is not None and not bandwidth:
        reason += (
            f"; {OCTAVE:g} lets them repeat after {slow[0]} cycles ({' : '.join(map(str, slow))})"
        )
    elif slow is not None:
        beat = float(np.abs(combinations(count, size) @ np.array(slow)).min()) / slow[0]
        speed = -_upwards(-beat / REACH)
        reason += (
            f", or under this limit a loop bandwidth of {speed} of the slowest "
            f"({' : '.join(map(str, slow))})"
        )
    return reason


def _upwards(number: float) -> float:
    """Return a number in four digits, rounded upwards: what it bounds stays within it."""
    unit = 10.0 ** (math.floor(math.log10(abs(number))) - 3)
    return float(f"{math.ceil(number / unit * (1 - 1e-12)) * unit:.4g}")


def apart(
    dithers: Dithers,
    moving: Sequence[tuple[int, ...]],
    avoided: tuple[int, ...] | None,
    degree: int,
    bandwidth: float,
) -> str:
    """Return the nearest change of one frequency after which a combination is not felt any more.

    Of those after which all repeat within a few cycles, and that make no new collision. The slowest
    frequency stays, as it is what the loop's bandwidth is measured against.

    Parameters
    ----------
    moving
        Dithers that may be moved, those that stay together in one tuple.
    avoided
        n_k per frequency; None to part dithers that share one.
    """
    shared = list(dithers.shared)
    ratios = [dithers.ratios[members[0]] for members in shared]
    slowest, size = min(dithers.rates), degree + 1

    def heard(tried: Sequence[Fraction]) -> set[tuple[int, ...]]:
        return {n for n, _ in felt([float(r) * slowest for r in tried], size, bandwidth)}

    known = {(*n, 0)[: len(n) + (avoided is None)] for n in heard(ratios) - {avoided}}
    for limit in SHORT:
        for members, place, ratio in _changes(dithers, shared, moving, limit):
            if heard([*ratios[:place], ratio, *ratios[place + 1 :]]) <= known:
                moved = " = ".join(f"ω_{dithers.names[i]}" for i in members)
                base = dithers.names[dithers.ratios.index(min(dithers.ratios))]
                return f"{moved} = {ratio} ω_{base} ({float(ratio) * slowest:.6g} rad/s)"
    return ""


def _changes(
    dithers: Dithers,
    shared: Sequence[tuple[int, ...]],
    moving: Sequence[tuple[int, ...]],
    limit: int,
) -> list[tuple[tuple[int, ...], int, Fraction]]:
    """Return (dithers, place among the frequencies, new ratio), the smallest change first."""
    found = []
    for members in moving:
        whole = members in shared
        place = list(shared).index(members) if whole else len(shared)
        now = dithers.ratios[members[0]]
        if whole and now == 1:
            continue
        others = [dithers.ratios[m[0]] for k, m in enumerate(shared) if k != place]
        cycles = int(1 / common([Fraction(1), *others]))
        cycles = 1 if cycles > MAX_CYCLES else cycles  # they never repeat anyway
        for below in range(1, limit + 1):
            if math.lcm(below, cycles) > max(limit, cycles):
                continue
            for above in range(
                max(below, math.ceil(now * below / 2)), math.floor(2 * now * below) + 1
            ):
                ratio = Fraction(above, below)
                if ratio.denominator == below and ratio not in (1, now):
                    found.append((abs(math.log(ratio / now)), ratio, members, place))
    return [(members, place, ratio) for _, ratio, members, place in sorted(found)]
