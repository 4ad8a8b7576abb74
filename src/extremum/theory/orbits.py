"""`periodic_orbit`: the orbit that averaging promises, found on the exact equations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ..engines import shooting
from ..engines.shooting import Closed
from ..errors import InvalidDescription
from ..loop import Loop
from . import branch, floquet
from .averaging import Average, average
from .excursion import orbit_about
from .frame import Frame
from .labelled import labelled
from .periods import slow_frequencies

if TYPE_CHECKING:
    import xarray

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

FOUND: Final = "found"
SAMPLES: Final = 32
MAX_SAMPLES: Final = 1024
RESOLVED: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic orbit of a loop, or why there is none; made by `periodic_orbit`.

    Without an orbit every array is empty and every number NaN.

    Attributes
    ----------
    outcome
        ``"found"``, or a sentence that says why there is none.
    frame
        The loop in coordinates relative to the source and the steady dither response.
    closed
        The orbit in these coordinates: nodes, transition matrices, residual.
    notes
        What was replaced, and how the orbit was reached, in sentences.
    """

    outcome: str
    frame: Frame
    closed: Closed | None
    notes: tuple[str, ...]

    @property
    def found(self) -> bool:
        """Whether there is an orbit."""
        return self.closed is not None

    @property
    def period(self) -> float:
        """T (s): of the dithers and, where it moves, of the source."""
        return math.nan if self.closed is None else self.closed.period

    @property
    def frequency(self) -> float:
        """2π/T (rad/s), modulo which the exponents' imaginary parts are known."""
        return 2 * math.pi / self.period

    @property
    def start(self) -> Vector:
        """The state at t = 0 in the frame's coordinates, (states,)."""
        return np.empty(0) if self.closed is None else self.closed.nodes[0]

    @property
    def residual(self) -> float:
        """The largest |x(T) − x(0)|; over several segments, the largest gap between two."""
        return math.nan if self.closed is None else self.closed.residual

    @property
    def uncertainty(self) -> float:
        """What Newton's method would still change: the residual through (I − Φ)⁻¹."""
        return math.nan if self.closed is None else self.closed.correction

    @cached_property
    def exponents(self) -> Complex:
        """Floquet exponents λ (1/s), the least stable first, (states,); Im λ in (−π/T, π/T]."""
        if self.closed is None:
            return np.empty(0, dtype=complex)
        return floquet.exponents(self.closed.factors, self.closed.period)

    @cached_property
    def multipliers(self) -> Complex:
        """μ = e^{λT}, the eigenvalues of the monodromy matrix, in the same order."""
        return floquet.multipliers(self.exponents, self.period)

    @property
    def stable(self) -> bool:
        """Whether there is an orbit and every exponent has a negative real part."""
        return floquet.decays(self.exponents)

    @property
    def mean(self) -> Vector:
        """Mean of the position over one period (m), (axes,)."""
        return self._means("position")

    @property
    def offset(self) -> Vector:
        """Mean of x̃ = position − source − steady dither response (m), (axes,): the bias."""
        return self._means("offset")

    @property
    def amplitude(self) -> Vector:
        """Half the peak-to-peak of the position relative to the source (m), (axes,)."""
        if self.closed is None:
            return np.empty(0)
        low, high = self._extremes
        return (high - low)[1:] / 2

    @property
    def J_mean(self) -> float:  # noqa: N802 - the paper's letter
        """Mean of J over one period."""
        return math.nan if self.closed is None else float(self._means("J")[0])

    @property
    def J_range(self) -> tuple[float, float]:  # noqa: N802 - the paper's letter
        """Least and greatest J on the orbit."""
        if self.closed is None:
            return math.nan, math.nan
        low, high = self._extremes
        return float(low[0]), float(high[0])

    def text(self) -> str:
        """Return what the orbit is like, or why there is none, as text."""
        if self.closed is None:
            return "\n".join([f"no periodic orbit: {self.outcome}", *self.notes])
        low, high = self.J_range
        places = [_listed(v) for v in (self.mean, self.offset, self.amplitude)]
        return "\n".join(
            [
                f"periodic orbit of period {self.period:.7g} s, "
                f"{'stable' if self.stable else 'not stable'}",
                f"mean position {places[0]} m, offset {places[1]} m, amplitude {places[2]} m",
                f"J has mean {self.J_mean:.7g} and lies in {low:.7g} … {high:.7g}",
                f"Floquet exponents {_listed(self.exponents)} 1/s",
                *self.notes,
            ]
        )

    __str__ = __repr__ = text

    def harmonic(self, frequency: float) -> Complex:
        """Return x̃'s component at a frequency: x̃ = … + Re(a e^{jΩt}), (axes,) complex (m).

        At a moving source's own frequency it is the tracking error of the mean, with which the
        sensitivity of the averaged loop is compared.

        Parameters
        ----------
        frequency
            Ω (rad/s), a multiple of `frequency`.
        """
        if self.closed is None:
            return np.full(len(self.frame.equations.dither), np.nan, dtype=complex)
        times, outputs = self._samples
        waves = np.exp(-1j * frequency * times)
        return np.asarray(2 / len(times) * (waves @ outputs["offset"]), dtype=complex)

    def dataset(self, samples: int = 256) -> xarray.Dataset:
        """Return the orbit over one period.

        Parameters
        ----------
        samples
            How many, equispaced, both ends among them; over several segments rounded up.

        Returns
        -------
        xarray.Dataset
            ``position(time, axis)`` (m), ``source``, ``offset`` (x̃), ``input``, ``J(time)`` and
            every state of the frame by name, with units.

        Raises
        ------
        InvalidDescription
            If there is no orbit.
        """
        if self.closed is None:
            raise InvalidDescription("", f"there is no orbit to sample: {self.outcome}")
        system, values, closed = self.frame.system, self.frame.values, self.closed
        each = max(math.ceil((samples - 1) / len(closed.nodes)), 1)
        times, states = shooting.sampled(system, values, closed, each)
        times = np.append(times, closed.period)
        states = np.concatenate([states, states[:1]])
        return labelled(system, times, states, values, {"period": closed.period})

    @cached_property
    def _samples(self) -> tuple[Vector, dict[str, Vector]]:
        """Times and outputs, dense enough for the spectrum to have died away."""
        assert self.closed is not None
        count = SAMPLES
        while True:
            times, states = shooting.sampled(
                self.frame.system, self.frame.values, self.closed, count
            )
            outputs = self.frame.system.evaluate(times, states, self.frame.values)
            count *= 2
            if count > MAX_SAMPLES or _resolved(_judged(outputs)):
                return times, outputs

    def _means(self, name: str) -> Vector:
        return np.empty(0) if self.closed is None else self._samples[1][name].mean(axis=0)

    @cached_property
    def _extremes(self) -> tuple[Vector, Vector]:
        columns = _judged(self._samples[1])
        return -_peaks(-columns), _peaks(columns)


