from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sympy import Determinant, Matrix, Symbol, zeros

import extremum as es
from extremum.theory.conditions import HurwitzSystem, blocks, characteristic, conditions
from extremum.theory.hurwitz import hurwitz
from extremum.theory.routh import hurwitz_determinant, permanent, routh

Numbers = np.ndarray[Any, np.dtype[np.float64]]

# --- the paper's three averaged loops, Jacobians written by hand ---------------------------


def letters(axis: str) -> dict[str, Symbol]:
    names = ("alpha", "c", "k", "q", "z", "p", "epsilon")
    return {name: Symbol(f"{name}_{axis}", real=True) for name in names}


X, Y = letters("x"), letters("y")
H = Symbol("h", real=True)
GAINS = [*X.values(), *Y.values(), H]


def loop_gain(axis: dict[str, Symbol]) -> Any:
    return axis["alpha"] * axis["c"] * axis["k"] * axis["q"]


def velocity_actuated() -> Matrix:
    """The states x̃, ỹ, e; the paper's (14) in t."""
    rates = [-a["alpha"] * a["c"] * a["q"] for a in (X, Y)]
    return sympy.diag(*rates, -H)


def force_actuated() -> Matrix:
    """The states x̃, ṽ_x, ỹ, ṽ_y, e, w_x, w_y; erratum 1: λ³ − pλ² + gλ − gz."""
    matrix = zeros(7, 7)
    for first, w, a in ((0, 5, X), (2, 6, Y)):
        g = loop_gain(a)
        matrix[first, first + 1] = 1
        matrix[first + 1, w] = 1
        matrix[w, first] = g * a["z"]
        matrix[w, first + 1] = -g
        matrix[w, w] = a["p"]
    matrix[4, 4] = -H
    return matrix


def unstable_poles() -> Matrix:
    """The states x̃, ỹ, e, w_x, w_y; erratum 2: λ² + (g − ε − p)λ + pε − gz."""
    matrix = zeros(5, 5)
    for first, w, a in ((0, 3, X), (1, 4, Y)):
        g = loop_gain(a)
        matrix[first, first] = a["epsilon"]
        matrix[first, w] = 1
        matrix[w, first] = g * (a["z"] - a["epsilon"])
        matrix[w, w] = a["p"] - g
    matrix[2, 2] = -H
    return matrix


SCHEMES = {
    "velocity": velocity_actuated(),
    "force": force_actuated(),
    "unstable": unstable_poles(),
}


def expanded(expressions: Any) -> set[Any]:
    return {sympy.expand(e) for e in expressions}


# --- Routh's array -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("coefficients", "unstable", "imaginary"),
    [
        ([1, 2, 3, 4, 5], 2, 0),  # Ogata
        ([1, 2, 3, 6, 5], 2, 0),  # a zero begins the third row
        ([1, 2, 3, 6, 5, 3], 2, 0),  # Nise, the same
        ([1, 0, -3, 2], 2, 0),  # (s − 1)² (s + 2)
        ([1, 2, 24, 48, -25, -50], 1, 2),  # Ogata: (s² − 1)(s² + 25)(s + 2), a row of zeros
        ([1, 7, 6, 42, 8, 56], 0, 4),  # Nise: (s⁴ + 6s² + 8)(s + 7)
        ([1, 1, 12, 22, 39, 59, 48, 38, 20], 2, 4),  # Nise
        ([1, 2, 1, 2], 0, 2),  # (s + 2)(s² + 1)
        ([1, 0, 2, 0, 1], 0, 4),  # (s² + 1)²
        ([1, 0, -2, 0, 1], 2, 0),  # (s² − 1)²
        ([1, 0, 0], 0, 2),  # s²
        ([1, 1, 0], 0, 1),
        ([1, 0, 0, 0, 1], 2, 0),
        ([1, 0, 0, 0, 0, 1], 2, 0),  # three zeros begin a row
        ([-2, -4, -2.5], 0, 0),  # a negative leading coefficient
        ([0, 0, 1, 3], 0, 0),  # leading zeros
        ([5], 0, 0),
    ],
)
def test_routh_counts_what_the_textbooks_count(
    coefficients: list[float], unstable: int, imaginary: int
) -> None:
    array = routh(coefficients)
    assert (array.unstable, array.imaginary) == (unstable, imaginary)
    assert array.stable == (unstable == imaginary == 0)


