"""The loops' numbers: SciPy's own, and a function of the study and the loop's index alone."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import qmc

from extremum.sweeps import Axis, Sweep, sampling
from extremum.sweeps.layout import Layout

DRAWING = ("random", "latin hypercube", "sobol")
UNIT = {"start.0": Axis(0, 1), "start.1": Axis(0, 1), "field.peak": Axis(0, 1)}


def sweep(method: str, loops: int = 256, seed: int = 5, axes=UNIT) -> Sweep:
    return Sweep(axes=axes, method=method, loops=loops, seed=seed)


def columns(given: Sweep, begin: int = 0, end: int | None = None) -> np.ndarray:
    end = given.loops if end is None else end
    return np.array(list(sampling.drawn(given, begin, end or 0).values()))


def test_uniform_draws_are_those_of_numpy_and_scipy():
    assert (np.random.default_rng(5).random((256, 3)) == columns(sweep("random")).T).all()
    assert (qmc.Sobol(3, rng=5).random(256) == columns(sweep("sobol")).T).all()
    cube = qmc.LatinHypercube(3, rng=5).random(256)
    assert (cube == columns(sweep("latin hypercube")).T).all()


@pytest.mark.parametrize("method", DRAWING)
@given(st.integers(0, 255), st.integers(0, 255))
def test_a_loops_numbers_follow_from_its_index(method, first, second):
    begin, end = sorted((first, second))
    whole, part = columns(sweep(method)), columns(sweep(method), begin, end + 1)
    assert (part == whole[:, begin : end + 1]).all()


@pytest.mark.parametrize("method", DRAWING)
def test_the_seed_decides(method):
    assert (columns(sweep(method)) == columns(sweep(method))).all()
    assert (columns(sweep(method)) != columns(sweep(method, seed=6))).mean() > 0.99


@pytest.mark.parametrize("method", ["latin hypercube", "sobol"])
def test_every_256th_of_an_axis_has_one_loop(method):
    counts = [np.bincount((256 * row).astype(int), minlength=256) for row in columns(sweep(method))]
    assert (np.array(counts) == 1).all()


AXES = {
    "uniform": (Axis(-3, 5), scipy.stats.uniform(-3, 8)),
    "log-uniform": (Axis(0.1, 50, distribution="log-uniform"), scipy.stats.loguniform(0.1, 50)),
    "normal": (Axis(distribution="normal", mean=2, std=3), scipy.stats.norm(2, 3)),
    "cut off": (
        Axis(distribution="normal", mean=2, std=3, low=0, high=9),
        scipy.stats.truncnorm(-2 / 3, 7 / 3, 2, 3),
    ),
    "cut off below": (
        Axis(distribution="normal", mean=2, std=3, low=0),
        scipy.stats.truncnorm(-2 / 3, np.inf, 2, 3),
    ),
}


@pytest.mark.parametrize("name", AXES)
def test_quantiles_are_scipys(name):
    axis, expected = AXES[name]
    u = np.concatenate([[1e-12, 1 - 1e-6], np.random.default_rng(1).random(1000)])
    np.testing.assert_allclose(sampling.quantile(axis, u), expected.ppf(u), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", AXES)
def test_the_ends_of_the_unit_interval_stay_inside(name):
    axis = AXES[name][0]
    ends = sampling.quantile(axis, np.array([0.0, 2.0**-53, 1 - 2.0**-53]))
    low, high = axis.extremes()
    assert np.isfinite(ends).all()
    assert ((low <= ends) & (ends <= high)).all()


def test_listed_values_are_drawn_equally_often():
    given = sweep("sobol", 1024, axes={"field.peak": Axis(values=(5, -1, 2, 7))})
    values, counts = np.unique(columns(given), return_counts=True)
    assert values.tolist() == [-1, 2, 5, 7]
    assert counts.tolist() == [256] * 4


def test_grids_have_exact_ends_and_even_steps():
    line = sampling.grid(Axis(-3, 0.7, 12))
    assert (line[0], line[-1]) == (-3, 0.7)
    np.testing.assert_allclose(np.diff(line), 3.7 / 11, rtol=1e-12)
    log = sampling.grid(Axis(0.1, 70, 12, "log"))
    assert (log[0], log[-1]) == (0.1, 70)
    np.testing.assert_allclose(log[1:] / log[:-1], 700 ** (1 / 11), rtol=1e-12)
    assert sampling.grid(Axis(values=(3, 1, 2))).tolist() == [3, 1, 2]


def test_an_axis_sets_all_of_its_paths():
    paths = ("controller.channels.0.gain", "controller.channels.1.gain")
    gain = Axis(1, 2, 3, paths=paths)
    given = Sweep(axes={"start.0": Axis(0, 1, 5), "gain": gain})
    over = sampling.over(given, {"start.0": slice(2, 4), "gain": slice(0, 3)})
    assert list(over) == ["start.0", *paths]
    assert [array.dims for array in over.values()] == [("start.0",), ("gain",), ("gain",)]
    assert over["start.0"].values.tolist() == [0.5, 0.75]
    assert over[paths[0]].values.tolist() == over[paths[1]].values.tolist() == [1, 1.5, 2]
    assert over[paths[0]].coords["gain"].values.tolist() == [1, 1.5, 2]


@given(st.lists(st.integers(1, 9), min_size=1, max_size=3), st.data())
def test_jobs_cover_every_loop_once(shape, data):
    chunk = tuple(data.draw(st.integers(1, n)) for n in shape)
    layout = Layout(tuple("abc"[: len(shape)]), tuple(shape), chunk)
    seen = np.zeros(shape, int)
    for job in range(layout.jobs):
        seen[tuple(layout.region(job).values())] += 1
    assert (seen == 1).all()
