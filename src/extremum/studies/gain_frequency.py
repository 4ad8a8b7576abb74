"""Convergence over gain and frequency for the paper's three schemes, and what theory says of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..engines.trajectory import Progress
from ..ensembles import ensemble
from ..fields import Quadratic
from ..loop import Loop
from ..papers import zhang2007
from ..plots.panels import STAR, VERMILION
from ..starts import OnDither
from ..theory import average, critical_frequency, periodic_orbit
from ..theory.demodulation import gradient
from .common import counted, empty_figure, packed, part, side

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = NDArray[np.float64]

TITLE: Final = "Convergence over gain and frequency"
LOOPS: Final = 100_000
LEAST: Final = 24
SCHEMES: Final = {"velocity": "fig4", "force": "fig6", "unstable": "fig7"}
"""Each scheme, and the scenario whose numbers it has."""
HEADINGS: Final = {
    "velocity": "(a) velocity, 1/s",
    "force": "(b) force, 1/s², lead",
    "unstable": "(c) unstable pole, 1/(s − 0.05)",
}
GAINS: Final = (0.5, 500.0)
FREQUENCIES: Final = (0.3, 100.0)
"""ω (rad/s)."""
T_END: Final = 400.0
OFFSETS: Final = (0.002, 0.5)
"""Starts: so far (m) from the orbit about the source along both axes."""
NODES: Final = 32
"""Gains at which theory is asked."""
SLOW: Final = 3.0
"""Fewer time constants than this are too few to tell growth from decay."""
Q: Final = (1.0, 0.5)
UNITS: Final = {"velocity": "m/s", "force": "m/s²", "unstable": "m/s"}
GAIN_UNITS: Final = "m/s; force: m/s^2"


def centred(name: str) -> Loop:
    """Return a scenario's loop with the source at rest at the origin, the start on the dither.

    The washout starts at the averaged equilibrium, η(0) = f* − Σ q_i α_i²/2.
    """
    loop = zhang2007.scenario(name).loop
    controller = gradient(loop)
    level = 1.0 - sum(q * a**2 / 2 for q, a in zip(Q, amplitudes(loop), strict=True))
    return replace(
        loop,
        field=Quadratic(source=(0.0, 0.0), q=Q, peak=1.0),
        controller=replace(controller, washout_start=level),
        start=OnDither((0.0, -amplitudes(loop)[1])),
    )


def amplitudes(loop: Loop) -> tuple[float, ...]:
    """Return the dithers' amplitudes α (m)."""
    return tuple(channel.dither.amplitude for channel in gradient(loop).channels)


def study(loops: int = LOOPS, *, progress: Progress | None = None) -> xarray.Dataset:
    """Run the paper's three schemes from near the source and from farther, and ask theory.

    Returns
    -------
    xarray.Dataset
        ``distance(scheme, offset, frequency, gain)`` of the mean position to the source over the
        last period (m), NaN where it escaped; ``converged``, whether it ended nearer than it began;
        ``exponent(scheme, frequency, gain)``, the largest real part of the Floquet exponents (1/s),
        between `NODES` gains interpolated, but where simulation from near the source disagrees its
        own orbit's; ``averaged(scheme, gain)``, that of the averaged loop;
        ``disagreement(reason, scheme)``, the share of the map where they still disagree, and why.
    """
    import xarray

    count = side(counted(loops, LEAST), maps=len(SCHEMES) * len(OFFSETS))
    gains, frequencies = np.geomspace(*GAINS, count), np.geomspace(*FREQUENCIES, count)
    maps: list[xarray.Dataset] = []
    for index, (scheme, name) in enumerate(SCHEMES.items()):
        loop = centred(name)
        simulated = _simulated(loop, gains, frequencies, part(progress, index, len(SCHEMES)))
        exponent, averaged = theory(loop, gains, frequencies)
        wrong = simulated.converged.values[0] != (exponent < 0)
        exponent[wrong] = [
            _exact(loop, float(gains[column]), float(frequencies[row]))
            for row, column in np.argwhere(wrong)
        ]
        simulated["exponent"] = (("frequency", "gain"), exponent)
        simulated["averaged"] = ("gain", averaged)
        maps.append(simulated.assign_coords(scheme=scheme))
    found = xarray.concat(maps, "scheme", combine_attrs="drop_conflicts")
    found["disagreement"] = disagreement(found)
    for name in ("exponent", "averaged"):
        found[name].attrs["units"] = "1/s"
    total = found.converged.size
    title = f"{TITLE}, the paper's three schemes: {total:,} loops"
    return packed(found, title=title, finding=_finding(found.disagreement), loops=total)


