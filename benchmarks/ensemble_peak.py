"""The multiply-add peak of one core, by a kernel that does nothing else."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np

from extremum.engines.simd.compiling import Compiled
from extremum.engines.simd.emitter import Emitter

CHAINS, DEEP = 16, 8
"""Independent chains, and multiply-adds of each in one turn of the loop."""

TURNS = 2_000_000


def width(bits: int) -> int:
    """Return how many numbers a vector of 64 bytes holds."""
    return 512 // bits


def text(bits: int) -> str:
    """Return the kernel: `CHAINS` times x ← a x + b, `DEEP` times a turn, in LLVM's language."""
    emitter = Emitter(width(bits), bits)
    kind = emitter.type
    ends = [f"%x{i}" for i in range(CHAINS)]
    for _ in range(DEEP):
        ends = [emitter.fma(x, "%a", "%b") for x in ends]
    phis = [f"  %x{i} = phi {kind} [ %b, %enter ], [ {end}, %loop ]" for i, end in enumerate(ends)]
    address = [f"  %to{i} = getelementptr {kind}, ptr %out, i64 {i}" for i in range(CHAINS)]
    stores = [f"  store {kind} {end}, ptr %to{i}, align 4" for i, end in enumerate(ends)]
    return "\n".join(
        [
            "define void @peak(ptr %in, ptr %out, i64 %turns) {",
            "enter:",
            f"  %a = load {kind}, ptr %in, align 4",
            f"  %second = getelementptr {kind}, ptr %in, i64 1",
            f"  %b = load {kind}, ptr %second, align 4",
            "  br label %loop",
            "loop:",
            "  %i = phi i64 [ 0, %enter ], [ %next, %loop ]",
            *phis,
            *emitter.lines,
            "  %next = add i64 %i, 1",
            "  %more = icmp ult i64 %next, %turns",
            "  br i1 %more, label %loop, label %leave",
            "leave:",
            *address,
            *stores,
            "  ret void",
            "}",
            *emitter.intrinsics.values(),
        ]
    )


@cache
def _kernel(bits: int) -> tuple[Compiled, Any]:
    compiled = Compiled(text(bits))
    pointer = ctypes.c_void_p
    return compiled, compiled.function("peak", pointer, pointer, ctypes.c_int64)


def operations(bits: int) -> float:
    """Return the floating-point operations of one `run`."""
    return 2.0 * CHAINS * DEEP * width(bits) * TURNS


def run(bits: int) -> None:
    """Multiply and add for some hundredths of a second."""
    _, kernel = _kernel(bits)
    lanes, kind = width(bits), np.float64 if bits == 64 else np.float32
    numbers = np.concatenate([np.full(lanes, 0.5, kind), np.ones(lanes, kind)])
    out = np.empty((CHAINS, lanes), kind)
    kernel(numbers.ctypes.data, out.ctypes.data, TURNS)
    if not np.allclose(out, 2.0):
        raise SystemExit(f"the peak kernel returned {out[0, 0]}, not 2")
