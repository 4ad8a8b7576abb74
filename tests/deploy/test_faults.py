"""Bad samples, time jumps and stalls: outputs stay numbers within their limits, the state recovers.

The vehicle, two integrators, and the field are written out here; nothing of the package but the
discrete controller is run.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as some
from loops import force_actuated, velocity_actuated

import extremum as es

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

DT: Final = 0.01
GAIN, AMPLITUDE, Q = 5.0, 0.08, (1.0, 0.5)
LOW, HIGH = -200.0, 1.5
"""Samples that are believed; the field's peak is 1."""
BOUND: Final = 4.0
"""Of each input (m/s)."""
TIMEOUT, FADE = 1.0, 0.5
CALM: Final = 2.0
"""Time of calm that the detector asks for (s)."""


def seeker(**changes: Any) -> Any:
    """Return Fig. 4's controller with half its gain, guarded as one would guard it."""
    gains = {f"controller.channels.{i}.gain": GAIN for i in range(2)}
    loop = velocity_actuated(**gains)
    options = {
        "validity": es.Validity(low=LOW, high=HIGH, stuck=0.2, timeout=TIMEOUT, fade=FADE),
        "limits": es.Limits(low=(-BOUND,) * 2, high=(BOUND,) * 2),
        "detector": es.Detector(level=0.05, time=CALM, response=1.0),
    }
    practice = es.Practice(**{**options, **changes})
    return es.discretize(loop.controller, DT, practice=practice, vehicle=loop.vehicle)


# --- hours of faults ---------------------------------------------------------------------------

Sample = Callable[[random.Random, float], Any]
"""From the true J to what the sensor says."""


def _huge(rng: random.Random, true: float) -> float:
    return rng.choice((1, -1)) * 10 ** rng.uniform(5, 308)


FAULTS: Final[dict[str, Sample]] = {
    "NaN": lambda rng, true: math.nan,
    "nothing": lambda rng, true: None,
    "every other lost": lambda rng, true: rng.choice((true, None)),
    "infinite": lambda rng, true: rng.choice((math.inf, -math.inf)),
    "spikes out of range": lambda rng, true: rng.choice((true, true, 1e3, -1e6)),
    "huge": _huge,
    "wrong within range": lambda rng, true: rng.uniform(-30, 1.4),
}
KINDS: Final = (*FAULTS, "stuck", "stall", "time jump")
LONGEST: Final = {"wrong within range": 0.5}
"""Seconds; nobody can tell such samples from good ones."""

DRIFT: Final = 3.0
"""Distance (m) that what a fault left in the washout may drive the vehicle."""
NEAR: Final = 0.3
"""Distance (m) from the source that counts as recovered; the dither alone is 0.08."""


def patience(distance: float) -> float:
    """Return the time (s) in which the vehicle must be back near the source.

    The output fades in, the washout forgets within 5/h, and the averaged loop converges with its
    slowest rate c α q from wherever that has taken the vehicle; half as long again for the
    nonlinear part far away.
    """
    rate = GAIN * AMPLITUDE * min(Q)
    return FADE + 5.0 + 1.5 * math.log((distance + DRIFT) / (NEAR - AMPLITUDE)) / rate


@dataclass(frozen=True)
class Fault:
    kind: str
    length: float
    distance: float
    """From the source when it ended (m)."""
    status: str
    after: float
    """From the source when the patience was over, the largest of two dither periods (m)."""
    status_after: str


