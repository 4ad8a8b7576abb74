"""The paper's conditions, printed and corrected; figures from the paper's equations and errata."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from sympy import Symbol

import extremum as es
from extremum import pi, s
from extremum.papers.zhang2007 import scenario
from extremum.theory.hurwitz import LAMBDA
from extremum.theory.printed import (
    NotThePapers,
    PaperLoop,
    corrected_conditions,
    printed_conditions,
    recognise,
)


def loop_of(
    plants: tuple[Any, ...],
    compensator: Any = 1,
    gains: tuple[float, ...] = (10.0, 20.0),
    source: tuple[float, ...] = (0.05, 0.05),
    through: Any = None,
    **changes: Any,
) -> es.Loop:
    """Two axes in quadrature, α = 0.1, h = 1, q = (1, 0.5)."""
    phases = (0.0, -pi / 2)
    channels = tuple(
        es.Channel(es.Dither(0.1, phase, through), gain, compensator)
        for phase, gain in zip(phases, gains, strict=True)
    )
    loop = es.Loop(
        field=es.Quadratic(source=source, q=(1.0, 0.5), peak=1.0),
        vehicle=es.PointMass(axes=plants),
        controller=es.GradientES(frequency=100, washout=1.0, channels=channels),
        start=(0.0, 0.0),
    )
    return loop.replace(changes)


def unstable(pole: float) -> es.Rational:
    return es.Rational("1/(s - epsilon)", parameters={"epsilon": pole})


def single() -> es.Loop:
    return loop_of((1 / s, 1 / s))


def double(k: float = 5.0, z: float = -0.5, p: float = -3.0) -> es.Loop:
    lead = es.Lead(gain=k, zero=z, pole=p)
    return loop_of((1 / s**2, 1 / s**2), lead, gains=(10.0, 10.0), source=(0.0, 0.0))


def third(pole: float = 0.05) -> es.Loop:
    return loop_of((unstable(pole), unstable(pole)), through=1 / s)


def fourth(**changes: Any) -> es.Loop:
    lead = es.Lead(gain=1, zero=-0.8, pole=-1)
    return loop_of((unstable(0.5), unstable(0.5)), lead, through=1 / s, **changes)


def known(loop: es.Loop) -> PaperLoop:
    found = recognise(loop)
    assert isinstance(found, PaperLoop), found
    return found


def letters(loop: es.Loop) -> dict[str, Symbol]:
    return {str(symbol): symbol for symbol in loop.system.symbols}


def same(left: Any, right: Any) -> bool:
    return sympy.expand(left - right) == 0


# --- recognising ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "theorem"),
    [(single, 1), (double, 2), (third, 3), (fourth, 4)],
    ids=["1/s", "1/s² with lead", "1/(s − ε)", "1/(s − ε) with lead"],
)
def test_each_theorem_knows_its_scheme(build: Callable[[], es.Loop], theorem: int) -> None:
    found = known(build())
    assert found.theorem == theorem
    assert found.title.startswith(f"Theorem {theorem} ")


@pytest.mark.parametrize(
    ("name", "theorem"),
    [("fig4", 1), ("fig5", 1), ("fig6", 2), ("fig7", 3), ("unstable", 4), ("three_d", 1)],
)
def test_the_papers_own_scenarios_are_known(name: str, theorem: int) -> None:
    assert known(scenario(name).loop).theorem == theorem


def test_the_dither_may_go_through_the_axis_itself_and_the_frequencies_may_differ() -> None:
    own = loop_of((unstable(0.05), unstable(0.05)))
    assert known(own).theorem == 3
    apart = single().replace(
        {"controller.channels.1.ratio": Fraction(3, 2), "controller.channels.1.dither.phase": 0.0}
    )
    assert known(apart).theorem == 1


LEAD = es.Lead(gain=5, zero=-0.5, pole=-3)
UNLIKE = [
    (lambda: scenario("drag").loop, "the paper's axes are 1/s"),
    (lambda: scenario("nondiagonal").loop, "couples x and y: its Hessian at the source holds -0.8"),
    (lambda: loop_of((1 / s, 1 / s**2)), "different kinds"),
    (lambda: loop_of((2 / s, 2 / s)), "the paper's axes are 1/s"),
    (lambda: loop_of((1 / s**2, 1 / s**2)), "1/s² without a compensator"),
    (lambda: loop_of((1 / s, 1 / s), LEAD), "1/s with a compensator"),
    (lambda: loop_of((1 / s**2, 1 / s**2), 1 / (s + 2)), "C = k(s − z)/(s − p) in every axis"),
    (lambda: loop_of((unstable(-0.5), unstable(-0.5))), "pole -0.5 is stable"),
    (lambda: loop_of((1 / s**2, 1 / s**2), LEAD, through=1 / s), "dither goes through 1/s"),
    (
        lambda: single().replace({"controller.channels.1.dither.phase": 0.0}),
        "share the frequency 100 rad/s 0 rad apart",
    ),
    (
        lambda: single().replace({"controller.channels.0.reference": 0.02}),
        "turned by 0.02 rad against its dither",
    ),
    (
        lambda: single().replace(
            {"controller.channels.0": es.Channel(es.Probe(10.0, pi / 2), 10.0, reference=0.0)}
        ),
        "states its probe",
    ),
]


@pytest.mark.parametrize(("build", "reason"), UNLIKE, ids=[reason for _, reason in UNLIKE])
def test_a_loop_that_is_none_of_the_papers_is_told_why(
    build: Callable[[], es.Loop], reason: str
) -> None:
    found = recognise(build())
    assert isinstance(found, NotThePapers)
    assert reason in found.reason
    assert found.reason.endswith(".")
    assert printed_conditions(build()) is None
    assert corrected_conditions(build()) is None


def test_an_expression_that_changes_its_curvature_is_not_the_papers() -> None:
    field = es.Expression("-(2 + sin(t))*x**2 - y**2")
    found = recognise(single().replace({"field": field}))
    assert isinstance(found, NotThePapers)
    assert "The map changes with time" in found.reason


# --- the conditions ---------------------------------------------------------------------------


def test_the_conditions_of_theorem_2() -> None:
    """(32) to (40) as printed; corrected with z in place of z + h."""
    loop = double()
    v = letters(loop)
    printed, corrected, names = [], [], []
    for axis, first in (("x", 32), ("y", 36)):
        z, p = v[f"z_{axis}"], v[f"p_{axis}"]
        g = v[f"alpha_{axis}"] * v[f"c_{axis}"] * v[f"k_{axis}"] * v[f"q_{axis}"]
        printed += [-p, g, -g * (z + v["h"]), -g * p + g * (z + v["h"])]
        corrected += [-p, g, -g * z, -g * p + g * z]
        names += [f"({n}) {axis}" for n in range(first, first + 4)]
    for conditions, expected in (
        (printed_conditions(loop), [*printed, v["h"]]),
        (corrected_conditions(loop), [*corrected, v["h"]]),
    ):
        assert conditions is not None
        assert [c.name for c in conditions] == [*names, "(40) h"]
        for condition, law in zip(conditions, expected, strict=True):
            assert same(condition.expression, law), condition.name


def test_the_conditions_of_theorem_4() -> None:
    """(60) to (64) as printed; corrected with pε − gz > 0."""
    loop = fourth()
    v = letters(loop)
    printed, corrected = [], []
    for axis in ("x", "y"):
        z, p, e = v[f"z_{axis}"], v[f"p_{axis}"], v[f"epsilon_{axis}"]
        g = v[f"alpha_{axis}"] * v[f"c_{axis}"] * v[f"k_{axis}"] * v[f"q_{axis}"]
        printed += [g - e - p, (g + p) * e - g * (z + v["h"])]
        corrected += [g - e - p, p * e - g * z]
    for conditions, expected in (
        (printed_conditions(loop), [*printed, v["h"]]),
        (corrected_conditions(loop), [*corrected, v["h"]]),
    ):
        assert conditions is not None
        assert [c.name for c in conditions] == [
            *("(60) x", "(61) x", "(62) y", "(63) y", "(64) h"),
        ]
        for condition, law in zip(conditions, expected, strict=True):
            assert same(condition.expression, law), condition.name


def test_the_conditions_of_theorems_1_and_3() -> None:
    loop = third()
    v = letters(loop)
    g = v["alpha_x"] * v["c_x"] * v["q_x"]
    for conditions in (printed_conditions(loop), corrected_conditions(loop)):
        assert conditions is not None
        assert [c.name for c in conditions] == ["(43) x", "(43) y", "(14) h"]
        assert same(conditions[0].expression, g - v["epsilon_x"])
    first = printed_conditions(single())
    assert first is not None
    assert [(c.name, c.value) for c in first] == [
        *(("(14) x", 1.0), ("(14) y", 1.0), ("(14) h", 1.0)),
    ]


def test_more_axes_than_the_papers_two_have_conditions_too() -> None:
    conditions = printed_conditions(scenario("three_d").loop)
    assert conditions is not None
    assert [c.name for c in conditions] == ["(14) x", "(14) y", "(14) z", "(14) h"]


def test_a_condition_has_a_value_and_a_margin_without_unit() -> None:
    """(35), printed: −gp + g(z + h) = 15 + 2.5 with three terms 15, −2.5 and 5."""
    conditions = printed_conditions(double())
    assert conditions is not None
    (third_,) = (c for c in conditions if c.name == "(35) x")
    assert third_.value == pytest.approx(17.5)
    assert third_.margin == pytest.approx(17.5 / 22.5)
    assert third_.holds


@pytest.mark.parametrize("build", [double, fourth], ids=["theorem 2", "theorem 4"])
def test_the_conditions_hold_exactly_where_all_roots_lie_left(
    build: Callable[[], es.Loop],
) -> None:
    """Both sets agree with the signs of their own polynomials' roots, on random gains."""
    random = np.random.default_rng(7)
    loop, seen = build(), {True: 0, False: 0}
    for _ in range(400):
        z, p, h, k, e = random.uniform([-3, -3, 0.1, 0.5, 0.05], [0.5, 0.5, 2, 8, 1.5])
        changes = {"controller.washout": h}
        for i in (0, 1):
            lead = f"controller.channels.{i}.compensator"
            changes |= {f"{lead}.zero": z, f"{lead}.pole": p, f"{lead}.gain": k}
            if build is fourth:
                changes[f"vehicle.axes.{i}.parameters.epsilon"] = e
        found = known(loop.replace(changes))
        for prediction in (found.printed, found.corrected):
            if abs(prediction.rate) > 1e-6:
                assert prediction.stable == (prediction.rate < 0)
                seen[prediction.stable] += 1
    assert min(seen.values()) > 50


