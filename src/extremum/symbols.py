"""The mathematics shared by every layer: `s`, `t`, the functions allowed, and the parser.

The functions are exactly those that SymPy, heyoka and NumPy all have, so that an equation
written with them can be printed, differentiated and integrated by every engine.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, cast

import sympy
from sympy import Expr, Integer, Rational, Symbol

from .errors import InvalidDescription, shown, suggestion

s: Final = Symbol("s")
"""The Laplace variable, in which transfer functions are written: ``1/s``, ``(s + 1)/(s + 10)``."""

t: Final = Symbol("t", real=True)
"""Time in seconds, for moving sources and time-dependent fields."""

pi: Final = sympy.pi

exp, log, sqrt = sympy.exp, sympy.log, sympy.sqrt
sin, cos, tan = sympy.sin, sympy.cos, sympy.tan
asin, acos, atan, atan2 = sympy.asin, sympy.acos, sympy.atan, sympy.atan2
sinh, cosh, tanh = sympy.sinh, sympy.cosh, sympy.tanh
asinh, acosh, atanh = sympy.asinh, sympy.acosh, sympy.atanh

FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = {
    f.__name__: f
    for f in (
        *(exp, log, sqrt, sin, cos, tan, asin, acos, atan, atan2),
        *(sinh, cosh, tanh, asinh, acosh, atanh),
    )
}

MAX_LENGTH: Final = 10_000
MAX_DEPTH: Final = 100
MAX_EXPONENT: Final = 64
MAX_DECADES: Final = 300


def axis_names(dimension: int) -> tuple[str, ...]:
    """Return the coordinates' names: x, y, z up to three axes, x1 … xn beyond."""
    if dimension <= 3:
        return ("x", "y", "z")[:dimension]
    return tuple(f"x{i + 1}" for i in range(dimension))


def coordinates(dimension: int) -> tuple[Symbol, ...]:
    """Return the coordinates as real symbols."""
    return tuple(Symbol(name, real=True) for name in axis_names(dimension))


def letters(names: Iterable[str]) -> dict[str, Symbol]:
    """Return real symbols for parameters of these names."""
    return {name: Symbol(name, real=True) for name in names}


def is_coordinate(text: str) -> bool:
    """Return whether `text` is the name of a coordinate: x, y, z, x1, x2, …."""
    return text in {"x", "y", "z"} or bool(re.fullmatch(r"x[1-9]\d*", text))


def is_name(text: str) -> bool:
    """Return whether `text` may name a parameter: an ASCII identifier that nothing else uses."""
    taken = text in {*FUNCTIONS, "pi", "s", "t"} or keyword.iskeyword(text)
    return text.isascii() and text.isidentifier() and not taken


def exact(number: float) -> Rational:
    """Return the number that the shortest decimal of a finite float states: 0.1 is 1/10."""
    return cast(Rational, Rational(repr(float(number))))


def decimals_exact(expression: Expr) -> Expr:
    """Return the expression with every float made the rational it states."""
    return substituted(expression, {f: exact(float(f)) for f in expression.atoms(sympy.Float)})


def substituted(expression: Expr, table: Mapping[Any, Any]) -> Expr:
    """Return the expression with symbols and numbers exchanged as the table says, at once."""
    return cast(Expr, expression.xreplace(dict(table)))


def quarter_turns(phase: object) -> int | None:
    """Return k in 0 … 3 if `phase` is the float nearest to kπ/2 (mod 2π), else None."""
    if not isinstance(phase, float) or not math.isfinite(phase):
        return None
    turns = round(phase / (math.pi / 2))
    return turns % 4 if abs(turns) <= 8 and phase == turns * (math.pi / 2) else None


def is_quarter_turn(phase: object) -> bool:
    """Return whether `phase` is a multiple of π/2, which is structure and not a number."""
    return quarter_turns(phase) is not None


def sine(angle: Expr, phase: Expr | float) -> Expr:
    """Return sin(angle + φ), resolved where φ is a quarter turn: sin(a − π/2) is −cos a."""
    turns = quarter_turns(phase)
    if turns is None:
        return sin(angle + phase)
    return (sin(angle), cos(angle), -sin(angle), -cos(angle))[turns]