def faults(controller: Any, seconds: float, seed: int) -> Iterator[Fault]:
    """Run the closed loop and yield what became of each fault."""
    rng = random.Random(seed)
    step = controller.step
    x, y, u, v = 1.0, 1.0, 0.0, 0.0
    state = controller.init(math.nan)

    def run(steps: int, bad: Sample | None, value: float = 0.0) -> float:
        nonlocal x, y, u, v, state
        farthest = 0.0
        for _ in range(steps):
            sample = 1 - Q[0] * (x + 1) ** 2 - Q[1] * (y + 1) ** 2
            if bad is not None:
                sample = bad(rng, sample)
            (u, v), state = step(state, sample)
            assert -BOUND <= u <= BOUND, (u, sample)  # False for NaN too
            assert -BOUND <= v <= BOUND, (v, sample)
            x += u * DT
            y += v * DT
            farthest = max(farthest, math.hypot(x + 1, y + 1))
        return farthest

    elapsed, left = 0.0, list[str]()
    while elapsed < seconds:
        left = left or rng.sample(KINDS, len(KINDS))
        kind = left.pop()
        length = rng.uniform(DT, LONGEST.get(kind, 5.0))
        if kind == "stall":  # the program stands still, the vehicle goes on with its last input
            length = rng.uniform(DT, 0.3)
            steps = round(length / DT)
            x, y = x + u * steps * DT, y + v * steps * DT
            state = controller.skip(state, steps)
        elif kind == "time jump":
            length = 0.0
            state = controller.skip(state, rng.randrange(10**9))
        elif kind == "stuck":
            stuck = 1 - Q[0] * (x + 1) ** 2 - Q[1] * (y + 1) ** 2
            run(round(length / DT), lambda rng, true, stuck=stuck: stuck)
        else:
            run(round(length / DT), FAULTS[kind])
        distance, status = math.hypot(x + 1, y + 1), controller.status(state)
        wait = patience(distance)
        run(round(wait / DT), None)
        after = run(42, None)
        run(round(CALM / DT), None)
        yield Fault(kind, length, distance, status, after, controller.status(state))
        elapsed += length + wait + 42 * DT + CALM


def recovers(seconds: float, seed: int) -> None:
    controller = seeker()
    seen = set()
    for fault in faults(controller, seconds, seed):
        assert fault.after < NEAR, fault
        assert fault.status_after == "arrived", fault
        if fault.kind in ("NaN", "nothing", "infinite") and fault.length > TIMEOUT + 2 * DT:
            assert fault.status == "lost", fault
        seen.add(fault.kind)
    assert seen == set(KINDS)


def test_ten_minutes_of_faults() -> None:
    recovers(600.0, seed=1)


@pytest.mark.slow
def test_a_day_of_faults() -> None:
    recovers(24 * 3600.0, seed=2)


# --- any practice, any stream --------------------------------------------------------------------

PERIOD: Final = 2 * math.pi / 30


def floats(low: float, high: float) -> some.SearchStrategy[float]:
    return some.floats(low, high)


def pairs(low: float, high: float) -> some.SearchStrategy[tuple[float, float]]:
    return some.tuples(floats(low, high), floats(low, high))


def optional(strategy: some.SearchStrategy[Any]) -> some.SearchStrategy[Any]:
    return some.none() | strategy


VALIDITIES: Final = some.builds(
    es.Validity,
    low=optional(floats(-1e3, -1)),
    high=optional(floats(1, 1e3)),
    stuck=optional(floats(DT, 1)),
    timeout=optional(floats(DT, 1)),
    fade=floats(1e-3, 2),
    safe=optional(pairs(-1, 1)),
)
LIMITS: Final = some.builds(
    es.Limits,
    low=optional(pairs(-10, -1)),
    high=pairs(1, 10),
    rate=optional(pairs(1, 1e3)),
    tracking=optional(floats(1e-3, 1)),
)
SCALES: Final = some.builds(es.LogScale, floor=floats(1e-9, 1)) | some.builds(
    es.RunningScale, time=floats(0.1, 5), floor=floats(1e-6, 1)
)
DITHERS: Final = some.builds(
    es.ShrinkingDither,
    full=floats(1e-3, 10),
    least=floats(1e-2, 0.99),
    shrink=floats(0.3, 5),
    grow=floats(0.3, 5),
    response=floats(0.3, 5),
)
DETECTORS: Final = some.builds(
    es.Detector,
    level=floats(1e-3, 10),
    time=floats(0.1, 2),
    response=floats(0.3, 2),
    background=optional(floats(-10, 0)),
)
PARTS: Final = {
    "delay": some.none() | floats(0, 0.1),
    "validity": VALIDITIES,
    "limits": optional(LIMITS),
    "scale": optional(SCALES),
    "dither": optional(DITHERS),
    "detector": optional(DETECTORS),
    "changes": optional(some.builds(es.Changes, time=floats(0.22, 2))),
}
VALUES: Final = some.one_of(
    some.none(),
    floats(-100, 100),
    some.floats(),
    some.sampled_from((math.nan, math.inf, -math.inf, 1e18, -1e18, 1e300, 0.0, -0.0, 5e-324)),
)
STREAMS: Final = some.lists(
    some.tuples(
        VALUES, some.integers(1, 60), some.sampled_from(("step",) * 6 + ("skip", "change"))
    ),
    min_size=1,
    max_size=20,
)
LOOPS: Final = (
    velocity_actuated(),
    force_actuated(**{"controller.probe_ramp": 0.5, "start": (1, 1)}),
)


