"""Frequencies against sampled averages, exact orbits, and searches written out in full."""

from __future__ import annotations

import itertools
import math
import random
import re
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from loops import velocity_actuated
from numpy.typing import NDArray

import extremum as es
from extremum import s
from extremum.theory.averaging import average
from extremum.theory.collisions import combinations
from extremum.theory.orbits import periodic_orbit
from extremum.theory.probing.assignment import assign_frequencies
from extremum.theory.probing.checking import check_frequencies

QUARTER = math.pi / 2


def dithered(
    ratios: Sequence[Any], phases: Sequence[float], frequency: float, field: es.Field
) -> es.Loop:
    """A loop of 1/s with α = 0.1 on every axis."""
    channels = tuple(
        es.Channel(dither=es.Dither(0.1, phase=phase), gain=8, ratio=ratio)
        for ratio, phase in zip(ratios, phases, strict=True)
    )
    return es.Loop(
        field=field,
        vehicle=es.PointMass(axes=(1 / s,) * len(ratios)),
        controller=es.GradientES(frequency=frequency, washout=1.0, channels=channels),
        start=(0.1,) * len(ratios),
    )


def coupled(size: int) -> es.Quadratic:
    q = tuple(tuple(1.0 - 0.1 * i if i == j else 0.15 for j in range(size)) for i in range(size))
    return es.Quadratic(source=(0.0,) * size, q=q, peak=1.0)


# --- the combinations --------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "size"), [(1, 3), (2, 3), (3, 4), (4, 3), (3, 6), (5, 4)])
def test_every_combination_is_listed_once(count: int, size: int) -> None:
    found = set()
    for n in itertools.product(range(-size, size + 1), repeat=count):
        entries = [k for k in n if k]
        mixed = len(entries) > 1 and sum(map(abs, n)) <= size
        if mixed and math.gcd(*n) == 1 and entries[0] > 0:
            found.add(n)
    rows = [tuple(row) for row in combinations(count, size).tolist()]
    assert len(rows) == len(set(rows))
    assert set(rows) == found
    assert [sum(map(abs, n)) for n in rows] == sorted(sum(map(abs, n)) for n in rows)


# --- the verdict, against averages taken by sampling ----------------------------------------------


def drive(
    frequencies: Sequence[int],
    phases: Sequence[float],
    degree: int,
    seed: int,
    references: Sequence[float] | None = None,
) -> NDArray[Any]:
    """⟨J(x̃ + a) sin(ω_i t + ψ_i)⟩ at some x̃, of a polynomial J with all its coefficients."""
    rng, axes = np.random.default_rng(seed), range(len(frequencies))
    count = 2 * (degree + 1) * max(frequencies) + 1  # exact: a trigonometric polynomial
    t = 2 * np.pi * np.arange(count) / count
    waves = [np.sin(f * t + p) for f, p in zip(frequencies, phases, strict=True)]
    sensed = np.zeros(count)
    for powers in itertools.product(range(degree + 1), repeat=len(axes)):
        if sum(powers) <= degree:
            terms = [(0.3 * (i + 1) + (0.5 + 0.1 * i) * waves[i]) ** powers[i] for i in axes]
            sensed = sensed + rng.normal() * np.prod(terms, axis=0)
    turned = phases if references is None else references
    heard = [np.sin(f * t + p) for f, p in zip(frequencies, turned, strict=True)]
    return np.array([np.mean(sensed * wave) for wave in heard])


