"""The variables of an ensemble's result, and where they are put: into memory or a Zarr store."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidDescription
from ..parameters import Parameter
from ..symbols import axis_names
from ..system import System
from .keeping import STATISTICS, Keeping
from .lanes import Lanes
from .regions import Region, extent

if TYPE_CHECKING:
    import xarray

OUTCOMES: Final = "completed escaped left_the_data"
"""What the outcomes 0, 1, 2 mean, as the CF conventions write it."""

OWN: Final = ("position", "J", "outcome", "end_time", "sampled_position", "sampled_J")


@dataclass(frozen=True)
class Column:
    """A variable of the result: what it is besides one for each loop."""

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    attrs: Mapping[str, Any]

    def size(self) -> int:
        """Return how many bytes it has for each loop."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize

    def shaped(self, values: NDArray[Any], region: Region) -> NDArray[Any]:
        """Return a block's values, (…, loops), as (region, …)."""
        last = np.moveaxis(values, -1, 0).reshape((*extent(region), *self.shape))
        with np.errstate(over="ignore"):  # what float32 cannot hold is infinite
            return last.astype(self.dtype)


class Target(Protocol):
    """What takes the blocks of a result as they are computed."""

    def write(self, region: Region, block: Mapping[str, NDArray[Any]]) -> None:
        """Take a block: every variable's values, (…, loops)."""
        ...

    def finished(self, attrs: Mapping[str, Any]) -> xarray.Dataset:
        """Return the whole, with attrs that are known at the end."""
        ...


def taken(system: System) -> tuple[str, ...]:
    """Return the names of all variables that a result may have."""
    return (*OWN, *STATISTICS, *map(str, system.states))


def columns(system: System, keeping: Keeping, samples: int, dtype: str) -> list[Column]:
    """Return the variables of a result, besides its coordinates."""
    axes = len(system.outputs["position"])
    units = [system.units[symbol] for symbol in system.inputs]
    sizes = {"axis": axes, "input": len(units), "time": samples}
    meanings = {"flag_values": np.arange(3, dtype=np.int8), "flag_meanings": OUTCOMES}

    def column(name: str, dims: tuple[str, ...], unit: str, long_name: str) -> Column:
        attrs = {"units": unit, "long_name": long_name}
        return Column(name, dims, tuple(sizes[dim] for dim in dims), dtype, attrs)

    found = [column(str(x), (), system.units[x], f"state {x} at the end") for x in system.states]
    found += [
        column("position", ("axis",), "m", "position at the end"),
        column("J", (), "1", "value of the field at the end"),
        Column("outcome", (), (), "int8", {"long_name": "how the run ended", **meanings}),
        Column("end_time", (), (), "float64", {"units": "s", "long_name": "when the run ended"}),
    ]
    for name in keeping.places:
        statistic = STATISTICS[name]
        unit = statistic.unit.format(input=", ".join(dict.fromkeys(units)))
        found.append(column(name, statistic.dims, unit, statistic.long_name))
    if samples:
        found += [
            column("sampled_position", ("time", "axis"), "m", "position"),
            column("sampled_J", ("time",), "1", "value of the field"),
        ]
    return found


def coordinates(
    system: System,
    lanes: Lanes,
    swept: Sequence[Parameter],
    dims: set[str],
    t_end: float,
    samples: int,
) -> dict[str, xarray.Variable]:
    """Return a result's coordinates: the named arrays' own, every swept number, and labels."""
    import xarray

    found = dict(lanes.coords)
    for (path, variable), parameter in zip(lanes.swept.items(), swept, strict=True):
        found[path] = variable.copy(deep=False)
        found[path].attrs = {"long_name": path, **variable.attrs, "units": parameter.unit}
    labels: dict[str, tuple[Any, dict[str, str]]] = {
        "axis": (list(axis_names(len(system.outputs["position"]))), {}),
        "input": ([str(symbol) for symbol in system.inputs], {}),
        "time": (times(t_end, samples), {"units": "s", "long_name": "time"}),
    }
    found |= {dim: xarray.Variable((dim,), *labels[dim]) for dim in labels if dim in dims}
    return found


def times(t_end: float, samples: int) -> NDArray[np.float64]:
    """Return when states are kept (s), (samples,)."""
    return np.linspace(0.0, t_end, samples)


@dataclass(frozen=True)
class Memory:
    """Keeps a result in memory.

    Raises
    ------
    InvalidDescription
        If there is not enough memory.
    """

    lanes: Lanes
    columns: list[Column]
    coords: Mapping[str, xarray.Variable]
    attrs: Mapping[str, Any]
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        try:
            for column in self.columns:
                shape = (*self.lanes.shape, *column.shape)
                self.arrays[column.name] = np.empty(shape, column.dtype)
        except (MemoryError, ValueError):  # ValueError: more bytes than an address can count
            count = self.lanes.count
            needed = sum(count * column.size() for column in self.columns) / 2**30
            raise InvalidDescription(
                "into",
                f"the results of {count:,} loops need {needed:,.1f} GiB, more memory than there "
                'is; name a Zarr store that they are written to, such as into="results.zarr", or '
                "run fewer loops",
            ) from None

    def write(self, region: Region, block: Mapping[str, NDArray[Any]]) -> None:
        """Put a block in its place."""
        for column in self.columns:
            self.arrays[column.name][region] = column.shaped(block[column.name], region)

    def finished(self, attrs: Mapping[str, Any]) -> xarray.Dataset:
        """Return the dataset."""
        import xarray

        variables = {
            c.name: xarray.Variable((*self.lanes.dims, *c.dims), self.arrays[c.name], c.attrs)
            for c in self.columns
        }
        return xarray.Dataset(variables, self.coords, {**self.attrs, **attrs})
