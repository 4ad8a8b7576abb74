"""The figure of a design: what it shows is what other ways of computing it find."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import extremum as es
from extremum import plots, s

EPSILON = "vehicle.axes.0.parameters.epsilon"


@pytest.fixture(scope="module")
def design() -> es.Design:
    """An unstable pole that is known up to a range, PI control; and a double integrator, a lead."""
    slow = es.Rational("1/(s - epsilon)", {"epsilon": 0.25})
    return es.design(
        es.Requirements(
            vehicle=es.PointMass(axes=(slow, 1 / s**2)),
            curvature=((0.5, 2.0), (0.5, 1.5)),
            dither_limit=0.1,
            settling_time=8.0,
            uncertain={EPSILON: (0, 0.5)},
            source_distance=(2, 0),
            start_distance=0.5,
        )
    )


@pytest.fixture(scope="module")
def figure(design: es.Design) -> Figure:
    return plots.design(design)


def small(**changes: Any) -> es.Requirements:
    wanted = {
        "vehicle": es.PointMass(axes=(1 / s,)),
        "curvature": ((0.5, 2.0),),
        "dither_limit": 0.1,
        "settling_time": 6.0,
    }
    return es.Requirements(**(wanted | changes))


def panels(figure: Figure) -> list[Any]:
    return [axes for axes in figure.axes if axes.axison]


def lines(axes: Any, label: str) -> list[Any]:
    found = [line for line in axes.lines if line.get_label() == label]
    assert found, [line.get_label() for line in axes.lines]
    return found


def points(axes: Any, label: str) -> NDArray[np.complex128]:
    return np.concatenate([x.get_xdata() + 1j * x.get_ydata() for x in lines(axes, label)])


def loop_gain(design: es.Design, axis: int, q: float, epsilon: float, at: Any) -> Any:
    """Return L = α c q cos(ψ − φ) C G at complex points; the washout's m = ω/√(ω² + h²) by hand."""
    controller: Any = design.controller
    channel = controller.channels[axis]
    omega, h = controller.frequency, controller.washout
    shape = design.plan.shapes[axis]
    compensator = np.polyval(shape.above, at) / np.polyval(shape.below, at)
    plant = 1 / (at - epsilon) if axis == 0 else 1 / at**2
    m = omega / np.hypot(omega, h)
    return channel.dither.amplitude * channel.gain * q * m * compensator * plant


# --- roots ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("end", "words"), [(0, "lowest q"), (1, "highest q")])
def test_marked_roots_solve_the_loop_at_the_ends(
    design: es.Design, figure: Figure, end: int, words: str
) -> None:
    for axis, axes in ((0, panels(figure)[0]), (1, panels(figure)[3])):
        q = design.requirements.curvature[axis][end]
        found = lines(axes, words)
        for line, epsilon in zip(found, (0.0, 0.5) if axis == 0 else (0.0,), strict=True):
            roots = line.get_xdata() + 1j * line.get_ydata()
            assert len(roots) == (2, 3)[axis]
            distance = np.abs(1 + loop_gain(design, axis, q, epsilon, roots))
            assert distance.max() < 2e-4  # the gain is rounded to five digits


def test_no_root_over_the_box_crosses_the_proved_line(design: es.Design, figure: Figure) -> None:
    for axis, axes in ((0, panels(figure)[0]), (1, panels(figure)[3])):
        (line,) = lines(axes, "proved: Re λ < −σ")
        decay = -float(line.get_xdata()[0])
        assert decay == design.proofs[axis].decay
        inside = points(axes, "averaged, all over the box").real.max()
        assert -1.05 * decay < inside < -decay
        assert points(axes, "averaged, other gains").real.max() > -decay
        assert f"σ = {decay:.3g} 1/s" in axes.get_title(loc="left")


def test_diamonds_are_floquet_exponents_near_the_averaged_roots(
    design: es.Design, figure: Figure
) -> None:
    exact = []
    for end in (0, 1):
        for epsilon in (0.0, 0.5):
            q = {f"field.q.{i}": ends[end] for i, ends in enumerate(design.requirements.curvature)}
            orbit = es.periodic_orbit(design.at({**q, EPSILON: epsilon, "field.source.0": 0.0}))
            exact += orbit.exponents.tolist()
    for axes in (panels(figure)[0], panels(figure)[3]):
        shown = points(axes, "exact (Floquet exponents)")
        assert len(shown) >= 4
        assert all(np.abs(np.array(exact) - x).min() < 1e-9 for x in shown)
        averaged = np.concatenate([points(axes, words) for words in ("lowest q", "highest q")])
        assert all(np.abs(averaged - x).min() < 0.1 * abs(x) for x in shown)


