"""What a sensor makes of J, against SciPy and statistics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import sympy
from loops import velocity_actuated
from scipy.integrate import solve_ivp
from scipy.signal import lfilter, lfilter_zi

import extremum as es
from extremum import s
from extremum.sampled.diagram import SampledDiagram


def still(**changes: Any) -> es.Loop:
    """A loop without feedback: the vehicle only follows its probes, whatever is sensed."""
    channels = {f"controller.channels.{i}.gain": 0 for i in (0, 1)}
    return velocity_actuated(**channels, **changes)


def sensed(sensor: es.Sensor, t_end: float = 1.0, dt: float = 1e-3, **options: Any) -> Any:
    return es.simulate_sampled(still(), dt, t_end, sensor=sensor, **options)


# --- lag --------------------------------------------------------------------------------------


def stepped(lag: es.Lag, z: float, begin: float, end: float, time: float) -> float:
    """What `Lag.follow` draws, with numbers."""
    diagram = SampledDiagram(sympy.Float(time))
    numbers = map(sympy.Float, (z, begin, end, time))
    lag.follow(diagram, "z", *numbers)
    known: dict[Any, Any] = {}
    for symbol, expression in diagram.signals:
        law = expression.subs(known)
        known[symbol] = sympy.Float(sympy.lambdify([], law, "math")())
    return float(known[sympy.Symbol("z", real=True)])


def integrated(rise: float, decay: float, z: float, begin: float, end: float, time: float) -> float:
    """ż = (J − z)/τ by SciPy, stopped where z meets J."""

    def rates(s: float, z: Any, tau: float) -> Any:
        return (begin + (end - begin) * s / time - z) / tau

    def meets(s: float, z: Any, tau: float) -> Any:
        return begin + (end - begin) * s / time - z[0]

    meets.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    gap = begin - z or end - begin
    now, tau, events = 0.0, rise if gap > 0 else decay, meets if begin != z else None
    options: Any = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853"}
    run = solve_ivp(rates, (0, time), [z], args=(tau,), events=events, **options)
    if run.status == 1:
        now, z = run.t[-1], run.y[0, -1]
        other = decay if tau == rise else rise
        run = solve_ivp(rates, (now, time), [z], args=(other,), **options)
    return float(run.y[0, -1])


LAGS = [
    (0.3, 1.2, 0.0, 1.0, 2.0, 0.5),  # rises
    (0.3, 1.2, 2.0, 1.0, 0.0, 0.5),  # decays
    (0.3, 1.2, 0.0, 0.2, -3.0, 0.5),  # rises, then decays
    (0.3, 1.2, 0.0, -0.2, 3.0, 0.5),  # decays, then rises
    (0.3, 1.2, 1.0, 1.0, 2.0, 0.5),  # begins on J
    (0.3, 1.2, 1.0, 1.0, 0.0, 0.5),
    (0.3, 1.2, 1.0, 1.0, 1.0, 0.5),  # rests
    (0.01, 3.0, 0.0, 1.0, -1.0, 0.5),  # one much slower
    (3.0, 0.01, 0.0, 1.0, -1.0, 0.5),
    (0.4, 0.4, 0.0, 1.0, -1.0, 0.5),
]


@pytest.mark.parametrize("case", LAGS)
def test_a_lag_is_solved_exactly_for_a_straight_line(case: tuple[float, ...]) -> None:
    rise, decay, *rest = case
    expected = integrated(rise, decay, *rest)
    assert stepped(es.Lag(rise, decay), *rest) == pytest.approx(expected, abs=1e-10)
    if rise == decay:
        assert stepped(es.Lag(rise), *rest) == pytest.approx(expected, abs=1e-10)


def test_a_gas_sensor_hears_one_per_cent_of_the_dither() -> None:
    """1/(jωτ + 1) at 30 rad/s and 2.96 s: 1.1 per cent, −89.4°. J = x = sin 30 t here."""
    loop = es.Loop(
        field=es.Expression("x"),
        vehicle=es.PointMass(axes=(1 / s,)),
        controller=es.GradientES(
            frequency=30, washout=1, channels=(es.Channel(es.Dither(1.0), gain=0),)
        ),
        start=(0,),
    )
    run = es.simulate_sampled(loop, 1e-3, 12.0, sensor=es.Sensor(lag=2.96))
    time = run.time.values
    waves = np.stack([np.sin(30 * time), np.cos(30 * time)], axis=-1)
    rest = np.stack([np.ones_like(time), np.exp(-time / 2.96)], axis=-1)

    def phasor(signal: np.ndarray) -> complex:
        a, b, *_ = np.linalg.lstsq(np.hstack([waves, rest]), signal, rcond=None)[0]
        return complex(a, b)

    passed = phasor(run.sensed.values) / phasor(run.J.values)
    assert passed == pytest.approx(1 / (1j * 30 * 2.96 + 1), abs=2e-6)
    assert abs(passed) == pytest.approx(0.0113, abs=5e-5)
    assert math.degrees(np.angle(passed)) == pytest.approx(-89.36, abs=0.01)


@pytest.mark.parametrize(
    ("lag", "rise", "decay"),
    [(es.TGS2620, 2.96, 15.71), (es.TGS2600, 4.8, 18.75), (es.TGS2611, 3.44, 6.35)],
)
def test_unequal_rise_and_decay_rectify(lag: es.Lag, rise: float, decay: float) -> None:
    """What falls slowly stays too high; solved by SciPy along the exact J."""
    assert (lag.rise, lag.decay) == (rise, decay)
    run = sensed(es.Sensor(lag=lag), 2.0)
    assert run.sensed.values == pytest.approx(heard(run, rise, decay, 0.0), abs=2e-6)
    even = sensed(es.Sensor(lag=rise), 2.0)
    assert run.sensed[-210:].mean() > even.sensed[-210:].mean() + 1e-3


def heard(run: Any, rise: float, decay: float, delay: float) -> np.ndarray:
    """The lag's output at t_k − delay: the vehicle moves in straight lines between samples."""
    times, places = run.time.values, run.position.values

    def rates(time: float, z: Any) -> Any:
        x, y = (np.interp(time, times, places[:, i]) for i in (0, 1))
        gap = 1 - (x + 1) ** 2 - 0.5 * (y + 1) ** 2 - z
        return gap / np.where(gap > 0, rise, decay)

    options: Any = {"max_step": 2e-3, "rtol": 1e-9, "atol": 1e-10, "dense_output": True}
    solution = solve_ivp(rates, (0, times[-1]), [-5.0], **options)
    return solution.sol(np.maximum(times - delay, 0))[0]


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.007, 0.0074])
@pytest.mark.parametrize("decay", [0.05, 0.2])
def test_a_lag_before_a_delay_is_the_lag_late(decay: float, delay: float) -> None:
    run = sensed(es.Sensor(lag=es.Lag(0.05, decay), delay=delay), 0.5)
    assert run.sensed.values == pytest.approx(heard(run, 0.05, decay, delay), abs=2e-5)
    before = run.time.values <= delay + 1e-9
    assert np.all(run.sensed.values[before] == -5)


