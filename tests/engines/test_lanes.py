"""Tapes and steps against mpmath: what all ensemble engines print."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy
import tapes
from hypothesis import given
from hypothesis import strategies as some
from loops import velocity_actuated
from systems import system

import extremum as es
from extremum.engines.lanes.program import Ground, program
from extremum.engines.lanes.schemes import RK4, Taylor
from extremum.engines.lanes.tape import LOOP, STEP, UNIFORM, Tape
from extremum.engines.lanes.watch import Watch
from extremum.symbols import FUNCTIONS, parse, t

NUMBERS = some.floats(-1e3, 1e3)
WAVE, BEGUN = 2.3, 0.6


# --- the tape ----------------------------------------------------------------------------------


def test_equal_operations_are_recorded_once() -> None:
    tape = Tape()
    a, b = tape.leaf("value", 0, LOOP), tape.leaf("state", 0, STEP)
    assert tape.add(a, b) == tape.add(b, a)
    assert tape.multiply(a, b) == tape.multiply(b, a)
    assert tape.call("sin", a) == tape.call("sin", a)
    assert tape.subtract(a, b) != tape.subtract(b, a)
    assert tape.divide(a, b) != tape.divide(b, a)
    assert tape.call("atan2", a, b) != tape.call("atan2", b, a)
    assert tape.leaf("value", 0, LOOP) == a != tape.leaf("value", 1, LOOP)


def test_a_value_varies_with_what_it_is_made_of() -> None:
    tape = Tape()
    shared, own, state = (
        tape.leaf(name, 0, rate)
        for name, rate in (("tol", UNIFORM), ("value", LOOP), ("state", STEP))
    )
    assert tape.rate(tape.constant(2.0)) == UNIFORM
    assert tape.rate(tape.multiply(shared, tape.constant(2.0))) == UNIFORM
    assert tape.rate(tape.call("exp", tape.add(shared, own))) == LOOP
    assert tape.rate(tape.divide(own, state)) == STEP
    total = tape.operations[tape.total([state, own, shared])]
    assert {tape.rate(o) for o in total.operands} == {LOOP, STEP}  # what varies least first


def test_what_is_known_is_computed_at_once() -> None:
    tape = Tape()
    x, one, zero = tape.leaf("state", 0, STEP), tape.constant(1.0), tape.constant(0.0)
    assert tape.add(x, zero) == tape.add(zero, x) == tape.subtract(x, zero) == x
    assert tape.multiply(x, one) == tape.multiply(one, x) == tape.divide(x, one) == x
    assert tape.known(tape.multiply(x, zero)) == tape.known(tape.divide(zero, x)) == 0
    assert tape.multiply(x, tape.constant(-1.0)) == tape.negative(x) == tape.subtract(zero, x)
    assert tape.negative(tape.negative(x)) == x
    y = tape.leaf("state", 1, STEP)
    assert tape.add(x, tape.negative(y)) == tape.add(tape.negative(y), x) == tape.subtract(x, y)
    assert tape.subtract(x, tape.negative(y)) == tape.add(x, y)
    assert tape.known(tape.total([])) == 0
    assert tape.known(tape.product([])) == 1
    for name in FUNCTIONS:
        given = (0.7,) if name != "atan2" else (0.7, -0.3)
        given = (1.7,) if name == "acosh" else given
        value = tape.known(tape.call(name, *(tape.constant(g) for g in given)))
        assert value == pytest.approx(float(getattr(mpmath, name)(*given)), rel=1e-15)


def test_what_has_no_value_is_left_to_the_engine() -> None:
    tape = Tape()
    for name, argument in (("log", -1.0), ("sqrt", -1.0), ("exp", 1e6), ("acosh", 0.0)):
        assert tape.known(tape.call(name, tape.constant(argument))) is None
    assert tape.known(tape.divide(tape.constant(1.0), tape.constant(0.0))) is None


@given(some.lists(NUMBERS, min_size=4, max_size=4), some.sets(some.integers(0, 3)))
def test_folding_changes_no_value(numbers: list[float], folded: set[int]) -> None:
    """The same formula with some of its letters known is the same number."""

    def value(known: set[int]) -> float:
        tape = Tape()
        a, b, c, d = (
            tape.constant(x) if i in known else tape.leaf("value", i, LOOP)
            for i, x in enumerate(numbers)
        )
        top = tape.subtract(tape.product([a, b, c]), tape.negative(tape.total([a, c, d])))
        top = tape.convolution([(top, a), (tape.negative(b), c), (d, tape.subtract(a, b))])
        result = tape.divide(top, tape.add(tape.constant(2.0), tape.multiply(d, d)))
        leaves = {("value", i): x for i, x in enumerate(numbers)}
        return float(tapes.run(tape, leaves, math)[result])

    plain = value(set())
    scale = 1 + max(map(abs, numbers)) ** 4
    assert value(folded) == pytest.approx(plain, rel=1e-13, abs=1e-14 * scale)


def test_only_what_is_needed_is_listed_in_order() -> None:
    tape = Tape()
    a, b = tape.leaf("value", 0, LOOP), tape.leaf("value", 1, LOOP)
    unused = tape.call("exp", b)
    wanted = tape.call("sin", tape.multiply(a, a))
    needed = tape.needed([wanted])
    assert needed == sorted(needed)
    assert a in needed
    assert wanted in needed
    assert not {b, unused} & set(needed)
    assert tape.needed([]) == []


# --- steps -------------------------------------------------------------------------------------


def one_step(rates: str, scheme: Any, length: float, *, names: str = "x", **watched: Any) -> Any:
    """The states after a step of `length` (units of 1/w) from 1, …, and what is watched.

    a = 0.9, b = 0.4, w = 2.3; the step begins at t = 0.6.
    """
    made = system(rates, names=names, carriers="w")
    known = {str(x): x for x in (*made.states, *made.symbols, t)}
    watch = Watch(**{k: tuple(parse(e, known) for e in v) for k, v in watched.items()})
    step = program(made, (0,), scheme, watch)
    phase = WAVE * BEGUN
    leaves: dict[tuple[str, int], Any] = {
        ("value", 0): 0.9,
        ("value", 1): 0.4,
        ("value", 2): WAVE,
        ("time", 0): BEGUN,
        ("sine", 0): math.sin(phase),
        ("cosine", 0): math.cos(phase),
        ("part", 0): length,
        ("length", 0): length,
        ("left", 0): 0.25 * length,
        ("tol", 0): 1e-7,
    }
    leaves |= {("state", i): 1.0 + 0.3 * i for i in range(len(made.states))}
    values = tapes.run(step.tape, leaves)
    return step, values


def solved(rates: str, names: str, seconds: float, extra: tuple[str, ...] = ()) -> list[float]:
    """The same by mpmath's Taylor method in 40 digits; integrals of `extra` after the states."""
    made = system(rates, names=names, carriers="w")
    known = {str(x): x for x in (*made.states, *made.symbols, t)}
    flat = [*made.rhs, *(parse(e, known) for e in extra)]
    f = sympy.lambdify([t, *made.states, *made.symbols], flat, "mpmath")
    count = len(made.states)
    numbers = (mpmath.mpf(0.9), mpmath.mpf(0.4), mpmath.mpf(WAVE))
    start = [1.0 + 0.3 * i for i in range(count)] + [0.0] * len(extra)
    with mpmath.workdps(25):
        found = mpmath.odefun(lambda s, y: f(s, *y[:count], *numbers), BEGUN, start)
        return [float(v) for v in found(BEGUN + seconds)]


