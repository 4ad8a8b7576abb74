"""One process at a time may write a store."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InvalidDescription


@contextmanager
def alone(store: Path, file: Path) -> Iterator[None]:
    """Hold the lock file of a store; the system lets go of it when the process ends, even killed.

    Raises
    ------
    InvalidDescription
        If another process holds it, or it cannot be written.
    """
    try:
        handle = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise InvalidDescription("", f"cannot write {store}: {error.strerror}") from None
    try:
        try:
            _lock(handle)
        except OSError:
            holder = os.read(handle, 200).decode(errors="replace") or "another process"
            reason = f"{store} is being written by {holder}; wait until it has ended"
            raise InvalidDescription("", reason) from None
        os.ftruncate(handle, 0)
        os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        os.close(handle)


def _lock(handle: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
