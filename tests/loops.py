"""Loops that several tests start from."""

from __future__ import annotations

from typing import Any

import extremum as es
from extremum import pi, s


def velocity_actuated(**changes: Any) -> es.Loop:
    """The paper's Fig. 1 loop with the numbers of Fig. 4, washout started at J(0)."""
    loop = es.Loop(
        field=es.Quadratic(source=(-1, -1), q=(1.0, 0.5), peak=1.0),
        vehicle=es.PointMass(axes=(1 / s, 1 / s)),
        controller=es.GradientES(
            frequency=30,
            washout=1.0,
            channels=(
                es.Channel(dither=es.Dither(0.08), gain=10),
                es.Channel(dither=es.Dither(0.08, phase=-pi / 2), gain=10),
            ),
        ),
        start=(1, 1),
    )
    return loop.replace(changes)


def force_actuated(**changes: Any) -> es.Loop:
    """The paper's Fig. 2 loop with a lead that the corrected conditions call stable."""
    lead = es.Lead(gain=5, zero=-0.5, pole=-3)
    loop = es.Loop(
        field=es.Quadratic(source=(0, 0), q=(1.0, 0.5), peak=1.0),
        vehicle=es.PointMass(axes=(1 / s**2, 1 / s**2)),
        controller=es.GradientES(
            frequency=30,
            washout=1.0,
            channels=(
                es.Channel(dither=es.Dither(0.1), gain=10, compensator=lead),
                es.Channel(dither=es.Dither(0.1, phase=-pi / 2), gain=10, compensator=lead),
            ),
        ),
        start=es.OnDither((1, 1)),
    )
    return loop.replace(changes)
