"""Paths: how a source moves, as displacement d(t) in metres."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from sympy import Expr

from .description import Description, structure, value
from .errors import InvalidDescription, shown
from .symbols import cosine, is_quarter_turn, letters, parse, plain, sine, t


class Path(Description, abstract=True):
    """A displacement over time; subclasses state `law`."""

    @abstractmethod
    def law(self) -> tuple[Expr, ...]:
        """Return d(t), one expression per axis."""

    def dimension(self) -> int:
        """Return the number of coordinates."""
        return len(self.law())


class FigureEight(Path):
    """d = (a sin ω_m t, a cos(2 ω_m t + φ_m)).

    Source: Zhang, Siranosian and Krstić (2007), equations (17) and (18).

    Parameters
    ----------
    amplitude
        a (m).
    frequency
        ω_m (rad/s).
    phase
        φ_m (rad); 3π/2 starts the source at (0, 0).
    """

    amplitude: float = value("a_m", "m", "a, half the eight's width")
    frequency: float = value("omega_m", "rad/s", "ω_m of x; y has twice that", positive=True)
    phase: float = value("phi_m", "rad", "φ_m at t = 0", default=0.0, literal=is_quarter_turn)

    def law(self) -> tuple[Expr, ...]:
        """Return (a sin ω_m t, a cos(2 ω_m t + φ_m))."""
        first = sine(self.frequency * t, 0.0)
        return self.amplitude * first, self.amplitude * cosine(2 * self.frequency * t, self.phase)


class Circle(Path):
    """d = (R cos(ω_m t + φ_m), R sin(ω_m t + φ_m)); a negative ω_m goes clockwise.

    Parameters
    ----------
    radius
        R (m).
    frequency
        ω_m (rad/s).
    phase
        φ_m (rad).
    """

    radius: float = value("R", "m", "radius", positive=True)
    frequency: float = value("omega_m", "rad/s", "ω_m; negative is clockwise")
    phase: float = value("phi_m", "rad", "φ_m at t = 0", default=0.0, literal=is_quarter_turn)

    def law(self) -> tuple[Expr, ...]:
        """Return (R cos(ω_m t + φ_m), R sin(ω_m t + φ_m))."""
        angle = self.frequency * t
        return self.radius * cosine(angle, self.phase), self.radius * sine(angle, self.phase)


class Line(Path):
    """d = V t.

    Parameters
    ----------
    velocity
        V (m/s), one number per axis.
    """

    velocity: tuple[float, ...] = value("V", "m/s", "V, the velocity", shape="vector")

    def law(self) -> tuple[Expr, ...]:
        """Return V t."""
        return tuple(v * t for v in self.velocity)


def _texts(given: Any) -> Any:
    if isinstance(given, str) or not hasattr(given, "__iter__"):
        raise InvalidDescription("", "must be a tuple with one expression per axis", shown(given))
    return tuple(item if isinstance(item, str) else str(item) for item in given)


class Along(Path):
    """d(t) by one formula per axis: ``Along(("R*sin(0.1*t)", "0.2*t"), parameters={"R": 2})``.

    Parameters
    ----------
    formulas
        Text (or SymPy expressions in ``es.t``), one per axis.
    parameters
        Name → value.
    """

    formulas: tuple[str, ...] = structure("one expression in t per axis", converter=_texts)
    parameters: Mapping[str, float] = value(
        "", "", "values of the letters", default=None, shape="table"
    )

    def check(self) -> None:
        """Refuse text that cannot be read."""
        self._read(letters(self.parameters))

    def _read(self, names: Mapping[str, Any]) -> tuple[Expr, ...]:
        read = []
        for index, formula in enumerate(self.formulas):
            try:
                read.append(parse(formula, {"t": t, **names}))
            except InvalidDescription as error:
                raise error.within(f"formulas.{index}") from None
        return tuple(read)

    def law(self) -> tuple[Expr, ...]:
        """Return the formulas with the parameters put in."""
        return self._read({name: plain(v) for name, v in self.parameters.items()})


def as_path(given: Any) -> Any:
    """Return a `Path`; a tuple of expressions in t becomes `Along`."""
    if isinstance(given, Path | str | Mapping) or not hasattr(given, "__iter__"):
        return given
    return Along(given)
