"""Small systems made from text."""

from __future__ import annotations

from typing import Any

import sympy

from extremum.parameters import Parameter
from extremum.symbols import parse, t
from extremum.system import System


def system(rates: str, *, names: str = "x", carriers: str = "", **signals: str) -> System:
    """A system from text: states `names`, parameters a, b and w, signals in the order given."""
    states = tuple(sympy.symbols(names + ",", real=True))
    parameters = sympy.symbols("a b w", real=True)
    known: dict[str, Any] = {str(x): x for x in (*states, *parameters, t)}
    bound = []
    for name, text in signals.items():
        known[name] = sympy.Symbol(name, real=True)
        bound.append((known[name], parse(text, known)))
    return System(
        states=states,
        rhs=tuple(parse(rate, known) for rate in rates.split(",")),
        initial=(sympy.Integer(1),) * len(states),
        inputs=(),
        outputs={},
        signals=tuple(bound),
        parameters=tuple(Parameter(p, str(p), "1") for p in parameters),
        units=dict.fromkeys(known.values(), "1"),
        carriers=tuple(parse(c, known) for c in carriers.split(",") if c),
    )
