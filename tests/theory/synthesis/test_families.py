"""Polynomials in batches, and one axis as numbers, each against a derivation of its own."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import extremum as es
from extremum import s
from extremum.requirements import Requirements
from extremum.theory.synthesis import polynomials as poly
from extremum.theory.synthesis.family import (
    PACE,
    PROBE,
    WASHED,
    Family,
    closed,
    families,
    felt_curvature,
    pade,
    plants,
    poles_at_origin,
)

from . import by_hand
from .asked import EPSILON, family_of, required


def uncertain_pole(low: float, high: float, **changes: Any) -> Requirements:
    axis = es.Rational("1/(s - epsilon)", parameters={"epsilon": 0.3})
    return required(axis, uncertain={EPSILON: (low, high)}, **changes)


# --- polynomials ------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [(0, 0), (0, 3), (3, 0), (2, 5), (5, 2), (4, 4)])
def test_batches_of_polynomials_are_numpy_s_one_by_one(degrees: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    a, b = (rng.standard_normal((7, d + 1)) for d in degrees)
    points = rng.standard_normal(7) + 1j * rng.standard_normal(7)
    many, sums, values = poly.product(a, b), poly.total(a, b), poly.at(a, points)
    slopes = poly.slope(a)
    for k in range(7):
        assert many[k] == pytest.approx(np.polymul(a[k], b[k]))
        assert np.polysub(sums[k], np.polyadd(a[k], b[k])) == pytest.approx(0, abs=1e-12)
        assert sums.shape[-1] == max(degrees) + 1
        assert values[k] == pytest.approx(np.polyval(a[k], points[k]))
        if degrees[0]:
            assert slopes[k] == pytest.approx(np.polyder(a[k]))


def test_products_of_several_factors_broadcast() -> None:
    rng = np.random.default_rng(2)
    a, b, c = rng.standard_normal(3), rng.standard_normal((4, 2)), rng.standard_normal((5, 1, 4))
    found = poly.product(a, b, c)
    assert found.shape == (5, 4, 7)
    expected = np.polymul(np.polymul(a, b[3]), c[2, 0])
    assert found[2, 3] == pytest.approx(expected)


def test_roots_of_a_batch() -> None:
    rng = np.random.default_rng(3)
    given = rng.standard_normal((2, 6, 5))
    found = poly.roots(given)
    assert found.shape == (2, 6, 4)
    for k in np.ndindex(2, 6):
        assert np.sort_complex(found[k]) == pytest.approx(np.sort_complex(np.roots(given[k])))


# --- dead time --------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_pade_s_form_is_scipy_s_and_passes_all(order: int) -> None:
    above, below = pade(0.3, order)
    expected = by_hand.dead_time(0.3, order)
    scale = expected[1][0]  # pyright: ignore[reportIndexIssue, reportArgumentType]
    assert below[0] == 1
    for found, wanted in zip((above, below), expected, strict=True):
        assert found == pytest.approx(np.array(wanted) / scale, rel=1e-5)
    points = 1j * np.linspace(0, 50, 40)
    assert np.abs(np.polyval(above, points) / np.polyval(below, points)) == pytest.approx(1)


@pytest.mark.parametrize(
    ("order", "turn", "degrees"), [(2, 1.0, 0.09), (2, 2.0, 2.5), (4, 1.5 * math.pi, 1.3)]
)
def test_pade_s_form_is_the_dead_time_where_it_is_used(
    order: int, turn: float, degrees: float
) -> None:
    delay = 0.07
    above, below = pade(delay, order)
    points = 1j * np.linspace(0, turn / delay, 60)
    ratio = np.polyval(above, points) / np.polyval(below, points) / np.exp(-points * delay)
    assert 0.3 * degrees < np.degrees(np.abs(np.angle(ratio))).max() < degrees


def test_no_dead_time_is_the_factor_one() -> None:
    above, below = pade(0.0)
    assert above.tolist() == below.tolist() == [1.0]


# --- families ---------------------------------------------------------------------------------


def test_plants_at_the_ends_and_in_the_middle_of_their_ranges() -> None:
    axis = es.Rational("k/((s - epsilon)*(tau*s + 1))", parameters={"k": 2, "epsilon": 0, "tau": 1})
    path = "vehicle.axes.0.parameters."
    wanted = required(
        axis, uncertain={f"{path}epsilon": (-0.1, 0.5), f"{path}tau": (0.05, 0.2), f"{path}k": 3.0}
    )
    family = families(wanted)[0]
    corners = {(3 / tau, (1.0, 1 / tau - e, -e / tau)) for e in (-0.1, 0.5) for tau in (0.05, 0.2)}
    seen = {(float(p.numerator[0]), tuple(p.denominator)) for p in family.vertices}
    assert len(seen) == len(family.vertices) == 4
    for found, expected in zip(sorted(seen), sorted(corners), strict=True):
        assert found[0] == pytest.approx(expected[0])
        assert found[1] == pytest.approx(expected[1])
    assert family.nominal.numerator == pytest.approx([3 / 0.125])
    assert family.nominal.denominator == pytest.approx([1, 8 - 0.2, -0.2 * 8])
    assert len(plants(wanted, 0, 3)) == 9
    load = max(0.5 / 3, 0.1 / 3)
    assert max(abs(p.load) for p in family.vertices) == pytest.approx(load)
    assert np.sort(family.nominal.poles.real) == pytest.approx([-8, 0.2])


def test_an_axis_sees_only_its_own_uncertain_numbers() -> None:
    axis = es.Rational("1/(s - epsilon)", parameters={"epsilon": 0.3})
    wanted = required(
        vehicle=es.PointMass(axes=(axis, axis)),
        curvature=((0.5, 2.0), (1.0, 1.0)),
        uncertain={EPSILON: (0.0, 0.5)},
    )
    first, second = families(wanted)
    assert len(first.vertices) == 2
    assert len(second.vertices) == 1
    assert second.vertices[0].denominator == pytest.approx([1, -0.3])
    assert (first.axis, first.name, second.axis, second.name) == (0, "x", 1, "y")
    assert first.gains == pytest.approx((0.5, 2.0))
    assert second.gains == (1.0, 1.0)


@pytest.mark.parametrize(
    ("axis", "changes", "expected"),
    [
        (1 / s, {}, 0),
        (1 / s, {"force": 0.2}, 1),
        (1 / s, {"force": 0.2, "zero_bias": False}, 0),
        (1 / s, {"motion": es.Ramp()}, 1),
        (1 / s, {"motion": es.Ramp(), "force": 0.2}, 1),
        (1 / s, {"motion": es.Ramp(), "zero_bias": False}, 0),
        (1 / s, {"motion": es.Periodic(0.1)}, 0),
        (1 / s**2, {}, 0),
        (1 / s**2, {"force": 0.2}, 1),
        (1 / s**2, {"motion": es.Ramp()}, 0),
        (1 / s**2, {"motion": es.Ramp(), "force": 0.2}, 1),
        (1 / (s - 0.5), {}, 1),
        (1 / (s - 0.5), {"zero_bias": False}, 0),
        (1 / (s - 0.5), {"motion": es.Ramp()}, 2),
        (1 / (s - 0.5), {"motion": es.Ramp(), "zero_bias": False}, 1),
        (1 / (s - 0.5), {"force": 1.0}, 1),
        (1 / (s + 0.5), {}, 1),
        (1 / (s * (s + 0.7)), {}, 0),
        (1 / (s * (s + 0.7)), {"force": 0.1}, 1),
        (1 / (s * (s + 0.7)), {"motion": es.Ramp()}, 1),
        (1 / (s * (s - 0.7)), {}, 0),
    ],
)
def test_as_many_integrators_as_zero_error_needs(
    axis: Any, changes: dict[str, Any], expected: int
) -> None:
    """Final values: with one integrator fewer, x̃(∞) is not 0."""
    family = family_of(axis, **changes)
    assert family.integrators == expected
    if not changes.get("zero_bias", True):
        return
    ramp = isinstance(changes.get("motion"), es.Ramp)
    assert not _error_remains(family, expected, ramp)
    if expected:
        assert _error_remains(family, expected - 1, ramp)


def _error_remains(family: Family, integrators: int, ramp: bool) -> bool:
    """Whether lim s·x̃(s) is not 0, x̃ = D_c(N d − D x*)/P, x* a step, or a ramp."""
    plant = family.nominal
    free_below = len(plant.denominator) - 1 - np.flatnonzero(plant.denominator)[-1]
    zeros_from_source = integrators + free_below - (2 if ramp else 1)
    zeros_from_force = integrators - 1
    # the loop has no root at 0, so the order of s in s·x̃(s) is what is left
    return bool(zeros_from_source < 0 or (family.force > 0 and zeros_from_force < 0))


def test_an_uncertain_pole_may_pass_through_the_origin() -> None:
    family = families(uncertain_pole(0.0, 0.5))[0]
    assert family.integrators == 1
    assert poles_at_origin(family.vertices) == 0
    assert poles_at_origin((family.vertices[0],)) == 1


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        (None, ()),
        (es.Ramp(), ()),
        (es.Periodic(0.3), (0.3,)),
        (es.Periodic(0.3, up_to=0.6), (0.3, 0.6)),
        (es.Periodic(0.1, up_to=0.3), (0.1, 0.2, 0.3)),
        (es.Periodic(0.3, up_to=0.59), (0.3,)),
    ],
)
def test_resonators_at_the_frequencies_of_the_source(motion: Any, expected: Any) -> None:
    assert family_of(motion=motion).resonances == pytest.approx(expected)


def test_what_the_input_has_room_for() -> None:
    family = family_of(
        1 / (s - 0.5), input_limit=10.0, source_distance=3.0, force=2.0, dither_limit=0.2
    )
    assert family.load == pytest.approx(0.5 * 3 + 2)
    assert float(family.passed(4.0)) == pytest.approx(1 / math.hypot(4, 0.5))
    slow = 1.0
    assert float(family.amplitude(slow)) == 0.2
    room = PROBE * (10 - 3.5)
    assert float(family.amplitude(200.0)) == pytest.approx(room / math.hypot(200, 0.5))
    assert family_of(dither_limit=0.2).amplitude(1e9) == 0.2


def test_the_reach_is_where_c_q_r_over_omega_is_a_tenth() -> None:
    family = family_of(dither_limit=0.2)
    bandwidth, gain = 3.0, 2.5
    r = float(family.reach(bandwidth, gain))
    cq = gain / (0.2 * WASHED)
    assert cq * r / (PACE * bandwidth) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("axis", "motion", "expected"),
    [
        (1 / s, es.Ramp(velocity=0.2), 0.2),
        (1 / s**2, es.Ramp(velocity=0.2), 0.0),
        (2 / (s - 0.5), es.Ramp(velocity=0.2), 0.1),
        ((s + 3) / (s * (s + 1)), es.Ramp(velocity=0.6), 0.2),
        ((s + 3) / ((s + 1) * (s + 2)), es.Ramp(velocity=0.9), 0.9 * (3 - 2 / 3) / 3),
        (1 / s, es.Periodic(0.5, amplitude=0.4), 0.2),
        (1 / s, es.Periodic(0.5, up_to=1.0, amplitude=0.4), 0.4),
        (1 / s**2, es.Periodic(0.5, amplitude=0.4), 0.1),
        (1 / (s - 0.5), es.Periodic(0.5, amplitude=0.4), 0.4 * math.hypot(0.5, 0.5)),
        (1 / s, es.Ramp(), 0.0),
        (1 / s, es.Periodic(0.5), 0.0),
        (1 / s, None, 0.0),
    ],
)
def test_what_following_the_source_takes(axis: Any, motion: Any, expected: float) -> None:
    """ẋ/N(0) and so on, besides what holds the vehicle where it is."""
    family = family_of(axis, motion=motion, input_limit=10.0)
    assert family.following == pytest.approx(expected)
    room = PROBE * (10 - family.load - expected)
    assert float(family.amplitude(1e4)) == pytest.approx(room * family.passed(1e4))


def test_what_the_probe_makes_of_plants_that_are_not_nominal() -> None:
    """It goes through 1/G₀ of τ = 0.1: the position moves by α G/G₀, heard is the real part."""
    axis = es.Rational("k/(s*(tau*s + 1))", parameters={"k": 1, "tau": 0.1})
    path = "vehicle.axes.0.parameters."
    wanted = required(axis, uncertain={f"{path}k": (0.8, 1.2), f"{path}tau": (0.05, 0.15)})
    family = families(wanted)[0]
    assert all(plant.heard == 1.0 for plant in family.vertices)
    tuned = family.tuned(12.0)
    ratios = [
        k * (1.2j + 1) / (12j * tau + 1) for k, tau in itertools.product((0.8, 1.2), (0.05, 0.15))
    ]
    heard = sorted(p.heard for p in tuned.vertices)
    assert heard == pytest.approx(sorted(r.real for r in ratios))
    assert tuned.swing == pytest.approx(max(map(abs, ratios)))
    assert tuned.heard == pytest.approx((min(heard), max(heard)), rel=0.01)
    assert float(tuned.amplitude(1.0)) == pytest.approx(0.1 / tuned.swing)
    assert tuned.tuned(0.001).swing == pytest.approx(1.2, rel=1e-3)


def test_what_is_heard_of_the_dither_is_gain() -> None:
    family = family_of(1 / s)
    half = replace(family.nominal, heard=0.5)
    one = np.ones(1)
    assert closed(family, half, one, one, 3.0) == pytest.approx([1, 1.5])


def test_axes_that_are_alike_have_one_key() -> None:
    def of(axes: tuple[Any, Any], **changes: Any) -> tuple[Family, ...]:
        vehicle = es.PointMass(axes=axes)
        wanted = {"curvature": ((0.5, 2.0), (0.5, 2.0))} | changes
        return families(required(vehicle=vehicle, **wanted))

    alike = of((1 / s, 1 / s))
    assert alike[0].key == alike[1].key
    for changes in (
        {"curvature": ((0.5, 2.0), (0.5, 2.1))},
        {"force": (0.0, 0.1)},
        {"dither_limit": (0.1, 0.2)},
        {"input_limit": (5.0, 6.0)},
        {"include": (1, 1 / (s + 1))},
    ):
        first, second = of((1 / s, 1 / s), **changes)
        assert first.key != second.key
    first, second = of((1 / (s - 0.5), 1 / (s - 0.5)), source_distance=(1.0, 2.0))
    assert first.key != second.key
    first, second = of((1 / s, 1 / s**2))
    assert first.key != second.key


def test_coupled_axes_feel_the_eigenvalues_of_all_hessians() -> None:
    wanted = required(
        vehicle=es.PointMass(axes=(1 / s,) * 3),
        curvature=((0.5, 2.0), (1.0, 3.0), (0.8, 0.9)),
        coupling=0.2,
    )
    low, high = felt_curvature(wanted, 1)
    rng = np.random.default_rng(4)
    seen = []
    for _ in range(3000):
        q = np.diag([rng.choice(ends) for ends in wanted.curvature]).astype(float)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            q[i, j] = q[j, i] = rng.choice([-0.2, 0.2])
        seen += np.linalg.eigvalsh(q).tolist()
    assert min(seen) == pytest.approx(low, rel=1e-9)
    assert max(seen) == pytest.approx(high, rel=1e-9)
    family = families(wanted)[1]
    assert family.gains == pytest.approx((low / math.sqrt(3), high / math.sqrt(3)))
    assert felt_curvature(wanted.replace({"coupling": 0.0}), 1) == (1.0, 3.0)


def test_the_characteristic_polynomial() -> None:
    """(s² − 0.3 s)(s + 4) + 1.5 · 2 (s + 1)."""
    family = family_of(2 / (s * (s - 0.3)))
    found = closed(family, family.nominal, np.array([1.0, 1.0]), np.array([1.0, 4.0]), 1.5)
    assert found == pytest.approx([1, 3.7, -1.2 + 3, 3])
