"""The loop: a field, a vehicle, a controller and a start, composed into one `System`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Container, Hashable, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from sympy import Expr, Symbol

from .controllers import Controller
from .description import Description, flatten, located, part, value
from .diagram import Diagram
from .errors import InvalidDescription, shown, suggestion
from .fields import Field
from .lti import Transfer, TransferFunction, settled, static_gain, transfer
from .parameters import Parameter, symbolic
from .rational import ratio
from .starts import InState, OnDither, Start, as_start, initial_state
from .symbols import axis_names, coordinates, plain
from .system import System
from .vehicles import Vehicle


class Loop(Description):
    """A vehicle that senses a field and is driven by a controller.

    Parameters
    ----------
    field
        The map J(position, t), unknown to the controller; it is maximised.
    vehicle
        From inputs to position.
    controller
        From J to inputs.
    start
        The vehicle's position at t = 0 (it starts at rest there), or `OnDither`, or a mapping of
        every vehicle state's name to its value.
    sensor
        F(s), proper and stable: what the controller receives is F(s)[J] instead of J, such as
        ``1/(2.96*s + 1)`` of a gas sensor, or a Padé approximation of a delay. It has settled on
        J(0) when the loop starts. The default 1 is no sensor at all.

    Raises
    ------
    InvalidDescription
        Where the parts do not fit each other, with the dotted path and the smallest change.
    """

    root = True
    sampled: ClassVar[bool] = False
    """Whether its controller runs at samples, so that its equations are difference equations."""

    field: Field = part(Field, "the map that is maximised")
    vehicle: Vehicle = part(Vehicle, "from inputs to position")
    controller: Controller = part(Controller, "from J to inputs")
    start: Any = value(
        "{axis}_0",
        "m",
        "position at t = 0, or a Start",
        shape="vector",
        converter=as_start,
        role=Start,
        literal=lambda given: isinstance(given, Start),
    )
    sensor: Transfer = part(
        Transfer,
        "F(s) from J to what is sensed, stable",
        default=TransferFunction(),
        converter=lambda given: transfer(given),
    )

    def check(self) -> None:
        """Refuse parts that do not fit each other."""
        axes = self.vehicle.dimension()
        inputs = len(self.vehicle.input_names())
        if self.controller.inputs() != inputs:
            raise InvalidDescription(
                "controller.channels",
                f"has {self.controller.inputs()} channels, the vehicle has {inputs} inputs; give "
                "one channel per input",
            )
        wanted = self.field.dimension()
        if wanted is not None and wanted != axes:
            raise InvalidDescription(
                "field", f"has {wanted} coordinates, the vehicle moves in {axes}; they must agree"
            )
        self._check_start(axes)
        if wanted is None:
            self._check_field(axes)
        self._check_probes()
        self._check_sensor()

    def _check_start(self, axes: int) -> None:
        if isinstance(self.start, InState):
            given, names = self.start.states, self.vehicle.state_names()
            for name in given:
                if name not in names:
                    hint = suggestion(name, names)
                    raise InvalidDescription(f"start.{name}", f"is no vehicle state; {hint}")
            missing = [name for name in names if name not in given]
            if missing:
                raise InvalidDescription(
                    "start", f"lacks {', '.join(missing)}; a full state names every vehicle state"
                )
            return
        position = self.start if isinstance(self.start, tuple) else self.start.position
        if len(position) != axes:
            raise InvalidDescription(
                "start",
                f"has {len(position)} coordinates, the vehicle moves in {axes}",
                shown(position),
            )
        if isinstance(self.start, OnDither) and any(
            self.controller.motion(axis) is None for axis in range(axes)
        ):
            raise InvalidDescription(
                "start",
                "OnDither needs a probe that is steady from t = 0; leave controller.probe_ramp out",
            )

    def _check_field(self, axes: int) -> None:
        try:
            self.field.law(coordinates(axes))
        except InvalidDescription as error:
            raise error.within("field") from None

    def _check_probes(self) -> None:
        for axis, plant in enumerate(self.vehicle.dynamics()):
            self.controller.check_plant(axis, plant)

    def _check_sensor(self) -> None:
        growing = [p for p in self.sensor.poles if p.real >= -UNDAMPED * abs(p)]
        if growing:
            raise InvalidDescription(
                "sensor",
                f"is not stable: its pole at {growing[0]:.6g} 1/s does not decay, so that it would "
                "never settle on J; every pole needs a negative real part",
                shown(self.sensor),
            )
        if self.sensor.law() == 0:
            raise InvalidDescription(
                "sensor", "is 0: the controller would receive nothing of J; 1 is no sensor", "0"
            )

    @property
    def system(self) -> System:
        """The loop's equations, shared by all loops of the same structure."""
        return self._composed[0]

    @property
    def twin(self) -> Loop:
        """The same loop with the parameters' symbols in place of its numbers.

        Its parts' laws, such as ``twin.field.law(p)``, are equations in the symbols of `system`.
        """
        return self._composed[1]

    @cached_property
    def _composed(self) -> tuple[System, Loop]:
        return _shared(self, self._flat[0])

    def rest(self, signal: Expr) -> tuple[Expr, ...]:
        """Return the sensor's and the controller's states at rest under a constant J = `signal`."""
        law = self.sensor.law()
        sensed = static_gain(law) * signal
        return (*(e * signal for e in settled(law)), *self.controller.rest(sensed))

    @property
    def values(self) -> NDArray[np.float64]:
        """The numbers, in the order of ``system.parameters``."""
        return self.system.completed(np.array(self._flat[1]))

    @property
    def continuous(self) -> Loop:
        """The loop without sampling: itself."""
        return self

    @property
    def counts(self) -> Hashable:
        """Whole numbers that decide the form of the equations and follow from the loop's numbers.

        Equal structure with equal counts is the same `system`.
        """
        return ()

    def counting(self, varied: Container[str]) -> Hashable:
        """Return which counts depend on the numbers at the `varied` paths, and are letters too."""
        return ()

    def covering(self, ends: Callable[[str], tuple[float, float] | None]) -> Loop:
        """Return this loop with counts as large as any loop's of an ensemble, and its own.

        `ends` takes a path to the smallest and the largest number there, None if it is not swept.
        """
        return self

    def lettered(
        self, reserved: frozenset[str], varied: Container[str]
    ) -> tuple[Any, tuple[Parameter, ...]]:
        """Return the loop with symbols for its numbers, and the parameters.

        No symbol takes a `reserved` name, and the numbers at the `varied` paths are symbols
        whatever they are.
        """
        axes = self.vehicle.dimension()
        letters = axis_names(max(axes, self.controller.inputs()))
        form, _ = symbolic(self, len(letters), {}, varied=varied)
        form._check_start(axes)
        units = dict(zip(letters, form.vehicle.input_units(), strict=False))
        return symbolic(self, len(letters), units, reserved, varied)

    def drawn(self, reserved: frozenset[str], varied: Container[str]) -> tuple[System, Loop]:
        """Return the equations, and the loop with their symbols for its numbers."""
        twin, parameters = self.lettered(reserved, varied)
        names, units = twin.vehicle.input_names(), twin.vehicle.input_units()
        diagram = Diagram()
        inputs = tuple(Symbol(name, real=True) for name in names)
        initial = initial_state(twin.start, twin.vehicle, twin.controller)
        body = twin.vehicle.compose(diagram, inputs, initial)
        signal = diagram.signal("J", twin.field.law(body.sensor), "1")
        sensed = _sensed(diagram, twin.sensor.law(), signal)
        twin.controller.compose(diagram, sensed, twin.vehicle.dynamics(), names, units)
        outputs: dict[str, tuple[Expr, ...]] = {
            "position": body.position,
            "sensor": body.sensor,
            "J": (signal,),
            "input": inputs,
        }
        source = twin.field.maximum()
        if source is not None:
            outputs["source"] = source
        system = System(
            states=tuple(diagram.states),
            rhs=tuple(diagram.rhs),
            initial=tuple(plain(e) for e in diagram.initial),
            inputs=inputs,
            outputs=MappingProxyType(outputs),
            signals=tuple(diagram.signals),
            parameters=parameters,
            units=MappingProxyType(diagram.units),
            carriers=tuple(diagram.carriers),
            oracles=MappingProxyType(dict(self.field.oracles())),
        )
        return system, twin

    @cached_property
    def _flat(self) -> tuple[tuple[Any, ...], list[float]]:
        return flatten(self)


