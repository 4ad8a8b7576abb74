"""Every example in the documentation is run, what it prints is what the page shows, and every key
of a scenario is documented."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from schema import documented

from extremum.cli import main
from extremum.description import Description

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_examples_run_and_print_what_is_shown(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks(page, "python"):
        exec(compile(block, str(page), "exec"), namespace)
    printed = [line.rstrip() + "\n" for line in capsys.readouterr().out.splitlines()]
    for shown in blocks(page, "text"):
        assert shown in "".join(printed)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_scenarios_and_commands_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for linked in page.parent.glob("docs/*.toml" if page.parent == ROOT else "*.toml"):
        copy = tmp_path / linked.relative_to(page.parent)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(linked, copy)
    for block in blocks(page, "toml"):
        if "[controller]" in block:
            (tmp_path / "loop.toml").write_text(block, encoding="utf-8")
            assert main(["run", "loop.toml"]) == 0
    for block in blocks(page, "console"):
        for command in re.findall(r"^\$ extremum (.*?)(?:\s+#.*)?$", block, re.MULTILINE):
            assert main(command.split()) == 0, command


def test_there_is_something_to_run() -> None:
    assert sum(len(blocks(page, "python")) for page in PAGES) >= 5
    assert sum(len(blocks(page, "text")) for page in PAGES) >= 5


def test_every_key_of_a_scenario_is_documented_as_it_is_declared() -> None:
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    internal = {"Scenario", "TransferFunction", "InState", "Opaque", "DiscreteController"}
    for name, cls in Description.registry.items():
        if name not in internal and _of_a_scenario(cls):
            assert f"### {name}\n" in text
            for row in documented(cls):
                assert row in text, row


def _of_a_scenario(cls: type[Description]) -> bool:
    module = cls.__module__
    other = ("extremum.requirements", "extremum.sweeps.")
    return module.startswith("extremum.") and not module.startswith(other)


def test_ci_runs_the_commands_that_the_readme_prints() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = [line for line in (ROOT / ".ci" / "run").read_text().splitlines() if "&&" in line]
    assert len(commands) == 2
    assert all(command in readme for command in commands)
