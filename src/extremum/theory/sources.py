"""Where the source is, for theory: stated by the field, or found uphill from the start."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy.core.function import AppliedUndef

from ..controllers import GradientES
from ..errors import InvalidDescription
from ..fields import Field, Moving, Quadratic
from ..loop import Loop
from ..rational import at_frequency
from ..symbols import axis_names, coordinates
from ..symbols import t as time

Vector = NDArray[np.float64]
LEVELS: Final = 5
SIMPLE: Final = 100
"""Denominator up to which a float ratio of frequencies is taken for the fraction it is."""

NEWTON: Final = 60
"""Steps: a quartic maximum is met by a factor 2/3 at each."""

FAR: Final = 1e8
"""Dither sizes beyond which a climb is not believed."""

SMALL: Final = 1e-6
"""Slope at a maximum, as a part of how much J changes over the dither's size."""


@dataclass(frozen=True)
class Located:
    """A loop that theory can take: its field symbolic, its probe steady, its source known.

    Attributes
    ----------
    loop
        The loop without a probe ramp, and with a field known by its values only replaced by the
        local quadratic at its maximum.
    found
        The source's coordinates (m) where the field states none; None where it does.
    notes
        What was replaced or found, in sentences.
    """

    loop: Loop
    found: tuple[float, ...] | None
    notes: tuple[str, ...]


def located(loop: Loop) -> Located:
    """Return the loop made ready for theory.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start.
    """
    notes: list[str] = []
    if getattr(loop.controller, "probe_ramp", None) is not None:
        loop = loop.replace({"controller.probe_ramp": None})
        notes.append("the probe's ramp is over: theory is about the steady probe")
    loop = _with_fractions(loop)
    if loop.system.oracles:
        field, note = _local_quadratic(loop)
        return Located(loop.replace({"field": field}), None, (*notes, note))
    if "source" in loop.system.outputs:
        return Located(loop, None, tuple(notes))
    names = coordinates(loop.vehicle.dimension())
    law = loop.field.law(names)
    gradient = sympy.lambdify([names], [law.diff(x).subs(time, 0) for x in names], "math")
    curved = sympy.lambdify([names], sympy.hessian(law, names).subs(time, 0), "numpy")
    value = sympy.lambdify([names], law.subs(time, 0), "math")
    source = _uphill(loop, value, gradient, curved)
    where = _shown(source)
    notes.append(
        f"the field states no source; it is taken to be the stationary point uphill from the "
        f"start, {where}"
    )
    if law.has(time):
        notes.append("the field changes with time; its source is that at t = 0")
    return Located(loop, tuple(source.tolist()), tuple(notes))


def _with_fractions(loop: Loop) -> Loop:
    """Return the loop with every ratio that is a simple fraction stated as one."""
    if not isinstance(loop.controller, GradientES):
        return loop
    simple = {}
    for index, channel in enumerate(loop.controller.channels):
        near = Fraction(channel.ratio).limit_denominator(SIMPLE)
        if isinstance(channel.ratio, float) and float(near) == channel.ratio:
            simple[f"controller.channels.{index}.ratio"] = near
    return loop.replace(simple) if simple else loop


def _start(loop: Loop) -> Vector:
    system, values = loop.system, loop.values.tolist()
    state = np.array([system.start(values)], dtype=float)
    return system.evaluate(np.zeros(1), state, values)["position"][0]


def _size(loop: Loop) -> float:
    """Return the dither's size (m), the scale on which the loop can see the field."""
    sizes = []
    for axis, plant in enumerate(loop.vehicle.dynamics()):
        motion = loop.controller.motion(axis)
        assert motion is not None
        amplitude, frequency, _, through = motion
        if through is not None and plant is not None:
            amplitude *= abs(at_frequency(plant / through, frequency))
        sizes.append(amplitude)
    return max(sizes)


def _uphill(
    loop: Loop,
    value: Callable[[Any], float],
    gradient: Callable[[Any], Any],
    curved: Callable[[Any], Any],
) -> Vector:
    """Return the stationary point uphill from the start: BFGS, then Newton's method."""
    from scipy.optimize import minimize

    start, size = _start(loop), _size(loop)
    count = len(start)
    height, slope = _quiet(value, ()), _quiet(gradient, (count,))
    bend = _quiet(curved, (count, count))

    def downhill(scaled: Vector) -> tuple[float, Vector]:
        point = start + size * scaled
        found = float(height(point))
        return (-found, -size * slope(point)) if math.isfinite(found) else (math.inf, 0 * point)

    if not np.any(slope(start)):
        return start
    with np.errstate(all="ignore"):
        climbed = minimize(downhill, np.zeros(count), jac=True, method="BFGS")
        point = start + size * climbed.x
        lost = not float(np.abs(climbed.x).max()) < FAR
        for _ in range(NEWTON):
            parts = bend(point), -slope(point)
            if not all(np.isfinite(part).all() for part in parts):
                break
            step = np.linalg.lstsq(*parts, rcond=None)[0]
            if np.abs(step).max() > size:
                break
            point = point + step
        steep = float(np.linalg.norm(slope(point)))
        around = [height(point + sign * size * e) for e in np.eye(count) for sign in (1, -1)]
        change = float(np.abs(np.array(around) - height(point)).max())
    if lost or not steep * size <= SMALL * change:
        raise InvalidDescription(
            "field",
            f"has no maximum uphill from the start {_shown(start)}: the climb ended at "
            f"{_shown(point)} with slope {steep:.3g}. Theory is about a "
            "neighbourhood of the source; start nearer to one, or take a field that states it",
        )
    return point


