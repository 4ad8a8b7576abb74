"""The numbers that a design must reach: no bias, speed on an unstable pole, references in phase."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from typing import Any, Final

import numpy as np
import pytest
from scipy.signal import lsim

import extremum as es
from extremum import s
from extremum.papers.zhang2007 import scenario
from extremum.papers.zhang2007.schemes import single_integrators, unstable_poles

from .. import oracle
from ..plain import Vector
from .judged import hand_written, multipliers
from .random_requirements import requirements

CURVATURE: Final = ((1.0, 1.0), (0.5, 0.5))
POLE, SOURCE, FORCE = 0.5, (1.0, -1.0), 0.3

BIASED: Final[dict[str, dict[str, Any]]] = {
    "an unstable pole": {
        "axes": [{"kind": "1/(s - eps)", "lags": [], "pole": (POLE, POLE)}] * 2,
        "source_distance": 1.0,
    },
    "a force on a velocity": {
        "axes": [{"kind": "1/s", "lags": [], "pole": (0.0, 0.0)}] * 2,
        "force": FORCE,
    },
    "a force on a mass": {
        "axes": [{"kind": "1/s^2", "lags": [], "pole": (0.0, 0.0)}] * 2,
        "force": FORCE,
    },
}
"""What leaves a bias without integral action."""


def problem(name: str, *, quadrature: bool = True) -> dict[str, Any]:
    """The numbers of a problem on two axes, as `random_requirements` has them."""
    return {
        "curvature": CURVATURE,
        "dither_limit": 0.2,
        "settling_time": 5.0,
        "quadrature": quadrature,
        "source_distance": 0.0,
        "force": 0.0,
        "coupling": 0.0,
        "bandwidth": None,
        "start_distance": 0.0,
        "zero_bias": True,
        "input_limit": None,
        "frequency_limit": None,
        "motion": None,
        **BIASED[name],
    }


@cache
def designed(name: str, *, quadrature: bool = True) -> es.Design:
    return es.design(requirements(problem(name, quadrature=quadrature)))


def faster(loop: es.Loop, factor: float, **more: Any) -> es.Loop:
    """The loop with ω and h multiplied: the references stay right."""
    controller: Any = loop.controller
    changes = {
        "controller.frequency": controller.frequency * factor,
        "controller.washout": controller.washout * factor,
    }
    return loop.replace(changes | more)


# --- zero bias ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BIASED)
@pytest.mark.parametrize("quadrature", [True, False])
def test_no_bias_is_left(name: str, quadrature: bool) -> None:
    """At every corner of source and force, and at a point that nobody looked at."""
    design = designed(name, quadrature=quadrature)
    frequencies = design.controller.frequencies()
    assert (frequencies[0] == frequencies[1]) == quadrature
    ends = {path: high for path, (low, high) in design.box.items() if low < high}
    assert len(ends) == 2
    for shares in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0.37, -0.81)):
        point = {
            path: share * high for (path, high), share in zip(ends.items(), shares, strict=True)
        }
        orbit = es.periodic_orbit(design.at(point))
        assert orbit.found
        assert np.abs(orbit.offset).max() < 1e-9


@pytest.mark.parametrize("name", BIASED)
def test_no_bias_is_left_by_hand(name: str) -> None:
    """The same of loops written by hand, whose first guess is off by what holds the vehicle."""
    numbers, design = problem(name), designed(name)
    point = {path: 0.7 * high for path, (_, high) in design.box.items()} | {
        path: high for path, (_, high) in design.box.items() if path.startswith("field.q")
    }
    orbit = oracle.orbit(hand_written(numbers, design.controller, point))
    assert np.abs(orbit.offset).max() < 1e-9
    assert np.abs(multipliers(orbit)).max() < 1


def test_several_frequencies_are_odd_multiples_of_one() -> None:
    """Half a common period later every dither and reference has changed its sign."""
    channels = designed("an unstable pole", quadrature=False).controller.channels
    ratios = [Fraction(channel.ratio) for channel in channels]
    common = Fraction(1, math.lcm(*(ratio.denominator for ratio in ratios)))
    assert [ratio / common % 2 for ratio in ratios] == [1, 1]


def test_other_ratios_leave_a_bias_that_falls_as_one_over_the_frequency() -> None:
    """2 : 3 is not half-wave symmetric: what is left halves with every doubling of ω."""
    loop = designed("an unstable pole", quadrature=False).at({})
    offsets = [
        np.abs(
            es.periodic_orbit(
                faster(loop, k, **{"controller.channels.1.ratio": Fraction(3, 2)})
            ).offset
        ).max()
        for k in (1, 2, 4, 8)
    ]
    assert offsets[0] > 1e-3
    orders = np.log2(np.divide(offsets[:-1], offsets[1:]))
    assert (orders > 0.85).all()
    assert orders[-1] == pytest.approx(1.0, abs=0.02)


def test_the_papers_scheme_keeps_a_bias_for_an_unstable_pole() -> None:
    """ε x*/(αcq − ε) as ω → ∞; the error at finite ω falls with it."""
    kept = POLE * np.array(SOURCE) / (2.0 - POLE)
    errors = []
    for frequency in (480.0, 960.0, 1920.0):
        orbit = es.periodic_orbit(
            unstable_poles(frequency, 0.05, (40.0, 80.0), POLE, source=SOURCE)
        )
        assert orbit.stable
        errors.append(np.abs(orbit.offset - kept).max())
    assert errors[0] < 0.005
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(1.0, abs=0.1)


def test_the_papers_scheme_keeps_a_bias_for_a_force() -> None:
    """d/(αcq) as ω → ∞."""
    errors = []
    for frequency in (60.0, 120.0, 240.0):
        orbit = es.periodic_orbit(
            single_integrators(frequency, 0.1, (20.0, 40.0), force=(FORCE, -0.2))
        )
        errors.append(np.abs(orbit.offset - np.array([FORCE, -0.2]) / 2.0).max())
    assert errors[0] < 0.02
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("quadrature", [True, False])
def test_an_asymmetric_map_keeps_an_offset_of_order_two_in_the_dither(quadrature: bool) -> None:
    """(f_iii α²/16 + Σ f_ijj α²/8)/q_i, /16 on the cross term in quadrature, as ω → ∞."""
    design = es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=(1 / s, 1 / s)),
            curvature=CURVATURE,
            dither_limit=0.1,
            settling_time=4.0,
            quadrature=quadrature,
        )
    )
    a, b, c = 0.3, -0.2, 0.1
    field = es.Expression(f"1 - x**2 - 0.5*y**2 + {a}*x**3 + ({b})*x*y**2 + {c}*y**3")
    loop = design.at({}).replace({"field": field})
    alpha = [channel.dither.amplitude for channel in design.controller.channels]
    cross = 16 if quadrature else 8
    expected = np.array(
        [
            (6 * a * alpha[0] ** 2 / 16 + 2 * b * alpha[1] ** 2 / cross) / 1.0,
            6 * c * alpha[1] ** 2 / 16 / 0.5,
        ]
    )
    assert es.bias(loop).total == pytest.approx(expected, rel=1e-9)
    assert np.abs(expected).max() > 5e-4
    errors = [
        np.abs(es.periodic_orbit(faster(loop, k)).offset - es.bias(loop).total).max()
        for k in (1, 4, 16)
    ]
    assert errors[0] < 0.25 * np.abs(expected).max()
    assert errors[-1] < 0.02 * np.abs(expected).max()
    assert errors[2] < errors[1] < errors[0]


# --- how fast ------------------------------------------------------------------------------------


def near_from(loop: es.Loop, period: float, centre: Vector, duration: float) -> float:
    """The time (s) from which the mean over one period is, and stays, within 0.1 m of a place."""
    count, each = math.ceil(duration / period), 64
    run = es.simulate(loop, count * period, samples=count * each + 1)
    assert run.attrs["outcome"] == "completed"
    swept = np.cumsum(np.vstack([[0.0, 0.0], run.position.values]), axis=0)
    means = (swept[each:] - swept[:-each]) / each
    far = np.linalg.norm(means - centre, axis=1) > 0.1
    assert not far[-1]
    return float(run.time.values[len(far) - np.argmax(far[::-1])])


def test_the_weak_pole_of_figure_7_takes_longer_to_its_own_bias() -> None:
    """The measure that the next test goes by: 10.65 s."""
    loop = scenario("fig7").loop
    orbit = es.periodic_orbit(loop)
    assert near_from(loop, orbit.period, orbit.mean, 25.0) == pytest.approx(10.65, abs=0.01)


def test_an_unstable_pole_is_fast_and_without_a_bias() -> None:
    """ε = 0.5 from (0, 0) to (1, −1), for every pole from 0 to 0.5 and q up to 1 : 2."""
    pole = es.Rational("1/(s - epsilon)", parameters={"epsilon": POLE})
    design = es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=(pole, pole)),
            curvature=((0.7, 1.4), (0.35, 0.7)),
            uncertain={f"vehicle.axes.{k}.parameters.epsilon": (0.0, POLE) for k in (0, 1)},
            dither_limit=0.2,
            settling_time=6.0,
            source_distance=1.0,
            start_distance=1.5,
        )
    )
    point = {"field.source.0": 1.0, "field.source.1": -1.0, "field.q.0": 1.0, "field.q.1": 0.5}
    point |= {f"vehicle.axes.{k}.parameters.epsilon": POLE for k in (0, 1)}
    loop = design.at(point).replace({"start": (0.0, 0.0)})
    orbit = es.periodic_orbit(loop)
    assert orbit.stable
    assert np.abs(orbit.offset).max() < 1e-9
    assert near_from(loop, orbit.period, np.array(SOURCE), 25.0) < 10.65


# --- references ----------------------------------------------------------------------------------

PLANTS: Final = {
    "one integrator": (1 / s, 1 / s),
    "two integrators and a lag": (1 / s**2 / (0.05 * s + 1), 1 / (s * (s + 0.8))),
    "an unstable pole and two lags": (1 / ((s - 0.4) * (0.1 * s + 1) * (0.03 * s + 1)), 1 / s),
}


@pytest.mark.parametrize(
    ("name", "quadrature", "delay", "lag"),
    [
        ("one integrator", True, 0.0, 0.0),
        ("one integrator", False, 0.0, 0.2),
        ("one integrator", False, 0.03, 0.2),
        ("two integrators and a lag", True, 0.0, 0.0),
        ("two integrators and a lag", False, 0.0, 0.2),
        ("an unstable pole and two lags", True, 0.0, 0.0),
        ("an unstable pole and two lags", False, 0.0, 0.2),
    ],
)
def test_references_are_in_phase_with_what_returns(
    name: str, quadrature: bool, delay: float, lag: float
) -> None:
    """By quadrature of the exact steady dither response through sensor, dead time and washout.

    The vehicle's own phase is none of the reference's business: the probe has taken it back.
    """
    design = es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=PLANTS[name]),
            curvature=CURVATURE,
            dither_limit=0.1,
            settling_time=8.0,
            sensor=1 / (lag * s + 1) if lag else 1,
            delay=delay,
            quadrature=quadrature,
        )
    )
    controller: Any = design.controller
    still = {f"controller.channels.{k}.gain": 0.0 for k in (0, 1)}
    for axis, (channel, omega) in enumerate(
        zip(controller.channels, controller.frequencies(), strict=True)
    ):
        period, each, settle = 2 * np.pi / omega, 4000, 12
        times = np.linspace(0.0, period, each + 1)
        run = es.simulate(design.loop.replace(still), period, samples=times)
        one = run.position.values[:-1, axis] - design.loop.field.source[axis]  # pyright: ignore[reportAttributeAccessIssue]
        wave = np.append(np.tile(one, settle), one[0])
        whole = np.linspace(0.0, settle * period, len(wave))
        h = controller.washout
        _, washed, _ = lsim(([1.0, 0.0], [1.0, h]), wave, whole)
        received = washed if not lag else lsim(([1.0], [lag, 1.0]), washed, whole)[1]
        last, t = received[-each - 1 : -1], whole[-each - 1 : -1]
        psi = channel.reference.phase
        turned = omega * (t + delay) + psi  # the signal is late: t is when it left the field
        in_phase = float((np.sin(turned) * last).mean())
        across = float((np.cos(turned) * last).mean())
        assert in_phase > 0
        assert abs(across / in_phase) < 1e-4
        size = channel.dither.amplitude / 2 / math.hypot(1, h / omega) / math.hypot(1, lag * omega)
        assert in_phase == pytest.approx(size, rel=1e-3)
