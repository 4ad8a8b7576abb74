"""What a reader of the evidence should know, in sentences."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
import sympy
from numpy.typing import NDArray

from ..loop import Loop
from ..printing import expression_text, symbol_text
from ..rational import at_frequency
from ..symbols import axis_names, s
from .collisions import coupling
from .demodulation import gradient
from .linear import hidden_modes, pole_text

if TYPE_CHECKING:
    from .verdict import Verdict

SLOW: Final = 0.1
"""h/ω and bandwidth/ω above which averaging is warned of."""

PULL: Final = 0.05
"""ρ = c |C(∞)| q |x̃|/ω above which averaging is warned of."""

FAR: Final = 0.2
"""Relative distance of the slowest averaged mode from the exact one that is said."""

FLAT: Final = 1e-9


def remarks(verdict: Verdict) -> tuple[str, ...]:
    """Return what should be said of a verdict, the most important first."""
    return (
        *_disagreements(verdict),
        *_shape(verdict),
        *_trust(verdict),
        *_sensing(verdict),
        *_distances(verdict),
        *_hidden(verdict),
        *_collisions(verdict),
        *(f"{note[0].upper()}{note[1:]}." for note in verdict.orbit.notes),
    )


def _word(stable: bool | None) -> str:
    return "stable" if stable else "unstable"


def _disagreements(verdict: Verdict) -> Iterator[str]:
    printed, corrected, averaged_, exact = verdict.evidence
    if printed.stable is not None and printed.stable != corrected.stable:
        yield (
            f"The paper's printed conditions say {_word(printed.stable)}, the corrected ones "
            f"{_word(corrected.stable)}: the printed formula is wrong here (docs/errata.md)."
        )
    periodic = verdict.average.frame.period() is not None
    if len(averaged_.modes) and _neutral(averaged_.modes):
        yield (
            "A mode of the averaged loop has the real part 0 to rounding: to first order it "
            "neither decays nor grows, and averaging decides nothing."
        )
    elif exact.silence and averaged_.stable and periodic:
        yield (
            "The averaged loop is stable, but at this ω no periodic orbit was found: the claim of "
            "the theorems, for all sufficiently large ω, does not reach down to it."
        )
    elif None not in (averaged_.stable, exact.stable) and averaged_.stable != exact.stable:
        yield (
            f"Averaging says {_word(averaged_.stable)} ({averaged_.rate:+.4g} 1/s), the exact "
            f"orbit {_word(exact.stable)} ({exact.rate:+.4g} 1/s): ω is too low for the average, "
            "or the loop is too near to the boundary."
        )


def _distances(verdict: Verdict) -> Iterator[str]:
    """Say where the average is far from the exact modes although the verdicts agree."""
    pairs, (_, _, averaged, exact) = verdict.modes, verdict.evidence
    if pairs is None or averaged.stable != exact.stable:
        return
    if abs(averaged.rate - exact.rate) > FAR * abs(exact.rate):
        yield (
            f"The averaged loop's slowest mode ({averaged.rate:+.4g} 1/s) is far from the exact "
            f"one ({exact.rate:+.4g} 1/s): at this ω the limit says little about how fast it is."
        )


def _neutral(modes: NDArray[np.complex128]) -> bool:
    return bool(np.abs(modes.real).min() <= FLAT * np.abs(modes).max())


def _shape(verdict: Verdict) -> Iterator[str]:
    """Say where the field is no maximum at the source."""
    hessian = verdict.average.hessian
    values, vectors = np.linalg.eigh(hessian)
    size = np.abs(values).max(initial=0.0)
    names = axis_names(len(values))
    for value, vector in zip(values, vectors.T, strict=True):
        along = ", ".join(f"{n} {x:+.3f}" for n, x in zip(names, vector, strict=True))
        if value > FLAT * size:
            yield (
                f"The source is no maximum: the field rises along ({along}), where its second "
                f"derivative is {value:+.4g}."
            )
        elif size == 0 or value > -FLAT * size:
            yield (
                f"The field is flat to second order along ({along}): nothing drives the loop "
                "there, but what is of higher order in α."
            )


def _trust(verdict: Verdict) -> Iterator[str]:
    model = verdict.average
    frequency = float(model.frame.numbers(model.frame.system.carriers).min())
    washout = gradient(model.frame.loop).washout
    if washout > SLOW * frequency:
        yield _warned(f"h/ω = {washout / frequency:.2g}", "the washout turns the dither")
    size = model.bandwidth
    if size > SLOW * frequency:
        yield _warned(
            f"the loop's fastest mode over ω = {size / frequency:.2g}", "the loop is fast"
        )
    lag = size * _delay(model.frame.loop)
    if lag > SLOW:
        yield _warned(
            f"the loop's fastest mode times the sensor's delay = {lag:.2g}",
            "what is sensed lags behind the loop",
        )
    fast = max(model.frame.turning(), default=0.0)
    if fast > SLOW * frequency:
        yield _warned(
            f"the source's path or the field turns at {fast:.3g} rad/s, {fast / frequency:.2g} ω",
            "averaging takes it for slow",
        )
    pull = _pull(verdict, frequency)
    if pull > PULL:
        yield _warned(
            f"ρ = c |C(∞)| q |x̃|/ω = {pull:.2g} at the equilibrium",
            "so far from the peak the washout couples at order 1/ω; above about 0.3 orbits vanish",
        )


def _delay(loop: Loop) -> float:
    """Return |F'(jω)/F(jω)| (s) of the sensor, the largest of all channels' frequencies."""
    law = loop.sensor.law()
    slope = law.diff(s) / law
    return max(abs(at_frequency(slope, float(w))) for w in gradient(loop).frequencies())


def _sensing(verdict: Verdict) -> Iterator[str]:
    """Say where a sensor turns the dither and the reference is not turned with it."""
    frame = verdict.average.frame
    law, controller = frame.loop.sensor.law(), gradient(frame.loop)
    turning = {o.frequency: o for o in frame.equations.oscillators}
    carriers = gradient(frame.loop.twin).frequencies()
    for i, name in enumerate(axis_names(len(carriers))):
        frequency, channel = float(controller.frequencies()[i]), controller.channels[i]
        passed = at_frequency(law, frequency)
        swing, o = sympy.expand(frame.equations.dither_limit[i]), turning[carriers[i]]
        dither = complex(*frame.numbers([swing.coeff(o.sine), swing.coeff(o.cosine)]))
        washed = math.atan(controller.washout / frequency)
        wanted = cmath.phase(dither) + cmath.phase(passed)
        given = (channel.reference or channel.dither).phase
        off = min(abs(cmath.phase(cmath.rect(1, given - wanted - lead))) for lead in (0, washed))
        if min(abs(cmath.phase(passed)), off) > SLOW:
            yield (
                f"The sensor passes {100 * abs(passed):.3g} % of the dither on {name}, turned by "
                f"{math.degrees(cmath.phase(passed)):.1f}°, which the reference is not corrected "
                f"by: ψ = φ + atan(h/ω) + arg F(jω) = {wanted + washed:.4g} rad would be."
            )


def _warned(number: str, why: str) -> str:
    return f"The averaged verdict should not be trusted by itself: {number}, {why}."


def _pull(verdict: Verdict, frequency: float) -> float:
    model = verdict.average
    offset = model.offset
    if not np.isfinite(offset).all():
        return 0.0
    channels = gradient(model.frame.loop).channels
    direct = [
        abs(float(sympy.limit(c.compensator.law(), s, sympy.oo))) * abs(c.gain) for c in channels
    ]
    return float(max(direct) * np.abs(model.hessian @ offset).max() / 2 / frequency)


def _hidden(verdict: Verdict) -> Iterator[str]:
    for axis, pole in hidden_modes(verdict.average.frame):
        kind = "unstable" if pole.real >= 0 else "stable"
        yield (
            f"On {axis} a zero of C cancels a pole of G, or the reverse, at {pole_text(pole)} 1/s: "
            f"that mode is hidden from the loop, and it is {kind}."
        )


def _separate(demodulation: NDArray[np.float64]) -> bool:
    beside = demodulation - np.diag(np.diag(demodulation))
    return bool(np.abs(beside).max() <= FLAT * np.abs(demodulation).max())


def _collisions(verdict: Verdict) -> Iterator[str]:
    model = verdict.average
    found = model.resonances
    exact = [r for r in found if r.frequency == 0]
    if exact:
        told = ", ".join(map(str, exact))
        added = coupling(model.frame.loop)
        if added:
            terms = "; ".join(
                f"d{symbol_text(x.name)}/dt gains {expression_text(e)}" for x, e in added.items()
            )
            yield f"Frequencies collide ({told}), which couples the axes at every ω: {terms}."
        elif not _separate(model.demodulation_limit):
            yield f"Frequencies collide ({told}); what that couples is in the average."
    slow = [r for r in found if r.frequency > 0]
    if slow:
        told = ", ".join(map(str, slow[:3]))
        yield (
            f"Frequencies nearly collide ({told}), within ten times the loop's fastest mode: the "
            "beat drives the loop slowly; the averaged eigenvalues leave it out."
        )
