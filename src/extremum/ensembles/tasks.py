"""An ensemble that has been checked, block by block."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..engines.lanes.accuracy import EXACT, SAMPLE, Accuracy, estimate
from ..engines.lanes.asked import Asked, Ended
from ..engines.lanes.difference import check_number, check_steps
from ..errors import InvalidDescription, shown
from ..loop import Loop, checked, varied
from ..parameters import Parameter
from ..system import System
from ..validation import positive
from . import regions
from .datasets import Memory, Target, columns, coordinates, taken, times
from .keeping import Finished, Keeping, keeping, last_periods, seen
from .lanes import Lanes, checked_numbers, lanes
from .streaming import Store

USUAL: Final = {"float64": 1e-6, "float32": 1e-4}
"""The tolerance where none is given."""

FLOORS: Final = {"float64": 1e-13, "float32": 1e-5}
"""The smallest tolerance that each kind of number can hold."""

MOST_SAMPLES: Final = 1_000_000
SAMPLED: Final = 2**24
"""Most numbers of a block's sampled states."""


@dataclass(frozen=True, eq=False)
class Task:
    """An ensemble that has been checked and can run.

    Attributes
    ----------
    system, values, places
        The equations, the loop's numbers, and which of them vary; see `loop.varied`.
    lanes, keeping
        What they vary over, and what is kept.
    t_end, samples, tol, dtype
        As `ensemble` takes them; no samples are 0.
    """

    system: System
    values: NDArray[np.float64]
    places: tuple[int, ...]
    lanes: Lanes
    keeping: Keeping
    t_end: float
    samples: int
    tol: float
    dtype: str

    @property
    def swept(self) -> list[Parameter]:
        """The parameters that vary, in the order of `lanes`."""
        return [self.system.parameters[place] for place in self.places]

    @property
    def following(self) -> tuple[int, ...]:
        """Which numbers vary because they are derived from some that do."""
        derived, total = self.system.derived, len(self.system.parameters)
        if derived is None or not any(derived.depends(p.path) for p in self.swept):
            return ()
        return tuple(range(total - derived.count, total))

    def chunk(self) -> tuple[int, ...]:
        """Return the shape of a block of loops that fits into memory with its samples."""
        sampled = max(1, self.samples * len(self.system.states))
        return regions.chunked(self.lanes.shape, min(regions.LIMIT, max(1, SAMPLED // sampled)))

    def target(self, path: Path | None, chunk: tuple[int, ...], attrs: Mapping[str, Any]) -> Target:
        """Return what takes the results: a store at the path, or memory.

        `attrs` are those that are known before anything runs.
        """
        found = columns(self.system, self.keeping, self.samples, self.dtype)
        dims = {dim for column in found for dim in column.dims}
        coords = coordinates(self.system, self.lanes, self.swept, dims, self.t_end, self.samples)
        if path is None:
            own = {name: variable.copy(deep=True) for name, variable in coords.items()}
            return Memory(self.lanes, found, own, attrs)
        return Store(path, self.lanes, chunk, found, coords, attrs)

    def completed(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the numbers at the paths, (paths, n), and below them those that follow."""
        if not self.following:
            return table
        derived, count = self.system.derived, table.shape[1]
        assert derived is not None
        others = np.repeat(self.values[: -derived.count, None], count, axis=1)
        others[list(self.places)] = table
        return np.concatenate([table, derived.function(others)])

    def numbers(self, columns: NDArray[np.float64]) -> list[Any]:
        """Return the parameters' numbers, those that vary as arrays."""
        numbers: list[Any] = self.values.tolist()
        for place, row in zip((*self.places, *self.following), columns, strict=True):
            numbers[place] = row
        return numbers

    def asked(self, table: NDArray[np.float64]) -> Asked:
        """Return what an engine is asked for loops with these numbers, (paths, n)."""
        watch, whole = self.keeping.watch, self.completed(table)
        window = None
        if watch.last_mean:
            count = table.shape[1]
            window = last_periods(self.system, self.numbers(whole), self.t_end, count)
        return Asked(
            system=self.system,
            values=self.values,
            swept=(*self.places, *self.following),
            columns=whole,
            t_end=self.t_end,
            watch=watch,
            window=window,
            samples=self.samples,
            tol=self.tol,
            dtype=self.dtype,
        )

    def tells(self, chunk: tuple[int, ...]) -> bool:
        """Return whether the run itself is what `accuracy` would run first."""
        return not self.samples and chunk == self.lanes.shape and self.lanes.count <= SAMPLE

    def accuracy(self, integrate: Callable[..., Ended]) -> Accuracy:
        """Run some of the loops twice, with different steps."""
        if self.system.dt is not None:
            return EXACT
        count = self.lanes.count
        some = np.linspace(0, count - 1, min(count, SAMPLE)).astype(np.int64)
        asked = replace(self, samples=0).asked(self.lanes.at(some))
        return estimate(asked, integrate(asked), integrate)

    def results(self, asked: Asked, ended: Ended) -> dict[str, NDArray[Any]]:
        """Return every variable of a block, (…, n)."""
        numbers = self.numbers(asked.columns)
        position, signal, source = seen(self.system, ended.end_time, ended.states, numbers)
        found: dict[str, NDArray[Any]] = {
            str(x): row for x, row in zip(self.system.states, ended.states, strict=True)
        }
        found |= {"position": position, "J": signal}
        found |= {"outcome": ended.outcome, "end_time": ended.end_time}
        with np.errstate(over="ignore", invalid="ignore"):  # of loops that escaped
            found |= self.keeping.results(Finished(ended, position, signal, source))
        if self.samples:
            found |= self._sampled(asked.count, ended, numbers)
        return found

    def _sampled(self, count: int, ended: Ended, numbers: list[Any]) -> dict[str, NDArray[Any]]:
        states = np.moveaxis(ended.samples, 1, 0).reshape(len(self.system.states), -1)
        instants = np.repeat(times(self.t_end, self.samples), count)
        many = [np.tile(n, self.samples) if isinstance(n, np.ndarray) else n for n in numbers]
        position, signal, _ = seen(self.system, instants, states, many)
        rows = position.reshape(len(position), self.samples, count)
        return {
            "sampled_position": np.moveaxis(rows, 0, 1),
            "sampled_J": signal.reshape(self.samples, count),
        }


def prepared(
    loop: Any, t_end: Any, over: Any, keep: Any, radius: Any, samples: Any, tol: Any, dtype: Any
) -> Task:
    """Return what the arguments of `ensemble` ask for, or refuse them."""
    checked(loop, sampled=True)
    duration = positive("t_end", t_end)
    found = lanes(over, taken(loop.system))
    system, _, places = varied(loop, tuple(found.swept))
    if any(oracle.table is None for oracle in system.oracles.values()):
        raise InvalidDescription(
            "field",
            "is known by its values only (Opaque), which an ensemble cannot run; write it with "
            "field_from or Expression, or put its values on a Grid",
        )
    swept = [system.parameters[place] for place in places]
    extremes = checked_numbers(found, swept, system.seeds)
    _check_loops(loop, found, extremes)
    system, values, places = varied(loop.covering(found.ends), tuple(found.swept))
    tolerance, kept = _tolerance(tol, dtype), _samples(samples)
    if system.dt is not None:
        check_number(dtype)
        dt = system.symbols.index(system.dt)
        lengths = found.numbers(places.index(dt)) if dt in places else [values[dt]]
        for length in lengths:
            check_steps(duration, length, kept)
    return Task(
        system=system,
        values=values,
        places=places,
        lanes=found,
        keeping=keeping(system, keep, radius),
        t_end=duration,
        samples=kept,
        tol=tolerance,
        dtype=dtype,
    )


def _check_loops(loop: Loop, lanes: Lanes, several: list[int]) -> None:
    """Refuse numbers that do not fit each other, in some of the loops."""
    table = lanes.at(np.array(several))
    for place, column in zip(several, table.T, strict=True):
        try:
            loop.replace(dict(zip(lanes.swept, column.tolist(), strict=True)))
        except InvalidDescription as error:
            where = f" (in the loop at index {list(lanes.index(place))})" if lanes.shape else ""
            raise InvalidDescription(error.path, error.reason + where, error.value) from None


def _tolerance(tol: Any, dtype: Any) -> float:
    if not isinstance(dtype, str) or dtype not in FLOORS:
        raise InvalidDescription("dtype", 'must be "float64" or "float32"', shown(dtype))
    tolerance, floor = positive("tol", USUAL[dtype] if tol is None else tol), FLOORS[dtype]
    if not floor <= tolerance < 0.1:
        raise InvalidDescription(
            "tol", f"must lie between {floor:g}, what {dtype} can hold, and 0.1", shown(tol)
        )
    return tolerance


def _samples(samples: Any) -> int:
    if samples is None:
        return 0
    whole = isinstance(samples, int | np.integer) and not isinstance(samples, bool)
    if not whole or not 2 <= samples <= MOST_SAMPLES:
        reason = f"must be a whole number between 2 and {MOST_SAMPLES:,}"
        raise InvalidDescription("samples", reason, shown(samples))
    return int(samples)
