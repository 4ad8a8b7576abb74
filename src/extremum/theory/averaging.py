"""`average`: the averaged loop, with its equilibrium, its Jacobian and what they decide."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, ImmutableMatrix, Symbol

from ..engines.trajectory import UNDEFINED
from ..errors import InvalidDescription, shown
from ..loop import Loop
from ..printing import symbol_text
from ..symbols import substituted
from ..symbols import t as time
from ..system import System
from ..validation import positive
from . import averaged as equations
from .averaged import Averaged
from .collisions import Resonance, resonances_of
from .conditions import Condition, HurwitzSystem
from .demodulation import demodulation
from .equilibria import first_step, nearest, real_solutions
from .equilibrium import equilibrium_law, held
from .floquet import decays
from .frame import Frame, relative
from .path import averaged_system, path
from .routh import RouthArray

if TYPE_CHECKING:
    import xarray

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Average:
    """The averaged loop of one `Loop`; made by `average`.

    Attributes
    ----------
    frame
        The exact loop in the same coordinates.
    averaged
        The averaged equations, symbolically.
    """

    frame: Frame
    averaged: Averaged

    @property
    def states(self) -> tuple[Symbol, ...]:
        """X: x̃, ṽ_x, …, e, ζ_x, in the order of the loop's states."""
        return self.averaged.equations.states

    @property
    def rates(self) -> tuple[Expr, ...]:
        """Ẋ per second; divided by ω they are rates in τ = ωt, as in the paper's (10) to (12)."""
        return self.averaged.rates

    @property
    def system(self) -> System:
        """The averaged equations as a `System`, ready to be integrated."""
        return averaged_system(self.averaged)

    @property
    def values(self) -> list[float]:
        """The numbers, in the order of ``system.parameters``."""
        return self.frame.values

    @property
    def exact(self) -> bool:
        """Whether the average is in closed form; otherwise it is taken by quadrature."""
        return self.averaged.moments is None

    @cached_property
    def error(self) -> float:
        """Estimated error of the quadrature at the equilibrium; 0 in closed form."""
        if self.exact or self.equilibrium is None:
            return 0.0
        return self._at(self.equilibrium)[2]

    def _at(self, state: Vector) -> tuple[Vector, Vector, float]:
        """Return Ẋ, ∂Ẋ/∂X and the quadrature's error."""
        numbers = [float(x) for x in state]
        means, slopes, error = _moments(self.averaged, numbers, self.values)
        try:
            found = _compiled(self.averaged)(numbers, self.values, means, slopes)
        except UNDEFINED:
            count = len(self.states)
            found = np.full(count, np.nan), np.full((count, count), np.nan)
        rates, jacobian = (np.array(part, dtype=float) for part in found)
        return rates, jacobian, error

    @cached_property
    def equilibrium(self) -> Vector | None:
        """Xᵉ nearest to the source, (states,); None if there is none.

        For a moving source with its position and velocity held at their means.
        """
        law = self.equilibrium_law
        if law is not None:
            found = self.frame.numbers(law.values())
            return found if np.isfinite(found).all() else None
        origin = np.zeros(len(self.states))
        rates, slopes, _ = self._at(origin)
        if not (np.isfinite(rates).all() and np.isfinite(slopes).all()):
            return None
        sizes = np.maximum(1.0, abs(first_step(rates, slopes)))
        return nearest(lambda x: self._at(x)[0], lambda x: self._at(x)[1], origin, scale=sizes)

    @property
    def offset(self) -> Vector:
        """x̃ᵉ = position − source at the equilibrium (m), per axis; NaN if there is none."""
        places = self.frame.system.outputs["offset"]
        if self.equilibrium is None:
            return np.full(len(places), np.nan)
        return np.array([self.equilibrium[self.states.index(x)] for x in places])

    @property
    def equilibrium_law(self) -> dict[Symbol, Expr] | None:
        """Xᵉ in closed form, for quadratic fields; see (13), (43) and the corrected (54)."""
        return equilibrium_law(self.averaged)

    @cached_property
    def equilibria(self) -> tuple[Vector, ...]:
        """Every real Xᵉ known: all for polynomial fields of low degree, else the nearest."""
        if self.equilibrium_law is None and self.exact:
            table = dict(zip(self.system.symbols, map(sympy.Float, self.values), strict=True))
            still = [substituted(e, table) for e in held(self.averaged)]
            with suppress(InvalidDescription):  # too many to be sure of, or a continuum
                return tuple(real_solutions(still, list(self.states)))
        return () if self.equilibrium is None else (self.equilibrium,)

    @property
    def jacobian(self) -> ImmutableMatrix:
        """∂Ẋ/∂X per second, at the equilibrium where that is in closed form; see (14)."""
        return _jacobian(self.averaged)

    @cached_property
    def matrix(self) -> Vector | None:
        """∂Ẋ/∂X at the equilibrium in numbers (1/s), (states, states)."""
        return None if self.equilibrium is None else self._at(self.equilibrium)[1]

    @cached_property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues of `matrix` (1/s), the least stable first; empty without equilibrium."""
        if self.matrix is None:
            return np.empty(0, dtype=complex)
        found: NDArray[np.complex128] = np.linalg.eigvals(self.matrix).astype(np.complex128)
        return found[np.argsort(-found.real, kind="stable")]

    @cached_property
    def bandwidth(self) -> float:
        """The fastest mode's |λ| (1/s), the sensor's own left out; 0 without equilibrium."""
        if self.matrix is None:
            return 0.0
        sensing = self.averaged.equations.sensing
        kept = [i for i, x in enumerate(self.states) if x not in sensing]
        modes = np.linalg.eigvals(self.matrix[np.ix_(kept, kept)])
        return float(np.abs(modes).max(initial=0.0))

    @property
    def stable(self) -> bool:
        """Whether there is an equilibrium and every eigenvalue has a negative real part."""
        return decays(self.eigenvalues)

    @property
    def characteristic(self) -> tuple[tuple[Expr, ...] | None, ...]:
        """Factors of det(λI − J), as coefficients from the highest power; see (31).

        One for each block of states that depend on each other; None where it is too long to write.
        """
        return _hurwitz(self.averaged).polynomials

    @cached_property
    def routh(self) -> tuple[RouthArray, ...]:
        """Routh's array of each factor; empty without equilibrium."""
        return () if self.equilibrium is None else _hurwitz(self.averaged).routh(self._numbers())

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """The Routh–Hurwitz conditions, each an inequality, its value and its margin."""
        if self.equilibrium is None:
            return ()
        return _hurwitz(self.averaged).at(self._numbers())

    def _numbers(self) -> list[float]:
        assert self.equilibrium is not None
        state = [float(x) for x in self.equilibrium]
        means, slopes, _ = _moments(self.averaged, state, self.values)
        return [*self.values, *state, *means, *(d for row in slopes for d in row)]

    @cached_property
    def resonances(self) -> tuple[Resonance, ...]:
        """Combinations of the dithers' frequencies that collide, or nearly: those felt by the loop.

        Nearly is within ten times the fastest averaged mode; such a beat is kept as a forcing.
        """
        return resonances_of(self.frame, self.averaged.degree, self.bandwidth)

    @property
    def hessian_law(self) -> ImmutableMatrix:
        """H = ∂²J/∂p² at the source."""
        return self.averaged.equations.hessian

    @cached_property
    def hessian(self) -> Vector:
        """H in numbers, (axes, axes)."""
        return self.frame.numbers(self.hessian_law)

    @property
    def demodulation_law(self) -> ImmutableMatrix:
        """M, at finite ω; see `demodulation`."""
        return demodulation(self.frame.equations, self.frame.loop.twin, limit=False)

    @cached_property
    def demodulation(self) -> Vector:
        """M in numbers (m), (channels, axes): ½ diag(α) in the ideal."""
        return self.frame.numbers(self.demodulation_law)

    @cached_property
    def demodulation_limit(self) -> Vector:
        """M as ω → ∞, but for the sensor's F(jω), in numbers (m), (channels, axes)."""
        frame = self.frame
        return frame.numbers(demodulation(frame.equations, frame.loop.twin, limit=True))

    def simulate(self, t_end: float, *, samples: int = 2000, tol: float = 1e-10) -> xarray.Dataset:
        """Integrate the averaged equations from the loop's own start, to draw over the true path.

        Returns
        -------
        xarray.Dataset
            ``position(time, axis)`` (m), the dither left out; ``offset(time, axis)`` = x̃ (m); every
            state; ``attrs["outcome"]`` as in `simulate`.
        """
        t_end, tol = positive("t_end", t_end), positive("tol", tol)
        return path(self.system, self.values, t_end, samples, tol)

    def text(self) -> str:
        """Return equations, equilibrium, characteristic polynomial and conditions as text."""
        from .wording import text

        return text(self)

    def __str__(self) -> str:
        return self.text()

    __repr__ = __str__

    def latex(self) -> str:
        """Return the averaged equations in τ as a LaTeX ``aligned`` environment."""
        from .wording import latex

        return latex(self)

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {self.latex()}$"