def cosine(angle: Expr, phase: Expr | float) -> Expr:
    """Return cos(angle + φ), resolved where φ is a quarter turn."""
    turns = quarter_turns(phase)
    if turns is None:
        return cos(angle + phase)
    return (cos(angle), -sin(angle), -cos(angle), sin(angle))[turns]


def plain(item: Any) -> Any:
    """Return floats as the exact rationals they state, anything else as it is."""
    return exact(item) if isinstance(item, float) else item


def parse(text: str, names: Mapping[str, Expr]) -> Expr:
    """Return the SymPy expression that `text` writes, from a whitelist and without evaluation.

    Numbers (decimals are exact: 0.1 is 1/10), the given `names`, ``pi``, ``+ - * / **`` and calls
    of the functions in `FUNCTIONS`. Text longer than 10,000 characters, nested deeper than 100,
    with an exponent beyond 64 or a number beyond 1e±300 is refused before anything is built.

    Raises
    ------
    InvalidDescription
        With what stands in the way and, for an unknown name, the nearest known one.
    """
    text = text.replace("\n", " ")
    if len(text) > MAX_LENGTH:
        raise InvalidDescription(
            "",
            f"the expression has {len(text):,} characters; at most {MAX_LENGTH:,} are read",
            shown(text, 30),
        )
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (RecursionError, MemoryError):
        raise _refusal(text, "it is nested too deeply") from None
    except (SyntaxError, ValueError) as error:
        column = getattr(error, "offset", None)
        at = f" at column {column}" if column else ""
        raise _refusal(text, f"it is not a mathematical expression{at}") from None
    return _whitelisted(_Reader(text, names).read(tree.body, 0), text)


def _whitelisted(value: Expr, text: str) -> Expr:
    """Refuse what SymPy's automatic simplification has made of functions that engines have."""
    value = cast(Expr, value.replace(sympy.cot, lambda angle: 1 / tan(angle)))  # tan(x + π/2)
    if value.has(sympy.I, sympy.zoo, sympy.oo, sympy.nan):
        raise _refusal(text, "a part of it is not a finite real number")
    for call in value.atoms(sympy.Abs):
        raise _refusal(text, f"it is |{call.args[0]}|, which has a corner; write a smooth function")
    return value


def parse_number(text: str) -> float:
    """Return the number that `text` writes, such as ``"-pi/2"`` or ``"2/3"``."""
    value = parse(text, {})
    number = complex(value)
    if number.imag or not math.isfinite(number.real):
        raise _refusal(text, "it is not a finite real number")
    return number.real


def _refusal(text: str, reason: str) -> InvalidDescription:
    return InvalidDescription("", reason, shown(text))


def _continues(inner: ast.expr, outer: ast.BinOp) -> bool:
    """Return whether `inner` is the beginning of the same sum or product."""
    if not isinstance(inner, ast.BinOp):
        return False
    kinds = (ast.Add | ast.Sub, ast.Mult | ast.Div)
    return any(isinstance(inner.op, kind) and isinstance(outer.op, kind) for kind in kinds)


