"""Fields: their laws against the formulas of their docstrings, and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from loops import velocity_actuated

import extremum as es
from extremum import s

POINT = np.array([0.3, -0.7])
SOURCE = np.array([-1.0, 0.5])


def laws() -> list[tuple[es.Field, float]]:
    offset = POINT - SOURCE
    q = np.array([[1.0, 0.3], [0.3, 0.5]])
    r2 = float(offset @ offset)
    return [
        (es.Quadratic(SOURCE, (1.0, 0.5), 2.0), 2 - offset[0] ** 2 - 0.5 * offset[1] ** 2),  # pyright: ignore[reportArgumentType]
        (es.Quadratic(SOURCE, q, 2.0), 2 - float(offset @ q @ offset)),  # pyright: ignore[reportArgumentType]
        (es.Gaussian(SOURCE, 0.7, 3.0), 3 * np.exp(-r2 / (2 * 0.7**2))),  # pyright: ignore[reportArgumentType]
        (es.Gaussian(SOURCE, (0.7, 2.0), 3.0), 3 * np.exp(-(offset**2 / [0.98, 8.0]).sum())),  # pyright: ignore[reportArgumentType]
        (es.InverseSquare(SOURCE, 0.7, 3.0), 3 / (1 + r2 / 0.49)),  # pyright: ignore[reportArgumentType]
    ]


@pytest.mark.parametrize(("field", "expected"), laws(), ids=lambda item: type(item).__name__)
def test_the_law_is_the_docstrings(field: es.Field, expected: float) -> None:
    assert float(field.at(*POINT)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (es.FigureEight(2.0, 0.3, 0.4), lambda t: (2 * np.sin(0.3 * t), 2 * np.cos(0.6 * t + 0.4))),
        (es.FigureEight(1.0, 0.1, 3 * np.pi / 2), lambda t: (np.sin(0.1 * t), np.sin(0.2 * t))),
        (es.Circle(2.0, -0.3), lambda t: (2 * np.cos(0.3 * t), -2 * np.sin(0.3 * t))),
        (es.Line((0.1, -0.2)), lambda t: (0.1 * t, -0.2 * t)),
        (es.Along(("R*sin(t)", "t**2"), {"R": 3.0}), lambda t: (3 * np.sin(t), t**2)),
    ],
)
def test_a_moving_field_is_the_field_at_the_displaced_position(path: Any, expected: Any) -> None:
    still = es.Gaussian((0.2, 0.1), 0.8, 1.0)
    moving = es.Moving(still, path)
    for time in (0.0, 0.7, 5.0):
        d = np.array(expected(time))
        assert float(moving.at(*POINT, time=time)) == pytest.approx(float(still.at(*(POINT - d))))
    source = velocity_actuated(field=moving)
    run = es.simulate(source, 2.0, samples=3)
    assert run.source.values[-1] == pytest.approx(np.array([0.2, 0.1]) + expected(2.0))


def test_formulas_reach_beyond_three_axes() -> None:
    field = es.Expression("1 - x1**2 - x4**2 - (x5 - 1)**2")
    assert float(field.at(1, 0, 0, 2, 3)) == 1 - 1 - 4 - 4
    traced = es.field_from(lambda x1, x2, x3, x4: -(x4**2) + x1 * x2 * x3)
    assert float(traced.at(1, 2, 3, 4)) == 6 - 16
    channel = es.Channel(es.Dither(0.1), 10)
    loop = es.Loop(
        field=field,
        vehicle=es.PointMass((1 / s,) * 5),
        controller=es.GradientES(
            20, 1, tuple(channel.replace({"ratio": r}) for r in (4, 5, 7, 9, 11))
        ),
        start=(0.1,) * 5,
    )
    run = es.simulate(loop, 0.5)
    assert list(run.axis.values) == ["x1", "x2", "x3", "x4", "x5"]


def test_a_formula_may_take_several_lines() -> None:
    assert float(es.Expression("1 - x**2\n  - y**2\n").at(1, 2)) == -4


def test_constants_survive_tracing() -> None:
    traced = es.field_from(lambda x: es.exp(1) * x + es.pi)
    assert float(traced.at(2.0)) == pytest.approx(2 * np.e + np.pi)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: es.Expression("x1 - x", {"x1": 3}), "parameters.x1: is the name of a coordinate"),
        (lambda: es.Expression("x", {"lambda": 1}), "lambda: is no name for a parameter"),
        (lambda: es.field_from(lambda x, b: x * b), "b: is neither a coordinate"),
        (lambda: es.field_from(lambda x: np.exp(x)), "es.exp"),
        (lambda: es.field_from(lambda x: x if x > 0 else -x), "without branches"),
        (lambda: es.field_from(3), "takes a function"),  # pyright: ignore[reportArgumentType]
        (lambda: es.Quadratic((0, 0), (1, 1)).at(1), "has 1 axes, the field 2"),
        (lambda: es.Gaussian((0, 0), width=(1, 2, 3)), "3 entries for a source with 2"),
        (lambda: es.Moving(es.Quadratic((0, 0), (1, 1)), es.Line((1,))), "1 coordinates"),
    ],
)
def test_what_is_no_field_is_refused(make: Any, words: str) -> None:
    with pytest.raises(es.InvalidDescription, match=words):
        make()
