"""Trigonometric polynomials of several oscillators as exact Fourier series.

An oscillator i turns at ν_i = n_i · Ω, n_i a vector of integers and Ω the independent frequencies:
one for commensurate dithers, several on a torus. Its sine and cosine are symbols S_i, C_i, and an
expression that is polynomial in them has finitely many harmonics k, each found exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import sympy
from sympy import QQ, Expr, Symbol
from sympy.polys.orderings import lex
from sympy.polys.rings import PolyRing

from ..rational import response_parts
from ..symbols import substituted
from ..symbols import t as time

Harmonic = tuple[int, ...]
_Laurent = Mapping[Harmonic, tuple[Fraction, Fraction]]


@dataclass(frozen=True, eq=False)
class Oscillator:
    """The sine and cosine of θ = ν t, ν = Σ n_i Ω_i, as symbols."""

    sine: Symbol
    cosine: Symbol
    frequency: Expr
    harmonic: Harmonic


def oscillators(carriers: Sequence[Expr]) -> tuple[tuple[Oscillator, ...], tuple[Expr, ...]]:
    """Return an oscillator for each frequency, and the independent frequencies Ω.

    Frequencies whose ratio is a rational number whatever the parameters' values share one Ω.
    """
    classes: list[list[tuple[int, sympy.Rational]]] = []
    for index, carrier in enumerate(carriers):
        for members in classes:
            ratio = sympy.cancel(carrier / carriers[members[0][0]])
            if isinstance(ratio, sympy.Rational):
                members.append((index, ratio))
                break
        else:
            classes.append([(index, sympy.Integer(1))])
    bases, found = [], {}
    for place, members in enumerate(classes):
        common = sympy.gcd_list([ratio for _, ratio in members])
        bases.append(carriers[members[0][0]] * common)
        for index, ratio in members:
            turns = [0] * len(classes)
            turns[place] = int(ratio / common)
            sine, cosine = (Symbol(f"{name}_{index}", real=True) for name in ("S", "C"))
            found[index] = Oscillator(sine, cosine, carriers[index], tuple(turns))
    return tuple(found[i] for i in range(len(carriers))), tuple(bases)


def turned(expression: Expr, dithers: Sequence[Oscillator]) -> Expr:
    """Return the expression with sin(νt + φ), cos(νt + φ) in the oscillators' symbols."""
    table: dict[Expr, Expr] = {}
    for call in expression.atoms(sympy.sin, sympy.cos):
        angle = sympy.expand(call.args[0])
        frequency = angle.coeff(time)
        for o in dithers:
            if frequency == o.frequency:
                phase = angle - frequency * time
                sine, cosine = sympy.sin(phase), sympy.cos(phase)
                table[call] = (
                    o.sine * cosine + o.cosine * sine
                    if isinstance(call, sympy.sin)
                    else o.cosine * cosine - o.sine * sine
                )
    return substituted(expression, table)


def unturned(expression: Expr, dithers: Sequence[Oscillator]) -> Expr:
    """Return the expression with sin νt and cos νt in place of the oscillators' symbols."""
    table: dict[Expr, Expr] = {o.sine: sympy.sin(o.frequency * time) for o in dithers}
    table |= {o.cosine: sympy.cos(o.frequency * time) for o in dithers}
    return substituted(expression, table)


def derivative(wave: Expr, dithers: Sequence[Oscillator]) -> Expr:
    """Return d/dt of a combination of the oscillators' symbols."""
    parts = []
    for o in dithers:
        parts.append(wave.diff(o.sine) * o.frequency * o.cosine)
        parts.append(-wave.diff(o.cosine) * o.frequency * o.sine)
    return sympy.Add(*parts)


def leading(wave: Expr, dithers: Sequence[Oscillator], base: Expr) -> tuple[Expr, Any]:
    """Return a combination's leading term as ω = `base` → ∞, and its power of ω, −∞ for 0."""
    terms: dict[Any, list[Expr]] = {}
    for symbol in (symbol for o in dithers for symbol in (o.sine, o.cosine)):
        quotient = sympy.fraction(sympy.cancel(wave.diff(symbol)))
        above, below = (sympy.Poly(e, base) for e in quotient)
        order = sympy.sympify(above.degree() - below.degree())
        terms.setdefault(order, []).append(symbol * above.LC() / below.LC())
    top = max(terms)
    return (sympy.Add(*terms[top]) * base**top if top.is_finite else wave), top


def passed(transfer: Expr, frequency: Expr, cosine: Expr, sine: Expr) -> tuple[Expr, Expr]:
    """Return the coefficients of A cos νt + B sin νt after F(s), in the steady state.

    A Re F(jν) + B Im F(jν) and B Re F(jν) − A Im F(jν).
    """
    real, imaginary = response_parts(transfer, frequency)
    return real * cosine + imaginary * sine, real * sine - imaginary * cosine


@dataclass(frozen=True, eq=False)
class Series:
    """mean + Σ_k (cosine_k cos θ_k + sine_k sin θ_k), θ_k = Σ k_i Ω_i t, of one expression.

    Of k and −k only that with the first nonzero entry positive is listed.
    """

    mean: Expr
    waves: Mapping[Harmonic, tuple[Expr, Expr]]


