from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import pytest
import sympy
from sympy import Expr, Rational, Symbol, symbols

from extremum.errors import InvalidDescription
from extremum.symbols import s
from extremum.theory.robustness import proofs, separation
from extremum.theory.robustness.proofs import Proof, largest_decay, prove
from extremum.theory.robustness.separation import Part

a, b, c = symbols("a b c")
Box = dict[Symbol, tuple[float, float]]
CLOSE = 1e-6
TOUCHING = s**3 + (1 + a) * s**2 + (1 + a) * s
"""With c₀ + c₁a added, stable if and only if (1 + a)² > c₀ + c₁a > 0 (Routh)."""


def numbers(polynomial: Expr, point: Mapping[Symbol, float]) -> list[float]:
    """Return the coefficients at a point, the highest power of s first."""
    table = {letter: sympy.Float(value) for letter, value in point.items()}
    return [float(x.xreplace(table)) for x in sympy.Poly(polynomial, s).all_coeffs()]


def slowest(polynomial: Expr, point: Mapping[Symbol, float]) -> float:
    """Return the largest Re λ of the polynomial at a point, by NumPy's companion matrix."""
    return float(np.roots(numbers(polynomial, point)).real.max())


def slowest_of(polynomial: Expr, box: Box, points: int = 400, seed: int = 0) -> float:
    """Return the largest Re λ seen over the box: at random points, and along all its edges."""
    letters = list(box)
    low, high = (np.array([box[p][i] for p in letters]) for i in (0, 1))
    parts = np.random.default_rng(seed).random((points, len(box)))
    edges = [
        (*corner[:axis], part, *corner[axis + 1 :])
        for axis in range(len(box))
        for corner in product((0.0, 1.0), repeat=len(box))
        for part in np.linspace(0, 1, 41)
    ]
    where = low + (high - low) * np.vstack([parts, np.array(edges)])
    compiled = sympy.lambdify(letters, sympy.Poly(polynomial, s).all_coeffs(), "numpy")
    table = np.stack([np.broadcast_to(x, len(where)) for x in compiled(*where.T)], axis=1)
    return max(float(np.roots(row).real.max()) for row in table)


def assert_genuine(proof: Proof, polynomial: Expr, box: Box) -> None:
    """The point lies in the box, the root is one of it, and it is too slow."""
    found = proof.counterexample
    assert found is not None
    assert not proof.holds
    for letter, (low, high) in box.items():
        assert low - 1e-12 <= found.point[letter] <= high + 1e-12
    assert abs(np.roots(numbers(polynomial, found.point)) - found.root).min() < 1e-5 * max(
        1, abs(found.root)
    )
    assert found.root.real >= -proof.decay
    assert "Not true" in proof.statement
    assert f"{found.root.real:.6g}" in str(proof)


def random_stable(rng: np.random.Generator, degree: int) -> Any:
    found = np.array([1.0])
    while len(found) <= degree:
        if len(found) < degree and rng.random() < 0.6:
            real, size = rng.uniform(0.1, 2), rng.uniform(0.3, 3)
            found = np.convolve(found, (1, real, size))
        else:
            found = np.convolve(found, (1, rng.uniform(0.2, 3)))
    return found


def random_affine(rng: np.random.Generator, letters: tuple[Symbol, ...], size: float) -> Expr:
    degree = int(rng.integers(2, 6))
    nominal = random_stable(rng, degree)
    found = sum((float(x) * s ** (degree - i) for i, x in enumerate(nominal)), sympy.Integer(0))
    for letter in letters:
        change = size * nominal * rng.uniform(-1, 1, degree + 1)
        change[0] *= 0.3
        found += letter * sum(float(x) * s ** (degree - i) for i, x in enumerate(change))
    return found


# --- the edge theorem -------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("decay", [0.0, 0.05])
def test_affine_families_are_decided_and_rightly(size: float, decay: float) -> None:
    rng = np.random.default_rng([round(100 * size), round(100 * decay)])
    verdicts = []
    for seed in range(25):
        letters = (a, b, c)[: int(rng.integers(1, 4))]
        family = random_affine(rng, letters, size)
        box: Box = dict.fromkeys(letters, (-1.0, 1.0))
        proof = prove(family, box, decay)
        verdicts.append(proof.holds)
        assert proof.method == "edge theorem"
        if proof.holds:
            assert slowest_of(family, box, seed=seed) < -decay + CLOSE
            assert proof.counterexample is None
            assert proof.tested == 2 ** (len(letters) - 1) * len(letters)
        else:
            assert_genuine(proof, family, box)
    assert set(verdicts) == {True, False} or size == 0.1


