"""Averaged loops of the paper's procedures, multiplied out from 1 + K q (s − z)/(s − p) G(s)."""

from __future__ import annotations

import numpy as np

from extremum.papers.zhang2007.procedures import DoubleIntegrators, Procedure, UnstablePoles


def rightmost(procedure: Procedure, q: float, *plant: float) -> float:
    """Largest real part of 1 + K q (s − z)/(s − p)/plant(s) = 0."""
    lead = procedure.lead
    strength = procedure.amplitude * procedure.gain * lead.gain
    numerator = strength * q * np.array([1.0, -lead.zero])
    closed = np.polyadd(np.polymul(plant, [1.0, -lead.pole]), numerator)
    return float(np.roots(closed).real.max())


def pole_at(procedure: UnstablePoles, q: float, pole: float) -> float:
    return rightmost(procedure, q, 1.0, -pole)


def integrators_at(procedure: DoubleIntegrators, q: float) -> float:
    return rightmost(procedure, q, 1.0, 0.0, 0.0)
