"""`DiscreteController.step` in a loop that SciPy integrates is what `simulate_sampled` runs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from by_hand import DRAGGED, ZERO, ByHand, Numbers, Seeker
from loops import velocity_actuated

import extremum as es
from extremum import s

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

VEHICLE = es.PointMass((1 / (s * (s + 0.7)), (s + 3) / (s**2 + s + 1)), disturbance=(0.1, 0.2))


class Deployed(Seeker):
    """The controller as it is deployed; samples in, commands out."""

    def __init__(self, controller: es.DiscreteController) -> None:
        super().__init__(controller.dt, (DRAGGED, ZERO))
        self.controller, self.state = controller, None

    def command(self, k: int, sample: float) -> Numbers:
        if k == 0:
            self.state = self.controller.init(sample)
        sent, self.state = self.controller.step(self.state, sample)
        return np.array(sent)


def quadratic(p: Numbers) -> float:
    return 1 - (p[0] + 1) ** 2 - 0.5 * (p[1] + 1) ** 2


PRACTICES: dict[str, Any] = {
    "none": (None, {}),
    "compensators": (None, {"controller.channels.0.compensator": es.Lead(5, -0.5, -3)}),
    "frequencies": (es.Practice(delay=0.0), {"controller.channels.1.ratio": 1.5}),
    "ramp": (es.Practice(delay=0.01, lag=0.03), {"controller.probe_ramp": 0.2}),
    "limits": (es.Practice(limits=es.Limits(low=(-50, -50), high=(50, 50))), {}),
    "scale": (es.Practice(scale=es.RunningScale(0.5, 0.1)), {}),
}


@pytest.mark.parametrize("name", PRACTICES)
def test_the_deployed_controller_drives_the_same_loop(name: str) -> None:
    practice, changes = PRACTICES[name]
    loop = velocity_actuated(vehicle=VEHICLE, **changes)
    dt, steps = 2e-3, 400
    controller = es.discretize(loop.controller, dt, practice=practice, vehicle=VEHICLE)
    hand = ByHand((DRAGGED, ZERO), quadratic, Deployed(controller))
    positions, _ = hand.run((1, 1), steps)
    run = es.simulate_sampled(loop, dt, steps * dt, practice=practice)
    assert run.position.values == pytest.approx(positions, abs=1e-9)


def test_lost_samples_are_lost_alike() -> None:
    """NaN where the run had NaN: the commands are the run's inputs."""
    loop, dt = velocity_actuated(), 1e-3
    practice = es.Practice(validity=es.Validity(timeout=0.02, fade=0.05))
    sensor = es.Sensor(dropout=0.7)
    run = es.simulate_sampled(loop, dt, 2.0, sensor=sensor, practice=practice, seed=5)
    controller = es.discretize(loop.controller, dt, practice=practice, vehicle=loop.vehicle)
    sent = controller.run(run.sensed.values)
    assert np.isnan(run.sensed.values[1000:1020]).any()
    assert sent == pytest.approx(run.input.values, abs=1e-9)
    assert math.isfinite(sent.sum())
