"""The averaged loop: the paper's equations by hand, quadrature, limits, and the exact loop."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated
from scipy.integrate import quad

import extremum as es
from extremum import pi, s
from extremum.papers.zhang2007 import NAMES, scenario
from extremum.theory.averaging import Average, average
from extremum.theory.orbits import periodic_orbit
from extremum.theory.wording import paper_form


def letters(names: str) -> Any:
    """Symbols as the package makes them, by their printed names."""
    return [sympy.Symbol(name, real=True) for name in names.split()]


def same(expression: Any, other: Any) -> bool:
    """Whether two expressions agree whatever is assumed of their symbols."""
    both = []
    for e in (expression, other):
        table = {x: sympy.Symbol(x.name) for x in sympy.sympify(e).free_symbols}
        both.append(sympy.sympify(e).xreplace(table))
    return sympy.simplify(both[0] - both[1]) == 0


# --- the paper's equations, written by hand ----------------------------------------------------


def in_tau(loop: es.Loop) -> dict[str, Any]:
    """Return the averaged rates in τ = ωt as they are printed, by state."""
    states, rates, _ = paper_form(average(loop).averaged)
    return {x.name: e / sympy.Symbol("omega") for x, e in zip(states, rates, strict=True)}


def test_equations_10_to_12_are_printed() -> None:
    rates = in_tau(velocity_actuated())
    a, b, cx, cy, qx, qy, h, w = letters("alpha_x alpha_y c_x c_y q_x q_y h omega")
    x, y, e = letters("xtilde ytilde e")
    assert same(rates["xtilde"], -a * cx * qx * x / w)
    assert same(rates["ytilde"], -b * cy * qy * y / w)
    ripple = (a**2 * qx + b**2 * qy) / 2
    assert same(rates["e"], -h / w * (qx * x**2 + qy * y**2 + e + ripple))
    text = average(velocity_actuated()).text()
    assert "dx̃/dτ = -α_x c_x q_x x̃/ω" in text
    assert "de/dτ = -h (α_x² q_x/2 + α_y² q_y/2 + e + q_x x̃² + q_y ỹ²)/ω" in text


def test_equations_13_and_14() -> None:
    found = average(velocity_actuated())
    law = {x.name: e for x, e in (found.equilibrium_law or {}).items()}
    a, b, cx, cy, qx, qy, h = letters("alpha_x alpha_y c_x c_y q_x q_y h")
    assert law["xtilde"] == law["ytilde"] == 0
    assert same(law["e"], -(a**2 * qx + b**2 * qy) / 2)
    wanted = sympy.diag(-a * cx * qx, -b * cy * qy, -h)
    pairs = zip(found.jacobian.flat(), wanted.flat(), strict=True)
    assert all(same(ours, theirs) for ours, theirs in pairs)


def test_the_corrected_24_to_28_and_31() -> None:
    rates = in_tau(force_actuated())
    a, c, k, q, p, z, w, x, v, u = letters("alpha_x c_x k_x q_x p_x z_x omega xtilde vtilde_x w_x")
    assert same(rates["xtilde"], v / w)
    assert same(rates["vtilde_x"], u / w)
    g = a * c * k * q
    assert same(rates["w_x"], (p * u + g * z * x - g * v) / w)  # printed: g (z + h) x̃
    (cubic, *_) = average(force_actuated()).characteristic
    assert cubic is not None
    for ours, theirs in zip(cubic, (1, -p, g, -g * z), strict=True):
        assert same(ours, theirs)


def test_equation_43_and_the_corrected_52_and_54() -> None:
    loop = scenario("unstable").loop
    lead = es.Lead(4, -3, -2.5)
    loop = loop.replace({f"controller.channels.{i}.compensator": lead for i in (0, 1)})
    rates = in_tau(loop)
    a, c, k, q, p, z, eps, w, x, u, r = letters(
        "alpha_x c_x k_x q_x p_x z_x epsilon_x omega xtilde w_x x^*"
    )
    g = a * c * k * q
    assert same(rates["xtilde"], (eps * (x + r) + u) / w)  # (49)
    # printed: g (z - 2ε + h) x̃
    assert same(rates["w_x"], ((p - g) * u + g * (z - eps) * x - g * eps * r) / w)
    law = {x.name: e for x, e in (average(loop).equilibrium_law or {}).items()}
    assert same(law["xtilde"], p * eps * r / (g * z - p * eps))
    bare = average(scenario("fig7").loop).equilibrium_law or {}
    first = {x.name: e for x, e in bare.items()}["xtilde"]
    assert same(first, eps * r / (a * c * q - eps))


@pytest.mark.parametrize("name", NAMES)
def test_every_average_prints_as_text_and_latex(name: str) -> None:
    from matplotlib.mathtext import MathTextParser

    found = average(scenario(name).loop)
    assert "Stable if and only if" in str(found)
    lines = found.latex().split("\n")[1:-1]
    for line in lines:
        MathTextParser("agg").parse(f"${line.replace('&', '').rstrip(chr(92)).strip()}$")


# --- against averaging by quadrature of the exact rates ----------------------------------------


def by_quadrature(found: Average, state: np.ndarray, points: int = 4096) -> np.ndarray:
    """Average the exact rates over the common period, the source held where it is at t = 0."""
    frame = found.frame
    rates = frame.system.function(list(frame.system.rhs), vector=True)
    period = frame.period()
    assert period is not None
    times = period[0] * np.arange(points) / points
    states = [np.full(points, x) for x in state]
    return np.array([np.mean(e + 0 * times) for e in rates(times, states, frame.values)])


def coupled(field: es.Field, ratios: tuple[Any, ...], phases: tuple[float, ...]) -> es.Loop:
    """Axes 1/s, 1/s² and 1/(s − 0.3), as many as there are ratios."""
    axes = (1 / s, 1 / s**2, 1 / (s - 0.3))[: len(ratios)]
    leads = (es.TransferFunction(), es.Lead(4, -0.7, -5), es.Lead(2, -1, -3))
    return es.Loop(
        field=field,
        vehicle=es.PointMass(axes=axes),
        controller=es.GradientES(
            frequency=40,
            washout=1.3,
            channels=tuple(
                es.Channel(es.Dither(0.1 + 0.02 * i, phase=p), 3 + i, leads[i], ratio=r)
                for i, (r, p) in enumerate(zip(ratios, phases, strict=True))
            ),
        ),
        start=(0.1,) * len(ratios),
    )


QUADRATIC = es.Quadratic((0.2, -0.1, 0.3), ((1, 0.3, 0.1), (0.3, 0.6, -0.2), (0.1, -0.2, 0.8)))
CUBIC = es.Expression("1 - x**2 - 0.7*y**2 + 0.2*x**3 - 0.3*x*y**2 + 0.1*x**2*y - 0.05*y**4")
GAUSSIAN = es.Gaussian((0.1, 0.2), width=(0.5, 0.8))


@pytest.mark.parametrize(
    ("field", "ratios", "phases"),
    [
        (QUADRATIC, (2, 3, 5), (0.0, 0.4, 1.0)),
        (QUADRATIC, (1, 1, 2), (0.0, float(-pi / 2), float(pi / 2))),
        (QUADRATIC, (Fraction(1, 2), Fraction(2, 3), 1), (0.2, 0.0, -1.0)),
        (CUBIC, (1, 1), (0.0, float(-pi / 2))),
        (CUBIC, (1, 3), (0.3, 1.2)),
        (CUBIC, (2, 3), (0.0, 0.0)),
        (GAUSSIAN, (1, 1), (0.0, float(-pi / 2))),
        (GAUSSIAN, (1, 2), (0.3, 0.9)),
    ],
)
def test_the_mean_of_the_exact_rates(
    field: es.Field, ratios: tuple[Any, ...], phases: tuple[float, ...]
) -> None:
    found = average(coupled(field, ratios, phases))
    # the limit ω → ∞: the unstable axis' dither is α sin there, as its probe goes through 1/G
    assert found.exact == (field is not GAUSSIAN)
    rng = np.random.default_rng(1)
    for _ in range(3):
        state = rng.uniform(-0.5, 0.5, len(found.states))
        rates = found.system.rates(0.0, state.tolist(), found.values)
        assert rates == pytest.approx(by_quadrature(found, state), rel=1e-9, abs=1e-11)


def test_the_mean_over_the_torus_of_incommensurate_phases() -> None:
    found = average(coupled(GAUSSIAN, (1, 2**0.5), (0.3, 0.9)))
    assert not found.exact
    assert found.frame.period() is None
    state = [0.2, -0.1, 0.05, 0.3, 0.0]
    rates = found.system.rates(0.0, state, found.values)
    grid = 2 * np.pi * np.arange(64) / 64
    one, two = np.meshgrid(grid, grid)
    x = 0.2 + 0.1 * np.sin(one + 0.3)
    y = -0.1 + 0.12 * np.sin(two + 0.9)
    J = np.exp(-(x**2) / (2 * 0.25) - y**2 / (2 * 0.64))  # noqa: N806
    assert rates[0] == pytest.approx(3 * np.mean(J * np.sin(one + 0.3)), rel=1e-12)


def test_quadrature_is_right_and_states_its_error() -> None:
    found = average(velocity_actuated(field=es.InverseSquare((-1, -1), 0.5)))

    def pulled(offset: float) -> float:
        def weighted(theta: float) -> float:
            x, y = offset + 0.08 * np.sin(theta), -0.08 * np.cos(theta)
            return np.sin(theta) / (1 + (x**2 + y**2) / 0.25) / (2 * np.pi)

        return 10 * quad(weighted, 0, 2 * np.pi, epsabs=1e-14)[0]

    rate = found.system.rates(0.0, [0.3, 0.0, 0.0], found.values)[0]
    assert rate == pytest.approx(pulled(0.3), abs=1e-12)
    slope = (pulled(1e-5) - pulled(-1e-5)) / 2e-5
    assert found.eigenvalues.real == pytest.approx(sorted([slope, slope, -1], reverse=True))
    assert 0 <= found.error < 1e-12


def test_quadrature_takes_as_many_points_as_a_sharp_peak_needs() -> None:
    """J = 1/(1 + r²/w²), w a quarter of the dither; ⟨J⟩ on the circle r = α is J(α)."""
    loop = velocity_actuated(field=es.InverseSquare((-1, -1), 0.02))
    found = average(loop)
    rates = found.system.rates(0.0, [0.0, 0.0, 0.0], found.values)
    assert rates[2] == pytest.approx(1 / (1 + 16) - 1, abs=1e-14)
    theta = 2 * np.pi * np.arange(1 << 14) / (1 << 14)
    x, y = 0.05 + 0.08 * np.sin(theta), -0.08 * np.cos(theta)
    pulled = np.mean(10 * np.sin(theta) / (1 + (x**2 + y**2) / 0.02**2))
    rate = found.system.rates(0.0, [0.05, 0.0, 0.0], found.values)[0]
    assert rate == pytest.approx(pulled, rel=1e-11)


def test_a_field_with_a_kink_is_refused() -> None:
    kinked = es.Expression("-sqrt(x**2 + y**2)")
    with pytest.raises(es.InvalidDescription, match=r"not converged|no maximum|no finite"):
        average(velocity_actuated(field=kinked, start=(0.1, 0.2))).eigenvalues  # noqa: B018


# --- limits --------------------------------------------------------------------------------------


def test_case_5_the_path_comes_nearer_as_one_over_omega() -> None:
    distances = []
    frequencies = np.array([20.0, 40, 80, 160, 320])
    for frequency in frequencies:
        loop = velocity_actuated(
            **{"controller.frequency": frequency, "start": (-0.9, -0.9)},
        )
        times = np.linspace(0, 3, 3001)
        found = average(loop)
        run = es.simulate(loop, 3.0, samples=3001)
        theta = frequency * times
        dither = 0.08 * np.stack([np.sin(theta), -np.cos(theta)], axis=1)
        offset = run.position.values - (-1.0) - dither
        distances.append(np.abs(offset - found.simulate(3.0, samples=3001).offset.values).max())
    slope = np.polyfit(np.log(frequencies), np.log(distances), 1)[0]
    assert slope == pytest.approx(-1, abs=0.1)


@pytest.mark.parametrize("name", ["constant_force", "three_d"])
def test_the_second_order_halves_twice(name: str) -> None:
    """Its error in the orbit's mean falls as ω⁻², where the first order's falls as ω⁻¹."""
    errors: dict[int, list[float]] = {1: [], 2: []}
    for frequency in (120, 240):
        loop = scenario(name).loop.replace({"controller.frequency": frequency})
        exact = periodic_orbit(loop).offset
        for order, found in errors.items():
            found.append(float(np.abs(average(loop, order=order).offset - exact).max()))
    assert errors[1][0] / errors[1][1] == pytest.approx(2, rel=0.05)
    assert errors[2][0] / errors[2][1] > 3.7


def test_the_second_order_knows_the_washouts_phase() -> None:
    """Two equal axes: eigenvalues −g ± jg δ, δ = (h + αcq/2)/ω to the second order."""
    loop = velocity_actuated(**{"field.q": (1.0, 1.0), "controller.frequency": 200})
    found = average(loop, order=2).eigenvalues
    orbit = periodic_orbit(loop).exponents
    assert sorted(found.imag) == pytest.approx(sorted(orbit.imag), abs=2e-5)
    assert max(orbit.imag) > 1e-3


def test_the_centre_of_a_cubic_field() -> None:
    a, b, q, r = 0.1, 0.15, 1.0, 0.5
    fxxx, fxyy, fxxy, fyyy = 0.3, 0.2, 0.25, -0.4
    field = es.Expression(
        f"-{q}*x**2 - {r}*y**2 + {fxxx}*x**3/6 + {fxyy}*x*y**2/2 + {fxxy}*x**2*y/2 + {fyyy}*y**3/6"
    )
    apart = velocity_actuated(
        **{
            "field": field,
            "start": (0, 0),
            "controller.channels.0.dither.amplitude": a,
            "controller.channels.1.dither.amplitude": b,
            "controller.channels.0.ratio": 4,
            "controller.channels.1.ratio": 5,
        }
    )
    x = (fxxx * a**2 / 16 + fxyy * b**2 / 8) / q
    y = (fyyy * b**2 / 16 + fxxy * a**2 / 8) / r
    assert average(apart).offset == pytest.approx([x, y], rel=2e-3)
    pair = apart.replace(
        {"controller.channels.1.ratio": 4, "controller.channels.1.dither.amplitude": a}
    )
    x, y = (fxxx + fxyy) * a**2 / 16 / q, (fyyy + fxxy) * a**2 / 16 / r
    assert average(pair).offset == pytest.approx([x, y], rel=2e-3)


def test_all_equilibria_of_a_field_with_two_peaks() -> None:
    """J = −(x² − 1)² − y²: two maxima and the saddle between, shifted by the dither alone."""
    field = es.Expression("-(x**2 - 1)**2 - y**2")
    loop = velocity_actuated(field=field, start=(0.8, 0.1))
    found = average(loop)
    a = 0.08  # ⟨J sin⟩ = −2α x (x² − 1) − (3/2) α³ x for a lone sine of amplitude α
    peak = (1 - 3 * a**2 / 4) ** 0.5
    places = sorted(state[0] + 1 for state in found.equilibria)
    assert places == pytest.approx([-peak, 0, peak], abs=1e-9)


def test_no_equilibrium_is_said() -> None:
    loop = velocity_actuated(**{"vehicle.axes.0": 1 / (s - 0.8)})  # ε = α c q = 0.8
    found = average(loop)
    assert found.equilibrium is None
    assert "none found" in found.text()
    assert found.conditions == ()
    assert not found.stable


# --- the demodulation matrix, frequencies that collide ------------------------------------------


def test_the_demodulation_matrix_by_quadrature() -> None:
    loop = coupled(QUADRATIC, (1, 1, 2), (0.3, -0.9, 0.2)).replace(
        {"controller.channels.0.reference": 0.7, "vehicle.axes.2": 1 / (s - 0.3)}
    )
    found = average(loop)
    theta = 2 * np.pi * np.arange(512) / 512
    frequencies, phases = (40, 40, 80), (0.3, -0.9, 0.2)
    references = [np.sin(theta + 0.7), np.sin(theta - 0.9), np.sin(2 * theta + 0.2)]
    for j, (w, phase) in enumerate(zip(frequencies, phases, strict=True)):
        washout = 1j * w / (1j * w + 1.3)
        turned = (0.1 + 0.02 * j) * np.imag(washout * np.exp(1j * (w / 40 * theta + phase)))
        for i, reference in enumerate(references):
            assert found.demodulation[i, j] == pytest.approx(np.mean(reference * turned), abs=1e-14)


def test_in_the_ideal_the_demodulation_matrix_is_half_the_amplitudes() -> None:
    loop = velocity_actuated(**{"controller.frequency": 1e7})
    assert average(loop).demodulation == pytest.approx(np.diag([0.04, 0.04]), abs=1e-8)


def apart(ratio: Any, phase: float = 0.0) -> es.Loop:
    return velocity_actuated(
        **{
            "field": es.Quadratic((0, 0), ((1, 0.2), (0.2, 0.5))),
            "controller.frequency": 100,
            "controller.channels.1.ratio": ratio,
            "controller.channels.1.dither.phase": phase,
            "start": (0.5, 0.5),
        }
    )


def test_an_axis_at_twice_the_frequency_rests_beside_the_source() -> None:
    loop = velocity_actuated(
        **{
            "controller.channels.1.ratio": 2,
            "controller.channels.1.dither.phase": float(pi / 2),
            "controller.frequency": 400,
        }
    )
    assert average(loop).offset == pytest.approx([0, 0.08 / 2], abs=1e-12)  # α/2 for q = (1, 0.5)
    assert periodic_orbit(loop).offset == pytest.approx([0, 0.04], abs=1e-5)


def test_two_three_five() -> None:
    q = ((1.0, 0.3, 0), (0.3, 0.5, 0), (0, 0, 0.8))
    loop = scenario("three_d").loop.replace(
        {
            "field.q": q,
            "controller.frequency": 50,
            **{f"controller.channels.{i}.ratio": r for i, r in enumerate((2, 3, 5))},
            "controller.channels.2.dither.phase": float(pi / 2),
            **{f"controller.channels.{i}.dither.amplitude": 0.1 for i in range(3)},
        }
    )
    offset = 0.1 * 0.3 / (2 * 0.8)  # 0.01875
    assert average(loop).offset[2] == pytest.approx(offset, rel=1e-9)
    assert periodic_orbit(loop).offset[2] == pytest.approx(0.0187, abs=1e-4)


def test_a_near_collision_is_kept_as_a_slow_forcing() -> None:
    """ω and 1.01 ω beat at 1 rad/s; the averaged path follows the true one through it."""
    loop = apart(Fraction(101, 100)).replace({"start": (0.1, 0.1)})
    found = average(loop)
    assert [r.frequency for r in found.resonances] == pytest.approx([1.0])
    assert any(e.has(sympy.cos) for e in found.averaged.forcing)
    times = np.linspace(0, 12, 1201)
    run, path = es.simulate(loop, 12.0, samples=1201), found.simulate(12.0, samples=1201)
    dither = 0.08 * np.stack([np.sin(100 * times), np.sin(101 * times)], axis=1)
    error = np.abs(run.position.values - dither - path.offset.values).max()
    blind = average(apart(Fraction(3, 2)).replace({"start": (0.1, 0.1)}))
    missed = run.position.values - dither - blind.simulate(12.0, samples=1201).offset.values
    assert error < 0.2 * np.abs(missed).max()


@pytest.mark.parametrize("t_end", [-1.0, 0, float("nan"), "x"])
def test_a_path_takes_a_positive_time(t_end: Any) -> None:
    with pytest.raises(es.InvalidDescription, match="t_end"):
        average(velocity_actuated()).simulate(t_end)


def test_a_ratio_that_is_a_fraction_is_one_however_it_is_stated() -> None:
    for first, second in ((2, 2.0), (2.0, 2), ("3/2", 1.5), (1, 1.0)):
        for ratio in (first, second):
            found = average(apart(ratio, float(pi / 2)))
            assert found.frame.period() is not None
        stated, floated = (average(apart(r, float(pi / 2))) for r in (first, second))
        assert floated.offset == pytest.approx(stated.offset, abs=1e-15)
        assert floated.eigenvalues == pytest.approx(stated.eigenvalues, abs=1e-15)


def test_equal_loops_of_different_structure_are_not_mixed_up() -> None:
    exact, floated = apart("129/128"), apart(129 / 128)
    assert exact == floated
    for loop, bases in ((exact, 1), (floated, 2), (exact, 1)):
        assert len(average(loop).frame.equations.bases) == bases


def test_frequencies_in_hertz_have_a_common_period() -> None:
    path = es.Circle(0.1, float(pi / 5))
    moving = es.Moving(es.Quadratic((0, 0), (1, 0.5)), path)
    loop = velocity_actuated(**{"field": moving, "controller.frequency": float(6 * pi)})
    assert average(loop).frame.period() == (pytest.approx(10.0), 30)


def test_the_mean_place_of_a_swinging_source() -> None:
    """x* = 0.3 sin² t has the mean 0.15: ε x*/(g − ε) beside it."""
    loop = velocity_actuated(
        **{
            "field": es.Moving(es.Quadratic((0, 0), (1, 0.5)), ("0.3*sin(t)**2", "0.3*exp(-t)")),
            "vehicle.axes": (1 / (s - 0.1), 1 / (s - 0.1)),
        }
    )
    found = average(loop)
    assert found.offset == pytest.approx([0.1 * 0.15 / 0.7, 0.1 * 0.3 / 0.3], abs=1e-12)
    assert "more than a constant velocity and sines" in found.text()


def test_a_continuum_of_equilibria_is_no_error() -> None:
    ridge = es.Expression("1 - (x + y)**2 - (x + y)**4")
    found = average(velocity_actuated(field=ridge, start=(0.1, 0.1)))
    assert len(found.equilibria) == 1
    assert not found.stable


class Squaring(es.GradientES):
    """Seeks the maximum of J², which it computes itself."""

    def compose(self, diagram: Any, signal: Any, plants: Any, inputs: Any, units: Any) -> Any:
        squared = diagram.signal("J_2", signal**2, "1")
        return super().compose(diagram, squared, plants, inputs, units)


def test_a_controller_that_multiplies_the_signal_by_itself_is_refused() -> None:
    loop = velocity_actuated()
    usual: Any = loop.controller
    squaring = Squaring(usual.frequency, usual.washout, usual.channels)
    with pytest.raises(es.InvalidDescription, match="multiplies the sensed signal by itself"):
        average(loop.replace({"controller": squaring}))


def test_orders_other_than_one_and_two_are_refused() -> None:
    with pytest.raises(es.InvalidDescription, match="order = 3: must be 1 or 2"):
        average(velocity_actuated(), order=3)
    with pytest.raises(es.InvalidDescription, match="polynomial"):
        average(velocity_actuated(field=es.Gaussian((0, 0))), order=2)
