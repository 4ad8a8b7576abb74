"""Random loops against the slow and exact engine: every variable of the result."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated
from test_keep import KEEP, close, moving

import extremum as es

RNG = np.random.default_rng(5)
COUNT = 8
CHANNELS = ("controller.channels.0", "controller.channels.1")


def spread(low: float, high: float) -> np.ndarray:
    return RNG.uniform(low, high, COUNT)


COMMON = {
    "controller.frequency": spread(20, 45),
    "controller.washout": spread(0.5, 2),
    f"{CHANNELS[0]}.dither.amplitude": spread(0.05, 0.12),
    f"{CHANNELS[1]}.dither.phase": spread(-2, -1),
}
BUMP = es.Expression("exp(-a*((x + 1)**2 + (y - b)**2)) + sin(x*y)/10", {"a": 0.3, "b": 0.2})
LOOPS: dict[str, tuple[es.Loop, dict[str, Any]]] = {
    "quadratic": (
        velocity_actuated(),
        {**COMMON, "field.q.0": spread(0.5, 1), "start.1": spread(-2, 2)},
    ),
    "escaping": (
        velocity_actuated(**{"controller.washout_start": 0.0}),
        {**COMMON, "field.peak": spread(-9, 2), f"{CHANNELS[1]}.gain": spread(5, 20)},
    ),
    "force": (
        force_actuated(),
        {**COMMON, f"{CHANNELS[0]}.compensator.zero": spread(-1, -0.2)},
    ),
    "moving": (moving(), {**COMMON, "field.path.radius": spread(0.1, 0.4)}),
    "gaussian": (
        velocity_actuated(field=es.Gaussian((-1, -1), width=(2, 1.5))),
        {**COMMON, "field.width.0": spread(1.5, 3), "field.peak": spread(1, 3)},
    ),
    "expression": (velocity_actuated(field=BUMP), {**COMMON, "field.parameters.a": spread(0.2, 1)}),
}


@pytest.mark.parametrize("name", LOOPS)
def test_random_loops_are_those_of_the_exact_engine(
    name: str, request: pytest.FixtureRequest
) -> None:
    loop, over = LOOPS[name]
    stated = "source" in loop.system.outputs
    keep = [k for k in KEEP if stated or k not in ("distance", "settling_time")]
    asked: dict[str, Any] = {"keep": keep, "radius": 0.8 if stated else None, "samples": 3}
    ours = es.ensemble(loop, 2.0, over=over, **asked, tol=1e-9)
    assert ours.attrs["error"] < 1e-6
    assert ours.attrs["doubtful"] == 0
    request.getfixturevalue("slowly")
    theirs = es.ensemble(loop, 2.0, over=over, **asked)
    assert np.array_equal(ours.outcome, theirs.outcome)
    assert (name == "escaping") == bool(theirs.outcome.any())
    assert np.allclose(ours.end_time, theirs.end_time, rtol=1e-6)
    whole = (theirs.outcome == 0).values
    period = 2 * np.pi / over["controller.frequency"][whole]
    for variable in ours.data_vars:
        one, other = (d[variable].values[whole] for d in (ours, theirs))
        assert close(str(variable), one, other, period), variable
