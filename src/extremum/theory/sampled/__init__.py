"""The averaged loop when its controller is sampled: loop gain, margins, stability limits, noise."""

from .critical import SampledCrossing, StabilityLimit, critical_delay, critical_dt
from .gain import SampledLoopGain, sampled_loop_gain
from .margins import Margins
from .noise import NoiseVariance, noise_variance

__all__ = [
    "Margins",
    "NoiseVariance",
    "SampledCrossing",
    "SampledLoopGain",
    "StabilityLimit",
    "critical_delay",
    "critical_dt",
    "noise_variance",
    "sampled_loop_gain",
]
