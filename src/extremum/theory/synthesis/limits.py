"""What no controller can do, and what this one cannot: the conditions of a refusal."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ...rational import at_frequency
from ...requirements import Requirements
from ..robustness import Proof, hessian_eigenvalues
from .building import Plan
from .family import Family, Plant, felt_curvature, hessian_bounds
from .refusals import Infeasible
from .responses import frequencies, noise_bandwidth, sensitivity
from .shapes import MARGIN, WORST_PEAK, Wish, nearest

NEAR: Final = 1e-12
TURN: Final = 1.5 * math.pi
"""Largest phase ωT of a dead time that a reference is turned back by."""


def check_hessian(wanted: Requirements) -> None:
    """Refuse a range of Hessians that holds maps without a maximum."""
    if not wanted.coupling:
        return
    least, _ = hessian_eigenvalues(*hessian_bounds(wanted))
    if least <= 0:
        raise Infeasible(
            "indefinite Hessian",
            "coupling",
            f"{wanted.coupling:g} beside the curvatures {wanted.curvature} allows maps whose Q "
            f"has an eigenvalue of {least:.3g} 1/m²: J has no maximum there, and nothing to climb",
            relaxations=("coupling",),
        )


def coupled_too_much(wanted: Requirements, proof: Proof) -> Infeasible:
    """Return that the coupled loop is not proved stable."""
    return Infeasible(
        "coupling",
        "coupling",
        f"{wanted.coupling:g} is too much: each axis' loop is stable by itself, all together are "
        f"not shown to be: {proof.statement.rstrip('.')}",
        relaxations=("coupling", "curvature", "settling_time"),
    )


def check(wanted: Requirements, members: tuple[Family, ...]) -> None:
    """Refuse what no linear controller can do, whatever its structure."""
    for family in members:
        for plant in family.vertices:
            _check_plant(wanted, family, plant)
        _check_authority(family)
        if (
            family.integrators
            and abs(family.include[0][-1]) <= NEAR * np.abs(family.include[0]).max()
        ):
            raise Infeasible(
                "conflicting wishes",
                f"include.{family.axis}",
                f"has a zero at s = 0, which cancels an integrator that zero error needs on axis "
                f"{family.name}; leave it out, or set zero_bias = false",
            )
        signs = {math.copysign(1.0, p.numerator[-1]) for p in family.vertices}
        if len(signs) > 1:
            raise Infeasible(
                "sign",
                "uncertain",
                f"on axis {family.name} the sign of G's numerator at s = 0 changes within the box: "
                "what stabilises the one end pushes the other away",
                relaxations=("uncertain",),
            )


def check_heard(members: tuple[Family, ...]) -> None:
    """Refuse a box over which one probe moves the vehicle against the reference somewhere."""
    for family in members:
        if family.heard[0] <= 0:
            raise Infeasible(
                "phase",
                "uncertain",
                f"on axis {family.name} the phase of G(jω) at the dither changes by more than 90° "
                "within the box: a probe made for its middle moves the vehicle against the "
                "reference",
                relaxations=("uncertain",),
            )


def _check_plant(wanted: Requirements, family: Family, plant: Plant) -> None:
    path = f"vehicle.axes.{family.axis}"
    if abs(plant.numerator[-1]) <= NEAR * np.abs(plant.numerator).max():
        raise Infeasible(
            "zero at the origin",
            path,
            "G(s) has a zero at s = 0: no constant input holds the vehicle at a place, so it "
            "cannot stay at the source",
        )
    zeros = [z for z in plant.zeros if z.real >= 0]
    poles = [p for p in plant.poles if p.real > 0]
    for z in zeros:
        for p in poles:
            least = abs((z + p.conjugate()) / (z - p)) if abs(z - p) > NEAR else math.inf
            if least > WORST_PEAK:
                raise Infeasible(
                    "non-minimum-phase zero",
                    path,
                    f"G(s) has a zero at {_at(z)} and an unstable pole at {_at(p)}: whatever the "
                    f"controller, max |S(jω)| ≥ |z + p|/|z − p| = {least:.3g}, and at most "
                    f"{WORST_PEAK:g} is robust (Freudenberg and Looze, 1985). It would be feasible "
                    f"with the pole below {z.real / 2:.3g} 1/s",
                    relaxations=("uncertain",),
                )
    for p in poles:
        least = math.exp(min(p.real * wanted.delay, 700.0))
        if least > WORST_PEAK:
            raise Infeasible(
                "delay",
                "delay",
                f"an unstable pole at {_at(p)} on axis {family.name} under a dead time of "
                f"{wanted.delay:g} s makes max |S(jω)| ≥ e^(pT) = {least:.3g} whatever the "
                f"controller; at most {WORST_PEAK:g} is robust",
                relaxations=("delay", "uncertain"),
            )


def no_shape(wanted: Requirements, family: Family, wish: Wish) -> Infeasible:
    """Return why no compensator of the structure does it."""
    best = nearest(family, wish)
    zeros = [z.real for p in family.vertices for z in p.zeros if z.real > 0]
    ratio = family.gains[1] / family.gains[0]
    reasons = [f"on axis {family.name} no compensator of its structure ({_structure(family)})"]
    if best is None:
        reasons.append(
            f"stabilises the averaged loop for all curvatures in a range of 1 : {ratio:.3g}"
        )
    else:
        reasons.append(
            f"does all that is asked: the nearest settles in {_time(best.settling)} "
            f"({_time(MARGIN * wish.settling)} allowed) with max |S(jω)| = {best.peak:.3g} "
            f"({WORST_PEAK:g} allowed), for curvatures in a range of 1 : {ratio:.3g}"
        )
        if best.error > 1:
            reasons.append(f"and |S| = {best.error / math.sqrt(2):.3g} below the bandwidth wanted")
    condition = "phase"
    text = " ".join(reasons)
    if zeros:
        condition = "non-minimum-phase zero"
        text += (
            f". G(s) has a zero at +{min(zeros):.3g} 1/s: no loop is faster than about half of "
            "that, as its phase lag grows where its gain does not fall"
        )
    elif wanted.delay:
        text += f". The dead time of {wanted.delay:g} s takes the phase ωT"
    return Infeasible(
        condition,
        f"vehicle.axes.{family.axis}",
        text,
        relaxations=("settling_time", "bandwidth", "curvature", "uncertain", "delay"),
    )


def _structure(family: Family) -> str:
    parts = []
    if family.integrators:
        parts.append(f"{family.integrators} integrator{'s' if family.integrators > 1 else ''}")
    if family.resonances:
        parts.append(f"{len(family.resonances)} resonators")
    parts.append("up to two leads")
    return ", ".join(parts)


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if math.isfinite(seconds) else "more than twice the time"


def _at(root: complex) -> str:
    return f"{root.real:.4g}" + (f" ± {abs(root.imag):.4g}j" if root.imag else "")


def unproved(family: Family, proof: Proof) -> Infeasible:
    """Return that no shape could be proved."""
    return Infeasible(
        "proof",
        f"vehicle.axes.{family.axis}",
        f"the averaged loop settles at every vertex of the box, but not all over it: "
        f"{proof.statement.rstrip('.')}",
        relaxations=("uncertain", "curvature"),
    )


def check_frequency(plan: Plan, axis: int, base: float, begun: float, reason: str) -> None:
    """Refuse a dither faster than allowed."""
    limit, omega = plan.requirements.frequency_limit, plan.frequency(axis, base)
    if limit is None or omega <= limit:
        return
    family, shape = plan.families[axis], plan.shapes[axis]
    poles = [p.real for plant in family.vertices for p in plant.poles if p.real > 0]
    why = (
        f"the unstable pole at {max(poles):.3g} 1/s needs"
        if poles and max(poles) * 4 > shape.fastest / 4
        else "the settling time needs"
    )
    text = (
        f"on axis {family.name} {why} a loop that passes {shape.fastest:.3g} rad/s at the highest "
        f"curvature, and the dither must be faster: ω = {omega:.3g} rad/s"
    )
    if base > begun:
        text += f" (raised from {plan.frequency(axis, begun):.3g}, as {reason})"
    raise Infeasible(
        "frequency",
        "frequency_limit",
        f"{text}; allowed are {limit:.3g}",
        relaxations=("frequency_limit", "settling_time", "bandwidth", "curvature", "uncertain"),
    )


def check_delay(plan: Plan, axis: int, base: float) -> None:
    """Refuse a dead time of more than three quarters of a dither's period."""
    wanted, omega = plan.requirements, plan.frequency(axis, base)
    if omega * wanted.delay <= TURN:
        return
    raise Infeasible(
        "delay",
        "delay",
        f"on axis {plan.families[axis].name} the dither at ω = {omega:.3g} rad/s is too fast for "
        f"the dead time of {wanted.delay:g} s: the reference would turn by ωT = "
        f"{math.degrees(omega * wanted.delay):.0f}°, {math.degrees(TURN):.0f}° allowed, and an "
        f"error of 10 % in T by {math.degrees(0.1 * omega * wanted.delay):.0f}°",
        relaxations=("delay", "settling_time", "bandwidth"),
    )


