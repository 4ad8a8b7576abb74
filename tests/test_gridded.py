"""Gridded fields: what is read, how it is interpolated, and where it ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st

import extremum as es
from extremum import pi, s

X = np.array([-1.0, 0.0, 0.5, 2.0, 3.0])
Y = np.array([0.0, 1.0, 1.5, 4.0])
J = np.add.outer(np.sin(X), Y**2) + np.multiply.outer(X, Y)
GRID = es.Grid([X, Y], J)


def csv(columns: str = "x,y,J", order: Any = None) -> str:
    rows = [f"{x},{y},{J[i, j]}" for i, x in enumerate(X) for j, y in enumerate(Y)]
    return "\n".join([columns, *np.array(rows)[order if order is not None else slice(None)]])


# --- reading ----------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def array(*dims: str) -> xarray.DataArray:
    return xarray.DataArray(J, {"x": X, "y": Y}, ("x", "y"), name="J").transpose(*dims)


def test_the_same_data_from_every_kind_of_file_are_equal(folder):
    array("y", "x").to_netcdf("a.nc")
    np.savez("a.npz", x=X, y=Y, J=J)
    np.savez("t.npz", lon=X, lat=Y, J=J.T, K=J)
    (folder / "a.csv").write_text(csv(order=np.random.default_rng(1).permutation(J.size)))
    tables: list[Any] = [
        GRID,
        "a.nc",
        "a.npz",
        "a.csv",
        array("x", "y"),
        array("y", "x"),
        {"file": "a.nc", "variable": "J"},
        {"file": "t.npz", "variable": "J", "dims": ["y", "x"], "coordinates": ["lon", "lat"]},
        {"x": X.tolist(), "y": Y.tolist(), "values": J.tolist()},
    ]
    fields = [es.Gridded(table) for table in tables]
    assert all(field == fields[0] for field in fields)
    assert len({field.grid.digest for field in fields}) == 1


@pytest.mark.parametrize(("i", "j"), [(-1, 1), (1, -1), (-1, -1)])
def test_decreasing_axes_are_turned(i, j):
    turned = es.Grid([X[::i], Y[::j]], J[::i, ::j])
    assert turned == GRID
    assert turned.values.tolist() == J.tolist()


def test_spacing_places_the_first_corner_at_zero(folder):
    np.savez("dem.npz", z=J.T[::-1])
    grid = es.Gridded({"file": "dem.npz", "dims": ["y", "x"], "spacing": [2, -0.5]}).grid  # pyright: ignore
    assert grid.axes[0].tolist() == [0, 2, 4, 6, 8]
    assert grid.axes[1].tolist() == [0, 0.5, 1, 1.5]
    assert grid.values.tolist() == J.tolist()


def test_a_changed_number_is_another_grid():
    changed = J.copy()
    changed[2, 3] = np.nextafter(changed[2, 3], np.inf)
    assert es.Grid([X, Y], changed) != GRID
    assert es.Grid([X, Y + 1e-15], J) != GRID


def test_grids_are_immutable():
    with pytest.raises(ValueError, match="read-only"):
        GRID.values[0, 0] = 1
    source = J.copy()
    grid = es.Grid([X, Y], source)
    source[0, 0] = 7
    assert grid == GRID


SIGNS = (-1.0) ** np.add.outer(np.arange(5), np.arange(4))
BAD = {
    "NaN": (lambda: es.Grid([X, Y], np.where(J[2, 1] == J, np.nan, J)), "values: 1 of 20 are NaN"),
    "infinity": (lambda: es.Grid([X, Y], J + np.inf), "values: 20 of 20 are NaN or infinite"),
    "not monotonic": (lambda: es.Grid([[0, 2, 1, 3, 4], Y], J), "x: must be finite and strictly"),
    "repeated": (lambda: es.Grid([X, [0, 1, 1, 2]], J), "y: must be finite and strictly"),
    "NaN in an axis": (lambda: es.Grid([X, [0, 1, np.nan, 2]], J), "y: must be finite"),
    "one row": (lambda: es.Grid([X[:1], Y], J[:1]), "x: has 1 grid line(s)"),
    "three rows": (lambda: es.Grid([X[:3], Y], J[:3]), "x: has 3 grid line(s)"),
    "lengths": (lambda: es.Grid([X, Y[:3]], J), "y: has 3 coordinates for 4 values"),
    "dimensions": (lambda: es.Grid([X], J), "values: must have 1 dimension"),
    "ragged": (lambda: es.Grid([X, Y], [[1, 2], [3]]), "values = [[1, 2], [3]]: must be an array"),
    "text": (lambda: es.Grid([X, Y], "abc"), "values = 'abc': must be an array"),
    "complex": (lambda: es.Grid([X, Y], J * 1j), "values"),
    "axes of no kind": (lambda: es.Grid(1, J), "axes"),  # pyright: ignore[reportArgumentType]
    "no axes": (lambda: es.Grid([], 1.0), "axes"),
    "dates": (lambda: es.Grid([X, np.array("2000", "M8[D]") + np.arange(4)], J), "axes.1"),
    "vast": (lambda: es.Gridded(es.Grid([[-1e308, 0, 1, 2, 1.7e308], Y], J)), "Gridded.grid"),
    "huge values": (lambda: es.Gridded(es.Grid([X, Y], 1e308 * SIGNS)), "Gridded.grid"),
    "no coordinate": (lambda: es.Gridded(xarray.DataArray(J)), "Gridded.grid.dim_0: this dim"),  # pyright: ignore
    "nothing": (lambda: es.Gridded(None), "Gridded.grid = None: must be a Grid"),  # pyright: ignore
    "missing file": (lambda: es.Gridded("a.nc"), "Gridded.grid.file = 'a.nc': there is no"),  # pyright: ignore
    "numbers of no shape": (lambda: es.Gridded({"values": [1]}), "Gridded.grid"),  # pyright: ignore
}


@pytest.mark.parametrize("name", BAD)
def test_data_that_make_no_field_are_refused(name):
    build, message = BAD[name]
    with pytest.raises(es.InvalidDescription) as refused:
        build()
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


FILES = {
    "ok.npz": lambda path: np.savez(path, x=X, y=Y, J=J),
    "empty.npz": lambda path: np.savez(path),
    "two.npz": lambda path: np.savez(path, x=X, y=Y, J=J, K=J),
    "words.npz": lambda path: np.savez(path, x=X, y=Y, J=np.full(J.shape, "a")),
    "objects.npz": lambda path: np.savez(path, x=X, y=Y, J=J.astype(object)),
    "nothing.npz": lambda path: path.write_bytes(b""),
    "random.npz": lambda path: path.write_bytes(b"hello"),
    "cut.npz": lambda path: (np.savez(path, J=J), path.write_bytes(path.read_bytes()[:200])),
    "random.nc": lambda path: path.write_bytes(b"hello"),
    "nothing.nc": lambda path: path.write_bytes(b""),
    "empty.nc": lambda path: xarray.Dataset().to_netcdf(path),
    "words.nc": lambda path: array("x", "y").astype(str).to_netcdf(path),
    "nothing.csv": lambda path: path.write_text(""),
    "header.csv": lambda path: path.write_text("x,y,J\n"),
    "headless.csv": lambda path: path.write_text(csv().partition("\n")[2]),
    "words.csv": lambda path: path.write_text(csv().replace("1.5", "one")),
    "ragged.csv": lambda path: path.write_text(csv() + "\n1,2"),
    "missing.csv": lambda path: path.write_text(csv().rpartition("\n")[0]),
    "twice.csv": lambda path: path.write_text(csv().rpartition("\n")[0] + "\n0,0,1"),
    "semicolons.csv": lambda path: path.write_text(csv().replace(",", ";")),
    "binary.csv": lambda path: path.write_bytes(bytes(range(256))),
    "folder.nc": lambda path: path.mkdir(),
    "a.txt": lambda path: path.write_text(csv()),
}
TABLES: list[dict[str, Any]] = [
    *({"file": name} for name in FILES if name != "ok.npz"),
    *({"file": item} for item in (1, "", ".", ["a"], "matplotlib:nosuch.npz", "matplotlib:")),
    *({"variable": item} for item in ("K", 1, ["J"])),
    *({"dims": item} for item in ("yx", ["y"], [1, 2], [1, "x"], [["x"], "y"], 3)),
    *({"spacing": item} for item in (1, [1], [0, 1], ["a", 1], ["1", "1"], [[1], [1]])),
    *({"spacing": item} for item in ([float("nan"), 1], [float("inf"), 1])),
    *({"coordinates": item} for item in (1, ["x"], ["x", "q"], [1, 2], [["x"], ["y"]], ["J"] * 2)),
    *({"digest": item} for item in ("abc", 1)),
    {"colour": 1},
]


@pytest.mark.parametrize("table", TABLES, ids=str)
def test_tables_that_cannot_be_read_are_refused(table, folder):
    name = table.get("file", "ok.npz")
    if isinstance(name, str) and name in FILES:
        FILES[name](folder / name)
    with pytest.raises(es.InvalidDescription) as refused:
        es.Gridded({"file": "ok.npz", **table})  # pyright: ignore[reportArgumentType]
    assert str(refused.value).startswith("Gridded.grid.")
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 400


# --- interpolation ----------------------------------------------------------------------------

COEFFICIENTS = st.lists(st.floats(-1, 1), min_size=16, max_size=16)
STEPS = st.lists(st.floats(0.2, 2), min_size=4, max_size=7)


@settings(deadline=None, max_examples=40)
@given(COEFFICIENTS, STEPS, STEPS, st.integers(0, 99))
def test_products_of_cubics_are_reproduced(coefficients, across, along, seed):
    c = np.reshape(coefficients, (4, 4))
    axes = [np.cumsum(across) - 3, np.cumsum(along) - 3]
    grid = es.Grid(axes, np.polynomial.polynomial.polygrid2d(axes[0], axes[1], c))
    rng = np.random.default_rng(seed)
    x, y = (rng.uniform(axis[0], axis[-1], 20) for axis in axes)
    expected = np.polynomial.polynomial.polyval2d(x, y, c)
    scale = np.abs(grid.values).max() + 1e-3
    np.testing.assert_allclose(es.Gridded(grid).at(x, y), expected, atol=1e-11 * scale)


def test_the_interpolation_passes_through_the_data():
    np.testing.assert_allclose(
        es.Gridded(GRID).at(*np.meshgrid(X, Y, indexing="ij")), J, atol=1e-13
    )


def test_the_interpolation_is_twice_continuously_differentiable():
    rng = np.random.default_rng(3)
    axis = np.arange(8.0)
    field = es.Gridded(es.Grid([axis, axis], rng.normal(size=(8, 8))))
    jumps = np.array([sides(field, knot) for knot in (2.0, 3.0, 4.0, 5.0)])
    assert np.abs(jumps[:, :3]).max() < 1e-9  # value, slope, curvature
    assert np.abs(jumps[:, 3]).min() > 1e-3  # the third derivative jumps: these are knots


def sides(field: es.Gridded, knot: float) -> np.ndarray:
    """The jumps at a grid line of a cubic's four derivatives, fitted on each side along x."""
    offsets = np.array([0.1, 0.35, 0.65, 0.9])
    left, right = (
        np.polynomial.polynomial.polyfit(side, field.at(knot + side, 3.3), 3)
        for side in (-offsets, offsets)
    )
    return left - right


