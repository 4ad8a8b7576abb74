"""Whether a loop is one of the paper's three schemes, and what the paper says of it.

The formulas, as printed and as corrected, are in `paper_laws`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import sympy

from ..controllers import Dither, GradientES
from ..loop import Loop
from ..rational import Ratio, ratio
from ..symbols import axis_names, plain, s
from ..symbols import t as time
from ..vehicles import PointMass
from .conditions import Condition
from .frame import Frame, Relative, relative
from .paper_laws import Axis, Formulas, Prediction, corrected, formulas, printed

TITLES: Final = {
    1: "Theorem 1 (Fig. 1): every axis 1/s, C constant",
    2: "Theorem 2 (Fig. 2): every axis 1/s², C = k(s − z)/(s − p)",
    3: "Theorem 3 (Fig. 3, no compensator): every axis 1/(s − ε), C constant",
    4: "Theorem 4 (Fig. 3): every axis 1/(s − ε), C = k(s − z)/(s − p)",
}
SAME: Final = 1e-9


@dataclass(frozen=True, eq=False)
class PaperLoop:
    """A loop as one of the paper's schemes.

    Attributes
    ----------
    theorem
        1 for 1/s, 2 for 1/s² with lead, 3 and 4 for 1/(s − ε) without and with lead.
    printed, corrected
        What the formulas say.
    """

    theorem: int
    printed: Prediction
    corrected: Prediction

    @property
    def title(self) -> str:
        """Which theorem and figure it is."""
        return TITLES[self.theorem]


@dataclass(frozen=True)
class NotThePapers:
    """A loop that is none of the paper's schemes, and why in a sentence."""

    reason: str


def recognise(loop: Loop) -> PaperLoop | NotThePapers:
    """Return the loop as one of the paper's schemes, or why it is none of them.

    The schemes: every axis 1/s with C constant; every axis 1/s² with C = k(s − z)/(s − p); axes
    1/(s − ε), ε ≥ 0, with C constant or C = k(s − z)/(s − p). Each dither is demodulated in phase;
    two axes share a frequency only in quadrature; the map's Hessian at the source is diagonal, its
    entries −2q. The paper has two axes; more, which it calls trivial, count too. A constant force,
    which it says is accommodated, adds nothing to the printed offset.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start.
    """
    if not isinstance(loop.controller, GradientES) or not isinstance(loop.vehicle, PointMass):
        return NotThePapers("The paper has point masses under the gradient scheme only.")
    unlike = _unlike_dithers(loop.controller)
    if unlike:
        return NotThePapers(unlike)
    frame = relative(loop)
    scheme = _scheme(frame.equations, frame.loop.twin)
    if isinstance(scheme, str):
        return NotThePapers(scheme)
    unlike = _unlike_numbers(frame, scheme)
    if unlike:
        return NotThePapers(unlike)
    return PaperLoop(
        scheme.theorem, scheme.printed.at(frame.values), scheme.corrected.at(frame.values)
    )


def printed_conditions(loop: Loop) -> tuple[Condition, ...] | None:
    """Return the paper's conditions as printed; None for a loop that is none of its schemes."""
    known = recognise(loop)
    return known.printed.conditions if isinstance(known, PaperLoop) else None


def corrected_conditions(loop: Loop) -> tuple[Condition, ...] | None:
    """Return the corrected conditions; None for a loop that is none of the paper's schemes."""
    known = recognise(loop)
    return known.corrected.conditions if isinstance(known, PaperLoop) else None


# --- recognising ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Scheme:
    """A structure's formulas; `facts` gives its poles ε and its Hessian from the numbers."""

    theorem: int
    printed: Formulas
    corrected: Formulas
    facts: Any


@lru_cache(maxsize=256)
def _scheme(equations: Relative, twin: Loop) -> _Scheme | str:
    """Return the scheme of a structure with its formulas, or why it is none."""
    controller, vehicle = twin.controller, twin.vehicle
    assert isinstance(controller, GradientES)
    assert isinstance(vehicle, PointMass)
    channels = controller.channels
    plants = [ratio(axis.law()) for axis in vehicle.axes]
    compensators = [ratio(channel.compensator.law()) for channel in channels]
    theorem = _theorem(plants, compensators)
    if isinstance(theorem, str):
        return theorem
    if twin.sensor.law() != 1:
        return "The paper's controller receives J itself; here a sensor stands between them."
    if equations.changing:
        return "The map changes with time; the paper's moves at most."
    zero = sympy.Integer(0)
    axes = []
    for index, (plant, c, channel) in enumerate(zip(plants, compensators, channels, strict=True)):
        bent: Any = equations.hessian[index, index]
        amplitude, gain = plain(channel.dither.amplitude), plain(channel.gain)
        leads = c.order == 1
        axes.append(
            Axis(
                axis_names(len(plants))[index],
                amplitude * gain * c.numerator[0] * sympy.factor_terms(-bent / 2),
                -plant.denominator[1],
                -sympy.cancel(c.numerator[1] / c.numerator[0]) if leads else zero,
                -c.denominator[1] if leads else zero,
                equations.source[index],
                zero if vehicle.disturbance is None else plain(vehicle.disturbance[index]),
            )
        )
    washout, symbols = plain(controller.washout), equations.system.symbols
    moving = any(x.has(time) for x in equations.source)
    laws = [printed(theorem, axis, washout) for axis in axes]
    right = [corrected(theorem, axis) for axis in axes]
    facts = [[axis.pole for axis in axes], equations.hessian.tolist()]
    return _Scheme(
        theorem,
        formulas(theorem, axes, laws, washout, symbols, moving=moving),
        formulas(theorem, axes, right, washout, symbols, moving=moving),
        sympy.lambdify([list(symbols)], facts, "math", dummify=True),
    )


