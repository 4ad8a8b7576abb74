"""Difference equations: a step takes the states to the next sample, and is exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidDescription
from .program import Ground, Stepped
from .schemes import crossed, inside, larger
from .watch import Watch

NEAR: Final = 1e-6
"""Share of a sampling time by which a duration may miss a whole number, rounding aside."""


@dataclass(frozen=True)
class Difference:
    """x(k + 1) = f(x(k), p, k dt), H = dt.

    A sample stands for the sampling time that follows it: means are sums over the samples, of
    which the last window takes the first by the part of its time that lies in the window. Maxima
    and crossings are looked for at the samples, the one at the end included.
    """

    name: str = "difference equations"
    order: int = 1
    paced: bool = False

    def steps(self, ground: Ground, watch: Watch) -> Stepped:
        """Record one step."""
        tape, system = ground.tape, ground.system
        now = ground.at(tuple(ground.states.values()), tape.constant(0.0))
        states = tuple(now.read(rate) for rate in system.rhs)
        then = ground.at(states, tape.constant(1.0))
        share = inside(ground)
        return Stepped(
            states=states,
            part=None,
            means=tuple(now.read(e) for e in watch.mean),
            last=tuple(tape.multiply(share, now.read(e)) for e in watch.last_mean),
            maxima=tuple(larger(now, then, e) for e in watch.maxima),
            beyond=tuple(crossed(now, then, e) for e in watch.beyond),
        )


def check_number(dtype: str) -> None:
    """Refuse single precision: a random number is made of 53 bits."""
    if dtype != "float64":
        raise InvalidDescription(
            "dtype",
            "must be 'float64' for a sampled loop, whose random numbers have 53 bits",
            repr(dtype),
        )


def check_steps(t_end: float, dt: Any, samples: int) -> None:
    """Refuse durations that are no whole number of steps, between two samples that are kept too.

    Parameters
    ----------
    t_end
        Duration (s).
    dt
        Sampling time (s), a number or an array of them.
    samples
        How many states are kept, those at 0 and `t_end` among them; 0 for none.

    Raises
    ------
    InvalidDescription
        With the first sampling time that does not fit, and the nearest duration that does.
    """
    lengths: NDArray[np.float64] = np.atleast_1d(np.asarray(dt, dtype=float))
    steps = t_end / lengths
    whole = np.maximum(np.rint(steps), 1.0)
    wrong = np.abs(steps - whole) > NEAR + 4 * np.spacing(steps)
    if wrong.any():
        at = int(np.argmax(wrong))
        length, nearest = float(lengths[at]), float(whole[at])
        raise InvalidDescription(
            "t_end",
            f"is {float(steps[at]):.9g} sampling times of {length!r} s; it must be a whole number "
            f"of them, such as {_product(nearest, length)} s",
            repr(t_end),
        )
    parts = max(samples - 1, 1)
    wrong = whole % parts != 0
    if wrong.any():
        at = int(np.argmax(wrong))
        count, length = int(whole[at]), float(lengths[at])
        raise InvalidDescription(
            "samples",
            f"divides {count:,} sampling times of {length!r} s into {parts:,} parts, which are no "
            f"whole numbers of them; choose samples so that samples - 1 divides {count:,}, such as "
            f"{_divisor(count, parts) + 1}",
            repr(samples),
        )


def _product(count: float, length: float) -> str:
    """Return count · length, without the digits that are rounding."""
    return f"{count * length:.12g}"


def _divisor(count: int, most: int) -> int:
    """Return the largest divisor that is not above `most`, or else the smallest above 1."""
    return next(part for part in range(min(most, count), 0, -1) if count % part == 0)