def test_poles_and_zeros_of_the_loop(design: es.Design, figure: Figure) -> None:
    axes = panels(figure)[0]
    assert np.allclose(np.sort(np.unique(points(axes, "pole of L(s)").real)), [0, 0.5])
    above = design.plan.shapes[0].above
    assert np.allclose(points(axes, "zero of L(s)"), -above[1] / above[0])


# --- the Nichols chart ------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1])
def test_the_curve_is_the_loop_gain_in_the_middle(
    design: es.Design, figure: Figure, axis: int
) -> None:
    axes = panels(figure)[3 * axis + 1]
    (line,) = lines(axes, "L(jω), in the middle")
    shown = 10 ** (line.get_ydata() / 20) * np.exp(1j * np.radians(line.get_xdata()))
    q = np.sqrt(np.prod(design.requirements.curvature[axis]))
    w = design.plan.shapes[axis].crossover
    omega = np.geomspace(w / 300, w * 300, len(shown))
    expected = loop_gain(design, axis, q, 0.25, 1j * omega)
    assert np.abs(shown / expected - 1).max() < 1e-4
    phase = np.radians(line.get_xdata())
    assert np.abs(np.diff(phase)).max() < 0.1
    for text in axes.texts:
        if text.get_text().endswith(" rad/s"):
            named = 1j * float(text.get_text().removesuffix(" rad/s"))
            value = loop_gain(design, axis, q, 0.25, named)
            x, y = text.xy
            assert 10 ** (y / 20) * np.exp(1j * np.radians(x)) == pytest.approx(value, rel=1e-2)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_band_holds_the_loop_gain_all_over_the_box(
    design: es.Design, figure: Figure, axis: int
) -> None:
    axes = panels(figure)[3 * axis + 1]
    cells = [c for c in axes.collections if isinstance(c, PolyCollection) and c.get_label() != ""]
    corners = np.concatenate([p.vertices for c in cells for p in c.get_paths()])
    rng = np.random.default_rng(1)
    low, high = design.requirements.curvature[axis]
    for _ in range(60):
        q = rng.uniform(low, high)
        epsilon = rng.choice(np.linspace(0, 0.5, 17))
        omega = design.plan.shapes[axis].crossover * 10 ** rng.uniform(-1, 1)
        value = loop_gain(design, axis, q, epsilon, 1j * omega)
        size, phase = 20 * np.log10(abs(value)), np.degrees(np.angle(value))
        turns = (corners[:, 0] - phase + 180) % 360 - 180
        near = corners[np.abs(turns) < 1.5]
        assert near[:, 1].min() - 0.3 < size < near[:, 1].max() + 0.3


def test_the_region_around_minus_one_is_that_of_sensitivities_above_2(figure: Figure) -> None:
    for axes in (panels(figure)[1], panels(figure)[4]):
        drawn = [c for c in axes.collections if isinstance(c, QuadContourSet)]
        assert [c.filled for c in drawn] == [True, False]
        for contours in drawn:
            edge = np.concatenate([path.vertices for path in contours.get_paths()])
            gain = 10 ** (edge[:, 1] / 20) * np.exp(1j * np.radians(edge[:, 0]))
            assert np.abs(1 / np.abs(1 + gain) - 2).max() < 0.02
            assert edge[:, 1].max() == pytest.approx(20 * np.log10(1.5), abs=0.02)


def shown_margins(axes: Any) -> tuple[float, list[float]]:
    """Return the phase margin (°) and the gain margins (dB) that a chart names."""
    texts = [text.get_text() for text in axes.texts]
    (phase,) = [float(t.removesuffix("°")) for t in texts if t.endswith("°")]
    return phase, [float(t.removesuffix(" dB")) for t in texts if t.endswith(" dB")]


def least_margins(gains: Any, curves: list[Any]) -> tuple[float, float, float]:
    """Return the least phase margin (°), gain margin up and down (dB) by looking everywhere."""
    phase, up, down = np.inf, np.inf, np.inf
    for gain in gains:
        for curve in curves:
            level, angle = np.abs(gain * curve), np.unwrap(np.angle(curve))
            cross = np.flatnonzero(np.diff(np.sign(level - 1)))
            margin = np.abs((angle[cross] + 2 * np.pi) % (2 * np.pi) - np.pi)
            phase = min([phase, *np.degrees(margin).tolist()])
            turned = np.sin(angle)
            real = np.flatnonzero((turned[1:] * turned[:-1] < 0) & (np.cos(angle[1:]) < 0))
            for size in 20 * np.log10(level[real]):
                up, down = (min(up, -size), down) if size < 0 else (up, min(down, size))
    return phase, up, down


