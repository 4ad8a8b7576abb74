"""A result that is written to a Zarr store block by block, as one chunk each."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidDescription, shown
from .datasets import OUTCOMES, Column
from .lanes import Lanes
from .regions import Region

if TYPE_CHECKING:
    import xarray
    import zarr

FLAGS: Final = {"flag_values": [-1, 0, 1, 2], "flag_meanings": f"not_run {OUTCOMES}"}
"""What the outcomes mean where some loops may not have been run."""


class Store:
    """Writes a result to a new Zarr store (format 3), which is there once its first block is.

    Until a block is written its outcome is −1 and its numbers are NaN.

    Raises
    ------
    InvalidDescription
        For coordinates that no store can hold, before anything is written.
    """

    def __init__(
        self,
        path: Path,
        lanes: Lanes,
        chunk: tuple[int, ...],
        columns: list[Column],
        coords: Mapping[str, xarray.Variable],
        attrs: Mapping[str, Any],
    ) -> None:
        self.path, self.lanes, self.chunk, self.columns = path, lanes, chunk, columns
        self.attrs, self.group = _plain(attrs), None
        self.labels = {n: v.copy(deep=True) for n, v in coords.items() if v.dtype.kind == "U"}
        self.coords = {name: _storable(variable) for name, variable in coords.items()}
        for name, variable in self.coords.items():
            _check_storable(name, variable)

    def write(self, region: Region, block: Mapping[str, NDArray[Any]]) -> None:
        """Write a block's chunks."""
        with _writing(self.path):
            if self.group is None:
                self.group = self._begun(region, block)
            else:
                self._put(self.group, region, block)

    def finished(self, attrs: Mapping[str, Any]) -> xarray.Dataset:
        """Return the store, opened lazily."""
        import xarray

        assert self.group is not None
        with _writing(self.path):
            self.group.attrs.update(_plain(attrs))
        opened = xarray.open_zarr(self.path, chunks=None, consolidated=False)
        return opened.assign_coords(self.labels)[[column.name for column in self.columns]]

    def _begun(self, region: Region, block: Mapping[str, NDArray[Any]]) -> zarr.Group:
        """Make the store with its first block: whole, or not at all."""
        import zarr

        half = self.path.with_name(f".{self.path.name}.part")
        try:
            self._put(self._empty(half), region, block)
            half.rename(self.path)
        finally:
            shutil.rmtree(half, ignore_errors=True)
        return zarr.open_group(self.path, mode="r+")

    def _empty(self, folder: Path) -> zarr.Group:
        import xarray
        import zarr

        known = xarray.Dataset(coords=self.coords, attrs=self.attrs)
        known.to_zarr(folder, mode="w", zarr_format=3, consolidated=False)
        group = zarr.open_group(folder, mode="r+")
        for column in self.columns:
            flags = FLAGS if column.name == "outcome" else {}
            group.create_array(
                column.name,
                shape=(*self.lanes.shape, *column.shape),
                chunks=(*self.chunk, *column.shape),
                dtype=column.dtype,
                fill_value=-1 if column.dtype == "int8" else float("nan"),
                dimension_names=(*self.lanes.dims, *column.dims),
                attributes=_plain({**column.attrs, **flags}),
            )
        return group

    def _put(self, group: zarr.Group, region: Region, block: Mapping[str, NDArray[Any]]) -> None:
        for column in self.columns:
            values = column.shaped(block[column.name], region)
            cast(Any, group[column.name])[(*region, ...)] = values


def new(into: Any) -> Path:
    """Return the path of a store that can be made."""
    if not isinstance(into, str | Path) or not str(into):
        raise InvalidDescription("into", "must be the path of a new Zarr store", shown(into))
    path = Path(into)
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        if path.parent.is_dir():
            return path
        raise InvalidDescription("into", f"there is no folder {path.parent}", str(path)) from None
    except (OSError, ValueError) as error:
        reason = f"cannot be the path of a store: {_reason(error)}"
        raise InvalidDescription("into", reason, shown(into)) from None
    raise InvalidDescription("into", "exists already; remove it or choose another", str(path))


def _storable(variable: xarray.Variable) -> xarray.Variable:
    """Return a coordinate with text as Zarr's format 3 has it: of any length."""
    return variable.astype(object) if variable.dtype.kind == "U" else variable.drop_encoding()


def _check_storable(name: str, variable: xarray.Variable) -> None:
    """Refuse a coordinate that does not come back from a store as it was.

    Tried in memory with some entries, or with all where their types may differ.
    """
    import xarray
    from zarr.storage import MemoryStore

    first = {} if variable.dtype.kind == "O" else dict.fromkeys(variable.dims, slice(100))
    tried = variable[first].to_base_variable()
    store = MemoryStore()
    try:
        data = xarray.Dataset({name: (tried.dims, tried.data, tried.attrs)})
        data.to_zarr(store, zarr_format=3, consolidated=False)
        back = xarray.open_zarr(store, chunks=None, consolidated=False).variables
        reason = "" if name in back and back[name].equals(tried) else "it is read back otherwise"
    except Exception as error:  # whatever xarray and zarr raise for what they cannot hold
        reason = _reason(error)
    if reason:
        raise InvalidDescription(
            "into",
            f"the coordinate {name!r}, of {variable.dtype}, cannot be stored ({reason}); rename "
            "it, make it numbers or text without attrs, or leave it out with drop_vars",
        )


def _plain(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes as JSON can hold them."""
    arrays = np.ndarray | np.generic
    return {k: v.tolist() if isinstance(v, arrays) else v for k, v in attrs.items()}


def _reason(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, TypeError, ValueError) as error:
        raise InvalidDescription("into", f"cannot be written: {error}", str(path)) from error
