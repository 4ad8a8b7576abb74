from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Barrier
from typing import Any

import heyoka
import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated
from scipy.linalg import expm
from systems import system

import extremum as es
from extremum import s
from extremum.engines import flow
from extremum.system import Oracle

ENGINES = ("taylor", "reference")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_linear_system_has_the_matrix_exponential(engine: str) -> None:
    """ẋ = A x, Φ = e^{A T}; the signals pass the chain rule on."""
    linear = system("v, w*m - b*v", names="x,v", n="2*x - v", m="a*n + x")
    a, b, w = 0.3, 0.7, 1.9
    matrix = np.array([[0, 1], [w * (2 * a + 1), -w * a - b]])
    found = flow.transition(linear, (a, b, w), (0.4, -2.0), 0.5, 3.0, engine=engine)
    exact = expm(2.5 * matrix)
    assert found.completed
    assert found.matrix == pytest.approx(exact, rel=1e-11)
    assert found.state == pytest.approx(exact @ (0.4, -2.0), rel=1e-11)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_periodic_coefficient(engine: str) -> None:
    """ẋ = (a + b cos wt) x: Φ = exp(aT + b (sin wT₂ − sin wT₁)/w)."""
    times = np.array([0.2, 0.9, 1.0, 2.4])
    a, b, w = -0.3, 4.0, 25.0
    found = flow.transitions(
        system("(a + b*cos(w*t))*x", carriers="w"), (a, b, w), (1.5,), times, engine=engine
    )
    exact = np.exp(a * np.diff(times) + b * np.diff(np.sin(w * times)) / w)
    assert found.factors[:, 0, 0] == pytest.approx(exact, rel=1e-11)
    assert found.matrix[0, 0] == pytest.approx(np.prod(exact), rel=1e-11)
    assert found.states[:, 0] == pytest.approx(1.5 * np.cumprod([1, *exact]), rel=1e-11)


def test_what_a_short_period_changes_is_right() -> None:
    """At ω = 409600, Φ − I is of size 1e-5; it is wanted to more digits than 1e-12/1e-5."""
    linear = system("v, -a*x - b*v", names="x,v")
    matrix, period = np.array([[0, 1], [-0.8, -0.3]]), 2 * np.pi / 409600
    found = flow.transition(linear, (0.8, 0.3, 0.0), (0.1, 0.2), 0.0, period)
    small = matrix * period
    exact = small + small @ small / 2 + small @ small @ small / 6
    assert found.matrix - np.eye(2) == pytest.approx(exact, rel=1e-15, abs=3e-16)


@pytest.mark.parametrize("make", [velocity_actuated, force_actuated])
def test_engines_and_differences_agree(make: Any) -> None:
    loop = make()
    values = loop.values.tolist()
    start = np.array(loop.system.start(values))
    span = (0.1, 0.5)
    ours, theirs = (
        flow.transition(loop.system, values, start, *span, engine=engine) for engine in ENGINES
    )
    assert ours.state == pytest.approx(theirs.state, rel=1e-10, abs=1e-10)
    assert ours.matrix == pytest.approx(theirs.matrix, rel=1e-9, abs=1e-10)
    step = 1e-5
    columns = []
    for direction in np.eye(len(start)):
        ends = [
            flow.transition(loop.system, values, start + sign * step * direction, *span).state
            for sign in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step))
    assert ours.matrix == pytest.approx(np.array(columns).T, rel=1e-6, abs=1e-7)


def test_a_start_for_each_segment() -> None:
    """Multiple shooting: every segment goes from its own start, and no further."""
    linear = system("a*x")
    times = np.array([0.0, 1.0, 1.5, 4.0])
    starts = np.array([[1.0], [5.0], [-2.0]])
    found = flow.transitions(linear, (0.2, 0, 0), starts, times)
    growth = np.exp(0.2 * np.diff(times))
    assert found.states[0] == 1.0
    assert found.states[1:, 0] == pytest.approx(starts[:, 0] * growth, rel=1e-13)
    assert found.factors[:, 0, 0] == pytest.approx(growth, rel=1e-13)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("power", [2, 3, 5, 6, 11])
