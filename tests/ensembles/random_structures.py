"""Random loops of all kinds that have equations, and a few columns of numbers for each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.random import Generator

import extremum as es
from extremum import pi, s
from extremum.engines.lanes.asked import Asked
from extremum.loop import varied

FORMULAS: Final = (
    "exp(-a*(x - 0.2)**2 - b*u**2/3)",
    "-log(1 + a*x**2 + b*u**2)",
    "log(a + 1.2 + x) - b*(x**2 + u**2)/4",  # leaves at x = −a − 1.2
    "-sqrt(a + x**2 + b*u**2)",
    "sqrt(1.5*a + x) - u**2/5",  # leaves at x = −1.5 a
    "sin(a*x + b*u) - x**2/9",
    "cos(a*x)*cos(b*u + 0.7*t)",
    "cos(a*x*t/3 + b*u)",
    "-tan(a*x/3)**2 - b*u**2",
    "asin(a*tanh(x - b*u)/2) - x**2/7",
    "acos(x/2) - b*u**2/3 - a*x**2",  # leaves at |x| = 2
    "acos(tanh(x)/2)*a + exp(-b*u**2)",
    "-atan(a*x**2 + b*u**2)",
    "atan2(1 + a*x**2, 2 + b*u)",
    "atan2(a*x + sin(t), 2 + b*u**2)",
    "-sinh(a*x)*x - b*u**2",
    "-cosh(a*x/2) - cosh(b*u/3)",
    "tanh(a - x**2) - b*u**2/2",
    "-asinh(a*x)**2 - b*asinh(u)**2",
    "-acosh(1.3 + a*x**2 + b*u**2)",
    "atanh(a*cos(x)/2) - b*u**2/4",
    "atanh(x/2) - a*x**2 - b*u**2",  # escapes or leaves at |x| = 2
    "-(a + x**2 + u**2)**b",
    "(a + x**2 + u**2)**(-b)",
    "-(1 + a*x**2)**(3/2) - b*u**4/(2 + u**2)",
    "(1 + a*x**2)**(-5/2) - b*u**6/(9 + u**4)",
    "(2 + x)**1.7 - a*x**2*2 - b*u**2",  # leaves at x = −2
    "1/(x + 2)**2 - a*x**2 - b*u**2",
    "(1 + x**2/4)**(a*sin(u)) - b*x**2/3",
    "a**x - x**2 - b*u**2 + x**3/9",
    "exp(-t/3)*exp(-a*x**2) - b*u**2*(1 + t)/5",
    "a*x**3/5 - x**2 - b*u**2 + x*u/4",
    "-x**2/(1 + u**2) - b*(u - a*sin(x + t))**2",
    "a*exp(-((x - 0.3)**2 + u**2)) + b*exp(-((x + 0.8)**2 + (u - 0.5)**2)/2)",
    "-sqrt(2)*x**2/pi - b*u**2 + exp(1)*sin(pi*x/4)*a/9",
)
"""J of x, of u, the last axis, of t and of two parameters; see `_expression`."""

VEHICLES: Final = (
    *("1/s",) * 6,
    *("1/s**2",) * 3,
    "1/s**3",
    "1/(s*(s + 0.7))",
    "1/(s**2 + 0.6*s + 4)",
    "1/(s - 0.3)",
    "1/(s + 0.4)",
    "1/(s**2 - 0.2*s)",
    "(s + 2)/(s*(s + 1))",
    "(s + 3)/(s**2 + 1.1*s + 2)",
    "(2*s**2 + s + 5)/(s**3 + 2*s**2 + 3*s)",
)

COMPENSATORS: Final = (
    *(1,) * 6,
    es.Lead(3, -0.5, -4),
    es.Lead(2, -1, -8),
    "(s**2 + 4)/(s**2 + 2*s + 4)",
    "(s + 0.5)/(s + 0.1)",
    es.Rational("k/(T*s + 1)", {"k": 0.8, "T": 0.3}),
    "1/(s*(s + 3))",
)

SENSORS: Final = (
    *(1,) * 5,
    "1/(0.1*s + 1)",
    "400/(s**2 + 16*s + 400)",
    "(1 - 0.02*s)/(1 + 0.02*s)",
    es.Rational("k/(T*s + 1)", {"k": 1.5, "T": 0.7}),
)

RATIOS: Final = {
    1: ((1,), (2,), (1.5,)),
    2: ((1, 1), (1, 2), (2, 3), (Fraction(2, 3), 1), (1, 2**0.5), (4, 5)),
    3: ((1, 1, 2), (4, 5, 7), (Fraction(1, 2), Fraction(2, 3), 1), (1, 1.37, 2)),
}


@dataclass(frozen=True)
class Case:
    """A loop, how long it runs, and the numbers that vary."""

    loop: es.Loop
    t_end: float
    paths: tuple[str, ...]
    columns: np.ndarray

    def asked(self, **options: Any) -> Asked:
        """What an engine is asked."""
        system, values, places = varied(self.loop, self.paths)
        return Asked(system, values, places, self.columns, self.t_end, **options)

    def numbers(self, index: int) -> list[float]:
        """All parameters of one loop."""
        _, values, places = varied(self.loop, self.paths)
        values[list(places)] = self.columns[:, index]
        return values.tolist()


def random_case(seed: int, count: int = 4) -> Case:
    """One structure by chance, and `count` columns for what is swept of it."""
    rng = np.random.default_rng([1862, seed])
    loop = _loop(rng, seed)
    paths = _paths(rng, loop)
    given = np.array([_number(loop, path) for path in paths])[:, None]
    spread = np.array([0.4 if path.startswith("start") else 0.1 for path in paths])[:, None]
    chance = rng.uniform(-1, 1, (len(paths), count))
    moved = np.array([p.startswith(("start", "field.source", "field.field")) for p in paths])
    columns = np.where(moved[:, None], given + spread * chance, given * (1 + spread * chance))
    return Case(loop, between(rng, 1.0, 4.0), tuple(paths), columns)


def between(rng: Generator, low: float, high: float) -> float:
    """A number of three decimals."""
    return round(float(rng.uniform(low, high)), 3)


def chosen(rng: Generator, items: Any) -> Any:
    """One of the items."""
    return items[int(rng.integers(len(items)))]


def _number(loop: es.Loop, path: str) -> float:
    _, values, (place,) = varied(loop, [path])
    return float(values[place])


def _paths(rng: Generator, loop: es.Loop) -> list[str]:
    """Some of the numbers: the start and others by chance."""
    known = [parameter.path for parameter in loop.system.parameters]
    starts = [path for path in known if path.startswith("start")]
    others = [
        path
        for path in known
        if path not in starts and not path.startswith(("vehicle", "sensor", "controller.probe"))
    ]
    more = rng.choice(others, size=min(len(others), int(rng.integers(1, 5))), replace=False)
    phases = ["controller.channels.0.dither.phase"] if rng.random() < 0.2 else []
    return list(dict.fromkeys([*starts, *map(str, more), *phases]))


def _loop(rng: Generator, seed: int) -> es.Loop:
    size = int(rng.choice([1, 2, 2, 3]))
    ratios = chosen(rng, RATIOS[size])
    vehicles = [chosen(rng, VEHICLES) for _ in range(size)]
    frequency = between(rng, 12, 60)
    ramp = between(rng, 0.2, 1.0) if rng.random() < 0.15 else None
    channels = [
        _channel(rng, str(vehicle), axis, ratio, frequency)
        for axis, (vehicle, ratio) in enumerate(zip(vehicles, ratios, strict=True))
    ]
    position = tuple(between(rng, -0.7, 0.7) for _ in range(size))
    vehicle = es.PointMass(
        axes=tuple(vehicles),
        disturbance=_numbers(rng, size, -0.2, 0.2) if rng.random() < 0.25 else None,
    )
    start: Any = position
    if rng.random() < 0.3 and ramp is None:
        start = es.OnDither(position)
    elif rng.random() < 0.2:
        start = {name: between(rng, -0.5, 0.5) for name in vehicle.state_names()}
    return es.Loop(
        field=_field(rng, seed, size),
        vehicle=vehicle,
        controller=es.GradientES(
            frequency=frequency,
            washout=between(rng, 0.5, 3.0),
            channels=tuple(channels),
            washout_start=chosen(rng, ["signal", "signal", "zero", 0.4]),
            probe_ramp=ramp,
        ),
        start=start,
        sensor=chosen(rng, SENSORS),
    )


def _numbers(rng: Generator, size: int, low: float, high: float) -> tuple[float, ...]:
    return tuple(between(rng, low, high) for _ in range(size))


def _channel(
    rng: Generator, vehicle: str, axis: int, ratio: float | Fraction, frequency: float
) -> es.Channel:
    phase = chosen(rng, [0.0, -pi / 2, between(rng, -3, 3)]) if axis == 0 else axis * -pi / 2
    amplitude = between(rng, 0.04, 0.12)
    reference = float(phase) + between(rng, -0.6, 0.6) if rng.random() < 0.3 else None
    dither: Any = es.Dither(amplitude, float(phase))
    if vehicle == "1/(s - 0.3)":
        dither = es.Dither(amplitude, float(phase), through=1 / s)
    elif vehicle == "1/s" and rng.random() < 0.2:
        dither = es.Probe(round(amplitude * frequency, 3), float(phase))
        reference = float(phase) - pi / 2
    wanted = between(rng, 0.3, 3.0) * chosen(rng, [1, 1, 1, 1, -1])
    compensator = chosen(rng, COMPENSATORS)
    if vehicle.startswith("1/s**"):
        compensator = es.Lead(5, -0.5, -6)
    return es.Channel(dither, round(wanted / amplitude, 3), compensator, reference, ratio)


def _field(rng: Generator, seed: int, size: int) -> es.Field:
    """Kinds by turns: every second field is a formula, and every formula has its turn."""
    if seed % 2:
        still: es.Field = _expression(rng, seed // 2, size)
    else:
        still = chosen(rng, [_quadratic, _matrix, _gaussian, _inverse])(rng, size)
    return es.Moving(still, _path(rng, size)) if rng.random() < 0.2 else still


def _quadratic(rng: Generator, size: int) -> es.Field:
    return es.Quadratic(
        _numbers(rng, size, -0.3, 0.3), _numbers(rng, size, 0.3, 1.5), between(rng, -1, 1)
    )


def _matrix(rng: Generator, size: int) -> es.Field:
    rows = np.diag(_numbers(rng, size, 0.3, 1.5))
    for i in range(size):
        for j in range(i):
            rows[i, j] = rows[j, i] = between(rng, -0.9, 0.9)  # a saddle now and then
    return es.Quadratic(_numbers(rng, size, -0.3, 0.3), rows.tolist(), 1.0)


def _gaussian(rng: Generator, size: int) -> es.Field:
    width: Any = chosen(rng, [between(rng, 0.6, 2), _numbers(rng, size, 0.6, 2)])
    return es.Gaussian(_numbers(rng, size, -0.3, 0.3), width, between(rng, 0.5, 2))


def _inverse(rng: Generator, size: int) -> es.Field:
    return es.InverseSquare(
        _numbers(rng, size, -0.3, 0.3), between(rng, 0.5, 2), between(rng, 0.5, 2)
    )


def _expression(rng: Generator, turn: int, size: int) -> es.Field:
    formula = FORMULAS[turn % len(FORMULAS)]
    last = ("x", "y", "z")[size - 1]
    spread = "" if size < 3 else " - y**2/3"
    text = "".join(last if c == "u" else c for c in formula)
    return es.Expression(text + spread, {"a": between(rng, 0.4, 0.9), "b": between(rng, 0.4, 0.9)})


def _path(rng: Generator, size: int) -> es.Path:
    speed, radius = between(rng, 0.3, 2.0), between(rng, 0.1, 0.4)
    plane: tuple[Callable[[], es.Path], ...] = (
        lambda: es.FigureEight(radius, speed, chosen(rng, [3 * pi / 2, 0.3])),
        lambda: es.Circle(radius, chosen(rng, [speed, -speed]), chosen(rng, [0.0, 0.8])),
    )
    anywhere: tuple[Callable[[], es.Path], ...] = (
        lambda: es.Line(_numbers(rng, size, -0.2, 0.2)),
        lambda: es.Along(tuple(f"R*sin({k + 1}*t/3)" for k in range(size)), {"R": radius}),
    )
    return chosen(rng, [*anywhere, *(plane if size == 2 else ())])()
