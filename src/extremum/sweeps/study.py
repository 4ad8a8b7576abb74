"""Study files: a scenario and what varies, TOML ⇄ `Study`, without loss; see `documents`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ..declarations import is_none
from ..description import Description, part, structure, value
from ..documents import Reader, entries, opened, parsed, table
from ..errors import InvalidDescription, shown
from ..loop import varied
from ..scenario import TOP, Run, Scenario, as_tables, load_scenario, stated
from .axes import Axis, as_axes, choice, texts, whole

METHODS: Final = ("grid", "random", "latin hypercube", "sobol")
MOST: Final = 10**10
MOST_SOBOL: Final = 2**30
MOST_HYPERCUBE: Final = 2**27
PAPER: Final = "paper:"
RESERVED: Final = frozenset(("loop", "jobs", "zarr.json"))
"""Names in a store that no axis may have, besides those of results."""


class Sweep(Description):
    """Which loops a study runs, and what is kept of each.

    Parameters
    ----------
    axes
        Name or dotted path → `Axis`.
    method
        ``"grid"``: every combination of the axes' numbers. ``"random"``: independent draws.
        ``"latin hypercube"`` and ``"sobol"``: draws that fill the axes more evenly
        (`scipy.stats.qmc`).
    loops
        How many draws; a power of two for ``"sobol"``.
    seed
        Decides the draws.
    keep, radius, samples, tol, dtype, device
        As in `ensemble`.
    """

    axes: Mapping[str, Axis] = structure("name or dotted path → Axis", converter=as_axes)
    method: str = structure(
        "grid, random, latin hypercube or sobol", default="grid", converter=choice(*METHODS)
    )
    loops: int | None = structure("how many draws (not grid)", default=None, converter=whole(1))
    seed: int = structure("decides the draws (not grid)", default=0, converter=whole(0))
    keep: tuple[str, ...] = structure("what is kept of every loop", default=(), converter=texts)
    radius: float | None = value(
        "radius",
        "m",
        "settled is closer than this",
        default=None,
        positive=True,
        literal=is_none,
    )
    samples: int | None = structure(
        "positions and J kept along the way", default=None, converter=whole(2)
    )
    tol: float | None = value(
        "tol",
        "1",
        "each step may err by a thirtieth of it, relative to 1 + |x|; 1e-6, in float32 1e-4",
        default=None,
        positive=True,
        literal=is_none,
    )
    dtype: str = structure(
        "float64 or float32", default="float64", converter=choice("float64", "float32")
    )
    device: str = structure("cpu or cuda", default="cpu", converter=choice("cpu", "cuda"))

    def check(self) -> None:
        """Refuse entries that do not fit the method."""
        for name in ("seed", "keep"):
            if getattr(self, name) is None:
                raise InvalidDescription(name, "must not be None; leave it out")
        for name, axis in self.axes.items():
            try:
                self._check_axis(axis)
            except InvalidDescription as error:
                raise error.within(f"axes.{name}") from None
        self._check_loops()
        self._check_paths()

    def _check_axis(self, axis: Axis) -> None:
        if self.method == "grid":
            if axis.values is None and axis.points is None and axis.distribution == "uniform":
                raise InvalidDescription("points", "is missing: how many grid points")
            if axis.distribution != "uniform":
                reason = 'is for methods that draw, such as "random"; a grid has scale = "log"'
                raise InvalidDescription("distribution", reason, shown(axis.distribution))
            return
        if axis.points is not None:
            reason = f'is for method = "grid"; "{self.method}" has loops in [sweep]'
            raise InvalidDescription("points", reason, shown(axis.points))
        if axis.scale != "linear":
            reason = f'is for method = "grid"; "{self.method}" has distribution = "log-uniform"'
            raise InvalidDescription("scale", reason, shown(axis.scale))

    def _check_loops(self) -> None:
        if self.method == "grid":
            if self.loops is not None:
                reason = f"is for methods that draw; this grid has {self.count():,} loops"
                raise InvalidDescription("loops", reason, shown(self.loops))
            if self.count() > MOST:
                reason = f"make {self.count():,} loops, at most {MOST:,} are run; take fewer points"
                raise InvalidDescription("axes", reason)
            return
        loops = self.loops
        if loops is None:
            raise InvalidDescription("loops", f'is missing: method = "{self.method}" draws so many')
        if self.method == "sobol" and loops & (loops - 1):
            below = 2 ** (loops.bit_length() - 1)
            reason = (
                "must be a power of two: only so many of Sobol's points fill every half, quarter … "
                f"of each axis equally; take {below} or {2 * below}"
            )
            raise InvalidDescription("loops", reason, shown(loops))
        most = {"sobol": MOST_SOBOL, "latin hypercube": MOST_HYPERCUBE // len(self.axes)}
        if loops > most.get(self.method, MOST):
            reason = f"must be at most {most.get(self.method, MOST):,} with {self.method!r}"
            others = "" if self.method == "random" else '; "random" has no such limit'
            raise InvalidDescription("loops", reason + others, shown(loops))

    def _check_paths(self) -> None:
        seen: dict[str, str] = {}
        for name in self.axes:
            for path in self.paths(name):
                if path in seen:
                    reason = f"sets {path}, which {seen[path]!r} sets too; one axis a number"
                    raise InvalidDescription(f"axes.{name}", reason)
                seen[path] = name

    def paths(self, name: str) -> tuple[str, ...]:
        """Return the dotted paths that an axis sets."""
        return self.axes[name].paths or (name,)

    def count(self) -> int:
        """Return the number of loops."""
        if self.method != "grid":
            return self.loops or 0
        return math.prod(self.shape())

    def shape(self) -> tuple[int, ...]:
        """Return how many loops lie along each dimension of the results."""
        if self.method != "grid":
            return (self.loops or 0,)
        return tuple(
            len(axis.values) if axis.values is not None else axis.points or 0
            for axis in self.axes.values()
        )

    def ends(self, path: str) -> tuple[float, float] | None:
        """Return the smallest and the largest number at a path, None if no axis sets it."""
        for name, axis in self.axes.items():
            if path in self.paths(name):
                return axis.extremes()
        return None

    def dims(self) -> tuple[str, ...]:
        """Return the names of the results' dimensions: the axes of a grid, else ``loop``."""
        return tuple(self.axes) if self.method == "grid" else ("loop",)