def test_the_array_is_the_one_on_paper() -> None:
    assert routh([1, 2, 3, 4, 5]).table == ((1, 3, 5), (2, 4), (1, 5), (-6,), (5,))
    ogata = routh([1, 2, 24, 48, -25, -50]).table
    assert ogata[:3] == ((1, 24, -25), (2, 48, -50), (8, 96))  # derivative of 2s⁴ + 48s² − 50
    assert ogata[3:5] == ((24, -50), (pytest.approx(338 / 3),))
    text = routh([1, 2, 3, 4, 5]).text().splitlines()
    assert [line.split() for line in text[1:4:2]] == [["λ^3", "|", "2", "4"], ["λ^1", "|", "-6"]]


factor = st.one_of(
    st.tuples(st.integers(-3, 3)),
    st.tuples(st.integers(-2, 2), st.integers(1, 3)),  # a pair a ± jb
)


@settings(max_examples=300, deadline=None)
@given(st.lists(factor, min_size=1, max_size=5))
def test_routh_finds_the_roots_it_was_built_from(factors: list[tuple[int, ...]]) -> None:
    polynomial = np.array([1], dtype=object)
    unstable = imaginary = 0
    for real, *rest in factors:
        size = 1 + len(rest)
        part = [1, -2 * real, real**2 + rest[0] ** 2] if rest else [1, -real]
        polynomial = np.convolve(polynomial, np.array(part, dtype=object))
        unstable += size * (real > 0)
        imaginary += size * (real == 0)
    array = routh(list(polynomial))
    assert (array.unstable, array.imaginary) == (unstable, imaginary)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.integers(-3, 3).map(float), min_size=2, max_size=9), st.integers(-30, 30))
def test_routh_counts_what_numpy_counts_in_any_unit_of_time(
    coefficients: list[float], decades: int
) -> None:
    assume(coefficients[0])
    roots = np.roots(coefficients)
    assume(len(roots) and min(abs(roots.real)) > 1e-4)
    unit = 2.0**decades
    scaled = [c * unit**i for i, c in enumerate(coefficients)]
    assert routh(scaled).unstable == sum(roots.real > 0)
    assert routh(scaled).imaginary == 0


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=9))
def test_routh_counts_what_numpy_counts_for_any_floats(coefficients: list[float]) -> None:
    assume(min(abs(coefficients[0]), abs(coefficients[-1])) > 1e-3)
    roots = np.roots(coefficients)
    assume(min(abs(roots.real) / abs(roots)) > 1e-4)
    assert routh(coefficients).unstable == sum(roots.real > 0)


def test_decimals_are_taken_for_what_they_state() -> None:
    assert 0.3 * 0.7 == 0.21
    assert routh([1, 0.3, 0.7, 0.21]).imaginary == 2  # (λ + 0.3)(λ² + 0.7), inexact in binary
    assert routh([1, 0.3, 0.7, 0.2100001]).unstable == 2
    assert routh([1, 0.3, 0.7, 0.2099999]).stable


@pytest.mark.parametrize("coefficients", [[], [0, 0], [1, float("nan")], [1, 1j], [1, "a"]])
def test_what_is_no_polynomial_is_refused(coefficients: Any) -> None:
    with pytest.raises(es.InvalidDescription, match=r"coefficients"):
        routh(coefficients)


