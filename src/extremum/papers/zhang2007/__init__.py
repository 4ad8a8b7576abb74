"""Zhang, Siranosian and Krstić, *Automatica* 43 (2007) 1832–1839: its loops as scenarios.

Figures 4 and 5 have the paper's parameters. What the only surviving scan has lost of figures 6
and 7, and everything the paper states in words only, has our own values: each title says so.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

from ...errors import InvalidDescription, suggestion
from ...scenario import Scenario, load_scenario

NAMES: Final = (
    *("fig4", "fig5", "fig6", "fig7", "unstable", "nondiagonal", "nonquadratic", "three_d"),
    *("drag", "constant_force", "commensurate", "incommensurate", "landscape"),
)
"""The scenarios, in the order of the paper's argument."""


def path(name: str) -> Path:
    """Return the scenario's file.

    Raises
    ------
    InvalidDescription
        For an unknown name, with the nearest known one.
    """
    if name not in NAMES:
        raise InvalidDescription("", f"there is no scenario {name!r}; {suggestion(name, NAMES)}")
    return Path(__file__).with_name(f"{name}.toml")


@cache
def scenario(name: str) -> Scenario:
    """Return a scenario of the paper by name."""
    return load_scenario(path(name))
