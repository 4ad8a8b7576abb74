"""How long a design takes: proof, exact confirmation and runs included."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

from report import Table, Target, interleaved

import extremum as es
from extremum import s


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    yield warm(3 if quick else 15)


def problems() -> dict[str, es.Requirements]:
    """Return design problems of two axes and more, from easy to hard."""
    unstable = es.Rational("1/(s - epsilon)", {"epsilon": 0.25})
    lagging = es.Rational("1/((s - epsilon)*(0.05*s + 1)*(0.02*s + 1))", {"epsilon": 0.5})
    poles = {f"vehicle.axes.{i}.parameters.epsilon": (0.0, 0.5) for i in range(2)}
    usual: dict[str, Any] = {"dither_limit": 0.2, "settling_time": 6.0}
    return {
        "two axes 1/s": es.Requirements(
            vehicle=es.PointMass(axes=(1 / s, 1 / s)), curvature=((0.5, 1), (0.25, 0.5)), **usual
        ),
        "two axes 1/s², a constant force": es.Requirements(
            vehicle=es.PointMass(axes=(1 / s**2, 1 / s**2)),
            curvature=((0.5, 1), (0.25, 0.5)),
            force=0.3,
            **usual,
        ),
        "two axes 1/(s − ε), ε in 0 … 0.5": es.Requirements(
            vehicle=es.PointMass(axes=(unstable, unstable)),
            uncertain=poles,
            curvature=((0.5, 1), (0.25, 0.5)),
            source_distance=1.0,
            start_distance=1.5,
            **usual,
        ),
        "the same under two lags, curvature 1 : 4": es.Requirements(
            vehicle=es.PointMass(axes=(lagging, lagging)),
            uncertain=poles,
            curvature=((0.25, 1), (0.25, 1)),
            source_distance=1.0,
            **usual,
        ),
        "two axes 1/s, coupled by |Q_xy| ≤ 0.2": es.Requirements(
            vehicle=es.PointMass(axes=(1 / s, 1 / s)),
            curvature=((0.5, 1), (0.5, 1)),
            coupling=0.2,
            **usual,
        ),
        "three axes 1/s": es.Requirements(
            vehicle=es.PointMass(axes=(1 / s,) * 3), curvature=((0.5, 1),) * 3, **usual
        ),
    }


def warm(rounds: int) -> Table:
    """Change the settling time of a design problem a little, and design again."""
    changes = count(1)

    def again(wanted: es.Requirements) -> Callable[[], es.Design]:
        assert wanted.settling_time is not None
        time = wanted.settling_time
        return lambda: es.design(wanted.replace({"settling_time": time + 1e-6 * next(changes)}))

    runs = {name: again(wanted) for name, wanted in problems().items()}
    timed: dict[str, Callable[[], object]] = {**runs}
    points = {name: len(run().confirmations) for name, run in runs.items()}
    times = interleaved(timed, rounds)
    worst = max(t.median for name, t in times.items() if "two axes" in name or "same" in name)
    return Table(
        "Warm: one design, its proof, every corner and edge confirmed by Floquet, runs from afar",
        ("", "points of the box", "median (s)", "range (s)"),
        [(name, str(points[name]), *t.text("s")) for name, t in times.items()],
        [f"{rounds} designs each, with a settling time that was never asked before."],
        [Target("one design, warm, two axes", worst, 1.0, "s")],
        {"times": {name: t.data() for name, t in times.items()}},
    )
