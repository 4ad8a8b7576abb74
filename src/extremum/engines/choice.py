"""Which engine integrates a system when none is asked for."""

from __future__ import annotations

from typing import Final

from ..system import System
from . import reference, taylor

ENGINES: Final = {"taylor": taylor, "reference": reference}


def usual(system: System) -> str:
    """Return ``"taylor"`` where heyoka is installed and every function is known, or the other."""
    return "reference" if system.oracles or not taylor.available() else "taylor"
