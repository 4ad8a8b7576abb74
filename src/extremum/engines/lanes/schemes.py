"""Ways to take one step: Taylor's method with its own step size, and Runge–Kutta methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Final

from sympy import Expr, Symbol

from .program import Ground, Stepped
from .reading import Plain
from .series import Powers, Scaled, Series, SeriesReading
from .tape import UNIFORM, Tape
from .watch import Watch

LOOKS: Final = 8
"""Looks within a Taylor step for maxima and crossings, besides its beginning."""


@dataclass(frozen=True)
class Taylor:
    """Taylor's method, x(t + wH) = Σ x_k w^k, k = 0 … p.

    Every loop has a step of its own: w = (tol/E)^(1/p), E = max (|x_p| + |x_{p−1}|/4)/(1 + |x|)
    over the states, so that the last term kept is about `tol`. Source of the step control: Jorba
    and Zou, Experimental Mathematics 14 (2005), section 3.

    Attributes
    ----------
    order
        p.
    """

    order: int
    paced: bool = True

    @property
    def name(self) -> str:
        """What it is called."""
        return f"Taylor, order {self.order}"

    def steps(self, ground: Ground, watch: Watch) -> Stepped:
        """Record one step."""
        tape, system = ground.tape, ground.system
        powers: dict[Expr, Powers] = {}

        def waves(frequency: Expr) -> Powers:
            if frequency not in powers:
                powers[frequency] = Powers(tape, *ground.oscillator(frequency))
            return powers[frequency]

        bound: dict[Symbol, Series] = {}
        rates: list[Series] = []
        for index, symbol in enumerate(system.states):
            bound[symbol] = Series(lambda k, i=index: _coefficient(ground, rates, i, k))
        zero, instant = tape.constant(0.0), (ground.time, ground.unit)
        bound[system.time] = Series(lambda k: instant[k] if k < 2 else zero)
        reading = SeriesReading(ground.constants, bound, waves)
        for symbol, expression in system.signals:
            reading.bind(symbol, expression)
        rates.extend(reading.read(rate) for rate in system.rhs)
        states = [bound[symbol] for symbol in system.states]
        for k in range(self.order + 1):
            for series in states:
                series[k]
        return Stepped(
            states=tuple(self._value(tape, series, ground.part) for series in states),
            part=self._part(tape, states),
            means=tuple(self._integral(tape, reading.read(e), ground.part) for e in watch.mean),
            last=tuple(self._last(ground, reading.read(e)) for e in watch.last_mean),
            maxima=tuple(self._largest(ground, reading.read(e)) for e in watch.maxima),
            beyond=tuple(self._beyond(ground, reading.read(e)) for e in watch.beyond),
        )

    def _value(self, tape: Tape, series: Series, theta: int) -> int:
        """Return Σ x_k θ^k by Horner's rule."""
        result = series[self.order]
        for k in range(self.order - 1, -1, -1):
            result = tape.add(tape.multiply(result, theta), series[k])
        return result

    def _part(self, tape: Tape, states: Sequence[Series]) -> int:
        """Return w from logarithms to base 2, which need not be accurate."""
        one = tape.constant(1.0)
        errors = [self._error(tape, series) for series in states]
        largest = reduce(lambda a, b: tape.call("maximum", a, b), errors)
        spare = tape.subtract(tape.call("logarithm", tape.leaf("tol", 0, UNIFORM), one), largest)
        return tape.call("power of two", tape.multiply(spare, tape.constant(1 / self.order)))

    def _error(self, tape: Tape, series: Series) -> int:
        last, before = (tape.call("absolute", series[k]) for k in (self.order, self.order - 1))
        estimate = tape.add(last, tape.multiply(tape.constant(0.25), before))
        size = tape.add(tape.constant(1.0), tape.call("absolute", series[0]))
        return tape.call("logarithm", estimate, size)

    def _integral(self, tape: Tape, series: Series, theta: int) -> int:
        """Return ∫ Σ x_k θ^k dθ from 0."""
        shares = Series(lambda k: tape.multiply(tape.constant(1 / (k + 1)), series[k]))
        return tape.multiply(theta, self._value(tape, shares, theta))

    def _last(self, ground: Ground, series: Series) -> int:
        tape, part = ground.tape, ground.part
        begin = tape.call("maximum", ground.left(), tape.constant(0.0))
        begin = tape.call("minimum", begin, part)
        whole, before = (self._integral(tape, series, theta) for theta in (part, begin))
        inside = tape.subtract(part, begin)  # 0 before the window: no rounding of what is fused
        return tape.call("positive", inside, tape.subtract(whole, before), tape.constant(0.0))

    def _looks(self, ground: Ground, series: Series) -> list[tuple[int, int]]:
        """Return equispaced places in the step and the values there."""
        tape = ground.tape
        fractions = (tape.constant(look / LOOKS) for look in range(LOOKS + 1))
        places = [tape.multiply(fraction, ground.part) for fraction in fractions]
        return [(theta, self._value(tape, series, theta)) for theta in places]

    def _largest(self, ground: Ground, series: Series) -> int:
        """Return the largest of the looks and of the value near the top about the largest one."""
        tape, looks = ground.tape, self._looks(ground, series)
        gap = tape.multiply(tape.constant(1 / LOOKS), ground.part)
        values = [value for _, value in looks]
        tops = [
            tape.add(looks[i][0], tape.multiply(gap, _top(tape, *values[i - 1 : i + 2])))
            for i in range(1, LOOKS)
        ]
        largest, place = values[0], tops[0]
        for value, top in zip(values[1:], [*tops, tops[-1]], strict=True):
            place = tape.call("positive", tape.subtract(value, largest), top, place)
            largest = tape.call("maximum", value, largest)
        return tape.call("maximum", largest, self._value(tape, series, place))

    def _beyond(self, ground: Ground, series: Series) -> int:
        """Return the last look at which e > 0, or where it crosses 0 before the next."""
        tape, looks = ground.tape, self._looks(ground, series)
        result = tape.constant(-1.0)
        for (theta, value), (after, then) in pairwise(looks):
            share = tape.divide(value, tape.subtract(value, then))
            crossing = tape.add(theta, tape.multiply(tape.subtract(after, theta), share))
            inside = tape.call("positive", then, after, crossing)
            result = tape.call("positive", value, inside, result)
        return tape.call("positive", looks[-1][1], looks[-1][0], result)


