"""The parser: numbers as an independent evaluator gives them, and nothing but mathematics."""

from __future__ import annotations

import contextlib
import math
import time
from typing import Any

import mpmath
import pytest
import sympy
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from extremum import InvalidDescription
from extremum.symbols import FUNCTIONS, coordinates, exact, parse, parse_number, t

X, Y = coordinates(2)
NAMES = {"x": X, "y": Y, "t": t}
AT = {"x": 0.7, "y": -1.3, "t": 0.4}

TEMPLATES = {
    "exp(-({})**2)": lambda u: mpmath.exp(-(u**2)),
    "log(1 + ({})**2)": lambda u: mpmath.log(1 + u**2),
    "sqrt(1 + ({})**2)": lambda u: mpmath.sqrt(1 + u**2),
    "sin({})": mpmath.sin,
    "cos({})": mpmath.cos,
    "tan({})": mpmath.tan,
    "asin(sin({})/2)": lambda u: mpmath.asin(mpmath.sin(u) / 2),
    "acos(sin({})/2)": lambda u: mpmath.acos(mpmath.sin(u) / 2),
    "atan({})": mpmath.atan,
    "sinh(cos({}))": lambda u: mpmath.sinh(mpmath.cos(u)),
    "cosh(cos({}))": lambda u: mpmath.cosh(mpmath.cos(u)),
    "tanh({})": mpmath.tanh,
    "asinh({})": mpmath.asinh,
    "acosh(2 + ({})**2)": lambda u: mpmath.acosh(2 + u**2),
    "atanh(sin({})/2)": lambda u: mpmath.atanh(mpmath.sin(u) / 2),
    "-({})": lambda u: -u,
    "+({})": lambda u: u,
    "({})**2": lambda u: u**2,
    "({})**3": lambda u: u**3,
}


def numeral(number: float | int) -> tuple[str, Any]:
    return repr(number), mpmath.mpf(repr(number))


LEAVES = st.one_of(
    st.sampled_from([(name, mpmath.mpf(repr(value))) for name, value in AT.items()]),
    st.just(("pi", mpmath.mpf(math.pi))),
    st.integers(0, 9).map(numeral),
    st.floats(0.001, 99).map(lambda number: numeral(round(number, 3))),
)


def called(inner: tuple[str, Any], template: str) -> tuple[str, Any]:
    text, number = inner
    return template.format(text), TEMPLATES[template](number)


def joined(left: tuple[str, Any], right: tuple[str, Any], sign: str) -> tuple[str, Any]:
    a, b = left[1], right[1]
    assume(sign != "/" or abs(b) > 1e-6)
    number = {"+": a + b, "-": a - b, "*": a * b}[sign] if sign != "/" else a / b
    assume(abs(number) < 1e12)
    return f"({left[0]}){sign}({right[0]})", number


EXPRESSIONS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(called, inner, st.sampled_from(sorted(TEMPLATES))),
        st.builds(joined, inner, inner, st.sampled_from("+-*/")),
    ),
    max_leaves=8,
)


@pytest.fixture(autouse=True)
def digits():
    with mpmath.workdps(50):
        yield


def understood(text: str) -> Any:
    try:
        return parse(text, NAMES)
    except InvalidDescription as error:
        assume("beyond" not in error.reason)  # exponents and exact fractions that grow too large
        raise


def numeric(expression: Any) -> Any:
    values = {symbol: exact(AT[name]) for name, symbol in NAMES.items()}
    return mpmath.mpmathify(
        expression.subs({**values, sympy.pi: sympy.Rational(*math.pi.as_integer_ratio())}).evalf(40)
    )


@settings(deadline=None, max_examples=150)
@given(EXPRESSIONS)
@example(("9/10-0.9", mpmath.mpf(0)))  # decimals are exact
@example(("2**3**2-512", mpmath.mpf(0)))
@example(("-2**2", mpmath.mpf(-4)))
def test_numbers_agree_with_an_independent_evaluator(drawn):
    text, expected = drawn
    assume(abs(expected) < 1e12)
    found = numeric(understood(text))
    assert abs(found - expected) <= 1e-9 * (1 + abs(expected))


