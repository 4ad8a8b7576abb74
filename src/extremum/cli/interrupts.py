"""Ctrl-C that is not lost.

Python raises KeyboardInterrupt wherever it happens to be; in a callback of the garbage collector it
is printed and forgotten. The signal is therefore also remembered, and asked for at safe places.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_pending = threading.Event()


@contextmanager
def remembered() -> Iterator[None]:
    """Remember SIGINT inside the block, and treat SIGTERM alike: neither leaves half a file."""
    _pending.clear()
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, _interrupted) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def check() -> None:
    """Raise KeyboardInterrupt if one was asked for."""
    if _pending.is_set():
        raise KeyboardInterrupt


def _interrupted(number: int, frame: FrameType | None) -> None:
    _pending.set()
    raise KeyboardInterrupt
