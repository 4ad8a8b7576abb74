"""The rules of a finished design, collected: what was chosen, what bounds it, and who decided."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ...requirements import Periodic, Ramp
from .confirmation import reach
from .family import BY_INPUT, PACE, WASHOUT, Family, Plant, poles_at_origin
from .limits import noise_error
from .polynomials import at
from .rules import Rule, at_least, at_most, chosen
from .shapes import CHARGING, MARGIN, PEAK, WORST_PEAK, Shape

if TYPE_CHECKING:
    from .report import Design

ROUNDING: Final = 1e-9


def rules_of(design: Design) -> tuple[Rule, ...]:
    """Return every rule of a design."""
    found: list[Rule] = []
    for axis in range(len(design.plan.families)):
        found += _axis_rules(design, axis)
    return (*found, *_whole(design))


def _axis_rules(design: Design, axis: int) -> Iterator[Rule]:
    plan, wanted = design.plan, design.requirements
    family, shape, name = plan.families[axis], plan.shapes[axis], plan.families[axis].name
    yield from _structure(design, family, shape)
    channel: Any = design.controller.channels[axis]
    base, omega = design.frequency, plan.frequency(axis, design.frequency)
    low, high = (abs(shape.gain) * factor for factor in family.gains)
    yield chosen(
        f"loop gain {name}",
        "L(s) = g C(s) G(s), g = α c q m |F|",
        abs(shape.gain),
        "",
        "settling_time" if wanted.bandwidth is None else "bandwidth",
        f"from {low:.4g} to {high:.4g} over the curvature's range",
    )
    if wanted.settling_time is not None:
        yield at_most(
            f"settling {name}",
            "averaged loop, to 1.6 % of a displacement, worst vertex",
            shape.settling,
            "s",
            MARGIN * wanted.settling_time,
            "settling_time",
        )
        if family.load and family.integrators:
            yield at_most(
                f"charging {name}",
                "the same with empty integrators, source and force at their farthest",
                shape.charging,
                "s",
                MARGIN * CHARGING * wanted.settling_time,
                "settling_time",
            )
    if wanted.bandwidth is not None:
        yield at_most(
            f"tracking {name}",
            f"|S(jω)| below {wanted.bandwidth:g} rad/s, worst vertex",
            shape.error / math.sqrt(2),
            "",
            math.sqrt(0.5),
            "bandwidth",
        )
    yield at_most(
        f"sensitivity {name}",
        "max |S(jω)| = 1/(distance of L from −1), worst vertex",
        shape.peak,
        "",
        PEAK if shape.peak <= PEAK else WORST_PEAK,
        "curvature",
        _margins(shape.peak),
    )
    amplitude = channel.dither.amplitude
    by_input = amplitude * family.swing < BY_INPUT * family.dither
    yield at_most(
        f"dither {name}",
        "|position − mean| = α |G/G₀|, the largest over the box",
        amplitude * family.swing,
        "m",
        family.dither,
        "input_limit" if by_input else "dither_limit",
    )
    probe = amplitude / float(family.passed(omega))
    yield at_most(
        f"authority {name}",
        "|D(0)/N(0)| |x*| + |d| + what follows the source + α/|G₀(jω)|",
        family.load + family.following + probe,
        design.loop.vehicle.input_units()[axis],
        family.input,
        "input_limit" if by_input else "dither_limit",
        f"{family.load:.4g} to hold the vehicle, {family.following:.4g} to follow the source, "
        f"{probe:.4g} for the probe",
    )
    turned = cmath.phase(plan.response(axis, base))
    yield chosen(
        f"reference {name}",
        "ψ = φ + arg[jω/(jω + h) F(jω) e^(−jωT)]",
        math.degrees(channel.reference.phase),
        "°",
        ", ".join(
            ["washout", *["sensor"] * (wanted.sensor.law() != 1), *["delay"] * (wanted.delay > 0)]
        ),
        f"{math.degrees(turned):.4g}° beyond the dither's "
        f"{math.degrees(channel.dither.phase):.4g}°; the plant's phase is compensated by the "
        "probe, which goes through 1/G₀(jω)",
    )
    if wanted.noise:
        limit = math.inf if wanted.accuracy is None else wanted.accuracy
        yield at_most(
            f"noise {name}",
            "rms of x̃ = n √(‖T‖₂²/2)/(α q |F|), worst vertex",
            noise_error(plan, axis, base),
            "m",
            limit,
            "accuracy" if wanted.accuracy is not None else "noise",
        )


def _structure(design: Design, family: Family, shape: Shape) -> Iterator[Rule]:
    wanted, name = design.requirements, family.name
    poles = poles_at_origin(family.vertices)
    causes = []
    if isinstance(wanted.motion, Ramp) and poles < 1 + wanted.zero_bias:
        causes.append("motion")
    if family.force and wanted.zero_bias:
        causes.append("force")
    if not poles and wanted.zero_bias:
        causes.append("zero_bias: G has no pole at 0")
    yield at_least(
        f"integrators {name}",
        "C(s) has as many poles at 0 as zero error needs",
        poles_at_origin((Plant(np.array(shape.above), np.array(shape.below)),)),
        "",
        family.integrators,
        ", ".join(causes) if family.integrators else "not needed",
        f"G(s) has {poles} pole{'' if poles == 1 else 's'} at 0",
    )
    if isinstance(wanted.motion, Periodic):
        listed = ", ".join(f"{f:.4g}" for f in family.resonances)
        yield at_least(
            f"resonators {name}",
            "C(jΩ) = ∞ at the source's frequencies: S(jΩ) = 0",
            sum(_infinite(shape, omega) for omega in family.resonances),
            "",
            len(family.resonances),
            "motion",
            f"at {listed} rad/s",
        )
    yield chosen(
        f"leads {name}",
        "as few as settle in time at every vertex, with max |S| ≤ 2 or a third of the noise",
        shape.leads,
        "",
        "phase" if shape.leads else "gain suffices",
    )
    bias = family.load and not family.integrators
    if bias:
        low = shape.gain * family.gains[0] * shape.above[-1] / shape.below[-1]
        worst = max(abs(family.load / (low * p.heard + p.load)) for p in family.vertices)
        yield chosen(
            f"bias {name}",
            "|x̃| ≤ U/|D(0)/N(0) + g C(0)|, U = |D(0)/N(0)| |x*| + |d|",
            worst,
            "m",
            "zero_bias = false",
        )


def _margins(peak: float) -> str:
    """Return the margins that max |S| guarantees; the true ones are larger."""
    up = f"{peak / (peak - 1):.3g}" if peak > 1.001 else "any factor"
    phase = math.degrees(2 * math.asin(min(0.5 / peak, 1.0)))
    return (
        f"so that gains from {peak / (peak + 1):.3g} to {up} times as large and {phase:.3g}° of "
        "phase are safe, at least"
    )


def _infinite(shape: Shape, omega: float) -> bool:
    """Return whether C has a pole at jω."""
    size = np.abs(np.array(shape.below)) @ omega ** np.arange(len(shape.below) - 1.0, -1.0, -1.0)
    return abs(complex(at(shape.below, 1j * omega))) <= ROUNDING * float(size)


def _whole(design: Design) -> Iterator[Rule]:
    plan, wanted = design.plan, design.requirements
    limit = math.inf if wanted.frequency_limit is None else wanted.frequency_limit
    frequencies = design.controller.frequencies()
    passed = max(s.fastest / float(r) for s, r in zip(plan.shapes, plan.ratios, strict=True))
    yield at_most(
        "fastest dither",
        "ω_i ≤ ω_max",
        max(frequencies),
        "rad/s",
        limit,
        "bandwidth of the loop" if design.frequency == design.begun else "the exact loop",
        "" if design.frequency == design.begun else f"ω was raised from {design.begun:g} rad/s",
    )
    yield at_least(
        "separation",
        f"ω_i ≥ {PACE:g} × what the closed loop passes",
        design.frequency / passed,
        "",
        PACE,
        "averaging",
    )
    yield chosen(
        "washout",
        f"h = {WASHOUT:g} ω: fast, as the reference takes its phase back",
        design.controller.washout,
        "rad/s",
        "frequency",
    )
    yield at_least(
        "decay, averaged",
        "every root of 1 + L(s) has Re λ < −σ all over the box: proved",
        design.decay,
        "1/s",
        0.0,
        design.proofs[0].method,
    )
    seen = design.confirmations
    yield at_most(
        "exponents, exact",
        f"max Re λ of the periodic orbit, {len(seen)} points of the box",
        max(c.exponent for c in seen),
        "1/s",
        0.0,
        "Floquet",
    )
    if wanted.settling_time is not None:
        for name, times, allowed in (
            ("settling, exact", [c.settling for c in seen], 1.0),
            ("charging, exact", [c.charging for c in seen], CHARGING),
        ):
            yield at_most(
                name,
                f"Mᵏ δ, M the monodromy matrix, {len(seen)} points of the box",
                max(times),
                "s",
                allowed * wanted.settling_time,
                "settling_time",
            )
    yield chosen(
        "offset, exact",
        "|mean of x̃| on the orbit, worst point",
        max(c.offset for c in seen),
        "m",
        "zero_bias" if wanted.zero_bias else "zero_bias = false",
    )
    far = max(wanted.start_distance, reach(design.loop))
    yield at_most(
        "arrival, exact",
        f"|mean of x̃| after twice the settling time, from {far:.3g} m away",
        max(run.distance for run in design.arrivals),
        "m",
        far / 10,
        "start_distance" if wanted.start_distance else "reach",
    )
    for family in plan.families:
        yield at_most(
            f"input {family.name}, exact",
            "max |u| on these runs",
            max(run.input[family.axis] for run in design.arrivals),
            design.loop.vehicle.input_units()[family.axis],
            family.input,
            "input_limit" if math.isfinite(family.input) else "start_distance",
        )
