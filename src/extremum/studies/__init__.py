"""Ready studies of many loops, each with a figure: what `extremum study` runs."""

from .catalogue import NAMES, Ready, ready

__all__ = ["NAMES", "Ready", "ready"]
