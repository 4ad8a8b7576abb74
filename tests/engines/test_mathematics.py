"""The vector functions against extended precision, C's special values and mpmath."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from extremum.engines.simd.compiling import Compiled
from extremum.engines.simd.emitter import Emitter
from extremum.engines.simd.mathematics import FUNCTIONS, sincos
from extremum.symbols import FUNCTIONS as SYMBOLS

Numbers = NDArray[Any]
WIDE = {64: 8, 32: 16}
DTYPE = {64: np.float64, 32: np.float32}
NUMPY = {"a" + rest: "arc" + rest for rest in ("sin", "cos", "tan", "tan2", "sinh", "cosh", "tanh")}
NUMPY["pow"] = "power"
BOTH = pytest.mark.parametrize("bits", [64, 32])
ALL = pytest.mark.parametrize("name", sorted({*FUNCTIONS} - {"atan2", "pow"}))


def compiled(body: Callable[..., tuple[str, ...]], inputs: int, e: Emitter) -> Callable[..., Any]:
    """Return a function of arrays: `body` of the loaded vectors, its results stored."""

    def address(k: int) -> str:
        return e.value(f"getelementptr {e.element}, ptr %p{k}, i64 %i")

    align = f"align {e.bits // 8}"
    loaded = [e.value(f"load {e.type}, ptr {address(k)}, {align}") for k in range(inputs)]
    results = body(e, *loaded)
    for k, result in enumerate(results, start=inputs):
        e.line(f"store {e.type} {result}, ptr {address(k)}, {align}")
    pointers = ", ".join(f"ptr %p{k}" for k in range(inputs + len(results)))
    text = "\n".join(
        (
            *e.intrinsics.values(),
            f"define void @f({pointers}, i64 %n) {{",
            "entry:\n  br label %loop",
            "loop:\n  %i = phi i64 [0, %entry], [%next, %loop]",
            *e.lines,
            f"  %next = add i64 %i, {e.width}\n  %more = icmp slt i64 %next, %n",
            "  br i1 %more, label %loop, label %out",
            "out:\n  ret void\n}",
        )
    )
    module = Compiled(text)
    call = module.function("f", *[ctypes.c_void_p] * (inputs + len(results)), ctypes.c_int64)

    def function(*arrays: Any) -> Any:
        given = [np.asarray(a, DTYPE[e.bits]).ravel() for a in arrays]
        n = given[0].size
        padded = [np.concatenate([a, np.ones(-n % e.width, a.dtype)]) for a in given]
        made = [np.full_like(padded[0], 77.0) for _ in results]
        call(*(a.ctypes.data for a in (*padded, *made)), padded[0].size)
        assert module
        return made[0][:n] if len(made) == 1 else tuple(a[:n] for a in made)

    return function


@cache
def lanes(name: str, bits: int, width: int, contract: bool = False) -> Callable[..., Any]:
    inputs = 2 if name in {"atan2", "pow"} else 1
    e = Emitter(width, bits, contract=contract)
    if name == "sincos":
        return compiled(sincos, inputs, e)
    return compiled(lambda e, *x: (FUNCTIONS[name](e, *x),), inputs, e)


def reference(name: str, *x: Numbers) -> Numbers:
    """Return the function in extended precision, eleven bits more than a double has."""
    with np.errstate(all="ignore"):
        return getattr(np, NUMPY.get(name, name))(*(a.astype(np.longdouble) for a in x))


def ulps(found: Numbers, exact: Numbers) -> Numbers:
    """Return |found − exact| in units of the last place of `exact`; ∞ for a wrong ∞, NaN or ±0."""
    kind = np.finfo(found.dtype)
    with np.errstate(all="ignore"):
        nearest = exact.astype(found.dtype)
        places = np.maximum(np.frexp(exact)[1] - 1, kind.minexp) - kind.nmant
        error = np.abs(found - exact) / np.ldexp(np.longdouble(1), places)
    alike = (found == nearest) & (np.signbit(found) == np.signbit(nearest))
    alike |= np.isnan(found) & np.isnan(nearest)
    numbers = np.isfinite(found) & np.isfinite(nearest) & ((found != 0) | (nearest != 0))
    return np.where(numbers, error, np.where(alike, 0, np.inf))


def neighbours(values: Numbers) -> Numbers:
    """Return the values and, on each side, the next number of their type."""
    with np.errstate(all="ignore"):
        up, down = (np.nextafter(values, values.dtype.type(end)) for end in (np.inf, -np.inf))
    return np.concatenate([values, up, down])


@cache
def everywhere(bits: int) -> Numbers:
    """Return numbers of every magnitude, infinities and NaN, and the neighbours of edges."""
    dtype = DTYPE[bits]
    random = np.random.default_rng(1).bytes(20_000 * bits // 8)
    kind = np.finfo(dtype)
    limits = [0.0, kind.smallest_subnormal, kind.tiny, kind.max, np.inf, kind.eps]
    bends = [0.5, 1.0, 2.0, 2**0.5, 2**-0.5, math.tan(math.pi / 8), math.tan(3 * math.pi / 8)]
    scale = np.log(np.longdouble(kind.max))
    depths = [scale, -scale, np.log(np.longdouble(kind.smallest_subnormal)), scale + np.log(2)]
    powers = 2.0 ** np.arange(-60, 60)
    edges = np.concatenate([limits, bends, depths, powers]).astype(dtype)
    with np.errstate(all="ignore"):
        return np.concatenate([np.frombuffer(random, dtype), neighbours(edges), neighbours(-edges)])


def dense(bits: int, *intervals: tuple[float, float]) -> Numbers:
    """Return uniformly random numbers in each interval."""
    random = np.random.default_rng(2)
    parts = [random.uniform(low, high, 30_000) for low, high in intervals]
    return np.concatenate(parts).astype(DTYPE[bits])


FARTHEST = {64: 1e12, 32: 1e5}
INTERVALS: dict[str, tuple[tuple[float, float], ...]] = {
    "exp": ((-1, 1), (-104, 89), (-746, 710)),
    "log": ((0.5, 2), (0.98, 1.02), (0, 1000)),
    "sqrt": ((0, 4),),
    **dict.fromkeys(("sin", "cos", "tan", "sincos"), ((-7, 7), (-1e4, 1e4), (-1e5, 1e5))),
    **dict.fromkeys(("asin", "acos", "atanh"), ((-1, 1), (-0.3, 0.3), (0.4, 0.6), (0.99, 1))),
    "atan": ((-1, 1), (-10, 10), (0.4, 0.5)),
    **dict.fromkeys(("sinh", "cosh", "tanh", "asinh"), ((-1, 1), (-20, 20), (-711, 711))),
    "acosh": ((1, 1.1), (1, 2), (1, 1000)),
}

BOUNDS = {
    "sqrt": 0.501,
    "log": 0.9,
    "tanh": 2.8,
    "tan": 4.0,
    **dict.fromkeys(("exp", "pow"), 1.4),
    **dict.fromkeys(("acos", "cosh"), 1.6),
    **dict.fromkeys(("sin", "cos", "sincos", "asinh"), 1.9),
    **dict.fromkeys(("asin", "atan", "atan2", "sinh", "acosh", "atanh"), 2.5),
}
"""Above the largest errors that the module's docstring states."""


