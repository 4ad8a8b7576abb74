"""The search for ω: as low as the exact loop allows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...engines.trajectory import COMPLETED, ESCAPED, LEFT
from ...loop import Loop
from . import limits
from .building import Plan, centre, corners, is_diagonal, midpoints
from .candidates import rounded
from .confirmation import Arrival, Confirmed, arrival, confirmed, reach
from .family import BY_INPUT, PACE, uncertain
from .proofs import proofs_of
from .report import Design
from .shapes import CHARGING, Wish

RAISE: Final = 1.2
"""Factor by which ω is raised when the exact loop does not do what the averaged one does."""
RAISES: Final = 14
ENDS: Final = (COMPLETED, ESCAPED, LEFT)
ARRIVAL: Final = 2.0
"""Settling times within which a start from far away must have come to a tenth."""


def found(plan: Plan, wish: Wish) -> Design:
    """Return the design with the lowest ω tried at which the exact loop does all that is asked.

    Raises
    ------
    Infeasible
        If a limit is reached before, or the averaged loop cannot be proved to decay.
    """
    return _Search(plan, wish).run()


@dataclass(frozen=True, eq=False)
class _Search:
    plan: Plan
    wish: Wish

    def run(self) -> Design:
        plan = self.plan
        needed = (
            PACE * max(shape.fastest, *family.resonances, 0.0) / float(ratio)
            for family, shape, ratio in zip(plan.families, plan.shapes, plan.ratios, strict=True)
        )
        base = _up(max(needed))
        hard: list[dict[str, float]] = []
        begun, last, reason = base, base, ""
        for _ in range(RAISES):
            plan = plan.tuned(base)
            last = base
            limits.check_heard(plan.families)
            self._check_limits(plan, base, begun, reason)
            loop = plan.loop(base)
            reason, judged, runs = self._judged(plan, loop, hard)
            if not reason:
                return Design(plan, base, begun, loop, proofs_of(plan), judged, runs)
            base = _up(base * RAISE)
        raise limits.never(plan, begun, last, reason)

    def _check_limits(self, plan: Plan, base: float, begun: float, reason: str) -> None:
        for axis in range(len(plan.families)):
            limits.check_frequency(plan, axis, base, begun, reason)
            limits.check_delay(plan, axis, base)
            limits.check_noise(plan, axis, base)

    def _judged(
        self, plan: Plan, loop: Loop, hard: list[dict[str, float]]
    ) -> tuple[str, tuple[Confirmed, ...], tuple[Arrival, ...]]:
        """Return why the exact loop fails, or nothing, and what was seen.

        What failed before, `hard`, is looked at first; then the runs, which are few; then the rest.
        """
        box = plan.judged_box()
        seen: list[Confirmed] = []

        def look(point: dict[str, float]) -> str:
            seen.append(confirmed(loop.replace(plan.pushed(point)), point, self.wish.settling))
            return self._failing(seen[-1])

        for point in hard:
            if reason := look(point):
                return reason, (), ()
        runs = []
        for point, displacement in _far(plan, loop):
            runs.append(arrival(loop, point, displacement, self._duration))
            if reason := self._lost(plan, runs[-1], displacement, float(loop.controller.base())):
                return reason, (), ()
        for point in itertools.chain(corners(box), midpoints(box), [centre(box)]):
            if not any(c.point == point for c in seen) and (reason := look(point)):
                hard.append(point)
                return reason, (), ()
        return "", tuple(seen), tuple(runs)

    def _failing(self, here: Confirmed) -> str:
        if not here.stable:
            return f"at {_told(here.point)} the exact loop is not stable ({here.outcome})"
        for found, allowed in ((here.settling, 1.0), (here.charging, CHARGING)):
            if found > allowed * self.wish.settling:
                return (
                    f"at {_told(here.point)} the exact loop settles in {found:.3g} s, "
                    f"{allowed * self.wish.settling:.3g} s allowed"
                )
        return ""

    @property
    def _duration(self) -> float:
        settling = self.wish.settling
        slowest = max(shape.abscissa for shape in self.plan.shapes)
        return ARRIVAL * (settling if math.isfinite(settling) else -4 / slowest)

    def _lost(self, plan: Plan, run: Arrival, displacement: tuple[float, ...], base: float) -> str:
        far = math.hypot(*displacement)
        if run.outcome == COMPLETED:
            for family, pushed in zip(plan.families, run.input, strict=True):
                if pushed > family.input:
                    raise limits.pushed(plan, family, pushed, displacement)
        if run.distance <= far / 10:
            return ""
        reason = f"from {far:.3g} m away the exact loop {_ending(run)} after {self._duration:.3g} s"
        for axis, family in enumerate(plan.families):
            if plan.amplitude(axis, base) * family.swing < BY_INPUT * family.dither:
                raise limits.cramped(plan, axis, base, reason)
        return reason


def _ending(run: Arrival) -> str:
    if math.isinf(run.distance):
        return "has " + ("no orbit to arrive at" if run.outcome not in ENDS else run.outcome)
    return f"is still {run.distance:.3g} m away"


def _far(plan: Plan, loop: Loop) -> Iterable[tuple[dict[str, float], tuple[float, ...]]]:
    """Yield the farthest starts: along every axis and in every quadrant, source and force pushing.

    At the lowest and the highest curvature, and with the uncertain numbers that need most input to
    hold the vehicle, and those at the other ends.
    """
    box = plan.judged_box()
    curvature = [path for path in box if path.startswith("field.q.") and is_diagonal(path)]
    axes = len(plan.families)
    for end, numbers in itertools.product((0, 1), _ends(plan)):
        point = {**{path: box[path][end] for path in curvature}, **numbers}
        point |= plan.pushed(point)
        r = max(plan.requirements.start_distance, reach(loop.replace(point)))
        for signs in itertools.product((1.0, 0.0, -1.0), repeat=axes):
            if sum(map(abs, signs)) in (1, axes):
                yield point, tuple(r * sign / math.sqrt(sum(map(abs, signs))) for sign in signs)


def _ends(plan: Plan) -> list[dict[str, float]]:
    """Return the uncertain numbers at the vertex with the largest loads, and at the opposite."""
    wanted = plan.requirements
    heaviest: dict[str, float] = {}
    for family in plan.families:
        loads = [abs(plant.load) for plant in family.vertices]
        heaviest |= list(corners(uncertain(wanted, family.axis)))[int(np.argmax(loads))]
    if not heaviest:
        return [{}]
    opposite = {path: sum(wanted.uncertain[path]) - value for path, value in heaviest.items()}
    return [heaviest, opposite]


def _told(point: Mapping[str, float]) -> str:
    return ", ".join(f"{path} = {value:.4g}" for path, value in point.items())


def _up(frequency: float) -> float:
    """Return a frequency rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(frequency)) - 2)
    return float(rounded(math.ceil(frequency / unit - 1e-9) * unit))
