"""From shapes and frequencies to a controller, and to the loop at any point of the box."""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, Final

import numpy as np

from ...controllers import Channel, Dither, GradientES
from ...fields import Quadratic
from ...loop import Loop
from ...lti import Transfer, transfer
from ...rational import at_frequency
from ...requirements import VEHICLE, Requirements
from ...starts import OnDither
from ...vehicles import PointMass
from .candidates import rounded
from .family import WASHOUT, Family, middle, pade, plant_of, uncertain
from .polynomials import expression
from .shapes import Shape

DIGITS: Final = 5
DELAY_ORDER: Final = 4
Point = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that makes a controller: the shapes and the frequencies.

    Attributes
    ----------
    requirements, families, shapes
        What is known, and one family and shape for each axis.
    ratios, phases
        ω_i/ω and φ_i of each axis.
    """

    requirements: Requirements
    families: tuple[Family, ...]
    shapes: tuple[Shape, ...]
    ratios: tuple[Fraction, ...]
    phases: tuple[float, ...]

    @cached_property
    def vehicle(self) -> PointMass:
        """The vehicle in the middle of its uncertain numbers' ranges."""
        wanted = self.requirements
        numbers: dict[str, Any] = dict(middle(wanted))
        if any(f.force for f in self.families):
            numbers["disturbance"] = tuple(f.force for f in self.families)
        return wanted.vehicle.replace(numbers)

    def tuned(self, base: float) -> Plan:
        """Return the plan with what dithers at multiples of ω = `base` make of each plant."""
        tuned = (f.tuned(self.frequency(i, base)) for i, f in enumerate(self.families))
        return replace(self, families=tuple(tuned))

    def pushed(self, point: Point) -> dict[str, float]:
        """Return the forces that add to what holds the vehicle at its source, at a point.

        Of −|d| and |d| the one that makes |D(0)/N(0) x* − d| the larger, x* ≥ 0.
        """
        if not any(f.force for f in self.families):
            return {}
        known = {
            p.removeprefix(VEHICLE): point[p] for p in self.requirements.uncertain if p in point
        }
        laws = self.vehicle.replace(known).dynamics()
        found = {}
        for family, law in zip(self.families, laws, strict=True):
            path = f"{VEHICLE}disturbance.{family.axis}"
            if path not in point:
                found[path] = -family.force if plant_of(law).load > 0 else family.force
        return found

    @cached_property
    def sensor(self) -> Transfer:
        """F(s) with the dead time in a Padé form whose phase is right to 1.3° up to ωT = 3π/2."""
        wanted = self.requirements
        above, below = (expression(p) for p in pade(wanted.delay, DELAY_ORDER))
        return transfer(wanted.sensor.law() * above / below)

    def frequency(self, axis: int, base: float) -> float:
        """Return ω_i (rad/s)."""
        return float(self.ratios[axis]) * base

    def response(self, axis: int, base: float) -> complex:
        """Return what sensor, dead time and washout make of the dither, at jω_i."""
        omega, wanted = self.frequency(axis, base), self.requirements
        washout = 1j * omega / (1j * omega + WASHOUT * base)
        delayed = cmath.exp(-1j * omega * wanted.delay)
        return at_frequency(wanted.sensor.law(), omega) * delayed * washout

    def compensator_text(self, axis: int) -> str:
        """Return C(s) in factors, as it is read."""
        shape = self.shapes[axis]
        return factored(shape.above, shape.below)

    def amplitude(self, axis: int, base: float) -> float:
        """Return α (m): the dither's limit, or what the input has room for."""
        found = float(self.families[axis].amplitude(self.frequency(axis, base)))
        return found if found == self.families[axis].dither else rounded_down(found)

    def controller(self, base: float) -> GradientES:
        """Return the controller for the base frequency ω = `base` (rad/s)."""
        return GradientES(
            frequency=base,
            washout=float(rounded(WASHOUT * base, DIGITS)),
            channels=tuple(self._channel(axis, base) for axis in range(len(self.shapes))),
        )

    def _channel(self, axis: int, base: float) -> Channel:
        shape, amplitude = self.shapes[axis], self.amplitude(axis, base)
        response = self.response(axis, base)
        low, high = self.requirements.curvature[axis]
        gain = shape.gain / (amplitude * math.sqrt(low * high) * abs(response))
        through = self.vehicle.axes[axis] if uncertain(self.requirements, axis) else None
        phase = self.phases[axis]
        return Channel(
            dither=Dither(amplitude, phase=phase, through=through),
            gain=float(rounded(gain, DIGITS)),
            compensator=transfer(expression(shape.above) / expression(shape.below)),
            reference=float(rounded(phase + cmath.phase(response), 2 * DIGITS)),
            ratio=self.ratios[axis],
        )

    def loop(self, base: float) -> Loop:
        """Return the loop in the middle of the box, the source and the force at their farthest."""
        controller = self.controller(base)
        source = tuple(f.source for f in self.families)
        found = Loop(
            field=Quadratic(source=source, q=self._curvature(), peak=0.0),
            vehicle=self.vehicle,
            controller=controller,
            start=OnDither(centred(controller, source)),
            sensor=self.sensor,
        )
        return found.replace(self.pushed({}))

    def _curvature(self) -> Any:
        middle = [math.sqrt(low * high) for low, high in self.requirements.curvature]
        if not self.requirements.coupling:
            return tuple(middle)
        return tuple(tuple(row) for row in np.diag(middle).tolist())

    def box(self) -> dict[str, tuple[float, float]]:
        """Return the range of every number that the design does not know, by dotted path."""
        wanted = self.requirements
        axes = len(self.families)
        coupled = wanted.coupling > 0
        found = {
            f"field.q.{i}.{i}" if coupled else f"field.q.{i}": wanted.curvature[i]
            for i in range(axes)
        }
        if coupled:
            pairs = itertools.combinations(range(axes), 2)
            found |= {f"field.q.{i}.{j}": (-wanted.coupling, wanted.coupling) for i, j in pairs}
        found |= dict(wanted.uncertain)
        found |= {
            f"field.source.{f.axis}": (-f.source, f.source) for f in self.families if f.source
        }
        found |= {
            f"{VEHICLE}disturbance.{f.axis}": (-f.force, f.force) for f in self.families if f.force
        }
        return found

    def judged_box(self) -> dict[str, tuple[float, float]]:
        """Return the part of the box on which the orbit's exponents depend.

        Where C integrates, its states take up whatever input holds the vehicle at the source: in
        coordinates about the orbit the equations are the same for every source and force. With a
        pole at 0 they are the same for every source.
        """
        free = set()
        for family in self.families:
            if family.integrators or not any(plant.load for plant in family.vertices):
                free.add(f"field.source.{family.axis}")
            if family.integrators:
                free.add(f"{VEHICLE}disturbance.{family.axis}")
        return {path: ends for path, ends in self.box().items() if path not in free}


