"""Live evidence on what the paper claims in words, and on the orders it prints.

Every number is computed when its table is asked for.
"""

from __future__ import annotations

from fractions import Fraction
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from ...controllers import Channel, Dither, GradientES
from ...fields import Expression, Quadratic
from ...loop import Loop
from ...lti import Lead, transfer
from ...simulation import simulate
from ...theory.orbits import periodic_orbit
from ...vehicles import PointMass
from . import scenario
from .evidence import RATE, known, largest
from .orders import measured
from .schemes import double_integrators, single_integrators, two_axes, unstable_poles
from .tables import Cell, Table
from .theorems import theorem

if TYPE_CHECKING:
    import xarray


def orders() -> Table:
    """Return the orders of Theorems 1 to 4 that are not what is measured."""
    rows = tuple(
        (number, fit.quantity, fit.small, fit.dithers, fit.claim, fit.printed, fit.slope)
        for number in (1, 2, 3, 4)
        for fit in theorem(number).fits
        if not fit.as_printed
    )
    columns = (
        ("theorem", "g"),
        ("quantity", ""),
        ("in", ""),
        ("dithers", ""),
        ("claim", ""),
        ("printed", "g"),
        ("measured", ".2f"),
    )
    return Table(columns, rows)


def design() -> Table:
    """Return designs by section 3 with z < −h: h = 0.1, q̲ = 0.5, αck = 2, ε = 0.5."""
    rows: list[tuple[Cell, ...]] = []
    for zero in (-0.2, -0.4, -0.6):
        loop = unstable_poles(400.0, 0.1, 20.0, 0.5, Lead(gain=1, zero=zero, pole=-1), washout=0.1)
        found = known(loop)
        rows.append((zero, found.printed.rate, found.corrected.rate, largest(loop)))
    columns = (
        ("z", "g"),
        ("printed (52)", RATE),
        ("corrected", RATE),
        ("exact, ω = 400", RATE),
    )
    return Table(columns, tuple(rows))


def medium_pole() -> Table:
    """Return ε = 0.5 without a compensator: α = 0.05, ω = 60, g = 2 in both axes."""
    rows: list[tuple[Cell, ...]] = []
    for source in (0.0, 0.2, 0.4, 1.0):
        loop = unstable_poles(60.0, 0.05, (40.0, 80.0), 0.5, source=(source, -source))
        orbit, found = periodic_orbit(loop), known(loop)
        exact: tuple[Cell, ...] = ("none found", "none found")
        if orbit.found:
            exact = float(orbit.exponents[0].real), float(orbit.mean[0] - source)
        bias = float(found.corrected.offset[0])
        rows.append((source, found.corrected.rate, exact[0], bias, exact[1]))
    columns = (
        ("x* = −y*", "g"),
        ("averaged", RATE),
        ("exact", RATE),
        ("bias, by (43)", ".4f"),
        ("mean of x̃", ".4f"),
    )
    return Table(columns, tuple(rows))


def constant_force() -> Table:
    """Return the mean of x̃ under a constant force 0.3 at the input of x, at ω = 400."""
    lead, push = Lead(gain=5, zero=-0.5, pole=-3), (0.3, 0.0)
    loops = {
        "1/s, g = 1": single_integrators(400.0, 0.1, 10.0, force=push),
        "1/s² with lead, g = 5": double_integrators(400.0, 0.1, 10.0, lead, force=push),
    }
    rows = tuple(
        (name, 0.0, float(known(loop).corrected.offset[0]), float(periodic_orbit(loop).mean[0]))
        for name, loop in loops.items()
    )
    columns = (("axis", ""), ("the paper", "g"), ("d/(α c q C(0))", ".4f"), ("exact", ".4f"))
    return Table(columns, rows)


def drag() -> Table:
    """Return 1/(s(s + d)) with C = 1, g = 1 in both axes, at ω = 100."""
    rows: list[tuple[Cell, ...]] = []
    for d in (0.5, 2.0):
        plant = transfer(f"1/(s*(s + {d}))")
        loop = two_axes(plant, transfer(1.0), 100.0, 0.1, (10.0, 20.0))
        roots = np.roots([1.0, d, 1.0])
        rows.append((d, float(plant.relative_degree()), float(roots.real.max()), largest(loop)))
    columns = (
        ("d", "g"),
        ("relative degree", "g"),
        ("roots of s² + ds + g", RATE),
        ("exact, ω = 100", RATE),
    )
    return Table(columns, tuple(rows))


