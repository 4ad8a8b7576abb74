"""Statistics of a run: what is watched while it goes on, and what is made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Literal, cast

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ..engines.lanes.asked import Ended
from ..engines.lanes.watch import Watch
from ..errors import InvalidDescription, shown, suggestion
from ..system import System
from ..validation import positive

Numbers = NDArray[np.float64]
Slot = Literal["mean", "last_mean", "maxima", "beyond"]


@dataclass(frozen=True)
class Finished:
    """A block of loops that have run, (…, n) each."""

    ended: Ended
    position: Numbers
    signal: Numbers
    source: Numbers | None


@dataclass(frozen=True)
class Statistic:
    """One thing that can be kept.

    Attributes
    ----------
    slot
        Where in `Watch` its expressions stand.
    watched
        (system, radius) → the expressions.
    result
        Their values, (k, n), the block and the radius → what is kept, (…, n).
    dims
        Its dimensions besides those of the loops.
    unit, long_name
        What its attrs say; ``{input}`` stands for the inputs' unit.
    """

    slot: Slot
    watched: Callable[[System, float], tuple[Expr, ...]]
    result: Callable[[NDArray[Any], Finished, float], NDArray[Any]]
    dims: tuple[str, ...]
    unit: str
    long_name: str


def _offset(system: System) -> tuple[Expr, ...]:
    pairs = zip(system.outputs["position"], system.outputs["source"], strict=True)
    return tuple(x - c for x, c in pairs)


def _farther(system: System, radius: float) -> tuple[Expr, ...]:
    squares = (e**2 for e in _offset(system))
    return (sympy.Add(*squares) - sympy.Float(radius) ** 2,)


def _settled(values: NDArray[Any], block: Finished, radius: float) -> NDArray[Any]:
    assert block.source is not None
    away = np.sqrt(((block.position - block.source) ** 2).sum(axis=0))
    inside = (block.ended.outcome == 0) & (away <= radius)
    return np.where(inside, values[0], np.nan)


def _first(values: NDArray[Any], block: Finished, radius: float) -> NDArray[Any]:
    return values[0]


def _all(values: NDArray[Any], block: Finished, radius: float) -> NDArray[Any]:
    return values


def _length(values: NDArray[Any], block: Finished, radius: float) -> NDArray[Any]:
    return np.sqrt((values**2).sum(axis=0))


def _magnitude(values: NDArray[Any], block: Finished, radius: float) -> NDArray[Any]:
    high, low = np.split(values, 2)
    return np.maximum(high, low)


STATISTICS: Final[Mapping[str, Statistic]] = MappingProxyType(
    {
        "mean_J": Statistic(
            "mean", lambda system, _: system.outputs["J"], _first, (), "1", "mean of J over the run"
        ),
        "max_J": Statistic(
            "maxima", lambda system, _: system.outputs["J"], _first, (), "1", "largest J of the run"
        ),
        "mean_position": Statistic(
            "last_mean",
            lambda system, _: system.outputs["position"],
            _all,
            ("axis",),
            "m",
            "mean position over the last period",
        ),
        "distance": Statistic(
            "last_mean",
            lambda system, _: _offset(system),
            _length,
            (),
            "m",
            "distance of the mean position over the last period to the source",
        ),
        "settling_time": Statistic(
            "beyond", _farther, _settled, (), "s", "time from which on the source is near"
        ),
        "peak_input": Statistic(
            "maxima",
            lambda system, _: (*system.inputs, *(-u for u in system.inputs)),
            _magnitude,
            ("input",),
            "{input}",
            "largest magnitude of each input",
        ),
    }
)


@dataclass(frozen=True)
class Keeping:
    """The statistics that one ensemble keeps.

    Attributes
    ----------
    places
        Statistic's name → which expressions of its slot of `watch` are its.
    radius
        Within which of the source a loop has settled (m).
    watch
        What the engine follows.
    """

    places: Mapping[str, slice]
    radius: float
    watch: Watch

    def results(self, block: Finished) -> dict[str, NDArray[Any]]:
        """Return each statistic of a block, (…, n)."""
        return {
            name: STATISTICS[name].result(
                getattr(block.ended, STATISTICS[name].slot)[place], block, self.radius
            )
            for name, place in self.places.items()
        }


def keeping(system: System, keep: Any, radius: Any) -> Keeping:
    """Return what `keep` and `radius` ask of a system."""
    names = _names(keep)
    if ("settling_time" in names) != (radius is not None):
        raise InvalidDescription(
            "radius",
            'goes with keep=("settling_time",): within this distance (m) of the source a loop '
            "has settled",
            shown(radius),
        )
    within = 0.0 if radius is None else positive("radius", radius)
    watched: dict[str, tuple[Expr, ...]] = {"mean": (), "last_mean": (), "maxima": (), "beyond": ()}
    places: dict[str, slice] = {}
    for name in names:
        statistic = STATISTICS[name]
        if name in ("distance", "settling_time") and "source" not in system.outputs:
            raise InvalidDescription(
                "keep", "needs a field that states where its source is; this one does not", name
            )
        if statistic.slot == "last_mean" and not system.carriers:
            raise InvalidDescription("keep", "needs a dither, whose last period it looks at", name)
        own, before = statistic.watched(system, within), watched[statistic.slot]
        places[name] = slice(len(before), len(before) + len(own))
        watched[statistic.slot] = (*before, *own)
    return Keeping(places, within, Watch(**watched))


def _names(keep: Any) -> tuple[str, ...]:
    if isinstance(keep, str) or not isinstance(keep, Sequence | set | frozenset):
        raise InvalidDescription("keep", 'must be names, such as ("mean_J", "max_J")', shown(keep))
    for name in keep:
        if not isinstance(name, str) or name not in STATISTICS:
            raise InvalidDescription(
                "keep", f"cannot be kept; {suggestion(str(name), STATISTICS)}", shown(name)
            )
    return tuple(name for name in STATISTICS if name in keep)


@lru_cache(maxsize=64)
def _carriers(system: System) -> tuple[Callable[..., Any], float | None]:
    """Return the dithers' frequencies as a function, and the common period's share of the first."""
    ratios = [sympy.cancel(carrier / system.carriers[0]) for carrier in system.carriers]
    periodic = all(ratio.is_Rational for ratio in ratios)
    base = float(cast(Any, sympy.gcd_list(ratios))) if periodic else None
    names = [list(system.symbols)]
    return sympy.lambdify(names, list(system.carriers), "numpy", dummify=True), base


def last_periods(system: System, values: Sequence[Any], t_end: float, count: int) -> Numbers:
    """Return how long the last period of each loop is (s), (count,).

    The time after which all dithers repeat; where their frequencies have no common measure, the
    slowest one's period; `t_end` where that is shorter.

    Parameters
    ----------
    values
        The parameters' numbers; those that vary as arrays, (count,).
    """
    evaluate, base = _carriers(system)
    frequencies = np.abs([np.broadcast_to(w, count) for w in evaluate(values)])
    slow = frequencies.min(axis=0) if base is None else base * frequencies[0]
    return np.minimum(2 * np.pi / slow, t_end)


@lru_cache(maxsize=64)
def _seen(system: System) -> Callable[..., Any]:
    outputs = system.outputs
    wanted = (*outputs["position"], *outputs["J"], *outputs.get("source", ()))
    return system.function(wanted, vector=True)


def seen(
    system: System, times: Numbers, states: NDArray[Any], values: Sequence[Any]
) -> tuple[Numbers, Numbers, Numbers | None]:
    """Return position (axes, n), J (n,) and source (axes, n) or None at n times and states.

    Parameters
    ----------
    states
        (states, n).
    values
        The parameters' numbers; those that vary as arrays, (n,).
    """
    with np.errstate(all="ignore"):
        flat = _seen(system)(times, list(states.astype(float)), values)
    rows = np.array([np.broadcast_to(row, len(times)) for row in flat], dtype=float)
    axes = len(system.outputs["position"])
    return rows[:axes], rows[axes], rows[axes + 1 :] if "source" in system.outputs else None