# --- polynomials, offsets and the largest real part --------------------------------------------


@pytest.mark.parametrize(
    ("z", "p", "printed", "corrected"),
    [
        (-2.0, -1.5, -0.1607, +0.1515),
        (-0.5, -3.0, +0.3944, -0.4550),
        (-2.0, -10.0, -0.1148, -0.1015),
        (-1.2, -1.1, -0.2077, +0.0391),
    ],
)
def test_the_largest_real_parts_of_erratum_1(
    z: float, p: float, printed: float, corrected: float
) -> None:
    found = known(double(z=z, p=p))
    assert found.printed.rate == pytest.approx(printed, abs=6e-5)
    assert found.corrected.rate == pytest.approx(corrected, abs=6e-5)


def test_the_polynomial_of_31_as_printed_and_corrected() -> None:
    loop = double()
    v = letters(loop)
    g = v["alpha_x"] * v["c_x"] * v["k_x"] * v["q_x"]
    found = known(loop)
    begin = LAMBDA**3 - v["p_x"] * LAMBDA**2 + g * LAMBDA
    assert same(found.printed.polynomials[0], begin - g * (v["z_x"] + v["h"]))
    assert same(found.corrected.polynomials[0], begin - g * v["z_x"])
    assert len(found.corrected.eigenvalues) == 7