def _check_authority(family: Family) -> None:
    """Refuse an input that cannot hold the vehicle, and so has no room for a probe either."""
    if family.load + family.following >= family.input:
        parts = max(abs(p.load) for p in family.vertices) * family.source
        raise Infeasible(
            "authority",
            "input_limit",
            f"on axis {family.name} holding the vehicle at the farthest source takes "
            f"|D(0)/N(0)| |x*| + |d| = {parts:.4g} + {family.force:.4g}, and "
            f"{family.following:.4g} to follow it, more than the limit {family.input:.4g}: no "
            "controller has the authority",
            relaxations=("input_limit", "source_distance", "force", "uncertain"),
        )


def noise_error(plan: Plan, axis: int, base: float) -> float:
    """Return the rms error of the mean position by sensor noise (m), the worst vertex.

    Var x̃ = n² ‖T‖₂²/(2 (α q |F|)²), n = σ√Δt; for T = g/(s + g) it is c σ² Δt/(4 α q).
    """
    family, shape, wanted = plan.families[axis], plan.shapes[axis], plan.requirements
    omega = frequencies(shape.fastest)
    passed = abs(at_frequency(wanted.sensor.law(), plan.frequency(axis, base)))
    curvature = felt_curvature(wanted, axis)
    alpha = plan.amplitude(axis, base)
    worst = 0.0
    for plant in family.vertices:
        for factor, q in zip(family.gains, curvature, strict=True):
            s = sensitivity(
                family,
                plant,
                np.array(shape.above),
                np.array(shape.below),
                np.array(shape.gain * factor),
                omega,
            )
            width = float(noise_bandwidth(1 - s, omega))
            worst = max(
                worst, wanted.noise * math.sqrt(width / 2) / (alpha * q * passed * plant.heard)
            )
    return worst


