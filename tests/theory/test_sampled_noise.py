"""What noise leaves of the error: closed forms, Lyapunov's equation, and runs by the thousand."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov
from scipy.stats import chi2
from sympy.parsing.sympy_parser import (
    implicit_multiplication,
    parse_expr,
    standard_transformations,
)

import extremum as es
from extremum import s
from extremum.theory.sampled import noise_variance

from .sampled_plain import Plain

APART: Any = {"controller.channels.1.ratio": "3/2"}
DT = 2 * math.pi / (30 * 52)
"""52 samples a period at ω = 30: near 4 ms."""


# --- Lyapunov's equation and closed forms --------------------------------------------------------


def test_the_closed_form_of_one_integrator() -> None:
    """c σ² dt/(4 α q): the standard deviations 0.106 and 0.150 of the known example."""
    found = noise_variance(velocity_actuated(), 1e-3, 0.6)
    assert found.closed_form == pytest.approx(10 * 0.36 * 1e-3 / (4 * 0.08 * np.array([1, 0.5])))
    assert found.deviation == pytest.approx([0.106, 0.150], abs=5e-4)
    c, alpha, q, sigma, dt = sympy.symbols("c_x alpha_x q_x sigma dt")
    assert found.law is not None
    (law,) = [sympy.sympify(str(found.law[0]))]
    assert sympy.simplify(law - c * sigma**2 * dt / (4 * alpha * q)) == 0


@pytest.mark.parametrize(
    ("vehicle", "compensator"),
    [
        (1 / s**2, es.Lead(5, -0.5, -3)),
        (1 / (s * (s + 0.7)), (s + 2) / (s + 5)),
        ((s + 3) / (s**2 * (s + 1)), 4 * (s + 0.2) / (s + 6)),
    ],
)
def test_closed_forms_solve_the_continuous_lyapunov_equation(
    vehicle: Any, compensator: Any
) -> None:
    sigma, dt, c = 0.4, 1e-3, 10.0
    loop = force_actuated(**{"vehicle.axes.0": vehicle,
                             "controller.channels.0.compensator": compensator})  # fmt: skip
    found = noise_variance(loop, dt, sigma)
    assert found.closed_form is not None
    g = 10 * 0.1 * 1.0
    law = sympy.sympify(compensator.law() if isinstance(compensator, es.Lead) else compensator)
    top, bottom = sympy.fraction(sympy.cancel(sympy.nsimplify(law * vehicle)))
    closed = sympy.Poly(sympy.expand(bottom + sympy.nsimplify(g) * top), s)
    den = np.array([float(x) for x in closed.all_coeffs()])
    num = np.array([float(x) for x in sympy.Poly(top, s).all_coeffs()]) / den[0]
    order = len(den) - 1
    a = np.eye(order, k=1)
    a[-1] = -den[:0:-1] / den[0]
    b = np.zeros((order, 1))
    b[-1] = 1
    p = solve_continuous_lyapunov(a, -b @ b.T * c**2 * sigma**2 * dt / 2)
    output = np.zeros(order)
    output[: len(num)] = num[::-1]
    assert found.closed_form[0] == pytest.approx(output @ p @ output)
    assert found.covariance[0, 0] == pytest.approx(found.closed_form[0], rel=0.02)


@pytest.mark.parametrize(
    ("changes", "late"),
    [
        ({}, {}),
        ({"field.q": ((1.0, 0.3), (0.3, 0.6))}, {"delay": 0.013}),
        (APART, {"delay": 0.3, "practice": es.Practice(delay=0.3), "lag": 0.05}),
    ],
)
def test_the_covariance_solves_the_discrete_lyapunov_equation(changes: Any, late: Any) -> None:
    """P = A P Aᵀ + B Q Bᵀ, Q = c²σ²/2 per axis: white noise, a washout that passes all of it."""
    loop = force_actuated(**{"controller.washout": 1e-9, **changes})
    found = noise_variance(loop, 0.004, 0.3, **late)
    a, b, c = (m.toarray() for m in found.gain.matrices())
    closed = a + b @ found.gain.slope @ c
    noise = np.diag([10.0**2 * 0.3**2 / 2] * 2)
    p = solve_discrete_lyapunov(closed, b @ noise @ b.T)
    assert found.covariance == pytest.approx(c @ p @ c.T, rel=1e-6, abs=1e-9)


def test_a_period_mean_is_the_mean_of_correlated_positions() -> None:
    """Of an AR(1) position, var/N² Σ_kl a^|k−l| over the N samples of a period."""
    loop = velocity_actuated(**{"controller.washout": 1e-9, **APART})
    found = noise_variance(loop, DT, 0.6)
    for i in range(2):
        kept = 1 + float(found.gain.slope[i, i]) * DT
        lags = np.abs(np.subtract.outer(np.arange(52), np.arange(52)))
        wanted = found.covariance[i, i] * (kept**lags).mean()
        assert found.period_covariance[i, i] == pytest.approx(wanted, rel=1e-6)


def test_correlated_noise_counts_by_its_spectrum_at_the_dither() -> None:
    """S(ω)/σ² = (1 − ρ²)/|1 − ρ e^(−jω dt)|², 2/(τ dt (ω² + 1/τ²)) for fast sampling."""
    white = noise_variance(velocity_actuated(), 1e-3, 0.1)
    for tau in (0.01, 0.1):
        found = noise_variance(velocity_actuated(), 1e-3, 0.1, correlation_time=tau)
        ratio = 2 / (tau * 1e-3 * (30**2 + 1 / tau**2))
        assert found.closed_form == pytest.approx(np.asarray(white.closed_form) * ratio, rel=1e-2)
        for ours, flat, part in (
            (found.period_covariance, white.period_covariance, 0.03),
            (found.covariance, white.covariance, 0.07),  # what is at 0 is moved to ω: jitter
        ):
            assert np.diag(ours) == pytest.approx(np.diag(flat) * ratio, rel=part)


@pytest.mark.parametrize("tau", [1e-9, 0.003, 0.05])
def test_the_printed_law_gives_the_printed_number(tau: float) -> None:
    """c dt σ²/(4 α q) S_n(ω dt)/σ², S_n the Fourier sum of the correlations ρ^|m|."""
    dt = 1e-3
    found = noise_variance(velocity_actuated(**APART), dt, 0.1, correlation_time=tau)
    lags = np.arange(1, 4000)
    correlation = np.exp(-lags * dt / tau)
    numbers = {"sigma": 0.1, "dt": dt, "tau_n": tau, "omega": 30.0}
    names = {name: sympy.Symbol(name, positive=True) for name in (
        *numbers, "c_x", "alpha_x", "q_x", "c_y", "alpha_y", "q_y")}  # fmt: skip
    printed = [line for line in str(found).splitlines() if "var " in line]
    deviations = re.findall(r"in closed form ([\d.]+) m", str(found))
    assert found.law is not None
    for i, (axis, w, q) in enumerate((("x", 30.0, 1.0), ("y", 45.0, 0.5))):
        own = {f"c_{axis}": 10.0, f"alpha_{axis}": 0.08, f"q_{axis}": q}
        spectrum = 1 + 2 * (correlation * np.cos(w * dt * lags)).sum()
        wanted = 10.0 * dt * 0.1**2 / (4 * 0.08 * q) * spectrum
        law: Any = found.law[i]
        table = {letter: (numbers | own)[letter.name] for letter in law.free_symbols}
        assert float(law.subs(table)) == pytest.approx(wanted, rel=1e-9)
        text = printed[i].split(" = ")[1]
        for shown, name in {"σ²": "sigma**2", "τ_n": "tau_n", "α": "alpha", "ω": "omega"}.items():
            text = text.replace(shown, name)
        read = parse_expr(text, names, (*standard_transformations, implicit_multiplication))
        values = {names[key]: number for key, number in (numbers | own).items()}
        assert float(read.subs(values)) == pytest.approx(wanted, rel=1e-9)
        assert float(deviations[i]) == pytest.approx(math.sqrt(wanted), rel=1e-3)


def test_axes_that_share_a_frequency_in_quadrature_are_uncorrelated() -> None:
    assert "correlation" not in str(noise_variance(velocity_actuated(), DT, 0.6))
    coupled = noise_variance(velocity_actuated(**{"field.q": ((1.0, 0.3), (0.3, 0.6))}), DT, 0.6)
    assert coupled.law is None
    assert coupled.closed_form is None
    assert "the axes are coupled: no closed form" in str(coupled)
    assert "x and y: correlation -0" in str(coupled)


# --- runs by the thousand ------------------------------------------------------------------------


def measured(plain: Plain, settle: float, duration: float, lanes: int, **noise: Any) -> Any:
    """Covariance of the position beside the dither, and of a period's mean."""
    offset = np.zeros((lanes, 2))
    period = 52
    first, last = round(settle / plain.dt), round((settle + duration) / plain.dt)
    total, instants, means = np.zeros((lanes, 2)), [], []
    for k, x in zip(range(last), plain.steps(offset, **noise), strict=False):
        beside = x - plain.dither(k)[0]
        total += beside
        if (k + 1) % period == 0:
            if k >= first:
                instants.append(beside)
                means.append(total / period)
            total = np.zeros((lanes, 2))
    return [np.cov(np.concatenate(rows).T) for rows in (instants, means)]


