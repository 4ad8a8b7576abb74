"""Vehicles: how inputs move the position at which the field is sensed.

A vehicle is one small class: its numbers and its diagram. `PointMass` covers every vehicle whose
axes are independent linear dynamics.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy
from sympy import Expr, Symbol

from .declarations import is_none
from .description import Description, part, value
from .diagram import Diagram, Motion
from .errors import InvalidDescription, shown
from .lti import Transfer, realise, transfer
from .rational import ratio, response_parts
from .symbols import axis_names, cosine, sine


@dataclass(frozen=True)
class Body:
    """What a vehicle's diagram hands to the loop: one expression per axis."""

    position: tuple[Expr, ...]
    sensor: tuple[Expr, ...]


class Vehicle(Description, abstract=True):
    """Motion from inputs to position. Subclasses draw it with `compose`."""

    @abstractmethod
    def dimension(self) -> int:
        """Return the number of coordinates."""

    @abstractmethod
    def input_names(self) -> tuple[str, ...]:
        """Return the inputs' names."""

    @abstractmethod
    def input_units(self) -> tuple[str, ...]:
        """Return the inputs' units."""

    @abstractmethod
    def state_names(self) -> tuple[str, ...]:
        """Return the states' names."""

    @abstractmethod
    def dynamics(self) -> tuple[Expr | None, ...]:
        """Return each input's transfer function to its position, None if it has none."""

    @abstractmethod
    def compose(self, diagram: Diagram, inputs: Sequence[Symbol], initial: Sequence[Expr]) -> Body:
        """Draw the vehicle: its states with the given initial values, driven by `inputs`."""

    @abstractmethod
    def rest(self, position: Sequence[Expr]) -> tuple[Expr, ...]:
        """Return the state at rest at `position`."""

    @abstractmethod
    def swing(self, axis: int, motion: Motion, time: Expr) -> tuple[Expr, ...]:
        """Return the axis' steady state at `time` under its probe."""


class PointMass(Vehicle):
    """A point whose axes are independent: X_i(s) = G_i(s) (U_i(s) + d_i/s).

    Parameters
    ----------
    axes
        One strictly proper rational transfer function per axis: ``1/s`` (velocity-actuated),
        ``1/s**2`` (force-actuated, unit mass), ``1/(s - 0.5)``, ``1/(s*(s + 0.7))`` (drag), …
    disturbance
        A constant force d_i at each axis' input (unit of the input); None for no such term.

    Notes
    -----
    States, per axis: with a constant numerator the position and its derivatives (x, v_x, a_x, …),
    otherwise observer form with the position first (x, x_2, x_3, …). A vehicle that starts at a
    position starts at rest there.

    Source: Zhang, Siranosian and Krstić (2007), equation (1), Figs. 1, 2 and 3.
    """

    axes: tuple[Transfer, ...] = part(
        Transfer, "G(s), strictly proper", per_axis=True, converter=lambda given: _transfers(given)
    )
    disturbance: tuple[float, ...] | None = value(
        "d",
        "{input}",
        "d, a constant force at each input",
        default=None,
        shape="vector",
        literal=is_none,
    )

    def check(self) -> None:
        """Refuse direct feed-through, and a disturbance of the wrong size."""
        for index, axis in enumerate(self.axes):
            if axis.relative_degree() < 1:
                raise InvalidDescription(
                    f"axes.{index}",
                    "feeds its input straight through to the position, so that J would depend on "
                    "itself at once; its denominator must have a higher degree than its numerator",
                    str(axis),
                )
        if self.disturbance is not None and len(self.disturbance) != len(self.axes):
            raise InvalidDescription(
                "disturbance",
                f"has {len(self.disturbance)} entries for {len(self.axes)} axes; give one per axis",
                shown(self.disturbance),
            )

    def dimension(self) -> int:
        """Return the number of axes."""
        return len(self.axes)

    def dynamics(self) -> tuple[Expr | None, ...]:
        """Return G(s) per axis."""
        return tuple(axis.law() for axis in self.axes)

    def input_names(self) -> tuple[str, ...]:
        """Return v_x for a first-order axis, as in the paper's Figs. 1 and 3, otherwise u_x."""
        return tuple(
            f"{'v' if axis.form.order == 1 else 'u'}_{name}"
            for axis, name in zip(self.axes, axis_names(len(self.axes)), strict=True)
        )

    def input_units(self) -> tuple[str, ...]:
        """Return m/s to the power of each axis' relative degree."""
        degrees = (axis.relative_degree() for axis in self.axes)
        return tuple("m/s" if degree == 1 else f"m/s^{degree}" for degree in degrees)

    def state_names(self) -> tuple[str, ...]:
        """Return every axis' states' names, axis after axis."""
        return tuple(name for names in self._states() for name in names)

    def _states(self) -> list[list[str]]:
        states = []
        for axis, name in zip(self.axes, axis_names(len(self.axes)), strict=True):
            order = axis.form.order
            if axis.form.numerator_degree == 0:
                names = [name, f"v_{name}", f"a_{name}"][:order]
                states.append(names + [f"{name}_d{i}" for i in range(3, order)])
            else:
                states.append([name, *(f"{name}_{i}" for i in range(2, order + 1))])
        return states

    def compose(self, diagram: Diagram, inputs: Sequence[Symbol], initial: Sequence[Expr]) -> Body:
        """Draw every axis as a filter driven by its input plus the disturbance."""
        pending = list(initial)
        position = []
        for index, (axis, names) in enumerate(zip(self.axes, self._states(), strict=True)):
            force = self.disturbance[index] if self.disturbance is not None else sympy.Integer(0)
            values, pending = pending[: len(names)], pending[len(names) :]
            position.append(diagram.filter(axis.law(), inputs[index] + force, names, "m", values))
        return Body(tuple(position), tuple(position))

    def rest(self, position: Sequence[Expr]) -> tuple[Expr, ...]:
        """Return the states at which, without input, every derivative of the position is zero."""
        states: list[Expr] = []
        for axis, x in zip(self.axes, position, strict=True):
            states += [x * unit for unit in self._realised(axis).rest]
        return tuple(states)

    def swing(self, axis: int, motion: Motion, time: Expr) -> tuple[Expr, ...]:
        """Return Im[X_k(jω)/G(jω) · α e^{j(ωt + φ)}] for each state k of the axis."""
        amplitude, frequency, phase, through = motion
        law = self.axes[axis].law() if through is None else through
        angle = frequency * time
        states = []
        for response in self._realised(self.axes[axis]).response:
            real, imaginary = response_parts(response / law, frequency)
            turned = real * sine(angle, phase) + imaginary * cosine(angle, phase)
            states.append(amplitude * turned)
        return tuple(states)

    @staticmethod
    def _realised(axis: Transfer) -> Any:
        law = axis.law()
        states = tuple(sympy.Dummy() for _ in range(ratio(law).order))
        return realise(law, sympy.Integer(0), states)


def _transfers(given: Any) -> Any:
    if isinstance(given, str | Mapping | Transfer) or not hasattr(given, "__iter__"):
        raise InvalidDescription(
            "", "must be a tuple with one transfer function per axis", shown(given)
        )
    axes = []
    for index, axis in enumerate(given):
        try:
            axes.append(transfer(axis))
        except InvalidDescription as error:
            raise error.within(str(index)) from None
    return tuple(axes)