def arguments(name: str, bits: int) -> Numbers:
    x = np.concatenate([dense(bits, *INTERVALS[name]), everywhere(bits)])
    if name not in {"sin", "cos", "tan", "sincos"}:
        return x
    return x[~np.isfinite(x) | (np.abs(x) <= FARTHEST[bits])]


def test_every_function_of_the_symbols_is_there() -> None:
    assert set(FUNCTIONS) == {*SYMBOLS, "pow"}


@pytest.mark.parametrize("name", sorted({*SYMBOLS} - {"atan2"}))
def test_the_reference_itself(name: str) -> None:
    """It is close to what mpmath finds: within 2^-8 ulp of a double."""
    ends = {"acosh": (1, 20), "asin": (0, 1), "acos": (0, 1), "atanh": (0, 1)}.get(name, (0, 20))
    chosen = dense(64, ends)[:200]
    for value, near in zip(chosen.tolist(), reference(name, chosen), strict=True):
        with mpmath.workprec(120):
            exact = getattr(mpmath, name)(value)
            high = float(near)
            found = mpmath.mpf(high) + float(near - np.longdouble(high))
            assert abs(found - exact) <= abs(exact) * mpmath.mpf(2) ** -61


@BOTH
@ALL
def test_error_is_within_the_stated_bound(name: str, bits: int) -> None:
    x = arguments(name, bits)
    error = ulps(lanes(name, bits, WIDE[bits])(x), reference(name, x))
    worst = np.argmax(error)
    assert error[worst] <= BOUNDS[name], x[worst]


