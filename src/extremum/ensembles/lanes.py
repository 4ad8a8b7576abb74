"""What varies over an ensemble: arrays of numbers by dotted path, broadcast by dimension."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..engines.lanes.random import LARGEST
from ..errors import InvalidDescription, shown
from ..parameters import Parameter
from ..validation import number
from . import regions

if TYPE_CHECKING:
    import xarray

Numbers = NDArray[np.float64]

RESERVED: Final = ("axis", "time", "input")
"""Dimensions that results have of their own."""

MOST_BYTES: Final = 8
"""Of a number."""


@dataclass(frozen=True, eq=False)
class Lanes:
    """The loops of an ensemble: its dimensions, and the numbers that vary along them.

    Attributes
    ----------
    dims, shape
        The dimensions' names and sizes.
    swept
        Dotted path → its numbers, along some of the dimensions.
    coords
        The named arrays' coordinates.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    swept: Mapping[str, xarray.Variable]
    coords: Mapping[str, xarray.Variable]

    @property
    def count(self) -> int:
        """How many loops."""
        return math.prod(self.shape)

    def columns(self, region: regions.Region) -> Numbers:
        """Return the numbers of a block's loops, (paths, loops), in C order."""
        shape = regions.extent(region)
        where = dict(zip(self.dims, region, strict=True))
        table = np.empty((len(self.swept), *shape))
        for row, variable in enumerate(self.swept.values()):
            part = variable[{dim: where[str(dim)] for dim in variable.dims}]
            part = part.transpose(*(dim for dim in self.dims if dim in variable.dims))
            missing = tuple(i for i, dim in enumerate(self.dims) if dim not in variable.dims)
            table[row] = np.expand_dims(_floats(part), missing)
        return table.reshape(len(self.swept), -1)

    def at(self, loops: NDArray[np.int64]) -> Numbers:
        """Return the numbers of some loops, (paths, loops), by their places in C order."""
        import xarray

        inner = np.unravel_index(loops, self.shape) if self.shape else ()
        places = dict(zip(self.dims, inner, strict=True))
        table = np.empty((len(self.swept), len(loops)))
        for row, variable in enumerate(self.swept.values()):
            where = {dim: xarray.Variable("loop", places[str(dim)]) for dim in variable.dims}
            table[row] = _floats(variable[where])
        return table

    def numbers(self, row: int) -> Iterator[Numbers]:
        """Return all different numbers at a path, block by block."""
        variable = tuple(self.swept.values())[row]
        chunk = regions.chunked(variable.shape, regions.LIMIT)
        for region in regions.regions(variable.shape, chunk):
            yield np.unique(_floats(variable[region]))

    def ends(self, path: str) -> tuple[float, float] | None:
        """Return the smallest and the largest number at a path, None if it is not swept."""
        if path not in self.swept:
            return None
        parts = [*self.numbers(list(self.swept).index(path))]
        return min(float(part[0]) for part in parts), max(float(part[-1]) for part in parts)

    def index(self, place: int) -> tuple[int, ...]:
        """Return a loop's index along the dimensions."""
        return tuple(int(i) for i in np.unravel_index(place, self.shape))


def lanes(over: Any, taken: Sequence[str]) -> Lanes:
    """Return the loops that `over` states; no dimension or coordinate may have a `taken` name."""
    import xarray

    if not isinstance(over, Mapping) or not over:
        raise InvalidDescription(
            "over", "must map dotted paths to arrays, such as {'start.0': [0, 1]}", shown(over)
        )
    for path in over:
        if not isinstance(path, str):
            raise InvalidDescription("over", f"a dotted path must be text, got {shown(path)}")
    named = {
        path: xarray.DataArray(given)
        for path, given in over.items()
        if isinstance(given, xarray.DataArray | xarray.Variable)
    }
    plain = {path: _array(path, given) for path, given in over.items() if path not in named}
    for path, array in named.items():
        _check_kind(path, array)
        if not all(isinstance(name, str) for name in (*array.dims, *array.coords)):
            raise InvalidDescription(path, "its dimensions' names must be text", shown(array.dims))
    several = [path for path, array in plain.items() if array.ndim]
    if named and several:
        raise InvalidDescription(
            several[0],
            f"has dimensions without names beside {next(iter(named))}, whose dimensions have "
            "names; make it an xarray.DataArray too",
        )
    made = _by_name(named, plain, taken) if named else _by_place(plain)
    ordered = {path: made.swept[path] for path in over}
    return Lanes(made.dims, made.shape, ordered, made.coords)


def checked_numbers(
    lanes: Lanes, parameters: Sequence[Parameter], seeds: Container[Any] = ()
) -> list[int]:
    """Refuse numbers that are not finite, not positive where they must be, and what is no seed.

    Returns the places, in C order, of loops in which each number is the first, the smallest and
    the largest. `parameters` are the swept ones, in the order of the lanes; `seeds` the symbols
    of those that are seeds of random numbers.
    """
    found = {0}
    for (path, variable), parameter in zip(lanes.swept.items(), parameters, strict=True):
        extremes: dict[str, tuple[float, tuple[int, ...]]] = {}
        chunk = regions.chunked(variable.shape, regions.LIMIT)
        for region in regions.regions(variable.shape, chunk):
            part = _floats(variable[region])
            is_seed = parameter.symbol in seeds
            bad = _no_seed(part) if is_seed else _bad(part, bool(parameter.symbol.is_positive))
            if bad:
                place, reason = bad
                index = _shifted(part, place, region)
                where = f" at index {list(index)}" if index else ""
                raise InvalidDescription(path, reason, f"{float(part.flat[place])!r}{where}")
            for name, place in (("low", int(part.argmin())), ("high", int(part.argmax()))):
                size = float(part.flat[place]) * (1 if name == "low" else -1)
                if name not in extremes or size < extremes[name][0]:
                    extremes[name] = size, _shifted(part, place, region)
        for _, index in extremes.values():
            where = dict(zip(variable.dims, index, strict=True))
            whole = tuple(where.get(dim, 0) for dim in lanes.dims)
            found.add(int(np.ravel_multi_index(whole, lanes.shape)) if whole else 0)
    return sorted(found)


