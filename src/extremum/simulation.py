"""`simulate`: one run of a loop, as an `xarray.Dataset`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .engines import taylor
from .engines.choice import ENGINES, usual
from .engines.trajectory import COMPLETED, LEFT, UNDEFINED, Progress, Trajectory
from .errors import InvalidDescription, shown
from .extremes import extremes
from .loop import Loop, checked
from .scenario import Run, Scenario, format_scenario
from .symbols import axis_names
from .system import System
from .validation import positive

if TYPE_CHECKING:
    import xarray

TOLERANCE: Final = 1e-12
MIN_SAMPLES: Final = 2000
MAX_SAMPLES: Final = 20_000_000
SAMPLES_PER_PERIOD: Final = 20
DENSE_PER_PERIOD: Final = 40


def simulate(
    loop: Loop,
    t_end: float,
    *,
    samples: int | ArrayLike | None = None,
    tol: float = TOLERANCE,
    engine: str | None = None,
    title: str = "",
    progress: Progress | None = None,
) -> xarray.Dataset:
    """Integrate the loop from t = 0 to `t_end` and return what happened.

    ẋ = f(x, p, t), the equations that ``print(loop.system)`` shows. An unstable loop may run to
    infinity in finite time, or leave a gridded field's data: the run then ends there, cleanly.

    Parameters
    ----------
    loop
        The loop. A `SampledLoop` is run as `simulate_sampled` does; its `samples` are a number, and
        `tol` and `engine` are not for it.
    t_end
        Duration (s).
    samples
        How many equispaced samples, t = 0 and `t_end` among them, or the times themselves
        (increasing, in 0 … t_end). By default 2000 or 20 for each period of the fastest dither,
        whichever is more.
    tol
        Tolerance of each step; the default makes every figure right to 1e-8.
    engine
        ``"taylor"`` (heyoka), ``"reference"`` (SciPy's DOP853), or None to choose: the reference
        serves opaque and gridded fields, and platforms without heyoka.
    title
        Kept in ``attrs["title"]``.
    progress
        Called with the time reached, now and then.

    Returns
    -------
    xarray.Dataset
        ``position(time, axis)`` (m), ``J(time)``, ``input(time, axis)``, ``source(time, axis)``
        where the field states it, and every state by name, with units. Position, J and input carry
        ``min`` and ``max`` in their attrs, taken between the samples too. The dataset's attrs hold
        ``outcome`` (``"completed"``, ``"escaped"`` or ``"left the data"``), ``end_time`` and
        ``end_state`` (the last finite state, in the order ``state_names``), ``scenario`` (the text
        that reproduces the run, if the loop can be written), ``engine`` and ``tol``. Every number
        in it is finite.

    Raises
    ------
    InvalidDescription
        If `t_end`, `samples`, `tol` or `engine` cannot be right, or the field has no value at the
        start.
    """
    if isinstance(loop, Loop) and loop.sampled:
        return _sampled(loop, t_end, samples, tol, engine, title, progress)
    times = _times(checked(loop), t_end, samples)
    tol, t_end = positive("tol", tol), positive("t_end", t_end)
    if not 1e-16 < tol < 1e-1:
        raise InvalidDescription("tol", "must lie between 1e-16 and 0.1", shown(tol))
    system, values = loop.system, loop.values.tolist()
    name = _engine(system, engine)
    start = started(system, values)
    integrate = ENGINES[name].integrate
    dense, wanted = _dense(times, system.fastest_period(values))
    whole = integrate(system, values, dense, tol=tol, state=start, progress=progress)
    run, outputs = _cut(system, values, whole)

    def again(segment: NDArray[np.float64], state: NDArray[np.float64]) -> NDArray[np.float64]:
        part = integrate(system, values, segment, tol=tol, state=state)
        padding = len(segment) - len(part.states)
        return np.concatenate([part.states, np.repeat(part.states[-1:], padding, axis=0)])

    judged = {name: outputs[name] for name in ("position", "J", "input")}
    bounds = extremes(system, values, run, judged, again)
    if len(dense) > len(times):
        kept = wanted[wanted < len(run.times)]
        run = replace(run, times=run.times[kept], states=run.states[kept])
        outputs = {name: output[kept] for name, output in outputs.items()}
    result = dataset(system, run, outputs, bounds)
    result.attrs |= {
        "title": title,
        "outcome": run.outcome,
        "end_time": run.end_time,
        "end_state": run.end_state,
        "state_names": [str(x) for x in system.states],
        "engine": name,
        "tol": tol,
        "scenario": scenario_text(loop, t_end, samples, title),
    }
    return result


def _sampled(
    loop: Loop, t_end: Any, samples: Any, tol: Any, engine: Any, title: str, progress: Any
) -> xarray.Dataset:
    from .sampled.simulating import ran

    for name, given, usual_one in (("tol", tol, TOLERANCE), ("engine", engine, None)):
        if given != usual_one:
            reason = "is for continuous loops: a sampled one is stepped exactly; leave it out"
            raise InvalidDescription(name, reason, shown(given))
    return ran(loop, t_end, samples=samples, title=title, progress=progress)  # pyright: ignore


def _times(loop: Loop, t_end: float, samples: Any) -> NDArray[np.float64]:
    end = positive("t_end", t_end)
    if samples is None:
        period = loop.system.fastest_period(loop.values.tolist()) or np.inf
        samples = max(MIN_SAMPLES, math.ceil(SAMPLES_PER_PERIOD * end / period) + 1)
        if samples > MAX_SAMPLES:
            raise InvalidDescription(
                "t_end",
                f"is {end / period:.3g} periods of the dither, which takes more than the "
                f"{MAX_SAMPLES:,} samples that are kept; give `samples`",
                repr(end),
            )
    if isinstance(samples, int | np.integer) and not isinstance(samples, bool):
        if not 2 <= samples <= MAX_SAMPLES:
            raise InvalidDescription(
                "samples", f"must lie between 2 and {MAX_SAMPLES:,}", shown(int(samples))
            )
        return np.linspace(0.0, end, int(samples))
    try:
        times = np.asarray(samples, dtype=float)
    except (TypeError, ValueError):
        times = np.empty(0)
    good = times.ndim == 1 and len(times) > 1 and np.isfinite(times).all()
    if not good or (np.diff(times) <= 0).any() or times[0] < 0 or times[-1] > end:
        raise InvalidDescription(
            "samples", "must be a number or increasing times in 0 … t_end", shown(samples)
        )
    return times if times[0] == 0 else np.concatenate(([0.0], times))


def _dense(
    times: NDArray[np.float64], period: float | None
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return times at which extremes can be seen, and where the wanted ones are among them."""
    gaps = np.diff(times)
    step = period / DENSE_PER_PERIOD if period else np.inf
    parts = np.maximum(1, np.ceil(gaps / step - 1e-9)).astype(int)
    if parts.sum() > MAX_SAMPLES:
        parts[:] = 1
    first = np.concatenate(([0], np.cumsum(parts)))
    fraction = (np.arange(first[-1]) - np.repeat(first[:-1], parts)) / np.repeat(parts, parts)
    inside = np.repeat(times[:-1], parts) + fraction * np.repeat(gaps, parts)
    return np.append(inside, times[-1]), first


def _engine(system: System, engine: str | None) -> str:
    if engine is None:
        return usual(system)
    if not isinstance(engine, str) or engine not in ENGINES:
        raise InvalidDescription("engine", f"must be one of {', '.join(ENGINES)}", shown(engine))
    if engine == "taylor" and not taylor.available():
        raise InvalidDescription(
            "engine", 'cannot be "taylor": heyoka is not installed; leave it out, or install it'
        )
    if engine == "taylor" and system.oracles:
        raise InvalidDescription(
            "engine", 'cannot be "taylor": the field is known by its values only; leave it out'
        )
    return engine


def started(system: System, values: list[float]) -> list[float]:
    """Return the state at t = 0, and refuse one at which the field has no value."""
    try:
        state = [float(x) for x in system.start(values)]
        if system.guards:
            margin = min(system.margins(0.0, state, values))
            if margin < 0:
                raise InvalidDescription(
                    "start", f"lies {-margin:g} m outside the field's data; start inside"
                )
        outputs = system.evaluate(np.zeros(1), np.array([state]), values)
        outputs.pop("sensed", None)  # a sample may be lost
        defined = all(np.isfinite(o).all() for o in (state, *outputs.values()))
    except InvalidDescription:
        raise
    except UNDEFINED:
        defined, state = False, []
    if not defined:
        raise InvalidDescription(
            "start", "the field has no finite value there; start where it has one"
        )
    return state


def _cut(
    system: System, values: list[float], run: Trajectory
) -> tuple[Trajectory, dict[str, NDArray[np.float64]]]:
    """Return the run up to where every output is finite, and the outputs."""
    outputs = system.evaluate(run.times, run.states, values)
    if all(np.isfinite(o).all() for o in outputs.values()):
        return run, outputs
    finite = np.logical_and.reduce([np.isfinite(o).all(axis=1) for o in outputs.values()])
    count = int(np.argmin(finite))
    times, states = run.times[:count], run.states[:count]
    outcome = LEFT if run.outcome == COMPLETED else run.outcome
    shorter = Trajectory(times, states, outcome, float(times[-1]), states[-1])
    return shorter, {name: o[:count] for name, o in outputs.items()}


def dataset(
    system: System,
    run: Trajectory,
    outputs: dict[str, NDArray[np.float64]],
    bounds: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> xarray.Dataset:
    """Return a run's outputs and states, with units; `bounds` are outputs' extremes."""
    import xarray

    units = [system.units[symbol] for symbol in system.inputs]
    described = {
        "position": ("m", "position", {}),
        "J": ("1", "value of the field", {}),
        "sensed": ("1", "what the controller receives", {}),
        "input": (
            units[0] if len(set(units)) == 1 else ", ".join(units),
            "input",
            {"names": [str(symbol) for symbol in system.inputs]},
        ),
        "source": ("m", "source", {}),
    }
    variables: dict[str, xarray.Variable] = {}
    for name, (unit, long_name, more) in described.items():
        if name in outputs:
            column, dims = outputs[name], ("time", "axis")
            attrs: dict[str, Any] = {"units": unit, "long_name": long_name, **more}
            if name in bounds:
                attrs["min"], attrs["max"] = bounds[name]
            if name in ("J", "sensed"):
                column, dims = column[:, 0], ("time",)
            if name == "J":
                attrs["min"], attrs["max"] = attrs["min"][0], attrs["max"][0]
            variables[name] = xarray.Variable(dims, column, attrs, fastpath=True)
    for symbol, state in zip(system.states, run.states.T, strict=True):
        attrs = {"units": system.units[symbol], "long_name": f"state {symbol}"}
        variables[str(symbol)] = xarray.Variable(("time",), state, attrs, fastpath=True)
    axes = list(axis_names(outputs["position"].shape[1]))
    time = xarray.Variable(("time",), run.times, {"units": "s", "long_name": "time"}, fastpath=True)
    return xarray.Dataset(variables, {"time": time, "axis": axes})


def scenario_text(loop: Loop, t_end: float, samples: Any = None, title: str = "") -> str:
    """Return the scenario's text, empty if the loop cannot be written."""
    run = Run(t_end=t_end, samples=samples if isinstance(samples, int) else None)
    try:
        return format_scenario(Scenario(loop=loop, run=run, title=title))
    except InvalidDescription:
        return ""  # an Opaque field: no text can state it
