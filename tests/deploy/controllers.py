"""Controllers with every option of practice: each pair of options meets in at least one of them."""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import numpy as np
from loops import force_actuated, velocity_actuated
from numpy.typing import NDArray

import extremum as es
from extremum import pi, s

DT = 1e-3


def three_frequencies() -> es.Loop:
    """Return a loop of three axes with frequencies 2 : 3 : 5 and a probe that ramps up."""
    channels = tuple(
        es.Channel(dither=es.Dither(0.05, phase=phase), gain=3.0, ratio=ratio)
        for phase, ratio in ((0.3, 2), (0, 3), (-pi / 2, 5))
    )
    return es.Loop(
        field=es.Quadratic(source=(0, 0, 0), q=(1.0, 0.5, 0.7)),
        vehicle=es.PointMass(axes=(1 / s, 1 / s, 1 / s)),
        controller=es.GradientES(frequency=9, washout=1.0, channels=channels, probe_ramp=0.5),
        start=(1, 1, 1),
    )


LOOPS = {"velocity": velocity_actuated, "force": force_actuated, "three": three_frequencies}
SIZES = {"velocity": 2.4, "force": 90.0, "three": 2.25}
"""Of the largest probe (m/s, or m/s²)."""
FULL = {"low": -40.0, "high": 40.0, "stuck": 0.1, "timeout": 0.05, "fade": 0.3}

LOG = es.LogScale(floor=0.01)
SHRINKING = es.ShrinkingDither(full=1.0, least=0.2, shrink=3.0, grow=2.0, response=2.5)

OPTIONS: dict[str, dict[str, Any]] = {
    "loop": LOOPS,
    "scale": {
        "none": {},
        "log": {"scale": LOG},
        "running": {"scale": es.RunningScale(time=2.0, floor=0.05)},
        "shrinking": {"dither": SHRINKING},
        "log-shrinking": {"scale": LOG, "dither": SHRINKING},
    },
    "limits": {  # in sizes of the largest probe
        "none": {},
        "bounds": {"low": -0.9, "high": 1.1},
        "rate": {"high": 1.5, "rate": 25.0},
    },
    "validity": {"plain": es.Validity(), "full": FULL},
    "detector": {
        "none": None,
        "detector": es.Detector(level=0.2, time=1.0, response=2.5, background=-5.0),
    },
    "changes": {"none": None, "changes": es.Changes(time=0.7)},
    "late": {"no": {}, "late": {"delay": 2e-3, "lag": 1e-2}},
}


def pairwise(options: dict[str, Any]) -> list[dict[str, str]]:
    """Return choices in which every two options meet in every way; greedy, always the same."""
    names = list(options)
    open_pairs = {
        (a, x, b, y) for a, b in combinations(names, 2) for x, y in product(options[a], options[b])
    }
    rows: list[dict[str, str]] = []
    while open_pairs:
        a, x, b, y = min(open_pairs)
        row = {a: x, b: y}
        for name in names:
            if name not in row:
                row[name] = max(
                    options[name],
                    key=lambda z: sum(
                        (p, row[p], name, z) in open_pairs or (name, z, p, row[p]) in open_pairs
                        for p in row
                    ),
                )
        open_pairs -= {(p, row[p], q, row[q]) for p, q in product(names, repeat=2)}
        rows.append(row)
    return rows


def controller(row: dict[str, str]) -> es.DiscreteController:
    """Return the controller of a choice."""
    chosen = {name: OPTIONS[name][row[name]] for name in OPTIONS}
    loop = chosen["loop"]()
    inputs = loop.controller.inputs()
    size = SIZES[row["loop"]]
    limits = {name: (size * number,) * inputs for name, number in chosen["limits"].items()}
    validity = chosen["validity"]
    if isinstance(validity, dict):
        validity = es.Validity(**validity, safe=tuple(0.25 * i for i in range(inputs)))
    practice = es.Practice(
        limits=es.Limits(**limits) if limits else None,
        validity=validity,
        detector=chosen["detector"],
        changes=chosen["changes"],
        **chosen["scale"],
        **chosen["late"],
    )
    return es.discretize(loop.controller, DT, vehicle=loop.vehicle, practice=practice)


CHOICES = pairwise(OPTIONS)
PLAIN = {name: next(iter(options)) for name, options in OPTIONS.items()}


def named(row: dict[str, str]) -> str:
    """Return a choice as the name of a test."""
    return "-".join(row[name] for name in OPTIONS if row[name] not in ("none", "no", "plain"))


def samples(count: int, seed: int, wild: bool = True) -> NDArray[np.float64]:
    """Return a signal with noise, dropouts, and bursts of what is no sample.

    All of them are numbers of single precision too; `wild` adds numbers that are not, and a sensor
    that is stuck.
    """
    random = np.random.default_rng(seed)
    time = DT * np.arange(count)
    noise = 0.02 * random.standard_normal(count)
    signal = 1.5 + 0.4 * np.sin(30 * time + 0.3) + 0.5 * np.sin(0.5 * time) + noise
    signal = signal.astype(np.float32).astype(np.float64)
    signal[random.random(count) < 0.02] = np.nan
    odd = [np.nan, np.inf, -np.inf, 1e25, -1e25]
    if wild:
        odd += [1e300, -1.7e308, 5e-324, 3e17, -0.0, 0.0]
    for begin in random.integers(0, count, max(count // 1000, 3)):
        signal[begin : begin + random.integers(1, 400)] = random.choice(odd)
    if wild:
        signal[count // 3 : count // 3 + 300] = 1.25
    return signal
