"""Theorems 1 to 4: hypothesis, orbits, orders; orders from theory, orbits against plain SciPy."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from extremum import InvalidDescription
from extremum.papers.zhang2007.orders import Fit, measured
from extremum.papers.zhang2007.schemes import unstable_poles
from extremum.papers.zhang2007.theorem_plot import plot
from extremum.papers.zhang2007.theorems import Theorem, theorem

Vector = NDArray[np.float64]
NUMBERS = (1, 2, 3, 4)
RESIDUAL = "lim sup |f − f*|"


@cache
def run(number: int) -> Theorem:
    return theorem(number)


def fit(number: int, quantity: str, small: str, dithers: str = "quadrature") -> Fit:
    (found,) = (
        f
        for f in run(number).fits
        if f.quantity == quantity and f.small == small and f.dithers == dithers
    )
    return found


@pytest.mark.parametrize("number", NUMBERS)
def test_the_hypothesis_holds_and_every_orbit_is_stable(number: int) -> None:
    result = run(number)
    assert all(c.holds for c in result.printed)
    assert all(c.holds for c in result.corrected)
    assert result.stable
    assert result.frequencies[-1] == pytest.approx(10 * result.frequencies[0])


@pytest.mark.parametrize("dithers", ["quadrature", "separate"])
@pytest.mark.parametrize("number", NUMBERS)
def test_every_orbit_is_within_one_over_omega(number: int, dithers: str) -> None:
    """Order 1; for two integrators the position's ripple is of order 2."""
    order = {2: 2}.get(number, 1)
    assert fit(number, "|x̃ − x̃ᵉ|", "1/ω", dithers).slope == pytest.approx(order, abs=0.1)
    assert fit(number, "|e − eᵉ|", "1/ω", dithers).slope == pytest.approx(1, abs=0.1)
    assert not fit(number, "|x̃ − x̃ᵉ|", "1/ω", dithers).refuted


def test_the_residual_error_of_theorem_1() -> None:
    """Above its α² it falls as 1/ω² in quadrature, as 1/ω with frequencies 2 : 3; (16)."""
    name = f"{RESIDUAL} from its limit"
    assert fit(1, name, "1/ω", "quadrature").slope == pytest.approx(2, abs=0.1)
    separate = fit(1, name, "1/ω", "separate")
    assert separate.slope == pytest.approx(1, abs=0.1)
    assert "lower than the 2 of (16): the product" in separate.verdict
    assert not separate.refuted
    assert fit(1, RESIDUAL, "α").slope == pytest.approx(2, abs=0.1)


def test_the_residual_error_of_theorem_2() -> None:
    """Two integrators: the ripple, and with it the residual's, is of order 2 with either."""
    for dithers in ("quadrature", "separate"):
        name = f"{RESIDUAL} from its limit"
        assert fit(2, name, "1/ω", dithers).slope == pytest.approx(2, abs=0.1)
    assert fit(2, RESIDUAL, "α").slope == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("number", [3, 4])
def test_the_residual_error_with_a_bias_is_of_first_order_in_each(number: int) -> None:
    """f − f* = −q(x̃ᵉ + α sin + O(1/ω))²: each product with the bias is linear."""
    for dithers in ("quadrature", "separate"):
        name = f"{RESIDUAL} from its limit"
        assert fit(number, name, "1/ω", dithers).slope == pytest.approx(1, abs=0.11)
    assert fit(number, f"{RESIDUAL} above q(x̃ᵉ)²", "α").slope == pytest.approx(1, abs=0.15)
    pole = fit(number, f"{RESIDUAL} above that of ε = 0", "ε")
    assert pole.slope == pytest.approx(1, abs=0.15)
    assert "falls only as ε" in pole.verdict


@pytest.mark.parametrize("number", NUMBERS)
def test_all_small_numbers_together_have_the_printed_order(number: int) -> None:
    """O(α² + 1/ω² + ε²) as a bound for the sum: scaled together the order is 2."""
    together = fit(number, RESIDUAL, "all")
    assert together.slope == pytest.approx(2, abs=0.1)
    assert together.as_printed
    assert "as printed" in together.verdict


def test_together_means_that_frequency_amplitude_and_pole_all_shrink() -> None:
    """A tenth of α = 0.05 and ε = 0.005, ten times ω = 400, αc held."""
    loop = unstable_poles(4000.0, 0.005, 100.0, 0.0005, source=(1.0, -1.0))
    assert fit(3, RESIDUAL, "all").y[0] == pytest.approx(measured(loop).residual, rel=1e-9)


@pytest.mark.parametrize("dithers", ["quadrature", "separate"])
def test_the_compensators_output_is_not_within_one_over_omega(dithers: str) -> None:
    output = fit(4, "|w − wᵉ|", "1/ω", dithers)
    assert output.slope == pytest.approx(0, abs=0.05)
    assert output.refuted
    assert "false as printed" in output.verdict


def test_the_printed_equilibrium_is_not_approached() -> None:
    """With g = 2, 1: (54) gives x̃ᵉ = 0.05, −2/15; the corrected one 0.04, −0.1."""
    wrong = fit(4, "|x̃ − x̃ᵉ|, x̃ᵉ of (54)", "1/ω")
    assert wrong.y[-1] == pytest.approx(2 / 15 - 0.1, abs=1e-3)
    assert wrong.refuted