RATES = "-a*x*y + b*cos(w*t)*w, x*sin(w*t)/2 - y*sqrt(1 + x**2)"


@pytest.mark.parametrize("order", [8, 12, 20])
def test_a_taylor_step_misses_by_its_next_term(order: int) -> None:
    def error(length: float) -> float:
        step, values = one_step(RATES, Taylor(order), length, names="x,y")
        found = [float(values[v]) for v in step.step.states]
        wanted = solved(RATES, "x,y", length / WAVE)
        return max(abs(a - b) for a, b in zip(found, wanted, strict=True))

    long, short = (1.0, 0.7) if order == 20 else (0.8, 0.4)
    slope = math.log(error(long) / error(short)) / math.log(long / short)
    assert slope == pytest.approx(order + 1, abs=1.2)


def test_a_step_of_rk4_misses_by_the_fifth_power() -> None:
    def error(length: float) -> float:
        step, values = one_step(RATES, RK4, length, names="x,y")
        found = [float(values[v]) for v in step.step.states]
        wanted = solved(RATES, "x,y", length)
        return max(abs(a - b) for a, b in zip(found, wanted, strict=True))

    slope = math.log(error(0.04) / error(0.02)) / math.log(2)
    assert slope == pytest.approx(5, abs=0.3)


def test_the_coefficients_of_rk4_satisfy_the_order_conditions() -> None:
    """Up to order 4; Hairer, Nørsett and Wanner I, section II.1."""
    a = np.zeros((4, 4))
    for i, row in enumerate(RK4.a):
        a[i, : len(row)] = row
    b, c = np.array(RK4.b), a.sum(axis=1)
    conditions = {
        1: b.sum(),
        1 / 2: b @ c,
        1 / 3: b @ c**2,
        1 / 6: b @ a @ c,
        1 / 4: b @ c**3,
        1 / 8: (b * c) @ a @ c,
        1 / 12: b @ a @ c**2,
        1 / 24: b @ a @ a @ c,
    }
    for wanted, found in conditions.items():
        assert found == pytest.approx(wanted, abs=1e-15)


