"""Controllers: what drives the vehicle, knowing only the signal J that it senses."""

from __future__ import annotations

import cmath
import numbers
from abc import abstractmethod
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import sympy
from sympy import Expr, Symbol

from .declarations import is_none
from .description import Description, part, value
from .diagram import Diagram, Motion
from .errors import InvalidDescription, shown
from .lti import Transfer, TransferFunction, transfer
from .rational import at_frequency, ratio
from .symbols import axis_names, is_quarter_turn, parse, parse_number, plain
from .validation import number


class Excitation(Description, abstract=True):
    """What makes an axis wiggle: stated as motion (`Dither`) or as input (`Probe`)."""

    amplitude: float
    phase: float


class Dither(Excitation):
    """The wanted motion of the position, α sin(ωt + φ).

    Its probe at the input is that sine through 1/G(jω):
    α (Re G⁻¹(jω) sin(ωt + φ) + Im G⁻¹(jω) cos(ωt + φ)). For ``through=1/s`` that is the paper's
    αω cos ωt (Fig. 1), for ``through=1/s**2`` −αω² sin ωt (Fig. 2).

    Parameters
    ----------
    amplitude
        α (m).
    phase
        φ (rad); ``-pi/2`` on the second axis makes the paper's quadrature pair.
    through
        The transfer function G whose inverse makes the probe; None for the axis' own. The paper's
        scheme for unstable poles (Fig. 3) uses ``1/s``.
    """

    amplitude: float = value("alpha", "m", "α, amplitude of the position's dither", positive=True)
    phase: float = value(
        "phi", "rad", "φ of the dither α sin(ωt + φ)", default=0.0, literal=is_quarter_turn
    )
    through: Transfer | None = part(
        Transfer,
        "G whose inverse makes the probe",
        default=None,
        converter=lambda given: given if given is None else transfer(given),
        literal=is_none,
    )


class Probe(Excitation):
    """The probe stated directly at the input: a sin(ωt + φ).

    The channel's `reference` must then be given, as the phase of the motion it causes is the
    vehicle's.

    Parameters
    ----------
    amplitude
        a (unit of the input).
    phase
        φ (rad).
    """

    amplitude: float = value("a", "{input}", "a, amplitude of the probe", positive=True)
    phase: float = value(
        "phi", "rad", "φ of the probe a sin(ωt + φ)", default=0.0, literal=is_quarter_turn
    )


class Reference(Description):
    """The sinusoid that demodulates, sin(ωt + ψ).

    Parameters
    ----------
    phase
        ψ (rad).
    """

    phase: float = value(
        "psi", "rad", "ψ of the reference sin(ωt + ψ)", default=0.0, literal=is_quarter_turn
    )


def _as_reference(given: Any) -> Any:
    if given is None or isinstance(given, Reference):
        return given
    return Reference(given)


def _as_fraction(given: Any) -> Any:
    """Return integers, fractions and texts of them ("2/3") as `Fraction`, floats as they are."""
    if isinstance(given, str):
        read = parse(given, {})
        given = read if isinstance(read, sympy.Rational) else parse_number(given)
    if isinstance(given, bool) or not isinstance(given, numbers.Rational | sympy.Rational):
        return given
    number(given)
    numerator, denominator = sympy.fraction(given)
    return Fraction(int(numerator), int(denominator))


class Channel(Description):
    """One axis of the controller: input = probe(t) + C(s)[gain · ξ · reference(t)].

    ξ is the signal after the washout. Source: Zhang, Siranosian and Krstić (2007), Figs. 1 to 3.

    Parameters
    ----------
    dither
        A `Dither` (motion wanted) or a `Probe` (input stated).
    gain
        c (unit of the input per unit of J).
    compensator
        C(s), proper; its own gain belongs to it.
    reference
        `Reference` or its phase ψ (rad): demodulates with sin(ωt + ψ). None: in phase with the
        dither, sin(ωt + φ).
    ratio
        This channel's frequency over the controller's: an integer or a `Fraction` keeps the loop
        periodic, a float makes it almost periodic.
    """

    dither: Excitation = part(Excitation, "what makes the axis wiggle", usual=Dither)
    gain: float = value("c", "{input}", "c, the demodulation gain")
    compensator: Transfer = part(
        Transfer, "C(s)", default=TransferFunction(), converter=lambda given: transfer(given)
    )
    reference: Reference | None = part(
        Reference, "what demodulates", default=None, converter=_as_reference, literal=is_none
    )
    ratio: Fraction | float = value(
        "rho",
        "1",
        "its frequency over the base frequency",
        default=Fraction(1),
        positive=True,
        converter=_as_fraction,
        literal=lambda given: isinstance(given, Fraction),
    )

    def check(self) -> None:
        """Refuse a probe without a reference, and a ratio that is not positive."""
        if isinstance(self.dither, Probe) and self.reference is None:
            raise InvalidDescription(
                "reference",
                "must be given with a Probe: the phase of the motion it causes depends on the "
                "vehicle (for 1/s: the probe's phase − π/2); or state a Dither instead",
                "None",
            )
        if isinstance(self.ratio, Fraction) and self.ratio <= 0:
            raise InvalidDescription("ratio", "must be greater than 0", str(self.ratio))


