"""Limits of what is sent to the actuators, and what they do to the compensators."""

from __future__ import annotations

from typing import Any

from sympy import Expr

from ..declarations import is_none
from ..description import Description, value
from ..errors import InvalidDescription, shown
from ..logic import clamped, maximum, minimum
from ..symbols import plain
from .diagram import SampledDiagram


class Limits(Description):
    """Saturation and rate limit of every input, with anti-windup.

    v = u cut to v₋ ± R dt, then to low … high, v₋ the last v. The compensators, in observer form
    x⁺ = A x + B m, x₁ + D m = u − probe, follow what was sent: x⁺ = A x + B m + L (v − u), with L
    such that all eigenvalues of A − L C are e^(−dt/T), T = `tracking`. So the states forget within
    T what the actuator could not do. They also do so while `Validity` fades the output, with or
    without limits. Source: Åström and Wittenmark, Computer-Controlled Systems (1997), section 9.4
    (observer form of anti-windup).

    While no limit is reached, nothing changes. While one is, the loop is open for what goes beyond
    it: an unstable vehicle escapes if its input would have to be larger. Limits must leave room for
    the probe, or a warning says so: one that is cut at a share r of its amplitude keeps only
    (2/π)(asin r + r √(1 − r²)) of it, and its peaks, which are tracked every period, turn an
    integrator in C(s) into a slow leak.

    Parameters
    ----------
    low, high
        Bounds, one per input (unit of the input); None for no such bound.
    rate
        R, the largest change per second, one per input; None for no such bound.
    tracking
        T (s); None: 1/ω of the input's channel.
    """

    low: tuple[float, ...] | None = value(
        "u_low", "{input}", "smallest input", default=None, shape="vector", literal=is_none
    )
    high: tuple[float, ...] | None = value(
        "u_high", "{input}", "largest input", default=None, shape="vector", literal=is_none
    )
    rate: tuple[float, ...] | None = value(
        "R",
        "{input}/s",
        "largest change per second",
        default=None,
        shape="vector",
        positive=True,
        literal=is_none,
    )
    tracking: float | None = value(
        "T_t", "s", "tracking time of the anti-windup", default=None, positive=True, literal=is_none
    )

    def check(self) -> None:
        """Refuse bounds that leave nothing, and vectors of different lengths."""
        given = [v for v in (self.low, self.high, self.rate) if v is not None]
        if not given:
            raise InvalidDescription("", "limits nothing; give low, high or rate, or leave it out")
        if len({len(v) for v in given}) > 1:
            raise InvalidDescription("", "low, high and rate must have one number per input each")
        if self.low is not None and self.high is not None:
            for i, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
                if low >= high:
                    raise InvalidDescription(
                        f"low.{i}", f"must be less than high.{i} = {high!r}", repr(low)
                    )

    def check_inputs(self, inputs: int) -> None:
        """Refuse vectors that do not fit the controller."""
        for name in ("low", "high", "rate"):
            given = getattr(self, name)
            if given is not None and len(given) != inputs:
                raise InvalidDescription(
                    name,
                    f"has {len(given)} entries for {inputs} inputs; give one per input",
                    shown(given),
                )

    def admits(self, index: int, number: float) -> bool:
        """Return whether a number is within an input's bounds."""
        above = self.low is None or self.low[index] <= number
        return above and (self.high is None or number <= self.high[index])

    def room(self, index: int, frequency: float) -> list[tuple[str, float]]:
        """Return the amplitudes of a sine about 0 that each limit leaves to an input."""
        found = [] if self.low is None else [("low", -self.low[index])]
        found += [] if self.high is None else [("high", self.high[index])]
        return found + ([] if self.rate is None else [("rate", self.rate[index] / frequency)])

    def draw(
        self,
        diagram: SampledDiagram,
        name: str,
        unit: str,
        index: int,
        wanted: Expr,
        begin: Expr,
    ) -> Expr:
        """Draw the limits of one input; return what is sent.

        `begin` is what was sent before the first sample.
        """
        sent: Any = wanted
        if self.rate is not None:
            last = diagram.state(f"{name}_last", unit, begin)
            step = plain(self.rate[index]) * diagram.dt
            sent = clamped(sent, last - step, last + step)
        sent = self._bounded(sent, index)
        limited = diagram.signal(f"{name}_limited", sent, unit)
        if self.rate is not None:
            diagram.follow(last, limited)  # pyright: ignore[reportPossiblyUnboundVariable]
        return limited

    def _bounded(self, sent: Any, index: int) -> Any:
        if self.high is not None:
            sent = minimum(sent, plain(self.high[index]))
        return sent if self.low is None else maximum(sent, plain(self.low[index]))
