"""How a refused command ends."""

from __future__ import annotations

from pathlib import Path

from extremum.cli.main import main


def refused(capsys, *arguments: str) -> str:
    """Run the command; return its one message after checking how it ended."""
    before = sorted(Path().rglob("*"))
    assert main(arguments) == 2
    assert sorted(Path().rglob("*")) == before
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("extremum: error: ")
    assert printed.err.count("\n") == 1, printed.err
    assert len(printed.err) < 600
    assert "Traceback" not in printed.err
    return printed.err
