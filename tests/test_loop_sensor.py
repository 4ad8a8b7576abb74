"""A sensor F(s) between the field and the controller: equations, runs, files and refusals."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated
from scipy.integrate import solve_ivp
from scipy.signal import tf2ss

import extremum as es
from extremum import s

SENSORS: dict[str, tuple[Any, tuple[list[float], list[float]]]] = {
    "a lag": ("1/(0.05*s + 1)", ([1], [0.05, 1])),
    "a slow one that halves": (es.Rational("k/(T*s + 1)", {"k": 0.5, "T": 2}), ([0.5], [2, 1])),
    "a ringing one": (6400 / (s**2 + 32 * s + 6400), ([6400], [1, 32, 6400])),
    "with a zero": ((3 * s + 7) / (s**2 + 2 * s + 5), ([3, 7], [1, 2, 5])),
    "an all-pass": ((1 - 0.02 * s) / (1 + 0.02 * s), ([-0.02, 1], [0.02, 1])),
    "a lead": (es.Lead(2, -3, -9), ([2, 6], [1, 9])),
    "one that passes no mean": (s / (s + 0.4), ([1, 0], [1, 0.4])),
    "a factor": (3, ([3], [1])),
}


def pade(delay: float, order: int) -> Any:
    """The diagonal Padé approximation of e^{−sT}."""
    n, terms = order, range(order + 1)
    c = [math.comb(n, k) * math.factorial(2 * n - k) / math.factorial(2 * n) for k in terms]
    above = "+".join(f"{c[k] * (-delay) ** k!r}*s**{k}" for k in terms)
    below = "+".join(f"{c[k] * delay**k!r}*s**{k}" for k in terms)
    return f"({above})/({below})"


# --- the equations -----------------------------------------------------------------------------


def test_the_equations_are_printed() -> None:
    sensor = es.Rational("1/(tau*s + 1)", parameters={"tau": 2.96})
    text = str(velocity_actuated(sensor=sensor).system)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    for line in (
        "J_s = ζ_J",
        "ξ = J_s - η",
        "dζ_J/dt = (J - ζ_J)/τ",
        "dη/dt = h (J_s - η)",
        "ζ_J(0) = J(0)",
        "η(0) = J_s(0)",
    ):
        assert line in lines


def test_no_sensor_is_as_nothing() -> None:
    plain = velocity_actuated()
    for one in (1, 1.0, "1", s / s, "(s + 2)/(s + 2)"):
        assert plain.replace({"sensor": one}) == plain
        assert plain.replace({"sensor": one}).system is plain.system
    assert "J_s" not in str(plain.system)


def test_a_changed_number_keeps_the_equations() -> None:
    loop = velocity_actuated(sensor="1/(2.96*s + 1)")
    other = loop.replace({"sensor": "1/(3*s + 1)", "controller.frequency": 40})
    assert other.system is loop.system
    assert other.system is not velocity_actuated().system
    assert {"sensor.gain", "sensor.den.0"} <= {p.path for p in loop.system.parameters}


@pytest.mark.parametrize("name", list(SENSORS))
def test_it_has_settled_on_the_signal_at_the_start(name: str) -> None:
    loop = velocity_actuated(sensor=SENSORS[name][0])
    system, values = loop.system, loop.values.tolist()
    start = system.start(values)
    rates = dict(zip(map(str, system.states), system.rates(0.0, start, values), strict=True))
    assert rates.pop("x") == pytest.approx(0.08 * 30)  # ξ(0) = 0: the probe alone
    assert list(rates.values()) == pytest.approx([0] * len(rates), abs=1e-12)


def test_its_letters_and_states_keep_clear_of_others() -> None:
    field = es.Expression(
        "1 - k*x**2 - p*y**2 - zeta_J*z**2", parameters={"k": 1, "p": 1, "zeta_J": 1}
    )
    loop = es.Loop(
        field=field,
        vehicle=es.PointMass(axes=(1 / s, 1 / s, 1 / s)),
        controller=es.GradientES(30, 1, tuple(es.Channel(es.Dither(0.1), 1) for _ in range(3))),
        start=(0, 0, 0),
        sensor=es.Lead(2, -3, -9),
    )
    names = [str(x) for x in (*loop.system.symbols, *loop.system.units)]
    assert len(set(names)) == len(names)


# --- runs --------------------------------------------------------------------------------------


def by_hand(
    loop: es.Loop, numbers: tuple[list[float], list[float]], times: np.ndarray
) -> np.ndarray:
    """The paper's Fig. 1 loop with a sensor in controllable canonical form, by SciPy's Radau."""
    A, B, C, D = tf2ss(*numbers)  # noqa: N806
    order = len(A) if len(numbers[1]) > 1 else 0
    A, B, C, D = A[:order, :order], B[:order, 0], C[0, :order], float(D[0, 0])  # noqa: N806

    def field(x: float, y: float) -> float:
        return 1 - (x + 1) ** 2 - 0.5 * (y + 1) ** 2

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        x, y, eta, sigma = state[0], state[1], state[2], state[3:]
        sensed = C @ sigma + D * field(x, y)
        xi = sensed - eta
        sine, cosine = np.sin(30 * t), np.cos(30 * t)
        moving = [2.4 * cosine + 10 * xi * sine, 2.4 * sine - 10 * xi * cosine]
        return np.concatenate([moving, [xi], A @ sigma + B * field(x, y)])

    sigma = -np.linalg.solve(A, B * field(1, 1)) if order else np.empty(0)
    begin = np.concatenate([[1, 1, C @ sigma + D * field(1, 1)], sigma])
    run = solve_ivp(rates, (0, times[-1]), begin, "Radau", times, rtol=1e-10, atol=1e-12)
    return run.y[:2].T


@pytest.mark.parametrize("engine", ["taylor", "reference"])
@pytest.mark.parametrize("name", list(SENSORS))
def test_a_run_agrees_with_one_written_by_hand(name: str, engine: str) -> None:
    given, numbers = SENSORS[name]
    loop, times = velocity_actuated(sensor=given), np.linspace(0, 2, 101)
    run = es.simulate(loop, 2.0, samples=times, engine=engine)
    found = by_hand(loop, numbers, times)
    assert run.position.values == pytest.approx(found, abs=2e-8)
    x, y = run.position.values.T  # J is the field's true value, not what is sensed
    assert run.J.values == pytest.approx(1 - (x + 1) ** 2 - 0.5 * (y + 1) ** 2, abs=1e-12)


def test_a_factor_is_undone_by_the_gains() -> None:
    halved = {f"controller.channels.{i}.gain": 5.0 for i in (0, 1)}
    ours = es.simulate(velocity_actuated(sensor=2, **halved), 3.0)
    theirs = es.simulate(velocity_actuated(), 3.0)
    assert ours.position.values == pytest.approx(theirs.position.values, abs=1e-9)


def delayed(delay: float, t_end: float) -> tuple[np.ndarray, np.ndarray]:
    """Fig. 1's loop near its source with J(t − T), by the method of steps; J(t < 0) = J(0)."""

    def field(state: np.ndarray) -> float:
        return 1 - (state[0] + 1) ** 2 - 0.5 * (state[1] + 1) ** 2

    def rates(t: float, state: np.ndarray, heard: Any) -> list[float]:
        xi = heard(t - delay) - state[2]
        sine, cosine = np.sin(30 * t - 1.2), np.cos(30 * t - 1.2)
        probes = 2.4 * np.cos(30 * t), 2.4 * np.sin(30 * t)
        return [probes[0] + 10 * xi * sine, probes[1] - 10 * xi * cosine, xi]

    state = np.array([-0.5, -0.6, 0.67])
    times, places, heard = [0.0], [state], lambda t: 0.67
    for k in range(round(t_end / delay)):
        span = (k * delay, (k + 1) * delay)
        run = solve_ivp(
            rates, span, state, "DOP853", dense_output=True, args=(heard,), rtol=1e-11, atol=1e-12
        )
        state = run.y[:, -1]
        times.append(span[1])
        places.append(state)
        heard = lambda t, sol=run.sol: field(sol(t))  # noqa: E731
    return np.array(times), np.array(places)


