"""Orders measured on exact orbits: how fast a quantity vanishes with a small number.

An order O(·) is an upper bound. |f − f*| holds products such as 2q α x̃, and since 2ab ≤ a² + b²
the sum of squares bounds them; what remains above the floor then falls more slowly than its own
square. `Fit.verdict` says so wherever that is measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...loop import Loop
from ...system import System
from ...theory.orbits import Orbit, periodic_orbit
from ...theory.printed import PaperLoop, recognise
from .schemes import CURVATURES, Dithers

Vector = NDArray[np.float64]

CLOSE: Final = 0.1
"""What a fitted slope may differ from the printed order."""
SAMPLES: Final = 513


@dataclass(frozen=True, eq=False)
class Fit:
    """A quantity that vanishes with a small number, its fitted order and the printed one.

    Attributes
    ----------
    quantity
        What is measured.
    small
        The number that goes to zero: ``"1/ω"`` (s/rad), ``"α"`` (m), ``"ε"`` (1/s), or
        ``"all"``: α, ε and 1/ω in proportion, scaled by a factor.
    dithers
        ``"quadrature"`` or ``"separate"`` frequencies.
    claim
        The paper's equation number.
    printed
        The order it prints.
    x, y
        The small number and the quantity's absolute value, (points,).
    remark
        Why the measured order differs, if it does.
    joint
        Whether the claim is one bound for several small numbers together, such as O(α² + 1/ω²),
        which a lower order in one of them does not refute.
    """

    quantity: str
    small: str
    dithers: Dithers
    claim: str
    printed: int
    x: Vector
    y: Vector
    remark: str = ""
    joint: bool = False

    @property
    def slope(self) -> float:
        """The measured order: d log y / d log x, by least squares."""
        return float(np.polyfit(np.log(self.x), np.log(self.y), 1)[0])

    @property
    def as_printed(self) -> bool:
        """Whether the measured order is the printed one, within 0.1."""
        return abs(self.slope - self.printed) <= CLOSE

    @property
    def refuted(self) -> bool:
        """Whether the claim is false: a lower order, in a bound for this number alone."""
        return self.slope < self.printed - CLOSE and not self.joint

    @property
    def verdict(self) -> str:
        """What was measured, and where it is not the printed order, that it is not."""
        found = f"order {self.slope:.2f} in {self.small}, {self.dithers}"
        if self.as_printed:
            return f"{found}, as printed in {self.claim}."
        side = "higher" if self.slope > self.printed else "lower"
        false = ", which is false as printed" if self.refuted else ""
        return f"{found}, {side} than the {self.printed} of {self.claim}{false}: {self.remark}."


@dataclass(frozen=True, eq=False)
class Measured:
    """One orbit, against the averaged equilibrium.

    Attributes
    ----------
    orbit, known
        The orbit, and the loop as one of the paper's schemes.
    distance, misprinted
        max |x̃ − x̃ᵉ| (m), with the corrected equilibrium and with the printed one.
    level
        max |e − eᵉ|.
    output
        max |w − wᵉ|, w the compensators' outputs; 0 without compensators.
    residual
        lim sup |f − f*|.
    limit
        What it tends to as ω → ∞: max Σ q (x̃ᵉ + α sin)².
    """

    orbit: Orbit
    known: PaperLoop
    distance: float
    misprinted: float
    level: float
    output: float
    residual: float
    limit: float


def measured(loop: Loop) -> Measured:
    """Return an orbit's distances from the equilibrium and lim sup |f − f*| on it.

    x̃ is the paper's, position − source − α sin(ωt + φ), whatever the probe; w is the compensator's
    output, at its equilibrium −ε(x̃ᵉ + x*).
    """
    orbit, known = periodic_orbit(loop), recognise(loop)
    assert orbit.found, orbit.outcome
    assert isinstance(known, PaperLoop)
    run, frame = orbit.dataset(SAMPLES), orbit.frame
    controller: Any = loop.controller
    times = run.time.values
    waves = np.stack(
        [
            channel.dither.amplitude * np.sin(frequency * times + channel.dither.phase)
            for channel, frequency in zip(
                controller.channels, controller.frequencies(), strict=True
            )
        ],
        axis=1,
    )
    centred = run.position.values - run.source.values - waves
    q, right = np.array(CURVATURES), known.corrected.offset
    amplitudes = np.array([channel.dither.amplitude for channel in controller.channels])
    level = -float(q @ (amplitudes**2 / 2 + right**2))
    states = [run[str(x)].values for x in frame.system.states]
    found = _outputs(frame.system)(times, states, frame.values)
    still = [_still(loop, axis, right[axis]) for axis in range(len(found))]
    ripples = [np.abs(w - w0).max() for w, w0 in zip(found, still, strict=True)]
    peak: float = loop.field.peak  # pyright: ignore[reportAttributeAccessIssue]
    return Measured(
        orbit,
        known,
        distance=float(np.abs(centred - right).max()),
        misprinted=float(np.abs(centred - known.printed.offset).max()),
        level=float(np.abs(run["e"].values - level).max()),
        output=float(max(ripples, default=0.0)),
        residual=peak - orbit.J_range[0],
        limit=_limit(waves, right),
    )


@lru_cache(maxsize=64)
def _outputs(system: System) -> Any:
    """Return the compensators' outputs w as a function of t, state and values."""
    outputs = [x for x, _ in system.signals if x.name.startswith("w_")]
    return system.function(outputs, vector=True)


def _still(loop: Loop, axis: int, offset: float) -> float:
    """Return w at the equilibrium, which holds the vehicle against its own pole."""
    vehicle: Any = loop.vehicle
    parameters = getattr(vehicle.axes[axis], "parameters", {})
    source: Any = loop.field.source  # pyright: ignore[reportAttributeAccessIssue]
    return -parameters.get("epsilon", 0.0) * (offset + source[axis])


def _limit(waves: Vector, offset: Vector) -> float:
    """Return max Σ q (x̃ᵉ + α sin)² over a period: lim sup |f − f*| as ω → ∞."""
    values = ((waves + offset) ** 2 @ np.array(CURVATURES))[:-1]
    spectrum = np.fft.rfft(values)  # at most four harmonics: exact on any grid
    fine = np.fft.irfft(spectrum, 256 * len(values)) * 256
    return float(fine.max())
