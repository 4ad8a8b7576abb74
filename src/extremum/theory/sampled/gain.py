"""The averaged loop at sampling instants: its loop gain L_d(z) with hold and delay, its modes."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ...loop import Loop
from ...sampled.controlling import FEW
from ...sampled.practice import Practice
from ...symbols import axis_names
from ..demodulation import gradient
from ..frame import Frame, relative
from ..linear import check_axis, control_library, linear, pole_text
from .asked import asked
from .held import Complex, Held, Matrix, StateSpace, chained, held, realised, tustin
from .received import Received, Timing, coefficients, frequencies, received

if TYPE_CHECKING:
    from .margins import Margins

SMALL: Final = 1e-12
"""Part of the largest entry of diag(c) M H below which an entry is rounding."""

DENSE: Final = 100
NEAREST: Final = 24
"""States up to which all modes are computed; beyond, how many: those nearest to z = 1."""

BESIDE: Final = 1 + 1e-9
"""Where those are looked for: at z = 1 itself may be a mode."""

ROUNDING: Final = 1e-11
"""How near to 1 a |z| is not told apart from it."""


@dataclass(frozen=True, eq=False)
class SampledLoopGain:
    """L_d(z) = −G_d(z; T) C_d(z) diag(c) M H; made by `sampled_loop_gain`.

    Attributes
    ----------
    frame
        The loop, with its numbers.
    timing
        The time between samples, delay and lag, and what the references account for.
    received
        The dither as the samples show it, and what the references make of it: M.
    slope
        diag(c) M H, (axes, axes): the demodulated signal per metre from the source.
    compensators, plants
        C_d per axis, and hold · G · e^(−sT).
    """

    frame: Frame
    timing: Timing
    received: Received
    slope: Matrix
    compensators: tuple[StateSpace, ...]
    plants: tuple[Held, ...]

    @property
    def dt(self) -> float:
        """The time between samples (s)."""
        return self.timing.dt

    @cached_property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """The axes that depend on each other, together."""
        from scipy.sparse.csgraph import connected_components

        linked = np.abs(self.slope) > SMALL * np.abs(self.slope).max()
        _, labels = connected_components(linked, directed=False)
        return tuple(tuple(np.flatnonzero(labels == k).tolist()) for k in range(max(labels) + 1))

    @cached_property
    def modes(self) -> Complex:
        """Its modes ln(z)/dt (1/s), z the closed loop's eigenvalues; the slowest decaying first.

        Of a loop with more than 100 states, a long delay's, the 24 of each block nearest to z = 1.
        The washout's own mode is not among them, it always decays.
        """
        found = np.concatenate([self._eigenvalues(block) for block in self.blocks])
        with np.errstate(divide="ignore"):  # what only waits is at z = 0
            decay = np.log(np.abs(found)) / self.dt
        rates = np.empty(len(found), complex)
        rates.real, rates.imag = decay, np.angle(found) / self.dt
        return rates[np.argsort(-decay, kind="stable")]

    @property
    def leading(self) -> float:
        """The largest real part of the modes (1/s), taken as above 0 where |z| = 1 to rounding."""
        return float(self.modes[0].real) + ROUNDING / self.dt

    @property
    def stable(self) -> bool:
        """Whether every |z| < 1."""
        return self.leading < 0

    @cached_property
    def margins(self) -> Margins:
        """Gain, phase and delay margin of L_d(e^(jω dt))."""
        from .margins import margins

        return margins(self)

    def response(self, z: Complex, block: Sequence[int] | None = None) -> Complex:
        """Return L_d(z) at points (N,), (N, axes, axes), of some axes by themselves or of all."""
        axes = range(len(self.plants)) if block is None else block
        return -self.forward(z, axes)[:, :, None] * self.slope[np.ix_(axes, axes)]

    def forward(self, z: Complex, axes: Sequence[int]) -> Complex:
        """Return G_d(z; T) C_d(z) at points (N,), (N, axes)."""
        return np.stack([self.plants[i].at(z) * self.compensators[i].at(z) for i in axes], axis=1)

    def at(self, frequency: float) -> Complex:
        """Return L_d(e^(jω dt)), (axes, axes), at ω = `frequency` (rad/s), exactly."""
        return self.response(np.array([cmath.exp(1j * frequency * self.dt)]))[0]

    def approximate(self, frequency: float) -> Complex:
        """Return −hold(jω) e^(−jωT) G(jω) C(jω) diag(c) M H, (axes, axes), without aliases.

        hold(jω) = (1 − e^(−jω dt))/(jω dt) ≈ e^(−jω dt/2): what a Bode plot by hand takes for
        `at`, good well below the Nyquist frequency π/dt.
        """
        turn = 1j * frequency
        hold = -np.expm1(-turn * self.dt) / (turn * self.dt)
        parts = linear(self.frame.equations, self.frame.loop.twin)
        passing = hold * np.exp(-turn * self.timing.delay)
        passing /= np.polyval(self.timing.slowing, turn)
        found = []
        for pair in zip(parts.plants, parts.compensators, strict=True):
            (a, b), (c, d) = (coefficients(self.frame, form) for form in pair)
            above, below = np.polymul(a, c), np.polymul(b, d)
            found.append(passing * np.polyval(above, turn) / np.polyval(below, turn))
        return -np.array(found)[:, None] * self.slope

    def matrices(self, block: Sequence[int] | None = None) -> tuple[Any, Any, Any]:
        """Return sparse A, B, C from the demodulated signals of some axes to their positions."""
        from scipy.sparse import block_diag

        axes = range(len(self.plants)) if block is None else block
        parts = [chained(self.compensators[i], self.plants[i]) for i in axes]
        a, b, c = (block_diag(entries, format="csc") for entries in zip(*parts, strict=True))
        return a, b, c

    def control(self, axis: int | None = None) -> Any:
        """Return L_d as a python-control state-space object with its `dt`.

        Parameters
        ----------
        axis
            Which axis' L_d(z), single-input single-output; None for the whole matrix.

        Raises
        ------
        InvalidDescription
            For one axis of a coupled loop; if python-control is not installed.
        """
        control = control_library()
        if axis is not None:
            check_axis(axis, len(self.plants), (axis,) in self.blocks)
        chosen = list(range(len(self.plants))) if axis is None else [axis]
        a, b, c = self.matrices(chosen)
        slope = self.slope[np.ix_(chosen, chosen)]
        return control.ss(
            a.toarray(), -b.toarray() @ slope, c.toarray(), np.zeros_like(slope), self.dt
        )

    def text(self) -> str:
        """Return what the samples make of the dither, the margins and the slowest modes as text."""
        names = axis_names(len(self.plants))
        lines = [f"Averaged sampled loop, {self.timing}"]
        for i, (name, w) in enumerate(zip(names, frequencies(self.frame), strict=True)):
            lines.append(
                f"  {name}: {2 * math.pi / (w * self.dt):.4g} samples per period; the dither in "
                f"them is {abs(self.received.dither[i]):.6g} of what was asked for, "
                f"{math.degrees(self.received.leads[i]):+.3g}° from its reference"
            )
        coupled = [block for block in self.blocks if len(block) > 1]
        if coupled:
            listed = "; ".join(" and ".join(names[i] for i in block) for block in coupled)
            lines.append(f"  coupled axes: {listed}")
        slowest = [mode for mode in self.modes if mode.imag >= 0][:3]
        shown_modes = ", ".join(pole_text(complex(mode)) for mode in slowest)
        verdict = "stable" if self.stable else "not stable"
        lines.append(f"  slowest modes: {shown_modes} 1/s: {verdict}")
        if self.stable:
            lines.append(f"  {self.margins}")
        return "\n".join([*lines, *(f"  Note: {note}." for note in self.notes)])

    __str__ = __repr__ = text

    @property
    def notes(self) -> tuple[str, ...]:
        """What was taken for granted or left out, in sentences."""
        fastest = max(frequencies(self.frame))
        samples = 2 * math.pi / (fastest * self.dt)
        few = f"{samples:.3g} samples per period of the fastest dither are few, {FEW} are better"
        return ((few,) if samples < FEW else ()) + self.frame.notes + self.timing.notes

    def _eigenvalues(self, block: Sequence[int]) -> Complex:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import eigs

        a, b, c = self.matrices(block)
        closed = a + b @ csc_array(self.slope[np.ix_(block, block)]) @ c
        if closed.shape[0] <= DENSE:
            return np.linalg.eigvals(closed.toarray()).astype(complex)
        start = np.ones(closed.shape[0])
        found: Any = eigs(closed, NEAREST, sigma=BESIDE, v0=start, return_eigenvectors=False)
        return found


def sampled_loop_gain(
    loop: Loop,
    dt: float | None = None,
    *,
    delay: float | None = None,
    lag: float | None = None,
    practice: Practice | None = None,
) -> SampledLoopGain:
    """Return the loop gain of the averaged loop whose controller runs every `dt` seconds.

    L_d(z) = −G_d(z; T) C_d(z) diag(c) M H, with G_d the exact z-transform of hold · G · e^(−sT),
    C_d Tustin's rule pre-warped at the channel's ω, and

    M_ij = ½ Re[a_j W_d(e^(jω dt)) e^(j(φ_j − ψ_i + ψ̂))],  ψ̂ = ω (dt/2 + T̂) + atan(ω τ̂),

    of axes that share a frequency, 0 otherwise: a_j = α_j G_d(e^(jω dt); T)/G(jω) is the dither as
    it arrives in the samples (after F_d(e^(jω dt)) where the loop has a sensor F), W_d the
    discretised washout, ψ̂ what the references account for. A delay does two things: it is e^(−sT)
    in the slow loop, and where it is not accounted for, a phase error δ = ψ̂ − ω (dt/2 + T) of the
    demodulation: cos δ in a single axis' gain, a rotation e^(±jδ) of a quadrature pair.

    As in `loop_gain`, the average is that of first order; what is kept of the sampling, the
    washout and the delays at ω is exact. A sensor's F is that at ω, its slow lag is left out.

    Parameters
    ----------
    loop
        A `Loop`, or a `SampledLoop`, whose `sampling` says what is left out here; a lag of its
        sensor becomes part of F.
    dt
        Time between two samples (s), at least six in a period of the fastest dither.
    delay
        T: what sensor, computation and actuator are late together (s).
    lag
        τ (s) of an actuator 1/(τs + 1) before the vehicle; 0 for none. A sensor's belongs into
        ``loop.sensor``.
    practice
        `Practice`, as `discretize` takes it: its `delay` and `lag` are T̂ and τ̂. Without a delay,
        ψ̂ = 0.

    Raises
    ------
    InvalidDescription
        For a dt that is not positive, missing or leaves fewer than six samples in a period, a
        negative delay or lag, a signal that is scaled, a sensor that rises and decays unequally;
        where `loop_gain` refuses the loop. Limits, quantisation and lost samples are left out,
        `notes` says so.

    Notes
    -----
    Sources: Åström and Wittenmark (1997), section 2.6, for G_d; the averaged loop as in
    `loop_gain`. Checked against simulation on both sides of its stability limits.
    """
    given = asked(loop, dt, delay, lag, practice)
    timing = given.timing()
    return gain_of(relative(given.loop), timing)


def gain_of(frame: Frame, timing: Timing) -> SampledLoopGain:
    """Return `sampled_loop_gain` of a loop already in relative coordinates."""
    timing.check(frame)
    parts = linear(frame.equations, frame.loop.twin)
    plants, compensators = [], []
    for g, c, w in zip(parts.plants, parts.compensators, frequencies(frame), strict=True):
        top, bottom = coefficients(frame, g)
        slow = np.polymul(bottom, timing.slowing)
        plants.append(held(realised(top, slow), timing.dt, timing.delay))
        compensators.append(tustin(realised(*coefficients(frame, c)), timing.dt, w))
    heard = received(frame, timing, plants)
    gains = np.diag([channel.gain for channel in gradient(frame.loop).channels])
    return SampledLoopGain(
        frame=frame,
        timing=timing,
        received=heard,
        slope=gains @ heard.demodulation @ frame.numbers(frame.equations.hessian),
        compensators=tuple(compensators),
        plants=tuple(plants),
    )
