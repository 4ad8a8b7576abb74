from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from extremum.theory import floquet

RNG = np.random.default_rng(3)


def matrix(*modes: complex, jordan: int = 1) -> np.ndarray:
    """A real matrix with these eigenvalues (complex ones with their conjugates), mixed up.

    With `jordan` > 1 each real one gets a Jordan block of that size.
    """
    blocks = []
    for mode in modes:
        if isinstance(mode, complex):
            blocks.append(np.array([[mode.real, mode.imag], [-mode.imag, mode.real]]))
        else:
            blocks.append(mode * np.eye(jordan) + np.eye(jordan, k=1))
    mixing = generic(sum(len(b) for b in blocks))
    return mixing @ block_diag(*blocks) @ np.linalg.inv(mixing)


def generic(count: int) -> np.ndarray:
    """A random matrix with a condition number of 4."""
    left, right = (np.linalg.qr(RNG.standard_normal((count, count)))[0] for _ in range(2))
    return left @ np.diag(np.linspace(0.5, 2, count)) @ right


def cycle(generator: np.ndarray, period: float, segments: int) -> np.ndarray:
    """Factors P_{k+1} e^{Ah} P_k⁻¹ with P_m = P_0: the exponents are A's eigenvalues."""
    bases = [generic(len(generator)) for _ in range(segments)]
    bases.append(bases[0])
    step = expm(generator * period / segments)
    return np.array([b @ step @ np.linalg.inv(a) for a, b in pairwise(bases)])


def spectrum(*modes: complex) -> np.ndarray:
    conjugates = [m.conjugate() for m in modes if isinstance(m, complex)]
    return np.array([*modes, *conjugates], dtype=complex)


CASES: dict[str, tuple[tuple[complex, ...], float, int]] = {
    "one short period": ((-0.4, -0.8, -1.0), 2 * np.pi / 400, 1),
    "a very short one": ((-0.157, 0.2 + 1.1j, -1.0), 2 * np.pi / 409600, 1),
    "two short cycles": ((0.3, -0.5 + 0.35j, -1.0, -1.0), 4 * np.pi / 100, 2),
    "a figure eight": ((-0.375, -0.75, -1.0, -2.09), 62.8, 300),
    "unstable and long": ((0.4, 0.1 + 0.04j, -1.5, -2.0 + 0.02j), 62.8, 300),
    "nearly equal": ((-1.0, -1.0001, -1.0002, -1.01, -1.5), 62.8, 150),
    "a ladder": ((-0.2, -0.25, -0.3, -0.35, -0.4, -0.45), 62.8, 200),
}


@pytest.mark.parametrize("name", list(CASES))
def test_known_exponents(name: str) -> None:
    modes, period, segments = CASES[name]
    found = floquet.exponents(cycle(matrix(*modes), period, segments), period)
    pairs = floquet.match(spectrum(*modes), found, 2 * np.pi / period)
    rounding = 3e-14 * segments**0.5 / min(period, 1.0)
    assert pairs.worst < rounding
    assert (np.diff(found.real) <= rounding).all()


def test_multipliers_of_1e_57_keep_their_digits() -> None:
    """The plain product has no correct digit of the small multiplier; the exponent has twelve."""
    period, modes = 62.8, (-0.375, -2.09)
    factors = cycle(matrix(*modes), period, 300)
    plain = np.eye(2)
    for factor in factors:
        plain = factor @ plain
    small = np.abs(np.linalg.eigvals(plain)).min()
    exact = np.exp(-2.09 * period)
    assert exact == pytest.approx(1e-57, rel=0.1)
    assert abs(small / exact - 1) > 0.5
    multipliers = floquet.multipliers(floquet.exponents(factors, period), period)
    assert multipliers[1].real == pytest.approx(exact, rel=1e-10)
    assert multipliers[0].real == pytest.approx(np.exp(-0.375 * period), rel=1e-10)


def test_a_negative_multiplier_has_half_the_frequency() -> None:
    """μ = −e^{−0.2}: λ = −0.2/T + jπ/T, the principal value."""
    period = 3.0
    found = floquet.exponents([np.diag([-np.exp(-0.2), 0.5])], period)
    assert found[0] == pytest.approx((-0.2 + 1j * np.pi) / period, rel=1e-13)
    again = floquet.exponents([np.diag([-np.exp(-0.2), 0.5]), np.eye(2)], period)
    assert again[0] == pytest.approx((-0.2 + 1j * np.pi) / period, rel=1e-13)


