"""One axis of a design problem as numbers: its plants, its gains, its loads.

Per axis, with the vehicle G = N/D, the compensator C = N_c/D_c, a dead time T in its Padé form
N_p/D_p and the loop gain g, the averaged loop is P(s) = D D_c D_p + g N N_c N_p = 0. Started at
rest a distance r from the source, under a force d and with the source at x*, it obeys

    x̃(s) = D_c D_p [ (D − D(0)) r + N d − D(0) x* ] / (s P(s)).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...lti import Transfer
from ...rational import ratio
from ...requirements import VEHICLE, Interval, Periodic, Ramp, Requirements
from ..robustness import hessian_eigenvalues
from .polynomials import at, product, total

Vector = NDArray[np.float64]

PACE: Final = 4.0
"""ω over the loop's bandwidth from which the search for ω starts."""
LINEAR: Final = 0.1
"""c q r/ω up to which a displacement r counts as small."""
NODES: Final = {0: 1, 1: 17, 2: 7}
"""Nodes of the lattice along each of so many uncertain numbers; 3 along more."""
BY_INPUT: Final = 0.999
"""Part of its limit below which α is what the input has room for."""
PROBE: Final = 0.7
"""Part of the input that is left after the load which the probe may take."""
WASHOUT: Final = 0.5
"""h/ω: fast enough not to couple with the loop, the reference takes its phase back."""
WASHED: Final = 1 / math.hypot(1, WASHOUT)
"""m = ω/√(ω² + h²), what the washout leaves of the dither."""


@dataclass(frozen=True, eq=False)
class Plant:
    """G = N/D at one point of the box, highest power first, D monic.

    Attributes
    ----------
    numerator, denominator
        N and D.
    heard
        Re G(jω)/G₀(jω): the probe goes through 1/G₀ of the nominal vehicle, so that the position
        moves by G/G₀ times α, of which the reference hears this part.
    """

    numerator: Vector
    denominator: Vector
    heard: float = 1.0

    def response(self, frequency: Any) -> Any:
        """Return G(jω)."""
        point = 1j * np.asarray(frequency, dtype=float)
        return at(self.numerator, point) / at(self.denominator, point)

    @property
    def load(self) -> float:
        """D(0)/N(0): the input that holds the vehicle 1 m away from where it rests without."""
        return float(self.denominator[-1] / self.numerator[-1])

    @property
    def poles(self) -> NDArray[np.complex128]:
        """The poles (1/s)."""
        return np.roots(self.denominator).astype(complex)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """The zeros (1/s)."""
        return np.roots(self.numerator).astype(complex)


