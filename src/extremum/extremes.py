"""Extremes between the samples: the run is integrated again around each sampled extreme."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .engines.trajectory import Trajectory
from .system import System

_DEGREE = 10
_FINE = 128
_NODES = -np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)
_GRID = np.linspace(-1.0, 1.0, _FINE + 1)
_TO_GRID = np.polynomial.chebyshev.chebvander(_GRID, _DEGREE) @ np.linalg.inv(
    np.polynomial.chebyshev.chebvander(_NODES, _DEGREE)
)

Again = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""(times, state at the first) → states at those times."""


def extremes(
    system: System,
    values: list[float],
    run: Trajectory,
    outputs: Mapping[str, NDArray[np.float64]],
    again: Again,
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return each output's (minimum, maximum) over the run, one entry per component.

    Around each sampled extreme the run is integrated anew at Chebyshev points and interpolated by
    a polynomial of degree 10, so that the figure does not depend on where the samples fell.
    """
    if len(run.times) < 2:
        return {name: (column[0], column[0]) for name, column in outputs.items()}
    signed = [
        (name, component, sign)
        for name, column in outputs.items()
        for component in range(column.shape[1])
        for sign in (-1.0, 1.0)
    ]
    rows = np.stack([sign * outputs[name][:, c] for name, c, sign in signed])
    highest = _highest(run.times, rows)
    wanted = [(*named, index) for named, index in zip(signed, highest, strict=True)]
    around = _around(system, values, run, {index for *_, index in wanted}, again)
    columns = [sign * around[index][name][:, c] for name, c, sign, index in wanted]
    sampled = rows.max(axis=1)
    with np.errstate(all="ignore"):  # near an escape the square of a difference overflows
        refined = _peaks(_TO_GRID @ np.stack(columns, axis=1))
    peaks = np.fmax(sampled, np.where(np.isfinite(refined), refined, -np.inf))
    found: dict[tuple[str, float], list[float]] = {}
    for (name, _, sign, _), peak in zip(wanted, peaks.tolist(), strict=True):
        found.setdefault((name, sign), []).append(sign * peak)
    return {name: (np.array(found[name, -1.0]), np.array(found[name, 1.0])) for name in outputs}


def _highest(times: NDArray[np.float64], rows: NDArray[np.float64]) -> list[int]:
    """Return for each row the sample nearest to its maximum: that whose parabola rises highest.

    Of two crests the one that a sample happens to hit looks higher than it is.
    """
    best = np.argmax(rows, axis=1).tolist()
    inner = rows[:, 1:-1]
    row, crest = np.nonzero((inner >= rows[:, :-2]) & (inner >= rows[:, 2:]))
    crest += 1
    before, after = times[crest] - times[crest - 1], times[crest + 1] - times[crest]
    with np.errstate(all="ignore"):  # on a plateau, and near an escape
        rise = (rows[row, crest] - rows[row, crest - 1]) / before
        fall = (rows[row, crest + 1] - rows[row, crest]) / after
        slope = (rise * after + fall * before) / (before + after)
        bend = (rise - fall) / (before + after)
        tops = rows[row, crest] + np.nan_to_num(slope**2 / (4 * bend), posinf=0.0)
    bounds = np.searchsorted(row, np.arange(len(rows) + 1))
    for index, (first, last) in enumerate(pairwise(bounds)):
        if last > first:
            top = first + int(np.argmax(tops[first:last]))
            if tops[top] >= rows[index, best[index]]:
                best[index] = int(crest[top])
    return best


def _around(
    system: System, values: list[float], run: Trajectory, indices: set[int], again: Again
) -> dict[int, dict[str, NDArray[np.float64]]]:
    times, states = [], []
    for index in indices:
        first, last = max(index - 1, 0), min(index + 1, len(run.times) - 1)
        low, high = run.times[first], run.times[last]
        segment = low + (high - low) * (_NODES + 1) / 2
        segment[-1] = high
        times.append(segment)
        states.append(again(segment, run.states[first]))
    outputs = system.evaluate(np.concatenate(times), np.concatenate(states), values)
    count = _DEGREE + 1
    return {
        index: {name: o[i * count : (i + 1) * count] for name, o in outputs.items()}
        for i, index in enumerate(indices)
    }


def _peaks(fine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the maximum of each column on the fine grid, by the parabola through its top."""
    columns = np.arange(fine.shape[1])
    top = np.argmax(fine, axis=0)
    inner = np.clip(top, 1, len(fine) - 2)
    left, middle, right = (fine[inner + step, columns] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    vertex = middle - (right - left) ** 2 / (8 * np.where(bend < 0, bend, -1.0))
    return np.where((inner == top) & (bend < 0), vertex, fine[top, columns])
