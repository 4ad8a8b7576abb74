"""What is compiled once for a system and a tolerance, one for each thread."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final

from ..system import System

KEPT: Final = 64


class Kept(threading.local):
    """Integrators by system and tolerance; a shared one would give wrong results.

    Parameters
    ----------
    compiled
        Makes the integrator of a system for a tolerance.
    """

    def __init__(self, compiled: Callable[[System, float], Any]) -> None:
        self.compiled = compiled
        self.integrators: OrderedDict[tuple[System, float], Any] = OrderedDict()

    def get(self, system: System, tol: float) -> Any:
        """Return the integrator, compiled now if it is not kept; the longest unused goes first."""
        kept, key = self.integrators, (system, tol)
        if key in kept:
            kept.move_to_end(key)
            return kept[key]
        while len(kept) >= KEPT:
            kept.popitem(last=False)
        kept[key] = self.compiled(system, tol)
        return kept[key]
