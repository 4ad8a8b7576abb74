"""The rules of a design: each an inequality with its value, its limit and who set it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """One decision of a design.

    Attributes
    ----------
    name
        What is decided, with the axis.
    equation
        The condition or law, as it is read.
    value
        What was chosen or found.
    unit
        Its unit.
    limit
        The bound that it keeps; NaN where it keeps none.
    upper
        Whether `limit` is an upper bound.
    decided_by
        The requirement, or the condition, that set the value.
    note
        More about it, in words; may be empty.
    """

    name: str
    equation: str
    value: float
    unit: str
    limit: float
    upper: bool
    decided_by: str
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether the value keeps its limit."""
        return math.isnan(self.limit) or (
            self.value <= self.limit if self.upper else self.value >= self.limit
        )

    @property
    def margin(self) -> float:
        """Part of the limit that is left, (limit − value)/limit; negative beyond the limit.

        For a lower limit (value − limit)/value. NaN without a finite limit, and with the limit 0,
        which has no parts.
        """
        if not math.isfinite(self.limit) or not self.limit:
            return math.nan
        gap = self.limit - self.value if self.upper else self.value - self.limit
        return gap / abs(self.limit if self.upper else self.value)


def at_most(
    name: str, equation: str, value: float, unit: str, limit: float, by: str, note: str = ""
) -> Rule:
    """Return the rule value ≤ limit."""
    return Rule(name, equation, float(value), unit, float(limit), True, by, note)


def at_least(
    name: str, equation: str, value: float, unit: str, limit: float, by: str, note: str = ""
) -> Rule:
    """Return the rule value ≥ limit."""
    return Rule(name, equation, float(value), unit, float(limit), False, by, note)


def chosen(name: str, equation: str, value: float, unit: str, by: str, note: str = "") -> Rule:
    """Return a value that keeps no limit of its own."""
    return Rule(name, equation, float(value), unit, math.nan, True, by, note)