def periodic_orbit(loop: Loop) -> Orbit:
    """Return the periodic orbit x(t + T) = x(t) near the averaged equilibrium, stable or not.

    x(T; x₀) = x₀ is solved by Newton's method with the exact state-transition matrix Φ, in
    coordinates relative to the source and the steady dither response:
    x₀ ← x₀ + (I − Φ)⁻¹ (x(T; x₀) − x₀), over several segments at once where T is long. T is the
    common period of the dithers and, where it moves, of the source. Where the averaged equilibrium
    is too far away, the orbit is followed from a high ω, where it is near, down to the wanted one.

    Returns
    -------
    Orbit
        With ``found``, ``period``, ``exponents``, ``multipliers``, ``mean``, ``offset``,
        ``amplitude``, ``J_mean``, ``J_range``; or an `outcome` that says why there is none: the
        averaged loop has no equilibrium, the branch ends at some ω, Newton's method does not
        converge, or the frequencies have no common period.

    Raises
    ------
    InvalidDescription
        If the field states no source and none is found uphill from the start.

    Notes
    -----
    The orbit is that of theorems 1 to 4 of Zhang, Siranosian and Krstić (2007); its exponents
    decide stability at finite ω, where the averaged eigenvalues decide for ω → ∞.
    """
    return orbit_of(average(loop))


