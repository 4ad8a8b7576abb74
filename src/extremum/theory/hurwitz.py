"""Routh–Hurwitz conditions of a polynomial with letters for coefficients, to be read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, cast

import sympy
from sympy import Add, Determinant, Eq, Expr, ImmutableMatrix, Mul, Symbol

from ..errors import InvalidDescription, shown
from ..printing import expression_text
from .routh import hurwitz_rows, permanent

WRITTEN_DEGREE: Final = 4
"""Polynomials up to this degree have their determinants multiplied out in the parameters."""
MAX_WRITTEN: Final = 40
"""Terms beyond which a condition is stated in the coefficients' letters."""
MAX_FACTORED: Final = 24
"""Terms beyond which what is left of a sum is not factored."""

LAMBDA: Final = Symbol("lambda")

Coefficients = tuple[Expr, ...]


@dataclass(frozen=True)
class Inequality:
    """expression > 0.

    Attributes
    ----------
    name
        What it is in the characteristic polynomial λⁿ + a₁λⁿ⁻¹ + … + aₙ: ``a_1 a_2 - a_3``.
    expression
        The same in the parameters, or in the coefficients' letters where that would be too long.
    where
        What the letters are: equations letter = expression, or, where even those would be too
        long, λⁿ + a₁λⁿ⁻¹ + … = det(λ − A).
    """

    name: str
    expression: Expr
    where: tuple[Eq, ...] = field(default=(), kw_only=True)

    def text(self) -> str:
        """Return the inequality as one line of text, ``-α_x c_x k_x q_x z_x > 0``."""
        return f"{_text(self.expression)} > 0"

    def latex(self) -> str:
        """Return the inequality in LaTeX."""
        return f"{sympy.latex(self.expression)} > 0"

    def definitions(self) -> tuple[str, ...]:
        """Return what the letters are, one line of text for each equation of `where`."""
        return tuple(f"{_text(e.lhs)} = {_text(e.rhs)}" for e in cast(Any, self.where))


def hurwitz(coefficients: Sequence[Any], letter: str = "a") -> tuple[Inequality, ...]:
    """Return the conditions under which all roots of a symbolic polynomial have Re λ < 0.

    Liénard and Chipart: with the leading coefficient made 1, all aᵢ > 0 and Δₙ₋₁ > 0, Δₙ₋₃ > 0, …
    down to Δ₂ or Δ₃, where Δₖ = det[a₂ⱼ₋ᵢ], i, j = 1 … k. Up to degree 4 they are multiplied out in
    the parameters, beyond, or where that would be long, they stand in the letters aᵢ. Equal ones
    are stated once, and what is a positive number whatever the symbols are not at all.

    Parameters
    ----------
    coefficients
        Highest power first.
    letter
        What the coefficients are called.
    """
    given = [cast(Expr, sympy.sympify(c)) for c in coefficients]
    if not given or vanishes(given[0]):
        raise InvalidDescription("coefficients", "must begin with one that is not 0", shown(given))
    if given[0] != 1:
        given = [factored(sympy.cancel(c / given[0])) for c in given]
    return tuple(rule.inequality for rule in rules_of(tuple(given), letter))


@dataclass(frozen=True)
class Rule:
    """How an inequality gets its numbers: as a sum of `terms`, or as a_k or Δ_k of the block."""

    inequality: Inequality
    terms: tuple[Expr, ...] = ()
    coefficient: int = 0
    determinant: int = 0


def rules_of(coefficients: Coefficients, letter: str) -> list[Rule]:
    """Return the rules of a polynomial that begins with 1; see `hurwitz`."""
    degree = len(coefficients) - 1
    named = _named(letter, degree)
    where = tuple(
        cast(Eq, Eq(a, e, evaluate=False)) for a, e in zip(named[1:], coefficients[1:], strict=True)
    )
    lettered = any(c.free_symbols for c in coefficients)
    rules: dict[Expr, Rule] = {}
    for a, expression, equation in zip(named[1:], coefficients[1:], where, strict=True):
        if lettered and expression.is_number and expression.is_positive:
            continue
        parts = summands(expression)
        short = len(parts) <= MAX_WRITTEN
        stated = Inequality(a.name, expression if short else a, where=() if short else (equation,))
        rules.setdefault(stated.expression, Rule(stated, parts))
    for order in _orders(degree):
        stated = _determinant(order, named, where)
        if degree > WRITTEN_DEGREE or not _short_determinant(order, coefficients):
            rules[stated.expression] = Rule(stated, determinant=order)
            continue
        table = dict(zip(named[1:], coefficients[1:], strict=True))
        parts = summands(stated.expression.xreplace(table))
        product = factored(Add(*parts))
        rules.setdefault(product, Rule(Inequality(stated.name, product), parts))
    return list(rules.values())


