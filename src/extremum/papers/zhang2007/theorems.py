"""Theorems 1 to 4 as statements that can be run: hypothesis, orbits, and the orders they claim.

Each theorem says that for every ω beyond some ω̄ there is a unique exponentially stable periodic
solution within O(1/ω) of the averaged equilibrium, and that lim sup |f − f*| = O(α² + 1/ω²), with
ε² added for unstable poles. Here the orbits are found on the exact equations over a decade of each
small number, and the orders fitted as slopes in log–log scale (`orders`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidDescription, shown
from ...loop import Loop
from ...lti import Lead
from ...theory.conditions import Condition
from ...theory.orbits import periodic_orbit
from ...theory.printed import PaperLoop, recognise
from .orders import Fit, Measured, measured
from .schemes import CURVATURES, Dithers, double_integrators, single_integrators, unstable_poles

Vector = NDArray[np.float64]

POINTS: Final = 6
"""Orbits in each decade."""


@dataclass(frozen=True, eq=False)
class Counterexample:
    """A loop that meets the printed hypothesis and whose orbits are unstable.

    Attributes
    ----------
    loop
        At the first frequency.
    frequencies
        ω (rad/s), (points,).
    printed, corrected
        The largest real part that the printed and the corrected formulas predict (1/s).
    measured
        The largest real part of the Floquet exponents at each frequency (1/s), (points,).
    """

    loop: Loop
    frequencies: Vector
    printed: float
    corrected: float
    measured: Vector


@dataclass(frozen=True, eq=False)
class Theorem:
    """A theorem, run.

    Attributes
    ----------
    number
        1 to 4.
    claim
        What it states.
    loop
        The loop at the lowest ω.
    printed, corrected
        The hypothesis' conditions with their numbers, as printed and as corrected.
    frequencies, exponents
        The decade of ω (rad/s) and the largest real part of the exponents at each (1/s).
    fits
        The orders.
    counterexample
        A loop for which the theorem as printed is false; None where none is known.
    """

    number: int
    claim: str
    loop: Loop
    printed: tuple[Condition, ...]
    corrected: tuple[Condition, ...]
    frequencies: Vector
    exponents: Vector
    fits: tuple[Fit, ...]
    counterexample: Counterexample | None

    @property
    def stable(self) -> bool:
        """Whether an exponentially stable orbit was found at every ω of the decade."""
        return bool((self.exponents < 0).all())

    def text(self) -> str:
        """Return hypothesis, orbits, orders and counterexample, one line each."""
        lines = [f"Theorem {self.number}: {self.claim}"]
        for name, conditions in (("printed", self.printed), ("corrected", self.corrected)):
            held = sum(condition.holds for condition in conditions)
            lines.append(f"  {name} conditions: {held} of {len(conditions)} hold")
        low, high = self.frequencies[[0, -1]]
        lines.append(
            f"  ω = {low:g} … {high:g} rad/s: orbits found at {len(self.exponents)} frequencies, "
            f"largest exponent {self.exponents.max():.4g} 1/s"
        )
        lines += [f"  {fit.quantity}: {fit.verdict}" for fit in self.fits]
        if self.counterexample is not None:
            c = self.counterexample
            lines.append(
                f"  as printed it is false: a loop that meets the printed conditions (largest real "
                f"part {c.printed:.4f}) has the exponents' {c.measured[-1]:+.4f} at "
                f"ω = {c.frequencies[-1]:g} rad/s; corrected {c.corrected:+.4f}"
            )
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.text()


def theorem(number: int) -> Theorem:
    """Run a theorem of the paper, 1 to 4.

    Raises
    ------
    InvalidDescription
        For another number.
    """
    if number not in _FAMILIES:
        raise InvalidDescription("number", "must be 1, 2, 3 or 4", shown(number))
    return _run(number)


# --- the loops --------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Family:
    """A theorem's loops: `build` takes ω, α, ε and the dithers.

    Attributes
    ----------
    frequencies
        The lowest ω of the decade; the highest is ten times that.
    fast
        ω where the other numbers are swept, so that 1/ω does not show.
    amplitude, pole
        α and ε otherwise.
    amplitudes, poles
        The lower ends of their decades.
    """

    claim: str
    build: Callable[[float, float, float, Dithers], Loop]
    frequencies: float
    fast: float
    amplitude: float
    amplitudes: float
    pole: float = 0.0
    poles: float = 0.0


_LEAD: Final = Lead(gain=5, zero=-2, pole=-10)
_COMPENSATOR: Final = Lead(gain=2, zero=-3, pole=-2)

_FAMILIES: Final = {
    1: _Family(
        "1/s, C constant: a stable orbit within O(1/ω) of 0; lim sup |f − f*| = O(α² + 1/ω²)",
        lambda w, a, _, d: single_integrators(w, a, 10.0, dithers=d),
        frequencies=30.0,
        fast=100.0,
        amplitude=0.08,
        amplitudes=0.02,
    ),
    2: _Family(
        "1/s² with lead: a stable orbit within O(1/ω) of 0; lim sup |f − f*| = O(α² + 1/ω²)",
        lambda w, a, _, d: double_integrators(w, a, 10.0, _LEAD, dithers=d),
        frequencies=30.0,
        fast=100.0,
        amplitude=0.1,
        amplitudes=0.02,
    ),
    3: _Family(
        "1/(s − ε), C constant: a stable orbit within O(1/ω) of x̃ᵉ = εx*/(αcq − ε); "
        "lim sup |f − f*| = O(α² + 1/ω² + ε²)",
        lambda w, a, e, d: unstable_poles(w, a, 0.5 / a, e, source=(1.0, -1.0), dithers=d),
        frequencies=100.0,
        fast=4000.0,
        amplitude=0.05,
        amplitudes=0.005,
        pole=0.05,
        poles=0.0001,
    ),
    4: _Family(
        "1/(s − ε) with lead: a stable orbit within O(1/ω) of the averaged equilibrium; "
        "lim sup |f − f*| = O(α² + 1/ω² + ε²)",
        lambda w, a, e, d: unstable_poles(
            w, a, 1.0 / a, e, _COMPENSATOR, source=(0.2, -0.2), dithers=d
        ),
        frequencies=100.0,
        fast=4000.0,
        amplitude=0.1,
        amplitudes=0.005,
        pole=0.5,
        poles=0.005,
    ),
}


# --- the orders -------------------------------------------------------------------------------


def _decade(low: float) -> Vector:
    return np.geomspace(low, 10 * low, POINTS)


@cache
def _run(number: int) -> Theorem:
    family = _FAMILIES[number]
    frequencies = _decade(family.frequencies)

    def loop(frequency: float, dithers: Dithers) -> Loop:
        return family.build(frequency, family.amplitude, family.pole, dithers)

    fits: list[Fit] = []
    pair: list[Measured] = []
    for dithers in ("quadrature", "separate"):
        found = [measured(loop(w, dithers)) for w in frequencies.tolist()]
        pair = pair or found
        fits += _in_frequency(number, dithers, frequencies, found)
    fits += _in_the_others(number, family)
    return Theorem(
        number,
        family.claim,
        pair[0].orbit.frame.loop,
        pair[0].known.printed.conditions,
        pair[0].known.corrected.conditions,
        frequencies,
        np.array([m.orbit.exponents[0].real for m in pair]),
        tuple(fits),
        _counterexample(number),
    )


_RIPPLE: Final = "two integrators divide the ripple at ω by ω²"
_PRODUCT: Final = (
    "the product 2qα x̃ ~ α/ω is bounded by α² + 1/ω², but above α² it falls only as itself"
)
_SHIFT: Final = (
    "away from the peak the orbit is shifted by O(1/ω), and 2q(α + |x̃ᵉ|) times that is of first "
    "order"
)
_DIRECT: Final = (
    "w holds the compensator's direct term k c ξ sin ωt, whose ripple does not shrink; what "
    "averaging bounds is the state of its strictly proper part"
)
_MISPRINT: Final = "(54) is not the equilibrium; with the corrected one the order is 1"
_BIAS: Final = "the product 2qα|x̃ᵉ| is bounded by α² + ε², but above the {0} it falls only as {1}"
_BOUNDS: Final = {1: "(15)", 2: "(41)", 3: "(43)", 4: "(65)"}
_RESIDUALS: Final = {1: "(16)", 2: "(16)", 3: "Theorem 3", 4: "Theorem 4"}
_RESIDUAL: Final = "lim sup |f − f*|"


def _in_frequency(
    number: int, dithers: Dithers, frequencies: Vector, found: Sequence[Measured]
) -> list[Fit]:
    """Return the orders in 1/ω."""
    small, bound = 1 / frequencies, _BOUNDS[number]

    def near(quantity: str, sizes: Sequence[float], remark: str = "") -> Fit:
        return Fit(quantity, "1/ω", dithers, bound, 1, small, np.array(sizes), remark)

    fits = [
        near("|x̃ − x̃ᵉ|", [m.distance for m in found], _RIPPLE),
        near("|e − eᵉ|", [m.level for m in found]),
    ]
    if number == 4:
        fits.append(near("|w − wᵉ|", [m.output for m in found], _DIRECT))
        fits.append(near("|x̃ − x̃ᵉ|, x̃ᵉ of (54)", [m.misprinted for m in found], _MISPRINT))
    excess = np.abs([m.residual - m.limit for m in found])
    remark = _PRODUCT if number < 3 else _SHIFT
    claim, name = _RESIDUALS[number], f"{_RESIDUAL} from its limit"
    return [*fits, Fit(name, "1/ω", dithers, claim, 2, small, excess, remark, joint=True)]


def _in_the_others(number: int, family: _Family) -> list[Fit]:
    """Return the orders in α, in ε, and in all small numbers together, in quadrature."""
    fast, amplitude, pole = family.fast, family.amplitude, family.pole

    def at(frequency: float, size: float, rate: float) -> Measured:
        return measured(family.build(frequency, size, rate, "quadrature"))

    def fit(quantity: str, small: str, x: Vector, y: Vector, remark: str = "") -> Fit:
        claim = _RESIDUALS[number]
        return Fit(quantity, small, "quadrature", claim, 2, x, y, remark, joint=small != "all")

    amplitudes = _decade(family.amplitudes)
    found = [at(fast, a, pole) for a in amplitudes.tolist()]
    bias = np.array([m.known.corrected.offset**2 @ np.array(CURVATURES) for m in found])
    above = np.array([m.residual for m in found]) - bias
    name = _RESIDUAL if number < 3 else f"{_RESIDUAL} above q(x̃ᵉ)²"
    fits = [fit(name, "α", amplitudes, above, _BIAS.format("bias", "α"))]
    if number > 2:
        poles = _decade(family.poles)
        least = at(fast, amplitude, 0.0).residual
        excess = np.array([at(fast, amplitude, e).residual - least for e in poles.tolist()])
        remark = _BIAS.format("dither's share", "ε")
        fits.append(fit(f"{_RESIDUAL} above that of ε = 0", "ε", poles, excess, remark))
    scales = _decade(0.1)
    sizes = [at(fast / (10 * k), k * amplitude, k * pole / 10).residual for k in scales.tolist()]
    return [*fits, fit(_RESIDUAL, "all", scales, np.array(sizes))]


def _counterexample(number: int) -> Counterexample | None:
    """Return a loop that meets the printed conditions (32) to (40), or (60) to (64), unstably."""
    lead = Lead(gain=5, zero=-2, pole=-1.5)
    slack = Lead(gain=1, zero=-0.2, pole=-1)
    builds: dict[int, Callable[[float], Loop]] = {
        2: lambda w: double_integrators(w, 0.1, 10.0, lead),
        4: lambda w: unstable_poles(w, 0.1, 20.0, 0.5, slack, washout=0.1),
    }
    if number not in builds:
        return None
    frequencies = np.array([30.0, 100.0, 400.0])
    loops = [builds[number](w) for w in frequencies.tolist()]
    known = recognise(loops[0])
    assert isinstance(known, PaperLoop)
    measured = np.array([periodic_orbit(loop).exponents[0].real for loop in loops])
    return Counterexample(loops[0], frequencies, known.printed.rate, known.corrected.rate, measured)