@settings(deadline=None, max_examples=100)
@given(EXPRESSIONS)
def test_what_is_printed_is_read_as_the_same_expression(drawn):
    read = understood(drawn[0])
    assume(not read.has(sympy.E))  # printed as E, which is no name here
    again = numeric(parse(str(read), NAMES))
    assert abs(again - numeric(read)) <= 1e-25 * (1 + abs(again))


MALICIOUS = {
    "import": "__import__('os').system('true')",
    "dunder": "__builtins__",
    "attribute": "x.__class__",
    "attribute of a number": "(1).real",
    "unknown call": "foo(x)",
    "call of a name": "x(y)",
    "call of a number": "1(2)",
    "call of a call": "sin(x)(y)",
    "called lambda": "(lambda: 0)()",
    "lambda": "lambda: 1",
    "comprehension": "[i for i in x]",
    "generator": "sum(i for i in x)",
    "list": "[x]",
    "tuple": "x, y",
    "set": "{x}",
    "walrus": "(z := 1)",
    "f-string": "f'{x}'",
    "string": "'a'",
    "bytes": "b'a'",
    "ellipsis": "...",
    "complex": "1j",
    "truth": "True",
    "nothing": "None",
    "subscript": "x[0]",
    "star": "sin(*x)",
    "double star": "sin(**x)",
    "keyword argument": "sin(x=1)",
    "too many arguments": "sin(x, y)",
    "too few arguments": "atan2(x)",
    "no arguments": "sin()",
    "bare function": "sin",
    "comparison": "x < y",
    "conditional": "x if y else t",
    "and": "x and y",
    "not": "not x",
    "invert": "~x",
    "floor": "x // 2",
    "modulo": "x % 2",
    "matrix product": "x @ y",
    "shift": "1 << 999999999",
    "caret": "x^2",
    "tower": "9**9**9",
    "tower of squares": "x**2**2**2**2",
    "powers of powers": "(9**64)**64",
    "many powers": "(((9**64)**64)**64)**64",
    "powers of x": "(((x + 1)**64)**64)**64",
    "products of powers": "x**64*x**64",
    "exponentials": "exp(exp(exp(9)))",
    "large product": "1e300*1e300",
    "small product": "1e-300*1e-300",
    "10 MB": "x" * 10_000_000,
    "10 MB of sums": "x+" * 5_000_000 + "x",
    "deep parentheses": "(" * 10_000 + "x" + ")" * 10_000,
    "deep minus": "-" * 9_999 + "x",
    "deep minus and parentheses": "-(" * 3_000 + "x" + ")" * 3_000,
    "deep calls": "sin(" * 1_600 + "x" + ")" * 1_600,
    "calls within the parser's depth": "sin(" * 150 + "x" + ")" * 150,
    "deep powers": "**".join(["x"] * 3_000),
    "huge": "9" * 5_000,
    "huge but read by Python": "9" * 4_000,
    "huge in hexadecimal": "0x" + "f" * 9_000,
    "too large": "1e400",
    "beyond": "1e308",
    "zero divisor": "1/0",
    "hidden zero divisor": "x/(y - y)",
    "zero to a negative power": "0**-1",
    "root of -1": "sqrt(-1)",
    "imaginary power": "(-1)**0.5",
    "logarithm of 0": "log(0)",
    "logarithm of -1": "log(-1)",
    "arc cosine of 2": "acos(2)",
    "pole of tan": "tan(pi/2)",
    "undefined angle": "atan2(0, 0)",
    "hidden imaginary": "x + sqrt(-x**2)",
    "hidden infinity": "tan(atan2(x, 0))",
    "empty": "",
    "blank": " \t\n ",
    "comment only": "# x",
    "keyword": "lambda",
    "if": "if",
    "statement": "import os",
    "assignment": "x = 1",
    "two statements": "x; y",
    "null byte": "x\0",
    "null byte first": "\0x",
    "Cyrillic letter": "\u0445",
    "Greek pi": "π*x",
    "superscript": "x²",
    "Unicode minus": "x − y",
    "surrogate": "\ud800",
    "unknown name": "w",
    "imaginary unit": "I",
    "SymPy's infinity": "oo",
    "nan": "nan",
    "juxtaposition": "2x",
}