def disagreement(found: xarray.Dataset) -> xarray.DataArray:
    """Return the shares of the map where simulation and exponents disagree, (reason, scheme).

    Slow: |λ| t_end ≤ 3. Otherwise circling: λ > 0, but the loop ends on a cycle nearer than it
    began; or leaving: λ < 0, but even from near it is out of the basin.
    """
    import xarray

    near, exponent = found.converged.isel(offset=0), found.exponent
    slow = abs(exponent) * T_END <= SLOW
    kinds = {
        "slow": (near != (exponent < 0)) & slow,
        "circling": near & (exponent >= 0) & ~slow,
        "leaving": ~near & (exponent < 0) & ~slow,
    }
    return xarray.Dataset(kinds).mean(("frequency", "gain")).to_dataarray("reason")


def _finding(shares: xarray.DataArray) -> str:
    lines = []
    for scheme in SCHEMES:
        of = shares.sel(scheme=scheme)
        parts = [f"{reason} {float(of.sel(reason=reason)):.2%}" for reason in of.reason.values]
        lines.append(f"{scheme} {float(of.sum()):.2%} ({', '.join(parts)})")
    return f"simulation and Floquet multipliers disagree on: {'; '.join(lines)} of the map"


def _simulated(
    loop: Loop, gains: Vector, frequencies: Vector, progress: Progress | None
) -> xarray.Dataset:
    import xarray

    offset = xarray.DataArray(np.array(OFFSETS), dims="offset", attrs={"units": "m"})
    gain = xarray.DataArray(gains, dims="gain", attrs={"units": GAIN_UNITS})
    frequency = xarray.DataArray(frequencies, dims="frequency", attrs={"units": "rad/s"})
    found = ensemble(
        loop,
        T_END,
        over={
            "start.position.0": offset,
            "start.position.1": offset - amplitudes(loop)[1],
            "controller.frequency": frequency,
            "controller.channels.0.gain": gain,
            "controller.channels.1.gain": gain,
        },
        keep=("distance",),
        progress=progress,
    )
    kept = found[["distance"]].drop_vars([name for name in found.coords if "." in str(name)])
    kept = kept.assign_coords(offset=offset, frequency=frequency, gain=gain)
    kept["converged"] = kept.distance < kept.offset
    return kept


def theory(loop: Loop, gains: Vector, frequencies: Vector) -> tuple[Vector, Vector]:
    """Return the largest real parts (1/s): Floquet's (frequency, gain), the averaged (gain,).

    Floquet exponents are followed along ω at `NODES` gains, every crossing of 0 among the points,
    and interpolated linearly in ln ω and ln c. Where there is no orbit they are NaN.
    """
    nodes = np.geomspace(gains[0], gains[-1], min(NODES, len(gains)))
    exact, averaged = [], []
    for gain in nodes:
        changed = loop.replace(_both(gain))
        found = critical_frequency(changed, frequencies[0], frequencies[-1])
        at = np.append(found.frequencies, [c.frequency for c in found.crossings])
        values = np.append(found.leading, np.zeros(len(found.crossings)))
        if not len(at):
            at, values = frequencies[:1], np.full(1, np.nan)
        order = np.argsort(at)
        exact.append(np.interp(np.log(frequencies), np.log(at[order]), values[order], left=np.nan))
        averaged.append(float(average(changed).eigenvalues.real.max()))
    places = np.log(gains), np.log(nodes)
    rows = [np.interp(*places, row) for row in np.array(exact).T]
    return np.array(rows), np.interp(*places, averaged)


