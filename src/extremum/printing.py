"""A system's equations as text and LaTeX, in the paper's symbols."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from unicodedata import combining, normalize

import sympy
from sympy import Expr, Symbol
from sympy.printing.precedence import precedence
from sympy.printing.str import StrPrinter

from .symbols import substituted, t

if TYPE_CHECKING:
    from .system import System

_GREEK: dict[str, str] = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "epsilon": "ε",
    "zeta": "ζ",
    "eta": "η",
    "theta": "θ",
    "kappa": "κ",
    "lambda": "λ",
    "mu": "μ",
    "nu": "ν",
    "xi": "ξ",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "psi": "ψ",
    "omega": "ω",
}
_MARKS: dict[str | None, str] = {"tilde": "\N{COMBINING TILDE}", "dot": "\N{COMBINING DOT ABOVE}"}
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_text(unit: str) -> str:
    """Return a unit as it is read: ``m/s^2`` is m/s²; the unit 1 is not shown."""
    raised = re.sub(r"\^(-?\d+)", lambda match: match[1].translate(SUPERSCRIPTS), unit)
    return "" if raised == "1" else raised


def symbol_text(name: str) -> str:
    """Return a symbol's name as it is read: ``alpha_x`` is α_x, ``x^*`` x*, ``xtilde`` x̃."""
    name = name.replace("^*", "*")
    read = re.match(r"([a-z]+?)(tilde|dot)?(?![a-z])", name)
    if read is None:
        return name
    letter = _GREEK.get(read[1], read[1])
    return normalize("NFC", letter + _MARKS.get(read[2], "")) + name[read.end() :]


class _Text(StrPrinter):
    """Products by juxtaposition, small integer powers raised, Greek letters."""

    def _print_Symbol(self, expr: Symbol) -> str:  # noqa: N802 - SymPy's naming
        return symbol_text(expr.name)

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:  # noqa: N802
        base, exponent = expr.as_base_exp()
        if exponent.is_Integer and exponent > 0:
            inner = self.parenthesize(base, precedence(expr), strict=False)
            return inner + str(exponent).translate(SUPERSCRIPTS)
        if exponent == sympy.Rational(1, 2):
            return f"√({self._print(base)})"
        if exponent.is_Rational and exponent < 0:
            return f"1/{self.parenthesize(1 / expr, precedence(expr), strict=False)}"
        return super()._print_Pow(expr, rational)

    def _print_Add(self, expr: Any, order: Any = None) -> str:  # noqa: N802
        terms = self._as_ordered_terms(expr, order=order)
        plus = [term for term in terms if term.is_Symbol]
        minus = [-term for term in terms if (-term).is_Symbol]
        if plus and minus and len(plus) + len(minus) == len(terms):  # s - p, not -p + s
            return " - ".join([" + ".join(map(self._print, plus)), *map(self._print, minus)])
        return super()._print_Add(expr, order)

    def _print_Mul(self, expr: Any) -> str:  # noqa: N802
        coefficient, _ = expr.as_coeff_Mul()
        if coefficient.is_negative:
            return "-" + self.parenthesize(-expr, precedence(expr), strict=False)
        numerator, denominator = sympy.fraction(expr, exact=True)
        if denominator != 1:
            top = f"({self._print(numerator)})" if numerator.is_Add else self._print(numerator)
            simple = denominator.is_Atom or denominator.is_Pow or denominator.is_Function
            bottom = self._print(denominator)
            return f"{top}/{bottom}" if simple else f"{top}/({bottom})"
        factors = sorted(expr.as_ordered_factors(), key=lambda factor: factor == t)
        return " ".join(self.parenthesize(f, precedence(expr), strict=False) for f in factors)


def expression_text(expression: Expr) -> str:
    """Return an expression as one line of text."""
    return _Text().doprint(expression)


def text(system: System, values: Sequence[float] | None = None) -> str:
    """Return the equations as text: signals, rates, initial values and the symbols' meaning."""
    named = [(symbol_text(x.name), expression_text(e)) for x, e in system.signals]
    after = "d{}/dt" if system.dt is None else "{}\N{SUPERSCRIPT PLUS SIGN}"
    rates = [
        (after.format(symbol_text(x.name)), expression_text(e))
        for x, e in zip(system.states, system.rhs, strict=True)
    ]
    begun = {x: Symbol(f"{x.name}(0)") for x, _ in system.signals}
    starts = [
        (f"{symbol_text(x.name)}(0)", expression_text(substituted(e, begun)))
        for x, e in zip(system.states, system.initial, strict=True)
    ]
    units = system.units
    rows = [(symbol_text(x.name), units[x], "state") for x in system.states]
    rows += [(symbol_text(x.name), units[x], "signal") for x, _ in system.signals]
    for index, p in enumerate(system.parameters):
        number = "" if values is None else f" = {float(values[index]):.12g}"
        rows.append((symbol_text(p.symbol.name), p.unit, p.path + number))
    width = max(len(symbol) for symbol, _, _ in rows)
    wide = max(len(unit) for _, unit, _ in rows)
    parts = [
        "Equations",
        *aligned([*named, *rates]),
        "",
        "At t = 0",
        *aligned(starts),
        "",
        "Symbols",
        *(f"  {symbol:<{width}}  {unit:<{wide}}  {path}" for symbol, unit, path in rows),
    ]
    return "\n".join(parts)


def latex(system: System) -> str:
    """Return the equations as a LaTeX ``aligned`` environment."""
    lines = [f"{sympy.latex(x)} &= {sympy.latex(e)}" for x, e in system.signals]
    begun = {x: Symbol(f"{x.name}(0)") for x, _ in system.signals}
    after = "\\dot{{{}}}" if system.dt is None else "{{{}}}^+"
    lines += [
        f"{after.format(sympy.latex(x))} &= {sympy.latex(e)}, & "
        f"{sympy.latex(x)}(0) &= {sympy.latex(substituted(start, begun))}"
        for x, e, start in zip(system.states, system.rhs, system.initial, strict=True)
    ]
    return "\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}"


def padded(text: str, width: int) -> str:
    """Return the text filled up to a width on the screen, where a combining mark takes no room."""
    return text + " " * (width - shown_width(text))


def shown_width(text: str) -> int:
    """Return how many columns a text takes."""
    return sum(not combining(character) for character in text)


def aligned(equations: Sequence[tuple[str, str]]) -> list[str]:
    """Return lines "left = right" with the equal signs below each other."""
    width = max(shown_width(left) for left, _ in equations)
    return [f"  {padded(left, width)} = {right}" for left, right in equations]
