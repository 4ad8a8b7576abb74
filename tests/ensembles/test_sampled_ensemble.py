"""`ensemble` of loops that are difference equations, against the same equations in NumPy.

`Stepped` is a loop in small whose equations are written by hand: Euler's rule for everything, a
noisy sample, and a number that is a function of others but no formula.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
import sympy
import xarray
from loops import velocity_actuated
from numpy.typing import NDArray
from scipy.linalg import expm
from sympy import Integer, Symbol

import extremum as es
from extremum.description import Description, part, value
from extremum.engines import simd
from extremum.engines.lanes import random
from extremum.engines.simd import running
from extremum.ensembles import ensembling, regions
from extremum.ensembles.keeping import STATISTICS
from extremum.logic import normal
from extremum.loop import Loop
from extremum.parameters import Parameter
from extremum.system import Derived, System

SEED = "sampling.seed"
STEP = 0.004
RADIUS = 1.3


class Clock(Description):
    """When samples are taken, and what is wrong with them."""

    dt: float = value("T", "s", "sampling time", positive=True)
    noise: float = value("sigma", "1", "noise of a sample", default=0.0)
    decay: float = value("lambda", "1/s", "of what is derived", default=1.0)
    seed: float = value("seed", "", "of the noise", default=0.0)


class Stepped(Loop):
    """Fig. 1 by Euler's rule, its gain multiplied by g = e^(−λT)."""

    sampling: Any = part(Clock, "when it is run", default=Clock(dt=STEP))

    def drawn(self, reserved: frozenset[str], varied: Container[str]) -> tuple[System, Loop]:
        """Return the equations."""
        twin: Any
        twin, parameters = self.lettered(reserved, varied)
        clock, controller = twin.sampling, twin.controller
        x, y, z, v_x, v_y = names = sympy.symbols("x y z v_x v_y", real=True)
        level, sensed, xi = sympy.symbols("J J_s xi", real=True)
        inputs = sympy.symbols("u_x u_y", real=True)
        g = Parameter(Symbol("g", real=True), "", "1")
        signals = [
            (level, twin.field.law((x, y))),
            (sensed, level + clock.noise * normal(clock.seed, Integer(0))),
            (xi, sensed - z),
        ]
        w = controller.frequency
        for u, channel in zip(inputs, controller.channels, strict=True):
            phase = channel.dither.phase
            wave = sympy.sin(w * es.t + phase)
            probe = channel.dither.amplitude * w * sympy.cos(w * es.t + phase)
            signals.append((u, probe + g.symbol * channel.gain * xi * wave))
        held = zip((x, y), (v_x, v_y), strict=True)
        system = System(
            states=names,
            rhs=(
                *(p + clock.dt * v for p, v in held),
                z + clock.dt * controller.washout * xi,
                *inputs,
            ),
            initial=(*twin.start, sensed, Integer(0), Integer(0)),
            inputs=inputs,
            outputs=MappingProxyType(
                {
                    "position": (x, y),
                    "sensor": (x, y),
                    "J": (level,),
                    "input": (v_x, v_y),
                    "source": twin.field.maximum(),
                }
            ),
            signals=tuple(signals),
            parameters=(*parameters, g),
            units=dict.fromkeys((*names, *inputs), "1"),
            carriers=(w,),
            dt=clock.dt,
            derived=Derived(1, frozenset(["sampling"]), _decayed(parameters)),
        )
        return system, twin


