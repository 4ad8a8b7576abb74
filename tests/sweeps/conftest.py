from __future__ import annotations

import closed_form
import pytest


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    closed_form.small_jobs(monkeypatch=monkeypatch)
    return tmp_path
