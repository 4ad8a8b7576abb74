"""Where an averaged loop can rest: every real solution of polynomial equations, or the nearest one.

Polynomials are solved completely: unknowns that stand alone in an equation are eliminated, what is
left falls into independent parts, and each part's solutions are the joint eigenvalues of
multiplication by the unknowns modulo the equations (Stickelberger; Cox, Little and O'Shea, *Using
Algebraic Geometry*, §2.4), from a Gröbner basis over the rational numbers that the floats state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import QQ, Expr, Poly, PolynomialError, Symbol
from sympy.polys.groebnertools import groebner
from sympy.polys.orderings import grevlex
from sympy.polys.rings import PolyRing

from ..errors import InvalidDescription, shown
from ..symbols import decimals_exact, exact
from .polynomials import ZERO, Numeric

Array = NDArray[np.float64]

GREVLEX: Final[Any] = grevlex
STEPS: Final = 100
TOLERANCE: Final = 1e-10
"""`nearest` is done when Newton's step is smaller, in units of the unknowns' scale."""
FLAT: Final = 1e-3
"""Values must also be smaller than this times the slopes: a function that fades away is no zero."""
SHORTEST: Final = 2.0**-20
"""The shortest part of Newton's step that `nearest` tries."""


def real_solutions(
    equations: Sequence[Expr], unknowns: Sequence[Symbol], *, limit: int = 64
) -> list[Array]:
    """Return all real solutions of polynomial equations, nearest to the origin first.

    Solutions that rounding cannot tell apart are one: a double root is returned once, with about
    half the digits, and so is a pair of complex ones whose imaginary part is at that level.

    Parameters
    ----------
    equations
        Expressions that are to vanish, polynomials of `unknowns` with numbers as coefficients.
        Floats are the decimals they state: what rounding has left of a cancellation, 1e-17·x³, is
        a term, and brings solutions far away.
    unknowns
        As many as equations.
    limit
        Refuse more solutions, counted as the product of the degrees after elimination.

    Raises
    ------
    InvalidDescription
        If an equation is not such a polynomial, if the product of the degrees exceeds `limit`, or
        if there are infinitely many (complex) solutions.
    """
    ring = PolyRing(tuple(unknowns), QQ, GREVLEX)
    left, solved = _eliminated([_polynomial(e, unknowns, ring) for e in equations], ring)
    if any(p.is_ground for p in left):
        return []
    count = _bezout(left)
    if count > limit:
        raise InvalidDescription(
            "equations",
            f"may have {count} solutions, more than {limit}; give a guess and use `nearest`, or "
            "raise the limit",
        )
    free = set(range(len(unknowns))) - {index for index, _ in solved}
    parts = _parts(left, free)
    found = [_solutions(polynomials, indices, ring) for indices, polynomials in parts]
    known = [(index, Numeric.of([expression])) for index, expression in reversed(solved)]
    solutions: list[Array] = []
    for combined in product(*found):
        point = np.zeros(len(unknowns))
        for (indices, _), values in zip(parts, combined, strict=True):
            point[list(indices)] = values
        for index, expression in known:
            point[index] = expression.values(point)[0]
        solutions.append(point)
    return sorted(solutions, key=lambda x: (float(f"{np.linalg.norm(x):.9g}"), *x))


def nearest(
    function: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    guess: Array,
    *,
    scale: float | Array = 1.0,
) -> Array | None:
    """Return the solution of f(x) = 0 that Newton's method finds from a guess, None without one.

    Each step is at most as long as max(1, |x|) in units of `scale`, and halved until |f| falls.

    Parameters
    ----------
    function, jacobian
        x (n,) → f (n,) and ∂f/∂x (n, n), smooth; values that are not finite shorten the step.
    guess
        x to start from (n,).
    scale
        What is a typical size of the unknowns, one number or (n,); the solution is accurate to
        1e-10 of it, or to half the digits if the Jacobian is singular there.
    """
    units = np.broadcast_to(np.asarray(scale, dtype=float), np.shape(guess))
    y = np.asarray(guess, dtype=float) / units
    values, slopes = function(y * units), jacobian(y * units) * units
    level = abs(values) + abs(slopes).sum(axis=1)
    level[level == 0] = 1.0
    for _ in range(STEPS):
        if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
            return None
        step = _step(values / level, slopes / level[:, None])
        length, reach = float(np.linalg.norm(step)), max(1.0, float(np.linalg.norm(y)))
        small = bool((abs(values) <= FLAT * abs(slopes).sum(axis=1) * reach).all())
        if small and length <= TOLERANCE * reach:
            return (y + step) * units
        error = float(np.linalg.norm(values / level))
        part = min(1.0, reach / length) if length else 0.0
        while part >= SHORTEST:
            values = function((y + part * step) * units)
            if float(np.linalg.norm(values / level)) < (1 - part / 10_000) * error:
                break
            part /= 2
        else:
            return y * units if small and error <= TOLERANCE else None
        y = y + part * step
        slopes = jacobian(y * units) * units
    return None


