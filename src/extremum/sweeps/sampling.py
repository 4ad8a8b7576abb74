"""The numbers of a sweep's loops: those of loop i follow from the study and i alone."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from .axes import Axis
from .study import Sweep

if TYPE_CHECKING:
    import xarray

Floats = NDArray[np.float64]
SOBOL_BITS: Final = 30
SMALLEST: Final = 2.0**-54
"""Stands for a draw of 0, where a normal distribution is at −∞: half the next draw."""


def over(sweep: Sweep, region: Mapping[str, slice]) -> dict[str, xarray.DataArray]:
    """Return dotted path → numbers of the loops in a region of the results.

    Parameters
    ----------
    region
        Dimension → indices, as `Sweep.dims` names them.

    Returns
    -------
    dict
        Arrays over one dimension, their axis' numbers as coordinate.
    """
    import xarray

    if sweep.method == "grid":
        found = {name: grid(axis)[region[name]] for name, axis in sweep.axes.items()}
        along = {name: name for name in found}
    else:
        found = drawn(sweep, region["loop"].start, region["loop"].stop)
        along = dict.fromkeys(found, "loop")
    return {
        path: xarray.DataArray(numbers, {name: (along[name], numbers)}, (along[name],))
        for name, numbers in found.items()
        for path in sweep.paths(name)
    }


def grid(axis: Axis) -> Floats:
    """Return a grid axis' numbers; both ends are exact."""
    if axis.values is not None:
        return np.array(axis.values)
    assert axis.low is not None
    assert axis.high is not None
    assert axis.points is not None
    if axis.scale == "log":
        return np.geomspace(axis.low, axis.high, axis.points)
    return np.linspace(axis.low, axis.high, axis.points)


def drawn(sweep: Sweep, begin: int, end: int) -> dict[str, Floats]:
    """Return axis → the numbers of loops `begin` … `end` − 1 of a method that draws."""
    unit = _DRAWS[sweep.method](sweep, begin, end)
    return {name: quantile(axis, unit[:, k]) for k, (name, axis) in enumerate(sweep.axes.items())}


def quantile(axis: Axis, u: Floats) -> Floats:
    """Return F⁻¹(u), the inverse of an axis' cumulative distribution, for u in [0, 1)."""
    from scipy.special import ndtr, ndtri

    if axis.values is not None:
        return np.array(axis.values)[(u * len(axis.values)).astype(np.int64)]
    low = -np.inf if axis.low is None else axis.low
    high = np.inf if axis.high is None else axis.high
    if axis.mean is not None and axis.std is not None:
        first, last = ndtr((low - axis.mean) / axis.std), ndtr((high - axis.mean) / axis.std)
        inside = first + np.maximum(u, SMALLEST) * (last - first)
        return np.clip(axis.mean + axis.std * ndtri(inside), low, high)
    if axis.distribution == "log-uniform":
        return np.clip(np.exp(np.log(low) * (1 - u) + np.log(high) * u), low, high)
    return np.clip(low * (1 - u) + high * u, low, high)


def _random(sweep: Sweep, begin: int, end: int) -> Floats:
    """Return rows of ``default_rng(seed).random((loops, axes))``."""
    axes = len(sweep.axes)
    bits = np.random.PCG64(sweep.seed).advance(begin * axes)
    return np.random.Generator(bits).random((end - begin, axes))


def _hypercube(sweep: Sweep, begin: int, end: int) -> Floats:
    return _whole_hypercube(len(sweep.axes), sweep.loops or 0, sweep.seed)[begin:end]


@lru_cache(maxsize=1)
def _whole_hypercube(axes: int, loops: int, seed: int) -> Floats:
    from scipy.stats import qmc

    return qmc.LatinHypercube(axes, rng=seed).random(loops)


def _sobol(sweep: Sweep, begin: int, end: int) -> Floats:
    from scipy.stats import qmc

    points = qmc.Sobol(len(sweep.axes), rng=sweep.seed, bits=SOBOL_BITS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a part of the points; all are balanced
        return points.fast_forward(begin).random(end - begin) if begin else points.random(end)


_DRAWS: Final[dict[str, Any]] = {
    "random": _random,
    "latin hypercube": _hypercube,
    "sobol": _sobol,
}
