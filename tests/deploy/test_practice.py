"""What practice adds to a controller, each part against its own law."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

import extremum as es
from extremum import pi, s

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

DT = 1e-3
OMEGA, ALPHA, GAIN, WASHOUT = 30.0, 0.08, 10.0, 1.0


def controller(**changes: object) -> es.GradientES:
    """Return one for a single axis 1/s."""
    channel = {"dither": es.Dither(ALPHA, through=1 / s), "gain": GAIN} | changes
    return es.GradientES(frequency=OMEGA, washout=WASHOUT, channels=(es.Channel(**channel),))  # pyright: ignore[reportArgumentType]


def made(dt: float = DT, *, of: es.GradientES | None = None, **practice: object):
    return es.discretize(of or controller(), dt, practice=es.Practice(**practice))  # pyright: ignore[reportArgumentType]


def two(**practice: object) -> es.DiscreteController:
    of = controller().replace({"channels": controller().channels * 2})
    return made(DT, of=of, **practice)


def fed(ctrl: es.DiscreteController, samples: Sequence[float | None]) -> np.ndarray:
    """Return the first output at every sample."""
    return ctrl.run(samples)[:, 0]


def signal(count: int, size: float = 1.0, mean: float = 2.0) -> list[float]:
    times = DT * np.arange(count)
    return list(mean + size * np.sin(OMEGA * times) + 0.1 * size * np.sin(7.0 * times))


def probe(count: int) -> np.ndarray:
    return ALPHA * OMEGA * np.cos(OMEGA * DT * np.arange(count))


def seek(
    ctrl: es.DiscreteController, t_end: float, source=lambda t: 0.0, q: float = 1.0, x: float = 1.0
) -> tuple[np.ndarray, np.ndarray, object]:
    """Run a vehicle 1/s on J = −q (x − x*)²; return x, u and the state."""
    count = round(t_end / ctrl.dt)
    xs, us = np.empty(count), np.empty(count)
    state = ctrl.init(-q * (x - source(0.0)) ** 2)
    for k in range(count):
        xs[k] = x
        (us[k],), state = ctrl.step(state, -q * (x - source(k * ctrl.dt)) ** 2)
        x += ctrl.dt * us[k]
    return xs, us, state


# --- samples that do not count ----------------------------------------------------------------


@pytest.mark.parametrize("bad", [None, math.nan, math.inf, -math.inf, 1e300, 99.0, -99.0])
def test_xi_decays_while_samples_are_missing(bad: float | None) -> None:
    ctrl = made(validity=es.Validity(low=-50, high=50))
    before = signal(1000)
    state = ctrl.init(before[0])
    for sample in before:
        _, state = ctrl.step(state, sample)
    xi = state.xi_last
    assert abs(xi) > 0.1
    for k in range(1, 301):
        (u,), state = ctrl.step(state, bad)
        # Tustin's pole (1 − h/K)/(1 + h/K), K = ω/tan(ω dt/2), written otherwise
        warped = WASHOUT * math.tan(OMEGA * DT / 2) / OMEGA
        expected = xi * ((1 - warped) / (1 + warped)) ** k
        assert state.xi_last == pytest.approx(expected, rel=1e-12)
        angle = OMEGA * DT * (len(before) + k - 1)
        driven = ALPHA * OMEGA * math.cos(angle) + GAIN * expected * math.sin(angle)
        assert u == pytest.approx(driven, abs=1e-11)
    assert state.J_last == before[-1]
    assert state.age == 300


def test_bounds_belong_to_the_range() -> None:
    ctrl = made(validity=es.Validity(low=-50, high=50))
    state = ctrl.init(0.0)
    for sample, age in ((50.0, 0), (-50.0, 0), (50.0000001, 1), (-50.0000001, 2)):
        _, state = ctrl.step(state, sample)
        assert state.age == age


def test_the_output_fades_to_the_safe_one_and_comes_back_without_a_jump() -> None:
    fade, timeout = 0.5, 0.3
    validity = es.Validity(timeout=timeout, fade=fade, safe=(0.7,))
    ctrl = made(validity=validity)
    good, gone = signal(2000), 2000
    u = fed(ctrl, [*good, *[None] * gone, *(1e6 + j for j in good)])
    lost = u[len(good) :][:gone]
    assert np.all(lost[round((timeout + fade) / DT) + 5 :] == 0.7)
    assert abs(lost[round(timeout / DT) - 5] - 0.7) > 0.1
    # from one sample to the next: the dither's own, what ξ feeds back, and the fade of both
    size = np.abs(u[: len(good)]).max() + 0.7
    assert np.abs(np.diff(u[len(good) :])).max() < size * (OMEGA * DT + DT / fade) * 1.5
    back = u[len(good) + gone :]
    expected = probe(len(u))[len(good) + gone :]
    late = slice(round(fade / DT) + 5, None)
    assert np.abs(back[late] - expected[late]).max() < GAIN * 1.5  # not 1e6
    # the washout starts anew: what is fed back is that of a controller that begins there
    assert back[0] == pytest.approx(0.7, abs=size * DT / fade * 1.01)


@pytest.mark.parametrize("dt", [1e-3, 1.1e-3, 0.7e-3])
def test_a_gap_shorter_than_the_timeout_does_not_fade(dt: float) -> None:
    """However the times round."""
    count = 300
    ctrl = made(dt, validity=es.Validity(timeout=count * dt))
    samples = [*signal(500), *[None] * (count - 1), *signal(500)]
    assert np.array_equal(fed(ctrl, samples), fed(made(dt), samples))
    longer = [*signal(500), *[None] * count, *signal(500)]
    gone = fed(ctrl, longer) != fed(made(dt), longer)
    assert np.flatnonzero(gone)[0] == 500 + count - 1


@pytest.mark.parametrize("dt", [1e-3, 1.1e-3, 0.7e-3])
def test_a_sensor_is_stuck_when_it_repeats_for_longer_than_is_said(dt: float) -> None:
    ctrl = made(dt, validity=es.Validity(stuck=100 * dt))
    state, ages = ctrl.init(1.0), []
    for _ in range(105):
        _, state = ctrl.step(state, 1.0)
        ages.append(state.age)
    assert ages[:100] == [0] * 100
    assert ages[100:] == [1, 2, 3, 4, 5]


def test_a_stuck_sensor_counts_as_missing() -> None:
    ctrl = made(validity=es.Validity(stuck=0.1, timeout=0.2, fade=0.1, safe=(0.0,)))
    u = fed(ctrl, [*signal(500), *[1.25] * 1000, *signal(500)])
    assert np.all(u[500 + 410 : 1500] == 0.0)
    assert abs(u[500 + 290]) > 0.0
    assert np.abs(u[1700:]).max() > 1.0


def test_nothing_is_fed_back_before_the_first_good_sample() -> None:
    ctrl = made()
    u = fed(ctrl, [None, math.nan, math.inf, *[1e6] * 5])
    assert u == pytest.approx(probe(8), abs=1e-12)


def test_missing_samples_now_and_then_cost_hardly_any_gain() -> None:
    """At 40 % dropouts the averaged loop is as fast as without, e^(−αcq t)."""
    draw = np.random.default_rng(0)
    ctrl = made()
    x, count = 0.5, 4000
    state = ctrl.init(-(x**2))
    xs = np.empty(count)
    for k in range(count):
        xs[k] = x
        (u,), state = ctrl.step(state, None if draw.random() < 0.4 else -(x**2))
        x += DT * u
    period = round(2 * math.pi / OMEGA / DT)
    means = np.convolve(xs, np.ones(period) / period, "valid")
    rate = -np.polyfit(DT * np.arange(1500), np.log(means[:1500]), 1)[0]
    assert rate == pytest.approx(ALPHA * GAIN, rel=0.05)


@pytest.mark.parametrize("law", ["(s + 1)/(s - 10)", "(s + 1)/(s - 0.5)", "(s + 1)**2/s**2"])
@pytest.mark.parametrize("limits", [None, es.Limits(low=(-5.0,), high=(5.0,))])
def test_a_compensator_comes_back_from_a_long_outage(law: str, limits: es.Limits | None) -> None:
    """While λ is 0 it follows the safe output, whatever its own poles are."""
    of, validity = controller(compensator=law), es.Validity(timeout=0.3, fade=0.5)
    ctrl = made(of=of, validity=validity, limits=limits)
    good = [1.0 + 0.01 * math.sin(OMEGA * DT * k) for k in range(500)]
    u = fed(ctrl, [*good, *[None] * 90_000, *good])
    assert np.isfinite(u).all()
    assert np.all(u[90_000:90_500] == 0.0)
    before, after = np.abs(u[:500]).max(), np.abs(u[90_500:]).max()
    assert after < 2 * before


def test_nothing_is_sent_before_the_first_good_sample() -> None:
    ctrl = made(validity=es.Validity(timeout=0.3, fade=0.5, safe=(0.7,)))
    good = signal(300)
    u = fed(ctrl, [*[None] * 500, *good])
    assert np.all(u[:500] == 0.7)
    alone = probe(800)[500:]
    assert u[500] == pytest.approx(alone[0])
    assert ctrl.skip(ctrl.init(None), 5).age == ctrl.init(None).age


# --- limits -----------------------------------------------------------------------------------


def test_limits_and_rates_are_kept() -> None:
    limits = es.Limits(low=(-1.5,), high=(2.0,), rate=(40.0,))
    samples = [2.0 + 3.0 * math.cos(OMEGA * DT * k) for k in range(3000)]
    u = fed(made(limits=limits), samples)
    assert u.min() == -1.5
    assert u.max() == 2.0
    assert np.abs(np.diff(u)).max() == pytest.approx(40.0 * DT)
    free = fed(made(), samples)
    assert np.abs(np.diff(free)).max() > 60.0 * DT
    assert free.max() > 3.0


def test_a_fade_keeps_the_rate_and_begins_where_it_is_safe() -> None:
    limits, validity = es.Limits(rate=(40.0,)), es.Validity(timeout=0.1, fade=1e-3, safe=(1.5,))
    u = fed(made(limits=limits, validity=validity), [*signal(500), *[None] * 500, *signal(500)])
    assert u[0] == pytest.approx(1.54)
    assert np.abs(np.diff(u)).max() == pytest.approx(40.0 * DT)
    assert u[900] == 1.5


def test_limits_out_of_reach_change_nothing() -> None:
    lead = es.Lead(5.0, -0.5, -3.0)
    of = controller(compensator=lead, dither=es.Dither(ALPHA, through=1 / s**2))
    wide = es.Limits(low=(-1e6,), high=(1e6,), rate=(1e9,))
    samples = signal(2000)
    assert fed(made(of=of, limits=wide), samples) == pytest.approx(
        fed(made(of=of), samples), rel=1e-9
    )


@pytest.mark.parametrize("law", ["2/s", "3*(s + 1)/(s*(s + 4))", "(s + 2)**2/(s**2 + 0.1*s + 1)"])
def test_a_saturated_compensator_forgets_within_the_tracking_time(law: str) -> None:
    """Two states under the same limit come together as polynomials times e^(−t/T), whatever C."""
    tracking = 0.05
    of = controller(compensator=law)
    ctrl = made(
        of=of,
        limits=es.Limits(high=(-1e3,), low=(-1e3 - 1e-9,), tracking=tracking),
        validity=es.Validity(safe=(-1e3,)),
    )
    samples = signal(2000)
    state = ctrl.init(samples[0])
    first = {name: 5.0 for name in state._fields if name.startswith("zeta")}
    one, other = state, state._replace(**first)
    gaps = []
    for sample in samples[:400]:
        (u,), one = ctrl.step(one, sample)
        (v,), other = ctrl.step(other, sample)
        assert u == pytest.approx(-1e3) == v
        gaps.append(max(abs(getattr(one, n) - getattr(other, n)) for n in first))
    order = len(first)
    late = np.array(gaps[200:])
    times = DT * np.arange(200, 400)
    # e^(−t/T) t^(order − 1): divide the power off
    slope = np.polyfit(times, np.log(late / times ** (order - 1)), 1)[0]
    assert slope == pytest.approx(-1 / tracking, rel=0.05)


def test_anti_windup_lets_an_integrator_turn_back_at_once() -> None:
    of = controller(compensator="4/s", gain=20.0)
    there = [math.sin(OMEGA * DT * k) for k in range(3000)]
    back = [-math.sin(OMEGA * DT * k) for k in range(3000, 6000)]

    def turning(tracking: float | None) -> float:
        limits = es.Limits(low=(-3.0,), high=(3.0,), tracking=tracking)
        u = fed(made(of=of, limits=limits), there + back)
        assert u[2500:3000].max() == 3.0
        turned = np.flatnonzero(u[3000:] < -1.0)
        return DT * turned[0] if len(turned) else math.inf

    assert turning(None) < 0.25
    assert turning(1e5) > 2.0


# --- scales -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [es.LogScale(1e-9), es.RunningScale(1.0, 1e-12)])
def test_the_signals_scale_does_not_matter(scale: es.Scale) -> None:
    ctrl = made(scale=scale)
    samples = signal(3000, size=0.5)
    assert fed(ctrl, [300.0 * j for j in samples]) == pytest.approx(fed(ctrl, samples), abs=1e-9)
    assert np.abs(fed(ctrl, samples) - probe(3000)).max() > 0.5
    other = fed(made(), [300.0 * j for j in samples]) - fed(made(), samples)
    assert np.abs(other).max() > 100.0


def test_a_log_scale_divides_the_gain_by_the_signal() -> None:
    """J = 5 − q x̃² near its peak is ln J = ln 5 − (q/5) x̃²: the rate is α c q/5."""
    ctrl = made(scale=es.LogScale(1e-3))
    x, count = 0.3, 6000
    state, xs = ctrl.init(5 - 2 * x**2), np.empty(count)
    for k in range(count):
        xs[k] = x
        (u,), state = ctrl.step(state, 5 - 2 * x**2)
        x += DT * u
    assert _rate(xs) == pytest.approx(ALPHA * GAIN * 2 / 5, rel=0.05)


def test_below_the_floor_the_logarithm_is_flat() -> None:
    ctrl = made(scale=es.LogScale(0.5))
    u = fed(ctrl, [0.4 * math.sin(OMEGA * DT * k) for k in range(1000)])
    assert u == pytest.approx(probe(1000), abs=1e-12)


def _rate(xs: np.ndarray, begin: float = 0.5, end: float = 2.5) -> float:
    """Return how fast the mean over a period decays (1/s)."""
    period = round(2 * math.pi / OMEGA / DT)
    means = np.convolve(xs, np.ones(period) / period, "valid")
    part = slice(round(begin / DT), round(end / DT))
    times = DT * np.arange(len(means))[part]
    return -np.polyfit(times, np.log(np.abs(means[part])), 1)[0]


@pytest.mark.parametrize("q", [0.3, 30.0])
def test_a_running_scale_moves_at_one_speed_and_converges_at_one_rate(q: float) -> None:
    gain, floor = 0.05, 1e-6
    ctrl = made(of=controller(gain=gain), scale=es.RunningScale(2.0, floor))
    far, _, _ = seek(ctrl, 12.0, q=q, x=50.0)
    times = DT * np.arange(len(far))
    speed = -np.polyfit(times[6000:], far[6000:], 1)[0]
    drift, half = ALPHA**2 / 2, (gain * ALPHA / 2) ** 2  # v² (drift + v²/h²) = half
    expected = math.sqrt((-drift + math.sqrt(drift**2 + 4 * half / WASHOUT**2)) / 2) * WASHOUT
    assert expected < 0.9 * gain / math.sqrt(2)
    assert speed == pytest.approx(expected, rel=0.03)
    ctrl = made(of=controller(gain=gain), scale=es.RunningScale(0.4, floor))
    near, _, _ = seek(ctrl, 12.0, q=q, x=0.02)
    settled = near - near[-round(20 * math.pi / OMEGA / DT) :].mean()
    assert _rate(settled, 1.2, 2.2) == pytest.approx(2 * math.sqrt(2) * gain / ALPHA, rel=0.1)


# --- changes, delays, dithers, verdicts -------------------------------------------------------


def test_a_changed_gain_comes_without_a_jump_and_then_holds() -> None:
    time = 0.25
    ctrl = made(changes=es.Changes(time))
    samples = signal(4000)
    state, us = ctrl.init(samples[0]), []
    for k, sample in enumerate(samples):
        if k == 1000:
            state = ctrl.change(state, gain=3.0, amplitude=0.5)
        (u,), state = ctrl.step(state, sample)
        us.append(u)
    u, plain = np.array(us), fed(made(), samples)
    assert u[:1000] == pytest.approx(plain[:1000], abs=1e-12)
    share = 1 - np.exp(-DT * np.arange(3000) / time)
    fed_back = plain - probe(4000)
    gain, amplitude = 1 + 2 * share, 1 - 0.5 * share
    expected = gain * fed_back[1000:] + amplitude * probe(4000)[1000:]
    assert u[1000:] == pytest.approx(expected, abs=1e-9)


def test_references_lag_by_what_hold_delay_and_lag_take() -> None:
    """A signal that is late by dt/2 + T and a lag is demodulated whole; the quadrature is 0."""
    delay, lag = 0.011, 0.02
    late = OMEGA * (DT / 2 + delay) + math.atan(OMEGA * lag)
    of = es.GradientES(
        frequency=OMEGA,
        washout=0.01,
        channels=(
            es.Channel(es.Dither(1e-9, through=1 / s), gain=2.0),
            es.Channel(es.Dither(1e-9, phase=-pi / 2, through=1 / s), gain=2.0),
        ),
    )
    ctrl = es.discretize(of, DT, practice=es.Practice(delay=delay, lag=lag))
    count = round(20 * math.pi / OMEGA / DT)
    samples = [math.sin(OMEGA * k * DT - late) for k in range(4 * count)]
    u = ctrl.run(samples)[-count:].mean(axis=0)
    assert u[0] == pytest.approx(1.0, rel=1e-3)
    assert u[1] == pytest.approx(0.0, abs=2e-3)


def test_a_dither_shrinks_at_the_source_and_grows_when_it_moves() -> None:
    practice = es.ShrinkingDither(full=0.1, least=0.2, shrink=3.0, grow=0.5, response=0.5)
    ctrl = made(of=controller(gain=8.0), dither=practice)
    xs, us, _ = seek(ctrl, 45.0, source=lambda t: 0.0 if t < 30 else 0.5, x=0.4)
    swing = [np.ptp(xs[round(t / DT) :][:210]) / 2 for t in (3.0, 29.0, 31.0)]
    assert swing[1] == pytest.approx(0.2 * ALPHA, rel=0.1)
    assert swing[2] > 2 * swing[1]
    assert abs(np.mean(xs[-210:]) - 0.5) < 0.03  # with the smaller dither it is slow
    assert np.isfinite(us).all()


def test_the_verdict_is_seeking_then_arrived_then_lost_then_seeking() -> None:
    radius = 0.05
    detector = es.Detector(level=2 * ALPHA * radius, time=1.0, response=0.5)
    ctrl = made(detector=detector, validity=es.Validity(timeout=0.5))
    x, state, seen = 1.0, ctrl.init(-1.0), []
    for k in range(24000):
        time = k * DT
        source = 0.0 if time < 18 else 0.7
        sample = None if 12 < time < 14 else -((x - source) ** 2)
        (u,), state = ctrl.step(state, sample)
        x += DT * u
        verdict = ctrl.status(state)
        if not seen or seen[-1][1] != verdict:
            seen.append((time, verdict, x))
    assert [verdict for _, verdict, _ in seen] == [
        "seeking",
        "arrived",
        "lost",
        "arrived",
        "seeking",
        "arrived",
    ]
    assert abs(seen[1][2]) < radius + ALPHA
    assert seen[1][0] > 1.0 + math.log(1 / radius) / (ALPHA * GAIN) * 0.8
    assert 12.5 <= seen[2][0] < 12.6
    assert 14.0 <= seen[3][0] < 14.1
    assert 18.0 < seen[4][0] < 18.6


def test_nothing_known_is_not_arrived() -> None:
    """A dead sensor, a start far away, and a dither that still grows."""
    detector = es.Detector(level=0.1, time=0.3, response=1.0)
    dead = made(detector=detector)
    state = dead.init(1.0)
    for _ in range(20_000):
        _, state = dead.step(state, None)
    assert dead.status(state) == "seeking"
    for of in (controller(gain=0.0), controller(gain=0.0).replace({"probe_ramp": 3.0})):
        far = made(of=of, detector=detector)
        x, state = 5.0, far.init(-25.0)
        for _ in range(10_000):  # A = 2 α q x = 0.8
            (u,), state = far.step(state, -(x**2))
            x += DT * u
            assert far.status(state) == "seeking"


def test_the_detectors_level_is_that_of_the_full_dither() -> None:
    """J = −x at a slope of 1: A = α, whatever factor the amplitude has."""
    detector = es.Detector(level=1.0, time=1.0, response=0.5)
    ctrl = made(of=controller(gain=0.0), detector=detector, changes=es.Changes(0.3))
    for factor in (1.0, 0.25):
        state = ctrl.change(ctrl.init(0.0), amplitude=factor)
        x = 0.0
        for _ in range(8000):
            (u,), state = ctrl.step(state, -x)
            x += DT * u
        seen = 2 * abs(state.A_1) / factor
        assert seen == pytest.approx(ALPHA * OMEGA / math.hypot(OMEGA, WASHOUT), rel=0.04)


def test_a_running_scale_has_no_kick() -> None:
    """|ν| ≤ √2 for a sine once its size is known; at the start and after a gap hardly more."""
    ctrl = made(of=controller(gain=1.0), scale=es.RunningScale(2.0, 1e-9))
    sine = [math.sin(OMEGA * DT * k) for k in range(4000)]
    u = fed(ctrl, [*sine, *[None] * 15_000, *sine])
    driven = np.abs(u - probe(len(u)))
    assert driven[2000:4000].max() == pytest.approx(math.sqrt(2), rel=0.05)
    assert driven.max() < 3.0


def test_a_small_signal_on_a_logarithmic_scale_is_not_stuck() -> None:
    """Below the floor its logarithm repeats, the samples do not."""
    ctrl = made(scale=es.LogScale(1.0), validity=es.Validity(stuck=0.1))
    state = ctrl.init(0.5)
    for k in range(500):
        _, state = ctrl.step(state, 0.5 + 0.1 * math.sin(0.1 * k))
        assert state.age == 0
    for _ in range(105):
        _, state = ctrl.step(state, 0.5)
    assert state.age > 0


def test_a_signal_in_the_background_is_lost() -> None:
    """The mean counts, η = J − ξ: a step of J is at first all ξ."""
    ctrl = made(detector=es.Detector(level=0.1, time=1.0, response=0.3, background=0.5))
    state = ctrl.init(1.0)
    for sample, before, after in ((1.0, "seeking", "arrived"), (0.2, "arrived", "lost")):
        _, state = ctrl.step(state, sample)
        assert ctrl.status(state) == before
        for _ in range(4000):
            _, state = ctrl.step(state, sample)
        assert ctrl.status(state) == after


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: es.Validity(low=2, high=1), "Validity.low = 2.0: must be less than high = 1.0"),
        (lambda: es.Validity(timeout=-1), "Validity.timeout"),
        (lambda: made(validity=es.Validity(timeout=1e4)), "practice.validity.timeout = 10000.0"),
        (lambda: made(validity=es.Validity(stuck=1e4)), "is 1e+07 samples; at most 8388608"),
        (lambda: made(detector=es.Detector(1, 1e4, 1)), "practice.detector.time = 10000.0"),
        (lambda: es.Validity(low=2e18), "must be less than all samples = 1e+18"),
        (lambda: made(changes=es.Changes(0.2)), "practice.changes.time = 0.2: must be longer"),
        (
            lambda: made(of=controller(compensator="1/(s - 3000)")),
            "controller.channels.0.compensator = 1/(s - 3000.0): is faster than its samples",
        ),
        (lambda: es.Limits(), "limits nothing"),
        (lambda: es.Limits(low=(1.0,), high=(0.0,)), "must be less than high.0"),
        (lambda: es.Limits(low=(1.0,), high=(2.0, 3.0)), "one number per input"),
        (lambda: es.Limits(rate=(0.0,)), "greater than 0"),
        (lambda: es.RunningScale(1.0, 1e-20), "its square is 0"),
        (lambda: es.Practice(delay=-1e-3), "must not be negative"),
        (lambda: es.Practice(lag=0.1), "must be given with a lag"),
        (lambda: es.ShrinkingDither(1, 1.5, 9, 9, 9), "must be less than 1"),
        (
            lambda: es.Practice(
                dither=es.ShrinkingDither(1, 0.5, 9, 9, 9), scale=es.RunningScale(1, 1)
            ),
            "RunningScale",
        ),
        (lambda: made(limits=es.Limits(high=(1.0, 2.0))), "practice.limits.high"),
        (lambda: two(limits=es.Limits(low=(-9.0,))), "practice.limits.low = (-9.0,): has 1"),
        (lambda: two(validity=es.Validity(timeout=1, safe=(0.0,))), "has 1 entries for 2"),
        (lambda: made(limits=es.Limits(high=(-1.0,))), "practice.validity.safe = 0.0"),
        (lambda: made(validity=es.Validity(safe=(0, 0))), "practice.validity.safe"),
        (lambda: made(detector=es.Detector(1, 1, 0.1)), "slowest dither's period, 0.2094 s"),
        (lambda: made(dither=es.ShrinkingDither(1, 0.5, 9, 0.1, 9)), "practice.dither.grow"),
    ],
)
def test_what_cannot_be_is_refused(build, message: str) -> None:
    with pytest.raises(es.InvalidDescription) as caught:
        build()
    assert message in str(caught.value)


def test_a_pole_that_will_ring_is_warned_of() -> None:
    with pytest.warns(UserWarning, match=r"its pole at -100000 1/s is faster than the samples"):
        made(of=controller(compensator="(s + 1)/(1e-5*s + 1)"))


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        (es.Limits(high=(2.3,)), "high.0 cuts the probe, whose amplitude is 2.4"),
        (es.Limits(low=(-2.3,)), "low.0 cuts"),
        (es.Limits(rate=(71.0,)), "rate.0 cuts"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_limits_that_cut_the_probe_are_warned_of(limits: es.Limits, name: str) -> None:
    with pytest.warns(UserWarning, match=name.replace(".", r"\.")):
        made(limits=limits)
    made(limits=es.Limits(low=(-2.4,), high=(2.4,), rate=(72.0,)))
