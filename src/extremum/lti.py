"""Linear dynamics: rational transfer functions of `s`, their states and their frequency response.

A transfer function is a description like any other: its numbers are parameters, its form (degrees,
exact zeros, leading ones, a text's letters) is structure.
"""

from __future__ import annotations

import numbers
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
import sympy
from sympy import Expr, Symbol

from .description import Description, flatten, structure, value
from .errors import InvalidDescription, shown
from .parameters import symbolic
from .rational import Ratio, ratio
from .symbols import decimals_exact, exact, letters, parse, plain, s, substituted


class Transfer(Description, abstract=True):
    """A proper rational transfer function; subclasses state it as `law`."""

    @abstractmethod
    def law(self) -> Expr:
        """Return the transfer function as an expression in `s`."""

    def text(self) -> str | None:
        """Return the text that writes it in a scenario, or None if it is written as a table."""
        return None

    def __str__(self) -> str:
        return str(ratio(self.law()))

    @cached_property
    def form(self) -> Ratio:
        """Numerator and denominator with letters for the numbers: what is structure, not chance."""
        twin, _ = symbolic(self, 1, {})
        return ratio(twin.law())

    @cached_property
    def poles(self) -> tuple[complex, ...]:
        """The poles (1/s) of its states, also those that a zero cancels by chance of numbers."""
        _, parameters = symbolic(self, 1, {})
        numbers = map(plain, flatten(self)[1])
        table = {p.symbol: number for p, number in zip(parameters, numbers, strict=True)}
        return tuple(np.roots([float(substituted(c, table)) for c in self.form.denominator]))

    def relative_degree(self) -> int:
        """Return the denominator's degree minus the numerator's."""
        form = self.form
        return form.order - form.numerator_degree


class TransferFunction(Transfer):
    """G(s) = gain · (sᵐ + … + b₁ s + b₀) / (sⁿ + … + a₁ s + a₀), from its coefficients.

    Written as an expression of `s` everywhere a transfer function is wanted (``1/s``,
    ``(s + 0.25)/s``, ``1/(s*(s + 0.7))``): common factors are cancelled exactly first.
    Coefficients that are 0, and a gain of 1, are structure; the others are parameters.
    """

    gain: float = value("k", "", "the leading coefficient", default=1.0, literal=lambda g: g == 1.0)
    num: tuple[float, ...] = value(
        "b",
        "{per}",
        "numerator below its leading 1, highest power first",
        default=(),
        shape="coefficients",
        literal=lambda b: b == 0.0 or b == (),
    )
    den: tuple[float, ...] = value(
        "a",
        "{per}",
        "denominator below its leading 1, highest power first",
        default=(),
        shape="coefficients",
        literal=lambda a: a == 0.0 or a == (),
    )

    def check(self) -> None:
        """Refuse an improper transfer function."""
        _check_proper(len(self.num), len(self.den), self.text())

    def law(self) -> Expr:
        """Return gain · (sᵐ + …)/(sⁿ + …)."""
        return plain(self.gain) * _monic(self.num) / _monic(self.den)

    def text(self) -> str:
        """Return the expression of `s` that writes this transfer function without loss."""
        num, den = _monic_text(self.num), _monic_text(self.den)
        if self.gain != 1.0:
            num = repr(self.gain) if num == "1" else f"{self.gain!r}*({num})"
        elif num != "1" and den != "1":
            num = f"({num})"
        if den == "1":
            return num
        return f"{num}/{den}" if den == "s" else f"{num}/({den})"

    def __repr__(self) -> str:
        return self.text()

    __str__ = __repr__


class Lead(Transfer):
    """Phase-lead compensator C(s) = k (s − z)/(s − p); a lead for p < z < 0.

    Source: Zhang, Siranosian and Krstić (2007), Fig. 2.
    """

    gain: float = value("k", "", "k, its gain at high frequency")
    zero: float = value("z", "1/s", "z, its zero")
    pole: float = value("p", "1/s", "p, its pole")

    def law(self) -> Expr:
        """Return k (s − z)/(s − p)."""
        return plain(self.gain) * (s - plain(self.zero)) / (s - plain(self.pole))


