"""A file system on which no more files can be written."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import Any, Self


class Disk:
    """Counts the files opened for writing whose path has the store's name; refuses after some."""

    current: Disk | None = None
    hooked = False

    def __init__(self, store: Path, room: int | None = None, error: int = errno.ENOSPC) -> None:
        self.name, self.room, self.error, self.files = store.name, room, error, 0

    def __enter__(self) -> Self:
        if not Disk.hooked:
            sys.addaudithook(_opened)  # which cannot be removed
            Disk.hooked = True
        Disk.current = self
        return self

    def __exit__(self, *details: object) -> None:
        Disk.current = None


def _opened(event: str, arguments: tuple[Any, ...]) -> None:
    disk = Disk.current
    if disk is None or event != "open" or disk.name not in str(arguments[0]):
        return
    if arguments[2] & (os.O_WRONLY | os.O_RDWR):
        if disk.room is not None and disk.files >= disk.room:
            raise OSError(disk.error, os.strerror(disk.error), str(arguments[0]))
        disk.files += 1
