"""Random design problems as plain dictionaries, from easy to infeasible.

Both sides are built from them: the package's `Requirements`, and the oracle's loops in `checked`.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

import extremum as es

KINDS: Final = {
    "1/s": "1/s",
    "1/s^2": "1/s**2",
    "1/(s(s + d))": "1/(s*(s + d))",
    "1/(s - eps)": "1/(s - epsilon)",
}
"""Vehicles by name, as `es.Rational` reads them."""
MAX_LAGS: Final = 2
MAX_AXES: Final = 3


def random_requirements(seed: int) -> dict[str, Any]:
    """Return one problem's numbers, three significant digits each.

    One to three axes by turns, most with the same dynamics on all. An axis has ``kind``, ``lags``
    (time constants, s) and ``pole``, the range of ε or d (1/s): often one point, mostly so with
    three axes, as every range doubles the corners at which a design looks. An input limit, where
    there is one, is what the full dither would take at some frequency from 5 to 300 rad/s.
    """
    rng = np.random.default_rng([2007, 4, seed])

    def between(low: float, high: float) -> float:
        return neat(rng.uniform(low, high))

    def spread(low: float, high: float) -> float:
        return neat(low * (high / low) ** rng.random())

    def chance(probability: float) -> bool:
        return bool(rng.random() < probability)

    size = 1 + seed % MAX_AXES

    def axis() -> dict[str, Any]:
        kind = str(rng.choice(list(KINDS)))
        low, high = sorted((between(0, 1), between(0, 1)))
        if chance(0.5):
            low = 0.0
        if kind == "1/(s(s + d))":
            low = spread(0.2, 3.0)
            high = neat(low * spread(1.1, 4.0))
        if chance(0.8 if size == MAX_AXES else 0.4):
            low = high
        lags = [spread(0.01, 0.1) for _ in range(int(rng.integers(MAX_LAGS + 1)))]
        return {"kind": kind, "lags": lags, "pole": (low, high)}

    alike = chance(0.6)
    axes = [axis() for _ in range(size)]
    if alike:
        axes = axes[:1] * size
    curvature = []
    for _ in range(size):
        low = spread(0.2, 2.0)
        curvature.append((low, neat(low * spread(1.0, 10.0))))
    least = min(low for low, _ in curvature)
    numbers: dict[str, Any] = {
        "seed": seed,
        "axes": axes,
        "curvature": tuple(curvature),
        "coupling": neat(between(0.05, 0.3) * least) if size > 1 and chance(0.1) else 0.0,
        "dither_limit": spread(0.02, 0.3),
        "settling_time": spread(1.0, 20.0),
        "bandwidth": None,
        "source_distance": spread(0.1, 3.0) if chance(0.7) else 0.0,
        "start_distance": spread(0.1, 3.0) if chance(0.5) else 0.0,
        "force": spread(0.02, 1.0) if chance(0.4) else 0.0,
        "zero_bias": not chance(0.15),
        "input_limit": None,
        "frequency_limit": spread(10.0, 300.0) if chance(0.25) else None,
        "motion": None,
        "quadrature": not chance(0.1),
    }
    if chance(0.25):
        fastest = spread(5.0, 300.0)
        pushes = [numbers["dither_limit"] / passed(axis, fastest) for axis in axes]
        numbers["input_limit"] = neat(max(pushes) + numbers["force"])
    if chance(0.07):
        numbers["motion"] = "ramp"
    elif chance(0.07):
        numbers["motion"] = spread(0.05, 0.5)
    if chance(0.05):
        numbers["bandwidth"], numbers["settling_time"] = spread(0.2, 3.0), None
    return numbers


def passed(axis: dict[str, Any], frequency: float) -> float:
    """Return about |G(jω)|, what an axis makes of a fast unit input."""
    order = 1 if axis["kind"] in ("1/s", "1/(s - eps)") else 2
    lags = [float(np.hypot(1.0, tau * frequency)) for tau in axis["lags"]]
    return 1.0 / float(frequency**order * np.prod(lags))


def neat(number: float) -> float:
    """Return a number with three digits, so that both sides read the same one."""
    return float(f"{number:.3g}")


def vehicle(numbers: dict[str, Any]) -> es.PointMass:
    """Return the nominal vehicle: the unknown poles at the low ends of their ranges."""
    laws = []
    for axis in numbers["axes"]:
        lags = {f"tau_{k + 1}": tau for k, tau in enumerate(axis["lags"])}
        parameters = dict(lags)
        if axis["kind"] == "1/(s - eps)":
            parameters["epsilon"] = axis["pole"][0]
        elif axis["kind"] == "1/(s(s + d))":
            parameters["d"] = axis["pole"][0]
        text = "".join([KINDS[axis["kind"]], *(f"/({name}*s + 1)" for name in lags)])
        laws.append(es.Rational(text, parameters=parameters))
    return es.PointMass(axes=tuple(laws))


def requirements(numbers: dict[str, Any]) -> es.Requirements:
    """Return the package's statement of a problem."""
    names = {"1/(s - eps)": "epsilon", "1/(s(s + d))": "d"}
    uncertain = {
        f"vehicle.axes.{i}.parameters.{names[axis['kind']]}": axis["pole"]
        for i, axis in enumerate(numbers["axes"])
        if axis["kind"] in names and axis["pole"][0] < axis["pole"][1]
    }
    motion = numbers["motion"]
    if motion == "ramp":
        motion = es.Ramp()
    elif motion is not None:
        motion = es.Periodic(frequency=motion)
    kept = (
        *("curvature", "coupling", "dither_limit", "settling_time", "bandwidth"),
        *("source_distance", "start_distance", "force", "zero_bias", "input_limit"),
        *("frequency_limit", "quadrature"),
    )
    return es.Requirements(
        vehicle=vehicle(numbers),
        uncertain=uncertain,
        motion=motion,
        **{name: numbers[name] for name in kept},
    )
