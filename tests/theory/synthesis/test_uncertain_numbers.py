"""Uncertain numbers that are structure at one end of their range stay uncertain in the proof."""

from __future__ import annotations

import numpy as np
import pytest

import extremum as es
from extremum import s

ENDS = [
    ((0.0, 1.0), es.TransferFunction(num=(), den=(0.0, 0.0)), "den.0"),
    ((-0.5, 0.5), es.TransferFunction(num=(), den=(0.25, 0.0)), "den.0"),
    ((0.5, 1.0), es.TransferFunction(gain=1.0, den=(0.0,)), "gain"),
    ((1.0, 2.0), es.TransferFunction(gain=1.0, den=(0.0,)), "gain"),
]


@pytest.mark.parametrize(("ends", "plant", "name"), ENDS)
def test_the_proof_is_about_the_whole_range(
    ends: tuple[float, float], plant: es.TransferFunction, name: str
) -> None:
    path = f"vehicle.axes.0.{name}"
    design = es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=(plant,)),
            uncertain={path: ends},
            curvature=((0.5, 1.0),),
            dither_limit=0.1,
            settling_time=6.0,
        )
    )
    statement = design.proofs[0].statement
    assert f"[{ends[0]:g}, {ends[1]:g}]" in statement.replace("0.50", "0.5")
    slowest = -np.inf
    shape = design.plan.shapes[0]
    for value in np.linspace(*ends, 9):
        above, below = ([1.0], [1.0, value, 0.0]) if "den" in name else ([value], [1.0, 0.0])
        heard = value / np.mean(ends) if name == "gain" else 1.0
        for factor in heard * np.geomspace(*design.plan.families[0].gains, 9):
            loop = np.polyadd(
                np.polymul(below, shape.below),
                shape.gain * factor * np.polymul(above, shape.above),
            )
            slowest = max(slowest, float(np.roots(loop).real.max()))
    assert slowest < -design.decay
    assert slowest > -1.02 * design.decay


def test_ranges_of_structure_are_confirmed_at_their_ends() -> None:
    design = es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=(1 / (s**2 + 0.3 * s),)),
            uncertain={"vehicle.axes.0.den.0": (0.0, 0.6)},
            curvature=((0.5, 1.0),),
            dither_limit=0.1,
            settling_time=6.0,
        )
    )
    seen = {c.point["vehicle.axes.0.den.0"] for c in design.confirmations}
    assert {0.0, 0.3, 0.6} <= seen
    assert all(c.exponent < 0 for c in design.confirmations)