@pytest.mark.parametrize("scheme", [Taylor(16), RK4])
def test_means_of_one_step_are_integrals(scheme: Any) -> None:
    length = 0.2 if scheme is not RK4 else 0.002
    seconds = length / WAVE if scheme is not RK4 else length
    unit = 1 / WAVE if scheme is not RK4 else length
    extra = ("x**2*y", "cos(w*t)*x", "1 + 0*x")
    step, values = one_step(RATES, scheme, length, names="x,y", mean=("x**2*y", "cos(w*t)*x", "1"))
    found = [float(values[v]) * unit for v in step.step.means]
    assert found == pytest.approx(solved(RATES, "x,y", seconds, extra)[2:], rel=1e-10)


def test_the_last_window_takes_its_share_of_a_step() -> None:
    length = 0.2
    step, values = one_step(RATES, Taylor(16), length, names="x,y", last_mean=("x*y",))
    parts = [solved(RATES, "x,y", share * length / WAVE, ("x*y",))[2] for share in (0.25, 1.0)]
    assert float(values[step.step.last[0]]) / WAVE == pytest.approx(parts[1] - parts[0], rel=1e-10)


def test_looks_see_a_maximum_and_a_crossing_within_a_step() -> None:
    """x = cos τ and v = −sin τ from τ = 0 at x = 1, v = 1.3: amplitude √(1 + 1.3²)."""
    step, values = one_step(
        "w*v, -w*x", Taylor(16), 2.0, names="x,v", maxima=("x", "-x"), beyond=("x", "-5 + 0*x")
    )
    assert float(values[step.step.maxima[0]]) == pytest.approx(math.hypot(1, 1.3), rel=0.01)
    end = math.cos(2.0) + 1.3 * math.sin(2.0)
    assert float(values[step.step.maxima[1]]) == pytest.approx(-end, rel=1e-9)
    last = 2.0  # x > 0 until atan2(1.3, 1) + π/2 = 2.49
    assert float(values[step.step.beyond[0]]) == pytest.approx(last, abs=1e-12)
    assert float(values[step.step.beyond[1]]) == -1


def test_the_step_keeps_the_last_terms_at_the_tolerance() -> None:
    """ẋ = a x in units of 1/w: x_k = (a/w)^k/k!, and w^p (x_p + x_{p−1}/4) = tol (1 + |x|)."""
    order = 10
    step, values = one_step("a*x", Taylor(order), 1.0)
    assert step.step.part is not None
    rate = 0.9 / WAVE
    terms = [rate**k / math.factorial(k) for k in (order, order - 1)]
    wanted = (1e-7 / ((terms[0] + terms[1] / 4) / 2)) ** (1 / order)
    assert float(values[step.step.part]) == pytest.approx(wanted, rel=1e-9)


def test_sums_of_one_angle_are_one_oscillator() -> None:
    made = velocity_actuated().system
    for scheme in (Taylor(8), RK4):
        assert len(program(made, (), scheme, Watch()).angles) == 1
    figure = es.FigureEight(0.3, 0.5)
    moving = velocity_actuated(field=es.Moving(es.Quadratic((0, 0), (1, 1), 1), figure))
    assert len(program(moving.system, (), Taylor(8), Watch()).angles) == 3


def test_an_oscillators_angle_is_exact_where_frequencies_are_multiples() -> None:
    """ωH = 1, and the ratio for the other channel: the same for all loops, whatever their ω."""
    loop = velocity_actuated(**{"controller.channels.1.ratio": 2})
    made = loop.system
    place = [p.path for p in made.parameters].index("controller.frequency")
    step = program(made, (place,), Taylor(8), Watch())
    assert [step.tape.known(angle) for angle in step.angles] == [1, 2]


def test_what_does_not_vary_is_not_computed_at_every_step() -> None:
    made = velocity_actuated().system
    names = [p.path for p in made.parameters]
    few = program(made, (), Taylor(8), Watch())
    many = program(made, tuple(range(len(names))), Taylor(8), Watch())
    assert few.flops() == many.flops()
    uniform = [o for o in few.tape.operations if o.rate == LOOP]
    assert not uniform


def test_no_time_in_what_is_constant() -> None:
    ground = Ground(velocity_actuated().system, (), True)
    with pytest.raises(TypeError, match="depends on time"):
        ground.constants.read(sympy.sin(3 * t))