def test_hurwitz_determinants_against_their_definition() -> None:
    rng = np.random.default_rng(3)
    for order in (1, 2, 3, 5):
        a = [1.0, *rng.normal(size=6)]
        matrix = np.zeros((order, order))
        for i in range(order):
            for j in range(order):
                if 0 <= 2 * (j + 1) - (i + 1) <= 6:
                    matrix[i, j] = a[2 * (j + 1) - (i + 1)]
        value, margin = hurwitz_determinant(a, order)
        size: Any = sympy.Matrix(abs(matrix)).per()
        assert value == pytest.approx(np.linalg.det(matrix), rel=1e-9)
        assert margin == pytest.approx(value / float(size), rel=1e-9)


def test_hurwitz_determinants_survive_extreme_units_of_time() -> None:
    plain, margin = hurwitz_determinant([1, 3, 4, 3, 2, 1], 4)
    assert margin != 0
    for unit in (1e-30, 1e-3, 1e12, 1e40):
        value, other = hurwitz_determinant(
            [c * unit**i for i, c in enumerate([1, 3, 4, 3, 2, 1])], 4
        )
        assert np.sign(value) == np.sign(plain)
        assert other == pytest.approx(margin, rel=1e-9)


def test_a_large_hurwitz_determinant_can_be_had_at_all() -> None:
    """Its 19! products, or all 2¹⁹ sets of columns, would take for ever."""
    coefficients = list(np.poly(-np.linspace(0.5, 1.5, 20)))
    _, margin = hurwitz_determinant(coefficients, 19)
    assert abs(margin) < 1e-12  # a cluster of 20 is on the boundary to rounding


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 5), st.data())
def test_permanent(size: int, data: Any) -> None:
    row = st.lists(st.integers(0, 2), min_size=size, max_size=size)
    rows = data.draw(st.lists(row, min_size=size, max_size=size))
    assert permanent(rows) == sympy.Matrix(rows).per()


# --- a Jacobian's blocks and polynomials --------------------------------------------------------


def test_blocks_are_the_paper_s_factors() -> None:
    assert blocks(SCHEMES["velocity"]) == ((0,), (1,), (2,))
    assert blocks(SCHEMES["force"]) == ((0, 1, 5), (2, 3, 6), (4,))
    assert blocks(SCHEMES["unstable"]) == ((0, 3), (1, 4), (2,))
    driven = SCHEMES["force"].copy()
    driven[4, 0] = X["q"]  # e is driven by x̃ and drives nothing
    assert blocks(driven) == ((0, 1, 5), (2, 3, 6), (4,))
    hidden = SCHEMES["force"].copy()
    hidden[0, 2] = H * (X["c"] + 1) - H * X["c"] - H  # 0, though not written so
    hidden[2, 0] = H
    assert len(blocks(hidden)) == 3


def test_the_blocks_polynomials_multiply_to_the_whole_one() -> None:
    rng = np.random.default_rng(5)
    for _ in range(30):
        size = int(rng.integers(1, 8))
        numbers = rng.integers(-3, 4, (size, size)) * (rng.random((size, size)) < 0.3)
        matrix = sympy.Matrix(numbers.tolist())
        parts = blocks(matrix)
        assert sorted(i for part in parts for i in part) == list(range(size))
        product = np.array([1], dtype=object)
        for part in parts:
            inner = matrix.extract(list(part), list(part))
            product = np.convolve(product, np.array(characteristic(inner), dtype=object))
        assert list(product) == matrix.charpoly().all_coeffs()


def test_the_polynomial_of_the_double_integrator_is_the_paper_s() -> None:
    first, *_ = blocks(SCHEMES["force"])
    block = SCHEMES["force"].extract(list(first), list(first))
    g = loop_gain(X)
    assert characteristic(block) == (1, -X["p"], g, -g * X["z"])


def test_functions_and_fractions_count_as_letters() -> None:
    a, w = Symbol("a", real=True), Symbol("omega", real=True)
    block = Matrix([[0, 1], [-a / (w**2 + 1), -sympy.cos(w) - sympy.Rational(1, 3)]])
    _, a_1, a_2 = characteristic(block)
    assert sympy.simplify(a_1 - sympy.cos(w) - sympy.Rational(1, 3)) == 0
    assert sympy.simplify(a_2 - a / (w**2 + 1)) == 0