@pytest.mark.parametrize("degree", [3, 4, 5])
def test_interval_polynomials_agree_with_kharitonov(degree: int) -> None:
    """Kharitonov: all are stable iff four are, their coefficients low low high high, shifted."""
    rng = np.random.default_rng(degree)
    letters = symbols(f"p0:{degree + 1}")
    family = sum((p * s**i for i, p in enumerate(letters)), sympy.Integer(0))
    verdicts = set()
    for _ in range(12 if degree < 5 else 6):
        nominal = random_stable(rng, degree)[::-1] * rng.uniform(1, 2)
        width = rng.uniform(0.02, 0.3)
        ends = np.stack([nominal * (1 - width), nominal * (1 + width)])
        four = [
            [ends[pattern[i % 4], i] for i in range(degree, -1, -1)]
            for pattern in ((0, 0, 1, 1), (1, 1, 0, 0), (1, 0, 0, 1), (0, 1, 1, 0))
        ]
        worst = max(float(np.roots(p).real.max()) for p in four)
        assert abs(worst) > CLOSE
        box = {p: (float(x), float(y)) for p, (x, y) in zip(letters, ends.T, strict=True)}
        assert prove(family, box).holds == (worst < 0)
        verdicts.add(worst < 0)
    assert verdicts == {True, False}


def test_stable_corners_do_not_make_a_stable_edge() -> None:
    family = TOUCHING + Rational(4, 5) + 3 * a
    box: Box = {a: (0.0, 1.0)}
    assert slowest(family, {a: 0}) < 0
    assert slowest(family, {a: 1}) < 0
    proof = prove(family, box)
    assert_genuine(proof, family, box)
    assert proof.counterexample is not None
    assert 0.1 < proof.counterexample.point[a] < 0.9


@pytest.mark.parametrize("decay", [0.0, 0.3])
def test_an_edge_is_decided_to_the_last_digit(decay: float) -> None:
    """(1 + a)² − 8/9 − 8a/3 = (a − 1/3)²: at a = 1/3 two roots touch Re λ = −decay."""
    touching = TOUCHING + Rational(8, 9) + Rational(8, 3) * a
    shifted = touching.subs(s, s + Rational(str(decay)))
    box: Box = {a: (0.0, 1.0)}
    refused = prove(shifted, box, decay)
    assert not refused.holds
    assert refused.counterexample is not None
    assert refused.counterexample.point[a] == pytest.approx(1 / 3, abs=1e-6)
    assert refused.counterexample.root == pytest.approx(-decay + (4 / 3) ** 0.5 * 1j, abs=1e-6)
    little = Rational(1, 10**40)
    assert prove(sympy.expand(shifted - little), box, decay).holds
    assert not prove(sympy.expand(shifted + little), box, decay).holds


def test_floats_are_the_decimals_that_they_state() -> None:
    """λ + 3 · 0.1 − 0.3 has its root at 0, which floats do not say."""
    assert 3 * 0.1 != 0.3
    assert not prove(s + 3 * a - 0.3, {a: (0.1, 1.0)}).holds
    assert prove(s + (3 + Rational(1, 10**30)) * a - 0.3, {a: (0.1, 1.0)}).holds
    assert not prove(s + a, {a: (0.1, 1.0)}, 0.1).holds
    assert prove(s + a, {a: (0.1, 1.0)}, 0.0999999999999999).holds


def test_a_leading_coefficient_that_vanishes_is_refused() -> None:
    crossing = prove(a * s + 1, {a: (-1.0, 2.0)})
    assert_genuine(crossing, a * s + 1, {a: (-1.0, 2.0)})
    for family in (a * s + 1, a * b * s + 1, a**2 * s + 1):
        at_the_end = prove(family, {a: (0.0, 2.0), b: (1.0, 2.0)})
        assert not at_the_end.holds
        assert at_the_end.counterexample is None
        assert "leading coefficient" in at_the_end.statement
    assert prove(-s * (1 + a) - 1, {a: (0.0, 2.0)}).holds


