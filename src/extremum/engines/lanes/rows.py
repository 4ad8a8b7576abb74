"""The rows of numbers that an engine is given, a column a loop, and those it leaves behind."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import choosing
from .asked import Asked, Ended, Numbers


def given(asked: Asked, leaves: Iterable[tuple[str, int]]) -> Numbers:
    """Return the rows of what varies from loop to loop, (leaves, n).

    Parameters
    ----------
    asked
        The loops.
    leaves
        ``("value", i)`` for every swept parameter, in order; then ``("length", 0)``, the step (s)
        where the scheme has none of its own, and ``("begin", 0)``, the time (s) at which the last
        window begins, where a program needs them.
    """
    rows = [*asked.columns]
    for name, _ in leaves:
        if name == "length":
            rows.append(choosing.lengths(asked))
        elif name == "begin":
            rows.append(asked.t_end - _window(asked))
    return np.array(rows, dtype=float).reshape(len(rows), asked.count)


def _window(asked: Asked) -> Numbers:
    assert asked.window is not None
    return np.minimum(asked.window, asked.t_end)


def ended(
    asked: Asked, names: Sequence[str], left: Numbers, samples: NDArray[Any], scheme: str
) -> Ended:
    """Return what became of the loops.

    Parameters
    ----------
    asked
        The loops.
    names
        What the rows of `left` are: "steps"; "state 0", …; "mean 0", …, integrals over time;
        "last 0", …, integrals over the last window; "maximum 0", …; "beyond 0", …; "time", where
        the loop ended (s); "completed", 1 where that is t_end.
    left
        (rows, n).
    samples
        (samples, states, n).
    scheme
        What took the steps.
    """
    rows = dict(zip(names, left, strict=True))

    def block(name: str) -> NDArray[Any]:
        found = [row for key, row in rows.items() if key.split()[0] == name]
        return np.array(found).reshape(len(found), asked.count)

    states = block("state").astype(samples.dtype)
    completed, times = rows["completed"] == 1, rows["time"].copy()
    times[completed] = asked.t_end
    last = block("last")
    if len(last):
        last = np.where(completed, last / _window(asked), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = block("mean") / times
    maxima = np.where(rows["steps"] > 0, block("maximum"), np.nan)
    return Ended(
        states=states,
        outcome=choosing.outcomes(asked, completed, times, states),
        end_time=times,
        mean=mean,
        last_mean=last,
        maxima=maxima,
        beyond=block("beyond"),
        samples=samples,
        steps=rows["steps"].astype(np.int64),
        scheme=scheme,
    )
