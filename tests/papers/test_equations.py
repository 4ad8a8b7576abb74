"""The paper's numbered equations, and the table that says where each is."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import pytest
import sympy
from sympy import Expr, Symbol, cos, sin

import extremum as es
from extremum.papers.zhang2007.equations import EQUATIONS, Equation, markdown
from extremum.papers.zhang2007.errata import ERRATA
from extremum.papers.zhang2007.schemes import (
    double_integrators,
    single_integrators,
    unstable_poles,
)
from extremum.symbols import substituted, t
from extremum.system import System
from extremum.theory.averaging import Average, average
from extremum.theory.frame import relative
from extremum.theory.wording import paper_form

ROOT = Path(__file__).parents[2]
LEAD = es.Lead(gain=5, zero=-0.5, pole=-3)


def fig_1() -> es.Loop:
    return single_integrators(30.0, 0.08, 10.0)


def fig_2() -> es.Loop:
    return double_integrators(30.0, 0.1, 10.0, LEAD)


def fig_3() -> es.Loop:
    return unstable_poles(30.0, 0.1, 10.0, 0.5, LEAD, source=(1.0, -1.0))


class Letters:
    """The symbols of a system by name: parameters, states and signals."""

    def __init__(self, system: System) -> None:
        known = [*system.symbols, *system.states, *(x for x, _ in system.signals)]
        self.known = {str(x): x for x in known}

    def __getattr__(self, name: str) -> Any:
        return self.known[name]

    def of(self, axis: str) -> dict[str, Symbol]:
        """The letters of one axis without its name: α, c, k, z, p, q, ε where they occur."""
        ending = f"_{axis}"
        return {n.removesuffix(ending): x for n, x in self.known.items() if n.endswith(ending)}

    def source(self, axis: str) -> Symbol:
        return self.known[f"{axis}^*"]


def full(system: System, expression: Expr) -> Expr:
    """The expression with every signal written out."""
    for symbol, law in reversed(system.signals):
        expression = substituted(expression, {symbol: law})
    return expression


def same(left: Any, right: Any) -> bool:
    return sympy.expand(sympy.expand_trig(sympy.simplify(left - right))) == 0


def check(system: System, state: Any, expected: Any) -> None:
    rate = system.rhs[system.states.index(state)]
    assert same(full(system, rate), full(system, expected)), state


# --- the equations ----------------------------------------------------------------------------


def test_the_vehicle_and_the_map() -> None:
    """(1), (2)."""
    system = fig_1().system
    v = Letters(system)
    x, y, _ = system.states
    assert system.rhs[:2] == (v.v_x, v.v_y)
    law = v.known["f^*"] - v.q_x * (x - v.source("x")) ** 2 - v.q_y * (y - v.source("y")) ** 2
    assert same(dict(system.signals)[v.J], law)


def delta(v: Letters) -> Expr:
    """(6): Δ = −[q_x (x̃ + α sin τ)² + q_y (ỹ − α cos τ)² + e], each axis with its own α."""
    tau = v.omega * t
    first = v.q_x * (v.xtilde + v.alpha_x * sin(tau)) ** 2
    second = v.q_y * (v.ytilde - v.alpha_y * cos(tau)) ** 2
    return -(first + second + v.e)


def test_fig_1_in_relative_coordinates() -> None:
    """(3) to (9), per second: x̃ = x − x* − α sin ωt, ỹ = y − y* + α cos ωt, e = η − f*."""
    frame = relative(fig_1())
    system, v = frame.system, Letters(frame.system)
    tau = v.omega * t
    position = system.outputs["position"]
    assert same(position[0], v.xtilde + v.source("x") + v.alpha_x * sin(tau))
    assert same(position[1], v.ytilde + v.source("y") - v.alpha_y * cos(tau))
    assert same(full(system, v.xi), delta(v))
    check(system, v.xtilde, v.c_x * delta(v) * sin(tau))
    check(system, v.ytilde, -v.c_y * delta(v) * cos(tau))
    check(system, v.e, v.h * delta(v))


def test_the_average_of_fig_1() -> None:
    """(10) to (14), per second."""
    averaged = average(fig_1())
    v = Letters(averaged.system)
    level = -(v.q_x * v.alpha_x**2 + v.q_y * v.alpha_y**2) / 2
    square = v.q_x * v.xtilde**2 + v.q_y * v.ytilde**2
    gains = [v.alpha_x * v.c_x * v.q_x, v.alpha_y * v.c_y * v.q_y]
    expected = [-gains[0] * v.xtilde, -gains[1] * v.ytilde, -v.h * (square + v.e - level)]
    for rate, law in zip(averaged.rates, expected, strict=True):
        assert same(rate, law)
    at = averaged.equilibrium_law
    assert at is not None
    assert [at[v.xtilde], at[v.ytilde]] == [0, 0]
    assert same(at[v.e], level)
    assert averaged.jacobian == sympy.diag(-gains[0], -gains[1], -v.h)


def test_the_figure_eight() -> None:
    """(17), (18)."""
    a, w, phase = 2.0, 0.3, 0.7
    found = es.FigureEight(a, w, phase).law()
    expected = (2 * sin(0.3 * t), 2 * cos(2 * 0.3 * t + 0.7))
    for law, wanted in zip(found, expected, strict=True):
        for time in (0.0, 1.3, 7.9):
            assert float(law.subs(t, time)) == pytest.approx(float(wanted.subs(t, time)))


def output(system: System, axis: str) -> Expr:
    """The compensator's output w, written out."""
    return full(system, Letters(system).known[f"w_{axis}"])


