"""What a dither that shrinks needs."""

from __future__ import annotations

import pytest

import extremum as es
from extremum.papers import zhang2007


def dither(least: float, shrink: float) -> es.ShrinkingDither:
    return es.ShrinkingDither(full=1.0, least=least, shrink=shrink, grow=2.0, response=1.0)


def test_single_integrators_keep_it_down_to_any_size() -> None:
    """The slowest mode is −a α c q_y = −0.4 a; at a = 0.1 its time is 25 s."""
    loop = zhang2007.scenario("fig4").loop
    found = es.check_shrinking(loop, dither(0.1, 30.0))
    assert found.holds
    assert found.rates[0] == pytest.approx(-0.04)
    assert found.rates[-1] == pytest.approx(-0.4)
    fast = es.check_shrinking(loop, dither(0.1, 20.0))
    assert fast.stable
    assert not fast.slow
    assert "1/|λ| = 25 s" in str(fast)


def test_an_unstable_vehicle_needs_its_smallest_gain() -> None:
    """Both sides of the boundary, against Floquet exponents of the exact orbit."""
    loop = zhang2007.scenario("unstable").loop
    found = es.check_shrinking(loop, dither(0.02, 100.0))
    assert not found.stable
    assert "take a larger `least`" in str(found)
    stable = [a for a, rate in zip(found.factors, found.rates, strict=True) if rate < 0]
    assert stable == list(found.factors[-len(stable) :])
    for factor, is_stable in ((1.4 * stable[0], True), (0.6 * stable[0], False)):
        smaller = loop.replace(
            {
                f"controller.channels.{i}.dither.amplitude": factor * channel.dither.amplitude
                for i, channel in enumerate(loop.controller.channels)  # pyright: ignore[reportAttributeAccessIssue]
            }
        )
        exact = es.stability(smaller.replace({"controller.frequency": 400.0}))
        assert exact.stable is is_stable


def test_something_else_is_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="must be a ShrinkingDither"):
        es.check_shrinking(zhang2007.scenario("fig4").loop, 0.1)  # pyright: ignore[reportArgumentType]