def test_margins_are_the_least_over_the_box(design: es.Design, figure: Figure) -> None:
    points = 1j * np.geomspace(1e-3, 1e3, 20001)
    for axis in (0, 1):
        phase, gains = shown_margins(panels(figure)[3 * axis + 1])
        poles = np.linspace(0, 0.5, 11) if axis == 0 else [0.0]
        curves = [loop_gain(design, axis, 1.0, epsilon, points) for epsilon in poles]
        q = np.geomspace(*design.requirements.curvature[axis], 25)
        least = least_margins(q, curves)
        assert phase == pytest.approx(least[0], abs=0.3)
        assert gains == ([pytest.approx(least[2], abs=0.1)] if axis == 0 else [])
        assert np.isinf(least[1])


def test_lags_leave_the_least_margins_to_the_highest_curvature() -> None:
    lags = 1 / (s * (0.1 * s + 1) * (0.05 * s + 1))
    design = es.design(small(vehicle=es.PointMass(axes=(lags,))))
    phase, gains = shown_margins(panels(plots.design(design))[1])
    at = 1j * np.geomspace(1e-2, 1e3, 20001)
    (shape,) = design.plan.shapes
    compensator = np.polyval(shape.above, at) / np.polyval(shape.below, at)
    curve = shape.gain * compensator / (at * (0.1 * at + 1) * (0.05 * at + 1))
    least = least_margins(np.geomspace(0.5, 2.0, 25), [curve])
    assert phase == pytest.approx(least[0], abs=0.3)
    assert gains == [pytest.approx(least[1], abs=0.1)]
    assert np.isinf(least[2])
    assert phase == pytest.approx(least_margins([2.0], [curve])[0], abs=0.3)


# --- responses --------------------------------------------------------------------------------


def test_the_band_is_what_the_averaged_equations_do(design: es.Design, figure: Figure) -> None:
    """On x, x' = εx + u, u = −k(x + a∫x); on y, y'' = u through a lead; in states, integrated."""
    (lead_above, lead_below) = (design.plan.shapes[1].above, design.plan.shapes[1].below)
    rate = design.plan.shapes[0].above[1] / design.plan.shapes[0].above[0]
    r = 0.5 / np.sqrt(2)
    for axis in (0, 1):
        axes = panels(figure)[3 * axis + 2]
        (band,) = [c for c in axes.collections if c.get_label() == "averaged, all over the box"]
        outline = band.get_paths()[0].vertices
        for q in design.requirements.curvature[axis]:
            k = float(np.real(loop_gain(design, axis, q, 0.0, 1e9) * (1e9 if axis == 0 else 1e18)))

            def slope(t: float, x: Any, k: float = k, axis: int = axis) -> list[float]:
                if axis == 0:
                    return [0.5 * x[0] - k * (x[0] + rate * x[1]), x[0]]
                # z' = −p z + x; the lead's output is x + (zero − pole) z
                zero, pole = lead_above[1] / lead_above[0], lead_below[1]
                return [x[1], -k * (x[0] + (zero - pole) * x[2]), x[0] - pole * x[2]]

            start = [r, 0.0] if axis == 0 else [r, 0.0, 0.0]
            times = np.linspace(0.2, 15.0, 40)
            run = solve_ivp(slope, (0, 15), start, t_eval=times, rtol=1e-9, atol=1e-12)
            for t, x in zip(times, run.y[0], strict=True):
                here = outline[np.abs(outline[:, 0] - t) < 0.05][:, 1]
                assert here.min() - 0.02 * r < x < here.max() + 0.02 * r


def test_the_exact_path_is_what_simulate_returns(design: es.Design, figure: Figure) -> None:
    r = 0.5 / np.sqrt(2)
    for words, end in (("lowest q", 0), ("highest q", 1)):
        q = {f"field.q.{i}": ends[end] for i, ends in enumerate(design.requirements.curvature)}
        point = {**q, EPSILON: 0.5, "field.source.0": 0.0}
        loop = design.at(point, (r, r))
        period = 2 * np.pi / design.frequency
        run = es.simulate(loop, 16.0, samples=np.arange(0, 16, period / 200))
        for axis in (0, 1):
            axes = panels(figure)[3 * axis + 2]
            mean = lines(axes, f"exact, {words}: mean")[0].get_xydata()
            window = np.convolve(run.position[:, axis], np.ones(200) / 200, "valid")
            centre = run.time.values[: len(window)] + 199 / 400 * period
            inside = centre > mean[0, 0]
            assert np.abs(np.interp(centre, *mean.T) - window)[inside].max() < 1e-3 * r
            if end == 0:
                path = lines(axes, "exact, lowest q: position")[0].get_xydata()
                again = es.simulate(loop, path[-1, 0], samples=path[:, 0])
                assert np.abs(again.position[:, axis] - path[:, 1]).max() < 1e-9


