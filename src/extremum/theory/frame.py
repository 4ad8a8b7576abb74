"""The loop in coordinates relative to the source and to the steady response to its probes.

With r(t) the source and a(t) the vehicle's steady response to the probes (from G(jω)), each
vehicle state is X = X̃ + N r + a, N the state at rest at position 1, and the washout's is
η = e + F(0) f*, F the sensor (1 without one), whose states are relative to rest under f*. For the
paper's Fig. 1 that is its change of coordinates, (3) to (9): x̃ = x − x* − α sin ωt, e = η − f*.
It is exact: nothing is averaged here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy import Expr, Symbol

from ..diagram import Motion
from ..engines.trajectory import UNDEFINED
from ..loop import SENSED, Loop, checked
from ..parameters import Parameter
from ..rational import ratio, vanishes
from ..symbols import axis_names, substituted
from ..symbols import t as time
from ..system import System
from .drift import whole
from .fourier import Oscillator, derivative, leading, oscillators, turned, unturned
from .periods import MAX_CYCLES, common, fraction, slow_frequencies
from .sources import located


@dataclass(frozen=True, eq=False)
class Relative:
    """The equations in relative coordinates, shared by all loops of one structure.

    The oscillators' sines and cosines are symbols here, so that rates and signals are polynomial in
    them wherever the field is polynomial.

    Attributes
    ----------
    oscillators, bases
        The dithers, and the independent frequencies Ω they are multiples of.
    states, rates
        X̃, ζ, e and their rates (per second) in terms of the signals.
    signals
        Ordered bindings: r and ṙ of a moving source, J, ξ, m, w, u.
    signal, leading
        J's symbol, and J with the position's dither replaced by its limit as ω → ∞.
    sensed, sensor, sensing
        The symbol of what the controller receives, F(s) from J to it, and its states; J's symbol
        and 1 where there are none.
    dither, dither_limit
        Per axis, the sensor's steady response a(t) to the probes, and its limit as ω → ∞ (the same
        where the probe goes through 1/G: G(jω)/G(jω) = 1).
    ripple
        Per axis, the sensor's steady motion that a constant ξ leaves, which is demodulated too:
        c ξ sin(ωt + ψ) through C and G, to the leading order in 1/ω. Empty without a sensor: only
        a gain that makes up for a small F(jω) makes it matter.
    source
        Per axis r(t).
    hessian
        ∂²J/∂p² at the source.
    system
        The same as a `System` in t, ready to be integrated.
    """

    oscillators: tuple[Oscillator, ...]
    bases: tuple[Expr, ...]
    states: tuple[Symbol, ...]
    rates: tuple[Expr, ...]
    signals: tuple[tuple[Symbol, Expr], ...]
    signal: Symbol
    leading: Expr
    sensed: Symbol
    sensor: Expr
    sensing: tuple[Symbol, ...]
    dither: tuple[Expr, ...]
    dither_limit: tuple[Expr, ...]
    ripple: tuple[Expr, ...]
    source: tuple[Expr, ...]
    hessian: sympy.ImmutableMatrix
    system: System

    @property
    def changing(self) -> bool:
        """Whether the field changes with time otherwise than by moving as a whole."""
        return self.leading.has(time)

    @property
    def slow(self) -> tuple[tuple[Symbol, Expr], ...]:
        """The bindings of r and ṙ of a moving source."""
        return self.signals[: [x for x, _ in self.signals].index(self.signal)]


@dataclass(frozen=True, eq=False)
class Frame:
    """A loop in relative coordinates, with its numbers.

    Attributes
    ----------
    loop
        The loop as theory takes it: its probe steady, its field symbolic.
    equations
        The symbolic part.
    values
        The numbers, in the order of ``system.parameters``.
    notes
        What was replaced or found to get here, in sentences.
    """

    loop: Loop
    equations: Relative
    values: list[float]
    notes: tuple[str, ...]

    @property
    def system(self) -> System:
        """The exact equations in relative coordinates."""
        return self.equations.system

    def numbers(self, law: Any) -> NDArray[np.float64]:
        """Return a matrix or a sequence of expressions in numbers, NaN if one has none."""
        matrix = isinstance(law, sympy.MatrixBase)
        found = evaluated(tuple(law.flat() if matrix else law), self.system)(self.values)
        return np.array(found, dtype=float).reshape(law.shape if matrix else len(found))

    def frequencies(self) -> tuple[float, ...]:
        """Return every angular frequency (rad/s): the dithers', then the source's."""
        base, multiples = self._multiples()
        return tuple(dict.fromkeys(float(m) * base for m in multiples))

    def _multiples(self) -> tuple[float, list[Fraction]]:
        """Return ω, and every frequency as a multiple of it."""
        controller: Any = self.loop.twin.controller
        ratios = tuple(sympy.cancel(c / controller.base()) for c in self.system.carriers)
        base = float(self.loop.controller.base())
        numbers = self.numbers(ratios).tolist()
        multiples = [
            Fraction(int(law.p), int(law.q)) if isinstance(law, sympy.Rational) else fraction(n)
            for law, n in zip(ratios, numbers, strict=True)
        ]
        return base, [*multiples, *(fraction(f / base) for f in self.turning())]

    def turning(self) -> tuple[float, ...]:
        """Return the angular frequencies (rad/s) of the source's path and the field alone."""
        slow = self.numbers(slow_frequencies(self.system) or ()).tolist()
        return tuple(abs(f) for f in slow if f)

    def period(self) -> tuple[float, int] | None:
        """Return the time after which everything repeats (s), and how many cycles that is.

        A cycle is one of the slowest dither. None if nothing repeats within 20,000 cycles, or if
        time enters otherwise than by sines.
        """
        if not self.system.carriers or slow_frequencies(self.system) is None:
            return None
        base, multiples = self._multiples()
        unit = common(multiples)
        cycles = int(min(multiples[: len(self.system.carriers)]) / unit)
        return None if cycles > MAX_CYCLES else (2 * math.pi / (float(unit) * base), cycles)


