"""What an ensemble engine is asked, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...system import System
from .watch import Watch

Numbers = NDArray[np.float64]

OUTCOMES = ("completed", "escaped", "left the data")
"""What an `Ended.outcome` of 0, 1, 2 means."""


@dataclass(frozen=True, eq=False)
class Asked:
    """Many loops of one system, a column of numbers each.

    Attributes
    ----------
    system
        Their equations.
    values
        The parameters' numbers, (parameters,), in the order of ``system.parameters``.
    swept
        Which parameters vary.
    columns
        Their numbers, (len(swept), n), a column a loop.
    t_end
        Duration (s).
    watch
        What is computed while they run.
    window
        Length (s) of each loop's last window, (n,); needed for ``watch.last_mean``.
    samples
        States are kept at t_end k/(samples − 1), k = 0 … samples − 1; 0 for none.
    tol
        Of the error at the end, relative to 1 + |x|: a step may take a thirtieth of it.
    dtype
        ``"float64"`` or ``"float32"``.
    shorter
        By how much steps are shorter than `tol` asks for.
    """

    system: System
    values: Numbers
    swept: tuple[int, ...]
    columns: Numbers
    t_end: float
    watch: Watch = field(default_factory=Watch)
    window: Numbers | None = None
    samples: int = 0
    tol: float = 1e-6
    dtype: str = "float64"
    shorter: float = 1.0

    @property
    def count(self) -> int:
        """How many loops."""
        return self.columns.shape[1]


@dataclass(frozen=True, eq=False)
class Ended:
    """What became of the loops.

    Attributes
    ----------
    states
        (states, n), the last finite ones, at `end_time`.
    outcome
        (n,), an index into `OUTCOMES`.
    end_time
        (n,) s.
    mean, last_mean, maxima, beyond
        (k, n), as asked; `last_mean` is NaN for loops that did not complete.
    samples
        (samples, states, n); NaN after a loop's end.
    steps
        (n,), steps taken.
    scheme
        What took them.
    """

    states: NDArray[Any]
    outcome: NDArray[np.int8]
    end_time: Numbers
    mean: NDArray[Any]
    last_mean: NDArray[Any]
    maxima: NDArray[Any]
    beyond: NDArray[Any]
    samples: NDArray[Any]
    steps: NDArray[np.int64]
    scheme: str