@BOTH
@pytest.mark.parametrize("name", [*sorted(FUNCTIONS), "sincos"])
def test_lanes_agree_bit_for_bit(name: str, bits: int) -> None:
    """Whatever the width is, and whether the emitter around fuses or not."""
    x = np.random.default_rng(3).permutation(arguments(name if name in INTERVALS else "exp", bits))
    given = (x, x[::-1]) if name in {"atan2", "pow"} else (x,)
    expected = np.asarray(lanes(name, bits, 1)(*given))
    for width, contract in ((8, False), (16, False), (WIDE[bits], True)):
        found = np.asarray(lanes(name, bits, width, contract)(*given))
        assert np.array_equal(np.isnan(found), np.isnan(expected))
        assert np.array_equal(found[~np.isnan(found)], expected[~np.isnan(expected)])
        assert np.array_equal(np.signbit(found[found == 0]), np.signbit(expected[found == 0]))


INF, NAN = math.inf, math.nan
SPECIAL: dict[str, dict[float, float]] = {
    "exp": {0.0: 1, INF: INF, -INF: 0, 1000: INF, -1000: 0},
    "log": {0.0: -INF, 1: 0, -1: NAN, INF: INF, -INF: NAN},
    "sqrt": {0.0: 0, 4: 2, -1: NAN, INF: INF},
    "sin": {0.0: 0.0, INF: NAN, -INF: NAN, 1e30: NAN},
    "cos": {0.0: 1, INF: NAN, -INF: NAN, -1e30: NAN},
    "tan": {0.0: 0, INF: NAN, 1e30: NAN},
    "asin": {0.0: 0, 1.5: NAN, INF: NAN},
    "acos": {1: 0, 1.5: NAN, -1.5: NAN, INF: NAN},
    "atan": {0.0: 0},
    "sinh": {0.0: 0, INF: INF, -INF: -INF, 1000: INF},
    "cosh": {0.0: 1, INF: INF, -INF: INF, -1000: INF},
    "tanh": {0.0: 0, INF: 1, -INF: -1, 50: 1},
    "asinh": {0.0: 0, INF: INF, -INF: -INF},
    "acosh": {1: 0, 0.5: NAN, -1e10: NAN, -INF: NAN, INF: INF},
    "atanh": {0.0: 0, 1: INF, -1: -INF, 1.5: NAN, -1.5: NAN, INF: NAN},
}


@BOTH
@ALL
def test_special_values(name: str, bits: int) -> None:
    for width in (1, WIDE[bits]):
        for x, expected in {**SPECIAL[name], NAN: NAN}.items():
            found = lanes(name, bits, width)([x])
            assert np.array_equal(found, [expected], equal_nan=True), x


@BOTH
@pytest.mark.parametrize("name", ["sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh"])
def test_odd_functions_are_odd(name: str, bits: int) -> None:
    """Exactly; −0 stays −0 and the smallest numbers stay what they are."""
    x = arguments(name, bits)
    function = lanes(name, bits, WIDE[bits])
    there, back = function(x), function(-x)
    inside = ~np.isnan(there)
    assert np.array_equal(there[inside], -back[inside])
    assert np.array_equal(np.signbit(function([-0.0, 0.0])), [True, False])
    least = np.finfo(DTYPE[bits]).smallest_subnormal * np.array([1, 2, 3, 5, 7, 1e6])
    assert np.array_equal(function(least), least)


# --- angles -----------------------------------------------------------------------------------


@BOTH
def test_sincos(bits: int) -> None:
    x = arguments("sin", bits)
    for found, name in zip(lanes("sincos", bits, WIDE[bits])(x), ("sin", "cos"), strict=True):
        assert np.max(ulps(found, reference(name, x))) <= BOUNDS["sincos"]
        assert np.nanmax(np.abs(found)) <= 1


@BOTH
@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_next_to_multiples_of_a_quarter_turn(name: str, bits: int) -> None:
    """Where a reduction that is not exact enough loses every digit."""
    turns = np.random.default_rng(4).integers(1, int(FARTHEST[bits] / 1.6), 20_000)
    with mpmath.workprec(150):
        x = np.array([float(n * mpmath.pi / 2) for n in turns.tolist()]).astype(DTYPE[bits])
    assert np.max(ulps(lanes(name, bits, WIDE[bits])(x), reference(name, x))) <= BOUNDS[name]


@BOTH
def test_angles_too_large_to_reduce_are_refused(bits: int) -> None:
    edge = DTYPE[bits](FARTHEST[bits])
    x = [edge, -edge, np.nextafter(edge, INF), -np.nextafter(edge, INF), np.finfo(edge.dtype).max]
    results = [lanes(name, bits, WIDE[bits])(x) for name in ("sin", "cos", "tan")]
    for found in (*results, *lanes("sincos", bits, WIDE[bits])(x)):
        assert np.array_equal(np.isnan(found), [False, False, True, True, True])


