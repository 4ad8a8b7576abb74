"""Sensors as they are: slow, late, noisy, limited, coarse, and sometimes silent.

What a sample y_k is made of, in this order: the field's J at the sensor → lag → delay → (the loop's
F(s)) → noise → range → steps of quantisation → dropout. What is left out costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import sympy
from sympy import Expr, Symbol

from ..declarations import is_none
from ..description import Description, part, value
from ..errors import InvalidDescription
from ..logic import maximum, minimum, nearest, normal, positive, uniform
from .delays import Late, line
from .diagram import SampledDiagram

WHITE, COLOURED, DROPOUT = (sympy.Integer(i) for i in range(3))
"""The streams of random numbers."""


class Lag(Description):
    """A first-order lag that may rise and decay differently: ż = (J − z)/τ.

    τ is `rise` where J > z and `decay` elsewhere. Over a sample J is taken for linear in time (a
    first-order hold), and ż is solved exactly for that, the moment at which z meets J included. It
    has settled on J(0) at t = 0.

    Metal-oxide gas sensors are such lags: `TGS2620`, `TGS2600` and `TGS2611`. One with
    τ = 2.96 s passes 1.1 per cent of a dither of 30 rad/s, turned by −89.4°. Source of the numbers:
    Monroy et al., GADEN: A 3D Gas Dispersion Simulator (2017).

    Parameters
    ----------
    rise
        τ where J > z (s).
    decay
        τ elsewhere (s); None for the same.
    """

    rise: float = value("tau_rise", "s", "τ where the signal rises", positive=True)
    decay: float | None = value(
        "tau_decay",
        "s",
        "τ where it decays; none for the same",
        default=None,
        positive=True,
        literal=is_none,
    )

    def follow(
        self, diagram: SampledDiagram, name: str, z: Expr, begin: Expr, end: Expr, time: Expr
    ) -> Symbol:
        """Draw z after `time`, in which J goes from `begin` to `end` in a straight line.

        e = J − z obeys ė = r − e/τ, r the slope of J: e(s) = r τ + (e₀ − r τ) e^(−s/τ). It changes
        its sign at most once, where e^(s/τ) = 1 − e₀/(r τ).
        """
        before = diagram.signal(f"e_{name}", begin - z, "1")
        slope = diagram.signal(f"r_{name}", (end - begin) / time, "1/s")
        if self.decay is None:
            after = _relaxed(before, slope, self.rise, time)
            return diagram.signal(name, end - after, "1")

        def chosen(rising: Any, falling: Any) -> Any:
            still = positive(slope, rising, falling)
            return positive(before, rising, positive(-before, falling, still))

        first, second = (
            diagram.signal(f"tau{i}_{name}", chosen(*pair), "s")
            for i, pair in enumerate([(self.rise, self.decay), (self.decay, self.rise)], 1)
        )
        left, right = (_relaxed(before, slope, tau, time) for tau in (self.rise, self.decay))
        uncrossed = diagram.signal(f"e1_{name}", chosen(left, right), "1")
        crossed = -before * uncrossed
        part = positive(crossed, before, 0) / positive(crossed, slope * first, 1)
        grown = sympy.exp((first * sympy.log(1 - part) - time) / second)
        after = positive(crossed, slope * second * (1 - grown), uncrossed)
        return diagram.signal(name, end - after, "1")


def _relaxed(before: Any, slope: Any, tau: Any, time: Any) -> Any:
    """Return r τ (1 − e^(−T/τ)) + e₀ e^(−T/τ)."""
    kept = sympy.exp(-time / tau)
    return slope * tau * (1 - kept) + before * kept


TGS2620: Final = Lag(2.96, 15.71)
"""Organic vapours: how the sensor's resistance rises and decays (s)."""

TGS2600: Final = Lag(4.8, 18.75)
"""Air contaminants."""

TGS2611: Final = Lag(3.44, 6.35)
"""Methane."""


GAS_SENSORS: Final = {"TGS2620": TGS2620, "TGS2600": TGS2600, "TGS2611": TGS2611}


def as_lag(given: Any) -> Any:
    """Return a `Lag` for its time constant, or the name of a gas sensor."""
    if given is None or isinstance(given, Description):
        return given
    if isinstance(given, str) and given in GAS_SENSORS:
        return GAS_SENSORS[given]
    return Lag(given)  # pyright: ignore[reportArgumentType] - which refuses what is no number


class ColouredNoise(Description):
    """Noise that remembers: standard deviation σ, correlation σ² e^(−|t|/T) (AR(1)).

    n_{k+1} = a n_k + σ √(1 − a²) ν_k, a = e^(−dt/T), ν white with variance 1: exactly the
    Ornstein and Uhlenbeck process at the samples, stationary from the first one on.

    Parameters
    ----------
    deviation
        σ (unit of J).
    time
        T (s).
    """

    deviation: float = value("sigma_n", "1", "σ, standard deviation")
    time: float = value("T_n", "s", "T, correlation time", positive=True)

    def check(self) -> None:
        """Refuse a negative standard deviation."""
        _at_least_zero(self, "deviation")

    def draw(self, diagram: SampledDiagram, seed: Expr) -> Symbol:
        """Draw n; its first sample has all its variance, those after it what a sample adds."""
        kept = sympy.exp(-diagram.dt / self.time)
        before = diagram.state("n_before", "1", 0)
        size = diagram.state("n_size", "1", self.deviation)
        noise = diagram.signal("n", kept * before + size * normal(seed, COLOURED), "1")
        diagram.follow(before, noise)
        diagram.follow(size, self.deviation * sympy.sqrt(1 - kept**2))
        return noise


