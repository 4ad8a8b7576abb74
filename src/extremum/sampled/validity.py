"""Which samples are believed, and what happens while none is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import sympy
from sympy import Expr, Symbol

from ..declarations import is_none
from ..description import Description, value
from ..errors import InvalidDescription
from ..logic import absolute, clamped, maximum, minimum, positive
from ..symbols import plain
from .diagram import SampledDiagram

HUGE: Final = 1e18
"""No sample is larger: its square is still a number in single precision."""

LONG: Final = 2.0**24
"""Counts of samples end here: below, they are exact in single precision."""

NEVER: Final = 2 * LONG
"""The age of a sample that there has never been."""


def check_count(name: str, time: float | None, dt: float) -> None:
    """Refuse a time of so many samples that counting them ends before."""
    if time is not None and time / dt >= LONG / 2:
        raise InvalidDescription(
            name,
            f"is {time / dt:.3g} samples; at most {LONG / 2:.0f} are counted, "
            f"{LONG / 2 * dt:.4g} s",
            repr(time),
        )


class Validity(Description):
    """When a sample counts, and for how long the controller goes on without one.

    A sample is missing if it is NaN, infinite, beyond ±10¹⁸, outside `low` … `high`, or if it has
    not changed at all for `stuck`. The last good one is held then and the dither goes on: ξ decays
    as e^(−ht), and so does what is fed back. With a `timeout`, the output u goes over to the safe
    one, safe + λ (u − safe), λ falling to 0 within `fade` when no sample was good for `timeout`,
    and rising to 1 within `fade` when there is one again. The first good sample after a timeout
    starts the washout anew, ξ going on from where it is, so that the output has no jump. Before the
    first good sample of all the output is the safe one.

    While samples are missing the loop is open: it is as stable as the vehicle is by itself. Single
    ones that are missing now and then make the samples older, by their mean age, and cost hardly
    any loop gain. After 2²³ missing samples the washout starts anew in any case.

    Parameters
    ----------
    low, high
        The range of believable samples (unit of J); None for no such bound.
    stuck
        Time (s) after which a sample that repeats exactly is missing; None: never. For sensors
        whose noise or resolution never lets a good sample repeat for so long: a coarse one repeats
        near the peak, where J changes little, and with a `timeout` a vehicle that is then stopped
        waits for ever.
    timeout
        Time (s) without a good sample before the output fades; None: never.
    fade
        Time (s) in which it does.
    safe
        The output then, one number per input; None for zeros.
    """

    low: float | None = value("J_low", "1", "smallest sample", default=None, literal=is_none)
    high: float | None = value("J_high", "1", "largest sample", default=None, literal=is_none)
    stuck: float | None = value(
        "T_stuck", "s", "time of repeats", default=None, positive=True, literal=is_none
    )
    timeout: float | None = value(
        "T_out", "s", "time without a sample", default=None, positive=True, literal=is_none
    )
    fade: float = value("T_fade", "s", "time to fade", default=1.0, positive=True)
    safe: tuple[float, ...] | None = value(
        "safe", "{input}", "the safe output", default=None, shape="vector", literal=is_none
    )

    def check(self) -> None:
        """Refuse a range that holds nothing."""
        low = -HUGE if self.low is None else self.low
        high = HUGE if self.high is None else self.high
        if low >= min(high, HUGE):
            bound = "high" if self.high is not None and self.high <= HUGE else "all samples"
            raise InvalidDescription(
                "low", f"must be less than {bound} = {min(high, HUGE)!r}", repr(low)
            )

    def check_times(self, dt: float) -> None:
        """Refuse times of more samples than are counted."""
        for name in ("stuck", "timeout"):
            check_count(name, getattr(self, name), dt)

    def safes(self, inputs: int) -> tuple[Any, ...]:
        """Return the safe output of every input."""
        return self.safe if self.safe is not None else (sympy.Float(0.0),) * inputs

    def draw(self, diagram: SampledDiagram, sample: Expr, scaled: Expr) -> Guarded:
        """Draw the choice of samples.

        Parameters
        ----------
        sample, scaled
            The sample as it came, which may be no number, and after its scale, which is one.
        """
        last = diagram.state("J_last", "1", 0)
        age = diagram.state("age", "1", NEVER)
        good: Any = sympy.Integer(1)
        if self.high is not None:
            good = positive(sample - plain(self.high), 0, good)
        if self.low is not None:
            good = positive(plain(self.low) - sample, 0, good)
        good = positive(HUGE - absolute(sample), good, 0)
        if self.stuck is not None:
            same = diagram.state("same", "1", 0)
            more = minimum(same + 1, LONG)
            before = last
            if scaled != sample:  # a scale may make different samples equal
                before = diagram.state("J_raw", "1", 0)
                diagram.follow(before, positive(good, sample, before))
            repeats = diagram.signal(
                "repeats", positive(good, positive(absolute(sample - before), 0, more), more), "1"
            )
            diagram.follow(same, repeats)
            limit = plain(self.stuck) / diagram.dt + sympy.Rational(1, 2)
            good = positive(repeats - limit, 0, good)
        good = diagram.signal("good", good, "1")
        held = diagram.signal("J_held", positive(good, scaled, last), "1")
        missed = diagram.signal(
            "missed", positive(good, 0, minimum(age + 1, maximum(age, LONG))), "1"
        )
        patience: Any = sympy.Float(LONG / 2)
        if self.timeout is not None:  # half a sample less: rounding decides nothing
            patience = plain(self.timeout) / diagram.dt - sympy.Rational(1, 2)
        change = diagram.signal("dJ", positive(patience - age, held - last, 0), "1")
        diagram.follow(last, held)
        diagram.follow(age, missed)
        diagram.given |= {last: held, age: positive(good, 0, NEVER)}
        return Guarded(last, age, good, held, change, patience - missed)

    def authority(self, diagram: SampledDiagram, guarded: Guarded) -> Symbol | None:
        """Draw λ, the share of the controller's output that reaches the vehicle."""
        if self.timeout is None:
            return None
        share = diagram.state("authority", "1", 1)
        step = diagram.dt / plain(self.fade)
        moved = clamped(positive(guarded.patience, share + step, share - step), 0, 1)
        begun = positive(NEVER - LONG / 2 - guarded.age, moved, guarded.good)
        now = diagram.signal("lambda", begun, "1")
        diagram.follow(share, now)
        return now


@dataclass(frozen=True)
class Guarded:
    """A signal after the choice of samples.

    Attributes
    ----------
    last, age
        The states: the last sample that counted, and how many samples came after it.
    good
        Positive where the sample counts.
    held
        The sample, or the last one that counted.
    change
        How much it has changed since the last sample; 0 when there was none for long.
    patience
        Positive as long as a good sample is not older than the timeout.
    """

    last: Symbol
    age: Symbol
    good: Symbol
    held: Symbol
    change: Symbol
    patience: Expr

    def begin(self, diagram: SampledDiagram, start: Expr) -> None:
        """Let the signal have been `start` before the first sample."""
        known = start.is_number and abs(float(start)) <= HUGE  # pyright: ignore[reportArgumentType]
        diagram.begin(self.last, start if known else clamped(start, -HUGE, HUGE))
        diagram.begin(self.age, sympy.Integer(0))
