"""`design`: from what the engineer knows to a controller that works all over the box."""

from __future__ import annotations

import itertools
import math
from typing import Any, Final

from ...errors import InvalidDescription, shown
from ...requirements import Requirements
from ..probing import assign_frequencies
from . import limits
from .building import Plan
from .family import Family, families
from .refusals import Infeasible, eased
from .report import Design
from .search import found
from .shapes import Shape, Wish, shapes

TRIALS: Final = 3
"""Shapes tried on each axis before a refusal."""
LIKELY: Final = 10.0
"""ω over the wanted speed for which shapes are chosen, before it is known."""
TRIED_AGAIN: Final = ("proof", "coupling", "frequency", "exact loop", "noise", "delay")
"""Refusals after which another shape may do."""


def design(requirements: Requirements) -> Design:
    """Return a controller that is proved and confirmed to meet the requirements.

    Structure by need: a gain where it suffices; integrators in C(s) where a constant force, an
    unstable pole or a ramp would leave a bias; resonators for a periodic source; one or two leads
    where the phase asks for them. Of all such compensators that settle in time at every vertex of
    the box, with max |S| ≤ 2 (3 if none has less), that with the least noise bandwidth. The probe
    goes through 1/G(jω) of the nominal vehicle; the references take back the phase of washout,
    sensor and dead time: ψ = φ + arg[jω/(jω + h) F(jω) e^{−jωT}].

    Then every root of the averaged loop is proved to be to the left of −σ all over the box, and the
    exact loop is looked at in every corner, in the middle of every edge and in the centre: Floquet
    exponents, settling and, from the farthest start, arrival. ω begins at 4 bandwidths of the
    closed loop and is raised until all pass, or a limit is reached.

    Parameters
    ----------
    requirements
        `Requirements`.

    Returns
    -------
    Design
        With ``controller``, ``loop``, ``rules``, ``proofs``, ``confirmations``, ``scenario()`` and
        the report as text.

    Raises
    ------
    Infeasible
        If there is none: the condition that fails, its numbers, and the smallest change of each
        requirement that alone would make it feasible.

    Notes
    -----
    The averaged loop is 1 + L(s) = 0, L = α c q m C(s) G(s), on each axis; see `loop_gain`.
    """
    if not isinstance(requirements, Requirements):
        raise InvalidDescription("requirements", "must be Requirements", shown(requirements))
    try:
        return _attempt(requirements)
    except Infeasible as refusal:
        changes = eased(requirements, refusal.relaxations, _feasible)
        raise refusal.taught(changes) from None


def _feasible(requirements: Requirements) -> bool:
    try:
        _attempt(requirements)
    except Infeasible:
        return False
    return True


def _attempt(wanted: Requirements) -> Design:
    """Return a design with the first shapes that do; where ω had to be raised, the lowest ω's."""
    limits.check_hessian(wanted)
    wish = Wish(wanted.settling_time or math.inf, wanted.bandwidth or 0.0)
    members = families(wanted)
    limits.check(wanted, members)
    members = tuple(family.tuned(LIKELY * wish.speed) for family in members)
    limits.check_heard(members)
    known: dict[Any, list[Shape]] = {}
    for family in members:
        if family.key not in known:
            known[family.key] = list(itertools.islice(shapes(family, wish), TRIALS))
        if not known[family.key]:
            raise limits.no_shape(wanted, family, wish)
    options = [known[family.key] for family in members]
    best: Design | None = None
    first: Infeasible | None = None
    for k in range(max(map(len, options))):
        chosen = tuple(some[min(k, len(some) - 1)] for some in options)
        try:
            plan = _planned(wanted, members, chosen)
            design = found(plan, wish)
        except Infeasible as refusal:
            if refusal.condition not in TRIED_AGAIN:
                raise
            first = first or refusal
            continue
        if best is None or design.frequency < best.frequency:
            best = design
        if design.frequency == design.begun:
            break
    if best is None:
        assert first is not None
        raise first
    return best


def _planned(wanted: Requirements, members: tuple[Family, ...], chosen: tuple[Shape, ...]) -> Plan:
    """Return the plan in which faster loops have faster dithers."""
    axes = range(len(members))
    given = assign_frequencies(
        len(members), quadrature=wanted.quadrature, half_wave=wanted.zero_bias
    )
    order = sorted(axes, key=lambda i: (chosen[i].fastest, i))
    ratios = tuple(given.ratios[order.index(i)] for i in axes)
    phases = tuple(given.phases[order.index(i)] for i in axes)
    return Plan(wanted, members, chosen, ratios, phases)