def relative(loop: Loop) -> Frame:
    """Return the loop in coordinates relative to source and dither.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start.
    """
    try:
        return _frame(checked(loop), loop.system)
    except TypeError:  # an opaque field's callable that cannot be hashed
        return _frame.__wrapped__(loop, loop.system)


@lru_cache(maxsize=32)
def _frame(loop: Loop, system: System) -> Frame:
    """Return the frame; equal loops may differ in structure, as a ratio "129/128" and its float do.

    Hence their systems are part of the key.
    """
    ready = located(loop)
    equations = _relative(ready.loop.system, ready.loop.twin)
    values = [*ready.loop.values.tolist(), *(ready.found or ())]
    notes = ready.notes
    if equations.changing:
        notes += (
            "the field changes with time: eigenvalues, conditions and loop gain are those at t = 0",
        )
    if not whole(equations.source):
        notes += (
            "the source's path is more than a constant velocity and sines: equilibrium and static "
            "errors are those of a source that stays where the rest of its path is at t = 0",
        )
    return Frame(ready.loop, equations, values, notes)


@lru_cache(maxsize=512)
def evaluated(
    expressions: tuple[Expr, ...], system: System
) -> Callable[[Sequence[float]], list[float]]:
    """Return a callable: the parameters' values → the expressions' values, NaN if one has none."""
    law = sympy.lambdify([list(system.symbols)], list(expressions), "math", dummify=True, cse=True)

    def asked(values: Sequence[float]) -> list[float]:
        try:
            return [float(x) for x in law(values)]
        except UNDEFINED:
            return [math.nan] * len(expressions)

    return asked


