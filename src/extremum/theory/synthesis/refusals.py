"""Why there is no design, and the smallest change after which there is one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from ...errors import InvalidDescription
from ...requirements import Requirements

LARGEST: Final = 64.0
CLOSE: Final = 1.03


class Infeasible(InvalidDescription):
    """No controller meets the requirements.

    Attributes
    ----------
    condition
        A short name: ``"phase"``, ``"frequency"``, ``"authority"``, ``"noise"``, ….
    changes
        (entry, value) of each single change that would make it feasible, the smallest found.
    """

    def __init__(
        self,
        condition: str,
        path: str,
        reason: str,
        changes: Sequence[tuple[str, str]] = (),
        relaxations: Sequence[str] = (),
    ) -> None:
        self.condition, self.stated, self.changes = condition, reason, tuple(changes)
        self.relaxations = tuple(relaxations)
        if changes:
            listed = ", or ".join(f"{name} = {value}" for name, value in changes)
            reason = f"{reason}. Smallest change found that makes it feasible: {listed}"
        super().__init__(path, reason)

    def taught(self, changes: Sequence[tuple[str, str]]) -> Infeasible:
        """Return the same refusal with the changes that help."""
        return Infeasible(self.condition, self.path, self.stated, changes)


@dataclass(frozen=True)
class _Relaxation:
    """One requirement made easier by a factor k ≥ 1."""

    apply: Callable[[Requirements, float], Requirements]
    shown: Callable[[Requirements], str]


def _scaled(name: str, power: int) -> _Relaxation:
    def apply(wanted: Requirements, k: float) -> Requirements:
        given = getattr(wanted, name)
        factor = k**power
        eased = (
            tuple(_neat(x * factor, power) for x in given)
            if isinstance(given, tuple)
            else _neat(given * factor, power)
        )
        return wanted.replace({name: eased})

    return _Relaxation(apply, lambda wanted: _shown(getattr(wanted, name)))


def _narrowed(wanted: Requirements, k: float) -> Requirements:
    """Return the curvature's ranges with the ratio of their ends taken to the power 1/k."""
    eased = []
    for low, high in wanted.curvature:
        middle, half = math.sqrt(low * high), math.sqrt(high / low) ** (1 / k)
        ends = _neat(middle / half, 1), _neat(middle * half, -1)
        eased.append((min(ends), max(ends)))
    return wanted.replace({"curvature": tuple(eased)})


def _tamer(wanted: Requirements, k: float) -> Requirements:
    """Return the uncertain numbers with their ranges shrunk towards the low end."""
    eased = {
        path: (low, max(low, _neat(low + (high - low) / k, -1)))
        for path, (low, high) in wanted.uncertain.items()
    }
    return wanted.replace({"uncertain": eased})


def _bolder(wanted: Requirements, k: float) -> Requirements:
    """Return the uncertain numbers with their ranges shrunk towards the high end."""
    eased = {
        path: (min(high, _neat(high - (high - low) / k, 1)), high)
        for path, (low, high) in wanted.uncertain.items()
    }
    return wanted.replace({"uncertain": eased})


_EASIER: Final = {
    "settling_time": _scaled("settling_time", 1),
    "bandwidth": _scaled("bandwidth", -1),
    "frequency_limit": _scaled("frequency_limit", 1),
    "input_limit": _scaled("input_limit", 1),
    "dither_limit": _scaled("dither_limit", 1),
    "accuracy": _scaled("accuracy", 1),
    "start_distance": _scaled("start_distance", -1),
    "source_distance": _scaled("source_distance", -1),
    "force": _scaled("force", -1),
    "delay": _scaled("delay", -1),
    "coupling": _scaled("coupling", -1),
    "noise": _scaled("noise", -1),
    "curvature": _Relaxation(_narrowed, lambda wanted: _shown(wanted.curvature)),
    "uncertain": _Relaxation(_tamer, lambda wanted: _shown(dict(wanted.uncertain))),
    "uncertain, from below": _Relaxation(_bolder, lambda wanted: _shown(dict(wanted.uncertain))),
}


def eased(
    wanted: Requirements, names: Sequence[str], feasible: Callable[[Requirements], bool]
) -> list[tuple[str, str]]:
    """Return (entry, value) for each named requirement that alone can be eased far enough.

    The factor is found by doubling, up to 64, then by bisection to 3 %: the smallest, if every
    easier requirement is feasible as well. A range of uncertain numbers is shrunk towards its low
    end, or if that does not help towards its high end.
    """
    found = []
    for name in names:
        given = getattr(wanted, name)
        if given is None or not given or given == 0:
            continue
        ways = [_EASIER[key] for key in (name, f"{name}, from below") if key in _EASIER]
        shown = next(filter(None, (_smallest(wanted, way, feasible) for way in ways)), None)
        if shown is not None:
            found.append((name, shown))
    return found


def _smallest(
    wanted: Requirements, way: _Relaxation, feasible: Callable[[Requirements], bool]
) -> str | None:
    """Return the requirement eased by the smallest factor that is enough, None if none is."""
    high, works = 1.0, None
    while works is None and high < LARGEST:
        high *= 2
        trial = way.apply(wanted, high)
        works = trial if feasible(trial) else None
    if works is None:
        return None
    low = high / 2
    while high / low > CLOSE:
        middle = math.sqrt(low * high)
        trial = way.apply(wanted, middle)
        if feasible(trial):
            high, works = middle, trial
        else:
            low = middle
    return way.shown(works)


def _neat(value: float, direction: int) -> float:
    """Return a number with three digits, rounded to the easier side."""
    if value == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    steps = math.ceil(value / unit - 1e-9) if direction > 0 else math.floor(value / unit + 1e-9)
    return float(f"{steps * unit:.3g}")


def _shown(given: object) -> str:
    if isinstance(given, float):
        return f"{given:.3g}"
    if isinstance(given, tuple):
        inner = ", ".join(_shown(x) for x in given)
        return f"({inner},)" if len(given) == 1 else f"({inner})"
    if isinstance(given, dict):
        return "{" + ", ".join(f"{k}: {_shown(v)}" for k, v in given.items()) + "}"
    return str(given)