# --- the conditions as they are read ------------------------------------------------------------


def test_conditions_of_the_force_actuated_scheme_are_those_of_erratum_1() -> None:
    system = HurwitzSystem(SCHEMES["force"].as_immutable(), tuple(GAINS))
    g, p, z = loop_gain(X), X["p"], X["z"]
    own = [e.expression for e in system.inequalities[:4]]
    assert expanded(own) == expanded([-p, g, -g * z, g * (z - p)])
    assert [e.text() for e in system.inequalities[:3]] == [
        "-p_x > 0",
        "α_x c_x k_x q_x > 0",
        "-α_x c_x k_x q_x z_x > 0",
    ]
    assert system.inequalities[3].text() == "α_x c_x k_x q_x (z_x - p_x) > 0"
    assert system.inequalities[2].latex() == (r"- \alpha_{x} c_{x} k_{x} q_{x} z_{x} > 0")
    assert [e.name for e in system.inequalities] == [
        *("a_1", "a_2", "a_3", "a_1 a_2 - a_3"),
        *("b_1", "b_2", "b_3", "b_1 b_2 - b_3"),
        "d_1",
    ]
    assert system.inequalities[-1].text() == "h > 0"


def test_conditions_of_the_other_schemes() -> None:
    velocity = HurwitzSystem(SCHEMES["velocity"].as_immutable(), tuple(GAINS)).inequalities
    assert [e.text() for e in velocity] == ["α_x c_x q_x > 0", "α_y c_y q_y > 0", "h > 0"]
    unstable = HurwitzSystem(SCHEMES["unstable"].as_immutable(), tuple(GAINS)).inequalities
    g, p, z, epsilon = loop_gain(X), X["p"], X["z"], X["epsilon"]
    assert expanded(e.expression for e in unstable[:2]) == expanded(
        [g - epsilon - p, p * epsilon - g * z]
    )
    assert unstable[0].text() == "α_x c_x k_x q_x - ε_x - p_x > 0"
    assert unstable[1].text() == "ε_x p_x - α_x c_x k_x q_x z_x > 0"
    assert len(unstable) == 5


def test_equal_conditions_are_stated_once() -> None:
    shared = SCHEMES["force"].subs(dict(zip(Y.values(), X.values(), strict=True)))
    assert len(conditions(shared, [*X.values(), H], [1.0] * 8)) == 5
    rows = [[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]]
    companion = Matrix([*rows, [-a for a in reversed(GAINS[:5])]])
    once = conditions(companion, GAINS, [1.0] * len(GAINS))
    assert len(once) == 7
    assert conditions(sympy.diag(companion, companion), GAINS, [1.0] * len(GAINS)) == once
    damped = [Matrix([[0, 1], [-a, -H]]) for a in (X["q"], Y["q"])]  # h > 0 for both
    assert [c.text() for c in conditions(sympy.diag(*damped), GAINS, [1.0] * len(GAINS))] == [
        *("h > 0", "q_x > 0", "q_y > 0"),
    ]
    assert [e.text() for e in hurwitz([1, H, H, 1])] == ["h > 0", "h² - 1 > 0"]
    numeric = [e.text() for e in hurwitz([2, 4, 8])]
    assert numeric == ["2 > 0", "4 > 0"]


def test_letters_of_parameters_are_left_to_them() -> None:
    a, b = Symbol("a_1", real=True), Symbol("b_x", real=True)
    matrix = Matrix([[0, 1, 0], [-a, -b, 0], [0, 0, -H]])
    names = [e.name for e in HurwitzSystem(matrix.as_immutable(), (a, b, H)).inequalities]
    assert names == ["d_1", "d_2", "g_1"]


