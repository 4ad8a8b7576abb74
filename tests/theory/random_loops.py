"""Random loops as plain dictionaries: what both the package and the oracle are built from."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, Final

import numpy as np

from .plain import Axis, Field, Gaussian, Loop, Polynomial, Quadratic

KINDS: Final = ("1/s", "1/s^2", "1/(s - eps)")
RATIOS: Final = {1: [(1,)], 2: [(1, 1), (2, 3), (4, 5), (1, 3), (1, 2)],
                 3: [(4, 5, 7), (1, 1, 2), (2, 3, 5), (3, 3, 4)]}  # fmt: skip
FIELDS: Final = ("quadratic", "quadratic", "quadratic", "gaussian", "cubic")


def random_loop(seed: int) -> dict[str, Any]:
    """Return one loop's numbers: kinds, axes and fields by turns, everything else by chance.

    Axes that share a frequency are a quadrature pair. Numbers have three decimals, so that both
    sides read the same ones. About half of the loops are unstable.
    """
    rng = np.random.default_rng([2007, seed])

    def between(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 3)

    kind, size = KINDS[seed % 3], 1 + (seed // 3) % 3
    ratios = RATIOS[size][rng.integers(len(RATIOS[size]))]
    field = FIELDS[seed % 5]
    q = [between(0.4, 1.5) for _ in range(size)]
    matrix = np.diag(q)
    if field != "gaussian" and rng.random() < 0.5:  # a strong coupling makes a saddle
        off = np.triu([[between(-0.5, 0.5) for _ in q] for _ in q], 1)
        matrix = matrix + off + off.T
    axes: list[dict[str, Any]] = []
    for i, ratio in enumerate(ratios):
        twin = i > 0 and ratios[i - 1] == ratio
        phase = between(-3.0, 3.0) if not twin else axes[-1]["phase"] - np.pi / 2
        amplitude = axes[-1]["amplitude"] if twin else between(0.05, 0.15)
        numerator, denominator, wanted = (1.0,), (1.0,), between(0.3, 2.0)
        vehicle: tuple[float, ...] = (1.0, 0.0)
        if kind == "1/s^2":
            vehicle = (1.0, 0.0, 0.0)
            numerator, denominator = (1.0, between(0.2, 1.5)), (1.0, between(0.8, 6.0))
        elif kind == "1/(s - eps)":
            vehicle = (1.0, -between(0.05, 0.5))
            if rng.random() < 0.5:
                numerator, denominator = (1.0, between(0.3, 1.5)), (1.0, between(0.8, 4.0))
        if rng.random() < 0.2:
            wanted = -wanted
        axes.append(
            {
                "vehicle": ((1.0,), vehicle),
                "amplitude": amplitude,
                "gain": round(wanted / (amplitude * q[i]), 3),
                "compensator": (numerator, denominator),
                "phase": phase,
                "reference": phase + between(-0.7, 0.7) if rng.random() < 0.4 else None,
                "ratio": Fraction(ratio),
                "through": ((1.0,), (1.0, 0.0)) if kind == "1/(s - eps)" and i == 0 else None,
                "force": between(-0.1, 0.1) if rng.random() < 0.3 else 0.0,
            }
        )
    return {
        "seed": seed,
        "kind": kind,
        "axes": axes,
        "frequency": round(between(40, 100) / min(ratios), 3),
        "washout": between(0.5, 2.0),
        "field": field,
        "matrix": matrix.tolist(),
        "cubic": between(-0.3, 0.3),
        "peak": between(0.5, 1.5),
        "source": tuple(between(-0.3, 0.3) for _ in range(size)),
    }


def plain_field(numbers: dict[str, Any]) -> Field:
    """Return the oracle's field of such numbers."""
    matrix, peak = np.array(numbers["matrix"]), numbers["peak"]
    if numbers["field"] == "gaussian":
        return Gaussian(np.sqrt(peak / (2 * np.diag(matrix))), peak)
    if numbers["field"] == "quadratic":
        return Quadratic(matrix, peak)
    size = len(matrix)
    terms = {(0,) * size: peak}
    for i in range(size):
        for j in range(i, size):
            powers = tuple(int(k == i) + int(k == j) for k in range(size))
            terms[powers] = -float(matrix[i, j]) * (1 if i == j else 2)
    terms[(3,) + (0,) * (size - 1)] = numbers["cubic"]
    if size > 1:
        terms[(1, 2) + (0,) * (size - 2)] = -numbers["cubic"]
    return Polynomial(terms)


def plain_loop(numbers: dict[str, Any]) -> Loop:
    """Return the oracle's loop of such numbers."""
    return Loop(
        axes=tuple(Axis(**axis) for axis in numbers["axes"]),
        frequency=numbers["frequency"],
        washout=numbers["washout"],
        field=plain_field(numbers),
        source=numbers["source"],
    )
