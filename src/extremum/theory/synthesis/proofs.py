"""Proofs about the averaged loop of a design, over the whole box."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import sympy
from sympy import Expr, Poly, Symbol

from ...description import flatten
from ...parameters import symbolic
from ...requirements import VEHICLE, Requirements
from ...symbols import exact
from ..robustness import Proof, characteristic, coupled, largest_decay, prove_identical
from .building import Plan
from .family import Family, felt_curvature, hessian_bounds, pade
from .limits import coupled_too_much, unproved
from .polynomials import expression
from .shapes import Shape

ROUNDING: Final = 1e-12

Box = dict[Symbol, tuple[float, float]]


def proofs_of(plan: Plan) -> tuple[Proof, ...]:
    """Return proofs of decay over the box: of every axis, or of all that are coupled.

    Raises
    ------
    Infeasible
        If one fails.
    """
    wanted = plan.requirements
    if wanted.coupling:
        proof = coupled_proof(wanted, plan.families, plan.shapes)
        if not proof.holds:
            raise coupled_too_much(wanted, proof)
        return (proof,)
    proofs = []
    for family, shape in zip(plan.families, plan.shapes, strict=True):
        proofs.append(axis_proof(wanted, family, shape))
        if not proofs[-1].holds:
            raise unproved(family, proofs[-1])
    return tuple(proofs)


def axis_proof(wanted: Requirements, family: Family, shape: Shape) -> Proof:
    """Return the proof of the largest decay rate of one axis over its part of the box.

    P = D(p) D_c D_p + (q/q̄) g N(p) N_c N_p over q and the uncertain numbers p, q̄ = √(q_low q_high).
    The range of q is widened by what is heard of α over the box, see `Plant.heard`.
    """
    _, polynomial, box = _axis(wanted, family, shape)
    proof = largest_decay(polynomial, box)
    least, most = family.heard
    if most - least <= ROUNDING:
        return proof
    told = (
        f"of α the reference hears {least:.6g} to {most:.6g}, and q_{family.name} is widened by it"
    )
    return replace(proof, statement=f"{proof.statement} Over the box, {told}.")


def _axis(wanted: Requirements, family: Family, shape: Shape) -> tuple[Symbol, Poly, Box]:
    """Return the letter q, P, and the box of one axis."""
    q = Symbol(f"q_{family.name}", real=True)
    low, high = felt_curvature(wanted, family.axis)
    box: Box = {q: (low * family.heard[0], high * family.heard[1])}
    law = _plant(wanted, family.axis, box)
    gain = q * _per_curvature(wanted, family, shape)
    return q, characteristic(law, _compensator(family, shape), gain), box


def coupled_proof(
    wanted: Requirements, families: Sequence[Family], shapes: Sequence[Shape]
) -> Proof:
    """Return the proof of the largest decay rate of all axes together, coupled by Q.

    Axes that are alike, each with the same known numbers, are Π P(s, λᵢ) over Q's eigenvalues λᵢ.
    """
    alike = len({f.key for f in families}) == 1 and len(set(wanted.curvature)) == 1
    if alike and not wanted.uncertain:
        q, polynomial, box = _axis(wanted, families[0], shapes[0])
        decay = largest_decay(polynomial, box).decay
        return prove_identical(polynomial, q, *hessian_bounds(wanted), decay=decay)
    n = len(families)
    box: Box = {}
    entries: dict[tuple[int, int], Symbol] = {}
    for i, j in itertools.combinations_with_replacement(range(n), 2):
        symbol = Symbol(f"q_{families[i].name}{families[j].name if i != j else ''}", real=True)
        entries[i, j] = symbol
        reach = wanted.coupling
        box[symbol] = wanted.curvature[i] if i == j else (-reach, reach)
    plants = [_plant(wanted, i, box) for i in range(n)]
    controllers = [_compensator(f, shape) for f, shape in zip(families, shapes, strict=True)]
    heard = [Symbol(f"m_{f.name}", real=True) for f in families]
    box |= dict(zip(heard, (f.heard for f in families), strict=True))
    gains = [
        [
            heard[i] * _per_curvature(wanted, families[i], shapes[i]) if i == j else 0
            for j in range(n)
        ]
        for i in range(n)
    ]
    curvature = [[entries[min(i, j), max(i, j)] for j in range(n)] for i in range(n)]
    return largest_decay(coupled(plants, controllers, gains, curvature), box)


def _per_curvature(wanted: Requirements, family: Family, shape: Shape) -> Expr:
    """Return g/q̄ = α c m."""
    low, high = wanted.curvature[family.axis]
    return exact(float(f"{shape.gain / math.sqrt(low * high):.15g}"))


def _plant(wanted: Requirements, axis: int, box: Box) -> Expr:
    """Return G(s) with letters for its uncertain numbers, whose ranges are added to the box."""
    lettered = {path.removeprefix(VEHICLE): _ordinary(*e) for path, e in wanted.uncertain.items()}
    transfer = wanted.vehicle.replace(lettered).axes[axis]
    twin, parameters = symbolic(transfer, 1, {})
    table: dict[Any, Any] = {}
    for parameter, value in zip(parameters, flatten(transfer)[1], strict=True):
        path = f"{VEHICLE}axes.{axis}.{parameter.path}"
        if path in wanted.uncertain:
            symbol = Symbol(f"{parameter.symbol}_{wanted.axes()[axis]}", real=True)
            table[parameter.symbol] = symbol
            box[symbol] = wanted.uncertain[path]
        else:
            table[parameter.symbol] = exact(value)
    law: Any = twin.law()
    return law.xreplace(table)


def _ordinary(low: float, high: float) -> float:
    """Return a number of a range that is no structure, as a coefficient 0 or a gain 1 is."""
    return next(x for x in (high, low, low + (high - low) / 3, 0.5) if x not in (0.0, 1.0))


def _compensator(family: Family, shape: Shape) -> Expr:
    """Return C(s) and the dead time's Padé form, exact, as one fraction."""
    early, late = pade(family.delay)
    above = sympy.Mul(expression(shape.above), expression(early))
    return above / sympy.Mul(expression(shape.below), expression(late))
