"""Refusals: each condition by a problem that meets it, and changes that help when they are made."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from functools import cache
from typing import Any

import pytest

import extremum as es
from extremum import s
from extremum.requirements import Requirements
from extremum.theory.synthesis import designing, proofs, refusals, search
from extremum.theory.synthesis.proofs import axis_proof, coupled_proof

from .asked import ASKED, EPSILON, designed, lagged, on, required, unstable

PUSH = "vehicle.axes.0.parameters.k"
PUSHED = es.Rational("k/s", parameters={"k": 1})
TWICE = es.Rational("1/(s*(tau*s + 1)**2)", parameters={"tau": 0.1})
ZERO = es.Rational("(s + z)/(s*(s + 1)*(s + 2))", parameters={"z": 1})


class Case:
    """A problem, the condition that fails, its path, and what the message must say."""

    def __init__(self, wanted: Requirements, condition: str, path: str, *said: str) -> None:
        self.wanted, self.condition, self.path, self.said = wanted, condition, path, said


CASES: dict[str, Case] = {
    "indefinite Hessian": Case(
        required(**on(1 / s, 1 / s), coupling=0.6),
        "indefinite Hessian",
        "coupling",
        *("0.6", "eigenvalue of -0.1 1/m²"),
    ),
    "sign": Case(
        required(ZERO, uncertain={"vehicle.axes.0.parameters.z": (-0.5, 0.6)}),
        "sign",
        "uncertain",
        *("axis x", "sign of G's numerator at s = 0"),
    ),
    "push or pull": Case(
        required(PUSHED, uncertain={PUSH: (-1, 2)}), "sign", "uncertain", "axis x", "sign"
    ),
    "probe against the reference": Case(
        required(TWICE, uncertain={"vehicle.axes.0.parameters.tau": (0.001, 0.3)}),
        "phase",
        "uncertain",
        *("axis x", "more than 90°"),
    ),
    "cancelled integrator": Case(
        required(1 / (s - 0.5), include=(s / (s + 1),)),
        "conflicting wishes",
        "include.0",
        *("zero at s = 0", "zero_bias = false"),
    ),
    "zero at the origin": Case(
        required(s / (s**2 + s + 1)), "zero at the origin", "vehicle.axes.0", "s = 0"
    ),
    "zero beside an unstable pole": Case(
        required((1 - s) / (s * (s - 0.6))),
        "non-minimum-phase zero",
        "vehicle.axes.0",
        *("zero at 1", "pole at 0.6", "= 4", "at most 3", "below 0.5"),
    ),
    "slow zero": Case(
        required((1 - s) / (s * (s + 1)), curvature=((0.9, 1.0),)),
        "non-minimum-phase zero",
        "vehicle.axes.0",
        *("3.8 s allowed", "1 : 1.11", "zero at +1 1/s"),
    ),
    "unstable pole under a dead time": Case(
        required(unstable(0.5), delay=3.0),
        "delay",
        "delay",
        *("pole at 0.5", "3 s", "e^(pT) = 4.48", "at most 3"),
    ),
    "dead time longer than the dither": Case(
        required(delay=0.3, settling_time=2, curvature=((0.7, 1.0),)),
        "delay",
        "delay",
        *("ω = ", "0.3 s", "270° allowed"),
    ),
    "phase, none stable": Case(
        required(1 / s**4),
        "phase",
        "vehicle.axes.0",
        *("up to two leads", "stabilises", "1 : 4"),
    ),
    "phase, none in time": Case(
        required(1 / (s * (0.3 * s + 1) ** 3), settling_time=3, curvature=((0.2, 3.0),)),
        "phase",
        "vehicle.axes.0",
        *("nearest settles in", "2.85 s allowed", "3 allowed", "1 : 15"),
    ),
    "phase under a dead time": Case(
        required(delay=0.5, settling_time=3.0), "phase", "vehicle.axes.0", "dead time of 0.5 s"
    ),
    "phase within a bandwidth": Case(
        required(1 / (s * (0.5 * s + 1) ** 4), settling_time=None, bandwidth=3.0),
        "phase",
        "vehicle.axes.0",
        *("below the bandwidth wanted", "|S| = "),
    ),
    "frequency": Case(
        required(frequency_limit=10.0),
        "frequency",
        "frequency_limit",
        *("the settling time needs", "highest curvature", "allowed are 10"),
    ),
    "frequency for a pole": Case(
        required(unstable(2.0), frequency_limit=20.0, settling_time=20, dither_limit=0.2),
        "frequency",
        "frequency_limit",
        *("the unstable pole at 2 1/s needs", "allowed are 20"),
    ),
    "authority": Case(
        required(1 / (s - 0.5), source_distance=20.0, force=0.5, input_limit=8.0),
        "authority",
        "input_limit",
        *("10 + 0.5, and 0 to follow", "than the limit 8", "no controller has the authority"),
    ),
    "no room for a dither": Case(
        required(1 / (s - 0.5), source_distance=3.0, force=0.5, input_limit=4.0),
        "input",
        "input_limit",
        *("4 with 2 to hold", "dither of α = 0.0", "ω = ", "too small"),
    ),
    "noise": Case(
        required(noise=1e-3, accuracy=5e-3),
        "noise",
        "accuracy",
        *("0.001 √s", "0.005 m allowed", "α = 0.1 m", "lowest curvature 0.5"),
    ),
    "input": Case(
        required(start_distance=2.0, input_limit=4.0),
        "input",
        "input_limit",
        *("2 m away", "the limit is 4", "saturate"),
    ),
}


@cache
def refused(name: str) -> es.Infeasible:
    with pytest.raises(es.Infeasible) as caught:
        es.design(CASES[name].wanted)
    return caught.value


def changed(wanted: Requirements, entry: str, text: str) -> Any:
    """Read a change as it is printed."""
    numbers = [float(x) for x in re.findall(r"(?<![.\w])-?\d[\d.]*(?:e-?\d+)?", text)]
    if entry in ("curvature", "uncertain"):
        pairs = tuple(zip(numbers[::2], numbers[1::2], strict=True))
        return pairs if entry == "curvature" else dict(zip(wanted.uncertain, pairs, strict=True))
    return numbers[0] if not isinstance(getattr(wanted, entry), tuple) else tuple(numbers)


def feasible(wanted: Requirements) -> bool:
    try:
        designing._attempt(wanted)
    except es.Infeasible:
        return False
    return True


# --- what is said -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_a_refusal_names_its_condition_its_numbers_and_its_place(name: str) -> None:
    case, found = CASES[name], refused(name)
    assert found.condition == case.condition
    assert found.path == case.path
    assert str(found).startswith(f"{case.path}: ") or str(found).startswith(f"{case.path} ")
    for said in case.said:
        assert said in str(found), said


@pytest.mark.parametrize("name", CASES)
def test_a_refusal_is_a_plain_invalid_description(name: str) -> None:
    found = refused(name)
    assert isinstance(found, es.InvalidDescription)
    assert found.__cause__ is None
    assert found.__suppress_context__


@pytest.mark.parametrize("name", CASES)
def test_its_changes_are_told(name: str) -> None:
    found = refused(name)
    if not found.changes:
        assert "Smallest change" not in str(found)
    for entry, value in found.changes:
        assert f"{entry} = {value}" in str(found)


def test_conditions_without_a_remedy_offer_none() -> None:
    for name in ("zero at the origin", "zero beside an unstable pole", "phase, none stable"):
        assert refused(name).changes == ()


@pytest.mark.parametrize(
    ("name", "entries"),
    [
        ("indefinite Hessian", {"coupling"}),
        ("slow zero", {"settling_time"}),
        ("dead time longer than the dither", {"delay", "settling_time"}),
        ("phase under a dead time", {"settling_time", "curvature", "delay"}),
        ("frequency", {"frequency_limit", "settling_time", "curvature"}),
        ("frequency for a pole", {"frequency_limit"}),
        ("authority", {"input_limit", "source_distance"}),
        ("noise", {"dither_limit", "accuracy", "settling_time", "noise"}),
        ("input", {"input_limit", "start_distance"}),
        ("no room for a dither", {"input_limit", "source_distance"}),
    ],
)
def test_what_may_be_changed_is_offered(name: str, entries: set[str]) -> None:
    assert entries <= {entry for entry, _ in refused(name).changes}


# --- the changes themselves -------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_each_change_alone_makes_it_feasible(name: str) -> None:
    case = CASES[name]
    for entry, value in refused(name).changes:
        assert feasible(case.wanted.replace({entry: changed(case.wanted, entry, value)})), entry


@pytest.mark.parametrize("name", CASES)
def test_a_tenth_less_of_a_change_does_not(name: str) -> None:
    """Where one number is changed by more than what it is searched to, 3 %."""
    case = CASES[name]
    for entry, value in refused(name).changes:
        given = getattr(case.wanted, entry)
        if not isinstance(given, float):
            continue
        eased = changed(case.wanted, entry, value)
        less = given + 0.9 * (eased - given)
        if abs(math.log(eased / less)) < math.log(refusals.CLOSE):
            continue
        assert not feasible(case.wanted.replace({entry: less})), (entry, eased, less)


def test_known_changes() -> None:
    """Where the threshold is known: Q's least eigenvalue, the frequency, the noise."""
    by_name = {
        name: dict(refused(name).changes) for name in ("indefinite Hessian", "frequency", "noise")
    }
    assert 0.45 < float(by_name["indefinite Hessian"]["coupling"]) < 0.5
    free = es.design(CASES["frequency"].wanted.replace({"frequency_limit": None})).frequency
    assert f"ω = {free:g} rad/s" in str(refused("frequency"))
    assert free <= float(by_name["frequency"]["frequency_limit"]) < free * 1.035
    noise = by_name["noise"]
    found = re.search(r"by ([\d.e-]+) m rms", str(refused("noise")))
    assert found
    error = float(found[1])
    assert float(noise["accuracy"]) == pytest.approx(error, rel=0.035)
    assert float(noise["noise"]) == pytest.approx(1e-3 * 5e-3 / error, rel=0.035)
    assert float(noise["dither_limit"]) == pytest.approx(0.1 * error / 5e-3, rel=0.035)