class Sensor(Description):
    """What stands between the field's J and the sample that the controller receives.

    Everything is optional. Order: field → `lag` → `delay` → F(s) of the loop → `noise` and
    `coloured` → `low`, `high` → `step` → `dropout`.

    Parameters
    ----------
    lag
        A `Lag`, its time constant (s), or the name of a gas sensor, such as ``"TGS2620"``.
    delay
        T ≥ 0 (s), any real number: the controller receives what left the lag at t_k − T, exactly,
        J(0) before t = T.
    noise
        σ of white noise, a new number each sample.
    coloured
        `ColouredNoise`.
    low, high
        Range: what lies outside is cut off.
    step
        Δ of quantisation: the nearest multiple of it, ties to the even one.
    dropout
        Probability with which a sample is lost; the controller then receives NaN.
    """

    lag: Lag | None = part(
        Lag, "a Lag, or its time constant (s)", default=None, converter=as_lag, literal=is_none
    )
    delay: float | None = value("T_s", "s", "T, the sensor's delay", default=None, literal=is_none)
    noise: float | None = value(
        "sigma", "1", "σ of white noise per sample", default=None, literal=is_none
    )
    coloured: ColouredNoise | None = part(
        ColouredNoise, "noise with a correlation time", default=None, literal=is_none
    )
    low: float | None = value("J_low", "1", "the lowest value", default=None, literal=is_none)
    high: float | None = value("J_high", "1", "the highest value", default=None, literal=is_none)
    step: float | None = value(
        "Delta", "1", "Δ of quantisation", default=None, positive=True, literal=is_none
    )
    dropout: float | None = value(
        "p_lost", "1", "probability of losing a sample", default=None, literal=is_none
    )

    def check(self) -> None:
        """Refuse what no sensor is."""
        _at_least_zero(self, "delay")
        _at_least_zero(self, "noise")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise InvalidDescription(
                "low",
                f"must be less than high = {self.high!r}, or nothing gets through",
                repr(self.low),
            )
        if self.dropout is not None and not 0 <= self.dropout <= 1:
            raise InvalidDescription(
                "dropout", "is a probability: it must lie between 0 and 1", repr(self.dropout)
            )

    def disturbed(self, diagram: SampledDiagram, signal: Expr, seed: Expr) -> Expr:
        """Draw noise, range, quantisation and dropout; return the sample."""
        found = signal
        if self.noise is not None:
            found = found + self.noise * normal(seed, WHITE)
        if self.coloured is not None:
            found = found + self.coloured.draw(diagram, seed)
        if self.high is not None:
            found = minimum(found, self.high)
        if self.low is not None:
            found = maximum(found, self.low)
        if self.step is not None:
            found = self.step * nearest(found / self.step)
        if self.dropout is not None:
            found = positive(self.dropout - uniform(seed, DROPOUT), sympy.nan, found)
        return found  # pyright: ignore[reportReturnType]


@dataclass
class Sensing:
    """A sensor as it is drawn: its samples first, what it remembers once the vehicle's motion is.

    Parameters
    ----------
    diagram
        Where it is drawn.
    sensor
        The sensor.
    late
        Its delay, if it has one.
    """

    diagram: SampledDiagram
    sensor: Sensor
    late: Late | None

    def delayed(self, signal: Symbol) -> Expr:
        """Draw lag and delay of J, settled on J(0); return what leaves them at t_k."""
        diagram, lag = self.diagram, self.sensor.lag
        self.signal = self.lagged = signal
        if lag is not None:
            last = diagram.state("J_before", "1", signal)
            z = diagram.state("J_lag_before", "1", signal)
            self.lagged = lag.follow(diagram, "J_lag", z, last, signal, diagram.dt)
            diagram.follow(last, signal)
            diagram.follow(z, self.lagged)
        if self.late is None:
            return self.lagged
        self.line = line(diagram, "J_ago", "1", signal, self.late.longest + 1)
        return self.late.entry(diagram, "J_late", "1", self.line)

    @property
    def ahead(self) -> Expr | None:
        """The time after t_k at which J enters the delay line, None without one.

        It is dt − f, f what the delay has beyond whole samples: an entry of the line is then what
        left the lag at t_k − T.
        """
        return None if self.late is None else self.diagram.dt - self.late.rest

    def remember(self, signal: Expr) -> None:
        """Let J at the time `ahead` enter the delay line."""
        entering = self.diagram.signal("J_ahead", signal, "1")
        if self.sensor.lag is not None:
            assert self.ahead is not None
            entering = self.sensor.lag.follow(
                self.diagram, "J_lag_ahead", self.lagged, self.signal, entering, self.ahead
            )
        self.diagram.follow(self.line[0], entering)


def _at_least_zero(owner: Description, name: str) -> None:
    number = getattr(owner, name)
    if number is not None and number < 0:
        raise InvalidDescription(name, "must not be negative", repr(number))
