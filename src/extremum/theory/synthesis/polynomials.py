"""Batches of real polynomials, highest power first along the last axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray
from sympy import Expr

from ...symbols import exact, s

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]


def product(*factors: ArrayLike) -> Vector:
    """Return the product of polynomials whose leading dimensions broadcast."""
    return reduce(_times, (np.asarray(f, dtype=float) for f in factors))


def _times(a: Vector, b: Vector) -> Vector:
    if b.shape[-1] > a.shape[-1]:
        a, b = b, a
    size = a.shape[-1] + b.shape[-1] - 1
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    total = np.zeros((*shape, size))
    for k in range(b.shape[-1]):
        total[..., k : k + a.shape[-1]] += b[..., k, None] * a
    return total


def total(a: ArrayLike, b: ArrayLike) -> Vector:
    """Return the sum of two polynomials of any degrees."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    size = max(a.shape[-1], b.shape[-1])
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    found = np.zeros((*shape, size))
    found[..., size - a.shape[-1] :] += a
    found[..., size - b.shape[-1] :] += b
    return found


def at(polynomial: ArrayLike, point: ArrayLike) -> Complex:
    """Return the values at complex points, by Horner; leading dimensions broadcast."""
    coefficients = np.asarray(polynomial)
    where = np.asarray(point, dtype=complex)
    value = np.zeros(np.broadcast_shapes(coefficients.shape[:-1], where.shape), dtype=complex)
    for k in range(coefficients.shape[-1]):
        value = value * where + coefficients[..., k]
    return value


def slope(polynomial: ArrayLike) -> Vector:
    """Return the derivative."""
    coefficients = np.asarray(polynomial, dtype=float)
    degree = coefficients.shape[-1] - 1
    return coefficients[..., :-1] * np.arange(degree, 0, -1)


def expression(coefficients: Sequence[float] | Vector) -> Expr:
    """Return a polynomial in s with exact coefficients."""
    powers = range(len(coefficients) - 1, -1, -1)
    return sympy.Add(*(exact(float(c)) * s**k for c, k in zip(coefficients, powers, strict=True)))


def roots(polynomial: ArrayLike) -> Complex:
    """Return the roots, (…, degree), as eigenvalues of the companion matrices."""
    coefficients = np.asarray(polynomial, dtype=float)
    degree = coefficients.shape[-1] - 1
    matrix = np.zeros((*coefficients.shape[:-1], degree, degree))
    matrix[..., 0, :] = -coefficients[..., 1:] / coefficients[..., :1]
    lower = np.arange(degree - 1)
    matrix[..., lower + 1, lower] = 1.0
    return np.linalg.eigvals(matrix).astype(complex)
