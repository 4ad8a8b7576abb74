"""The theory against the oracle, on random loops of the paper's three kinds, one to three axes."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import extremum as es
from extremum import s
from extremum.theory.averaging import average

from . import oracle
from .plain import Polynomials
from .random_loops import plain_loop, random_loop

EVERY = range(50)
SOME = range(15)


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


@pytest.mark.parametrize("seed", SOME)
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
    """Equilibrium (position and washout) and eigenvalues of the averaged equations."""
    numbers = random_loop(seed)
    found, expected = average(loop(numbers)), oracle.average(plain_loop(numbers), leading=True)
    names = [str(state) for state in found.states]
    print(names, found.equilibrium, expected)
    apart, _ = oracle.matched(found.eigenvalues, expected.eigenvalues)
    assert apart.max() < 1e-8 * np.abs(expected.eigenvalues).max()
