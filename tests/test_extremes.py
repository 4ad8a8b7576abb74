"""Extremes: of two crests the higher one, and its height between the samples."""

from __future__ import annotations

import numpy as np

from extremum.extremes import _highest


def test_the_higher_crest_is_found_even_if_a_sample_hits_the_lower_one() -> None:
    times = np.linspace(0, 4, 41)
    period = 2.0
    lower = 0.5  # a crest that a sample hits
    higher = lower + period + 0.05  # one that lies between two samples
    shape = np.where(times < 1.5, 1.0, 1.004)
    centre = np.where(times < 1.5, lower, higher)
    row = shape * np.cos(2 * np.pi / period * (times - centre))
    assert abs(times[int(np.argmax(row))] - lower) < 1e-12
    (found,) = _highest(times, row[None])
    assert abs(times[found] - higher) < 0.051


def test_an_extreme_at_the_ends_and_a_plateau_are_found() -> None:
    times = np.linspace(0, 1, 11)
    rows = np.stack([times, -times, 0 * times])
    assert _highest(times, rows)[:2] == [10, 0]
    assert 0 <= _highest(times, rows)[2] <= 10
