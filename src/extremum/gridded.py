"""Measured fields: values on a grid, interpolated smoothly."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from .description import structure
from .errors import InvalidDescription, shown, suggestion
from .fields import Field
from .symbols import axis_names, is_coordinate
from .system import Oracle, Table

MIN_POINTS: Final = 4
PACKAGED: Final = "matplotlib:"


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Grid:
    """Values J on the product of one axis per coordinate; immutable, equal by content.

    Parameters
    ----------
    axes
        Coordinates (m) of the grid lines, one strictly monotonic array per axis, at least four.
    values
        J, of shape (len(axes[0]), len(axes[1]), …); all finite.
    origin
        The table of a scenario file that reads this grid, if it came from a file.

    Raises
    ------
    InvalidDescription
        For axes that are not monotonic or too short, values that do not fit them, or NaN.
    """

    axes: tuple[NDArray[np.float64], ...]
    values: NDArray[np.float64]
    origin: Mapping[str, Any] | None

    def __init__(
        self, axes: Sequence[Any], values: Any, origin: Mapping[str, Any] | None = None
    ) -> None:
        if isinstance(axes, str) or not hasattr(axes, "__len__") or not len(axes):
            raise InvalidDescription("axes", "must be one array per coordinate", shown(axes))
        lines = [_numbers(axis, f"axes.{i}", 1) for i, axis in enumerate(axes)]
        table = _numbers(values, "values", len(lines))
        for index, line in enumerate(lines):
            _check_axis(line, axis_names(len(lines))[index], table.shape[index])
            if line[0] > line[-1]:
                lines[index], table = line[::-1], np.flip(table, index)
        bad = ~np.isfinite(table)
        if bad.any():
            first = tuple(int(i) for i in np.argwhere(bad)[0])
            raise InvalidDescription(
                "values",
                f"{int(bad.sum())} of {bad.size} are NaN or infinite, the first at index {first}; "
                "fill or cut them first",
            )
        object.__setattr__(self, "axes", tuple(_frozen(line) for line in lines))
        object.__setattr__(self, "values", _frozen(table))
        object.__setattr__(self, "origin", MappingProxyType(dict(origin)) if origin else None)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the axes and values."""
        digest = hashlib.sha256()
        for array in (*self.axes, self.values):
            digest.update(repr(array.shape).encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Grid) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        size = " × ".join(str(n) for n in self.values.shape)
        return f"Grid({size}, {self.origin['file'] if self.origin else self.digest[:8]})"

    @cached_property
    def spline(self) -> Any:
        """The tensor product of cubic splines (C², not-a-knot) through the values."""
        from scipy.interpolate import NdBSpline, make_interp_spline

        knots, coefficients = [], self.values
        for index, line in enumerate(self.axes):
            fitted = make_interp_spline(line, coefficients, k=3, axis=index)
            knots.append(fitted.t)
            coefficients = np.moveaxis(fitted.c, 0, index)
        return NdBSpline(tuple(knots), np.ascontiguousarray(coefficients), 3)

    def table(self) -> dict[str, Any]:
        """Return the table that a scenario holds: the file it came from, or the numbers."""
        if self.origin is not None:
            return {**self.origin, "digest": self.digest}
        names = axis_names(len(self.axes))
        lines = {name: line.tolist() for name, line in zip(names, self.axes, strict=True)}
        return {**lines, "values": self.values.tolist()}


class Gridded(Field):
    """J measured on a grid, interpolated by C² cubic splines; it is not extrapolated.

    A run that reaches the grid's edge ends with the outcome ``"left the data"``.

    Parameters
    ----------
    grid
        A `Grid`, an `xarray.DataArray` with a coordinate for each dimension (dimensions x, y, z
        in any order), a file's path, or a table as in a scenario file (`read_grid`).
    """

    grid: Grid = structure("the data: numbers, or a file", converter=lambda given: as_grid(given))

    def check(self) -> None:
        """Refuse data whose interpolation overflows."""
        try:
            self.grid.spline  # noqa: B018
        except (ValueError, np.linalg.LinAlgError):
            raise InvalidDescription(
                "grid", "its numbers are too large or too close together to be interpolated"
            ) from None

    def dimension(self) -> int:
        """Return the number of axes."""
        return len(self.grid.axes)

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return f(p) with f left undefined."""
        return sympy.Function("f")(*p)

    def oracles(self) -> Mapping[str, Oracle]:
        """Return the spline under the name f, with the grid's bounds."""
        spline = self.grid.spline

        def asked(*arguments: float) -> float:
            return float(spline(arguments))

        def many(*arguments: Any) -> Any:
            return spline(np.stack(np.broadcast_arrays(*arguments), axis=-1))

        lower, upper = (tuple(float(a[i]) for a in self.grid.axes) for i in (0, -1))
        table = Table(self.grid.axes, self.grid.values)
        return {"f": Oracle(asked, lower, upper, many, table)}