def test_what_is_accepted_averages_as_frequencies_far_apart_and_what_is_rejected_does_not() -> None:
    """500 random sets of up to four axes, quadrature pairs among them, in fields of degree 2 to 4.

    Far apart are 1 : 7 : 49 : 343 with the same phases.
    """
    chance, verdicts = random.Random(4), []
    for seed in range(500):
        degree = chance.choice((2, 2, 3, 3, 4))
        axes = chance.choice((2, 3, 4) if degree < 4 else (2, 3))
        groups = (
            [[0, 1], *([i] for i in range(2, axes))]
            if axes > 2 and chance.random() < 0.5
            else [[i] for i in range(axes)]
        )
        drawn = chance.sample(range(1, 9), len(groups))
        frequencies, apart, phases = [0] * axes, [0] * axes, [0.0] * axes
        for place, members in enumerate(groups):
            phase = chance.choice((0.0, 0.0, QUARTER, chance.uniform(-3, 3)))
            for k, i in enumerate(members):
                frequencies[i], apart[i] = drawn[place], 7**place
                phases[i] = phase - k * QUARTER
        mixed = drive(frequencies, phases, degree, seed) - drive(apart, phases, degree, seed)
        report = check_frequencies(frequencies, phases=phases, degree=degree)
        assert report.ok == (np.abs(mixed).max() < 1e-11), str(report)
        verdicts.append(report.ok)
    assert 150 < sum(verdicts) < 350


def test_without_phases_the_worst_ones_decide() -> None:
    chance = random.Random(5)
    for seed in range(60):
        frequencies = chance.sample(range(1, 9), 3)
        phases = [chance.uniform(-3, 3) for _ in range(3)]
        mixed = drive(frequencies, phases, 3, seed) - drive((1, 7, 49), phases, 3, seed)
        assert check_frequencies(frequencies, degree=3).ok == (np.abs(mixed).max() < 1e-11)


def test_a_references_own_phase_counts_with_its_sign() -> None:
    """Phases and references by eighths of a turn, at which a wrong sign is silent or loud."""
    chance, verdicts = random.Random(6), []
    for seed in range(150):
        frequencies = chance.choice(((1, 2), (2, 3, 5), (1, 3), (3, 4, 5)))
        eighths = [chance.randrange(8) * math.pi / 4 for _ in frequencies]
        errors = [chance.choice((0, 0, 1, -1)) * math.pi / 4 for _ in frequencies]
        references = [p + e for p, e in zip(eighths, errors, strict=True)]
        mixed = drive(frequencies, eighths, 3, seed, references)
        mixed -= drive((1, 7, 49)[: len(frequencies)], eighths, 3, seed, references)
        channels = tuple(
            es.Channel(dither=es.Dither(0.1, phase=p), gain=1, ratio=f, reference=psi)
            for f, p, psi in zip(frequencies, eighths, references, strict=True)
        )
        controller = es.GradientES(frequency=1, washout=1e-12, channels=channels)
        verdicts.append(check_frequencies(controller, degree=3).ok)
        assert verdicts[-1] == (np.abs(mixed).max() < 1e-11)
    assert 10 < sum(verdicts) < 140


def test_twice_a_silent_combination_is_another_that_may_not_be() -> None:
    """In phase 2ω_x − ω_y is silent; a field of degree 5 has 4ω_x − 2ω_y too, which is not."""
    for degree in (4, 5):
        mixed = drive((1, 2), (0, 0), degree, 1) - drive((1, 7), (0, 0), degree, 1)
        report = check_frequencies((1, 2), phases=(0, 0), degree=degree)
        assert report.ok == (np.abs(mixed).max() < 1e-11) == (degree == 4)
    assert "channel y demodulates ∂⁵J/∂x⁴∂y" in str(report)  # pyright: ignore[reportPossiblyUnboundVariable]


# --- the verdict, against exact orbits ------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratios", "phases"),
    [
        ((2, 3), (0.3, 1.0)),
        ((3, 4, 5), (0.3, 1.0, 0.7)),
        ((4, 5, 7), (0.3, 1.0, 0.7)),
        ((1, 1, Fraction(3, 2)), (0.0, -QUARTER, 1.0)),
        ((3, 3, 4, 4), (0.0, -QUARTER, 0.5, 0.5 - QUARTER)),
    ],
)
def test_the_offset_of_accepted_frequencies_falls_as_one_over_omega(
    ratios: tuple[Any, ...], phases: tuple[float, ...]
) -> None:
    loop = dithered(ratios, phases, 40 / float(min(ratios)), coupled(len(ratios)))
    assert check_frequencies(loop).ok
    assert average(loop).offset == pytest.approx(0, abs=1e-14)
    low, high = (
        np.abs(periodic_orbit(loop.replace({"controller.frequency": f * f0})).offset).max()
        for f0 in (40 / float(min(ratios)),)
        for f in (1, 8)
    )
    assert 1e-6 < low < 0.02
    assert high < 1.1 * low / 8


