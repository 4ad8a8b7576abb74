from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
import sympy
from sympy import Rational, symbols

from extremum.errors import InvalidDescription
from extremum.symbols import s
from extremum.theory.robustness import characteristic, coupled, hessians
from extremum.theory.robustness.hessians import hessian_eigenvalues, prove_identical
from extremum.theory.robustness.proofs import prove

k = symbols("k")
Matrix = np.ndarray[Any, np.dtype[np.float64]]


def random_range(rng: np.random.Generator, n: int) -> tuple[Matrix, Matrix]:
    ends = np.sort(rng.uniform(-2, 3, (2, n, n)), axis=0)
    low, high = (np.triu(m) + np.triu(m, 1).T for m in ends)
    return low, high


def corners(low: Matrix, high: Matrix) -> list[Matrix]:
    """All symmetric matrices whose entries are ends: 2^(n(n + 1)/2) of them."""
    n = len(low)
    places = [(i, j) for i in range(n) for j in range(i, n)]
    found = []
    for choice in product((low, high), repeat=len(places)):
        matrix = np.empty((n, n))
        for (i, j), ends in zip(places, choice, strict=True):
            matrix[i, j] = matrix[j, i] = ends[i, j]
        found.append(matrix)
    return found


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_eigenvalues_agree_with_all_corners_and_bound_the_inside(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(10 if n < 4 else 4):
        low, high = random_range(rng, n)
        least, most = hessian_eigenvalues(low.tolist(), high.tolist())
        every = np.linalg.eigvalsh(np.array(corners(low, high)))
        assert least == pytest.approx(every.min(), abs=1e-10)
        assert most == pytest.approx(every.max(), abs=1e-10)
        parts = rng.random((200, n, n))
        parts = np.triu(parts) + np.swapaxes(np.triu(parts, 1), 1, 2)
        inside = np.linalg.eigvalsh(low + parts * (high - low))
        assert least <= inside.min()
        assert inside.max() <= most


@pytest.mark.parametrize("outward", [1e-12, 1e-20])
def test_eigenvalues_are_rounded_outward(monkeypatch: pytest.MonkeyPatch, outward: float) -> None:
    """By as much more as it takes: 1e-20 is nothing in floats."""
    monkeypatch.setattr(hessians, "OUTWARD", outward)
    third = Rational(1, 3)
    least, most = hessian_eigenvalues([[1, third], [third, 1]], [[1, third], [third, 1]])  # pyright: ignore[reportArgumentType]
    assert Rational(repr(least)) < Rational(2, 3) < Rational(4, 3) < Rational(repr(most))
    assert most - least == pytest.approx(2 / 3, abs=1e-11)
    assert hessian_eigenvalues([[0.0]], [[0.0]])[0] < 0
    indefinite = hessian_eigenvalues([[1.0, 1.0], [1.0, 1.0]], [[1.0, 1.0], [1.0, 1.0]])
    assert indefinite[0] < 0  # 0 is an eigenvalue: not positive definite


@pytest.mark.parametrize(
    ("low", "high", "match"),
    [
        ([[1.0, 2.0]], [[1.0, 2.0]], "must be square"),
        ([[1.0]], [[1.0, 0.0], [0.0, 1.0]], "of one size"),
        ([[1.0, 2.0], [1.0, 1.0]], [[3.0, 3.0], [3.0, 3.0]], "low = .*must be symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], [[1.0, 1.0], [1.0, 1.0]], r"low\.0\.1 = 2\.0: must not exceed"),
        ([[float("nan")]], [[1.0]], "must be a finite number"),
        (np.eye(9).tolist(), np.eye(9).tolist(), "at most 8 axes"),
        ([], [], "must be square"),
    ],
)
def test_what_is_no_range_of_matrices_is_refused(low: Any, high: Any, match: str) -> None:
    with pytest.raises(InvalidDescription, match=match):
        hessian_eigenvalues(low, high)


# --- identical axes ---------------------------------------------------------------------------

PLANT, COMPENSATOR = 1 / (s - Rational(1, 5)), 1 + 1 / (5 * s)


@pytest.mark.parametrize("width", [0.3, 0.6, 0.9])
def test_identical_axes_agree_with_the_coupled_polynomial(width: float) -> None:
    """λ² + (k − 1/5)λ + k/5 is stable if and only if k > 1/5."""
    q1, q2, q12 = symbols("q1 q2 q12")
    low, high = [[1.0, -width], [-width, 1.0]], [[2.0, width], [width, 2.0]]
    proof = prove_identical(characteristic(PLANT, COMPENSATOR, k), k, low, high)
    both = coupled([PLANT] * 2, [COMPENSATOR] * 2, [[1, 0], [0, 1]], [[q1, q12], [q12, q2]])
    box = {q1: (1.0, 2.0), q2: (1.0, 2.0), q12: (-width, width)}
    assert proof.method == "Hessian eigenvalues"
    assert proof.holds == prove(both, box).holds == (1 - width > 0.2)
    if not proof.holds:
        assert proof.counterexample is not None
        assert proof.counterexample.point[k] < 0.2
        assert "Not true" in proof.statement


def test_identical_axes_share_their_other_numbers() -> None:
    e = symbols("e")
    family = characteristic(1 / (s - e), COMPENSATOR, k)
    low, high = [[1.0, -0.5], [-0.5, 1.0]], [[2.0, 0.5], [0.5, 2.0]]
    assert prove_identical(family, k, low, high, {e: (0.0, 0.49)}).holds
    assert not prove_identical(family, k, low, high, {e: (0.0, 0.51)}).holds
    assert not prove_identical(family, k, low, high, {e: (0.0, 0.49)}, decay=0.2).holds


def test_a_curvature_that_no_matrix_has_refutes_nothing() -> None:
    """Stable at k = 0 and 1, where (1 + k)² > 4/5 + 3k, but not between."""
    family = s**3 + (1 + k) * s**2 + (1 + k) * s + Rational(4, 5) + 3 * k
    apart = prove_identical(family, k, [[0, 0], [0, 1]], [[0, 0], [0, 1]])
    assert not apart.holds
    assert apart.counterexample is None
    assert "Neither proved nor refuted" in apart.statement
    met = prove_identical(family, k, [[0, 0], [0, 0.4]], [[0.6, 0], [0, 1]])
    assert not met.holds
    assert met.counterexample is not None


# --- the polynomials themselves ---------------------------------------------------------------


def test_nothing_cancels_between_plant_and_compensator() -> None:
    half = Rational(1, 2)
    hidden = characteristic(1 / (s - half), (s - half) / (s + 1), 3)
    assert sympy.expand(hidden.as_expr() / hidden.LC() - (s - half) * (s + 4)) == 0
    assert not prove(hidden, {}).holds


def test_letters_below_a_fraction_are_multiplied_out() -> None:
    m, e = symbols("m e")
    found = characteristic(1 / (m * s**2 + e * s), (s + 1) / (s + 4), k)
    assert sympy.expand(found.as_expr() - (m * s**2 + e * s) * (s + 4) - k * (s + 1)) == 0
    assert prove(found, {m: (1.0, 2.0), e: (0.1, 0.3), k: (1.0, 3.0)}).holds


def test_coupled_is_the_determinant_of_the_loop() -> None:
    """Up to a constant, det(I + L(s)) = D⁻¹ · polynomial; an eigenvalue of A is a root."""
    q1, q2, q12 = symbols("q1 q2 q12")
    plants, compensators = [1 / (s - Rational(1, 2)), 1 / s], [1 + Rational(3, 10) / s, 2]
    gains = np.array([[1.0, 0.25], [-0.5, 1.5]])
    family = coupled(plants, compensators, gains.tolist(), [[q1, q12], [q12, q2]])  # pyright: ignore[reportArgumentType]
    q = np.array([[2.0, 0.7], [0.7, 1.2]])
    loop = gains @ q
    states = np.array(  # x₁' = x₁/2 − e₁ − w, w' = 0.3 e₁, x₂' = −2 e₂ with e = K x
        [
            [0.5 - loop[0, 0], -1.0, -loop[0, 1]],
            [0.3 * loop[0, 0], 0.0, 0.3 * loop[0, 1]],
            [-2 * loop[1, 0], 0.0, -2 * loop[1, 1]],
        ]
    )
    numbers = {q1: q[0, 0], q2: q[1, 1], q12: q[0, 1]}
    roots = np.roots([float(x.subs(numbers)) for x in family.all_coeffs()])
    wanted = np.linalg.eigvals(states)
    assert np.sort_complex(roots) == pytest.approx(np.sort_complex(wanted), abs=1e-9)


@pytest.mark.parametrize(
    ("plants", "compensators", "gains", "curvature", "match"),
    [
        ([1 / s], [1, 1], [[1]], [[1]], "for 1 plants"),
        ([1 / s, 1 / s], [1, 1], [[1, 0]], [[1, 0], [0, 1]], "2 × 2"),
        ([1 / s, 1 / s], [1, 1], [[1, 0], [0, 1]], [[1, 2], [3, 1]], "must be symmetric"),
        ([sympy.exp(s)], [1], [[1]], [[1]], "rational function of s"),
    ],
)
def test_what_is_no_loop_is_refused(
    plants: Any, compensators: Any, gains: Any, curvature: Any, match: str
) -> None:
    with pytest.raises(InvalidDescription, match=match):
        coupled(plants, compensators, gains, curvature)
