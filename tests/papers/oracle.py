"""Plain hand-written extremum seeking loops: an oracle for tests, from the paper's equations.

Nothing is shared with ``extremum``. Each scenario is one function that states its numbers and its
ordinary differential equations in full. Common to all (the paper's eqs. (1)-(3)), with
``eta = h/(s + h) [J]``::

    xi = J - eta,   d eta/dt = h xi,   input_i = probe_i(t) + C_i(s)[c xi reference_i(t)]

so ``eta`` is the washout's state and ``eta = e + f*`` in the paper's letters. Every quadrature
pair has ``reference = (sin wt, -cos wt)``. A compensator is realised as direct term plus strictly
proper part, never by differentiating ``xi sin wt``. The last state is always ``eta``.
"""

# ruff: noqa: N806  (J is the paper's letter)
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import RectBivariateSpline

Vector = NDArray[np.float64]


class Signals(NamedTuple):
    """The signals of a loop at one time: position, map value, input, and the rest of the rhs."""

    position: tuple[float, ...]
    J: float
    input: tuple[float, ...]
    rates: tuple[float, ...]


class Problem(NamedTuple):
    """One scenario: ``rhs(t, state)``, ``state0``, ``outputs(t, state)``, end, fastest period."""

    rhs: Callable[[float, Vector], Vector]
    state0: Vector
    outputs: Callable[[float, Vector], dict[str, float | Vector]]
    t_end: float
    period: float


def _problem(
    signals: Callable[[float, Vector], Signals],
    state0: ArrayLike,
    t_end: float,
    fastest: float,
) -> Problem:
    """Make a problem of a function that returns every signal and the time derivative."""

    def rhs(t: float, state: Vector) -> Vector:
        return np.array(signals(t, state).rates)

    def outputs(t: float, state: Vector) -> dict[str, float | Vector]:
        now = signals(t, state)
        return {"position": np.array(now.position), "J": now.J, "input": np.array(now.input)}

    return Problem(rhs, np.array(state0, dtype=float), outputs, t_end, 2 * np.pi / fastest)


def fig4() -> Problem:
    """Velocity-actuated, stationary source, zero washout start. State: x, y, eta."""
    w, alpha, c, h = 30.0, 0.08, 10.0, 1.0

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        J = 1.0 - (x + 1.0) ** 2 - 0.5 * (y + 1.0) ** 2
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    return _problem(signals, (1.0, 1.0, 0.0), 4.0, w)


def fig5() -> Problem:
    """Velocity-actuated, source on a figure eight, zero washout start. State: x, y, eta."""
    w, alpha, c, h = 30.0, 0.05, 15.0, 1.0
    a_m, w_m, phi_m = 1.0, 0.1, 1.5 * np.pi

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        x_source = a_m * np.sin(w_m * t)
        y_source = a_m * np.cos(2.0 * w_m * t + phi_m)
        J = 1.0 - (x - x_source) ** 2 - 0.5 * (y - y_source) ** 2
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    return _problem(signals, (1.0, 1.0, 0.0), 30.0, w)


