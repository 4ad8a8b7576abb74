"""How a source moves: at rest, at a constant velocity, and swinging at single frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import sympy
from sympy import Expr
from sympy.simplify.fu import TR8

from ..symbols import substituted
from ..symbols import t as time


@dataclass(frozen=True, eq=False)
class Wave:
    """coefficient · sin(frequency t + phase)."""

    coefficient: Expr
    frequency: Expr
    phase: Expr


@dataclass(frozen=True, eq=False)
class Drift:
    """r(t) = place + velocity t + Σ waves, and whether that is all of it.

    Where it is not, the rest is held at its value at t = 0, as a part of `place`.
    """

    place: Expr
    velocity: Expr
    waves: tuple[Wave, ...]
    whole: bool


@lru_cache(maxsize=512)
def drift(r: Expr) -> Drift:
    """Return what one coordinate of a source's path consists of."""
    place, velocity, waves, rest = [], [], [], []
    for term in sympy.Add.make_args(sympy.expand(TR8(sympy.expand(r)))):
        if not term.has(time):
            place.append(term)
        elif not (rate := term / time).has(time):
            velocity.append(rate)
        elif (wave := _wave(term)) is not None:
            waves.append(wave)
        else:
            rest.append(term)
    held = substituted(sympy.Add(*rest), {time: sympy.Integer(0)})
    return Drift(sympy.Add(*place, held), sympy.Add(*velocity), tuple(waves), not rest)


def _wave(term: Expr) -> Wave | None:
    coefficient, call = term.as_independent(time, as_Add=False)
    if not isinstance(call, sympy.sin | sympy.cos):
        return None
    angle = sympy.expand(call.args[0])
    frequency = angle.coeff(time)
    phase = angle - frequency * time
    if phase.has(time):
        return None
    turn = sympy.pi / 2 if isinstance(call, sympy.cos) else sympy.Integer(0)
    return Wave(coefficient, frequency, phase + turn)


def whole(source: Sequence[Expr]) -> bool:
    """Return whether every coordinate is a place, a constant velocity and sines."""
    return all(drift(r).whole for r in source)
