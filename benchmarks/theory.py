"""The verdict, the orbit and the average: how long they take, and how long it takes by hand."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from time import process_time
from typing import Any

import control
import numpy as np
import variational as hand
from report import Table, Target, Times, environment, figure, interleaved
from scipy.integrate import odeint, solve_ivp

import extremum as es
from extremum import pi, s
from extremum.papers import zhang2007

GAIN = "controller.channels.0.gain"
ERRORS = (1e-6, 1e-11)
"""Of the exponents, relative to the largest |λ|: what is asked of them, and what ours have."""

TOLERANCES = tuple(m * 10.0**-k for k in range(4, 13) for m in (1.0, 0.5, 0.2))
CAPS = (np.inf, hand.PERIOD / 10, hand.PERIOD / 20)
LEAST = 3.0
"""Times our periodic orbit: DOP853 on the variational equations, at our accuracy."""


def tables(quick: bool) -> Iterator[Table]:
    """Yield the tables of this file."""
    yield warm(20 if quick else 200)
    yield cold(2 if quick else 7)
    yield exponents(3 if quick else 15)
    yield poles(20 if quick else 200)
    yield averages(2 if quick else 5)


def double_integrator() -> es.Loop:
    """Return the paper's Fig. 2 with the second design of erratum 1: seven states, two axes."""
    return es.Loop(
        field=es.Quadratic(source=(0, 0), q=(hand.Q_X, hand.Q_Y)),
        vehicle=es.PointMass(axes=(1 / s**2, 1 / s**2)),
        controller=es.GradientES(
            frequency=hand.OMEGA,
            washout=hand.WASHOUT,
            channels=tuple(
                es.Channel(
                    dither=es.Dither(hand.AMPLITUDE, phase=phase),
                    gain=hand.GAIN,
                    compensator=es.Lead(gain=hand.LEAD_GAIN, zero=hand.ZERO, pole=hand.POLE),
                )
                for phase in (0, -pi / 2)
            ),
        ),
        start=(1, 1),
    )


# --- in a running process ---------------------------------------------------------------------


def warm(rounds: int) -> Table:
    """Change one number of a two-axis loop, and ask again."""
    loops = {"Fig. 1": zhang2007.scenario("fig4").loop, "Fig. 2": double_integrator()}
    gains = count(1)

    def changed(loop: es.Loop) -> es.Loop:
        return loop.replace({GAIN: hand.GAIN + 1e-7 * next(gains)})

    def verdict(loop: es.Loop) -> str:
        return es.stability(changed(loop)).text()

    def orbit(loop: es.Loop) -> object:
        found = es.periodic_orbit(changed(loop))
        return found.exponents, found.mean, found.amplitude, found.J_range

    def average(loop: es.Loop) -> object:
        found = es.average(changed(loop))
        return found.eigenvalues, found.conditions

    def lines(loop: es.Loop) -> object:
        return control.poles(control.feedback(es.loop_gain(changed(loop)).control(0)))

    verbs: dict[str, Callable[[es.Loop], object]] = {
        "stability, with its table as text": verdict,
        "stability, without": lambda loop: es.stability(changed(loop)).stable,
        "periodic_orbit: exponents, mean, amplitude, range of J": orbit,
        "average: eigenvalues, conditions": average,
        "bias": lambda loop: es.bias(changed(loop)).total,
        "loop_gain as a python-control object, its closed poles": lines,
    }
    runs = {
        f"{scheme}: {name}": (lambda verb=verb, loop=loop: verb(loop))
        for scheme, loop in loops.items()
        for name, verb in verbs.items()
    }
    for run in runs.values():
        run()
    times = interleaved(runs, rounds)
    worst = {
        name: max(times[f"{scheme}: {name}"].median for scheme in loops) * 1e3 for name in verbs
    }
    text, _, orbits, *_ = verbs
    return Table(
        "Warm: one gain changed, then asked again; two axes, three and seven states",
        ("", "median (ms)", "range (ms)"),
        [(name, *t.text()) for name, t in times.items()],
        [f"{rounds} runs, each with a gain that was never used before."],
        [
            Target("warm stability with its table, two axes", worst[text], 30.0, "ms"),
            Target("warm periodic orbit, two axes", worst[orbits], 5.0, "ms"),
        ],
        {"times": {name: t.data() for name, t in times.items()}},
    )