def test_the_offset_of_theorem_3() -> None:
    """(43), Fig. 7: ε x*/(αcq − ε) = 0.05/(0.5 − 0.05) and −0.05/(0.25 − 0.05)."""
    found = known(scenario("fig7").loop)
    for prediction in (found.printed, found.corrected):
        assert prediction.offset == pytest.approx([0.05 / 0.45, -0.05 / 0.2])


def test_the_offsets_of_erratum_2() -> None:
    changes: dict[str, Any] = {"field.source": (1.0, -1.0)}
    for i in (0, 1):
        channel = f"controller.channels.{i}"
        changes |= {f"{channel}.gain": 10.0, f"{channel}.dither.amplitude": 0.05}
        changes[f"{channel}.compensator"] = es.Lead(gain=4, zero=-3, pole=-2.5)
    found = known(fourth(**changes))
    assert found.corrected.offset[0] == pytest.approx(0.26316, abs=5e-6)
    assert found.printed.offset[0] == pytest.approx(0.3333, abs=5e-5)


def test_the_offsets_and_rates_of_the_off_peak_case() -> None:
    """ε = 0.5, h = 1, p = −1, z = −0.8, αckq = 1, source (0.05, 0.05)."""
    found = known(fourth())
    assert found.corrected.offset == pytest.approx([0.0833, 0.0833], abs=5e-5)
    assert found.printed.offset == pytest.approx([-0.125, -0.125])
    assert found.printed.rate == pytest.approx(0.1232, abs=5e-5)
    assert not found.printed.stable
    assert found.corrected.stable


def test_a_constant_force_shifts_the_corrected_offset_only() -> None:
    """d/(αcq C(0)): 0.30 on 1/s with g = 1, d p/(g z) = 0.36 on 1/s² with the lead."""
    force = {"vehicle.disturbance": (0.3, 0.0)}
    for loop, expected in ((single(), 0.30), (double(), 0.36)):
        found = known(loop.replace(force))
        assert found.corrected.offset == pytest.approx([expected, 0.0])
        assert found.printed.offset == pytest.approx([0.0, 0.0])


def test_without_an_equilibrium_the_offset_is_nan() -> None:
    """p = 0 and z − ε + h = 0 make (54) 0/0: the scenario `unstable`, as printed."""
    found = known(scenario("unstable").loop)
    assert np.isnan(found.printed.offset).all()
    assert found.corrected.offset == pytest.approx([0.0, 0.0])


def test_a_moving_source_has_conditions_but_no_offset() -> None:
    found = known(scenario("fig6").loop)
    assert found.printed.offsets == ()
    assert found.printed.offset.size == 0
    assert len(found.printed.conditions) == 9


def test_the_curvature_of_a_smooth_map_is_half_its_hessian() -> None:
    """1/(1 + r²/w²): q = f*/w²."""
    field = es.InverseSquare(source=(0.0, 0.0), width=2.0, peak=3.0)
    conditions = printed_conditions(single().replace({"field": field}))
    assert conditions is not None
    assert conditions[0].value == pytest.approx(0.1 * 10.0 * 3.0 / 4.0)
