"""What the studies share: how many loops, what a result carries, figures without a run."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engines.trajectory import Progress
from ..errors import InvalidDescription, shown

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def counted(loops: Any, least: int) -> int:
    """Return a number of loops.

    Raises
    ------
    InvalidDescription
        If it is no whole number, or less than the study needs.
    """
    whole = isinstance(loops, int | np.integer) and not isinstance(loops, bool)
    if not whole or loops < least:
        reason = f"must be a whole number, at least {least:,} for this study"
        raise InvalidDescription("loops", reason, shown(loops))
    return int(loops)


def side(loops: int, maps: int = 1) -> int:
    """Return the side of `maps` square maps that are made of at most so many loops."""
    return math.isqrt(loops // maps)


def part(progress: Progress | None, index: int, parts: int) -> Callable[[float], object] | None:
    """Return the progress of one of several equal parts as progress of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress((index + fraction) / parts)


def packed(found: xarray.Dataset, **attrs: Any) -> xarray.Dataset:
    """Return a dataset with further attrs, its results as 4-byte numbers that files compress."""
    for name, variable in found.data_vars.items():
        if variable.dtype == np.float64:
            found[name] = variable.astype(np.float32)
        found[name].encoding = {"zlib": True, "complevel": 4}
    return found.assign_attrs(**attrs)


def empty_figure(found: xarray.Dataset, width: float, height: float) -> Figure:
    """Return a figure with the study's title."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    text = textwrap.fill(found.attrs["title"], int(12 * width))
    figure.suptitle(text, fontsize=11, parse_math=False)
    return figure


def key(figure: Figure, axes: Axes, columns: int) -> None:
    """Name below the panels what one of them shows."""
    handles, texts = axes.get_legend_handles_labels()
    figure.legend(
        *(handles, texts),
        loc="outside lower center",
        ncols=columns,
        fontsize=9,
        frameon=False,
    )
