from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from loops import force_actuated, velocity_actuated

import extremum as es
from extremum import s
from extremum.engines.trajectory import broken_off

CHANNELS = ("controller.channels.0", "controller.channels.1")


def apart(a: xarray.Dataset, b: xarray.Dataset) -> float:
    return float(np.abs(a.position.values - b.position.values).max())


# --- invariances, with the conditions under which they hold ------------------------------------


def test_a_constant_added_to_the_signal_changes_nothing_if_the_washout_starts_at_it() -> None:
    plain, raised = velocity_actuated(), velocity_actuated(**{"field.peak": 1001.0})
    assert apart(es.simulate(plain, 4.0), es.simulate(raised, 4.0)) < 1e-8


def test_with_a_zero_start_a_constant_matters_and_can_make_the_loop_escape() -> None:
    """Fig. 4 with J − 5 and a washout that starts at zero escapes at 0.064 s."""
    loop = velocity_actuated(**{"field.peak": -4.0, "controller.washout_start": "zero"})
    run = es.simulate(loop, 4.0)
    assert run.attrs["outcome"] == "escaped"
    assert run.attrs["end_time"] == pytest.approx(0.064, abs=5e-4)


@pytest.mark.parametrize("start", ["signal", "zero", 0.5])
def test_scaling_the_signal_is_undone_by_scaling_the_gain(start: Any) -> None:
    factor = 7.0
    loop = velocity_actuated(**{"controller.washout_start": start})
    scaled = loop.replace(
        {
            "field.peak": factor * 1.0,
            "field.q": (factor * 1.0, factor * 0.5),
            **{f"{channel}.gain": 10.0 / factor for channel in CHANNELS},
            "controller.washout_start": start if isinstance(start, str) else factor * start,
        }
    )
    assert apart(es.simulate(loop, 4.0), es.simulate(scaled, 4.0)) < 1e-8


def test_moving_source_and_start_together_moves_the_path() -> None:
    shift = np.array([3.0, -2.0])
    moved = velocity_actuated(
        **{"field.source": (-1 + shift[0], -1 + shift[1]), "start": (1 + shift[0], 1 + shift[1])}
    )
    ours, theirs = es.simulate(velocity_actuated(), 4.0), es.simulate(moved, 4.0)
    assert np.abs(ours.position.values + shift - theirs.position.values).max() < 1e-8


@pytest.mark.parametrize("make", [velocity_actuated, force_actuated])
def test_rotation_turns_the_path_of_a_quadrature_pair_with_rotated_phases(make: Any) -> None:
    """Turning map and start by θ and advancing both phases by θ turns the path by θ."""
    theta = 0.7
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    q, source, begin = (
        np.array([[1.0, 0.3], [0.3, 0.5]]),
        np.array([-1.0, -1.0]),
        np.array([0.5, 1]),
    )
    start = es.OnDither if make is force_actuated else tuple
    phases = np.array([0.0, -np.pi / 2])
    loop = make(**{"field.q": q, "field.source": source, "start": start(tuple(begin))})
    turned_q = turn @ q @ turn.T
    turned = loop.replace(
        {
            "field.q": (turned_q + turned_q.T) / 2,
            "field.source": turn @ source,
            "start": start(tuple(turn @ begin)),
            **{f"{c}.dither.phase": phases[i] + theta for i, c in enumerate(CHANNELS)},
        }
    )
    # R(θ) (sin a, −cos a) = (sin(a + θ), −cos(a + θ))
    ours, theirs = es.simulate(loop, 4.0), es.simulate(turned, 4.0)
    assert np.abs(ours.position.values @ turn.T - theirs.position.values).max() < 1e-8


def test_time_scales_with_every_rate() -> None:
    factor = 3.0
    fast = velocity_actuated(
        **{
            "controller.frequency": 30 * factor,
            "controller.washout": factor,
            **{f"{channel}.gain": 10 * factor for channel in CHANNELS},
        }
    )
    ours = es.simulate(velocity_actuated(), 4.0, samples=2000)
    theirs = es.simulate(fast, 4.0 / factor, samples=2000)
    assert apart(ours, theirs) < 1e-8


def test_a_uniformly_moving_field_is_a_moving_frame() -> None:
    """Seen from a source moving at V, a 1/s vehicle feels the disturbance −V."""
    velocity = (0.2, -0.1)
    still = velocity_actuated()
    moving = still.replace({"field": es.Moving(still.field, es.Line(velocity))})
    pushed = still.replace({"vehicle.disturbance": (-velocity[0], -velocity[1])})
    ours, theirs = es.simulate(moving, 4.0), es.simulate(pushed, 4.0)
    relative = ours.position.values - np.outer(ours.time.values, velocity)
    assert np.abs(relative - theirs.position.values).max() < 1e-8


