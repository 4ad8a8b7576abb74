"""`export_c`: a discrete controller as files for firmware."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import sympy

from ..errors import InvalidDescription, shown, suggestion
from . import c99, micropython, readme
from .discrete import DiscreteController
from .naming import check_prefix

PRECISIONS: Final[Mapping[str, int]] = {"double": 64, "single": 32}
MARK: Final = "Written by extremum"
"""What every file says of itself: such a file may be replaced by a later export."""


def export_c(
    ctrl: DiscreteController,
    folder: str | os.PathLike[str],
    *,
    prefix: str = "esc",
    precision: Literal["double", "single"] = "double",
) -> tuple[Path, ...]:
    """Write a controller as a C99 header, which is C++17 too, and a Python file; return the paths.

    ``PREFIX.h`` is self-contained: a state struct ``PREFIX_t`` and the functions ``PREFIX_init``,
    ``_step``, ``_reset``, ``_skip``, and ``_change`` and ``_status`` where the practice has
    `Changes` and a `Detector`; no allocation, no globals, no recursion. ``PREFIX.py`` is the same
    for MicroPython, in the precision of its floats; ``README.md`` says how to use both. In double
    precision header, Python file and `ctrl.step` agree to the last bit, if the compiler does not
    fuse operations (``-ffp-contract=off``).

    Parameters
    ----------
    ctrl
        The controller.
    folder
        Where to write; made if it does not exist. Files of an earlier export are replaced, all or
        none; controllers of several prefixes in one folder share the README of the last.
    prefix
        What every name in C begins with.
    precision
        ``"double"``, or ``"single"``: no double precision anywhere in the header.

    Raises
    ------
    InvalidDescription
        If the prefix is no identifier, or a keyword, of C, C++ or Python; if the folder cannot be
        written, or one of the files is there and is not of an earlier export.
    """
    texts = exported(ctrl, prefix, precision)
    try:
        if not str(folder):
            raise InvalidDescription("folder", "must be named; '.' is the one you are in", "''")
        target = Path(folder)
        for path in (target / name for name in texts):
            if path.exists() and not _ours(path):
                reason = f"{path} is there and not of an earlier export; give another folder"
                raise InvalidDescription("folder", reason, shown(str(folder)))
        target.mkdir(parents=True, exist_ok=True)
        _write(target, texts)
    except InvalidDescription:
        raise
    except (OSError, TypeError, ValueError) as error:
        reason = f"cannot be written: {getattr(error, 'strerror', None) or error}"
        raise InvalidDescription("folder", reason, shown(str(folder))) from None
    return tuple(target / name for name in texts)


def exported(ctrl: DiscreteController, prefix: str, precision: str) -> dict[str, str]:
    """Return what `export_c` writes: file name → text."""
    from .. import __version__

    if not isinstance(ctrl, DiscreteController):
        reason = "must be a DiscreteController, as discretize(controller, dt) makes one"
        raise InvalidDescription("ctrl", reason, shown(ctrl))
    check_prefix(prefix)
    if precision not in PRECISIONS:
        raise InvalidDescription(
            "precision", suggestion(str(precision), PRECISIONS), shown(precision)
        )
    wanted = ctrl.machine_of(PRECISIONS[precision])
    about = _about(ctrl)
    head = f"{len(ctrl.inputs)} inputs, a step every {ctrl.dt!r} s"
    made = f"{MARK} {__version__}; change the controller and export again, this file is replaced."
    return {
        f"{prefix}.h": c99.header(
            wanted,
            prefix,
            ctrl.safe,
            [
                f"{prefix}.h: extremum seeking controller, {head}, {precision} precision.",
                made,
                "",
                f"One C or C++ file of the program defines {prefix.upper()}_IMPLEMENTATION before",
                "it includes this header; README.md has an example.",
                "",
                *about,
            ],
        ),
        f"{prefix}.py": micropython.module(
            ctrl.machine,
            ctrl.safe,
            [f"{prefix}.py: extremum seeking controller, {head}.", made, "", *about],
        ),
        "README.md": readme.readme(ctrl, wanted, prefix, made),
    }


def _about(ctrl: DiscreteController) -> list[str]:
    """Return equations and numbers, in the letters of the program."""
    system, dt = ctrl.system, ctrl.system.dt
    rows = [(str(x), sympy.sstr(e)) for x, e in system.signals]
    rows += [(f"{x}+", sympy.sstr(e)) for x, e in zip(system.states, system.rhs, strict=True)]
    width = max(len(name) for name, _ in rows)
    numbers = [
        (str(p.symbol), repr(float(x)), p.unit, p.path)
        for p, x in zip(system.parameters, ctrl.values, strict=True)
    ]
    wide = [max(len(row[i]) for row in numbers) for i in range(3)]
    return [
        f"Equations at t = k {dt}; x+ is x at the next sample, positive(x, a, b) is a where x > 0,",
        "else b, also where x is NaN:",
        *(f"  {name:<{width}} = {text}" for name, text in rows),
        "",
        "Numbers:",
        *(
            f"  {a:<{wide[0]}} = {b:<{wide[1]}}  {unit:<{wide[2]}}  {path}"
            for a, b, unit, path in numbers
        ),
    ]


def _ours(path: Path) -> bool:
    """Return whether a file was written by an export."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return MARK in file.read(2000)
    except OSError:
        return False


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    """Write all files, or none: under other names first."""
    mask = os.umask(0)
    os.umask(mask)
    written: dict[Path, Path] = {}
    try:
        for name, text in texts.items():
            handle, temporary = tempfile.mkstemp(".part", f".{name}.", folder)
            written[Path(temporary)] = folder / name
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
                file.write(text)
            Path(temporary).chmod(0o666 & ~mask)
        for temporary, path in written.items():
            temporary.replace(path)
    finally:
        for temporary in written:
            temporary.unlink(missing_ok=True)