@pytest.mark.parametrize(
    ("ratios", "phases", "axis", "offset", "told"),
    [
        # ½ J_xx α² sin² ωt demodulated by cos 2ωt; q_x = 1, q_y = 0.9
        ((1, 2), (0, QUARTER), 1, 2 * 0.1 / (8 * 0.9), "|∂²J/∂x²| α_x²/(8 |q_y| α_y)"),
        ((1, 2), (0, math.pi / 6), 1, 0.5 * 2 * 0.1 / (8 * 0.9), "0.5 |∂²J/∂x²| α_x²/(8 |q_y|"),
        ((2, 3, 5), (0, 0, QUARTER), 2, 0.3 * 0.1 / (4 * 0.8), "|∂²J/∂x∂y| α_x α_y/(4 |q_z| α_z)"),
    ],
)
def test_the_offset_of_rejected_frequencies_stays_and_is_the_one_told(
    ratios: tuple[int, ...], phases: tuple[float, ...], axis: int, offset: float, told: str
) -> None:
    field = coupled(len(ratios))
    if ratios == (1, 2):  # an axis that the map does not couple, as the sentence says
        field = es.Quadratic(source=(0, 0), q=(1.0, 0.9), peak=1.0)
    else:
        q = ((1.0, 0.15, 0), (0.15, 0.9, 0), (0, 0, 0.8))
        field = es.Quadratic(source=(0, 0, 0), q=q, peak=1.0)
    loop = dithered(ratios, phases, 200, field)
    report = check_frequencies(loop)
    assert not report.ok
    assert f"rests {told}" in report.collisions[0].effect
    for frequency in (200, 3200):
        orbit = periodic_orbit(loop.replace({"controller.frequency": frequency}))
        assert abs(orbit.offset[axis]) == pytest.approx(offset, rel=20 / frequency)


@pytest.mark.parametrize(
    ("ratios", "third", "axis", "offset", "told"),
    [
        ((1, 3), "x**3", 1, 3 * 0.01 / (48 * 0.9), "|∂³J/∂x³| α_x³/(48 |q_y| α_y)"),
        ((2, 3, 7), "x**2*y", 2, 0.01 / (16 * 0.8), "|∂³J/∂x²∂y| α_x² α_y/(16 |q_z| α_z)"),
        ((4, 5, 3), "x**2*z", 1, 0.01 / (16 * 0.9), "|∂³J/∂x²∂z| α_x² α_z/(16 |q_y| α_y)"),
    ],
)
def test_cubic_fields_add_three_omega_and_two_omega_plus_or_minus_omega(
    ratios: tuple[int, ...], third: str, axis: int, offset: float, told: str
) -> None:
    """The collision moves an axis that the cubic term itself leaves alone, at every ω."""
    size = len(ratios)
    formula = " - ".join(["1", "x**2", "0.9*y**2", "0.8*z**2"][: size + 1])
    loop = dithered(ratios, (0.0,) * size, 3000, es.Expression(f"{formula} + 0.5*{third}"))
    assert check_frequencies(ratios).ok
    report = check_frequencies(loop)
    assert not report.ok
    assert f"rests {told}" in str(report)
    assert abs(average(loop).offset[axis]) == pytest.approx(offset, rel=2e-2)
    assert abs(periodic_orbit(loop).offset[axis]) == pytest.approx(offset, rel=5e-2)