@pytest.mark.parametrize("text", MALICIOUS.values(), ids=MALICIOUS)
def test_anything_else_is_refused_at_once(text):
    begun = time.perf_counter()
    with pytest.raises(InvalidDescription) as refused:
        parse(text, NAMES)
    assert time.perf_counter() - begun < 1
    assert len(str(refused.value)) < 400
    assert "\n" not in str(refused.value)


def test_nothing_is_evaluated(tmp_path):
    marker = tmp_path / "marker"
    for text in (f"open({str(marker)!r}, 'w')", f"__import__('os').mkdir({str(marker)!r})"):
        with pytest.raises(InvalidDescription):
            parse(text, NAMES)
    assert not marker.exists()


ODD = ["0x", "1e", "e9", "1e300", "99", "_", "pi", "**", "//", "'", '"', "f'", "if", "for", "in"]
ODD += ["is", "é", "\0", "\n", "\t"]
TOKENS = st.sampled_from([*FUNCTIONS, *NAMES, *"+-*/()^,.:=!~%@[]{}#\\ 01", *ODD])


@settings(deadline=2000, max_examples=300)
@given(st.lists(TOKENS, max_size=20).map("".join))
def test_any_text_is_an_expression_or_refused(text):
    with contextlib.suppress(InvalidDescription):
        assert isinstance(parse(text, NAMES), sympy.Expr)


@pytest.mark.parametrize(
    "text", ["sqrt(x**2)", "(x**4)**0.25", "tan(x + pi/2)", "cos(tan(pi/2 - x))", "sqrt(-x**2)"]
)
def test_only_functions_that_every_engine_has_come_out(text):
    try:
        read = parse(text, NAMES)
    except InvalidDescription:
        return
    known = {sympy.exp, *FUNCTIONS.values()}
    used = {part.func for part in read.atoms(sympy.Function)}
    assert used <= known
    assert not read.has(sympy.I, sympy.zoo)


def test_a_long_sum_is_not_deep():
    terms = " + ".join(f"cos({k}*x)/{k}" for k in range(1, 200))
    assert math.isclose(
        float(numeric(parse(terms, NAMES))),
        math.fsum(math.cos(k * AT["x"]) / k for k in range(1, 200)),
    )


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("x + yy", "did you mean 'y'?"),
        ("coss(x)", "did you mean 'cos'?"),
        ("x^2", "a power is written **"),
        ("x.__class__", ".__class__"),
        ("x + 1/0", "division by zero"),
        ("sin + 1", "sin(…)"),
    ],
)
def test_a_refusal_says_what_is_wrong(text, part):
    with pytest.raises(InvalidDescription) as refused:
        parse(text, NAMES)
    assert part in refused.value.reason
    assert text in refused.value.value


@pytest.mark.parametrize(
    ("text", "number"),
    [("-pi/2", -math.pi / 2), ("2/3", 2 / 3), ("0.1*sqrt(2)", math.sqrt(2) / 10), ("1e-3", 1e-3)],
)
def test_numbers_in_text(text, number):
    assert parse_number(text) == pytest.approx(number, rel=1e-15)


@pytest.mark.parametrize("text", ["x", "cosh(1e9)", "0x" + "f" * 9000, "log(-2)", "1/0"])
def test_text_that_is_no_finite_number_is_refused(text):
    with pytest.raises(InvalidDescription):
        parse_number(text)


@given(st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False))
def test_exact_states_the_shortest_decimal(number):
    assert float(exact(number)) == number
    assert exact(0.1) == sympy.Rational(1, 10)
