from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import extremum as es
from extremum import s
from extremum.lti import realise, transfer
from extremum.rational import at_frequency, ratio, response_parts

OMEGAS = (0.1357, 0.7123, 1.1234, 5.4321, 40.123)  # no poles of the examples below
coefficient = st.integers(-40, 40).map(lambda n: n / 8)


@st.composite
def proper(draw: Any) -> tuple[list[float], list[float]]:
    order = draw(st.integers(1, 4))
    num = draw(st.lists(coefficient, min_size=1, max_size=order + 1))
    den = draw(st.lists(coefficient, min_size=order, max_size=order))
    return (num if any(num) else [1.0]), [1.0, *den]


def matrices(expression: sympy.Expr) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C, D read off the realisation's equations by differentiating them."""
    states = tuple(sympy.Symbol(f"x{i}") for i in range(ratio(expression).order))
    entering = sympy.Symbol("u")
    block = realise(expression, entering, states)
    rates, output = sympy.Matrix(block.rates), sympy.Matrix([block.output])

    def numbers(m: Any) -> np.ndarray:
        return np.array(m.tolist(), dtype=float).reshape(m.shape)

    return (
        numbers(rates.jacobian(states)) if states else np.zeros((0, 0)),
        numbers(rates.jacobian([entering])) if states else np.zeros((0, 1)),
        numbers(output.jacobian(states)) if states else np.zeros((1, 0)),
        numbers(output.jacobian([entering])),
    )


def written(num: list[float], den: list[float]) -> sympy.Expr:
    top, bottom = (sum((c * s**i for i, c in enumerate(reversed(cs))), 0 * s) for cs in (num, den))
    return top / bottom


@settings(max_examples=80, deadline=None)
@given(proper())
def test_realisation_has_the_frequency_response_that_python_control_computes(
    polynomials: tuple[list[float], list[float]],
) -> None:
    num, den = polynomials
    a, b, c, d = matrices(transfer(written(num, den)).law())
    theirs: Any = control.tf(num, den)
    for omega in OMEGAS:
        expected = complex(theirs(1j * omega))
        ours = (c @ np.linalg.solve(1j * omega * np.eye(len(a)) - a, b) + d)[0, 0]
        assert ours == pytest.approx(expected, rel=1e-8, abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(proper())
def test_python_control_objects_are_accepted_without_rounding(
    polynomials: tuple[list[float], list[float]],
) -> None:
    num, den = polynomials
    expected = transfer(written(num, den))
    assert transfer(control.tf(num, den)) == expected
    a, b, c, d = matrices(expected.law())
    if len(a):
        from_states = transfer(control.ss(a, b, c, d))
        for omega in OMEGAS:
            assert at_frequency(from_states.law(), omega) == pytest.approx(
                at_frequency(expected.law(), omega), rel=1e-9, abs=1e-12
            )


@settings(max_examples=60, deadline=None)
@given(proper())
def test_text_states_a_transfer_function_without_loss(
    polynomials: tuple[list[float], list[float]],
) -> None:
    expected = transfer(written(*polynomials))
    assert transfer(expected.text()) == expected


@pytest.mark.parametrize(
    ("expression", "order"),
    [
        ((s + 1) * (s - 1) / (s * (s - 1)), 1),
        ((s + 0.1) * (s + 0.2) / ((s + 0.1) * s**2), 2),
        ((0.1 * s + 0.3) / ((s + 3) * s), 1),
        (1 / (s * (s + 0.7)), 2),
        (sympy.Integer(3), 0),
        ("(s + 1)**2/((s + 1)*(s + 2)*(s + 3))", 2),
    ],
)
def test_common_factors_are_cancelled_exactly(expression: Any, order: int) -> None:
    assert ratio(transfer(expression).law()).order == order


@pytest.mark.parametrize("text", ["1/s", "1/s**2", "(s + 2)/(s*(s + 0.7))", "1/((s+1)*(s+2)*s)"])
def test_rest_means_that_no_derivative_moves_without_input(text: str) -> None:
    law = transfer(text).law()
    a, _, c, _ = matrices(law)
    states = tuple(sympy.Symbol(f"x{i}") for i in range(len(a)))
    rest = np.array(realise(law, sympy.Integer(0), states).rest, dtype=float)
    observed = np.concatenate([c @ np.linalg.matrix_power(a, k) for k in range(len(a))])
    assert observed @ rest == pytest.approx([1.0] + [0.0] * (len(a) - 1), abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(proper())
def test_state_responses_solve_the_state_equation(
    polynomials: tuple[list[float], list[float]],
) -> None:
    law = transfer(written(*polynomials)).law()
    a, b, _, _ = matrices(law)
    states = tuple(sympy.Symbol(f"x{i}") for i in range(len(a)))
    block = realise(law, sympy.Integer(0), states)
    omega = 1.3
    expected = np.linalg.solve(1j * omega * np.eye(len(a)) - a, b)[:, 0]
    responses: Any = block.response
    ours = [complex(r.subs(s, sympy.I * omega)) for r in responses]
    assert ours == pytest.approx(list(expected), rel=1e-8, abs=1e-8)


def test_response_parts_are_the_real_and_imaginary_part_at_any_frequency() -> None:
    omega, k = sympy.symbols("omega k", positive=True)
    law = k * (s + 2) / (s * (s**2 + s + 3))
    real, imaginary = response_parts(law, omega)
    for value in OMEGAS:
        put: Any = (real + sympy.I * imaginary).subs({omega: value, k: 2.5})
        ours = complex(put)
        jw = 1j * value
        assert ours == pytest.approx(2.5 * (jw + 2) / (jw * (jw**2 + jw + 3)), rel=1e-12)


def test_letters_survive_into_the_equations() -> None:
    lead = es.Rational("k*(s - z)/(s - p)", parameters={"k": 5, "z": -0.5, "p": -3})
    twin = es.Lead(gain=5, zero=-0.5, pole=-3)
    for omega in OMEGAS:
        assert at_frequency(lead.law(), omega) == pytest.approx(at_frequency(twin.law(), omega))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("s", "improper"),
        ((s**2 + 1) / (s + 1), "improper"),
        (sympy.exp(-s) / s, "rational function of s"),
        (1 / (s + sympy.Symbol("a")), "letters a besides s"),
        (1 / (s + sympy.I), "real coefficients"),
        ("1/(s - s)", "division by zero"),
        (None, "rational expression of s"),
        (control.tf([1], [1, 0.5], dt=0.1), "sampled"),
        ((s + 1) ** 64 / (s + 2) ** 64, "degree"),
    ],
)
def test_what_is_no_proper_rational_function_is_refused(given: Any, words: str) -> None:
    with pytest.raises(es.InvalidDescription, match=words):
        transfer(given)
