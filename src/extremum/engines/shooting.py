"""Periodic orbits of a `System` by multiple shooting: Newton's method with the exact flow.

The orbit is cut into m segments with nodes x_0 … x_{m−1}, and φ_k(x_k) = x_{k+1}, x_m = x_0, is
solved for all nodes at once: a long period or an unstable orbit is no harder than one dither cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..system import System
from . import flow
from .choice import ENGINES, usual

Vector = NDArray[np.float64]

CONVERGED: Final = "converged"
DIVERGED: Final = "diverged"

CONTRACTION: Final = 0.5
"""What each correction may be of the one before, and half of what the change of Φ may make of it.

For a quadratic equation both say that Kantorovich's number is at most 1; beyond, Newton's method
may land on another orbit.
"""

FIRST: Final = 1.5
"""The same for the first, as a state that others drive begins to move with the second."""

MAX_ITERATIONS: Final = 40
SMALL: Final = 1e-6
LEAST_WEIGHT: Final = 1e-3
DENSE: Final = 64


@dataclass(frozen=True)
class Closed:
    """What Newton's method found.

    Attributes
    ----------
    outcome
        ``"converged"``, ``"diverged"``, or the flow's ``"escaped"`` or ``"left the data"``.
    period
        T (s).
    nodes
        The states at t = k T/m, (m, n).
    factors
        The transition matrices from each node to the next, (m, n, n).
    residual
        max |φ_k(x_k) − x_{k+1}|, over nodes and states.
    correction
        max |Newton's next correction|: what the nodes are uncertain by.
    """

    outcome: str
    period: float
    nodes: Vector
    factors: Vector
    residual: float
    correction: float

    @property
    def converged(self) -> bool:
        """Whether the orbit was found."""
        return self.outcome == CONVERGED


@dataclass(frozen=True)
class _Trial:
    """Nodes, how far the flow misses the next ones, and Newton's correction."""

    nodes: Vector
    factors: Vector
    gaps: Vector
    step: Vector


class _Problem:
    """The equations to be solved, and how large each state has been seen to be."""

    def __init__(
        self, system: System, values: Sequence[float], period: float, nodes: Vector
    ) -> None:
        self.system, self.values = system, list(values)
        self.times = period * np.arange(len(nodes) + 1) / len(nodes)
        self.sizes = np.zeros(nodes.shape[1])

    def size(self, step: Vector) -> float:
        """Return a correction's largest entry, each divided by how large its state is."""
        largest = self.sizes.max()
        weights = np.maximum(self.sizes, LEAST_WEIGHT * largest) if largest else 1.0
        return float((np.abs(step) / weights).max())

    def learn(self, trial: _Trial) -> None:
        """Take note of how large the states are at the nodes, and how far they go between them."""
        ends = np.roll(trial.nodes, -1, axis=0) + trial.gaps
        seen = [trial.nodes, trial.nodes + trial.step, ends - trial.nodes]
        self.sizes = np.maximum(self.sizes, np.abs(np.concatenate(seen)).max(axis=0))

    def evaluate(self, nodes: Vector) -> _Trial | str:
        found = flow.transitions(self.system, self.values, nodes, self.times)
        if not found.completed:
            return found.outcome
        gaps = found.states[1:] - np.roll(nodes, -1, axis=0)
        try:
            step = corrections(found.factors, gaps)
        except np.linalg.LinAlgError:
            return DIVERGED
        return _Trial(nodes, found.factors, gaps, step) if np.isfinite(step).all() else DIVERGED

    def improve(self, trial: _Trial, contraction: float) -> _Trial | str:
        """Return the next iterate, or why there is none."""
        found = self.evaluate(trial.nodes + trial.step)
        if isinstance(found, str):
            return found
        self.learn(found)
        bent = np.einsum("kij,kj->ki", found.factors - trial.factors, trial.step)
        turn = self.size(corrections(trial.factors, bent))
        allowed = contraction * self.size(trial.step)
        smaller = self.size(found.step) <= max(allowed, SMALL)
        return found if smaller and turn <= max(2 * allowed, SMALL) else DIVERGED


