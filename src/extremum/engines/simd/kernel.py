"""A program as an LLVM module: blocks of loops in the cache, a vector of loops at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from types import MappingProxyType
from typing import Final

from ..lanes.frame import HUGE, LAST, SHORTEST, TIMES, TWO_PI, UNCAPPED, WIDE
from ..lanes.program import Program
from ..lanes.tape import LOOP, UNIFORM
from .layout import Layout
from .mathematics import sincos
from .memory import Memory
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
        self.memory = Memory(self.layout)
        self.vector, self.double = self.memory.vector, self.memory.double
        self.plain, self.flow = self.memory.plain, self.memory.flow
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
            number = self.memory.narrowed(self.single[value], plain)
            plain.line(
                f"store {self.vector.element} {number}, ptr {self.memory.shared(place)}, align 4"
            )
        flow = self.flow
        more = flow.whole("add", "%vectors", layout.vectors - 1)
        plain.line(f"%blocks = udiv i64 {more}, {layout.vectors}")

    def _uniform(self, value: int) -> str:
        operation = self.tape.operations[value]
        if operation.name == "value":
            return self.memory.load(
                self.flow.at("%values", int(operation.number), "double"), self.plain
            )
        return printed(self.plain, operation, self.single, self.tables)

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
        slots, double = self.memory.slots(g), self.double
        rows = {
            leaf: self.memory.load(self.memory.row("%columns", row, vector, "double"), double, 8)
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
            self.memory.put(
                self.memory.narrowed(named[value], double), slots[f"constant {value}"], self.vector
            )
        unit = named.operand(double, program.unit)
        self.memory.put(unit, slots["unit"], double)
        for i, value in enumerate(program.angles):
            self.memory.put(named.operand(double, value), slots[f"angle {i}"], double)
        if program.step.last:
            self.memory.put(double.divide(rows["begin", 0], unit), slots["begin"], double)
        for name in ("time", "until"):
            self.memory.put(double.constant(0.0), slots[name], double)
        for i, value in enumerate(program.start):
            start = named.operand(double, value)
            self.memory.put(self.memory.narrowed(start, double), slots[f"state {i}"], self.vector)
        for name in layout.left:
            if not name.startswith("state"):
                begun = -HUGE[layout.bits] if name.startswith("maximum") else 0.0
                emitter = self.memory.precision(name)
                self.memory.put(emitter.constant(begun), slots[name], emitter)
        if layout.tries_again:
            self.memory.put(self.vector.constant(UNCAPPED), slots["cap"], self.vector)

    def _aim(self, g: str, segment: str) -> None:
        """Let the loops that have come so far go on to the segment's end."""
        slots, double = self.memory.slots(g), self.double
        goal = self._goal(slots, self.flow.whole("add", segment, 1))
        time, runs = self.memory.load(slots["time"], double), self._arrived(slots, segment)
        self.memory.put(double.select(runs, goal, time), slots["until"], double)

    def _goal(self, slots: dict[str, str], segments: str) -> str:
        """Return the end of so many segments in units of H, whole where every step is H."""
        double, plain = self.double, self.plain
        done, count = (plain.value(f"uitofp i64 {n} to double") for n in (segments, "%segments"))
        end = spread(double, plain.multiply("%end", plain.divide(done, count)))
        goal = double.divide(end, self.memory.load(slots["unit"], double))
        return double.rounded(goal) if self.program.step.part is None else goal

    def _arrived(self, slots: dict[str, str], segments: str) -> str:
        """Return which loops have come to the end of so many segments."""
        goal = self._goal(slots, segments)
        return self.double.compare("oeq", self.memory.load(slots["time"], self.double), goal)

    def _keep(self, vector: str, g: str, segment: str) -> None:
        """Keep the states of the loops that still run, NaN for the others."""
        slots, flow, count = self.memory.slots(g), self.flow, len(self.program.step.states)
        runs = self._arrived(slots, segment)
        shift = flow.whole("mul", flow.whole("mul", segment, count), "%stride")
        base = flow.at("%kept", shift, self.vector.element)
        for i in range(count):
            state = self.memory.load(slots[f"state {i}"], self.vector)
            shown = self.vector.select(runs, state, self.vector.constant(float("nan")))
            address = self.memory.row(base, i, vector, self.vector.element)
            self.memory.store(shown, address, self.vector)

    def _finish(self, vector: str, g: str) -> None:
        slots, double = self.memory.slots(g), self.double
        unit, time = (self.memory.load(slots[name], double) for name in ("unit", "time"))
        rows = [
            self.memory.load(slots[name], double)
            if name.startswith(WIDE)
            else self.memory.widened(self.memory.load(slots[name], self.vector))
            for name in self.layout.left
        ]
        rows = [
            double.multiply(row, unit) if name.startswith(TIMES) else row
            for name, row in zip(self.layout.left, rows, strict=True)
        ]
        completed = double.select(
            self._arrived(slots, "%segments"), double.constant(1.0), double.constant(0.0)
        )
        for row, value in enumerate([*rows, double.multiply(time, unit), completed]):
            self.memory.store(value, self.memory.row("%out", row, vector, "double"), double)

    # --- a step -------------------------------------------------------------------------------

    def _step(self, g: str) -> str:
        """Take one step of a vector of loops; return whether one of them has more to do."""
        begun = len(self.vector.lines)
        tape, vector, double, slots = self.tape, self.vector, self.double, self.memory.slots(g)
        step = self.program.step
        time, until = (self.memory.load(slots[name], double) for name in ("time", "until"))
        remaining = double.subtract(until, time)
        named = Names(tape, self._leaves(slots, time), fallback=self._fetch(slots))
        if step.part is None:
            part, whole = vector.constant(1.0), double.constant(1.0)
            last = double.compare("olt", remaining, double.constant(LAST))
            long = double.compare("ogt", remaining, double.constant(0.0))
        else:
            self._compute(named, tape.needed([step.part]))
            longest = named[step.part]
            if self.layout.tries_again:
                cap = self.memory.load(slots["cap"], vector)
                shorter = vector.compare("olt", cap, longest)
                longest = vector.select(shorter, cap, longest)
            wished = self.memory.widened(longest)
            last = double.compare("oge", wished, remaining)
            part = self.memory.narrowed(double.select(last, remaining, wished), double)
            whole = self.memory.widened(part)
            long = double.compare("oge", wished, double.constant(SHORTEST))
        named.update({v: part for v, o in enumerate(tape.operations) if o.name == "part"})
        self._compute(named, tape.needed([*step.outputs(), *self.program.guards]))
        runs = double.compare("olt", time, until)
        sound = self._sound(named, double.both(runs, long))
        going = self._inside(named, sound)
        after = double.select(last, until, double.add(time, whole))
        after = double.select(going, after, time)
        stays = going
        if self.layout.tries_again:
            self._cap(slots, going, sound, part)
            stays = sound
        left = double.select(double.either(stays, self._not(runs)), until, time)
        self.memory.put(after, slots["time"], double)
        self.memory.put(left, slots["until"], double)
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
                found[value] = self.memory.load(slots[f"state {index}"], vector)
            elif operation.name in ("sine", "cosine"):
                if index not in waves:
                    waves[index] = self._wave(
                        self.memory.load(slots[f"angle {index}"], double), time
                    )
                found[value] = waves[index][operation.name == "cosine"]
            elif operation.name == "time":
                seconds = double.multiply(time, self.memory.load(slots["unit"], double))
                found[value] = self.memory.narrowed(seconds, double)
            elif operation.name == "step":
                found[value] = self.memory.narrowed(time, double)
            elif operation.name == "left":
                left = double.subtract(self.memory.load(slots["begin"], double), time)
                found[value] = self.memory.narrowed(left, double)
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
        return sincos(self.vector, self.memory.narrowed(reduced, double))

    def _fetch(self, slots: dict[str, str]):
        """Return a function that loads what is the same for all steps where it is first needed."""
        places = {value: place for place, value in enumerate(self.layout.uniform)}

        def fetched(value: int) -> str:
            if value not in places:
                return self.memory.load(slots[f"constant {value}"], self.vector)
            element = self.vector.element
            number = self.plain.value(
                f"load {element}, ptr {self.memory.shared(places[value])}, align 4"
            )
            return spread(self.vector, number)

        return fetched

    def _compute(self, named: Names, values: Sequence[int]) -> None:
        inside = set(self.layout.inside)
        for value in values:
            if value in inside and value not in named:
                named[value] = printed(self.vector, self.tape.operations[value], named, self.tables)

    def _sound(self, named: Names, going: str) -> str:
        """Return which loops have finite states after the step."""
        vector = self.vector
        limit = vector.constant(HUGE[vector.bits])
        states = [named.operand(vector, value) for value in self.program.step.states]
        size = reduce(vector.add, map(vector.absolute, states))  # NaN if one is
        return vector.both(going, vector.compare("olt", size, limit))

    def _inside(self, named: Names, going: str) -> str:
        """Return which loops have taken the step: the field has a value there."""
        vector = self.vector
        for value in self.program.guards:
            guard = named.operand(vector, value)
            going = vector.both(going, vector.compare("oge", guard, vector.constant(0.0)))
        return going

    def _cap(self, slots: dict[str, str], going: str, sound: str, part: str) -> None:
        """Halve the step that left the field's domain; let it grow again afterwards."""
        vector = self.vector
        cap = self.memory.load(slots["cap"], vector)
        halved = vector.multiply(part, vector.constant(0.5))
        grown = vector.select(going, vector.multiply(cap, vector.constant(2.0)), cap)
        failed = vector.both(sound, self._not(going))
        self.memory.put(vector.select(failed, halved, grown), slots["cap"], vector)

    def _watch(self, slots: dict[str, str], named: Names, going: str, time: str) -> None:
        """Update what the loops that have taken the step have become and shown."""
        vector, step = self.vector, self.program.step
        changed: dict[str, str] = {}
        for i, value in enumerate(step.states):
            changed[f"state {i}"] = named.operand(vector, value)
        double = self.double
        changed["steps"] = double.add(
            self.memory.load(slots["steps"], double), double.constant(1.0)
        )
        for i, value in enumerate(step.means):
            total = self.memory.load(slots[f"mean {i}"], double)
            added = self.memory.widened(named.operand(vector, value))
            changed[f"mean {i}"] = double.add(total, added)
        for i, value in enumerate(step.maxima):
            largest = self.memory.load(slots[f"maximum {i}"], vector)
            value = named.operand(vector, value)
            changed[f"maximum {i}"] = vector.select(
                vector.compare("ogt", value, largest), value, largest
            )
        for i, value in enumerate(step.beyond):
            look = named.operand(vector, value)
            seen = vector.compare("oge", look, vector.constant(0.0))
            when = vector.add(self.memory.narrowed(time, self.double), look)
            before = self.memory.load(slots[f"beyond {i}"], vector)
            changed[f"beyond {i}"] = vector.select(seen, when, before)
        for name, value in changed.items():
            emitter = self.memory.precision(name)
            before = self.memory.load(slots[name], emitter)
            self.memory.put(emitter.select(going, value, before), slots[name], emitter)

    def _window(self, slots: dict[str, str], named: Names, going: str, after: str) -> None:
        """Add up what the last window asks for, if a loop of the vector has come to it."""
        vector, double, step = self.vector, self.double, self.program.step
        late = double.compare("ogt", after, self.memory.load(slots["begin"], double))
        with self.flow.where(self.flow.any(late, self.layout.width)):
            there = named.copy()
            self._compute(there, self.tape.needed(step.last))
            for i, value in enumerate(step.last):
                before = self.memory.load(slots[f"last {i}"], double)
                total = double.add(before, self.memory.widened(there.operand(vector, value)))
                self.memory.put(double.select(going, total, before), slots[f"last {i}"], double)


def _arithmetic(line: str) -> int:
    """Return the additions, multiplications, divisions and roots of an instruction, per loop."""
    _, _, text = line.partition(" = ")
    if text.startswith(("fadd", "fsub", "fmul", "fdiv")):
        return 1
    return 2 if "@llvm.fma" in text else 1 if "@llvm.sqrt" in text else 0
