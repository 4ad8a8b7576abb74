"""`SampledLoop`: a loop whose controller runs every dt seconds, as difference equations."""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable
from types import MappingProxyType
from typing import Any, Final

import sympy
from sympy import Expr

from ..description import part
from ..errors import InvalidDescription
from ..logic import absolute, positive
from ..loop import SENSED, Loop
from ..lti import settled
from ..parameters import Parameter
from ..rational import ratio
from ..starts import initial_state
from ..symbols import coordinates, plain, substituted, t
from ..system import System
from .actuators import Arriving, arriving
from .controlling import check_poles, check_probes, check_rate, draw, slowest_period
from .delays import Late
from .diagram import SampledDiagram
from .motion import Exponentials, Linear, linear, moved
from .sampling import Sampling
from .sensors import Sensing
from .validity import HUGE

MOVING: Final = frozenset(
    (
        "vehicle",
        "sampling.dt",
        "sampling.sensor.delay",
        "sampling.actuator.delay",
        "sampling.actuator.lag",
    )
)
"""What the way from one sample to the next depends on."""


class SampledLoop(Loop):
    """A loop whose controller is run every dt seconds, on what a real sensor and actuator do.

    At t_k = k dt the sensor gives a sample, the controller a command at once, and the command is
    held for dt; in between, the vehicle moves exactly as its equations say. `sampling.sensor`,
    `sampling.actuator` and `sampling.practice` say what else happens. `system` is these difference
    equations, and `ensemble` runs many of them.

    Parameters
    ----------
    field, vehicle, controller, start, sensor
        As of a `Loop`. F(s) is discretised as the controller's filters are: Tustin's rule, exact at
        ω; it comes after the lag and the delay of `sampling.sensor` and before its noise.
    sampling
        `Sampling`: dt and everything that is not ideal.

    Raises
    ------
    InvalidDescription
        As a `Loop` does; and for a vehicle that is not linear, fewer than 6 samples in a period of
        the dither, and limits that do not fit the vehicle's inputs.
    """

    sampled = True

    sampling: Any = part(Sampling, "how the controller is run; must be given", default=None)

    @classmethod
    def of(cls, loop: Loop, sampling: Sampling) -> SampledLoop:
        """Return a loop with its controller sampled."""
        return cls(loop.field, loop.vehicle, loop.controller, loop.start, loop.sensor, sampling)

    def check(self) -> None:
        """Refuse parts that do not fit each other."""
        super().check()
        names = self.vehicle.input_names()
        linear(self.vehicle, _symbols(names), self.vehicle.rest(coordinates(len(names))))
        ideal = self.continuous
        system, values = ideal.system, ideal.values.tolist()
        sampling = self.sampling
        _within("sampling", lambda: check_rate(system, values, sampling.dt))
        _within("sampling.actuator", lambda: sampling.actuator.check_inputs(len(names)))
        _within("sampling", lambda: check_poles(self.controller, sampling.dt))
        check_probes(self.controller, sampling.practice, self.vehicle.dynamics())
        slowest = slowest_period(system, values)
        _within("sampling.practice", lambda: sampling.practice.check_inputs(len(names)))
        _within("sampling.practice", lambda: sampling.practice.check_times(slowest, sampling.dt))

    @property
    def continuous(self) -> Loop:
        """The same loop with an ideal sensor and actuator and a controller that never waits."""
        return Loop(self.field, self.vehicle, self.controller, self.start, self.sensor)

    @property
    def counts(self) -> Hashable:
        """The whole samples in the delays, which are states."""
        return self.sampling.counts

    def counting(self, varied: Container[str]) -> Hashable:
        """Return which delays vary: an ensemble's loops may have fewer samples in them."""
        return self.sampling.counting(varied)

    def covering(self, ends: Callable[[str], tuple[float, float] | None]) -> Loop:
        """Return this loop with the shortest dt and the longest delays of all, its own included."""
        sampling, changes = self.sampling, {}
        for path, own, extreme in (
            ("sampling.dt", sampling.dt, min),
            ("sampling.sensor.delay", sampling.sensor.delay, max),
            ("sampling.actuator.delay", sampling.actuator.delay, max),
        ):
            found = ends(path)
            if found is not None:
                changes[path] = extreme(own, *found)
        return self.replace(changes)

    def drawn(self, reserved: frozenset[str], varied: Container[str]) -> tuple[System, Loop]:
        """Return the equations, and the loop with their symbols for its numbers."""
        twin, parameters = self.lettered(reserved, varied)
        drawing = _Drawing(self, twin, parameters, varied)
        return drawing.system(), twin


def _within(path: str, check: Callable[[], None]) -> None:
    try:
        check()
    except InvalidDescription as error:
        raise error.within(path) from None


def _symbols(names: tuple[str, ...]) -> tuple[sympy.Symbol, ...]:
    return tuple(sympy.Symbol(name, real=True) for name in names)