def _theorem(plants: Sequence[Ratio], compensators: Sequence[Ratio]) -> int | str:
    names = axis_names(len(plants))
    for name, plant in zip(names, plants, strict=True):
        first = plant.order == 1
        second = plant.order == 2 and not any(plant.denominator[1:])
        if plant.numerator != (1,) or not (first or second):
            return f"Axis {name} is {plant}; the paper's axes are 1/s, 1/s² and 1/(s − ε)."
    if len({plant.order for plant in plants}) > 1:
        return "The axes are of different kinds; the paper's are of one."
    integrators = not any(any(plant.denominator[1:]) for plant in plants)
    kinds = {(c.numerator_degree, c.order) for c in compensators}
    if kinds == {(0, 0)}:
        if plants[0].order == 1:
            return 1 if integrators else 3
        return "1/s² without a compensator is not in the paper: it needs the phase lead of Fig. 2."
    if kinds == {(1, 1)}:
        if plants[0].order == 2:
            return 2
        return "1/s with a compensator is not in the paper." if integrators else 4
    allowed = "C = k(s − z)/(s − p) in every axis, or C constant in every axis"
    shown = ", ".join(str(c) for c in compensators)
    return f"The compensators are {shown}; the paper's are {allowed}."


def _unlike_dithers(controller: GradientES) -> str | None:
    """Return where the dithers are not the paper's, as a sentence."""
    names = axis_names(len(controller.channels))
    for name, channel in zip(names, controller.channels, strict=True):
        if not isinstance(channel.dither, Dither):
            return f"Axis {name} states its probe; the paper's schemes state the motion, a dither."
        turned = (channel.reference or channel.dither).phase - channel.dither.phase
        if abs(math.remainder(turned, 2 * math.pi)) > SAME:
            return (
                f"Axis {name}'s reference is turned by {turned:.6g} rad against its dither; the "
                "paper's references are in phase."
            )
    phases = [channel.dither.phase for channel in controller.channels]
    frequencies = controller.frequencies()
    for j, name in enumerate(names):
        for i in range(j):
            apart = phases[i] - phases[j]
            if frequencies[i] == frequencies[j] and abs(math.cos(apart)) > SAME:
                return (
                    f"Axes {names[i]} and {name} share the frequency {frequencies[j]:g} rad/s "
                    f"{apart:.6g} rad apart; the paper's axes share one only in quadrature."
                )
    return None


def _unlike_numbers(frame: Frame, scheme: _Scheme) -> str | None:
    """Return what else is not the paper's, of a loop of the right form."""
    poles, rows = scheme.facts(frame.values)
    names = axis_names(len(poles))
    for axis, (name, plant) in enumerate(zip(names, frame.loop.vehicle.dynamics(), strict=True)):
        motion = frame.loop.controller.motion(axis)
        assert motion is not None
        assert plant is not None
        through, own = ratio(plant if motion.through is None else motion.through), ratio(plant)
        if through != own and (scheme.theorem < 3 or through != ratio(1 / s)):
            return (
                f"Axis {name}'s dither goes through {through}; the paper's go through the axis' "
                "own dynamics, or 1/s where those are 1/(s − ε)."
            )
    for name, pole in zip(names, poles, strict=True):
        if pole < 0:
            return f"Axis {name}'s pole {pole:g} is stable; the paper's 1/(s − ε) has ε ≥ 0."
    hessian = np.array(rows, dtype=float)
    coupled = np.abs(hessian - np.diag(np.diag(hessian)))
    if coupled.max() > SAME * np.abs(hessian).max():
        i, j = np.unravel_index(int(coupled.argmax()), coupled.shape)
        return (
            f"The map couples {names[i]} and {names[j]}: its Hessian at the source holds "
            f"{hessian[i, j]:.6g}; the paper's is diagonal."
        )
    return None
