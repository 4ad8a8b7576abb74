"""Random tapes, printed as C and Python, against an interpreter of tapes in NumPy."""

from __future__ import annotations

import ctypes
import keyword
import math
import re

import numpy as np
import pytest
from building import WARNINGS, compiled, needs, same

from extremum.deploy import c99, micropython
from extremum.deploy.machine import Machine, Oscillator
from extremum.deploy.naming import KEYWORDS
from extremum.deploy.statements import LONGEST
from extremum.engines.lanes.tape import STEP, Tape
from extremum.errors import InvalidDescription

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

OPERATIONS = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "negative": lambda a: -a,
    "absolute": np.abs,
    "maximum": lambda a, b: np.where(a > b, a, b),
    "minimum": lambda a, b: np.where(a < b, a, b),
    "positive": lambda x, a, b: np.where(x > 0, a, b),
}
DIVIDING = {**OPERATIONS, "divide": lambda a, b: a / b, "sqrt": np.sqrt}
REALS = {64: np.float64, 32: np.float32}
INCREMENT = 0x9E3779B97F4A7C15
STATES = ("eta", "v1", "double", "x^*", "self")
COUNT = 512


def drawn(seed: int, precision: int, operations: dict) -> Machine:
    """Return a machine of random operations on a sample, a phase, states and constants."""
    random, tape = np.random.default_rng(seed), Tape()
    values = [tape.leaf("sample", 0, STEP), tape.leaf("turn", 0, STEP)]
    values += [tape.leaf("state", i, STEP) for i, _ in enumerate(STATES)]
    values += [tape.constant(x) for x in (-1.5, 1 / 3, 1e-7, -0.0, 2.0**-64, 12345.678)]
    while len(values) < 60:
        name = random.choice([*operations])
        recent = values[-12:] if random.random() < 0.7 else values
        operands = [int(random.choice(recent)) for _ in range(_arity(name))]
        direct = name in ("add", "subtract", "multiply", "divide", "negative")
        value = getattr(tape, name)(*operands) if direct else tape.call(name, *operands)
        values.append(value)
    start = Tape.constant(tape, 0.25)
    return Machine(
        dt=1e-3,
        precision=precision,
        tape=tape,
        oscillators=(Oscillator("phase", INCREMENT),),
        states=STATES,
        start=(values[0], start, start, tape.constant(-3.0), start),
        following=tuple(values[-5:]),
        output_names=("u_x", "u_y"),
        outputs=(values[-6], values[-7]),
        clocks=(),
        units=dict.fromkeys((*STATES, "u_x", "u_y"), "m/s^2 */ %"),
        signals={values[40]: "xi"},
    )


def _arity(name: str) -> int:
    return {"positive": 3, "negative": 1, "absolute": 1, "sqrt": 1}.get(name, 2)


def interpreted(machine: Machine, operations: dict, leaves: dict) -> dict:
    """Return the values of a machine's tape, operation by operation."""
    real, found = REALS[machine.precision], {}
    with np.errstate(all="ignore"):
        for value in machine.needed():
            operation = machine.tape.operations[value]
            if operation.name == "constant":
                found[value] = np.full(COUNT, operation.number, real)
            elif not operation.operands:
                found[value] = leaves[operation.name, int(operation.number)]
            else:
                found[value] = operations[operation.name](*(found[a] for a in operation.operands))
    return found


def inputs(seed: int, real: type) -> dict:
    """Return numbers for the leaves: random bits as well as ordinary ones."""
    random = np.random.default_rng(seed)
    bits = np.int64 if real is np.float64 else np.int32
    leaves = {}
    for leaf in [("sample", 0), *(("state", i) for i, _ in enumerate(STATES))]:
        wild = random.integers(np.iinfo(bits).min, np.iinfo(bits).max, COUNT, bits).view(real)
        tame = random.standard_normal(COUNT).astype(real)
        rare = random.choice(np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1.0], real), COUNT)
        leaves[leaf] = np.choose(random.integers(0, 4, COUNT), [wild, tame, tame, rare])
    return leaves