# --- as a command -----------------------------------------------------------------------------


def cold(rounds: int) -> Table:
    """Time ``extremum stability`` in a fresh process with no compiled code kept."""
    program = shutil.which("extremum", path=str(Path(sys.executable).parent))
    command = [program] if program else [sys.executable, "-m", "extremum"]
    taken: dict[str, list[float]] = {"fig4": [], "fig6": []}
    for round_ in range(rounds + 1):
        for name, seconds in taken.items():
            with tempfile.TemporaryDirectory() as cache:
                spent = _judged(command, zhang2007.path(name), cache)
            if round_:  # the first fills the file cache and writes bytecode
                seconds.append(spent)
    times = {name: Times(tuple(seconds)) for name, seconds in taken.items()}
    words = {"fig4": "source at rest", "fig6": "1/s², source on a figure eight, over 62.8 s"}
    return Table(
        "Cold: extremum stability SCENARIO.toml, XDG_CACHE_HOME empty",
        ("", "median (s)", "range (s)"),
        [(f"{name}: {words[name]}", *t.text("s")) for name, t in times.items()],
        [f"{rounds} fresh processes each, alternating; heyoka compiles anew."],
        [Target(f"cold stability of {name}", t.median, 4.0, "s") for name, t in times.items()],
        {"times": {name: t.data() for name, t in times.items()}},
    )


def _judged(command: list[str], scenario: Any, cache: str) -> float:
    begin = time.perf_counter()
    done = subprocess.run(
        [*command, "stability", str(scenario)],
        env=environment(XDG_CACHE_HOME=cache),
        capture_output=True,
        text=True,
        check=False,
    )
    spent = time.perf_counter() - begin
    if done.returncode or "Floquet exponents" not in done.stdout:
        raise SystemExit(f"extremum stability {scenario} failed:\n{done.stdout}{done.stderr}")
    return spent


# --- by hand: the exponents ---------------------------------------------------------------------


@dataclass(frozen=True)
class Entry:
    """One way to the exponents: a gain → exponents, sorted as the reference's are."""

    tool: str
    settings: str
    run: Callable[[float], hand.Complex]

    def error(self, reference: hand.Complex) -> float:
        """Return the largest error of an exponent, relative to the largest |λ|."""
        wrong = np.abs(self.run(hand.GAIN) - reference).max()
        return float(wrong / np.abs(reference).max())


def exponents(rounds: int) -> Table:
    """Compare Floquet exponents at the same achieved error, interleaved."""
    reference = hand.orbit(hand.GAIN, hand.by_extrapolation, 1e-9).exponents
    makers = {"DOP853": _dop853, "odeint": _odeint}
    entries = {"ours": _ours()} | {
        f"{name}, {error:g}": _loosest(make, reference, error)
        for error in ERRORS
        for name, make in makers.items()
    }
    errors = {name: entry.error(reference) for name, entry in entries.items()}
    gains = count(1)
    runs: dict[str, Callable[[], object]] = {
        name: (lambda entry=entry: entry.run(hand.GAIN + 1e-7 * next(gains)))
        for name, entry in entries.items()
    }
    times = interleaved(runs, rounds, {"ours": 20}, process_time)
    ratios = {name: t.median / times["ours"].median for name, t in times.items()}
    rows = [
        (e.tool, e.settings, f"{errors[name]:.1e}", *times[name].text(), figure(ratios[name]))
        for name, e in entries.items()
    ]
    same = f"DOP853, {ERRORS[-1]:g}"
    return Table(
        "Floquet exponents of Fig. 2 at ω = 100, seven states",
        ("tool", "settings", "error", "CPU ms", "range", "× ours"),
        rows,
        [
            "Error relative to the largest |λ|. By hand: Newton's method from the averaged",
            "equilibrium on equations and variational equations written out in NumPy. Ours",
            "includes Loop.replace and the averaging.",
        ],
        [
            Target("error of our Floquet exponents", errors["ours"], ERRORS[-1], "|λ|"),
            Target("Floquet exponents: DOP853 / ours", ratios[same], LEAST, "×", at_least=True),
        ],
        {"errors": errors, "ratios": ratios, "times": {n: t.data() for n, t in times.items()}},
    )


