"""A system's states and outputs along a path, as an `xarray.Dataset`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..symbols import axis_names
from ..system import System

if TYPE_CHECKING:
    import xarray


def labelled(
    system: System,
    times: NDArray[np.float64],
    states: NDArray[np.float64],
    values: Sequence[float],
    attrs: Mapping[str, Any],
) -> xarray.Dataset:
    """Return every output over (time, axis), J over time, and every state, with units."""
    import xarray

    outputs = system.evaluate(times, states, values)
    units = {"input": ", ".join(system.units[symbol] for symbol in system.inputs), "J": "1"}
    variables: dict[str, Any] = {}
    for name, output in outputs.items():
        unit = {"units": units.get(name, "m")}
        flat = name == "J"
        variables[name] = ("time", output[:, 0], unit) if flat else (("time", "axis"), output, unit)
    for symbol, state in zip(system.states, states.T, strict=True):
        variables[str(symbol)] = ("time", state, {"units": system.units[symbol]})
    axes = list(axis_names(outputs["position"].shape[1]))
    coordinates = {"time": ("time", times, {"units": "s"}), "axis": axes}
    return xarray.Dataset(variables, coordinates, dict(attrs))