class Rational(Transfer):
    """A transfer function whose letters survive into the equations.

    ``Rational("k*(s - z)/(s - p)", parameters={"k": 5, "z": -0.5, "p": -3})``; numbers written in
    the text are structure, the parameters are values.
    """

    formula: str = structure("a rational expression of s and the parameters")
    parameters: Mapping[str, float] = value(
        "", "", "values of the letters", default=None, shape="table"
    )

    def check(self) -> None:
        """Refuse text that is no proper rational function of `s`."""
        if not isinstance(self.formula, str):
            raise InvalidDescription("formula", "must be text", shown(self.formula))
        try:
            form = ratio(self._read(letters(self.parameters)))
        except InvalidDescription as error:
            raise error.within("formula") from None
        _check_proper(form.numerator_degree, form.order, self.formula)
        named = letters(self.parameters)
        put: dict[Any, Any] = {named[name]: plain(v) for name, v in self.parameters.items()}
        coefficients = (*form.numerator, *form.denominator)
        if any(cast(Any, c).subs(put).is_finite is False for c in coefficients):
            raise InvalidDescription(
                "formula",
                f"loses its highest power of s at {dict(self.parameters)}; write the simpler "
                "transfer function",
                shown(self.formula),
            )

    def _read(self, names: Mapping[str, Any]) -> Expr:
        return parse(self.formula, {"s": s, **names})

    def law(self) -> Expr:
        """Return the expression, with the parameters' symbols or numbers for its letters."""
        return self._read({name: plain(v) for name, v in self.parameters.items()})


def transfer(given: Any) -> Any:
    """Return the `Transfer` that `given` states.

    Accepts a `Transfer`, a number, a rational SymPy expression in `s`, text of one, or a
    continuous single-input single-output python-control object.
    """
    if isinstance(given, Transfer):
        return given
    if isinstance(given, str):
        return _from_expression(parse(given, {"s": s}), given)
    if isinstance(given, Expr):
        unknown = given.free_symbols - {s}
        if unknown:
            names = ", ".join(sorted(str(symbol) for symbol in unknown))
            raise InvalidDescription(
                "",
                f"has the letters {names} besides s; give them values with "
                f'Rational("…", parameters={{"{next(iter(sorted(map(str, unknown))))}": …}})',
                shown(str(given)),
            )
        return _from_expression(decimals_exact(given), str(given))
    if isinstance(given, numbers.Real) and not isinstance(given, bool):
        return TransferFunction(gain=float(given))
    if type(given).__module__.partition(".")[0] == "control":
        return _from_control(given)
    raise InvalidDescription(
        "", "must be a rational expression of s, such as 1/s or (s + 1)/(s + 10)", shown(given)
    )


@dataclass(frozen=True)
class Realisation:
    """ẋ = A x + B u, y = x₁ + D u: the minimal states of a proper transfer function.

    Attributes
    ----------
    rates
        ẋ as expressions of `states` and the input.
    output
        y.
    rest
        The states with output 1 and, without input, the derivatives of the output below the order
        0: what "at rest at position 1" means; multiplied by a position, the vehicle rests there.
    response
        X(s)/U(s), each state's transfer function from the input.
    """

    states: tuple[Symbol, ...]
    rates: tuple[Expr, ...]
    output: Expr
    rest: tuple[Expr, ...]
    response: tuple[Expr, ...]


def realise(expression: Expr, entering: Expr, states: tuple[Symbol, ...]) -> Realisation:
    """Return G(s) as differential equations in the given states.

    With a constant numerator the states are the output and its derivatives (phase variables),
    ẋ₁ = x₂, …, ẋₙ = −Σ aᵢ x + b u; otherwise observer form, ẋᵢ = −a x₁ + xᵢ₊₁ + b u, after the
    direct term D has been split off, y = x₁ + D u. The output's input is never differentiated.
    """
    form = ratio(expression)
    order, a = form.order, form.denominator[1:]
    if order == 0:
        gain = form.numerator[0]
        return Realisation((), (), gain * entering, (), ())
    if len(states) != order:
        raise ValueError(f"{order} states are needed, {len(states)} given")
    padded = (sympy.Integer(0),) * (order + 1 - len(form.numerator)) + form.numerator
    direct = padded[0]
    b = tuple(sympy.factor(c - direct * ai) for c, ai in zip(padded[1:], a, strict=True))
    output = states[0] + direct * entering
    if form.numerator_degree == 0:
        feedback = sum((-c * x for c, x in zip(a, reversed(states), strict=True)), sympy.Integer(0))
        rates = (*states[1:], sympy.factor_terms(feedback + b[-1] * entering))
        rest = (sympy.Integer(1),) + (sympy.Integer(0),) * (order - 1)
        response = tuple(s**i * expression for i in range(order))
        return Realisation(states, rates, output, rest, response)
    shifted = (*states[1:], sympy.Integer(0))
    rates = tuple(
        -ai * states[0] + x + bi * entering for ai, x, bi in zip(a, shifted, b, strict=True)
    )
    strictly_proper = expression - direct
    response = [strictly_proper]
    for ai, bi in zip(a[:-1], b[:-1], strict=True):
        response.append(s * response[-1] + ai * strictly_proper - bi)
    return Realisation(states, rates, output, (sympy.Integer(1), *a[:-1]), tuple(response))