def _ours() -> Entry:
    loop = double_integrator()

    def run(gain: float) -> hand.Complex:
        return hand.in_order(es.periodic_orbit(loop.replace({GAIN: gain})).exponents)

    return Entry("extremum periodic_orbit", "default", run)


def _dop853(tolerance: float, cap: float) -> Entry:
    def flow(right: Any, state: hand.Vector, period: float) -> hand.Vector:
        options: dict[str, Any] = {"rtol": tolerance, "atol": tolerance, "max_step": cap}
        return solve_ivp(right, (0.0, period), state, "DOP853", [period], **options).y[:, -1]

    def run(gain: float) -> hand.Complex:
        return hand.orbit(gain, flow, 1e-8).exponents

    return Entry("scipy solve_ivp", _words("DOP853", tolerance, cap), run)


def _odeint(tolerance: float, cap: float) -> Entry:
    limit = 0.0 if np.isinf(cap) else cap

    def flow(right: Any, state: hand.Vector, period: float) -> hand.Vector:
        options = {"rtol": tolerance, "atol": tolerance, "hmax": limit, "mxstep": 10_000}
        return odeint(right, state, [0.0, period], tfirst=True, **options)[-1]

    def run(gain: float) -> hand.Complex:
        return hand.orbit(gain, flow, 1e-8).exponents

    return Entry("scipy odeint", _words("LSODA", tolerance, cap), run)


def _words(method: str, tolerance: float, cap: float) -> str:
    capped = "" if np.isinf(cap) else f", max_step period/{hand.PERIOD / cap:.0f}"
    return f"{method}, tol {tolerance:.0e}{capped}"


def _loosest(make: Callable[[float, float], Entry], reference: hand.Complex, error: float) -> Entry:
    """Return the fastest entry of the loosest tolerances that reach the error, one per cap."""
    entries = []
    for cap in CAPS:
        tried = (make(tolerance, cap) for tolerance in TOLERANCES)
        good = next((entry for entry in tried if entry.error(reference) <= error), None)
        entries += [good] if good else []
    times = interleaved({e.settings: (lambda e=e: e.run(hand.GAIN)) for e in entries}, 3)
    return min(entries, key=lambda entry: min(times[entry.settings].seconds))


# --- by hand: the averaged loop -----------------------------------------------------------------


def poles(rounds: int) -> Table:
    """Compare the averaged eigenvalues of Fig. 2 with python-control's poles of 1 + L."""
    loop, gains = double_integrator(), count(1)
    lead = hand.LEAD_GAIN * hand.AMPLITUDE

    def ours(gain: float) -> hand.Complex:
        return es.average(loop.replace({GAIN: gain})).eigenvalues

    def theirs(gain: float) -> hand.Complex:
        curved = ((gain, hand.Q_X), (hand.GAIN, hand.Q_Y))
        axes = [
            control.tf([lead * c * q, -lead * c * q * hand.ZERO], [1, -hand.POLE, 0, 0])
            for c, q in curved
        ]
        found = [control.poles(control.feedback(gain, 1)) for gain in axes]
        return np.concatenate([*found, [-hand.WASHOUT]])

    ways = {"extremum average": ours, "python-control tf, feedback, poles": theirs}
    both = [np.sort_complex(way(hand.GAIN)) for way in ways.values()]
    apart = float(np.abs(both[0] - both[1]).max())
    runs = {
        name: (lambda way=way: way(hand.GAIN + 1e-7 * next(gains))) for name, way in ways.items()
    }
    times = interleaved(runs, rounds, clock=process_time)
    base = times["extremum average"].median
    return Table(
        "Averaged eigenvalues of Fig. 2, a number changed each time",
        ("tool", "CPU ms", "range", "× ours"),
        [(name, *t.text(), figure(t.median / base)) for name, t in times.items()],
        [f"They agree to {apart:.1e}; python-control is given L(s), which average derives."],
        (),
        {"apart": apart, "times": {name: t.data() for name, t in times.items()}},
    )