def test_a_phase_at_which_the_octave_averages_out_is_harmless_until_it_is_off() -> None:
    loop = dithered((1, 2), (0, 0), 400, es.Quadratic(source=(0, 0), q=(1.0, 0.5), peak=1.0))
    report = check_frequencies(loop)
    assert report.ok
    assert "averages out" in str(report)
    assert np.abs(periodic_orbit(loop).offset).max() < 1e-3
    turns = {
        f"controller.channels.{i}.reference": math.atan(1 / (400 * r)) for i, r in ((0, 1), (1, 2))
    }
    assert check_frequencies(loop.replace(turns)).ok  # corrected for the washout
    off = loop.replace({"controller.channels.1.reference": 0.1})
    assert not check_frequencies(off).ok
    assert abs(average(off).offset[1]) > 0.04 * math.sin(0.1)


@pytest.mark.parametrize("error", [0.0, "washout", 0.3])
def test_references_are_what_separates_a_pair(error: Any) -> None:
    """Corrected for the washout or not, both separate as ω → ∞; an error of 0.3 rad does not."""
    turn = math.atan(1 / 30) if error == "washout" else error
    loop = velocity_actuated(
        **{
            "controller.channels.0.reference": turn,
            "controller.channels.1.reference": turn - QUARTER,
        }
    )
    report = check_frequencies(loop)
    assert report.ok == (error != 0.3)
    if error == 0.3:
        assert f"hears up to {math.sin(0.3):.3g} of the other's dither" in str(report)
        across = average(loop).demodulation_limit
        assert abs(across[0, 1] / across[0, 0]) == pytest.approx(math.tan(0.3))


def test_a_sensor_turns_what_references_must_be_corrected_by() -> None:
    slow = velocity_actuated(sensor=1 / (0.1 * s + 1))
    report = check_frequencies(slow)
    assert not report.ok
    turn = -math.atan(3.0)
    assert f"up to {abs(math.sin(turn)):.3g}" in str(report)
    corrected = slow.replace(
        {
            "controller.channels.0.reference": turn,
            "controller.channels.1.reference": turn - QUARTER,
        }
    )
    assert check_frequencies(corrected).ok


def test_a_position_that_lags_its_dither_is_taken_as_it_moves() -> None:
    """Through 1/s an axis 1/(s (s + 40)) turns its dither by −atan 30/40: no pair any more."""
    loop = velocity_actuated(
        **{
            "vehicle.axes.0": 1 / (s * (s + 40)),
            "controller.channels.0.dither.through": 1 / s,
        }
    )
    inverted = loop.replace({"controller.channels.0.dither.through": None})
    assert check_frequencies(inverted).ok
    assert not check_frequencies(loop).ok
    assert check_frequencies(loop.controller).ok  # the controller knows no vehicle


def test_two_dithers_in_phase_leave_one_direction_unsteered() -> None:
    report = check_frequencies((30, 30), phases=(0.4, 0.4))
    (collision,) = report.collisions
    assert not report.ok
    assert "M is singular" in str(collision)
    assert "a quarter turn" in collision.change
    loop = dithered((1, 1), (0.4, 0.4), 30, coupled(2))
    assert np.linalg.det(average(loop).demodulation) == pytest.approx(0, abs=1e-18)
    assert not check_frequencies(loop).ok
    assert "only a quarter turn" in str(check_frequencies((30, 30)))
    oblique = str(check_frequencies((30, 30), phases=(0, 0.5)))
    assert f"hears up to {math.cos(0.5):.3g} of the other's dither" in oblique
    assert "singular" not in oblique


def test_a_third_dither_at_one_frequency_is_one_too_many() -> None:
    report = check_frequencies((30, 30, 30), phases=(0, -QUARTER, 1.0))
    assert [c.harmless for c in report.collisions] == [True, False]
    assert "M of 3 is singular" in report.collisions[1].effect
    loop = dithered((1, 1, 1), (0, -QUARTER, 1.0), 30, coupled(3))
    assert np.linalg.matrix_rank(average(loop).demodulation, tol=1e-12) == 2


