"""Choices, limits and random numbers as expressions are read, on every way to a number."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy
from recursions import VALUES, J, a, asked, b, noisy, sampled, seed, x, y, z
from sympy import Integer

from extremum.engines import simd
from extremum.engines.lanes.difference import Difference
from extremum.engines.lanes.evaluation import evaluated
from extremum.engines.lanes.program import Ground, program
from extremum.engines.lanes.schemes import RK4, Taylor
from extremum.engines.lanes.tape import Tape
from extremum.engines.lanes.watch import Watch
from extremum.logic import absolute, maximum, minimum, normal, positive


def test_choices_and_limits_as_they_are_written_also_of_nan() -> None:
    """In NumPy, in Python, as the tape's values and folded on it, against their definitions."""
    nan = math.nan
    written = {
        "positive": (positive(x, y, z), lambda p, q, r: q if p > 0 else r),
        "maximum": (maximum(x, y), lambda p, q, r: p if p > q else q),
        "minimum": (minimum(x, y), lambda p, q, r: p if p < q else q),
        "absolute": (absolute(x), lambda p, q, r: abs(p)),
    }
    rows = [(p, q, r) for p in (-1.0, 0.0, 2.0, nan) for q in (1.0, nan, -3.0) for r in (5.0, nan)]
    states = (x, y, z)
    made = sampled(dict(zip(states, states, strict=True)), dict.fromkeys(states, 1))
    for expression, meant in written.values():
        wanted = [meant(*row) for row in rows]
        many = made.function([expression], vector=True)
        columns = [np.array(c) for c in zip(*rows, strict=True)]
        assert np.array_equal(many(0.0, columns, VALUES.values())[0], wanted, equal_nan=True)
        one = made.function([expression], vector=False)
        found = [one(0.0, row, tuple(VALUES.values()))[0] for row in rows]
        assert np.array_equal(found, wanted, equal_nan=True)
        ground = Ground(made, (), False)
        begun = tuple(ground.states.values())
        value = ground.at(begun, ground.tape.constant(0.0)).read(expression)
        leaves = {("state", i): c for i, c in enumerate(columns)}
        found = evaluated(ground.tape, [value], leaves)[value]
        assert np.array_equal(found, wanted, equal_nan=True)
        for row, result in zip(rows, wanted, strict=True):
            tape = Tape()
            operands = [tape.constant(n) for n in row][: len(expression.args)]
            known = tape.known(tape.call(type(expression).__name__, *operands))
            assert known == result or (math.isnan(result) and math.isnan(known or 0.0))


def test_choices_of_lanes_whose_samples_are_no_numbers() -> None:
    made = sampled(
        {x: positive(J, 1, 2), y: maximum(J, 5), z: minimum(J, 5)},
        {x: 0, y: 0, z: positive(sympy.log(b), 1, 3)},
        (J, sympy.log(b)),
    )
    question = asked(made, 1, {b: np.array([-1.0, math.e, math.exp(9.0), 0.5])})
    ended = simd.integrate(question)
    assert ended.states[0].tolist() == [2, 1, 1, 2]
    assert ended.states[1] == pytest.approx([5, 5, 9, 5])
    assert ended.states[2] == pytest.approx([5, 1, 5, math.log(0.5)])
    begun = simd.integrate(replace(question, samples=2)).samples[0, 2]
    assert begun.tolist() == [3, 1, 1, 3]
    assert (ended.outcome == 0).all()


@pytest.mark.parametrize("scheme", [RK4, Taylor(8)], ids=["RK4", "Taylor"])
def test_differential_equations_have_no_random_numbers(scheme: Any) -> None:
    made = replace(sampled({x: normal(seed, Integer(0)) * x}, {x: 1}), dt=None)
    with pytest.raises(TypeError, match="only the samples of difference equations"):
        program(made, (), scheme, Watch())


@pytest.mark.parametrize("stream", [a, Integer(-1), sympy.Rational(1, 2)])
def test_a_stream_is_a_whole_number(stream: Any) -> None:
    made = sampled({x: normal(seed, stream)}, {x: 0})
    with pytest.raises(TypeError, match="a stream of random numbers is 0, 1, 2"):
        program(made, (), Difference(), Watch())


def test_seeds_are_known() -> None:
    assert noisy().seeds == {seed}
    assert sampled({x: x}, {x: 0}).seeds == frozenset()
