"""The errata: figures from the shared table and closed forms, each on the exact loop."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.cells import cell_len

from extremum.papers.zhang2007 import errata
from extremum.papers.zhang2007.tables import Table, escaped

ROOT = Path(__file__).parents[2]


@cache
def report() -> errata.Report:
    return errata.report()


def table(number: int) -> Table:
    return report().tables[number - 1]


def column(number: int, heading: str) -> NDArray[Any]:
    found = table(number)
    (index,) = (i for i, (name, _) in enumerate(found.columns) if name == heading)
    return np.array([row[index] for row in found.rows])


# --- errata 1 to 3 ----------------------------------------------------------------------------

FOUR_DESIGNS = [
    [-2, -1.5, -0.1607, +0.1515, +0.1544, +0.1518, +0.1515],
    [-0.5, -3, +0.3944, -0.4550, -0.4561, -0.4551, -0.4550],
    [-2, -10, -0.1148, -0.1015, -0.1014, -0.1015, -0.1015],
    [-1.2, -1.1, -0.2077, +0.0391, +0.0419, +0.0394, +0.0392],
]
"""z, p, printed, corrected, exact at ω = 30, 100, 400: recomputed from the stated parameters."""


def test_the_four_designs() -> None:
    rows = [row[1:] for row in table(1).rows]
    np.testing.assert_allclose(np.array(rows, dtype=float), FOUR_DESIGNS, atol=1e-4)


def test_the_printed_conditions_are_neither_sufficient_nor_necessary() -> None:
    printed, exact = column(1, "printed (27)"), column(1, "exact, ω = 400")
    assert ((printed < 0) & (exact > 0)).any()
    assert ((printed > 0) & (exact < 0)).any()
    corrected = column(1, "corrected")
    assert (np.sign(corrected) == np.sign(exact)).all()


def test_the_off_peak_orbit() -> None:
    """The mean tends to 0.26316, where (54) says 0.3333; the second loop is stable."""
    mean, corrected, printed = (
        column(2, name) for name in ("mean of x̃", "corrected (54)", "printed (54)")
    )
    assert mean[3] == pytest.approx(0.26318, abs=5e-6)
    assert corrected[3] == pytest.approx(0.26316, abs=5e-6)
    assert printed[3] == pytest.approx(0.3333, abs=5e-5)
    distance = np.abs(mean - corrected)[:4]
    assert (distance[1:] < distance[:-1] / 3).all()
    exact = column(2, "largest exponent")
    assert exact[-1] == pytest.approx(-0.23765, abs=5e-6)
    assert mean[-1] == pytest.approx(0.0833, abs=5e-5)
    assert column(2, "printed (52)")[-1] == pytest.approx(0.1232, abs=5e-5)
    assert printed[-1] == pytest.approx(-0.125)


def test_positive_roots_are_meant_to_lie_left() -> None:
    (row,) = table(3).rows
    a1, a2, a3, product = (float(cell) for cell in row[:4])
    assert [a1, a2, a3, product] == pytest.approx([3.0, 5.0, 2.5, 12.5])
    roots = [complex(text) for text in str(row[4]).split(", ")]
    assert all(root.real < 0 for root in roots)
    assert np.poly(roots).real == pytest.approx([1, a1, a2, a3], abs=5e-3)


# --- what else is not exact -------------------------------------------------------------------


def test_the_compensators_output_keeps_its_ripple() -> None:
    """On the peak of Fig. 2: max |w| = k c α² |q_x − q_y|/2 = 5 · 10 · 0.01 · 0.5/2."""
    assert column(4, "Fig. 2: max |w|") == pytest.approx([0.125] * 3, rel=1e-3)
    ripple = column(4, "Fig. 3: max |w − wᵉ|")
    assert ripple[2] / ripple[0] == pytest.approx(1.0, abs=0.02)
    distance = column(4, "max |x̃ − x̃ᵉ|")
    assert distance[0] / distance[2] == pytest.approx(16.0, rel=0.02)


def test_only_the_orders_that_differ_are_listed() -> None:
    printed, found = column(5, "printed"), column(5, "measured")
    assert (np.abs(printed.astype(float) - found.astype(float)) > 0.1).all()


def test_a_smaller_amplitude_makes_the_residual_of_theorem_3_larger() -> None:
    """The bias alone is q (εx*/(αcq − ε))² in each axis."""
    residual = column(6, "lim sup |f − f*|")
    amplitude = column(6, "α")
    for a, found in zip(amplitude[:3], residual[:3], strict=True):
        bias = sum(q * (0.05 / (a * 10 * q - 0.05)) ** 2 for q in (1.0, 0.5))
        dither = sum(q * (a + 0.05 / (a * 10 * q - 0.05)) ** 2 for q in (1.0, 0.5))
        assert bias < float(found) < dither
    assert residual[3] == "unstable"
    assert 0.008 * 10 * 0.5 < 0.05


def test_the_design_is_safe_exactly_beyond_the_corrected_bound() -> None:
    """z < −ε q̲/q, the worse in the axis with q = q̲ = 0.5: z < −0.5, not z < −h = −0.1."""
    zero, exact = column(7, "z"), column(7, "exact, ω = 400")
    assert (zero < -0.1).all()
    assert (column(7, "printed (52)") < 0).all()
    assert ((zero < -0.5) == (exact < 0)).all()


def test_gain_alone_stabilises_a_pole_of_medium_size() -> None:
    assert (column(8, "exact").astype(float) < 0).all()
    source, bias = column(8, "x* = −y*"), column(8, "bias, by (43)")
    assert bias == pytest.approx(0.5 * source / 1.5)


def test_a_constant_force_is_accommodated_up_to_the_static_error() -> None:
    assert column(9, "exact") == pytest.approx([0.30, 0.36], abs=1e-3)


def test_drag_keeps_the_relative_degree() -> None:
    assert (column(10, "relative degree") == 2).all()
    assert (column(10, "exact, ω = 100").astype(float) < 0).all()
    assert column(10, "roots of s² + ds + g") == pytest.approx([-0.25, -1.0])


def test_two_frequencies_serve_three_axes_and_a_collision_costs_half_the_dither() -> None:
    far, rate = column(11, "distance of the mean"), column(11, "largest exponent")
    assert (rate < 0).all()
    assert (far[:2] < 1e-3).all()
    assert far[2:] == pytest.approx([0.05, 0.05], abs=1e-4)


def test_a_cubic_map_moves_the_centre_whatever_the_frequency() -> None:
    assert column(12, "exact mean of x") == pytest.approx([3 * 0.1**2 / 16] * 4, rel=5e-3)


def test_the_scanned_phase_escapes_and_starts_elsewhere() -> None:
    ended = column(13, "Fig. 5, 30 s")
    assert ended[0].startswith("escapes")
    assert ended[1] == "completed"
    assert column(13, "source at t = 0")[1] == "(0.00, 0.00)"


def test_the_washouts_start_decides_an_escape() -> None:
    """Fig. 4 with J − 5 escapes at 0.064 s, Fig. 7 at 0.17 s."""
    from_zero = [float(text.split()[2]) for text in column(14, "washout from zero")]
    assert from_zero == pytest.approx([0.064, 0.17], abs=5e-3)
    assert set(column(14, "washout from J(0)")) == {"completed"}


# --- the report and the page ------------------------------------------------------------------


def test_the_page_shows_what_the_report_computes() -> None:
    page = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
    for erratum, found in zip(errata.ERRATA, report().tables, strict=True):
        assert found.markdown() in page, f"erratum {erratum.number}"
        assert erratum.heading() in page
        for text in (erratum.printed, erratum.corrected, erratum.why, erratum.shows):
            assert escaped(text) in page, text


def test_the_report_prints_every_erratum_and_number() -> None:
    text = str(report())
    for erratum in errata.ERRATA:
        assert f"\n{erratum.number}. " in f"\n{text}"
    for number in ("-0.1607", "+0.1515", "0.26318", "+0.1787"):
        assert number in text
    assert max(map(cell_len, text.splitlines())) <= 100


def test_a_table_hides_the_sign_of_zero_and_escapes_what_markdown_reads() -> None:
    found = Table((("|x|", "+.2f"), ("x*", "")), ((-0.001, "a|b"), (0.125, "c")))
    assert found.cells() == [["+0.00", "a|b"], ["+0.12", "c"]]
    assert found.markdown() == (
        "| \\|x\\| | x\\* |\n| --- | --- |\n| +0.00 | a\\|b |\n| +0.12 | c |"
    )