def test_a_pair_at_the_double_of_another_pair_always_collides() -> None:
    report = check_frequencies((1, 1, 2, 2), phases=(0, -QUARTER, 0, -QUARTER))
    assert [c.harmless for c in report.collisions] == [True, True, False]


# --- near-collisions ------------------------------------------------------------------------------


def test_a_near_collision_drives_the_loop_at_its_beat() -> None:
    """ẏ̃ = −λ ỹ + c q_x α²/4 · sin(δt + …): amplitude (c q_x α²/4)/|λ + jδ|, λ = 0.4, δ = 1."""
    loop = velocity_actuated(
        **{"controller.frequency": 50, "controller.channels.1.ratio": Fraction(101, 50)}
    )
    report = check_frequencies(loop)
    (near,) = report.collisions
    assert not report.ok
    assert near.combination == (2, -1)
    assert near.beat == pytest.approx(1.0)
    assert "2 ω_x and ω_y differ by 1 rad/s: within ten bandwidths" in str(near)
    swing = abs(periodic_orbit(loop).harmonic(1.0)[1])
    assert swing == pytest.approx(10 * 0.08**2 / 4 / abs(0.4 + 1j), rel=0.02)


def test_the_loops_own_bandwidth_decides_what_is_near() -> None:
    """Its fastest mode is the washout's, 1 rad/s; ten times that is the limit."""
    for beat, felt in ((9, True), (11, False)):
        ratio = 2 + Fraction(beat, 100)
        loop = velocity_actuated(
            **{"controller.frequency": 100, "controller.channels.1.ratio": ratio}
        )
        report = check_frequencies(loop)
        assert report.bandwidth == pytest.approx(1.0)
        assert report.ok != felt
        assert len(average(loop).resonances) == len(report.collisions)
        assert check_frequencies(loop, bandwidth=0).ok
    assert not check_frequencies((100, 109), bandwidth=1.0).ok
    assert check_frequencies((100, 111), bandwidth=1.0).ok
    assert check_frequencies((100, 126), bandwidth=1e3).ok  # a quarter of ω is not slow


# --- what avoids them -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frequencies", "degree", "bandwidth"),
    [
        ((30, 60), 2, 0.0),
        ((2, 3, 5), 2, 0.0),
        ((1, 3), 3, 0.0),
        ((30, 30), 2, 0.0),
        ((2, 3, 4, 6), 3, 0.0),
        ((5, 6, 10), 2, 0.0),  # the nearest, 11, would be 5 + 6
        ((100, 101), 2, 1.0),
        ((1, math.sqrt(2), 1 + math.sqrt(2)), 2, 0.0),
    ],
)
def test_every_change_told_avoids_its_collision_and_makes_no_other(
    frequencies: tuple[float, ...], degree: int, bandwidth: float
) -> None:
    report = check_frequencies(frequencies, degree=degree, bandwidth=bandwidth)
    names = ("x", "y", "z") if len(frequencies) <= 3 else ("x1", "x2", "x3", "x4")
    before = {c.combination for c in report.collisions}
    for collision in report.collisions:
        moved, ratio = re.findall(r"ω_(\w+) = ([\d/]+) ω_\w+ \(", collision.change)[0]
        changed = [Fraction(f) for f in frequencies]
        changed[names.index(moved)] = Fraction(ratio) * min(changed)
        after = check_frequencies(changed, degree=degree, bandwidth=bandwidth)
        assert {c.combination for c in after.collisions} <= before - {collision.combination}
        assert after.cycles is None or after.cycles <= 8
        shift = abs(math.log(Fraction(ratio) * min(frequencies) / frequencies[names.index(moved)]))
        assert shift < 0.2