def close(
    system: System,
    values: Sequence[float],
    period: float,
    nodes: Vector,
) -> Closed:
    """Return the periodic orbit near the given nodes.

    Newton's method runs until rounding stops it: at a high dither frequency I − Φ is as small as
    λT, and a residual that looks small is not. It either contracts from the start or gives up, and
    so does not wander off to another orbit: continuation reaches further.

    Parameters
    ----------
    period
        T (s), a period of the system's right-hand side.
    nodes
        Guesses at t = k T/m, (m, n); m segments are used.
    """
    problem = _Problem(system, values, period, nodes)
    trial, ratio = problem.evaluate(nodes), 1.0
    if isinstance(trial, _Trial):
        problem.learn(trial)
    for iteration in range(MAX_ITERATIONS):
        if isinstance(trial, str):
            break
        found = problem.improve(trial, CONTRACTION if iteration else FIRST)
        if isinstance(found, _Trial):
            before, after = problem.size(trial.step), problem.size(found.step)
            settled = after > CONTRACTION * before or before * ratio**2 < np.finfo(float).eps
            if settled and before < SMALL:
                return _closed(period, found if after < before else trial)
            ratio = after / before
        trial = found
    outcome = trial if isinstance(trial, str) else DIVERGED
    count = nodes.shape[1]
    return Closed(outcome, period, nodes, np.empty((0, count, count)), np.inf, np.inf)


def _closed(period: float, trial: _Trial) -> Closed:
    return Closed(
        CONVERGED,
        period,
        trial.nodes,
        trial.factors,
        float(np.abs(trial.gaps).max()),
        float(np.abs(trial.step).max()),
    )


def corrections(factors: Vector, gaps: Vector) -> Vector:
    """Return δ with δ_{k+1} − Φ_k δ_k = gap_k around the cycle, (m, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the monodromy matrix has the eigenvalue 1 exactly.
    """
    segments, count = gaps.shape
    if segments == 1:
        return np.linalg.solve(np.eye(count) - factors[0], gaps[0])[None, :]
    rows = np.arange(segments * count)
    following = (rows + count) % len(rows)
    blocks = np.arange(segments) * count
    inner = np.arange(count)
    if len(rows) <= DENSE:
        matrix = np.zeros((len(rows), len(rows)))
        matrix[rows, following] = 1.0
        for k, block in enumerate(blocks):
            matrix[block : block + count, block : block + count] -= factors[k]
        return np.asarray(np.linalg.solve(matrix, gaps.ravel()), dtype=float).reshape(gaps.shape)
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    across = blocks[:, None, None] + inner[None, :, None]
    down = blocks[:, None, None] + inner[None, None, :]
    across, down = (np.broadcast_to(a, factors.shape).ravel() for a in (across, down))
    data = np.concatenate([np.ones(len(rows)), -factors.ravel()])
    places = np.concatenate([rows, across]), np.concatenate([following, down])
    matrix = csc_array((data, places), shape=(len(rows), len(rows)))
    try:
        return splu(matrix).solve(gaps.ravel()).reshape(gaps.shape)
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from None


def sampled(
    system: System, values: Sequence[float], orbit: Closed, samples: int
) -> tuple[Vector, Vector]:
    """Return equispaced times over one period, without its end, and the states there.

    Each segment is integrated from its own node, so that an unstable orbit is not left.

    Parameters
    ----------
    samples
        How many for each segment.
    """
    engine = ENGINES[usual(system)]
    segments, count = orbit.nodes.shape
    times = orbit.period * np.arange(segments * samples + 1) / (segments * samples)
    states = np.empty((segments * samples, count))
    for k, node in enumerate(orbit.nodes):
        piece = slice(k * samples, (k + 1) * samples)
        states[piece] = engine.integrate(
            system, values, times[piece], tol=flow.TOLERANCE, state=node.tolist()
        ).states
    return times[:-1], states
