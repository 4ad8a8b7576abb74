"""The paper's errata as data: what is printed, what is right, and the evidence.

The first three are errors of its equations; the others are claims in words, or orders, that are
not exact. Each has a table that is computed when it is asked for, from exact periodic orbits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Final

from . import claims, evidence
from .tables import Table, escaped

if TYPE_CHECKING:
    from rich.console import Group


@dataclass(frozen=True)
class Erratum:
    """One thing that is wrong or imprecise in the paper.

    Attributes
    ----------
    number
        From 1; 1 to 3 are errors of equations.
    where
        The equations, or the section.
    printed, corrected
        What the paper says, and what is right.
    why
        How it comes about, and what follows.
    shows
        What the table shows: its heading.
    evidence
        Computes the table.
    """

    number: int
    where: str
    printed: str
    corrected: str
    why: str
    shows: str
    evidence: Callable[[], Table]

    def heading(self) -> str:
        """Return its heading in the documentation."""
        return f"## {self.number}. {escaped(self.where)}"

    def markdown(self) -> str:
        """Return it as a section of the documentation, its table computed now."""
        return "\n\n".join(
            [
                self.heading(),
                f"**Printed.** {escaped(self.printed)}",
                f"**Right.** {escaped(self.corrected)}",
                escaped(self.why),
                f"{escaped(self.shows)}:",
                self.evidence().markdown(),
            ]
        )


ERRATA: Final = (
    Erratum(
        1,
        "(27), (28), (31), (34), (35), (38), (39): the double integrator",
        "dw/dτ = (1/ω)[p w + g (z + h) x̃ − g ṽ], g = α c k q, so λ³ − pλ² + gλ − g(z + h) = 0 and "
        "the conditions −g(z + h) > 0, −gp + g(z + h) > 0.",
        "dw/dτ = (1/ω)[p w + g z x̃ − g ṽ], so λ³ − pλ² + gλ − gz = 0 and p < 0, g > 0, z < 0, "
        "p < z: a phase lead.",
        "Equation (22) differentiates ξ sin ωt and so holds a term ω cos ωt. First-order averaging "
        "needs a right-hand side of order 1/ω; here the ripple of e, of order 1/ω, times that term "
        "is of the same order as what is kept, and cancels h. A proper state for the compensator, "
        "fed by ξ sin ωt and not by its derivative, avoids it. The printed conditions are neither "
        "sufficient nor necessary.",
        "Largest real part over both axes, k = 5, c = 10, α = 0.1, q = (1, 0.5), source at the "
        "origin",
        evidence.four_designs,
    ),
    Erratum(
        2,
        "(52) to (59), (61), (63): unstable poles with a lead",
        "dw/dτ = (1/ω)[(p − g) w + g (z − 2ε + h) x̃ − g ε x*], "
        "x̃ᵉ = p ε x*/(g (z − ε + h) − p ε), condition (g + p) ε − g (z + h) > 0.",
        "z − ε in place of z − 2ε + h, x̃ᵉ = p ε x*/(g z − p ε), condition p ε − g z > 0.",
        "The same mistake: the terms of order ω in (47) and (48).",
        "The mean in x and the largest real part over both axes, ε = 0.5, h = 1: source (1, −1) "
        "with k = 4, c = 10, α = 0.05; source (0.05, 0.05) with k = 1, αcq = 1, α = 0.1",
        evidence.off_peak,
    ),
    Erratum(
        3,
        "Section 3: “to have positive roots”",
        "“… condition for a third order polynomial to have positive roots is a₁, a₂, a₃ > 0 and "
        "a₁a₂ − a₃ > 0”.",
        "Roots with negative real parts.",
        "A polynomial with positive coefficients has no positive root.",
        "The second design of erratum 1, in x",
        evidence.positive_roots,
    ),
    Erratum(
        4,
        "(65), Theorem 4: the compensators' outputs",
        "|w − wᵉ| is within O(1/ω), like x̃, ỹ and e.",
        "It is not: w holds k c ξ sin ωt, whose ripple does not shrink with ω. On the peak of "
        "Fig. 2 it is k c α² |q_x − q_y|/2, here 0.125. x̃, ỹ and e are within O(1/ω).",
        "Averaging bounds the state of the compensator's strictly proper part. (41), Theorem 2's "
        "bound, is lost; if it lists w, the same holds for it.",
        "Distances on the exact orbit; Fig. 2 with k = 5, z = −0.5, p = −3, Fig. 3 with k = 2, "
        "z = −3, p = −2, ε = 0.5, source (0.2, −0.2)",
        evidence.outputs,
    ),
    Erratum(
        5,
        "(15), (16), (43), (65): the orders",
        "lim sup |f − f*| = O(α² + 1/ω²), with ε² added for unstable poles.",
        "True as an upper bound for all small numbers together; it is not the order in which each "
        "enters. Above its α² the residual falls as 1/ω² only without bias, and for 1/s only in "
        "quadrature; otherwise as 1/ω. Above the bias it falls as α. In the pole it is of order ε, "
        "as the paper's own sentence says: “proportional to the value of the unstable poles”.",
        "|f − f*| holds the products 2qα x̃ and 2qα x̃ᵉ, which squares bound since 2ab ≤ a² + b². "
        "In the other direction, two integrators leave only 1/ω² of x̃. All fits with their "
        "points: `extremum.papers.zhang2007.theorems`.",
        "Every fitted order that is not the printed one, over a decade of the small number",
        claims.orders,
    ),
    Erratum(
        6,
        "Theorem 3: “for all ε in (0, ε̄)”",
        "lim sup |f − f*| = O(α² + 1/ω² + ε²), α to be chosen small.",
        "The constant behind ε² is q (x*/(αcq − ε))²: with c fixed a smaller α makes the residual "
        "larger, and αcq < ε makes the loop unstable. α may shrink only with αc held.",
        "ε̄ depends on α.",
        "c = 10, ε = 0.05, source (1, −1)",
        claims.small_amplitudes,
    ),
    Erratum(
        7,
        "The design after (64): p = −α c k q̲ and z < −h",
        "Every such design is stable.",
        "z < −ε q̲/q in each axis, for which z < −ε suffices. The washout does not enter.",
        "It repeats erratum 2. With h < ε the printed step (3) allows unstable designs, with h > ε "
        "it forbids stable ones. Step (2) is right. Both columns as functions, with proofs and "
        "runs: `extremum.papers.zhang2007.procedures`.",
        "h = 0.1, ε = 0.5, q̲ = 0.5, αck = 2, p = −1, q = (1, 0.5): −ε q̲/q = (−0.25, −0.5)",
        claims.design,
    ),
    Erratum(
        8,
        "Section 3: poles “of medium size”",
        "“the robustness of the extremum seeking loop itself cannot stabilize the system”.",
        "The averaged pole is ε − αcq: gain alone stabilises it. What remains is the bias "
        "ε x*/(αcq − ε), and what it does to the validity of averaging.",
        "The lead does not remove the bias either: with p = −αckq̲ and |z| < |p| it leaves a larger "
        "one than C = k. Integral action removes it.",
        "ε = 0.5, C = 1, α = 0.05, ω = 60, αcq = 2 in both axes",
        claims.medium_pole,
    ),
    Erratum(
        9,
        "Section 1: constant forces are “automatically accommodated”",
        "Extremum seeking auto-tunes the input to compensate for them.",
        "Up to the static error of the loop: a force d shifts the mean by d/(α c q C(0)). The "
        "plant's integrators do not help, because the force acts at their input; one in C does.",
        "For the lead C(0) = k z/p.",
        "A force of 0.3 along x, ω = 400",
        claims.constant_force,
    ),
    Erratum(
        10,
        "Section 1: drag lowers the relative degree",
        "“the input–output relationship drops in relative degree, making the problem easier”.",
        "1/(s(s + d)) still has relative degree 2. The problem is easier because of its damping: "
        "s² + ds + g is stable for every g > 0, so gain alone suffices.",
        "The relative degree of a force-actuated mass is 2 with any loss at all.",
        "C = 1, αcq = 1 in both axes, h = 1",
        claims.drag,
    ),
    Erratum(
        11,
        "Section 1: separate frequencies in space",
        "“one employs separate probing frequencies … for the individual axes of motion”.",
        "n axes need ⌈n/2⌉ frequencies, each for two axes in quadrature. And not all frequencies "
        "serve: the squares in J couple ωᵢ = 2ωⱼ and ωᵢ = ωⱼ ± ωₖ, already for a quadratic map.",
        "With ω₂ = 2ω₁ and phase π/2 the mean stays α/2 from the source however large ω is.",
        "Axes 1/s, c = 10",
        claims.frequencies,
    ),
    Erratum(
        12,
        "Section 2: maps that are not quadratic",
        "“General non-quadratic maps … are equally amenable to analysis”.",
        "They are, but Theorem 1's O(1/ω) for the orbit's centre is for quadratic maps. For others "
        "it is O(α² + 1/ω): in quadrature (f_xxx α_x² + f_xyy α_y²)/(16 q_x), whatever ω is.",
        "The cubic term rectifies the dither.",
        "J = 1 − x² − y²/2 + x³/2, α = 0.1, c = 10; the formula is the leading term in α",
        claims.cubic,
    ),
    Erratum(
        13,
        "Fig. 5: φ_m",
        "The scan reads φ_m = 3.",
        "3π/2. The caption starts the source at (0, 0), and the printed ranges come out.",
        "With φ_m = 3 the loop escapes at once.",
        "Fig. 5 with its other parameters",
        claims.phases,
    ),
    Erratum(
        14,
        "The results are local",
        "Local stability, which the paper says could be made semi-global.",
        "The loops can escape in finite time, and the washout's start may decide it. From zero, as "
        "in the paper's figures, ξ(0) = J(0): a constant added to J, which no average sees, ends "
        "the run. From J(0), the default here, it cannot.",
        "The scan gives no start; from zero the printed ranges of Figs. 4 and 5 come out.",
        "The same loop with either start, 4 s",
        claims.starts,
    ),
)


@dataclass(frozen=True, eq=False)
class Report:
    """All errata with their tables, for ``print`` and for ``rich.console.Console.print``."""

    tables: tuple[Table, ...]

    def __str__(self) -> str:
        """Return it as plain text of 100 columns."""
        from rich.console import Console

        console = Console(file=StringIO(), width=100, color_system=None)
        with console.capture() as captured:
            console.print(self)
        return captured.get().rstrip()

    def __rich__(self) -> Group:
        """Return it as rich prints it, as wide as the terminal."""
        from rich.console import Group
        from rich.table import Table as RichTable
        from rich.text import Text

        parts: list[Text | RichTable] = []
        for erratum, found in zip(ERRATA, self.tables, strict=True):
            parts.append(Text(f"{erratum.number}. {erratum.where}", style="bold"))
            parts.append(Text(f"printed: {erratum.printed}"))
            parts.append(Text(f"right:   {erratum.corrected}"))
            parts.append(Text(erratum.why))
            shown = RichTable(title=Text(erratum.shows), title_justify="left")
            for heading, form in found.columns:
                shown.add_column(Text(heading), justify="right" if form else "left")
            for row in found.cells():
                shown.add_row(*map(Text, row))
            parts += [shown, Text()]
        return Group(*parts)


def report() -> Report:
    """Return all errata with their evidence; every number is computed now, from exact orbits."""
    return Report(tuple(erratum.evidence() for erratum in ERRATA))


def markdown() -> str:
    """Return all errata as sections of the documentation."""
    return "\n\n".join(erratum.markdown() for erratum in ERRATA)