def test_a_pair_moves_together() -> None:
    report = check_frequencies((1, 1, 2, 2), phases=(0, -QUARTER, 0, -QUARTER))
    assert "ω_x3 = ω_x4 = 17/8 ω_x1" in report.collisions[-1].change


# --- the report -----------------------------------------------------------------------------------


def test_the_common_period() -> None:
    assert check_frequencies((30, 45.0)).cycles == 2
    assert check_frequencies((30, 45.0)).period == pytest.approx(2 * 2 * math.pi / 30)
    assert check_frequencies((1, Fraction(5, 4), "7/4")).cycles == 4
    never = check_frequencies((1, math.sqrt(2)))
    assert never.cycles is None
    assert never.period is None
    assert "never repeat" in str(never)


def test_frequencies_known_in_floats_collide_to_rounding() -> None:
    report = check_frequencies((math.sqrt(2), math.sqrt(3), math.sqrt(2) + math.sqrt(3)))
    assert [c.beat for c in report.collisions] == [0.0]
    assert check_frequencies((0.1, 0.1 + 1e-16, 0.2)).collisions[-1].combination == (2, 0, -1)


def test_a_report_of_nothing_says_up_to_which_degree() -> None:
    report = check_frequencies((4, 5, 7), degree=3)
    assert report.ok
    assert report.collisions == ()
    assert "Σ|n_k| ≤ 4 collides: right for fields up to degree 3" in str(report)
    assert not check_frequencies((4, 5, 7), degree=4).ok  # 3·4 = 5 + 7


def test_the_degree_is_the_fields_own() -> None:
    quadratic, cubic = "1 - x**2 - y**2", "1 - x**2 - y**2 + 0.1*x**3"
    for field, degree in ((es.Expression(quadratic), 2), (es.Expression(cubic), 3)):
        loop = velocity_actuated(field=field, start=(0.1, 0.1))
        assert check_frequencies(loop).degree == degree
    bell = velocity_actuated(field=es.Gaussian(source=(0, 0), width=1.0))
    assert check_frequencies(bell).degree == 3
    assert check_frequencies(bell, degree=4).degree == 4


def test_a_controller_alone_has_its_own_phases_where_it_knows_them() -> None:
    assert check_frequencies(velocity_actuated().controller).ok
    channels = (
        es.Channel(dither=es.Dither(0.08, phase=-QUARTER), gain=10),
        es.Channel(dither=es.Probe(2.4, phase=QUARTER), gain=10, reference=0.0),
    )
    unknown = es.GradientES(frequency=30, washout=1.0, channels=channels)
    assert not check_frequencies(unknown).ok
    assert check_frequencies(velocity_actuated(controller=unknown)).ok  # the loop knows 1/s


@pytest.mark.parametrize(
    ("arguments", "options", "path"),
    [
        ((), {}, "frequencies"),
        (30, {}, "frequencies"),
        ("30", {}, "frequencies"),
        ((30, 0), {}, "frequencies.1"),
        ((30, Fraction(-1, 2)), {}, "frequencies.1"),
        ((30, "x"), {}, "frequencies.1"),
        ((30, float("inf")), {}, "frequencies.1"),
        ((30, True), {}, "frequencies.1"),
        ((30, 45), {"phases": (0,)}, "phases"),
        ((30, 45), {"phases": (0, "x")}, "phases.1"),
        ((30, 45), {"phases": 0.0}, "phases"),
        ((30, 45), {"degree": 1}, "degree"),
        ((30, 45), {"degree": 2.0}, "degree"),
        ((30, 45), {"degree": True}, "degree"),
        (tuple(range(1, 40)), {"degree": 5}, "degree"),
        ((30, 45), {"bandwidth": -1}, "bandwidth"),
        ((30, 45), {"bandwidth": "x"}, "bandwidth"),
    ],
)
def test_what_cannot_be_checked_is_refused_by_name(
    arguments: Any, options: dict[str, Any], path: str
) -> None:
    with pytest.raises(es.InvalidDescription) as refusal:
        check_frequencies(arguments, **options)
    assert refusal.value.path == path


