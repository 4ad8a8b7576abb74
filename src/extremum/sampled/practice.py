"""What a controller needs in practice, beside its own law."""

from __future__ import annotations

from collections.abc import Callable

from ..declarations import is_none
from ..description import Description, part, value
from ..errors import InvalidDescription
from .adapting import Changes, Detector, ShrinkingDither
from .limits import Limits
from .scaling import RunningScale, Scale
from .validity import Validity, check_count


class Practice(Description):
    """What is added to a controller when it runs on samples; each part is optional.

    With a `delay`, 0 at least, the references lag by what the samples are late, so that near the
    source the demodulation has no phase error: sin(ωt + ψ − ω (dt/2 + delay) − atan(ω lag)), dt/2
    the hold's own delay. A phase error δ left over turns a quadrature pair's gain to c e^(±jδ).
    Without it they are those of the continuous controller. Far from the source, where ξ is large,
    ξ sin ωt drives the vehicle more than the gradient does, and lagging makes that worse: the
    paper's Fig. 4, which starts at the brim, escapes with it at dt = 4 ms and does not without.

    Parameters
    ----------
    delay
        Delay (s) of sensor, computation and actuator together, beside the hold's dt/2; None leaves
        the references as they are.
    lag
        Time constant (s) of a first-order sensor or actuator; None for none.
    validity
        `Validity`: which samples count, and what happens without.
    limits
        `Limits` of the inputs.
    scale
        `LogScale` or `RunningScale`.
    dither
        `ShrinkingDither`.
    detector
        `Detector`.
    changes
        `Changes`: gains and amplitudes that can be changed while it runs.
    """

    delay: float | None = value(
        "T_d", "s", "delay that the references account for", default=None, literal=is_none
    )
    lag: float | None = value(
        "tau_d",
        "s",
        "lag that the references account for",
        default=None,
        positive=True,
        literal=is_none,
    )
    validity: Validity = part(Validity, "which samples count", default=Validity())
    limits: Limits | None = part(Limits, "limits of the inputs", default=None, literal=is_none)
    scale: Scale | None = part(Scale, "the signal's scale", default=None, literal=is_none)
    dither: ShrinkingDither | None = part(
        ShrinkingDither, "a dither that shrinks", default=None, literal=is_none
    )
    detector: Detector | None = part(
        Detector, "whether it has arrived", default=None, literal=is_none
    )
    changes: Changes | None = part(Changes, "changes while it runs", default=None, literal=is_none)

    def check(self) -> None:
        """Refuse a negative delay."""
        if self.delay is not None and self.delay < 0:
            raise InvalidDescription("delay", "must not be negative", repr(self.delay))
        if self.lag is not None and self.delay is None:
            raise InvalidDescription(
                "delay", "must be given with a lag: 0 for the hold's own delay alone", "None"
            )

        if self.dither is not None and isinstance(self.scale, RunningScale):
            raise InvalidDescription(
                "dither",
                "does not go with a RunningScale, whose loop gain grows as the dither shrinks; "
                "leave one of them out, or use a LogScale",
            )

    def check_inputs(self, inputs: int) -> None:
        """Refuse what does not fit a controller of so many inputs."""
        safe, limits = self.validity.safe, self.limits
        if safe is not None and len(safe) != inputs:
            raise InvalidDescription(
                "validity.safe", f"has {len(safe)} entries for {inputs} inputs; give one per input"
            )
        if limits is None:
            return
        _within("limits", lambda: limits.check_inputs(inputs))
        for i, number in enumerate(safe or (0.0,) * inputs):
            if not limits.admits(i, number):
                raise InvalidDescription(
                    "validity.safe", f"input {i} is beyond its limits", repr(number)
                )

    def check_times(self, slowest: float, dt: float) -> None:
        """Refuse times that do not fit the slowest dither's period and dt (s)."""
        _within("validity", lambda: self.validity.check_times(dt))
        if self.detector is not None:
            time = self.detector.time
            _within("detector", lambda: check_count("time", time, dt))
        for name in ("dither", "detector", "changes"):
            item = getattr(self, name)
            if item is not None:
                _within(name, lambda item=item: item.check_frequency(slowest))


def _within(name: str, check: Callable[[], None]) -> None:
    try:
        check()
    except InvalidDescription as error:
        raise error.within(name) from None
