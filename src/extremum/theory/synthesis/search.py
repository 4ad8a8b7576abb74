"""The search for ω: as low as the exact loop allows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from ...engines.trajectory import COMPLETED, ESCAPED, LEFT
from ...loop import Loop
from ..robustness import Proof
from . import limits
from .building import Plan, centre, corners, midpoints
from .candidates import rounded
from .confirmation import Arrival, Confirmed, arrival, confirmed, reach
from .family import PACE
from .report import Design
from .shapes import CHARGING, Wish

RAISE: Final = 1.2
"""Factor by which ω is raised when the exact loop does not do what the averaged one does."""
RAISES: Final = 14
ENDS: Final = (COMPLETED, ESCAPED, LEFT)
ARRIVAL: Final = 2.0
"""Settling times within which a start from far away must have come to a tenth."""


def found(plan: Plan, wish: Wish, proofs: tuple[Proof, ...]) -> Design:
    """Return the design with the lowest ω tried at which the exact loop does all that is asked.

    Raises
    ------
    Infeasible
        If a limit is reached before.
    """
    return _Search(plan, wish, proofs).run()


@dataclass(frozen=True, eq=False)
class _Search:
    plan: Plan
    wish: Wish
    proofs: tuple[Proof, ...]

    def run(self) -> Design:
        plan = self.plan
        needed = (
            PACE * max(shape.fastest, *family.resonances, 0.0) / float(ratio)
            for family, shape, ratio in zip(plan.families, plan.shapes, plan.ratios, strict=True)
        )
        base = _up(max(needed))
        hard: list[dict[str, float]] = []
        begun, reason = base, ""
        for _ in range(RAISES):
            self._check_limits(base, begun, reason)
            loop = plan.loop(base)
            reason, judged, runs = self._judged(loop, hard)
            if not reason:
                return Design(plan, base, begun, loop, self.proofs, judged, runs)
            base = _up(base * RAISE)
        raise limits.never(plan, begun, base, reason)

    def _check_limits(self, base: float, begun: float, reason: str) -> None:
        plan = self.plan
        for axis in range(len(plan.families)):
            limits.check_frequency(plan, axis, base, begun, reason)
            limits.check_delay(plan, axis, base)
            limits.check_noise(plan, axis, base)

    def _judged(
        self, loop: Loop, hard: list[dict[str, float]]
    ) -> tuple[str, tuple[Confirmed, ...], tuple[Arrival, ...]]:
        """Return why the exact loop fails, or nothing, and what was seen.

        What failed before, `hard`, is looked at first; then the runs, which are few; then the rest.
        """
        box = self.plan.judged_box()
        seen: list[Confirmed] = []
        for point in hard:
            seen.append(confirmed(loop, point, self.wish.settling))
            if reason := self._failing(seen[-1]):
                return reason, (), ()
        runs = []
        for point, displacement in _far(self.plan, loop):
            runs.append(arrival(loop, point, displacement, self._duration))
            if reason := self._lost(runs[-1], displacement, float(loop.controller.base())):
                return reason, (), ()
        for point in itertools.chain(corners(box), midpoints(box), [centre(box)]):
            if point not in hard:
                seen.append(confirmed(loop, point, self.wish.settling))
                if reason := self._failing(seen[-1]):
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
        decay = min(proof.decay for proof in self.proofs)
        return ARRIVAL * (settling if math.isfinite(settling) else 4 / decay)

    def _lost(self, run: Arrival, displacement: tuple[float, ...], base: float) -> str:
        far = math.hypot(*displacement)
        if run.outcome == COMPLETED:
            for family, pushed in zip(self.plan.families, run.input, strict=True):
                if pushed > family.input:
                    raise limits.pushed(self.plan, family, pushed, displacement)
        if run.distance <= far / 10:
            return ""
        reason = f"from {far:.3g} m away the exact loop {_ending(run)} after {self._duration:.3g} s"
        for axis, family in enumerate(self.plan.families):
            if self.plan.amplitude(axis, base) < family.dither:
                raise limits.cramped(self.plan, axis, base, reason)
        return reason


def _ending(run: Arrival) -> str:
    if math.isinf(run.distance):
        return "has " + ("no orbit to arrive at" if run.outcome not in ENDS else run.outcome)
    return f"is still {run.distance:.3g} m away"


def _far(plan: Plan, loop: Loop) -> Iterable[tuple[Mapping[str, float], tuple[float, ...]]]:
    """Yield the farthest starts: at the lowest and the highest curvature, in all quadrants."""
    box = plan.judged_box()
    curvature = [path for path in box if path.startswith("field.q.")]
    highest = {path: high for path, (_, high) in box.items() if path not in curvature}
    axes = len(plan.families)
    for end in (0, 1):
        point = {**highest, **{path: box[path][end] for path in curvature if _is_diagonal(path)}}
        r = max(plan.requirements.start_distance, reach(loop.replace(point))) / math.sqrt(axes)
        for signs in itertools.product((1.0, -1.0), repeat=axes):
            yield point, tuple(r * sign for sign in signs)


def _is_diagonal(path: str) -> bool:
    parts = path.split(".")
    return len(parts) == 3 or parts[2] == parts[3]


def _told(point: Mapping[str, float]) -> str:
    return ", ".join(f"{path} = {value:.4g}" for path, value in point.items())


def _up(frequency: float) -> float:
    """Return a frequency rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(frequency)) - 2)
    return float(rounded(math.ceil(frequency / unit - 1e-9) * unit))
