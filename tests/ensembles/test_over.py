"""What may vary, how it broadcasts, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from loops import velocity_actuated

import extremum as es
from extremum.ensembles import ensembling, regions
from extremum.ensembles.lanes import lanes

GAIN = "controller.channels.0.gain"
PHASE = "controller.channels.1.dither.phase"


def whole(shape: Sequence[int]) -> regions.Region:
    return tuple(slice(0, size) for size in shape)


@pytest.mark.parametrize("shape", [(), (1,), (7,), (64,), (65,), (3, 50), (50, 3), (5, 1, 9, 4)])
@pytest.mark.parametrize("limit", [1, 8, 64])
def test_blocks_cover_every_loop_once_and_are_bounded(shape: tuple[int, ...], limit: int) -> None:
    seen = np.zeros(shape, int)
    for region in regions.regions(shape, regions.chunked(shape, limit)):
        seen[region] += 1
        assert 1 <= np.prod(regions.extent(region)) <= limit
    assert (seen == 1).all()


def test_arrays_broadcast_as_in_numpy() -> None:
    rng = np.random.default_rng(0)
    shapes = {"a": (4, 1, 3), "b": (5, 1), "c": (), "d": (1, 1, 1), "e": (3,)}
    over = {path: rng.normal(size=shape) for path, shape in shapes.items()}
    made = lanes(over, ())
    expected = np.broadcast_arrays(*over.values())
    assert made.dims == ("loop_0", "loop_1", "loop_2")
    assert made.shape == (4, 5, 3)
    table = made.columns(whole(made.shape)).reshape(5, 4, 5, 3)
    assert np.array_equal(table, expected)
    part = (slice(1, 3), slice(2, 5), slice(0, 2))
    assert np.array_equal(made.columns(part).reshape(5, 2, 3, 2), [e[part] for e in expected])
    some = np.array([0, 17, 59, 3])
    assert np.array_equal(made.at(some), [e.ravel()[some] for e in expected])
    assert made.swept["b"].dims == ("loop_1",)


def test_named_arrays_broadcast_by_name_and_keep_their_coordinates() -> None:
    first = xarray.DataArray(
        [[1.0, 2.0, 3.0]] * 2, dims=("batch", "gain"), coords={"gain": [10.0, 20.0, 30.0]}
    )
    labels = {"batch": ["a", "b"], "when": ("batch", [1.0, 2.0])}
    second = xarray.DataArray([5.0, 6.0], dims="batch", coords=labels)
    made = lanes({"p": second, "q": first, "r": 3, "s": first.T}, ())
    assert made.dims == ("batch", "gain")
    expected = xarray.broadcast(second, first)
    table = made.columns(whole(made.shape)).reshape(4, 2, 3)
    assert np.array_equal(table[0], expected[0].values)
    assert np.array_equal(table[1], expected[1].values)
    assert (table[2] == 3).all()
    assert np.array_equal(table[3], expected[1].values)
    assert set(made.coords) == {"batch", "gain", "when"}


def test_arrays_on_disk_are_read_block_by_block(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).uniform(-1, 1, (20, 30))
    xarray.Dataset({"gain": (("a", "b"), numbers)}).to_zarr(tmp_path / "n", consolidated=False)
    lazy = xarray.open_zarr(tmp_path / "n", chunks=None, consolidated=False).gain
    made = lanes({GAIN: lazy, "start.0": lazy[0]}, ())
    part = (slice(2, 5), slice(7, 9))
    assert np.array_equal(made.columns(part)[0], numbers[part].ravel())
    assert np.array_equal(
        made.at(np.array([31, 599])), [numbers[[1, 19], [1, 29]], numbers[0, [1, 29]]]
    )
    assert not lazy.variable._in_memory
    assert not any(variable._in_memory for variable in made.swept.values())


def test_numbers_may_be_written_in_any_way() -> None:
    over: dict[str, Any] = {
        "a": [0, es.pi / 2, Fraction(1, 2)],
        "b": "-pi/2",
        "c": np.float32(0.5),
        "d": range(3),
        "e": np.array([1, 2, 3], dtype=np.uint8),
    }
    table = lanes(over, ()).columns((slice(0, 3),))
    expected = [[0, np.pi / 2, 0.5], [-np.pi / 2] * 3, [0.5] * 3, [0, 1, 2], [1, 2, 3]]
    assert np.array_equal(table, expected)


def test_the_result_is_shaped_by_what_varies() -> None:
    loop = velocity_actuated()
    line = es.ensemble(loop, 0.1, over={"start.0": [0.0, 1.0, 2.0], GAIN: 5})
    assert line.x.dims == ("loop",)
    assert line[GAIN].dims == ()
    assert line["start.0"].values.tolist() == [0, 1, 2]
    plane = es.ensemble(loop, 0.1, over={"start.0": [[0.0], [1.0]], GAIN: [5, 6, 7]})
    assert plane.position.dims == ("loop_0", "loop_1", "axis")
    assert plane["start.0"].dims == ("loop_0",)
    single = es.ensemble(loop, 0.1, over={"start.0": 0.5})
    assert single.x.dims == ()
    named = xarray.DataArray([5.0, 6.0], dims=GAIN, coords={GAIN: [5.0, 6.0]})
    by_name = es.ensemble(
        loop, 0.1, over={GAIN: named, "start.0": xarray.DataArray([0.0], dims="p")}
    )
    assert by_name.x.dims == (GAIN, "p")
    assert float(by_name.sel({GAIN: 6.0}).x[0]) == float(by_name.x[1, 0])


def test_the_result_is_not_the_callers_arrays() -> None:
    gain, labels, mass = np.array([5.0, 6.0]), np.array([1.0, 2.0]), np.array([3.0, 4.0])
    named = xarray.DataArray(gain, dims="n", coords={"n": labels, "mass": ("n", mass)})
    by_name = es.ensemble(velocity_actuated(), 0.1, over={GAIN: named})
    by_place = es.ensemble(velocity_actuated(), 0.1, over={GAIN: gain})
    for array in (gain, labels, mass):
        array[:] = 99
    assert by_name[GAIN].values.tolist() == by_place[GAIN].values.tolist() == [5, 6]
    assert by_name.n.values.tolist() == [1, 2]
    assert by_name.mass.values.tolist() == [3, 4]
    by_place[GAIN][:] = 7
    assert (gain == 99).all()


def test_units_are_those_that_numbers_are_taken_in() -> None:
    start = xarray.DataArray([0.0, 1.0], dims="n", attrs={"units": "km", "long_name": "begin"})
    found = es.ensemble(velocity_actuated(), 0.1, over={"start.0": start})
    assert found["start.0"].attrs == {"units": "m", "long_name": "begin"}
    assert start.attrs["units"] == "km"


def test_numbers_that_are_structure_vary_like_others() -> None:
    """Each loop ends where its own replaced loop does."""
    over: dict[str, Any] = {
        "vehicle.axes.0.gain": [1.0, 1.2],
        "vehicle.axes.1.den.0": [0.0, 0.3],
        PHASE: [-np.pi / 2, -1.0],
        "controller.channels.0.ratio": [1.0, 1.5],
    }
    found = es.ensemble(velocity_actuated(), 1.0, over=over, tol=1e-9)
    for index in range(2):
        loop = velocity_actuated(**{path: numbers[index] for path, numbers in over.items()})
        run = es.simulate(loop, 1.0)
        assert np.abs(found.position[index] - run.position[-1]).max() < 1e-6


NAN, INF = float("nan"), float("inf")
A = xarray.DataArray([1.0, 2.0], dims="a")

BAD: list[tuple[dict[str, Any], str]] = [
    ({"over": {}}, "over = {}: must map dotted paths to arrays"),
    ({"over": [1, 2]}, "over = [1, 2]: must map dotted paths"),
    ({"over": {3: [1.0]}}, "a dotted path must be text, got 3"),
    ({"over": {"field.peek": [1.0]}}, "did you mean 'field.peak'?"),
    ({"over": {"field.q": [1.0]}}, "field.q: is not one number; inside it are field.q.0"),
    ({"over": {"vehicle.disturbance": [1.0]}}, "vehicle.disturbance = None: must be given first"),
    ({"over": {GAIN: []}}, f"{GAIN}: has no numbers: its shape is (0,)"),
    ({"over": {GAIN: np.empty((3, 0))}}, "has no numbers: its shape is (3, 0)"),
    ({"over": {GAIN: [1.0, NAN]}}, f"{GAIN} = nan at index [1]: must be a finite number"),
    ({"over": {GAIN: [[1.0, INF]]}}, f"{GAIN} = inf at index [0, 1]: must be a finite number"),
    ({"over": {"controller.frequency": [30.0, -1.0, 0.0]}}, "= -1.0 at index [1]: must be greater"),
    ({"over": {"controller.channels.0.ratio": [0.0]}}, "= 0.0 at index [0]: must be greater than"),
    ({"over": {GAIN: [1j]}}, "must be an array of real numbers, not of complex128"),
    ({"over": {GAIN: ["a", "b"]}}, "must be an array of real numbers, not of <U1"),
    ({"over": {GAIN: [True, False]}}, "must be an array of real numbers, not of bool"),
    ({"over": {GAIN: np.array(["2020-01-01"], "M8[D]")}}, "not of datetime64[D]"),
    ({"over": {GAIN: [[1.0], [1.0, 2.0]]}}, "must be an array of numbers: its rows differ"),
    ({"over": {GAIN: [1.0, None]}}, f"{GAIN} = None: must be a number"),
    ({"over": {GAIN: None}}, f"{GAIN} = None: must be a number"),
    ({"over": {GAIN: "ten"}}, "unknown name 'ten'"),
    ({"over": {GAIN: np.ma.masked_equal([1.0, 2.0], 2.0)}}, "has masked entries"),
    ({"over": {GAIN: [1.0, 2.0], "start.0": [1.0, 2.0, 3.0]}}, "the shapes do not broadcast: "),
    ({"over": {GAIN: A, "start.0": [1.0, 2.0]}}, "start.0: has dimensions without names beside"),
    ({"over": {GAIN: A, "start.0": A.isel(a=[0, 1, 1])}}, "over: the arrays do not fit each other"),
    (
        {"over": {GAIN: A.assign_coords(a=[0, 1]), "start.0": A.assign_coords(a=[1, 2])}},
        "over: the arrays do not fit each other",
    ),
    (
        {"over": {GAIN: A.rename(a="x")}},
        "'x' of its dimension or coordinate is one of the result's",
    ),
    ({"over": {GAIN: A.rename(a="time")}}, "rename it, for instance to 'time_0'"),
    ({"over": {GAIN: A.assign_coords(J=3.0)}}, "'J' of its dimension or coordinate"),
    ({"over": {GAIN: A.astype(complex)}}, "must be an array of real numbers, not of complex128"),
    ({"over": {GAIN: A.rename(a=3)}}, "dimensions' names must be text"),
    ({"over": {GAIN: np.array([1.0], dtype="g")}}, "of which a loop takes float64 only"),
    ({"over": {GAIN: A.astype("g")}}, "of which a loop takes float64 only; use astype(float)"),
    ({"over": {GAIN: A.to_dataset(name="a")}}, f"{GAIN} = Dataset: must be an array of numbers:"),
    ({"progress": 3}, "progress = 3: must be a function that takes the fraction of loops done"),
    ({"t_end": 0}, "t_end = 0: must be a finite number greater than 0"),
    ({"t_end": NAN}, "t_end"),
    ({"tol": 1e-15}, "tol = 1e-15: must lie between 1e-13, what float64 can hold, and 0.1"),
    ({"tol": 1}, "tol = 1: must lie between"),
    (
        {"dtype": "float32", "tol": 1e-6},
        "tol = 1e-06: must lie between 1e-05, what float32 can hold",
    ),
    ({"dtype": "float16"}, "dtype = 'float16': must be"),
    ({"dtype": np.float32, "tol": 1e-4}, "dtype"),
    ({"device": "gpu"}, "device = 'gpu': must be"),
    ({"threads": 0}, "threads = 0: must be a whole number, at least 1"),
    ({"samples": 1}, "samples = 1: must be a whole number between 2"),
    ({"samples": True}, "samples = True"),
    ({"keep": "mean_J"}, "keep = 'mean_J': must be names, such as"),
    ({"keep": ("mean",)}, "keep = 'mean': cannot be kept; did you mean 'mean_J'?"),
    ({"keep": ("settling_time",)}, "radius = None: goes with"),
    ({"radius": 1.0}, "radius = 1.0: goes with"),
    ({"keep": ("settling_time",), "radius": -1}, "radius = -1: must be a finite number greater"),
    ({"into": 3}, "into = 3: must be the path of a new Zarr store"),
    ({"into": "nowhere/here.zarr"}, "into = nowhere/here.zarr: there is no folder nowhere"),
    ({"loop": 3}, "loop = 3: must be a Loop"),
]


@pytest.mark.parametrize(("changes", "message"), BAD, ids=lambda v: str(v)[:60])
def test_what_cannot_be_is_refused_before_anything_runs(
    changes: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def engine(*_: Any, **__: Any) -> Any:
        raise AssertionError("nothing may run")

    if "device" not in changes:
        monkeypatch.setattr(ensembling, "integrator", lambda device: engine)
    arguments = {"loop": velocity_actuated(), "t_end": 1.0, "over": {GAIN: [1.0, 2.0]}, **changes}
    with pytest.raises(es.InvalidDescription) as refused:
        es.ensemble(**arguments)
    assert message in str(refused.value)


def test_numbers_that_do_not_fit_each_other_are_refused_with_the_loop() -> None:
    """A zero of the vehicle at jω makes the wanted dither impossible in the last loop only."""
    axis = es.TransferFunction(num=(0.0, 400.0), den=(1.0, 1.0, 1.0))
    loop = velocity_actuated(**{"vehicle.axes.0": axis, "start": (1, 1)})
    frequency = {"controller.frequency": [30.0, 25.0, 20.0]}
    with pytest.raises(es.InvalidDescription, match=r"cannot be made.*in the loop at index \[2\]"):
        es.ensemble(loop, 1.0, over=frequency)
    sensed = velocity_actuated(sensor="1/(s + 1)")
    with pytest.raises(es.InvalidDescription, match=r"sensor.*not stable.*index \[1, 0\]"):
        es.ensemble(sensed, 1.0, over={"sensor.den.0": [[1.0], [-1.0]], GAIN: [1.0, 2.0]})


def test_opaque_fields_and_unknown_sources_are_refused(tmp_path: Path) -> None:
    opaque = velocity_actuated(field=es.Opaque(lambda p, t: -p @ p))
    with pytest.raises(es.InvalidDescription, match="field: is known by its values only"):
        es.ensemble(opaque, 1.0, over={GAIN: [1.0]})
    nowhere = velocity_actuated(field=es.Expression("-x**2 - y**2"))
    for keep, radius in ((("distance",), None), (("settling_time",), 1.0)):
        with pytest.raises(es.InvalidDescription, match="states where its source is"):
            es.ensemble(nowhere, 1.0, over={GAIN: [1.0]}, keep=keep, radius=radius)
    with pytest.raises(es.InvalidDescription, match="exists already"):
        es.ensemble(velocity_actuated(), 1.0, over={GAIN: [1.0]}, into=tmp_path)
