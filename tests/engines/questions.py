"""Questions for the ensemble engines and their answers by the Taylor engine."""

from __future__ import annotations

from typing import Any

import numpy as np

import extremum as es
from extremum.engines import taylor
from extremum.engines.lanes.asked import Asked, Ended
from extremum.engines.lanes.watch import Watch
from extremum.loop import varied
from extremum.symbols import parse, t

FIELDS = ("states", "outcome", "end_time", "mean", "last_mean", "maxima", "beyond", "samples")


def asked(loop: es.Loop, over: dict[str, Any], t_end: float, **options: Any) -> Asked:
    """Loops of one structure; `over` is dotted path → numbers."""
    made, values, places = varied(loop, list(over))
    return Asked(made, values, places, np.array(list(over.values()), dtype=float), t_end, **options)


def watching(made: Any, **expressions: tuple[str, ...]) -> Watch:
    """A watch of text in the system's states and signals."""
    known = {str(x): x for x in (*made.states, *(s for s, _ in made.signals), t)}
    return Watch(**{k: tuple(parse(e, known) for e in v) for k, v in expressions.items()})


def reference(question: Asked, index: int, times: np.ndarray | None = None) -> Any:
    values = question.values.copy()
    values[list(question.swept)] = question.columns[:, index]
    times = np.array([0.0, question.t_end]) if times is None else times
    return taylor.integrate(question.system, values.tolist(), times, tol=1e-15)


def errors(question: Asked, ended: Ended) -> np.ndarray:
    """Largest |x − exact|/(1 + |exact|) of every loop."""
    exact = np.array([reference(question, i).end_state for i in range(question.count)]).T
    return np.abs((ended.states - exact) / (1 + np.abs(exact))).max(axis=0)


def same(a: Ended, b: Ended, loops: Any = slice(None), into: Any = slice(None)) -> None:
    """Refuse a single different bit."""
    assert np.array_equal(a.steps[loops], b.steps[into])
    for name in FIELDS:
        x, y = getattr(a, name)[..., loops], getattr(b, name)[..., into]
        assert np.array_equal(x, y, equal_nan=True), name


def starts(count: int, seed: int = 1) -> dict[str, np.ndarray]:
    """Starts, gains and frequencies; most loops with a negative gain escape."""
    rng = np.random.default_rng(seed)
    return {
        "start.0": rng.uniform(-2, 2, count),
        "start.1": rng.uniform(-2, 2, count),
        "controller.channels.0.gain": rng.uniform(-25, 14, count),
        "controller.frequency": rng.uniform(20, 40, count),
    }


def closer(count: int, path: str = "start") -> dict[str, np.ndarray]:
    """Starts of stable loops."""
    return {
        f"{path}.0": np.linspace(-0.5, 1.5, count),
        f"{path}.1": np.linspace(1.2, -0.4, count),
    }
