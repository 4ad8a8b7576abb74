"""What an engineer knows before there is a controller: the statement of a design problem."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from .declarations import Table, declarations, is_none
from .description import Description, flatten, part, structure, value
from .documents import Reader, entries, opened, parsed
from .errors import InvalidDescription, shown
from .lti import Transfer, TransferFunction, transfer
from .symbols import axis_names
from .validation import number
from .vehicles import PointMass

VEHICLE: Final = "vehicle."
SMALLEST: Final = 1e-30
LARGEST: Final = 1e30
Interval = tuple[float, float]


class SourceMotion(Description, abstract=True):
    """How the source moves."""


class Ramp(SourceMotion):
    """A source of constant velocity.

    With `zero_bias` the loop is made of type 2 and follows without a lag; without, of type 1, and a
    lag v/K_v remains.

    Parameters
    ----------
    velocity
        Its bound (m/s), for what the input needs to follow; 0 leaves that out.
    """

    velocity: float = value("v", "m/s", "bound on the source's velocity", default=0.0)

    def check(self) -> None:
        """Refuse a negative bound."""
        _check_bound("velocity", self.velocity)


class Periodic(SourceMotion):
    """A source that repeats: its sines at Ω, 2Ω, … up to a frequency are followed without error.

    Parameters
    ----------
    frequency
        Ω (rad/s), the fundamental.
    up_to
        The highest frequency (rad/s) that its motion contains; None for Ω alone. A figure eight,
        a sin Ωt and a cos 2Ωt, has 2Ω.
    amplitude
        Bound on each of its sines (m), for what the input needs to follow; 0 leaves that out.
    """

    frequency: float = value("Omega", "rad/s", "Ω, the motion's fundamental", positive=True)
    up_to: float | None = value(
        "Omega_max",
        "rad/s",
        "the highest frequency in it; None for Ω",
        default=None,
        positive=True,
        literal=is_none,
    )
    amplitude: float = value("a", "m", "bound on each of its sines", default=0.0)

    def check(self) -> None:
        """Refuse an upper end below the fundamental, and more resonators than make sense."""
        _check_bound("amplitude", self.amplitude)
        if self.up_to is not None and self.up_to < self.frequency:
            raise InvalidDescription(
                "up_to", f"must not be below the fundamental {self.frequency:g}", shown(self.up_to)
            )
        if len(self.frequencies()) > MAX_RESONATORS:
            raise InvalidDescription(
                "up_to",
                f"asks for {len(self.frequencies())} resonators, at most {MAX_RESONATORS} are "
                f"made; lower it to {MAX_RESONATORS * self.frequency:g}",
                shown(self.up_to),
            )

    def frequencies(self) -> tuple[float, ...]:
        """Return Ω, 2Ω, … up to `up_to` (rad/s)."""
        highest = self.frequency if self.up_to is None else self.up_to
        return tuple(k * self.frequency for k in range(1, int(highest / self.frequency + 1e-9) + 1))


MAX_RESONATORS: Final = 4


def _check_bound(name: str, given: float) -> None:
    if given < 0:
        raise InvalidDescription(name, "must not be negative", shown(given))


def interval(given: Any) -> Interval:
    """Return (low, high) of a range; a single number is a range of one point."""
    if isinstance(given, str | Mapping) or not hasattr(given, "__iter__"):
        low = high = number(given)
    else:
        ends = dict(enumerate(given))
        if len(ends) != 2:
            raise InvalidDescription("", "must be two numbers, low and high", shown(given))
        low, high = each(ends, number).values()
    if low > high:
        raise InvalidDescription("", f"its low end {low:g} exceeds its high end {high:g}")
    return low, high


def each(given: Mapping[Any, Any], converter: Callable[[Any], Any]) -> dict[str, Any]:
    """Return a mapping with every entry converted; a refusal names the entry."""
    found = {}
    for name, item in given.items():
        try:
            found[str(name)] = converter(item)
        except InvalidDescription as error:
            raise error.within(str(name)) from None
    return found


def _intervals(given: Any) -> tuple[Interval, ...]:
    if not isinstance(given, list | tuple) or not given:
        raise InvalidDescription("", "must be one pair of numbers per axis", shown(given))
    return tuple(each(dict(enumerate(given)), interval).values())


def _ranges(given: Any) -> Table:
    if given is None:
        return Table({})
    if not isinstance(given, Mapping):
        raise InvalidDescription("", "must map dotted paths to low and high", shown(given))
    for path, item in given.items():
        if isinstance(item, Mapping):
            reason = 'is a table; a dotted path is one key, in quotes: "vehicle.axes.0.den.0"'
            raise InvalidDescription(str(path), reason, shown(item))
    return Table(each(given, interval))


def _factors(given: Any) -> Any:
    if given is None:
        return None
    if isinstance(given, str) or not hasattr(given, "__iter__"):
        raise InvalidDescription("", "must be one transfer function per axis", shown(given))
    return tuple(each(dict(enumerate(given)), transfer).values())


class Requirements(Description):
    """What is known of vehicle, map and surroundings, and what is wanted of the closed loop.

    The map is J = J* − p̃ᵀQ p̃ near its source, p̃ = position − source; of Q only bounds are known.
    Where one number may stand for all axes it says "per axis".

    Parameters
    ----------
    vehicle
        A `PointMass` without a disturbance. Its uncertain numbers count as the middles of their
        ranges: that is the nominal vehicle, through whose 1/G₀(jω) the probe goes.
    curvature
        (low, high) of Q_ii (1/m²) for each axis, low > 0.
    dither_limit
        Largest amplitude α of the position's dither (m), per axis.
    settling_time
        T_s (s): from a small displacement to within 2 % of it, anywhere in the box. This or
        `bandwidth`.
    bandwidth
        Ω_B (rad/s): motions of the source below it leave an error |S(jΩ)| of at most 1/√2.
    coupling
        Bound on every |Q_ij|, i ≠ j (1/m²).
    uncertain
        Dotted path of a number of the vehicle → (low, high):
        ``{"vehicle.axes.0.parameters.epsilon": (0, 0.5)}``.
    input_limit
        Largest |input| (unit of the input), per axis; None for no limit on any.
    frequency_limit
        Highest dither frequency (rad/s); None for no limit.
    source_distance
        How far the source may be from where the vehicle rests without input (m), per axis. It
        matters to axes without a pole at 0.
    start_distance
        How far from the source the vehicle may start (m).
    force
        Bound on a constant force at the input (unit of the input), per axis.
    zero_bias
        Whether constant forces, unstable poles and (with `Ramp`) velocities must leave no error.
    motion
        `Ramp`, `Periodic`, or None for a source at rest.
    noise
        σ√Δt (√s × unit of J) of white noise on the sensor: standard deviation σ per sample of Δt.
    accuracy
        Largest root-mean-square error of the mean position that noise may cause (m), per axis.
    sensor
        F(s) between the field and the controller.
    delay
        Dead time of sensor, computation and actuator together (s).
    include
        One factor of C(s) per axis that the design must keep: a lag or a notch asked for.
    quadrature
        Whether two axes may share a frequency, a quarter turn apart.
    """

    root = True

    vehicle: PointMass = part(PointMass, "from inputs to position, nominal")
    curvature: tuple[Interval, ...] = structure(
        "(low, high) of Q_ii for each axis (1/m²)", converter=_intervals
    )
    dither_limit: Any = value(
        "alpha_max", "m", "largest amplitude of the dither", shape="scalar or vector", positive=True
    )
    settling_time: float | None = value(
        "T_s", "s", "time to within 2 %", default=None, positive=True, literal=is_none
    )
    bandwidth: float | None = value(
        "Omega_B", "rad/s", "up to it |S| ≤ 1/√2", default=None, positive=True, literal=is_none
    )
    coupling: float = value("kappa", "1/m^2", "bound on |Q_ij|", default=0.0)
    uncertain: Mapping[str, Interval] = structure(
        "dotted path of a number of the vehicle → (low, high)", default=None, converter=_ranges
    )
    input_limit: Any = value(
        "u_max",
        "{input}",
        "largest |input|",
        default=None,
        shape="scalar or vector",
        positive=True,
        literal=is_none,
    )
    frequency_limit: float | None = value(
        "omega_max",
        "rad/s",
        "highest dither frequency",
        default=None,
        positive=True,
        literal=is_none,
    )
    source_distance: Any = value(
        "X", "m", "how far the source may be", default=0.0, shape="scalar or vector"
    )
    start_distance: float = value("R", "m", "how far the start may be", default=0.0)
    force: Any = value(
        "d_max", "{input}", "bound on a constant force", default=0.0, shape="scalar or vector"
    )
    zero_bias: bool = structure("whether no constant error may remain", default=True)
    motion: SourceMotion | None = part(
        SourceMotion, "how the source moves", default=None, literal=is_none
    )
    noise: float = value("n", "s^0.5", "σ√Δt of the sensor's noise", default=0.0)
    accuracy: float | None = value(
        "sigma_x", "m", "largest rms error by noise", default=None, positive=True, literal=is_none
    )
    sensor: Transfer = part(
        Transfer, "F(s)", default=TransferFunction(), converter=lambda given: transfer(given)
    )
    delay: float = value("T_d", "s", "dead time of the whole loop", default=0.0)
    include: tuple[Transfer, ...] | None = part(
        Transfer,
        "a factor of C(s) to keep",
        default=None,
        per_axis=True,
        converter=_factors,
        literal=is_none,
    )
    quadrature: bool = structure("whether two axes may share a frequency", default=True)

    def check(self) -> None:
        """Refuse what contradicts itself, before anything is computed."""
        self._check_sizes()
        axes = self.vehicle.dimension()
        if len(self.curvature) != axes:
            raise InvalidDescription(
                "curvature", f"has {len(self.curvature)} ranges, the vehicle has {axes} axes"
            )
        for index, (low, high) in enumerate(self.curvature):
            if low <= 0:
                raise InvalidDescription(
                    f"curvature.{index}",
                    "must be greater than 0 all over the range: where it is not, the source is no "
                    "maximum of J along this axis and no controller of this kind stays there",
                    shown((low, high)),
                )
        if (self.settling_time is None) == (self.bandwidth is None):
            given = "none is" if self.settling_time is None else "both are"
            raise InvalidDescription(
                "settling_time", f"or bandwidth must be given, one of the two; {given}"
            )
        for name in ("coupling", "source_distance", "start_distance", "force", "noise", "delay"):
            if min(_each(getattr(self, name))) < 0:
                raise InvalidDescription(name, "must not be negative", shown(getattr(self, name)))
        for name in ("dither_limit", "input_limit", "source_distance", "force"):
            given = getattr(self, name)
            if isinstance(given, tuple) and len(given) != axes:
                raise InvalidDescription(
                    name, f"has {len(given)} entries for {axes} axes; give one number, or one each"
                )
        for name in ("zero_bias", "quadrature"):
            if not isinstance(getattr(self, name), bool):
                raise InvalidDescription(name, "must be true or false", shown(getattr(self, name)))
        if self.include is not None and len(self.include) != axes:
            raise InvalidDescription(
                "include", f"has {len(self.include)} factors for {axes} axes; give 1 where none is"
            )
        if self.accuracy is not None and self.noise == 0:
            raise InvalidDescription(
                "accuracy", "bounds what noise does, and no `noise` is given", shown(self.accuracy)
            )
        self._check_vehicle()

    def _check_sizes(self) -> None:
        for name in declarations(type(self)):
            given = getattr(self, name)
            if not all(SMALLEST <= abs(x) <= LARGEST for x in _numbers(given) if x):
                reason = f"must lie between {SMALLEST:g} and {LARGEST:g} in size; take other units"
                raise InvalidDescription(name, reason, shown(given))
        factors = {f"include.{k}": factor for k, factor in enumerate(self.include or ())}
        for name, factor in {"sensor": self.sensor, **factors}.items():
            if factor.law() == 0:
                raise InvalidDescription(name, "lets nothing pass; 1 passes everything", "0")

    def _check_vehicle(self) -> None:
        if self.vehicle.disturbance is not None:
            raise InvalidDescription(
                "vehicle.disturbance",
                "is one force; a design holds for all up to `force`: state its bound there",
            )
        for path, ends in self.uncertain.items():
            if not path.startswith(VEHICLE):
                raise InvalidDescription(
                    f"uncertain.{path}",
                    f"must begin with {VEHICLE[:-1]}; the map's range is `curvature`",
                )
            for end in (*ends, sum(ends) / 2):
                try:
                    self.vehicle.replace({path.removeprefix(VEHICLE): end})
                except InvalidDescription as error:
                    raise InvalidDescription(f"uncertain.{path}", str(error)) from None

    def per_axis(self, name: str) -> tuple[float, ...]:
        """Return an entry that may be one number, or one per axis, as one per axis."""
        given = getattr(self, name)
        return given if isinstance(given, tuple) else (given,) * self.vehicle.dimension()

    def axes(self) -> tuple[str, ...]:
        """Return the axes' letters."""
        return axis_names(self.vehicle.dimension())


