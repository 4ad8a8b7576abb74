"""Arguments, errors and exit statuses."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from .. import __version__
from ..errors import InvalidDescription
from ..papers.zhang2007 import NAMES
from ..studies import NAMES as STUDIES
from . import commands, exporting, interrupts, studying, sweeping

WRONG, INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status.

    0 completed, 1 escaped, left the data or not stable, 2 the user's error, 130 interrupted.
    """
    options = _parser().parse_args(arguments)
    try:
        with interrupts.remembered():
            status = options.command(options)
            sys.stdout.flush()
        return status
    except InvalidDescription as error:
        return _complain(str(error))
    except BrokenPipeError:
        _forget_output()
        return 0
    except OSError as error:
        _forget_output()
        return _complain(f"{error.filename or 'output'}: {error.strerror or error}")
    except MemoryError:
        return _complain("there is not enough memory for this run; give fewer run.samples")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def _forget_output() -> None:
    """Let what cannot be written be lost quietly, or Python complains of it again at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(message: str) -> int:
    print(f"extremum: error: {message}", file=sys.stderr)
    return WRONG


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="extremum",
        description="Extremum seeking control: simulate a loop from its equations.",
        epilog="""examples:
  extremum paper fig4                         the paper's Fig. 4: fig4.png, fig4.nc, fig4.toml
  extremum run fig4.toml --plot fig4b.png     run it again after editing the file
  extremum equations fig4.toml                its differential equations
  extremum stability fig4.toml                is it stable, and what says so
  extremum design wishes.toml -o loop.toml    a controller that is proved to work
  extremum sweep study.toml                   many loops, in a store that survives
  extremum study basin                        a million of them, with a figure
  extremum export c fig4.toml --dt 1e-3 -o DIR  its controller for firmware, in C

exit status: 0 completed, 1 escaped, left the data or not stable, 2 the input is wrong""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"extremum {__version__}")
    verbs = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_run(verbs)
    _add_paper(verbs)
    _add_equations(verbs)
    _add_stability(verbs)
    _add_design(verbs)
    _add_sweep(verbs)
    _add_study(verbs)
    _add_export(verbs)
    return parser


