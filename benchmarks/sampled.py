"""The sampled controller: one step, one loop, and ten thousand noisy loops."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np
import sampled_rivals as rivals
from numpy.typing import NDArray
from report import Table, Target, Times, figure, interleaved

import extremum as es
from extremum.papers import zhang2007

DT = 1e-3
SAMPLES = 20_000
GAIN = "controller.channels.0.gain"
SIGMA = 0.6
"""Standard deviation of the noise on J, a sample."""

AGREE = 1e-9
"""How near all must come to each other, or the comparison means nothing."""


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    yield steps(3 if quick else 15)
    yield loops(3 if quick else 15)
    yield monte_carlo(quick)


def fig4() -> es.Loop:
    """Return Fig. 4, its washout begun at the first sample."""
    return zhang2007.scenario("fig4").loop.replace({"controller.washout_start": "signal"})


def guarded() -> es.Practice:
    """Return a practice with most of what there is."""
    return es.Practice(
        validity=es.Validity(low=-100, high=2, stuck=0.2, timeout=1),
        limits=es.Limits(low=(-8, -8), high=(8, 8), rate=(400, 400)),
        dither=es.ShrinkingDither(full=0.1, least=0.2, shrink=5, grow=1, response=1),
        detector=es.Detector(level=0.05, time=2, response=1),
        changes=es.Changes(time=1),
    )


def discrete(practice: es.Practice | None = None) -> es.DiscreteController:
    """Return Fig. 4's controller at 1 kHz."""
    loop = fig4()
    return es.discretize(loop.controller, DT, practice=practice, vehicle=loop.vehicle)


# --- one step ----------------------------------------------------------------------------------


def steps(rounds: int) -> Table:
    """Time one step of the controller against what one writes by hand."""
    samples = np.random.default_rng(1).normal(-1, 1, SAMPLES).tolist()
    made: dict[str, Callable[[], rivals.Step]] = {
        "extremum": lambda: _stepping(discrete(), samples[0]),
        "extremum, guarded": lambda: _stepping(discrete(guarded()), samples[0]),
        "floats, by hand": lambda: rivals.plain(DT, samples[0]),
        "NumPy arrays, by hand": lambda: rivals.arrays(DT, samples[0]),
        "scipy.signal.lfilter": lambda: rivals.filtered(DT, samples[0]),
        "python-control": lambda: rivals.discrete_system(DT, samples[0]),
    }
    ours = _sent(made["extremum"](), samples[:2000])
    for name, make in made.items():
        if "guarded" not in name:
            apart = float(np.abs(_sent(make(), samples[:2000]) - ours).max())
            assert apart < AGREE, f"{name} differs by {apart:g}"
    runs = {name: _feeding(make(), samples) for name, make in made.items()}
    runs["extremum"] = _stepping_on(discrete(), samples)
    runs["extremum, guarded"] = _stepping_on(discrete(guarded()), samples)
    taken = interleaved(runs, rounds, clock=time.process_time)
    times = {
        name: Times(tuple(second / SAMPLES for second in t.seconds)) for name, t in taken.items()
    }
    python = times["extremum"].median
    return Table(
        "One step of Fig. 4's controller, two axes, double precision",
        ("", "median (µs)", "range (µs)", "× extremum"),
        [
            (
                name,
                figure(t.median * 1e6),
                f"{figure(min(t.seconds) * 1e6)} – {figure(max(t.seconds) * 1e6)}",
                figure(t.median / python),
            )
            for name, t in times.items()
        ],
        [
            f"{SAMPLES} samples a run. All send the same within {AGREE:g}; those by hand look at",
            "no sample: a NaN stays in them. guarded: range, stuck sensor, timeout, limits, rates,",
            "anti-windup, shrinking dither, detector, live changes.",
        ],
        [Target("ctrl.step in Python, two axes", python * 1e6, 3.0, "µs")],
        {"times": {name: t.data() for name, t in times.items()}},
    )


def _stepping(controller: es.DiscreteController, first: float) -> rivals.Step:
    state = controller.init(first)

    def step(sample: float) -> tuple[float, ...]:
        nonlocal state
        sent, state = controller.step(state, sample)
        return sent

    return step


def _stepping_on(controller: es.DiscreteController, samples: list[float]) -> Callable[[], Any]:
    def run() -> None:
        step, state = controller.step, controller.init(samples[0])
        for sample in samples:
            _, state = step(state, sample)

    return run


def _feeding(step: rivals.Step, samples: list[float]) -> Callable[[], Any]:
    def run() -> None:
        for sample in samples:
            step(sample)

    return run


def _sent(step: rivals.Step, samples: list[float]) -> NDArray[np.float64]:
    return np.array([step(sample) for sample in samples])


# --- one loop ----------------------------------------------------------------------------------


