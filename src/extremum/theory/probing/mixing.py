"""What colliding dithers do, in sentences.

Channel i demodulates J at ω_i. A term of J of degree d in the dithers holds every frequency
Σ d_k ω_k, each d_k with either sign, so that what is demodulated has a mean wherever

    Σ n_k ω_k = 0,   Σ |n_k| ≤ degree + 1,

not all n_k cancelling by themselves. With s = Σ|n_k|, d_i = |n_i| − 1, d_k = |n_k| and
Θ = Σ n_k φ_k, that mean moves an axis that the map does not couple by

    |x̃_i| = f |∂ˢ⁻¹J/∏∂x_k^{d_k}| ∏ α_k^{d_k}/(2ˢ⁻¹ ∏ d_k! |q_i| α_i),

f = |sin Θ| for odd s and |cos Θ| for even s, at every ω. A reference's own error adds to Θ.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import Any, Final

from ...printing import SUPERSCRIPTS
from ..collisions import ROUNDING, felt, relation
from .assignment import apart
from .dithers import Dithers

SILENT: Final = 1e-9
"""Share of a collision's largest effect that is none."""


@dataclass(frozen=True)
class Collision:
    """One combination Σ n_k ω_k that is zero, or slow enough for the loop to feel.

    Attributes
    ----------
    combination
        n_k, one per dither; of dithers that share a frequency the first stands for all, but where
        it is that sharing itself which collides.
    beat
        |Σ n_k ω_k| (rad/s); 0 for a collision.
    harmless
        Whether nothing of it is left as ω → ∞: two dithers in quadrature, or phases at which the
        products average out.
    effect, change
        What it does, told of one of the channels that take part, and the smallest change of one
        frequency that avoids it; no change where it is harmless.
    """

    combination: tuple[int, ...]
    beat: float
    harmless: bool
    effect: str
    change: str

    def __str__(self) -> str:
        told = f"{relation(self.combination, self.beat)}: {self.effect}"
        return f"{told}; {self.change}" if self.change else told


def sharing(dithers: Dithers, degree: int, bandwidth: float) -> Iterator[Collision]:
    """Yield what dithers at one frequency do to each other."""
    for members in dithers.shared:
        first, *others = members
        for place, i in enumerate(others):
            combination = tuple((k == first) - (k == i) for k in range(len(dithers.rates)))
            effect, harmless = _pair(dithers, first, i) if place == 0 else _crowd(members)
            changes = []
            if not harmless:
                changes = [apart(dithers, [(i,)], None, degree, bandwidth)]
                if place == 0:
                    changes.insert(0, "a quarter turn between their phases, 0 and −π/2")
            yield Collision(combination, 0.0, harmless, effect, _avoids(*changes))


def _avoids(*changes: str) -> str:
    told = ", or ".join(filter(None, changes))
    return told and f"{told} avoids it"


def _crowd(members: Sequence[int]) -> tuple[str, bool]:
    return (
        "one frequency carries two axes at most, its sine and its cosine; the demodulation M of "
        f"{len(members)} is singular"
    ), False


def _pair(dithers: Dithers, i: int, j: int) -> tuple[str, bool]:
    """Return what two dithers at one frequency do, and whether that is harmless."""
    if dithers.phases is None:
        return (
            "only a quarter turn between their phases separates them; in phase both channels hear "
            "the same, the demodulation M is singular and one direction is not steered"
        ), False
    phases, errors = dithers.phases, dithers.errors
    own, other, back, across = (
        math.cos(phases[a] + errors[a] - phases[b]) for a, b in ((i, i), (j, j), (j, i), (i, j))
    )
    small = SILENT + math.sin(max(dithers.turns[i], dithers.turns[j]))
    heard = max(abs(across), abs(back))
    if heard <= small:
        return "in quadrature, so that the references separate them", True
    if abs(own * other - across * back) <= small**2:
        return (
            "in phase, so that both channels hear the same: the demodulation M is singular and one "
            "direction is not steered"
        ), False
    return (
        f"not in quadrature, so that each channel hears up to {heard:.3g} of the other's dither, "
        "which couples the axes at every ω"
    ), False


