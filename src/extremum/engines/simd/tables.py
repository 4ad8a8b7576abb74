"""Tables of gridded fields, read by vectors of loops: splines by their values at the nodes.

A cell of a tensor product of cubic splines is determined by the 2^d mixed first derivatives at its
2^d corners. Those of two neighbours along the last axis follow each other in memory: every loop
loads rows of 2^(d+1) numbers, and the rows of a vector of loops are transposed. That takes half the
time of gathering number by number, and 2^d times less memory than the polynomials' coefficients.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidDescription
from ...symbols import axis_names
from ...system import System, Table
from .emitter import Emitter
from .printing import spread
from .transposing import joined, transposed

SLOTS: Final = ("origin", "rate", "step", "top", "last", "stride", "lines", "first")
"""What is known of an axis: where it begins; bins per m; m per bin; the last bin; the last cell;
nodes from one line to the next; where its lines and the bins' first cells lie. Its bins are its
cells if the lines are evenly spaced."""

BINS: Final = 4
"""Bins per cell of lines that are not evenly spaced."""

EVEN: Final = 4
"""Rounding errors by which evenly spaced lines may be off."""

ALIGNED: Final = 64
CHUNK: Final = 8
"""Numbers loaded at once."""


@dataclass(frozen=True, eq=False)
class _Axis:
    """Lines and what finds the one before a coordinate."""

    line: NDArray[Any]
    first: NDArray[Any] | None
    halvings: int
    rate: float
    step: float

    @property
    def bins(self) -> int:
        return len(self.line) - 1 if self.first is None else len(self.first)


def _axis(line: NDArray[np.float64], name: str, dtype: str) -> _Axis:
    rounded = line.astype(dtype)
    steps = np.diff(rounded)
    if not (steps > 0).all():
        at = float(line[int(np.argmin(steps))])
        reason = f"cannot tell the grid lines at {name} = {at:.9g} apart; use float64"
        raise InvalidDescription("dtype", reason, repr(dtype))
    cells, span = len(line) - 1, float(line[-1] - line[0])
    even = line[0] + span / cells * np.arange(cells + 1)
    if np.abs(line - even).max() <= EVEN * np.spacing(np.abs(line).max()):
        return _Axis(rounded, None, 0, cells / span, span / cells)
    rate = np.asarray(BINS * cells / span, dtype)
    places = np.minimum((rounded - rounded[0]) * rate, BINS * cells - 1).astype(np.int64)
    before, upto = (
        np.searchsorted(places, np.arange(BINS * cells), side) - 1 for side in ("left", "right")
    )
    first = np.maximum(before, 0)
    halvings = int((upto - first).max()).bit_length()
    return _Axis(rounded, first, halvings, float(rate), span / (BINS * cells))


def _tables(system: System) -> Iterator[tuple[str, Table, int]]:
    """Return names and tables, and where the description of each lies."""
    at = 0
    for name, oracle in system.oracles.items():
        if oracle.table is not None:
            yield name, oracle.table, at
            at += len(SLOTS) * len(oracle.table.lines) + 1


def _axes(table: Table, dtype: str) -> list[_Axis]:
    names = axis_names(len(table.lines))
    return [_axis(line, name, dtype) for line, name in zip(table.lines, names, strict=True)]


def packed(system: System, dtype: str) -> NDArray[Any]:
    """Return the numbers of a system's tables as the kernel reads them; empty if it has none.

    Parameters
    ----------
    dtype
        ``"float64"`` or ``"float32"``; integers are stored as bits.

    Raises
    ------
    InvalidDescription
        For grid lines that are the same number in this precision.
    """
    number = np.dtype(dtype)
    tables = list(_tables(system))
    parts: list[NDArray[Any]] = [
        np.zeros(sum(len(SLOTS) * len(table.lines) + 1 for _, table, _ in tables), number)
    ]
    used = len(parts[0])

    def put(array: NDArray[Any], per: int = 1) -> int:
        nonlocal used
        gap = -used % per
        parts.extend([np.zeros(gap, number), array.ravel()])
        used += gap + array.size
        return used - array.size

    for _, table, head in tables:
        strides = np.cumprod([1, *table.values.shape[:0:-1]])[::-1]
        for axis, stride in zip(_axes(table, dtype), strides, strict=True):
            first = axis.first if axis.first is not None else np.empty(0)
            whole = [axis.bins - 1, len(axis.line) - 2, stride]
            whole += [put(axis.line), put(first.astype(number))]
            parts[0][head : head + 3] = axis.line[0], axis.rate, axis.step
            parts[0].view(f"i{number.itemsize}")[head + 3 : head + len(SLOTS)] = whole
            head += len(SLOTS)
        with np.errstate(over="ignore"):
            at = put(table.nodes.astype(number), ALIGNED // number.itemsize)
        parts[0].view(f"i{number.itemsize}")[head] = at
    return _aligned(np.concatenate(parts))


def _aligned(array: NDArray[Any]) -> NDArray[Any]:
    """Return a copy that begins with a cache line."""
    room = np.empty(array.nbytes + ALIGNED, np.uint8)
    begin = -room.ctypes.data % ALIGNED
    result = room[begin : begin + array.nbytes].view(array.dtype)
    result[:] = array
    return result


def readers(system: System, bits: int) -> Mapping[str, Reader]:
    """Return what writes the tape's operations on tables, by their names.

    Two systems whose readers are equal can share machine code.
    """
    return {
        f"table {name}": Reader(
            head, bits, tuple(None if a.first is None else a.halvings for a in axes)
        )
        for name, table, head in _tables(system)
        for axes in [_axes(table, f"float{bits}")]
    }


@dataclass(frozen=True)
class Reader:
    """Writes the value of one table at a point.

    What lies outside is the continuation of the cell at the edge; NaN is read in the first cell.

    Attributes
    ----------
    head
        Where its description lies.
    bits
        Of a stored number.
    halvings
        Of each axis: steps of the search within a bin; None for evenly spaced lines.
    """

    head: int
    bits: int
    halvings: tuple[int | None, ...]

    def __call__(self, emitter: Emitter, *coordinates: str) -> str:
        """Write the value at coordinates."""
        writer = _Writer(self, emitter)
        cells = [writer.cell(k, x) for k, x in enumerate(coordinates)]
        numbers = writer.numbers([cell for cell, _, _ in cells])
        for _, part, length in reversed(cells):
            numbers = _folded(emitter, numbers, _weights(emitter, part, length))
        return numbers[()]


def _weights(e: Emitter, t: str, h: str) -> list[str]:
    """Return Hermite's cubics of f(0), f'(0), f(1), f'(1) at t of a cell of length h."""
    rest = e.subtract(e.constant(1.0), t)
    both = e.multiply(t, rest)
    slope = e.multiply(h, both)
    last = e.multiply(e.multiply(t, t), e.subtract(e.constant(3.0), e.add(t, t)))
    first = e.subtract(e.constant(1.0), last)
    return [first, e.multiply(slope, rest), last, e.negative(e.multiply(slope, t))]