class _Reader:
    def __init__(self, text: str, names: Mapping[str, Expr]) -> None:
        self.text = text
        self.names: Mapping[str, Expr] = {"pi": pi, **names}

    def refuse(self, reason: str, node: ast.AST | None = None) -> InvalidDescription:
        column = getattr(node, "col_offset", None)
        at = "" if column is None else f" (column {column + 1})"
        return _refusal(self.text, reason + at)

    def read(self, node: ast.expr, depth: int) -> Expr:
        if depth > MAX_DEPTH:
            raise self.refuse(f"it is nested deeper than {MAX_DEPTH} levels")
        if isinstance(node, ast.Constant):
            return self.number(node)
        if isinstance(node, ast.Name):
            return self.name(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            operand = self.read(node.operand, depth + 1)
            return -operand if isinstance(node.op, ast.USub) else operand
        if isinstance(node, ast.BinOp):
            chain = [node]  # a long sum is read in a loop: it is not deep
            while _continues(chain[-1].left, chain[-1]):
                chain.append(cast(ast.BinOp, chain[-1].left))
            value = self.read(chain[-1].left, depth + 1)
            for link in reversed(chain):
                right = self.read(link.right, depth + 1)
                value = self.bounded(self.operate(link, value, right), link)
            return value
        if isinstance(node, ast.Call):
            return self.bounded(self.call(node, depth), node)
        if isinstance(node, ast.Attribute):
            raise self.refuse(f"attribute access (.{node.attr}) is not mathematics", node)
        raise self.refuse(
            "only numbers, known names, + - * / ** and calls of known functions may stand here",
            node,
        )

    def number(self, node: ast.Constant) -> Expr:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(f"{shown(value)} is not a number", node)
        if isinstance(value, int) and value > 10**MAX_DECADES:
            raise self.refuse(f"a number beyond 1e±{MAX_DECADES} is not read", node)
        if value and not math.isfinite(value):
            raise self.refuse(f"{value} is not finite", node)
        if value and abs(math.log10(abs(value))) > MAX_DECADES:
            raise self.refuse(f"{value:.3g} lies beyond 1e±{MAX_DECADES}", node)
        return Integer(value) if isinstance(value, int) else exact(value)

    def name(self, node: ast.Name) -> Expr:
        if node.id in self.names:
            return self.names[node.id]
        if node.id in FUNCTIONS:
            raise self.refuse(f"the function {node.id} needs an argument: {node.id}(…)", node)
        hint = suggestion(node.id, {*self.names, *FUNCTIONS})
        raise self.refuse(f"unknown name {node.id!r}; {hint}", node)

    def operate(self, node: ast.BinOp, left: Expr, right: Expr) -> Expr:
        match node.op:
            case ast.Add():
                return left + right
            case ast.Sub():
                return left - right
            case ast.Mult():
                return left * right
            case ast.Div():
                if right.is_zero:
                    raise self.refuse("division by zero", node)
                return left / right
            case ast.Pow():
                return self.power(node, left, right)
            case ast.BitXor():
                raise self.refuse("a power is written **, not ^", node)
        raise self.refuse("only + - * / ** may combine terms", node)

    def power(self, node: ast.BinOp, base: Expr, exponent: Expr) -> Expr:
        if exponent.is_number and abs(float(exponent)) > MAX_EXPONENT:
            raise self.refuse(f"an exponent beyond ±{MAX_EXPONENT} is not read", node)
        if base.is_zero and exponent.is_negative:
            raise self.refuse("division by zero", node)
        if base.is_number and exponent.is_number and not base.is_zero:
            decades = float(exponent) * math.log10(abs(complex(base)))
            if abs(decades) > MAX_DECADES:
                raise self.refuse(f"a number beyond 1e±{MAX_DECADES} is not read", node)
        return base**exponent

    def call(self, node: ast.Call, depth: int) -> Expr:
        if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS:
            called = shown(ast.unparse(node.func), 30).strip("'\"")
            hint = suggestion(called, FUNCTIONS)
            raise self.refuse(f"{called!r} is not a known function; {hint}", node)
        wanted = 2 if node.func.id == "atan2" else 1
        if node.keywords or len(node.args) != wanted:
            raise self.refuse(f"{node.func.id} takes {wanted} argument(s)", node)
        arguments = [self.read(argument, depth + 1) for argument in node.args]
        if node.func.id == "exp" and arguments[0].is_number:
            exponent = complex(arguments[0]).real
            if abs(exponent) > MAX_DECADES * math.log(10):
                raise self.refuse(f"a number beyond 1e±{MAX_DECADES} is not read", node)
        return FUNCTIONS[node.func.id](*arguments)

    def bounded(self, value: Expr, node: ast.expr) -> Expr:
        if value.is_number:
            if value.has(sympy.zoo, sympy.oo, sympy.nan) or value.is_real is False:
                raise self.refuse("a part of it is not a finite real number", node)
            if isinstance(value, Rational) and max(abs(value.p), value.q) > 10**MAX_DECADES:
                raise self.refuse(f"a number beyond 1e±{MAX_DECADES} is not read", node)
        if isinstance(value, sympy.Pow) and isinstance(value.exp, Rational):
            self.check_exponent(value.exp, node)
        return value

    def check_exponent(self, exponent: Rational, node: ast.expr) -> None:
        if abs(exponent) > MAX_EXPONENT:
            raise self.refuse(f"an exponent beyond ±{MAX_EXPONENT} is not read", node)
