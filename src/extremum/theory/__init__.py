"""Theory: the average, the exact orbit, and the verdict."""

from .averaging import Average, average
from .conditions import Condition
from .critical import Critical, critical_frequency
from .linear import LoopGain, loop_gain
from .lyapunov import Lyapunov, lyapunov
from .offsets import Bias, bias
from .orbits import Orbit, periodic_orbit
from .verdict import Verdict, stability

__all__ = [
    "Average",
    "Bias",
    "Condition",
    "Critical",
    "LoopGain",
    "Lyapunov",
    "Orbit",
    "Verdict",
    "average",
    "bias",
    "critical_frequency",
    "loop_gain",
    "lyapunov",
    "periodic_orbit",
    "stability",
]
