"""What an engine returns, and how a run that ends early is named."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..system import System

COMPLETED: Final = "completed"
ESCAPED: Final = "escaped"
LEFT: Final = "left the data"

STEEP: Final = 1e6
"""Growth per dither cycle beyond which a run that broke off escaped and met no domain's edge."""

HUGE: Final = 1e100
"""A state beyond which a run that broke off is an escape: squares overflow soon."""

UNDEFINED: Final = (OverflowError, ValueError, ZeroDivisionError, TypeError)
"""What evaluating on floats raises outside a function's domain or beyond the largest float."""

Progress = Callable[[float], object]


@dataclass(frozen=True)
class Trajectory:
    """States at the wanted times, up to where the run ended.

    Attributes
    ----------
    times, states
        The wanted times that were reached, (n,), and the states there, (n, states); all finite.
    outcome
        ``"completed"``, ``"escaped"`` (to infinity in finite time) or ``"left the data"`` (where
        the field has no value).
    end_time, end_state
        The last finite state and its time.
    """

    times: NDArray[np.float64]
    states: NDArray[np.float64]
    outcome: str
    end_time: float
    end_state: NDArray[np.float64]


def broken_off(system: System, time: float, state: Sequence[float], values: Sequence[float]) -> str:
    """Return why the solution cannot be continued beyond its last finite state."""
    if np.abs(state).max() > HUGE:
        return ESCAPED
    try:
        rates = system.rates(time, [float(x) for x in state], values)
        if any(math.isnan(rate) for rate in rates):
            return LEFT
        cycle = (system.fastest_period(values) or 1.0) / (2 * math.pi)
        limit = STEEP * (1 + float(np.abs(state).max())) / cycle
        steep = not all(math.isfinite(rate) and abs(rate) < limit for rate in rates)
    except OverflowError:
        steep = True
    except UNDEFINED:
        steep = False
    return ESCAPED if steep else LEFT
