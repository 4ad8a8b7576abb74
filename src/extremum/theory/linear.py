"""The averaged loop as a linear feedback loop: its loop gain L(s) = −diag(c) C(s) G(s) M H."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, ImmutableMatrix

from ..errors import InvalidDescription, shown
from ..loop import Loop
from ..printing import aligned, expression_text
from ..rational import Ratio, ratio
from ..symbols import axis_names, exact, s, substituted
from .demodulation import demodulation, gradient
from .frame import Frame, Relative, relative


@dataclass(frozen=True, eq=False)
class Linear:
    """The parts of the averaged loop, symbolically, shared by all loops of one structure.

    Attributes
    ----------
    plants, compensators
        G = N/D and C = N_c/D_c per axis.
    sensor
        −diag(c) M H, (axes, axes): what the demodulated signal says of x̃, times −1.
    """

    plants: tuple[Ratio, ...]
    compensators: tuple[Ratio, ...]
    sensor: Any

    @property
    def below(self) -> list[Expr]:
        """D D_c per axis, polynomials in s."""
        pairs = zip(self.plants, self.compensators, strict=True)
        return [polynomial(g.denominator) * polynomial(c.denominator) for g, c in pairs]

    @property
    def above(self) -> list[Expr]:
        """N N_c per axis, polynomials in s."""
        pairs = zip(self.plants, self.compensators, strict=True)
        return [polynomial(g.numerator) * polynomial(c.numerator) for g, c in pairs]


@dataclass(frozen=True, eq=False)
class LoopGain:
    """L(s) = −diag(c) C G M H of the averaged loop; made by `loop_gain`.

    Attributes
    ----------
    frame
        The loop, with its numbers.
    matrix
        L(s), (axes, axes), in the loop's symbols and `s`.
    """

    frame: Frame
    matrix: Any

    @property
    def axes(self) -> tuple[Expr, ...] | None:
        """L(s) = α c q C(s) G(s) of each axis; None where axes are coupled."""
        return tuple(self.matrix.diagonal()) if self.matrix.is_diagonal() else None

    @property
    def hidden(self) -> tuple[tuple[str, complex], ...]:
        """(axis, pole in 1/s) of what cancels between C and G: the loop has it, L(s) does not."""
        return hidden_modes(self.frame)

    @cached_property
    def numbers(self) -> Any:
        """L(s) with the loop's numbers, exact, as a matrix of rational functions of `s`."""
        return ImmutableMatrix(self.matrix.applyfunc(lambda e: sympy.cancel(_put(e, self.frame))))

    def at(self, frequency: float) -> NDArray[np.complex128]:
        """Return L(jω), (axes, axes), at ω = `frequency` (rad/s); infinite or NaN at a pole."""
        found = self.numbers.subs(s, sympy.I * sympy.Float(frequency))
        return np.array(found.tolist(), dtype=np.complex128)

    def sensitivity(self, frequency: float) -> NDArray[np.complex128]:
        """Return S(jω) = (I + L)⁻¹, (axes, axes), from −source to the mean of x̃; 0 at L's poles."""
        parts = linear(self.frame.equations, self.frame.loop.twin)

        def number(part: Any) -> NDArray[np.complex128]:
            here = part.applyfunc(lambda e: _put(e, self.frame)).subs(s, sympy.I * exact(frequency))
            return np.array(here.tolist(), dtype=np.complex128)

        below, above = number(sympy.diag(*parts.below)), number(sympy.diag(*parts.above))
        found = np.linalg.solve(below + above @ number(parts.sensor), below)
        return found.astype(np.complex128)

    def control(self, axis: int | None = None) -> Any:
        """Return L as a python-control transfer function, for Bode plots, margins, the root locus.

        Parameters
        ----------
        axis
            Which axis' L(s), single-input single-output; None for the whole matrix.

        Raises
        ------
        InvalidDescription
            For one axis of a coupled loop; if python-control is not installed.
        """
        control, rows = control_library(), self.numbers.tolist()
        if axis is None:
            entries = [[_coefficients(e) for e in row] for row in rows]
            return control.tf(*([[entry[k] for entry in row] for row in entries] for k in (0, 1)))
        check_axis(axis, len(rows), self.axes is not None)
        return control.tf(*_coefficients(rows[axis][axis]))

    def __str__(self) -> str:
        names = axis_names(self.matrix.rows)
        if self.axes is not None:
            rows = [(f"L_{n}(s)", e) for n, e in zip(names, self.axes, strict=True)]
        else:
            marks = [f"L_{a}{b}(s)" for a in names for b in names]
            rows = list(zip(marks, self.matrix, strict=True))
        lines = [
            "Loop gain of the averaged loop",
            *aligned([(n, expression_text(e)) for n, e in rows]),
        ]
        lines += [
            f"  hidden on {a}: {pole_text(p)} 1/s is a pole and a zero" for a, p in self.hidden
        ]
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_latex_(self) -> str:
        law = self.matrix if self.axes is None else sympy.Matrix(self.axes)
        return f"$\\displaystyle L(s) = {sympy.latex(law)}$"


