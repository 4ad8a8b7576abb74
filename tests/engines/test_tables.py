"""Tables of gridded fields in vectors of loops, against SciPy's splines."""

from __future__ import annotations

import ctypes
import mmap
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import extremum as es
from extremum.engines.lanes.asked import Asked
from extremum.engines.simd import running
from extremum.engines.simd.compiling import Compiled
from extremum.engines.simd.emitter import Emitter
from extremum.engines.simd.tables import packed, readers
from extremum.papers import zhang2007

DTYPE = {64: np.float64, 32: np.float32}
WIDE = {64: 16, 32: 16}
BOTH = pytest.mark.parametrize("bits", [64, 32])


def lines(kind: str) -> NDArray[np.float64]:
    """Return grid lines: as even as rounding lets them be, or not at all."""
    rng = np.random.default_rng(3)
    return {
        "even": 3.7 + 0.3 * np.arange(17),
        "fewest": np.array([-1.0, 0.0, 0.5, 2.0]),
        "random": np.cumsum(rng.uniform(0.05, 1.0, 23)) - 4,
        "geometric": np.geomspace(0.01, 20, 40),
        "one apart": np.array([0.0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3, 10.0]),
    }[kind]


GRIDS = {
    "even": ("even",),
    "fewest": ("fewest",),
    "geometric": ("geometric",),
    "one apart": ("one apart",),
    "even even": ("even", "even"),
    "random even": ("random", "even"),
    "even geometric": ("even", "geometric"),
    "random even fewest": ("random", "even", "fewest"),
    "even even even": ("even", "even", "even"),
}
ALL = pytest.mark.parametrize("name", GRIDS)


@cache
def grid(name: str) -> es.Grid:
    axes = [lines(kind) for kind in GRIDS[name]]
    values = np.random.default_rng(5).normal(size=[len(axis) for axis in axes])
    return es.Grid(axes, values)


def system(*grids: es.Grid) -> Any:
    """Return as much of a system as tables need."""
    oracles = [es.Gridded(each).oracles()["f"] for each in grids]
    return SimpleNamespace(oracles={f"f{i}": oracle for i, oracle in enumerate(oracles)})