# --- the edge ---------------------------------------------------------------------------------


def climbing(slope: tuple[float, float], start: tuple[float, float] = (1.0, 1.0)) -> es.Loop:
    """A loop on a plane map over [0, 3]², which it climbs until the data end."""
    axis = np.linspace(0, 3, 7)
    return es.Loop(
        field=es.Gridded(es.Grid([axis, axis], np.add.outer(slope[0] * axis, slope[1] * axis))),
        vehicle=es.PointMass((1 / s, 1 / s)),
        controller=es.GradientES(
            frequency=20,
            washout=1.0,
            channels=(
                es.Channel(es.Dither(0.1), 30),
                es.Channel(es.Dither(0.1, -pi / 2), 30),
            ),
        ),
        start=start,
    )


@pytest.mark.parametrize(
    ("slope", "axis", "edge"), [((1, 0), 0, 3.0), ((-1, 0), 0, 0.0), ((0, 1), 1, 3.0)]
)
def test_a_run_ends_at_the_edge_of_the_data(slope, axis, edge):
    loop = climbing(slope).replace({f"controller.channels.{1 - axis}.gain": 0})
    run = es.simulate(loop, 60.0)
    assert run.attrs["outcome"] == "left the data"
    assert run.attrs["engine"] == "reference"
    end = np.array(run.attrs["end_state"])[axis]
    assert abs(end - edge) < 1e-9
    assert 0 <= end <= 3
    assert 0 < run.attrs["end_time"] < 60
    assert run.time.values[-1] <= run.attrs["end_time"]
    assert ((run.position >= 0) & (run.position <= 3)).all()
    assert all(np.isfinite(run[name].values).all() for name in run.data_vars)


