"""Ctrl-C that is not lost.

Python raises KeyboardInterrupt wherever it happens to be; in a callback of the garbage collector it
is printed and forgotten. The signal is therefore also remembered, and asked for at safe places.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType

_pending = threading.Event()


def install() -> None:
    """Remember SIGINT and treat SIGTERM alike, so that neither leaves a half-written file."""
    _pending.clear()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _interrupted)
        signal.signal(signal.SIGTERM, _interrupted)


def check() -> None:
    """Raise KeyboardInterrupt if one was asked for."""
    if _pending.is_set():
        raise KeyboardInterrupt


def _interrupted(number: int, frame: FrameType | None) -> None:
    _pending.set()
    raise KeyboardInterrupt
