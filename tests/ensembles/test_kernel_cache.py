"""The folder of machine code stays small and tidy."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from extremum.engines.simd import compiling
from extremum.engines.simd.compiling import Compiled

TEXT = "define void @f{}() {{ ret void }}"


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "extremum"


def test_the_oldest_code_is_removed(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setattr(compiling, "KEPT", 3)
    made: list[str] = []
    for i in range(7):
        Compiled(TEXT.format(i))
        (new,) = {path.name for path in folder.iterdir()} - set(made)
        made.append(new)
        os.utime(folder / new, (i, i))
    assert {path.name for path in folder.iterdir()} == set(made[-3:])


def test_a_failure_leaves_no_temporary_file(folder: Path) -> None:
    text = TEXT.format("")
    Compiled(text)
    (path,) = folder.iterdir()
    path.unlink()
    path.mkdir()
    Compiled(text)
    assert list(folder.iterdir()) == [path]
