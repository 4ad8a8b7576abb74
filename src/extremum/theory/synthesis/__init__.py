"""Design: from what the engineer knows to gains that work."""

from .designing import design
from .refusals import Infeasible
from .report import Design
from .rules import Rule

__all__ = ["Design", "Infeasible", "Rule", "design"]
