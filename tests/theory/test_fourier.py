"""Fourier series of trigonometric polynomials against NumPy's transform of their samples."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import sympy

from extremum.symbols import t
from extremum.theory.fourier import oscillators, series, turned, unturned

OMEGA = sympy.Symbol("omega", positive=True)
RHO = sympy.Symbol("rho", positive=True)


def test_commensurate_frequencies_share_one_base():
    found, bases = oscillators((2 * OMEGA, 3 * OMEGA, sympy.Rational(5, 2) * OMEGA))
    assert bases == (OMEGA / 2,)
    assert [o.harmonic for o in found] == [(4,), (6,), (5,)]


def test_incommensurate_frequencies_have_bases_of_their_own():
    found, bases = oscillators((OMEGA, RHO * OMEGA, 3 * OMEGA))
    assert bases == (OMEGA, RHO * OMEGA)
    assert [o.harmonic for o in found] == [(1, 0), (0, 1), (3, 0)]


def test_phases_are_turned_into_sines_and_cosines_and_back():
    (o,), _ = oscillators((OMEGA,))
    phi = sympy.Symbol("phi", real=True)
    expression = sympy.sin(OMEGA * t + phi) ** 2 + sympy.cos(OMEGA * t - 1) + sympy.sin(3 * t)
    found = turned(expression, (o,))
    assert not found.has(sympy.sin(OMEGA * t + phi))
    assert found.has(sympy.sin(3 * t))
    numbers: Any = {OMEGA: 1.7, phi: 0.4, t: 0.9}
    back = unturned(found, (o,))
    assert float(back.subs(numbers)) == pytest.approx(float(expression.subs(numbers)), abs=1e-14)


@pytest.mark.parametrize("ratios", [(1,), (1, 1), (2, 3), (4, 5, 7), (Fraction(1, 2), 3)])
def test_series_of_random_polynomials_is_numpys(ratios: tuple[Fraction, ...]) -> None:
    rng = np.random.default_rng(3)
    carriers = tuple(sympy.Rational(str(r)) * (i * RHO * 0 + OMEGA) for i, r in enumerate(ratios))
    found, (base,) = oscillators(tuple(dict.fromkeys(carriers)))
    symbols = [symbol for o in found for symbol in (o.sine, o.cosine)]
    x = sympy.Symbol("x")
    polynomial = sympy.Integer(0)
    for _ in range(6):
        powers = rng.integers(0, 4, len(symbols))
        term = sympy.Mul(*(s ** int(n) for s, n in zip(symbols, powers, strict=True)))
        polynomial += int(rng.integers(-5, 6)) * x ** int(rng.integers(0, 3)) * term
    ours = series(polynomial.subs(x, 2), found)
    count = 512
    theta = 2 * np.pi * np.arange(count) / count
    turns = [int(o.frequency / base) for o in found]
    waves = [wave(n * theta) for n in turns for wave in (np.sin, np.cos)]
    sampled = sympy.lambdify(symbols, polynomial.subs(x, 2))(*waves) + 0 * theta
    spectrum = np.fft.rfft(sampled) / count
    assert float(ours.mean) == pytest.approx(spectrum[0].real, abs=1e-10)
    for k in range(1, 60):
        cosine, sine = ours.waves.get((k,), (0, 0))
        assert complex(cosine, -sine) == pytest.approx(2 * spectrum[k], abs=1e-10)


def test_the_torus_keeps_frequencies_apart():
    found, _ = oscillators((OMEGA, RHO * OMEGA))
    a, b = found
    ours = series(a.sine * b.sine + 3 * a.sine**2, found)
    assert ours.mean == sympy.Rational(3, 2)
    assert ours.waves[(1, -1)] == (sympy.Rational(1, 2), 0)
    assert ours.waves[(1, 1)] == (-sympy.Rational(1, 2), 0)
