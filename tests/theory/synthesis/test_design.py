"""Whole designs: every rule by another calculation, the exact loop by an oracle of its own."""

from __future__ import annotations

import cmath
import dataclasses
import math
import re

import numpy as np
import pytest

import extremum as es
from extremum import s
from extremum.theory.synthesis.rules import Rule

from . import by_hand, exactly
from .asked import ASKED, designed, required

QUICK = ("gain", "forces", "unstable", "coupled", "biased")


def rule(design: es.Design, name: str) -> Rule:
    [found] = [rule for rule in design.rules if rule.name == name]
    return found


def random_points(name: str, count: int) -> list[dict[str, float]]:
    rng = np.random.default_rng([4, *name.encode()])
    box = designed(name).box
    return [{path: float(rng.uniform(*ends)) for path, ends in box.items()} for _ in range(count)]


def axis_at(design: es.Design, axis: int, point: dict[str, float]) -> by_hand.Axis:
    """The averaged axis from the loop's own numbers: L = α c q m C G, m = ω/√(ω² + h²)."""
    plain = exactly.plain_of(design.loop.replace(point))
    own, omega = plain.axes[axis], plain.frequencies[axis]
    m = omega / math.hypot(omega, plain.washout)
    q = float(plain.field.Q[axis, axis])  # pyright: ignore[reportAttributeAccessIssue]
    return by_hand.Axis(own.vehicle, own.compensator, own.amplitude * own.gain * q * m)


# --- rules ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ASKED)
def test_every_rule_holds(name: str) -> None:
    rules = designed(name).rules
    assert [rule.name for rule in rules if not rule.holds] == []
    assert len({rule.name for rule in rules}) == len(rules)
    assert all(rule.equation and rule.decided_by for rule in rules)


def test_what_a_rule_says() -> None:
    upper = Rule("a", "=", 3.0, "m", 4.0, True, "b")
    lower = Rule("a", "=", 5.0, "m", 4.0, False, "b")
    assert (upper.holds, upper.margin) == (True, 0.25)
    assert (lower.holds, lower.margin) == (True, 0.2)
    assert not dataclasses.replace(upper, value=4.1).holds
    assert dataclasses.replace(upper, value=5.0).margin == -0.25
    assert not dataclasses.replace(lower, value=3.9).holds
    free = dataclasses.replace(upper, limit=math.nan)
    assert free.holds
    assert math.isnan(free.margin)
    assert math.isnan(dataclasses.replace(upper, limit=math.inf).margin)
    assert math.isnan(dataclasses.replace(lower, limit=0.0).margin)


@pytest.mark.parametrize("name", ASKED)
def test_the_loop_gain_is_alpha_c_q_m(name: str) -> None:
    design = designed(name)
    for axis, shape in enumerate(design.plan.shapes):
        found = axis_at(design, axis, {}).gain
        letter = "xyz"[axis]
        assert found == pytest.approx(shape.gain, rel=6e-5)
        assert rule(design, f"loop gain {letter}").value == pytest.approx(abs(found), rel=6e-5)


@pytest.mark.parametrize("name", ASKED)
def test_references_take_back_the_washout_s_phase_and_nothing_else(name: str) -> None:
    controller = designed(name).controller
    for channel, omega in zip(controller.channels, controller.frequencies(), strict=True):
        assert channel.reference is not None
        turned = channel.reference.phase - channel.dither.phase
        assert turned == pytest.approx(math.atan2(controller.washout, omega), abs=1e-9)


@pytest.mark.parametrize("name", ASKED)
def test_the_averaged_loop_decays_as_it_is_proved_to(name: str) -> None:
    """At corners and at random, the dither being what the vehicle there makes of the probe."""
    design = designed(name)
    assert all(proof.holds for proof in design.proofs)
    points = random_points(name, 40) + [dict(found.point) for found in design.confirmations]
    rates = [
        exactly.averaged_roots(exactly.plain_of(design.loop.replace(point))).real.max()
        for point in points
    ]
    assert max(rates) <= -0.98 * design.decay
    assert rule(design, "decay, averaged").value == design.decay > 0


