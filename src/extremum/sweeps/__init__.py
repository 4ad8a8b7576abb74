"""Sweeps: many loops of one scenario, in jobs whose results survive whatever happens."""

from .axes import Axis
from .running import sweep
from .study import Study, Sweep, format_study, load_study, parse_study

__all__ = ["Axis", "Study", "Sweep", "format_study", "load_study", "parse_study", "sweep"]