def test_no_uncertain_number_leaves_routh() -> None:
    family = (s + 2) * (s**2 + a * s + 4)
    box: Box = {a: (1.0, 1.0), b: (0.0, 5.0)}
    proof = prove(family, box, 0.49)
    assert proof.holds
    assert proof.method == "Routh's array"
    refuted = prove(family, box, 0.5)
    assert_genuine(refuted, family, {a: (1.0, 1.0)})
    assert refuted.counterexample is not None
    assert refuted.counterexample.point == {a: 1.0, b: 0.0}
    assert 0.498 < largest_decay(family, box).decay < 0.5


# --- the mapping theorem and the Bernstein expansion ------------------------------------------


def random_entangled(rng: np.random.Generator, squares: bool) -> Expr:
    """Two loops (s + …)(s² + …) with uncertain gains, coupled."""
    x, y, z, w = (round(float(v), 3) for v in rng.uniform(0.2, 2.0, 4))
    coupling = float(rng.uniform(0, 1.5))
    first, second = s**2 + x * s + (y + a) * (s + 1), s**2 + z * s + (w + b) * (s + 2) * 0.5
    return sympy.expand(first * second - (c**2 if squares else c * a) * coupling * (s + 1))


@pytest.mark.parametrize("squares", [False, True])
def test_entangled_families_are_never_proved_wrongly(squares: bool) -> None:
    rng = np.random.default_rng(int(squares))
    verdicts = []
    for seed in range(30):
        family = random_entangled(rng, squares)
        box: Box = {
            letter: (float(low), float(low + width))
            for letter, low, width in zip(
                (a, b, c), rng.uniform(-0.5, 1, 3), rng.uniform(0.2, 2, 3), strict=True
            )
        }
        proof = prove(family, box)
        assert proof.method == ("Bernstein expansion" if squares else "mapping theorem")
        worst = slowest_of(family, box, seed=seed)
        if proof.holds:
            assert worst < CLOSE
            assert proof.tested > 0
        elif proof.counterexample:
            assert_genuine(proof, family, box)
        else:
            assert abs(worst) < 0.01  # left open only where the margin is small
        verdicts.append((proof.holds, proof.counterexample is None))
    assert {(True, True), (False, False)} <= set(verdicts)
    assert verdicts.count((False, True)) <= 2


def test_where_the_mapping_theorem_is_conservative_the_box_is_cut() -> None:
    """Every member is a product of stable factors, the mean of two corners' is not stable."""
    family = sympy.expand((s**2 + s / 10 + a) * (s**2 + s / 10 + b))
    box: Box = {a: (1.0, 4.0), b: (1.0, 4.0)}
    mean = (family.subs({a: 1, b: 1}) + family.subs({a: 4, b: 4})) / 2
    assert slowest(mean, {}) > 0.1
    proof = prove(family, box)
    assert proof.holds
    assert "parts of the box" in proof.statement
    assert proof.tested > 4
    assert prove(family, box, 0.03).holds
    assert_genuine(prove(family, box, 0.05), family, box)


def test_what_floats_take_for_stable_is_not_proved() -> None:
    """At a = b = −1 the root is +4e-18; in floats, where 1 + 1.12e-16 is 1 + 2.22e-16, −4e-16."""
    above, total = 1 + Rational("1.12e-16"), 3 + Rational("3.4e-16")
    family = s + above * (a * b - a - b) - total
    box: Box = {a: (-1.5, -1.0), b: (-1.5, -1.0)}
    assert sympy.Poly(family.subs({a: -1, b: -1}), s).all_coeffs()[1] < 0
    assert 3 * float(above) > float(total)
    assert not prove(family, box).holds
    assert prove(family + Rational("1e-17"), box).holds