class Controller(Description, abstract=True):
    """From the signal J to the inputs. Subclasses draw it with `compose`."""

    @abstractmethod
    def compose(
        self,
        diagram: Diagram,
        signal: Symbol,
        plants: Sequence[Expr | None],
        inputs: Sequence[str],
        units: Sequence[str],
    ) -> tuple[Symbol, ...]:
        """Draw the controller driven by J; bind and return the inputs' symbols.

        `plants` are the axes' transfer functions, for probes that go through the axis' own.
        """

    @abstractmethod
    def inputs(self) -> int:
        """Return how many inputs it drives."""

    @abstractmethod
    def base(self) -> Any:
        """Return the frequency ω (rad/s) that all its frequencies are multiples of."""

    @abstractmethod
    def rest(self, signal: Expr) -> tuple[Expr, ...]:
        """Return its states at rest under a constant J = `signal`, in the order `compose` draws."""

    def check_plant(self, axis: int, plant: Expr | None) -> None:
        """Refuse an axis that cannot be driven; `plant` is its transfer function, if it has one."""

    def compensators(self) -> tuple[tuple[str, Transfer, float], ...]:
        """Return the filters' dotted paths, transfer functions and dither frequencies (rad/s)."""
        return ()

    def through(self, plants: Sequence[Expr | None]) -> Controller:
        """Return the controller with the axes' transfer functions in its probes that need them."""
        return self

    @abstractmethod
    def motion(self, axis: int) -> Motion | None:
        """Return the axis' probe; None if it is not steady from t = 0."""

    def ripple(self, axis: int) -> Motion:
        """Return what a constant sensed signal adds to the axis' input: nothing, unless it says so.

        Its amplitude is an expression of the signals that `compose` binds.
        """
        return Motion(sympy.Integer(0), self.base(), 0.0, sympy.Integer(1))


def _start_literal(given: Any) -> bool:
    if isinstance(given, str):
        if given in ("signal", "zero"):
            return True
        raise InvalidDescription(
            "", 'must be "signal" (the washout starts at J(0)), "zero" or a number', shown(given)
        )
    return False


