"""A controller with what practice adds to it, drawn as difference equations."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any, Final

import sympy
from sympy import Expr, Symbol

from ..controllers import Controller
from ..errors import InvalidDescription
from ..logic import maximum
from ..rational import at_frequency
from ..symbols import plain, sine
from ..symbols import t as time
from ..system import System
from .adapting import responses
from .diagram import Filter, SampledDiagram
from .practice import Practice
from .validity import Guarded

FEWEST: Final = 6
FEW: Final = 20
"""Samples per period of the fastest dither: fewer are refused, and warned of."""

MOST: Final = 1e9
"""Samples per period: with more, a sample changes nothing that double precision shows."""

SMALL: Final = 1e-2
"""A smaller dither, as a share of the full one, says nothing about the response."""


def check_rate(system: System, values: Sequence[float], dt: float) -> None:
    """Refuse too few samples per period of the fastest dither, and warn of few.

    Raises
    ------
    InvalidDescription
        For fewer than 6 samples a period.
    """
    period = system.fastest_period(values)
    if period is None:
        return
    count = period / dt
    if count > MOST:
        raise InvalidDescription(
            "dt", f"leaves {count:.3g} samples in a period; at most {MOST:g} make sense", repr(dt)
        )
    if count < FEWEST * (1 - 1e-12):
        raise InvalidDescription(
            "dt",
            f"leaves {count:.3g} samples in a period of the fastest dither, {period:.6g} s; at "
            f"least {FEWEST} are needed, {FEW} are good: at most {period / FEW:.3g} s",
            repr(dt),
        )
    if count < FEW * (1 - 1e-12):
        warnings.warn(
            f"dt = {dt:g} s leaves {count:.3g} samples in a period of the fastest dither; "
            f"below {FEW} the hold takes much of it (dt <= {period / FEW:.3g} s avoids that)",
            UserWarning,
            stacklevel=4,
        )


def check_poles(controller: Controller, dt: float) -> None:
    """Refuse a pole that Tustin's rule cannot place, and warn of one that it makes ring.

    Raises
    ------
    InvalidDescription
        For a pole at p ≥ K, K = ω/tan(ω dt/2), which is unstable and faster than the samples.
    """
    for path, law, frequency in controller.compensators():
        warped = frequency / math.tan(frequency * dt / 2)
        for pole in law.poles:
            text = (
                f"its pole at {pole:.6g} 1/s" if pole.imag else f"its pole at {pole.real:.6g} 1/s"
            )
            wanted = f"dt <= {1 / abs(pole):.3g} s" if pole else ""
            if pole.real >= warped * (1 - 1e-6):
                raise InvalidDescription(
                    f"controller.{path}",
                    f"is faster than its samples: {text} lies beyond ω/tan(ω dt/2) = {warped:.6g} "
                    f"1/s; {wanted} would do",
                    str(law),
                )
            if abs(pole) > warped * (1 + 1e-6):
                warnings.warn(
                    f"controller.{path}: {text} is faster than the samples can follow, ω/tan(ω "
                    f"dt/2) = {warped:.6g} 1/s, and will ring from sample to sample; take a slower "
                    f"one, or {wanted}",
                    UserWarning,
                    stacklevel=4,
                )


def check_probes(controller: Controller, practice: Practice, plants: Sequence[Expr | None]) -> None:
    """Warn of limits that cut the steady probe."""
    limits = practice.limits
    for axis, plant in enumerate(plants if limits is not None else ()):
        motion = controller.motion(axis)
        law = None if motion is None else plant if motion.through is None else motion.through
        if limits is None or motion is None or law is None:
            continue
        size = motion.amplitude / abs(at_frequency(law, motion.frequency))
        for name, room in limits.room(axis, motion.frequency):
            if size > room * (1 + 1e-9):
                warnings.warn(
                    f"practice.limits.{name}.{axis} cuts the probe, whose amplitude is {size:.4g} "
                    f"at {motion.frequency:.4g} rad/s where {room:.4g} is left: the loop loses "
                    "gain, and an integrator leaks",
                    UserWarning,
                    stacklevel=4,
                )


def slowest_period(system: System, values: Sequence[float]) -> float:
    """Return the slowest dither's period (s), 0 without a dither."""
    found = sympy.lambdify([list(system.symbols)], list(system.carriers), "math")(values)
    return 2 * math.pi / min(map(abs, found)) if found else 0.0


