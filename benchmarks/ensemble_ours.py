"""Our engine as one of the candidates, and the flops that its program has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from ensemble_problems import T_END, Problem
from ensemble_rivals import TOLERANCES, Candidate
from numpy.typing import NDArray

from extremum.engines.lanes import choosing
from extremum.engines.lanes.asked import Asked, Ended
from extremum.engines.lanes.schemes import RungeKutta, Taylor
from extremum.engines.simd import integrate
from extremum.engines.simd.running import KERNELS

LOOPS = 1 << 15
Scheme = Taylor | RungeKutta
COARSE = tuple(10.0 ** (-k / 4) for k in range(-8, 41))
"""Tolerances of schemes without a step size of their own, by a power law that suits RK4."""


def asked(problem: Problem, columns: NDArray[np.float64], tol: float, dtype: str) -> Asked:
    """Return what the engine is asked: the states at the end, nothing watched."""
    loop = problem.loop
    return Asked(loop.system, loop.values, problem.swept, columns, T_END, tol=tol, dtype=dtype)


@dataclass(frozen=True)
class Work:
    """Our engine on one problem.

    Attributes
    ----------
    problem, tol, dtype
        What is asked.
    scheme
        None for the usual one.
    """

    problem: Problem
    tol: float
    dtype: str
    scheme: Scheme | None = None

    def ended(self, columns: NDArray[np.float64], threads: int = 1) -> Ended:
        """Run loops."""
        work = asked(self.problem, columns, self.tol, self.dtype)
        return integrate(work, threads=threads, scheme=self.scheme)

    def flops(self) -> float:
        """Return those of one step of one loop, as the kernel is written."""
        few = asked(self.problem, self.problem.columns(8), self.tol, self.dtype)
        scheme = choosing.usual(few) if self.scheme is None else self.scheme
        return KERNELS.get(few.system, few.swept, scheme, few.watch, self.dtype).flops


def ours(
    problem: Problem,
    dtype: str,
    *,
    title: str = "extremum",
    threads: int = 1,
    scheme: Scheme | None = None,
    settings: Sequence[float] = TOLERANCES,
) -> Candidate:
    """Return our engine, as it comes or with another scheme."""

    def run(columns: NDArray[np.float64], tol: float) -> NDArray[Any]:
        return Work(problem, tol, dtype, scheme).ended(columns, threads).states

    return Candidate(title, run, LOOPS, settings)