def _top(tape: Tape, before: int, value: int, after: int) -> int:
    """Return where the parabola through three equispaced values has its top, 0 if not among them.

    As a share of the gap, from the middle.
    """
    slope = tape.multiply(tape.constant(0.5), tape.subtract(after, before))
    bend = tape.subtract(tape.add(value, value), tape.add(before, after))
    steep = tape.subtract(bend, tape.call("absolute", slope))
    return tape.call("positive", steep, tape.divide(slope, bend), tape.constant(0.0))


def _coefficient(ground: Ground, rates: Sequence[Series], index: int, k: int) -> int:
    """Return x_k of a state: H/k ẋ_{k−1}."""
    if k == 0:
        return tuple(ground.states.values())[index]
    tape, rate, unit = ground.tape, rates[index], ground.unit
    if isinstance(rate, Scaled):
        rate, unit = rate.base, tape.product([unit, rate.scale])
    return tape.multiply(tape.multiply(unit, tape.constant(1 / k)), rate[k - 1])


@dataclass(frozen=True)
class RungeKutta:
    """An explicit Runge–Kutta method, k_i = f(x + H Σ_j a_ij k_j), x + H Σ_i b_i k_i.

    What is watched is looked at at both ends of every step; means take the weights b_i too.

    Attributes
    ----------
    name
        What it is called.
    a
        The lower triangle, row by row, the first row empty.
    b
        The weights.
    order
        The error is about H^order.
    """

    name: str
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    order: int
    paced: bool = False

    def steps(self, ground: Ground, watch: Watch) -> Stepped:
        """Record one step of length H."""
        tape, begun = ground.tape, tuple(ground.states.values())
        stages: list[Plain] = []
        rates: list[list[int]] = []
        for row in self.a:
            reading = ground.at(_moved(ground, begun, rates, row), tape.constant(sum(row)))
            stages.append(reading)
            rates.append([reading.read(rate) for rate in ground.system.rhs])

        def averaged(expression: Expr) -> int:
            seen = [stage.read(expression) for stage in stages]
            weights = [tape.constant(b) for b in self.b]
            return tape.convolution(zip(weights, seen, strict=True))

        states = _moved(ground, begun, rates, self.b)
        first, last = stages[0], ground.at(states, tape.constant(1.0))
        share = inside(ground)
        return Stepped(
            states=tuple(states),
            part=None,
            means=tuple(averaged(e) for e in watch.mean),
            last=tuple(tape.multiply(share, averaged(e)) for e in watch.last_mean),
            maxima=tuple(larger(first, last, e) for e in watch.maxima),
            beyond=tuple(crossed(first, last, e) for e in watch.beyond),
        )


def inside(ground: Ground) -> int:
    """Return the part of a step of length H that lies in the last window."""
    tape = ground.tape
    return tape.subtract(tape.constant(1.0), tape.call("unit", ground.left()))


def larger(first: Plain, last: Plain, expression: Expr) -> int:
    """Return the larger of the values at a step's ends."""
    return first.tape.call("maximum", first.read(expression), last.read(expression))


def crossed(first: Plain, last: Plain, expression: Expr) -> int:
    """Return the last of a step's ends, 0 and 1, at which the value is positive, −1 if none."""
    tape = first.tape
    zero, one, none = (tape.constant(number) for number in (0.0, 1.0, -1.0))
    before = tape.call("positive", first.read(expression), zero, none)
    return tape.call("positive", last.read(expression), one, before)


def _moved(
    ground: Ground,
    begun: Sequence[int],
    rates: Sequence[Sequence[int]],
    weights: Sequence[float],
) -> list[int]:
    """Return x + H Σ_i w_i k_i."""
    tape = ground.tape
    used = [
        (tape.multiply(tape.constant(weight), ground.unit), k)
        for weight, k in zip(weights, rates, strict=True)
        if weight
    ]
    return [
        reduce(lambda x, term, i=i: tape.add(x, tape.multiply(term[0], term[1][i])), used, state)
        for i, state in enumerate(begun)
    ]


RK4: Final = RungeKutta(
    "RK4", ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), 4
)
"""Kutta's method of order 4 (1901)."""