RUNS: Any = {
    "fig4": (velocity_actuated, Plain(DT), {}, 0.3),
    "fig4, correlated noise": (velocity_actuated, Plain(DT), {"correlation_time": 0.02}, 0.1),
    "fig4, late": (velocity_actuated, Plain(DT, delay=0.02, known=0.02), {}, 0.3),
    "fig2": (force_actuated, Plain(DT, 2, alpha=0.1, lead=(5, -0.5, -3)), {}, 0.15),
    "coupled": (
        force_actuated,
        Plain(DT, 2, alpha=0.1, lead=(5, -0.5, -3), q=((1.0, 0.3), (0.3, 0.6))),
        {},
        0.15,
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_monte_carlo(name: str) -> None:
    """5 % is 4 standard errors and more: 1600 lanes of 20 s, of 2.5 s memory at most."""
    make, plain, noise, sigma = RUNS[name]
    instant, mean = measured(plain, 12.0, 20.0, 1600, sigma=sigma, seed=7, **noise)
    loop = make(**{"field.q": plain.q})
    found = noise_variance(
        loop, DT, sigma, delay=plain.delay, practice=es.Practice(delay=plain.known), **noise
    )
    assert np.diag(instant) == pytest.approx(np.diag(found.covariance), rel=0.05)
    assert np.diag(mean) == pytest.approx(np.diag(found.period_covariance), rel=0.05)
    scale = math.sqrt(found.covariance[0, 0] * found.covariance[1, 1])
    assert instant[0, 1] == pytest.approx(found.covariance[0, 1], abs=0.05 * scale)


def test_monte_carlo_of_a_fast_loop() -> None:
    """C = 1, G = 1/s at ω = 120, g = 4: 1500 lanes of 6 s, 0.25 and 0.5 s of memory."""
    dt = 2 * math.pi / (120 * 52)
    changes = {"controller.frequency": 120, "controller.washout": 2.0}
    loop = velocity_actuated(**changes, **{f"controller.channels.{i}.gain": 50 for i in (0, 1)})
    plain = Plain(dt, omega=(120.0, 120.0), gain=(50.0, 50.0), washout=2.0)
    instant, mean = measured(plain, 2.5, 6.0, 1500, sigma=0.2, seed=3)
    found = noise_variance(loop, dt, 0.2)
    assert np.diag(instant) == pytest.approx(np.diag(found.covariance), rel=0.05)
    assert np.diag(mean) == pytest.approx(np.diag(found.period_covariance), rel=0.05)
    assert np.diag(instant) == pytest.approx(
        50 * 0.04 * dt / (4 * 0.08 * np.array([1, 0.5])), rel=0.06
    )


# --- probabilities and words ---------------------------------------------------------------------


def test_the_probability_of_being_near() -> None:
    """One axis: erf. Two equal axes: Rayleigh. Three: Maxwell. Unequal: drawn."""
    from extremum.theory.sampled.noise import _inside

    for axes in (1, 2, 3):
        wanted = chi2.cdf(1.3**2 / 0.7**2, axes)
        assert _inside(1.3, [0.7] * axes) == pytest.approx(wanted, rel=1e-4)
    draws = np.random.default_rng(1).standard_normal((400_000, 2)) * (0.3, 0.8)
    assert _inside(0.9, [0.3, 0.8]) == pytest.approx((np.hypot(*draws.T) < 0.9).mean(), abs=0.003)
    found = noise_variance(velocity_actuated(), 1e-3, 0.6)
    assert found.within(0.5) == pytest.approx(_inside(0.5, list(found.period_deviation)), rel=1e-6)


def test_the_percentages_of_the_known_example() -> None:
    """10,000 runs of fig4 in NumPy were within: 99.84 % and, with c = 5 and 0.3 m, 99.24 %."""
    first = noise_variance(velocity_actuated(), 1e-3, 0.6).within(0.5)
    weak = {f"controller.channels.{i}.gain": 5 for i in (0, 1)}
    second = noise_variance(velocity_actuated(**weak), 1e-3, 0.6).within(0.3)
    assert first == pytest.approx(0.9984, abs=3 * 0.0004)
    assert second == pytest.approx(0.9924, abs=3 * 0.0009)


def test_what_is_printed() -> None:
    text = str(noise_variance(velocity_actuated(), 1e-3, 0.6))
    assert "Residual error from noise, σ = 0.6 in a sample every 0.001 s" in text
    assert "var x = c_x dt σ²/(4 α_x q_x)" in text
    assert (
        "x: standard deviation 0.106 m, of a period's mean 0.1032 m; in closed form 0.1061" in text
    )
    coloured = str(noise_variance(velocity_actuated(), 1e-3, 0.6, correlation_time=0.05))
    assert "correlated over 0.05 s, in a sample" in coloured


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sigma": 0.0}, "sigma = 0.0: must be a finite number greater than 0"),
        ({"sigma": 1.0, "correlation_time": -1}, "correlation_time = -1: must not be negative"),
        ({}, "sigma: must be given: .* only a SampledLoop says"),
        ({"correlation_time": 0.1}, "sigma: must be given with a correlation_time"),
        (
            {"sigma": 1.0, "delay": 0.06},
            "loop: is not stable when sampled: its slowest mode is 0.2186",
        ),
    ],
)
def test_bad_numbers(arguments: Any, message: str) -> None:
    with pytest.raises(es.InvalidDescription, match=message):
        noise_variance(velocity_actuated(), 0.01, **arguments)
