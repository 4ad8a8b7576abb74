"""Dither frequencies: which collide, and some that do not."""

from .assignment import Assignment, assign_frequencies
from .checking import FrequencyCheck, check_frequencies
from .mixing import Collision

__all__ = [
    "Assignment",
    "Collision",
    "FrequencyCheck",
    "assign_frequencies",
    "check_frequencies",
]