# --- delay ------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.0, 0.0003, 0.001, 0.0025, 0.0070, 0.0499])
@pytest.mark.parametrize("moving", [False, True])
def test_a_delay_shifts_the_signal(delay: float, moving: bool) -> None:
    """A velocity-actuated vehicle moves in straight lines between samples, its field as well."""
    field: Any = es.Quadratic((0, 0), (1.0, 0.5), peak=1.0)
    loop = still(field=es.Moving(field, es.Circle(0.5, 2.0)) if moving else field)
    run = es.simulate_sampled(loop, 1e-3, 0.8, sensor=es.Sensor(delay=delay))
    time = run.time.values
    then = np.maximum(time - delay, 0)
    x, y = (np.interp(then, time, run.position.values[:, i]) for i in (0, 1))
    if moving:
        x, y = x - 0.5 * np.cos(2 * then), y - 0.5 * np.sin(2 * then)
    assert run.sensed.values == pytest.approx(1 - x**2 - 0.5 * y**2, abs=1e-12)


# --- F(s) -------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [None, 0.0042])
def test_the_loops_own_sensor_is_its_bilinear_filter(delay: float | None) -> None:
    """F(s) = 1/(0.02 s + 1): s → K (z − 1)/(z + 1), settled on J(0)."""
    loop = still(sensor=1 / (0.02 * s + 1))
    run = es.simulate_sampled(loop, 1e-3, 0.6, sensor=es.Sensor(delay=delay))
    late = es.simulate_sampled(still(), 1e-3, 0.6, sensor=es.Sensor(delay=delay)).sensed.values
    warped = 0.02 * 30 / math.tan(30 * 1e-3 / 2)
    b, a = np.array([1.0, 1.0]), np.array([1 + warped, 1 - warped])
    filtered, _ = lfilter(b, a, late, zi=lfilter_zi(b, a) * late[0])
    assert run.sensed.values == pytest.approx(filtered, abs=1e-11)


