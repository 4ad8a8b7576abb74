"""Proofs that the averaged loop is stable at every point of a box of uncertain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

import numpy as np
from sympy import Expr, Poly, Symbol

from .families import Exact, Family, edges, family_of, fraction
from .searches import Member, on_edge, skeleton, slowest, unstable
from .segments import apart, crosses, is_hurwitz, shifted
from .separation import Part, separable_parts

MAX_PARTS: Final = 128
"""A box is cut into at most so many parts before the mapping theorem gives up, …"""
MAX_POLYNOMIALS: Final = 20_000
"""… or into as many as are bounded by so many polynomials."""
BELOW: Final = 1e-3
"""How far below the slowest root that was seen a decay rate is proved, at first."""
NEAR: Final = 0.02
"""Where P is not affine and the slowest root is out of reach, how near to stop below what fails."""
ROUNDS: Final = 10
"""Bisections, and attempts that each stay twice as far below, for the largest decay rate."""


@dataclass(frozen=True)
class Counterexample:
    """A point of the box where a root has Re λ ≥ −decay.

    Attributes
    ----------
    point
        The value of each symbol of the box.
    root
        λ (1/s).
    """

    point: Mapping[Symbol, float]
    root: complex

    def text(self) -> str:
        """Return the point and its root as text."""
        at = ", ".join(f"{symbol} = {value:.6g}" for symbol, value in self.point.items())
        root = f"{self.root.real:.6g}"
        root += f" ± {self.root.imag:.6g}j" if self.root.imag else ""
        return f"at {at} a root is {root} 1/s" if at else f"a root is {root} 1/s"


@dataclass(frozen=True)
class Proof:
    """What is proved of the averaged loop over a box; made by `prove`.

    Attributes
    ----------
    holds
        Whether it is proved, in exact arithmetic.
    method
        ``"Routh's array"``, ``"edge theorem"``, ``"mapping theorem"``, ``"Bernstein expansion"`` or
        ``"Hessian eigenvalues"``.
    decay
        What was to be proved: every root has Re λ < −decay (1/s).
    tested
        How many segments between two polynomials (edge theorem) or polynomials were tested exactly.
    counterexample
        Where it is wrong; None if it holds, and if it is neither proved nor refuted. Its point is
        exact unless the root only touches Re λ = −decay.
    statement
        What is proved, refuted or left open, in words.
    """

    holds: bool
    method: str
    decay: float
    tested: int
    counterexample: Counterexample | None
    statement: str

    def __str__(self) -> str:
        return self.statement


def prove(
    polynomial: Expr | Poly, box: Mapping[Symbol, tuple[float, float]], decay: float = 0.0
) -> Proof:
    """Return a proof that all roots of P(s, p) have Re λ < −decay for every p in a box.

    A proof is worked out in integers, floats being the decimals that they state: nothing is
    rounded. How, depends on the coefficients of P as functions of the box's n symbols:

    - affine: by the edge theorem the roots of all members have Re λ < −decay if and only if those
      along the 2ⁿ⁻¹ n edges of the box have, each of which is tested;
    - with products of different symbols: by the mapping theorem the values of P over the box lie,
      at every s, in the convex hull of those at its corners. A polynomial C(s) is sought with
      Re P(jω − decay) C(jω − decay)* > 0 at every ω for the corners' P, and so for all: none is 0
      there. Each corner is tested with C, which is sufficient only. Where it fails the box is cut
      in two, into at most 128 parts;
    - with powers of a symbol: the same, with the Bernstein coefficients of P for the corners' P.

    The leading coefficient may not vanish in the box. Symbols of the box that P does not depend on
    are ignored. `characteristic` and `coupled` state P for a loop.

    Parameters
    ----------
    polynomial
        A polynomial in `s`, its coefficients polynomials in the box's symbols.
    box
        (low, high) of each symbol.
    decay
        In 1/s.

    Raises
    ------
    InvalidDescription
        If P is no such polynomial or the box is none; see `families.family_of`.

    Source: Bartlett, Hollot and Lin (1988), Mathematics of Control, Signals and Systems 1, 61–71;
    Zadeh and Desoer (1963), Linear System Theory, 9.17; Zettler and Garloff (1998), IEEE
    Transactions on Automatic Control 43(3), 425–431.
    """
    return _proof(family_of(polynomial, box), fraction("decay", decay))


def largest_decay(polynomial: Expr | Poly, box: Mapping[Symbol, tuple[float, float]]) -> Proof:
    """Return the proof of the largest decay rate that is found, which is its `decay`.

    The slowest root is sought over the box in floats, and what is 0.1 % below it, cut to four
    digits, is proved. Where P is not affine and that is out of the mapping theorem's reach, what it
    gives is found by bisection, to 2 %. If not even the decay rate 0 is proved, what `prove` says
    of 0 is returned.

    Raises
    ------
    InvalidDescription
        As `prove`.
    """
    family = family_of(polynomial, box)
    steps = 16 if len(family.symbols) < 8 else 4
    seen = slowest(family, family.ranges, skeleton(len(family.symbols), steps))
    high = -seen.root.real if seen else 0.0
    if family.entangled and high > 0:
        high = _promising(family, high)
    for attempt in range(ROUNDS):
        if high <= 0:
            break
        rate = _cut(high * (1 - BELOW * 2**attempt))
        proof = _proof(family, fraction("decay", rate))
        if proof.holds:
            return proof
        if proof.counterexample:
            high = min(high, -proof.counterexample.root.real)
    return _proof(family, Fraction(0))


def _promising(family: Family, high: float) -> float:
    """Return the largest decay rate up to `high` for which parts seem separable; 0 if none."""
    low, rate = 0.0, high * (1 - BELOW)
    for _ in range(ROUNDS):
        whole = Part(family, family.ranges, fraction("decay", _cut(rate)))
        if isinstance(separable_parts([whole], _most_parts(family)), list):
            low = rate
        else:
            high = rate
        if high - low <= NEAR * high:
            break
        rate = (low + high) / 2
    return low


def _cut(rate: float) -> float:
    """Return a rate > 0 cut to four digits, a short decimal."""
    exponent = math.floor(math.log10(rate)) - 3
    return float(f"{math.floor(rate / 10.0**exponent)}e{exponent}")


def _proof(family: Family, decay: Fraction) -> Proof:
    if family.entangled:
        powers = max(family.degrees) > 1
        method = "Bernstein expansion" if powers else "mapping theorem"
    else:
        method = "edge theorem" if family.symbols else "Routh's array"
    leading = replace(family, tensor=family.tensor[..., :1]).controls(family.ranges, Fraction(0))
    corners = leading[(..., *(slice(None, None, d) for d in family.degrees))]
    if found := unstable(family, decay, family.ranges, skeleton(len(family.symbols), 4)):
        outcome = _Outcome(0, refuted=found)
    elif not _one_sign(corners.flat):
        outcome = _Outcome(0, stopped="its leading coefficient vanishes there: a root at infinity")
    elif family.entangled:
        outcome = _by_hulls(family, decay)
    else:
        outcome = _by_edges(family, decay)
    return _stated(family, decay, method, outcome)


@dataclass(frozen=True)
class _Outcome:
    """What was tested in how many parts of the box, and what refutes or stops a proof, if any."""

    tested: int
    parts: int = 1
    refuted: Member | None = None
    stopped: str = ""


def _by_edges(family: Family, decay: Fraction) -> _Outcome:
    corners = family.controls(family.ranges, decay)
    first = (0,) * corners.ndim
    if not is_hurwitz(corners[first]):
        return _Outcome(0, refuted=slowest(family, family.ranges, np.array([first])))
    every = edges(corners.shape)
    for count, (low, high) in enumerate(every, 1):
        if crosses(corners[low], corners[high]):
            return _Outcome(count, refuted=on_edge(family, decay, low, high))
    return _Outcome(len(every))


def _by_hulls(family: Family, decay: Fraction) -> _Outcome:
    most = _most_parts(family)
    tested, proved, todo = 0, 0, [Part(family, family.ranges, decay)]
    while todo:
        parts = separable_parts(todo, most - proved)
        if isinstance(parts, Member):
            return _Outcome(tested, refuted=parts)
        if parts is None:
            return _Outcome(tested, stopped=f"{most} parts of the box are not enough for it")
        todo = []
        for part in parts:
            count = _separated(part)
            tested += count
            if count:
                proved += 1
            else:
                todo += part.halves()
    return _Outcome(tested, proved)


def _separated(part: Part) -> int:
    """Return how many polynomials were proved to bound a stable part; 0 if it is not proved.

    Where all their values at jω − decay lie in the half-plane Re P C* > 0, those of their convex
    hull do: no root crosses, and as one of them is stable, all are.
    """
    different = list(dict.fromkeys(part.family.controls(part.ranges, part.decay).flat))
    direction = part.separating()
    if direction is None or not _one_sign(different) or not is_hurwitz(different[0]):
        return 0
    scale = math.lcm(*(c.denominator for c in direction))
    separating = shifted([int(scale * c) for c in direction], part.decay.as_integer_ratio())
    return len(different) if all(apart(p, separating) for p in different) else 0


def _most_parts(family: Family) -> int:
    polynomials = math.prod(d + 1 for d in family.degrees)
    return max(1, min(MAX_PARTS, MAX_POLYNOMIALS // polynomials))


def _one_sign(polynomials: Iterable[Exact]) -> bool:
    leading = [p[0] for p in polynomials]
    return min(leading) > 0 or max(leading) < 0


def _stated(family: Family, decay: Fraction, method: str, outcome: _Outcome) -> Proof:
    rate = float(decay)
    claim = f"every root of the averaged loop has Re λ < {0.0 - rate:.6g} 1/s"
    if family.symbols:
        limits = zip(family.symbols, family.ranges, strict=True)
        over = ", ".join(f"{p} in [{float(a):.6g}, {float(b):.6g}]" for p, (a, b) in limits)
        claim += f" for all {over}"
    counterexample = None
    if outcome.refuted:
        root = outcome.refuted.root
        # Rounding may have put it below the limit, where exactly it is not.
        root = complex(max(root.real, 0.0 - rate), root.imag)
        counterexample = Counterexample(family.named(outcome.refuted.point), root)
        statement = f"Not true: {claim}; {counterexample.text()}."
    elif outcome.stopped:
        statement = f"Neither proved nor refuted by the {method}: {claim}; {outcome.stopped}."
    else:
        what = "polynomials" if family.entangled else "segments"
        how = f"{method}, {outcome.tested} {what}" if family.symbols else method
        how += f" in {outcome.parts} parts of the box" if outcome.parts > 1 else ""
        how += ", necessary and sufficient" if not family.entangled else ""
        statement = f"Proved in exact arithmetic ({how}): {claim}."
    return Proof(
        not outcome.refuted and not outcome.stopped,
        method,
        rate,
        outcome.tested,
        counterexample,
        statement,
    )
