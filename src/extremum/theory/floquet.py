"""Floquet and Lyapunov exponents, from transition matrices over consecutive segments.

Over one period T the monodromy matrix is M = Φ_m … Φ₂ Φ₁; its eigenvalues are the multipliers μ,
and λ = ln(μ)/T the exponents, whose imaginary part is known modulo 2π/T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

SPREAD: Final = np.log(1e4)
"""Ratio of the multipliers within which they are taken from one block of the monodromy matrix."""

NEUTRAL: Final = 1e-9
"""A real part within this of 0, relative to the largest mode, is 0 to rounding."""

SETTLED: Final = 1e-13
MAX_SWEEPS: Final = 60


def exponents(factors: ArrayLike, period: float) -> Complex:
    """Return the Floquet exponents λ = ln(μ)/T, μ the eigenvalues of Φ_m … Φ₂ Φ₁.

    Parameters
    ----------
    factors
        Φ over consecutive segments that make up one period, the first first, (m, n, n). None of
        them should shrink one direction against another by more than 1e4 or so.
    period
        T (s).

    Returns
    -------
    NDArray
        (n,), complex (1/s), the largest real part first. The imaginary part is the principal one,
        in (−π/T, π/T]. A mode that shrinks by more than 1e-16 within one factor is only known to
        be as fast as that.

    Notes
    -----
    A single factor is decomposed as Φ − I, with log1p, as λT may be tiny. A product is never
    formed where its eigenvalues differ much: orthogonal iteration with a QR decomposition at every
    factor turns it into a block triangular one, each block with multipliers that differ by at most
    1e4 (complex pairs and clusters stay together), and each block's product is scaled. So
    multipliers of 1e-57 beside 1 have full relative accuracy. After Bojanczyk, Golub and
    Van Dooren, "The periodic Schur decomposition" (1992).
    """
    cycle = _balanced(np.asarray(factors, dtype=float))
    if len(cycle) == 1:
        logs = _logs(cycle[0] - np.eye(cycle.shape[1]))
    else:
        logs = np.concatenate(_block_logs(cycle))
    found = logs / period
    return found[np.lexsort((-found.imag, -found.real))]


def monodromy(factors: ArrayLike) -> Vector:
    """Return Φ_m … Φ₂ Φ₁, right in its large multipliers; see `exponents` for the small ones."""
    cycle = np.asarray(factors, dtype=float)
    product = np.eye(cycle.shape[1])
    for factor in cycle:
        product = factor @ product
    return product


def leading(factors: ArrayLike, period: float) -> float:
    """Return the largest real part of the exponents (1/s); much faster than all of them."""
    increment = monodromy(factors) - np.eye(np.shape(factors)[1])
    return float(_logs(increment).real.max()) / period


def decays(modes: Complex) -> bool:
    """Return whether every real part is negative; one that is 0 to rounding is not."""
    size = float(np.abs(modes).max(initial=0.0))
    return len(modes) > 0 and bool(modes.real.max() < -NEUTRAL * size)


def multipliers(found: Complex, period: float) -> Complex:
    """Return μ = e^{λT}; those below 1e-308 underflow to 0."""
    return np.exp(found * period)


def _logs(increment: Vector) -> Complex:
    """Return ln(1 + d) for the eigenvalues d of M − I; of M's zeros, that of the smallest float."""
    d: Complex = np.linalg.eigvals(increment).astype(complex)
    size = np.maximum(np.abs(1 + d), np.finfo(float).tiny)
    near = 0.5 * np.log1p(np.maximum(2 * d.real + d.real**2 + d.imag**2, -0.75))
    return np.where(size < 0.5, np.log(size), near) + 1j * np.arctan2(d.imag, 1 + d.real)


def _balanced(cycle: Vector) -> Vector:
    """Return D⁻¹ Φ D of every factor, D of powers of 2: states whose units differ by 1e18 agree."""
    from scipy.linalg import matrix_balance

    sizes = np.abs(cycle).max(axis=0)
    if not np.isfinite(sizes).all():
        return cycle
    scale = matrix_balance(sizes, permute=False, separate=True)[1][0]
    return cycle * scale / scale[:, None]


def _block_logs(cycle: Vector) -> list[Complex]:
    count = cycle.shape[1]
    basis = np.linalg.qr(np.random.default_rng(0).standard_normal((count, count)))[0]
    sweep = 0
    while True:
        first, triangles = basis, []
        for factor in cycle:
            basis, triangle = np.linalg.qr(factor @ basis)
            triangles.append(triangle)
        turn = first.T @ basis
        edges = [k for k in range(1, count) if np.abs(turn[k:, :k]).max() < SETTLED]
        blocks = [slice(*pair) for pair in pairwise([0, *edges, count])]
        scaled = [_scaled_product(triangles, block) for block in blocks]
        sweep += 1
        if sweep == MAX_SWEEPS or all(_spread(product) < SPREAD for product, _ in scaled):
            return [
                _logs(turn[block, block] @ product - np.eye(len(product))) + scale
                for block, (product, scale) in zip(blocks, scaled, strict=True)
            ]


