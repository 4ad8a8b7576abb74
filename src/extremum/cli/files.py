"""Output files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from ..errors import InvalidDescription
from . import interrupts


class Files:
    """Files being written under temporary names; `commit` gives all of them their own.

    Whatever ends the block before that, an error or Ctrl-C, leaves nothing behind.

    Raises
    ------
    InvalidDescription
        Before anything is computed: for an existing file (without `force`), a folder that does not
        exist or cannot be written to, or one file asked for twice.
    """

    def __init__(self, paths: Mapping[str, Path], force: bool) -> None:
        self.paths = dict(paths)
        self._temporary: dict[str, Path] = {}
        for path in self.paths.values():
            if path.is_dir():
                raise InvalidDescription("", f"{path} is a folder; name a file")
            if path.exists() and not force:
                raise InvalidDescription("", f"{path} exists; --force overwrites it")
            if sum(path.absolute() == other.absolute() for other in self.paths.values()) > 1:
                raise InvalidDescription("", f"{path} is asked for twice")

    def __contains__(self, key: str) -> bool:
        return key in self.paths

    def __getitem__(self, key: str) -> Path:
        return self._temporary[key]

    def __enter__(self) -> Self:
        for key, path in self.paths.items():
            try:
                handle, name = tempfile.mkstemp(
                    f".part{path.suffix}", f".{path.stem}.", path.parent
                )
            except OSError as error:
                self._remove()
                raise InvalidDescription("", f"cannot write {path}: {error.strerror}") from None
            os.close(handle)
            self._temporary[key] = Path(name)
        return self

    def commit(self) -> None:
        """Move every file to its own name."""
        interrupts.check()
        mask = os.umask(0)
        os.umask(mask)
        for key, path in self.paths.items():
            self._temporary[key].chmod(0o666 & ~mask)
            self._temporary.pop(key).replace(path)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._remove()

    def _remove(self) -> None:
        for path in self._temporary.values():
            path.unlink(missing_ok=True)
        self._temporary.clear()