def average(loop: Loop, *, order: int = 1) -> Average:
    """Return the averaged loop.

    In coordinates relative to the source and the steady dither response (x̃ = x − x* − α sin ωt,
    e = η − f*; the compensators' states as they are), Ẋ = ⟨f(X, t)⟩ over the fast phases. One
    frequency or several commensurate ones are averaged over their common period, incommensurate
    ones over the torus of their phases; beats slow enough for the loop to feel are kept; a moving
    source stays as slow inputs r(t), ṙ(t). Exact for fields polynomial in position; by the
    trapezoidal rule, with its error estimated, for others. A sensor F(s) passes each harmonic of J
    as F(jν) at the loop's own ω; its states stay, driven by the mean of J.

    Parameters
    ----------
    order
        1 for the limit ω → ∞ that the paper's theorems are about; 2 adds the terms of order 1/ω
        (the washout's phase, the ripple's rectification), for loops without a sensor.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start; if it is not smooth;
        for order 2 of a field that is no polynomial, or of a loop with a sensor.

    Notes
    -----
    Source: Zhang, Siranosian and Krstić (2007), (7) to (14), (24) to (31), (49) to (54), of which
    (27), (31), (52) and (54) are corrected here; see docs/errata.md.
    """
    if order not in (1, 2):
        raise InvalidDescription("order", "must be 1 or 2", shown(order))
    frame = relative(loop)
    found = Average(frame, equations.averaged(frame.equations, order))
    slow = [r.harmonic for r in found.resonances if r.frequency > 0]
    if not slow:
        return found
    kept = tuple(dict.fromkeys(slow))
    return Average(frame, equations.averaged(frame.equations, order, kept))


