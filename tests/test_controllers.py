from __future__ import annotations

import numpy as np
import pytest
import sympy
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import pi, s

t = es.t


def symbols(loop: es.Loop) -> dict[str, sympy.Symbol]:
    system = loop.system
    names = {str(p.symbol): p.symbol for p in system.parameters}
    names |= {str(x): x for x in (*system.states, *(symbol for symbol, _ in system.signals))}
    return names


def signals(loop: es.Loop) -> dict[str, sympy.Expr]:
    return {str(symbol): expression for symbol, expression in loop.system.signals}


def test_fig1_is_the_papers_diagram_word_for_word() -> None:
    loop = velocity_actuated()
    n, drawn = symbols(loop), signals(loop)
    sin, cos = sympy.sin(n["omega"] * t), sympy.cos(n["omega"] * t)
    qx, qy, x0, y0 = n["q_x"], n["q_y"], n["x^*"], n["y^*"]
    expected = {
        "J": n["f^*"] - qx * (n["x"] - x0) ** 2 - qy * (n["y"] - y0) ** 2,
        "xi": n["J"] - n["eta"],
        "v_x": n["alpha_x"] * n["omega"] * cos + n["c_x"] * n["xi"] * sin,
        "v_y": n["alpha_y"] * n["omega"] * sin - n["c_y"] * n["xi"] * cos,
    }
    assert {name: sympy.simplify(drawn[name] - e) for name, e in expected.items()} == dict.fromkeys(
        expected, 0
    )
    rates = dict(zip(map(str, loop.system.states), loop.system.rhs, strict=True))
    assert sympy.expand(rates["eta"] - n["h"] * (n["J"] - n["eta"])) == 0
    assert (rates["x"], rates["y"]) == (n["v_x"], n["v_y"])


def test_fig2_is_the_papers_diagram_with_a_proper_compensator() -> None:
    loop = force_actuated()
    n, drawn = symbols(loop), signals(loop)
    sin, cos = sympy.sin(n["omega"] * t), sympy.cos(n["omega"] * t)
    assert drawn["u_x"] == -n["alpha_x"] * n["omega"] ** 2 * sin + n["w_x"]
    assert drawn["u_y"] == n["alpha_y"] * n["omega"] ** 2 * cos + n["w_y"]
    assert drawn["m_y"] == -n["c_y"] * n["xi"] * cos
    rates = dict(zip(map(str, loop.system.states), loop.system.rhs, strict=True))
    # w = C(s) m with C = k (s - z)/(s - p): (d/dt - p) w = k (d/dt - z) m, m taken as constant
    w = drawn["w_x"]
    rate = sum(w.diff(x) * rates[str(x)] for x in loop.system.states)
    expected = n["p_x"] * w - n["k_x"] * n["z_x"] * n["m_x"]
    assert sympy.expand(rate - expected) == 0


def test_unstable_scheme_probes_through_one_over_s_not_through_the_axis() -> None:
    through_s = velocity_actuated().replace(
        {
            "vehicle.axes": (1 / (s - 0.5), 1 / (s - 0.5)),
            "controller.channels.0.dither.through": 1 / s,
        }
    )
    n, drawn = symbols(through_s), signals(through_s)
    probe = drawn["v_x"].subs(n["xi"], 0)
    assert probe == n["alpha_x"] * n["omega"] * sympy.cos(n["omega"] * t)
    exact = drawn["v_y"].subs(n["xi"], 0)
    a = next(p.symbol for p in through_s.system.parameters if p.path == "vehicle.axes.1.den.0")
    extra = n["alpha_y"] * a * sympy.sin(n["omega"] * t - pi / 2)
    assert (
        sympy.simplify(exact - n["alpha_y"] * n["omega"] * sympy.sin(n["omega"] * t) - extra) == 0
    )


@pytest.mark.parametrize(
    "axis",
    [
        *(1 / s, 1 / s**2, 1 / s**3, 1 / (s - 0.5), 1 / (s * (s + 0.7))),
        *((s + 2) / (s * (s + 0.7)), (s + 3) / ((s - 0.2) * (s + 1) * (s + 5))),
        (s**2 + s + 3) / (s**2 * (s + 4)),
    ],
)
@pytest.mark.parametrize("phase", [0.0, -np.pi / 2, 0.4])
def test_a_start_on_the_dither_moves_exactly_as_the_dither_says(
    axis: sympy.Expr, phase: float
) -> None:
    """With zero gain and a pole-free centre, x(t) is the start plus α (sin(ωt + φ) − sin φ)."""
    alpha, omega = 0.3, 7.0
    centre = -alpha * np.sin(phase)  # so that the dither's centre is the origin, a rest of any axis
    loop = es.Loop(
        field=es.Quadratic(source=(centre,), q=(1.0,)),
        vehicle=es.PointMass(axes=(axis,)),
        controller=es.GradientES(
            frequency=omega,
            washout=1.0,
            channels=(es.Channel(dither=es.Dither(alpha, phase=phase), gain=0.0),),
        ),
        start=es.OnDither((alpha * np.sin(phase),)),
    )
    run = es.simulate(loop, 2.0)
    expected = alpha * np.sin(omega * run.time.values + phase)
    assert np.abs(run.x.values - expected).max() < 1e-9


