from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from systems import system

from extremum.engines import shooting

OSCILLATOR = system("v, -a*x - b*v + cos(w*t)", names="x,v", carriers="w")
A, W = 2.0, 7.0
PERIOD = 2 * np.pi / W


def response(b: float, times: np.ndarray) -> np.ndarray:
    """The periodic solution of ẍ + b ẋ + A x = cos wt, and its velocity: Re[e^{jwt}/…]."""
    position = np.exp(1j * W * times) / (A - W**2 + 1j * b * W)
    return np.stack([position.real, (1j * W * position).real], axis=-1)


@pytest.mark.parametrize("b", [0.4, -0.6, 0.0])
@pytest.mark.parametrize(("periods", "segments"), [(1, 1), (1, 4), (12, 12), (60, 240)])
def test_a_forced_oscillator(b: float, periods: int, segments: int) -> None:
    """Damped, undamped and driven away; one segment, a dense and a sparse system of equations."""
    period = periods * PERIOD
    found = shooting.close(OSCILLATOR, (A, b, W), period, np.zeros((segments, 2)))
    assert found.converged
    nodes = response(b, period * np.arange(segments) / segments)
    assert found.nodes == pytest.approx(nodes, abs=1e-12)
    assert found.residual < 1e-13
    assert found.correction < 1e-11
    once = expm(np.array([[0, 1], [-A, -b]]) * period / segments)
    assert found.factors == pytest.approx(np.broadcast_to(once, (segments, 2, 2)), abs=1e-12)


def test_rounding_is_what_remains_however_fast_the_forcing() -> None:
    """ẋ = −x + cos wt at w = 1e6: I − Φ is 6e-6, and x₀ = 1/(1 + w²) right to 1e-11 of |x|."""
    w = 1e6
    found = shooting.close(
        system("-x + cos(w*t) + a", carriers="w"), (1.0, 0, w), 2 * np.pi / w, np.zeros((1, 1))
    )
    assert found.converged
    assert found.nodes[0, 0] == pytest.approx(1 + 1 / (1 + w**2), abs=3e-11)


def test_samples_stay_on_an_unstable_orbit() -> None:
    """Growth e^{0.6·60·T/2} from rounding would leave it: every segment starts at its own node."""
    segments = 60
    found = shooting.close(OSCILLATOR, (A, -0.6, W), segments * PERIOD, np.zeros((segments, 2)))
    times, states = shooting.sampled(OSCILLATOR, (A, -0.6, W), found, 16)
    assert len(times) == segments * 16
    assert np.diff(times) == pytest.approx(PERIOD / 16)
    assert states == pytest.approx(response(-0.6, times), abs=1e-11)


@pytest.mark.parametrize("guess", [1.2, 1.3, 1.35, 1.4])
def test_another_orbit_is_not_taken_for_the_one_that_was_guessed(guess: float) -> None:
    """ẋ = sin x + cos(wt)/10 has orbits at kπ; from 1.2 plain Newton's method lands at 5π."""
    waves = system("sin(x) + cos(w*t)/10", carriers="w")
    away = shooting.close(waves, (0, 0, W), PERIOD, np.array([[guess]]))
    assert away.outcome == "diverged"
    assert len(away.factors) == 0
    for near, orbit in ((0.3, 0.0), (-0.5, 0.0), (2.5, np.pi)):
        found = shooting.close(waves, (0, 0, W), PERIOD, np.array([[near]]))
        assert found.nodes[0, 0] == pytest.approx(orbit, abs=0.003)


@pytest.mark.parametrize("segments", [1, 3])
def test_without_an_orbit_there_is_an_outcome(segments: int) -> None:
    guess = np.zeros((segments, 1))
    drifting = shooting.close(system("1 + cos(w*t)"), (0, 0, W), PERIOD, guess)
    assert drifting.outcome == "diverged"
    escaping = shooting.close(system("x**2 + 9*w"), (0, 0, W), PERIOD, guess + 1)
    assert escaping.outcome == "escaped"
    assert len(escaping.factors) == 0
    leaving = shooting.close(system("sqrt(x) - 9"), (0, 0, W), PERIOD, guess + 1)
    assert leaving.outcome == "left the data"