def kept(limits: Any, before: Any, sent: tuple[float, ...]) -> bool:
    low, high = limits.low or (-math.inf,) * 2, limits.high
    step = [rate * DT * (1 + 1e-9) for rate in limits.rate or (math.inf,) * 2]
    before = sent if before is None else before
    return all(
        low[i] - 1e-12 <= sent[i] <= high[i] + 1e-12 and abs(sent[i] - before[i]) <= step[i]
        for i in range(2)
    )


@settings(max_examples=200, deadline=None)
@given(some.fixed_dictionaries(PARTS), some.sampled_from(LOOPS), STREAMS, VALUES)
def test_whatever_practice_and_samples_outputs_are_numbers_within_limits(
    parts: dict[str, Any], loop: es.Loop, stream: list[tuple[Any, int, str]], first: Any
) -> None:
    assume(parts["dither"] is None or not isinstance(parts["scale"], es.RunningScale))
    controller = es.discretize(
        loop.controller, DT, practice=es.Practice(**parts), vehicle=loop.vehicle
    )
    limits = parts["limits"]
    state, before = controller.init(first), None
    for sample, count, what in stream:
        if what == "skip":
            state = controller.skip(state, count**4)
        if what == "change" and parts["changes"] is not None:
            state = controller.change(state, gain=count / 10, amplitude=count / 20)
        for _ in range(count):
            sent, state = controller.step(state, sample)
            assert all(map(math.isfinite, (*sent, *state))), (sent, state)
            if limits is not None:
                assert kept(limits, before, sent), (before, sent)
            before = sent
        if parts["detector"] is not None:
            assert controller.status(state) in ("seeking", "arrived", "lost")


# --- no jumps, and the verdict -----------------------------------------------------------------


def answers(controller: Any, samples: list[Any]) -> list[tuple[float, ...]]:
    state, sent = controller.init(samples[0]), []
    for sample in samples:
        commands, state = controller.step(state, sample)
        sent.append(commands)
    return sent


def test_the_first_sample_after_a_timeout_makes_no_jump_however_much_has_changed() -> None:
    """Only the probe moves, α ω · 2 sin(ω dt/2) a step, and the fade, dt/fade of it."""
    samples = [1.0] * 100 + [None] * 500 + [40.0] * 300
    sent = answers(seeker(limits=None, validity=es.Validity(timeout=1.0, fade=0.5)), samples)
    probe = AMPLITUDE * 30
    most = probe * (2 * math.sin(30 * DT / 2) + DT / 0.5)
    assert sent[599] == (0.0, 0.0)
    steps = [abs(b[i] - a[i]) for a, b in pairwise(sent) for i in range(2)]
    assert max(steps) <= most * (1 + 1e-9)
    held = answers(seeker(limits=None, validity=es.Validity()), samples)
    bump = max(abs(a - b) for a, b in zip(held[600], held[599], strict=True))
    assert bump > 100, "without a timeout the step of J reaches the output"


