"""Equations as text and LaTeX."""

from __future__ import annotations

import pytest
from loops import force_actuated, velocity_actuated
from matplotlib.mathtext import MathTextParser

from extremum.papers.zhang2007 import NAMES, scenario


def test_the_papers_loop_reads_as_in_the_paper() -> None:
    lines = str(velocity_actuated().system).splitlines()
    for line in (
        "  J     = f* - q_x (x - x*)² - q_y (y - y*)²",
        "  ξ     = J - η",
        "  v_x   = α_x ω cos(ω t) + c_x ξ sin(ω t)",
        "  v_y   = α_y ω sin(ω t) - c_y ξ cos(ω t)",
        "  dx/dt = v_x",
        "  dη/dt = h (J - η)",
        "  η(0) = J(0)",
    ):
        assert line in lines
    lines = str(force_actuated().system).splitlines()
    assert "  u_x     = -α_x ω² sin(ω t) + w_x" in lines
    assert "  w_x     = k_x m_x + ζ_x" in lines


def test_numbers_stand_beside_their_paths() -> None:
    loop = velocity_actuated()
    text = loop.system.text(loop.values.tolist())
    assert "controller.channels.1.dither.amplitude = 0.08" in text


@pytest.mark.parametrize("name", NAMES)
def test_every_line_of_latex_can_be_set(name: str) -> None:
    latex = scenario(name).loop.system.latex()
    lines = latex.split("\n")
    assert lines[0] == r"\begin{aligned}"
    assert lines[-1] == r"\end{aligned}"
    for line in lines[1:-1]:
        formula = line.removesuffix(r" \\").replace("&", "")
        MathTextParser("path").parse(f"${formula}$")


def test_latex_has_the_papers_symbols() -> None:
    latex = velocity_actuated().system.latex()
    assert r"v_{x} &= \alpha_{x} \omega \cos{\left(\omega t \right)} + c_{x} \xi" in latex
    assert r"\dot{\eta} &= h \left(J - \eta\right), & \eta(0) &= J(0)" in latex