def control_library() -> Any:
    """Return python-control, and say how to install it where it is missing."""
    try:
        import control
    except ImportError:
        raise InvalidDescription(
            "", "python-control is not installed: pip install 'extremum[control]'"
        ) from None
    return control


def check_axis(axis: int, count: int, alone: bool) -> None:
    """Refuse an axis that there is not, or that has no loop gain of its own."""
    if axis not in range(count):
        raise InvalidDescription("axis", f"must lie in 0 … {count - 1}", shown(axis))
    if not alone:
        raise InvalidDescription(
            "axis", "the axes are coupled, none has a loop gain of its own; leave it out", ""
        )


def loop_gain(loop: Loop) -> LoopGain:
    """Return the averaged loop's gain L(s) = −diag(c) C(s) G(s) M H as ω → ∞.

    The averaged loop is the feedback loop det(I + L(s)) = 0 beside the washout's mode −h. Where the
    Hessian is −2q diagonal and M = ½ diag(α) there is one L(s) = α c q C(s) G(s) for each axis:
    extremum seeking design is loop shaping. M is `Average.demodulation` in the limit ω → ∞, but for
    a sensor's F(jω), which it keeps.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start; for a vehicle with
        an axis that is no transfer function, and a controller that does not demodulate.
    """
    frame = relative(loop)
    return LoopGain(frame, _matrix(frame.equations, frame.loop.twin))


@lru_cache(maxsize=256)
def _matrix(equations: Relative, twin: Loop) -> Any:
    parts = linear(equations, twin)
    gains = [sympy.factor(n / d) for n, d in zip(parts.above, parts.below, strict=True)]
    return ImmutableMatrix((sympy.diag(*gains) * parts.sensor).applyfunc(sympy.factor_terms))


@lru_cache(maxsize=256)
def linear(equations: Relative, twin: Loop) -> Linear:
    """Return the parts of the averaged loop; both arguments are of one structure."""
    channels = gradient(twin).channels
    plants: list[Ratio] = []
    for plant in twin.vehicle.dynamics():
        if plant is None:
            raise InvalidDescription("vehicle", "has an axis that is no transfer function")
        plants.append(ratio(plant))
    m = demodulation(equations, twin, limit=True)
    sensor: Any = -sympy.diag(*(c.gain for c in channels)) * m * equations.hessian
    return Linear(
        tuple(plants),
        tuple(ratio(channel.compensator.law()) for channel in channels),
        ImmutableMatrix(sensor.applyfunc(sympy.factor)),
    )


def hidden_modes(frame: Frame) -> tuple[tuple[str, complex], ...]:
    """Return (axis, pole in 1/s) of what cancels between C and G, so that L(s) does not show it."""
    parts = linear(frame.equations, frame.loop.twin)
    names = axis_names(len(parts.plants))
    found = []
    for name, g, c in zip(names, parts.plants, parts.compensators, strict=True):
        for zeros, poles in ((c.numerator, g.denominator), (g.numerator, c.denominator)):
            shared: Any = sympy.gcd(*(_put(polynomial(e), frame) for e in (zeros, poles)))
            if shared.has(s):
                found += [(name, complex(root)) for root in sympy.Poly(shared, s).nroots()]
    return tuple(found)


def pole_text(pole: complex) -> str:
    """Return a pole as it is read, real where its imaginary part is rounding."""
    real = abs(pole.imag) <= 1e-9 * abs(pole)
    return f"{pole.real:.6g}" if real else f"{pole.real:.6g} {pole.imag:+.6g}j"


def polynomial(coefficients: Sequence[Expr]) -> Expr:
    """Return a polynomial in s from its coefficients, highest power first."""
    return sympy.Poly(list(coefficients), s).as_expr()


def _put(expression: Expr, frame: Frame) -> Expr:
    table = dict(zip(frame.system.symbols, map(exact, frame.values), strict=True))
    return substituted(expression, table)


def _coefficients(expression: Expr) -> tuple[list[float], list[float]]:
    form = ratio(expression)
    return [float(c) for c in form.numerator], [float(c) for c in form.denominator]