def _exact(loop: Loop, gain: float, frequency: float) -> float:
    """Return the largest real part of one orbit's exponents (1/s), NaN without an orbit."""
    orbit = periodic_orbit(loop.replace({"controller.frequency": frequency, **_both(gain)}))
    return float(orbit.exponents[0].real) if orbit.found else float("nan")


def _both(gain: float) -> dict[str, float]:
    return {f"controller.channels.{i}.gain": gain for i in (0, 1)}


# --- the figure -------------------------------------------------------------------------------

FATES: Final = (
    ("not even from {near:g} mm away", "#f6cdb8"),
    ("from {near:g} mm, not from {far:g} m away", "#a3c2e0"),
    ("from {far:g} m away too", "#0072B2"),
)


def figure(found: xarray.Dataset) -> Figure:
    """Draw for each scheme where it converges, over gain and frequency, and the boundaries."""
    from matplotlib.patches import Patch

    drawn = empty_figure(found, 11.0, 4.6)
    panels: Any = drawn.subplots(1, len(SCHEMES), sharey=True)
    for axes, scheme in zip(panels, SCHEMES, strict=True):
        _draw(axes, found.sel(scheme=scheme))
        axes.set_title(HEADINGS[scheme], loc="left", fontsize=10)
    panels[0].set_ylabel("$ω$ (rad/s)")
    near, far = (float(v) for v in found.offset)
    fates = [
        Patch(color=colour, label="converges " + text.format(near=1000 * near, far=far))
        for text, colour in FATES
    ]
    fates[0].set_label(f"does not converge, {FATES[0][0].format(near=1000 * near)}")
    lines = panels[-1].get_legend_handles_labels()[0]
    drawn.legend(
        handles=[*fates, *lines], loc="outside lower center", ncols=3, fontsize=9, frameon=False
    )
    return drawn


def _draw(axes: Axes, found: xarray.Dataset) -> None:
    from matplotlib.colors import ListedColormap

    gain, frequency = found.gain.values, found.frequency.values
    near, far = found.converged.values
    axes.pcolormesh(
        *(gain, frequency, near.astype(int) + (near & far)),
        cmap=ListedColormap([colour for _, colour in FATES]),
        vmin=0,
        vmax=len(FATES) - 1,
        rasterized=True,
    )
    exact = {"colors": "black", "linewidths": 1.8}
    axes.contour(gain, frequency, found.exponent.values, [0.0], **exact)
    axes.plot([], [], color="black", linewidth=1.8, label="exact boundary (Floquet multipliers)")
    averaged = found.averaged.values
    for index in np.flatnonzero(np.diff(averaged < 0)):
        low, high = averaged[index : index + 2]
        place = gain[index] * (gain[index + 1] / gain[index]) ** (low / (low - high))
        axes.axvline(place, color=VERMILION, linestyle="--", linewidth=1.8)
    axes.plot([], [], color=VERMILION, linestyle="--", label="averaged condition, ω → ∞")
    scheme = str(found.scheme.values)
    controller = gradient(zhang2007.scenario(SCHEMES[scheme]).loop)
    point = controller.channels[0].gain, controller.frequency
    axes.plot(*point, linestyle="", label="the scenario's values", **STAR)
    axes.set(xscale="log", yscale="log", xlabel=f"gain $c$ ({UNITS[scheme]})")
    if (averaged < 0).all():
        both = "exact and averaged" if (found.exponent < 0).all() else "averaged"
        text = f"{both}: stable for every $c$ > 0"
        axes.text(0.97, 0.03, text, transform=axes.transAxes, fontsize=9, ha="right")