def _quiet(function: Callable[[Any], Any], shape: tuple[int, ...]) -> Callable[[Any], Vector]:
    """Return the function with NaN where it has no value."""

    def asked(point: Any) -> Vector:
        try:
            return np.array(function(point), dtype=float).reshape(shape)
        except (ValueError, OverflowError, ZeroDivisionError):
            return np.full(shape, np.nan)

    return asked


def _local_quadratic(loop: Loop) -> tuple[Field, str]:
    """Return the field's local quadratic, its Hessian by Richardson's differences."""
    moving = loop.field if isinstance(loop.field, Moving) else None
    field = moving.field if moving else loop.field
    size, axes = _size(loop), loop.vehicle.dimension()
    value = _evaluated(field, axes)

    def gradient(point: Any) -> Vector:
        return np.array([_derivative(value, point, (i,), size) for i in range(axes)])

    def curved(point: Any) -> Vector:
        upper = {
            (i, j): _derivative(value, point, (i, j), size)
            for i in range(axes)
            for j in range(i, axes)
        }
        return np.array([[upper[min(i, j), max(i, j)] for j in range(axes)] for i in range(axes)])

    source = _uphill(loop, value, gradient, curved)
    hessian = curved(source)
    local: Field = Quadratic(
        source=tuple(source.tolist()),
        q=tuple(map(tuple, (-hessian / 2).tolist())),
        peak=value(source),
    )
    note = (
        f"the field is known by its values only: it is replaced by its local quadratic at the "
        f"stationary point uphill from the start, {_shown(source)}, with the Hessian "
        f"{_rows(hessian)} by Richardson's differences from steps of the dither's size, "
        f"{size:.3g} m, downwards"
    )
    return (Moving(local, moving.path) if moving else local), note


def _evaluated(field: Field, axes: int) -> Callable[[Any], float]:
    """Return J at t = 0 as a fast function of a point, NaN where the field has no value."""
    names, oracles = coordinates(axes), field.oracles()
    law = field.law(names)
    guards = [
        guard
        for call in law.atoms(AppliedUndef)
        for guard in oracles[call.func.__name__].guards(call.args)
    ]
    library = [{name: oracle.function for name, oracle in oracles.items()}, "math"]
    within = sympy.lambdify([[*names, time]], guards, library, dummify=True)
    inside = sympy.lambdify([[*names, time]], law, library, dummify=True)

    def value(point: Any) -> float:
        place = [*(float(x) for x in point), 0.0]
        return float(inside(place)) if all(g >= 0 for g in within(place)) else math.nan

    return value


def _derivative(
    value: Callable[[Any], float], point: Any, axes: tuple[int, ...], size: float
) -> float:
    """Return a first or second derivative by central differences, extrapolated to step 0.

    The extrapolation stops where rounding makes it worse: the entry of the tableau that changed
    least is taken.
    """
    rows: list[list[float]] = []
    best, change = math.nan, math.inf
    for level in range(LEVELS):
        step = size / 2**level
        rows.append([_difference(value, np.asarray(point, dtype=float), axes, step)])
        for k in range(1, level + 1):
            finer, coarser = rows[level][k - 1], rows[level - 1][k - 1]
            rows[level].append(finer + (finer - coarser) / (4**k - 1))
            moved = max(abs(rows[level][k] - finer), abs(rows[level][k] - coarser))
            if moved < change:
                best, change = rows[level][k], moved
    return best


def _difference(
    value: Callable[[Any], float], point: Vector, axes: tuple[int, ...], step: float
) -> float:
    unit = step * np.eye(len(point))
    if len(axes) == 1:
        e = unit[axes[0]]
        return (value(point + e) - value(point - e)) / (2 * step)
    a, b = unit[axes[0]], unit[axes[1]]
    if axes[0] == axes[1]:
        return (value(point + a) - 2 * value(point) + value(point - a)) / step**2
    corners = (1, a + b), (-1, a - b), (-1, b - a), (1, -a - b)
    return sum(sign * value(point + corner) for sign, corner in corners) / (4 * step**2)


def _shown(point: Vector) -> str:
    names = axis_names(len(point))
    return "(" + ", ".join(f"{n} = {x:.6g}" for n, x in zip(names, point, strict=True)) + ")"


def _rows(matrix: Vector) -> str:
    return "[" + "; ".join(", ".join(f"{x:.6g}" for x in row) for row in matrix) + "]"
