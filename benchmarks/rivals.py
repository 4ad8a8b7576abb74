"""The same loop, the same output times, the same achieved error: who needs how long.

Errors are the largest of x, y and J over all samples against a solution by a third method. Every
tool gets the loosest setting that reaches `ERROR`; the rivals also get the method and the step
cap that make them fastest. Times are CPU times: waiting for a shared processor would lengthen the
long runs, the rivals', more than the short ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from time import process_time
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from problems import FIG4, FIG5, PERIOD, START, Problem, Rates
from report import Table, Target, figure, interleaved
from scipy.integrate import odeint, solve_ivp

import extremum as es
from extremum.engines import taylor
from extremum.papers import zhang2007

ERROR = 1e-8
TOLERANCES = tuple(m * 10.0**-k for k in range(6, 13) for m in (1.0, 0.5, 0.2))
CAPS = (np.inf, PERIOD / 10, PERIOD / 20)
METHODS = ("DOP853", "RK45", "LSODA")
GAIN = "controller.channels.0.gain"
LEAST = {"scipy": 50.0, "control": 100.0}
"""Times the engine: the same work, states at the output times, on both sides."""

Result = NDArray[np.float64]
"""x, y and J at the output times, (3, times)."""


@dataclass(frozen=True)
class Entry:
    """One tool with its settings.

    Attributes
    ----------
    tool, settings
        Words for the table.
    run
        Takes a value of x's gain and returns what the tool's user gets.
    results
        Takes that and returns `Result`; not timed where the tool returns it at once.
    """

    tool: str
    settings: str
    run: Callable[[float], Any]
    results: Callable[[Any], Result]

    def error(self, problem: Problem, reference: Result) -> Result:
        """Return the largest error of x, y and J."""
        return np.abs(self.results(self.run(problem.gain)) - reference).max(axis=1)


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    for problem, rounds in ((FIG4, 5 if quick else 25), (FIG5, 3 if quick else 15)):
        reference = problem.reference(2)
        yield compare(problem, reference, rounds)
        yield defaults(problem, reference)


def compare(problem: Problem, reference: Result, rounds: int) -> Table:
    """Time every tool at the same achieved error, interleaved."""
    entries = {
        "ours": _loosest(lambda tol: _ours(problem, tol), problem, reference),
        "ours, default": _ours(problem, None),
        "engine": _loosest(lambda tol: _engine(problem, tol), problem, reference),
        "engine, default": _engine(problem, es.simulation.TOLERANCE),
        "scipy": _fastest(_scipy, problem, reference, ("DOP853",)),
        "scipy, best": _fastest(_scipy, problem, reference, METHODS),
        "control": _fastest(_control, problem, reference, ("DOP853",)),
        "control, best": _fastest(_control, problem, reference, METHODS),
        "odeint": _loosest(lambda tol: _odeint(problem, tol), problem, reference),
    }
    errors = {name: float(e.error(problem, reference).max()) for name, e in entries.items()}
    gains = count(1)
    runs = {name: _changing(entry, problem, gains) for name, entry in entries.items()}
    often = {name: 10 for name in entries if name.startswith(("ours", "engine"))}
    times = interleaved(runs, rounds, often, process_time)
    base = times["ours"].median
    ratios = {name: t.median / base for name, t in times.items()}
    engine = {name: t.median / times["engine"].median for name, t in times.items()}
    rows = [
        (
            entry.tool,
            entry.settings,
            f"{errors[name]:.1e}",
            *times[name].text(),
            figure(ratios[name]),
            figure(engine[name]),
        )
        for name, entry in entries.items()
    ]
    targets = [
        Target(f"{problem.name}: {entries[name].tool}, DOP853", engine[name], least, "×", True)
        for name, least in LEAST.items()
    ]
    own = float(np.abs(problem.reference() - reference).max())
    return Table(
        f"{problem.name}, {problem.t_end:g} s, 2001 output times, error ≤ {ERROR:g}",
        ("tool", "settings", "error", "median CPU (ms)", "range (ms)", "× simulate", "× engine"),
        rows,
        [
            "error: the largest of x, y and J over all samples. The reference (extrapolation by",
            f"hand) differs from itself at half the step by {own:.0e}. Every run has a new gain:",
            "simulate includes Loop.replace and returns the Dataset, engine is the integration"
            " alone.",
        ],
        targets,
        {
            "problem": problem.name,
            "reference_error": own,
            "tools": {
                name: {
                    "tool": entry.tool,
                    "settings": entry.settings,
                    "error": errors[name],
                    "ratio_to_simulate": ratios[name],
                    "ratio_to_engine": engine[name],
                    **times[name].data(),
                }
                for name, entry in entries.items()
            },
        },
    )


def defaults(problem: Problem, reference: Result) -> Table:
    """Measure the error of every tool as it comes, in percent of each quantity's range."""
    entries = (
        _ours(problem, None),
        _scipy(problem, "RK45", None, np.inf),
        _control(problem, "RK45", None, np.inf),
        _odeint(problem, None),
    )
    span = np.ptp(reference, axis=1)
    percent = {e.tool: 100 * e.error(problem, reference) / span for e in entries}
    rows = [
        (entry.tool, entry.settings, *(f"{p:.1e}" if p < 1e-3 else figure(p) for p in errors))
        for entry, errors in zip(entries, percent.values(), strict=True)
    ]
    return Table(
        f"{problem.name}: error at every tool's default settings, % of the quantity's range",
        ("tool", "settings", "x", "y", "J"),
        rows,
        data={
            "problem": problem.name,
            "percent_of_range": {tool: list(map(float, p)) for tool, p in percent.items()},
        },
    )