class _Drawing:
    """Draws a sampled loop: what happens at t_k first, then the way to t_{k+1}."""

    def __init__(
        self,
        loop: SampledLoop,
        twin: Any,
        parameters: tuple[Parameter, ...],
        varied: Container[str],
    ) -> None:
        self.loop, self.twin, self.parameters = loop, twin, parameters
        self.sampling: Sampling = twin.sampling
        self.diagram = SampledDiagram(self.sampling.dt)  # pyright: ignore[reportArgumentType]
        self.names = twin.vehicle.input_names()
        self.units = twin.vehicle.input_units()
        self.inputs = _symbols(self.names)
        self.exponentials = Exponentials(parameters, MOVING)
        parts = (self.sampling.sensor, self.sampling.actuator)
        counts, varies = loop.sampling.counts, loop.sampling.counting(varied)
        self.sensor_late, self.actuator_late = (
            None if part.delay is None else Late.of(part.delay, self.diagram.dt, count, vary)
            for part, count, vary in zip(parts, counts, varies, strict=True)
        )

    def system(self) -> System:
        """Return the equations."""
        diagram, twin = self.diagram, self.twin
        vehicle = self._vehicle()
        position = vehicle.body.position
        signal = diagram.signal("J", twin.field.law(vehicle.body.sensor), "1")
        sensing = Sensing(diagram, self.sampling.sensor, self.sensor_late)
        sensed = self._sampled(sensing, signal)
        arrived = self._driven(vehicle, sensed)
        following = moved(vehicle, self.exponentials, arrived, diagram.dt)
        for state, later in zip(vehicle.states, following, strict=True):
            diagram.follow(state, later)
        first = vehicle.states[0]  # beyond HUGE no sample is believed: the loop has escaped
        escaped = positive(absolute(signal) - HUGE, sympy.oo, diagram.follows(first))
        diagram.follow(first, escaped)
        if sensing.ahead is not None:
            sensing.remember(self._field_ahead(vehicle, arrived, sensing.ahead))
        outputs: dict[str, tuple[Expr, ...]] = {
            "position": position,
            "sensor": vehicle.body.sensor,
            "J": (signal,),
            "input": self.inputs,
            "sensed": (sensed,),
        }
        source = twin.field.maximum()
        if source is not None:
            outputs["source"] = source
        used = (*diagram.rhs, *(e for _, e in diagram.signals))
        derived, numbers = self.exponentials.finished(used)
        return System(
            states=tuple(diagram.states),
            rhs=tuple(diagram.rhs),
            initial=tuple(plain(e) for e in diagram.initial),
            inputs=self.inputs,
            outputs=MappingProxyType(outputs),
            signals=tuple(diagram.signals),
            parameters=(*self.parameters, *derived),
            units=MappingProxyType(diagram.units),
            carriers=tuple(diagram.carriers),
            oracles=MappingProxyType(dict(self.loop.field.oracles())),
            dt=self.sampling.dt,  # pyright: ignore[reportArgumentType]
            derived=numbers,
            essential=(signal,),
        )

    def _vehicle(self) -> Linear:
        """Draw the vehicle's states, behind the actuator's lag if it has one."""
        twin = self.twin
        initial = initial_state(twin.start, twin.vehicle, twin.controller)
        vehicle = linear(twin.vehicle, self.inputs, initial)
        lag: Any = self.sampling.actuator.lag
        if lag is not None:
            vehicle = vehicle.behind(lag, [f"{name}_lag" for name in self.names], self.units)
        for state, unit, begun in zip(vehicle.states, vehicle.units, vehicle.initial, strict=True):
            self.diagram.state(state.name, unit, begun)
        return vehicle

    def _sampled(self, sensing: Sensing, signal: sympy.Symbol) -> sympy.Symbol:
        """Draw what becomes of J at t_k; return the sample."""
        diagram, law = self.diagram, self.twin.sensor.law()
        reached = sensing.delayed(signal)
        found: Expr = reached
        if law != 1:
            base = plain(self.twin.controller.base())
            order = ratio(law).order
            states = ["zeta_J" + (f"_{i + 1}" if order > 1 else "") for i in range(order)]
            begun = [e * signal for e in settled(diagram.tustin(law, base))]
            found = diagram.filter(law, reached, states, "1", begun, base)
        found = sensing.sensor.disturbed(diagram, found, self.sampling.seed)  # pyright: ignore[reportArgumentType]
        return signal if found == signal else diagram.signal(SENSED.name, found, "1")

    def _driven(self, vehicle: Linear, sensed: sympy.Symbol) -> Arriving:
        """Draw the controller and the actuator; return what arrives at the vehicle."""
        diagram, sampling = self.diagram, self.sampling
        ideal = sampling.actuator.is_absent
        names = self.names if ideal else tuple(f"{name}_command" for name in self.names)
        plants = self.twin.vehicle.dynamics()
        commands = draw(
            diagram, self.twin.controller, sampling.practice, sensed, plants, names, self.units
        )
        if ideal:
            return Arriving(commands, commands, None)
        arrived = arriving(
            diagram, sampling.actuator, self.actuator_late, commands, self.names, self.units
        )
        lagged = vehicle.states[-len(self.names) :] if sampling.actuator.lag is not None else None
        for index, name in enumerate(self.names):
            reaching = arrived.new[index] if lagged is None else lagged[index]
            diagram.signal(name, reaching, self.units[index])
        return arrived

    def _field_ahead(self, vehicle: Linear, arrived: Arriving, time: Expr) -> Expr:
        """Return J at t_k + `time`, on the way to the next sample."""
        states = moved(vehicle, self.exponentials, arrived, time)
        later = dict(zip(vehicle.states, states, strict=True))
        place = tuple(
            self.diagram.signal(f"p{index + 1}_ahead", substituted(expression, later), "m")
            for index, expression in enumerate(vehicle.body.sensor)
        )
        return substituted(self.twin.field.law(place), {t: t + time})
