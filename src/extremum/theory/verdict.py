"""`stability`: the verdict on a loop, with four columns of evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..loop import Loop
from .averaging import Average, average
from .conditions import Condition
from .floquet import Match, decays, match
from .lyapunov import Lyapunov, lyapunov
from .orbits import Orbit, orbit_of
from .periods import slow_frequencies
from .printed import NotThePapers, PaperLoop, recognise
from .remarks import remarks

Complex = NDArray[np.complex128]

CONSTANTS: Final = 20
TURNS: Final = 3
CYCLES: Final = 5000
"""The window of Lyapunov exponents: time constants, turns of the slowest sine, at most cycles."""


@dataclass(frozen=True)
class Evidence:
    """One column of the table.

    Attributes
    ----------
    title
        What speaks here.
    stable
        What it says; None where it says nothing.
    rate
        The largest real part it gives (1/s), NaN where it says nothing.
    conditions
        The inequalities it rests on, if it does.
    modes
        The eigenvalues or exponents (1/s), the least stable first.
    silence
        Why it says nothing, as a sentence; empty where it does not.
    """

    title: str
    stable: bool | None
    rate: float
    conditions: tuple[Condition, ...]
    modes: Complex
    silence: str


@dataclass(frozen=True, eq=False)
class Verdict:
    """Whether a loop is stable, and the evidence; made by `stability`.

    Attributes
    ----------
    average, orbit
        The averaged loop and the exact periodic orbit.
    lyapunov
        Where the frequencies have no common period and the averaged loop is stable: the growth
        rates along the motion.
    paper
        The paper's formulas, where the loop is one of its schemes.
    """

    average: Average
    orbit: Orbit
    lyapunov: Lyapunov | None
    paper: PaperLoop | NotThePapers

    @property
    def stable(self) -> bool:
        """The verdict: there is an orbit, and every Floquet exponent has a negative real part.

        Without a common period, every Lyapunov exponent about the almost-periodic motion has.
        """
        return bool(self.evidence[3].stable)

    @cached_property
    def evidence(self) -> tuple[Evidence, Evidence, Evidence, Evidence]:
        """The columns: conditions as printed, corrected, averaged eigenvalues, exponents."""
        return (
            self._formulas("printed conditions"),
            self._formulas("corrected conditions"),
            self._averaged(),
            self._exact(),
        )

    def _formulas(self, title: str) -> Evidence:
        if isinstance(self.paper, NotThePapers):
            return Evidence(title, None, math.nan, (), np.empty(0, complex), self.paper.reason)
        found = self.paper.printed if title.startswith("printed") else self.paper.corrected
        modes = found.eigenvalues[np.argsort(-found.eigenvalues.real, kind="stable")]
        return Evidence(title, found.stable, found.rate, found.conditions, modes, "")

    def _averaged(self) -> Evidence:
        title, modes = "averaged eigenvalues", self.average.eigenvalues
        if not len(modes):
            why = "The averaged loop has no equilibrium near the source."
            return Evidence(title, False, math.nan, (), modes, why)
        return Evidence(title, decays(modes), _rate(modes), self.average.conditions, modes, "")

    def _exact(self) -> Evidence:
        title, modes = "Floquet exponents", self.orbit.exponents
        along = self.lyapunov
        if along is not None and len(along.exponents):
            title = f"Lyapunov exponents over {along.window:.4g} s, ± {along.uncertainty:.1g}"
            modes = along.exponents.astype(np.complex128)
            return Evidence(title, along.stable, _rate(modes), (), modes, "")
        if along is not None:
            why = f"The loop {along.outcome} within {along.window:.4g} s of the averaged motion."
            return Evidence(title, False, math.nan, (), modes, why)
        if not self.orbit.found:
            why = f"{self.orbit.outcome[0].upper()}{self.orbit.outcome[1:]}."
            return Evidence(title, None, math.nan, (), modes, why)
        return Evidence(title, decays(modes), _rate(modes), (), modes, "")

    @cached_property
    def modes(self) -> Match | None:
        """Averaged eigenvalues beside Floquet exponents, mode by mode modulo jω; None without."""
        if not self.orbit.found or not len(self.average.eigenvalues):
            return None
        return match(self.average.eigenvalues, self.orbit.exponents, self.orbit.frequency)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """Plain sentences: where columns disagree, and what should not be trusted."""
        return remarks(self)

    def text(self) -> str:
        """Return the verdict, the table and the remarks as text."""
        from .table import text

        return text(self)

    def __str__(self) -> str:
        return self.text()

    __repr__ = __str__

    def data(self) -> dict[str, Any]:
        """Return the verdict as plain lists, numbers and text, ready for JSON."""
        from .table import data

        return data(self)


def _rate(modes: Complex) -> float:
    return float(modes.real.max())


def stability(loop: Loop) -> Verdict:
    """Return whether the loop is stable, and the evidence for it.

    Four columns: the paper's conditions as printed and as corrected (where the loop is one of its
    three schemes), the eigenvalues of the averaged loop, and the Floquet exponents of the exact
    periodic orbit, which decide: the loop is locally exponentially stable if and only if every
    exponent has Re λ < 0. The others hold as ω → ∞. Where frequencies have no common period the
    fourth column holds Lyapunov exponents over a stated window.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start.

    Notes
    -----
    Source: Zhang, Siranosian and Krstić (2007), (32) to (40), (60) to (64), theorems 1 to 4.
    """
    predicted = average(loop)
    found = orbit_of(predicted)
    along = None
    swings = slow_frequencies(predicted.frame.system) is not None
    if swings and predicted.frame.period() is None and predicted.stable:
        along = lyapunov(loop, _window(predicted))
    return Verdict(predicted, found, along, recognise(loop))


def _window(predicted: Average) -> float:
    """Return a time (s) over which growth rates can be told: many time constants, many beats."""
    frequencies = predicted.frame.frequencies()
    wanted = max(CONSTANTS / -predicted.eigenvalues[0].real, 2 * TURNS * math.pi / min(frequencies))
    return min(wanted, 2 * CYCLES * math.pi / max(frequencies))