def check_noise(plan: Plan, axis: int, base: float) -> None:
    """Refuse a dither too small to be heard through the noise."""
    wanted, family = plan.requirements, plan.families[axis]
    if wanted.accuracy is None:
        return
    error, alpha = noise_error(plan, axis, base), plan.amplitude(axis, base)
    if error <= wanted.accuracy:
        return
    needed = alpha * error / wanted.accuracy
    raise Infeasible(
        "noise",
        "accuracy",
        f"on axis {family.name} noise of {wanted.noise:g} √s moves the mean by "
        f"{error:.3g} m rms at the lowest curvature {wanted.curvature[axis][0]:g}, "
        f"{wanted.accuracy:g} m allowed: n √(‖T‖₂²/2)/(α q) with α = {alpha:.3g} m. It takes "
        f"α = {needed:.3g} m",
        relaxations=("dither_limit", "accuracy", "settling_time", "bandwidth", "noise"),
    )


def pushed(plan: Plan, family: Family, peak: float, displacement: tuple[float, ...]) -> Infeasible:
    """Return that the input saturates on the way from the farthest start."""
    far = math.hypot(*displacement)
    return Infeasible(
        "input",
        "input_limit",
        f"on axis {family.name} a run of the exact loop from {far:.3g} m away needs |u| = "
        f"{peak:.3g}, the limit is {family.input:.3g}: it would saturate",
        relaxations=("input_limit", "start_distance", "dither_limit", "settling_time"),
    )


def cramped(plan: Plan, axis: int, base: float, reason: str) -> Infeasible:
    """Return that the input has no room for a dither that is large enough."""
    family, omega = plan.families[axis], plan.frequency(axis, base)
    return Infeasible(
        "input",
        "input_limit",
        f"on axis {family.name} the input, {family.input:.3g} with {family.load:.3g} to hold the "
        f"vehicle, has room for a dither of α = {plan.amplitude(axis, base):.3g} m at "
        f"ω = {omega:.3g} rad/s, and that is too small: {reason}",
        relaxations=("input_limit", "settling_time", "start_distance", "source_distance", "force"),
    )


def never(plan: Plan, begun: float, base: float, reason: str) -> Infeasible:
    """Return that no ω is high enough."""
    return Infeasible(
        "exact loop",
        "requirements",
        f"ω was raised from {begun:.3g} to {base:.3g} rad/s, and still {reason}",
        relaxations=("start_distance", "settling_time", "dither_limit", "curvature"),
    )