_Numbers = Mapping[tuple[int, ...], str]


def _folded(e: Emitter, numbers: _Numbers, weights: Sequence[str]) -> _Numbers:
    """Return the sums over the last axis."""
    found: dict[tuple[int, ...], str] = {}
    for key, number in numbers.items():
        rest, weight = key[:-1], weights[key[-1]]
        known = found.get(rest)
        found[rest] = e.multiply(number, weight) if known is None else e.fma(number, weight, known)
    return found


class _Writer:
    """Writes the parts of a `Reader`; `stored` is the type of numbers in the table."""

    def __init__(self, reader: Reader, emitter: Emitter) -> None:
        self.reader, self.emitter = reader, emitter
        self.stored = emitter.like(bits=reader.bits)
        self.whole = emitter.like(bits=32)

    def _slot(self, axis: int, name: str) -> str:
        slot = self.reader.head + len(SLOTS) * axis + (SLOTS.index(name) if name else 0)
        return self._place("%tables", str(slot))

    def _place(self, base: str, offset: str) -> str:
        kind = self.stored.element
        return self.emitter.value(f"getelementptr {kind}, ptr {base}, i64 {offset}")

    def _number(self, axis: int, name: str) -> str:
        kind = self.stored.element
        number = self.emitter.value(f"load {kind}, ptr {self._slot(axis, name)}, align 4")
        return self._as_asked(spread(self.stored, number), self.stored.type)

    def _as_asked(self, number: str, kind: str) -> str:
        if self.emitter.bits == self.reader.bits:
            return number
        wide = kind.replace("float", "double")
        return self.emitter.value(f"fpext {kind} {number} to {wide}")

    def _integer(self, axis: int, name: str) -> str:
        """Return an integer of the description in every lane."""
        bits = self.emitter.value(f"load float, ptr {self._slot(axis, name)}, align 4")
        return self.whole.as_bits(spread(self.whole, bits))

    def _offset(self, axis: int, name: str) -> str:
        """Return an integer of the description as an index."""
        number = self.emitter.value(f"load i32, ptr {self._slot(axis, name)}, align 4")
        return self.emitter.value(f"sext i32 {number} to i64")

    def _to_number(self, integers: str) -> str:
        kinds = self.whole.integers, self.emitter.type
        return self.emitter.value(f"sitofp {kinds[0]} {integers} to {kinds[1]}")

    def _chosen(self, mask: str, a: str, b: str) -> str:
        kind, masks = self.whole.integers, self.emitter.masks
        return self.emitter.value(f"select {masks} {mask}, {kind} {a}, {kind} {b}")

    # --- a cell -------------------------------------------------------------------------------

    def cell(self, axis: int, x: str) -> tuple[str, str, str]:
        """Return the cell that a coordinate is in, how much of it lies before, and its length."""
        e = self.emitter
        origin, rate = self._number(axis, "origin"), self._number(axis, "rate")
        place = e.multiply(e.subtract(x, origin), rate)
        bin_ = self._bin(axis, place)
        halvings = self.reader.halvings[axis]
        if halvings is None:
            part = e.subtract(place, self._to_number(bin_))
            return bin_, part, self._number(axis, "step")
        lines = self._place("%tables", self._offset(axis, "lines"))
        cell = self._found(axis, x, bin_, lines, halvings)
        begin, end = (self._gathered(self._place(lines, i), cell) for i in ("0", "1"))
        length = e.subtract(end, begin)
        return cell, e.divide(e.subtract(x, begin), length), length

    def _bin(self, axis: int, place: str) -> str:
        """Return the whole part, inside the table whatever the number; 0 for NaN."""
        e, zero = self.emitter, self.emitter.constant(0.0)
        top = self._to_number(self._integer(axis, "top"))
        inside = e.select(e.compare("ogt", place, zero), place, zero)
        inside = e.select(e.compare("olt", inside, top), inside, top)
        return e.value(f"fptosi {e.type} {inside} to {self.whole.integers}")

    def _found(self, axis: int, x: str, bin_: str, lines: str, halvings: int) -> str:
        """Return the last line that is not beyond x, but one with a cell behind it."""
        e, whole, last = self.emitter, self.whole, self._integer(axis, "last")
        starts = self._place("%tables", self._offset(axis, "first"))
        kind = f"{e.type} {self._gathered(starts, bin_)} to {whole.integers}"
        cell = self._least(e.value(f"fptosi {kind}"), last)
        for power in reversed(range(halvings)):
            ahead = self._least(whole.integral("add", cell, whole.integer(2**power)), last)
            reached = e.compare("ole", self._gathered(lines, ahead), x)
            cell = self._chosen(reached, ahead, cell)
        return cell

    def _least(self, a: str, b: str) -> str:
        return self._chosen(self.whole.compare_integers("slt", a, b), a, b)

    def _gathered(self, base: str, indices: str) -> str:
        """Return the numbers at indices."""
        e, kind, width = self.emitter, self.stored.type, self.emitter.width
        element, kinds = self.stored.element, self.whole.integers
        places = e.value(f"getelementptr {element}, ptr {base}, {kinds} {indices}")
        if width == 1:
            return self._as_asked(e.value(f"load {kind}, ptr {places}, align 4"), kind)
        name = f"@llvm.masked.gather.v{width}f{self.reader.bits}.v{width}p0"
        given = f"<{width} x ptr>", "i32", e.masks, kind
        e.intrinsics[name] = f"declare {kind} {name}({', '.join(given)})"
        text = f"{given[0]} {places}, i32 4, {e.masks} splat (i1 true), {kind} poison"
        return self._as_asked(e.value(f"call {kind} {name}({text})"), kind)

    # --- its corners --------------------------------------------------------------------------

    def numbers(self, cells: Sequence[str]) -> _Numbers:
        """Return what the cells' corners hold.

        A key has a number for each axis: 0 for f, 1 for its derivative at the cell's beginning; 2
        and 3 for those at its end.
        """
        whole, d = self.whole, len(cells)
        strides = [self._integer(k, "stride") for k in range(d)]
        node = reduce(
            lambda a, b: whole.integral("add", a, b),
            (whole.integral("mul", c, s) for c, s in zip(cells, strides, strict=True)),
        )
        lanes = self._lanes(node)
        found: dict[tuple[int, ...], str] = {}
        for corner in product((0, 1), repeat=d - 1):
            base = self._row(corner)
            bits = product((0, 1), repeat=d + 1)
            for last_and_slopes, number in zip(bits, self._rows(base, lanes, d), strict=True):
                ends, slopes = (*corner, last_and_slopes[0]), last_and_slopes[1:]
                key = tuple(2 * end + slope for end, slope in zip(ends, slopes, strict=True))
                found[key] = self._as_asked(number, self.stored.type)
        return dict(sorted(found.items()))

    def _lanes(self, integers: str) -> list[str]:
        e, width = self.emitter, self.emitter.width
        kind = self.whole.integers
        numbers = [integers]
        if width > 1:
            numbers = [e.value(f"extractelement {kind} {integers}, i64 {i}") for i in range(width)]
        return [e.value(f"sext i32 {number} to i64") for number in numbers]

    def _row(self, corner: tuple[int, ...]) -> str:
        """Return the address of the node at a corner of the table's first cell."""
        e, d = self.emitter, len(corner) + 1
        base = self._place("%tables", self._offset(d, ""))
        for axis, end in enumerate(corner):
            if end:
                kind = f"[{2**d} x {self.stored.element}]"
                stride = self._offset(axis, "stride")
                base = e.value(f"getelementptr {kind}, ptr {base}, i64 {stride}")
        return base

    def _rows(self, base: str, lanes: Sequence[str], d: int) -> Iterator[str]:
        """Return the numbers of two neighbouring nodes, each of all lanes."""
        e, width, kind = self.emitter, self.emitter.width, self.stored.element
        size = min(width, 2 ** (d + 1), CHUNK)
        nodes = [
            e.value(f"getelementptr [{2**d} x {kind}], ptr {base}, i64 {lane}") for lane in lanes
        ]
        row = kind if size == 1 else f"<{size} x {kind}>"
        for begin in range(0, 2 ** (d + 1), size):
            places = [self._place(node, str(begin)) for node in nodes]
            loaded = [e.value(f"load {row}, ptr {place}, align 4") for place in places]
            groups = [transposed(e, loaded[i : i + size], row) for i in range(0, width, size)]
            for parts in zip(*groups, strict=True):
                yield joined(e, parts, size, kind)