# --- two arguments ----------------------------------------------------------------------------


def pairs(bits: int) -> tuple[Numbers, Numbers]:
    """Return pairs of every magnitude whose quotient and power mostly are finite."""
    random, largest = np.random.default_rng(5), {64: 700.0, 32: 87.0}[bits]
    logs = random.uniform(-largest, largest, 30_000)
    near = random.uniform(-0.5, 0.5, 30_000)
    bases = np.exp(np.concatenate([logs, near, near * 1e-4]))
    exponents = random.uniform(-1, 1, bases.size) * largest / np.abs(np.log(bases))
    return bases.astype(DTYPE[bits]), exponents.astype(DTYPE[bits])


def grid(bits: int) -> tuple[Numbers, Numbers]:
    kind = np.finfo(DTYPE[bits])
    sizes = [0, kind.smallest_subnormal, kind.tiny, 0.5, 1, 1 + kind.eps, 2, 2.5, 3, 1e30]
    sizes += [2.0**kind.nmant, 2.0**kind.nmant + 1, kind.max, INF]
    signed = [*sizes, *(-size for size in sizes), NAN]
    a, b = np.array(list(product(signed, signed))).T
    return a.astype(DTYPE[bits]), b.astype(DTYPE[bits])


@BOTH
@pytest.mark.parametrize("name", ["pow", "atan2"])
def test_functions_of_two_arguments(name: str, bits: int) -> None:
    """In pairs of every magnitude and at all of C's special pairs."""
    for width, (a, b) in product((1, WIDE[bits]), (pairs(bits), grid(bits))):
        error = ulps(lanes(name, bits, width)(a, b), reference(name, a, b))
        worst = np.argmax(error)
        assert error[worst] <= BOUNDS[name], (a[worst], b[worst])


@BOTH
def test_atan2_in_every_direction(bits: int) -> None:
    a, b = np.random.default_rng(6).normal(size=(2, 100_000)).astype(DTYPE[bits])
    error = ulps(lanes("atan2", bits, WIDE[bits])(a, b), reference("atan2", a, b))
    assert np.max(error) <= BOUNDS["atan2"]


# --- the emitter's instructions -----------------------------------------------------------------


def bodies(e: Emitter, x: str, y: str) -> tuple[str, ...]:
    """Return the results of the instructions that the functions rest on."""
    whole = e.to_number(
        e.integral("ashr", e.to_integer(e.multiply(x, e.constant(4))), e.integer(1))
    )
    below = e.compare("olt", x, y)
    return (
        *(e.rounded(x), e.floor(x), e.absolute(x), e.negative(x), e.copysign(x, y)),
        *(e.minimum(x, y), e.maximum(x, y), e.root(e.absolute(x)), whole),
        e.fma(x, y, e.negative(e.multiply(x, y))),
        e.select(below, x, y),
        e.select(e.both(below, e.compare("ogt", y, e.constant(0))), x, y),
        e.select(e.either(below, e.compare("uno", y, y)), x, y),
        e.from_bits(e.integral("xor", e.as_bits(x), e.integer(1))),
        e.select(e.compare_integers("slt", e.as_bits(x), e.integer(0)), x, e.constant(0.1)),
    )


@BOTH
def test_instructions(bits: int) -> None:
    random, dtype = np.random.default_rng(7), DTYPE[bits]
    x, y = random.normal(size=(2, 1000)).astype(dtype)
    x[:8], y[:4] = [0.5, 1.5, 2.5, -0.5, -0.0, 3, -3, 1], [NAN, 0, -0.0, 1.5]
    product_error = [
        math.nan
        if math.isnan(b)
        else dtype(Fraction(a) * Fraction(b) - Fraction(float(dtype(a) * dtype(b))))
        for a, b in zip(x.tolist(), y.tolist(), strict=True)
    ]
    flipped = (x.view(f"i{bits // 8}") ^ 1).view(dtype)
    expected = (
        *(np.rint(x), np.floor(x), np.abs(x), -x, np.copysign(x, y)),
        *(np.fmin(x, y), np.fmax(x, y), np.sqrt(np.abs(x)), np.floor(np.trunc(4 * x) / 2)),
        *(product_error, np.where(x < y, x, y), np.where((x < y) & (y > 0), x, y)),
        *(np.where((x < y) | np.isnan(y), x, y), flipped),
        np.where(np.signbit(x), x, dtype(0.1)),
    )
    for width in (1, WIDE[bits]):
        found = compiled(bodies, 2, Emitter(width, bits))(x, y)
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert np.array_equal(one, other, equal_nan=True), k