def checked(loop: Any, *, sampled: bool = False) -> Loop:
    """Return a loop as it is, and refuse anything else: what every verb does first.

    A sampled loop is one only for verbs that say so.
    """
    if not isinstance(loop, Loop):
        raise InvalidDescription("loop", "must be a Loop", shown(loop))
    if loop.sampled and not sampled:
        raise InvalidDescription(
            "loop", "is sampled, and this is for continuous loops; take loop.continuous"
        )
    return loop


UNDAMPED: Final = 1e-9
"""Damping ratio of a sensor's pole below which it is not taken for stable."""

SENSED: Final = Symbol("J_s", real=True)
"""What the controller receives where there is a sensor; J itself where there is none."""


def varied(loop: Loop, paths: Sequence[str]) -> tuple[System, NDArray[np.float64], tuple[int, ...]]:
    """Return the equations in which the numbers at `paths` are parameters whatever they are.

    A phase that is a quarter turn, a gain of 1, a coefficient of 0 and a fraction are structure of
    `Loop.system`; here they are letters like any other.

    Returns
    -------
    system, values, places
        The equations, the loop's numbers in the order of ``system.parameters``, and where among
        them the numbers at `paths` stand.

    Raises
    ------
    InvalidDescription
        For a path that names no number, or one named twice.
    """
    names = [located(loop, path) for path in paths]
    for index, name in enumerate(names):
        if name in names[:index]:
            same = paths[names.index(name)]
            raise InvalidDescription(paths[index], f"is the same number as {same}; vary one")
    skeleton, values = flatten(loop, names)
    system, _ = _shared(loop, skeleton, names)
    order = [parameter.path for parameter in system.parameters]
    numbers = system.completed(np.array(values))
    return system, numbers, tuple(order.index(name) for name in names)


