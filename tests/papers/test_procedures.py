"""The paper's design procedures: roots over dense samples of the bounds, and the proofs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from averaged import integrators_at, pole_at
from sympy import Symbol

import extremum as es
from extremum.papers.zhang2007 import procedure_proofs as proofs
from extremum.papers.zhang2007.procedures import (
    DoubleIntegrators,
    UnstablePoles,
    for_double_integrators,
    for_unstable_poles,
)
from extremum.theory.printed import PaperLoop, recognise


def corners(procedure: UnstablePoles) -> Iterator[tuple[float, float]]:
    """Dense samples of q_low ≤ q ≤ 1000 q_low, 0 ≤ ε ≤ ε_high."""
    for q in procedure.q_low * np.geomspace(1, 1000, 25):
        for pole in np.linspace(0, procedure.pole_high, 15):
            yield float(q), float(pole)


def spread(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_poles(seed: int, **choices: float) -> UnstablePoles:
    """Bounds and α, h, c, k over two decades; z and αck relative to their corrected limits."""
    rng = np.random.default_rng(seed)
    q, high = spread(rng, 0.1, 10), spread(rng, 0.05, 2)
    a, k = spread(rng, 0.01, 0.3), spread(rng, 0.5, 10)
    stronger = choices.get("stronger", 1 + spread(rng, 1e-3, 30))
    farther = choices.get("farther", 1 + spread(rng, 1e-3, 30))
    h = choices.get("washout", 1.0) * high
    gain = stronger * high / (2 * q) / (a * k)
    return for_unstable_poles(q, high, amplitude=a, washout=h, gain=gain, k=k, zero=-farther * high)


# --- unstable poles: the rules over the bounds -------------------------------------------------


@pytest.mark.parametrize("seed", range(40))
def test_the_corrected_steps_are_safe_at_every_curvature_and_pole(seed: int) -> None:
    procedure = random_poles(seed)
    assert procedure.as_corrected
    assert procedure.stable
    found = [(pole_at(procedure, q, e), procedure.rate(q, e)) for q, e in corners(procedure)]
    assert max(exact for exact, _ in found) < 0
    for exact, reported in found:
        assert reported == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("broken", [{"stronger": 0.99}, {"farther": 0.99}])
def test_each_corrected_step_is_needed_at_the_worst_corner(
    seed: int, broken: dict[str, float]
) -> None:
    procedure = random_poles(seed, **broken)
    assert not procedure.as_corrected
    assert not procedure.stable
    assert pole_at(procedure, procedure.q_low, procedure.pole_high) > 0


@pytest.mark.parametrize("seed", range(20))
def test_the_printed_zero_is_safe_exactly_where_the_washout_is_as_fast_as_the_pole(
    seed: int,
) -> None:
    """z just left of −h, with h half of and twice ε_high."""
    slow = random_poles(seed, washout=0.5, farther=0.51)
    assert slow.as_printed
    assert not slow.as_corrected
    assert pole_at(slow, slow.q_low, slow.pole_high) > 0
    assert "is not safe: h < ε_high" in slow.findings[-1]
    fast = random_poles(seed, washout=2.0, farther=2.01)
    assert fast.as_printed
    assert max(pole_at(fast, q, e) for q, e in corners(fast)) < 0
    assert "is safe here, since h ≥ ε_high" in fast.findings[-1]
    forbidden = random_poles(seed, washout=2.0, farther=1.5)
    assert not forbidden.as_printed
    assert max(pole_at(forbidden, q, e) for q, e in corners(forbidden)) < 0


@pytest.mark.parametrize("seed", range(20))
def test_where_an_unsafe_zero_is_unstable(seed: int) -> None:
    """|z| ≤ ε q_low/q: the two crossings that the report names."""
    procedure = random_poles(seed, washout=0.1, stronger=8.0, farther=0.6)
    q, high, z = procedure.q_low, procedure.pole_high, procedure.lead.zero
    assert f"from ε = {-z:g} on" in procedure.findings[0]
    assert f"up to q = {-q * high / z:g}" in procedure.findings[0]
    for factor, unstable in ((0.99, False), (1.01, True)):
        assert (pole_at(procedure, q, -z * factor) > 0) is unstable
    for factor, unstable in ((0.99, True), (1.01, False)):
        assert (pole_at(procedure, -q * high / z * factor, high) > 0) is unstable


def test_where_too_little_gain_is_unstable() -> None:
    procedure = random_poles(1, stronger=0.7)
    assert f"at q_low from ε = {0.7 * procedure.pole_high:g} on" in procedure.findings[0]
    for factor, unstable in ((0.99, False), (1.01, True)):
        pole = 0.7 * procedure.pole_high * factor
        assert (pole_at(procedure, procedure.q_low, pole) > 0) is unstable


def test_a_zero_on_the_right_is_unstable_everywhere() -> None:
    procedure = for_unstable_poles(0.5, 0.5, zero=0.1)
    assert not procedure.as_printed
    assert not procedure.as_corrected
    assert "Unstable for every ε > 0" in procedure.findings[0]
    assert min(pole_at(procedure, q, e) for q, e in corners(procedure) if e) > 0


def test_the_printed_steps_do_meet_the_printed_conditions() -> None:
    """So the procedure is right about (60) to (64): it is they that are not."""
    met = 0
    for seed in range(30):
        procedure = random_poles(seed, washout=0.3, farther=0.31)
        found = recognise(procedure.loop(100.0))
        assert isinstance(found, PaperLoop)
        assert found.printed.stable
        met += not found.corrected.stable
    assert met == 30


@pytest.mark.parametrize(("q", "high"), [(0.5, 0.5), (3.0, 0.05), (0.2, 2.0)])
def test_the_defaults_are_damped_and_leave_a_quarter(q: float, high: float) -> None:
    procedure = for_unstable_poles(q, high)
    assert procedure.as_corrected
    for curvature, pole in corners(procedure):
        g, lead = procedure.strength * curvature, procedure.lead
        roots = np.roots(np.polyadd(np.polymul([1, -pole], [1, -lead.pole]), [g, -g * lead.zero]))
        assert (-roots.real / np.abs(roots)).min() > 0.7
        sensitivity = 1 / (1 + g * (-lead.zero / -lead.pole) / -pole) if pole else 0.0
        assert abs(sensitivity) <= 0.25 + 1e-12
        assert procedure.bias(curvature, pole) == pytest.approx(-sensitivity, abs=1e-12)
    assert procedure.bias(q, high) == pytest.approx(0.25)


# --- double integrators: the rules over the bounds ---------------------------------------------


def random_integrators(seed: int, **choices: float) -> DoubleIntegrators:
    """q_low, σ, α, k over decades; z, p and αck relative to their limits."""
    rng = np.random.default_rng(seed)
    q, decay = spread(rng, 0.1, 10), spread(rng, 0.02, 2)
    a, k = spread(rng, 0.01, 0.3), spread(rng, 0.5, 10)
    z = -decay * choices.get("zero", 1 + spread(rng, 1e-3, 10))
    p = z - 2 * decay - decay * choices.get("apart", spread(rng, 1e-2, 10))
    stronger = choices.get("stronger", 1 + spread(rng, 1e-3, 10))
    if p >= z - 2 * decay:
        gain = 1e3 * decay**2 / (q * a * k)
        return for_double_integrators(q, decay, amplitude=a, k=k, zero=z, pole=p, gain=gain)
    twice = for_double_integrators(q, decay, amplitude=a, k=k, zero=z, pole=p)
    gain = stronger * twice.gain / 2
    return for_double_integrators(q, decay, amplitude=a, k=k, zero=z, pole=p, gain=gain)


@pytest.mark.parametrize("seed", range(40))
def test_every_root_decays_at_every_curvature(seed: int) -> None:
    procedure = random_integrators(seed)
    assert procedure.as_corrected
    assert procedure.stable
    rates = [integrators_at(procedure, procedure.q_low * f) for f in np.geomspace(1, 1e4, 200)]
    assert max(rates) < -procedure.decay
    assert procedure.rate(procedure.q_low) == pytest.approx(rates[0])
    assert "Every root has Re λ < −σ" in procedure.findings[1]


@pytest.mark.parametrize("seed", range(20))
def test_each_step_for_the_decay_is_needed(seed: int) -> None:
    """Too little gain shows at q_low; a zero or a pole too slow as q grows."""
    weak = random_integrators(seed, stronger=0.98)
    slow = random_integrators(seed, zero=0.9)
    near = random_integrators(seed, apart=-0.1)
    for procedure in (weak, slow, near):
        assert not procedure.as_corrected
        assert procedure.stable
    assert integrators_at(weak, weak.q_low) > -weak.decay
    for procedure in (slow, near):
        assert integrators_at(procedure, 1e7 * procedure.q_low) > -procedure.decay


@pytest.mark.parametrize("seed", range(20))
def test_without_a_decay_the_curvature_does_not_matter(seed: int) -> None:
    """p < z < 0 and nothing else, whatever h is; the printed conditions ask p < z + h, z < −h."""
    rng = np.random.default_rng(seed)
    z, h, gain = -spread(rng, 0.05, 5), spread(rng, 0.05, 5), spread(rng, 0.1, 100)
    for factor, stable in ((1.05, True), (0.95, False)):
        procedure = for_double_integrators(1.0, 0.01, washout=h, gain=gain, zero=z, pole=factor * z)
        assert procedure.stable is stable
        assert procedure.findings[0].startswith("Stable" if stable else "Not stable")
        rates = [integrators_at(procedure, q) for q in np.geomspace(1e-3, 1e3, 50)]
        assert (max(rates) < 0) is stable
        assert (min(rates) < 0) is stable
        assert procedure.as_printed is (z < -h and procedure.lead.pole < z + h)
        found = recognise(procedure.loop(100.0))
        assert isinstance(found, PaperLoop)
        assert found.printed.stable is procedure.as_printed


def test_the_default_pole_needs_the_least_gain() -> None:
    chosen = for_double_integrators(0.7, 0.3, zero=-0.8)
    assert chosen.least == pytest.approx(8 * 0.3 * 0.8 / 0.7)
    assert chosen.strength == pytest.approx(2 * chosen.least)
    poles = np.linspace(-12, -1.41, 400)
    least = [for_double_integrators(0.7, 0.3, zero=-0.8, pole=float(p)).least for p in poles]
    assert min(least) == pytest.approx(chosen.least, rel=1e-3)
    assert poles[int(np.argmin(least))] == pytest.approx(chosen.lead.pole, abs=0.03)
    assert chosen.lead.pole == pytest.approx(2 * (-0.8 - 0.3))


def test_a_pole_that_no_gain_helps_is_refused_unless_the_gain_is_given() -> None:
    with pytest.raises(es.InvalidDescription, match=r"pole = -2.3: .* p < z − 2σ = -2.4 does"):
        for_double_integrators(0.5, 0.2, zero=-2, pole=-2.3)
    procedure = for_double_integrators(0.5, 0.2, zero=-2, pole=-2.3, gain=10.0)
    assert procedure.steps[-1].here == "no K suffices"
    assert [step.as_corrected for step in procedure.steps] == [True, True, False, False]
    assert procedure.stable
    assert not procedure.as_corrected


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"q_low": 0.0}, "q_low"),
        ({"pole_high": -0.5}, "pole_high"),
        ({"amplitude": 0.0}, "amplitude"),
        ({"washout": -1.0}, "washout"),
        ({"gain": 0.0}, "gain"),
        ({"k": float("nan")}, "k"),
        ({"zero": float("inf")}, "zero"),
    ],
)
def test_meaningless_numbers_are_refused(choice: dict[str, float], message: str) -> None:
    numbers = {"q_low": 0.5, "pole_high": 0.5} | choice
    with pytest.raises(es.InvalidDescription, match=rf"^{message} = .*must be a finite number"):
        for_unstable_poles(**numbers)
    if message != "pole_high":
        numbers["decay"] = numbers.pop("pole_high")
        with pytest.raises(es.InvalidDescription, match=rf"^{message} = "):
            for_double_integrators(**numbers)


# --- the proofs --------------------------------------------------------------------------------

PROOFS = {"poles": proofs.of_unstable_poles(), "integrators": proofs.of_double_integrators()}


@pytest.mark.parametrize("name", PROOFS)
def test_every_condition_is_a_sum_of_positive_terms(name: str) -> None:
    """The signs of bounds and slacks alone show it."""
    letters = {proofs.U, proofs.V, proofs.W, proofs.Y, proofs.N, proofs.M, proofs.K, proofs.SIGMA}
    letters |= {proofs.Q_LOW, proofs.EPSILON_HIGH}
    for proof in PROOFS[name]:
        assert proof.holds
        assert proof.expanded.free_symbols <= letters
        assert all(c > 0 for c in proof.expanded.as_coefficients_dict().values())


def test_the_printed_zero_has_no_such_proof() -> None:
    """With z = −h − y a term (h − ε_high) q_low is left."""
    h = Symbol("h", positive=True)
    proof = PROOFS["poles"][1]
    slacks = {**dict(proof.slacks), proofs.Z: -h - proofs.Y}
    printed = replace(proof, slacks=tuple(slacks.items()))
    assert not printed.holds
    left: Any = printed.expanded
    corner = left.subs({proofs.U: 0, proofs.V: 0})
    assert corner.equals((h - proofs.EPSILON_HIGH + proofs.Y) * proofs.Q_LOW)


@pytest.mark.parametrize("seed", range(10))
def test_the_proofs_are_about_the_closed_loop(seed: int) -> None:
    """Coefficients of the polynomials multiplied out, at random letters; decay as a shift."""
    rng = np.random.default_rng(seed)
    q, e, k = rng.uniform(0.1, 2, 3)
    z, p = -rng.uniform(0.1, 3, 2)
    at: Any = {proofs.Q: q, proofs.EPSILON: e, proofs.K: k, proofs.Z: z, proofs.P: p}
    _, first, last = np.polyadd(np.polymul([1, -e], [1, -p]), [k * q, -k * q * z])
    found = [float(proof.condition.subs(at)) for proof in PROOFS["poles"]]
    assert found == pytest.approx([first, last])
    sigma = 0.3
    cubic = np.poly1d(np.polyadd(np.polymul([1, 0, 0], [1, -p]), [k * q, -k * q * z]))
    _, a1, a2, a3 = cubic(np.poly1d([1.0, -sigma])).coeffs
    at[proofs.SIGMA] = sigma
    found = [float(proof.condition.subs(at)) for proof in PROOFS["integrators"]]
    assert found == pytest.approx([a1, a3, a1 * a2 - a3])


def test_at_the_worst_corner_the_last_slack_is_left() -> None:
    corner: Any = {proofs.U: 0, proofs.V: 0}
    damping, stiffness = (p.expanded.subs(corner) for p in PROOFS["poles"])
    assert damping == 2 * proofs.Q_LOW * proofs.W
    assert stiffness == proofs.Q_LOW * proofs.Y
    *_, last = PROOFS["integrators"]
    assert last.expanded.subs(proofs.U, 0) == proofs.M * proofs.Q_LOW**2 * proofs.W


def test_a_proof_reads_as_an_equation() -> None:
    assert str(PROOFS["poles"][1]) == ("1/K (-K q z + ε p) = ε_high u + q_low v + q_low y + u y")
    assert str(PROOFS["integrators"][0]) == "-p - 3 σ = m + n"


# --- the report --------------------------------------------------------------------------------


def test_the_report_lists_every_step_both_ways() -> None:
    text = str(for_unstable_poles(0.5, 0.5, washout=0.1, gain=20.0, zero=-0.2))
    assert "K = αck = 2" in text
    row = next(line for line in text.splitlines() if "z < −h " in line and "(3)" in line)
    assert row.split("  ")[:2] == ["(3)", " z < −h"]
    assert "yes  z < −ε_high  no   z = -0.2, −h = -0.1, −ε_high = -0.5" in row
    other = str(for_double_integrators(0.5, 0.1, gain=10.0, k=5.0, zero=-0.5, pole=-3.0))
    assert "a derived procedure, the printed one being lost" in other
    assert "forbids this safe z" in other
    assert all(len(line) <= 100 for line in (text + "\n" + other).splitlines())