def settled(expression: Expr) -> tuple[Expr, ...]:
    """Return the states of a stable G(s) that has come to rest under the constant input 1."""
    states = tuple(sympy.Dummy() for _ in range(ratio(expression).order))
    responses = realise(expression, sympy.Integer(0), states).response
    still = {s: sympy.Integer(0)}
    return tuple(sympy.factor(substituted(sympy.cancel(e), still)) for e in responses)  # pyright: ignore[reportReturnType]


def static_gain(expression: Expr) -> Expr:
    """Return G(0) of a stable G(s)."""
    form = ratio(expression)
    return form.numerator[-1] / form.denominator[-1]  # pyright: ignore[reportReturnType]


# --- reading what a user wrote ----------------------------------------------------------------


def _monic(coefficients: tuple[Any, ...]) -> Expr:
    powers = range(len(coefficients) - 1, -1, -1)
    tail = sum((plain(c) * s**i for c, i in zip(coefficients, powers, strict=True)), s * 0)
    return s ** len(coefficients) + tail


def _monic_text(coefficients: tuple[float, ...]) -> str:
    degree = len(coefficients)
    terms = [_power_text(degree) or "1"]
    for power, c in zip(range(degree - 1, -1, -1), coefficients, strict=True):
        if c:
            factor = _power_text(power)
            size = repr(abs(c))
            terms.append(f"{'-' if c < 0 else '+'} {size}{f'*{factor}' if factor else ''}")
    return " ".join(terms)


def _power_text(power: int) -> str:
    return "" if power == 0 else "s" if power == 1 else f"s**{power}"


def _check_proper(numerator_degree: int, order: int, text: str | None) -> None:
    if numerator_degree > order:
        raise InvalidDescription(
            "",
            f"is improper: its numerator's degree {numerator_degree} exceeds its denominator's "
            f"{order}; it would differentiate its input. Add {numerator_degree - order} fast "
            "pole(s)",
            shown(text),
        )


def _from_expression(expression: Expr, text: str) -> TransferFunction:
    try:
        form = ratio(expression)
    except InvalidDescription as error:
        raise InvalidDescription("", error.reason, shown(text)) from None
    numerator, denominator = form.numerator, form.denominator
    _check_proper(form.numerator_degree, form.order, text)
    gain = numerator[0]
    if not all(c.is_real for c in (*numerator, *denominator)):
        raise InvalidDescription("", "must have real coefficients", shown(text))
    monic = tuple(float(c / gain) for c in numerator[1:]) if gain else ()
    return TransferFunction(float(gain), monic, tuple(float(c) for c in denominator[1:]))


def _from_control(given: Any) -> TransferFunction:
    if getattr(given, "ninputs", 1) != 1 or getattr(given, "noutputs", 1) != 1:
        raise InvalidDescription("", "must have one input and one output", type(given).__name__)
    if getattr(given, "dt", 0) not in (0, None):
        raise InvalidDescription(
            "", f"is sampled (dt = {given.dt}); a continuous transfer function is needed"
        )
    if not hasattr(given, "num") and not hasattr(given, "A"):
        raise InvalidDescription(
            "", "must be a rational transfer function or a state space", type(given).__name__
        )
    if hasattr(given, "num"):
        num, den = (
            sum((exact(c) * s**i for i, c in enumerate(reversed(cs))), s * 0)
            for cs in (given.num[0][0], given.den[0][0])
        )
        return _from_expression(num / den, str(given))
    matrices = (
        sympy.Matrix(m.shape[0], m.shape[1], [exact(v) for v in m.ravel()])
        for m in (given.A, given.B, given.C, given.D)
    )
    a, b, c, d = matrices
    resolvent = s * sympy.eye(a.rows) - a
    return _from_expression(
        (c * resolvent.adjugate() * b)[0, 0] / resolvent.det() + d[0, 0], str(given)
    )