def total(system: System, expression: Expr) -> Expr:
    """d/dt along the system's solutions."""
    parts = (
        expression.diff(x) * full(system, rate)
        for x, rate in zip(system.states, system.rhs, strict=True)
    )
    return sympy.Add(expression.diff(t), *parts)


def check_output(system: System, slopes: tuple[Any, Any], swings: Expr) -> None:
    """(22), (23) and (47), (48) per second, with dΔ/dt from the position's rates `slopes`."""
    v = Letters(system)
    tau = v.omega * t
    change = -2 * v.q_x * (v.xtilde + v.alpha_x * sin(tau)) * slopes[0]
    change += -2 * v.q_y * (v.ytilde - v.alpha_y * cos(tau)) * slopes[1]
    change += -v.h * swings
    waves = {"x": (sin(tau), v.omega * cos(tau)), "y": (-cos(tau), v.omega * sin(tau))}
    for axis, (wave, slope) in waves.items():
        a = v.of(axis)
        w, gain = output(system, axis), a["c"] * a["k"]
        law = a["p"] * w + gain * (-a["z"] * swings * wave + swings * slope + wave * change)
        assert same(total(system, w), law), axis


def test_fig_2_in_relative_coordinates() -> None:
    """(19) to (23), per second: the proper compensator's output obeys the paper's equation."""
    system = relative(fig_2()).system
    v = Letters(system)
    tau = v.omega * t
    check(system, v.xtilde, v.vtilde_x)
    check(system, v.ytilde, v.vtilde_y)
    check(system, v.e, v.h * delta(v))
    check(system, v.vtilde_x, v.w_x)
    check(system, v.vtilde_y, v.w_y)
    fast = (
        v.vtilde_x + v.alpha_x * v.omega * cos(tau),
        v.vtilde_y + v.alpha_y * v.omega * sin(tau),
    )
    check_output(system, fast, delta(v))


def in_the_papers_states(averaged: Average) -> tuple[dict[str, Expr], dict[str, Symbol]]:
    """Rates per second by state, the compensators' outputs among the states, and the states."""
    states, rates, _ = paper_form(averaged.averaged)
    named = {str(x): x for x in states}
    return dict(zip(named, rates, strict=True)), named


def gain(v: Letters, axis: str) -> Expr:
    a = v.of(axis)
    return a["alpha"] * a["c"] * a["k"] * a["q"]


def test_the_average_of_fig_2() -> None:
    """(24) to (26), (29), (30); (27), (28) and (31) with z in place of z + h."""
    averaged = average(fig_2())
    v = Letters(averaged.system)
    rates, states = in_the_papers_states(averaged)
    level = -(v.q_x * v.alpha_x**2 + v.q_y * v.alpha_y**2) / 2
    square = v.q_x * v.xtilde**2 + v.q_y * v.ytilde**2
    assert same(rates["e"], -v.h * (square + v.e - level))
    factors = {sympy.expand(Symbol("s") + v.h)}
    for axis in ("x", "y"):
        a, g = v.of(axis), gain(v, axis)
        offset, velocity = states[f"{axis}tilde"], states[f"vtilde_{axis}"]
        w = states[f"w_{axis}"]
        assert same(rates[f"{axis}tilde"], velocity)
        assert same(rates[f"vtilde_{axis}"], w)
        assert same(rates[f"w_{axis}"], a["p"] * w + g * a["z"] * offset - g * velocity)
        s = Symbol("s")
        factors.add(sympy.expand(s**3 - a["p"] * s**2 + g * s - g * a["z"]))
    assert {as_polynomial(c) for c in averaged.characteristic} == factors
    at = averaged.equilibrium_law
    assert at is not None
    assert same(at[v.e], level)
    assert all(law == 0 for state, law in at.items() if state != v.e)


def as_polynomial(coefficients: tuple[Expr, ...] | None) -> Expr:
    assert coefficients is not None
    return sympy.expand(sympy.Poly(list(coefficients), Symbol("s")).as_expr())


