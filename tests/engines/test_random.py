"""Random numbers: Philox against its authors' vectors, NumPy against LLVM, statistics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy import stats
from test_mathematics import compiled

from extremum.engines.lanes import random
from extremum.engines.simd.emitter import Emitter
from extremum.engines.simd.random import RANDOM, philox

KNOWN = (
    (
        *("00000000 00000000 00000000 00000000", "00000000 00000000"),
        "6627e8d5 e169c58d bc57ac4c 9b00dbd8",
    ),
    (
        *("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff"),
        "408f276d 41c83b0e a20bc7c6 6d5451fd",
    ),
    (
        *("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0"),
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
)
"""Random123's kat_vectors, philox4x32-10: counter, key, result."""

BOTH = pytest.mark.parametrize("name", ["uniform", "normal"])
SEEDS = (0.0, 1.0, 2.0, 3.0, 2.0**32 - 1, 2.0**32, 12345678901234.0, 2.0**53 - 1, 2.0**53)


def words(text: str) -> list[int]:
    return [int(word, 16) for word in text.split()]


def lanes(name: str, stream: int, width: int = 8) -> Callable[..., Any]:
    """Seeds and steps → random numbers, by the vector units."""
    e = Emitter(width, 64, contract=True)
    return compiled(lambda e, seed, step: (RANDOM[name](e, seed, step, stream),), 2, e)


def drawn(name: str, seed: Any, step: Any, stream: int) -> Any:
    return getattr(random, name)(seed, step, stream)


@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
def test_philox_against_its_authors_vectors(counter: str, key: str, result: str) -> None:
    found = random.philox(words(counter), words(key))
    assert [int(word) for word in found] == words(result)


@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
@pytest.mark.parametrize("width", [1, 8])
def test_philox_of_the_vector_units_against_its_authors_vectors(
    counter: str, key: str, result: str, width: int
) -> None:
    def body(e: Emitter, *given: str) -> tuple[str, ...]:
        bits = [e.as_bits(word) for word in given]
        low = [e.integral("and", w, e.integer(2**32 - 1)) for w in philox(e, bits[:4], bits[4:])]
        return tuple(e.from_bits(word) for word in low)

    given = np.array([words(counter) + words(key)], np.uint64)
    given |= np.uint64(0xDEADBEEF00000000)  # what stands above a word is of no account
    found = compiled(body, 6, Emitter(width, 64))(*given.T.view(np.float64))
    assert [int(word.view(np.uint64)[0]) for word in found] == words(result)


@BOTH
def test_the_vector_units_draw_what_numpy_draws(name: str) -> None:
    rng = np.random.default_rng(1)
    seed = np.concatenate([np.repeat(SEEDS, 2000), np.floor(2.0 ** rng.uniform(0, 53, 20_000))])
    step = np.floor(2.0 ** rng.uniform(0, 52, len(seed)))
    step[::3] = rng.integers(0, 1000, len(step[::3]))
    for stream in (0, 1, 2, 7):
        found, wanted = lanes(name, stream)(seed, step), drawn(name, seed, step, stream)
        if name == "uniform":
            assert np.array_equal(found, wanted)
        else:
            assert np.abs(found / wanted - 1).max() < 6 * np.finfo(float).eps


@BOTH
def test_a_number_is_the_same_in_a_vector_of_any_width(name: str) -> None:
    seed, step = np.arange(64.0), np.arange(64.0)[::-1] * 2.0**31
    found = [lanes(name, 3, width)(seed, step) for width in (1, 4, 8, 32)]
    assert all(np.array_equal(other, found[0]) for other in found[1:])


def test_uniforms_are_odd_multiples_inside_0_to_1() -> None:
    found = drawn("uniform", np.arange(100_000.0), 0.0, 0)
    assert (np.fmod(found * 2**53, 2) == 1).all()
    zero, most = (np.array([word] * 2, np.uint64) for word in (0, 2**32 - 1))
    assert random._fraction(*zero) == 2.0**-53
    assert random._fraction(*most) == 1 - 2.0**-53


def test_normals_against_the_formula_in_extended_precision() -> None:
    seed = np.arange(200.0)
    for seeds, stream in ((seed, 0), (seed, 1), (seed, 4)):
        both = [random._drawn(s, 5.0, stream, random.NORMAL) for s in seeds]
        found = drawn("normal", seeds, 5.0, stream)
        with mpmath.workdps(40):
            for z, w in zip(found, both, strict=True):
                u, v = (
                    (mpmath.mpf(((int(high) << 32 | int(low)) >> 12) * 2 + 1)) / 2**53
                    for low, high in (w[:2], w[2:])
                )
                turn = mpmath.sin if stream % 2 else mpmath.cos
                exact = mpmath.sqrt(-2 * mpmath.log(u)) * turn(2 * mpmath.pi * v)
                assert abs(z / exact - 1) < 1e-15


# --- statistics: limits are quantiles of what the law would give ---------------------------------

COUNT = 1_000_000


def series(name: str, seed: float, stream: int, count: int = COUNT) -> Any:
    """The numbers of a run's steps, by the vector units."""
    return lanes(name, stream)(np.full(count, seed), np.arange(float(count)))


@pytest.mark.parametrize("stream", [0, 1])
def test_the_distribution_along_a_run_and_across_seeds(stream: int) -> None:
    across = lanes("normal", stream)(np.arange(float(COUNT)), np.full(COUNT, 3.0))
    for z in (series("normal", 42.0, stream), across):
        assert stats.kstest(z, "norm").pvalue > 1e-3
        for power, mean, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
            assert abs((z**power).mean() - mean) < 4 * np.sqrt(variance / COUNT)
        tail = (np.abs(z) > 4).sum()
        assert stats.binomtest(int(tail), COUNT, float(2 * stats.norm.sf(4))).pvalue > 1e-3
    u = series("uniform", 42.0, stream)
    assert stats.kstest(u, "uniform").pvalue > 1e-3
    low = (u * 2.0**53).astype(np.int64) >> 1 & 0xFF
    assert stats.chisquare(np.bincount(low, minlength=256)).pvalue > 1e-3


def test_steps_streams_and_seeds_are_uncorrelated() -> None:
    z = [series("normal", seed, stream) for seed in (7.0, 8.0) for stream in (0, 1, 2)]
    u = stats.norm.ppf(series("uniform", 7.0, 0))
    limit = 4.5 / np.sqrt(COUNT)
    assert np.abs(np.corrcoef([*z, u]) - np.eye(7)).max() < limit
    squares = [x**2 for x in z]
    assert np.abs(np.corrcoef(squares) - np.eye(6)).max() < limit
    spectrum = np.abs(np.fft.rfft(z[0], 2 * COUNT)) ** 2
    lags = np.fft.irfft(spectrum)[1:1001] / COUNT
    assert np.abs(lags).max() < limit