def unwritten(block: ImmutableMatrix, letter: str) -> list[Rule]:
    """Return the rules of a block whose characteristic polynomial is too long to write."""
    degree = block.rows
    named = _named(letter, degree)
    polynomial = Add(*(a * LAMBDA ** (degree - i) for i, a in enumerate(named)))
    shifted = ImmutableMatrix(LAMBDA * sympy.eye(degree) - block)
    where = (cast(Eq, Eq(polynomial, Determinant(shifted), evaluate=False)),)
    letters = [Inequality(a.name, a, where=where) for a in named[1:]]
    rules = [Rule(stated, coefficient=i) for i, stated in enumerate(letters, 1)]
    for order in _orders(degree):
        stated = _determinant(order, named, ())
        stated = Inequality(stated.name, stated.expression, where=where)
        rules.append(Rule(stated, determinant=order))
    return rules


def _orders(degree: int) -> range:
    return range(degree - 1, 1, -2)


def _named(letter: str, degree: int) -> list[Any]:
    return [sympy.Integer(1), *(Symbol(f"{letter}_{i}", real=True) for i in range(1, degree + 1))]


def _determinant(order: int, named: Sequence[Any], where: Sequence[Eq]) -> Inequality:
    matrix = ImmutableMatrix(hurwitz_rows(named, order))
    used = tuple(e for e in where if cast(Any, e).lhs in matrix.free_symbols)
    if order > 3:
        return Inequality(f"Δ_{order}", Determinant(matrix), where=used)
    product = sympy.expand(cast(Any, matrix.det(method="berkowitz")))
    return Inequality(_text(product), product, where=used)


def _short_determinant(order: int, coefficients: Coefficients) -> bool:
    counts = hurwitz_rows([terms(c) for c in coefficients], order)
    return permanent(counts, MAX_WRITTEN) <= MAX_WRITTEN


def _text(expression: Expr) -> str:
    if isinstance(expression, Determinant):
        rows = cast(Any, expression.arg).tolist()
        return f"det[{'; '.join(', '.join(map(expression_text, row)) for row in rows)}]"
    parts: list[Any] = sorted(cast(Any, expression).as_ordered_terms(), key=_is_negative)
    return " + ".join(map(expression_text, parts)).replace("+ -", "- ")


def _is_negative(part: Any) -> bool:
    return bool(part.as_coeff_Mul()[0].is_negative)


def terms(expression: Expr) -> int:
    """Return how many terms an expression has when it is multiplied out, 0 if it vanishes."""
    return 0 if vanishes(expression) else len(summands(expression))


def summands(expression: Any) -> tuple[Expr, ...]:
    """Return an expression's terms when it is multiplied out."""
    return Add.make_args(sympy.expand(expression))


def factored(expression: Any) -> Expr:
    """Return an expression with what its terms share taken out, and what is left then factored.

    Sums that share no letter, such as g − ε − p, are left as they are.
    """
    product = sympy.factor_terms(expression)
    factors: Any = Mul.make_args(product)
    if any(f.free_symbols and not f.is_Add for f in factors) and not product.atoms(sympy.Float):
        short = [f.is_Add and len(f.args) <= MAX_FACTORED for f in factors]
        factors = [sympy.factor(f) if s else f for f, s in zip(factors, short, strict=True)]
        return cast(Expr, Mul(*factors))
    return cast(Expr, product)


def vanishes(expression: Expr) -> bool:
    """Return whether an expression is 0 when it is multiplied out."""
    return expression == 0 or bool(sympy.expand(expression).is_zero)
