"""LLVM text to machine code: compiled for this processor, kept in memory and on disk."""

from __future__ import annotations

import ctypes
import hashlib
import os
import tempfile
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

_LOCK: Final = threading.Lock()
_DIGEST: Final = 32

KEPT: Final = 2000
"""Most object files on disk, some 25 kB each."""


class Compiled:
    """A module's machine code.

    Parameters
    ----------
    text
        LLVM's textual representation of a module.

    Attributes
    ----------
    size
        Bytes of the object file.
    """

    def __init__(self, text: str) -> None:
        with _LOCK:
            code = _object(text)
            self._engine = _linked(code)
        self.size = len(code)

    def function(self, name: str, *arguments: Any) -> Any:
        """Return a function of the module, called without Python's lock; it returns nothing."""
        found = ctypes.CFUNCTYPE(None, *arguments)(self._engine.get_function_address(name))
        found.code = self._engine  # pyright: ignore[reportAttributeAccessIssue] - which lives as long as the function does
        return found


def has(feature: str) -> bool:
    """Return whether this processor has a feature, such as ``"avx512f"``."""
    return f"+{feature}" in _features().split(",")


def _object(text: str) -> bytes:
    """Return the object code, from disk if it was made before on such a processor."""
    name = f"{_key(text)}.o"
    try:
        whole = (_folder() / name).read_bytes()
        if hashlib.sha256(whole[_DIGEST:]).digest() == whole[:_DIGEST]:
            return whole[_DIGEST:]
    except OSError:
        pass
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(text)
    module.triple = _machine().triple
    code = _machine().emit_object(module)
    _keep(name, hashlib.sha256(code).digest() + code)
    return code


def _keep(name: str, content: bytes) -> None:
    with suppress(OSError):  # a folder that cannot be written costs time, nothing else
        folder = _folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle, written = tempfile.mkstemp(dir=folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            Path(written).replace(folder / name)
        finally:
            Path(written).unlink(missing_ok=True)
        _prune(folder)


def _prune(folder: Path) -> None:
    """Remove the oldest files, so that at most `KEPT` are left."""
    files = [entry for entry in os.scandir(folder) if entry.is_file()]
    if len(files) > KEPT:
        for entry in sorted(files, key=lambda entry: entry.stat().st_mtime)[:-KEPT]:
            Path(entry).unlink(missing_ok=True)


def _key(text: str) -> str:
    import llvmlite
    import llvmlite.binding as llvm

    facts = (llvmlite.__version__, _machine().triple, llvm.get_host_cpu_name(), _features(), text)
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()


def _folder() -> Path:
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError as error:
        raise FileNotFoundError("the user has no home") from error
    return Path(base) / "extremum"


@cache
def _features() -> str:
    import llvmlite.binding as llvm

    return llvm.get_host_cpu_features().flatten()


@cache
def _machine() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=3, jit=True
    )


def _linked(code: bytes) -> Any:
    import llvmlite.binding as llvm

    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine_of_its_own())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def _machine_of_its_own() -> Any:
    import llvmlite.binding as llvm

    target = llvm.Target.from_triple(_machine().triple)
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=3, jit=True
    )
