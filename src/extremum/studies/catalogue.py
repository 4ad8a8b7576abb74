"""The studies by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from ..errors import InvalidDescription, suggestion

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

NAMES: Final = ("basin", "gain-frequency", "unknown-curvature", "cloud")


@dataclass(frozen=True)
class Ready:
    """A study that is ready to run.

    Attributes
    ----------
    title
        What it shows.
    loops, least
        How many loops it runs unless told otherwise, and at least.
    study
        ``study(loops, progress=None)`` → `xarray.Dataset`, with ``title`` and ``finding`` in its
        attrs.
    figure
        Dataset → figure.
    animate
        ``animate(dataset, path, progress=None)`` writes a GIF; None where there is none.
    """

    title: str
    loops: int
    least: int
    study: Callable[..., xarray.Dataset]
    figure: Callable[[xarray.Dataset], Figure]
    animate: Callable[..., None] | None


def ready(name: str) -> Ready:
    """Return a study by name.

    Raises
    ------
    InvalidDescription
        For an unknown name, with the nearest known one.
    """
    if name not in NAMES:
        raise InvalidDescription("", f"there is no study {name!r}; {suggestion(name, NAMES)}")
    module: Any = import_module(f".{name.replace('-', '_')}", __package__)
    return Ready(
        title=module.TITLE,
        loops=module.LOOPS,
        least=module.LEAST,
        study=module.study,
        figure=module.figure,
        animate=getattr(module, "animate", None),
    )
