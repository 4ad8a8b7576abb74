"""Theory: the average, the exact orbit, and the verdict."""

from .averaging import Average, average
from .conditions import Condition
from .critical import Critical, critical_frequency
from .linear import LoopGain, loop_gain
from .lyapunov import Lyapunov, lyapunov
from .offsets import Bias, bias
from .orbits import Orbit, periodic_orbit
from .probing import (
    Assignment,
    Collision,
    FrequencyCheck,
    assign_frequencies,
    check_frequencies,
)
from .shrinking import ShrinkingCheck, check_shrinking
from .synthesis import Design, Infeasible, Rule, design
from .verdict import Verdict, stability

__all__ = [
    "Assignment",
    "Average",
    "Bias",
    "Collision",
    "Condition",
    "Critical",
    "Design",
    "FrequencyCheck",
    "Infeasible",
    "LoopGain",
    "Lyapunov",
    "Orbit",
    "Rule",
    "ShrinkingCheck",
    "Verdict",
    "assign_frequencies",
    "average",
    "bias",
    "check_frequencies",
    "check_shrinking",
    "critical_frequency",
    "design",
    "loop_gain",
    "lyapunov",
    "periodic_orbit",
    "stability",
]
