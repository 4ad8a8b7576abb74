"""The verdict: its columns against the errata's table, and the sentences it must say."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import pi, s
from extremum.papers.zhang2007 import scenario
from extremum.theory.verdict import stability


def said(verdict: es.Verdict, words: str) -> bool:
    return any(words in remark for remark in verdict.remarks)


def design(zero: float, pole: float, frequency: float) -> es.Loop:
    """The double integrators of the errata: k = 5, c = 10, α = 0.1, source at the origin."""
    lead = es.Lead(5, zero, pole)
    changes = {f"controller.channels.{i}.compensator": lead for i in (0, 1)}
    return force_actuated(**changes, **{"controller.frequency": frequency})


@pytest.mark.parametrize(
    ("zero", "pole", "printed", "corrected", "exact"),
    [
        (-2, -1.5, -0.1607, 0.1515, (0.1544, 0.1518, 0.1515)),
        (-0.5, -3, 0.3944, -0.4550, (-0.4561, -0.4551, -0.4550)),
        (-2, -10, -0.1148, -0.1015, (-0.1014, -0.1015, -0.1015)),
        (-1.2, -1.1, -0.2077, 0.0391, (0.0419, 0.0394, 0.0392)),
    ],
)
def test_the_table_of_erratum_1(
    zero: float, pole: float, printed: float, corrected: float, exact: tuple[float, ...]
) -> None:
    for frequency, floquet in zip((30, 100, 400), exact, strict=True):
        verdict = stability(design(zero, pole, frequency))
        rates = [column.rate for column in verdict.evidence]
        assert rates == pytest.approx([printed, corrected, corrected, floquet], abs=6e-5)
        words = [column.stable for column in verdict.evidence]
        assert words == [rate < 0 for rate in rates]
        assert verdict.stable == (floquet < 0)
        differ = (printed < 0) != (corrected < 0)
        assert said(verdict, "the printed formula is wrong here") == differ


def test_modes_are_compared_one_by_one() -> None:
    verdict = stability(velocity_actuated())
    assert verdict.modes is not None
    assert sorted(verdict.modes.averaged.real) == pytest.approx([-1, -0.8, -0.4])
    assert verdict.modes.worst < 3e-3
    text = verdict.text()
    assert "printed conditions" in text
    assert "α_x c_x q_x > 0" in text
    assert text.startswith("stable: largest Floquet exponent -0.401")


def test_plain_data_for_programs() -> None:
    read = json.loads(json.dumps(stability(force_actuated()).data()))
    assert read["stable"] is True
    assert [column["stable"] for column in read["evidence"]] == [False, True, True, True]
    assert len(read["modes"]) == 7
    assert read["orbit"]["period"] == pytest.approx(2 * np.pi / 30)
    none = json.loads(json.dumps(stability(scenario("incommensurate").loop).data()))
    assert none["orbit"]["period"] is None


def test_where_averaging_should_not_be_trusted() -> None:
    slow_washout = velocity_actuated(**{"controller.washout": 5.0})
    assert said(stability(slow_washout), "h/ω = 0.17")
    assert not said(stability(velocity_actuated()), "trusted")
    fast = velocity_actuated(**{"controller.channels.0.gain": 60})
    assert said(stability(fast), "the loop's fastest mode over ω = 0.16")
    biased = velocity_actuated(**{"vehicle.disturbance": (1.0, 0.0)})
    pulled = stability(biased)  # x̃ᵉ = d/g = 1.25, ρ = c q x̃/ω
    assert said(pulled, f"|x̃|/ω = {10 * 1.25 / 30:.2g} at the equilibrium")


def test_a_limit_that_says_little_is_named() -> None:
    """Erratum 2's loop: −0.793 on average, −0.529 at ω = 1600."""
    loop = scenario("fig7").loop.replace(
        {
            **{f"vehicle.axes.{i}.parameters.epsilon": 0.5 for i in (0, 1)},
            **{f"controller.channels.{i}.compensator": es.Lead(4, -3, -2.5) for i in (0, 1)},
            "controller.frequency": 1600,
        }
    )
    assert said(stability(loop), "(-0.7929 1/s) is far from the exact one (-0.528")
    assert not said(stability(force_actuated()), "far from the exact one")


def test_a_curvature_that_changes_with_time_is_that_at_the_start() -> None:
    fading = velocity_actuated(field=es.Expression("-exp(-t)*x**2 - y**2"), start=(0.1, 0.1))
    verdict = stability(fading)
    assert verdict.average.hessian == pytest.approx(np.diag([-2, -2]))
    assert not verdict.stable  # no orbit: nothing repeats
    assert said(verdict, "The field changes with time")


def test_an_indefinite_hessian_is_unstable_and_says_where_to() -> None:
    saddle = velocity_actuated(field=es.Quadratic((0, 0), ((1.0, 1.5), (1.5, 1.0))))
    verdict = stability(saddle)
    assert verdict.stable is False
    assert verdict.evidence[3].stable is False
    assert said(verdict, "rises along (x -0.707, y +0.707), where its second derivative is +1")


def test_a_minimum_is_unstable() -> None:
    verdict = stability(velocity_actuated(**{"field.q": (-1.0, 0.5)}))
    assert not verdict.stable
    assert said(verdict, "The source is no maximum: the field rises along (x")


def test_a_flat_field_is_not_stable() -> None:
    flat = velocity_actuated(field=es.Expression("1 - x**2 + 0*y"), start=(0.1, 0.1))
    verdict = stability(flat)
    assert not verdict.stable
    assert said(verdict, "The field is flat to second order along (x +0.000, y +1.000)")
    assert "not isolated" in verdict.orbit.outcome
    assert said(verdict, "0 to rounding")