def _symbols(averaged: Averaged) -> tuple[list[Symbol], list[list[Symbol]]]:
    """Return the moments' symbols and those of their derivatives by the states they depend on."""
    if averaged.moments is None:
        return [], []
    means = [moment.symbol for moment in averaged.moments.wanted]
    inner = averaged.moments.arguments[: averaged.moments.inner]
    names = [symbol_text(x.name) for x in inner]
    return means, [[Symbol(f"∂{m}/∂{name}", real=True) for name in names] for m in means]


@lru_cache(maxsize=256)
def _derivative(averaged: Averaged) -> ImmutableMatrix:
    """Return ∂Ẋ/∂X with symbols for the moments' derivatives."""
    states = averaged.equations.states
    rates = sympy.Matrix(held(averaged))
    found = rates.jacobian(states)
    means, slopes = _symbols(averaged)
    if averaged.moments is not None:
        by_mean = rates.jacobian(means)
        inner = averaged.moments.arguments[: averaged.moments.inner]
        table = sympy.zeros(len(means), len(states))
        for row, entries in enumerate(slopes):
            for x, entry in zip(inner, entries, strict=True):
                table[row, states.index(x)] = entry
        found += by_mean * table
    return ImmutableMatrix(found)


@lru_cache(maxsize=256)
def _compiled(averaged: Averaged) -> Any:
    means, slopes = _symbols(averaged)
    arguments = [
        list(averaged.equations.states),
        list(averaged.equations.system.symbols),
        means,
        slopes,
    ]
    return sympy.lambdify(
        arguments,
        [list(held(averaged)), _derivative(averaged).tolist()],
        "math",
        dummify=True,
        cse=True,
    )


def _moments(
    averaged: Averaged, state: list[float], values: list[float]
) -> tuple[list[float], list[list[float]], float]:
    if averaged.moments is None:
        return [], [], 0.0
    known = dict(zip(averaged.equations.system.symbols, values, strict=True))
    known |= dict(zip(averaged.equations.states, state, strict=True)) | {time: 0.0}
    found, error = averaged.moments.at([known[x] for x in averaged.moments.arguments])
    return found[:, 0].tolist(), found[:, 1:].tolist(), error


@lru_cache(maxsize=256)
def _jacobian(averaged: Averaged) -> ImmutableMatrix:
    law = equilibrium_law(averaged)
    matrix = _derivative(averaged)
    if law is None:
        return matrix
    return ImmutableMatrix(matrix.applyfunc(lambda e: sympy.factor(substituted(e, law))))


@lru_cache(maxsize=256)
def _hurwitz(averaged: Averaged) -> HurwitzSystem:
    means, slopes = _symbols(averaged)
    symbols = [*averaged.equations.system.symbols, *averaged.equations.states]
    return HurwitzSystem(
        _jacobian(averaged),
        (*symbols, *means, *(d for row in slopes for d in row)),
        tuple(x.name for x in averaged.equations.states),
    )
