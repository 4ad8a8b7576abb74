from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import sympy
from sympy import Poly, Rational, Symbol

import extremum as es
from extremum.theory.equilibria import nearest, real_solutions

x, y, z, w = sympy.symbols("x y z w", real=True)
Array = np.ndarray[Any, np.dtype[np.float64]]


def matched(found: Sequence[Array], expected: Sequence[Any], tol: float = 1e-9) -> None:
    assert len(found) == len(expected), found
    for point in expected:
        distances = [np.linalg.norm(one - np.array(point, dtype=float)) for one in found]
        assert min(distances) <= tol * (1 + np.linalg.norm(point)), (point, found)


def exactly_counted(f: Any, g: Any) -> int:
    """The number of real solutions by Sturm's theorem, on the resultant in sheared coordinates."""
    shear = Rational(37, 101)
    f, g = (sympy.expand(e.subs(x, x - shear * y)) for e in (f, g))
    resultant: Any = Poly(sympy.resultant(f, g, y), x)
    return int(resultant.sqf_part().count_roots())


def random_polynomial(rng: np.random.Generator, degree: int, variables: Sequence[Symbol]) -> Any:
    monomials = sympy.itermonomials(list(variables), degree)
    ordered = sorted(monomials, key=lambda m: sympy.default_sort_key(m))
    return sympy.Add(*(Rational(repr(float(rng.normal()))) * m for m in ordered))


def gradient(f: Any, variables: Sequence[Symbol]) -> list[Any]:
    return [sympy.diff(f, v) for v in variables]


# --- all solutions ------------------------------------------------------------------------------

R2 = np.sqrt(0.5)
R7 = np.sqrt(7)


@pytest.mark.parametrize(
    ("equations", "unknowns", "expected"),
    [
        ([x**3 - x, y**3 - 4 * y], [x, y], [(a, b) for a in (-1, 0, 1) for b in (-2, 0, 2)]),
        (
            [(x**2 + y**2 - 4) * (x - y), (x**2 + y**2 - 1) * (x + y - 1)],
            [x, y],
            [
                (0.5, 0.5),
                (R2, R2),
                (-R2, -R2),
                ((1 + R7) / 2, (1 - R7) / 2),
                ((1 - R7) / 2, (1 + R7) / 2),
            ],
        ),
        ([x**2 + y**2 - 2, x * y - 1], [x, y], [(1, 1), (-1, -1)]),  # touching
        ([x**2 + y**2 - 1, (x - 3) ** 2 + y**2 - 1], [x, y], []),
        (
            [x**2 + y**2 + z**2 - 3, x - y, y * z - 1],  # 2x⁴ − 3x² + 1 = 0
            [x, y, z],
            [(1, 1, 1), (-1, -1, -1), (R2, R2, 2 * R2), (-R2, -R2, -2 * R2)],
        ),
        ([x**3 - 3 * x * y**2 - 1, 3 * x**2 * y - y**3], [x, y], [  # the cube roots of 1
            (1, 0), (-0.5, np.sqrt(0.75)), (-0.5, -np.sqrt(0.75)),
        ]),
        ([x * y - 1, y * z - 1, z * w - 1, (x - 2) * (y - 3)], [x, y, z, w], [
            (2, 0.5, 2, 0.5), (1 / 3, 3, 1 / 3, 3),
        ]),
        ([sympy.prod(x - k for k in range(1, 9))], [x], [(k,) for k in range(1, 9)]),
        ([x**2 + 1], [x], []),
        ([x**2 + y**2 - x, x**2 + y**2 - x - Rational(1, 10**15)], [x, y], []),  # just so
        ([x * y - z * w, x**2 - y - z, y**2 - w, z**2 - x + w], [x, y, z, w], [
            (0, 0, 0, 0), (1, 0, 1, 0),
        ]),
        ([x - 1, x - 2], [x, y], []),  # contradictory
        ([x + y - 3, x - y - 1], [x, y], [(2, 1)]),
        ([x**2 + y**2, x - y], [x, y], [(0, 0)]),
        ([x**2 - sympy.pi**2, 2.5 * y - x], [x, y], [(np.pi, np.pi / 2.5), (-np.pi, -np.pi / 2.5)]),
    ],
)  # fmt: skip
def test_systems_with_known_solutions(
    equations: list[Any], unknowns: list[Symbol], expected: list[tuple[float, ...]]
) -> None:
    matched(real_solutions(equations, unknowns), expected)


