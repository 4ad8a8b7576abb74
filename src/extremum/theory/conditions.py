"""When a linear system is stable, in its own letters: Routh–Hurwitz conditions and Routh's array.

A Jacobian falls into the strongly connected blocks of its sparsity pattern, and its characteristic
polynomial into one factor for each: the paper's (31) is (λ + h)(λ³ + a₁λ² + …)(λ³ + b₁λ² + …).
Each factor is judged by itself, in the form of Liénard and Chipart: every coefficient positive, and
every second Hurwitz determinant from the last but one down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import count
from typing import Any, Final, cast

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, ImmutableMatrix, Symbol

from ..errors import InvalidDescription
from .hurwitz import (
    LAMBDA,
    Coefficients,
    Inequality,
    Rule,
    factored,
    rules_of,
    terms,
    unwritten,
    vanishes,
)
from .routh import RouthArray, hurwitz_determinant, permanent, routh

MAX_TERMS: Final = 300
"""Terms beyond which a characteristic polynomial is not multiplied out at all."""


@dataclass(frozen=True)
class Condition(Inequality):
    """An `Inequality` with its numbers.

    Attributes
    ----------
    value
        The expression's value, in powers of 1/s.
    margin
        The distance to the boundary without a unit, −1 … 1: the value divided by the sum of its
        terms' absolute values. For a determinant the terms are its products of entries; for a
        coefficient that is not written out, its products of eigenvalues.
    states
        The states whose block it comes from.
    """

    value: float
    margin: float
    states: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def holds(self) -> bool:
        """Whether the value is positive."""
        return self.value > 0


def conditions(
    matrix: sympy.MatrixBase,
    symbols: Sequence[Symbol],
    values: Sequence[float],
    labels: Sequence[str] = (),
) -> tuple[Condition, ...]:
    """Return the conditions under which all eigenvalues of a matrix have Re λ < 0, with numbers.

    What is symbolic is worked out once for equal `matrix` and `symbols`; see `HurwitzSystem`.

    Parameters
    ----------
    matrix
        Square; its entries are expressions of `symbols`.
    values
        One number for each symbol.
    labels
        The states' names, to say which conditions are about which states.
    """
    return _system(cast(Any, ImmutableMatrix(matrix)), tuple(symbols), tuple(labels)).at(values)


@lru_cache(maxsize=64)
def _system(
    matrix: ImmutableMatrix, symbols: tuple[Symbol, ...], labels: tuple[str, ...]
) -> HurwitzSystem:
    return HurwitzSystem(matrix, symbols, labels)


# --- the matrix and its characteristic polynomial ---------------------------------------------


def blocks(matrix: sympy.MatrixBase) -> tuple[tuple[int, ...], ...]:
    """Return the strongly connected components of a matrix's sparsity pattern.

    Ordered by the first state of each. Reordered so, the matrix is block-triangular up to the
    order of the blocks, and its characteristic polynomial is the product of the blocks' ones.
    """
    size = matrix.rows
    reach = np.eye(size, dtype=bool)
    for i in range(size):
        for j in range(size):
            reach[i, j] |= not vanishes(cast(Expr, matrix[i, j]))
    for _ in range(size.bit_length()):
        reach = reach @ reach
    mutual = reach & reach.T
    return tuple(
        tuple(int(j) for j in np.flatnonzero(row))
        for i, row in enumerate(mutual)
        if not row[:i].any()
    )


def characteristic(matrix: sympy.MatrixBase) -> Coefficients:
    """Return (1, a₁, …, aₙ) with det(λ − A) = λⁿ + a₁λⁿ⁻¹ + … + aₙ.

    Multiplied out, common factors taken out: a₂ = α c k q for the paper's (31). Without division
    (Samuelson–Berkowitz); functions and denominators count as letters of their own.
    """
    from sympy.polys.matrices import DomainMatrix
    from sympy.polys.rings import sring

    size = matrix.rows
    entries = [cast(Expr, matrix[i, j]) for i in range(size) for j in range(size)]
    ring, (_, *elements) = cast(Any, sring([LAMBDA, *entries]))
    rows = [elements[i * size : (i + 1) * size] for i in range(size)]
    found = DomainMatrix(rows, (size, size), ring.to_domain()).charpoly()
    return tuple(factored(ring(a).as_expr()) for a in cast(Any, found))


def _is_short(matrix: ImmutableMatrix) -> bool:
    """Return whether det(λ − A) multiplied out has at most `MAX_TERMS` terms."""
    counts = [
        [terms(cast(Expr, matrix[i, j])) + (i == j) for j in range(matrix.rows)]
        for i in range(matrix.rows)
    ]
    return permanent(counts, MAX_TERMS) <= MAX_TERMS


# --- a Jacobian, symbolic once and then with numbers --------------------------------------------


@dataclass(frozen=True, eq=False)
class HurwitzSystem:
    """The stability conditions of ẋ = A(p) x for any numbers p.

    Attributes
    ----------
    matrix
        A, square, of expressions of `symbols`.
    symbols
        In the order in which `at` takes their values.
    labels
        The states' names, or nothing.
    """

    matrix: ImmutableMatrix
    symbols: tuple[Symbol, ...]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a matrix that is not square or has letters without a value."""
        rows, columns = self.matrix.shape
        if rows != columns:
            raise InvalidDescription("matrix", f"must be square; it is {rows} × {columns}")
        unknown = cast(set[Any], self.matrix.free_symbols) - set(self.symbols)
        if unknown:
            names = ", ".join(sorted(str(symbol) for symbol in unknown))
            raise InvalidDescription(
                "symbols", f"must name every letter of the matrix; add {names}"
            )

    @cached_property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """The states' indices, block by block."""
        return blocks(self.matrix)

    @cached_property
    def letters(self) -> tuple[str, ...]:
        """What each block's coefficients are called: a, b, …, but no parameter's letter."""
        taken = {symbol.name.partition("_")[0] for symbol in self.symbols}
        free = (name for name in _alphabet() if name not in taken)
        return tuple(name for _, name in zip(self.blocks, free, strict=False))

    @cached_property
    def polynomials(self) -> tuple[Coefficients | None, ...]:
        """Each block's (1, a₁, …, aₙ), or None where it would be too long to write."""
        parts = [self._part(block) for block in self.blocks]
        return tuple(characteristic(part) if _is_short(part) else None for part in parts)

    def _part(self, block: tuple[int, ...]) -> ImmutableMatrix:
        return ImmutableMatrix(self.matrix.extract(list(block), list(block)))

    @cached_property
    def _rules(self) -> list[list[Rule]]:
        known: set[Any] = set()
        rules: list[list[Rule]] = []
        for block, letter, polynomial in zip(
            self.blocks, self.letters, self.polynomials, strict=True
        ):
            if polynomial is None:
                rules.append(unwritten(self._part(block), letter))
                continue
            fresh = [] if polynomial in known else rules_of(polynomial, letter)
            rules.append([rule for rule in fresh if rule.inequality.expression not in known])
            known |= {polynomial, *(rule.inequality.expression for rule in fresh)}
        return rules

    @cached_property
    def inequalities(self) -> tuple[Inequality, ...]:
        """All conditions, block by block, without numbers."""
        return tuple(rule.inequality for rules in self._rules for rule in rules)

    @cached_property
    def _compiled(self) -> Callable[..., Any]:
        sums = [[list(rule.terms) for rule in rules] for rules in self._rules]
        factors = [
            self._part(block).tolist() if polynomial is None else list(polynomial)
            for block, polynomial in zip(self.blocks, self.polynomials, strict=True)
        ]
        return sympy.lambdify(
            [list(self.symbols)], [sums, factors], modules="math", cse=True, dummify=True
        )

    def _numbers(self, values: Sequence[float]) -> tuple[Any, list[_Factor]]:
        sums, factors = self._compiled([float(value) for value in values])
        return sums, [
            _Factor.of(np.array(factor, dtype=float))
            if polynomial is None
            else _Factor(tuple(map(float, factor)))
            for factor, polynomial in zip(factors, self.polynomials, strict=True)
        ]

    def coefficients(self, values: Sequence[float]) -> tuple[tuple[float, ...], ...]:
        """Return the numbers (1, a₁, …, aₙ) of each block."""
        return tuple(factor.coefficients for factor in self._numbers(values)[1])

    def routh(self, values: Sequence[float]) -> tuple[RouthArray, ...]:
        """Return Routh's array of each block."""
        return tuple(routh(coefficients) for coefficients in self.coefficients(values))

    def at(self, values: Sequence[float]) -> tuple[Condition, ...]:
        """Return every condition with its numbers; all hold if and only if every Re λ < 0."""
        sums, factors = self._numbers(values)
        found: list[Condition] = []
        for block, rules, parts, factor in zip(
            self.blocks, self._rules, sums, factors, strict=True
        ):
            states = tuple(self.labels[i] for i in block) if self.labels else ()
            for rule, summed in zip(rules, parts, strict=True):
                stated = rule.inequality
                value, margin = _summed(summed) if summed else factor.value(rule)
                found.append(
                    Condition(
                        stated.name,
                        stated.expression,
                        value,
                        margin,
                        where=stated.where,
                        states=states,
                    )
                )
        return tuple(found)


def _summed(parts: Sequence[float]) -> tuple[float, float]:
    value, size = math.fsum(parts), math.fsum(map(abs, parts))
    return value, value / size if value else 0.0


@dataclass(frozen=True)
class _Factor:
    """One block's characteristic polynomial in numbers.

    `sizes` are its coefficients with every eigenvalue replaced by −|λ|, if it comes from them.
    """

    coefficients: tuple[float, ...]
    sizes: tuple[float, ...] = ()

    @staticmethod
    def of(block: NDArray[np.float64]) -> _Factor:
        eigenvalues = np.linalg.eigvals(block)
        return _Factor(tuple(np.poly(eigenvalues)), tuple(np.poly(-abs(eigenvalues))))

    def value(self, rule: Rule) -> tuple[float, float]:
        """Return the value and the margin of Δₖ or aₖ."""
        if rule.determinant:
            return hurwitz_determinant(self.coefficients, rule.determinant)
        value, size = self.coefficients[rule.coefficient], self.sizes[rule.coefficient]
        return float(value), float(value / max(size, abs(value))) if value else 0.0


def _alphabet() -> Iterator[str]:
    for number in count(1):
        yield from (letter if number == 1 else f"{letter}{number}" for letter in "abdgmnruvw")