def test_the_edge_does_not_depend_on_the_samples():
    ends = [
        es.simulate(climbing((1, 0)), 60.0, samples=samples).attrs["end_time"]
        for samples in (3, 500)
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)


def test_a_gridded_quadratic_moves_as_the_quadratic_does():
    axis = np.linspace(-9, 9, 9)
    values = 1 - np.add.outer((axis + 1) ** 2, 0.5 * (axis + 1) ** 2)
    gridded = climbing((1, 0)).replace(
        {"field": es.Gridded(es.Grid([axis, axis], values)), "controller.channels.0.gain": 10}
    )
    smooth = gridded.replace({"field": es.Quadratic((-1, -1), (1.0, 0.5), 1.0)})
    runs = [es.simulate(loop, 2.0, samples=50) for loop in (gridded, smooth)]
    np.testing.assert_allclose(runs[0].position, runs[1].position, atol=1e-8)


def test_the_data_can_be_carried_along():
    loop = climbing((1, 0))
    moving = loop.replace({"field": es.Moving(loop.field, es.Line((-1.0, 0.0)))})
    run = es.simulate(moving, 60.0)
    assert run.attrs["outcome"] == "left the data"
    end = run.attrs["end_state"][0] + run.attrs["end_time"]
    assert abs(end - 3) < 1e-9


@pytest.mark.parametrize("start", [(3.1, 1.0), (1.0, -0.5)])
def test_a_start_outside_is_refused(start):
    with pytest.raises(es.InvalidDescription, match=r"start: lies 0\.[15]\d* m outside"):
        es.simulate(climbing((1, 0), start), 1.0)


def test_the_taylor_engine_is_refused():
    with pytest.raises(es.InvalidDescription, match="engine"):
        es.simulate(climbing((1, 0)), 1.0, engine="taylor")