def as_grid(given: Any) -> Grid:
    """Return a `Grid` from a grid, a DataArray, a path or a scenario's table."""
    if isinstance(given, Grid):
        return given
    if isinstance(given, str | Path):
        return read_grid({"file": str(given)})
    if isinstance(given, Mapping):
        return read_grid(given)
    if hasattr(given, "dims") and hasattr(given, "coords"):
        return _from_data_array(given)
    raise InvalidDescription(
        "", "must be a Grid, an xarray.DataArray, a path or a table", shown(given)
    )


def read_grid(table: Mapping[str, Any]) -> Grid:
    """Return the grid that a scenario's table states.

    Either the numbers themselves: ``x``, ``y``, … and ``values``. Or a file:

    - ``file``: NetCDF (``.nc``), ``.npz`` or CSV (a header, then one row per grid point with the
      columns x, y, … and the value); ``matplotlib:NAME`` is a file of matplotlib's sample data.
    - ``variable``: its variable, array or column; may be left out where there is only one.
    - ``dims``: which axis each dimension of the array is, such as ``["y", "x"]`` (npz and NetCDF;
      default x, y, z in order, or the dimensions' own names if they are x, y, z).
    - ``coordinates``: the arrays with the coordinates, in the order of the axes (npz; default the
      axes' names); or ``spacing``: the distance (m) of the lines per axis, negative where the
      file's order runs against the axis, with the first corner at 0.
    - ``digest``: SHA-256 of the content, checked if given.
    """
    if "file" not in table:
        return _inline(table)
    path = _located(table["file"])
    if path.suffix.lower() not in _READERS:
        raise InvalidDescription("file", "must end in .nc, .npz or .csv", shown(table["file"]))
    reader, special = _READERS[path.suffix.lower()]
    known = {"file", "variable", "digest", *special}
    for key in table:
        if key not in known:
            reason = f"is no entry for a {path.suffix} file; {suggestion(key, known)}"
            raise InvalidDescription(key, reason)
    try:
        axes, values = reader(path, table)
    except InvalidDescription:
        raise
    except Exception as error:  # a broken file may raise anything that its reader knows
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InvalidDescription("file", f"cannot be read: {reason}", repr(str(path))) from None
    origin = {key: item for key, item in table.items() if key != "digest"}
    grid = Grid(axes, values, origin)
    if table.get("digest", grid.digest) != grid.digest:
        raise InvalidDescription(
            "digest", f"differs from the file's, {grid.digest}: the data have changed"
        )
    return grid


def _inline(table: Mapping[str, Any]) -> Grid:
    names = [name for name in table if name != "values"]
    if "values" not in table or tuple(sorted(names)) != axis_names(len(names)):
        raise InvalidDescription(
            "", "must name a file, or give x, y, … and values", shown(sorted(table))
        )
    return Grid([table[name] for name in sorted(names)], table["values"])


def _located(file: Any) -> Path:
    if not isinstance(file, str):
        raise InvalidDescription("file", "must be text", shown(file))
    if file.startswith(PACKAGED):
        import matplotlib

        name = file.removeprefix(PACKAGED)
        folder = Path(matplotlib.get_data_path()) / "sample_data"
        path = folder / Path(name).name
    else:
        path = Path(file)
    if not path.is_file():
        raise InvalidDescription("file", "there is no such file", repr(file))
    return path


def _read_npz(path: Path, table: Mapping[str, Any]) -> tuple[list[Any], Any]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    names = [n for n, array in arrays.items() if array.ndim > 1 or n == table.get("variable")]
    variable = _variable(table, names)
    values = arrays[variable]
    dims = _dims(table, values.ndim)
    values = np.transpose(values, [dims.index(a) for a in axis_names(values.ndim)])
    if "spacing" in table:
        return _spaced(table["spacing"], values)
    wanted = table.get("coordinates", list(axis_names(values.ndim)))
    listed = isinstance(wanted, list | tuple) and len(wanted) == values.ndim
    if not listed or not all(isinstance(name, str) and name in arrays for name in wanted):
        raise InvalidDescription(
            "coordinates",
            f"must name {values.ndim} arrays of the file ({', '.join(sorted(arrays))}), or give "
            "`spacing`",
            shown(wanted),
        )
    return [arrays[name] for name in wanted], values


def _spaced(spacing: Any, values: NDArray[Any]) -> tuple[list[Any], Any]:
    good = isinstance(spacing, list | tuple) and len(spacing) == values.ndim
    if not good or not all(isinstance(d, int | float) and d and np.isfinite(d) for d in spacing):
        raise InvalidDescription(
            "spacing", f"must be {values.ndim} finite numbers other than 0", shown(spacing)
        )
    axes = []
    for index, step in enumerate(spacing):
        line = np.arange(values.shape[index]) * abs(float(step))
        axes.append(line if step > 0 else line[::-1])
    return axes, values