@pytest.mark.parametrize(
    "axis", [1 / s**2, (s + 2) / (s * (s + 0.7)), (s**2 + s + 3) / (s**2 * (s + 4))]
)
def test_a_start_anywhere_is_a_rest_or_a_dither_about_it(axis: sympy.Expr) -> None:
    """An axis with an integrator can rest anywhere, whatever coordinates its states have."""
    alpha, omega, begin = 0.3, 7.0, 5.0
    loop = es.Loop(
        field=es.Quadratic(source=(0,), q=(1.0,)),
        vehicle=es.PointMass(axes=(axis,)),
        controller=es.GradientES(omega, 1.0, (es.Channel(es.Dither(alpha), gain=0.0),)),
        start=es.OnDither((begin,)),
    )
    run = es.simulate(loop, 2.0)
    expected = begin + alpha * np.sin(omega * run.time.values)
    assert np.abs(run.x.values - expected).max() < 1e-9
    faint = loop.replace({"start": (begin,), "controller.channels.0.dither.amplitude": 1e-12})
    assert np.abs(es.simulate(faint, 2.0).x.values - begin).max() < 1e-9


@pytest.mark.parametrize(
    ("axis", "through"), [(1 / (s + 20), 1 / s), (1 / (s * (s + 3)), 1 / s**2)]
)
def test_on_the_dither_means_as_the_steady_probe_moves_it(
    axis: sympy.Expr, through: sympy.Expr
) -> None:
    """A probe through another 1/G moves the position by α G_axis/G, not by α."""
    alpha, omega, phase = 0.08, 7.0, 0.4

    def at(transfer: sympy.Expr) -> complex:
        return complex(transfer.subs(s, sympy.I * omega))  # pyright: ignore

    motion = alpha * np.exp(1j * phase) * at(axis) / at(through)
    loop = es.Loop(
        field=es.Quadratic((0,), (1.0,)),
        vehicle=es.PointMass((axis,)),
        controller=es.GradientES(
            omega, 1.0, (es.Channel(es.Dither(alpha, phase, through=through), gain=0.0),)
        ),
        start=es.OnDither((float(motion.imag),)),
    )
    run = es.simulate(loop, 3.0)
    expected = (motion * np.exp(1j * omega * run.time.values)).imag
    assert np.abs(run.x.values - expected).max() < 1e-9


def test_from_rest_a_double_integrator_drifts_and_a_ramp_prevents_it() -> None:
    """v settles about −αω (from rest) or −αω/(1 + ω²T²) (probe ramp of time constant T)."""
    alpha, omega, ramp = 0.1, 30.0, 0.5

    def drift(**changes: object) -> float:
        loop = force_actuated(start=(1.0, 1.0)).replace(
            {"controller.channels.0.gain": 0, "controller.channels.1.gain": 0, **changes}
        )
        period = 2 * np.pi / omega
        times = 60 * period + np.linspace(0, period, 65)
        run = es.simulate(loop, 62 * period, samples=times)
        return float((run.x.values[-1] - run.x.values[1]) / period)

    assert drift() == pytest.approx(-alpha * omega, rel=1e-9)
    slow = drift(**{"controller.probe_ramp": ramp})
    assert slow == pytest.approx(-alpha * omega / (1 + (omega * ramp) ** 2), rel=1e-6)


def test_a_probe_stated_at_the_input_is_the_dither_it_causes() -> None:
    """For 1/s the dither α sin(ωt + φ) is the probe αω sin(ωt + φ + π/2)."""
    dithered = velocity_actuated()
    probed = dithered.replace(
        {
            f"controller.channels.{i}": es.Channel(
                dither=es.Probe(0.08 * 30, phase=phase + np.pi / 2), gain=10, reference=phase
            )
            for i, phase in enumerate((0.0, -np.pi / 2))
        }
    )
    ours, theirs = es.simulate(dithered, 3.0), es.simulate(probed, 3.0)
    assert np.abs(ours.position - theirs.position).max() < 1e-9


def test_a_probe_needs_a_reference() -> None:
    with pytest.raises(es.InvalidDescription, match=r"Channel\.reference.*Probe"):
        es.Channel(dither=es.Probe(2.4), gain=10)


@pytest.mark.parametrize(("start", "expected"), [("zero", 0.0), ("signal", -5.0), (0.25, 0.25)])
def test_the_washout_starts_where_it_is_told(start: str | float, expected: float) -> None:
    run = es.simulate(velocity_actuated(**{"controller.washout_start": start}), 0.1)
    assert run.eta.values[0] == expected


def test_a_start_on_the_dither_and_a_ramp_exclude_each_other() -> None:
    with pytest.raises(es.InvalidDescription, match="steady from t = 0"):
        force_actuated(**{"controller.probe_ramp": 1.0})


def test_the_dithers_repeat_together_after_the_common_period() -> None:
    loop = velocity_actuated(**{"controller.channels.0.ratio": "2/3"})
    period = loop.system.common_period(loop.values.tolist())
    assert period == pytest.approx(2 * np.pi / (30 / 3))
    almost = velocity_actuated(**{"controller.channels.0.ratio": 0.7})
    assert almost.system.common_period(almost.values.tolist()) is None


def test_ratios_multiply_the_base_frequency() -> None:
    loop = velocity_actuated(**{"controller.channels.1.ratio": "3/2"})
    omega = symbols(loop)["omega"]
    assert set(loop.system.carriers) == {omega, sympy.Rational(3, 2) * omega}
    assert loop.system.fastest_period(loop.values.tolist()) == pytest.approx(2 * np.pi / 45)
    irrational = velocity_actuated(**{"controller.channels.1.ratio": 2**0.5})
    paths = [p.path for p in irrational.system.parameters]
    assert "controller.channels.1.ratio" in paths
    assert "controller.channels.1.ratio" not in [p.path for p in loop.system.parameters]