def test_the_nearest_to_the_origin_comes_first() -> None:
    found = real_solutions([(x - 3) * (x + 1) * (x + 2), y - x], [x, y])
    assert [round(float(point[0]), 9) for point in found] == [-1, -2, 3]


def test_points_of_a_tilted_ring() -> None:
    """J = −(r² − 1)² + b·p rests on the line along b alone, where 4 r (r² − 1) = |b|."""
    b = (0.1, 0.2, 0.05)
    field = 0.1 * x + 0.2 * y + 0.05 * z - (x**2 + y**2 + z**2 - 1) ** 2
    size = float(np.linalg.norm(b))
    along = np.roots([4, 0, -4, -size]).real
    found = real_solutions(gradient(field, (x, y, z)), [x, y, z])
    matched(found, [np.array(b) / size * r for r in along])


def test_random_systems_have_as_many_solutions_as_sturm_counts() -> None:
    rng = np.random.default_rng(11)
    counts = set()
    for degree in (2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 4):
        f, g = (random_polynomial(rng, degree, (x, y)) for _ in range(2))
        found = real_solutions([f, g], [x, y])
        assert len(found) == exactly_counted(f, g)
        counts.add(len(found))
        exact: Any = [{x: Rational(float(a)), y: Rational(float(b))} for a, b in found]
        assert all(abs(float(e.subs(at))) < 1e-9 for at in exact for e in (f, g))
    assert len(counts) > 3