class ControllerDiagram(SampledDiagram):
    """The diagram that a controller draws itself on: its blocks are conditioned as practice asks.

    It adds to the states and signals of the diagram around it.
    """

    def __init__(self, around: SampledDiagram, practice: Practice, guarded: Guarded) -> None:
        self.__dict__.update(around.__dict__)
        self.filters = []
        self.practice, self.guarded = practice, guarded
        self.references: list[Expr] = []
        self.xi: Expr = sympy.Integer(0)
        self._corner: tuple[Expr, Expr] | None = None
        self._ramp: Symbol | None = None
        self._delays: dict[Expr, Symbol] = {}
        changes, shrinking = practice.changes, practice.dither
        self.gain: Expr = sympy.Integer(1) if changes is None else changes.draw(self, "gain")
        self.amplitude: Expr = (
            sympy.Integer(1) if changes is None else changes.draw(self, "amplitude")
        )
        self.factor: Expr = sympy.Integer(1) if shrinking is None else shrinking.factor(self)  # pyright: ignore[reportAttributeAccessIssue]

    def washout(self, corner: Expr, signal: Symbol, start: Expr, frequency: Expr) -> Symbol:
        """Draw ξ_k = ξ_(k−1) − a ξ_(k−1) + g ΔJ, a = 2h/(K + h), g = K/(K + h); condition it.

        That is Tustin's s/(s + h) with differences of J, which are exact where J is large.
        """
        if start != signal:
            self.guarded.begin(self, start)
        warped = self.warp(frequency)
        self._corner = corner, frequency
        last = self.state("xi_last", "1", 0)
        share, gain = 2 * corner / (warped + corner), warped / (warped + corner)
        xi = self.signal("xi", last - share * last + gain * self.guarded.change, "1")
        self.follow(last, xi)
        self.xi = xi
        scale = self.practice.scale
        conditioned: Any = xi if scale is None else scale.after(self, xi, self.guarded.good)
        return conditioned if self.gain == 1 else self.signal("nu_c", self.gain * conditioned, "1")

    def reference(self, frequency: Expr, phase: Expr | float) -> Expr:
        """Draw sin(ωt + ψ + δ), −δ what hold, delays and lags make the samples late."""
        if frequency not in self.carriers:
            self.carriers.append(frequency)
        late: Any = sympy.Integer(0)
        if self.practice.delay is not None:
            late += frequency * (self.dt / 2 + plain(self.practice.delay))
        if self.practice.lag is not None:
            late += sympy.atan(frequency * plain(self.practice.lag))
        if self._corner is not None and frequency != self._corner[1]:
            late -= self._lead_error(*self._corner, frequency)
        if late not in self._delays and late != 0:
            number = f"_{len(self._delays) + 1}" if self._delays else ""
            self._delays[late] = self.signal(f"delta{number}", -late, "rad")
        turned = self._delays[late] if late != 0 else sympy.Integer(0)
        drawn = sine(frequency * time + turned, phase)
        self.references.append(drawn)
        return drawn

    def _lead_error(self, corner: Expr, exact_at: Expr, frequency: Expr) -> Expr:
        """Return how much more the discretised washout leads at ω than s/(s + h) does."""
        warped = self.warp(exact_at) * sympy.tan(frequency * self.dt / 2)
        return sympy.atan(corner / warped) - sympy.atan(corner / frequency)

    def envelope(self, ramp: Expr | None) -> Expr:
        """Draw what the probe is multiplied by: the ramp, and the factors of its amplitude."""
        if ramp is not None and self._ramp is None:
            self._ramp = self.state("unramped", "1", 1)
            self.follow(self._ramp, self._ramp - self.share(ramp) * self._ramp)
        return self.size

    @property
    def size(self) -> Expr:
        """The dither's size as a share of the full one."""
        whole = self.amplitude * self.factor
        return whole if self._ramp is None else whole * (1 - self._ramp)

    def feeding(self, command: Symbol) -> list[Filter]:
        """Return the filters whose output a command is made of."""
        bound = dict(self.signals)
        found: set[Any] = set()
        pending: set[Any] = {command}
        while pending:
            symbol = pending.pop()
            found.add(symbol)
            pending |= bound.get(symbol, sympy.Integer(0)).free_symbols - found
        return [f for f in self.filters if f.states[0] in found]


