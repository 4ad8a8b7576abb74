"""`simulate_sampled`: one run of a loop whose controller is sampled, as an `xarray.Dataset`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ..engines.lanes import random
from ..engines.lanes.asked import OUTCOMES, Asked
from ..engines.lanes.difference import check_steps
from ..engines.trajectory import Progress, Trajectory
from ..errors import InvalidDescription, shown
from ..logic import normal, uniform
from ..loop import Loop
from ..simulation import dataset, scenario_text, started
from ..symbols import substituted
from ..system import Oracle, System
from ..validation import positive
from .actuators import Actuator
from .loop import SampledLoop
from .practice import Practice
from .sampling import Sampling
from .sensors import Sensor

if TYPE_CHECKING:
    import xarray

MOST: Final = 2**24
"""Most numbers of the states that are kept where no `samples` are given."""


def simulate_sampled(
    loop: Loop,
    dt: float,
    t_end: float,
    *,
    sensor: Sensor | None = None,
    actuator: Actuator | None = None,
    practice: Practice | None = None,
    seed: int = 0,
    samples: int | None = None,
    title: str = "",
    progress: Progress | None = None,
) -> xarray.Dataset:
    """Run the loop with its controller sampled every `dt` seconds, and return what happened.

    x_{k+1} = f(x_k, p, k dt), the equations that ``print(SampledLoop(…).system)`` shows: at
    t_k = k dt the sensor gives a sample and the controller a command, which is held for dt; between
    the samples the vehicle moves exactly. Without imperfections the run converges to `simulate`'s
    as dt → 0.

    Parameters
    ----------
    loop
        The loop; its vehicle must be linear.
    dt
        Time between two samples (s).
    t_end
        Duration (s), a whole number of samples within a millionth of one.
    sensor, actuator, practice
        `Sensor`, `Actuator` and `Practice`; None for ideal ones and the controller's law alone.
    seed
        Whole number ≥ 0. All random numbers depend on it, on the sample's number and on nothing
        else: the same seed is the same run, here and in `ensemble`.
    samples
        How many equispaced samples are kept, those at 0 and `t_end` among them; samples − 1 must
        divide t_end/dt. None: all, or of long runs as many as 2²⁴ numbers hold.
    title
        Kept in ``attrs["title"]``.
    progress
        Called with the time reached, now and then.

    Returns
    -------
    xarray.Dataset
        ``position(time, axis)`` (m), ``J(time)``, ``sensed(time)``, what the controller received
        (NaN where a sample was lost), ``input(time, axis)``, the newest that reaches the vehicle in
        the sample that begins then (behind a lag, what leaves it at its beginning),
        ``source(time, axis)`` where the field states it, and every state by name.
        Position, J and input carry ``min`` and ``max`` of the samples kept. The attrs are those of
        `simulate`: ``outcome``, ``end_time``, ``end_state``, ``scenario``, …; and ``dt``, ``seed``.

    Raises
    ------
    InvalidDescription
        For what cannot be: dt ≤ 0, fewer than 6 samples in a period of the fastest dither (fewer
        than 20 are warned of), a duration that is no whole number of samples, a vehicle that is not
        linear, a sensor or an actuator that cannot exist, an `Opaque` field.

    Notes
    -----
    The loops are those of Zhang, Siranosian and Krstić (2007), Figs. 1 to 3; zero-order hold as in
    Franklin, Powell and Workman, Digital Control of Dynamic Systems (1998), section 4.3.
    """
    if not isinstance(loop, Loop) or isinstance(loop, SampledLoop):
        reason = "must be a Loop; `simulate` runs a SampledLoop"
        raise InvalidDescription("loop", reason, type(loop).__name__)
    sampling = Sampling(
        dt=dt,
        sensor=Sensor() if sensor is None else sensor,
        actuator=Actuator() if actuator is None else actuator,
        practice=Practice() if practice is None else practice,
        seed=seed,
    )
    return ran(
        SampledLoop.of(loop, sampling), t_end, samples=samples, title=title, progress=progress
    )


def ran(
    loop: SampledLoop,
    t_end: float,
    *,
    samples: int | None = None,
    title: str = "",
    progress: Progress | None = None,
) -> xarray.Dataset:
    """Run a sampled loop; see `simulate_sampled`."""
    from ..engines.simd import integrate

    system, values, dt = loop.system, loop.values, loop.sampling.dt
    duration = positive("t_end", t_end)
    check_steps(duration, dt, 0)
    if any(oracle.table is None for oracle in system.oracles.values()):
        raise InvalidDescription(
            "field",
            "is known by its values only (Opaque), which no sampled loop can run; write it with "
            "field_from or Expression, or put its values on a Grid",
        )
    steps = round(duration / dt)
    parts = _parts(steps, len(system.states)) if samples is None else _count(samples) - 1
    check_steps(duration, dt, parts + 1)
    asked = Asked(system, values, (), np.empty((0, 1)), duration, samples=parts + 1)
    seen = told(system)
    started(seen, values.tolist())
    ended = integrate(asked, progress=progress and (lambda share: progress(share * duration)))
    times = np.arange(parts + 1) * (steps // parts) * dt
    end = float(ended.end_time[0])
    states = ended.samples[:, :, 0]
    reached = np.isfinite(states).all(axis=1) & (times <= end + dt / 2)
    count = len(reached) if reached.all() else int(np.argmin(reached))
    outcome = OUTCOMES[int(ended.outcome[0])]
    run = Trajectory(times[:count], states[:count], outcome, end, ended.states[:, 0])
    outputs = seen.evaluate(run.times, run.states, values.tolist())
    kept = ("position", "J", "input")
    bounds = {name: (outputs[name].min(axis=0), outputs[name].max(axis=0)) for name in kept}
    result = dataset(system, run, outputs, bounds)
    result.attrs |= {
        "title": title,
        "outcome": outcome,
        "end_time": end,
        "end_state": run.end_state,
        "state_names": [str(x) for x in system.states],
        "engine": "sampled",
        "dt": dt,
        "seed": int(loop.sampling.seed),
        "scenario": scenario_text(loop, duration, samples, title),
    }
    return result


def _count(samples: Any) -> int:
    whole = isinstance(samples, int | np.integer) and not isinstance(samples, bool)
    if not whole or samples < 2:
        raise InvalidDescription("samples", "must be a whole number, at least 2", shown(samples))
    return int(samples)


def _parts(steps: int, states: int) -> int:
    """Return into how many equal parts the steps are divided by the samples that are kept."""
    most = max(1, MOST // states)
    if steps <= most:
        return steps
    part = next(part for part in range(most, 0, -1) if steps % part == 0)
    if part < most / 100:
        raise InvalidDescription(
            "t_end",
            f"is {steps:,} samples, of which not every second, third, … can be kept: {steps:,} has "
            "no such divisor; take a rounder duration, or give `samples`",
        )
    return part


@lru_cache(maxsize=64)
def told(system: System) -> System:
    """Return the same equations with random numbers that can be evaluated at any sample.

    normal(seed, i) becomes a function of the seed and the time, by its values.
    """
    assert system.dt is not None
    expressions = [*(e for _, e in system.signals), *system.rhs, *system.initial]
    calls: set[Any] = set().union(*(e.atoms(normal, uniform) for e in expressions))
    oracles = dict(system.oracles)
    table: dict[Expr, Expr] = {}
    for call in calls:
        seed, stream = call.args
        name = f"{type(call).__name__}_{stream}"
        many = _stream(getattr(random, type(call).__name__), int(stream))
        oracles[name] = Oracle(lambda *given, many=many: float(many(*given)), many=many)
        table[call] = sympy.Function(name)(seed, system.time, system.dt)  # pyright: ignore
    return replace(
        system,
        signals=tuple((x, substituted(e, table)) for x, e in system.signals),
        rhs=tuple(substituted(e, table) for e in system.rhs),
        initial=tuple(substituted(e, table) for e in system.initial),
        oracles=oracles,
    )


def _stream(kind: Callable[..., Any], stream: int) -> Callable[..., NDArray[np.float64]]:
    return lambda seed, time, dt: kind(seed, np.rint(time / dt), stream)