def _scaled_product(triangles: Sequence[Vector], block: slice) -> tuple[Vector, float]:
    """Return the product of the blocks with its diagonal's mean size brought to 1, and its log."""
    size = block.stop - block.start
    product, scale = np.eye(size), 0.0
    for triangle in triangles:
        product = triangle[block, block] @ product
        unit = float(np.abs(product).max()) or 1.0
        product, scale = product / unit, scale + np.log(unit)
    centre = float(_sizes(product).mean())
    return product * np.exp(-centre), scale + centre


def _spread(product: Vector) -> float:
    sizes = _sizes(product)
    return float(sizes.max() - sizes.min())


def _sizes(product: Vector) -> Vector:
    """Return the logs of the diagonal's entries; of zeros, that of the smallest float."""
    return np.log(np.maximum(np.abs(np.diag(product)), np.finfo(float).tiny))


@dataclass(frozen=True)
class Match:
    """Averaged eigenvalues and Floquet exponents, paired mode by mode modulo jω.

    Attributes
    ----------
    averaged, exponents
        (n,), complex (1/s): the averaged eigenvalues, and beside each the exponent paired with it,
        its imaginary part shifted by the multiple of ω that brings it nearest.
    distances
        |λ − λ_averaged| of each pair (1/s), (n,).
    polynomial
        Largest relative difference of the coefficients of the two characteristic polynomials, in
        (μ − 1)/T with T = 2π/ω: it goes to zero as 1/ω even where single eigenvalues of a cluster
        or a Jordan block of size m converge with the power 1/m only.
    """

    averaged: Complex
    exponents: Complex
    distances: Vector
    polynomial: float

    @property
    def pairs(self) -> tuple[tuple[complex, complex], ...]:
        """(averaged eigenvalue, exponent) for each mode."""
        return tuple(zip(self.averaged.tolist(), self.exponents.tolist(), strict=True))

    @property
    def worst(self) -> float:
        """The largest distance (1/s)."""
        return float(self.distances.max(initial=0.0))


def match(averaged: ArrayLike, found: ArrayLike, frequency: float) -> Match:
    """Pair averaged eigenvalues with Floquet exponents so that the distances' sum is least.

    Parameters
    ----------
    averaged, found
        Averaged eigenvalues and exponents, (n,) each (1/s).
    frequency
        ω = 2π/T (rad/s), the multiple modulo which imaginary parts are known.

    Notes
    -----
    The assignment is optimal (Hungarian method). For how fast the distances vanish as ω grows see
    `Match.polynomial`.
    """
    ours: Complex = np.asarray(averaged, dtype=complex)
    theirs: Complex = np.asarray(found, dtype=complex)
    beside, distances = nearest(ours, theirs, frequency)
    period = 2 * np.pi / frequency
    return Match(ours, beside, distances, polynomial_distance(ours, theirs, period))


def nearest(averaged: Complex, found: Complex, frequency: float) -> tuple[Complex, Vector]:
    """Return an exponent beside each averaged eigenvalue, and their distances (1/s), (n,) each.

    There may be more exponents than eigenvalues; none is taken twice, and the distances' sum is
    least. Imaginary parts are shifted by the multiple of `frequency` that brings them nearest.
    """
    from scipy.optimize import linear_sum_assignment

    difference: Complex = found[None, :] - averaged[:, None]
    turns = np.round(difference.imag / frequency)
    distance = np.abs(difference - 1j * frequency * turns)
    rows, columns = linear_sum_assignment(distance)
    return found[columns] - 1j * frequency * turns[rows, columns], distance[rows, columns]


def polynomial_distance(averaged: ArrayLike, found: ArrayLike, period: float) -> float:
    """Return the largest relative difference of two characteristic polynomials of e^{λT}.

    They are taken in s = (μ − 1)/T, μ = e^{λT}, in which a slow loop's roots do not crowd at 1;
    the coefficient of s^{n−k} is divided by C(n, k) |s|ᵏ, |s| the largest root.
    """
    roots = [np.expm1(np.asarray(a, dtype=complex) * period) / period for a in (averaged, found)]
    ours, theirs = (np.poly(r) for r in roots)
    size = max(float(np.abs(np.concatenate(roots)).max(initial=0.0)), np.finfo(float).tiny)
    count = len(ours) - 1
    usual = np.poly(np.full(count, -1.0)) * size ** np.arange(count + 1.0)
    return float(np.abs((theirs - ours) / usual).max())


def growth(factors: ArrayLike, basis: Vector) -> tuple[Vector, Vector]:
    """Return how much each direction grows, and the directions at the end.

    The logs of |r_ii| of QR decompositions, summed over the factors, (n,); divided by the time they
    tend to the Lyapunov exponents, the largest first, as the window grows.

    Parameters
    ----------
    factors
        Transition matrices over consecutive segments, (m, n, n).
    basis
        Orthogonal directions at the start, (n, n): from an earlier stretch, or the identity.
    """
    total = np.zeros(len(basis))
    for factor in np.asarray(factors, dtype=float):
        basis, triangle = np.linalg.qr(factor @ basis)
        total += np.log(np.abs(np.diag(triangle)))
    return total, basis
