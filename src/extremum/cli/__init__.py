"""The command line: `extremum run | paper | equations | stability | design | sweep`."""

from .main import main

__all__ = ["main"]
