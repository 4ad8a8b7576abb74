"""Tables of numbers, as text and for the documentation."""

from __future__ import annotations

from dataclasses import dataclass

Cell = float | str


@dataclass(frozen=True)
class Table:
    """Numbers under headings.

    Attributes
    ----------
    columns
        Heading and format of each column, such as ``("ω = 30", "+.4f")``; text stays as it is.
    rows
        One cell for each column.
    """

    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[Cell, ...], ...]

    def cells(self) -> list[list[str]]:
        """Return every row as text."""
        return [
            [
                cell if isinstance(cell, str) else _number(cell, form)
                for cell, (_, form) in zip(row, self.columns, strict=True)
            ]
            for row in self.rows
        ]

    def text(self) -> str:
        """Return the table as plain text, its columns aligned."""
        lines = [[heading for heading, _ in self.columns], *self.cells()]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        padded = ((cell.ljust(w) for cell, w in zip(line, widths, strict=True)) for line in lines)
        return "\n".join("  ".join(cells).rstrip() for cells in padded)

    def markdown(self) -> str:
        """Return the table for the documentation."""
        headings = [heading for heading, _ in self.columns]
        lines = [[escaped(cell) for cell in row] for row in [headings, *self.cells()]]
        lines.insert(1, ["---"] * len(headings))
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _number(value: float, form: str) -> str:
    text = format(value, form)
    return format(0.0, form) if float(text) == 0 else text  # no -0.0000


def escaped(text: str) -> str:
    """Return text in which Markdown sees neither emphasis nor the end of a cell."""
    return text.replace("|", "\\|").replace("*", "\\*")
