"""Every numbered equation of the paper: what reproduces or corrects it, and the test that does so.

The paper numbers its equations from (1) to (65); (41) is on the half page that the only surviving
scan has lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Status = Literal["as printed", "corrected", "not as measured", "lost"]


@dataclass(frozen=True)
class Equation:
    """A numbered equation, or several that belong together.

    Attributes
    ----------
    first, last
        The paper's numbers, both included.
    what
        What it states.
    status
        ``"as printed"``: reproduced. ``"corrected"``: the paper's algebra is wrong there.
        ``"not as measured"``: an order that is an upper bound, but not what is measured, or no
        bound at all. ``"lost"``: illegible in the scan, restored from its place.
    functions
        Dotted names, within ``extremum``, of what computes it.
    tests
        Where it is checked, as pytest names it, within ``tests``.
    """

    first: int
    last: int
    what: str
    status: Status
    functions: tuple[str, ...]
    tests: tuple[str, ...]

    @property
    def numbers(self) -> str:
        """The numbers as the paper writes them: (5), or (7)–(9)."""
        return f"({self.first})" if self.first == self.last else f"({self.first})–({self.last})"


_RELATIVE: Final = ("theory.frame.relative",)
_AVERAGE: Final = ("theory.averaging.average",)
_PRINTED: Final = ("theory.printed.printed_conditions", "theory.printed.corrected_conditions")
_ORBIT: Final = ("theory.orbits.periodic_orbit", "papers.zhang2007.theorems.theorem")
_HERE: Final = "papers/test_equations.py::"
_THEOREMS: Final = "papers/test_theorems.py::"
_PROCEDURES: Final = "papers/test_procedures.py::"
_CONDITIONS: Final = "theory/test_printed.py::"

EQUATIONS: Final = (
    Equation(
        *(1, 1, "the vehicle ẋ = v_x, ẏ = v_y", "as printed", ("vehicles.PointMass",)),
        (f"{_HERE}test_the_vehicle_and_the_map",),
    ),
    Equation(
        *(2, 2, "the map J = f* − q_x (x − x*)² − q_y (y − y*)²", "as printed"),
        ("fields.Quadratic",),
        (f"{_HERE}test_the_vehicle_and_the_map",),
    ),
    Equation(
        *(3, 3, "the washout, ξ = J − f* − e", "as printed", ("controllers.GradientES",)),
        (f"{_HERE}test_fig_1_in_relative_coordinates",),
    ),
    Equation(
        *(4, 6, "x̃ = x − x* − α sin ωt, ỹ = y − y* + α cos ωt; Δ", "as printed", _RELATIVE),
        (f"{_HERE}test_fig_1_in_relative_coordinates",),
    ),
    Equation(
        *(7, 9, "Fig. 1 in these coordinates", "as printed", _RELATIVE),
        (f"{_HERE}test_fig_1_in_relative_coordinates",),
    ),
    Equation(
        *(10, 14, "Fig. 1's average, its equilibrium and its Jacobian", "as printed", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_1",),
    ),
    Equation(
        *(15, 15, "Theorem 1: the orbit is within O(1/ω)", "as printed", _ORBIT),
        (f"{_THEOREMS}test_every_orbit_is_within_one_over_omega",),
    ),
    Equation(
        *(16, 16, "lim sup |f − f*| = O(α² + 1/ω²)", "not as measured"),
        ("papers.zhang2007.theorems.theorem",),
        (f"{_THEOREMS}test_the_residual_error_of_theorem_1",),
    ),
    Equation(
        *(17, 18, "the source's figure eight", "as printed", ("paths.FigureEight",)),
        (f"{_HERE}test_the_figure_eight",),
    ),
    Equation(
        *(19, 23, "Fig. 2 in relative coordinates", "as printed", _RELATIVE),
        (f"{_HERE}test_fig_2_in_relative_coordinates",),
    ),
    Equation(
        *(24, 26, "Fig. 2's average: x̃, e and ṽ", "as printed", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_2",),
    ),
    Equation(
        *(27, 28, "Fig. 2's average: w, with z instead of z + h", "corrected", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_2", "papers/test_errata.py::test_the_four_designs"),
    ),
    Equation(
        *(29, 30, "its equilibrium", "as printed", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_2",),
    ),
    Equation(
        *(31, 31, "its Jacobian, with a₃ = −αckqz", "corrected", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_2",),
    ),
    Equation(
        *(32, 40, "Theorem 2's conditions, with z instead of z + h; a design", "corrected"),
        (*_PRINTED, "papers.zhang2007.procedures.for_double_integrators"),
        (
            f"{_CONDITIONS}test_the_conditions_of_theorem_2",
            f"{_PROCEDURES}test_every_root_decays_at_every_curvature",
        ),
    ),
    Equation(
        *(41, 41, "by its place Theorem 2's bound, O(1/ω)", "lost", _ORBIT),
        (f"{_THEOREMS}test_every_orbit_is_within_one_over_omega",),
    ),
    Equation(
        *(42, 42, "the vehicle ẋ = εx + v, whose number alone survives", "lost"),
        ("vehicles.PointMass",),
        (f"{_HERE}test_fig_3_in_relative_coordinates",),
    ),
    Equation(
        *(43, 43, "Theorem 3: the orbit is within O(1/ω); x̃ᵉ", "as printed"),
        (*_ORBIT, "theory.printed.recognise"),
        (
            f"{_THEOREMS}test_every_orbit_is_within_one_over_omega",
            f"{_CONDITIONS}test_the_offset_of_theorem_3",
        ),
    ),
    Equation(
        *(44, 48, "Fig. 3 in relative coordinates", "as printed", ("loop.Loop",)),
        (f"{_HERE}test_fig_3_in_relative_coordinates",),
    ),
    Equation(
        *(49, 51, "Fig. 3's average: x̃ and e", "as printed", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_3",),
    ),
    Equation(
        *(52, 53, "Fig. 3's average: w, with z − ε instead of z − 2ε + h", "corrected", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_3",),
    ),
    Equation(
        *(54, 58, "its equilibrium, x̃ᵉ = pεx*/(gz − pε)", "corrected"),
        (*_AVERAGE, "theory.printed.recognise"),
        (f"{_HERE}test_the_average_of_fig_3", "papers/test_errata.py::test_the_off_peak_orbit"),
    ),
    Equation(
        *(59, 59, "its Jacobian, with z − ε instead of z − 2ε + h", "corrected", _AVERAGE),
        (f"{_HERE}test_the_average_of_fig_3",),
    ),
    Equation(
        *(60, 64, "Theorem 4's conditions, with pε − gz > 0; a design", "corrected"),
        (*_PRINTED, "papers.zhang2007.procedures.for_unstable_poles"),
        (
            f"{_CONDITIONS}test_the_conditions_of_theorem_4",
            f"{_PROCEDURES}test_the_corrected_steps_are_safe_at_every_curvature_and_pole",
        ),
    ),
    Equation(
        *(65, 65, "Theorem 4: the orbit is within O(1/ω), w included", "not as measured"),
        _ORBIT,
        (f"{_THEOREMS}test_the_compensators_output_is_not_within_one_over_omega",),
    ),
)


def markdown() -> str:
    """Return the table for the documentation."""
    lines = ["| equations | what | status | computed by | tested by |", "|---|---|---|---|---|"]
    for e in EQUATIONS:
        functions = ", ".join(f"`{name}`" for name in e.functions)
        tests = ", ".join(f"`{name}`" for name in e.tests)
        lines.append(f"| {e.numbers} | {e.what} | {e.status} | {functions} | {tests} |")
    return "\n".join(lines)
