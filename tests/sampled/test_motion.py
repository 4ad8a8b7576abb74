"""The motion between samples against SciPy's matrix exponential and mpmath's."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from extremum.sampled.motion import exponential


def generator(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[[A, B], [0, 0]]"""
    order, inputs = b.shape
    whole = np.zeros((order + inputs, order + inputs))
    whole[:order, :order], whole[:order, order:] = a, b
    return whole


def test_exponentials_are_scipys() -> None:
    """Of sizes from 1e-6 to 30, one by one and together."""
    random = np.random.default_rng(1)
    for order, inputs in ((1, 1), (2, 1), (3, 2), (5, 1)):
        sizes = np.geomspace(1e-6, 30 / order, 20)
        many = np.stack(
            [
                generator(
                    size * random.normal(size=(order, order)), random.normal(size=(order, inputs))
                )
                for size in sizes
            ]
        )
        found = exponential(many, order)
        for one, matrix in zip(found, many, strict=True):
            expected = expm(matrix)
            assert np.abs(one - expected).max() < 2e-12 * np.abs(expected).max()
            assert np.array_equal(exponential(matrix[None], order)[0], one)


@pytest.mark.parametrize("tau", [1e-6, 1e-3, 10.0])
def test_stiff_lags_keep_their_digits(tau: float) -> None:
    """A force-actuated axis with drag behind a lag, over 2 ms; 50 digits from mpmath."""
    a = np.array([[0, 1, 0], [0, -0.7, 1], [0, 0, -1 / tau]])
    matrix = generator(a, np.array([[0], [0], [1 / tau]])) * 2e-3
    with mpmath.workdps(50):
        exact = mpmath.expm(mpmath.matrix(matrix.tolist()))
        expected = np.array(exact.tolist(), dtype=float)
    found = exponential(matrix[None], 3)[0]
    assert found == pytest.approx(expected, rel=1e-11, abs=1e-300 if tau > 1e-4 else 1e-15)