def test_powers_at_zero(engine: str, power: int) -> None:
    """ẋ = xⁿ + a (b + 1/2)ⁿ rests at x = 0 for b = −1/2, with Φ = 1; the base is exactly 0."""
    text = f"x**{power} + a*(b + 1/2)**{power}"
    found = flow.transition(system(text), (1.0, -0.5, 0.0), (0.0,), 0.0, 1.0, engine=engine)
    assert found.completed
    assert found.state == [0.0]
    assert found.matrix == [[1.0]]
    elsewhere = flow.transition(system(text), (1.0, -0.5, 0.0), (0.5,), 0.0, 1.0, engine=engine)
    exact = (0.5 ** (1 - power) - (power - 1)) ** (1 / (1 - power))
    assert elsewhere.state[0] == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_escape_is_an_outcome(engine: str) -> None:
    """ẋ = x² from 2 is 2/(1 − 2t), infinite at t = 0.5; Φ = (x/x₀)²."""
    times = np.array([0.0, 0.2, 0.4, 0.6, 0.8])
    found = flow.transitions(system("x**2"), (0, 0, 0), (2.0,), times, engine=engine)
    assert found.outcome == "escaped"
    assert not found.completed
    assert found.times == pytest.approx(times[:3])
    assert found.states[:, 0] == pytest.approx([2, 10 / 3, 10], rel=1e-10)
    assert found.matrix[0, 0] == pytest.approx(25, rel=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_edge_of_a_domain_is_an_outcome(engine: str) -> None:
    """ẋ = b√x − a, a > b√x, falls below x = 0, where the root ends."""
    found = flow.transition(system("b*sqrt(x) - a"), (1, 0.1, 0), (0.5,), 0, 2, engine=engine)
    assert found.outcome == "left the data"
    assert len(found.factors) == 0
    assert np.isfinite(found.states).all()


def test_a_field_known_by_its_values_only() -> None:
    """The same Φ from the values as from the formula, by differences of fourth order."""
    law = es.Expression("1 - x**2 - y**2/2 - x**3/5 + sin(x*y)/4")

    def value(p: Any, _: float) -> float:
        x, y = p
        return float(1 - x**2 - y**2 / 2 - x**3 / 5 + np.sin(x * y) / 4)

    start = (0.4, -0.3)
    known = velocity_actuated(field=law, start=start)
    opaque = velocity_actuated(field=es.Opaque(value), start=start)
    matrices = []
    for loop in (known, opaque):
        values = loop.values.tolist()
        begin = loop.system.start(values)
        matrices.append(flow.transition(loop.system, values, begin, 0.0, 0.3).matrix)
    assert matrices[1] == pytest.approx(matrices[0], rel=1e-8, abs=1e-9)


def test_derivatives_of_values_do_not_ask_beyond_the_edge() -> None:
    """ẋ = −f(x), f(x) = x³ known on [0, 1] only: from 1, x = 1/√(1 + 2t) and Φ = x³."""

    def cube(x: float) -> float:
        if not 0 <= x <= 1:
            raise ValueError
        return x**3

    call = sympy.Function("f")(sympy.Symbol("x", real=True))
    value = sympy.Symbol("F", real=True)
    oracle = Oracle(cube, (0.0,), (1.0,))
    bound = replace(system("-x"), rhs=(-value,), signals=((value, call),), oracles={"f": oracle})
    found = flow.transition(bound, (0, 0, 0), (1.0,), 0.0, 1.0)
    assert found.completed
    assert found.state[0] == pytest.approx(3**-0.5, rel=1e-11)
    assert found.matrix[0, 0] == pytest.approx(3**-1.5, rel=1e-4)  # one-sided at the very edge


def test_gridded_data_end() -> None:
    """Φ over J = x is that of the plane up to the edge at x = 2, where the flow ends."""
    x = np.linspace(-1, 2, 7)
    loop = es.Loop(
        field=es.Gridded(es.Grid((x,), x)),
        vehicle=es.PointMass((1 / s,)),
        controller=es.GradientES(20.0, 1.0, (es.Channel(es.Dither(0.1), gain=20.0),)),
        start=(0.5,),
    )
    plane = loop.replace({"field": es.Expression("x")})
    times = np.arange(0.0, 20.0, 0.05)
    values = loop.values.tolist()
    begin = loop.system.start(values)
    found = flow.transitions(loop.system, values, begin, times)
    exact = flow.transitions(plane.system, values, begin, times)
    assert found.outcome == "left the data"
    reached = len(found.factors)
    assert 1 < reached < len(times) - 1
    assert found.states[:, 0].max() <= 2.0
    assert found.factors == pytest.approx(exact.factors[:reached], abs=1e-9)


def test_a_changed_number_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[Any] = []
    make = heyoka.taylor_adaptive

    def counted(*arguments: Any, **options: Any) -> Any:
        compiled.append(arguments)
        return make(*arguments, **options)

    monkeypatch.setattr(heyoka, "taylor_adaptive", counted)
    linear = system("a*x + b")
    for a in (0.1, -0.4, 2.0):
        found = flow.transition(linear, (a, 1.0, 0.0), (1.0,), 0.0, 1.0)
        assert found.matrix[0, 0] == pytest.approx(np.exp(a), rel=1e-14)
    assert len(compiled) == 1


def test_two_threads_do_not_share_an_integrator() -> None:
    linear = system("a*x + sin(w*t)", carriers="w")
    numbers = [(float(a), 0.0, 900.0) for a in np.linspace(-2, 2, 150)]
    together = Barrier(2)

    def sweep(order: np.ndarray) -> dict[int, float]:
        together.wait()
        return {
            int(i): flow.transition(linear, numbers[i], (1.0,), 0.0, 3.0).matrix[0, 0]
            for i in order
        }

    forwards = np.arange(len(numbers))
    with ThreadPoolExecutor(2) as pool:
        for found in pool.map(sweep, (forwards, forwards[::-1])):
            for i, factor in found.items():
                assert factor == pytest.approx(np.exp(3 * numbers[i][0]), rel=1e-12)
