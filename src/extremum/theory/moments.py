"""Means of J times a sine or cosine over the dither: exact for polynomials, else by quadrature.

J_c k(x̃) = ⟨J cos θ_k⟩ and J_s k(x̃) = ⟨J sin θ_k⟩ are all that averaging needs of a field. For a
field that is not polynomial they are taken with the trapezoidal rule over the period, or over the
torus where frequencies are incommensurate, which converges faster than any power of the number of
points for smooth fields.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Symbol

from ..errors import InvalidDescription
from .fourier import Harmonic, Oscillator

FIRST: Final = 16
MAX_POINTS: Final = 1 << 18
TOLERANCE: Final = 1e-13


@dataclass(frozen=True, eq=False)
class Moment:
    """⟨J cos θ_k⟩ or ⟨J sin θ_k⟩, as a symbol of the averaged equations."""

    symbol: Symbol
    harmonic: Harmonic
    is_sine: bool


@dataclass(frozen=True, eq=False)
class Moments:
    """The moments of one field, by quadrature.

    Attributes
    ----------
    law
        J in the oscillators' symbols, the states, the slow inputs and the parameters.
    arguments
        The symbols that `law` depends on besides the oscillators', in the order of the numbers that
        `at` takes; the first `inner` of them are differentiated by.
    """

    law: Expr
    oscillators: tuple[Oscillator, ...]
    wanted: tuple[Moment, ...]
    arguments: tuple[Symbol, ...]
    inner: int

    @cached_property
    def _evaluate(self) -> Any:
        waves = [symbol for o in self.oscillators for symbol in (o.sine, o.cosine)]
        slopes = [self.law.diff(x) for x in self.arguments[: self.inner]]
        return sympy.lambdify(
            [waves, list(self.arguments)], [self.law, *slopes], "numpy", dummify=True, cse=True
        )

    def at(self, numbers: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        """Return moments and their derivatives, (wanted, 1 + inner), and the error estimated.

        Raises
        ------
        InvalidDescription
            If the rule has not converged with as many points as are tried.
        """
        count, error = FIRST, np.inf
        before = self._rule(count, numbers)
        while True:
            count *= 2
            if count ** len(self.oscillators[0].harmonic) > MAX_POINTS:
                raise InvalidDescription(
                    "field",
                    f"its mean over the dither has not converged with {count // 2} points per "
                    f"frequency (last change {error:.1e}); it is not smooth there, or too many "
                    "incommensurate frequencies are averaged over: state ratios as fractions",
                )
            now = self._rule(count, numbers)
            error = float(np.abs(now - before).max())
            if not np.isfinite(error):
                raise InvalidDescription("field", "has no finite value where the dither takes it")
            if error <= TOLERANCE * float(np.abs(now).max()):
                return now, error
            before = now

    def _rule(self, count: int, numbers: Sequence[float]) -> NDArray[np.float64]:
        size = len(self.oscillators[0].harmonic)
        angles = np.meshgrid(*[2 * np.pi * np.arange(count) / count] * size, indexing="ij")
        phases = [
            sum(n * a for n, a in zip(o.harmonic, angles, strict=True)) for o in self.oscillators
        ]
        waves = [wave(phase) for phase in phases for wave in (np.sin, np.cos)]
        shape = angles[0].shape
        with np.errstate(all="ignore"):
            sampled = [np.broadcast_to(e, shape) for e in self._evaluate(waves, numbers)]
        rows = []
        for moment in self.wanted:
            angle = sum(n * a for n, a in zip(moment.harmonic, angles, strict=True))
            weight = np.sin(angle) if moment.is_sine else np.cos(angle)
            rows.append([float(np.mean(weight * e)) for e in sampled])
        return np.array(rows)
