"""Zarr stores that are written region by region: each region whole, or not at all.

A store is a folder in the format of Zarr, version 3. Its metadata are complete before it has its
name; a region's chunks are encoded in a folder of their own and renamed into their places; what is
rewritten is renamed over what was there. Whatever ends the process, even SIGKILL or a full disk,
leaves a store that can be read and gone on with.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Hashable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from .errors import InvalidDescription, shown

if TYPE_CHECKING:
    import xarray
    import zarr

METADATA: Final = "zarr.json"
JOBS: Final = "jobs"
"""A group inside the store, for what is needed only until it is complete."""


def create(
    store: Path,
    growing: xarray.Dataset,
    sizes: Mapping[str, int],
    chunks: Mapping[str, int],
    whole: xarray.Dataset,
) -> None:
    """Create a store: empty arrays for what is still to be computed, and what is known already.

    Parameters
    ----------
    store
        Its folder, which must not exist.
    growing
        Variables of one region, of any size: their names, dtypes, dimensions and attributes.
    sizes
        Dimension → its length in the store, for those that grow.
    chunks
        Dimension → length of a chunk; any other dimension has one chunk.
    whole
        What is written at once. Its attributes are the store's.

    Raises
    ------
    InvalidDescription
        If it exists, or cannot be written.
    """
    import zarr

    half = store.with_name(f".{store.name}.part")
    coordinates = [
        str(name) for data in (growing, whole) for name in data.coords if name not in data.dims
    ]
    attrs = {key: plain(item) for key, item in whole.attrs.items()}
    with _writing(store):
        try:
            shutil.rmtree(half, ignore_errors=True)
            attrs |= {"coordinates": " ".join(coordinates)} if coordinates else {}
            group = zarr.open_group(half, mode="w-", zarr_format=3, attributes=attrs)
            zarr.open_group(half / JOBS, mode="w-", zarr_format=3)
            for name, variable in growing.variables.items():
                _array(group, str(name), variable, sizes, chunks)
            for name, variable in whole.variables.items():
                array = _array(group, str(name), variable, {}, {})
                array[...] = np.asarray(variable.values)
            half.rename(store)
        finally:
            shutil.rmtree(half, ignore_errors=True)


def _array(
    group: zarr.Group,
    name: str,
    variable: xarray.Variable,
    sizes: Mapping[str, int],
    chunks: Mapping[str, int],
) -> zarr.Array[Any]:
    dims = [str(dim) for dim in variable.dims]
    shape = tuple(sizes.get(dim, variable.sizes[dim]) for dim in dims)
    kind = variable.dtype.kind
    fill = {"f": np.nan, "i": -1}.get(kind)
    return group.create_array(
        name,
        shape=shape,
        chunks=tuple(max(1, chunks.get(d, n)) for d, n in zip(dims, shape, strict=True)),
        dtype="str" if kind in "UTO" else variable.dtype,
        fill_value=fill,
        dimension_names=dims,
        attributes={str(key): plain(item) for key, item in variable.attrs.items()},
    )


def plain(item: Any) -> Any:
    """Return an attribute as JSON can hold it."""
    if isinstance(item, np.ndarray | np.generic):
        return item.tolist()
    return [plain(entry) for entry in item] if isinstance(item, list | tuple) else item


def put(store: Path, part: xarray.Dataset, region: Mapping[str, slice], name: str) -> None:
    """Write one region's results: its chunks appear when all of them are on the disk.

    Parameters
    ----------
    store
        A store that `create` made.
    part
        The region's variables; those without one of its dimensions are left as they are.
    region
        Dimension → indices, which must be whole chunks.
    name
        The region's name, for the folder in which it is prepared.

    Raises
    ------
    InvalidDescription
        If it cannot be written: a full disk, a read-only store.
    """
    with _writing(store), prepared(store, name) as place:
        for variable in part.variables:
            if set(region) & set(map(str, part[variable].dims)):
                _encode(store, place, part[variable], region)
        for chunk in place.rglob("c/**/*"):
            if chunk.is_file():
                target = store / chunk.relative_to(place)
                target.parent.mkdir(parents=True, exist_ok=True)
                chunk.replace(target)


def _encode(
    store: Path, place: Path, values: xarray.DataArray, region: Mapping[str, slice]
) -> None:
    import zarr

    folder = place / str(values.name)
    folder.mkdir()
    shutil.copyfile(store / str(values.name) / METADATA, folder / METADATA)
    array = zarr.open_array(folder, mode="r+")
    dims: tuple[Hashable, ...] = tuple(array.metadata.dimension_names or ())  # pyright: ignore
    index = tuple(region.get(str(dim), slice(None)) for dim in dims)
    array[index] = values.transpose(*dims).values


@contextmanager
def prepared(store: Path, name: str) -> Iterator[Path]:
    """Yield a folder inside the store, and remove it afterwards."""
    place = Path(tempfile.mkdtemp(prefix=f"{name}.", suffix=".part", dir=store / JOBS))
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)


def write_text(store: Path, target: Path, text: str) -> None:
    """Write a file of the store, whole or not at all."""
    with _writing(store):
        handle, name = tempfile.mkstemp(suffix=".part", dir=store / JOBS)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(name, 0o644)
            os.replace(name, target)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def attributes(store: Path) -> dict[str, Any]:
    """Return a store's attributes.

    Raises
    ------
    InvalidDescription
        If it is no Zarr store of version 3, or cannot be read.
    """
    return _metadata(store).get("attributes") or {}


def _metadata(store: Path) -> dict[str, Any]:
    try:
        data = json.loads((store / METADATA).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError):
        if not store.exists():
            raise InvalidDescription("", f"there is no {store}") from None
        kind = "a folder, but no store of Zarr 3" if store.is_dir() else "a file"
        raise InvalidDescription("", f"{store} is {kind}; choose another name") from None
    except OSError as error:
        raise InvalidDescription("", f"cannot read {store}: {error.strerror}") from None
    if not isinstance(data, dict) or data.get("node_type") != "group":
        reason = f"{store} is one array of Zarr 3, no group; choose another name"
        raise InvalidDescription("", reason)
    return data


def set_attributes(store: Path, changes: Mapping[str, Any]) -> None:
    """Change a store's attributes, all of them or none."""
    data = _metadata(store)
    data["attributes"] = {**(data.get("attributes") or {}), **changes}
    write_text(store, store / METADATA, json.dumps(data, indent=2))


def opened(store: Path) -> xarray.Dataset:
    """Return a store's dataset; its numbers are read when they are used."""
    import xarray

    return xarray.open_zarr(store, chunks=None, consolidated=False)


@contextmanager
def _writing(store: Path) -> Iterator[None]:
    """Say what the file system refused, and of which store."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or shown(error)
        raise InvalidDescription("", f"cannot write {store}: {reason}") from None
