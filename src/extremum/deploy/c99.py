"""A machine as one self-contained C99 header, which is C++17 too.

It needs <stdint.h>, and <math.h> where the controller takes logarithms, roots or absolute values.
Every operation is the tape's, in its order: built without contraction into fused operations, the
header computes in double precision what the Python step does, to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from ..errors import InvalidDescription
from ..sampled.adapting import LARGEST
from ..sampled.validity import LONG
from .statements import ARITHMETIC, Language, Printed, leaves_of, operations_of, spelled, statements

if TYPE_CHECKING:
    from .machine import Machine

_MATHEMATICS: Final = {"log": "log", "sqrt": "sqrt", "absolute": "fabs"}


@dataclass(frozen=True)
class Real:
    """A type of numbers in C.

    Attributes
    ----------
    name
        Of the type.
    call
        A function ``{}`` of <math.h> of ``{0}``. Where double has 32 bits, <math.h> may define
        logf as log, which is why its value is cast.
    turn
        An unsigned phase ``{0}`` as a fraction of a turn, −1/2 … 1/2.
    number
        A constant as text.
    """

    name: str
    call: str
    turn: str
    number: Callable[[float], str]


def _double(number: float) -> str:
    return "(double)INFINITY" if number == math.inf else repr(number)


def _single(number: float) -> str:
    with np.errstate(over="ignore"):
        nearest = np.float32(number)
    if np.isfinite(nearest):
        return f"{nearest!s}f"
    if number == math.inf:
        return "INFINITY"
    reason = "too large for single precision; export in double precision"
    raise InvalidDescription("", f"the constant {number:g} is {reason}")


REALS: Final[Mapping[int, Real]] = {
    64: Real("double", "{}({{0}})", f"(double)(int64_t){{0}} * {_double(2.0**-64)}", _double),
    32: Real(
        "float",
        "(float){}f({{0}})",
        f"(float)(int32_t)(uint32_t)({{0}} >> 32) * {_single(2.0**-32)}",
        _single,
    ),
}
"""Bits → type."""


def _language(real: Real) -> Language:
    zero = real.number(0.0)
    return Language(
        number=real.number,
        forms={
            **ARITHMETIC,
            "maximum": "{0} > {1} ? {0} : {1}",
            "minimum": "{0} < {1} ? {0} : {1}",
            "positive": f"{{0}} > {zero} ? {{1}} : {{2}}",
            **{name: real.call.format(called) for name, called in _MATHEMATICS.items()},
        },
        declaration=f"const {real.name} {{name}} = {{value}};",
        remark=" /* {} */",
    )


WANTED: Final = {
    "gain": ("gain_wanted", "gain_left"),
    "amplitude": ("amplitude_wanted", "amplitude_left"),
}
"""Argument of `change` → the state that it sets, and the one that keeps the factor as it is."""

VERDICTS: Final = ("SEEKING", "ARRIVED", "LOST")
"""What `status` returns, by number."""


_SEPARATE: Final = ("#ifdef __clang__", "#pragma STDC FP_CONTRACT OFF", "#endif")
"""What tells Clang to round after every operation; GCC knows no such pragma."""


def header(machine: Machine, prefix: str, safe: Sequence[float], about: Sequence[str]) -> str:
    """Return a machine as a header, in the machine's precision.

    Parameters
    ----------
    machine
        What is printed.
    prefix
        What every name begins with.
    safe
        The safe output.
    about
        Lines of the comment at the top.

    Raises
    ------
    InvalidDescription
        For a number that single precision does not have.
    """
    return _Header(machine, prefix).text(safe, about)


def changes(machine: Machine) -> bool:
    """Return whether a machine has what `change` moves."""
    return all(name in machine.states for names in WANTED.values() for name in names)


def kept(machine: Machine) -> tuple[int, ...]:
    """Return the states, by place, that `reset` leaves as they are: those that `change` moves."""
    return tuple(i for i, name in enumerate(machine.states) if name.split("_")[0] in WANTED)


def mathematics(machine: Machine) -> set[str]:
    """Return the operations that <math.h> is needed for."""
    results = (*machine.start, *machine.following, *machine.outputs)
    return operations_of(machine.tape, results) & {*_MATHEMATICS}


class _Header:
    """The parts of a header."""

    def __init__(self, machine: Machine, prefix: str) -> None:
        self.machine, self.prefix, self.macro = machine, prefix, prefix.upper()
        self.real = REALS[machine.precision]
        self.language = _language(self.real)
        taken = ("self", "J", "u", "steps", "fabs", "log", "sqrt")
        self.phases, self.states, self.turns, self.leaves = spelled(machine, taken)

    def text(self, safe: Sequence[float], about: Sequence[str]) -> str:
        """Return the header."""
        guard, macro = f"{self.macro}_H", self.macro
        functions = self._functions()
        lines = [
            *_comment(about),
            *(f"#ifndef {guard}", f"#define {guard}", "", "#include <stdint.h>", ""),
            *self._macros(safe),
            *("", "#ifdef __cplusplus", 'extern "C" {', "#endif", ""),
            *self._structure(),
            "",
        ]
        for function in functions:
            lines += [*_comment(function.says), f"{function.head};", ""]
        lines += [
            *("#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {guard} */", ""),
            f"#if defined({macro}_IMPLEMENTATION) && !defined({macro}_IMPLEMENTED)",
            *(f"#define {macro}_IMPLEMENTED", ""),
        ]
        if mathematics(self.machine):
            lines += ["#include <math.h>", ""]
        for function in functions:
            lines += [function.head, "{", *(_indented(x) for x in function.body), "}", ""]
        return "\n".join([*lines, f"#endif /* {macro}_IMPLEMENTATION */", ""])

    def _macros(self, safe: Sequence[float]) -> list[str]:
        number, outputs = self.real.number, self.machine.output_names
        return [
            f"#define {self.macro}_INPUTS {len(outputs)} /* {', '.join(outputs)} */",
            f"#define {self.macro}_SAFE {{{', '.join(map(number, safe))}}} /* the safe output */",
            f"#define {self.macro}_DT {number(self.machine.dt)} /* s between two steps */",
            *(
                f"#define {self.macro}_{verdict} {i}"
                for i, verdict in enumerate(VERDICTS)
                if "status" in self.machine.states
            ),
        ]

    def _structure(self) -> list[str]:
        """Return the type of the state."""
        fields = [(f"uint64_t {phase};", "2^-64 turns") for phase in self.phases]
        fields += [
            (f"{self.real.name} {field};", self.machine.units[name])
            for field, name in zip(self.states, self.machine.states, strict=True)
        ]
        width = max(len(field) for field, _ in fields)
        rows = [f"    {field:<{width}} /* {_plain(unit)} */" for field, unit in fields]
        return ["typedef struct {", *rows, f"}} {self.prefix}_t;"]

    def _functions(self) -> list[_Function]:
        name, real, given = self.prefix, self.real.name, f"{self.prefix}_t *self"
        units = [_plain(self.machine.units[x]) for x in self.machine.output_names]
        outputs = ", ".join(
            f"{x} ({unit})" for x, unit in zip(self.machine.output_names, units, strict=True)
        )
        fields = [self.states[i] for i in kept(self.machine)]
        found = [
            _Function(
                f"void {name}_init({given}, {real} J)",
                ["Begin with a first sample; NAN or infinite: there is none yet."],
                self._init(),
            ),
            _Function(
                f"void {name}_step({given}, {real} J, {real} u[{self.macro}_INPUTS])",
                [
                    f"One step, every {self.macro}_DT: a sample in (NAN or infinite: missing),",
                    f"commands out: {outputs}.",
                ],
                self._step(),
            ),
            _Function(
                f"void {name}_reset({given}, {real} J)",
                ["Begin again" + (", with the gain and amplitude as they are." if fields else ".")],
                self._reset(fields),
            ),
            _Function(
                f"void {name}_skip({given}, uint32_t steps)",
                ["Instants at which no step ran: the dither goes on."],
                self._skip(),
            ),
        ]
        if changes(self.machine):
            found.append(self._change())
        if "status" in self.machine.states:
            field = self.states[self.machine.states.index("status")]
            head = f"int {name}_status(const {name}_t *self)"
            says = f"As of the last step: {', '.join(f'{self.macro}_{x}' for x in VERDICTS)}."
            found.append(_Function(head, [says], [f"return (int)self->{field};"]))
        return found

    def _printed(self, results: Sequence[int]) -> Printed:
        machine = self.machine
        return statements(machine.tape, results, self.leaves, self.language, machine.signals)

    def _init(self) -> list[str]:
        printed = self._printed(self.machine.start)
        used = leaves_of(self.machine.tape, self.machine.start)
        return [
            *_SEPARATE,
            *_unused(used),
            *printed.lines,
            *(f"self->{phase} = 0;" for phase in self.phases),
            *(f"self->{x} = {y};" for x, y in zip(self.states, printed.results, strict=True)),
        ]

    def _step(self) -> list[str]:
        machine = self.machine
        results = (*machine.outputs, *machine.following)
        printed = self._printed(results)
        used = leaves_of(machine.tape, results)
        commands = printed.results[: len(machine.outputs)]
        following = printed.results[len(machine.outputs) :]
        const = f"const {self.real.name}"
        return [
            *_SEPARATE,
            *_unused(used),
            *(
                f"{const} {x} = self->{x};"
                for i, x in enumerate(self.states)
                if ("state", i) in used
            ),
            *(
                f"{const} {turn} = {self.real.turn.format(f'self->{phase}')};"
                for i, (turn, phase) in enumerate(zip(self.turns, self.phases, strict=True))
                if ("turn", i) in used
            ),
            *printed.lines,
            *(f"u[{i}] = {value};" for i, value in enumerate(commands)),
            *(
                f"self->{x} = {value};"
                for x, value in zip(self.states, following, strict=True)
                if x != value
            ),
            *(
                f"self->{phase} += UINT64_C({oscillator.increment});"
                for phase, oscillator in zip(self.phases, machine.oscillators, strict=True)
            ),
        ]

    def _skip(self) -> list[str]:
        machine, real = self.machine, self.real
        clocks = [self.states[i] for i in machine.clocks]
        limit = real.number(LONG)
        return [
            *_SEPARATE,
            *(
                f"self->{phase} += steps * UINT64_C({oscillator.increment});"
                for phase, oscillator in zip(self.phases, machine.oscillators, strict=True)
            ),
            *(
                line
                for clock in clocks
                for line in (
                    f"if (self->{clock} < {limit}) {{",
                    f"    self->{clock} += ({real.name})steps;",
                    f"    self->{clock} = self->{clock} < {limit} ? self->{clock} : {limit};",
                    "}",
                )
            ),
        ]

    def _reset(self, fields: Sequence[str]) -> list[str]:
        return [
            *(f"const {self.real.name} {field} = self->{field};" for field in fields),
            f"{self.prefix}_init(self, J);",
            *(f"self->{field} = {field};" for field in fields),
        ]

    def _change(self) -> _Function:
        real, (zero, largest) = self.real.name, map(self.real.number, (0.0, LARGEST))
        lines = []
        for argument, names in WANTED.items():
            field, left = (self.states[self.machine.states.index(name)] for name in names)
            least = f"{argument} >= {zero}" if argument == "gain" else f"{argument} > {zero}"
            lines += [
                f"if ({least} && {argument} <= {largest}) {{",
                f"    self->{left} += {argument} - self->{field};",
                f"    self->{field} = {argument};",
                "}",
            ]
        return _Function(
            f"void {self.prefix}_change({self.prefix}_t *self, {real} gain, {real} amplitude)",
            [
                "Let the factors of all gains and all amplitudes, 1 at first, go over to others;",
                f"what is no such factor (NAN, negative, beyond {LARGEST:g}) leaves one as it is.",
            ],
            lines,
        )


@dataclass(frozen=True)
class _Function:
    """A function's head without braces, what it does, and the lines between the braces."""

    head: str
    says: Sequence[str]
    body: Sequence[str]


def _unused(used: set[tuple[str, int]]) -> list[str]:
    """Return what keeps compilers from asking for a sample that is not needed."""
    return [] if ("sample", 0) in used else ["(void)J;"]


def _indented(line: str) -> str:
    return line if line.startswith("#") else f"    {line}"


def _comment(lines: Sequence[str]) -> list[str]:
    """Return lines as one comment."""
    first, *rest = map(_plain, lines)
    if not rest:
        return [f"/* {first} */"]
    return [f"/* {first}", *(f" * {line}".rstrip() for line in rest), " */"]


def _plain(text: str) -> str:
    """Return a text that may stand in a comment: ASCII that does not end it."""
    ascii_only = text.encode("ascii", "backslashreplace").decode()
    return ascii_only.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