def first_step(values: Array, slopes: Array) -> Array:
    """Return Newton's step −f/f′ from where f and ∂f/∂x are given: how far the unknowns reach."""
    level = abs(values) + abs(slopes).sum(axis=1)
    level[level == 0] = 1.0
    return _step(values / level, slopes / level[:, None])


def _step(values: Array, slopes: Array) -> Array:
    sizes = abs(slopes).max(axis=0)
    sizes[sizes == 0] = 1.0
    return np.linalg.lstsq(slopes / sizes, -values, rcond=None)[0] / sizes


# --- from expressions to polynomials ----------------------------------------------------------


def _polynomial(equation: Expr, unknowns: Sequence[Symbol], ring: PolyRing) -> Any:
    try:
        terms = Poly(decimals_exact(equation), *unknowns).terms()
        numbers = {powers: _rational(coefficient) for powers, coefficient in terms}
    except (PolynomialError, TypeError) as error:
        names = ", ".join(map(str, unknowns))
        raise InvalidDescription(
            "equations",
            f"must be polynomials of {names} with finite real coefficients ({error})",
            shown(str(equation)),
        ) from None
    return ring.from_dict({powers: QQ(c.p, c.q) for powers, c in numbers.items() if c})


def _rational(coefficient: Any) -> sympy.Rational:
    if isinstance(coefficient, sympy.Rational):
        return coefficient
    number = float(coefficient)
    if not math.isfinite(number):
        raise TypeError(f"{number} is not finite")
    return exact(number)


def _degree(polynomial: Any) -> int:
    return max(map(sum, polynomial.monoms()))


def _bezout(polynomials: Sequence[Any]) -> int:
    return math.prod(_degree(p) for p in polynomials)


def _eliminated(
    polynomials: Sequence[Any], ring: PolyRing
) -> tuple[list[Any], list[tuple[int, Any]]]:
    """Return what is left, and the unknowns' expressions in the order of their elimination.

    An unknown is eliminated with an equation in which it stands alone, as c·x with a number c, if
    the equation is linear or the product of the degrees falls.
    """
    left = [p for p in polynomials if p]
    solved: list[tuple[int, Any]] = []
    while not any(p.is_ground for p in left):
        for at, index in _pivots(left):
            x, pivot = ring.gens[index], left[at]
            expression = x - pivot * (1 / pivot.coeff(x))
            others = [p.compose(x, expression) for p in (*left[:at], *left[at + 1 :])]
            others = [p for p in others if p]
            if _degree(pivot) == 1 or _bezout(others) < _bezout(left):
                left = others
                solved.append((index, expression))
                break
        else:
            break
    return left, solved


def _pivots(polynomials: Sequence[Any]) -> list[tuple[int, int]]:
    """Return the equations' and unknowns' indices that allow an elimination, the best first."""
    found: list[tuple[int, float, int, int]] = []
    for at, polynomial in enumerate(polynomials):
        sizes = {powers: abs(float(c)) for powers, c in polynomial.terms()}
        for powers, size in sizes.items():
            if sum(powers) != 1:
                continue
            index = powers.index(1)
            if sum(bool(other[index]) for other in sizes) == 1:
                found.append((_degree(polynomial), max(sizes.values()) / size, at, index))
    return [(at, index) for _, _, at, index in sorted(found)]


def _parts(polynomials: Sequence[Any], free: set[int]) -> list[tuple[tuple[int, ...], list[Any]]]:
    """Return the sets of unknowns that no equation links, each with its equations."""
    parts: list[tuple[set[int], list[Any]]] = [({index}, []) for index in sorted(free)]
    for polynomial in polynomials:
        used = {i for powers in polynomial.monoms() for i, power in enumerate(powers) if power}
        joined = [part for part in parts if part[0] & used]
        parts = [part for part in parts if not part[0] & used]
        merged = [p for _, inner in joined for p in inner]
        parts.append((set().union(*(own for own, _ in joined)), [*merged, polynomial]))
    return [(tuple(sorted(indices)), inner) for indices, inner in parts]


# --- one part ---------------------------------------------------------------------------------


