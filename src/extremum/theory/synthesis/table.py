"""A design's report as tables: for terminals, and as plain text."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any, Final

from ...printing import unit_text
from .rules import Rule

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from .report import Design

WIDTH: Final = 100
WIDE: Final = 150
ROUNDING: Final = 1e-12


def text(design: Design) -> str:
    """Return the report as plain text."""
    from rich.console import Console

    out = io.StringIO()
    Console(file=out, width=WIDTH, color_system=None).print(rendered(design))
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def rendered(design: Design, width: int = WIDTH) -> RenderableType:
    """Return it for a terminal; only a wide one gets the rules' equations beside them."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    wide = width >= WIDE
    proved = dict.fromkeys(proof.statement for proof in design.proofs)
    parts: list[Any] = [Text.assemble(("Design", "bold green"), f": {design.summary}"), ""]
    parts += [Padding(Text(line), (0, 0, 0, 2)) for line in (*_controller(design), "", *proved)]
    parts += ["", _table(design, wide)]
    return Group(*parts, *([] if wide else ["", _equations(design.rules)]))


def _controller(design: Design) -> list[str]:
    channels: Any = design.controller.channels
    frequencies, families = design.controller.frequencies(), design.plan.families
    return [
        f"{family.name}: α = {channel.dither.amplitude:g} m at ω = {omega:g} rad/s, "
        f"c = {channel.gain:g}, C(s) = {design.plan.compensator_text(family.axis)}"
        for family, channel, omega in zip(families, channels, frequencies, strict=True)
    ]


def _table(design: Design, wide: bool) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(pad_edge=False)
    table.add_column("rule", no_wrap=True)
    for title in ("value", "limit", "margin"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("decided by", overflow="fold", max_width=24)
    if wide:
        table.add_column("equation", overflow="fold")
    names, begun = [family.name for family in design.plan.families], ""
    for rule in design.rules:
        axis = rule.name.rpartition(" ")[2]
        if (axis if axis in names else "") != begun:
            table.add_section()
            begun = axis if axis in names else ""
        cells = [rule.name, _value(rule), _limit(rule), _margin(rule), rule.decided_by]
        table.add_row(*map(Text, [*cells, _reason(rule)] if wide else cells))
    return table


def _equations(rules: tuple[Rule, ...]) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for rule in rules:
        table.add_row(Text(rule.name), Text(_reason(rule)))
    return table


def _value(rule: Rule) -> str:
    value = rule.value if abs(rule.value) > ROUNDING else 0.0
    unit = unit_text(rule.unit)
    return f"{value:.4g}{unit if unit == '°' else f' {unit}'}".rstrip()


def _limit(rule: Rule) -> str:
    if not math.isfinite(rule.limit):
        return ""
    return f"{'✓' if rule.holds else '✗'} {'≤' if rule.upper else '≥'} {rule.limit:.4g}"


def _margin(rule: Rule) -> str:
    return "" if math.isnan(rule.margin) else f"{100 * rule.margin:.0f} %"


def _reason(rule: Rule) -> str:
    return f"{rule.equation}; {rule.note}" if rule.note else rule.equation
