"""The procedures on exact loops: roots, Floquet exponents, runs against plain SciPy, the figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from averaged import integrators_at, pole_at
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import extremum as es
from extremum.papers.zhang2007.procedure_cases import CASES, Case, table
from extremum.papers.zhang2007.procedure_plot import plot
from extremum.papers.zhang2007.procedures import (
    UnstablePoles,
    for_double_integrators,
    for_unstable_poles,
)
from extremum.papers.zhang2007.schemes import unstable_poles

ROOT = Path(__file__).parents[2]
Vector = NDArray[np.float64]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_every_case_is_judged_alike_by_its_roots_by_its_orbit_and_by_its_run(case: Case) -> None:
    procedure = case.procedure
    if isinstance(procedure, UnstablePoles):
        rate = max(pole_at(procedure, q, procedure.pole_high) for q in (1.0, 0.5))
    else:
        rate = max(integrators_at(procedure, q) for q in (1.0, 0.5))
    exact = es.periodic_orbit(case.loop).exponents.real
    assert exact[0] == pytest.approx(max(rate, -procedure.washout), abs=2e-3)
    assert (rate < 0) == procedure.as_corrected
    printed, corrected, *_ = case.verdict.evidence
    assert printed.stable is procedure.as_printed
    assert corrected.stable is procedure.as_corrected
    assert case.verdict.stable is procedure.as_corrected
    _, distance = case.distance
    if procedure.as_corrected:
        assert distance[-1] < 1e-4 < distance[0] / 1000
        assert case.ended.startswith("below 1 mm")
    else:
        assert distance[-1] > 10 * distance[0]


def test_the_cases_hold_both_errors_of_both_printed_rules() -> None:
    for theirs in (CASES[:3], CASES[3:]):
        met = [(c.procedure.as_printed, c.procedure.as_corrected) for c in theirs]
        assert met == [(True, False), (True, True), (False, True)]
        first, second = (c.procedure for c in theirs[:2])
        assert (first.amplitude, first.washout, first.gain, first.lead.gain) == (
            *(second.amplitude, second.washout, second.gain, second.lead.gain),
        )
    assert CASES[3].run.attrs["outcome"] == "escaped"


@pytest.mark.parametrize("zero", [-0.52, -0.48])
def test_the_boundary_of_the_exact_loop_is_the_corrected_one(zero: float) -> None:
    """q_low = 0.5 and ε_high = 0.5: z = −0.5, whether h is a tenth or four times of it."""
    for washout in (0.05, 2.0):
        procedure = for_unstable_poles(0.5, 0.5, washout=washout, gain=20.0, zero=zero)
        orbit = es.periodic_orbit(procedure.loop(400.0))
        assert orbit.stable is (zero < -0.5)
    safe = es.periodic_orbit(procedure.loop(400.0, q=(0.6, 0.6)))
    assert safe.stable
    assert es.periodic_orbit(procedure.loop(400.0, pole=0.45)).stable


@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_the_exact_loop_decays_as_asked(factor: float) -> None:
    procedure = for_double_integrators(0.5, 0.2, washout=1.0)
    q = 0.5 * factor
    orbit = es.periodic_orbit(procedure.loop(200.0, q=(q, 2 * q)))
    assert orbit.stable
    assert orbit.exponents[0].real < -0.2


def test_a_lead_leaves_a_larger_bias_than_gain_alone() -> None:
    """|z| < αckq_low: x̃ᵉ = εx*/(αckq |z|/|p| − ε), gain alone ε/(αckq − ε)."""
    source = (0.02, -0.02)
    procedure = for_unstable_poles(0.5, 0.5, gain=20.0, zero=-0.9)
    with_lead = es.periodic_orbit(procedure.loop(3200.0, q=(1.0, 0.5), source=source)).offset
    alone = unstable_poles(3200.0, 0.1, 20.0, 0.5, source=source)
    without = es.periodic_orbit(alone).offset
    expected = [procedure.bias(q, 0.5) for q in (1.0, 0.5)]
    assert with_lead / source == pytest.approx(expected, rel=0.02)
    assert expected == pytest.approx([0.5 / 1.3, 0.5 / 0.4])
    assert without / source == pytest.approx([0.5 / 1.5, 0.5 / 0.5], rel=0.02)
    assert (np.abs(with_lead) > np.abs(without)).all()


def fig_3(w: float, h: float, a: float, c: float, z: float, p: float, e: float) -> Any:
    """Fig. 3 written by hand, k = 1, q = (1, 0.5), source at the origin: x, y, ζ_x, ζ_y, η."""

    def rhs(t: float, state: Vector) -> list[float]:
        x, y, zx, zy, eta = state
        xi = 1.0 - x * x - 0.5 * y * y - eta
        mx, my = c * xi * np.sin(w * t), -c * xi * np.cos(w * t)
        vx = a * w * np.cos(w * t) + mx + (p - z) * zx
        vy = a * w * np.sin(w * t) + my + (p - z) * zy
        return [e * x + vx, e * y + vy, p * zx + mx, p * zy + my, h * xi]

    return rhs


@pytest.mark.parametrize("index", [0, 1])
def test_the_runs_are_those_of_plain_scipy(index: int) -> None:
    """The printed rule's growth is e^(0.1787 t), the corrected rule's decay its slowest root's."""
    case = CASES[index]
    p = case.procedure
    rhs = fig_3(400.0, p.washout, p.amplitude, p.gain, p.lead.zero, p.lead.pole, 0.5)
    last = 12 * 1273 // 20 * 20
    times = case.run.time.values[:last]
    x, y = case.start
    begun = [x, y, 0.0, 0.0, 1.0 - x * x - 0.5 * y * y]
    found = solve_ivp(
        rhs, (0.0, times[-1]), begun, "DOP853", times, rtol=1e-9, atol=1e-10, max_step=7.8e-4
    )  # fmt: skip
    np.testing.assert_allclose(found.y[:2].T, case.run.position.values[:last], atol=1e-6)
    means = found.y[:2].reshape(2, -1, 20).mean(axis=2)
    distance = np.linalg.norm(means, axis=0)
    seconds = times.reshape(-1, 20).mean(axis=1)
    late = seconds > 6
    slope = np.polyfit(seconds[late], np.log(distance[late]), 1)[0]
    assert isinstance(p, UnstablePoles)
    assert slope == pytest.approx(pole_at(p, 0.5, 0.5), rel=0.05)