def _solutions(polynomials: Sequence[Any], indices: tuple[int, ...], ring: PolyRing) -> list[Array]:
    names = tuple(ring.symbols[i] for i in indices)
    small = PolyRing(names, QQ, GREVLEX)
    if not polynomials:
        raise _undetermined(names)
    exponents = [
        {tuple(powers[i] for i in indices): c for powers, c in p.terms()} for p in polynomials
    ]
    scaled, units = _scaled(exponents, len(indices))
    system = [small.from_dict(p) for p in scaled]
    basis = groebner(system, small, method="f5b")
    if any(g.is_ground for g in basis):
        return []
    leading = [g.LM for g in basis]
    free = [x for i, x in enumerate(names) if not any(sum(m) == m[i] for m in leading)]
    if free:
        raise _undetermined(free)
    numeric = Numeric.of(system)
    matrices = _multiplications(basis, leading, small)
    candidates = _joint_eigenvalues(matrices)
    if not numeric.leads_everywhere(candidates):
        candidates = _joint_eigenvalues_precisely(matrices)
    found = numeric.distinct([numeric.polished(start) for start in candidates.real])
    centred = [numeric.centred(point, candidates) for point in found]
    return [np.where(abs(point) <= ZERO, 0.0, point) * units for point in centred]


def _undetermined(free: Sequence[Any]) -> InvalidDescription:
    names = ", ".join(map(str, free))
    return InvalidDescription(
        "equations",
        f"have infinitely many solutions (complex ones counted): nothing fixes {names}; give a "
        "guess and use `nearest`",
    )


def _scaled(
    polynomials: Sequence[dict[tuple[int, ...], Any]], count: int
) -> tuple[list[dict[tuple[int, ...], Any]], Array]:
    """Return the equations in units, powers of 2, that bring their coefficients close to 1.

    Least squares of log₂|coefficient| over the units of unknowns and equations.
    """
    rows: list[list[float]] = []
    sizes: list[float] = []
    for k, polynomial in enumerate(polynomials):
        for powers, c in polynomial.items():
            rows.append([*powers, *(-1.0 if k == j else 0.0 for j in range(len(polynomials)))])
            sizes.append(-math.log2(abs(c.numerator)) + math.log2(c.denominator))
    fitted = np.linalg.lstsq(np.array(rows), np.array(sizes), rcond=None)[0]
    exponents = [round(e) for e in fitted]
    scaled = [
        {
            m: c * QQ(2) ** (sum(map(int.__mul__, m, exponents[:count])) - exponents[count + k])
            for m, c in polynomial.items()
        }
        for k, polynomial in enumerate(polynomials)
    ]
    return scaled, np.array([2.0**e for e in exponents[:count]])


def _multiplications(basis: Sequence[Any], leading: Sequence[Any], ring: PolyRing) -> list[Any]:
    """Return, for each unknown x, the matrix with x·bₖ = Σ Tₖⱼ bⱼ modulo the equations.

    b are the standard monomials, those that no leading monomial of the basis divides.
    """
    count = len(ring.gens)
    monomials = [(0,) * count]
    for monomial in monomials:
        for i in range(count):
            larger = _times(monomial, i)
            if larger not in monomials and not any(_divides(m, larger) for m in leading):
                monomials.append(larger)
    matrices: list[Any] = []
    for i in range(count):
        products = [ring.from_dict({_times(m, i): QQ(1)}).rem(basis) for m in monomials]
        matrices.append([[remainder.get(m, QQ(0)) for m in monomials] for remainder in products])
    return matrices


def _joint_eigenvalues(matrices: Sequence[Any]) -> NDArray[np.complex128]:
    """Return all complex solutions, roughly: shape (solution, unknown).

    The standard monomials at a solution are a common eigenvector of the matrices; it is taken from
    a random combination of them.
    """
    tables = np.array(matrices, dtype=float)
    _, vectors = np.linalg.eig(np.tensordot(_weights(len(matrices)), tables, 1))
    return np.einsum("jv,ijk,kv->vi", vectors.conj(), tables, vectors)


def _joint_eigenvalues_precisely(matrices: Sequence[Any]) -> NDArray[np.complex128]:
    """Return the same with 50 digits on the way, for solutions of very different sizes."""
    import mpmath

    with mpmath.workdps(50):
        tables: list[Any] = [
            mpmath.matrix([[mpmath.mpf(c.numerator) / c.denominator for c in row] for row in rows])
            for rows in matrices
        ]
        mixed: Any = mpmath.zeros(tables[0].rows)
        for table, weight in zip(tables, _weights(len(tables)), strict=True):
            mixed += table * weight
        _, columns = mpmath.eig(mixed)
        vectors = [columns[:, k] for k in range(columns.cols)]
        found = [[complex((v.H * t * v)[0] / (v.H * v)[0]) for t in tables] for v in vectors]
    return np.array(found)


def _weights(count: int) -> Array:
    return np.random.default_rng(0).uniform(1, 2, count)


def _times(monomial: tuple[int, ...], index: int) -> tuple[int, ...]:
    return tuple(power + (index == j) for j, power in enumerate(monomial))


def _divides(smaller: tuple[int, ...], larger: tuple[int, ...]) -> bool:
    return all(a <= b for a, b in zip(smaller, larger, strict=True))