@pytest.mark.parametrize(("number", "corrected"), [(2, 0.1515), (4, None)])
def test_the_printed_hypothesis_is_not_sufficient(number: int, corrected: float | None) -> None:
    """Erratum 1's first design; λ² + 1.5λ − 0.3 in y for the other, (√3.45 − 1.5)/2."""
    found = run(number).counterexample
    assert found is not None
    assert found.printed < 0
    expected = (np.sqrt(1.5**2 + 1.2) - 1.5) / 2 if corrected is None else corrected
    assert found.corrected == pytest.approx(expected, abs=1e-4)
    assert (found.measured > 0).all()
    assert found.measured[-1] == pytest.approx(expected, abs=1e-3)
    assert "as printed it is false" in str(run(number))


def test_theorems_1_and_3_have_no_counterexample() -> None:
    assert run(1).counterexample is None
    assert run(3).counterexample is None
    assert "false" not in str(run(1))


def test_a_verdict_is_a_sentence_with_both_orders() -> None:
    for number in NUMBERS:
        for found in run(number).fits:
            assert found.verdict.endswith(".")
            assert found.as_printed or (found.remark and found.remark in found.verdict)


def test_another_number_is_refused() -> None:
    with pytest.raises(InvalidDescription, match="must be 1, 2, 3 or 4"):
        theorem(5)


# --- against plain SciPy -----------------------------------------------------------------------


def test_the_first_point_of_theorem_1_by_hand() -> None:
    """Equations (7) to (9), integrated until the transient is below 1e-7; ω = 30."""
    w, a, c, h, qx, qy = 30.0, 0.08, 10.0, 1.0, 1.0, 0.5
    level = -(a**2) / 2 * (qx + qy)

    def rates(tau: float, state: Vector) -> list[float]:
        x, y, e = state
        sine, cosine = np.sin(tau), np.cos(tau)
        delta = -(qx * (x + a * sine) ** 2 + qy * (y - a * cosine) ** 2 + e)
        return [c * delta * sine / w, -c * delta * cosine / w, h * delta / w]

    x, y, e, tau = settled(rates, [0.0, 0.0, level], 1200)
    first = {f.quantity: f for f in run(1).fits if (f.small, f.dithers) == ("1/ω", "quadrature")}
    distance = max(np.abs(x).max(), np.abs(y).max())
    assert first["|x̃ − x̃ᵉ|"].y[0] == pytest.approx(distance, rel=1e-3)
    assert first["|e − eᵉ|"].y[0] == pytest.approx(np.abs(e - level).max(), rel=1e-3)
    far = qx * (x + a * np.sin(tau)) ** 2 + qy * (y - a * np.cos(tau)) ** 2
    excess = abs(far.max() - a**2)
    assert first[f"{RESIDUAL} from its limit"].y[0] == pytest.approx(excess, rel=1e-2)


def test_the_compensators_output_of_theorem_4_by_hand() -> None:
    """(44) to (48) at ω = 100 with a proper state: w = k(m + (p − z)ζ), ζ̇ = pζ + m."""
    w, a, c, h, k, z, p, pole = 100.0, 0.1, 10.0, 1.0, 2.0, -3.0, -2.0, 0.5
    q, source = np.array([1.0, 0.5]), np.array([0.2, -0.2])
    g = a * c * k * q
    offset = p * pole * source / (g * z - p * pole)
    still = -pole * (offset + source)

    def outputs(tau: float, state: Vector) -> tuple[Vector, Vector, float]:
        wave = np.array([np.sin(tau), -np.cos(tau)])
        delta = -float(q @ (state[:2] + a * wave) ** 2 + state[4])
        return c * delta * wave, wave, delta

    def rates(tau: float, state: Vector) -> Vector:
        m, wave, delta = outputs(tau, state)
        out = k * (m + (p - z) * state[2:4])
        moved = pole * (state[:2] + source + a * wave) + out
        return np.concatenate([moved, p * state[2:4] + m, [h * delta]]) / w

    level = -float(q @ (a**2 / 2 + offset**2))
    begun = [*offset, *(a * c * q * offset / p), level]
    *states, tau = settled(rates, begun, 1600)
    found = np.array(
        [
            k * (outputs(t, s)[0] + (p - z) * s[2:4])
            for t, s in zip(tau, np.array(states).T, strict=True)
        ]
    )
    ripple = np.abs(found - still).max()
    assert fit(4, "|w − wᵉ|", "1/ω").y[0] == pytest.approx(ripple, rel=1e-3)


def settled(rates: object, begun: list[float], radians: float) -> list[Vector]:
    """Return the states over the last turn of a long run, and τ there."""
    end = 2 * np.pi * round(radians / (2 * np.pi))
    grid = np.linspace(end, end + 2 * np.pi, 401)
    run_ = solve_ivp(
        rates,  # pyright: ignore[reportArgumentType]
        (0.0, grid[-1]),
        begun,
        method="DOP853",
        rtol=1e-9,
        atol=1e-12,
        max_step=0.6,
        t_eval=grid,
    )
    return [*run_.y, run_.t]


# --- the figure ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("number", "panels"), [(1, 4), (2, 4), (3, 5), (4, 5)])
def test_the_figure_shows_every_fit_with_its_order(
    number: int, panels: int, tmp_path: Path
) -> None:
    figure = plot(run(number))
    assert len(figure.axes) == panels
    labels = [text for axes in figure.axes for text in axes.get_legend_handles_labels()[1]]
    assert len(labels) == len(run(number).fits)
    for found in run(number).fits:
        shown = f"order {found.slope:.2f}, printed {found.printed}"
        assert any(shown in label for label in labels)
    assert all(axes.get_xscale() == axes.get_yscale() == "log" for axes in figure.axes)
    figure.savefig(tmp_path / "theorem.png")
    assert (tmp_path / "theorem.png").stat().st_size > 10_000
