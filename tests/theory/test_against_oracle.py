"""The theory against the oracle, on random loops of the paper's three kinds, one to three axes."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import extremum as es
from extremum import s
from extremum.papers.zhang2007 import scenario
from extremum.theory.averaging import average
from extremum.theory.linear import loop_gain
from extremum.theory.orbits import periodic_orbit

from . import oracle
from .plain import Axis, Loop, Path, Polynomials, Quadratic, Vector
from .random_loops import plain_loop, random_loop

QUICK = (0, 1, 2, 3, 7, 9, 10, 13, 20, 22, 26, 30, 31, 40)
EVERY = [pytest.param(k, marks=() if k in QUICK else pytest.mark.slow) for k in range(50)]


def rational(function: Polynomials) -> Any:
    """Return the transfer function as an expression of s."""
    numerator, denominator = (
        sum(c * s**power for power, c in enumerate(reversed(p))) for p in function
    )
    return numerator / denominator


def field(numbers: dict[str, Any]) -> es.Field:
    """Return the package's field of such numbers (see `random_loops.plain_field`)."""
    matrix, peak, source = numbers["matrix"], numbers["peak"], numbers["source"]
    if numbers["field"] == "gaussian":
        width = tuple(float(np.sqrt(peak / (2 * matrix[i][i]))) for i in range(len(matrix)))
        return es.Gaussian(source=source, width=width, peak=peak)
    if numbers["field"] == "quadratic":
        return es.Quadratic(source=source, q=tuple(map(tuple, matrix)), peak=peak)
    offset = [f"({name} - {x!r})" for name, x in zip("xyz", source, strict=False)]
    terms = [repr(peak), f"{numbers['cubic']!r}*{offset[0]}**3"]
    terms += [
        f"(-{matrix[i][j]!r})*{a}*{b}" for i, a in enumerate(offset) for j, b in enumerate(offset)
    ]
    if len(source) > 1:
        terms.append(f"(-{numbers['cubic']!r})*{offset[0]}*{offset[1]}**2")
    return es.Expression(" + ".join(terms).replace("(--", "(").replace("--", "+"))


def loop(numbers: dict[str, Any]) -> es.Loop:
    """Return the package's loop of such numbers."""
    axes = numbers["axes"]
    channels = tuple(
        es.Channel(
            dither=es.Dither(
                axis["amplitude"],
                phase=axis["phase"],
                through=None if axis["through"] is None else rational(axis["through"]),
            ),
            gain=axis["gain"],
            compensator=rational(axis["compensator"]),
            reference=axis["reference"],
            ratio=Fraction(axis["ratio"]),
        )
        for axis in axes
    )
    forces = tuple(axis["force"] for axis in axes)
    return es.Loop(
        field=field(numbers),
        vehicle=es.PointMass(
            axes=tuple(rational(axis["vehicle"]) for axis in axes),
            disturbance=forces if any(forces) else None,
        ),
        controller=es.GradientES(
            frequency=numbers["frequency"], washout=numbers["washout"], channels=channels
        ),
        start=numbers["source"],
    )


@pytest.mark.parametrize("seed", range(15))
def test_both_mean_the_same_loop(seed: int) -> None:
    """One period from rest near the source: the positions."""
    numbers = random_loop(seed)
    plain = plain_loop(numbers)
    start = np.array(numbers["source"]) + 0.05
    end = oracle.flow(plain, oracle.at_rest(plain, start), 0.0, plain.period).state
    run = es.simulate(loop(numbers).replace({"start": tuple(start)}), plain.period, samples=2)
    expected = plain.matrices[3] @ end
    assert run.position.values[-1] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", EVERY)
def test_average(seed: int) -> None:
    """Equilibrium, in position and in e = η − f*, and eigenvalues of the averaged equations."""
    numbers = random_loop(seed)
    found, expected = average(loop(numbers)), oracle.average(plain_loop(numbers), leading=True)
    assert found.equilibrium is not None
    assert found.offset == pytest.approx(expected.offset, abs=1e-10)
    e = found.equilibrium[[str(x) for x in found.states].index("e")]
    assert e == pytest.approx(expected.state[-1] - numbers["peak"], abs=1e-10)
    apart, _ = oracle.matched(found.eigenvalues, expected.eigenvalues)
    assert apart.max() < 1e-10 * np.abs(expected.eigenvalues).max()


