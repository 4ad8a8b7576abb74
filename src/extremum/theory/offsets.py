"""`bias`: where the mean of an averaged loop rests, cause by cause.

Per axis, with G = N/D, C = N_c/D_c, H the Hessian and M the demodulation matrix as ω → ∞, the mean
x̃ of position − source obeys

    P(s) x̃ = −D D_c r + N D_c d + N N_c μ,   P = diag(D D_c) − diag(N N_c c) M H:

r is the source, d a constant force at the input, μ what the field's asymmetry leaves at x̃ = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr

from ..errors import InvalidDescription
from ..loop import Loop
from ..printing import expression_text, symbol_text
from ..symbols import axis_names, s, sine, substituted
from ..symbols import t as time
from .averaged import averaged
from .averaging import average
from .demodulation import gradient
from .drift import drift
from .equilibrium import MAX_TERMS, quotient
from .fourier import filtered, series, turned
from .frame import Frame, Relative
from .hurwitz import summands
from .linear import LoopGain, linear, loop_gain, polynomial
from .routh import permanent

Vector = NDArray[np.float64]
Laws = Mapping[str, tuple[Expr, ...]]
NEGLIGIBLE: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Tracking:
    """The mean's error while the source swings at one frequency.

    Attributes
    ----------
    frequency
        ω_m (rad/s).
    source, error
        Complex amplitudes per axis (m) of r = Re[source e^{jω_m t}] and of x̃ = −S(jω_m) r.
    """

    frequency: float
    source: NDArray[np.complex128]
    error: NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Bias:
    """Static errors of the averaged loop; made by `bias`.

    Attributes
    ----------
    frame
        The loop, with its numbers.
    laws
        Cause → the mean of x̃ per axis it leaves, in closed form: ``"source"`` −S(0) r, left by an
        axis without a pole at 0 (an unstable pole); ``"force"``, G/(1 + L) d, left by a constant
        force at the input; ``"ramp"``, left by a source of constant velocity; ``"asymmetry"``,
        left by the odd derivatives of a polynomial field; ``"nonlinearity"``, all that the average
        by quadrature of another field has beyond these. Numbers instead where the closed form
        would be too long to read.
    growth
        Per axis how fast x̃ grows (m/s), where a ramping source cannot be followed; else zeros.
    tracking
        One entry for each frequency of a source that swings.
    """

    frame: Frame
    laws: Laws
    growth: tuple[Expr, ...]
    tracking: tuple[Tracking, ...]

    @cached_property
    def parts(self) -> dict[str, Vector]:
        """Cause → the mean of x̃ (m), per axis."""
        return {cause: self.frame.numbers(law) for cause, law in self.laws.items()}

    @property
    def total(self) -> Vector:
        """The mean of x̃ (m), per axis: the sum of all parts; infinite where it grows."""
        rates = self.frame.numbers(self.growth)
        held = sum(self.parts.values(), np.zeros(len(rates)))
        return np.where(rates == 0, held, np.copysign(np.inf, rates))

    def __str__(self) -> str:
        names = [symbol_text(f"{name}tilde") for name in axis_names(len(self.growth))]
        lines = ["Static error of the mean, x̃ = position − source"]
        for cause, law in self.laws.items():
            for i, (name, e) in enumerate(zip(names, law, strict=True)):
                value = self.parts[cause][i]
                if value != 0:
                    stated = "" if e.is_number else f" = {expression_text(e)}"
                    lines.append(f"  {name}{stated} = {value:.6g} m ({cause})")
        for name, e in zip(names, self.growth, strict=True):
            if e != 0:
                lines.append(f"  {name} grows as {expression_text(e)}: the ramp is not followed")
        for swing in self.tracking:
            errors = zip(names, swing.error, strict=True)
            told = ", ".join(f"|{name}| = {abs(e):.6g} m" for name, e in errors if e)
            lines.append(f"  at {swing.frequency:.6g} rad/s: {told} (tracking, −S(jω) r)")
        if len(lines) == 1:
            lines = [f"{lines[0]}: none"]
        return "\n".join([*lines, *(f"Note: {note}." for note in self.frame.notes)])

    __repr__ = __str__


def bias(loop: Loop) -> Bias:
    """Return the mean offset of the averaged loop from the source, cause by cause, as ω → ∞.

    x̃ = (I + L)⁻¹ (−r + G d) at s = 0, worked out so that poles at 0 of G and C cancel: p ε x*/(gz −
    pε) for an unstable pole under a lead, the corrected (54); ε x*/(g − ε) without, (43); d p/(gz)
    for a constant force on 1/s² under a lead, d/(g C(0)) on 1/s. For polynomial fields of higher
    degree it is the first order in x̃, and `Average.offset` the whole.

    Raises
    ------
    InvalidDescription
        As `loop_gain`; and where nothing holds the mean, det(I + L(0)) = 0.
    """
    gain = loop_gain(loop)
    frame = gain.frame
    balance = _balance(frame.equations, frame.loop.twin)
    _check(frame.numbers(balance.matrix))
    laws, growth = _closed(balance) if balance.short else _solved(balance, frame)
    if averaged(frame.equations, 1).moments is not None:
        laws = {**laws, **_left_over(loop, Bias(frame, laws, growth, ()))}
    return Bias(frame, laws, growth, _tracking(gain))


@dataclass(frozen=True, eq=False)
class _Balance:
    """P(0) x̃ = the sum of all causes, and P(0) x̃̇ = what a ramp leaves to grow."""

    matrix: Any
    causes: dict[str, Any]
    growing: Any

    @property
    def short(self) -> bool:
        """Whether its solution can be read, and be found in a moment."""
        counts = [[len(summands(e)) if e != 0 else 0 for e in row] for row in self.matrix.tolist()]
        return permanent(counts, MAX_TERMS) < MAX_TERMS


@lru_cache(maxsize=256)
def _balance(equations: Relative, twin: Loop) -> _Balance:
    parts = linear(equations, twin)
    below, above = sympy.diag(*parts.below), sympy.diag(*parts.above).subs(s, 0)
    still, slope = below.subs(s, 0), below.diff(s).subs(s, 0)
    moves = [drift(r) for r in equations.source]
    velocity = sympy.Matrix([move.velocity for move in moves])
    pushing = [
        polynomial(g.numerator) * polynomial(c.denominator)
        for g, c in zip(parts.plants, parts.compensators, strict=True)
    ]
    force = getattr(twin.vehicle, "disturbance", None) or [sympy.Integer(0)] * len(pushing)
    causes: dict[str, Any] = {
        "source": -still * sympy.Matrix([move.place for move in moves]),
        "force": sympy.diag(*pushing).subs(s, 0) * sympy.Matrix(force),
        "ramp": -slope * velocity,
        "asymmetry": above * sympy.Matrix(_asymmetry(equations, twin)),
    }
    present = {cause: side for cause, side in causes.items() if not side.is_zero_matrix}
    return _Balance(still + above * parts.sensor, present, -still * velocity)


@lru_cache(maxsize=256)
def _closed(balance: _Balance) -> tuple[Laws, tuple[Expr, ...]]:
    determinant = sympy.expand(balance.matrix.det())
    adjugate = balance.matrix.adjugate()

    def solved(side: Any) -> tuple[Expr, ...]:
        return tuple(quotient(e, determinant) for e in adjugate * side)

    laws = {cause: solved(side) for cause, side in balance.causes.items()}
    return laws, solved(balance.growing)


def _solved(balance: _Balance, frame: Frame) -> tuple[Laws, tuple[Expr, ...]]:
    """Return the same in numbers."""
    matrix = frame.numbers(balance.matrix)

    def solved(side: Any) -> tuple[Expr, ...]:
        found = np.linalg.solve(matrix, frame.numbers(side)[:, 0])
        return tuple(sympy.Float(float(x)) if x else sympy.Integer(0) for x in found)

    laws = {cause: solved(side) for cause, side in balance.causes.items()}
    return laws, solved(balance.growing)


def _check(matrix: Vector) -> None:
    sizes = np.abs(matrix).max(axis=1, keepdims=True)
    if (sizes == 0).any() or np.linalg.matrix_rank(matrix / sizes) < len(matrix):
        raise InvalidDescription(
            "controller",
            "does not hold the mean of every axis, det(I + L(0)) = 0: a gain is 0, the field is "
            "flat to second order, the demodulation is singular (two axes share a frequency and a "
            "phase), or C or G has a zero at s = 0; see es.average for what holds it beyond that",
        )


def _asymmetry(equations: Relative, twin: Loop) -> list[Expr]:
    """Return μ_i = c_i ⟨F[J] reference_i⟩ at x̃ = 0; zeros where it has no closed form."""
    controller = gradient(twin)
    here = substituted(equations.leading, dict.fromkeys(equations.states, sympy.Integer(0)))
    waves = [symbol for o in equations.oscillators for symbol in (o.sine, o.cosine)]
    if not here.is_polynomial(*waves):
        return [sympy.Integer(0)] * len(controller.channels)
    turning = equations.oscillators
    if twin.sensor.law() != 1:
        known = series(sympy.expand(here), turning)
        here, own = filtered(known, twin.sensor.law(), equations.bases)
        turning = (*turning, *own)
    means = []
    for channel, frequency in zip(controller.channels, controller.frequencies(), strict=True):
        reference = sine(frequency * time, (channel.reference or channel.dither).phase)
        product = channel.gain * here * turned(reference, equations.oscillators)
        means.append(series(sympy.expand(product), turning).mean)
    return means


def _left_over(loop: Loop, known: Bias) -> Laws:
    """Return what the averaged equilibrium has beyond the linear parts, where it has one."""
    model = average(loop)
    rest = model.offset - sum(known.parts.values(), np.zeros(len(known.growth)))
    held = not any(known.growth)
    if not (held and np.abs(rest).max() > NEGLIGIBLE * np.abs(model.demodulation).max()):
        return {}
    return {"nonlinearity": tuple(sympy.Float(float(x)) for x in rest)}


def _tracking(gain: LoopGain) -> tuple[Tracking, ...]:
    """Return the errors −S(jω) r at the frequencies at which the source swings."""
    frame = gain.frame
    amplitudes: dict[float, NDArray[np.complex128]] = {}
    for axis, r in enumerate(frame.equations.source):
        for wave in drift(r).waves:
            law = (wave.coefficient, wave.frequency, wave.phase)
            size, frequency, phase = frame.numbers(law).tolist()
            if frequency < 0:  # sin(−a) = −sin a
                size, frequency, phase = -size, -frequency, -phase
            empty = np.zeros(gain.matrix.rows, dtype=np.complex128)
            column = amplitudes.setdefault(frequency, empty)
            column[axis] += size * np.exp(1j * (phase - np.pi / 2))
    return tuple(
        Tracking(frequency, column, -gain.sensitivity(frequency) @ column)
        for frequency, column in sorted(amplitudes.items())
        if frequency and column.any()
    )