_KEPT = 256
_LOCK = threading.RLock()
_SYSTEMS: dict[Any, tuple[System, Loop]] = {}


def _shared(
    loop: Loop, skeleton: tuple[Any, ...], names: Container[str] = ()
) -> tuple[System, Loop]:
    key = skeleton, loop.counts, loop.counting(names)
    with _LOCK:
        found = _SYSTEMS.pop(key, None) or _assemble(loop, names)
        while len(_SYSTEMS) >= _KEPT:
            _SYSTEMS.pop(next(iter(_SYSTEMS)))  # the one not asked for longest
        _SYSTEMS[key] = found
        return found


def _assemble(loop: Loop, varied: Container[str]) -> tuple[System, Loop]:
    reserved: frozenset[str] = frozenset()
    while True:
        system, twin = loop.drawn(reserved, varied)
        drawn = {str(symbol) for symbol in system.units} | {"t", "J"}
        clash = drawn & {str(symbol) for symbol in system.symbols}
        if not clash:
            return system, twin
        reserved |= clash


def _sensed(diagram: Diagram, law: Expr, signal: Symbol) -> Symbol:
    """Draw the sensor, settled on J(0); return what the controller receives."""
    if law == 1:
        return signal
    order = ratio(law).order
    states = ["zeta_J" + (f"_{i + 1}" if order > 1 else "") for i in range(order)]
    begun = [e * signal for e in settled(law)]
    return diagram.signal(SENSED.name, diagram.filter(law, signal, states, "1", begun), "1")