@pytest.mark.parametrize(
    "flags", [("-O0",), ("-O3", "-march=native", "-ffp-contract=off")], ids=len
)
@pytest.mark.parametrize("precision", [64, 32])
def test_c_does_every_operation_in_the_order_of_the_tape(precision, flags, tmp_path):
    gcc, real = needs("gcc"), REALS[precision]
    for seed in range(6):
        machine = drawn(seed, precision, DIVIDING)
        source = tmp_path / f"made{seed}.c"
        text = c99.header(machine, "made", (0.0, 0.0), ["not the end: */ int x; ω ??/"])
        assert text.isascii()
        source.write_text(f"#define MADE_IMPLEMENTATION\n{text}")
        library = source.with_suffix(".so")
        compiled(
            [gcc, "-std=c99", *WARNINGS, *flags, "-shared", "-fPIC", source, "-o", library, "-lm"]
        )
        step = ctypes.CDLL(str(library)).made_step
        number = ctypes.c_float if precision == 32 else ctypes.c_double
        step.argtypes = [ctypes.c_void_p, number, ctypes.c_void_p]
        leaves = inputs(seed, real)
        phases = np.random.default_rng(seed).integers(-(2**63), 2**63, COUNT)
        exact = phases if precision == 64 else phases >> 32
        leaves["turn", 0] = exact.astype(real) * real(2.0**-precision)
        expected = interpreted(machine, DIVIDING, leaves)
        kinds = [("phase", np.int64), *((f"s{i}", real) for i, _ in enumerate(STATES))]
        states = np.zeros(COUNT, np.dtype(kinds, align=True))
        states["phase"] = phases
        for i, _ in enumerate(STATES):
            states[f"s{i}"] = leaves["state", i]
        commands = np.empty((COUNT, 2), real)
        for k, sample in enumerate(leaves["sample", 0]):
            step(states[k:].ctypes.data, float(sample), commands[k].ctypes.data)
        for i, value in enumerate(machine.outputs):
            assert _alike(commands[:, i], expected[value])
        for i, value in enumerate(machine.following):
            assert _alike(states[f"s{i}"], expected[value])
        with np.errstate(over="ignore"):
            assert np.array_equal(
                states["phase"].view(np.uint64), phases.view(np.uint64) + np.uint64(INCREMENT)
            )


def test_python_does_too(tmp_path):
    for seed in range(6):
        machine = drawn(seed, 64, OPERATIONS)
        names: dict = {}
        exec(micropython.module(machine, (0.0, 0.0), ["a"]), names)
        leaves = inputs(seed, np.float64)
        leaves["turn", 0] = np.zeros(COUNT)
        expected = interpreted(machine, OPERATIONS, leaves)
        made = names["Controller"](1.0)
        fields = [name for name in vars(made) if name != "phase"]
        assert len(fields) == len(STATES)
        for k in range(COUNT):
            made.phase = 0
            for i, field in enumerate(fields):
                setattr(made, field, float(leaves["state", i][k]))
            sent = made.step(float(leaves["sample", 0][k]))
            for i, value in enumerate(machine.outputs):
                assert _alike(np.array(sent[i]), expected[value][k])
            for i, value in enumerate(machine.following):
                assert _alike(np.array(getattr(made, fields[i])), expected[value][k])


def _alike(a, b) -> bool:
    """Compare bits; NaN is NaN, whatever its sign."""
    number = ~np.isnan(b)
    return same(np.asarray(a)[number], np.asarray(b)[number]) and bool(
        np.array_equal(np.isnan(a), np.isnan(b))
    )


def test_lines_are_short_and_names_are_no_keywords():
    machine = drawn(1, 32, DIVIDING)
    text = c99.header(machine, "made", (0.0, 0.0), ["a"])
    assert max(map(len, text.splitlines())) <= 60 + 3 * LONGEST
    fields = re.findall(r"^    float (\w+);", text, re.MULTILINE)
    assert len(set(fields)) == len(STATES)
    assert not {*fields} & {*KEYWORDS, *keyword.kwlist, "v1", "self"}


def test_constants_keep_their_bits_and_infinity_is_a_number_of_math_h():
    for number in (0.1, 1e22, 5e-324, math.pi, -0.0, 1.7976931348623157e308):
        assert float(c99.REALS[64].number(number)) == number
    for number in (0.1, math.pi, 1e-45, 3.4028235e38):
        text = c99.REALS[32].number(number)
        assert text.endswith("f")
        assert np.float32(text[:-1]) == np.float32(number)
    assert c99.REALS[32].number(math.inf) == "INFINITY"
    with pytest.raises(InvalidDescription, match="1e\\+40 is too large for single precision"):
        c99.REALS[32].number(1e40)
