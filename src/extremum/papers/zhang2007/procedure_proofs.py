"""Why the corrected design rules hold for every curvature and every pole within their bounds.

In each condition the letters are replaced by their bounds and what is left beyond them, the slack:
q = q_low + u, ε = ε_high − v, and so on. Written out, every condition is a sum of products of
positive numbers and of slacks that are not negative, so it is positive everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import sympy
from sympy import Expr, Poly, Symbol

from ...printing import expression_text
from ...theory.hurwitz import LAMBDA
from ...theory.paper_laws import Axis, corrected

Q: Final = Symbol("q", real=True)
EPSILON: Final = Symbol("epsilon", real=True)
Z: Final = Symbol("z", real=True)
P: Final = Symbol("p", real=True)
K: Final = Symbol("K", positive=True)
"""α c k, so that g = K q."""
Q_LOW: Final = Symbol("q_low", positive=True)
EPSILON_HIGH: Final = Symbol("epsilon_high", positive=True)
SIGMA: Final = Symbol("sigma", positive=True)
"""The decay rate that a double integrator's design asks for (1/s)."""
U: Final = Symbol("u", nonnegative=True)
V: Final = Symbol("v", nonnegative=True)
W: Final = Symbol("w", positive=True)
Y: Final = Symbol("y", positive=True)
N: Final = Symbol("n", nonnegative=True)
M: Final = Symbol("m", positive=True)


@dataclass(frozen=True)
class Proof:
    """A stability condition, positive throughout the bounds.

    Attributes
    ----------
    condition
        What must be positive, in the paper's letters and K = α c k.
    slacks
        Letters as bound and slack, in the order in which they are put in.
    multiplier
        A positive factor that makes the sum a polynomial.
    """

    condition: Expr
    slacks: tuple[tuple[Symbol, Expr], ...]
    multiplier: Expr = sympy.S.One

    @property
    def expanded(self) -> Expr:
        """The condition times the multiplier, written out in bounds and slacks."""
        found: Any = self.condition
        for letter, law in self.slacks:
            found = found.subs(letter, law)
        return sympy.expand(sympy.cancel(self.multiplier * found))

    @property
    def holds(self) -> bool:
        """Whether the signs of bounds and slacks alone make the sum positive."""
        return bool(self.expanded.is_positive)

    def __str__(self) -> str:
        left = expression_text(self.condition)
        if self.multiplier != 1:
            left = f"{expression_text(self.multiplier)} ({left})"
        return f"{left} = {expression_text(self.expanded)}"


def of_unstable_poles() -> tuple[Proof, ...]:
    """Return the proofs for K > ε_high/(2 q_low), p = −K q_low, z < −ε_high.

    Conditions (60) and (61), corrected: g − ε − p > 0 and pε − gz > 0. Slacks: q = q_low + u,
    ε = ε_high − v, K = ε_high/(2 q_low) + w, z = −ε_high − y; u, v ≥ 0, w, y > 0. At the worst
    corner, u = v = 0, the sums are 2 q_low w and q_low y: the rules are necessary too.
    """
    slacks: list[tuple[Symbol, Any]] = [
        (P, -K * Q_LOW),
        (Q, Q_LOW + U),
        (EPSILON, EPSILON_HIGH - V),
        (Z, -EPSILON_HIGH - Y),
    ]
    axis = Axis("x", K * Q, EPSILON, Z, P, Symbol("x^*"), sympy.Integer(0))
    damping, stiffness = corrected(4, axis)[0]
    return (
        Proof(damping, (*slacks, (K, EPSILON_HIGH / (2 * Q_LOW) + W))),
        Proof(stiffness, tuple(slacks), 1 / K),
    )


def of_double_integrators() -> tuple[Proof, ...]:
    """Return the proofs for z ≤ −σ, p = z − 2σ − m, m > 0, K > 2σ(z − m)²/(q_low m).

    The conditions a₁ > 0, a₃ > 0, a₁a₂ − a₃ > 0, of λ³ − pλ² + gλ − gz with λ − σ for λ: every
    root has Re λ < −σ; a₂ > 0 follows. Slacks: q = q_low + u, z = −σ − n, K as stated plus w, and
    m; u, n ≥ 0, w, m > 0. The rules are necessary too: as q grows, n < 0 makes a₃ negative and
    m ≤ 0 the last one; at q_low, w < 0 does.
    """
    slacks: list[tuple[Symbol, Any]] = [
        (Q, Q_LOW + U),
        (K, 2 * SIGMA * (Z - M) ** 2 / (Q_LOW * M) + W),
        (P, Z - 2 * SIGMA - M),
        (Z, -SIGMA - N),
    ]
    free = tuple((letter, law) for letter, law in slacks if letter != K)
    axis = Axis("x", K * Q, sympy.Integer(0), Z, P, Symbol("x^*"), sympy.Integer(0))
    polynomial: Any = corrected(2, axis)[1]
    _, a1, a2, a3 = Poly(polynomial.subs(LAMBDA, LAMBDA - SIGMA), LAMBDA).all_coeffs()
    last = sympy.expand(a1 * a2 - a3)
    return (Proof(a1, free), Proof(a3, free), Proof(last, tuple(slacks), Q_LOW))
