"""What varies from loop to loop of a sweep."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ..declarations import Table, is_none
from ..description import Description, structure, value
from ..documents import Reader
from ..errors import InvalidDescription, shown
from ..requirements import each

SCALES: Final = ("linear", "log")
DISTRIBUTIONS: Final = ("uniform", "log-uniform", "normal")
NAME: Final = re.compile(r"(?!_)[\w-]+(\.[\w-]+)*")
"""What may name a folder of the store, and stand among others in one of its attributes."""
FARTHEST: Final = 8.3
"""No number of 53 random bits lies farther out on a normal axis, in standard deviations."""
DEEPEST: Final = 6.0
"""A normal axis may be cut off so far beyond its mean, in standard deviations, and no farther."""


def choice(*known: str) -> Any:
    """Return a converter that accepts these texts only."""

    def one(given: Any) -> str:
        if isinstance(given, str) and given in known:
            return given
        raise InvalidDescription("", f"must be {' or '.join(map(repr, known))}", shown(given))

    return one


def whole(least: int) -> Any:
    """Return a converter that accepts whole numbers from `least` on, and None."""

    def one(given: Any) -> Any:
        good = isinstance(given, int) and not isinstance(given, bool) and given >= least
        if given is None or good:
            return given
        raise InvalidDescription("", f"must be a whole number, at least {least}", shown(given))

    return one


def texts(given: Any) -> Any:
    """Return a tuple of texts."""
    if given is None:
        return None
    if not isinstance(given, list | tuple) or not all(isinstance(item, str) for item in given):
        raise InvalidDescription("", "must be an array of texts", shown(given))
    if len(set(given)) < len(given):
        raise InvalidDescription("", "names one twice", shown(given))
    return tuple(given)


class Axis(Description):
    """One thing that varies: a number of the loop, or several that are equal.

    A grid has `points` numbers from `low` to `high`, evenly spaced on a linear or log scale. The
    other methods draw u from [0, 1) and take the inverse of the cumulative distribution F there:

    - uniform: low + (high − low) u,
    - log-uniform: low (high/low)^u,
    - normal: mean + std Φ⁻¹(u), cut off at `low` and `high` where they are given (the
      distribution between them is scaled up).

    Parameters
    ----------
    low, high
        The first and the last number.
    points
        How many, for grids.
    scale
        ``"linear"`` or ``"log"``, for grids.
    values
        Instead of a range: the numbers themselves. The methods that draw take each equally often.
    distribution
        ``"uniform"``, ``"log-uniform"`` or ``"normal"``, for the methods that draw.
    mean, std
        Of a normal distribution.
    paths
        The dotted paths of the numbers that it sets; by default its own name is the path.
    """

    low: float | None = value("low", "", "first or smallest", default=None, literal=is_none)
    high: float | None = value("high", "", "last or largest", default=None, literal=is_none)
    points: int | None = structure("how many (grid)", default=None, converter=whole(2))
    scale: str = structure("linear or log (grid)", default="linear", converter=choice(*SCALES))
    values: tuple[float, ...] | None = value(
        "values", "", "the numbers themselves", default=None, shape="vector", literal=is_none
    )
    distribution: str = structure(
        "uniform, log-uniform or normal (not grid)",
        default="uniform",
        converter=choice(*DISTRIBUTIONS),
    )
    mean: float | None = value("mean", "", "of a normal", default=None, literal=is_none)
    std: float | None = value(
        "std", "", "of a normal", default=None, positive=True, literal=is_none
    )
    paths: tuple[str, ...] | None = structure(
        "the dotted paths that it sets; by default its name", default=None, converter=texts
    )

    def check(self) -> None:
        """Refuse what contradicts itself."""
        if self.paths == ():
            raise InvalidDescription("paths", "names nothing; leave it out, or name a path")
        if self.values is not None:
            self._check_alone()
            return
        normal = self.distribution == "normal"
        for name in ("mean", "std"):
            if (getattr(self, name) is not None) != normal:
                reason = "is missing" if normal else 'needs distribution = "normal"'
                raise InvalidDescription(name, reason)
        if not normal:
            for name in ("low", "high"):
                if getattr(self, name) is None:
                    raise InvalidDescription(name, "is missing; or give values = […]")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise InvalidDescription(
                "low", f"must be less than high = {self.high!r}", repr(self.low)
            )
        self._check_cut()
        logarithmic = "log" in (self.scale, self.distribution.removesuffix("-uniform"))
        if logarithmic and self.low is not None and self.low <= 0:
            raise InvalidDescription(
                "low", "must be greater than 0: a log scale never reaches 0", repr(self.low)
            )

    def _check_cut(self) -> None:
        if self.mean is None or self.std is None:
            return
        for name, side in (("low", 1), ("high", -1)):
            end = getattr(self, name)
            if end is not None and side * (end - self.mean) > DEEPEST * self.std:
                reason = f"cuts off all but the last 1e-9 of a normal about {self.mean:g}"
                raise InvalidDescription(name, reason, repr(end))

    def _check_alone(self) -> None:
        others = ("low", "high", "points", "mean", "std")
        beside = [name for name in others if getattr(self, name) is not None]
        if beside:
            raise InvalidDescription(beside[0], "is a range's, and values are given; take one")
        if self.scale != "linear" or self.distribution != "uniform":
            name = "distribution" if self.scale == "linear" else "scale"
            raise InvalidDescription(name, "is a range's, and values are given; leave it out")

    def extremes(self) -> tuple[float, float]:
        """Return the smallest and largest number that it can take."""
        if self.values is not None:
            return min(self.values), max(self.values)
        low, high = self.low, self.high
        if self.mean is not None and self.std is not None:
            low = self.mean - FARTHEST * self.std if low is None else low
            high = self.mean + FARTHEST * self.std if high is None else high
        assert low is not None
        assert high is not None
        return low, high


def as_axes(given: Any) -> Table:
    """Return axes by name; one may be a table of `Axis`' entries.

    Raises
    ------
    InvalidDescription
        With the axis' name first in the path.
    """
    if not isinstance(given, Mapping) or not given:
        reason = 'must have at least one axis: "start.0" = { low = -3, high = 3, … }'
        raise InvalidDescription("", reason, shown(given))
    for name, item in given.items():
        _check_name(name)
        if isinstance(item, Mapping) and any(isinstance(v, Mapping) for v in item.values()):
            reason = 'is a table of tables; a dotted path is one key, in quotes: "start.0"'
            raise InvalidDescription(str(name), reason)
    return Table(each(given, _as_axis))


def _check_name(name: Any) -> None:
    if not isinstance(name, str) or not NAME.fullmatch(name):
        reason = "is no name for an axis: words of letters, digits, _ and -, with dots between them"
        raise InvalidDescription("", reason, shown(name))


def _as_axis(given: Any) -> Axis:
    if isinstance(given, Axis):
        return given
    if not isinstance(given, Mapping):
        reason = "must be a table such as { low = -3, high = 3 }"
        raise InvalidDescription("", reason, shown(given))
    return Reader(Path()).build(Axis, given, "")
