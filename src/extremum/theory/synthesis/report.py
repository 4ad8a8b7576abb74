"""`Design`: the controller, every rule that made it, and what was proved and confirmed of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from ...controllers import GradientES
from ...loop import Loop
from ...requirements import Requirements
from ...scenario import Run, Scenario
from ...starts import OnDither
from ..linear import LoopGain, loop_gain
from ..robustness import Proof
from .building import Plan, centred
from .confirmation import Arrival, Confirmed, reach
from .rules import Rule
from .ruling import rules_of
from .table import text

RUN: Final = 3.0
"""Settling times that a design's scenario runs."""


@dataclass(frozen=True, eq=False)
class Design:
    """A controller for a range of the unknown; made by `design`.

    Attributes
    ----------
    plan
        The compensators' shapes and the frequencies' ratios.
    frequency, begun
        ω (rad/s), and where the search for it began.
    loop
        The loop in the middle of the box, source and force at their farthest, started on the
        dither at the source.
    proofs
        One for each axis, or one for all coupled axes: about the averaged loop.
    confirmations
        The exact loop in every corner, in the middle of every edge and in the centre of the box.
    arrivals
        Runs of the exact loop from the farthest starts.
    """

    plan: Plan
    frequency: float
    begun: float
    loop: Loop
    proofs: tuple[Proof, ...]
    confirmations: tuple[Confirmed, ...]
    arrivals: tuple[Arrival, ...]

    @property
    def requirements(self) -> Requirements:
        """What was asked."""
        return self.plan.requirements

    @property
    def controller(self) -> GradientES:
        """The controller: all that the vehicle carries."""
        found = self.loop.controller
        assert isinstance(found, GradientES)
        return found

    @property
    def box(self) -> dict[str, tuple[float, float]]:
        """The range of every number that the controller does not know, by the loop's path."""
        return self.plan.box()

    @cached_property
    def rules(self) -> tuple[Rule, ...]:
        """Every rule, with its equation, value, limit and margin, and who decided it."""
        return rules_of(self)

    @property
    def decay(self) -> float:
        """σ (1/s): every root of the averaged loop is proved to have Re λ < −σ all over the box."""
        return min(proof.decay for proof in self.proofs)

    @property
    def duration(self) -> float:
        """The wanted settling time (s), or 4/σ where only a bandwidth is wished."""
        return self.requirements.settling_time or 4 / self.decay

    @cached_property
    def gain(self) -> LoopGain:
        """L(s) in the middle of the box, for margins, Nichols and Bode plots."""
        return loop_gain(self.loop)

    def at(self, point: Mapping[str, float], displacement: tuple[float, ...] = ()) -> Loop:
        """Return the exact loop at a point of the box, started on the dither.

        Parameters
        ----------
        point
            Dotted path → value, for any of `box`; what is left out stays as in `loop`.
        displacement
            Where the dither's centre starts, relative to the source (m), per axis; at the source
            if left out.
        """
        here = self.loop.replace(dict(point))
        source: Any = here.field.source  # pyright: ignore[reportAttributeAccessIssue]
        moved = displacement or (0.0,) * len(source)
        start = tuple(x + d for x, d in zip(source, moved, strict=True))
        return here.replace({"start": OnDither(centred(self.controller, start))})

    def scenario(self, t_end: float | None = None) -> Scenario:
        """Return a scenario that runs: from the farthest start, in the middle of the box.

        Parameters
        ----------
        t_end
            Duration (s); by default three times `duration`.
        """
        axes = len(self.plan.families)
        r = max(self.requirements.start_distance, reach(self.loop)) / math.sqrt(axes)
        loop = self.at({}, (r,) * axes)
        title = (
            f"Designed for {axes} {'axis' if axes == 1 else 'axes'}, ω = {self.frequency:g} rad/s"
        )
        note = (
            f"{self.summary} Here source and force are at their farthest, the curvature in the "
            "middle of its range."
        )
        run = Run(t_end=t_end or RUN * self.duration)
        return Scenario(loop=loop, run=run, title=title, note=note)

    @property
    def summary(self) -> str:
        """What is proved and what is confirmed, in a sentence."""
        worst = max(c.exponent for c in self.confirmations)
        return (
            f"Every root of the averaged loop is proved to have Re λ < −{self.decay:g} 1/s all "
            f"over the box; the exact loop's largest Floquet exponent is {worst:.4g} 1/s at the "
            f"{len(self.confirmations)} points looked at."
        )

    def text(self) -> str:
        """Return the report: the controller, what is proved, and every rule, as plain text."""
        return text(self)

    def __str__(self) -> str:
        return self.text()

    __repr__ = __str__
