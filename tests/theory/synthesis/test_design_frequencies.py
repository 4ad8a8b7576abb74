"""The dithers' frequencies of designs: how they begin, are shared, sorted and raised."""

from __future__ import annotations

import itertools
import math

import pytest

import extremum as es
from extremum import s
from extremum.theory.synthesis import designing

from .asked import ASKED, EPSILON, designed, required, unstable
from .test_design import rule


def test_two_axes_share_a_frequency_only_in_quadrature() -> None:
    shared = designed("unstable").controller
    assert shared.frequencies()[0] == shared.frequencies()[1]
    gap = abs(shared.channels[0].dither.phase - shared.channels[1].dither.phase)  # pyright: ignore[reportAttributeAccessIssue]
    assert gap == pytest.approx(math.pi / 2)
    apart = es.design(
        ASKED["gain"].replace(
            {"vehicle": es.PointMass(axes=(1 / s,) * 2)}
            | {
                "curvature": ((0.5, 1.0),) * 2,
                "quadrature": False,
            }
        )
    ).controller
    assert apart.frequencies()[0] != apart.frequencies()[1]


def test_every_dither_is_four_times_what_its_loop_passes() -> None:
    for name in ASKED:
        design = designed(name)
        omegas = design.controller.frequencies()
        for omega, shape in zip(omegas, design.plan.shapes, strict=True):
            assert omega >= 4 * shape.fastest * (1 - 1e-9)
        assert design.controller.washout == pytest.approx(design.frequency / 2, rel=1e-4)


def test_faster_loops_have_faster_dithers() -> None:
    design = designed("three")
    assert len(set(design.plan.ratios)) == 2
    pairs = list(zip(design.plan.shapes, design.plan.ratios, strict=True))
    for (first, slow), (second, fast) in itertools.product(pairs, repeat=2):
        assert first.fastest >= second.fastest or slow <= fast


def test_the_search_begins_at_four_bandwidths_of_the_fastest_loop() -> None:
    for name in ASKED:
        plan = designed(name).plan
        needed = (4 * s.fastest / float(r) for s, r in zip(plan.shapes, plan.ratios, strict=True))
        assert designed(name).begun == pytest.approx(max(needed), rel=0.01)


def test_a_frequency_is_raised_where_the_exact_loop_asks_for_it() -> None:
    """By factors of 1.2, and no further: at the one before, a run or an orbit fails."""
    design = designed("raised")
    times = math.log(design.frequency / design.begun) / math.log(1.2)
    assert round(times) >= 1
    assert times == pytest.approx(round(times), abs=0.1)
    found = rule(design, "fastest dither")
    assert found.decided_by == "the exact loop"
    assert f"{design.begun:g}" in found.note


def test_the_shape_with_the_lowest_frequency_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the first three, each alone."""
    best, found, shapes = designed("raised").frequency, [], designing.shapes
    for k in range(designing.TRIALS):
        monkeypatch.setattr(designing, "shapes", lambda *given, k=k: [[*shapes(*given)][k]])
        found.append(es.design(ASKED["raised"]).frequency)
    assert best == min(found) < max(found)


def test_an_uncertain_pole_is_taken_through_its_range() -> None:
    """The confirmed points hold 0, 0.25 and 0.5."""
    seen = {c.point[EPSILON] for c in designed("unstable").confirmations}
    assert seen == {0.0, 0.25, 0.5}
    known = es.design(required(unstable(0.5), settling_time=6, dither_limit=0.2))
    assert EPSILON not in known.box