# --- what is shown -----------------------------------------------------------------------------


def test_the_figure_shows_where_the_rules_and_the_exact_loops_agree() -> None:
    """Colours: allowed by both, as printed only, as corrected only, by neither; circles: stable."""
    figure = plot()
    poles, integrators = [axes for axes in figure.axes if axes.axison][:2]
    for axes, corrected, printed in (
        (poles, lambda x, _: x < -1, lambda x, y: x < -y),
        (integrators, lambda x, y: y < x, lambda x, y: x < -1 and y < x + 1),
    ):
        mesh: Any = axes.collections[0]
        kinds, corners = mesh.get_array(), mesh.get_coordinates()
        seen: list[int] = []
        for line in axes.get_lines():
            if line.get_marker() not in ("o", "X"):
                continue
            x, y = np.array(line.get_data(), dtype=float)[:, 0]
            assert (line.get_marker() == "o") == corrected(x, y)
            row = np.searchsorted(corners[:, 0, 1], y) - 1
            column = np.searchsorted(corners[0, :, 0], x) - 1
            seen.append(int(kinds[row, column]))
            assert seen[-1] == 2 * (not printed(x, y)) + (not corrected(x, y))
        assert set(seen) == {0, 1, 2, 3}


def test_the_page_shows_the_table_of_cases() -> None:
    assert table().markdown() in (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