def test_whatever_cannot_be_a_sample_counts_as_none() -> None:
    rng = random.Random(3)
    bad = (math.nan, math.inf, -math.inf, LOW - 1e-9, HIGH + 1e-9, 1e17, 1e300, -1e308)
    true = [math.sin(0.3 * k) for k in range(500)]
    lost = [rng.random() < 0.4 for _ in true]
    guarded = seeker()
    shown = answers(guarded, [rng.choice(bad) if b else x for b, x in zip(lost, true, strict=True)])
    assert shown == answers(guarded, [None if b else x for b, x in zip(lost, true, strict=True)])
    plain = seeker(validity=es.Validity())
    bad = (math.nan, math.inf, -math.inf, 1.1e18, -1e300)
    shown = answers(plain, [rng.choice(bad) if b else x for b, x in zip(lost, true, strict=True)])
    assert shown == answers(plain, [None if b else x for b, x in zip(lost, true, strict=True)])
    assert shown != answers(guarded, true)


def test_a_sensor_that_repeats_itself_counts_as_none_after_a_while() -> None:
    """0.2 s are 20 repeats."""
    controller = seeker()
    state, ages = controller.init(0.5), []
    for k in range(100):
        _, state = controller.step(state, 0.5 if k > 10 else 0.04 * k)
        ages.append(state.age)
    good = ages.count(0.0)
    assert good == 32  # 11 different ones, the first 0.5, and its 20 repeats
    assert ages[-1] == 100 - good


def test_calm_must_last() -> None:
    controller = seeker(validity=es.Validity())
    state = controller.init(1.0)
    for k in range(1000):
        _, state = controller.step(state, 1.0)
        if controller.status(state) == "arrived":
            assert k * DT == pytest.approx(3 * 1.0 + CALM, abs=1.5 * DT)  # response = 1 s
            return
    raise AssertionError("it never arrived")


def test_a_changed_gain_goes_over_as_a_lag_and_jumps_nowhere() -> None:
    """The part fed back is multiplied by κ_n = 1 + (κ* − 1)(1 − e^(−n dt/T))."""
    controller = seeker(limits=None, validity=es.Validity(), changes=es.Changes(time=0.7))
    samples = [math.sin(0.3 * k) + 0.01 * k for k in range(400)]
    same, probe = answers(controller, samples), answers(controller, [0.0] * 400)
    state = controller.change(controller.init(samples[0]), gain=3.0)
    for n, sample in enumerate(samples):
        sent, state = controller.step(state, sample)
        factor = 1 + 2.0 * -math.expm1(-n * DT / 0.7)
        for u, before, alone in zip(sent, same[n], probe[n], strict=True):
            assert u == pytest.approx(alone + factor * (before - alone), abs=1e-12)


def test_the_verdict_goes_from_seeking_to_arrived_to_lost_and_back() -> None:
    controller = seeker()
    x, y, source = 1.0, 1.0, -1.0
    state = controller.init(1 - (Q[0] + Q[1]) * 4)
    seen: list[tuple[int, str]] = []
    for k in range(10_000):
        if k == 6000:
            source = 1.5
        sample = 1 - Q[0] * (x - source) ** 2 - Q[1] * (y - source) ** 2
        (u, v), state = controller.step(state, None if 4000 <= k < 4300 else sample)
        x, y = x + u * DT, y + v * DT
        status = controller.status(state)
        if not seen or status != seen[-1][1]:
            seen.append((k, status))
    names = [name for _, name in seen]
    assert names == ["seeking", "arrived", "lost", "arrived", "seeking", "arrived"], seen
    times = [k * DT for k, _ in seen]
    assert times[1] > CALM
    assert times[2] == pytest.approx(40 + TIMEOUT, abs=2.5 * DT)
    assert times[3] == pytest.approx(43, abs=1.5 * DT)
    assert 60 <= times[4] < 61.5
    assert times[5] > times[4] + CALM
