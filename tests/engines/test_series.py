"""Recorded power series against mpmath, from derivatives in 60 digits."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import pytest
import sympy
import tapes

from extremum.engines.lanes.reading import Plain
from extremum.engines.lanes.series import Powers, Series, SeriesReading
from extremum.engines.lanes.tape import LOOP, STEP, Tape
from extremum.symbols import FUNCTIONS, parse, t

ORDER = 12

POLYNOMIALS = {"x": (0.37, -0.8, 0.5, 0.21, -0.4, 0.03), "y": (0.52, 0.3, -0.6, 0.1)}
"""x and y as series in θ."""

RATE, WAVE, BEGUN = 1.7, 2.3, 0.6
"""t = BEGUN + θ RATE; w = WAVE."""


def series_of(text: str) -> list[float]:
    """The coefficients that are recorded for a formula in x, y, t, a and w."""
    tape = Tape()
    names = dict(zip("xyaw", sympy.symbols("x y a w", real=True), strict=True))
    a, w = (tape.leaf("value", i, LOOP) for i in range(2))
    unit, time = tape.constant(RATE), tape.leaf("time", 0, STEP)
    zero = tape.constant(0.0)
    frequencies: list[Any] = []

    def waves(frequency: Any) -> Powers:
        if frequency not in powers:
            angle = tape.multiply(constants.read(frequency), unit)
            beginning = [tape.leaf(n, len(frequencies), STEP) for n in ("sine", "cosine")]
            powers[frequency] = Powers(tape, angle, (beginning[0], beginning[1]))
            frequencies.append(frequency)
        return powers[frequency]

    powers: dict[Any, Powers] = {}
    known = {names["a"]: a, names["w"]: w}
    constants = Plain(tape, known, t, frozenset(known), lambda _: (zero, zero))
    bound = {
        names[n]: Series(lambda k, n=n: tape.leaf(n, k, STEP) if k < len(POLYNOMIALS[n]) else zero)
        for n in "xy"
    }
    bound[t] = Series(lambda k: (time, unit)[k] if k < 2 else zero)
    found = SeriesReading(constants, bound, waves).read(parse(text, {**names, "t": t}))
    wanted = [found[k] for k in range(ORDER + 1)]
    leaves = {("value", 0): 0.9, ("value", 1): WAVE, ("time", 0): BEGUN}
    leaves |= {(n, k): c for n, cs in POLYNOMIALS.items() for k, c in enumerate(cs)}
    for i, frequency in enumerate(frequencies):
        angle = float(frequency.subs({names["a"]: 0.9, names["w"]: WAVE})) * BEGUN
        leaves |= {("sine", i): math.sin(angle), ("cosine", i): math.cos(angle)}
    values = tapes.run(tape, leaves)
    return [float(values[value]) for value in wanted]


def exact(text: str) -> list[float]:
    """The same coefficients by mpmath, from derivatives in 60 digits."""
    names = sympy.symbols("x y a w t", real=True)
    formula = parse(text, dict(zip("xyawt", names, strict=True)))
    f = sympy.lambdify(names, formula, "mpmath")

    def along(theta: Any) -> Any:
        x, y = (
            mpmath.polyval([mpmath.mpf(c) for c in cs[::-1]], theta) for cs in POLYNOMIALS.values()
        )
        return f(x, y, mpmath.mpf(0.9), mpmath.mpf(WAVE), BEGUN + mpmath.mpf(RATE) * theta)

    with mpmath.workdps(60):
        return [float(c) for c in mpmath.taylor(along, 0, ORDER)]


def agrees(text: str) -> None:
    found, wanted = series_of(text), exact(text)
    scale = max(abs(c) for c in wanted)
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12 * scale)


@pytest.mark.parametrize("name", list(FUNCTIONS))
def test_the_series_of_every_function(name: str) -> None:
    argument = {"acosh": "1.4 + {}*y", "atan2": "{} - 1, y"}.get(name, "{}")
    agrees(f"{name}({argument.format('x')})")
    agrees(f"{name}({argument.format('(x*y + 0.1*t)')})")
    if name == "atan2":
        agrees("atan2(-0.3, -a*x)")  # the branch at −x, and one argument constant


@pytest.mark.parametrize(
    "text",
    [
        "x**2",
        "x**3*y",
        "x**7",
        "x**12 - y",
        "1/x",
        "x**-3/y",
        "sqrt(x)",
        "1/sqrt(x)",
        "x**(3/2)",
        "x**(-5/2)",
        "x**a",
        "(x*y)**(-a)",
        "x**y",
        "a**x",
        "(a + x)**(w - y)",
        "(1 + x**2)**a - y**2",
        "x*y*(x + y)*a*(x - 2)",
        "a*w/7",
        "a*x + w*y + pi*t - 3",
        "t**2*x",
        "exp(-t/a)*x",
        "x**2 + 2*x*y + (x*y)**2",
    ],
)
def test_the_series_of_powers_and_products(text: str) -> None:
    agrees(text)


@pytest.mark.parametrize(
    "text",
    [
        "sin(w*t)",
        "cos(w*t)",
        "sin(w*t + a)",
        "cos(a - w*t)",
        "a*sin(w*t)*3",
        "x*sin(w*t)",
        "x*y*cos(w*t)*w",
        "x*sin(w*t)*cos(2*w*t/3)",
        "sin(w*t)*cos(w*t)",
        "sin(w*t)**2",
        "sin(w*t)**3*x",
        "a*sin(w*t + a)*(x - y)*cos(a*t)",
        "(1 - exp(-t/a))*w*cos(w*t)",
        "sin(w*t + x)",
        "cos(x*t)",
        "sin(t**2/3)",
        "cos(5*t)*sin(t/7 - 1)",
        "exp(sin(w*t)*x)",
    ],
)
def test_the_series_of_waves(text: str) -> None:
    agrees(text)


def test_a_power_of_a_sinusoids_angle_is_recorded_once() -> None:
    """Both channels and all products use the same (ωH)^k/k!."""
    tape = Tape()
    powers = Powers(tape, tape.leaf("value", 0, LOOP), (1, 2))
    before = [powers[k] for k in range(9)]
    size = len(tape.operations)
    assert [powers[k] for k in range(9)] == before
    assert len(tape.operations) == size
    values = tapes.run(tape, {("value", 0): 1.3})
    for k, value in enumerate(before):
        size = 1.3**k / math.factorial(k)
        sign = 1 if k == 0 else (-1) ** (k // 2)  # cos: + − + −, sin: + − + −
        assert values[value] == pytest.approx(sign * size, rel=1e-14)


def test_a_table_has_no_series() -> None:
    f = sympy.Function("f")
    tape = Tape()
    x = sympy.Symbol("x", real=True)
    constants = Plain(tape, {}, t, frozenset(), lambda _: (0, 0))
    reading = SeriesReading(constants, {x: Series(lambda k: tape.constant(k))}, lambda _: None)  # pyright: ignore
    with pytest.raises(TypeError, match="no power series"):
        reading.read(f(x))
