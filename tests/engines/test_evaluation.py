"""The tape by NumPy: against SymPy, and its steps against the vector code's."""

from __future__ import annotations

from typing import Any

import lane_cases
import numpy as np
import sympy

from extremum.engines import simd
from extremum.engines.lanes import choosing
from extremum.engines.lanes.asked import Asked, Numbers
from extremum.engines.lanes.evaluation import evaluated
from extremum.engines.lanes.program import Ground, program


def test_functions_have_the_values_that_sympy_finds() -> None:
    system = lane_cases.functions().system
    ground = Ground(system, (), paced=True)
    (rate,) = (
        ground.at(tuple(ground.states.values()), ground.tape.constant(0.0)).read(e)
        for e in system.rhs
    )
    numbers = {"a": 0.3, "b": 0.8, "w": 5.0}
    x, t = np.array([0.1, 0.4, 0.9]), 0.7
    leaves: dict[tuple[str, int], Any] = {("state", 0): x, ("time", 0): t}
    leaves |= {("value", i): number for i, number in enumerate(numbers.values())}
    leaves |= {("sine", 0): np.sin(5 * t), ("cosine", 0): np.cos(5 * t)}
    found = evaluated(ground.tape, [rate], leaves)[rate]
    ((_, formula),) = system.signals
    for number, value in zip(x, found, strict=True):
        known = {system.states[0]: number, system.time: t}
        known |= dict(zip(system.symbols, numbers.values(), strict=True))
        exact = sympy.N(formula.subs({s: sympy.Float(v, 30) for s, v in known.items()}), 25)
        assert abs(value - exact) < 1e-13


def stepped(asked: Asked) -> tuple[Numbers, Numbers]:
    """Run loops by evaluating the tape step by step; return states and the number of steps."""
    step = program(asked.system, asked.swept, choosing.usual(asked), asked.watch)
    leaves: dict[tuple[str, int], Any] = {("tol", 0): asked.tol * choosing.SHARE}
    leaves |= {("value", i): value for i, value in enumerate(asked.values)}
    leaves |= {("value", i): row for i, row in zip(asked.swept, asked.columns, strict=True)}
    begun = evaluated(step.tape, [*step.start, step.unit, *step.angles], leaves)
    states = np.array([np.broadcast_to(begun[value], asked.count) for value in step.start])
    end, time = asked.t_end / np.broadcast_to(begun[step.unit], asked.count), np.zeros(asked.count)
    count = np.zeros(asked.count)
    assert step.step.part is not None
    while (time < end).any():
        leaves |= {("state", i): state for i, state in enumerate(states)}
        for i, angle in enumerate(step.angles):
            leaves |= {("sine", i): np.sin(begun[angle] * time)}
            leaves |= {("cosine", i): np.cos(begun[angle] * time)}
        leaves["time", 0] = time * begun[step.unit]
        wished = evaluated(step.tape, [step.step.part], leaves)[step.step.part]
        leaves["part", 0] = np.minimum(wished, end - time)
        after = evaluated(step.tape, step.step.states, leaves)
        states = np.array([after[value] for value in step.step.states])
        count += time < end
        time = np.where(wished >= end - time, end, time + wished)
    return states, count


def test_steps_by_numpy_are_the_steps_of_the_vector_code() -> None:
    for asked in (lane_cases.quadratic(), lane_cases.force(), lane_cases.moving()):
        states, count = stepped(asked)
        ended = simd.integrate(asked)
        np.testing.assert_allclose(ended.states, states, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(ended.steps, count)
