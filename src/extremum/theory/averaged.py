"""The averaged equations of a loop, symbolically: one for each structure.

In relative coordinates Ẋ = f(X, t), fast in t. To first order in 1/ω the mean obeys
Ẋ = f̄(X) = ⟨f⟩; to second order Ẋ = f̄ + ⟨∂f/∂X · F⟩ with ∂F/∂t = f − f̄, ⟨F⟩ = 0. Both are exact
for fields that are polynomials of position, whatever the rational ratios of the frequencies.

A sensor F(s) may be as fast as the dither, so that its states are not slow as they stand: each
harmonic of J passes as F(jν_k) J_k, at its own frequency and ω, and what is left of the states is
driven by the mean of J alone; they carry the sensor's own modes. A gain c that makes up for a small
F(jω) makes the position ripple with c ξ̄ sin(ωt + ψ), too, and that changes the mean of J by κ ξ̄,
κ ξ̄ = Σ H_ij ⟨a_i r_j⟩, a the dither and r the ripple; products of r with x̃ are left out, which
count as far from the source as ρ does. So is that F(jν + λ) is not quite F(jν) for a loop that
moves at a rate λ: λ times the sensor's delay.
Source: Khalil, Nonlinear Systems, section 10.4; Sanders, Verhulst and Murdock, Averaging Methods,
theorem 2.9.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any

import sympy
from sympy import Expr, Poly, Symbol

from ..errors import InvalidDescription
from ..symbols import substituted
from ..symbols import t as time
from .fourier import Harmonic, Series, filtered, frequency_of, passed, series
from .frame import Relative
from .moments import Moment, Moments


@dataclass(frozen=True, eq=False)
class Averaged:
    """Ẋ of the averaged loop, per second.

    Attributes
    ----------
    rates
        In terms of the states, the slow inputs, the parameters and, where the field is no
        polynomial, the symbols of `moments`.
    forcing
        What is kept of slow beats between the dithers, to be added to `rates`: expressions in t.
    outputs
        The mean of each compensator's output w_i, by the state that carries it.
    moments
        The means that are taken by quadrature; None where the average is in closed form.
    degree
        The field's degree as a polynomial of position, None where it is none.
    """

    equations: Relative
    order: int
    rates: tuple[Expr, ...]
    forcing: tuple[Expr, ...]
    outputs: tuple[tuple[Symbol, Symbol, Expr], ...]
    moments: Moments | None
    degree: int | None


@lru_cache(maxsize=256)
def averaged(equations: Relative, order: int, kept: tuple[Harmonic, ...] = ()) -> Averaged:
    """Return the averaged equations to first or second order in 1/ω.

    Parameters
    ----------
    kept
        Harmonics that are too slow to be averaged over; they stay as forcing, for fields that are
        polynomials of position.

    Raises
    ------
    InvalidDescription
        For the second order of a field that is not a polynomial of position, or with a sensor that
        has states, and for a controller that is not linear in the sensed signal.
    """
    waves = [symbol for o in equations.oscillators for symbol in (o.sine, o.cosine)]
    law = equations.leading if order == 1 else dict(equations.signals)[equations.signal]
    closed = bool(law.is_polynomial(*waves, *equations.states))
    degree = Poly(law, *waves, *equations.states).total_degree() if closed else None
    inlined = _inlined(equations)
    rates = [substituted(rate, inlined) for rate in equations.rates]
    if order == 2:
        if equations.sensing:
            raise InvalidDescription(
                "order",
                "2 is not known for a loop with a sensor, whose states are neither slow nor fast "
                "against the dither; use order 1, or periodic_orbit, which is exact",
                "2",
            )
        if not closed:
            raise InvalidDescription(
                "order", "2 needs a field that is a polynomial of position; use order 1", "2"
            )
        full = _full(equations, rates, law)
        second = _second(equations, full, kept)
        return Averaged(equations, 2, second, _forcing(equations, full, kept), (), None, degree)
    signal = series(sympy.expand(law), equations.oscillators) if closed else None
    wanted: dict[tuple[Harmonic, bool], Moment] = {}

    def mean(expression: Expr) -> Expr:
        return _mean(expression, equations, signal, wanted)

    first = tuple(mean(rate) for rate in rates)
    outputs = []
    for state, symbol, expression in _carried(equations):
        outputs.append((state, symbol, mean(substituted(expression, inlined))))
    moments = None if closed else _moments(equations, law, tuple(wanted.values()))
    full = _full(equations, rates, law, signal) if kept and signal else []
    forcing = _forcing(equations, full, kept)
    return Averaged(equations, 1, first, forcing, tuple(outputs), moments, degree)


def _full(
    equations: Relative, rates: Sequence[Expr], law: Expr, signal: Series | None = None
) -> list[Series]:
    """Return the rates' series; what the sensor passes of J turns on oscillators of its own."""
    table, waves = {equations.signal: law}, equations.oscillators
    if equations.sensing and signal is not None:
        heard, own = filtered(signal, equations.sensor, equations.bases)
        table[equations.sensed] = _mean_sensed(equations, signal.mean) + heard
        waves = (*waves, *own)
    return [series(sympy.expand(substituted(e, table)), waves) for e in rates]