class Resting(es.Controller):
    """A controller that drives nothing."""

    def compose(self, diagram: Any, signal: Any, plants: Any, inputs: Any, units: Any) -> Any:
        return ()

    def inputs(self) -> int:
        return 1

    def base(self) -> float:
        return 1.0

    def rest(self, signal: Any) -> Any:
        return ()

    def motion(self, axis: int) -> None:
        return None


def test_a_controller_without_dithers_is_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="does not demodulate"):
        check_frequencies(Resting())


def test_a_loop_has_its_own_phases() -> None:
    with pytest.raises(es.InvalidDescription, match="phases"):
        check_frequencies(velocity_actuated(), phases=(0, 0))


# --- assignment -----------------------------------------------------------------------------------


def admissible(chosen: Sequence[int], size: int, near: float) -> bool:
    """Whether no combination is below `near`, all written out."""
    for n in itertools.product(range(-size, size + 1), repeat=len(chosen)):
        if 0 < sum(map(abs, n)) <= size:
            beat = abs(sum(k * f for k, f in zip(n, chosen, strict=True)))
            if beat < near or beat == 0:
                return False
    return True


@pytest.mark.parametrize(
    ("count", "degree", "bandwidth", "highest", "odd"),
    [
        *((count, degree, 0.0, 2.0, odd) for count in (1, 2, 3) for degree in (2, 3, 4)
          for odd in (False, True)),
        (4, 2, 0.0, 2.0, False),
        (4, 3, 0.0, 2.0, False),
        (3, 2, 0.0, 1.3, False),
        (3, 3, 0.0, 1.5, True),
        (3, 2, 0.02, 2.5, False),
        (4, 2, 0.025, 3.0, False),
        (3, 2, 0.0, 4.0, False),
    ],
)  # fmt: skip
def test_no_set_has_a_shorter_period_or_as_short_a_one_and_a_lower_top(
    count: int, degree: int, bandwidth: float, highest: float, odd: bool
) -> None:
    found = assign_frequencies(
        count,
        quadrature=False,
        degree=degree,
        bandwidth=bandwidth,
        highest=highest,
        half_wave=odd,
    )
    wanted = next(
        chosen
        for lowest in range(1, 30)
        for chosen in sorted(
            (
                (lowest, *rest)
                for rest in itertools.combinations(
                    range(lowest + 1, int(highest * lowest) + 1), count - 1
                )
            ),
            key=lambda chosen: chosen[-1],
        )
        if (not odd or all(f % 2 for f in chosen))
        and admissible(chosen, degree + 1, min(10 * bandwidth, 0.25) * lowest - 1e-9)
    )
    assert (found.cycles, found.highest) == (wanted[0], Fraction(wanted[-1], wanted[0]))


@pytest.mark.parametrize(("marks", "length"), [(2, 1), (3, 3), (4, 6), (5, 11), (6, 17)])
def test_in_an_octave_cubic_fields_want_a_golomb_ruler(marks: int, length: int) -> None:
    """There only ω_i + ω_j = ω_k + ω_l is left to avoid: all differences differ.

    The shortest rulers have these lengths, and an octave up from N must hold one: N = length + 1.
    """
    found = assign_frequencies(marks, quadrature=False, degree=3)
    assert found.cycles == length + 1
    assert found.highest == Fraction(2 * length + 1, length + 1)


