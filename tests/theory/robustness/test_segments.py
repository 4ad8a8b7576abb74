from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from extremum.theory.robustness.segments import apart, crosses, is_hurwitz, shifted

CLOSE = 1e-6
"""Where roots in floats come closer to the axis than this they decide nothing."""


def slowest(polynomial: object) -> float:
    return float(np.roots(np.array(polynomial, dtype=float)).real.max())


def stable_integers(rng: np.random.Generator, degree: int) -> list[int]:
    found = np.array([1])
    while len(found) <= degree:
        pair = len(found) < degree and rng.random() < 0.7
        factor = (1, rng.integers(1, 6), rng.integers(1, 40)) if pair else (1, rng.integers(1, 9))
        found = np.convolve(found, factor)
    return [int(c) for c in found]


@pytest.mark.parametrize("degree", range(1, 10))
def test_hurwitz_agrees_with_the_roots(degree: int) -> None:
    rng = np.random.default_rng(degree)
    verdicts = set()
    for _ in range(200):
        polynomial = stable_integers(rng, degree)
        polynomial[int(rng.integers(1, degree + 1))] += int(rng.integers(-30, 30))
        if abs(worst := slowest(polynomial)) > CLOSE:
            verdicts.add(worst < 0)
            assert is_hurwitz(polynomial) == (worst < 0)
            assert is_hurwitz([-c for c in polynomial]) == (worst < 0)
    assert verdicts == {True, False}


def test_roots_on_the_axis_are_not_stable() -> None:
    assert is_hurwitz([7])
    assert is_hurwitz([10**40, 1])
    assert not is_hurwitz([1, 0])
    assert not is_hurwitz([1, 1, 0])
    assert not is_hurwitz([1, 0, 4])
    assert not is_hurwitz([1, 3, 4, 12])  # (s + 3)(s² + 4)
    assert is_hurwitz([10**30, 3 * 10**30, 4 * 10**30, 12 * 10**30 - 1])
    assert not is_hurwitz([10**30, 3 * 10**30, 4 * 10**30, 12 * 10**30 + 1])
    assert not is_hurwitz([1, 2, 6, 8, 8])  # (s² + 4)(s² + 2s + 2)


@pytest.mark.parametrize("degree", range(1, 9))
def test_a_segment_crosses_where_its_roots_do(degree: int) -> None:
    rng = np.random.default_rng(10 + degree)
    verdicts = []
    parts = np.linspace(0, 1, 401)
    for _ in range(60):
        first, second = stable_integers(rng, degree), stable_integers(rng, degree)
        second[int(rng.integers(1, degree + 1))] -= int(rng.integers(0, 60))
        between = np.outer(1 - parts, first) + np.outer(parts, second)
        worst = max(slowest(p) for p in between)
        found = crosses(first, second)
        assert crosses(second, first) == found
        assert crosses(first, [3 * c for c in second]) == found
        if worst > CLOSE:
            assert found
        elif worst < -1e-3:
            assert not found
        verdicts.append(found)
    assert set(verdicts) == {True, False}


def test_a_segment_that_only_touches_the_axis_crosses() -> None:
    """For s³ + (1 + λ)s² + (1 + λ)s + c₀ + c₁λ, Routh's condition is (1 + λ)² > c₀ + c₁λ."""
    touching = [12, 12, 12, 9], [12, 24, 24, 45]  # (1 + λ)² − 3/4 − 3λ = (λ − 1/2)²
    assert is_hurwitz(touching[0])
    assert is_hurwitz(touching[1])
    assert crosses(*touching)
    scale = 10**30
    one, other = ([scale * c for c in p] for p in touching)
    assert crosses([*one[:-1], one[-1] + 1], [*other[:-1], other[-1] + 1])
    assert not crosses([*one[:-1], one[-1] - 1], [*other[:-1], other[-1] - 1])


def test_a_segment_with_a_root_at_0_or_an_unstable_end_crosses() -> None:
    assert crosses([1, 2, 1], [1, 2, 0])
    assert crosses([1, 2, 1], [1, 2, -1])
    assert crosses([1, 1, 1], [1, 0, 1])
    assert crosses([1, 1, 1], [1, -1, 1])
    assert not crosses([1, 1, 1], [1, 1, 1])
    assert not crosses([1, 1, 1], [5, 5, 5])


def test_apart_is_a_positive_real_part_on_the_whole_axis() -> None:
    assert apart([1, 1], [1, 5])
    assert apart([1, 1, 1], [1, 3, 1])
    assert not apart([1, 1], [1, -1])  # −(1 + ω²) + … turns: Re = ω² − 1
    assert not apart([1, 1, 1], [1, 1, 9])  # (1 − ω²)(9 − ω²) + ω² < 0 at ω² = 5
    assert not apart([1, 2, 4], [1, 0, 0])  # ω²(ω² − 4)
    assert not apart([1, 2, 4], [1, 2, 0])  # ω⁴, which is 0 at 0


@pytest.mark.parametrize("decay", [Fraction(0), Fraction(3, 10), Fraction(-7, 4)])
def test_shifting_moves_the_roots(decay: Fraction) -> None:
    polynomial = [2, 5, 7, 11, 1]
    found = shifted(polynomial, decay.as_integer_ratio())
    moved = (np.roots(polynomial) + float(decay)) * decay.denominator
    assert np.sort_complex(np.roots(found)) == pytest.approx(np.sort_complex(moved))
