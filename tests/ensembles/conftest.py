from __future__ import annotations

import pytest
import slow_engine

from extremum.ensembles import ensembling


@pytest.fixture
def slowly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every ensemble of the test runs on the slow and exact engine."""
    monkeypatch.setattr(ensembling, "integrator", lambda device: slow_engine.integrate)
