"""Ranges of Hessians: the eigenvalues of all, and proofs for identical axes that they couple."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sympy import Expr, Poly, Symbol

from ...errors import InvalidDescription, shown
from .families import fraction
from .proofs import Proof, prove

MAX_AXES: Final = 8
"""An n × n range of matrices is bounded by 2ⁿ⁻¹ matrices."""
OUTWARD: Final = 1e-12
"""Eigenvalues are rounded outward by this times the matrix' norm, and then verified."""
CLOSE: Final = 1e-9
"""To which part of its size an eigenvalue is known."""

Matrix = Sequence[Sequence[float]]
Fractions = NDArray[Any]


def hessian_eigenvalues(low: Matrix, high: Matrix) -> tuple[float, float]:
    """Return the smallest and the largest eigenvalue of all symmetric Q with low ≤ Q ≤ high.

    Entry by entry. All such Q are positive definite if and only if the smallest is > 0. It is
    attained where, for some signs z, Q_ij is low for z_i z_j = 1 and high for −1, and Q_ii is low;
    the largest the other way round: 2ⁿ⁻¹ matrices each. Rounded outward by 1e-12 of the norm, and
    so verified in fractions: no eigenvalue lies outside.

    Parameters
    ----------
    low, high
        Symmetric, (axes, axes), of Q or of the Hessian −2Q.

    Raises
    ------
    InvalidDescription
        If they are not symmetric matrices of one size with low ≤ high, of at most 8 axes.

    Source: Hertz (1992), IEEE Transactions on Automatic Control 37(4), 532–535.
    """
    below, above = _checked(low, high)
    return (-_largest(-above, -below), _largest(below, above))


def prove_identical(
    polynomial: Expr | Poly,
    curvature: Symbol,
    low: Matrix,
    high: Matrix,
    box: Mapping[Symbol, tuple[float, float]] | None = None,
    decay: float = 0.0,
) -> Proof:
    """Return a proof for identical axes coupled by any symmetric Q with low ≤ Q ≤ high.

    Where all axes have one G, C, gain c and amplitude α at demodulation M = ½ m α I, the loop is
    Π P(s, λᵢ) over the eigenvalues λᵢ of Q, P being one axis: it suffices to `prove` P with the
    range of the eigenvalues for the curvature. A counterexample is stated only if its curvature is
    an eigenvalue of one of those Q.

    Parameters
    ----------
    polynomial
        P: `characteristic` of one axis, with the letter `curvature` in its gain.
    low, high
        As for `hessian_eigenvalues`.
    box
        (low, high) of what else is uncertain, and the same on all axes.
    decay
        In 1/s.

    Raises
    ------
    InvalidDescription
        As `prove` and `hessian_eigenvalues`.
    """
    limits = {**(box or {}), curvature: hessian_eigenvalues(low, high)}
    proof = prove(polynomial, limits, decay)
    proof = replace(proof, method="Hessian eigenvalues")
    found = proof.counterexample
    if found is None:
        return replace(
            proof, statement=f"{proof.statement} {curvature} is any eigenvalue of the bounded Q."
        )
    value = found.point[curvature]
    if _attained(value, low, high):
        return replace(
            proof, statement=f"{proof.statement} {curvature} is an eigenvalue of a bounded Q."
        )
    return replace(
        proof,
        counterexample=None,
        statement=f"Neither proved nor refuted: the proof needs every {curvature} between the "
        f"eigenvalues' ends, and fails at {value:.6g}, which may be no eigenvalue of a bounded Q.",
    )


def _checked(low: Matrix, high: Matrix) -> tuple[Fractions, Fractions]:
    below, above = (
        np.array([[fraction(name, entry) for entry in row] for row in rows], dtype=object)
        for name, rows in (("low", low), ("high", high))
    )
    n = len(below)
    if not below.shape == above.shape == (n, n) or not 0 < n <= MAX_AXES:
        raise InvalidDescription(
            "low, high",
            f"must be square, of one size, and of at most {MAX_AXES} axes",
            shown((below.shape, above.shape)),
        )
    for name, rows in (("low", below), ("high", above)):
        if (rows != rows.T).any():
            raise InvalidDescription(name, "must be symmetric", shown(rows.astype(float).tolist()))
    for i, j in np.argwhere(below > above):
        raise InvalidDescription(
            f"low.{i}.{j}", "must not exceed high; exchange them", shown(float(below[i, j]))
        )
    return below, above


def _extreme(below: Fractions, above: Fractions) -> list[Fractions]:
    """Return the matrices in which xᵀQx is largest for each choice of the signs of x."""
    found = []
    for signs in product((1, -1), repeat=len(below) - 1):
        z = np.array([1, *signs])
        found.append(np.where(np.outer(z, z) > 0, above, below))
    return found


def _largest(below: Fractions, above: Fractions) -> float:
    candidates = _extreme(below, above)
    eigenvalues = np.linalg.eigvalsh(np.array(candidates, dtype=float))
    norm = float(abs(np.array([below, above], dtype=float)).sum(axis=-1).max())
    outward = OUTWARD * norm or OUTWARD
    while True:
        bound = float(eigenvalues.max()) + outward
        rows = fraction("", bound) * np.identity(len(below), dtype=object)
        if all(_positive_definite(rows - candidate) for candidate in candidates):
            return bound
        outward *= 10


def _positive_definite(matrix: Fractions) -> bool:
    rest = matrix
    while len(rest):
        pivot = rest[0, 0]
        if pivot <= 0:
            return False
        rest = rest[1:, 1:] - np.outer(rest[1:, 0], rest[0, 1:]) / pivot
    return True


def _attained(value: float, low: Matrix, high: Matrix) -> bool:
    """Return whether some Q certainly has this eigenvalue, to rounding.

    The k-th eigenvalue is continuous, so that it takes all values between those it has.
    """
    below, above = _checked(low, high)
    candidates = [*_extreme(below, above), *(-m for m in _extreme(-above, -below))]
    eigenvalues = np.linalg.eigvalsh(np.array(candidates, dtype=float))
    slack = CLOSE * max(1.0, abs(value))
    least, most = eigenvalues.min(axis=0) - slack, eigenvalues.max(axis=0) + slack
    return bool(((least <= value) & (value <= most)).any())
