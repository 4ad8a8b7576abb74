"""One of the paper's design procedures, followed: its steps, printed beside corrected."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final

from ...fields import Quadratic
from ...loop import Loop
from ...lti import Lead, Transfer
from ...starts import OnDither
from .schemes import two_axes
from .tables import Table

Pair = tuple[float, float]

WIDTH: Final = 100


@dataclass(frozen=True)
class Step:
    """One step of a procedure, as printed and as corrected, with what was chosen.

    Attributes
    ----------
    name
        Its number.
    printed, corrected
        The rules.
    here
        The numbers that were chosen, and their limits.
    as_printed, as_corrected
        Whether the numbers meet the rule.
    """

    name: str
    printed: str
    corrected: str
    here: str
    as_printed: bool
    as_corrected: bool


@dataclass(frozen=True)
class Procedure(ABC):
    """A procedure followed: bounds, choices, steps.

    Attributes
    ----------
    q_low
        The least curvature of J = f* − q_x (x − x*)² − q_y (y − y*)² (unit of J per m²).
    amplitude, washout, gain
        α (m), h (1/s) and c.
    lead
        k (s − z)/(s − p).
    """

    rules: ClassVar[str]
    """Where the first column of rules is from."""

    q_low: float
    amplitude: float
    washout: float
    gain: float
    lead: Lead

    @property
    def strength(self) -> float:
        """K = α c k: g = K q."""
        return self.amplitude * self.gain * self.lead.gain

    @property
    @abstractmethod
    def title(self) -> str:
        """What it is for, and the bounds."""

    @property
    @abstractmethod
    def steps(self) -> tuple[Step, ...]:
        """Every step with its numbers."""

    @property
    @abstractmethod
    def stable(self) -> bool:
        """Whether the averaged loop is stable for every q and ε within the bounds."""

    @property
    @abstractmethod
    def findings(self) -> tuple[str, ...]:
        """Where these numbers are safe and where not, and where the printed rule is: sentences."""

    @property
    def as_printed(self) -> bool:
        """Whether the numbers meet every step as printed."""
        return all(step.as_printed for step in self.steps)

    @property
    def as_corrected(self) -> bool:
        """Whether the numbers meet every step as corrected."""
        return all(step.as_corrected for step in self.steps)

    def text(self) -> str:
        """Return bounds, choices, every step both ways, and the findings."""
        lead, word = self.lead, {True: "yes", False: "no"}
        rows = tuple(
            (s.name, s.printed, word[s.as_printed], s.corrected, word[s.as_corrected], s.here)
            for s in self.steps
        )
        columns = ("step", self.rules, "met", "corrected", "met", "here")
        table = Table(tuple((name, "") for name in columns), rows)
        chosen = (
            f"α = {self.amplitude:g}, h = {self.washout:g}, c = {self.gain:g}, "
            f"k = {lead.gain:g}, z = {lead.zero:g}, p = {lead.pole:g}: K = αck = {self.strength:g}"
        )
        told = (wrapped for found in self.findings for wrapped in textwrap.wrap(found, WIDTH))
        return "\n".join([self.title, chosen, "", table.text(), "", *told])

    __str__ = text

    def started(
        self,
        plant: Transfer,
        frequency: float,
        q: Pair | None,
        source: Pair,
        start: Pair,
        through: Transfer | None = None,
    ) -> Loop:
        """Return the loop of these axes and numbers, started on the dither; see `two_axes`."""
        loop = two_axes(
            *(plant, self.lead, frequency, self.amplitude, self.gain),
            field=Quadratic(source=source, q=q or (self.q_low, self.q_low), peak=1.0),
            washout=self.washout,
            through=through,
        )
        return loop.replace({"start": OnDither(start)})
