"""A verdict as a table and as plain data."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from ..printing import expression_text

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from .conditions import Condition
    from .orbits import Orbit
    from .verdict import Evidence, Verdict

WIDTH: Final = 118
NARROW: Final = 100
ROUNDING: Final = 1e-10


def text(verdict: Verdict) -> str:
    """Return the verdict, the table and the remarks as plain text."""
    from rich.console import Console

    out = io.StringIO()
    console = Console(file=out, width=WIDTH, color_system=None)
    console.print(rendered(verdict))
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def rendered(verdict: Verdict, width: int = WIDTH) -> RenderableType:
    """Return the same for a terminal; a narrow one gets the conditions below the table."""
    from rich.console import Group
    from rich.text import Text

    orbit = verdict.orbit
    word = "stable" if verdict.stable else "not stable" if orbit.found else "not shown to be stable"
    colour = "green" if verdict.stable else "red"
    told = (
        f": largest Floquet exponent {orbit.exponents[0].real:+.6g} 1/s, orbit of period "
        f"{orbit.period:.6g} s, mean offset from the source ({_row(orbit)}) m"
        if orbit.found
        else ""
    )
    parts: list[Any] = [Text.assemble((word, f"bold {colour}"), told)]
    parts += [_wide(verdict)] if width >= NARROW else _narrow(verdict)
    parts += [Text(f"• {remark}") for remark in verdict.remarks]
    return Group(*parts)


def _wide(verdict: Verdict) -> Table:
    table = _columns(verdict.evidence)
    table.add_row(*(_verdict(column) for column in verdict.evidence))
    table.add_row(*(_rate(column) for column in verdict.evidence), end_section=True)
    printed, corrected, *_ = verdict.evidence
    table.add_row(_conditions(printed), _conditions(corrected), *_modes(verdict))
    return table


def _narrow(verdict: Verdict) -> list[Any]:
    from rich.text import Text

    summary = _columns(verdict.evidence)
    summary.add_row(*(_word(column.stable) for column in verdict.evidence))
    summary.add_row(*(_rate(column) for column in verdict.evidence))
    silent = [f"{c.title}: {c.silence}" for c in verdict.evidence if c.silence]
    listed = [f"{c.title}\n{_conditions(c)}" for c in verdict.evidence[:2] if c.conditions]
    modes = _columns(verdict.evidence[2:])
    modes.add_row(*_modes(verdict))
    return [summary, *map(Text, (*silent, *listed)), modes]


def _columns(evidence: Sequence[Evidence]) -> Table:
    from rich.table import Table

    table = Table(show_lines=False, pad_edge=False, expand=False)
    for column in evidence:
        listed = column.title.endswith(("eigenvalues", "exponents"))  # side by side, line by line
        table.add_column(column.title, vertical="top", overflow="fold", no_wrap=listed)
    return table


def data(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as plain lists, numbers and text."""
    orbit, pairs = verdict.orbit, verdict.modes
    return {
        "stable": verdict.stable,
        "outcome": orbit.outcome if verdict.lyapunov is None else verdict.evidence[3].title,
        "evidence": [
            {
                "title": column.title,
                "stable": column.stable,
                "rate": _finite(column.rate),
                "silence": column.silence,
                "modes": [_complex(mode) for mode in column.modes],
                "conditions": [_condition(c) for c in column.conditions],
            }
            for column in verdict.evidence
        ],
        "modes": []
        if pairs is None
        else [
            {"averaged": _complex(a), "floquet": _complex(b), "distance": float(d)}
            for (a, b), d in zip(pairs.pairs, pairs.distances, strict=True)
        ],
        "orbit": {
            "period": _finite(orbit.period),
            "mean": orbit.mean.tolist(),
            "offset": orbit.offset.tolist(),
            "amplitude": orbit.amplitude.tolist(),
            "J_mean": _finite(orbit.J_mean),
            "J_range": [_finite(x) for x in orbit.J_range],
        },
        "remarks": list(verdict.remarks),
    }


def _verdict(column: Evidence) -> str:
    return "\n".join(filter(None, (_word(column.stable), column.silence)))


def _word(stable: bool | None) -> str:
    return "—" if stable is None else "stable" if stable else "not stable"


def _rate(column: Evidence) -> str:
    return "" if column.rate != column.rate else f"{column.rate + 0.0:+.6g} 1/s"


def _conditions(column: Evidence) -> str:
    return "\n".join(
        f"{'✓' if c.holds else '✗'} {c.text()}  ({c.value:.4g})" for c in column.conditions
    )


def _modes(verdict: Verdict) -> tuple[str, str]:
    pairs = verdict.modes
    if pairs is None:
        columns = (verdict.evidence[2].modes, verdict.evidence[3].modes)
        return tuple("\n".join(_shown(mode) for mode in modes) for modes in columns)  # pyright: ignore[reportReturnType]
    left = "\n".join(_shown(a) for a, _ in pairs.pairs)
    right = "\n".join(
        f"{_shown(b)}  Δ {d:.1e}" for (_, b), d in zip(pairs.pairs, pairs.distances, strict=True)
    )
    return left, right


def _shown(mode: complex) -> str:
    return f"{mode.real:+.6f}" + (f" {mode.imag:+.6f}j" if abs(mode.imag) > 1e-12 else "")


def _row(orbit: Orbit) -> str:
    """Return the mean offset per axis, 0 where it is rounding."""
    rounding = ROUNDING * float(orbit.amplitude.max())
    return ", ".join(f"{x:.4g}" if abs(x) > rounding else "0" for x in orbit.offset)


def _complex(mode: Any) -> list[float]:
    return [float(mode.real), float(mode.imag)]


def _finite(number: float) -> float | None:
    return float(number) if number == number else None


def _condition(condition: Condition) -> dict[str, Any]:
    return {
        "name": condition.name,
        "expression": f"{expression_text(condition.expression)} > 0",
        "value": condition.value,
        "margin": condition.margin,
        "holds": condition.holds,
    }