def frequencies() -> Table:
    """Return which frequencies serve: three axes on two of them, and two that collide."""
    third = Channel(Dither(0.1), 10.0, ratio=Fraction(3, 2))
    pair = (Channel(Dither(0.1), 10.0), Channel(Dither(0.1, -pi / 2), 10.0))
    double = Channel(Dither(0.1, pi / 2), 10.0, ratio=2)
    cases = {
        "x, y at ω in quadrature, z at 3ω/2": (*pair, third),
        "x at ω, y at 2ω with phase π/2": (pair[0], double),
    }
    rows: list[tuple[Cell, ...]] = []
    for name, channels in cases.items():
        for w in (100.0, 1600.0):
            count = len(channels)
            loop = Loop(
                field=Quadratic(source=(0.0,) * count, q=(1.0, 0.5, 0.75)[:count], peak=1.0),
                vehicle=PointMass(axes=(transfer("1/s"),) * count),
                controller=GradientES(frequency=w, washout=1.0, channels=channels),
                start=(0.0,) * count,
            )
            orbit = periodic_orbit(loop)
            far = float(np.abs(orbit.mean).max())
            rows.append((name, w, float(orbit.exponents[0].real), far))
    columns = (
        ("frequencies, α = 0.1", ""),
        ("ω", "g"),
        ("largest exponent", RATE),
        ("distance of the mean", ".5f"),
    )
    return Table(columns, tuple(rows))


def cubic() -> Table:
    """Return the mean of x for J = 1 − x² − y²/2 + x³/2: f‴ = 3, α = 0.1, in quadrature."""
    field = Expression("1 - x**2 - y**2/2 + b*x**3", parameters={"b": 0.5})
    rows: list[tuple[Cell, ...]] = []
    for w in (100.0, 400.0, 1600.0, 6400.0):
        orbit = periodic_orbit(single_integrators(w, 0.1, 10.0, field=field))
        rows.append((w, 0.0, 3.0 * 0.1**2 / 16, float(orbit.mean[0])))
    columns = (
        ("ω", "g"),
        ("limit by Theorem 1", "g"),
        ("f‴α²/(16 q)", ".6f"),
        ("exact mean of x", ".6f"),
    )
    return Table(columns, tuple(rows))


def small_amplitudes() -> Table:
    """Return Theorem 3 with c = 10, ε = 0.05, source (1, −1), ω = 4000, as α shrinks."""
    rows: list[tuple[Cell, ...]] = []
    for amplitude in (0.05, 0.03, 0.02, 0.008):
        found = measured(unstable_poles(4000.0, amplitude, 10.0, 0.05, source=(1.0, -1.0)))
        rate = float(found.orbit.exponents[0].real)
        stable: Cell = found.residual if rate < 0 else "unstable"
        rows.append((amplitude, found.known.corrected.rate, rate, stable))
    columns = (
        ("α", "g"),
        ("averaged", RATE),
        ("exact, ω = 4000", RATE),
        ("lim sup |f − f*|", ".4f"),
    )
    return Table(columns, tuple(rows))


def phases() -> Table:
    """Return Fig. 5's loop with the phase that the scan shows, and with 3π/2."""
    rows: list[tuple[Cell, ...]] = []
    for name, phase in (("3", 3.0), ("3π/2", 3 * pi / 2)):
        loop = scenario("fig5").loop.replace({"field.path.phase": phase})
        run = simulate(loop, 30.0)
        x, y = run.source.values[0]
        rows.append((name, f"({x + 0.0:.2f}, {abs(y) if abs(y) < 1e-9 else y:.2f})", _ended(run)))
    return Table((("φ_m", ""), ("source at t = 0", ""), ("Fig. 5, 30 s", "")), tuple(rows))


def starts() -> Table:
    """Return loops that escape when the washout starts at zero, not when it starts at J(0)."""
    shifted = scenario("fig4").loop.replace({"field.peak": -4.0})
    loops = {"Fig. 4 with J − 5": shifted, "Fig. 7": scenario("fig7").loop}
    rows: list[tuple[Cell, ...]] = []
    for name, loop in loops.items():
        begun = (
            simulate(loop.replace({"controller.washout_start": start}), 4.0)
            for start in ("zero", "signal")
        )
        rows.append((name, *(_ended(run) for run in begun)))
    columns = (("loop", ""), ("washout from zero", ""), ("washout from J(0)", ""))
    return Table(columns, tuple(rows))


def _ended(run: xarray.Dataset) -> str:
    if run.attrs["outcome"] == "escaped":
        return f"escapes at {run.attrs['end_time']:.3f} s"
    return str(run.attrs["outcome"])