# --- settings ---------------------------------------------------------------------------------


def _loosest(make: Callable[[float], Entry], problem: Problem, reference: Result) -> Entry:
    """Return the entry with the loosest tolerance that reaches `ERROR`."""
    return make(_tolerance(make, problem, reference))


def _tolerance(make: Callable[[float], Entry], problem: Problem, reference: Result) -> float:
    for tol in TOLERANCES:
        if make(tol).error(problem, reference).max() <= ERROR:
            return tol
    raise SystemExit(f"{make(TOLERANCES[-1]).tool} does not reach {ERROR:g} on {problem.name}")


def _fastest(
    make: Callable[[Problem, str, float, float], Entry],
    problem: Problem,
    reference: Result,
    methods: tuple[str, ...],
) -> Entry:
    """Return the fastest of the loosest entries, one for each method and step cap.

    The steps are SciPy's in either tool: `solve_ivp` serves to find the tolerances.
    """
    entries: dict[str, Entry] = {}
    for method in methods:
        for cap in CAPS:
            tol = _tolerance(
                lambda tol, m=method, c=cap: _scipy(problem, m, tol, c), problem, reference
            )
            entry = make(problem, method, tol, cap)
            if entry.error(problem, reference).max() <= ERROR:
                entries[entry.settings] = entry
    gains = count(1)
    times = interleaved(
        {k: _changing(e, problem, gains) for k, e in entries.items()}, 5, clock=process_time
    )
    return entries[min(entries, key=lambda settings: min(times[settings].seconds))]


def _changing(entry: Entry, problem: Problem, gains: Iterator[int]) -> Callable[[], object]:
    return lambda: entry.run(problem.gain + 1e-7 * next(gains))


def _words(method: str, tol: float | None, cap: float) -> str:
    accuracy = "default tolerances" if tol is None else f"tol {tol:.0e}"
    capped = "" if np.isinf(cap) else f", max_step period/{PERIOD / cap:.0f}"
    return f"{method}, {accuracy}{capped}"


def _options(tol: float | None, cap: float = np.inf) -> dict[str, Any]:
    options: dict[str, Any] = {} if tol is None else {"rtol": tol, "atol": tol}
    return options if np.isinf(cap) else {**options, "max_step": cap}


# --- tools ------------------------------------------------------------------------------------


def _ours(problem: Problem, tol: float | None) -> Entry:
    loop, times = zhang2007.scenario(problem.name).loop, problem.times
    accuracy = es.simulation.TOLERANCE if tol is None else tol
    return Entry(
        "extremum simulate",
        "default (tol 1e-12)" if tol is None else f"tol {tol:.0e}",
        lambda gain: es.simulate(
            loop.replace({GAIN: gain}), problem.t_end, samples=times, tol=accuracy
        ),
        lambda run: np.vstack([run.position.values.T, run.J.values]),
    )


def _engine(problem: Problem, tol: float) -> Entry:
    loop, times = zhang2007.scenario(problem.name).loop, problem.times
    system, values = loop.system, loop.values.tolist()
    place = [parameter.path for parameter in system.parameters].index(GAIN)

    def run(gain: float) -> NDArray[np.float64]:
        values[place] = gain
        return taylor.integrate(system, values, times, tol=tol).states

    return Entry("extremum engine", f"tol {tol:.0e}", run, lambda states: problem.results(states.T))


def _scipy(problem: Problem, method: str, tol: float | None, cap: float) -> Entry:
    options, times = _options(tol, cap), problem.times

    def run(gain: float) -> Result:
        solution = solve_ivp(
            problem.rates(gain), (0.0, problem.t_end), START, method, times, **options
        )
        return problem.results(solution.y)

    return Entry("scipy solve_ivp", _words(method, tol, cap), run, lambda result: result)


def _control(problem: Problem, method: str, tol: float | None, cap: float) -> Entry:
    options, times = _options(tol, cap), problem.times
    start: Any = list(START)  # annotated as a number in python-control
    names = ["x", "y", "eta"]

    def make(rates: Rates) -> Any:
        return control.nlsys(
            lambda time, state, _, parameters: rates(time, state),
            None,  # no output function: the states are the outputs, at no further cost
            inputs=0,
            outputs=names,
            states=names,
        )

    def run(gain: float) -> Result:
        response = control.input_output_response(
            make(problem.rates(gain)),
            times,
            0,
            start,
            solve_ivp_method=method,
            solve_ivp_kwargs=options,
        )
        return problem.results(response.outputs)

    return Entry("python-control nlsys", _words(method, tol, cap), run, lambda result: result)


def _odeint(problem: Problem, tol: float | None) -> Entry:
    options, times = _options(tol), problem.times

    def run(gain: float) -> Result:
        states = odeint(problem.rates(gain), START, times, tfirst=True, **options)
        return problem.results(states.T)

    return Entry("scipy odeint", _words("LSODA", tol, np.inf), run, lambda result: result)
