"""Ensembles: many loops of one structure at once."""

from .ensembling import ensemble

__all__ = ["ensemble"]
