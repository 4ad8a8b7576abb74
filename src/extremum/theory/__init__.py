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
from .sampled import (
    Margins,
    NoiseVariance,
    SampledCrossing,
    SampledLoopGain,
    StabilityLimit,
    critical_delay,
    critical_dt,
    noise_variance,
    sampled_loop_gain,
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
    "Margins",
    "NoiseVariance",
    "Orbit",
    "Rule",
    "SampledCrossing",
    "SampledLoopGain",
    "ShrinkingCheck",
    "StabilityLimit",
    "Verdict",
    "assign_frequencies",
    "average",
    "bias",
    "check_frequencies",
    "check_shrinking",
    "critical_delay",
    "critical_dt",
    "critical_frequency",
    "design",
    "loop_gain",
    "lyapunov",
    "noise_variance",
    "periodic_orbit",
    "sampled_loop_gain",
    "stability",
]
