"""Studies of sampled loops: jobs whose delays are different have the same states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from loops import velocity_actuated

import extremum as es


def test_a_study_sweeps_seeds_and_delays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from extremum.sweeps import layout

    monkeypatch.setattr(layout, "LARGEST", 3)
    sampling = es.Sampling(2e-3, es.Sensor(noise=0.3, delay=0.001))
    loop = es.SampledLoop.of(velocity_actuated(), sampling)
    axes = {
        "delay": es.Axis(values=(0.0, 0.0043, 0.021), paths=("sampling.sensor.delay",)),
        "seed": es.Axis(values=(0, 1, 2), paths=("sampling.seed",)),
    }
    study = es.Study(es.Scenario(loop, es.Run(0.4)), es.Sweep(axes=axes))
    assert es.parse_study(es.format_study(study)) == study
    found = es.sweep(study, tmp_path / "store.zarr")
    assert found.attrs["chunk"] == [1, 3]
    for delay in (0.0, 0.0043, 0.021):
        one = loop.replace({"sampling.sensor.delay": delay, "sampling.seed": 2})
        last = es.simulate(one, 0.4).position.values[-1]
        lane = found.position.sel(delay=delay, seed=2).values
        assert lane == pytest.approx(last, abs=1e-11)
    assert np.isfinite(found.position).all()