@pytest.mark.parametrize("seed", [22, 38])  # several of which floats alone do not solve
def test_solutions_and_coefficients_of_very_different_sizes(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def term(i: int, j: int) -> Any:
        size = float(rng.normal() * 10 ** rng.uniform(-6, 6))
        return Rational(repr(size)) * x**i * y**j

    for _ in range(6):
        f, g = (sympy.Add(*(term(i, j) for i in range(4) for j in range(4 - i))) for _ in range(2))
        assert len(real_solutions([f, g], [x, y])) == exactly_counted(f, g)


@pytest.mark.parametrize(("size", "seed"), [(2, 0), (2, 1), (2, 2), (2, 3), (3, 0)])
def test_stationary_points_of_random_quartics_against_newton_from_everywhere(
    size: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    variables = (x, y, z)[:size]
    field = random_polynomial(rng, 4, variables)
    field -= 3 * sum(v**4 for v in variables)  # bounded above: every start leads somewhere
    equations = gradient(field, variables)
    found = real_solutions(equations, variables)
    slope = sympy.lambdify([variables], equations, "numpy")
    second = sympy.lambdify([variables], sympy.hessian(field, variables), "numpy")
    reached: list[Array] = []
    for start in rng.normal(size=(400, size)) * rng.choice([0.3, 1, 2], size=(400, 1)):
        point = start
        for _ in range(40):
            step = np.linalg.solve(np.array(second(point), dtype=float), slope(point))
            point = point - step * min(1, 0.5 / float(np.linalg.norm(step) + 1e-300))
        new = all(np.linalg.norm(point - other) > 1e-6 for other in reached)
        if new and np.linalg.norm(slope(point)) < 1e-9:
            reached.append(point)
    matched(found, reached, tol=1e-7)


def test_a_multiple_solution_is_reported_once() -> None:
    cubed = Rational(3, 10)
    matched(real_solutions([(x - cubed) ** 2 * (x - 2)], [x]), [(0.3,), (2,)])
    matched(real_solutions([(x - 0.1) ** 2 * (x - 2), y - x], [x, y]), [(0.1, 0.1), (2, 2)])
    matched(real_solutions([x**2 - y**3, x * y], [x, y]), [(0, 0)])
    touching = [x**2 + y**2 - 2, (x - 2) ** 2 + (y - 2) ** 2 - 2]
    matched(real_solutions(touching, [x, y]), [(1, 1)], tol=1e-7)
    thrice = [sympy.expand((x - 1) ** 2 + (y - 2) ** 3), (x - 1) * (y + 3)]
    r = np.sqrt(125)
    matched(real_solutions(thrice, [x, y]), [(1, 2), (1 + r, -3), (1 - r, -3)], tol=1e-7)


@pytest.mark.parametrize("root", [0.1, 0.7, 3.3, 1e-3, 250.0])
def test_a_double_solution_survives_rounding_of_the_coefficients(root: float) -> None:
    square = x**2 - 2 * root * x + root * root  # root² rounded: two roots, or none
    others = [5 * root, -2 * root]
    equations = [sympy.expand(square * (x - others[0])), y**2 - root * x - 2 * root**2]
    expected = [(root, s * np.sqrt(3) * root) for s in (1, -1)]
    expected += [(others[0], s * np.sqrt(7) * root) for s in (1, -1)]
    matched([p / root for p in real_solutions(equations, [x, y])],
            [(a / root, b / root) for a, b in expected], tol=1e-6)  # fmt: skip


def test_a_multiple_solution_needs_no_more_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("extremum.theory.equilibria._joint_eigenvalues_precisely", None)
    matched(real_solutions([x**2 + y**2 - 2, x * y - 1], [x, y]), [(1, 1), (-1, -1)])
    matched(real_solutions([(x - Rational(1, 3)) ** 3 * (x + 1)], [x]), [(1 / 3,), (-1,)])


@pytest.mark.parametrize("power", [6, 12])
def test_a_solution_of_high_multiplicity_keeps_its_digits(power: int) -> None:
    equation = (x - Rational(1, 10)) ** power * (x - 2)
    matched(real_solutions([equation], [x]), [(0.1,), (2,)])


def test_close_solutions_stay_apart() -> None:
    gap = Rational(1, 10**5)
    found = real_solutions([x * (x - gap) * (x - 1), y - x], [x, y])
    matched([p * 1e5 for p in found], [(0, 0), (1, 1), (1e5, 1e5)], tol=1e-6)
    overlap = Rational(1, 10**10)  # circles that cut at y = ±√overlap, or just miss
    for sign, count in ((1, 2), (-1, 0)):
        circles = [x**2 + y**2 - 1, (x - 2 + sign * overlap) ** 2 + y**2 - 1]
        found = real_solutions(circles, [x, y])
        assert len(found) == count
        assert all(abs(p[1]) == pytest.approx(1e-5, rel=1e-4) for p in found)


@pytest.mark.parametrize("unit", [Rational(1, 10**9), Rational(1), Rational(10**9)])
def test_solutions_do_not_depend_on_the_unit(unit: Any) -> None:
    circle = [(x / unit) ** 2 + (y / unit) ** 2 - 5, x * y / unit**2 - 2]
    found = [p / float(unit) for p in real_solutions(circle, [x, y])]
    matched(found, [(1, 2), (2, 1), (-1, -2), (-2, -1)])


def test_what_vanishes_is_exactly_zero() -> None:
    equations = [x * y - z * w, x**2 - y - z, y**2 - w, z**2 - x + w / 10]
    found = [p for p in real_solutions(equations, [x, y, z, w]) if abs(p[0] - 1) < 1e-9]
    assert [p.tolist() for p in found] == [[1, 0, 1, 0]]


def test_the_averaged_loop_of_erratum_2_rests_where_it_says() -> None:
    """The states x̃, e, w of the paper's unstable scheme, one axis; x̃ᵉ = p ε x*/(g z − p ε)."""
    epsilon, zero, p, k, c, alpha, h, source, q = 0.5, -3.0, -2.5, 4.0, 10.0, 0.05, 1.0, 1.0, 1.0
    g = alpha * c * k * q
    equations = [
        epsilon * (x + source) + w - g * x,
        -h * (q * x**2 + y + alpha**2 / 2 * q),
        p * w + g * (zero - p) * x,
    ]
    (found,) = real_solutions(equations, [x, y, w])
    expected = p * epsilon * source / (g * zero - p * epsilon)
    assert expected == pytest.approx(0.26316, abs=1e-5)
    assert found[0] == pytest.approx(expected, rel=1e-12)
    assert found[1] == pytest.approx(-q * expected**2 - alpha**2 / 2 * q, rel=1e-12)


def test_elimination_leaves_what_the_limit_counts() -> None:
    chain: list[Any] = [x - y**2, z - x**2, w - z**2, y - 2]  # degree 8 in all, but triangular
    matched(real_solutions(chain, [x, y, z, w], limit=1), [(4, 2, 16, 256)])
    washout: list[Any] = [z + x**2 + y**2, x**3 - x, y**3 - y]  # z is in no other equation
    assert len(real_solutions(washout, [x, y, z], limit=9)) == 9
    worse: list[Any] = [z - x**3, z**2 + y**2 - 2, z * y - 1]  # without z: degrees 6 and 4
    matched(real_solutions(worse, [x, y, z], limit=12), [(1, 1, 1), (-1, -1, -1)], tol=1e-7)
    with pytest.raises(es.InvalidDescription, match=r"may have 9 solutions, more than 8; .*guess"):
        real_solutions([x**3 - x, y**3 - y], [x, y], limit=8)


@pytest.mark.parametrize(
    ("equations", "names"),
    [
        ([x * y, x * (y - 1)], "y"),  # the line x = 0
        ([(x**2 + y**2 - 1) * x, (x**2 + y**2 - 1) * y], "y"),  # a ring
        ([x - y, 2 * x - 2 * y], "[xy]"),
        ([0.1 * x + 0.2 * y - 0.3, 0.3 * x + 0.6 * y - 0.9], "[xy]"),  # singular in decimals
        ([(x - 0.1) * (y - 0.7), (x - 0.1) * (x + 1)], "y"),  # the line x = 0.1
        ([sympy.Integer(0), y**2 - 1], "x"),
    ],
)
def test_infinitely_many_solutions_are_an_outcome_of_their_own(
    equations: list[Any], names: str
) -> None:
    with pytest.raises(es.InvalidDescription, match=f"infinitely many .*nothing fixes {names};"):
        real_solutions(equations, [x, y])


@pytest.mark.parametrize(
    "equation", [sympy.sin(x), 1 / (1 + x**2), w * x, x**2 + sympy.I, sympy.nan * x, sympy.oo + x]
)
def test_what_is_no_polynomial_is_refused(equation: Any) -> None:
    with pytest.raises(es.InvalidDescription, match="must be polynomials of x, y"):
        real_solutions([equation, y - 1], [x, y])


def test_two_dense_cubics() -> None:
    rng = np.random.default_rng(1)
    equations = [random_polynomial(rng, 3, (x, y)) for _ in range(2)]
    found = real_solutions(equations, [x, y])
    assert 1 <= len(found) <= 9
    assert len(found) % 2 == 1  # of the nine the others come in pairs
    for point in found:
        values = [float(e.subs({x: point[0], y: point[1]})) for e in equations]
        assert values == pytest.approx([0, 0], abs=1e-9)


# --- the nearest one ----------------------------------------------------------------------------


def scalar(f: Any, slope: Any, guess: float, scale: float = 1.0) -> float | None:
    found = nearest(
        lambda v: np.array([f(v[0])]),
        lambda v: np.array([[slope(v[0])]]),
        np.array([guess]),
        scale=scale,
    )
    return None if found is None else float(found[0])


def test_newton_finds_the_solution_near_the_guess() -> None:
    for guess, root in ((0.9, 1), (-0.8, -1), (0.3, 0), (30.0, 1)):
        found = scalar(lambda v: v**3 - v, lambda v: 3 * v**2 - 1, guess)
        assert found == pytest.approx(root, abs=1e-12)


def test_newton_takes_no_giant_leap() -> None:
    near = scalar(lambda v: np.sin(v), lambda v: np.cos(v), 1.5)  # a full step ends at −4π
    assert near == pytest.approx(0, abs=1e-12)


def test_newton_in_several_dimensions() -> None:
    """Kepler's equation E − e sin E = M, and a rotation that mixes it with a circle."""

    def function(v: Array) -> Array:
        return np.array([v[0] - 0.6 * np.sin(v[0]) - 1.0 + 0.1 * v[1], v[0] ** 2 + v[1] ** 2 - 4])

    def jacobian(v: Array) -> Array:
        return np.array([[1 - 0.6 * np.cos(v[0]), 0.1], [2 * v[0], 2 * v[1]]])

    found = nearest(function, jacobian, np.array([0.5, 3.0]))
    assert found is not None
    assert function(found) == pytest.approx([0, 0], abs=1e-13)
    upper = nearest(function, jacobian, np.array([0.5, -3.0]))
    assert upper is not None
    assert upper[1] < 0 < found[1]


def test_a_guess_that_is_a_solution_is_returned() -> None:
    assert scalar(lambda v: np.sin(v), lambda v: np.cos(v), 0.0) == 0.0
    assert scalar(lambda v: v**2, lambda v: 2 * v, 0.0) == 0.0


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_newton_does_not_depend_on_the_unit(scale: float) -> None:
    found = scalar(
        lambda v: np.tanh(v / scale - 0.3), lambda v: (1 - np.tanh(v / scale - 0.3) ** 2) / scale,
        2.0 * scale, scale,
    )  # fmt: skip
    assert found == pytest.approx(0.3 * scale, rel=1e-9)  # undamped Newton escapes from here


def test_a_double_solution_is_found_with_half_the_digits() -> None:
    rng = np.random.default_rng(4)
    for root, other in rng.normal(size=(60, 2)):
        rounded = np.poly1d(np.poly([root, root, root + 3 + abs(other)]))
        found = scalar(rounded, rounded.deriv(), root - 0.4)
        assert found == pytest.approx(root, abs=1e-5)


def test_where_there_is_no_solution_there_is_none() -> None:
    assert scalar(lambda v: v**2 + 1, lambda v: 2 * v, 0.7) is None
    assert scalar(lambda v: v**2 + 1, lambda v: 2 * v, 0.0) is None
    assert scalar(lambda v: v**2 + 1e-6, lambda v: 2 * v, 1.0) is None
    fades = (lambda v: v * np.exp(-(v**2)), lambda v: (1 - 2 * v**2) * np.exp(-(v**2)))
    assert scalar(*fades, 0.3) == pytest.approx(0, abs=1e-12)
    assert scalar(*fades, 2.0) is None  # Newton walks outwards, where the gradient fades away
    step = scalar(lambda v: v - 0.3 + (1e-8 if v > 0.3 else -1e-8), lambda _: 1.0, 1.0)
    assert step is None  # a jump over zero
    fades_to_a_floor = (lambda v: fades[0](v) + 1e-13, fades[1])
    assert scalar(*fades_to_a_floor, 2.0) is None
    assert scalar(lambda v: v * np.nan, lambda v: v, 1.0) is None


def test_a_step_out_of_the_domain_is_shortened() -> None:
    def log(v: float) -> float:
        return float(np.log(v)) if v > 0 else float("nan")

    assert scalar(log, lambda v: 1 / v, 2.9) == pytest.approx(1, abs=1e-12)


def test_newton_agrees_with_the_polynomial_solver() -> None:
    rng = np.random.default_rng(2)
    equations = [*gradient(random_polynomial(rng, 4, (x, y)), (x, y))]
    f = sympy.lambdify([[x, y]], equations, "numpy")
    slope = sympy.lambdify([[x, y]], sympy.Matrix(equations).jacobian([x, y]), "numpy")
    for point in real_solutions(equations, [x, y]):
        found = nearest(lambda v: np.array(f(v)), slope, point + 1e-3)
        assert found == pytest.approx(point, abs=1e-9)