def series(expression: Expr, oscillators: Sequence[Oscillator]) -> Series:
    """Return the Fourier series of a polynomial in the oscillators' symbols.

    Raises
    ------
    sympy.PolynomialError
        If the expression is not a polynomial in them.
    """
    generators = [symbol for o in oscillators for symbol in (o.sine, o.cosine)]
    present = [g for g in generators if expression.has(g)]
    if not present:
        return Series(expression, {})
    harmonics = {g: o.harmonic for o in oscillators for g in (o.sine, o.cosine)}
    kinds = tuple(g in {o.sine for o in oscillators} for g in present)
    turns = tuple(harmonics[g] for g in present)
    polynomial, back = _polynomial(expression, present)
    zero = polynomial.ring.zero
    sums: dict[Harmonic, list[Any]] = {}
    for powers, coefficient in polynomial.terms():
        inner = (0,) * len(present) + powers[len(present) :]
        term = polynomial.ring({inner: coefficient})
        for k, (cosine, sine) in _monomial(powers[: len(present)], kinds, turns).items():
            both = sums.setdefault(k, [zero, zero])
            both[0] += term * QQ(cosine.numerator, cosine.denominator)
            both[1] += term * QQ(sine.numerator, sine.denominator)
    added = {
        k: (substituted(c.as_expr(), back), substituted(s.as_expr(), back))
        for k, (c, s) in sums.items()
    }
    constant = (0,) * len(oscillators[0].harmonic)
    mean, _ = added.pop(constant, (sympy.Integer(0), sympy.Integer(0)))
    waves = {k: (c, s) for k, (c, s) in added.items() if c != 0 or s != 0}
    return Series(mean, waves)


def filtered(
    given: Series, transfer: Expr, bases: Sequence[Expr]
) -> tuple[Expr, tuple[Oscillator, ...]]:
    """Return what F(s) passes of the waves of a series, and the oscillators of its own for them."""
    parts, own = [], []
    for k, (cosine, sine) in given.waves.items():
        o = Oscillator(sympy.Dummy(), sympy.Dummy(), frequency_of(k, bases), k)
        after = passed(transfer, o.frequency, cosine, sine)
        parts += [after[0] * o.cosine, after[1] * o.sine]
        own.append(o)
    return sympy.Add(*parts), tuple(own)


def frequency_of(k: Harmonic, bases: Sequence[Expr]) -> Expr:
    """Return ν_k = Σ k_i Ω_i."""
    return sympy.Add(*(n * base for n, base in zip(k, bases, strict=True)))


def _polynomial(expression: Expr, first: Sequence[Symbol]) -> tuple[Any, dict[Expr, Expr]]:
    """Return the expression in a polynomial ring over the rationals, and what its letters mean.

    The ring's first generators are `first`; functions and denominators are letters of their own.
    """
    letters: dict[Any, Any] = {}

    def lettered(part: Any) -> Any:
        if part in letters:
            return letters[part]
        if part.is_Symbol or part.is_Rational:
            return part
        if part.is_Add or part.is_Mul:
            return part.func(*(lettered(inner) for inner in part.args))
        if part.is_Pow and part.exp.is_Integer:
            if part.exp > 0:
                return lettered(part.base) ** part.exp
            return lettered(1 / part.base) ** -part.exp if part.exp < -1 else _letter(part)
        return _letter(part)

    def _letter(part: Expr) -> Expr:
        if part.has(*first):
            raise sympy.PolynomialError(
                f"{part} is not a polynomial of {', '.join(map(str, first))}"
            )
        return letters.setdefault(part, sympy.Dummy())

    whole = lettered(expression)
    symbols = [*first, *sorted(whole.free_symbols - set(first), key=str)]
    ring = PolyRing(symbols, QQ, lex)
    return ring.from_expr(whole), {letter: part for part, letter in letters.items()}


@lru_cache(maxsize=4096)
def _monomial(
    powers: tuple[int, ...], sines: tuple[bool, ...], turns: tuple[Harmonic, ...]
) -> dict[Harmonic, tuple[Fraction, Fraction]]:
    """Return k → (coefficient of cos θ_k, of sin θ_k) of Π S^a C^b."""
    zero = (0,) * len(turns[0])
    product: _Laurent = {zero: (Fraction(1), Fraction(0))}
    for power, is_sine, turn in zip(powers, sines, turns, strict=True):
        half = Fraction(1, 2)
        back = tuple(-n for n in turn)
        if is_sine:  # sin θ = (E − 1/E)/2j
            factor = {turn: (Fraction(0), -half), back: (Fraction(0), half)}
        else:
            factor = {turn: (half, Fraction(0)), back: (half, Fraction(0))}
        for _ in range(power):
            product = _times(product, factor)
    waves = {}
    for k, (real, imaginary) in product.items():
        if k == zero:
            waves[k] = (real, Fraction(0))
        elif next(n for n in k if n) > 0:  # c E + c̄/E = 2 Re c cos θ − 2 Im c sin θ
            waves[k] = (2 * real, -2 * imaginary)
    return waves


def _times(left: _Laurent, right: _Laurent) -> _Laurent:
    product: dict[Harmonic, tuple[Fraction, Fraction]] = {}
    for k, (a, b) in left.items():
        for m, (c, d) in right.items():
            key = tuple(i + j for i, j in zip(k, m, strict=True))
            real, imaginary = product.get(key, (Fraction(0), Fraction(0)))
            product[key] = (real + a * c - b * d, imaginary + a * d + b * c)
    return {k: value for k, value in product.items() if value != (0, 0)}