def compiled(
    given: Any, name: str, bits: int, width: int, stored: int, held: Any = None
) -> Callable[..., Any]:
    """Return a table as a function of arrays (points, axes); `stored` are the table's bits."""
    e = Emitter(width, bits)
    reader = readers(given, stored)[f"table {name}"]
    numbers = packed(given, f"float{stored}") if held is None else held
    dimension = len(reader.halvings)

    def place(k: int) -> str:
        return e.value(f"getelementptr {e.element}, ptr %p{k}, i64 %i")

    align = f"align {bits // 8}"
    asked = [e.value(f"load {e.type}, ptr {place(k)}, {align}") for k in range(dimension)]
    result = reader(e, *asked)
    e.line(f"store {e.type} {result}, ptr {place(dimension)}, {align}")
    pointers = ", ".join(f"ptr %p{k}" for k in range(dimension + 1))
    text = (
        *e.intrinsics.values(),
        f"define void @f(ptr %tables, {pointers}, i64 %n) {{",
        "entry:\n  br label %loop",
        "loop:\n  %i = phi i64 [0, %entry], [%next, %loop]",
        *e.lines,
        f"  %next = add i64 %i, {width}\n  %more = icmp slt i64 %next, %n",
        "  br i1 %more, label %loop, label %out\nout:\n  ret void\n}",
    )
    code = Compiled("\n".join(text))
    call = code.function("f", *[ctypes.c_void_p] * (dimension + 2), ctypes.c_int64)

    def function(points: Any) -> Any:
        points = np.asarray(points, dtype=DTYPE[bits])
        count = len(points)
        rows = np.zeros((dimension + 1, -(-count // width) * width), DTYPE[bits])
        rows[:-1, :count] = points.T
        call(numbers.ctypes.data, *(row.ctypes.data for row in rows), rows.shape[1])
        return rows[-1, :count]

    return function


@cache
def table(name: str, bits: int) -> Callable[..., Any]:
    return compiled(system(grid(name)), "f0", bits, WIDE[bits], bits)


def points(name: str) -> NDArray[np.float64]:
    """Return random points, nodes, and the numbers beside the grid lines."""
    rng, axes = np.random.default_rng(11), grid(name).axes
    anywhere = np.stack([rng.uniform(a[0], a[-1], 4000) for a in axes], axis=-1)
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    edges = anywhere.copy()
    for column, axis in zip(edges.T, axes, strict=True):
        chosen = rng.choice(axis, len(column))
        beside = np.nextafter(chosen, rng.choice([-np.inf, np.inf], len(column)))
        moved = rng.random(len(column)) < 0.6
        column[moved] = np.clip(beside, axis[0], axis[-1])[moved]
    return np.concatenate([anywhere, nodes, edges])


def size(name: str) -> float:
    """Return the largest |f| seen, by which rounding is measured."""
    return float(np.abs(grid(name).spline(points(name))).max())


@ALL
def test_values_are_the_splines(name):
    asked = points(name)
    error = np.abs(table(name, 64)(asked) - grid(name).spline(asked))
    assert error.max() < 1e-13 * size(name)


@ALL
def test_single_precision_rounds_coordinates_and_values_and_nothing_else(name):
    asked = points(name)
    rounded = asked.astype(np.float32)
    spline = grid(name).spline
    eps, unit = np.finfo(np.float32).eps, np.eye(asked.shape[1])
    off = [np.abs(spline(asked, nu=nu.astype(int))) for nu in unit]
    reach = [np.abs(a).max() for a in grid(name).axes]
    bound = eps * (8 * size(name) + 4 * sum(o * r for o, r in zip(off, reach, strict=True)))
    error = np.abs(table(name, 32)(rounded) - spline(asked))
    assert (error < bound).all(), (error / bound).max()


@BOTH
@ALL
def test_nodes_are_met_exactly(name, bits):
    axes = grid(name).axes
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    error = np.abs(table(name, bits)(nodes) - grid(name).values.ravel())
    assert error.max() < 100 * np.finfo(DTYPE[bits]).eps * size(name)


@ALL
def test_outside_the_data_the_cell_at_the_edge_goes_on(name):
    axes, rng = grid(name).axes, np.random.default_rng(2)
    out = np.stack([rng.uniform(2 * a[0] - a[-1], 2 * a[-1] - a[0], 999) for a in axes], axis=-1)
    expected = grid(name).spline(out, extrapolate=True)
    np.testing.assert_allclose(table(name, 64)(out), expected, rtol=1e-9, atol=1e-9)


@BOTH
@pytest.mark.parametrize("width", [1, 2, 4, 32])
@pytest.mark.parametrize("name", ["geometric", "random even", "random even fewest"])
def test_every_width_gives_the_same_bits(name, width, bits):
    asked = points(name)
    other = compiled(system(grid(name)), "f0", bits, width, bits)
    np.testing.assert_array_equal(other(asked), table(name, bits)(asked))


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("name", ["geometric", "even even", "random even fewest"])
def test_a_table_of_single_precision_is_read_in_double(name, width):
    """As the kernel does before the first step."""
    asked = points(name).astype(np.float32).astype(float)
    wide = compiled(system(grid(name)), "f0", 64, width, 32)
    np.testing.assert_allclose(wide(asked), table(name, 32)(asked), atol=2e-5 * size(name))


@BOTH
def test_several_tables_lie_side_by_side(bits):
    names = ["random even", "geometric", "even"]
    for i, name in enumerate(names):
        found = compiled(system(*map(grid, names)), f"f{i}", bits, 16, bits)(points(name))
        np.testing.assert_array_equal(found, table(name, bits)(points(name)))


def test_another_grid_of_the_same_kind_needs_no_other_code():
    def like(count: int) -> es.Grid:
        axes = [np.arange(4.0 + count), np.arange(9.0 + count) / 7]
        return es.Grid(axes, np.random.default_rng(count).normal(size=[len(a) for a in axes]))

    assert readers(system(like(0)), 64) == readers(system(like(31)), 64)
    assert readers(system(like(0)), 64) != readers(system(grid("random even")), 64)


def test_lines_too_close_for_single_precision_are_refused():
    axis = 1e6 + np.array([0.0, 1.0, 2.0, 2.01, 4.0])
    given = system(es.Grid([axis], np.zeros(5)))
    assert len(packed(given, "float64"))
    with pytest.raises(es.InvalidDescription, match=r"x = 1000002 apart; use float64"):
        packed(given, "float32")


WILD = [np.nan, np.inf, -np.inf, 1e300, -1e300, 3e9, -3e9, 1e19, -1e19, 5e-324]


def read_anywhere(name: str, bits: int) -> None:
    """Read at wild coordinates from numbers between two pages that cannot be read."""
    libc, page = ctypes.CDLL(None), mmap.PAGESIZE
    libc.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    given = system(grid(name))
    numbers = packed(given, f"float{bits}")
    pages = -(-numbers.nbytes // page)
    room = mmap.mmap(-1, (pages + 2) * page)
    whole = np.frombuffer(room, np.uint8)
    for begin in (page, (pages + 1) * page - numbers.nbytes):
        whole[page:-page] = 0
        held = whole[begin : begin + numbers.nbytes].view(numbers.dtype)
        held[:] = numbers
        for edge in (0, (pages + 1) * page):
            assert libc.mprotect(whole.ctypes.data + edge, page, 0) == 0
        function = compiled(given, "f0", bits, 16, bits, held)
        with np.errstate(over="ignore"):
            function(list(product(WILD, repeat=len(GRIDS[name]))))
            function(points(name))
        for edge in (0, (pages + 1) * page):
            assert libc.mprotect(whole.ctypes.data + edge, page, 3) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="protects pages of memory by mprotect")
def test_nothing_outside_the_table_is_read():
    """In another process, which a read of a protected page would end."""
    script = "import test_tables as t; [t.read_anywhere(n, b) for n in t.GRIDS for b in (32, 64)]"
    folder = Path(__file__).parent
    ended = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True)
    assert ended.returncode == 0, ended.stderr


# --- runs -------------------------------------------------------------------------------------


def asked(loop: es.Loop, starts: Any, t_end: float, dtype: str = "float64") -> Asked:
    paths = [p.path for p in loop.system.parameters]
    swept = tuple(paths.index(f"start.{k}") for k in range(2))
    values = np.array(loop.values, dtype=float)
    return Asked(loop.system, values, swept, np.array(starts, float).T, t_end, dtype=dtype)


@pytest.mark.parametrize(("dtype", "off"), [("float64", 1e-3), ("float32", 1.0)])
def test_the_landscape_is_climbed_as_by_dop853(dtype, off):
    loop, t_end = zhang2007.scenario("landscape").loop, 300.0
    starts = [(18600, 3200), (17200, 5400), (9123, 20456)]
    ended = running.integrate(asked(loop, starts, t_end, dtype))
    for start, state in zip(starts, ended.states.T, strict=True):
        given = loop.replace({f"start.{k}": x for k, x in enumerate(start)})
        run = es.simulate(given, t_end, tol=1e-10)
        np.testing.assert_allclose(state, run.attrs["end_state"], rtol=0, atol=off)
    assert (ended.outcome == 0).all()


def test_runs_end_where_the_data_do():
    axis = np.linspace(0.0, 3.0, 7)
    field = es.Gridded(es.Grid([axis, axis], np.add.outer(axis, 0 * axis)))
    loop = zhang2007.scenario("landscape").loop.replace({"field": field})
    changes = {f"controller.channels.{k}.dither.amplitude": 0.1 for k in range(2)}
    loop = loop.replace({**changes, "controller.frequency": 20, "controller.channels.0.gain": 30})
    loop = loop.replace({"controller.channels.1.gain": 0, "start.0": 1, "start.1": 1.5})
    run = es.simulate(loop, 60.0)
    ended = running.integrate(asked(loop, [(1, 1.5)] * 3, 60.0))
    assert run.attrs["outcome"] == "left the data"
    assert (ended.outcome == 2).all()
    assert (ended.states[:2] >= 0).all()
    assert (ended.states[:2] <= 3).all()
    np.testing.assert_allclose(ended.end_time, run.attrs["end_time"], atol=2 * np.pi / 20 / 20)