def _mean_sensed(equations: Relative, mean: Expr) -> Expr:
    """Return the mean of what the sensor puts out, from its states and the mean of J."""
    return substituted(dict(equations.signals)[equations.sensed], {equations.signal: mean})


def _rippled(equations: Relative, mean: Expr) -> Expr:
    """Return κ ξ̄, what the ripple that ξ̄ leaves adds to the mean of J; 0 without a sensor."""
    pairs = product(enumerate(equations.dither_limit), enumerate(equations.ripple))
    terms = [equations.hessian[i, j] * a * r for (i, a), (j, r) in pairs]
    found = series(sympy.expand(sympy.Add(*terms)), equations.oscillators).mean
    heard = {equations.sensed: _mean_sensed(equations, mean)}
    return substituted(substituted(found, _inlined(equations)), heard)


def _forcing(
    equations: Relative, rates: Sequence[Series], kept: Sequence[Harmonic]
) -> tuple[Expr, ...]:
    """Return Σ_k A_k cos ν_k t + B_k sin ν_k t over the harmonics kept."""
    zero = sympy.Integer(0)
    found = []
    for rate in rates:
        parts = []
        for k in kept:
            cosine, sine = rate.waves.get(k, (zero, zero))
            angle = frequency_of(k, equations.bases) * time
            parts += [cosine * sympy.cos(angle), sine * sympy.sin(angle)]
        found.append(sympy.factor_terms(sympy.Add(*parts)))
    return tuple(found) or (zero,) * len(equations.states)


def _inlined(equations: Relative) -> dict[Symbol, Expr]:
    """Return every signal but J, what is sensed and the slow inputs, in terms of these."""
    table: dict[Symbol, Expr] = {}
    below = False
    for symbol, expression in equations.signals:
        if below and symbol != equations.sensed:
            table[symbol] = substituted(expression, table)
        below = below or symbol == equations.signal
    return table


def _carried(equations: Relative) -> list[tuple[Symbol, Symbol, Expr]]:
    """Return (state, signal, expression) of the signals w = ζ + D m that a compensator puts out."""
    found = []
    for symbol, expression in equations.signals:
        if symbol == equations.sensed:
            continue
        terms = sympy.Add.make_args(expression)
        carried = [x for x in equations.states if x in terms]
        if len(carried) == 1 and len(terms) > 1 and equations.signal not in expression.free_symbols:
            found.append((carried[0], symbol, expression))
    return found


