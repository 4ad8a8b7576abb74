"""Actuators as they are: late, limited in size and in speed, and slow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sympy import Expr, Symbol

from ..declarations import is_none
from ..description import Description, value
from ..errors import InvalidDescription, shown
from ..logic import clamped, maximum, minimum
from .delays import Late, line
from .diagram import SampledDiagram


class Actuator(Description):
    """What stands between the controller's commands and what reaches the vehicle.

    Everything is optional. Order: command → `low`, `high` → `rate` → `delay` → `lag`; a command is
    held for a sample, so that the delay may as well come first. Before t = 0 nothing was commanded:
    the actuator is at 0.

    Parameters
    ----------
    low, high
        Saturation: one number, or one for each input (unit of the input).
    rate
        The most that it changes in a second: by at most rate · dt from sample to sample.
    delay
        T ≥ 0 (s), any real number: a command that is given at t_k arrives at t_k + T, between
        samples too.
    lag
        τ of 1/(τ s + 1), integrated exactly together with the vehicle (s).
    """

    low: Any = value(
        "u_low",
        "{input}",
        "lowest input",
        default=None,
        shape="scalar or vector",
        literal=is_none,
    )
    high: Any = value(
        "u_high",
        "{input}",
        "highest input",
        default=None,
        shape="scalar or vector",
        literal=is_none,
    )
    rate: Any = value(
        "u_rate",
        "{input}/s",
        "largest change of the input in a second",
        default=None,
        shape="scalar or vector",
        positive=True,
        literal=is_none,
    )
    delay: float | None = value(
        "T_a", "s", "T, the actuator's delay", default=None, literal=is_none
    )
    lag: float | None = value(
        "tau_a", "s", "τ of 1/(τs + 1)", default=None, positive=True, literal=is_none
    )

    def check(self) -> None:
        """Refuse what no actuator is."""
        if self.delay is not None and self.delay < 0:
            raise InvalidDescription("delay", "must not be negative", repr(self.delay))
        if self.low is None or self.high is None:
            return
        sizes = {len(given) for given in (self.low, self.high) if isinstance(given, tuple)}
        for index in range(min(sizes, default=1)):
            low, high = chosen(self.low, index), chosen(self.high, index)
            if not low < high:
                where = f".{index}" if isinstance(self.low, tuple) else ""
                raise InvalidDescription(
                    f"low{where}", f"must be less than high = {high!r}", repr(low)
                )

    def check_inputs(self, count: int) -> None:
        """Refuse limits that are not one for each of the vehicle's inputs."""
        for name in ("low", "high", "rate"):
            given = getattr(self, name)
            if isinstance(given, tuple) and len(given) != count:
                raise InvalidDescription(
                    name,
                    f"has {len(given)} entries for {count} inputs; give one number, or one each",
                    shown(given),
                )

    @property
    def is_absent(self) -> bool:
        """Whether commands reach the vehicle as they are."""
        return all(getattr(self, name) is None for name in ("low", "high", "rate", "delay", "lag"))


def chosen(given: Any, index: int) -> Any:
    """Return an input's own of numbers that may be one for all."""
    return given[index] if isinstance(given, tuple) else given


@dataclass(frozen=True)
class Arriving:
    """What arrives in a sample: `old` until `switch` after t_k, `new` from then on."""

    old: tuple[Expr, ...]
    new: tuple[Expr, ...]
    switch: Expr | None


def arriving(
    diagram: SampledDiagram,
    actuator: Actuator,
    late: Late | None,
    commands: tuple[Symbol, ...],
    names: tuple[str, ...],
    units: tuple[str, ...],
) -> Arriving:
    """Draw saturation, rate limit and delay of the commands."""
    old: list[Expr] = []
    new: list[Expr] = []
    for index, (command, name, unit) in enumerate(zip(commands, names, units, strict=True)):
        limited: Any = command
        if actuator.high is not None:
            limited = minimum(limited, chosen(actuator.high, index))
        if actuator.low is not None:
            limited = maximum(limited, chosen(actuator.low, index))
        if actuator.rate is not None:
            most = chosen(actuator.rate, index) * diagram.dt
            before = diagram.state(f"{name}_before", unit, 0)
            change = clamped(limited - before, -most, most)
            limited = diagram.signal(f"{name}_limited", before + change, unit)
            diagram.follow(before, limited)
        if late is None:
            old.append(limited)
            new.append(limited)
            continue
        states = line(diagram, f"{name}_ago", unit, 0, late.longest + 1)
        diagram.follow(states[0], limited)
        past = [limited, *states]
        old.append(late.entry(diagram, f"{name}_old", unit, past, 1))
        new.append(late.entry(diagram, f"{name}_new", unit, past))
    return Arriving(tuple(old), tuple(new), None if late is None else late.rest)