def orbit_of(predicted: Average) -> Orbit:
    """Return the periodic orbit near an averaged equilibrium; see `periodic_orbit`."""
    frame = predicted.frame
    cycle = frame.period()
    if cycle is None:
        return Orbit(_aperiodic(frame), frame, None, frame.notes)
    if predicted.equilibrium is None:
        outcome = "the averaged loop has no equilibrium to start from"
        return Orbit(outcome, frame, None, frame.notes)
    modes = np.abs(predicted.eigenvalues)
    if modes.min() <= floquet.NEUTRAL * modes.max():
        outcome = "the averaged loop has a mode at 0: its equilibria and orbits are not isolated"
        return Orbit(outcome, frame, None, frame.notes)
    if not branch.rests(frame):
        about = orbit_about(predicted, cycle)
        if isinstance(about, Closed):
            return Orbit(FOUND, frame, about, frame.notes)
        return Orbit(_lost(about), frame, None, frame.notes)
    found = branch.reached(predicted, cycle)
    if found.end:
        return Orbit(found.end, frame, None, frame.notes)
    first, last = found.points[0], found.points[-1]
    notes = frame.notes
    if last is not first:
        way = f"the orbit was reached by continuation from ω = {first.frequency:.6g} rad/s"
        notes = (*notes, way)
    return Orbit(FOUND, frame, last.orbit, notes)


def _aperiodic(frame: Frame) -> str:
    if slow_frequencies(frame.system) is None:
        return "nothing repeats, as time enters otherwise than by sines"
    listed = ", ".join(f"{f:.10g}" for f in frame.frequencies())
    return (
        f"nothing repeats: the frequencies {listed} rad/s have no common period within 20,000 "
        "cycles; see `lyapunov`"
    )


def _lost(part: float) -> str:
    if not part:
        return "Newton's method finds no orbit, not even about the source at rest"
    return f"the orbit could be followed up to {part:.3g} of the source's excursion only"


def _listed(numbers: Vector | Complex) -> str:
    return "(" + ", ".join(f"{x:.5g}" for x in np.real_if_close(numbers).tolist()) + ")"


# --- spectra ----------------------------------------------------------------------------------


def _judged(outputs: dict[str, Vector]) -> Vector:
    """Return J and the position relative to the source as columns: both are periodic."""
    return np.hstack([outputs["J"], outputs["position"] - outputs["source"]])


def _resolved(columns: Vector) -> bool:
    """Return whether the upper half of every column's spectrum is rounding."""
    spectrum = np.abs(np.fft.rfft(columns, axis=0))
    tail = spectrum[len(spectrum) // 2 :].max(axis=0)
    return bool((tail <= RESOLVED * spectrum[1:].max(axis=0) + 1e-13 * spectrum[0]).all())


def _peaks(columns: Vector) -> Vector:
    """Return the maximum of each equispaced periodic column, by trigonometric interpolation."""
    count = len(columns)
    spectrum = np.fft.rfft(columns, axis=0) / count
    spectrum[1:] *= 2
    fine = np.fft.irfft(np.fft.rfft(columns, axis=0), 8 * count, axis=0) * 8
    angle = 2 * np.pi * np.argmax(fine, axis=0) / (8 * count)
    order = np.arange(len(spectrum))[:, None]
    peak = fine.max(axis=0)
    for _ in range(3):
        waves = spectrum * np.exp(1j * order * angle)
        value, slope, bend = (
            np.real((w * waves).sum(axis=0)) for w in (1, 1j * order, -(order**2))
        )
        peak = np.maximum(peak, value)
        angle = angle - np.where(bend < 0, slope / np.where(bend < 0, bend, 1.0), 0.0)
    return peak
