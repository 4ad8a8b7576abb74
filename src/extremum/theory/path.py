"""The averaged equations as a system of their own, and their path."""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import sympy
from sympy import Expr

from ..engines.choice import ENGINES, usual
from ..errors import InvalidDescription, shown
from ..system import Oracle, System
from .averaged import Averaged
from .labelled import labelled

if TYPE_CHECKING:
    import xarray


@lru_cache(maxsize=256)
def averaged_system(averaged: Averaged) -> System:
    """Return the averaged equations as a `System`; means by quadrature are oracles in it."""
    exact = averaged.equations.system
    signal = averaged.equations.signal
    slow = averaged.equations.slow
    means, oracles = _oracles(averaged)
    place = exact.outputs["source"]
    offset = exact.outputs["offset"]
    units = {x: exact.units[x] for x in (*exact.states, *(x for x, _ in slow))}
    units |= {x: exact.units[signal] for x, _ in means}
    return System(
        states=exact.states,
        rhs=tuple(e + f for e, f in zip(averaged.rates, averaged.forcing, strict=True)),
        initial=exact.begun,
        inputs=(),
        outputs=MappingProxyType(
            {
                "position": tuple(r + x for r, x in zip(place, offset, strict=True)),
                "offset": offset,
            }
        ),
        signals=(*slow, *means),
        parameters=exact.parameters,
        units=MappingProxyType(units),
        carriers=(),
        oracles=MappingProxyType(oracles),
    )


def _oracles(averaged: Averaged) -> tuple[list[tuple[sympy.Symbol, Expr]], dict[str, Oracle]]:
    if averaged.moments is None:
        return [], {}
    at = lru_cache(maxsize=8)(averaged.moments.at)
    bound, oracles = [], {}
    for index, moment in enumerate(averaged.moments.wanted):
        name = f"mean_{index}"

        def value(*numbers: float, index: int = index) -> float:
            return float(at(numbers)[0][index, 0])

        bound.append((moment.symbol, sympy.Function(name)(*averaged.moments.arguments)))
        oracles[name] = Oracle(value)
    return bound, oracles


def path(
    system: System, values: list[float], t_end: float, samples: int, tol: float
) -> xarray.Dataset:
    """Return the averaged path from the loop's own start; see `Average.simulate`."""
    engine = ENGINES[usual(system)]
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 2:
        raise InvalidDescription("samples", "must be a whole number greater than 1", shown(samples))
    times = np.linspace(0.0, t_end, samples)
    run = engine.integrate(system, values, times, tol=tol)
    attrs = {"outcome": run.outcome, "end_time": run.end_time}
    return labelled(system, run.times, run.states, values, attrs)
