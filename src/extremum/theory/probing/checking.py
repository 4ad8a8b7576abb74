"""`check_frequencies`: which dithers collide, what that does, and what avoids it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ...controllers import Controller
from ...errors import InvalidDescription
from ...loop import Loop
from ...symbols import axis_names
from ..averaging import average
from ..collisions import SMOOTH, field_degree
from ..periods import MAX_CYCLES, common
from .dithers import (
    at_least_0,
    dithers_of_controller,
    dithers_of_loop,
    dithers_of_numbers,
)
from .mixing import Collision, mixing, sharing


@dataclass(frozen=True)
class FrequencyCheck:
    """What is known of a set of dither frequencies; made by `check_frequencies`.

    Attributes
    ----------
    frequencies
        ω_i (rad/s), one per dither.
    ratios
        ω_i over the slowest.
    degree, bandwidth
        Of the field, and of the loop (rad/s).
    collisions
        Those with Σ|n_k| ≤ degree + 1, harmless ones included.
    """

    frequencies: tuple[float, ...]
    ratios: tuple[Fraction, ...]
    degree: int
    bandwidth: float
    collisions: tuple[Collision, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing collides but harmlessly."""
        return all(c.harmless for c in self.collisions)

    @property
    def cycles(self) -> int | None:
        """Cycles of the slowest dither after which all repeat; None beyond 20,000."""
        count = 1 / common(self.ratios)
        return int(count) if count <= MAX_CYCLES else None

    @property
    def period(self) -> float | None:
        """The common period (s); None if there is none within 20,000 cycles."""
        if self.cycles is None:
            return None
        return self.cycles * 2 * math.pi / min(self.frequencies)

    @property
    def half_wave(self) -> bool:
        """Whether every frequency is an odd multiple of one.

        Half a period later every dither is then its own negative. On a map that is even about a
        source at rest, J(x* + p̃) = J(x* − p̃), an orbit whose mean is on the source as ω → ∞
        has it there at every ω.
        """
        unit = common(self.ratios)
        return self.cycles is not None and all((r / unit) % 2 == 1 for r in self.ratios)

    def text(self) -> str:
        """Return the frequencies, when they repeat, and every collision in a sentence."""
        names = axis_names(len(self.ratios))
        listed = ", ".join(
            f"ω_{name} = {f:.6g}" for name, f in zip(names, self.frequencies, strict=True)
        )
        if self.cycles is None:
            repeats = "which never repeat together"
        else:
            ratios = " : ".join(str(int(r * self.cycles)) for r in self.ratios)
            count = f"{self.cycles} cycle{'s' if self.cycles > 1 else ''}"
            repeats = f"{ratios}, which repeat after {count} of the slowest ({self.period:.4g} s)"
        lines = [f"{listed} rad/s: {repeats}."]
        lines += [f"{'✓' if c.harmless else '✗'} {c}." for c in self.collisions]
        if not self.collisions:
            lines.append(
                f"No combination Σ n_k ω_k with Σ|n_k| ≤ {self.degree + 1} collides: right for "
                f"fields up to degree {self.degree}."
            )
        if self.ok and self.half_wave and len(set(self.ratios)) > 1:
            lines.append(
                "All are odd multiples of one frequency: on a map that is even about the source, "
                "what rests on it as ω → ∞ rests on it at every ω."
            )
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.text()


def check_frequencies(
    frequencies: Loop | Controller | Sequence[Any],
    *,
    phases: Sequence[float] | None = None,
    degree: int | None = None,
    bandwidth: float | None = None,
) -> FrequencyCheck:
    """Return every collision Σ n_k ω_k = 0 and every near-collision, each explained.

    Looked at are Σ|n_k| ≤ degree + 1; a near-collision is within ten loop bandwidths, and within a
    quarter of the slowest frequency. Two dithers at one frequency are harmless in quadrature.

    Parameters
    ----------
    frequencies
        A loop, or its controller, or ω_i (rad/s) as numbers, such as ``(30, 45, 75)``. Ratios do as
        well: everything is then in units of the frequency whose ratio is 1.
    phases
        φ_i of the dithers α_i sin(ω_i t + φ_i) (rad), the references in phase with them; None for
        the worst ones. A loop and a controller have their own.
    degree
        The field's degree as a polynomial of position, at least 2. None for the loop's own field (3
        where it is no polynomial), and for 2 where there is no loop.
    bandwidth
        Of the loop (rad/s). None for a loop's fastest averaged mode, and for 0 where there is none.

    Raises
    ------
    InvalidDescription
        For what is no frequency, phases that do not fit, a degree below 2 or too high to look
        through, a controller that does not demodulate.
    """
    if isinstance(frequencies, Loop | Controller) and phases is not None:
        raise InvalidDescription(
            "phases", "are the controller's own; give its frequencies as numbers to try others"
        )
    if isinstance(frequencies, Loop):
        model = average(frequencies)
        dithers = dithers_of_loop(model.frame)
        own = model.averaged.degree
        degree = max(SMOOTH if own is None else own, 2) if degree is None else degree
        fastest = float(np.abs(model.eigenvalues).max(initial=0.0))
        bandwidth = fastest if bandwidth is None else bandwidth
    elif isinstance(frequencies, Controller):
        dithers = dithers_of_controller(frequencies)
    else:
        dithers = dithers_of_numbers(frequencies, phases)
    order = field_degree(2 if degree is None else degree, len(dithers.shared))
    speed = at_least_0("bandwidth", 0.0 if bandwidth is None else bandwidth)
    found = (*sharing(dithers, order, speed), *mixing(dithers, order, speed))
    return FrequencyCheck(dithers.rates, dithers.ratios, order, speed, found)
