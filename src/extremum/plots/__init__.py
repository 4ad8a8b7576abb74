"""Figures of a run (overview, trajectory over the field, animation) and of a design.

Every figure reads without colour too: the source is dashed and marked by stars, the averaged path
dash-dotted, the start a circle, the end a square, or a cross if the run ended early.
"""

from .designs import design
from .figures import overview, trajectory
from .films import animate, check_animation

__all__ = ["animate", "check_animation", "design", "overview", "trajectory"]