@pytest.mark.parametrize("copies", [1, 2])
def test_modes_that_die_within_one_factor_stay_finite(copies: int) -> None:
    factors = [np.diag([0.5, 1e-9, 0.0])] * copies
    found = floquet.exponents(factors, copies)
    assert found[:2].real == pytest.approx(np.log([0.5, 1e-9]), rel=1e-6)
    assert np.isfinite(found).all()
    assert found[2].real < -300


def test_imaginary_parts_are_known_modulo_the_frequency() -> None:
    """j 7 at ω = 5 is seen as j 2, and matched to the averaged eigenvalue all the same."""
    frequency, modes = 5.0, (-0.3 + 7.0j, -1.0)
    period = 2 * np.pi / frequency
    found = floquet.exponents(cycle(matrix(*modes), period, 4), period)
    assert np.abs(found.imag).max() == pytest.approx(2.0, rel=1e-10)
    pairs = floquet.match(spectrum(*modes), found, frequency)
    assert pairs.worst < 1e-12
    assert pairs.exponents == pytest.approx(spectrum(*modes), rel=1e-11)


def test_modes_are_paired_at_the_least_total_distance() -> None:
    averaged = np.array([-1.0, -2.0, -3.0])
    pairs = floquet.match(averaged, [-3.1, -1.2, -2.4], 100.0)
    assert pairs.exponents.real == pytest.approx([-1.2, -2.4, -3.1])
    assert pairs.distances == pytest.approx([0.2, 0.4, 0.1])
    assert pairs.worst == pytest.approx(0.4)
    assert pairs.pairs[2] == (-3.0, -3.1)


@pytest.mark.parametrize(("size", "power"), [(2, 1 / 2), (3, 1 / 3)])
def test_a_jordan_block_is_compared_by_its_polynomial(size: int, power: float) -> None:
    """A perturbation δ of a Jordan block moves eigenvalues by δ^{1/m}, the polynomial by δ."""
    generator = matrix(-1.0, jordan=size)
    change = generic(size)
    period = 0.01
    distances, polynomials = [], []
    changes = (1e-4, 1e-6)
    for delta in changes:
        found = floquet.exponents([expm((generator + delta * change) * period)], period)
        pairs = floquet.match(np.full(size, -1.0), found, 2 * np.pi / period)
        distances.append(pairs.worst)
        polynomials.append(pairs.polynomial)

    def slope(sizes: list[float]) -> float:
        return float(np.log(sizes[0] / sizes[1]) / np.log(changes[0] / changes[1]))

    assert slope(distances) == pytest.approx(power, abs=0.05)
    assert slope(polynomials) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("frequency", [1e2, 1e6])
def test_polynomials_differ_as_their_roots_do_at_every_frequency(frequency: float) -> None:
    """(s + 1)(s + 2) and (s + 1)(s + 3): s differs by 1 of 2·3, s⁰ by 1 of 9; μ crowds at 1."""
    found = floquet.polynomial_distance([-1, -2], [-1, -3], 2 * np.pi / frequency)
    assert found == pytest.approx(1 / 6, rel=0.1)
    assert floquet.polynomial_distance([-1, -2], [-2, -1], 2 * np.pi / frequency) < 1e-15


def test_lyapunov_exponents_of_a_cycle_are_the_real_parts() -> None:
    modes: Any = (0.2, -0.5 + 0.7j, -1.5)
    period = 40.0
    factors = cycle(matrix(*modes), period, 200)
    _, basis = floquet.growth(factors, np.eye(4))
    total, _ = floquet.growth(np.tile(factors, (20, 1, 1)), basis)
    assert total / (20 * period) == pytest.approx([0.2, -0.5, -0.5, -1.5], abs=2e-3)


def test_a_mode_that_is_0_to_rounding_does_not_decay() -> None:
    assert floquet.decays(np.array([-1e-6, -1.0 + 2j]))
    assert not floquet.decays(np.array([-1e-12, -1.0 + 2j]))
    assert not floquet.decays(np.array([1e-6, -1.0 + 0j]))
    assert not floquet.decays(np.empty(0, complex))