class Study(Description):
    """A scenario and how it varies: the content of a study file.

    Parameters
    ----------
    scenario
        `Scenario`: the loop, and how long it runs.
    sweep
        `Sweep`: which of its numbers vary.
    """

    root = True

    scenario: Scenario = part(Scenario, "the loop, and how long it runs")
    sweep: Sweep = part(Sweep, "which of its numbers vary")

    def check(self) -> None:
        """Refuse axes that the loop does not have, or whose numbers it refuses."""
        from ..ensembles import datasets, lanes

        loop, sweep = self.scenario.loop, self.sweep
        owners = {path: name for name in sweep.axes for path in sweep.paths(name)}
        try:
            system, _, _ = varied(loop, list(owners))
        except InvalidDescription as error:
            name = owners.get(error.path, error.path)
            reason = error.reason if name == error.path else str(error)
            raise InvalidDescription(f"sweep.axes.{name}", reason) from None
        results = {*RESERVED, *lanes.RESERVED, *datasets.taken(system)}
        for name, axis in sweep.axes.items():
            if name in results:
                reason = "is the name of a result; take another, and state its paths"
                raise InvalidDescription(f"sweep.axes.{name}", reason)
            for number in axis.extremes():
                try:
                    loop.replace(dict.fromkeys(sweep.paths(name), number))
                except InvalidDescription as error:
                    raise _refused(error, f"sweep.axes.{name}", axis, number) from None


def _refused(
    error: InvalidDescription, where: str, axis: Axis, number: float
) -> InvalidDescription:
    if axis.mean is None or number in (axis.low, axis.high):
        return InvalidDescription(where, str(error))
    end = "low" if number < axis.mean else "high"
    return InvalidDescription(
        where, f"its normal distribution goes as far as {number:g}; cut it off by {end} ({error})"
    )


_BESIDE = ("scenario", "title", "note", "run", "sweep")


def parse_study(text: str, folder: Path | str = ".") -> Study:
    """Return the study that TOML text states; relative file names are looked up in `folder`.

    ``scenario = "fig4.toml"``, or ``"paper:fig4"``, stands for a scenario's tables; a `title`,
    `note` or `run` beside it replaces the scenario's.

    Raises
    ------
    InvalidDescription
        With the dotted path, the value and what would be right.
    """
    data = parsed(text, ("scenario", "sweep", *TOP))
    sweep = table(data, "sweep")
    rest = {key: entry for key, entry in data.items() if key not in ("sweep", "scenario")}
    try:
        if "scenario" in data:
            scenario = _referred(data["scenario"], rest, Path(folder))
        else:
            scenario = stated(rest, Path(folder))
        return Study(scenario, Reader(Path(folder)).build(Sweep, sweep, "sweep"))
    except RecursionError:
        raise InvalidDescription("", "this study is nested too deeply") from None


def _referred(given: Any, beside: Mapping[str, Any], folder: Path) -> Scenario:
    from ..papers import zhang2007

    if not isinstance(given, str):
        reason = 'must be a file\'s name or "paper:fig4"; its tables stand at the top instead'
        raise InvalidDescription("scenario", reason, shown(given))
    for key in beside:
        if key not in _BESIDE:
            reason = f"is stated by scenario = {given!r} too; leave one of them out"
            raise InvalidDescription(key, reason)
    try:
        if given.startswith(PAPER):
            found = zhang2007.scenario(given.removeprefix(PAPER))
        else:
            found = load_scenario(folder / given)
    except InvalidDescription as error:
        raise InvalidDescription("scenario", str(error), shown(given)) from None
    changes: dict[str, Any] = {key: beside[key] for key in ("title", "note") if key in beside}
    if "run" in beside:
        changes["run"] = Reader(folder).build(Run, table(beside, "run"), "run")
    return found.replace(changes) if changes else found


def load_study(path: Path | str) -> Study:
    """Return the study in a TOML file.

    Raises
    ------
    InvalidDescription
        If the file is missing or unreadable, or states no study.
    """
    return parse_study(*opened(path))


def format_study(study: Study) -> str:
    """Return the study as TOML text; `parse_study` returns an equal one.

    Raises
    ------
    InvalidDescription
        If it is none, or its loop has an `Opaque` field, which no text can state.
    """
    import tomli_w

    return tomli_w.dumps(tables(study))


def tables(study: Study) -> dict[str, Any]:
    """Return the study as nested tables of what TOML can hold."""
    if not isinstance(study, Study):
        reason = "must be a Study: Study(scenario=…, sweep=Sweep(axes=…))"
        raise InvalidDescription("study", reason, type(study).__name__)
    axes = {name: entries(axis) for name, axis in study.sweep.axes.items()}
    rest = {key: entry for key, entry in entries(study.sweep).items() if key != "axes"}
    return {**as_tables(study.scenario), "sweep": {**rest, "axes": axes}}