def test_states_say_what_a_condition_is_about() -> None:
    labels = ["x", "v_x", "y", "v_y", "e", "w_x", "w_y"]
    found = conditions(SCHEMES["force"], GAINS, [1.0] * len(GAINS), labels)
    assert found[0].states == ("x", "v_x", "w_x")
    assert found[-1].states == ("e",)


def test_a_degree_8_block_stays_bounded_and_readable() -> None:
    coefficients = [1, *(sympy.Add(*sympy.symbols(f"u{i}_:8")) for i in range(8))]
    found = hurwitz(coefficients)
    assert len(found) == 8 + 3  # a₁ … a₈, Δ₇, Δ₅, Δ₃
    assert sum(len(e.text()) for e in found) < 2000
    assert found[-1].name == "a_1 a_2 a_3 + a_1 a_5 - a_1² a_4 - a_3²"
    assert isinstance(found[-2].expression, Determinant)
    assert found[-2].text() == (
        "det[a_1, a_3, a_5, a_7, 0; 1, a_2, a_4, a_6, a_8; 0, a_1, a_3, a_5, a_7; "
        "0, 1, a_2, a_4, a_6; 0, 0, a_1, a_3, a_5] > 0"
    )
    assert found[-1].definitions()[0] == "a_1 = " + " + ".join(f"u0_{j}" for j in range(8))


def test_determinants_are_stated_in_letters_beyond_degree_4_or_where_they_are_long() -> None:
    fourth, fifth = (hurwitz([1, *GAINS[:degree]], letter="m") for degree in (4, 5))
    assert fourth[-1].text() == "α_x c_x k_x - α_x² q_x - k_x² > 0"
    assert fourth[-1].where == ()
    assert fifth[-1].text() == "m_1 m_2 - m_3 > 0"
    assert fifth[-2].text().startswith("det[m_1, m_3, m_5, 0; 1, m_2, m_4, 0; ")
    assert fifth[-1].definitions() == ("m_1 = α_x", "m_2 = c_x", "m_3 = k_x")
    dense = conditions(Matrix(4, 4, sympy.symbols("m:16")), sympy.symbols("m:16"), [1.0] * 16)
    assert dense[-1].text() == "a_1 a_2 a_3 - a_1² a_4 - a_3² > 0"
    assert len(dense[-1].definitions()) == 4
    assert sum(len(c.text()) for c in dense) < 2000
    large = conditions(Matrix(6, 6, sympy.symbols("m:36")), sympy.symbols("m:36"), [1.0] * 36)
    (definition,) = large[-1].definitions()
    assert "λ⁶ = det[λ - m0, -m1," in definition


