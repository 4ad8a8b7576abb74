"""What an engine compiles once for a structure."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from ...system import System
from .program import Scheme
from .watch import Watch

K = TypeVar("K")

KEPT: Final = 64


class Kernels(Generic[K]):
    """Kernels by structure; the longest unused goes first.

    Parameters
    ----------
    compiled
        Makes a kernel; see `get`.
    """

    def __init__(
        self, compiled: Callable[[System, tuple[int, ...], Scheme, Watch, str], K]
    ) -> None:
        self._compiled = compiled
        self._kept: OrderedDict[Any, K] = OrderedDict()
        self._lock = threading.Lock()

    def get(
        self, system: System, swept: tuple[int, ...], scheme: Scheme, watch: Watch, dtype: str
    ) -> K:
        """Return the kernel of a structure, compiled now if it is not kept."""
        key = (system, swept, scheme, watch, dtype)
        with self._lock:
            if key not in self._kept:
                made = self._compiled(*key)
                while len(self._kept) >= KEPT:
                    self._kept.popitem(last=False)
                self._kept[key] = made
            self._kept.move_to_end(key)
            return self._kept[key]
