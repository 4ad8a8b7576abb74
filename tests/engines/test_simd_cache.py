"""Machine code kept in memory and on disk."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from extremum.engines.simd import compiling
from extremum.engines.simd.compiling import Compiled

TEXT = """define void @f(ptr %x, i64 %n) {
  %a = load double, ptr %x, align 8
  %b = fmul double %a, FACTOR
  store double %b, ptr %x, align 8
  ret void
}"""


def text(factor: float) -> str:
    return TEXT.replace("FACTOR", f"{factor:.1f}")


def called(code: Compiled) -> float:
    return run(code.function("f", ctypes.c_void_p, ctypes.c_int64))


def run(function: Callable[..., None]) -> float:
    x = np.array([3.0])
    function(x.ctypes.data, 1)
    return float(x[0])


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "extremum"


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is compiled and not found on disk."""
    seen: list[Any] = []
    original = compiling._keep

    def keeping(*arguments: Any) -> None:
        seen.append(arguments)
        original(*arguments)

    monkeypatch.setattr(compiling, "_keep", keeping)
    return seen


def test_code_is_found_on_disk(folder: Path, made: list[Any]) -> None:
    assert called(Compiled(text(2))) == 6
    assert called(Compiled(text(2))) == 6
    assert len(made) == 1
    assert called(Compiled(text(5))) == 15
    assert len(made) == 2
    assert len(list(folder.iterdir())) == 2
    assert all(path.suffix == ".o" for path in folder.iterdir())  # nothing half written is left
    assert folder.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("damage", ["empty", "short", "flipped", "another's", "text"])
def test_a_damaged_file_is_made_again(folder: Path, made: list[Any], damage: str) -> None:
    Compiled(text(2))
    (path,) = folder.iterdir()
    good = path.read_bytes()
    middle = len(good) // 2
    bad = {
        "empty": b"",
        "short": good[:middle],
        "flipped": good[:middle] + bytes([good[middle] ^ 1]) + good[middle + 1 :],
        "another's": good[:32] + b"\x7fELF" + bytes(middle),
        "text": b"not found",
    }[damage]
    path.write_bytes(bad)
    assert called(Compiled(text(2))) == 6
    assert len(made) == 2
    assert path.read_bytes() == good


def test_a_folder_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(file))
    assert called(Compiled(text(7))) == 21
    assert file.read_text() == "in the way"


def test_no_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A container's user may have none."""

    def none() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", none)
    monkeypatch.chdir(tmp_path)
    assert called(Compiled(text(8))) == 24


def test_another_processor_or_compiler_is_another_file(
    folder: Path, made: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    import llvmlite

    Compiled(text(2))
    monkeypatch.setattr(llvmlite, "__version__", "9.99")
    Compiled(text(2))
    features = compiling._features()
    monkeypatch.setattr(compiling, "_features", lambda: features + ",+none-such")
    Compiled(text(2))
    assert len(made) == len(list(folder.iterdir())) == 3


def test_a_function_outlives_its_module(folder: Path) -> None:
    function = Compiled(text(2)).function("f", ctypes.c_void_p, ctypes.c_int64)
    gc.collect()
    others = [Compiled(text(k)).function("f", ctypes.c_void_p, ctypes.c_int64) for k in range(20)]
    gc.collect()
    assert run(function) == 6
    assert [run(other) for other in others] == [3 * k for k in range(20)]


def test_threads_compile_at_once(folder: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda k: called(Compiled(text(k % 5))), range(40)))
    assert found == [3 * (k % 5) for k in range(40)]
    assert len(list(folder.iterdir())) == 5


def test_what_is_no_module_is_refused(folder: Path) -> None:
    with pytest.raises(RuntimeError, match="LLVM"):
        Compiled("define nothing")
    assert not folder.exists() or not list(folder.iterdir())
    assert called(Compiled(text(2))) == 6  # and the lock is free
