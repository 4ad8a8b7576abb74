"""The oracle against what is known without it: differences, closed forms, the errata's numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from . import oracle
from .plain import Axis, Loop, Path, Polynomials, Quadratic, Vector
from .random_loops import plain_loop, random_loop

INTEGRATOR: Polynomials = ((1.0,), (1.0, 0.0))
DOUBLE: Polynomials = ((1.0,), (1.0, 0.0, 0.0))


def lead(gain: float, zero: float, pole: float) -> Polynomials:
    return (gain, -gain * zero), (1.0, -pole)


def pair(
    vehicle: Polynomials,
    compensator: Polynomials,
    alpha: float,
    gains: tuple[float, float],
    frequency: float,
    source: tuple[float, float] = (0.0, 0.0),
    through: Polynomials | None = None,
) -> Loop:
    """A quadrature pair with h = 1, q = (1, 0.5)."""
    axes = (
        Axis(vehicle, alpha, gains[0], compensator, through=through),
        Axis(vehicle, alpha, gains[1], compensator, phase=-np.pi / 2, through=through),
    )
    return Loop(axes, frequency, 1.0, Quadratic(np.diag([1.0, 0.5]), 1.0), source)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 7, 9, 13, 19])
def test_variational_equations_are_the_flow_differentiated(seed: int) -> None:
    loop = plain_loop(random_loop(seed))
    start = oracle.average(loop).state + loop.steady(0.0)

    def end(y: Vector) -> Vector:
        solution = solve_ivp(
            loop.rhs, (0.0, loop.period), y, "DOP853", rtol=1e-12, atol=1e-13,
            max_step=2 * np.pi / loop.frequencies.max() / 20,
        )  # fmt: skip
        return solution.y[:, -1]

    found = oracle.flow(loop, start, 0.0, loop.period).change
    direction = np.random.default_rng(seed).normal(size=len(start))
    size = 1e-4
    slopes = [
        (end(start + k * direction) - end(start - k * direction)) / (2 * k)
        for k in (size, 2 * size)
    ]
    difference = (4 * slopes[0] - slopes[1]) / 3 - direction
    assert np.abs(found @ direction - difference).max() < 1e-7 * np.abs(direction).max()


@pytest.mark.parametrize("seed", range(50))
def test_averaged_eigenvalues_are_the_roots_of_the_linear_loop(seed: int) -> None:
    """On the peak of a quadratic map 1 + L(s) = 0 and −h; frequencies do not collide."""
    numbers = random_loop(seed)
    if {int(axis["ratio"]) for axis in numbers["axes"]} in ({1, 2}, {2, 3, 5}):
        numbers["axes"] = [axis | {"ratio": 1 + 2 * i} for i, axis in enumerate(numbers["axes"])]
    numbers |= {"field": "quadratic"}
    loop = plain_loop(numbers)
    roots = oracle.linear_roots(loop, np.array(numbers["matrix"]))
    apart, _ = oracle.matched(oracle.average(loop, leading=True).eigenvalues, roots)
    assert apart.max() < 1e-9 * np.abs(roots).max()


@pytest.mark.parametrize(
    ("zero", "pole", "largest"),
    [
        (-2.0, -1.5, {30: 0.1544, 100: 0.1518, 400: 0.1515}),
        (-0.5, -3.0, {30: -0.4561, 100: -0.4551, 400: -0.4550}),
        (-2.0, -10.0, {30: -0.1014, 100: -0.1015, 400: -0.1015}),
        (-1.2, -1.1, {30: 0.0419, 100: 0.0394, 400: 0.0392}),
    ],
)
def test_first_erratum(zero: float, pole: float, largest: dict[float, float]) -> None:
    for frequency, expected in largest.items():
        loop = pair(DOUBLE, lead(5.0, zero, pole), 0.1, (10.0, 10.0), frequency)
        assert oracle.orbit(loop).exponents.real.max() == pytest.approx(expected, abs=5.1e-5)


def test_second_erratum() -> None:
    unstable: Polynomials = ((1.0,), (1.0, -0.5))
    loop = pair(unstable, lead(4.0, -3.0, -2.5), 0.05, (10.0, 10.0), 25600, (1.0, -1.0), INTEGRATOR)
    assert oracle.orbit(loop).offset[0] == pytest.approx(0.26318, abs=5e-6)
    exact_probe = replace(loop, axes=tuple(axis._replace(through=None) for axis in loop.axes))
    slowest = {100: -0.157, 1600: -0.528, 25600: -0.742, 409600: -0.789}
    for frequency, expected in slowest.items():
        found = oracle.orbit(replace(exact_probe, frequency=frequency))
        assert found.exponents.real.max() == pytest.approx(expected, abs=5e-4)


def test_offset_of_an_unstable_pole() -> None:
    """α c k q = 1 per axis, ω = 6400."""
    unstable: Polynomials = ((1.0,), (1.0, -0.5))
    loop = pair(unstable, lead(1.0, -0.8, -1.0), 0.1, (10.0, 20.0), 6400, (0.05, 0.05), INTEGRATOR)
    found = oracle.orbit(loop)
    assert found.exponents.real.max() == pytest.approx(-0.23765, abs=5e-6)
    assert found.offset[0] == pytest.approx(0.0833, abs=5e-5)


def test_a_long_orbit_contracts_as_its_factors_do() -> None:
    """Twenty dither periods of a source that rests, though it may move: the exponents of one."""
    loop = pair(INTEGRATOR, ((1.0,), (1.0,)), 0.1, (20.0, 10.0), 30.0)
    once = oracle.orbit(loop)
    moving = replace(loop, path=Path(lambda t: np.zeros(2), 20))
    found = oracle.contraction(moving, once.start, 20, cycles=40)
    assert np.sort(found) == pytest.approx(np.sort(once.exponents.real), abs=1e-9)