def _mean(
    rate: Expr,
    equations: Relative,
    signal: Series | None,
    wanted: dict[tuple[Harmonic, bool], Moment],
) -> Expr:
    """Return the mean of a + b J + d F[J], from the harmonics of b, d and J."""
    heard = tuple(dict.fromkeys((equations.signal, equations.sensed)))
    polynomial = Poly(sympy.expand(rate), *heard)
    if polynomial.total_degree() > 1:
        raise InvalidDescription(
            "controller",
            "multiplies the sensed signal by itself; averaging takes controllers that are linear "
            "in it, such as GradientES",
        )
    free = series(sympy.expand(polynomial.coeff_monomial(1)), equations.oscillators).mean
    zero = (0,) * len(equations.bases)

    def moment(k: Harmonic, is_sine: bool) -> Expr:
        if signal is None:
            if (k, is_sine) not in wanted:
                wanted[k, is_sine] = Moment(_named(k, is_sine), k, is_sine)
            return wanted[k, is_sine].symbol
        if k == zero:
            return signal.mean
        cosine, sine = signal.waves.get(k, (sympy.Integer(0), sympy.Integer(0)))
        return (sine if is_sine else cosine) / 2

    def whole(k: Harmonic, is_sine: bool) -> Expr:
        found = moment(k, is_sine)
        return found if k != zero else found + _rippled(equations, found)

    def sensed(k: Harmonic, is_sine: bool) -> Expr:
        if k == zero:
            return _mean_sensed(equations, whole(zero, False))
        both = moment(k, False), moment(k, True)
        return passed(equations.sensor, frequency_of(k, equations.bases), *both)[is_sine]

    parts = [free]
    for symbol, found in zip(heard, (whole, sensed), strict=False):
        driven = series(sympy.expand(polynomial.coeff_monomial(symbol)), equations.oscillators)
        if driven.mean != 0:
            parts.append(driven.mean * found(zero, False))
        for k, (cosine, sine) in driven.waves.items():
            parts += [
                c * found(k, is_sine) for c, is_sine in ((cosine, False), (sine, True)) if c != 0
            ]
    return sympy.factor_terms(sympy.expand(sympy.Add(*parts)))


def _named(k: Harmonic, is_sine: bool) -> Symbol:
    if not any(k):
        return Symbol("J_0", real=True)
    turns = ",".join(str(n) for n in k)
    return Symbol(f"J_{'s' if is_sine else 'c'}{turns}", real=True)


def _moments(equations: Relative, law: Expr, wanted: tuple[Moment, ...]) -> Moments:
    waves = {symbol for o in equations.oscillators for symbol in (o.sine, o.cosine)}
    inner = [x for x in equations.states if law.has(x)]
    free: set[Any] = set(law.free_symbols)
    others = sorted(free - waves - set(inner), key=str)
    return Moments(law, equations.oscillators, wanted, (*inner, *others), len(inner))


def _second(
    equations: Relative, rates: Sequence[Series], kept: Sequence[Harmonic]
) -> tuple[Expr, ...]:
    """Return f̄ + ⟨∂f/∂X F⟩ = f̄ + Σ_k (∂B_k A_k − ∂A_k B_k)/(2ν_k), f = f̄ + Σ A cos θ + B sin θ."""
    states = equations.states
    harmonics = dict.fromkeys(k for rate in rates for k in rate.waves if k not in kept)
    zero = (sympy.Integer(0), sympy.Integer(0))
    corrections = [sympy.Integer(0)] * len(rates)
    for k in harmonics:
        frequency = frequency_of(k, equations.bases)
        columns = [rate.waves.get(k, zero) for rate in rates]
        cosines, sines = (sympy.Matrix([column[i] for column in columns]) for i in (0, 1))
        mixed = sines.jacobian(states) * cosines - cosines.jacobian(states) * sines
        corrections = [c + m / (2 * frequency) for c, m in zip(corrections, mixed, strict=True)]
    return tuple(
        sympy.factor_terms(sympy.expand(rate.mean + correction))
        for rate, correction in zip(rates, corrections, strict=True)
    )
