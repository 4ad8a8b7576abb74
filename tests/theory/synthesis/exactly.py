"""The exact loop of a design in plain numbers, read off its description, and how it moves."""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import extremum as es
from extremum import s

from ..oracle import demodulation, gains
from ..plain import Axis, Complex, Loop, Polynomials, Quadratic, Vector


def polynomials(law: Any) -> Polynomials:
    """Return the coefficients of a rational function of s."""
    parts = (sympy.Poly(part, s) for part in sympy.fraction(sympy.together(law)))
    above, below = (tuple(float(c) for c in part.all_coeffs()) for part in parts)
    return above, below


def plain_of(loop: es.Loop) -> Loop:
    """Return the oracle's loop with the same numbers, without a sensor."""
    vehicle, controller, field = loop.vehicle, loop.controller, loop.field
    assert isinstance(vehicle, es.PointMass)
    assert isinstance(controller, es.GradientES)
    assert isinstance(field, es.Quadratic)
    forces = vehicle.disturbance or (0.0,) * len(vehicle.axes)
    axes = []
    for plant, channel, force in zip(vehicle.axes, controller.channels, forces, strict=True):
        dither, reference = channel.dither, channel.reference
        assert isinstance(dither, es.Dither)
        through = None if dither.through is None else polynomials(dither.through.law())
        axes.append(
            Axis(
                vehicle=polynomials(plant.law()),
                amplitude=dither.amplitude,
                gain=channel.gain,
                compensator=polynomials(channel.compensator.law()),
                phase=dither.phase,
                reference=None if reference is None else reference.phase,
                ratio=channel.ratio,  # pyright: ignore[reportArgumentType]
                through=through,
                force=force,
            )
        )
    q = np.array(field.q)
    matrix = q if q.ndim == 2 else np.diag(q)
    source = tuple(field.source)
    return Loop(tuple(axes), controller.frequency, controller.washout, Quadratic(matrix), source)


def averaged_roots(loop: Loop) -> Complex:
    """Return the averaged loop's roots without the washout's, 2 diag(c) M Q closing C and G.

    M at the loop's own frequencies, of the dither that its own vehicle makes of the probe.
    """
    a, _, e, p = loop.matrices
    q = loop.field.Q  # pyright: ignore[reportAttributeAccessIssue]
    closing = np.diag(gains(loop)) @ demodulation(loop, finite=True) @ (2 * q)
    return np.linalg.eigvals(a[:-1, :-1] - e[:-1] @ closing @ p[:, :-1]).astype(complex)


def displaced(loop: Loop, displacement: Vector) -> Vector:
    """Return what a displacement of the vehicle at rest adds to a raw state, the washout aside."""
    return np.linalg.pinv(loop.matrices[3]) @ displacement


def run(loop: Loop, start: Vector, times: NDArray[Any]) -> Vector:
    """Integrate the exact loop from a raw state with DOP853; return x̃ = p − p* − steady dither."""
    cap = 2 * np.pi / loop.frequencies.max() / 10
    found = solve_ivp(
        loop.rhs,
        (0, times[-1]),
        start,
        "DOP853",
        t_eval=times,
        rtol=1e-9,
        atol=1e-13,
        max_step=cap,
    )
    assert found.success
    dither = (loop.dither * np.exp(1j * np.outer(times, loop.frequencies))).imag
    return (loop.matrices[3] @ found.y).T - np.array(loop.source) - dither
