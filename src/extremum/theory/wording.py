"""An averaged loop as text and LaTeX, in the paper's symbols and its time τ = ωt."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import sympy
from sympy import Expr, Symbol

from ..printing import (
    SUPERSCRIPTS,
    aligned,
    expression_text,
    padded,
    shown_width,
    symbol_text,
)
from ..symbols import substituted
from .averaged import Averaged
from .equilibrium import equilibrium_steps
from .moments import Moment

if TYPE_CHECKING:
    from .averaging import Average
    from .conditions import Condition

ROUNDING: Final = 1e-10
"""Part of the dither's size below which a coordinate of the equilibrium is 0."""

WIDEST: Final = 100
"""Characters beyond which a condition is named by its coefficients, not written out."""


@lru_cache(maxsize=256)
def paper_form(
    averaged: Averaged,
) -> tuple[tuple[Symbol, ...], tuple[Expr, ...], Mapping[Symbol, Expr]]:
    """Return states, rates per second, and the old states in terms of the new ones.

    The paper's state of a compensator is its output w (24) to (28), not the state ζ of its strictly
    proper part: w̄ = ζ + D m̄(x̃), ẇ = ζ̇ + D ∂m̄/∂x̃ x̃̇. Where the average is taken by quadrature the
    states stay as they are.
    """
    states = averaged.equations.states
    rates = tuple(e + f for e, f in zip(averaged.rates, averaged.forcing, strict=True))
    outputs = {state: (symbol, e) for state, symbol, e in averaged.outputs if e != state}
    if averaged.moments is not None or not outputs:
        return states, rates, {}
    back = {state: symbol - (e - state) for state, (symbol, e) in outputs.items()}
    renamed = tuple(outputs[x][0] if x in outputs else x for x in states)
    full = []
    for state, rate in zip(states, rates, strict=True):
        if state in outputs:
            mean = outputs[state][1]
            rate = sympy.Add(*(mean.diff(x) * e for x, e in zip(states, rates, strict=True)))
        full.append(sympy.factor_terms(sympy.expand(substituted(rate, back))))
    return renamed, tuple(full), back


def text(average: Average) -> str:
    """Return equations, equilibrium, characteristic polynomial and conditions as text."""
    averaged = average.averaged
    frequency = average.frame.loop.twin.controller.base()
    states, rates, back = paper_form(averaged)
    named = [(_bound(x), expression_text(e)) for x, e in averaged.equations.slow]
    named += [
        (f"d{symbol_text(x.name)}/dτ", expression_text(sympy.factor_terms(e / frequency)))
        for x, e in zip(states, rates, strict=True)
    ]
    exact = "the limit ω → ∞" if averaged.order == 1 else "with the terms of order 1/ω"
    exact += " but for the sensor's F(jω)" if averaged.equations.sensing else ""
    parts = [f"Averaged equations, τ = ω t, {exact}", *aligned(named)]
    if averaged.moments is not None:
        parts += ["", *_quadrature(average)]
    parts += ["", "Equilibrium", *aligned(_equilibrium(average, back))]
    parts += ["", "Characteristic polynomial (per second)", *_characteristic(average)]
    parts += ["", "Stable if and only if", *_conditions(average)]
    parts += (
        ["", *(f"Note: {note}." for note in average.frame.notes)] if average.frame.notes else []
    )
    return "\n".join(parts)


def latex(average: Average) -> str:
    """Return the averaged equations in τ as a LaTeX ``aligned`` environment."""
    averaged = average.averaged
    frequency = average.frame.loop.twin.controller.base()
    states, rates, _ = paper_form(averaged)
    lines = [f"{sympy.latex(x)} &= {sympy.latex(e)}" for x, e in averaged.equations.slow]
    lines += [
        f"\\frac{{d{sympy.latex(x)}}}{{d\\tau}} &= {sympy.latex(sympy.factor_terms(e / frequency))}"
        for x, e in zip(states, rates, strict=True)
    ]
    return "\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}"


def _bound(symbol: Symbol) -> str:
    return f"{symbol_text(symbol.name)}(t)"


def _quadrature(average: Average) -> list[str]:
    moments = average.averaged.moments
    assert moments is not None
    inner = ", ".join(symbol_text(str(x)) for x in moments.arguments[: moments.inner])
    rows = [(f"{m.symbol}({inner})", _described(m)) for m in moments.wanted]
    return [
        f"Means by quadrature, estimated error {average.error:.1e} at the equilibrium",
        *aligned(rows),
    ]


def _described(moment: Moment) -> str:
    if not any(moment.harmonic):
        return "⟨J⟩"
    turns = " + ".join(
        ("" if n == 1 else f"{n} ") + (f"θ_{i}" if len(moment.harmonic) > 1 else "Ωt")
        for i, n in enumerate(moment.harmonic)
        if n
    )
    return f"⟨J {'sin' if moment.is_sine else 'cos'}({turns})⟩"


def _equilibrium(average: Average, back: Mapping[Symbol, Expr]) -> list[tuple[str, str]]:
    """Return rows of the equilibrium, in closed form with Xᵉ for what stands above."""
    states = average.states
    law = equilibrium_steps(average.averaged)
    if average.equilibrium is None:
        return [("Xᵉ", "none found")]
    if law is None:
        rounding = ROUNDING * float(np.abs(average.demodulation).max())
        return [
            (f"{symbol_text(x.name)}ᵉ", f"{value if abs(value) > rounding else 0:.9g}")
            for x, value in zip(states, average.equilibrium, strict=True)
        ]
    names = {state: symbol for state, symbol, _ in average.averaged.outputs if state in back}
    full = average.equilibrium_law
    assert full is not None
    rows = []
    for x in states:
        here = law[x]
        if x in names:
            here: Any = sympy.factor(law[x] + substituted(names[x] - back[x], full))
        at = {y: Symbol(f"{symbol_text(y.name)}ᵉ") for y in states}
        rows.append(
            (f"{symbol_text(names.get(x, x).name)}ᵉ", expression_text(substituted(here, at)))
        )
    return rows


def _characteristic(average: Average) -> list[str]:
    lines = []
    for coefficients in average.characteristic:
        if coefficients is None:
            lines.append("  a factor too long to be written out")
            continue
        degree = len(coefficients) - 1
        terms = [_power(degree)]
        for power, coefficient in zip(range(degree - 1, -1, -1), coefficients[1:], strict=True):
            if coefficient == 0:
                continue
            shown = expression_text(coefficient)
            if coefficient.is_Add:
                shown = f"({shown})"
            sign, shown = (" - ", shown[1:]) if shown.startswith("-") else (" + ", shown)
            factor = _power(power)
            terms.append(f"{sign}{shown}{f' {factor}' if factor else ''}")
        lines.append("  " + "".join(terms))
    return lines


def _power(power: int) -> str:
    return "" if power == 0 else "λ" if power == 1 else "λ" + str(power).translate(SUPERSCRIPTS)


def _stated(condition: Condition) -> str:
    stated = condition.text()
    return stated if len(stated) <= WIDEST else f"{condition.name} > 0"


def _conditions(average: Average) -> list[str]:
    rows = [(_stated(c), f"{c.value:.6g}", f"{c.margin:+.2f}", c.holds) for c in average.conditions]
    if not rows:
        return ["  there is no equilibrium to speak of"]
    width = max(shown_width(left) for left, *_ in rows)
    return [
        f"  {padded(left, width)}   {value:>12}   margin {margin}   {'holds' if holds else 'fails'}"
        for left, value, margin, holds in rows
    ]