def test_fig_3_in_relative_coordinates() -> None:
    """(42), (44) to (48), in the paper's x̃ = x − x* − α sin ωt, from the loop's own equations."""
    system = fig_3().system
    v = Letters(system)
    tau = v.omega * t
    waves = {"x": v.alpha_x * sin(tau), "y": -v.alpha_y * cos(tau)}
    offset = {axis: Symbol(f"{axis}tilde", real=True) for axis in waves}
    e = Symbol("e", real=True)
    table = {v.known[axis]: offset[axis] + v.source(axis) + waves[axis] for axis in waves}
    table[v.eta] = e + v.known["f^*"]
    swings = substituted(full(system, v.xi), table)
    first = v.q_x * (offset["x"] + waves["x"]) ** 2 + v.q_y * (offset["y"] + waves["y"]) ** 2
    assert same(swings, -(first + e))
    for axis, wave in waves.items():
        state = v.known[axis]
        own = full(system, system.rhs[system.states.index(state)])
        held = v.of(axis)["epsilon"] * (offset[axis] + v.source(axis) + wave)
        driven = held + substituted(output(system, axis), table)
        assert same(substituted(own, table) - wave.diff(t), driven)
    assert same(substituted(full(system, system.rhs[2]), table), v.h * swings)
    for axis, wave in waves.items():
        a = v.of(axis)
        m = a["c"] * swings * wave / a["alpha"]
        zeta = v.known[f"zeta_{axis}"]
        memory = substituted(full(system, system.rhs[system.states.index(zeta)]), table)
        # w = k m + ζ obeys (47): ẇ = p w + k ṁ − k z m
        assert same(substituted(output(system, axis), table), a["k"] * m + zeta)
        assert same(memory, a["p"] * (a["k"] * m + zeta) - a["k"] * a["z"] * m)


def test_the_average_of_fig_3() -> None:
    """(49) to (51); (52) to (59) with z − ε in place of z − 2ε + h."""
    averaged = average(fig_3())
    v = Letters(averaged.system)
    rates, states = in_the_papers_states(averaged)
    at = averaged.equilibrium_law
    assert at is not None
    factors = {sympy.expand(Symbol("s") + v.h)}
    level = -(v.q_x * v.alpha_x**2 + v.q_y * v.alpha_y**2) / 2
    square = v.q_x * v.xtilde**2 + v.q_y * v.ytilde**2
    assert same(rates["e"], -v.h * (square + v.e - level))
    for axis in ("x", "y"):
        a, g, source = v.of(axis), gain(v, axis), v.source(axis)
        e, z, p = a["epsilon"], a["z"], a["p"]
        offset, w = states[f"{axis}tilde"], states[f"w_{axis}"]
        assert same(rates[f"{axis}tilde"], e * (offset + source) + w)
        expected = (p - g) * w + g * (z - e) * offset - g * e * source
        assert same(rates[f"w_{axis}"], expected)
        right = p * e * source / (g * z - p * e)
        assert sympy.simplify(at[offset] - right) == 0
        # (57), (58): w holds the vehicle against its pole, −ε(x̃ᵉ + x*)
        still = sympy.solve(sympy.Eq(rates[f"{axis}tilde"].subs(offset, right), 0), w)[0]
        assert sympy.simplify(still + e * g * z * source / (g * z - p * e)) == 0
        level -= a["q"] * right**2
        s = Symbol("s")
        factors.add(sympy.expand(s**2 + (g - e - p) * s + p * e - g * z))
    assert sympy.simplify(at[v.e] - level) == 0
    assert {as_polynomial(c) for c in averaged.characteristic} == factors


# --- the table --------------------------------------------------------------------------------


def test_every_number_stands_in_the_table_once() -> None:
    listed = [n for e in EQUATIONS for n in range(e.first, e.last + 1)]
    assert listed == list(range(1, 66))


@pytest.mark.parametrize("equation", EQUATIONS, ids=lambda e: e.numbers)
def test_every_function_and_test_of_the_table_exists(equation: Equation) -> None:
    assert equation.functions
    assert equation.tests
    for name in equation.functions:
        module, _, function = name.rpartition(".")
        assert callable(getattr(importlib.import_module(f"extremum.{module}"), function)), name
    for test in equation.tests:
        page, _, name = test.partition("::")
        text = (ROOT / "tests" / page).read_text(encoding="utf-8")
        assert re.search(rf"^def {name}\(", text, re.MULTILINE), test


def test_what_is_not_as_printed_is_among_the_errata() -> None:
    named: set[int] = set()
    for erratum in ERRATA:
        where = re.sub(r"\((\d+)\) to \((\d+)\)", spelled, erratum.where)
        named |= {int(n) for n in re.findall(r"\((\d+)\)", where)}
    for equation in EQUATIONS:
        if equation.status in ("corrected", "not as measured"):
            assert named & set(range(equation.first, equation.last + 1)), equation.numbers
    assert {e.first for e in EQUATIONS if e.status == "lost"} == {41, 42}


def spelled(match: re.Match[str]) -> str:
    return " ".join(f"({n})" for n in range(int(match[1]), int(match[2]) + 1))


def test_the_page_shows_the_table() -> None:
    assert markdown() in (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
