"""What an averaged axis does under one compensator or many: settling, margins, noise.

All functions take numerators and denominators of C as (…, degree + 1), highest power first, and
loop gains g as (…,); they return (…,).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from . import polynomials as poly
from .family import Family, Plant, closed, pade

Vector = poly.Vector
Complex = poly.Complex

SETTLED: Final = 0.02
"""Settled is within 2 % of the displacement."""
CAUTION: Final = 0.8
"""Part of that to which the averaged loop must settle: a lobe just below may lie above in truth."""
HORIZON: Final = 2.0
"""Wanted settling times over which a response is looked at."""
TIMES: Final = 120
FREQUENCIES: Final = 200
NEARBY: Final = 64


def modes(family: Family, plant: Plant, above: Any, below: Any, gain: Any) -> Complex:
    """Return the roots of P = D D_c D_p + g N N_c N_p (1/s), (…, degree)."""
    return poly.roots(closed(family, plant, above, below, gain))


def responses(
    family: Family, plant: Plant, above: Any, below: Any, gain: Any, times: Vector
) -> tuple[Vector, Vector]:
    """Return how x̃ decays from 1 m, and how it departs from its end under the input 1, in time.

    x̃(t) = Σ Y(λ)/(λ P'(λ)) e^{λt} over the roots of P, Y = D_c D_p (D − D(0)) from a displacement
    at rest and Y = D_c D_p N from an input; (…, times) each.
    """
    polynomial = closed(family, plant, above, below, gain)
    roots = poly.roots(polynomial)
    late = poly.product(below, pade(family.delay)[1])
    weight = _along(late, roots) / (roots * _along(poly.slope(polynomial), roots))
    lifted = plant.denominator.copy()
    lifted[-1] = 0.0
    waves = np.exp(np.clip(roots.real, -np.inf, 1 / times[-1])[..., None] * times) * np.exp(
        1j * roots.imag[..., None] * times
    )
    found = []
    for source in (lifted, plant.numerator):
        residues = weight * poly.at(source, roots)
        found.append(np.einsum("...k,...kt->...t", residues, waves).real)
    return found[0], found[1]


def settling_times(
    family: Family,
    plant: Plant,
    above: Any,
    below: Any,
    gain: Any,
    *,
    wanted: float,
    relative_load: Any,
) -> tuple[Vector, Vector]:
    """Return when x̃ stays within 1.6 % of its displacement r (s), infinite beyond twice `wanted`.

    Once with the integrators charged, once with them empty: then r starts together with the input
    U = `relative_load` r, (…,), that they have to build up to hold the vehicle at the source.
    """
    times = np.linspace(0.0, HORIZON * wanted, TIMES + 1)[1:]
    free, driven = responses(family, plant, above, below, gain, times)
    loaded = np.abs(free) + np.asarray(relative_load)[..., None] * np.abs(driven)
    return _settled(np.abs(free), times), _settled(loaded, times)


def _settled(size: Vector, times: Vector) -> Vector:
    outside = size > CAUTION * SETTLED
    last = len(times) - np.argmax(outside[..., ::-1], axis=-1)
    found = np.where(outside.any(axis=-1), times[np.minimum(last, len(times) - 1)], times[0])
    return np.where(outside[..., -1], np.inf, found)


def frequencies(speed: float, bandwidth: float = 0.0, resonances: Sequence[float] = ()) -> Vector:
    """Return a grid of frequencies (rad/s) for loops of about a speed.

    It holds a bandwidth, what lies just below it, and the neighbourhood of resonances.
    """
    parts = [np.zeros(1), np.geomspace(speed / 50, speed * 3000, FREQUENCIES)]
    if bandwidth:
        parts.append(np.linspace(0.0, bandwidth, NEARBY + 1)[1:])
    for omega in resonances:
        away = np.geomspace(0.003, 0.9, NEARBY // 2)
        parts += [omega * (1 - away), omega * (1 + away)]
    return np.unique(np.concatenate(parts))


def sensitivity(
    family: Family, plant: Plant, above: Any, below: Any, gain: Any, omega: Vector
) -> Complex:
    """Return S(jω) = 1/(1 + L), (…, ω)."""
    points = 1j * omega
    polynomial = closed(family, plant, above, below, gain)
    late = poly.at(poly.product(plant.denominator, pade(family.delay)[1]), points)
    above_axis = poly.at(np.asarray(below)[..., None, :], points)
    return late * above_axis / poly.at(polynomial[..., None, :], points)


def noise_bandwidth(transfer: Complex, omega: Vector) -> Vector:
    """Return ‖T‖₂² = (1/π) ∫ |T(jω)|² dω (rad/s)."""
    return np.trapezoid(np.abs(transfer) ** 2, omega, axis=-1) / math.pi


def highest_passed(transfer: Complex, omega: Vector) -> Vector:
    """Return the highest frequency (rad/s) at which |T(jω)| exceeds 1/√2."""
    open_to = np.abs(transfer) > math.sqrt(0.5)
    last = omega.size - 1 - np.argmax(open_to[..., ::-1], axis=-1)
    return np.where(open_to.any(axis=-1), omega[last], omega[0])


def _along(polynomial: Vector, roots: Complex) -> Complex:
    """Return each polynomial of a batch at its own roots, (…, roots)."""
    value = np.zeros(roots.shape, dtype=complex)
    for k in range(polynomial.shape[-1]):
        value = value * roots + polynomial[..., k, None]
    return value