@pytest.mark.parametrize(
    ("family", "separating"),
    [
        (s - 1 - a, [1]),  # all unstable: no edge crosses
        (s - 1 - a * b, [1, -1]),  # all unstable, and apart from 0 with C = s − 1
        (s + (3 * a - 1) * (3 * b - 1), [1, 1]),  # the first corner, s + 1, is stable
        (s + a * b, [1, 1]),  # a root at 0
    ],
)
def test_floats_only_propose(
    monkeypatch: pytest.MonkeyPatch, family: Expr, separating: list[int]
) -> None:
    """Whatever is seen and proposed in floats, integers decide."""

    def propose(_: Part) -> list[Fraction]:
        return [Fraction(x) for x in separating]

    monkeypatch.setattr(Part, "separable", True)
    monkeypatch.setattr(Part, "separating", propose)
    for module in (proofs, separation):
        monkeypatch.setattr(module, "unstable", lambda *_: None)
    monkeypatch.setattr(proofs, "MAX_PARTS", 4)
    assert not prove(family, {a: (0.0, 1.0), b: (0.0, 1.0)}).holds


def test_what_stays_open_is_said_to_be_open() -> None:
    """The root −(a − 1/3)² is 0 at a point that no cutting in two meets."""
    touching = s + (a - Rational(1, 3)) ** 2
    proof = prove(touching, {a: (0.0, 1.0)})
    assert not proof.holds
    assert proof.counterexample is None
    assert "Neither proved nor refuted" in proof.statement
    assert prove(touching + Rational(1, 1000), {a: (0.0, 1.0)}).holds
    below = touching - Rational(1, 1000)
    assert_genuine(prove(below, {a: (0.0, 1.0)}), below, {a: (0.0, 1.0)})


def test_a_square_may_change_sign_with_its_letter() -> None:
    family = s + a**2 - a / 2 + b
    assert prove(family, {a: (-1.0, 1.0), b: (0.07, 1.0)}).holds  # −1/16 at a = 1/4
    assert not prove(family, {a: (-1.0, 1.0), b: (0.06, 1.0)}).holds


# --- the largest decay rate -------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_the_largest_decay_is_the_slowest_root(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    family = random_affine(rng, (a, b), 0.15)
    box: Box = {a: (-1.0, 1.0), b: (-0.5, 1.0)}
    worst = slowest_of(family, box, points=100)
    proof = largest_decay(family, box)
    if worst > 0:
        assert not proof.holds
        assert_genuine(proof, family, box)
    else:
        assert proof.holds
        assert 0.99 * -worst - CLOSE < proof.decay < -worst


def test_the_largest_decay_of_an_entangled_family() -> None:
    family = sympy.expand((s + a) * (s + b) * (s + 3) - Rational(1, 4) * c**2 * (s + 3))
    box: Box = {a: (1.0, 3.0), b: (1.0, 3.0), c: (-1.0, 1.0)}
    proof = largest_decay(family, box)
    assert proof.holds
    assert proof.method == "Bernstein expansion"
    assert 0.498 < proof.decay < 0.5  # eigenvalues of ((1, c/2), (c/2, 1))


def test_no_decay_is_no_proof() -> None:
    proof = largest_decay(s + a, {a: (0.0, 1.0)})
    assert not proof.holds
    assert proof.decay == 0
    assert_genuine(proof, s + a, {a: (0.0, 1.0)})


# --- descriptions -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("polynomial", "box", "match"),
    [
        (s + a, {}, "box: states no range of a"),
        (s + a, {Symbol("a", real=True): (0, 1)}, "other assumptions"),
        (s + sympy.pi, {}, "rational numbers"),
        (1 / s + a, {a: (0, 1)}, "must be a polynomial"),
        (s + 1 / a, {a: (1, 2)}, "must be a polynomial"),
        (a + 1, {a: (1, 2)}, "does not depend on s"),
        ("s + 1", {}, "SymPy expression"),
        (s + a, {a: (2, 1)}, r"box\.a = \(2, 1\): must be \(low, high\); write \(1, 2\)"),
        (s + a, {a: (0, float("inf"))}, r"box\.a = inf: must be a finite number"),
        (s + a, {a: 3}, r"box\.a = 3: must be \(low, high\)"),
        (s + sum(symbols("p0:13")), dict.fromkeys(symbols("p0:13"), (0, 1)), "8,192"),
    ],
)
def test_what_is_no_family_is_refused(polynomial: Any, box: Any, match: str) -> None:
    with pytest.raises(InvalidDescription, match=match):
        prove(polynomial, box)
    with pytest.raises(InvalidDescription, match=match):
        largest_decay(polynomial, box)


def test_a_decay_rate_that_is_none_is_refused() -> None:
    with pytest.raises(InvalidDescription, match="decay = nan"):
        prove(s + 1, {}, float("nan"))