# --- the same loop said in other words ---------------------------------------------------------


def same_map() -> dict[str, es.Field]:
    def law(x: Any, y: Any, q: Any) -> Any:
        return 1 - (x + 1) ** 2 - q * (y + 1) ** 2

    x = np.linspace(-6, 4, 9)
    return {
        "expression": es.Expression("1 - (x + 1)**2 - q*(y + 1)**2", parameters={"q": 0.5}),
        "traced": es.field_from(law, parameters={"q": 0.5}),
        "matrix": es.Quadratic((-1, -1), ((1, 0), (0, 0.5)), 1),
        "opaque": es.Opaque(lambda p, t: 1 - (p[0] + 1) ** 2 - 0.5 * (p[1] + 1) ** 2),
        "gridded": es.Gridded(es.Grid((x, x), 1 - (x[:, None] + 1) ** 2 - 0.5 * (x + 1) ** 2)),
        "not moving": es.Moving(es.Quadratic((0, 0), (1, 0.5), 1), ("-1", "-1 + 0*t")),
    }


@pytest.mark.parametrize("name", list(same_map()))
def test_one_map_in_other_words_gives_one_path(name: str) -> None:
    """A cubic spline reproduces a quadratic map exactly, so that data and formula agree."""
    loop = velocity_actuated()
    ours = es.simulate(loop, 2.0)
    theirs = es.simulate(loop.replace({"field": same_map()[name]}), 2.0)
    assert apart(ours, theirs) < 1e-8
    values = same_map()[name].at([0.3, -2.0], [1.0, 0.5])
    assert values == pytest.approx(loop.field.at([0.3, -2.0], [1.0, 0.5]), abs=1e-12)


def random_loop(seed: int) -> es.Loop:
    random = np.random.default_rng(seed)
    axes = int(random.integers(1, 4))
    vehicles = (1 / s, 1 / s**2, 1 / (s - 0.3), 1 / (s * (s + 0.7)), (s + 2) / (s * (s + 0.7)))
    compensators = (1, (s + 0.3) / s, es.Lead(4, -0.6, -3.0))
    source = tuple(random.uniform(-0.3, 0.3, axes))
    fields = (
        es.Quadratic(source, tuple(random.uniform(0.4, 1.2, axes)), 1.0),
        es.Gaussian(source, width=float(random.uniform(0.8, 2)), peak=2.0),
        es.InverseSquare(source, width=1.5, peak=1.0),
        es.Moving(es.Gaussian(source), es.Line(tuple(random.uniform(-0.02, 0.02, axes)))),
    )
    return es.Loop(
        field=fields[random.integers(len(fields))],
        vehicle=es.PointMass(tuple(vehicles[random.integers(5)] for _ in range(axes))),
        controller=es.GradientES(
            frequency=float(random.uniform(15, 30)),
            washout=1.0,
            channels=tuple(
                es.Channel(
                    dither=es.Dither(0.1, phase=float(random.uniform(-1, 1))),
                    gain=float(random.uniform(2, 8)),
                    compensator=compensators[random.integers(3)],
                    ratio=(4, 5, 7)[i] if axes > 1 else 1,
                )
                for i in range(axes)
            ),
        ),
        start=es.OnDither((0.0,) * axes),
    )


@pytest.mark.parametrize("seed", range(12))
def test_both_engines_agree_on_random_loops(seed: int) -> None:
    loop = random_loop(seed)
    taylor = es.simulate(loop, 1.5)
    reference = es.simulate(loop, 1.5, engine="reference")
    assert taylor.attrs["engine"] == "taylor"
    size = 1 + np.abs(taylor.position.values).max()
    assert apart(taylor, reference) < 1e-8 * size


# --- what is returned --------------------------------------------------------------------------


