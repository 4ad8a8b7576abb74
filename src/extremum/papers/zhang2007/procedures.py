"""The paper's two design procedures, followed for given bounds, printed beside corrected.

Letters: K = α c k, so that g = K q; q ≥ q_low is the curvature of the unknown map, ε ≤ ε_high the
unstable pole. The steps are the same in x and y. What is right follows from the corrected
conditions and is proved for every q and ε within the bounds in `procedure_proofs`. It is about the
averaged loop: it holds for every ω that is large enough, the larger the farther the source of a
biased loop is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InvalidDescription, shown
from ...loop import Loop
from ...lti import Lead, Rational, transfer
from ...validation import number, positive
from .procedure_steps import Pair, Procedure, Step

__all__ = [
    "DoubleIntegrators",
    "Procedure",
    "Step",
    "UnstablePoles",
    "for_double_integrators",
    "for_unstable_poles",
]

# --- unstable poles ---------------------------------------------------------------------------


@dataclass(frozen=True)
class UnstablePoles(Procedure):
    """The procedure after (64), for axes 1/(s − ε); made by `for_unstable_poles`.

    Attributes
    ----------
    pole_high
        ε_high (1/s): 0 ≤ ε ≤ ε_high.
    """

    rules = "printed"

    pole_high: float

    @property
    def title(self) -> str:
        """What it is for, and the bounds."""
        return (
            f"1/(s − ε), the procedure after (64): q ≥ q_low = {self.q_low:g}, ε ≤ ε_high = "
            f"{self.pole_high:g}"
        )

    @property
    def least(self) -> float:
        """ε_high/(2 q_low), which K must exceed."""
        return self.pole_high / (2 * self.q_low)

    @property
    def steps(self) -> tuple[Step, ...]:
        """Every step with its numbers."""
        strong, z, h = self.strength > self.least, self.lead.zero, self.washout
        gain, place = "K > ε_high/(2 q_low)", "p = −K q_low"
        limits = f"z = {z:g}, −h = {-h:g}, −ε_high = {-self.pole_high:g}"
        return (
            Step("(1)", "α > 0, h > 0", "the same", "", True, True),
            Step("(2)", gain, "the same", f"{self.strength:g} > {self.least:g}", strong, strong),
            Step("(3)", place, "the same", f"p = {self.lead.pole:g}", True, True),
            Step("(3)", "z < −h", "z < −ε_high", limits, z < -h, z < -self.pole_high),
        )

    @property
    def stable(self) -> bool:
        """Whether the averaged loop is stable for every q and ε within the bounds."""
        return self.as_corrected

    def bias(self, q: float, pole: float) -> float:
        """Return x̃ᵉ/x* = pε/(gz − pε), corrected (54), where the averaged loop is stable."""
        push = self.lead.pole * pole
        return push / (self.strength * q * self.lead.zero - push)

    def rate(self, q: float, pole: float) -> float:
        """Return the largest real part of λ² + (g − ε − p)λ + pε − gz, g = K q (1/s)."""
        g, p = self.strength * q, self.lead.pole
        return _rightmost([1.0, g - pole - p, p * pole - g * self.lead.zero])

    @property
    def findings(self) -> tuple[str, ...]:
        """Where these numbers are safe and where not, and where the printed rule is: sentences."""
        q, high, z, h = self.q_low, self.pole_high, self.lead.zero, self.washout
        found = []
        if self.strength <= self.least:
            found.append(
                f"Unstable where ε ≥ K (q + q_low): at q_low from ε = {2 * self.strength * q:g} on."
            )
        if z >= 0:
            found.append("Unstable for every ε > 0: pε − gz > 0 needs z < 0.")
        elif z >= -high:
            found.append(
                f"Unstable where |z| ≤ ε q_low/q: at q_low from ε = {-z:g} on, at ε_high up to "
                f"q = {-q * high / z:g}."
            )
        if self.stable:
            found.append(
                "Stable for every q ≥ q_low and ε ≤ ε_high. At q_low and ε_high: slowest root "
                f"{self.rate(q, high):.4g} 1/s, bias {self.bias(q, high):.4g} x*."
            )
        if h < high:
            found.append(
                f"z < −h as printed is not safe: h < ε_high, and from z = {-high:g} up to "
                f"{-h:g} the loop is unstable at q_low and ε_high."
            )
        else:
            forbids = f", and forbids z from {-h:g} to {-high:g}, which is safe" * (h > high)
            found.append(f"z < −h as printed is safe here, since h ≥ ε_high{forbids}.")
        return tuple(found)

    def loop(
        self,
        frequency: float,
        *,
        q: Pair | None = None,
        pole: float | None = None,
        source: Pair = (0.0, 0.0),
        start: Pair = (0.0, 0.0),
    ) -> Loop:
        """Return the loop of Fig. 3 with these numbers, started on the dither.

        Parameters
        ----------
        frequency
            ω (rad/s).
        q, pole
            The true curvatures, and ε (1/s) of both axes; None for the worst, q_low and ε_high.
        source, start
            Where the map has its maximum, and the position at t = 0 (m).
        """
        rate = self.pole_high if pole is None else pole
        plant = Rational("1/(s - epsilon)", parameters={"epsilon": rate})
        return self.started(plant, frequency, q, source, start, through=transfer("1/s"))


def for_unstable_poles(
    q_low: float,
    pole_high: float,
    *,
    amplitude: float = 0.1,
    washout: float = 1.0,
    gain: float | None = None,
    k: float = 1.0,
    zero: float | None = None,
) -> UnstablePoles:
    """Follow the printed procedure for axes 1/(s − ε), q ≥ q_low, 0 ≤ ε ≤ ε_high.

    ====  =======================  ===============  ============================================
    step  printed                  corrected        because for every q and ε within the bounds
    ====  =======================  ===============  ============================================
    (1)   α > 0 small, h > 0       the same
    (2)   α c k > ε_high/(2q_low)  the same         g − ε − p > 0
    (3)   p = −α c k q_low         the same
    (3)   z < −h                   z < −ε_high      pε − gz > 0, that is |z| > ε q_low/q
    ====  =======================  ===============  ============================================

    So (2) is right and sharp; the printed (3) is safe if and only if h ≥ ε_high. Choices that a
    rule forbids are followed all the same, and reported.

    Parameters
    ----------
    q_low, pole_high
        The bounds: the least curvature, and ε_high (1/s).
    amplitude, washout, k
        α (m), h (1/s) and the compensator's gain.
    gain
        c; None for α c k q_low = 3 ε_high, six times the least of step (2).
    zero
        z (1/s); None for −5 ε_high, which leaves at most a quarter of the source's distance as
        bias, ε_high/(|z| − ε_high), and with the default c a damping ratio above 0.7.

    Raises
    ------
    InvalidDescription
        Where a bound, α, h, c or k is not a positive number, or z no finite number.

    Source: Zhang, Siranosian and Krstić (2007), after (64).
    """
    q, high = positive("q_low", q_low), positive("pole_high", pole_high)
    a, h, k = positive("amplitude", amplitude), positive("washout", washout), positive("k", k)
    c = 3 * high / (a * k * q) if gain is None else positive("gain", gain)
    z = -5 * high if zero is None else _real("zero", zero)
    return UnstablePoles(q, a, h, c, Lead(k, z, -a * c * k * q), high)


# --- double integrators -----------------------------------------------------------------------


@dataclass(frozen=True)
class DoubleIntegrators(Procedure):
    """The procedure for axes 1/s², derived; made by `for_double_integrators`.

    Attributes
    ----------
    decay
        σ (1/s): every root of the averaged loop is to have Re λ < −σ.
    """

    rules = "from (32)–(40)"

    decay: float

    @property
    def title(self) -> str:
        """What it is for, and the bounds."""
        return (
            f"1/s², a derived procedure, the printed one being lost: q ≥ q_low = "
            f"{self.q_low:g}, decay σ = {self.decay:g}"
        )

    @property
    def least(self) -> float:
        """2σ(z − m)²/(q_low m), m = z − 2σ − p, which K must exceed; infinite where m ≤ 0."""
        return _least(self.q_low, self.decay, self.lead.zero, self.lead.pole)

    @property
    def steps(self) -> tuple[Step, ...]:
        """Every step with its numbers."""
        z, p, h, decay = self.lead.zero, self.lead.pole, self.washout, self.decay
        limit, need = z - 2 * decay, "K > 2σ(z − m)²/(q_low m)"
        zero = f"z = {z:g}, −h = {-h:g}, −σ = {-decay:g}"
        pole = f"p = {p:g}, z + h = {z + h:g}, z − 2σ = {limit:g}"
        gain = f"{self.strength:g} > {self.least:g}" if p < limit else "no K suffices"
        allowed = p < min(z + h, 0)
        return (
            Step("(1)", "α > 0, h > 0", "the same, σ > 0", "", True, True),
            Step("(2)", "z < −h", "z ≤ −σ", zero, z < -h, z <= -decay),
            Step("(3)", "p < z + h, p < 0", "p = z − 2σ − m, m > 0", pole, allowed, p < limit),
            Step("(4)", "K > 0", need, gain, True, self.strength > self.least),
        )

    @property
    def stable(self) -> bool:
        """Whether the averaged loop is stable for every q > 0: p < z < 0."""
        return self.lead.pole < self.lead.zero < 0

    def rate(self, q: float) -> float:
        """Return the largest real part of λ³ − pλ² + gλ − gz, g = K q (1/s)."""
        g, z, p = self.strength * q, self.lead.zero, self.lead.pole
        return _rightmost([1.0, -p, g, -g * z])

    @property
    def findings(self) -> tuple[str, ...]:
        """Where these numbers are safe and where not, and where the printed rule is: sentences."""
        h, z = self.washout, self.lead.zero
        found = [
            "Stable for every q > 0: p < z < 0. At q_low the slowest root is "
            f"{self.rate(self.q_low):.4g} 1/s."
            if self.stable
            else "Not stable for any q: p < z < 0 is needed, a phase lead."
        ]
        if self.as_corrected:
            found.append("Every root has Re λ < −σ for every q ≥ q_low.")
        if z < -h:
            found.append(
                f"p < z + h, from the conditions as printed, is not safe: from p = {z:g} up to "
                f"{z + h:g} the loop is unstable for every q."
            )
        elif self.stable:
            found.append("z < −h, from the conditions as printed, forbids this safe z.")
        return tuple(found)

    def loop(
        self,
        frequency: float,
        *,
        q: Pair | None = None,
        source: Pair = (0.0, 0.0),
        start: Pair = (0.0, 0.0),
    ) -> Loop:
        """Return the loop of Fig. 2 with these numbers, started on the dither.

        Parameters
        ----------
        frequency
            ω (rad/s).
        q
            The true curvatures; None for q_low.
        source, start
            Where the map has its maximum, and the position at t = 0 (m).
        """
        return self.started(transfer("1/s**2"), frequency, q, source, start)


def for_double_integrators(
    q_low: float,
    decay: float,
    *,
    amplitude: float = 0.1,
    washout: float = 1.0,
    gain: float | None = None,
    k: float = 1.0,
    zero: float | None = None,
    pole: float | None = None,
) -> DoubleIntegrators:
    """Follow a procedure for axes 1/s², q ≥ q_low, in which every root decays as e^(−σt).

    The paper's own is lost but for its first words, without their Greek: "One possible design to
    satisfy those inequalities (32)–(40) … is …, h, c_x, c_y, k_x, k_y, > 0 and z_x, z_y". Both
    columns are **derived**, the left one from the conditions as printed, the right one from the
    corrected ones:

    ====  =====================  ====================================
    step  (32)–(40) as printed   corrected
    ====  =====================  ====================================
    (1)   α > 0 small, h > 0     the same, and the decay, σ > 0
    (2)   z < −h                 z ≤ −σ
    (3)   p < z + h, p < 0       p = z − 2σ − m, m > 0
    (4)   c, k > 0               α c k > 2σ(z − m)²/(q_low m)
    ====  =====================  ====================================

    For stability alone, σ → 0, p < z < 0 suffices and q_low does not enter; the decay needs it.
    Choices that a rule forbids are followed all the same, and reported.

    Parameters
    ----------
    q_low
        The least curvature.
    decay
        σ (1/s).
    amplitude, washout, k
        α (m), h (1/s) and the compensator's gain.
    zero
        z (1/s); None for −2σ.
    pole
        p (1/s); None for 2(z − σ), m = |z|, with which the least α c k is 8σ|z|/q_low, smaller than
        with any other.
    gain
        c; None for twice the least of step (4).

    Raises
    ------
    InvalidDescription
        Where q_low, σ, α, h, c or k is not a positive number, z or p no finite number, or no gain
        is given with a p for which none reaches σ.
    """
    q, sigma = positive("q_low", q_low), positive("decay", decay)
    a, h, k = positive("amplitude", amplitude), positive("washout", washout), positive("k", k)
    z = -2 * sigma if zero is None else _real("zero", zero)
    p = 2 * (z - sigma) if pole is None else _real("pole", pole)
    if gain is None and p >= z - 2 * sigma:
        raise InvalidDescription(
            "pole",
            f"leaves no gain with which every root decays as e^(−σt); p < z − 2σ = "
            f"{z - 2 * sigma:g} does. Or give the gain too, to see what becomes of it",
            shown(p),
        )
    c = 2 * _least(q, sigma, z, p) / (a * k) if gain is None else positive("gain", gain)
    return DoubleIntegrators(q, a, h, c, Lead(k, z, p), sigma)


def _least(q: float, decay: float, zero: float, pole: float) -> float:
    m = zero - 2 * decay - pole
    return 2 * decay * (zero - m) ** 2 / (q * m) if m > 0 else math.inf


def _rightmost(polynomial: Sequence[float]) -> float:
    return float(np.roots(polynomial).real.max())


def _real(name: str, given: Any) -> float:
    try:
        return number(given)
    except InvalidDescription as error:
        raise error.within(name) from None
