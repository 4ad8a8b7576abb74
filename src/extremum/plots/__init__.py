"""Figures of a run: an overview, the trajectory over the field, and an animation.

Every figure reads without colour too: the source is dashed and marked by stars, the averaged path
dash-dotted, the start a circle, the end a square, or a cross if the run ended early.
"""

from .figures import overview, trajectory
from .films import animate, check_animation

__all__ = ["animate", "check_animation", "overview", "trajectory"]
