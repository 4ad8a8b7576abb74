"""The command line: `extremum run | paper | equations`."""

from .main import main

__all__ = ["main"]