class GradientES(Controller):
    """The paper's extremum seeking: wash out the mean, demodulate, compensate, add the probe.

    η = h/(s + h)[J], ξ = J − η = s/(s + h)[J], and per channel
    u = probe(t) + C(s)[c · ξ · reference(t)].
    Source: Zhang, Siranosian and Krstić (2007), Figs. 1 to 3 and equation (3); the paper's
    e is η − f*.

    Parameters
    ----------
    frequency
        ω (rad/s), the base of all channels' frequencies.
    washout
        h (rad/s), the washout's corner.
    channels
        One `Channel` per input.
    washout_start
        η(0): ``"signal"`` (the default) starts the washout at J(0), so that ξ(0) = 0; ``"zero"``
        as in the paper's figures, where ξ(0) = J(0); or a number.
    probe_ramp
        T (s): the probe grows as 1 − e^(−t/T) instead of starting at full size, which keeps a
        force-actuated vehicle from drifting away at αω; None for no ramp.
    """

    frequency: float = value("omega", "rad/s", "ω, the base frequency of the dither", positive=True)
    washout: float = value("h", "rad/s", "h, the corner of s/(s + h)", positive=True)
    channels: tuple[Channel, ...] = part(
        Channel, "probe, gain and compensator of each input", per_axis=True
    )
    washout_start: str | float = value(
        "eta_0", "1", 'η(0): "signal", "zero" or a number', default="signal", literal=_start_literal
    )
    probe_ramp: float | None = value(
        "T",
        "s",
        "T of the probe's ramp 1 − e^(−t/T)",
        default=None,
        positive=True,
        literal=is_none,
    )

    def inputs(self) -> int:
        """Return the number of channels."""
        return len(self.channels)

    def frequencies(self) -> tuple[Any, ...]:
        """Return every channel's frequency ω_i = ratio_i ω (rad/s)."""
        return tuple(_scale(channel.ratio, self.frequency) for channel in self.channels)

    def base(self) -> Any:
        """Return ω."""
        return self.frequency

    def rest(self, signal: Expr) -> tuple[Expr, ...]:
        """Return η = J and every compensator's state 0."""
        orders = sum(ratio(channel.compensator.law()).order for channel in self.channels)
        return (signal, *(sympy.Integer(0) for _ in range(orders)))

    def check_plant(self, axis: int, plant: Expr | None) -> None:
        """Refuse a dither that no probe can cause: G(jω) zero, infinite or unknown."""
        path = f"controller.channels.{axis}.dither"
        dither = self.channels[axis].dither
        if not isinstance(dither, Dither):
            return
        through = plant if dither.through is None else dither.through.law()
        if through is None:
            raise InvalidDescription(
                f"{path}.through", "must be given: the vehicle's axis has no transfer function"
            )
        response = at_frequency(through, self.frequencies()[axis])
        if response == 0 or not cmath.isfinite(response):
            raise InvalidDescription(
                path,
                f"cannot be made: G(jω) = {response} at ω = {self.frequencies()[axis]:g} rad/s; "
                "choose another frequency or `through`",
            )

    def compensators(self) -> tuple[tuple[str, Transfer, float], ...]:
        """Return every channel's C(s)."""
        pairs = zip(self.channels, self.frequencies(), strict=True)
        return tuple(
            (f"channels.{i}.compensator", channel.compensator, frequency)
            for i, (channel, frequency) in enumerate(pairs)
        )

    def through(self, plants: Sequence[Expr | None]) -> GradientES:
        """Return the controller with the axes' transfer functions in dithers that state none."""
        found = {
            f"channels.{i}.dither.through": transfer(plant)
            for i, (channel, plant) in enumerate(zip(self.channels, plants, strict=True))
            if isinstance(channel.dither, Dither)
            and channel.dither.through is None
            and plant is not None
        }
        return self.replace(found) if found else self

    def motion(self, axis: int) -> Motion | None:
        """Return (α, ω_i, φ, G), G = 1 for a `Probe`; None with a ramp."""
        if self.probe_ramp is not None:
            return None
        dither, frequency = self.channels[axis].dither, self.frequencies()[axis]
        if isinstance(dither, Dither):
            through = None if dither.through is None else dither.through.law()
        else:
            through = sympy.Integer(1)
        return Motion(dither.amplitude, frequency, dither.phase, through)

    def ripple(self, axis: int) -> Motion:
        """Return c ξ sin(ω_i t + ψ) through C, what a constant ξ is demodulated to."""
        channel = self.channels[axis]
        phase = (channel.reference or channel.dither).phase
        amplitude = channel.gain * Symbol("xi", real=True)
        return Motion(amplitude, self.frequencies()[axis], phase, 1 / channel.compensator.law())

    def compose(
        self,
        diagram: Diagram,
        signal: Symbol,
        plants: Sequence[Expr | None],
        inputs: Sequence[str],
        units: Sequence[str],
    ) -> tuple[Symbol, ...]:
        """Draw washout, demodulation, compensators and probes."""
        h = plain(self.washout)
        start = {"signal": signal, "zero": sympy.Integer(0)}.get(
            str(self.washout_start), self.washout_start
        )
        xi = diagram.washout(h, signal, start, plain(self.frequency))
        bound = []
        for index, (channel, frequency) in enumerate(
            zip(self.channels, self.frequencies(), strict=True)
        ):
            name, unit = axis_names(len(self.channels))[index], units[index]
            reference = channel.reference or channel.dither
            demodulated = channel.gain * xi * diagram.reference(frequency, reference.phase)
            law = channel.compensator.law()
            order = ratio(law).order
            if law != 1:
                entering = diagram.signal(f"m_{name}", demodulated, unit)
                states = [f"zeta_{name}" + (f"_{i + 1}" if order > 1 else "") for i in range(order)]
                output = diagram.filter(law, entering, states, unit, exact_at=frequency)
                demodulated = diagram.signal(f"w_{name}", output, unit)
            probe = self._probe(diagram, channel, frequency, plants[index])
            bound.append(diagram.signal(inputs[index], probe + demodulated, unit))
        return tuple(bound)

    def _probe(
        self, diagram: Diagram, channel: Channel, frequency: Expr, plant: Expr | None
    ) -> Expr:
        dither = channel.dither
        if isinstance(dither, Dither):
            through = plant if dither.through is None else dither.through.law()
            assert through is not None
            probe = dither.amplitude * diagram.sine(frequency, dither.phase, 1 / through)
        else:
            probe = dither.amplitude * diagram.sine(frequency, dither.phase)
        ramp = None if self.probe_ramp is None else plain(self.probe_ramp)
        return diagram.envelope(ramp) * probe


def _scale(factor: Any, frequency: Any) -> Any:
    if isinstance(frequency, float):
        return float(factor) * frequency
    if isinstance(factor, Fraction):
        factor = sympy.Rational(factor.numerator, factor.denominator)
        return factor * frequency if factor != 1 else frequency
    return factor * frequency