def test_an_opaque_field_is_judged_by_its_local_hessian() -> None:
    loop = velocity_actuated(
        field=es.Opaque(lambda p, t: float(-(p[0] ** 2) - 0.5 * p[1] ** 2)), start=(0.3, 0.2)
    )
    verdict = stability(loop)
    assert verdict.stable
    assert said(verdict, "Richardson")
    direct = stability(velocity_actuated(field=es.Quadratic((0, 0), (1, 0.5))))
    assert verdict.orbit.exponents == pytest.approx(direct.orbit.exponents, abs=1e-6)


def test_hidden_modes_are_named() -> None:
    hidden: dict[str, Any] = {
        "vehicle.axes.0": 1 / (s - 0.5),
        "controller.channels.0.compensator": (s - 0.5) / (s + 2),
    }
    verdict = stability(velocity_actuated(**hidden))
    assert not verdict.stable
    assert said(verdict, "at 0.5 1/s: that mode is hidden from the loop, and it is unstable")


def test_colliding_frequencies_are_computed_not_just_forbidden() -> None:
    twice = {
        "controller.channels.1.ratio": 2,
        "controller.channels.1.dither.phase": float(pi / 2),
        "controller.frequency": 100,
    }
    verdict = stability(velocity_actuated(**twice))
    assert said(verdict, "Frequencies collide (2 ω_x = ω_y)")
    assert said(verdict, "dỹ/dt gains α_x² c_y q_x/4")
    in_phase = stability(velocity_actuated(**{"controller.channels.1.dither.phase": 0.0}))
    assert not in_phase.stable
    assert said(in_phase, "Frequencies collide (ω_x = ω_y)")
    assert said(in_phase, "0 to rounding")
    assert not said(stability(velocity_actuated()), "collide")


def test_a_near_collision_is_said() -> None:
    near = velocity_actuated(**{"controller.channels.1.ratio": "101/100"})
    assert said(stability(near), "ω_x and ω_y differ by 0.3 rad/s")


def test_without_a_common_period_lyapunov_exponents_decide() -> None:
    verdict = stability(scenario("incommensurate").loop)
    assert verdict.stable
    assert verdict.evidence[3].title.startswith("Lyapunov exponents over")
    assert verdict.lyapunov is not None
    # their sum is the mean trace of the Jacobian, which is that of the average here
    assert verdict.lyapunov.exponents.sum() == pytest.approx(-5.5, abs=0.02)


def test_a_ramp_that_is_not_followed_is_not_called_stable() -> None:
    """1/(s − 0.1) falls behind a ramp for ever and escapes at last: no window shows that."""
    loop = velocity_actuated(
        **{
            "field": es.Moving(es.Quadratic((0, 0), (1, 0.5)), es.Line((0.05, 0.02))),
            "vehicle.axes": (1 / (s - 0.1), 1 / (s - 0.1)),
        }
    )
    verdict = stability(loop)
    assert not verdict.stable
    assert verdict.evidence[3].stable is None
    assert "otherwise than by sines" in verdict.evidence[3].silence


def test_an_escape_from_the_almost_periodic_motion_is_said() -> None:
    path = es.Circle(3.0, 5.1234567)
    loop = velocity_actuated(field=es.Moving(es.Quadratic((0, 0), (1, 0.5)), path))
    verdict = stability(loop)
    assert not verdict.stable
    assert "The loop escaped within" in verdict.evidence[3].silence
    assert not said(verdict, "no periodic orbit was found")


@pytest.mark.parametrize("turning", [30.0, 60.0])
def test_a_source_as_fast_as_the_dither_is_warned_of(turning: float) -> None:
    path = es.Circle(0.05, turning)
    loop = velocity_actuated(
        **{
            "field": es.Moving(es.Quadratic((0, 0), (1, 0.5)), path),
            "vehicle.axes.0": 1 / (s + 0.01),
        }
    )
    assert said(stability(loop), f"turns at {turning:.3g} rad/s")


def test_two_probes_in_quadrature_do_not_collide() -> None:
    probes = (es.Probe(2.4, 0.0), es.Probe(2.4, float(-pi / 2)))
    channels = tuple(
        es.Channel(probe, 10, reference=probe.phase - float(pi / 2)) for probe in probes
    )
    verdict = stability(velocity_actuated(**{"controller.channels": channels}))
    assert verdict.stable
    assert not said(verdict, "collide")


def test_where_no_orbit_is_found_nothing_is_claimed() -> None:
    far = scenario("fig7").loop.replace(
        {
            **{f"vehicle.axes.{i}.parameters.epsilon": 0.5 for i in (0, 1)},
            **{f"controller.channels.{i}.gain": 40 for i in (0, 1)},
            "field.source": (3, -3),
        }
    )
    verdict = stability(far)
    assert not verdict.stable
    assert verdict.average.stable
    assert verdict.evidence[3].stable is None
    assert "not shown to be stable" in verdict.text()
    assert said(verdict, "no periodic orbit was found")


@pytest.mark.parametrize(("zero", "pole", "stable"), [(-2, -1.3, False), (-0.5, -3, True)])
def test_verdicts_hold_in_simulation(zero: float, pole: float, *, stable: bool) -> None:
    """From a start near it the exact loop returns to its orbit, or leaves it."""
    loop = design(zero, pole, 60).replace({"start": es.OnDither((0.02, 0.02))})
    assert stability(loop).stable is stable
    run = es.simulate(loop, 30.0)
    early, late = (run.position.values[part] for part in (slice(0, 300), slice(-300, None)))
    grown = np.ptp(late, axis=0) > 2 * np.ptp(early, axis=0)
    assert bool(grown.any()) is not stable


def test_something_else_than_a_loop_is_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="loop = 3: must be a Loop"):
        stability(3)  # pyright: ignore[reportArgumentType]