@pytest.mark.parametrize("degree", range(1, 9))
def test_the_stated_expressions_decide_stability(degree: int) -> None:
    named = sympy.symbols(f"c1:{degree + 1}", real=True)
    stated = hurwitz([1, *named], letter="c")
    letters = sympy.symbols(f"c_1:{degree + 1}", real=True)
    whole: Any = [e.expression.xreplace(dict(zip(letters, named, strict=True))) for e in stated]
    parts = [e.arg if isinstance(e, Determinant) else Matrix([[e]]) for e in whole]
    function = sympy.lambdify([list(named)], parts, "numpy")
    rng = np.random.default_rng(degree)
    verdicts = set()
    for trial in range(200):
        roots = rng.normal(size=degree) - (1.5 if trial % 2 else 0)
        pairs = roots[: degree // 2] + 1j * rng.normal(size=degree // 2)
        rest = roots[2 * (degree // 2) :]
        polynomial = np.poly(np.concatenate([pairs, pairs.conj(), rest])).real
        largest = max([*pairs.real, *rest])
        values = [np.linalg.det(part) for part in function(polynomial[1:])]
        assert (min(values) > 0) == (largest < 0)
        verdicts.add(largest < 0)
    assert verdicts == {True, False}


# --- numbers ------------------------------------------------------------------------------------


def drawn(rng: np.random.Generator, name: str) -> Numbers:
    """Random gains around what is stable, each side of the boundary often."""
    values: list[float] = []
    for _ in range(2):
        alpha, c, k, q = rng.uniform(0.02, 0.2), rng.uniform(1, 20), rng.uniform(0.5, 10), 1.0
        q = rng.uniform(0.2, 2) * (-1 if rng.random() < 0.05 else 1)
        z = -rng.exponential(1.0) if rng.random() < 0.9 else rng.uniform(0, 1)
        p = -rng.exponential(3.0) if rng.random() < 0.9 else rng.uniform(0, 1)
        epsilon = rng.exponential(0.5) if name == "unstable" else 0.0
        values += [alpha, c, k, q, z, p, epsilon]
    return np.array([*values, rng.uniform(-0.02, 2)])


def test_the_verdict_is_the_largest_real_part_on_10000_gain_sets() -> None:
    rng = np.random.default_rng(31)
    stable = dict.fromkeys(SCHEMES, 0)
    for name, matrix in SCHEMES.items():
        system = HurwitzSystem(matrix.as_immutable(), tuple(GAINS))
        numeric = sympy.lambdify([GAINS], matrix, "numpy")
        draws = np.array([drawn(rng, name) for _ in range(3400)])
        jacobians = np.array([numeric(values) for values in draws])
        largest = np.linalg.eigvals(jacobians).real.max(axis=1)
        for values, real in zip(draws, largest, strict=True):
            holds = all(condition.holds for condition in system.at(values))
            if abs(real) >= 1e-9:
                assert holds == (real < 0), (name, values)
                stable[name] += holds
    assert all(0.2 < count / 3400 < 0.95 for count in stable.values()), stable


@pytest.mark.parametrize("size", range(2, 9))
def test_the_verdict_is_the_largest_real_part_of_dense_matrices(size: int) -> None:
    entries = sympy.symbols(f"m:{size * size}", real=True)
    system = HurwitzSystem(Matrix(size, size, entries).as_immutable(), entries)
    assert system.blocks == (tuple(range(size)),)
    rng = np.random.default_rng(size)
    shift = np.sqrt(size) * rng.uniform(0.5, 1.2, (400, 1, 1)) * np.eye(size)
    matrices = rng.normal(size=(400, size, size)) - shift
    largest = np.linalg.eigvals(matrices).real.max(axis=1)
    verdicts = []
    for matrix, real in zip(matrices, largest, strict=True):
        found = system.at(matrix.ravel().tolist())
        arrays = system.routh(matrix.ravel().tolist())
        assert all(-1 <= condition.margin <= 1 for condition in found)
        assert np.sign(arrays[0].unstable) == (real > 0)
        if abs(real) >= 1e-9:
            verdicts.append(all(condition.holds for condition in found))
            assert verdicts[-1] == (real < 0)
    assert 20 < sum(verdicts) < 380


@pytest.mark.parametrize("size", [3, 4, 5, 8])
def test_values_are_those_of_the_stated_expressions(size: int) -> None:
    entries = sympy.symbols(f"m:{size * size}", real=True)
    matrix = np.random.default_rng(size).normal(size=(size, size))
    plain = dict(zip(entries, map(float, matrix.ravel()), strict=True))
    named = sympy.symbols(f"a_1:{size + 1}", real=True)
    table: Any = {**plain, **dict(zip(named, map(float, np.poly(matrix)[1:]), strict=True))}
    found = conditions(Matrix(size, size, entries), entries, list(plain.values()))
    assert len(found) >= size + (size - 1) // 2
    for condition in found:
        expression: Any = condition.expression
        if isinstance(expression, Determinant):
            expected = np.linalg.det(np.array(expression.arg.xreplace(table), dtype=float))
        else:
            expected = float(expression.xreplace(table))
        assert condition.value == pytest.approx(expected, rel=1e-8)


def test_axes_coupled_by_the_hessian() -> None:
    """Two double integrators, w = C(s) g Q p̃: one block of degree 6."""
    matrix, q_xy = SCHEMES["force"].copy(), Symbol("q_xy", real=True)
    for (a, first), (_, other) in (((X, 5), (Y, 2)), ((Y, 6), (X, 0))):
        shared = a["alpha"] * a["c"] * a["k"] * q_xy
        matrix[first, other] = shared * a["z"]
        matrix[first, other + 1] = -shared
    symbols = [*GAINS, q_xy]
    system = HurwitzSystem(matrix.as_immutable(), tuple(symbols))
    assert system.blocks == ((0, 1, 2, 3, 5, 6), (4,))
    texts = {e.name: e.text() for e in system.inequalities}
    shared = "α_x α_y c_x c_y k_x k_y"
    assert texts["a_1"] == "-(p_x + p_y) > 0"
    assert texts["a_5"] == f"-{shared} (z_x + z_y) (q_x q_y - q_xy²) > 0"
    assert texts["a_6"] == f"{shared} z_x z_y (q_x q_y - q_xy²) > 0"
    numeric = sympy.lambdify([symbols], matrix, "numpy")
    rng = np.random.default_rng(8)
    verdicts = []
    for _ in range(500):
        values = [*drawn(rng, "force"), rng.normal(0, 0.5)]
        largest = np.linalg.eigvals(numeric(values)).real.max()
        verdicts.append(all(condition.holds for condition in system.at(values)))
        assert verdicts[-1] == (largest < 0)
    assert 50 < sum(verdicts) < 450


def test_conditions_of_the_errata_s_four_designs() -> None:
    system = HurwitzSystem(SCHEMES["force"].as_immutable(), tuple(GAINS))
    designs = {(-2, -1.5): False, (-0.5, -3): True, (-2, -10): True, (-1.2, -1.1): False}
    for (z, p), stable in designs.items():
        axes = [[0.1, 10, 5, q, z, p, 0.0] for q in (1.0, 0.5)]
        found = system.at([*axes[0], *axes[1], 1.0])
        assert all(condition.holds for condition in found) == stable
        broken = [condition.name for condition in found if not condition.holds]
        assert broken == ([] if stable else ["a_1 a_2 - a_3", "b_1 b_2 - b_3"])
        lead = found[3]
        assert lead.value == pytest.approx(5 * (z - p))
        assert lead.margin == pytest.approx((z - p) / (abs(z) + abs(p)))  # of g z − g p


def test_margins_have_no_unit() -> None:
    entries = sympy.symbols("m:36", real=True)
    matrix = np.random.default_rng(2).normal(size=(6, 6)) - 1.5 * np.eye(6)
    one, other = (
        conditions(Matrix(6, 6, entries), entries, list(map(float, (unit * matrix).ravel())))
        for unit in (1.0, 1e3)
    )
    assert [c.margin for c in other] == pytest.approx([c.margin for c in one], rel=1e-8)
    assert other[0].value == pytest.approx(1e3 * one[0].value)
    sizes = abs(np.linalg.eigvals(matrix))
    assert one[0].margin == pytest.approx(-np.trace(matrix) / sizes.sum())
    assert one[5].margin == pytest.approx(np.sign(np.linalg.det(matrix)))  # a₆ = det A


def test_a_damping_that_is_missing_is_a_condition_that_never_holds() -> None:
    g = Symbol("g", real=True)
    found = conditions(Matrix([[0, 1], [-g, 0]]), [g], [2.0])
    assert [(c.text(), c.holds, c.margin) for c in found] == [
        ("0 > 0", False, 0.0),
        ("g > 0", True, 1.0),
    ]


def test_bad_matrices_are_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="must be square; it is 1 × 2"):
        conditions(Matrix([[1, 2]]), [], [])
    with pytest.raises(es.InvalidDescription, match="add h"):
        conditions(Matrix([[H]]), [], [])
    with pytest.raises(es.InvalidDescription, match="not 0"):
        hurwitz([0, 1, 2])