# --- noise ------------------------------------------------------------------------------------


def test_white_noise_is_white() -> None:
    run = sensed(es.Sensor(noise=0.6), 40.0, seed=1)
    noise = (run.sensed - run.J).values
    count = len(noise)
    assert noise.mean() == pytest.approx(0, abs=5 * 0.6 / math.sqrt(count))
    assert noise.std() == pytest.approx(0.6, rel=5 / math.sqrt(2 * count))
    for lag in (1, 2, 7):
        assert abs(np.corrcoef(noise[lag:], noise[:-lag])[0, 1]) < 5 / math.sqrt(count)


def test_coloured_noise_remembers_and_is_stationary_from_the_start() -> None:
    sensor = es.Sensor(coloured=es.ColouredNoise(0.5, 0.03))
    many = 2000
    sampled = es.SampledLoop.of(still(), es.Sampling(1e-3, sensor))
    over = {"sampling.seed": np.arange(many)}
    ends = [es.ensemble(sampled, steps * 1e-3, over=over).n_before for steps in (1, 2, 51)]
    for noise in ends:  # the noise of the last sample but one
        assert noise.std() == pytest.approx(0.5, rel=5 / math.sqrt(2 * many))
    near, far = (np.corrcoef(ends[0], other)[0, 1] for other in ends[1:])
    assert near == pytest.approx(math.exp(-1e-3 / 0.03), abs=0.01)
    assert far == pytest.approx(math.exp(-50e-3 / 0.03), abs=5 / math.sqrt(many))
    run = sensed(sensor, 60.0, seed=2)
    noise = (run.sensed - run.J).values
    for lag in (1, 10, 30):
        expected = math.exp(-lag * 1e-3 / 0.03)
        assert np.corrcoef(noise[lag:], noise[:-lag])[0, 1] == pytest.approx(expected, abs=0.06)


def test_white_and_coloured_noise_and_dropout_are_independent() -> None:
    both = es.Sensor(noise=0.5, coloured=es.ColouredNoise(0.5, 1e-9), dropout=0.5)
    apart = (es.Sensor(noise=0.5), es.Sensor(coloured=es.ColouredNoise(0.5, 1e-9)))
    white, coloured = ((r.sensed - r.J).values for r in (sensed(x, 20.0) for x in apart))
    sums = sensed(both, 20.0)
    lost = np.isnan(sums.sensed.values)
    total = (sums.sensed - sums.J).values
    assert total[~lost] == pytest.approx((white + coloured)[~lost], abs=1e-12)
    limit = 5 / math.sqrt(len(white))
    assert abs(np.corrcoef(white, coloured)[0, 1]) < limit
    assert abs(np.corrcoef(lost, white)[0, 1]) < limit
    assert abs(np.corrcoef(lost, coloured)[0, 1]) < limit


@pytest.mark.parametrize(("dropout", "slack"), [(0.0, 0.0), (0.1, 0.011), (1.0, 0.0)])
def test_samples_are_lost_with_their_probability(dropout: float, slack: float) -> None:
    run = sensed(es.Sensor(dropout=dropout), 20.0)
    lost = np.isnan(run.sensed.values)
    assert lost.mean() == pytest.approx(dropout, abs=slack)
    assert np.array_equal(run.sensed.values[~lost], run.J.values[~lost])
    assert np.isfinite(run.position).all()


def test_the_range_cuts_off_and_steps_are_multiples() -> None:
    run = sensed(es.Sensor(low=-5.1, high=-4.9))
    assert np.array_equal(run.sensed, np.clip(run.J, -5.1, -4.9))
    assert (run.sensed == -5.1).any()
    assert (run.sensed == -4.9).any()
    run = sensed(es.Sensor(step=0.05))
    assert run.sensed.values == pytest.approx(0.05 * np.rint(run.J.values / 0.05), abs=1e-12)
    one = sensed(es.Sensor(low=-5.1))
    assert np.array_equal(one.sensed, np.maximum(one.J, -5.1))


def test_noise_is_added_before_the_range_and_the_range_before_the_steps() -> None:
    run = sensed(es.Sensor(noise=0.6, low=-5.13, high=-4.92, step=0.1))
    values = np.unique(np.round(run.sensed.values, 9))
    assert values == pytest.approx([-5.1, -5.0, -4.9])
