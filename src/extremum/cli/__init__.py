"""The command line: `extremum run | paper | equations | stability | design`."""

from .main import main

__all__ = ["main"]
