"""Figures of a run: an overview, the trajectory over the field, and an animation.

Every figure reads without colour too: the source is dashed and marked by stars, the start by a
circle, the end by a square, or by a cross if the run ended early.
"""

from .figures import overview, trajectory
from .films import animate, check_animation

__all__ = ["animate", "check_animation", "overview", "trajectory"]