@pytest.mark.parametrize("seed", EVERY)
def test_floquet_exponents(seed: int) -> None:
    """Floquet exponents to 1e-9 of the largest, and the mean offset.

    Closer than asked for, and nothing left out: |Re λ| < 1e-3 and condition numbers above 1e3,
    for which less would do, do not occur.
    """
    numbers = random_loop(seed)
    found, expected = periodic_orbit(loop(numbers)), oracle.orbit(plain_loop(numbers))
    assert found.outcome == "found"
    exponents = expected.exponents
    assert np.abs(exponents.real).min() > 1e-3
    assert expected.conditions.max() < 1e3
    apart, _ = oracle.matched(found.exponents, exponents, 2 * np.pi / expected.period)
    assert apart.max() < 1e-9 * np.abs(exponents).max()
    assert found.offset == pytest.approx(expected.offset, abs=1e-9)


def test_random_loops_are_of_all_kinds_stable_and_unstable() -> None:
    """On the average, which costs least: the three kinds, one to three axes, both verdicts."""
    seen = set()
    for seed in range(50):
        numbers = random_loop(seed)
        rate = oracle.average(plain_loop(numbers)).eigenvalues.real.max()
        seen.add((numbers["kind"], len(numbers["axes"]), bool(rate < 0)))
    assert len(seen) == 3 * 3 * 2


@pytest.mark.parametrize("seed", [0, 2])
def test_second_order_leaves_an_error_of_second_order(seed: int) -> None:
    """The orbit's mean offset and exponents, at ω and 2ω."""
    errors = []
    for factor in (8, 16):
        numbers = random_loop(seed)
        numbers["frequency"] *= factor
        predicted, exact = average(loop(numbers), order=2), oracle.orbit(plain_loop(numbers))
        frequency = 2 * np.pi / exact.period
        apart, _ = oracle.matched(predicted.eigenvalues, exact.exponents, frequency)
        errors.append((np.abs(predicted.offset - exact.offset).max(), apart.max()))
    assert np.log2(np.divide(*errors)) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("seed", [0, 2, 7, 10, 22, 30, 35, 41])
def test_demodulation_and_sensitivity(seed: int) -> None:
    """M at the loop's own frequency, and S(jΩ) = (I + L(jΩ))⁻¹ of the averaged loop."""
    numbers = random_loop(seed)
    found, plain = loop(numbers), plain_loop(numbers)
    matrix = np.array(numbers["matrix"])
    expected = oracle.demodulation(plain, finite=True)
    assert average(found).demodulation == pytest.approx(expected, abs=1e-12)
    for frequency in (0.1, 1.0, 10.0):
        expected = oracle.sensitivity(plain, matrix, frequency)
        assert loop_gain(found).sensitivity(frequency) == pytest.approx(expected, abs=1e-10)


def circling(frequency: float, periods: int) -> tuple[es.Loop, Loop]:
    """The force-actuated loop about a source on a circle that closes after so many periods."""
    radius, slow = 0.2, frequency / periods
    numbers = random_loop(22) | {"frequency": frequency}
    still, plain = loop(numbers), plain_loop(numbers)
    path = es.Circle(radius=radius, frequency=slow)
    moving = still.replace({"field": es.Moving(still.field, path)})

    def at(t: float) -> Vector:
        return radius * np.array([np.cos(slow * t), np.sin(slow * t)])

    return moving, replace(plain, path=Path(at, periods))


def test_floquet_exponents_about_a_moving_source() -> None:
    found, expected = circling(60.0, 6)
    orbit, exact = periodic_orbit(found), oracle.orbit(expected)
    assert orbit.period == pytest.approx(exact.period, rel=1e-12)
    frequency = 2 * np.pi / exact.period
    apart, _ = oracle.matched(orbit.exponents, exact.exponents, frequency)
    assert apart.max() < 1e-9 * np.abs(exact.exponents).max()


@pytest.mark.slow
def test_figure_5_about_its_eight() -> None:
    """62.8 s: multipliers down to 1e-28, of which the oracle knows the real parts by QR."""
    period = 2 * np.pi / 0.1
    found = scenario("fig5").loop
    axes = tuple(Axis(((1.0,), (1.0, 0.0)), 0.05, 15.0, phase=phase) for phase in (0.0, -np.pi / 2))

    def eight(t: float) -> Vector:
        return np.array([np.sin(0.1 * t), np.sin(0.2 * t)])

    plain = Loop(axes, 30.0, 1.0, Quadratic(np.diag([1.0, 0.5]), 1.0), (0.0, 0.0))
    moving = replace(plain, path=Path(eight, 300))
    orbit, exact = periodic_orbit(found), oracle.orbit(moving)
    assert orbit.period == pytest.approx(period, rel=1e-12)
    assert orbit.offset == pytest.approx(exact.offset, abs=1e-9)
    expected = oracle.contraction(moving, exact.start, 300)
    assert np.sort(orbit.exponents.real) == pytest.approx(np.sort(expected), abs=1e-8)