def rounded_down(value: float) -> float:
    """Return a positive number cut to four digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return float(f"{math.floor(value / unit) * unit:.4g}")


def is_diagonal(path: str) -> bool:
    """Return whether a path of Q, ``field.q.0`` or ``field.q.0.1``, is on its diagonal."""
    indices = path.split(".")[2:]
    return len(set(indices)) == 1


def centred(controller: GradientES, centre: tuple[float, ...]) -> tuple[float, ...]:
    """Return where a vehicle is at t = 0 whose dither is centred there."""
    dithers: Any = [channel.dither for channel in controller.channels]
    return tuple(c + d.amplitude * math.sin(d.phase) for c, d in zip(centre, dithers, strict=True))


def corners(box: Mapping[str, tuple[float, float]]) -> Iterator[dict[str, float]]:
    """Yield every corner of a box."""
    for ends in itertools.product(*(dict.fromkeys(pair) for pair in box.values())):
        yield dict(zip(box, ends, strict=True))


def centre(box: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Return the middle of a box."""
    return {path: (low + high) / 2 for path, (low, high) in box.items()}


def midpoints(box: Mapping[str, tuple[float, float]]) -> Iterator[dict[str, float]]:
    """Yield the middle of every edge of a box."""
    for path, (low, high) in box.items():
        if low != high:
            others = {name: ends for name, ends in box.items() if name != path}
            for corner in corners(others):
                yield {**corner, path: (low + high) / 2}


def factored(above: Sequence[float], below: Sequence[float]) -> str:
    """Return k Π (s − z)/Π (s − p) as text, complex pairs as quadratics."""
    top, bottom = _factors(above), _factors(below)
    gain = f"{above[0] / below[0]:.4g}"
    if gain != "1" or not top:
        top = [gain, *top]
    if not bottom:
        return " ".join(top)
    under = " ".join(bottom)
    return f"{' '.join(top)}/{under if len(bottom) == 1 else f'({under})'}"


def _factors(coefficients: Sequence[float]) -> list[str]:
    roots = np.roots(coefficients)
    upper = sorted(roots[roots.imag >= 0], key=lambda root: (abs(root), root.real))
    return [_factor(complex(root)) for root in upper]


def _factor(root: complex) -> str:
    size = abs(root)
    if size == 0:
        return "s"
    if abs(root.imag) <= 1e-9 * size:
        return f"(s {'-' if root.real > 0 else '+'} {abs(root.real):.4g})"
    middle = f" {'-' if root.real > 0 else '+'} {2 * abs(root.real):.4g} s"
    return f"(s²{middle if abs(root.real) > 1e-9 * size else ''} + {size**2:.4g})"
