"""Live evidence for the errata: exact orbits beside what the paper's equations say.

Every number is computed when its table is asked for.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ...loop import Loop
from ...lti import Lead
from ...theory.orbits import periodic_orbit
from ...theory.printed import PaperLoop, recognise
from .orders import measured
from .schemes import double_integrators, unstable_poles
from .tables import Cell, Table


def known(loop: Loop) -> PaperLoop:
    """Return a loop of the paper as one of its schemes."""
    found = recognise(loop)
    assert isinstance(found, PaperLoop)
    return found


def largest(loop: Loop) -> float:
    """Return the largest real part of the Floquet exponents (1/s)."""
    return float(periodic_orbit(loop).exponents[0].real)


DESIGNS: Final = ((-2.0, -1.5), (-0.5, -3.0), (-2.0, -10.0), (-1.2, -1.1))
"""(z, p) of four leads, k = 5, for c = 10, α = 0.1, h = 1, q = (1, 0.5), source at the origin."""

RATE: Final = "+.4f"


def four_designs() -> Table:
    """Return erratum 1's largest real parts, predicted and exact, of four double integrators."""
    frequencies = (30.0, 100.0, 400.0)
    rows: list[tuple[Cell, ...]] = []
    for zero, pole in DESIGNS:
        lead = Lead(gain=5, zero=zero, pole=pole)
        loops = [double_integrators(w, 0.1, 10.0, lead) for w in frequencies]
        found = known(loops[0])
        exact = (largest(loop) for loop in loops)
        rows.append((1.0, zero, pole, found.printed.rate, found.corrected.rate, *exact))
    numbers = (("h", "g"), ("z", "g"), ("p", "g"), ("printed (27)", RATE), ("corrected", RATE))
    exact_ = tuple((f"exact, ω = {w:g}", RATE) for w in frequencies)
    return Table((*numbers, *exact_), tuple(rows))


def off_peak() -> Table:
    """Return erratum 2's mean of x̃ and largest real part, predicted and exact."""
    first = Lead(gain=4, zero=-3, pole=-2.5)
    second = Lead(gain=1, zero=-0.8, pole=-1)
    rows: list[tuple[Cell, ...]] = []
    for w in (400.0, 1600.0, 6400.0, 25600.0):
        loop = unstable_poles(w, 0.05, 10.0, 0.5, first, source=(1.0, -1.0))
        rows.append(_off_peak_row("-3, -2.5, 2", w, loop))
    for w in (400.0, 1600.0, 6400.0):
        loop = unstable_poles(w, 0.1, (10.0, 20.0), 0.5, second, source=(0.05, 0.05))
        rows.append(_off_peak_row("-0.8, -1, 1", w, loop))
    return Table(
        (
            ("z, p, g", ""),
            ("ω", "g"),
            ("mean of x̃", ".5f"),
            ("corrected (54)", ".5f"),
            ("printed (54)", ".5f"),
            ("largest exponent", RATE),
            ("corrected (52)", RATE),
            ("printed (52)", RATE),
        ),
        tuple(rows),
    )


def _off_peak_row(name: str, frequency: float, loop: Loop) -> tuple[Cell, ...]:
    orbit, found = periodic_orbit(loop), known(loop)
    mean = float(orbit.mean[0] - loop.field.source[0])  # pyright: ignore[reportAttributeAccessIssue]
    offsets = float(found.corrected.offset[0]), float(found.printed.offset[0])
    rates = float(orbit.exponents[0].real), found.corrected.rate, found.printed.rate
    return (name, frequency, mean, *offsets, *rates)


def positive_roots() -> Table:
    """Return erratum 3's polynomial, which meets the conditions, and its roots."""
    lead = Lead(gain=5, zero=-0.5, pole=-3)
    found = known(double_integrators(100.0, 0.1, 10.0, lead))
    _, a2, a3, last, *_ = (c.value for c in found.corrected.conditions)
    a1 = found.corrected.conditions[0].value
    roots = np.roots([1.0, a1, a2, a3])
    shown = ", ".join(f"{root:.3f}" for root in roots)
    columns = (("a₁", "g"), ("a₂", "g"), ("a₃", "g"), ("a₁a₂ − a₃", "g"), ("roots", ""))
    return Table(columns, ((a1, a2, a3, last, shown.replace("+0.000j", "")),))


def outputs() -> Table:
    """Return how far from equilibrium (65) the compensators' outputs w are, and how far x̃ is."""
    lead, other = Lead(gain=5, zero=-0.5, pole=-3), Lead(gain=2, zero=-3, pole=-2)
    rows: list[tuple[Cell, ...]] = []
    for w in (100.0, 400.0, 1600.0):
        two = measured(double_integrators(w, 0.1, 10.0, lead))
        four = measured(unstable_poles(w, 0.1, 10.0, 0.5, other, source=(0.2, -0.2)))
        rows.append((w, two.output, two.distance, four.output, four.distance))
    columns = (
        ("ω", "g"),
        ("Fig. 2: max |w|", ".4f"),
        ("max |x̃|", ".1e"),
        ("Fig. 3: max |w − wᵉ|", ".4f"),
        ("max |x̃ − x̃ᵉ|", ".1e"),
    )
    return Table(columns, tuple(rows))
