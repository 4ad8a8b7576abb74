"""What is asked about: a loop and when things happen in it, given or read from a `SampledLoop`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidDescription, shown
from ...loop import Loop, checked
from ...sampled.loop import SampledLoop
from ...sampled.practice import Practice
from ...sampled.sampling import Sampling
from ...symbols import s
from ...validation import positive
from .received import Timing, not_negative


@dataclass(frozen=True)
class Asked:
    """A continuous loop, and what is known of its sampling; made by `asked`.

    Attributes
    ----------
    loop
        The continuous loop, a sensor's lag in its F(s).
    dt
        Time between two samples (s); None where nothing says it.
    delay, lag
        T of everything together, and τ of an actuator (s).
    practice
        What the references account for.
    left_out
        Paths of what no linear loop has.
    """

    loop: Loop
    dt: float | None
    delay: float
    lag: float
    practice: Practice
    left_out: tuple[str, ...]

    def timing(
        self, *, dt: float | None = None, delay: float | None = None, known: bool = False
    ) -> Timing:
        """Return when things happen, with another dt or delay, which the references may know."""
        dt = self.dt if dt is None else dt
        if dt is None:
            raise InvalidDescription(
                "dt", "must be given: how often its controller runs only a SampledLoop says itself"
            )
        delay = self.delay if delay is None else delay
        practice = self.practice.replace({"delay": delay}) if known else self.practice
        return Timing(dt, delay, self.lag, practice, self.left_out)


def asked(
    loop: Loop,
    dt: float | None = None,
    delay: float | None = None,
    lag: float | None = None,
    practice: Practice | None = None,
) -> Asked:
    """Return what is asked about; what is None comes from a `SampledLoop`, or is absent.

    Raises
    ------
    InvalidDescription
        For numbers that are none; a scaled signal, a sensor that rises and decays unequally.
    """
    dt = None if dt is None else positive("dt", dt)
    delay = None if delay is None else not_negative("delay", delay)
    lag = None if lag is None else not_negative("lag", lag)
    if practice is not None and not isinstance(practice, Practice):
        raise InvalidDescription("practice", "must be a Practice", shown(practice))
    where, skipped = "practice", ()
    loop = checked(loop, sampled=True)
    if isinstance(loop, SampledLoop):
        sampling: Any = loop.sampling
        dt = sampling.dt if dt is None else dt
        delay = (
            (sampling.sensor.delay or 0.0) + (sampling.actuator.delay or 0.0)
            if delay is None
            else delay
        )
        lag = sampling.actuator.lag if lag is None else lag
        if practice is None:
            where, practice = "sampling.practice", sampling.practice
        loop, skipped = _sensing(loop), _nonlinear(sampling)
    practice = practice or Practice()
    if practice.scale is not None:
        raise InvalidDescription(
            f"{where}.scale",
            "changes the loop's gain with the signal, which no linear loop does; leave it out "
            "and give the channels the gains that it comes to near the source",
            shown(practice.scale),
        )
    own = [f"{where}.{name}" for name in ("limits", "dither") if getattr(practice, name)]
    return Asked(loop, dt, delay or 0.0, lag or 0.0, practice, (*skipped, *own))


def _sensing(loop: SampledLoop) -> Loop:
    """Return the continuous loop, with the sensor's lag in its F(s)."""
    ideal, lag = loop.continuous, loop.sampling.sensor.lag
    if lag is None:
        return ideal
    if lag.decay not in (None, lag.rise):
        raise InvalidDescription(
            "sampling.sensor.lag.decay",
            f"differs from rise = {lag.rise:g} s, which no linear loop does; simulate it, or look "
            "at rise and at decay by itself",
            shown(lag.decay),
        )
    return ideal.replace({"sensor": ideal.sensor.law() / (lag.rise * s + 1)})


def _nonlinear(sampling: Sampling) -> tuple[str, ...]:
    def stated() -> Iterator[str]:
        for part, names in (
            ("sensor", ("low", "high", "step", "dropout")),
            ("actuator", ("low", "high", "rate")),
        ):
            for name in names:
                if getattr(getattr(sampling, part), name) is not None:
                    yield f"sampling.{part}.{name}"

    return tuple(stated())