@pytest.mark.parametrize("name", ASKED)
def test_proofs_are_about_every_number_that_is_not_known(name: str) -> None:
    design = designed(name)
    known = ("field.source.", "vehicle.disturbance.")
    unknown = [path for path in design.box if not path.startswith(known)]
    said = " ".join(dict.fromkeys(proof.statement for proof in design.proofs))
    letters = re.findall(r"(\w+) in \[", said)
    if ASKED[name].coupling and "eigenvalue" in said:
        assert len(letters) == 1
        return
    alike = len({family.key for family in design.plan.families}) < len(design.plan.families)
    assert len(set(letters)) == len(unknown) or alike
    if ASKED[name].coupling:
        assert f"q_xy in [-{ASKED[name].coupling}, {ASKED[name].coupling}]" in said


@pytest.mark.parametrize("name", ASKED)
def test_the_dither_keeps_its_limit_wherever_the_vehicle_is(name: str) -> None:
    """Half the peak-to-peak of the steady response to the probe, at the corners."""
    design = designed(name)
    limits = ASKED[name].per_axis("dither_limit")
    for found in design.confirmations:
        plain = exactly.plain_of(design.loop.replace(found.point))
        assert (np.abs(plain.dither) <= (1 + 1e-9) * np.array(limits)).all()


@pytest.mark.parametrize("name", ASKED)
def test_what_holding_and_probing_take(name: str) -> None:
    """Along the whole range of the known unstable pole: the holding input is linear in it."""
    design, wanted = designed(name), ASKED[name]
    source, force = wanted.per_axis("source_distance"), wanted.per_axis("force")
    nominal = exactly.plain_of(design.loop)
    for i, axis in enumerate(nominal.axes):
        held = 0.0
        for end in (0, 1):
            point = {path: ends[end] for path, ends in wanted.uncertain.items()}
            above, below = exactly.plain_of(design.loop.replace(point)).axes[i].vehicle
            held = max(held, abs(below[-1] / above[-1]))
        load = held * source[i] + force[i]
        probe = abs(nominal.probes[i])
        letter = "xyz"[i]
        found = rule(design, f"authority {letter}")
        assert found.value == pytest.approx(load + probe)
        limit = wanted.per_axis("input_limit")[i]
        assert found.limit == (math.inf if limit is None else limit)
        swings = [
            abs(exactly.plain_of(design.loop.replace(c.point)).dither[i])
            for c in design.confirmations
        ]
        assert rule(design, f"dither {letter}").value == pytest.approx(max(swings), rel=1e-6)
        assert axis.amplitude <= wanted.per_axis("dither_limit")[i]


def test_the_dither_is_what_the_input_has_room_for() -> None:
    """7/10 of what is left: α/|G(jω)| = 0.7 (u_max − load), three digits of it."""
    design = es.design(required(1 / (s - 0.5), input_limit=3.0, source_distance=0.5, force=0.25))
    plain = exactly.plain_of(design.loop)
    probe = abs(plain.probes[0])
    assert plain.axes[0].amplitude < 0.1
    assert probe == pytest.approx(0.7 * (3 - 0.25 - 0.25), rel=6e-3)
    assert rule(design, "dither x").decided_by == "input_limit"
    assert rule(design, "authority x").value < 3.0


@pytest.mark.parametrize("name", ["biased", "gain"])
def test_the_bias_is_the_force_over_the_static_gain(name: str) -> None:
    design = designed(name)
    if name == "gain":
        assert "bias x" not in {rule.name for rule in design.rules}
        return
    lowest = axis_at(design, 0, {"field.q.0": 0.5}).gain
    expected = (0.3 * 0.5 + 0.1) / (lowest - 0.3)
    assert rule(design, "bias x").value == pytest.approx(expected, rel=1e-4)
    assert rule(design, "offset, exact").value == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("name", QUICK)