def test_a_pade_filter_is_a_delay() -> None:
    """T = 0.04 s is 1.2 rad of the dither; the difference falls with the order."""
    times, places = delayed(0.04, 4.0)
    corrected = {
        f"controller.channels.{i}.reference": es.Reference(phase - 1.2)
        for i, phase in enumerate((0.0, -math.pi / 2))
    }
    errors = []
    for order in (1, 2, 3, 5):
        loop = velocity_actuated(sensor=pade(0.04, order), start=(-0.5, -0.6), **corrected)
        run = es.simulate(loop, 4.0, samples=times)
        errors.append(np.abs(run.position.values - places[:, :2]).max())
    assert errors[-1] < 1e-4
    assert all(b < a / 3 for a, b in pairwise(errors))
    assert errors[0] > 0.01


# --- files and refusals ------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(SENSORS))
def test_it_comes_back_from_its_text(name: str) -> None:
    loop = force_actuated(sensor=SENSORS[name][0])
    scenario = es.Scenario(loop=loop, run=es.Run(t_end=1))
    text = es.format_scenario(scenario)
    assert es.parse_scenario(text) == scenario
    assert "sensor" not in es.format_scenario(es.Scenario(force_actuated(), es.Run(t_end=1)))


def test_it_is_a_key_at_the_top_of_a_file() -> None:
    text = es.format_scenario(es.Scenario(velocity_actuated(), es.Run(t_end=1)))
    read = es.parse_scenario(f'sensor = "1/(2.96*s + 1)"\n{text}')
    assert read.loop == velocity_actuated(sensor="1/(2.96*s + 1)")
    with pytest.raises(es.InvalidDescription, match=r"sensr: .*did you mean 'sensor'"):
        es.parse_scenario(f'sensr = "1/(2.96*s + 1)"\n{text}')


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("s", "sensor = 's': is improper"),
        ("(s**2 + 1)/(s + 1)", "is improper: its numerator's degree 2 exceeds its denominator's 1"),
        ("1/s", "its pole at 0 1/s does not decay"),
        ("1/(s - 1)", "its pole at 1 1/s does not decay"),
        ("1/(s**2 + 4)", "is not stable"),
        (es.Lead(1, 2, 2), "its pole at 2 1/s"),
        (es.Rational("1/(T*s + 1)", {"T": -1}), "every pole needs a negative real part"),
        (0, "would receive nothing of J; 1 is no sensor"),
        (es.Lead(0, -1, -2), "would receive nothing of J"),
        ("exp(-s)", "must be a rational function of s"),
        (None, "must be a rational expression of s"),
    ],
)
def test_what_cannot_sense_is_refused(given: Any, words: str) -> None:
    with pytest.raises(es.InvalidDescription) as refused:
        velocity_actuated(sensor=given)
    assert words in str(refused.value)
    assert str(refused.value).startswith("sensor")
