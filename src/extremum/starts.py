"""Where a vehicle is and how it moves at t = 0."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import sympy
from sympy import Expr

from .controllers import Controller
from .description import Description, value
from .vehicles import Vehicle


class Start(Description, abstract=True):
    """The vehicle's state at t = 0."""

    @abstractmethod
    def state(self, vehicle: Vehicle, controller: Controller) -> tuple[Expr, ...]:
        """Return the vehicle's state, in the order of its state names."""


class OnDither(Start):
    """At a position, moving as the steady probe would move it: v(0) = αω cos φ, and so on.

    A force-actuated vehicle that starts at rest drifts away with velocity −αω cos φ until the loop
    catches it; one that starts on the dither does not. The position is exactly the one stated; the
    dither is centred at position − α sin φ.

    Parameters
    ----------
    position
        Coordinates (m).
    """

    position: tuple[float, ...] = value("{axis}_0", "m", "position at t = 0", shape="vector")

    def state(self, vehicle: Vehicle, controller: Controller) -> tuple[Expr, ...]:
        """Return rest at the dither's centre plus the steady response to the probe."""
        centre: list[Expr] = []
        swings: list[Expr] = []
        for axis, x in enumerate(self.position):
            motion = controller.motion(axis)
            assert motion is not None
            swing = vehicle.swing(axis, motion, sympy.Integer(0))
            centre.append(x - swing[0])
            swings += swing
        rest = vehicle.rest(centre)
        return tuple(sympy.expand(r + w) for r, w in zip(rest, swings, strict=True))


class InState(Start):
    """In a full state: ``InState({"x": 1, "v_x": 0.5, "y": 1, "v_y": 0})``.

    Parameters
    ----------
    states
        Every state of the vehicle by name.
    """

    states: Mapping[str, float] = value("", "", "every state of the vehicle", shape="table")

    def state(self, vehicle: Vehicle, controller: Controller) -> tuple[Expr, ...]:
        """Return the states in the vehicle's order."""
        return tuple(self.states[name] for name in vehicle.state_names())  # pyright: ignore[reportReturnType]


def as_start(given: Any) -> Any:
    """Return a mapping of states as `InState`, anything else as it is."""
    if isinstance(given, Start):
        return given
    if isinstance(given, Mapping):
        return InState(given)
    return given


def initial_state(start: Any, vehicle: Vehicle, controller: Controller) -> Sequence[Expr]:
    """Return the vehicle's state at t = 0: at rest at a position, or what a `Start` says."""
    return vehicle.rest(start) if isinstance(start, tuple) else start.state(vehicle, controller)
