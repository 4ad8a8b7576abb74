"""Measure what the project promises: ``python benchmarks/run.py``.

A new capability adds a module with ``tables(quick)`` and its name to `MODULES`.
"""

from __future__ import annotations

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path

from report import Table, as_data, machine, show, verdict
from rich.console import Console

MODULES = ("foundation", "rivals", "theory", "design", "ensemble", "sampled", "sampled_c")


def main() -> int:
    """Run the benchmarks; the exit status is 1 if a target is missed."""
    parser = argparse.ArgumentParser(description="Measure what the project promises.")
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=f"of {', '.join(MODULES)}")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here too")
    parser.add_argument("--quick", action="store_true", help="few repetitions, for a first look")
    chosen = parser.parse_args()
    for name in chosen.modules:
        if name not in MODULES:
            parser.error(f"there is no module {name!r}; choose from {', '.join(MODULES)}")
    console = Console()
    facts = machine()
    console.print(", ".join(f"{name} {text}" for name, text in facts.items()), highlight=False)
    console.print()
    done: list[Table] = []
    for name in chosen.modules or MODULES:
        try:
            module = import_module(name)
        except ModuleNotFoundError as missing:
            parser.error(f"{name} needs {missing.name}; pip install 'extremum[control]'")
        for table in module.tables(chosen.quick):
            show(table, console)
            done.append(table)
    targets = [target for table in done for target in table.targets]
    show(verdict(targets), console)
    if chosen.json is not None:
        data = {"machine": facts, "quick": chosen.quick, "tables": [as_data(t) for t in done]}
        chosen.json.write_text(json.dumps(data, indent=2) + "\n")
    return 0 if all(target.met for target in targets) else 1


if __name__ == "__main__":
    sys.exit(main())