def test_rules_about_the_exact_loop_state_the_worst_that_was_seen(name: str) -> None:
    design = designed(name)
    seen, runs = design.confirmations, design.arrivals
    worst = {
        "exponents, exact": max(c.exponent for c in seen),
        "settling, exact": max(c.settling for c in seen),
        "charging, exact": max(c.charging for c in seen),
        "offset, exact": max(c.offset for c in seen),
        "arrival, exact": max(run.distance for run in runs),
        "input x, exact": max(run.input[0] for run in runs),
    }
    assert {key: rule(design, key).value for key in worst} == worst
    settling = ASKED[name].settling_time
    assert settling is not None
    assert rule(design, "settling, exact").limit == settling
    assert rule(design, "charging, exact").limit == 1.5 * settling
    for shape, letter in zip(design.plan.shapes, "xyz", strict=False):
        assert rule(design, f"settling {letter}").value == shape.settling
        assert rule(design, f"sensitivity {letter}").value == shape.peak


def test_the_report_says_what_was_decided() -> None:
    design = designed("unstable")
    text = str(design)
    compensator = design.plan.compensator_text(0)
    for expected in (compensator, "Proved in exact arithmetic", "α = 0.1999 m", "Floquet"):
        assert expected in text
    for found in design.rules:
        assert found.name in text
    assert text == design.text() == repr(design)


# --- what a design offers ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ASKED)
def test_the_box_is_what_was_said_in_the_loop_s_own_paths(name: str) -> None:
    design, wanted = designed(name), ASKED[name]
    for path, ends in design.box.items():
        for end in ends:
            design.loop.replace({path: end})
    coupled = wanted.coupling > 0
    for i, ends in enumerate(wanted.curvature):
        assert design.box[f"field.q.{i}.{i}" if coupled else f"field.q.{i}"] == ends
        source, force = (wanted.per_axis(n)[i] for n in ("source_distance", "force"))
        assert design.box.get(f"field.source.{i}", (0, 0)) == (-source, source)
        assert design.box.get(f"vehicle.disturbance.{i}", (0, 0)) == (-force, force)
    for path, ends in wanted.uncertain.items():
        assert design.box[path] == ends
    if coupled:
        assert design.box["field.q.0.1"] == (-wanted.coupling, wanted.coupling)


@pytest.mark.parametrize("name", QUICK)
def test_a_loop_at_a_point_starts_on_the_dither(name: str) -> None:
    design = designed(name)
    point = random_points(name, 1)[0]
    axes = len(design.plan.families)
    moved = tuple(0.1 * (i + 1) for i in range(axes))
    loop = design.at(point, moved)
    for path, value in point.items():
        assert loop.replace({path: value}) == loop
    run = es.simulate(loop, 0.01, samples=2)
    at_once = [c.dither.amplitude * math.sin(c.dither.phase) for c in design.controller.channels]  # pyright: ignore[reportAttributeAccessIssue]
    start = run.position.values[0] - run.source.values[0] - at_once
    assert start == pytest.approx(moved, abs=1e-12)
    assert design.at({}).start == design.loop.start


@pytest.mark.parametrize("name", ["unstable", "lagged"])
def test_the_probe_goes_through_the_nominal_vehicle_wherever_the_loop_is(name: str) -> None:
    """u(t) = Im[α e^{j(ωt + φ)}/G(jω)], G at the middle of the uncertain numbers."""
    design = designed(name)
    quiet = {f"controller.channels.{i}.gain": 0.0 for i in range(len(design.plan.families))}
    corner = {path: high for path, (_, high) in design.box.items()}
    run = es.simulate(design.loop.replace(corner | quiet), 0.3, samples=40)
    times = run.time.values
    epsilon = {"unstable": 0.25, "lagged": 0.5}[name]
    lag = {"unstable": 0.0, "lagged": 0.05}[name]
    omega = design.frequency
    plant = 1 / ((1j * omega - epsilon) * (lag * 1j * omega + 1))
    channel = design.controller.channels[0]
    assert isinstance(channel.dither, es.Dither)
    phasor = channel.dither.amplitude * cmath.exp(1j * channel.dither.phase) / plant
    assert run.input.values[:, 0] == pytest.approx(
        (phasor * np.exp(1j * omega * times)).imag, abs=1e-9
    )


