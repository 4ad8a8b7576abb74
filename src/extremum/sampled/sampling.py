"""What makes a loop a sampled one: the time between samples, sensor, actuator and practice."""

from __future__ import annotations

from collections.abc import Container
from typing import Final

from ..description import Description, part, value
from ..errors import InvalidDescription, shown
from .actuators import Actuator
from .delays import LONGEST, whole
from .practice import Practice
from .sensors import Sensor

LARGEST_SEED: Final = 2**53


class Sampling(Description):
    """How a controller is run: how often, with which sensor and actuator, and with what practice.

    Parameters
    ----------
    dt
        The time between two samples (s).
    sensor
        `Sensor`, between the field and the controller.
    actuator
        `Actuator`, between the controller and the vehicle.
    practice
        `Practice`: what the controller does about them.
    seed
        Whole number ≥ 0 that all random numbers depend on.
    """

    dt: float = value("dt", "s", "time between two samples", positive=True)
    sensor: Sensor = part(Sensor, "between field and controller", default=Sensor())
    actuator: Actuator = part(Actuator, "between controller and vehicle", default=Actuator())
    practice: Practice = part(
        Practice, "what the controller does about samples and limits", default=Practice()
    )
    seed: float = value("seed", "", "what all random numbers depend on, whole", default=0.0)

    def check(self) -> None:
        """Refuse a seed that is none, and delays of too many samples."""
        if self.seed != int(self.seed) or not 0 <= self.seed <= LARGEST_SEED:
            raise InvalidDescription(
                "seed", f"must be a whole number from 0 to {LARGEST_SEED}", shown(self.seed)
            )
        for name, delay in (("sensor", self.sensor.delay), ("actuator", self.actuator.delay)):
            if delay is not None and whole(delay, self.dt) > LONGEST:
                raise InvalidDescription(
                    f"{name}.delay",
                    f"is {whole(delay, self.dt):,} samples of {self.dt!r} s, each of which is a "
                    f"state; at most {LONGEST} can be: dt of {delay / LONGEST:.3g} s or more",
                    repr(delay),
                )

    @property
    def counts(self) -> tuple[int, int]:
        """The whole samples in the delays of sensor and actuator, which are states."""
        return whole(self.sensor.delay, self.dt), whole(self.actuator.delay, self.dt)

    def counting(self, varied: Container[str]) -> tuple[bool, bool]:
        """Return whether those depend on the numbers at the `varied` paths."""
        return tuple(  # pyright: ignore[reportReturnType]
            delay is not None and ("sampling.dt" in varied or f"sampling.{name}.delay" in varied)
            for name, delay in (("sensor", self.sensor.delay), ("actuator", self.actuator.delay))
        )
