"""How wrong the loops are, estimated by halving the steps of some of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from .asked import Asked, Ended
from .choosing import usual

SAMPLE: Final = 256


@dataclass(frozen=True)
class Accuracy:
    """What halving the steps changes, relative to 1 + |x|.

    Attributes
    ----------
    largest, typical
        The largest and the median change of a state at the end, over the loops that completed.
    doubtful
        How many loops ended otherwise with half the step.
    loops
        How many were run again.
    """

    largest: float
    typical: float
    doubtful: int
    loops: int


EXACT: Final = Accuracy(0.0, 0.0, 0, 0)
"""Of difference equations: their steps are not approximations."""


def estimate(asked: Asked, ended: Ended, integrate: Callable[..., Ended]) -> Accuracy:
    """Run at most `SAMPLE` of the loops again with half the step, and compare."""
    if asked.system.dt is not None:
        return EXACT
    loops = np.unique(np.linspace(0, asked.count - 1, min(SAMPLE, asked.count)).astype(int))
    scheme = usual(asked)
    window = None if asked.window is None else np.asarray(asked.window)[loops]
    some = replace(asked, columns=asked.columns[:, loops], window=window, samples=0)
    again = integrate(replace(some, shorter=2.0), scheme=scheme)
    same = ended.outcome[loops] == again.outcome
    both = same & (again.outcome == 0)
    before, after = (x.astype(float) for x in (ended.states[:, loops], again.states))
    with np.errstate(invalid="ignore"):
        change = (np.abs(before - after) / (1 + np.abs(after))).max(axis=0)
    known = change[both] if both.any() else np.array([np.nan])
    return Accuracy(float(known.max()), float(np.median(known)), int((~same).sum()), len(loops))
