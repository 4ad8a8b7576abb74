"""The figure of the bias that the paper's schemes keep and designs do not."""

from __future__ import annotations

import numpy as np
import pytest

import extremum as es
from extremum.papers.zhang2007.zero_bias_plot import (
    Comparison,
    bias_comparison,
    comparisons,
    mean_error,
)


@pytest.fixture(scope="module")
def shown() -> tuple[Comparison, ...]:
    return comparisons()


def test_the_designs_keep_no_bias_and_the_papers_schemes_do(
    shown: tuple[Comparison, ...],
) -> None:
    """Exact orbits; the closed forms with α c q = (2, 2), and g = α c k q = (10, 5)."""
    pole = 0.5 * np.array([1.0, -1.0]) / (2.0 - 0.5)
    force = np.array([0.3, -0.3]) * -3.0 / (np.array([10.0, 5.0]) * -0.5)
    for comparison, kept in zip(shown, (pole, force), strict=True):
        paper, ours = (es.periodic_orbit(loop) for loop in comparison.loops)
        assert paper.stable
        assert ours.stable
        assert es.bias(comparison.loops[0]).total == pytest.approx(kept, rel=1e-9)
        assert paper.offset == pytest.approx(kept, abs=0.04)
        assert np.abs(ours.offset).max() < 1e-9


def test_every_run_ends_on_its_orbit(shown: tuple[Comparison, ...]) -> None:
    for comparison in shown:
        for loop in comparison.loops:
            _, errors = mean_error(loop, 20.0)
            assert errors[-1] == pytest.approx(es.periodic_orbit(loop).offset, abs=1e-3)


def test_both_of_a_pair_move_the_same_vehicle_on_the_same_map(
    shown: tuple[Comparison, ...],
) -> None:
    for comparison in shown:
        paper, ours = comparison.loops
        assert paper.vehicle == ours.vehicle
        assert paper.field.source == ours.field.source  # pyright: ignore[reportAttributeAccessIssue]
        assert paper.field.q == ours.field.q  # pyright: ignore[reportAttributeAccessIssue]


def test_the_figure_has_a_panel_for_each_axis_and_names_both() -> None:
    figure = bias_comparison()
    assert len(figure.axes) == 4
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:2] == ["the paper's scheme", "zero-bias design"]
    for axes in figure.axes:
        ends = {line.get_label(): np.array(line.get_ydata())[-1] for line in axes.get_lines()}
        assert abs(ends["zero-bias design"]) < 2e-3
        assert abs(ends["the paper's scheme"]) > 0.15