def test_an_input_that_is_changed_as_told_does_not_saturate() -> None:
    """Runs from the farthest start at both ends of the curvature, by `simulate`."""
    wanted = CASES["input"].wanted
    limit = float(dict(refused("input").changes)["input_limit"])
    design = es.design(wanted.replace({"input_limit": limit}))
    peaks = []
    for q, far in itertools.product((0.5, 2.0), (2.0, -2.0)):
        run = es.simulate(design.at({"field.q.0": q}, (far,)), 2.0)
        peaks += [-run.input.attrs["min"][0], run.input.attrs["max"][0]]
    assert 0.9 * limit < max(peaks) <= limit


# --- what takes long, or does not occur by itself ---------------------------------------------


def test_no_dither_is_fast_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop that never arrives, by a criterion that none meets."""
    monkeypatch.setattr(search, "RAISES", 3)
    monkeypatch.setattr(designing, "TRIALS", 1)
    monkeypatch.setattr(search, "CHARGING", 0.1)
    with pytest.raises(es.Infeasible, match=r"raised from .* to .*0\.4 s allowed") as caught:
        designing._attempt(required())
    assert caught.value.condition == "exact loop"
    assert "field.q.0 = 0.5 the exact loop settles in" in str(caught.value)


def test_a_frequency_is_raised_up_to_its_limit() -> None:
    free = designed("raised")
    assert free.begun < free.frequency
    limit = math.sqrt(free.begun * free.frequency)
    with pytest.raises(es.Infeasible, match=rf"raised from {free.begun:g}, as ") as caught:
        designing._attempt(ASKED["raised"].replace({"frequency_limit": limit}))
    assert caught.value.condition == "frequency"


def test_an_averaged_loop_that_cannot_be_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    def open_(*given: Any) -> Any:
        return replace(axis_proof(*given), holds=False, statement="Neither proved nor refuted.")

    monkeypatch.setattr(proofs, "axis_proof", open_)
    with pytest.raises(es.Infeasible, match="Neither proved nor refuted") as caught:
        es.design(required())
    assert (caught.value.condition, caught.value.path) == ("proof", "vehicle.axes.0")
    assert caught.value.changes == ()


def test_coupled_axes_that_cannot_be_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    def open_(wanted: Requirements, *given: Any) -> Any:
        proof = coupled_proof(wanted, *given)
        return replace(proof, holds=wanted.coupling < 0.15, statement="Left open.")

    monkeypatch.setattr(proofs, "coupled_proof", open_)
    with pytest.raises(es.Infeasible, match=r"0\.2 is too much: each axis.*Left open") as caught:
        es.design(required(**on(1 / s, 1 / s), coupling=0.2))
    assert (caught.value.condition, caught.value.path) == ("coupling", "coupling")
    [(entry, value)] = caught.value.changes
    assert entry == "coupling"
    assert 0.14 < float(value) < 0.15


def test_another_shape_is_tried_after_a_proof_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def second(wanted: Requirements, family: Any, shape: Any) -> Any:
        tried.append(shape)
        return replace(axis_proof(wanted, family, shape), holds=len(tried) > 1)

    monkeypatch.setattr(proofs, "axis_proof", second)
    assert es.design(required()).plan.shapes == (tried[1],)
    assert tried[0] != tried[1]


# --- easing -----------------------------------------------------------------------------------


def test_the_smallest_factor_is_found_to_three_percent() -> None:
    wanted = required(frequency_limit=10.0, force=0.4, uncertain={})
    calls = []

    def enough(trial: Requirements) -> bool:
        calls.append(trial)
        limit = trial.frequency_limit
        return limit is not None and limit >= 37.0

    [(entry, value)] = refusals.eased(wanted, ("frequency_limit", "uncertain", "force"), enough)
    assert entry == "frequency_limit"
    assert 37.0 <= float(value) < 37 * 1.03
    assert all(trial.force == 0.4 or trial.frequency_limit == 10.0 for trial in calls)


@pytest.mark.parametrize("threshold", [1.01, 1.5, 30.0, 63.0, 65.0])
def test_easing_gives_up_beyond_a_factor_of_64(threshold: float) -> None:
    wanted = required(force=1.0)
    found = refusals.eased(wanted, ("force",), lambda trial: trial.force <= 1.0 / threshold)
    assert bool(found) is (threshold <= 64)
    if found:
        value = float(found[0][1])
        assert 1 / threshold / 1.04 < value <= 1 / threshold


def test_narrower_and_tamer_ranges() -> None:
    """Ratios of the ends fall to a root, about the same middle; uncertain numbers to their low."""
    wanted = required(lagged(0.3, 0.05), uncertain={EPSILON: (0.1, 0.9)}, curvature=((0.5, 8.0),))
    [(_, narrow)] = refusals.eased(
        wanted, ("curvature",), lambda trial: trial.curvature[0][1] / trial.curvature[0][0] <= 4.0
    )
    low, high = changed(wanted, "curvature", narrow)[0]
    assert math.sqrt(low * high) == pytest.approx(2.0, rel=0.01)
    assert 3.6 < high / low <= 4.0
    [(_, tame)] = refusals.eased(
        wanted, ("uncertain",), lambda trial: trial.uncertain[EPSILON][1] <= 0.5
    )
    assert changed(wanted, "uncertain", tame)[EPSILON] == pytest.approx((0.1, 0.49), abs=0.0101)


def test_every_axis_is_eased_alike() -> None:
    wanted = required(**on(1 / s, 1 / s), force=(0.4, 0.8))
    [(_, value)] = refusals.eased(wanted, ("force",), lambda trial: trial.force[1] <= 0.2)
    assert changed(wanted, "force", value) == pytest.approx((0.1, 0.2), rel=0.04)


def test_a_range_that_nearly_vanishes_is_still_a_range() -> None:
    """Three digits of both ends of a range of 1 : 1.5 to the 1/64."""
    wanted = required(curvature=((1.0, 1.5),))
    assert refusals.eased(wanted, ("curvature",), lambda _: False) == []