def test_settling_time_and_two_percent_are_marked(design: es.Design, figure: Figure) -> None:
    r = 0.5 / np.sqrt(2)
    for axes in (panels(figure)[2], panels(figure)[5]):
        (line,) = lines(axes, "settling time wanted")
        assert set(line.get_xdata()) == {8.0}
        (band,) = [p for p in axes.patches if p.get_label() == "2 % of the displacement"]
        assert band.get_bbox().intervaly == pytest.approx([-0.02 * r, 0.02 * r])
        assert axes.get_xlim() == (0, 16)
        for words in ("lowest q", "highest q"):
            t, x = lines(axes, f"exact, {words}: mean")[0].get_xydata().T
            assert np.abs(x[t > 8]).max() < 0.02 * r


# --- the whole --------------------------------------------------------------------------------


def test_labels_and_titles(figure: Figure) -> None:
    shown = panels(figure)
    assert [a.get_xlabel() for a in shown] == ["Re λ (1/s)", "arg L(jω) (°)", "$t$ (s)"] * 2
    assert [a.get_ylabel() for a in shown] == [
        *("Im λ (rad/s)", "|L(jω)| (dB)", "$x - x^*$ (m)"),
        *("Im λ (rad/s)", "|L(jω)| (dB)", "$y - y^*$ (m)"),
    ]
    for letter, axes in zip("abcdef", shown, strict=True):
        title = axes.get_title(loc="left")
        assert title.startswith(f"({letter}) {'x' if letter < 'd' else 'y'}: ")


PROBLEMS = {
    "one axis": small(),
    "three axes": small(
        vehicle=es.PointMass(axes=(1 / s, 1 / s, 1 / (s * (s + 2)))),
        curvature=((0.5, 1.0),) * 3,
        settling_time=8.0,
    ),
    "bandwidth": small(settling_time=None, bandwidth=0.5),
    "resonator": small(motion=es.Periodic(0.5), settling_time=20.0),
    "negative gain": small(vehicle=es.PointMass(axes=(-1 / (s * (0.1 * s + 1)),))),
    "sensor": small(sensor=1 / (0.05 * s + 1)),
    "bias": small(
        vehicle=es.PointMass(axes=(1 / (s - 0.2),)), zero_bias=False, source_distance=0.5
    ),
    "one curvature": small(curvature=(1.0,)),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_everything_fits_into_the_figure(name: str) -> None:
    design = es.design(PROBLEMS[name])
    figure = plots.design(design)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    shown = panels(figure)
    assert len(shown) == 3 * len(design.plan.families)
    legends = [axes.get_legend() for axes in figure.axes if not axes.axison]
    assert len(legends) == 3
    boxes = [axes.get_tightbbox(renderer) for axes in shown]
    boxes += [legend.get_window_extent(renderer) for legend in legends if legend]
    for index, box in enumerate(boxes):
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1
        assert not any(box.overlaps(other) for other in boxes[:index])


def test_a_loop_with_a_resonator_keeps_clear_of_minus_one_on_both_sides() -> None:
    axes = panels(plots.design(es.design(PROBLEMS["resonator"])))[1]
    (line,) = lines(axes, "L(jω), in the middle")
    jumps = np.diff(line.get_xdata())
    (place,) = np.flatnonzero(np.abs(jumps) > 90)
    assert jumps[place] == pytest.approx(-180, abs=3)  # past a pole at jΩ on the right
    assert line.get_ydata()[place : place + 2].min() > 30


def test_anything_else_is_refused() -> None:
    with pytest.raises(es.InvalidDescription, match=r"design = 3: must be a Design"):
        plots.design(3)  # pyright: ignore[reportArgumentType]


def test_design_and_settings_are_left_as_they_are(design: es.Design) -> None:
    before, settings = str(design), dict(matplotlib.rcParams)
    plots.design(design)
    assert str(design) == before
    assert dict(matplotlib.rcParams) == settings


def test_pyplot_is_never_imported() -> None:
    program = """
import sys
import extremum as es
from extremum import s
design = es.design(es.Requirements(es.PointMass(axes=(1/s,)), [[0.5, 1]], 0.1, settling_time=5))
assert "matplotlib" not in sys.modules
es.plots.design(design)
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