def _numbers(given: Any) -> Iterator[float]:
    if isinstance(given, float):
        yield given
    elif isinstance(given, Description):
        yield from flatten(given)[1]
    elif isinstance(given, tuple | Table):
        for item in given.values() if isinstance(given, Table) else given:
            yield from _numbers(item)


def _each(given: Any) -> tuple[float, ...]:
    return given if isinstance(given, tuple) else (given,)


def parse_requirements(text: str, folder: Path | str = ".") -> Requirements:
    """Return the requirements that TOML text states; the keys are those of `Requirements`.

    A dotted path is one key, in quotes: ``"vehicle.axes.0.parameters.epsilon" = [0, 0.5]``.

    Raises
    ------
    InvalidDescription
        With the dotted path, the value and what would be right.
    """
    data = parsed(text, declarations(Requirements))
    try:
        return Reader(Path(folder)).build(Requirements, data, "")
    except RecursionError:
        raise InvalidDescription("", "these requirements are nested too deeply") from None


def load_requirements(path: Path | str) -> Requirements:
    """Return the requirements in a TOML file.

    Raises
    ------
    InvalidDescription
        If the file is missing or unreadable, or states no requirements.
    """
    return parse_requirements(*opened(path))


def format_requirements(requirements: Requirements) -> str:
    """Return the requirements as TOML text; `parse_requirements` returns equal ones.

    Raises
    ------
    InvalidDescription
        If they are none.
    """
    import tomli_w

    if not isinstance(requirements, Requirements):
        raise InvalidDescription("", "must be Requirements", type(requirements).__name__)
    return tomli_w.dumps(entries(requirements))