SYMPY = """
import time
from sympy import cos, expand, factor_terms, integrate, pi, sin, symbols
places, n = {places}, {count}
x, a, c, q = (symbols(f"{{name}}1:{{n + 1}}", real=True) for name in "xacq")
e, h, w, t = symbols("e h w t", real=True)
begin = time.perf_counter()
d = [sin(m * t) if sine else -cos(m * t) for m, sine in places]
xi = -sum(q[i] * (x[i] + a[i] * d[i]) ** 2 for i in range(n)) - e
rates = [c[i] * xi * d[i] / w for i in range(n)] + [h * xi / w]
means = [factor_terms(integrate(expand(r), (t, 0, 2 * pi)) / (2 * pi)) for r in rates]
print(time.perf_counter() - begin)
assert expand(means[0] + a[0] * c[0] * q[0] * x[0] / w) == 0
"""

OURS = """
import time
import extremum as es
from extremum import pi, s
places, n = {places}, {count}
begin = time.perf_counter()
loop = es.Loop(
    field=es.Quadratic(source=(0,) * n, q=(1.0,) * n),
    vehicle=es.PointMass(axes=(1 / s,) * n),
    controller=es.GradientES(frequency=10, washout=1.0, channels=tuple(
        es.Channel(dither=es.Dither(0.1, phase=0 if sine else -pi / 2), gain=5, ratio=m)
        for m, sine in places
    )),
    start=(0,) * n,
)
means = es.average(loop).rates
print(time.perf_counter() - begin)
x, a, c, q = ({{y.name: y for y in means[0].free_symbols}}[name.format("x" if n < 4 else "x1")]
              for name in ("{{}}tilde", "alpha_{{}}", "c_{{}}", "q_{{}}"))
assert (means[0] + a * c * q * x).expand() == 0
"""

PLACES = {
    "one frequency, quadrature (Fig. 1)": ((1, True), (1, False)),
    "2 : 3": ((2, True), (3, True)),
    "4 : 5 : 7": ((4, True), (5, True), (7, True)),
}


def averages(rounds: int) -> Table:
    """Compare averaging 1/s axes, fresh process, with SymPy's integral over τ."""
    taken: dict[str, dict[str, list[float]]] = {name: {"ours": [], "SymPy": []} for name in PLACES}
    for round_ in range(rounds + 1):
        for name, places in PLACES.items():
            for tool, program in (("ours", OURS), ("SymPy", SYMPY)):
                text = program.format(places=places, count=len(places))
                command = [sys.executable, "-c", text]
                done = subprocess.run(
                    command, env=environment(), capture_output=True, text=True, check=True
                )
                if round_:  # the first fills the file cache and writes bytecode
                    taken[name][tool].append(float(done.stdout))
    times = {
        name: {tool: Times(tuple(seconds)) for tool, seconds in tools.items()}
        for name, tools in taken.items()
    }
    rows = [
        (
            name,
            *tools["ours"].text(),
            *tools["SymPy"].text(),
            figure(tools["SymPy"].median / tools["ours"].median),
        )
        for name, tools in times.items()
    ]
    return Table(
        "The averaged equations, derived for the first time in a process; after the imports",
        ("axes 1/s", "ours (ms)", "range", "SymPy integrate (ms)", "range", "× ours"),
        rows,
        [
            f"{rounds} fresh processes each. Ours begins with the description and derives the",
            "relative coordinates; SymPy is given (7) to (9) in them, expanded, which helps it.",
        ],
        (),
        {n: {tool: t.data() for tool, t in tools.items()} for n, tools in times.items()},
    )
