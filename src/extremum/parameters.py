"""A description's numbers as symbols: the same description, read as equations."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any

import sympy

from .declarations import Meta, Table, declarations, is_matrix
from .description import Description, joined, numbers
from .symbols import axis_names


@dataclass(frozen=True)
class Parameter:
    """A value of a description as a symbol of its equations."""

    symbol: sympy.Symbol
    path: str
    unit: str

    @property
    def latex(self) -> str:
        """The symbol in LaTeX."""
        return sympy.latex(self.symbol)


def symbolic(
    description: Description,
    dimension: int,
    units: Mapping[str, str],
    reserved: frozenset[str] = frozenset(),
    varied: Container[str] = (),
) -> tuple[Any, tuple[Parameter, ...]]:
    """Return the description with symbols for values, and the parameters in `flatten`'s order.

    `dimension` gives the axes their letters, `units` says each axis' input unit, and no symbol
    takes a `reserved` name. The numbers at the `varied` paths are values whatever they are.
    """
    names = _Names(numbers(description, varied), dimension, units, reserved)
    twin = names.twin(description, "", None)
    return twin, tuple(names.parameters)


class _Names:
    """Gives every value its symbol, unique, in the order in which `flatten` lists the values."""

    def __init__(
        self,
        values: Container[str],
        dimension: int,
        units: Mapping[str, str],
        reserved: frozenset[str],
    ) -> None:
        self.values = values
        self.axes = axis_names(dimension)
        self.units = units
        self.parameters: list[Parameter] = []
        self.taken = set(reserved)

    def twin(self, item: Any, path: str, axis: str | None, meta: Meta | None = None) -> Any:
        if isinstance(item, Description):
            copy = object.__new__(type(item))
            for name, inner in declarations(type(item)).items():
                entry = self.twin(getattr(item, name), joined(path, name), axis, inner)
                object.__setattr__(copy, name, entry)
            return copy
        assert meta is not None
        if isinstance(item, tuple):
            return self.entries(item, path, axis, meta)
        if isinstance(item, Table):
            return Table(
                {
                    key: self.symbol(f"{path}.{key}", key, axis, meta)
                    if f"{path}.{key}" in self.values
                    else entry
                    for key, entry in item.items()
                }
            )
        if path in self.values:
            return self.symbol(path, meta.symbol, axis, meta)
        return item

    def entries(self, item: tuple[Any, ...], path: str, axis: str | None, meta: Meta) -> Any:
        if meta.kind == "value" and is_matrix(item, meta):
            size = len(item)
            upper = {
                (i, j): self.symbol(
                    f"{path}.{i}.{j}", meta.symbol, self.axes[i] + self.axes[j], meta
                )
                for i in range(size)
                for j in range(i, size)
            }
            return tuple(
                tuple(upper[min(i, j), max(i, j)] for j in range(size)) for i in range(size)
            )
        of_axes = meta.kind == "value" and axis is None and meta.shape != "coefficients"
        per_axis = of_axes or meta.per_axis
        return tuple(
            self.twin(entry, f"{path}.{i}", self.label(i) if per_axis else axis, meta)
            if per_axis
            else self.twin(entry, f"{path}.{i}", f"{axis or ''}{i}", meta)
            for i, entry in enumerate(item)
        )

    def label(self, index: int) -> str:
        return self.axes[index] if index < len(self.axes) else str(index)

    def symbol(self, path: str, template: str, axis: str | None, meta: Meta) -> sympy.Symbol:
        if "{axis}" in template:
            name = template.format(axis=axis)
        elif axis is not None:
            name = f"{template}{axis}" if template.endswith("_") else f"{template}_{axis}"
        else:
            name = template
        if name in self.taken:
            name = f"{name}_{path.split('.')[0]}"
        count = 2
        while name in self.taken:
            name, count = f"{name.rstrip('0123456789')}{count}", count + 1
        self.taken.add(name)
        symbol = sympy.Symbol(name, real=True, positive=True if meta.positive else None)
        place = int(path.rpartition(".")[2]) if meta.shape == "coefficients" else 0
        per = "1/s" if place == 0 else f"1/s^{place + 1}"
        unit = meta.unit.format(input=self.units.get(axis or "", "1"), per=per)
        self.parameters.append(Parameter(symbol, path, unit))
        return symbol
