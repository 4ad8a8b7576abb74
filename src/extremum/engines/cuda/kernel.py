"""A program as the Python text of a CUDA kernel: one thread a loop, its state in registers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Final

from ..lanes.frame import HUGE, LAST, SHORTEST, TAIL, TIMES, TWO_PI, UNCAPPED, WIDE, Frame
from ..lanes.program import Program
from ..lanes.tape import LOOP, STEP, UNIFORM
from .printing import Statements

ARGUMENTS: Final = "end, segments, wide, given, columns, out, kept"
"""t_end (s); segments of the run; what is the same for all loops, in double precision and in that
of the states; rows of what varies; rows of what is left at the end; states at the beginning of
every segment and at the end, (segments + 1, states, n), or a single number where none are kept."""

ROUNDING: Final = 1.5 * 2.0**52
"""Added to a number and taken away again, it leaves the nearest whole number."""


class Kernel:
    """Writes the function ``run``; see `ARGUMENTS`.

    Times, in units of H, and angles are double precision numbers whatever the states are.

    Parameters
    ----------
    program
        What runs.
    swept
        The parameters that vary from loop to loop.
    bits
        Of the states: 64 or 32.
    """

    def __init__(self, program: Program, swept: Sequence[int], bits: int) -> None:
        self.program, self.tape, self.bits = program, program.tape, bits
        self.frame = Frame(program, tuple(swept))
        self.first = Statements(self.tape, "w", 64)
        self.step = Statements(self.tape, "v", bits)
        self.number = self.step.number
        tape, begun = self.tape, self._begun()
        used = {operand for value in begun for operand in tape.operations[value].operands}
        used |= {*program.start, program.unit, *program.angles}
        self.wide = [v for v in sorted(used) if tape.rate(v) == UNIFORM and tape.known(v) is None]
        self.first.known |= {value: f"wide{value}" for value in self.wide}
        self.given = self.frame.uniform
        self.step.known |= {value: f"given{value}" for value in self.given}

    def _begun(self) -> list[int]:
        """Return what varies with the loop only, in order."""
        program = self.program
        wanted = [*self.frame.constants, *program.start, program.unit, *program.angles]
        return [v for v in self.tape.needed(wanted) if self.tape.rate(v) == LOOP]

    @cached_property
    def text(self) -> str:
        """The function."""
        states = range(len(self.program.step.states))
        kept = [f"kept[{{}}, {i}, lane] = x{i} if alive else {self.number}(nan)" for i in states]
        begun, step = self._begin(), self._step()
        return "\n".join(
            [
                f"def run({ARGUMENTS}):",
                *_indented(
                    "lane = cuda.grid(1)",
                    "if lane >= out.shape[1]:",
                    "    return",
                    *(f"wide{value} = wide[{place}]" for place, value in enumerate(self.wide)),
                    *(f"given{value} = given[{place}]" for place, value in enumerate(self.given)),
                    *self.first.named(),
                    *self.step.named(),
                    *begun,
                    "time, steps, alive = 0.0, 0, True",
                    "for segment in range(segments):",
                    "    if kept.shape[0] > 1:",
                    *_indented(*(line.format("segment") for line in kept), depth=2),
                    "    if alive:",
                    "        until = end * ((segment + 1) / segments) / unit",
                    "        while time < until:",
                    *_indented(*step, depth=3),
                    "if kept.shape[0] > 1:",
                    *_indented(*(line.format("segments") for line in kept)),
                    *self._finish(),
                ),
            ]
        )

    def _begin(self) -> list[str]:
        """Compute what varies with the loop only, and how it starts."""
        tape, program, frame, lines = self.tape, self.program, self.frame, []
        for value in self._begun():
            operation = tape.operations[value]
            leaf = (operation.name, int(operation.number))
            if not operation.operands and leaf in frame.columns:
                self.first.known[value] = f"w{value}"
                lines.append(f"w{value} = columns[{frame.columns[leaf]}, lane]")
            else:
                lines += self.first.computed([value])
        for value in frame.constants:
            self.step.known[value] = f"c{value}"
            lines.append(f"c{value} = {self.number}({self.first.name(value)})")
        lines.append(f"unit = {self.first.name(program.unit)}")
        for i, value in enumerate(program.angles):
            lines.append(f"angle{i} = {self.first.name(value)}")
        if program.step.last:
            row = frame.columns["begin", 0]
            lines.append(f"begin = columns[{row}, lane] / unit")
        for i, value in enumerate(program.start):
            lines.append(f"x{i} = {self.number}({self.first.name(value)})")
        for name in frame.left[1:]:
            if not name.startswith("state"):
                begun = -HUGE[self.bits] if name.startswith("maximum") else 0.0
                number = repr(begun) if name.startswith(WIDE) else self.step.literal(begun)
                lines.append(f"{_variable(name)} = {number}")
        if frame.tries_again:
            lines.append(f"cap = {UNCAPPED!r}")
        return lines

    def _step(self) -> list[str]:
        """Take one step, or end the loop where it goes nowhere."""
        step, text = self.program.step, self.step
        wanted = [*step.outputs(), *self.program.guards]
        return [
            *self._leaves(),
            *self._length(),
            *text.computed(self._inside(wanted)),
            f"alive = {self._going()}",
            "if not alive:",
            "    break",
            *self._retried(),
            *self._watched(),
            "time = after",
            "steps += 1",
            *(f"x{i} = {text.name(value)}" for i, value in enumerate(step.states)),
        ]

    def _retried(self) -> list[str]:
        """Try a step that left the field's domain again with half of it."""
        if not self.frame.tries_again:
            return []
        guards = " & ".join(self._guards())
        tried = [f"if not ({guards}):", "    cap = 0.5 * float64(part)", "    continue"]
        return [*tried, "cap *= 2.0"]

    def _guards(self) -> list[str]:
        zero = self.step.literal(0.0)
        return [f"({self.step.name(value)} >= {zero})" for value in self.program.guards]

    def _inside(self, wanted: Iterable[int]) -> list[int]:
        return [v for v in self.tape.needed(wanted) if self.tape.rate(v) == STEP]

    def _length(self) -> list[str]:
        """Choose the step: ``part`` of H, which ends at ``after``; `last` is the segment's last."""
        step, text, lines = self.program.step, self.step, ["remaining = until - time"]
        if step.part is None:
            lines += [f"last = remaining < {LAST!r}", "after = until if last else time + 1.0"]
        else:
            lines += text.computed(self._inside([step.part]))
            lines += [
                f"wished = float64({text.name(step.part)})",
                *(["wished = min(wished, cap)"] if self.frame.tries_again else []),
                "last = wished >= remaining",
                f"part = {self.number}(remaining if last else wished)",
                "after = until if last else time + float64(part)",
            ]
        whole = text.literal(1.0) if step.part is None else "part"
        text.known |= {v: whole for v, o in enumerate(self.tape.operations) if o.name == "part"}
        return lines

    def _leaves(self) -> list[str]:
        """Name what a step begins with: states, time, sines and cosines."""
        lines: list[str] = []
        for value in self.frame.inside:
            operation = self.tape.operations[value]
            index = int(operation.number)
            if operation.operands:
                continue
            if operation.name == "state":
                self.step.known[value] = f"x{index}"
            elif operation.name in ("sine", "cosine"):
                if f"sine{index}" not in self.step.known.values():
                    lines += self._wave(index)
                self.step.known[value] = f"{operation.name}{index}"
            elif operation.name == "time":
                self.step.known[value] = "seconds"
                lines.append(f"seconds = {self.number}(time * unit)")
            elif operation.name == "left":
                self.step.known[value] = "left"
                lines.append(f"left = {self.number}(begin - time)")
        return lines

    def _wave(self, i: int) -> list[str]:
        """Compute sin and cos of angle · time, reduced in double precision to ±π."""
        return [
            f"turned = angle{i} * time",
            f"rest = cuda.fma(angle{i}, time, -turned)",
            f"turns = (turned * {1 / TWO_PI[0]!r} + {ROUNDING!r}) - {ROUNDING!r}",
            f"reduced = cuda.fma(turns, {-TWO_PI[0]!r}, turned) + rest",
            f"reduced{i} = {self.number}(cuda.fma(turns, {-TWO_PI[1]!r}, reduced))",
            f"sine{i} = {self.number}(math.sin(reduced{i}))",
            f"cosine{i} = {self.number}(math.cos(reduced{i}))",
        ]

    def _going(self) -> str:
        """Return whether the step goes somewhere: states are finite and on every table."""
        text, program = self.step, self.program
        limit = text.literal(HUGE[self.bits])
        conditions = [] if program.step.part is None else [f"(wished >= {SHORTEST!r})"]
        conditions += [f"(abs({text.name(value)}) < {limit})" for value in program.step.states]
        if not self.frame.tries_again:
            conditions += self._guards()
        return " & ".join(conditions)

    def _watched(self) -> list[str]:
        """Update what the loop has shown."""
        step, text, lines = self.program.step, self.step, []
        if step.last:
            inner = text.computed(self._inside(step.last))
            inner += [
                f"last{i} += float64({text.name(value)})" for i, value in enumerate(step.last)
            ]
            lines += ["if after > begin:", *_indented(*inner)]
        lines += [f"mean{i} += float64({text.name(value)})" for i, value in enumerate(step.means)]
        for i, value in enumerate(step.maxima):
            seen = text.name(value)
            lines.append(f"maximum{i} = {seen} if {seen} > maximum{i} else maximum{i}")
        for i, value in enumerate(step.beyond):
            look = text.name(value)
            lines.append(f"if {look} >= {text.literal(0.0)}:")
            lines.append(f"    beyond{i} = {self.number}(time) + {look}")
        return lines

    def _finish(self) -> list[str]:
        rows: list[str] = []
        for name in self.frame.left:
            row = f"float64({_variable(name)})"
            rows.append(f"{row} * unit" if name.startswith(TIMES) else row)
        rows += ["time * unit", "1.0 if alive else 0.0"]
        return [f"out[{row}, lane] = {value}" for row, value in enumerate(rows)]

    @property
    def names(self) -> tuple[str, ...]:
        """The rows of what is left at the end."""
        return (*self.frame.left, *TAIL)


def _variable(name: str) -> str:
    """Return the local variable of a row of what is left: "state 1" is x1."""
    return name.replace("state", "x").replace(" ", "")


def _indented(*lines: str, depth: int = 1) -> list[str]:
    return ["    " * depth + line for line in lines]