def loops(rounds: int) -> Table:
    """Time 4 s of Fig. 4 at 1 kHz against the same loop by hand, positions at every sample."""
    loop, number, gains = fig4(), round(4 / DT), count(1)

    def ours(gain: float) -> NDArray[np.float64]:
        return es.simulate_sampled(loop.replace({GAIN: gain}), DT, 4.0).position.values

    entries: dict[str, Callable[[float], NDArray[np.float64]]] = {
        "extremum simulate_sampled": ours,
        "floats, by hand": lambda gain: rivals.floats_loop(DT, number, gain),
        "NumPy arrays, by hand": lambda gain: rivals.arrays_loop(DT, number, gain),
        "solve_ivp between samples": lambda gain: rivals.between_samples(DT, number, gain),
    }
    reference = rivals.floats_loop(DT, number, 10.0)
    errors = {name: float(np.abs(run(10.0) - reference).max()) for name, run in entries.items()}
    assert max(errors.values()) < AGREE, errors
    runs: dict[str, Callable[[], object]] = {
        name: lambda run=run: run(10 + 1e-6 * next(gains)) for name, run in entries.items()
    }
    often = {"extremum simulate_sampled": 10}
    slow = runs.pop("solve_ivp between samples")
    times = interleaved(runs, rounds, often, time.process_time)
    times |= interleaved({"solve_ivp between samples": slow}, 2, clock=time.process_time)
    base = times["extremum simulate_sampled"].median
    return Table(
        "Fig. 4 sampled at 1 kHz, 4 s, positions at all 4001 samples",
        ("", "apart", "median CPU (ms)", "range (ms)", "× extremum"),
        [
            (name, f"{errors[name]:.0e}", *t.text(), figure(t.median / base))
            for name, t in times.items()
        ],
        [
            "A new gain in every run; ours returns the whole Dataset, and makes its equations from",
            "the description each time. apart: from the loop over floats, the largest of all.",
        ],
        [],
        {"times": {name: t.data() for name, t in times.items()}},
    )


# --- ten thousand ------------------------------------------------------------------------------


def monte_carlo(quick: bool) -> Table:
    """Run 10,000 loops of 15,000 noisy samples, and the same in NumPy over the loops."""
    number, duration = 10_000, 15.0
    share = 10 if quick else 1
    loop = fig4()
    noisy = es.SampledLoop(
        field=loop.field,
        vehicle=loop.vehicle,
        controller=loop.controller,
        start=loop.start,
        sampling=es.Sampling(dt=DT, sensor=es.Sensor(noise=SIGMA)),
    )
    seeds = {"sampling.seed": np.arange(number)}

    def ours(threads: int | None) -> NDArray[np.float64]:
        return es.ensemble(noisy, duration, over=seeds, threads=threads).position.values.T

    ours(1)
    rival = "NumPy over the loops, one core"
    runs: dict[str, Callable[[], NDArray[np.float64]]] = {
        "extremum, all cores": lambda: ours(None),
        "extremum, one core": lambda: ours(1),
        rival: lambda: rivals.many(number // share, round(duration / DT), DT, SIGMA),
    }
    spread: dict[str, NDArray[np.float64]] = {}

    def keeping(name: str) -> Callable[[], None]:
        def run() -> None:
            spread[name] = runs[name]().std(axis=1)

        return run

    timed: dict[str, Callable[[], object]] = {name: keeping(name) for name in runs}
    wall = {"extremum, all cores": timed.pop("extremum, all cores")}
    times = interleaved(wall, 5)
    times |= interleaved(
        timed, 1 if quick else 3, {"extremum, one core": 5}, clock=time.process_time
    )
    times[rival] = Times(tuple(second * share for second in times[rival].seconds))
    base = times["extremum, one core"].median
    exact = [float(np.sqrt(10 * SIGMA**2 * DT / (4 * 0.08 * q))) for q in (1.0, 0.5)]
    return Table(
        f"Noise: {number} loops of {round(duration / DT)} samples, σ = {SIGMA:g} on J",
        ("", "σ of x (m)", "of y", "median (s)", "range (s)", "ns a step", "× extremum, one core"),
        [
            (
                name,
                *(f"{s:.3f}" for s in spread[name]),
                *t.text("s"),
                figure(t.median / number / round(duration / DT) * 1e9),
                figure(t.median / base),
            )
            for name, t in times.items()
        ],
        [
            "All cores: wall time; one core: CPU time. Random numbers: ours by seed, sample and",
            "stream, in every lane the same whatever runs beside it; NumPy's Philox and normals.",
            f"Closed form, √(c σ² dt/(4 α q)): {exact[0]:.3f} and {exact[1]:.3f} m."
            + (f" NumPy ran a {share}th of the loops." if share > 1 else ""),
        ],
        [
            Target(
                "10,000 noisy loops, 15 s at 1 kHz", times["extremum, all cores"].median, 3, "s"
            ),
        ],
        {
            "times": {name: t.data() for name, t in times.items()},
            "spread": {name: s.tolist() for name, s in spread.items()},
        },
    )
