"""The averaged loop's equilibrium in closed form, where it has one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import sympy
from sympy import Expr, Symbol
from sympy.polys.matrices import DomainMatrix

from ..symbols import substituted
from ..symbols import t as time
from .averaged import Averaged
from .drift import drift
from .hurwitz import summands
from .routh import permanent

MAX_TERMS: Final = 40
"""Terms of a determinant beyond which no closed form is looked for, unless the solution is 0."""


@lru_cache(maxsize=256)
def held(averaged: Averaged) -> tuple[Expr, ...]:
    """Return the rates with the source at its mean place, moving at its mean velocity."""
    slow = averaged.equations.slow
    table: dict[Symbol, Expr] = {time: sympy.Integer(0)}
    for (place, path), (velocity, _) in zip(slow[::2], slow[1::2], strict=True):
        found = drift(path)
        table |= {place: found.place, velocity: found.velocity}
    return tuple(substituted(rate, table) for rate in averaged.rates)


@lru_cache(maxsize=256)
def equilibrium_steps(averaged: Averaged) -> dict[Symbol, Expr] | None:
    """Return the equilibrium, each state in terms of the parameters and of states found before.

    Solved group by group of states that depend on each other, as long as the rates are linear in
    the group; states that are zero are put in. None where a group is too large to be read or not
    linear, or its matrix is singular whatever the parameters.
    """
    if averaged.moments is not None:
        return None
    states = averaged.equations.states
    pending = dict(zip(states, held(averaged), strict=True))
    known: dict[Symbol, Expr] = {}
    zero = sympy.Integer(0)
    while pending:
        group = _group(pending)
        zeros = {x: e for x, e in known.items() if e == 0}
        rows = [sympy.expand(substituted(pending[x], zeros)) for x in group]
        matrix = sympy.Matrix(rows).jacobian(group)
        constant = sympy.Matrix([substituted(row, dict.fromkeys(group, zero)) for row in rows])
        if matrix.has(*group):
            return None
        if constant.is_zero_matrix:
            known |= dict.fromkeys(group, zero)
            pending = {x: e for x, e in pending.items() if x not in group}
            continue
        counts = [[len(summands(e)) if e != 0 else 0 for e in row] for row in matrix.tolist()]
        if permanent(counts, MAX_TERMS) >= MAX_TERMS:
            return None
        solved, determinant = _cramer(matrix, constant)
        if determinant == 0:
            return None
        for x, e in zip(group, solved, strict=True):
            known[x] = quotient(e, determinant)
            del pending[x]
    return {x: known[x] for x in states}


def _cramer(matrix: Any, constant: Any) -> tuple[list[Expr], Expr]:
    """Return det Mᵢ and det M of M x = −constant, Mᵢ with −constant for its column i.

    They are worked out with one letter for each entry: few terms, whatever the entries are, where
    elimination would divide the entries by each other and cancel for ever.
    """
    whole = matrix.row_join(-constant)
    letters = whole.applyfunc(lambda e: sympy.Dummy() if e != 0 else e)
    table = {x: e for x, e in zip(letters.flat(), whole.flat(), strict=True) if e != 0}
    count = matrix.rows

    def determinant(columns: Sequence[int]) -> Expr:
        chosen = DomainMatrix.from_Matrix(letters[:, list(columns)])
        return substituted(chosen.domain.to_sympy(chosen.det()), table)

    replaced = [[*range(i), count, *range(i + 1, count)] for i in range(count)]
    found = determinant(range(count))
    return [determinant(columns) for columns in replaced], sympy.expand(found)


def quotient(numerator: Any, determinant: Any) -> Any:
    """Return a quotient in lowest terms, or as it is where that would take long."""
    size = len(summands(numerator)) * len(summands(determinant))
    whole = numerator / determinant
    return sympy.factor(sympy.cancel(whole)) if size <= MAX_TERMS else whole


@lru_cache(maxsize=256)
def equilibrium_law(averaged: Averaged) -> dict[Symbol, Expr] | None:
    """Return the equilibrium in the parameters alone; None where there is no closed form."""
    steps = equilibrium_steps(averaged)
    if steps is None:
        return None
    law = steps
    while any(e.has(*steps) for e in law.values()):
        law = {x: substituted(e, steps) for x, e in law.items()}
    return law


def _group(pending: dict[Symbol, Expr]) -> list[Symbol]:
    """Return the smallest set of states whose rates depend on no other pending state."""
    groups: list[list[Symbol]] = []
    for start in pending:
        group, todo = set[Symbol](), [start]
        while todo:
            x = todo.pop()
            if x not in group:
                group.add(x)
                todo += [y for y in pending if pending[x].has(y)]
        groups.append([x for x in pending if x in group])
    return min(groups, key=len)
