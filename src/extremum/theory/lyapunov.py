"""`lyapunov`: growth rates along the almost-periodic motion, where no period gives multipliers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..engines import flow
from ..errors import InvalidDescription, shown
from ..loop import Loop
from ..validation import positive
from . import floquet
from .averaging import average

Vector = NDArray[np.float64]
MAX_CYCLES: Final = 100_000


@dataclass(frozen=True, eq=False)
class Lyapunov:
    """Lyapunov exponents over a finite window; made by `lyapunov`.

    Attributes
    ----------
    outcome
        ``"completed"``, ``"escaped"`` or ``"left the data"``.
    exponents
        (states,) (1/s), the largest first; empty unless completed.
    uncertainty
        The largest difference between the first and the second half of the window (1/s); NaN
        unless completed.
    transient, window
        What was waited for, and what was averaged over (s).
    state
        The state at the end in the frame's coordinates, (states,): on the attractor if it is one.
    """

    outcome: str
    exponents: Vector
    uncertainty: float
    transient: float
    window: float
    state: Vector

    def text(self) -> str:
        """Return the exponents, or why there are none, as text."""
        if not len(self.exponents):
            return f"no Lyapunov exponents: the loop {self.outcome} within {self.window:g} s"
        listed = ", ".join(f"{x:.6g}" for x in self.exponents)
        return f"Lyapunov exponents {listed} 1/s over {self.window:g} s, ± {self.uncertainty:.2g}"

    __str__ = __repr__ = text

    @property
    def stable(self) -> bool:
        """Whether every exponent is negative by more than the uncertainty."""
        return bool(len(self.exponents)) and bool(self.exponents[0] < -self.uncertainty)


def lyapunov(loop: Loop, window: float, *, transient: float | None = None) -> Lyapunov:
    """Return the Lyapunov exponents lim (1/t) ln r_ii(t), Q R = Φ(t) … over a finite window.

    The exact loop runs from the averaged equilibrium in coordinates relative to source and dither;
    Φ of each dither cycle is decomposed as Q R in turn. For a periodic loop they are the real
    parts of the Floquet exponents; for incommensurate frequencies, where there are no multipliers,
    they decide stability. The run follows what attracts it: for an unstable loop that is not the
    motion about the source.

    Parameters
    ----------
    window
        What is averaged over (s).
    transient
        What is waited for first (s); a third of the window if left out.

    Raises
    ------
    InvalidDescription
        If a time is not positive, or there is no source.
    """
    window = positive("window", window)
    transient = window / 3 if transient is None else positive("transient", transient)
    predicted = average(loop)
    frame = predicted.frame
    system, values = frame.system, frame.values
    cycle = system.fastest_period(values) or window
    if not 1 <= window / cycle <= MAX_CYCLES:
        raise InvalidDescription(
            "window",
            f"is {window / cycle:.3g} cycles of the fastest dither; it must lie between 1 and "
            f"{MAX_CYCLES:,} of them, {cycle:.4g} … {MAX_CYCLES * cycle:.4g} s",
            shown(window),
        )
    state = predicted.equilibrium
    state = np.zeros(len(system.states)) if state is None else state
    basis = np.eye(len(state))
    time, rates = 0.0, []
    for duration in (transient, window / 2, window / 2):
        times = time + np.linspace(0.0, duration, math.ceil(duration / cycle) + 1)
        run = flow.transitions(system, values, state, times)
        if not run.completed:
            nothing = np.empty(0)
            return Lyapunov(run.outcome, nothing, math.nan, transient, window, run.state)
        growth, basis = floquet.growth(run.factors, basis)
        rates.append(growth / duration)
        time, state = float(times[-1]), run.state
    _, first, second = rates
    found = (first + second) / 2
    order = np.argsort(-found, kind="stable")
    spread = float(np.abs(first - second).max())
    return Lyapunov(flow.COMPLETED, found[order], spread, transient, window, state)