@dataclass(frozen=True, eq=False)
class Family:
    """What one axis may be.

    Attributes
    ----------
    axis
        Its index.
    name
        Its letter.
    nominal
        G in the middle of the uncertain numbers' ranges.
    vertices
        G at all their ends.
    gains
        q/√(q_low q_high) at the ends of the curvature's range; with coupled axes, of the range of
        Q's eigenvalues.
    source, force
        |x*| (m) and |d|, their bounds.
    integrators
        How many 1/s the compensator must have.
    resonances
        The frequencies (rad/s) at which it must have a resonator.
    include
        (numerator, denominator) of what it must keep.
    delay
        T (s).
    dither, input
        Limits of α (m) and |u|, infinite where there is none.
    following
        The input (bound) that moves the vehicle with the source.
    lattice
        G over a lattice of the uncertain numbers.
    swing
        max |G(jω)/G₀(jω)| over it: by how much the position may move more than α.
    """

    axis: int
    name: str
    nominal: Plant
    vertices: tuple[Plant, ...]
    gains: tuple[float, float]
    source: float
    force: float
    integrators: int
    resonances: tuple[float, ...]
    include: tuple[Vector, Vector]
    delay: float
    dither: float
    input: float
    following: float
    lattice: tuple[Plant, ...]
    swing: float = 1.0

    def tuned(self, frequency: float) -> Family:
        """Return the family with what a dither at ω = `frequency` (rad/s) makes of each plant."""
        swing = max(abs(self._relative(p, frequency)) for p in self.lattice)
        vertices, lattice = (
            tuple(self.hearing(p, frequency) for p in some)
            for some in (self.vertices, self.lattice)
        )
        return replace(self, vertices=vertices, lattice=lattice, swing=swing)

    def hearing(self, plant: Plant, frequency: float) -> Plant:
        """Return a plant with what is heard of a dither at ω = `frequency` (rad/s)."""
        return replace(plant, heard=self._relative(plant, frequency).real)

    def _relative(self, plant: Plant, frequency: float) -> complex:
        return complex(plant.response(frequency) / self.nominal.response(frequency))

    @property
    def unstable(self) -> float:
        """The largest real part of the plants' poles (1/s), 0 where none is unstable."""
        return max(0.0, *(float(p.real) for plant in self.vertices for p in plant.poles))

    @property
    def heard(self) -> tuple[float, float]:
        """The least and the greatest part of α that the reference hears, over the lattice."""
        found = [p.heard for p in self.lattice]
        return min(found), max(found)

    def amplitude(self, frequency: Any) -> Any:
        """Return the largest α (m) that is allowed, and whose probe α/|G₀(jω)| has room."""
        room = PROBE * (self.input - self.load - self.following)
        return np.minimum(self.dither / self.swing, room * self.passed(frequency))

    def passed(self, frequency: Any) -> Any:
        """Return |G₀(jω)| of the nominal vehicle, through which the probe goes."""
        return np.abs(self.nominal.response(frequency))

    def reach(self, bandwidth: Any, gain: Any) -> Any:
        """Return the displacement r = 0.1 ω/(c q) (m) up to which the loop counts as linear.

        At ω = 4 bandwidths, c q = g/(α m).
        """
        frequency = PACE * np.asarray(bandwidth)
        return LINEAR * WASHED * np.maximum(self.amplitude(frequency), 0) * frequency / gain

    @property
    def sign(self) -> float:
        """The sign that the loop's gain must have."""
        kept = float(self.include[0][-1])
        return math.copysign(1.0, float(self.nominal.numerator[-1])) * (-1.0 if kept < 0 else 1.0)

    @property
    def load(self) -> float:
        """The largest input that holds the vehicle at the source against the force."""
        return max(abs(p.load) for p in self.vertices) * self.source + self.force

    @property
    def key(self) -> Any:
        """What decides the compensator, hashable: axes alike get one alike."""
        plants = (self.nominal, *self.vertices)
        return (
            tuple((tuple(p.numerator), tuple(p.denominator), p.heard) for p in plants),
            *(self.gains, self.load, self.integrators, self.resonances, self.delay),
            *(self.dither, self.input, self.following, self.swing),
            tuple(tuple(part) for part in self.include),
        )


def families(requirements: Requirements) -> tuple[Family, ...]:
    """Return the families of all axes."""
    nominal = requirements.vehicle.replace(middle(requirements)).dynamics()
    source, force = requirements.per_axis("source_distance"), requirements.per_axis("force")
    dither, pushed = requirements.per_axis("dither_limit"), requirements.per_axis("input_limit")
    found = []
    for axis, name in enumerate(requirements.axes()):
        vertices = plants(requirements, axis, 2)
        low, high = requirements.curvature[axis]
        least, most = felt_curvature(requirements, axis)
        nominal_curvature = math.sqrt(low * high)
        found.append(
            Family(
                axis=axis,
                name=name,
                nominal=plant_of(nominal[axis]),
                vertices=vertices,
                gains=(least / nominal_curvature, most / nominal_curvature),
                source=source[axis],
                force=force[axis],
                integrators=_integrators(vertices, requirements, force[axis]),
                resonances=_resonances(requirements),
                include=_included(requirements, axis),
                delay=requirements.delay,
                dither=dither[axis],
                input=math.inf if pushed[axis] is None else pushed[axis],
                following=max(_following(p, requirements) for p in vertices),
                lattice=plants(
                    requirements, axis, NODES.get(len(uncertain(requirements, axis)), 3)
                ),
            )
        )
    return tuple(found)


def plants(requirements: Requirements, axis: int, count: int) -> tuple[Plant, ...]:
    """Return G over a lattice of its uncertain numbers, `count` from end to end of each range."""
    vehicle = requirements.vehicle
    ranges = uncertain(requirements, axis)
    mine = {path.removeprefix(VEHICLE): ends for path, ends in ranges.items()}
    lattice = itertools.product(*(np.unique(np.linspace(*ends, count)) for ends in mine.values()))
    usual = middle(requirements)
    points = [usual | dict(zip(mine, map(float, node), strict=True)) for node in lattice]
    return tuple(plant_of(vehicle.replace(point).dynamics()[axis]) for point in points)


def uncertain(requirements: Requirements, axis: int) -> dict[str, Interval]:
    """Return the ranges of an axis' uncertain numbers, by dotted path."""
    start = f"{VEHICLE}axes.{axis}."
    return {path: e for path, e in requirements.uncertain.items() if path.startswith(start)}