def _add_run(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    run = verbs.add_parser(
        "run",
        help="simulate a scenario file",
        description="Simulate a scenario file and print what happened.",
        epilog="""examples:
  extremum run fig4.toml                                  numbers on the terminal
  extremum run fig4.toml -o fig4.nc --plot fig4.png       also data and a figure
  extremum run fig4.toml --animation fig4.gif             also an animation (.gif or .mp4)
  extremum run fig4.toml --plot fig4.png --force          overwrite an existing fig4.png""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.add_argument("scenario", metavar="SCENARIO.toml")
    run.add_argument("-o", "--output", metavar="RUN.nc", help="write the run as NetCDF")
    run.add_argument("--plot", metavar="OUT.png", help="write the four panels (.png, .pdf, .svg)")
    run.add_argument("--animation", metavar="OUT.gif", help="write an animation (.gif, .mp4)")
    run.add_argument("--force", action="store_true", help="overwrite existing files")
    run.set_defaults(command=commands.run)


def _add_paper(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    paper = verbs.add_parser(
        "paper",
        help="reproduce a figure of Zhang, Siranosian and Krstić (2007)",
        description="Reproduce the loops of Zhang, Siranosian and Krstić (Automatica, 2007).\n\n"
        f"names: {', '.join(NAMES)}, all, errata",
        epilog="""examples:
  extremum paper                              list them
  extremum paper fig4                         write fig4.png, fig4.nc and fig4.toml here
  extremum paper all -o figures               write all of them into the folder figures
  extremum paper errata                       where the paper's formulas are wrong, with numbers""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    paper.add_argument("name", metavar="NAME", nargs="?", help="a name from the list above")
    paper.add_argument("-o", "--output", metavar="DIR", default=".", help="folder to write into")
    paper.add_argument("--force", action="store_true", help="overwrite existing files")
    paper.set_defaults(command=commands.paper)


def _add_equations(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    equations = verbs.add_parser(
        "equations",
        help="print a scenario's differential equations",
        description="Print the closed loop's differential equations in the paper's symbols.",
        epilog="""examples:
  extremum equations fig4.toml                equations, initial values, symbols with values
  extremum equations fig4.toml --latex        the equations as LaTeX
  extremum equations fig4.toml --average      averaged: equilibrium, polynomial, conditions""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    equations.add_argument("scenario", metavar="SCENARIO.toml")
    equations.add_argument("--latex", action="store_true", help="print LaTeX")
    equations.add_argument("--average", action="store_true", help="the averaged loop's, in τ = ωt")
    equations.set_defaults(command=commands.equations)


def _add_stability(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    stability = verbs.add_parser(
        "stability",
        help="say whether a scenario's loop is stable, with the evidence",
        description="Say whether a scenario's loop is stable: the paper's conditions as printed "
        "and as corrected,\nthe averaged eigenvalues, and the Floquet exponents of the exact "
        "periodic orbit, which decide.",
        epilog="""examples:
  extremum stability fig4.toml                the table
  extremum stability fig4.toml --json         the same for programs

of a scenario with a table [sampling] the verdict is the continuous loop's; the averaged sampled
loop, its modes and margins, is printed after it, and the exit status is 0 if both are stable

exit status: 0 stable, 1 not stable or not shown to be, 2 something in the input is wrong""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    stability.add_argument("scenario", metavar="SCENARIO.toml")
    stability.add_argument("--json", action="store_true", help="print JSON")
    stability.set_defaults(command=commands.stability)


def _add_design(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    design = verbs.add_parser(
        "design",
        help="find a controller that meets requirements, or the reason why none does",
        description="Find a controller for what is known of vehicle and map and what is wanted of "
        "the loop.\nIt is proved for the averaged loop and confirmed on the exact one; the report "
        "lists every\nrule with its value, its limit and who decided it.",
        epilog="""examples:
  extremum design wishes.toml                             the report on the terminal
  extremum design wishes.toml -o loop.toml                also a scenario, for `extremum run`
  extremum design wishes.toml --plot design.png           also roots, margins and responses

exit status: 0 designed, 2 no controller meets the requirements, or the input is wrong""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    design.add_argument("requirements", metavar="REQUIREMENTS.toml")
    design.add_argument("-o", "--output", metavar="LOOP.toml", help="write a scenario that runs")
    design.add_argument("--plot", metavar="OUT.png", help="write a figure (.png, .pdf, .svg)")
    design.add_argument("--force", action="store_true", help="overwrite existing files")
    design.set_defaults(command=commands.design)


def _add_sweep(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    sweep = verbs.add_parser(
        "sweep",
        help="run many loops of one scenario into a Zarr store",
        description="Run the loops of a study file, a scenario whose numbers vary, into a Zarr "
        "store.\nInterrupted, killed or out of disk, the same command goes on where it was.",
        epilog="""examples:
  extremum sweep basin.toml                               into basin.zarr, on all cores
  extremum sweep basin.toml -o run2.zarr --threads 4      on four threads
  extremum sweep basin.toml --workers 8                   in eight processes (needs Dask)
  extremum sweep basin.toml --scheduler tcp://node1:8786  on a Dask cluster

exit status: 0 complete, 2 something in the input is wrong, 130 interrupted""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sweep.add_argument("study", metavar="STUDY.toml")
    sweep.add_argument(
        "-o", "--output", metavar="STORE.zarr", help="by default the study's name, here"
    )
    where = sweep.add_mutually_exclusive_group()
    where.add_argument("--workers", metavar="N", type=int, help="processes of this machine")
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask scheduler")
    sweep.add_argument("--threads", metavar="N", type=int, help="threads of each process")
    sweep.set_defaults(command=sweeping.sweep)


def _add_study(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    study = verbs.add_parser(
        "study",
        help="run a ready study of many loops",
        description=f"Run {', '.join(STUDIES)} or all; without a name, list them.\n"
        "Writes NAME.nc (data) and NAME.png (figure), and for cloud NAME.gif (animation).",
        epilog="""examples:
  extremum study                              the list, with how many loops each runs
  extremum study basin -o studies             into the folder studies
  extremum study basin --loops 10000          a coarser one, soon done
  extremum study all -o studies --force       all of them again""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    study.add_argument("name", metavar="NAME", nargs="?", help="a name from the list above")
    study.add_argument("-o", "--output", metavar="DIR", default=".", help="folder to write into")
    study.add_argument("--loops", metavar="N", type=int, help="how many; at most so many are run")
    study.add_argument("--force", action="store_true", help="overwrite existing files")
    study.set_defaults(command=studying.study)


def _add_export(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    export = verbs.add_parser(
        "export",
        help="write a scenario's controller as C",
        description="Write a scenario's controller for other machines.",
    )
    kinds = export.add_subparsers(metavar="LANGUAGE", required=True)
    c = kinds.add_parser(
        "c",
        help="a C99 header, with a Python file and a README",
        description="Write a scenario's controller, as it runs on samples, as one self-contained "
        "C99 header\n(C++17 too), PREFIX.h, with the same for MicroPython, PREFIX.py, and "
        "README.md.",
        epilog="""examples:
  extremum export c fig4.toml --dt 1e-3 -o firmware             esc.h, esc.py and README.md
  extremum export c fig4.toml --dt 1e-3 -o firmware --single    float only, for small processors
  extremum export c fig4.toml --dt 2e-3 -o . --prefix seek      seek.h, seek.py and README.md""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    c.add_argument("scenario", metavar="SCENARIO.toml")
    c.add_argument(
        "--dt", type=float, metavar="S", help="time between two samples; else the file's [sampling]"
    )
    c.add_argument("-o", "--output", metavar="DIR", default=".", help="folder to write into")
    c.add_argument("--prefix", default="esc", help="what every name in C begins with: esc")
    c.add_argument("--single", action="store_true", help="single precision only")
    c.add_argument("--force", action="store_true", help="overwrite existing files")
    c.set_defaults(command=exporting.export_c)