@lru_cache(maxsize=256)
def _relative(system: System, twin: Loop) -> Relative:
    dithers, bases = oscillators(system.carriers)
    source, added = _source(system, twin)
    slow, place, drift = _slow_inputs(source, twin)
    swings = _swings(twin, dithers, twin.controller.motion)
    base = twin.controller.base()
    leads = [leading(a, dithers, base) for a in swings]
    limits = tuple(b if order == 0 else a for a, (b, order) in zip(swings, leads, strict=True))
    still = twin.rest(substituted(twin.field.law(source), {time: sympy.Integer(0)}))
    states = _renamed(system, len(swings), still)

    def shift(position: Sequence[Expr], turns: Sequence[Expr] = swings) -> tuple[Expr, ...]:
        rest = twin.vehicle.rest(position)
        return (*(n + a for n, a in zip(rest, turns, strict=True)), *still)

    def moved(position: Sequence[Expr], turns: Sequence[Expr] = swings) -> dict[Expr, Expr]:
        shifts = zip(system.states, states, shift(position, turns), strict=True)
        return {old: new + offset for old, new, offset in shifts}

    signal = next(x for x, _ in system.signals if x == system.outputs["J"][0])
    signals = {x: substituted(turned(e, dithers), moved(place)) for x, e in system.signals}
    law = turned(dict(system.signals)[signal], dithers)
    signals[signal] = substituted(law, moved(source))
    inputs = {u: signals[u] for u in system.inputs}
    turning = (*swings, *(sympy.Integer(0) for _ in still))
    drifting = (*twin.vehicle.rest(drift), *(sympy.Integer(0) for _ in still))
    rates = []
    for rate, swing, velocity in zip(system.rhs, turning, drifting, strict=True):
        driven = substituted(substituted(turned(rate, dithers), inputs), moved(place))
        rates.append(_settled(driven - derivative(swing, dithers), dithers, system) - velocity)
    places = system.outputs["sensor"]
    still_at = dict.fromkeys(system.states, sympy.Integer(0))
    order = ratio(twin.sensor.law()).order
    sensing = states[len(swings) : len(swings) + order]
    rippling = _swings(twin, dithers, twin.controller.ripple) if sensing else ()
    rippling = tuple(leading(r, dithers, base)[0] for r in rippling)
    dither, dither_limit, ripple = (
        tuple(substituted(e, still_at | dict(zip(system.states, a, strict=False))) for e in places)
        for a in (swings, limits, rippling)
    )
    known = (*slow, *signals.items())
    begun = [unturned(e, dithers).subs(time, 0) for e in shift(source)]
    centred = dict(zip(system.states, states, strict=True))
    outputs = {
        "position": tuple(substituted(e, moved(place)) for e in system.outputs["position"]),
        "J": (signal,),
        "input": system.inputs,
        "source": place,
        "offset": tuple(substituted(e, centred) for e in system.outputs["position"]),
    }
    units = {new: system.units[old] for old, new in zip(system.states, states, strict=True)}
    units |= {x: system.units[x] for x in signals} | {x: "m" for x, _ in slow[::2]}
    units |= {x: "m/s" for x, _ in slow[1::2]}
    return Relative(
        oscillators=dithers,
        bases=bases,
        states=states,
        rates=tuple(rates),
        signals=known,
        signal=signal,
        leading=substituted(law, moved(source, limits)),
        sensed=SENSED if sensing else signal,
        sensor=twin.sensor.law() if sensing else sympy.Integer(1),
        sensing=sensing,
        dither=dither,
        dither_limit=dither_limit,
        ripple=ripple,
        source=source,
        hessian=_hessian(twin, source),
        system=System(
            states=states,
            rhs=tuple(unturned(e, dithers) for e in rates),
            initial=tuple(e - d for e, d in zip(system.initial, begun, strict=True)),
            inputs=system.inputs,
            outputs=MappingProxyType(
                {name: tuple(unturned(e, dithers) for e in es) for name, es in outputs.items()}
            ),
            signals=tuple((x, unturned(e, dithers)) for x, e in known),
            parameters=(*system.parameters, *added),
            units=MappingProxyType(units),
            carriers=system.carriers,
        ),
    )