def _read_csv(path: Path, table: Mapping[str, Any]) -> tuple[list[Any], Any]:
    with path.open(encoding="utf-8-sig") as file:
        if not file.readline().strip():
            raise InvalidDescription("file", "is empty", shown(str(path)))
        file.seek(0)
        rows = np.genfromtxt(file, delimiter=",", names=True, ndmin=1)
    if rows.dtype.names is None:
        raise InvalidDescription("file", "must begin with a header x,y,…,value", shown(str(path)))
    columns = list(rows.dtype.names)
    coordinates = [
        name for name in columns if is_coordinate(name) and name != table.get("variable")
    ]
    if len(coordinates) == len(columns) > 1:  # x, y, z: altitude over the plane
        coordinates.pop()
    variable = _variable(table, [name for name in columns if name not in coordinates])
    if not coordinates:
        raise InvalidDescription("file", "must have columns x, y, …", shown(columns))
    axes = [np.unique(rows[name]) for name in sorted(coordinates)]
    shape = tuple(len(axis) for axis in axes)
    if int(np.prod(shape)) != len(rows):
        raise InvalidDescription(
            "file",
            f"has {len(rows)} rows for a grid of {' × '.join(map(str, shape))}: one row for each "
            "grid point is needed",
        )
    places = tuple(
        np.searchsorted(a, rows[name]) for a, name in zip(axes, sorted(coordinates), strict=True)
    )
    values = np.full(shape, np.nan)
    values[places] = rows[variable]
    return axes, values


def _read_netcdf(path: Path, table: Mapping[str, Any]) -> tuple[list[Any], Any]:
    import xarray

    with xarray.open_dataset(path) as dataset:
        variable = _variable(table, [str(name) for name in dataset.data_vars])
        array = dataset[variable].load()
    if "dims" in table:
        array = array.rename(dict(zip(array.dims, _dims(table, array.ndim), strict=True)))
    grid = _from_data_array(array)
    return list(grid.axes), grid.values


def _from_data_array(given: Any) -> Grid:
    dims = [str(dim) for dim in given.dims]
    for dim in given.dims:
        if dim not in given.coords:
            raise InvalidDescription(str(dim), "this dimension has no coordinate")
    names = axis_names(len(dims))
    if set(dims) != set(names):
        raise InvalidDescription(
            "dims",
            f"are {', '.join(dims)}; say which axis each one is, dims = {list(names)} in some "
            f"order, or rename them to {', '.join(names)}",
        )
    given = given.transpose(*names)
    return Grid([np.asarray(given.coords[dim]) for dim in given.dims], np.asarray(given))


_READERS: Final = {
    ".npz": (_read_npz, ("dims", "coordinates", "spacing")),
    ".csv": (_read_csv, ()),
    ".nc": (_read_netcdf, ("dims",)),
}


def _variable(table: Mapping[str, Any], names: list[str]) -> str:
    if "variable" not in table:
        if len(names) != 1:
            raise InvalidDescription("variable", f"must be one of {', '.join(names)}")
        return names[0]
    variable = table["variable"]
    if variable not in names:
        raise InvalidDescription(
            "variable", f"is not in the file; {suggestion(str(variable), names)}", shown(variable)
        )
    return variable


def _dims(table: Mapping[str, Any], count: int) -> list[str]:
    names = axis_names(count)
    dims = table.get("dims", list(names))
    if not isinstance(dims, list | tuple) or sorted(map(str, dims)) != sorted(names):
        raise InvalidDescription("dims", f"must be {', '.join(names)} in some order", shown(dims))
    return list(dims)


def _numbers(given: Any, path: str, dimensions: int) -> NDArray[np.float64]:
    try:
        raw = np.asarray(given)
        if raw.dtype.kind not in "biuf" and not (raw.dtype.kind == "O" and raw.size == 0):
            raise TypeError
        array = raw.astype(float)
    except (ValueError, TypeError):
        raise InvalidDescription(
            path, "must be an array of real numbers", " ".join(shown(given).split())
        ) from None
    if array.ndim != dimensions:
        raise InvalidDescription(path, f"must have {dimensions} dimension(s), it has {array.ndim}")
    return array


def _check_axis(line: NDArray[np.float64], name: str, count: int) -> None:
    if len(line) != count:
        raise InvalidDescription(
            name, f"has {len(line)} coordinates for {count} values along that axis"
        )
    if len(line) < MIN_POINTS:
        raise InvalidDescription(
            name,
            f"has {len(line)} grid line(s); a C² interpolation needs at least {MIN_POINTS}",
        )
    steps = np.diff(line)
    if not np.isfinite(line).all() or not ((steps > 0).all() or (steps < 0).all()):
        raise InvalidDescription(name, "must be finite and strictly monotonic; sort the axis")


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