def mixing(dithers: Dithers, degree: int, bandwidth: float) -> Iterator[Collision]:
    """Yield what different frequencies make of each other."""
    shared = dithers.shared
    rates = [dithers.rates[members[0]] for members in shared]
    for n, beat in felt(rates, degree + 1, bandwidth):
        combination = [0] * len(dithers.rates)
        for members, count in zip(shared, n, strict=True):
            combination[members[0]] = count
        if beat <= ROUNDING * min(rates):
            effect, harmless = _mean(dithers, combination, n, degree)
            beat = 0.0
        else:
            effect, harmless = _beat(dithers, combination), False
        change = ""
        if not harmless:
            moving = [members for members, count in zip(shared, n, strict=True) if count]
            change = apart(dithers, moving, n, degree, bandwidth)
        yield Collision(tuple(combination), beat, harmless, effect, _avoids(change))


def _beat(dithers: Dithers, n: Sequence[int]) -> str:
    reason = "within ten bandwidths of the loop, so that"
    if sum(map(abs, n)) == 2:
        return f"{reason} each channel hears the other's dither as a slow swing at that beat"
    i = min((k for k in range(len(n)) if n[k]), key=lambda k: _precedence(n, k))
    told = _derivative(_orders(n, i), dithers.names)
    return f"{reason} {told} drives channel {dithers.names[i]} slowly"


def _mean(
    dithers: Dithers, first: Sequence[int], n: Sequence[int], degree: int
) -> tuple[str, bool]:
    """Return what a collision leaves, and whether that is nothing.

    `first` has the first dither of those that share a frequency, `n` one entry per frequency.
    """
    loud: list[tuple[Any, Sequence[int], int, float | None]] = []
    spread = [first] if dithers.phases is None else list(_spread(dithers, n))
    size = sum(map(abs, first))
    for times in range(1, (degree + 1) // size + 1):
        for once in spread:
            whole = [times * count for count in once]
            for i in (k for k, count in enumerate(whole) if count):
                share = _share(dithers, whole, i)
                if share is None or share > SILENT + math.sin(dithers.turns[i]):
                    order = (times, *_precedence(whole, i), -(share or 0.0))
                    loud.append((order, whole, i, share))
    if not loud:
        return (
            "averages out at these phases and leaves only what vanishes with ω; a phase error δ "
            "brings sin δ of it back"
        ), True
    _, whole, i, share = min(loud, key=lambda entry: entry[0])
    orders, name = _orders(whole, i), dithers.names[i]
    told = _derivative(orders, dithers.names)
    amplitudes = _powers("α_", orders, dithers.names, " ")
    below = 2 ** sum(orders) * math.prod(map(math.factorial, orders))
    part = "up to " if share is None else "" if share > 0.9995 else f"{share:.3g} "
    return (
        f"channel {name} demodulates {told} and rests {part}|{told}| {amplitudes}/"
        f"({below} |q_{name}| α_{name}) beside the source, at every ω"
    ), False


def _spread(dithers: Dithers, n: Sequence[int]) -> Iterator[list[int]]:
    """Yield every n_k per dither that is `n` per frequency."""
    ways = [
        combinations_with_replacement(members, abs(count))
        for members, count in zip(dithers.shared, n, strict=True)
    ]
    for chosen in product(*ways):
        spread = [0] * len(dithers.rates)
        for members, count in zip(chosen, n, strict=True):
            for k in members:
                spread[k] += 1 if count > 0 else -1
        yield spread


def _share(dithers: Dithers, n: Sequence[int], i: int) -> float | None:
    """Return f, the share of its largest effect that channel i hears at these phases."""
    if dithers.phases is None:
        return None
    angle = sum(count * phase for count, phase in zip(n, dithers.phases, strict=True))
    angle += dithers.errors[i] if n[i] > 0 else -dithers.errors[i]
    return abs(math.sin(angle) if sum(map(abs, n)) % 2 else math.cos(angle))


def _precedence(n: Sequence[int], i: int) -> tuple[int, int]:
    """Return what makes channel i the one to speak of: alone on its side, and once."""
    return abs(n[i]), sum(abs(count) for count in n if count * n[i] > 0)


def _orders(n: Sequence[int], i: int) -> list[int]:
    return [abs(count) - (k == i) for k, count in enumerate(n)]


def _powers(letter: str, orders: Sequence[int], names: Sequence[str], between: str) -> str:
    return between.join(
        f"{letter}{name}{'' if order == 1 else str(order).translate(SUPERSCRIPTS)}"
        for order, name in zip(orders, names, strict=True)
        if order
    )


def _derivative(orders: Sequence[int], names: Sequence[str]) -> str:
    return f"∂{str(sum(orders)).translate(SUPERSCRIPTS)}J/{_powers('∂', orders, names, '')}"