def _source(system: System, twin: Loop) -> tuple[tuple[Expr, ...], list[Parameter]]:
    """Return r(t), and the parameters that stand for it where the field does not state it."""
    if "source" in system.outputs:
        return system.outputs["source"], []
    names = axis_names(twin.vehicle.dimension())
    symbols = tuple(Symbol(f"{name}^*", real=True) for name in names)
    return symbols, [Parameter(x, "", "m") for x in symbols]


def _slow_inputs(
    source: tuple[Expr, ...], twin: Loop
) -> tuple[list[tuple[Symbol, Expr]], tuple[Expr, ...], tuple[Expr, ...]]:
    """Return bindings of r and ṙ, and both per axis: symbols where the source moves."""
    bound: list[tuple[Symbol, Expr]] = []
    place: list[Expr] = []
    drift: list[Expr] = []
    for name, r in zip(axis_names(twin.vehicle.dimension()), source, strict=True):
        if r.has(time):
            position, velocity = (Symbol(f"{x}_{name}", real=True) for x in ("r", "rdot"))
            bound += [(position, r), (velocity, r.diff(time))]
        else:
            position, velocity = r, sympy.Integer(0)
        place.append(position)
        drift.append(velocity)
    return bound, tuple(place), tuple(drift)


def _swings(
    twin: Loop, dithers: Sequence[Oscillator], motions: Callable[[int], Motion | None]
) -> tuple[Expr, ...]:
    """Return every vehicle state's steady response to the probes, or to what ripples like them."""
    swings: list[Expr] = []
    for axis in range(twin.vehicle.dimension()):
        motion = motions(axis)
        assert motion is not None
        swings += (turned(e, dithers) for e in twin.vehicle.swing(axis, motion, time))
    return tuple(swings)


def _renamed(system: System, vehicle: int, still: Sequence[Expr]) -> tuple[Symbol, ...]:
    """Return the states' symbols: xtilde, vtilde_x, …; e for the washout's η."""
    names = []
    for index, x in enumerate(system.states):
        if index >= vehicle and still[index - vehicle] == 0:
            names.append(x.name)
        elif x.name == "eta" and "e" not in {str(p) for p in system.symbols}:
            names.append("e")
        else:
            letters = re.match("[a-z]+", x.name)
            assert letters is not None
            names.append(f"{letters[0]}tilde{x.name[letters.end() :]}")
    return tuple(Symbol(name, real=True) for name in names)


def _settled(rate: Expr, dithers: Sequence[Oscillator], system: System) -> Expr:
    """Return a rate with the probe and the response to it cancelled."""
    oscillating = {symbol for o in dithers for symbol in (o.sine, o.cosine)}
    numbers = {*system.symbols, *oscillating}
    pure: dict[Expr, list[Expr]] = {}
    others = []
    for term in sympy.Add.make_args(sympy.expand(rate)):
        if term.free_symbols & oscillating and term.free_symbols <= numbers:
            coefficient, wave = term.as_independent(*oscillating, as_Add=False)
            pure.setdefault(wave, []).append(coefficient)
        else:
            others.append(term)
    sums = {wave: sympy.Add(*cs) for wave, cs in pure.items()}
    left = (wave * sympy.cancel(e) for wave, e in sums.items() if not vanishes(e))
    return sympy.Add(*others, *left)


def _hessian(twin: Loop, source: Sequence[Expr]) -> sympy.ImmutableMatrix:
    """Return ∂²J/∂p² at the source, at t = 0 if it changes."""
    steps = [sympy.Dummy(real=True) for _ in source]
    law = twin.field.law([r + d for r, d in zip(source, steps, strict=True)])
    here = dict.fromkeys((*steps, time), sympy.Integer(0))
    entries = sympy.hessian(law, steps).applyfunc(lambda e: sympy.simplify(e.subs(here)))
    return sympy.ImmutableMatrix(entries)
