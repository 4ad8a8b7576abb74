"""How the average is approached as ω grows, and phase errors."""

from __future__ import annotations

import numpy as np
import pytest
from loops import force_actuated, velocity_actuated
from scipy.optimize import brentq
from scipy.signal import impulse

import extremum as es
from extremum import s
from extremum.theory.averaging import average
from extremum.theory.floquet import match
from extremum.theory.orbits import periodic_orbit

FREQUENCIES = np.array([100.0, 200, 400, 800])


def errors(loop: es.Loop) -> tuple[np.ndarray, np.ndarray]:
    """The largest distance of a mode from the average, and that of the polynomials, over ω."""
    distances, polynomials = [], []
    for frequency in FREQUENCIES:
        here = loop.replace({"controller.frequency": float(frequency)})
        pairs = match(average(here).eigenvalues, periodic_orbit(here).exponents, float(frequency))
        distances.append(pairs.worst)
        polynomials.append(pairs.polynomial)
    return np.array(distances), np.array(polynomials)


def slope(values: np.ndarray) -> float:
    return float(np.polyfit(np.log(FREQUENCIES), np.log(values), 1)[0])


def test_distinct_eigenvalues_are_met_at_the_second_order() -> None:
    assert slope(errors(velocity_actuated())[0]) == pytest.approx(-2, abs=0.05)
    assert slope(errors(force_actuated())[0]) == pytest.approx(-2, abs=0.1)


def test_identical_axes_in_quadrature_at_the_first() -> None:
    alike = velocity_actuated(**{"field.q": (1.0, 1.0), "controller.washout": 2.0})
    assert slope(errors(alike)[0]) == pytest.approx(-1, abs=0.05)


def test_a_triple_root_at_the_power_two_thirds() -> None:
    """λ³ + 3λ² + 3λ + 1 in x: p = −3, g = 3, z = −1/3; in y distinct roots."""
    triple = force_actuated(
        **{
            **{f"controller.channels.{i}.compensator": es.Lead(1, -1 / 3, -3) for i in (0, 1)},
            "controller.channels.0.gain": 30.0,
            "controller.channels.1.gain": 240.0,
        }
    )
    x = average(triple).conditions[:4]
    assert [c.value for c in x] == pytest.approx([3, 3, 1, 8])
    distances, polynomials = errors(triple)
    assert slope(distances) == pytest.approx(-2 / 3, abs=0.04)
    assert slope(polynomials) == pytest.approx(-2, abs=0.1)


def test_off_the_peak_the_slowest_exponent_comes_slowly() -> None:
    """Erratum 2's loop with the exact probe: −0.157 at ω = 100 … limit −0.793."""
    loop = es.Loop(
        field=es.Quadratic(source=(1, -1), q=(1.0, 0.5), peak=1.0),
        vehicle=es.PointMass(axes=(1 / (s - 0.5), 1 / (s - 0.5))),
        controller=es.GradientES(
            frequency=100,
            washout=1.0,
            channels=tuple(
                es.Channel(es.Dither(0.05, phase=phase), 10, es.Lead(4, -3, -2.5))
                for phase in (0.0, float(-es.pi / 2))
            ),
        ),
        start=(0, 0),
    )
    slowest = {100: -0.157, 1600: -0.528, 25600: -0.742, 409600: -0.789}
    for frequency, rate in slowest.items():
        orbit = periodic_orbit(loop.replace({"controller.frequency": frequency}))
        assert orbit.exponents[0].real == pytest.approx(rate, abs=6e-4)
    assert average(loop).eigenvalues[0].real == pytest.approx(-0.793, abs=5e-4)


@pytest.mark.parametrize(
    ("gain", "zero", "pole", "degrees"), [(5.0, -0.5, -3.0, 44.8), (1.0, -2.0, -2.2, 2.1)]
)
def test_the_phase_error_that_a_quadrature_pair_bears(
    gain: float, zero: float, pole: float, degrees: float
) -> None:
    """Two equal double integrators: on average |δ|; exactly, the washout adds its atan(h/ω)."""
    loop = force_actuated(
        **{
            "field.q": (1.0, 1.0),
            "controller.frequency": 400,
            **{f"controller.channels.{i}.gain": gain / 0.1 for i in (0, 1)},
            **{f"controller.channels.{i}.compensator": es.Lead(1, zero, pole) for i in (0, 1)},
        }
    )

    def turned(delta: float) -> es.Loop:
        phases = (0.0, float(-es.pi / 2))
        return loop.replace(
            {
                f"controller.channels.{i}.reference": es.Reference(phase + np.radians(delta))
                for i, phase in enumerate(phases)
            }
        )

    def averaged(delta: float) -> float:
        return float(average(turned(delta)).eigenvalues.real.max())

    def exact(delta: float) -> float:
        return float(periodic_orbit(turned(delta)).exponents.real.max())

    critical = brentq(averaged, degrees - 1, degrees + 1, xtol=1e-4)
    assert critical == pytest.approx(degrees, abs=0.06)
    lead = np.degrees(np.arctan(1 / 400))
    assert brentq(exact, degrees - 1, degrees + 1, xtol=1e-4) == pytest.approx(
        critical + lead, abs=3e-3
    )


@pytest.mark.parametrize("frequency", [30, 100, 400])
def test_the_average_shows_the_drift_from_rest(frequency: float) -> None:
    """From rest a double integrator's mean starts at −αω: x̃ = −αω (s − p)/(s³ − ps² + gs − gz)."""
    at_rest = force_actuated(**{"controller.frequency": frequency, "start": (0.0, 0.0)})
    path = average(at_rest).simulate(10.0, samples=501)
    p, g, z = -3.0, 5.0, -0.5
    _, response = impulse(([1, -p], [1, -p, g, -g * z]), T=path.time.values)
    assert path.offset.values[:, 0] == pytest.approx(
        -0.1 * frequency * response, abs=1e-7 * frequency
    )
