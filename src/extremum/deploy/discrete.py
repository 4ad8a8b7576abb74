"""`discretize`: a controller as it runs on samples, a pure function from state and sample."""

from __future__ import annotations

import threading
from collections import namedtuple
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sympy import Expr, Symbol

from ..controllers import Controller
from ..description import Description, flatten, part, structure, value
from ..errors import InvalidDescription, shown
from ..parameters import symbolic
from ..sampled.adapting import ARRIVED, LARGEST, LOST, SEEKING
from ..sampled.controlling import check_poles, check_probes, check_rate, draw, slowest_period
from ..sampled.diagram import SampledDiagram
from ..sampled.practice import Practice
from ..sampled.validity import LONG
from ..symbols import axis_names
from ..system import System
from ..validation import number
from ..vehicles import Vehicle
from .machine import TURN, Machine, machine
from .python import starter, stepper
from .records import placed

STATUS: Final = {SEEKING: "seeking", ARRIVED: "arrived", LOST: "lost"}

SAMPLE: Final = Symbol("J", real=True)
"""What the controller is given at every step."""


class DiscreteController(Description):
    """A controller that runs on samples J_k at t_k = k dt; made by `discretize`.

    ``state = ctrl.init(J)``, then at every sample ``u, state = ctrl.step(state, J)``, u held until
    the next one. Its equations are ``print(ctrl.system)``; J is all that it ever learns.

    Attributes
    ----------
    controller, dt, practice
        What it was made of.
    inputs, units
        Names and units of what it drives.
    system
        The difference equations.
    values
        The numbers, in the order of ``system.parameters``.
    """

    root = True

    controller: Controller = part(Controller, "the controller")
    dt: float = value("dt", "s", "time between two samples", positive=True)
    practice: Practice = part(Practice, "what practice adds", default=Practice())
    inputs: tuple[str, ...] = structure("names of what it drives", default=())
    units: tuple[str, ...] = structure("units of what it drives", default=())

    def check(self) -> None:
        """Refuse too few samples a period, and parts that do not fit."""
        count = self.controller.inputs()
        if not len(self.inputs) == len(self.units) == count:
            raise InvalidDescription(
                "inputs", f"must have {count} names and units; use discretize", shown(self.inputs)
            )
        for name, plant in zip(self.inputs, self._unknown_plants(), strict=True):
            if plant:
                raise InvalidDescription(
                    plant,
                    f"must be given: the probe of {name} goes through the vehicle's own transfer "
                    "function, which the controller does not know; name it, such as through=1/s, "
                    "or give discretize(…, vehicle=loop.vehicle)",
                    "None",
                )
        try:
            self.practice.check_inputs(count)
        except InvalidDescription as error:
            raise error.within("practice") from None
        check_rate(self.system, self.values.tolist(), self.dt)
        check_poles(self.controller, self.dt)
        check_probes(self.controller, self.practice, (None,) * count)
        try:
            slowest = slowest_period(self.system, self.values.tolist())
            self.practice.check_times(slowest, self.dt)
        except InvalidDescription as error:
            raise error.within("practice") from None

    def _unknown_plants(self) -> list[str]:
        found = []
        for axis, _ in enumerate(self.inputs):
            try:
                self.controller.check_plant(axis, None)
                found.append("")
            except InvalidDescription as error:
                found.append(error.path)
        return found

    @property
    def system(self) -> System:
        """The difference equations, shared by all controllers of the same structure."""
        return self._composed[0]

    @property
    def values(self) -> NDArray[np.float64]:
        """The numbers, in the order of ``system.parameters``."""
        return np.array(self._flat[1])

    @cached_property
    def _flat(self) -> tuple[tuple[Any, ...], list[float]]:
        return flatten(self)

    @cached_property
    def _composed(self) -> tuple[System, dict[Symbol, Expr]]:
        return _shared(self, self._flat[0])

    @cached_property
    def machine(self) -> Machine:
        """One step as a straight line of operations in double precision."""
        return self.machine_of(64)

    def machine_of(self, precision: int) -> Machine:
        """Return one step as a straight line of operations of 64 or 32 bits."""
        system, given = self._composed
        return machine(system, self._flat[1], self.dt, given, precision)

    @property
    def safe(self) -> tuple[float, ...]:
        """The output that is safe."""
        return tuple(map(float, self.practice.validity.safes(len(self.inputs))))

    @property
    def state_names(self) -> tuple[str, ...]:
        """The states' names; a phase is counted in 2⁻⁶⁴ turns, −2⁶³ … 2⁶³ − 1."""
        return (*self.machine.states, *(o.name for o in self.machine.oscillators))

    @cached_property
    def _state(self) -> Any:
        return _states(self.state_names)

    @cached_property
    def init(self) -> Callable[[float | None], Any]:
        """Return the state before the first step, J → state; J is the first sample, or about it."""
        return starter(self.machine, self._state)

    @cached_property
    def step(self) -> Callable[[Any, float | None], tuple[tuple[float, ...], Any]]:
        """Return what is sent and the next state, (state, J) → (u, state).

        J may be missing: None, NaN, infinite, or outside of what `Validity` believes.
        """
        return stepper(self.machine, self._state)

    def skip(self, state: Any, steps: int) -> Any:
        """Return the state after `steps` sampling instants at which nothing was run.

        The dither's phase goes on, and the last sample becomes older; nothing else changes.
        """
        if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0:
            raise InvalidDescription(
                "steps", "must be a whole number, at least 0: time does not go back", shown(steps)
            )
        names, made = self.machine, {}
        for i in names.clocks:
            made[names.states[i]] = state[i] + max(float(min(steps, LONG - state[i])), 0.0)
        for oscillator in names.oscillators:
            count = getattr(state, oscillator.name) + oscillator.increment * int(steps)
            made[oscillator.name] = (count + TURN // 2) % TURN - TURN // 2
        return state._replace(**made)

    def change(
        self, state: Any, *, gain: float | None = None, amplitude: float | None = None
    ) -> Any:
        """Return the state from which all gains, or amplitudes, go over to so many times their own.

        Raises
        ------
        InvalidDescription
            If the practice has no `Changes`, or a factor cannot be right.
        """
        if self.practice.changes is None:
            raise InvalidDescription(
                "practice.changes",
                "must be given, so that there are states that a change goes through: "
                "Practice(changes=Changes(time=1.0))",
                "None",
            )
        made = {}
        for name, factor in (("gain", gain), ("amplitude", amplitude)):
            if factor is not None:
                wanted = _factor(name, factor, name == "amplitude")
                left = getattr(state, f"{name}_left") + (wanted - getattr(state, f"{name}_wanted"))
                made |= {f"{name}_wanted": wanted, f"{name}_left": left}
        return state._replace(**made)

    def status(self, state: Any) -> str:
        """Return "seeking", "arrived" or "lost", as of the last step.

        Raises
        ------
        InvalidDescription
            If the practice has no `Detector`.
        """
        if self.practice.detector is None:
            raise InvalidDescription(
                "practice.detector",
                "must be given: Practice(detector=Detector(level=…, time=…, response=…))",
                "None",
            )
        return STATUS[int(state.status)]

    def run(
        self, samples: Iterable[float | None], times: Sequence[float] | None = None
    ) -> NDArray[np.float64]:
        """Feed a record of samples; return what would have been sent, (samples, inputs).

        Parameters
        ----------
        samples
            J_k; None or NaN where one is missing.
        times
            When they were taken (s), increasing; each belongs to the sampling instant nearest to
            it, and instants without one count as missing. None: at every instant.

        Raises
        ------
        InvalidDescription
            For samples out of order, or two at the same instant.
        """
        record = placed(samples, times, self.dt)
        if not record:
            return np.empty((0, len(self.inputs)))
        state, sent = self.init(record[0]), np.empty((len(record), len(self.inputs)))
        for k, sample in enumerate(record):
            sent[k], state = self.step(state, sample)
        return sent

    def __str__(self) -> str:
        return self.system.text(self._flat[1])


def _factor(name: str, given: Any, positive: bool) -> float:
    try:
        factor = number(given)
    except InvalidDescription as error:
        raise error.within(name) from None
    if factor > LARGEST:
        raise InvalidDescription(name, f"must be at most {LARGEST:g}", shown(given))
    if factor < 0 or (positive and not factor):
        reason = "must be greater than 0: without a dither nothing is sought"
        raise InvalidDescription(name, reason if positive else "must not be negative", shown(given))
    return factor


def discretize(
    controller: Controller,
    dt: float,
    *,
    practice: Practice | None = None,
    vehicle: Vehicle | None = None,
) -> DiscreteController:
    """Return the controller as it runs on samples taken every `dt`.

    The washout and the compensators are discretised by Tustin's rule pre-warped at their dither
    frequency, so that they are exact there and at 0: s → K (z − 1)/(z + 1), K = ω/tan(ω dt/2).
    Elsewhere what they do at a frequency b appears at b (1 + (ω² − b²) dt²/12), and a real pole −b
    decays at b (1 + (ω² + b²) dt²/12). Channels
    whose frequency is not the washout's have its small phase error taken out of their reference.
    Probes and references are those of the continuous controller at t_k, unless `Practice.delay`
    lets the references lag by what hold and delays take. Phases are counted in 2⁻⁶⁴ turns: after
    10⁹ steps that of a single frequency is right within 2e-10 rad, that of a ratio p/q within p/q
    times all ratios' common denominator as much; their ratios stay exact for ever.

    Parameters
    ----------
    controller
        The controller.
    dt
        Time between two samples (s); at most a sixth of the fastest dither's period.
    practice
        `Practice`: validity of samples, limits, scale, …; None for the default.
    vehicle
        Whose inputs it drives: their names and units, and its transfer functions where a dither
        states none of its own. The discrete controller keeps nothing else of it.

    Raises
    ------
    InvalidDescription
        If dt is not positive or leaves fewer than 6 samples a period, or parts do not fit.

    Warns
    -----
    UserWarning
        For fewer than 20 samples a period.

    Notes
    -----
    Source: Zhang, Siranosian and Krstić (2007), Figs. 1 to 3, for the continuous controller; Åström
    and Wittenmark, Computer-Controlled Systems (1997), section 8.3, for Tustin's rule.
    """
    if not isinstance(controller, Controller):
        raise InvalidDescription("controller", "must be a Controller", shown(controller))
    count = controller.inputs()
    names, units = tuple(f"u_{axis}" for axis in axis_names(count)), ("1",) * count
    if vehicle is not None:
        if not isinstance(vehicle, Vehicle):
            raise InvalidDescription("vehicle", "must be a Vehicle", shown(vehicle))
        names, units = vehicle.input_names(), vehicle.input_units()
        if len(names) != count:
            raise InvalidDescription(
                "vehicle", f"has {len(names)} inputs, the controller drives {count}"
            )
        controller = controller.through(vehicle.dynamics())
    return DiscreteController(
        controller=controller,
        dt=dt,
        practice=Practice() if practice is None else practice,
        inputs=names,
        units=units,
    )


@lru_cache(maxsize=256)
def _states(names: tuple[str, ...]) -> Any:
    """Return the named tuple's class of a state; it comes back from other processes."""
    state = namedtuple("State", names)
    state.__reduce__ = lambda self: (_state, (self._fields, tuple(self)))
    return state


def _state(names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    return _states(names)._make(values)


_KEPT: Final = 64
_LOCK: Final = threading.RLock()
_SYSTEMS: Final[dict[Any, tuple[System, dict[Symbol, Expr]]]] = {}


def _shared(
    controller: DiscreteController, skeleton: tuple[Any, ...]
) -> tuple[System, dict[Symbol, Expr]]:
    with _LOCK:
        if skeleton not in _SYSTEMS:
            while len(_SYSTEMS) >= _KEPT:
                _SYSTEMS.pop(next(iter(_SYSTEMS)))
            _SYSTEMS[skeleton] = _assemble(controller)
        return _SYSTEMS[skeleton]


def _assemble(controller: DiscreteController) -> tuple[System, dict[Symbol, Expr]]:
    reserved: frozenset[str] = frozenset()
    while True:
        system, given = _compose(controller, reserved)
        drawn = {str(symbol) for symbol in system.units} | {"t", str(SAMPLE)}
        clash = drawn & {str(symbol) for symbol in system.symbols}
        if not clash:
            return system, given
        reserved |= clash


def _compose(
    controller: DiscreteController, reserved: frozenset[str]
) -> tuple[System, dict[Symbol, Expr]]:
    names, units = controller.inputs, controller.units
    letters = axis_names(len(names))
    twin, parameters = symbolic(
        controller, len(names), dict(zip(letters, units, strict=True)), reserved
    )
    diagram = SampledDiagram(twin.dt)
    commands = draw(
        diagram, twin.controller, twin.practice, SAMPLE, (None,) * len(names), names, units
    )
    system = System(
        states=tuple(diagram.states),
        rhs=tuple(diagram.rhs),
        initial=tuple(diagram.initial),
        inputs=(SAMPLE,),
        outputs=MappingProxyType({"input": commands}),
        signals=tuple(diagram.signals),
        parameters=parameters,
        units=MappingProxyType(diagram.units),
        carriers=tuple(diagram.carriers),
        dt=twin.dt,
    )
    return system, diagram.given
