"""A result that is written to a Zarr store block by block, as one chunk each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidDescription, shown
from .datasets import Column
from .lanes import Lanes
from .regions import Region

if TYPE_CHECKING:
    import xarray


class Store:
    """Writes a result to a new Zarr store (format 3).

    Until a block is written its outcome is −1 and its numbers are NaN.
    """

    def __init__(
        self,
        path: Path,
        lanes: Lanes,
        chunk: tuple[int, ...],
        columns: list[Column],
        coords: Mapping[str, xarray.Variable],
    ) -> None:
        import xarray
        import zarr

        self.path, self.columns = path, columns
        self.labels = {n: v for n, v in coords.items() if v.dtype.kind == "U"}
        stored = {name: _storable(variable) for name, variable in coords.items()}
        try:
            xarray.Dataset(coords=stored).to_zarr(
                path, mode="w-", zarr_format=3, consolidated=False
            )
            self.group = zarr.open_group(path, mode="r+")
            for column in columns:
                self.group.create_array(
                    column.name,
                    shape=(*lanes.shape, *column.shape),
                    chunks=(*chunk, *column.shape),
                    dtype=column.dtype,
                    fill_value=-1 if column.dtype == "int8" else float("nan"),
                    dimension_names=(*lanes.dims, *column.dims),
                    attributes={name: _plain(entry) for name, entry in column.attrs.items()},
                )
        except OSError as error:
            raise _unwritable(path, error) from None

    def write(self, region: Region, block: Mapping[str, NDArray[Any]]) -> None:
        """Write a block's chunks."""
        try:
            for column in self.columns:
                values = column.shaped(block[column.name], region)
                cast(Any, self.group[column.name])[(*region, ...)] = values
        except OSError as error:
            raise _unwritable(self.path, error) from None

    def finished(self, attrs: Mapping[str, Any]) -> xarray.Dataset:
        """Return the store, opened lazily."""
        import xarray

        self.group.attrs.update({name: _plain(entry) for name, entry in attrs.items()})
        opened = xarray.open_zarr(self.path, chunks=None, consolidated=False)
        return opened.assign_coords(self.labels)[[column.name for column in self.columns]]


def new(into: Any) -> Path:
    """Return the path of a store that can be made."""
    if not isinstance(into, str | Path) or not str(into):
        raise InvalidDescription("into", "must be the path of a new Zarr store", shown(into))
    path = Path(into)
    if path.exists():
        raise InvalidDescription("into", "exists already; remove it or choose another", str(path))
    if not path.parent.is_dir():
        raise InvalidDescription("into", f"there is no folder {path.parent}", str(path))
    return path


def _storable(variable: xarray.Variable) -> xarray.Variable:
    """Return a coordinate with text as Zarr's format 3 has it: of any length."""
    return variable.astype(object) if variable.dtype.kind == "U" else variable.drop_encoding()


def _plain(entry: Any) -> Any:
    return entry.tolist() if isinstance(entry, np.ndarray | np.generic) else entry


def _unwritable(path: Path, error: OSError) -> InvalidDescription:
    return InvalidDescription("into", f"cannot be written: {error}", str(path))