@pytest.mark.parametrize("axes", range(1, 13))
@pytest.mark.parametrize("quadrature", [True, False])
@pytest.mark.parametrize("degree", [2, 3])
def test_what_is_assigned_passes_the_check(axes: int, quadrature: bool, degree: int) -> None:
    for half_wave in (False, True) if axes < 8 else (False,):
        found = assign_frequencies(axes, quadrature=quadrature, degree=degree, half_wave=half_wave)
        report = check_frequencies(found.ratios, phases=found.phases, degree=degree)
        assert report.ok
        assert report.cycles == found.cycles
        assert report.half_wave or not half_wave
        assert len(found.ratios) == len(found.phases) == axes
        assert len(set(found.ratios)) == (-(-axes // 2) if quadrature else axes)
        assert min(found.ratios) == 1
        assert max(found.ratios) == found.highest < 2
        turned = (0, -QUARTER) if quadrature else (0, 0)
        assert found.phases == tuple(turned[i % 2] for i in range(axes))


def test_an_assignment_respects_the_bandwidth() -> None:
    for bandwidth in (0.005, 0.01, 0.02):
        found = assign_frequencies(8, bandwidth=bandwidth, highest=3)
        assert check_frequencies(found.ratios, phases=found.phases, bandwidth=bandwidth).ok


def test_odd_multiples_leave_no_offset_at_any_frequency() -> None:
    """Half a period later everything is its own negative; even multiples only tend to it."""
    for half_wave in (True, False):
        found = assign_frequencies(4, half_wave=half_wave)
        loop = dithered(found.ratios, found.phases, 25, coupled(4))
        assert check_frequencies(loop).half_wave == half_wave
        offset = np.abs(periodic_orbit(loop).offset).max()
        assert offset < 1e-12 if half_wave else offset > 1e-4


def test_an_assigned_loop_seeks_its_source() -> None:
    found = assign_frequencies(3)
    assert str(found).splitlines() == [
        "ω_x = 1 ω, φ_x = 0",
        "ω_y = 1 ω, φ_y = −π/2",
        "ω_z = 3/2 ω, φ_z = 0",
        "repeating after 2 cycles of the slowest",
    ]
    loop = dithered(found.ratios, found.phases, 60, coupled(3))
    assert es.stability(loop).stable


@pytest.mark.parametrize(
    ("axes", "options"),
    [
        (12, {"bandwidth": 0.02}),
        (8, {"bandwidth": 0.03, "half_wave": True}),
        (4, {"highest": 1.001}),
        (6, {"highest": 1.001, "degree": 3}),
    ],
)
def test_a_refusal_says_what_would_do(axes: int, options: dict[str, Any]) -> None:
    with pytest.raises(es.InvalidDescription) as refusal:
        assign_frequencies(axes, **options)
    assert refusal.value.path == "highest"
    told = re.search(r"([\d.]+) would do \(([\d :]+)\)", refusal.value.reason)
    assert told is not None
    chosen = [int(f) for f in told[2].split(" : ")]
    assert chosen[-1] / chosen[0] == pytest.approx(float(told[1]), rel=1e-3)
    bandwidth = options.get("bandwidth", 0.0)
    report = check_frequencies(
        chosen, degree=options.get("degree", 2), bandwidth=bandwidth * chosen[0]
    )
    assert report.ok
    wider = assign_frequencies(axes, **{**options, "highest": float(told[1])})
    assert wider.highest <= float(told[1])
    slower = re.search(r"a loop bandwidth of ([\d.]+)", refusal.value.reason)
    assert (slower is not None) == ("bandwidth" in options)
    if slower is not None:
        assign_frequencies(axes, **{**options, "bandwidth": float(slower[1])})
    assert "highest" in options or refusal.value.value == "2"


@pytest.mark.parametrize(
    ("axes", "options", "path"),
    [
        (0, {}, "axes"),
        (2.0, {}, "axes"),
        (True, {}, "axes"),
        (2, {"degree": 1}, "degree"),
        (2, {"highest": 0}, "highest"),
        (2, {"bandwidth": -0.1}, "bandwidth"),
        (60, {"quadrature": False, "degree": 4}, "degree"),
    ],
)
def test_what_cannot_be_assigned_is_refused_by_name(
    axes: Any, options: dict[str, Any], path: str
) -> None:
    with pytest.raises(es.InvalidDescription) as refusal:
        assign_frequencies(axes, **options)
    assert refusal.value.path == path