def _bad(part: Numbers, positive: bool) -> tuple[int, str] | None:
    """Return where the first number is that cannot be, and what it must be."""
    finite = np.isfinite(part)
    good = finite & (part > 0) if positive else finite
    if good.all():
        return None
    place = int(np.argmin(good))
    return place, f"must be {'greater than 0' if finite.flat[place] else 'a finite number'}"


def _no_seed(part: Numbers) -> tuple[int, str] | None:
    """Return where the first number is that is no seed, and what it must be."""
    good = (part >= 0) & (part <= LARGEST) & (part == np.rint(part))
    if good.all():
        return None
    return int(np.argmin(good)), f"must be a whole number between 0 and {LARGEST:,}"


def _shifted(part: Numbers, place: int, region: regions.Region) -> tuple[int, ...]:
    inner = np.unravel_index(place, part.shape) if part.shape else ()
    return tuple(int(i) + r.start for i, r in zip(inner, region, strict=True))


def _floats(variable: xarray.Variable) -> Numbers:
    return np.asarray(variable.values, dtype=float)


def _array(path: str, given: Any) -> NDArray[Any]:
    if isinstance(given, str) or not (isinstance(given, Sequence) or hasattr(given, "__array__")):
        return np.asarray(_number(path, given))
    if np.ma.is_masked(given):
        raise InvalidDescription(path, "has masked entries; fill or drop them first")
    try:
        array = np.asarray(given)
    except ValueError:
        reason = "must be an array of numbers: its rows differ in length"
        raise InvalidDescription(path, reason, shown(given)) from None
    except TypeError as error:
        reason = f"must be an array of numbers: {error}"
        raise InvalidDescription(path, reason, type(given).__name__) from None
    if array.dtype == object and array.size:  # such as multiples of es.pi
        array = np.array([_number(path, n) for n in array.ravel()]).reshape(array.shape)
    _check_kind(path, array)
    return array


def _number(path: str, given: Any) -> float:
    try:
        return number(given)
    except InvalidDescription as error:
        raise error.within(path) from None


def _check_kind(path: str, array: Any) -> None:
    if array.size == 0:
        raise InvalidDescription(path, f"has no numbers: its shape is {array.shape}")
    if array.dtype.kind not in "iuf":
        raise InvalidDescription(
            path, f"must be an array of real numbers, not of {array.dtype}", _start(array)
        )
    if array.dtype.itemsize > MOST_BYTES:
        reason = f"holds {array.dtype}, of which a loop takes float64 only; use astype(float)"
        raise InvalidDescription(path, reason, _start(array))


def _start(array: Any) -> str:
    return shown(np.asarray(array).ravel()[0]) + (", …" if array.size > 1 else "")


def _by_place(arrays: Mapping[str, NDArray[Any]]) -> Lanes:
    """Broadcast arrays by the places of their dimensions, as NumPy does."""
    import xarray

    try:
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{path} {array.shape}" for path, array in arrays.items())
        raise InvalidDescription("over", f"the shapes do not broadcast: {shapes}") from None
    dims = ("loop",) if len(shape) == 1 else tuple(f"loop_{i}" for i in range(len(shape)))
    swept = {}
    for path, array in arrays.items():
        own = list(zip(dims[len(dims) - array.ndim :], array.shape, strict=True))
        kept = [dim for dim, size in own if size == shape[dims.index(dim)]]
        swept[path] = xarray.Variable(kept, array.reshape([shape[dims.index(dim)] for dim in kept]))
    return Lanes(dims, shape, swept, {})


def _by_name(
    named: Mapping[str, xarray.DataArray], plain: Mapping[str, NDArray[Any]], taken: Sequence[str]
) -> Lanes:
    """Broadcast arrays by the names of their dimensions, as xarray does."""
    import xarray

    parts = [array.to_dataset(name=f"over {i}") for i, array in enumerate(named.values())]
    try:
        merged = xarray.merge(parts, join="exact", compat="minimal")
    except ValueError as error:
        reason = f"the arrays do not fit each other: {str(error).splitlines()[0]}"
        raise InvalidDescription("over", reason) from None
    dims = tuple(dict.fromkeys(str(dim) for array in named.values() for dim in array.dims))
    swept = {path: array.variable.to_base_variable() for path, array in named.items()}
    swept |= {path: xarray.Variable((), array) for path, array in plain.items()}
    coords = {
        str(name): array.variable for name, array in merged.coords.items() if name not in swept
    }
    for path, array in named.items():
        for name in (*map(str, array.dims), *map(str, array.coords)):
            clash = name in taken or name in RESERVED
            if clash or (name in dims and name in swept and swept[name].dims != (name,)):
                raise InvalidDescription(
                    path,
                    f"the name {name!r} of its dimension or coordinate is one of the result's "
                    f"own; rename it, for instance to {name + '_0'!r}",
                )
    return Lanes(dims, tuple(merged.sizes[dim] for dim in dims), swept, coords)