def draw(
    diagram: SampledDiagram,
    controller: Controller,
    practice: Practice,
    signal: Expr,
    plants: Sequence[Expr | None],
    inputs: Sequence[str],
    units: Sequence[str],
) -> tuple[Symbol, ...]:
    """Draw a controller and what practice adds; bind and return the commands' symbols.

    Parameters
    ----------
    signal
        The sample, which may be no number.
    plants, inputs, units
        As `Controller.compose` takes them.
    """
    scale, validity = practice.scale, practice.validity
    scaled = signal if scale is None else diagram.signal("J_scaled", scale.before(signal), "1")
    guarded = validity.draw(diagram, signal, scaled)
    inner = ControllerDiagram(diagram, practice, guarded)
    authority = validity.authority(inner, guarded)
    final = practice.limits is None and authority is None
    names = inputs if final else [f"{name}_wanted" for name in inputs]
    commands = controller.compose(inner, guarded.held, plants, names, units)
    sent: list[Any] = list(commands)
    for i, (name, unit) in enumerate(zip(inputs, units, strict=True)):
        if final:
            continue
        safe = plain(validity.safes(len(inputs))[i])
        if authority is not None:
            sent[i] = inner.signal(f"{name}_faded", safe + authority * (sent[i] - safe), unit)
        if practice.limits is not None:
            sent[i] = practice.limits.draw(inner, name, unit, i, sent[i], safe)
        sent[i] = inner.signal(name, sent[i], unit)
        for drawn in inner.feeding(commands[i]):
            inner.track(drawn, _tracking(practice, drawn), sent[i] - commands[i])
    _observe(inner, practice)
    return tuple(sent)


def _tracking(practice: Practice, drawn: Filter) -> Expr:
    """Return the time constant with which a filter follows what was sent."""
    limits = practice.limits
    if limits is not None and limits.tracking is not None:
        return plain(limits.tracking)
    assert drawn.exact_at is not None
    return 1 / drawn.exact_at


def _observe(diagram: ControllerDiagram, practice: Practice) -> None:
    """Draw what follows the response at the dither frequencies."""
    guarded = diagram.guarded
    if practice.dither is not None:
        seen = _response(diagram, "S", practice.dither.response)
        practice.dither.draw(diagram, diagram.factor, seen, guarded.good)  # pyright: ignore[reportArgumentType]
    if practice.detector is not None:
        seen = _response(diagram, "A", practice.detector.response)
        patience = None if practice.validity.timeout is None else guarded.patience
        mean = guarded.held - diagram.xi
        practice.detector.draw(diagram, seen, mean, guarded.good, patience)


def _response(diagram: ControllerDiagram, name: str, time: Any) -> Expr:
    """Draw the response that the full dither would have."""
    seen = responses(
        diagram, name, diagram.xi, diagram.references, plain(time), diagram.guarded.good
    )
    size = diagram.size
    return seen if size == 1 else diagram.signal(f"{name}_full", seen / maximum(size, SMALL), "1")
