"""What an averaged axis does, by residues and on a grid; against state spaces and closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from extremum import s
from extremum.theory.synthesis import responses
from extremum.theory.synthesis.family import Family, Plant

from . import by_hand
from .asked import family_of

# --- responses in time ------------------------------------------------------------------------

Averaged = tuple[Family, Plant, Any, Any, Any]

AXES = {
    "gain on 1/s": (1 / s, (1.0,), (1.0,), 1.4),
    "lead on 1/s^2": (1 / s**2, (5.0, 2.0), (1.0, 8.0), 1.1),
    "PI on an unstable pole": (1 / (s - 0.5), (1.0, 0.4), (1.0, 0.0), 2.3),
    "PI on a spring": (1 / (s + 0.8), (1.0, 0.9), (1.0, 0.0), 1.7),
    "unstable pole with a lag": (1 / ((s - 0.5) * (0.05 * s + 1)), (1.0, 0.4), (1.0, 0.0), 2.3),
    "gain on an unstable pole": (1 / (s - 0.5), (1.0,), (1.0,), 2.3),
    "a zero": ((s + 3) / (s * (s + 1)), (1.0, 0.3), (1.0, 0.0), 0.8),
    "gain below zero": (-2 / s, (1.0,), (1.0,), -0.6),
    "resonator": (1 / s, (1.0, 0.5, 0.5), (1.0, 0.0, 0.09), 1.4),
}
DELAYS = (0.0, 0.15)


def by_residues(
    name: str, delay: float
) -> tuple[by_hand.Axis, tuple[Family, Plant, Any, Any, Any]]:
    axis, above, below, gain = AXES[name]
    family = family_of(axis, delay=delay)
    plant = family.nominal
    hand = by_hand.Axis((plant.numerator, plant.denominator), (above, below), gain, delay)
    return hand, (family, plant, np.array(above), np.array(below), np.array(gain))


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("name", AXES)
def test_a_displaced_vehicle_returns_as_a_matrix_exponential_says(name: str, delay: float) -> None:
    hand, here = by_residues(name, delay)
    times = np.linspace(0, 12, 121)
    free, _ = responses.responses(*here, times[1:])
    expected = by_hand.moved(hand, times, start=1.0)[1:]
    assert free == pytest.approx(expected, abs=2e-8)


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("name", AXES)
def test_a_load_moves_it_as_a_matrix_exponential_says(name: str, delay: float) -> None:
    hand, here = by_residues(name, delay)
    times = np.linspace(0, 12, 121)
    _, driven = responses.responses(*here, times[1:])
    long = np.linspace(0, 600, 3)
    end = by_hand.moved(hand, long, start=0.0, force=1.0)[-1]
    expected = by_hand.moved(hand, times, start=0.0, force=1.0)[1:] - end
    assert driven == pytest.approx(expected, abs=1e-7)


def test_a_far_source_is_a_load() -> None:
    """Held 2 m from where it rests, 1/(s − ε) needs −2 ε: as much as a force of that size."""
    hand, here = by_residues("PI on an unstable pole", 0.0)
    times = np.linspace(0, 12, 121)
    free, driven = responses.responses(*here, times[1:])
    expected = by_hand.moved(hand, times, start=0.3, source=2.0)[1:]
    load = here[1].load * 2.0
    assert load == -1.0
    assert 0.3 * free - load * driven == pytest.approx(expected, abs=1e-9)


def test_a_step_is_scipy_s_ode() -> None:
    """The same 1/(s − 0.5) with a PI, its equations written out."""

    def rates(_: float, state: Any) -> list[float]:
        x, z = state
        return [0.5 * x - 2.3 * x - 2.3 * 0.4 * z + 0.7, x]

    times = np.linspace(0, 12, 121)
    solution = solve_ivp(rates, (0, 12), [0.3, 0.0], t_eval=times, rtol=1e-10, atol=1e-12)
    hand, here = by_residues("PI on an unstable pole", 0.0)
    assert by_hand.moved(hand, times, start=0.3, force=0.7) == pytest.approx(
        solution.y[0], abs=1e-8
    )
    free, driven = responses.responses(*here, times[1:])
    assert 0.3 * free + 0.7 * driven == pytest.approx(solution.y[0][1:], abs=1e-8)


def test_responses_of_a_batch_are_those_of_its_members() -> None:
    family = family_of(1 / s**2, delay=0.1)
    above = np.array([[5.0, 2.0], [6.0, 1.0], [3.0, 2.0]])
    below = np.array([[1.0, 8.0], [1.0, 12.0], [1.0, 5.0]])
    gain = np.array([1.1, 0.7, 0.4])
    times = np.linspace(0.1, 6, 30)
    many = responses.responses(family, family.nominal, above, below, gain, times)
    wanted = responses.settling_times(
        family, family.nominal, above, below, gain, wanted=6.0, relative_load=np.zeros(3)
    )
    for k in range(3):
        one = responses.responses(family, family.nominal, above[k], below[k], gain[k], times)
        assert many[0][k] == pytest.approx(one[0])
        assert many[1][k] == pytest.approx(one[1])
        alone = responses.settling_times(
            family, family.nominal, above[k], below[k], gain[k], wanted=6.0, relative_load=0.0
        )
        assert wanted[0][k] == alone[0]


def test_modes_are_the_roots_of_the_averaged_loop() -> None:
    hand, here = by_residues("unstable pole with a lag", 0.15)
    assert np.sort_complex(responses.modes(*here)) == pytest.approx(
        np.sort_complex(by_hand.poles(hand)), rel=1e-9
    )


# --- settling ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("relative_load", [0.0, 2.0])
def test_settling_is_when_the_simulated_error_stays_within_1_6_percent(
    name: str, relative_load: float
) -> None:
    hand, here = by_residues(name, 0.0)
    wanted = 8.0
    charged, empty = responses.settling_times(*here, wanted=wanted, relative_load=relative_load)
    times = np.linspace(0, 16, 1601)
    free = by_hand.moved(hand, times, start=1.0)
    step = 16 / responses.TIMES
    assert float(charged) == pytest.approx(by_hand.settled(free, times, 0.016), abs=1.1 * step)
    driven = by_hand.moved(hand, times, start=0.0, force=1.0)
    end = by_hand.moved(hand, np.linspace(0, 600, 3), start=0.0, force=1.0)[-1]
    loaded = np.abs(free) + relative_load * np.abs(driven - end)
    assert float(empty) == pytest.approx(by_hand.settled(loaded, times, 0.016), abs=1.1 * step)


def test_what_does_not_settle_within_twice_the_time_does_not_settle() -> None:
    family = family_of()
    here = family, family.nominal, np.ones(1), np.ones(1)
    gains = np.log(1 / 0.016) / np.array([3.9, 7.9, 8.2])
    charged, empty = responses.settling_times(
        *here[:2], np.ones((3, 1)), np.ones((3, 1)), gains, wanted=4.0, relative_load=0.0
    )
    assert np.isfinite(charged).tolist() == [True, True, False]
    assert charged[0] == pytest.approx(3.9, abs=8 / responses.TIMES)
    assert (charged == empty).all()


def test_an_unstable_loop_never_settles() -> None:
    family = family_of(1 / (s - 0.5))
    charged, empty = responses.settling_times(
        family, family.nominal, np.ones(1), np.ones(1), 0.4, wanted=4.0, relative_load=1.0
    )
    assert math.isinf(charged)
    assert math.isinf(empty)


# --- frequencies and noise --------------------------------------------------------------------


@pytest.mark.parametrize("name", AXES)
def test_sensitivity_is_one_over_one_plus_the_loop(name: str) -> None:
    hand, here = by_residues(name, 0.0)
    omega = np.geomspace(0.01, 100, 50)
    found = responses.sensitivity(*here, omega)
    assert found == pytest.approx(by_hand.sensitivity(hand, omega))


def test_sensitivity_under_a_dead_time() -> None:
    hand, here = by_residues("gain on 1/s", 0.15)
    omega = np.geomspace(0.01, 12, 50)
    found = responses.sensitivity(*here, omega)
    assert found == pytest.approx(by_hand.sensitivity(hand, omega), abs=0.02)


@pytest.mark.parametrize("gain", [0.2, 1.0, 7.0])
def test_noise_bandwidth_of_the_first_order(gain: float) -> None:
    """T = g/(s + g): ‖T‖₂² = g/2, and |T| = 1/√2 at g."""
    family = family_of()
    omega = responses.frequencies(gain)
    s_ = responses.sensitivity(
        family, family.nominal, np.ones(1), np.ones(1), np.array(gain), omega
    )
    width = responses.noise_bandwidth(1 - s_, omega)
    assert float(width) == pytest.approx(gain / 2, rel=0.02)
    passed = float(responses.highest_passed(1 - s_, omega))
    assert passed <= gain * (1 + 1e-12)
    assert passed == pytest.approx(gain, rel=0.17)


@pytest.mark.parametrize("name", [name for name in AXES if name != "gain below zero"])
def test_noise_bandwidth_is_lyapunov_s_variance(name: str) -> None:
    hand, here = by_residues(name, 0.0)
    omega = responses.frequencies(2.0)
    found = responses.noise_bandwidth(1 - responses.sensitivity(*here, omega), omega)
    assert float(found) == pytest.approx(by_hand.spread(hand), rel=0.03)


def test_nothing_passed_is_the_lowest_frequency() -> None:
    omega = np.geomspace(1, 10, 5)
    assert responses.highest_passed(np.full(5, 0.5), omega) == 1.0
    assert responses.highest_passed(np.array([1, 0.8, 0.1, 0.9, 0.2]), omega) == omega[3]
