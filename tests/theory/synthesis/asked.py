"""Small design problems that several tests start from, and their designs."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import extremum as es
from extremum import s
from extremum.requirements import Requirements
from extremum.theory.synthesis.family import Family, families

EPSILON: Final = "vehicle.axes.0.parameters.epsilon"
LAG: Final = "vehicle.axes.0.parameters.tau"


def required(axis: Any = 1 / s, **changes: Any) -> Requirements:
    wanted: dict[str, Any] = {
        "vehicle": es.PointMass(axes=(axis,)),
        "curvature": ((0.5, 2.0),),
        "dither_limit": 0.1,
        "settling_time": 4.0,
    }
    return Requirements(**(wanted | changes))


def family_of(axis: Any = 1 / s, **changes: Any) -> Family:
    return families(required(axis, **changes))[0]


def unstable(epsilon: float) -> es.Rational:
    return es.Rational("1/(s - epsilon)", parameters={"epsilon": epsilon})


def lagged(epsilon: float, lag: float) -> es.Rational:
    return es.Rational("1/((s - epsilon)*(tau*s + 1))", parameters={"epsilon": epsilon, "tau": lag})


def on(*axes: Any) -> dict[str, Any]:
    return {"vehicle": es.PointMass(axes=axes), "curvature": ((0.5, 1.0),) * len(axes)}


ASKED: Final = {
    "gain": required(start_distance=0.5),
    "forces": required(
        **on(1 / s, 1 / s**2), settling_time=8, force=(0.1, 0.2), dither_limit=(0.1, 0.05)
    ),
    "unstable": required(
        **on(unstable(0.2), unstable(0.5)),
        uncertain={EPSILON: (0, 0.5)},
        settling_time=6,
        source_distance=1,
        dither_limit=0.2,
    ),
    "lagged": required(
        lagged(0.3, 0.05),
        uncertain={EPSILON: (0, 1)},
        settling_time=5,
        source_distance=0.5,
        dither_limit=0.2,
        input_limit=60.0,
    ),
    "three": required(**on(1 / s, 1 / s, 1 / (s * (s + 2))), settling_time=8, force=0.1),
    "coupled": required(**on(1 / s, unstable(0.3)), coupling=0.2, settling_time=6),
    "coupled alike": required(**on(1 / s, 1 / s), coupling=0.2),
    "biased": required(1 / (s - 0.3), zero_bias=False, source_distance=0.5, force=0.1),
    "bandwidth": required(settling_time=None, bandwidth=1.0, force=0.2),
    "pushed": required(uncertain={"vehicle.axes.0.gain": (0.8, 1.2)}),
    "raised": required(**on(unstable(0.5)), settling_time=6, source_distance=4, dither_limit=0.02),
    "spring": required(1 / (s + 1), source_distance=2, force=2, input_limit=80.0),
}


@cache
def designed(name: str) -> es.Design:
    """Return the design of a problem above, made once."""
    return es.design(ASKED[name])