def middle(requirements: Requirements) -> dict[str, float]:
    """Return the middle of every uncertain number's range, by its path in the vehicle."""
    return {
        path.removeprefix(VEHICLE): (low + high) / 2
        for path, (low, high) in requirements.uncertain.items()
    }


def felt_curvature(requirements: Requirements, axis: int) -> tuple[float, float]:
    """Return the range of the curvature that one axis' loop is shaped for (1/m²).

    Where axes are coupled, that of the eigenvalues of all the Hessians: what axes that are alike
    feel.
    """
    if not requirements.coupling:
        return requirements.curvature[axis]
    return hessian_eigenvalues(*hessian_bounds(requirements))


def hessian_bounds(requirements: Requirements) -> tuple[list[list[float]], list[list[float]]]:
    """Return the least and the greatest entries of Q, (axes, axes) each."""
    bounds = []
    for end, sign in ((0, -1.0), (1, 1.0)):
        matrix = np.full((len(requirements.curvature),) * 2, sign * requirements.coupling)
        np.fill_diagonal(matrix, [ends[end] for ends in requirements.curvature])
        bounds.append(matrix.tolist())
    return bounds[0], bounds[1]


def plant_of(law: Any) -> Plant:
    """Return a transfer function without letters as a plant."""
    form = ratio(law)
    numerator, denominator = ([float(c) for c in cs] for cs in (form.numerator, form.denominator))
    return Plant(np.array(numerator), np.array(denominator))


def poles_at_origin(plants: tuple[Plant, ...]) -> int:
    """Return how many poles at 0 all plants have for certain."""
    counts = [len(p.denominator) - 1 - np.flatnonzero(p.denominator)[-1] for p in plants]
    return int(min(counts))


def _integrators(plants: tuple[Plant, ...], wanted: Requirements, force: float) -> int:
    """Return how many integrators C needs: for the source's motion, and for a force."""
    constant = int(wanted.zero_bias)
    kind = constant + isinstance(wanted.motion, Ramp)
    return max(kind - poles_at_origin(plants), constant * (force > 0), 0)


def _following(plant: Plant, wanted: Requirements) -> float:
    """Return the input that moves the vehicle with the source, besides what holds it at a place.

    |x̂/G(jΩ)| for a sine of amplitude x̂; the constant part of D(p)(vt)/N(p) for a velocity v.
    """
    motion = wanted.motion
    if isinstance(motion, Periodic):
        sizes = 1 / np.abs(plant.response(np.array(motion.frequencies())))
        return motion.amplitude * float(sizes.max())
    if isinstance(motion, Ramp):
        (n1, n0), (d1, d0) = (_last_two(p) for p in (plant.numerator, plant.denominator))
        return motion.velocity * abs(d1 - n1 * d0 / n0) / abs(n0)
    return 0.0


def _last_two(polynomial: Vector) -> tuple[float, float]:
    first, last = np.concatenate([[0.0], polynomial])[-2:]
    return float(first), float(last)


def _resonances(requirements: Requirements) -> tuple[float, ...]:
    motion = requirements.motion
    return motion.frequencies() if isinstance(motion, Periodic) else ()


def _included(requirements: Requirements, axis: int) -> tuple[Vector, Vector]:
    if requirements.include is None:
        return np.ones(1), np.ones(1)
    factor: Transfer = requirements.include[axis]
    plant = plant_of(factor.law())
    return plant.numerator, plant.denominator


def pade(delay: float, order: int = 2) -> tuple[Vector, Vector]:
    """Return e^{−sT} ≈ N_p/D_p, Padé's of equal orders n: the all-pass with D_p monic.

    D_p = Σ (2n − k)!/(k! (n − k)!) (sT)ᵏ and N_p(s) = D_p(−s), divided by Tⁿ.
    """
    if delay == 0:
        return np.ones(1), np.ones(1)
    weights = [
        math.factorial(2 * order - k) / (math.factorial(k) * math.factorial(order - k))
        for k in range(order, -1, -1)
    ]
    below = np.array(weights) / delay ** np.arange(order + 1.0)
    signs = (-1.0) ** np.arange(order, -1.0, -1.0)
    return below * signs, below


def closed(family: Family, plant: Plant, above: Vector, below: Vector, gain: Any) -> Vector:
    """Return P = D D_c D_p + g m N N_c N_p for compensators and gains, m what is heard of α."""
    early, late = pade(family.delay)
    loop = product(plant.numerator, above, early) * (np.asarray(gain) * plant.heard)[..., None]
    return total(product(plant.denominator, below, late), loop)