def fig6() -> Problem:
    """Force-actuated with lead, source on a figure eight, from rest, zero washout start.

    State: x, y, v_x, v_y, w_x, w_y, eta. Lead k (s - z)/(s - p) = k + k (p - z)/(s - p):
    dw/dt = p w + m, output k m + k (p - z) w.
    """
    w, alpha, c, h = 30.0, 0.05, 10.0, 1.0
    k, z, p = 4.0, -0.8, -2.0
    a_m, w_m, phi_m = 1.0, 0.1, 1.5 * np.pi

    def signals(t: float, state: Vector) -> Signals:
        x, y, vx, vy, wx, wy, eta = state
        x_source = a_m * np.sin(w_m * t)
        y_source = a_m * np.cos(2.0 * w_m * t + phi_m)
        J = 1.0 - (x - x_source) ** 2 - 0.5 * (y - y_source) ** 2
        xi = J - eta
        mx = c * xi * np.sin(w * t)
        my = -c * xi * np.cos(w * t)
        ux = -alpha * w**2 * np.sin(w * t) + k * mx + k * (p - z) * wx
        uy = alpha * w**2 * np.cos(w * t) + k * my + k * (p - z) * wy
        rates = (vx, vy, ux, uy, p * wx + mx, p * wy + my, h * xi)
        return Signals((x, y), J, (ux, uy), rates)

    return _problem(signals, (1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 35.0, w)


def fig7() -> Problem:
    """Unstable poles 0.05, no compensator, washout started at J(0). State: x, y, eta."""
    w, alpha, c, h, epsilon = 20.0, 0.05, 10.0, 1.0, 0.05

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        J = 1.0 - (x - 1.0) ** 2 - 0.5 * (y + 1.0) ** 2
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        rates = (epsilon * x + vx, epsilon * y + vy, h * xi)
        return Signals((x, y), J, (vx, vy), rates)

    return _problem(signals, (0.0, 0.0, -0.5), 5.0, w)


def unstable() -> Problem:
    """Unstable poles 0.5 with C = (s + 0.5)/s, washout started at J(0).

    State: x, y, w_x, w_y, eta. C = 1 + 0.5/s: dw/dt = m, output m + 0.5 w.
    """
    w, alpha, c, h, epsilon = 30.0, 0.2, 15.0, 1.0, 0.5

    def signals(t: float, state: Vector) -> Signals:
        x, y, wx, wy, eta = state
        J = 1.0 - (x - 1.0) ** 2 - 0.5 * (y + 1.0) ** 2
        xi = J - eta
        mx = c * xi * np.sin(w * t)
        my = -c * xi * np.cos(w * t)
        vx = alpha * w * np.cos(w * t) + mx + 0.5 * wx
        vy = alpha * w * np.sin(w * t) + my + 0.5 * wy
        rates = (epsilon * x + vx, epsilon * y + vy, mx, my, h * xi)
        return Signals((x, y), J, (vx, vy), rates)

    return _problem(signals, (0.0, 0.0, 0.0, 0.0, -0.5), 12.0, w)


def nondiagonal() -> Problem:
    """Coupled quadratic map, q = [[1, 0.4], [0.4, 0.5]]. State: x, y, eta."""
    w, alpha, c, h = 40.0, 0.1, 10.0, 1.0

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        dx, dy = x + 1.0, y + 1.0
        J = 1.0 - (dx * dx + 2.0 * 0.4 * dx * dy + 0.5 * dy * dy)
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    return _problem(signals, (0.0, 0.0, 1.0 - (1.0 + 0.8 + 0.5)), 12.0, w)


def nonquadratic() -> Problem:
    """Softened inverse square J = 1/(1 + r^2), seen from three widths away. State: x, y, eta."""
    w, alpha, c, h = 30.0, 0.1, 20.0, 1.0

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        J = 1.0 / (1.0 + (x + 1.0) ** 2 + (y + 1.0) ** 2)
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    return _problem(signals, (2.0, 1.0, 1.0 / 14.0), 40.0, w)


def three_d() -> Problem:
    """Three axes, one frequency each (4 : 5 : 7 times 10 rad/s). State: x, y, z, eta."""
    wx, wy, wz = 40.0, 50.0, 70.0
    alpha, c, h = 0.1, 10.0, 1.0

    def signals(t: float, state: Vector) -> Signals:
        x, y, z, eta = state
        J = 1.0 - (x + 1.0) ** 2 - 0.5 * (y + 1.0) ** 2 - 0.75 * (z - 0.5) ** 2
        xi = J - eta
        vx = alpha * wx * np.cos(wx * t) + c * xi * np.sin(wx * t)
        vy = alpha * wy * np.cos(wy * t) + c * xi * np.sin(wy * t)
        vz = alpha * wz * np.cos(wz * t) + c * xi * np.sin(wz * t)
        return Signals((x, y, z), J, (vx, vy, vz), (vx, vy, vz, h * xi))

    return _problem(signals, (0.0, 0.0, 0.0, 1.0 - 1.0 - 0.5 - 0.1875), 15.0, wz)


def drag() -> Problem:
    """Force-actuated with drag, G = 1/(s (s + 2)), gain only. State: x, y, v_x, v_y, eta.

    Probe alpha sin(wt) / G(jw) = alpha (-w^2 sin wt + d w cos wt), a quarter period later in y.
    """
    w, alpha, c, h, d = 20.0, 0.1, 20.0, 1.0, 2.0

    def signals(t: float, state: Vector) -> Signals:
        x, y, vx, vy, eta = state
        J = 1.0 - (x + 1.0) ** 2 - 0.5 * (y + 1.0) ** 2
        xi = J - eta
        sin, cos = np.sin(w * t), np.cos(w * t)
        ux = alpha * (-(w**2) * sin + d * w * cos) + c * xi * sin
        uy = alpha * (w**2 * cos + d * w * sin) - c * xi * cos
        return Signals((x, y), J, (ux, uy), (vx, vy, ux - d * vx, uy - d * vy, h * xi))

    return _problem(signals, (1.0, 1.0, 0.0, 0.0, -5.0), 20.0, w)


def constant_force() -> Problem:
    """Force-actuated with lead, constant force 0.3 in x, started on the dither.

    State: x, y, v_x, v_y, w_x, w_y, eta. Lead k (s - z)/(s - p) realised as in ``fig6``.
    """
    w, alpha, c, h = 30.0, 0.1, 10.0, 1.0
    k, z, p = 5.0, -0.5, -3.0

    def signals(t: float, state: Vector) -> Signals:
        x, y, vx, vy, wx, wy, eta = state
        J = 1.0 - (x + 1.0) ** 2 - 0.5 * (y + 1.0) ** 2
        xi = J - eta
        mx = c * xi * np.sin(w * t)
        my = -c * xi * np.cos(w * t)
        ux = -alpha * w**2 * np.sin(w * t) + k * mx + k * (p - z) * wx
        uy = alpha * w**2 * np.cos(w * t) + k * my + k * (p - z) * wy
        rates = (vx, vy, ux + 0.3, uy, p * wx + mx, p * wy + my, h * xi)
        return Signals((x, y), J, (ux, uy), rates)

    return _problem(signals, (1.0, 1.0, alpha * w, 0.0, 0.0, 0.0, -5.0), 30.0, w)


def commensurate() -> Problem:
    """Source on a circle, w/w_m = 120; washout started at J(0). State: x, y, eta."""
    w, alpha, c, h = 30.0, 0.1, 20.0, 1.0
    radius, w_m = 1.0, 0.25

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        x_source, y_source = radius * np.cos(w_m * t), radius * np.sin(w_m * t)
        J = 1.0 - (x - x_source) ** 2 - 0.5 * (y - y_source) ** 2
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    return _problem(signals, (0.0, 0.0, 0.0), 55.0, w)


def incommensurate() -> Problem:
    """Source on an eight of size 2, w_m = 0.1 sqrt 2; washout started at J(0). State: x, y, eta."""
    w, alpha, c, h = 40.0, 0.1, 30.0, 1.0
    a_m, w_m, phi_m = 2.0, 0.1 * np.sqrt(2.0), 1.5 * np.pi

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        x_source = a_m * np.sin(w_m * t)
        y_source = a_m * np.cos(2.0 * w_m * t + phi_m)
        J = 1.0 - (x - x_source) ** 2 - 0.5 * (y - y_source) ** 2
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    return _problem(signals, (-1.0, 1.0, -0.5), 60.0, w)


def elevation_model() -> RectBivariateSpline:
    """Altitude in metres over local metres (x east, y north, origin at the south-west node).

    matplotlib's sample of the Jacksboro fault: rows run north to south, steps are degrees on a
    sphere of 6371 km at the middle latitude. The spline is cubic and interpolates (C2).
    """
    import matplotlib as mpl

    path = Path(mpl.get_data_path(), "sample_data", "jacksboro_fault_dem.npz")
    with np.load(path) as dem:
        altitude = dem["elevation"][::-1].T.astype(float)
        latitude = np.radians((float(dem["ymin"]) + float(dem["ymax"])) / 2)
        dx = 6371000.0 * np.radians(float(dem["dx"])) * np.cos(latitude)
        dy = 6371000.0 * np.radians(float(dem["dy"]))
    x = dx * np.arange(altitude.shape[0])
    y = dy * np.arange(altitude.shape[1])
    return RectBivariateSpline(x, y, altitude, kx=3, ky=3, s=0)


def landscape() -> Problem:
    """Climb a real landscape by altitude alone, metres and seconds. State: x, y, eta."""
    w, alpha, c, h = 0.2, 150.0, 0.1, 0.05
    terrain = elevation_model()

    def signals(t: float, state: Vector) -> Signals:
        x, y, eta = state
        J = float(terrain.ev(x, y))
        xi = J - eta
        vx = alpha * w * np.cos(w * t) + c * xi * np.sin(w * t)
        vy = alpha * w * np.sin(w * t) - c * xi * np.cos(w * t)
        return Signals((x, y), J, (vx, vy), (vx, vy, h * xi))

    start = (18600.0, 3200.0)
    return _problem(signals, (*start, float(terrain.ev(*start))), 3600.0, w)


SCENARIOS: Final[dict[str, Callable[[], Problem]]] = {
    scenario.__name__: scenario
    for scenario in (
        fig4, fig5, fig6, fig7, unstable, nondiagonal, nonquadratic, three_d, drag,
        constant_force, commensurate, incommensurate, landscape,
    )
}  # fmt: skip


def solve(name: str, times: ArrayLike) -> dict[str, Vector]:
    """Integrate a scenario and return ``position`` (time, axis), ``J`` (time,), ``input``.

    DOP853 at tolerances 1e-12, its step capped at a twentieth of the fastest dither period.
    ``times`` increase and start at or after 0; ``state`` (time, state) is returned too.
    """
    problem = SCENARIOS[name]()
    times = np.asarray(times, dtype=float)
    solution = solve_ivp(
        problem.rhs, (0.0, times[-1]), problem.state0, "DOP853", times,
        rtol=1e-12, atol=1e-12, max_step=problem.period / 20,
    )  # fmt: skip
    if not solution.success:
        message = f"{name}: {solution.message}"
        raise RuntimeError(message)
    rows = [problem.outputs(t, state) for t, state in zip(times, solution.y.T, strict=True)]
    found = {key: np.array([row[key] for row in rows]) for key in ("position", "J", "input")}
    return {"state": solution.y.T, **found}
