"""What requirements accept and refuse, each refusal with its path and the numbers."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

import extremum as es
from extremum import s
from extremum.requirements import MAX_RESONATORS, interval

from .asked import EPSILON, LAG, lagged, on, required, unstable

NAN, INFINITE = math.nan, math.inf
LAGGED = es.Rational("1/(s*(tau*s + 1))", parameters={"tau": 0.1})
REFUSED: list[tuple[dict[str, Any], str, str]] = [
    ({"curvature": ((0, 1),)}, "curvature.0", "greater than 0 all over the range"),
    ({"curvature": ((-1, 1),)}, "curvature.0", "no maximum"),
    ({"curvature": ((2, 1),)}, "curvature.0", "low end 2 exceeds its high end 1"),
    ({"curvature": ((1, 2), (1, 2))}, "curvature", "2 ranges, the vehicle has 1 axes"),
    ({"curvature": ((1, 2, 3),)}, "curvature.0", "two numbers"),
    ({"curvature": ((1, INFINITE),)}, "curvature.0.1", "finite"),
    ({"curvature": 2.0}, "curvature", "one pair of numbers per axis"),
    ({"curvature": ()}, "curvature", "one pair of numbers per axis"),
    ({"curvature": "2"}, "curvature", "one pair of numbers per axis"),
    ({"dither_limit": 0}, "dither_limit", "greater than 0"),
    ({"dither_limit": -1}, "dither_limit", "greater than 0"),
    ({"dither_limit": None}, "dither_limit", "number"),
    ({"dither_limit": (0.1, 0.2)}, "dither_limit", "2 entries for 1 axes"),
    ({"settling_time": None}, "settling_time", "none is"),
    ({"bandwidth": 1.0}, "settling_time", "both are"),
    ({"settling_time": 0}, "settling_time", "greater than 0"),
    ({"settling_time": NAN}, "settling_time", "finite"),
    ({"settling_time": None, "bandwidth": 0.0}, "bandwidth", "greater than 0"),
    ({"coupling": -0.1}, "coupling", "negative"),
    ({"force": -1}, "force", "negative"),
    ({"force": (1, 2)}, "force", "2 entries for 1 axes"),
    ({"noise": -1}, "noise", "negative"),
    ({"delay": -1}, "delay", "negative"),
    ({"delay": INFINITE}, "delay", "finite"),
    ({"start_distance": -1}, "start_distance", "negative"),
    ({"start_distance": (1.0,)}, "start_distance", "number"),
    ({"source_distance": -1}, "source_distance", "negative"),
    ({"source_distance": (1, 1)}, "source_distance", "2 entries for 1 axes"),
    ({"input_limit": 0}, "input_limit", "greater than 0"),
    ({"input_limit": (1, 2)}, "input_limit", "2 entries for 1 axes"),
    ({"frequency_limit": 0}, "frequency_limit", "greater than 0"),
    ({"zero_bias": 1}, "zero_bias", "true or false"),
    ({"quadrature": "yes"}, "quadrature", "true or false"),
    ({"include": (1, 1)}, "include", "2 factors for 1 axes"),
    ({"include": "1/s"}, "include", "one transfer function per axis"),
    ({"include": (s,)}, "include.0", "improper"),
    ({"include": (0,)}, "include", ""),
    ({"accuracy": 0.1}, "accuracy", "no `noise` is given"),
    ({"accuracy": 0, "noise": 1.0}, "accuracy", "greater than 0"),
    ({"motion": "ramp"}, "motion", "Periodic, Ramp"),
    ({"sensor": 0}, "sensor", ""),
    ({"sensor": 1 / (s - 1)}, "sensor", "not stable"),
    ({"uncertain": [1]}, "uncertain", "map dotted paths"),
    ({"uncertain": {"field.q.0": (1, 2)}}, "uncertain.field.q.0", "curvature"),
    ({"uncertain": {"vehicle.axes.1.den.0": 1}}, "uncertain.vehicle.axes.1.den.0", "known: 0"),
    ({"uncertain": {"vehicle.axes.0.den.0": (1, 0)}}, "uncertain.vehicle.axes.0.den.0", "exceeds"),
    ({"uncertain": {"vehicle.axes.0": (1, 2)}}, "uncertain.vehicle.axes.0", "feeds its input"),
    ({"uncertain": {"vehicle.axes": (1, 2)}}, "uncertain.vehicle.axes", "tuple"),
    ({"uncertain": {"vehicle.disturbance.0": 1}}, "uncertain.vehicle.disturbance.0", "None"),
    ({"vehicle": None}, "vehicle", "PointMass"),
    ({"vehicle": 1 / s}, "vehicle", "PointMass"),
    (
        {"vehicle": es.PointMass(axes=(1 / s,), disturbance=(0.1,))},
        "vehicle.disturbance",
        "state its bound",
    ),
    (
        {"vehicle": es.PointMass(axes=(LAGGED,)), "uncertain": {LAG: (0, 0.1)}},
        f"uncertain.{LAG}",
        "highest power",
    ),
    (
        {"vehicle": es.PointMass(axes=(LAGGED,)), "uncertain": {LAG: (-0.1, 0.1)}},
        f"uncertain.{LAG}",
        "",
    ),
]


@pytest.mark.parametrize(("changes", "path", "said"), REFUSED)
def test_what_cannot_be_is_refused_with_its_path(
    changes: dict[str, Any], path: str, said: str
) -> None:
    """By `Requirements`, or by `design` at the latest."""
    with pytest.raises(es.InvalidDescription) as caught:
        es.design(required(**changes))
    assert not isinstance(caught.value, es.Infeasible)
    assert caught.value.path.removeprefix("Requirements.").startswith(path)
    assert said in str(caught.value)


@pytest.mark.parametrize("given", [{"up_to": 0.5}, {"up_to": 5.0}, {"up_to": -1.0}])
def test_a_period_s_harmonics(given: dict[str, float]) -> None:
    with pytest.raises(es.InvalidDescription, match="up_to"):
        es.Periodic(1.0, **given)
    assert len(es.Periodic(1.0, up_to=4.99).frequencies()) == MAX_RESONATORS
    assert es.Periodic(0.1, up_to=0.3).frequencies() == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("given", "expected"), [(2, (2.0, 2.0)), ((1, 2), (1.0, 2.0)), ([1, 1], (1.0, 1.0))]
)
def test_a_number_is_a_range_of_one_point(given: Any, expected: Any) -> None:
    assert interval(given) == expected


def test_one_number_may_stand_for_all_axes() -> None:
    wanted = required(**on(1 / s, 1 / s), force=(0.1, 0.2), dither_limit=0.3, input_limit=None)
    assert wanted.per_axis("force") == (0.1, 0.2)
    assert wanted.per_axis("dither_limit") == (0.3, 0.3)
    assert wanted.per_axis("input_limit") == (None, None)
    assert wanted.axes() == ("x", "y")


def test_requirements_are_values() -> None:
    one, other = required(uncertain={}), required()
    assert one == other
    assert hash(one) == hash(other)
    assert one != required(force=0.1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.force = 1.0  # pyright: ignore[reportAttributeAccessIssue]
    changed = one.replace({"force": 0.2, "settling_time": None, "bandwidth": 1.0})
    assert (changed.force, changed.bandwidth, one.force) == (0.2, 1.0, 0.0)


def test_given_mappings_are_not_kept() -> None:
    given = {EPSILON: (0.0, 0.5)}
    wanted = required(unstable(0.2), uncertain=given)
    given[EPSILON] = (0.0, 9.0)
    assert wanted.uncertain[EPSILON] == (0.0, 0.5)
    with pytest.raises(TypeError):
        wanted.uncertain[EPSILON] = (0.0, 9.0)  # pyright: ignore[reportIndexIssue]


def test_transfer_functions_are_read_as_everywhere() -> None:
    wanted = required(sensor="1/(0.1*s + 1)", include=("1/(s + 1)",))
    assert wanted.sensor == required(sensor=1 / (0.1 * s + 1)).sensor
    assert wanted.include is not None
    assert str(wanted.include[0]) == "1/(s + 1.0)"


def test_the_nominal_number_need_not_lie_in_its_range() -> None:
    """The design's middle is that of the range."""
    path = f"{EPSILON}"
    wanted = required(lagged(0.9, 0.05), uncertain={path: (0, 0.4)}, settling_time=6)
    design = es.design(wanted)
    assert design.loop.vehicle.axes[0].parameters["epsilon"] == 0.2  # pyright: ignore[reportAttributeAccessIssue]
