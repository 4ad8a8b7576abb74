"""A program as an LLVM module: blocks of loops in the cache, a vector of loops at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from types import MappingProxyType
from typing import Final

from ..lanes.frame import HUGE, LAST, SHORTEST, TIMES, TWO_PI
from ..lanes.program import Program
from ..lanes.tape import LOOP, UNIFORM
from .emitter import Emitter
from .flow import Flow
from .layout import Layout
from .mathematics import sincos
from .printing import Names, printed, spread

ARGUMENTS: Final = (
    "double %tol, double %end, ptr %values, ptr %columns, ptr %out, ptr %kept, ptr %tables, "
    "ptr %stop, i64 %stride, i64 %vectors, i64 %segments"
)
"""Tolerance; t_end; the parameters; rows of what varies, `stride` loops each; rows of what is left
at the end; states kept at the beginning of every segment and at the end, or null; tables of
gridded fields; a number that stops the run when it is not 0; `stride`; how many vectors of loops,
and how many segments of the run."""


class Kernel:
    """Writes the function ``run``; see `ARGUMENTS`."""

    def __init__(
        self,
        program: Program,
        swept: Sequence[int],
        width: int,
        bits: int,
        tables: Mapping[str, Callable[..., str]] = MappingProxyType({}),
    ) -> None:
        self.program, self.tape, self.tables = program, program.tape, tables
        self.layout = Layout(program, tuple(swept), width, bits)
        self.vector = Emitter(width, bits, contract=True)
        self.double = self.vector.like(bits=64)
        self.plain = self.vector.like(width=1, bits=64)
        self.flow = Flow(self.plain)
        self.flops = 0.0

    def text(self) -> str:
        """Return the module."""
        flow, layout = self.flow, self.layout
        self._entry()
        with flow.loop("%blocks") as block:
            first = flow.whole("mul", block, layout.vectors)
            here = flow.least(flow.whole("sub", "%vectors", first), layout.vectors)
            self._block(first, here)
        self.plain.line("ret void")
        head = f"define void @run({ARGUMENTS}) {{\nentry:"
        declared = self.vector.intrinsics.values()
        return "\n".join([*declared, head, *self.vector.lines, "}"])

    def _entry(self) -> None:
        """Compute what is the same for all loops."""
        layout, program, plain = self.layout, self.program, self.plain
        plain.line(f"%u = alloca [{len(layout.uniform) + 1} x {self.vector.element}], align 64")
        plain.line(f"%buffer = alloca [{layout.size * layout.vectors} x i8], align 64")
        plain.line(f"%active = alloca [{layout.vectors} x i64], align 64")
        wanted = [*layout.inside, *layout.constants, *layout.uniform, *program.start]
        needed = self.tape.needed([*wanted, program.unit, *program.angles])
        given = {v: "%tol" for v in needed if self.tape.operations[v].name == "tol"}
        self.single = Names(self.tape, given)
        for value in needed:
            if self.tape.rate(value) == UNIFORM and value not in given:
                self.single[value] = self._uniform(value)
        for place, value in enumerate(layout.uniform):
            number = self._narrowed(self.single[value], plain)
            plain.line(f"store {self.vector.element} {number}, ptr {self._shared(place)}, align 4")
        flow = self.flow
        more = flow.whole("add", "%vectors", layout.vectors - 1)
        plain.line(f"%blocks = udiv i64 {more}, {layout.vectors}")

    def _uniform(self, value: int) -> str:
        operation = self.tape.operations[value]
        if operation.name == "value":
            return self._load(self.flow.at("%values", int(operation.number), "double"), self.plain)
        return printed(self.plain, operation, self.single, self.tables)

    # --- memory -------------------------------------------------------------------------------

    def _load(self, address: str, emitter: Emitter, align: int = 0) -> str:
        align = align or emitter.width * emitter.bits // 8
        return emitter.value(f"load {emitter.type}, ptr {address}, align {align}")

    def _store(self, value: str, address: str, emitter: Emitter) -> None:
        emitter.line(f"store {emitter.type} {value}, ptr {address}, align 4")

    def _put(self, value: str, address: str, emitter: Emitter) -> None:
        """Store a vector where vectors are aligned."""
        align = emitter.width * emitter.bits // 8
        emitter.line(f"store {emitter.type} {value}, ptr {address}, align {align}")

    def _shared(self, place: int) -> str:
        return self.flow.at("%u", place, self.vector.element)

    def _narrowed(self, name: str, emitter: Emitter) -> str:
        """Return double precision numbers in the precision of the states."""
        if self.layout.bits == 64:
            return name
        target = self.vector.element if emitter.width == 1 else self.vector.type
        return emitter.value(f"fptrunc {emitter.type} {name} to {target}")

    def _widened(self, name: str) -> str:
        if self.layout.bits == 64:
            return name
        return self.plain.value(f"fpext {self.vector.type} {name} to {self.double.type}")

    def _row(self, base: str, row: int, vector: str, element: str) -> str:
        """Return the address of a vector's loops in a row of `stride` numbers."""
        flow = self.flow
        start = flow.whole("mul", "%stride", row)
        place = flow.whole("mul", vector, self.layout.width)
        return flow.at(base, flow.whole("add", start, place), element)

    def _slots(self, g: str) -> dict[str, str]:
        base = self.flow.at("%buffer", self.flow.whole("mul", g, self.layout.size))
        return {name: self.flow.at(base, offset) for name, offset in self.layout.offsets.items()}

    # --- a block ------------------------------------------------------------------------------

    def _block(self, first: str, here: str) -> None:
        flow = self.flow
        with flow.loop(here) as g:
            self._begin(flow.whole("add", first, g), g)
        with flow.loop("%segments") as segment:
            with flow.where(flow.truth("icmp ne ptr %kept, null")), flow.loop(here) as g:
                self._keep(flow.whole("add", first, g), g, segment)
            with flow.loop(here) as g:
                self._aim(g, segment)
                self.plain.line(f"store i64 {g}, ptr {flow.at('%active', g, 'i64')}, align 8")
            flow.rounds("%active", here, "%stop", self._step)
        with flow.where(flow.truth("icmp ne ptr %kept, null")), flow.loop(here) as g:
            self._keep(flow.whole("add", first, g), g, "%segments")
        with flow.loop(here) as g:
            self._finish(flow.whole("add", first, g), g)

    def _begin(self, vector: str, g: str) -> None:
        """Compute what varies with the loop only, in double precision, and how it starts."""
        tape, layout, program = self.tape, self.layout, self.program
        slots, double = self._slots(g), self.double
        rows = {
            leaf: self._load(self._row("%columns", row, vector, "double"), double, 8)
            for leaf, row in layout.columns.items()
        }
        named = Names(tape, fallback=lambda value: spread(double, self.single[value]))
        for value in tape.needed(
            [*layout.constants, *program.start, program.unit, *program.angles]
        ):
            operation = tape.operations[value]
            leaf = (operation.name, int(operation.number)) if not operation.operands else None
            if tape.rate(value) == LOOP:
                known = rows.get(leaf) if leaf else None
                named[value] = known or printed(double, operation, named, self.tables)
        for value in layout.constants:
            self._put(self._narrowed(named[value], double), slots[f"constant {value}"], self.vector)
        unit = named.operand(double, program.unit)
        self._put(unit, slots["unit"], double)
        for i, value in enumerate(program.angles):
            self._put(named.operand(double, value), slots[f"angle {i}"], double)
        if program.step.last:
            self._put(double.divide(rows["begin", 0], unit), slots["begin"], double)
        for name in ("time", "until"):
            self._put(double.constant(0.0), slots[name], double)
        for i, value in enumerate(program.start):
            start = named.operand(double, value)
            self._put(self._narrowed(start, double), slots[f"state {i}"], self.vector)
        for name in layout.left:
            if not name.startswith("state"):
                begun = -HUGE[layout.bits] if name.startswith("maximum") else 0.0
                self._put(self.vector.constant(begun), slots[name], self.vector)

    def _aim(self, g: str, segment: str) -> None:
        """Let the loops that have come so far go on to the segment's end."""
        slots, double = self._slots(g), self.double
        goal = self._goal(slots, self.flow.whole("add", segment, 1))
        time, runs = self._load(slots["time"], double), self._arrived(slots, segment)
        self._put(double.select(runs, goal, time), slots["until"], double)

    def _goal(self, slots: dict[str, str], segments: str) -> str:
        """Return the end of so many segments in units of H."""
        double, plain = self.double, self.plain
        done, count = (plain.value(f"uitofp i64 {n} to double") for n in (segments, "%segments"))
        end = spread(double, plain.multiply("%end", plain.divide(done, count)))
        return double.divide(end, self._load(slots["unit"], double))

    def _arrived(self, slots: dict[str, str], segments: str) -> str:
        """Return which loops have come to the end of so many segments."""
        goal = self._goal(slots, segments)
        return self.double.compare("oeq", self._load(slots["time"], self.double), goal)

    def _keep(self, vector: str, g: str, segment: str) -> None:
        """Keep the states of the loops that still run, NaN for the others."""
        slots, flow, count = self._slots(g), self.flow, len(self.program.step.states)
        runs = self._arrived(slots, segment)
        shift = flow.whole("mul", flow.whole("mul", segment, count), "%stride")
        base = flow.at("%kept", shift, self.vector.element)
        for i in range(count):
            state = self._load(slots[f"state {i}"], self.vector)
            shown = self.vector.select(runs, state, self.vector.constant(float("nan")))
            address = self._row(base, i, vector, self.vector.element)
            self._store(shown, address, self.vector)

    def _finish(self, vector: str, g: str) -> None:
        slots, double = self._slots(g), self.double
        unit, time = (self._load(slots[name], double) for name in ("unit", "time"))
        rows = [self._widened(self._load(slots[name], self.vector)) for name in self.layout.left]
        rows = [
            double.multiply(row, unit) if name.startswith(TIMES) else row
            for name, row in zip(self.layout.left, rows, strict=True)
        ]
        completed = double.select(
            self._arrived(slots, "%segments"), double.constant(1.0), double.constant(0.0)
        )
        for row, value in enumerate([*rows, double.multiply(time, unit), completed]):
            self._store(value, self._row("%out", row, vector, "double"), double)

    # --- a step -------------------------------------------------------------------------------

    def _step(self, g: str) -> str:
        """Take one step of a vector of loops; return whether one of them has more to do."""
        begun = len(self.vector.lines)
        tape, vector, double, slots = self.tape, self.vector, self.double, self._slots(g)
        step = self.program.step
        time, until = (self._load(slots[name], double) for name in ("time", "until"))
        remaining = double.subtract(until, time)
        named = Names(tape, self._leaves(slots, time), fallback=self._fetch(slots))
        if step.part is None:
            part, whole = vector.constant(1.0), double.constant(1.0)
            last = double.compare("olt", remaining, double.constant(LAST))
            long = double.compare("ogt", remaining, double.constant(0.0))
        else:
            self._compute(named, tape.needed([step.part]))
            wished = self._widened(named[step.part])
            last = double.compare("oge", wished, remaining)
            part = self._narrowed(double.select(last, remaining, wished), double)
            whole = self._widened(part)
            long = double.compare("oge", wished, double.constant(SHORTEST))
        named.update({v: part for v, o in enumerate(tape.operations) if o.name == "part"})
        self._compute(named, tape.needed([*step.outputs(), *self.program.guards]))
        runs = double.compare("olt", time, until)
        going = self._going(named, double.both(runs, long))
        after = double.select(last, until, double.add(time, whole))
        after = double.select(going, after, time)
        left = double.select(double.either(going, self._not(runs)), until, time)
        self._put(after, slots["time"], double)
        self._put(left, slots["until"], double)
        self.flops = float(sum(map(_arithmetic, self.vector.lines[begun:])))
        if step.last:
            self._window(slots, named, going, after)
        self._watch(slots, named, going, time)
        return self.flow.any(self.double.compare("olt", after, left), self.layout.width)

    def _not(self, mask: str) -> str:
        ones = "true" if self.layout.width == 1 else "splat (i1 true)"
        return self.plain.value(f"xor {self.vector.masks} {mask}, {ones}")

    def _leaves(self, slots: dict[str, str], time: str) -> dict[int, str]:
        """Return the values that a step begins with: states, time, sines and cosines."""
        vector, double = self.vector, self.double
        found: dict[int, str] = {}
        waves: dict[int, tuple[str, str]] = {}
        for value in self.layout.inside:
            operation = self.tape.operations[value]
            index = int(operation.number)
            if operation.name == "state":
                found[value] = self._load(slots[f"state {index}"], vector)
            elif operation.name in ("sine", "cosine"):
                if index not in waves:
                    waves[index] = self._wave(self._load(slots[f"angle {index}"], double), time)
                found[value] = waves[index][operation.name == "cosine"]
            elif operation.name == "time":
                seconds = double.multiply(time, self._load(slots["unit"], double))
                found[value] = self._narrowed(seconds, double)
            elif operation.name == "left":
                left = double.subtract(self._load(slots["begin"], double), time)
                found[value] = self._narrowed(left, double)
        return found

    def _wave(self, angle: str, time: str) -> tuple[str, str]:
        """Return sin and cos of angle · time; in single precision reduced to ±π before."""
        double = self.double
        whole = double.multiply(angle, time)
        if self.layout.bits == 64:
            return sincos(double, whole)
        rest = double.fma(angle, time, double.negative(whole))
        turns = double.rounded(double.multiply(whole, double.constant(1 / TWO_PI[0])))
        reduced = double.fma(turns, double.constant(-TWO_PI[0]), whole)
        reduced = double.fma(turns, double.constant(-TWO_PI[1]), double.add(reduced, rest))
        return sincos(self.vector, self._narrowed(reduced, double))

    def _fetch(self, slots: dict[str, str]):
        """Return a function that loads what is the same for all steps where it is first needed."""
        places = {value: place for place, value in enumerate(self.layout.uniform)}

        def fetched(value: int) -> str:
            if value not in places:
                return self._load(slots[f"constant {value}"], self.vector)
            element = self.vector.element
            number = self.plain.value(f"load {element}, ptr {self._shared(places[value])}, align 4")
            return spread(self.vector, number)

        return fetched

    def _compute(self, named: Names, values: Sequence[int]) -> None:
        inside = set(self.layout.inside)
        for value in values:
            if value in inside and value not in named:
                named[value] = printed(self.vector, self.tape.operations[value], named, self.tables)

    def _going(self, named: Names, going: str) -> str:
        """Return which loops have taken the step: their states are finite and on every table."""
        vector = self.vector
        limit = vector.constant(HUGE[vector.bits])
        states = [named.operand(vector, value) for value in self.program.step.states]
        size = reduce(vector.add, map(vector.absolute, states))  # NaN if one is
        going = vector.both(going, vector.compare("olt", size, limit))
        for value in self.program.guards:
            guard = named.operand(vector, value)
            going = vector.both(going, vector.compare("oge", guard, vector.constant(0.0)))
        return going

    def _watch(self, slots: dict[str, str], named: Names, going: str, time: str) -> None:
        """Update what the loops that have taken the step have become and shown."""
        vector, step = self.vector, self.program.step
        changed: dict[str, str] = {}
        for i, value in enumerate(step.states):
            changed[f"state {i}"] = named.operand(vector, value)
        steps = self._load(slots["steps"], vector)
        changed["steps"] = vector.add(steps, vector.constant(1.0))
        for i, value in enumerate(step.means):
            total = self._load(slots[f"mean {i}"], vector)
            changed[f"mean {i}"] = vector.add(total, named.operand(vector, value))
        for i, value in enumerate(step.maxima):
            largest = self._load(slots[f"maximum {i}"], vector)
            value = named.operand(vector, value)
            changed[f"maximum {i}"] = vector.select(
                vector.compare("ogt", value, largest), value, largest
            )
        for i, value in enumerate(step.beyond):
            look = named.operand(vector, value)
            seen = vector.compare("oge", look, vector.constant(0.0))
            when = vector.add(self._narrowed(time, self.double), look)
            before = self._load(slots[f"beyond {i}"], vector)
            changed[f"beyond {i}"] = vector.select(seen, when, before)
        for name, value in changed.items():
            before = self._load(slots[name], vector)
            self._put(vector.select(going, value, before), slots[name], vector)

    def _window(self, slots: dict[str, str], named: Names, going: str, after: str) -> None:
        """Add up what the last window asks for, if a loop of the vector has come to it."""
        vector, double, step = self.vector, self.double, self.program.step
        late = double.compare("ogt", after, self._load(slots["begin"], double))
        with self.flow.where(self.flow.any(late, self.layout.width)):
            there = named.copy()
            self._compute(there, self.tape.needed(step.last))
            for i, value in enumerate(step.last):
                before = self._load(slots[f"last {i}"], vector)
                total = vector.add(before, there.operand(vector, value))
                self._put(vector.select(going, total, before), slots[f"last {i}"], vector)


def _arithmetic(line: str) -> int:
    """Return the additions, multiplications, divisions and roots of an instruction, per loop."""
    _, _, text = line.partition(" = ")
    if text.startswith(("fadd", "fsub", "fmul", "fdiv")):
        return 1
    return 2 if "@llvm.fma" in text else 1 if "@llvm.sqrt" in text else 0
