"""What there is to know of a set of dithers before they meet: frequencies, phases, references."""

from __future__ import annotations

import cmath
import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import sympy

from ...controllers import Controller, Dither, GradientES
from ...errors import InvalidDescription, shown
from ...rational import at_frequency
from ...symbols import axis_names
from ...validation import number, positive
from ..collisions import ROUNDING
from ..demodulation import gradient
from ..frame import Frame
from ..periods import fraction


@dataclass(frozen=True)
class Dithers:
    """Several dithers of position, α_i sin(ω_i t + φ_i), and what demodulates them.

    Attributes
    ----------
    rates, ratios
        ω_i (rad/s), and over the slowest.
    phases
        φ_i (rad); None where they are not known.
    errors
        The references' phases beyond φ_i and what the sensor turns, ψ_i − φ_i − arg F(jω_i) (rad).
    turns
        Errors as small as these vanish as ω → ∞: what the washout turns, atan(h/ω_i) (rad).
    """

    rates: tuple[float, ...]
    ratios: tuple[Fraction, ...]
    phases: tuple[float, ...] | None
    errors: tuple[float, ...]
    turns: tuple[float, ...]

    @cached_property
    def shared(self) -> tuple[tuple[int, ...], ...]:
        """The dithers by frequency, those that share one together, in order."""
        groups: list[list[int]] = []
        for i, rate in enumerate(self.ratios):
            for members in groups:
                if abs(rate - self.ratios[members[0]]) <= ROUNDING:
                    members.append(i)
                    break
            else:
                groups.append([i])
        return tuple(map(tuple, groups))

    @property
    def names(self) -> tuple[str, ...]:
        """The axes' names."""
        return axis_names(len(self.rates))


def dithers_of_numbers(given: Sequence[Any], phases: Sequence[Any] | None) -> Dithers:
    """Return dithers at such frequencies (rad/s), with references in phase.

    Raises
    ------
    InvalidDescription
        For no frequencies, one that is not a number greater than 0, phases that do not fit.
    """
    if not _is_listed(given):
        raise InvalidDescription(
            "frequencies",
            "must be a Loop, a GradientES, or a tuple of frequencies, one per axis",
            shown(given),
        )
    found = [_exact(item, f"frequencies.{i}") for i, item in enumerate(given)]
    turned = None
    if phases is not None:
        if not _is_listed(phases) or len(phases) != len(found):
            raise InvalidDescription(
                "phases", f"must be {len(found)} numbers, one per frequency", shown(phases)
            )
        turned = tuple(_number(item, f"phases.{i}") for i, item in enumerate(phases))
    none = (0.0,) * len(found)
    return Dithers(tuple(map(float, found)), _ratios(found), turned, none, none)


def dithers_of_controller(controller: Controller) -> Dithers:
    """Return its dithers; the phase of a position that a `Probe` moves is not known.

    Raises
    ------
    InvalidDescription
        For a controller that does not demodulate.
    """
    if not isinstance(controller, GradientES):
        kind = type(controller).__name__
        raise InvalidDescription("controller", "does not demodulate: it is no GradientES", kind)
    known = [c.dither.phase for c in controller.channels if isinstance(c.dither, Dither)]
    phases = tuple(known) if len(known) == controller.inputs() else None
    return _of(controller, phases, (0.0,) * controller.inputs())


def dithers_of_loop(frame: Frame) -> Dithers:
    """Return a loop's dithers, as its vehicle makes them and its sensor turns them."""
    equations, controller = frame.equations, gradient(frame.loop)
    by_frequency = {o.frequency: o for o in equations.oscillators}
    phases, turned = [], []
    twins = gradient(frame.loop.twin).frequencies()
    for swing, frequency, rate in zip(
        equations.dither_limit, twins, controller.frequencies(), strict=True
    ):
        o = by_frequency[frequency]
        swing = sympy.expand(swing)
        sine, cosine = frame.numbers((swing.coeff(o.sine), swing.coeff(o.cosine))).tolist()
        phases.append(math.atan2(cosine, sine))
        turned.append(cmath.phase(at_frequency(frame.loop.sensor.law(), rate)))
    return _of(controller, tuple(phases), tuple(turned))


def _of(
    controller: GradientES, phases: tuple[float, ...] | None, turned: tuple[float, ...]
) -> Dithers:
    rates = tuple(float(f) for f in controller.frequencies())
    references = [(c.reference or c.dither).phase for c in controller.channels]
    return Dithers(
        rates,
        _ratios([channel.ratio for channel in controller.channels]),
        phases,
        tuple(r - p - f for r, p, f in zip(references, phases or references, turned, strict=True)),
        tuple(math.atan(controller.washout / rate) for rate in rates),
    )


def _is_listed(given: Any) -> bool:
    listed = isinstance(given, Sequence | np.ndarray) and not isinstance(given, str | bytes)
    return listed and len(given) > 0


def _exact(given: Any, path: str) -> Fraction | float:
    if isinstance(given, numbers.Rational | sympy.Rational) and not isinstance(given, bool):
        positive(path, given)
        return Fraction(int(given.numerator), int(given.denominator))
    return positive(path, given)


def at_least_0(name: str, given: Any) -> float:
    """Return a number ≥ 0; a refusal names the argument."""
    result = _number(given, name)
    if result < 0:
        raise InvalidDescription(name, "must be at least 0", shown(given))
    return result


def _number(given: Any, path: str) -> float:
    try:
        return number(given)
    except InvalidDescription as error:
        raise error.within(path) from None


def _ratios(given: Sequence[Fraction | float]) -> tuple[Fraction, ...]:
    """Return them over the smallest: simple fractions where they are that to rounding."""
    base = min(given)
    return tuple(
        Fraction(x) / base
        if isinstance(x, Fraction) and isinstance(base, Fraction)
        else fraction(float(x) / float(base))
        for x in given
    )