def _decayed(parameters: tuple[Parameter, ...]) -> Any:
    order = [parameter.path for parameter in parameters]

    def decayed(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        dt, decay = (numbers[order.index(f"sampling.{name}")] for name in ("dt", "decay"))
        powers: Any = expm(-(dt * decay)[:, None, None])
        return powers[:, 0].T

    return decayed


def loop(**changes: Any) -> Stepped:
    paper = velocity_actuated()
    made = Stepped(paper.field, paper.vehicle, paper.controller, paper.start, paper.sensor)
    return made.replace({"sampling.noise": 0.6, "controller.channels.0.gain": 5.0} | changes)


def iterated(steps: int, dt: float = STEP, seed: float = 0.0, **own: float) -> dict[str, Any]:
    """The same equations: position and J at 0 … steps, and the inputs."""
    own = {"noise": 0.6, "decay": 1.0, "source": -1.0, "gain": 5.0, **own}
    p, v, path, levels, inputs = np.array([1.0, 1.0]), np.zeros(2), [], [], []
    z = None
    for k in range(steps + 1):
        level = 1 - (p[0] - own["source"]) ** 2 - 0.5 * (p[1] + 1) ** 2
        sensed = level + own["noise"] * float(random.normal(seed, k, 0))
        z = sensed if z is None else z
        wave = 30 * k * dt + np.array([0, -np.pi / 2])
        gains = np.exp(-own["decay"] * dt) * np.array([own["gain"], 10])
        command = 0.08 * 30 * np.cos(wave) + gains * (sensed - z) * np.sin(wave)
        path.append(p)
        levels.append(level)
        inputs.append(command)
        p, z, v = p + dt * v, z + dt * (sensed - z), command
    return {"position": np.array(path), "J": np.array(levels), "input": np.array(inputs)}


# --- numbers ----------------------------------------------------------------------------------


def test_everything_that_an_ensemble_returns() -> None:
    steps, seeds = 1000, np.arange(4)
    calm = loop(**{"sampling.noise": 0.2, "controller.channels.0.gain": 10.0})
    keep, t_end = tuple(STATISTICS), steps * STEP
    found = es.ensemble(calm, t_end, over={SEED: seeds}, keep=keep, radius=RADIUS, samples=21)
    assert found.attrs["scheme"] == "difference equations"
    assert found.attrs["steps"] == 4 * steps
    assert [found.attrs[name] for name in ("error", "typical_error", "doubtful")] == [0, 0, 0]
    window = 2 * np.pi / 30 / STEP  # samples, of which the first counts by its part
    weight = np.clip(np.arange(1, steps + 1) - (steps - window), 0, 1) / window
    for i in range(4):
        run, one = iterated(steps, seed=i, noise=0.2, gain=10.0), found.isel(loop=i)
        path, level = run["position"], run["J"]
        assert one.position.values == pytest.approx(path[-1], abs=1e-11)
        assert one.sampled_position.values == pytest.approx(path[::50], abs=1e-11)
        assert one.sampled_J.values == pytest.approx(level[::50], abs=1e-11)
        assert float(one.mean_J) == pytest.approx(level[:-1].mean(), abs=1e-11)
        assert float(one.max_J) == pytest.approx(level.max(), abs=1e-11)
        centre = weight @ path[:-1]
        assert one.mean_position.values == pytest.approx(centre, abs=1e-11)
        assert float(one.distance) == pytest.approx(np.hypot(*(centre + 1)), abs=1e-11)
        away = np.flatnonzero(np.hypot(*(path + 1).T) > RADIUS)[-1]
        assert away < steps
        assert float(one.settling_time) == pytest.approx(away * STEP)
        peak = np.abs(run["input"]).max(axis=0)
        assert one.peak_input.values == pytest.approx(peak, abs=1e-10)
    assert len(np.unique(found.J)) == 4


def test_numbers_that_follow_from_others_vary_with_them() -> None:
    """Every loop's own e^(−λT), whether dt or λ or both vary; fixed where neither does."""
    over: Any = {"sampling.decay": [1.0, 40.0, 80.0], "sampling.dt": [0.004, 0.002, 0.001]}
    found = es.ensemble(loop(), 0.4, over=over)
    for i in range(3):
        decay, dt = (over[f"sampling.{name}"][i] for name in ("decay", "dt"))
        run = iterated(round(0.4 / dt), dt, decay=decay)
        assert found.position[i].values == pytest.approx(run["position"][-1], abs=1e-11)
    assert found.attrs["steps"] == 100 + 200 + 400
    assert set(found.coords) == {"sampling.decay", "sampling.dt", "axis"}
    for over in ({"sampling.decay": [40.0, 1.0]}, {"field.source.0": [-1.0, -0.5]}):
        found = es.ensemble(loop(), 0.4, over=over, keep=("mean_position",))
        for i in range(2):
            own = {path.split(".")[1]: float(n[i]) for path, n in over.items()}
            run = iterated(100, **own)
            assert found.position[i].values == pytest.approx(run["position"][-1], abs=1e-11)


def test_a_loops_numbers_hold_what_follows_from_them() -> None:
    made = loop(**{"sampling.decay": 20.0})
    assert made.values[-1] == pytest.approx(np.exp(-0.08))
    assert made.system.derived is not None
    depends = made.system.derived.depends
    assert [depends(p) for p in ("sampling.dt", "sampling", "samplings.dt", "field.q.0")] == [
        *(True, True),
        *(False, False),
    ]


def test_a_seeds_loop_is_its_own_wherever_it_runs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Blocks, pieces, threads, order, a store, and alone."""
    seeds = np.random.default_rng(3).integers(0, 2**53, (3, 70))
    keep = ("mean_J", "max_J", "mean_position", "peak_input")
    whole = es.ensemble(loop(), 0.4, over={SEED: seeds}, keep=keep, threads=1)
    flat = xarray.DataArray(seeds[::-1].ravel(), dims="run")
    monkeypatch.setattr(running, "PIECE", 32)
    monkeypatch.setattr(regions, "LIMIT", 40)
    store = tmp_path / "a.zarr"
    again = es.ensemble(loop(), 0.4, over={SEED: flat}, keep=keep, threads=3, into=store)
    alone = es.ensemble(loop(), 0.4, over={SEED: seeds[1, 5]}, keep=keep)
    fixed = es.ensemble(loop(**{SEED: float(seeds[1, 5])}), 0.4, over={"start.0": 1.0}, keep=keep)
    for name in ("position", "J", "z", *keep):
        wanted = whole[name].values
        found = again[name].values.reshape(wanted.shape)[::-1]
        assert np.array_equal(found, wanted), name
        assert np.array_equal(alone[name].values, wanted[1, 5]), name
        assert fixed[name].values == pytest.approx(wanted[1, 5], abs=1e-12)


def test_what_is_exact_is_run_once(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []

    def counted(asked: Any, **options: Any) -> Any:
        counts.append(asked.count)
        return simd.integrate(asked, **options)

    monkeypatch.setattr(ensembling, "integrator", lambda device: counted)
    found = es.ensemble(loop(), 0.4, over={SEED: np.arange(1000)}, samples=3)
    es.ensemble(loop(), 0.4, over={SEED: np.arange(10)})
    assert counts == [1000, 10]
    assert found.attrs["error"] == found.attrs["doubtful"] == 0


def test_an_escape_of_a_sampled_loop() -> None:
    gains = [10.0, -1000.0]
    path = "controller.channels.0.gain"
    found = es.ensemble(loop(), 8.0, over={path: gains}, keep=("mean_J", "distance"), samples=5)
    assert found.outcome.values.tolist() == [0, 1]
    with np.errstate(all="ignore"):
        run = iterated(2000, gain=-1000.0)
    alive = np.abs(run["position"]).max(axis=1) < 1e90
    assert STEP * (alive.sum() - 10) < found.end_time[1] < STEP * (alive.sum() + 10)
    assert np.isfinite(found.position).all()
    assert np.isnan(found.distance[1])
    assert found.attrs["doubtful"] == 0


# --- bad input --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seeds", "place"),
    [([0, -1], "at index"), ([0, 0.5], "0.5 at index"), ([2.0**54], "index"), ([np.nan], "nan")],
)
def test_what_is_no_seed_is_refused(seeds: list[float], place: str) -> None:
    with pytest.raises(es.InvalidDescription, match="must be a whole number between 0 and") as e:
        es.ensemble(loop(), 0.4, over={SEED: seeds})
    assert SEED in str(e.value)
    assert place in str(e.value)


@pytest.mark.parametrize(
    ("t_end", "options", "text"),
    [
        (0.401, {}, "100.25 sampling times of 0.004 s; it must be a whole number of them, such as"),
        (0.001, {}, "such as 0.004 s"),
        (0.4, {"samples": 8}, "divides 100 sampling times of 0.004 s into 7 parts"),
        (0.4, {"dtype": "float32"}, "must be 'float64' for a sampled loop"),
        (0.4, {"device": "cuda"}, "a sampled loop does not run on a GPU yet; use device='cpu'"),
    ],
)
def test_what_cannot_be_asked_of_a_sampled_loop(
    t_end: float, options: dict[str, Any], text: str, tmp_path: Path
) -> None:
    with pytest.raises(es.InvalidDescription) as e:
        es.ensemble(loop(), t_end, over={SEED: [1, 2]}, into=tmp_path / "b.zarr", **options)
    assert text in str(e.value)
    assert not list(tmp_path.iterdir())


def test_every_loops_sampling_time_must_fit(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Before anything is run or written."""
    monkeypatch.setattr(regions, "LIMIT", 10)
    lengths = np.full(100, 0.01)
    lengths[77] = 0.03
    with pytest.raises(es.InvalidDescription, match=r"13\.3333333 sampling times of 0\.03 s"):
        es.ensemble(loop(), 0.4, over={"sampling.dt": lengths}, into=tmp_path / "c.zarr")
    assert not list(tmp_path.iterdir())


def test_a_differential_loop_is_as_it_was() -> None:
    system = velocity_actuated().system
    assert system.dt is system.derived is None
    assert system.completed(np.ones(3)).tolist() == [1, 1, 1]
    assert replace(system).seeds == frozenset()
