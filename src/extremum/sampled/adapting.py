"""What changes while the controller runs: gains and amplitudes, the dither's size, the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import sympy
from sympy import Expr, Symbol

from ..declarations import is_none
from ..description import Description, value
from ..errors import InvalidDescription
from ..logic import absolute, clamped, minimum, positive
from ..symbols import plain
from .diagram import SampledDiagram
from .validity import LONG

SEEKING, ARRIVED, LOST = 0, 1, 2
"""What `status` is."""

LARGEST: Final = 1e6
"""Of the factors that `Changes` takes."""


class Changes(Description):
    """Gains and amplitudes that can be changed while the controller runs, without a jump.

    Factors κ of all gains and a of all amplitudes go over to the wanted ones as first-order lags,
    κ⁺ = κ + (1 − e^(−dt/T)) (κ* − κ): `DiscreteController.change` sets κ* and a*, at most 10⁶. The
    loop gain is proportional to κ a (to κ/a with a `RunningScale`). A change is slow, and the
    averaged loop passes through the designs in between, if T is longer than the loop's own time.

    Parameters
    ----------
    time
        T (s), longer than a dither period: the output then changes by less in a sample than by the
        dither itself.
    """

    time: float = value("T_c", "s", "time constant of a change", positive=True)

    def check_frequency(self, period: float) -> None:
        """Refuse a time within a dither period (s)."""
        _longer_than_a_period("time", self.time, period)

    def draw(self, diagram: SampledDiagram, name: str) -> Symbol:
        """Draw the wanted factor, and what is left to go to it; return the factor.

        What is left decays, so that nothing is lost in single precision, as it is where a lag adds
        ever smaller steps to a number. A change adds to it what it adds to the wanted factor.
        """
        wanted = diagram.state(f"{name}_wanted", "1", 1)
        left: Any = diagram.state(f"{name}_left", "1", 0)
        diagram.follow(left, left - diagram.share(plain(self.time)) * left)
        return diagram.signal(name, wanted - left, "1")


class ShrinkingDither(Description):
    """A dither that shrinks near the source and grows when the source moves away.

    A factor a of all amplitudes follows the slope: with S = √Σ A_i²/(a κ_a), A_i the amplitude of ξ
    at channel i's frequency (see `response`) and κ_a that of `Changes` and of a ramp, so that S is
    what the full dither would cause, a* = S/`full` cut to `least` … 1 and

    a⁺ = a + (1 − e^(−dt/T)) (a* − a), T = `grow` where a* > a, else `shrink`.

    Missing samples change nothing. The loop gain is a times its own: the averaged loop must be
    stable for every factor from `least` to 1 (an unstable vehicle needs its smallest gain). With
    C = 1 and G = 1/s noise leaves the variance c σ² dt/(4 a α q) of the position.

    What the proof needs besides: a ≥ least > 0, so that the loop is excited always; a changes
    slowly in comparison with the dither, |ȧ|/a ≪ ω (all three times must be longer than a period,
    refused otherwise), and so that averaging first and letting a change second is right, more
    slowly than the averaged loop converges: `shrink` longer than 1/|λ| of its slowest mode at
    `least`. `check_shrinking` looks at a loop. Source: Tan, Nešić, Mareels and Astolfi, Automatica
    45 (2009), 245-251 (amplitude decreasing slowly).

    Parameters
    ----------
    full
        S at and above which the dither has its full size (unit of J).
    least
        Smallest factor, in 0 … 1.
    shrink, grow
        Time constants (s).
    response
        Time constant (s) with which A_i is measured.
    """

    full: float = value("S_1", "1", "response with the full dither", positive=True)
    least: float = value("a_0", "1", "smallest factor of the dither", positive=True)
    shrink: float = value("T_shrink", "s", "time constant of shrinking", positive=True)
    grow: float = value("T_grow", "s", "time constant of growing", positive=True)
    response: float = value("T_A", "s", "time constant of the response", positive=True)

    def check(self) -> None:
        """Refuse a factor beyond 1."""
        if self.least >= 1:
            raise InvalidDescription("least", "must be less than 1", repr(self.least))

    def check_frequency(self, period: float) -> None:
        """Refuse times within a dither period (s)."""
        for name in ("shrink", "grow", "response"):
            _longer_than_a_period(name, getattr(self, name), period)

    def factor(self, diagram: SampledDiagram) -> Symbol:
        """Draw a, still without what it follows."""
        return diagram.state("a_dither", "1", 1)

    def draw(self, diagram: SampledDiagram, factor: Symbol, response: Expr, good: Expr) -> None:
        """Let a follow the response of the full dither where the sample counts."""
        wanted: Any = clamped(response / plain(self.full), plain(self.least), 1)
        goal = diagram.signal("a_goal", wanted, "1")
        grow, shrink = (diagram.share(plain(time)) for time in (self.grow, self.shrink))
        share = positive(good, positive(goal - factor, grow, shrink), 0)
        diagram.follow(factor, factor + share * (goal - factor))


class Detector(Description):
    """Whether the vehicle has arrived, is lost, or still seeks.

    With A = √Σ A_i², A_i = 2 |mean of ξ · reference_i| over `response`, the amplitude of ξ at
    channel i's frequency with the full dither, about α_i |∂J/∂x_i|: *arrived* when A has stayed
    below `level` for `time`, counted from three `response` after the beginning; only good samples
    count. *Lost* when no good sample came for the `timeout` of `Validity`, or when the mean
    of the signal, η = J − ξ, is below `background`. Otherwise *seeking*. It observes only: the
    loop's stability is not touched.

    At the distance x̃ from a peak of curvature q, A = 2 α q |x̃|: level = 2 α q r detects a radius
    r. Noise of standard deviation σ per sample puts σ √(dt/response) into each A_i; `level` must
    be well above.

    Parameters
    ----------
    level
        A (unit of J).
    time
        How long (s).
    response
        Time constant (s) with which A_i is measured: some periods.
    background
        Mean signal (unit of J) below which there is nothing to follow; None for no such limit.
    """

    level: float = value("A_0", "1", "response at the source", positive=True)
    time: float = value("T_a", "s", "time of calm", positive=True)
    response: float = value("T_A", "s", "time constant of the response", positive=True)
    background: float | None = value(
        "J_b", "1", "smallest mean signal", default=None, literal=is_none
    )

    def check_frequency(self, period: float) -> None:
        """Refuse a response within a dither period (s)."""
        _longer_than_a_period("response", self.response, period)

    def draw(
        self,
        diagram: SampledDiagram,
        response: Expr,
        mean: Expr,
        good: Expr,
        patience: Expr | None,
    ) -> None:
        """Draw the verdict."""
        calm = diagram.state("calm", "1", -3 * plain(self.response) / diagram.dt)
        longer = minimum(calm + 1, LONG)
        seen = positive(plain(self.level) - response, longer, minimum(calm + 1, 0))
        still = diagram.signal("still", positive(good, seen, calm), "1")
        diagram.follow(calm, still)
        limit = plain(self.time) / diagram.dt - sympy.Rational(1, 2)
        verdict: Any = positive(still - limit, ARRIVED, SEEKING)
        if self.background is not None:
            verdict = positive(plain(self.background) - mean, LOST, verdict)
        if patience is not None:
            verdict = positive(patience, verdict, LOST)
        status = diagram.state("status", "1", SEEKING)
        diagram.follow(status, verdict)


def _longer_than_a_period(name: str, time: float, period: float) -> None:
    if time <= period:
        raise InvalidDescription(
            name,
            f"must be longer than the slowest dither's period, {period:.4g} s, so that it follows "
            "means and not the dither",
            repr(time),
        )


def responses(
    diagram: SampledDiagram,
    name: str,
    xi: Expr,
    references: Sequence[Expr],
    time: Expr,
    good: Expr,
) -> Expr:
    """Draw √Σ A_i², A_i = 2 |mean of ξ · reference_i|, a lag of T that good samples move."""
    means: list[Any] = []
    for i, reference in enumerate(references, 1):
        past = diagram.state(f"{name}_{i}", "1", 0)
        share = positive(good, diagram.share(time), 0)
        mean = diagram.signal(f"mean_{name}_{i}", past + share * (xi * reference - past), "1")
        diagram.follow(past, mean)
        means.append(mean)
    size = absolute(*means) if len(means) == 1 else sympy.sqrt(sum(mean**2 for mean in means))
    return diagram.signal(name, 2 * size, "1")