def test_a_vehicle_that_is_known_needs_no_statement_of_its_own() -> None:
    channel = designed("gain").controller.channels[0]
    assert isinstance(channel.dither, es.Dither)
    assert channel.dither.through is None


@pytest.mark.parametrize("name", ["gain", "unstable", "coupled", "three"])
def test_its_scenario_is_written_read_and_run(name: str) -> None:
    design = designed(name)
    scenario = design.scenario()
    read = es.parse_scenario(es.format_scenario(scenario))
    assert read.loop == scenario.loop
    assert read.run == scenario.run
    run = es.simulate(read.loop, read.run.t_end)
    assert run.attrs["outcome"] == "completed"
    error = np.linalg.norm((run.position - run.source).values, axis=1)
    dither = np.linalg.norm([channel.dither.amplitude for channel in design.controller.channels])  # pyright: ignore[reportAttributeAccessIssue]
    settling = float(ASKED[name].settling_time or math.nan)
    assert read.run.t_end == 3 * settling
    assert error[run.time > 2 * settling].max() < 1.3 * dither
    assert design.scenario(1.5).run.t_end == 1.5


def test_a_scenario_without_a_settling_time() -> None:
    design = designed("bandwidth")
    assert design.scenario().run.t_end == pytest.approx(12 / design.decay)


def test_a_design_does_not_change() -> None:
    design = designed("gain")
    before = design.loop, design.box, design.controller
    with pytest.raises(dataclasses.FrozenInstanceError):
        design.frequency = 3.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(dataclasses.FrozenInstanceError):
        design.rules[0].value = 0.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(dataclasses.FrozenInstanceError):
        design.confirmations[0].exponent = 0.0  # pyright: ignore[reportAttributeAccessIssue]
    design.at({"field.q.0": 1.7}, (3.0,))
    design.box["field.q.0"] = (0.0, 0.0)
    assert (design.loop, design.box, design.controller) == before
    assert design.requirements == ASKED["gain"]


def test_the_same_requirements_give_the_same_controller() -> None:
    assert es.design(ASKED["gain"]).controller == designed("gain").controller


def test_only_requirements_can_be_designed_for() -> None:
    with pytest.raises(es.InvalidDescription, match="must be Requirements"):
        es.design(designed("gain").loop)  # pyright: ignore[reportArgumentType]


# --- bandwidth --------------------------------------------------------------------------------


def test_a_bandwidth_alone() -> None:
    """|S| at most 1/√2 up to 1 rad/s at the lowest curvature; no settling is promised."""
    design = designed("bandwidth")
    below = np.linspace(1e-3, 1.0, 400)
    for q in (0.5, 1.0, 2.0):
        sensitivity = by_hand.sensitivity(axis_at(design, 0, {"field.q.0": q}), below)
        assert np.abs(sensitivity).max() <= math.sqrt(0.5) * 1.005
    names = {rule.name for rule in design.rules}
    assert not {name for name in names if name.startswith(("settling", "charging"))}
    assert all(math.isnan(c.settling) for c in design.confirmations)


def test_a_bandwidth_is_what_a_moving_source_leaves() -> None:
    """A sine of 1 rad/s, measured on the exact loop: its error over its amplitude is |S(j)|."""
    design = designed("bandwidth")
    loop = design.loop.replace({"field.q.0": 0.5, "vehicle.disturbance": None})
    assert isinstance(loop.field, es.Quadratic)
    path = es.Along(("0.02*sin(1.0*t)",))
    slow = design.frequency / round(design.frequency)
    path = es.Along((f"0.02*sin({slow!r}*t)",))
    orbit = es.periodic_orbit(loop.replace({"field": es.Moving(loop.field, path)}))
    measured = abs(orbit.harmonic(slow)[0]) / 0.02
    axis = axis_at(design, 0, {"field.q.0": 0.5})
    assert measured == pytest.approx(
        float(np.abs(by_hand.sensitivity(axis, np.array([slow])))[0]), rel=0.03
    )
