"""The dither as the samples show it, and what the references make of it."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InvalidDescription, shown
from ...rational import Ratio, at_frequency, ratio
from ...sampled.controlling import FEWEST
from ...sampled.practice import Practice
from ...validation import number
from ..demodulation import gradient
from ..frame import Frame
from .held import Complex, Held, Matrix, realised, tustin


@dataclass(frozen=True)
class Timing:
    """When things happen in a sampled loop.

    Attributes
    ----------
    dt
        Time between two samples (s).
    delay, lag
        T of everything in the loop together, and τ of an actuator 1/(τs + 1) (s).
    practice
        What the references account for.
    left_out
        Paths of what the loop has and a linear one has not.
    """

    dt: float
    delay: float
    lag: float
    practice: Practice
    left_out: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What is left out, as a sentence."""
        listed = ", ".join(self.left_out)
        return (f"left out, but not by simulate_sampled: {listed}",) if self.left_out else ()

    @property
    def slowing(self) -> list[float]:
        """The actuator's denominator τs + 1, 1 without a lag."""
        return [self.lag, 1.0] if self.lag else [1.0]

    def accounted(self, frequency: float) -> float:
        """Return by how much (rad) the references at ω = `frequency` lag on purpose."""
        if self.practice.delay is None:
            return 0.0
        late = frequency * (self.dt / 2 + self.practice.delay)
        return late + math.atan(frequency * (self.practice.lag or 0.0))

    def check(self, frame: Frame) -> None:
        """Refuse too few samples in a period."""
        fastest = max(frequencies(frame))
        samples = 2 * math.pi / (fastest * self.dt)
        if samples < FEWEST * (1 - 1e-9):
            raise InvalidDescription(
                "dt",
                f"gives {samples:.3g} samples in a period of the fastest dither, {fastest:g} rad/s;"
                f" {FEWEST} are the fewest: take dt ≤ {2 * math.pi / (fastest * FEWEST):.4g} s",
                shown(self.dt),
            )

    def __str__(self) -> str:
        late = f"dt = {self.dt:g} s, delay {self.delay:g} s"
        if self.lag:
            late += f", lag {self.lag:g} s"
        if self.practice.delay is None:
            return f"{late}; references account for none of it"
        known = f"the hold's {self.dt / 2:g} s and {self.practice.delay:g} s"
        if self.practice.lag:
            known += f", a lag of {self.practice.lag:g} s"
        return f"{late}; references account for {known}"


def not_negative(name: str, given: float) -> float:
    """Return a finite float that is 0 or greater; a refusal names the argument."""
    try:
        found = number(given)
    except InvalidDescription as error:
        raise error.within(name) from None
    if found < 0:
        raise InvalidDescription(name, "must not be negative", shown(given))
    return found


@dataclass(frozen=True, eq=False)
class Received:
    """The dither in the samples.

    Attributes
    ----------
    demodulation
        M, (axes, axes): the mean of each reference times each axis' dither after the washout.
    dither
        Per axis, the dither in the samples over what was asked for, a complex number: for 1/s
        without delay (ω dt/2)/sin(ω dt/2) e^(−jω dt/2).
    leads
        Per axis δ (rad), −π … π: by how much the washed-out dither leads its reference.
    phases
        Per axis, the phase of the reference sin(ω t_k + phase) (rad).
    """

    demodulation: Matrix
    dither: Complex
    leads: Matrix
    phases: Matrix


def received(frame: Frame, timing: Timing, plants: Sequence[Held]) -> Received:
    """Return what arrives of each axis' dither, and M.

    The sensor's F is discretised as the sampled loop does, by Tustin's rule, exact at the base ω.
    """
    controller = gradient(frame.loop)
    turning = frequencies(frame)
    law = realised(*coefficients(frame, ratio(frame.loop.twin.sensor.law())))
    sensor = tustin(law, timing.dt, float(controller.frequency))
    dither, phasors, phases = [], [], []
    for i, (plant, w) in enumerate(zip(plants, turning, strict=True)):
        z = np.array([cmath.exp(1j * w * timing.dt)])
        arrived = complex((plant.at(z) * sensor.at(z))[0])
        motion: Any = controller.motion(i)
        own = frame.loop.vehicle.dynamics()[i]
        given: Any = own if motion.through is None else motion.through
        dither.append(arrived / at_frequency(given, w))
        channel = controller.channels[i]
        washed = complex(washout(frame, timing, np.array([w]))[0])
        phasors.append(motion.amplitude * dither[i] * washed * cmath.exp(1j * motion.phase))
        late = timing.accounted(w) - (cmath.phase(washed) - math.atan(controller.washout / w))
        phases.append((channel.reference or channel.dither).phase - late)
    shared = np.equal.outer(turning, turning)
    turned: Any = np.array(phasors) * np.exp(-1j * np.array(phases))[:, None]
    return Received(
        demodulation=np.where(shared, turned.real / 2, 0.0),
        dither=np.array(dither),
        leads=np.angle(turned.diagonal()),
        phases=np.array(phases),
    )


def washout(frame: Frame, timing: Timing, frequency: Matrix) -> Complex:
    """Return s/(s + h) by Tustin's rule, pre-warped at the controller's ω, at frequencies (rad/s).

    At other channels' frequencies its phase is not that of s/(s + h); the references make up for
    the difference.
    """
    controller = gradient(frame.loop)
    base, half = float(controller.frequency), timing.dt / 2
    warped = 1j * base * np.tan(frequency * half) / math.tan(base * half)
    return warped / (warped + controller.washout)


def frequencies(frame: Frame) -> list[float]:
    """Return every channel's ω (rad/s)."""
    return [float(w) for w in gradient(frame.loop).frequencies()]


def coefficients(frame: Frame, form: Ratio) -> tuple[Matrix, Matrix]:
    """Return a transfer function's numerator and denominator, highest power first, monic."""
    return frame.numbers(form.numerator), frame.numbers(form.denominator)