def test_the_dataset_is_labelled_and_survives_netcdf(tmp_path: Path) -> None:
    run = es.simulate(force_actuated(), 1.0, title="a title")
    assert run.position.dims == run.input.dims == ("time", "axis")
    assert run.position.attrs["units"] == "m"
    assert run.input.attrs["units"] == "m/s^2"
    assert list(run.input.attrs["names"]) == ["u_x", "u_y"]
    assert {"x", "v_x", "y", "v_y", "eta", "zeta_x", "zeta_y"} <= set(run.data_vars)
    assert run.zeta_x.attrs["units"] == "m/s^2"
    assert len(run.time) == 2000
    run.to_netcdf(tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as read:
        xarray.testing.assert_identical(read.drop_attrs(), run.drop_attrs())
        for name, attribute in run.attrs.items():
            assert np.array_equal(read.attrs[name], attribute), name


def test_the_scenario_in_the_attrs_reproduces_the_run() -> None:
    run = es.simulate(velocity_actuated(), 2.0)
    scenario = es.parse_scenario(run.attrs["scenario"])
    again = es.simulate(scenario.loop, scenario.run.t_end)
    assert np.array_equal(again.position, run.position)
    few = es.simulate(velocity_actuated(), 2.0, samples=50)
    assert es.parse_scenario(few.attrs["scenario"]).run.samples == 50


@pytest.mark.parametrize("engine", ["taylor", "reference"])
def test_an_escape_ends_cleanly_and_nothing_in_the_dataset_is_nan(engine: str) -> None:
    loop = velocity_actuated(**{"field.peak": -4.0, "controller.washout_start": "zero"})
    run = es.simulate(loop, 4.0, engine=engine)
    assert run.attrs["outcome"] == "escaped"
    assert all(np.isfinite(v.values).all() for v in run.data_vars.values())
    assert np.isfinite(run.attrs["end_state"]).all()
    assert run.time.values[-1] <= run.attrs["end_time"] < 4.0
    assert len(run.attrs["end_state"]) == len(run.attrs["state_names"])


def test_an_opaque_field_that_returns_nan_at_its_edge_was_left_and_did_not_escape() -> None:
    def plane(p: np.ndarray, t: float) -> float:
        return float(p[0]) if p[0] < 1 else float("nan")

    loop = es.Loop(
        field=es.Opaque(plane),
        vehicle=es.PointMass((1 / s,)),
        controller=es.GradientES(20, 1, (es.Channel(es.Dither(0.1), 20.0),)),
        start=(0.0,),
    )
    run = es.simulate(loop, 20.0)
    assert run.attrs["outcome"] == "left the data"
    assert run.attrs["end_state"][0] == pytest.approx(1.0, abs=1e-6)
    values = loop.values.tolist()
    assert broken_off(loop.system, 0.0, [1.5, 0.0], values) == "left the data"


@pytest.mark.parametrize("engine", ["taylor", "reference"])
def test_a_run_up_to_the_largest_float_stays_finite(engine: str) -> None:
    """x = e^t: J = −x² overflows while x itself is still representable."""
    loop = es.Loop(
        field=es.Quadratic((0,), (1.0,)),
        vehicle=es.PointMass((1 / (s - 1),)),
        controller=es.GradientES(5, 1e-3, (es.Channel(es.Dither(0.1), gain=0.0),)),
        start=(1.0,),
    )
    run = es.simulate(loop, 400.0, samples=200_000, engine=engine)
    assert es.simulate(loop, 500.0, engine=engine).attrs["outcome"] == "escaped"
    assert run.attrs["outcome"] == "escaped"
    assert run.attrs["end_time"] == pytest.approx(np.log(np.sqrt(np.finfo(float).max)), abs=3.5)
    assert all(np.isfinite(v.values).all() for v in run.data_vars.values())
    assert np.isfinite([*run.J.attrs.values()][2:]).all()


@pytest.mark.parametrize("engine", ["taylor", "reference"])
@pytest.mark.parametrize("formula", ["sqrt(x)", "log(x)", "(x + 0.2)**1.5"])
def test_a_field_without_a_value_ends_the_run_and_is_not_called_an_escape(
    engine: str, formula: str
) -> None:
    """Minimising √x, log x, … drives x to the edge of where they are defined."""
    loop = es.Loop(
        field=es.Expression(formula),
        vehicle=es.PointMass((1 / s,)),
        controller=es.GradientES(20, 1.0, (es.Channel(es.Dither(0.05), gain=-40.0),)),
        start=(0.5,),
    )
    run = es.simulate(loop, 20.0, engine=engine)
    assert run.attrs["outcome"] == "left the data"
    assert all(np.isfinite(v.values).all() for v in run.data_vars.values())


def test_extremes_do_not_depend_on_where_the_samples_fell() -> None:
    coarse = es.simulate(velocity_actuated(), 4.0, samples=1000)
    fine = es.simulate(velocity_actuated(), 4.0, samples=400_000)
    for name in ("position", "J", "input"):
        for key, extreme in (("min", np.min), ("max", np.max)):
            dense = extreme(fine[name].values, axis=0)
            assert coarse[name].attrs[key] == pytest.approx(dense, rel=1e-7, abs=1e-7)
    assert abs(coarse.J.values.min() - fine.J.values.min()) > 1e-6  # the samples alone would not do


@pytest.mark.parametrize("samples", [11, 20, 50, 200, [0.0, 0.3, 4.0]])
def test_extremes_do_not_depend_on_how_few_samples_are_wanted(samples: Any) -> None:
    few = es.simulate(velocity_actuated(), 4.0, samples=samples)
    many = es.simulate(velocity_actuated(), 4.0)
    assert len(few.time) == (samples if isinstance(samples, int) else len(samples))
    for name in ("position", "J", "input"):
        for key in ("min", "max"):
            assert few[name].attrs[key] == pytest.approx(many[name].attrs[key], rel=1e-7, abs=1e-7)


def test_by_default_the_fastest_dither_has_twenty_samples_a_period() -> None:
    run = es.simulate(velocity_actuated(), 100.0)
    assert len(run.time) - 1 >= 20 * 100.0 * 30 / (2 * np.pi)


def test_times_can_be_given() -> None:
    times = [0.5, 1.0, 2.0]
    run = es.simulate(velocity_actuated(), 2.0, samples=times)
    assert run.time.values == pytest.approx([0.0, *times])
    dense = es.simulate(velocity_actuated(), 2.0, samples=2001)
    assert run.x.values[1:] == pytest.approx(dense.x.sel(time=times).values, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"t_end": 0}, "t_end = 0: must be a finite number greater than 0"),
        ({"t_end": -1.0}, "t_end"),
        ({"t_end": float("nan")}, "t_end"),
        ({"t_end": "four"}, "t_end"),
        ({"samples": 1}, "between 2 and"),
        ({"samples": [0, 2, 1]}, "increasing"),
        ({"samples": [0.0, 9.0]}, "0 … t_end"),
        ({"tol": 0.0}, "tol"),
        ({"engine": "euler"}, "taylor, reference"),
        ({"engine": ["taylor"]}, "taylor, reference"),
        ({"tol": "small"}, "tol"),
        ({"loop": "fig4"}, "must be a Loop"),
        ({"t_end": 1e12}, "samples"),
    ],
)
def test_arguments_that_cannot_be_right_are_refused(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(es.InvalidDescription, match=words):
        es.simulate(**{"loop": velocity_actuated(), "t_end": 4.0, **arguments})


def test_a_hole_that_only_a_sample_hits_is_marked() -> None:
    """NaN within 1e-9 s of t = 0.5: no stage of the integrator falls there, a sample does."""

    def holed(p: np.ndarray, t: float) -> float:
        return float("nan") if abs(t - 0.5) < 1e-9 else -float(p @ p)

    loop = velocity_actuated().replace({"field": es.Opaque(holed)})
    run = es.simulate(loop, 1.0, samples=11)
    assert run.attrs["outcome"] == "left the data"
    assert run.time.values[-1] == pytest.approx(0.4)
    assert 0.4 <= run.attrs["end_time"] < 0.5
    assert all(np.isfinite(v.values).all() for v in run.data_vars.values())


@pytest.mark.parametrize("formula", ["log(x)", "sqrt(x)", "x**1.5", "1/(x + 1)"])
@pytest.mark.parametrize("washout_start", ["signal", "zero"])
def test_a_start_where_the_field_has_no_value_is_refused(formula: str, washout_start: str) -> None:
    loop = velocity_actuated(
        **{
            "field": es.Expression(formula),
            "start": (-1.0, 0.0),
            "controller.washout_start": washout_start,
        }
    )
    with pytest.raises(es.InvalidDescription, match="start: the field has no finite value there"):
        es.simulate(loop, 1.0)


def test_opaque_fields_are_not_for_the_taylor_engine() -> None:
    loop = velocity_actuated().replace({"field": es.Opaque(lambda p, t: -float(p @ p))})
    with pytest.raises(es.InvalidDescription, match="known by its values only"):
        es.simulate(loop, 1.0, engine="taylor")
    assert es.simulate(loop, 0.2).attrs["scenario"] == ""


def test_an_error_inside_an_opaque_field_is_the_users_to_see() -> None:
    def broken(p: np.ndarray, t: float) -> float:
        raise ValueError("my own mistake")

    with pytest.raises(RuntimeError, match="my own mistake"):
        es.simulate(velocity_actuated().replace({"field": es.Opaque(broken)}), 1.0)


def test_importing_extremum_loads_nothing_heavy() -> None:
    heavy = [
        "heyoka",
        "xarray",
        "matplotlib",
        "scipy",
        "control",
        "rich",
        "numba",
        "pandas",
        "h5netcdf",
    ]
    code = f"import sys, extremum; print([m for m in {heavy!r} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
