"""Many loops on the processor's vector units."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...system import System
from ..lanes import choosing, rows
from ..lanes.asked import Asked, Ended
from ..lanes.difference import check_number, check_steps
from ..lanes.frame import TAIL
from ..lanes.kernels import Kernels
from ..lanes.program import Program, Scheme, program
from ..lanes.watch import Watch
from .compiling import Compiled, has
from .kernel import Kernel
from .layout import Layout
from .tables import packed, readers

CODE: Final = 36 * 1024
"""Bytes of an object file whose loop still fits the first-level cache."""

MOST_REGISTERS: Final = 4

PIECE: Final = 4096
"""Most loops of a piece of work, but for rounding; between two of them Ctrl-C is noticed."""

_SIGNATURE: Final = (*[ctypes.c_double] * 2, *[ctypes.c_void_p] * 6, *[ctypes.c_int64] * 3)


@dataclass(frozen=True)
class Ready:
    """A compiled kernel and what it needs to know."""

    program: Program
    layout: Layout
    run: Callable[..., None]
    flops: float


def compiled(
    system: System, swept: tuple[int, ...], scheme: Scheme, watch: Watch, dtype: str
) -> Ready:
    """Compile for the widest vectors whose code stays in the first-level cache.

    Several vector registers side by side hide the latency of each one's chain of operations.
    """
    bits = 32 if dtype == "float32" else 64
    register = (512 if has("avx512f") else 256) // bits
    step = program(system, swept, scheme, watch)
    width = (2 if system.oracles else MOST_REGISTERS) * register
    while True:
        made, size = _made(system, step, swept, width, bits)
        if size <= CODE or width == register:
            return made
        width //= 2


def alone(
    system: System, swept: tuple[int, ...], scheme: Scheme, watch: Watch, dtype: str
) -> Ready:
    """Compile for one loop: nothing is computed and kept beside it."""
    step = program(system, swept, scheme, watch)
    return _made(system, step, swept, 1, 32 if dtype == "float32" else 64)[0]


def _made(
    system: System, step: Program, swept: tuple[int, ...], width: int, bits: int
) -> tuple[Ready, int]:
    """Return the kernel and the bytes of its object file."""
    kernel = Kernel(step, swept, width, bits, readers(system, bits))
    code = Compiled(kernel.text())
    return Ready(step, kernel.layout, code.function("run", *_SIGNATURE), kernel.flops), code.size


KERNELS: Final = Kernels(compiled)
ALONE: Final = Kernels(alone)


def integrate(
    asked: Asked,
    *,
    threads: int = 1,
    progress: Callable[[float], object] | None = None,
    scheme: Scheme | None = None,
) -> Ended:
    """Run loops, a column of numbers each, and return what became of them.

    An exception from `progress`, or Ctrl-C, stops all threads within a step.

    Parameters
    ----------
    asked
        The loops.
    threads
        How many of the processor's cores work.
    progress
        Called with the share of the loops that are done.
    scheme
        Taylor's method of an order that fits the tolerance if left out, RK4 for tables.

    Raises
    ------
    InvalidDescription
        If difference equations are asked for in single precision, or for a duration that is no
        whole number of samples.
    """
    if asked.system.dt is not None:
        check_number(asked.dtype)
        check_steps(asked.t_end, np.unique(choosing.sampling(asked)), asked.samples)
    scheme = choosing.usual(asked) if scheme is None else scheme
    single = asked.count == 1 and asked.system.dt is not None
    kernels = ALONE if single else KERNELS
    kernel = kernels.get(asked.system, asked.swept, scheme, asked.watch, asked.dtype)
    work = _Work(kernel, asked, scheme)
    size = _share(asked.count, threads, kernel.layout.width)
    starts = range(0, asked.count, size)
    with ThreadPoolExecutor(threads) as pool:
        jobs = [pool.submit(work.run, start, size) for start in starts]
        try:
            for done, job in enumerate(jobs, 1):
                job.result()
                if progress is not None:
                    progress(done / len(jobs))
        except BaseException:
            work.stop[0] = 1
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return work.ended()


def _share(count: int, threads: int, width: int) -> int:
    """Return how many loops a piece has: whole vectors, and as many pieces for every thread."""
    rounds = math.ceil(max(count, 1) / (threads * PIECE))
    return math.ceil(max(count, 1) / (threads * rounds * width)) * width


class _Work:
    """What pieces of the loops read and write.

    In a piece, loops of similar pace share a vector: they take similarly many steps, and few
    wait for others.
    """

    def __init__(self, kernel: Ready, asked: Asked, scheme: Scheme) -> None:
        self.kernel, self.asked, self.scheme = kernel, asked, scheme
        self.given = rows.given(asked, kernel.layout.columns)
        self.paces = choosing.paces(asked)
        self.out = np.empty((len(kernel.layout.left) + len(TAIL), asked.count))
        states = len(asked.system.states)
        self.samples = np.empty((asked.samples, states, asked.count), dtype=asked.dtype)
        self.stop = np.zeros(1, dtype=np.int64)
        self.tables = packed(asked.system, asked.dtype)
        self.values = np.ascontiguousarray(asked.values, dtype=float)

    def run(self, start: int, size: int) -> None:
        """Run the loops of the piece that begins here."""
        asked, width = self.asked, self.kernel.layout.width
        part = slice(start, min(start + size, asked.count))
        order = np.argsort(self.paces[part])
        stride = -(-len(order) // width) * width
        padded = np.append(order, np.repeat(order[-1:], stride - len(order)))
        columns = self.given[:, part].take(padded, axis=1)
        out = np.empty((len(self.out), stride))
        samples = np.empty((*self.samples.shape[:2], stride), dtype=asked.dtype)
        self.kernel.run(
            choosing.tolerance(asked, self.scheme),
            asked.t_end,
            self.values.ctypes.data,
            columns.ctypes.data,
            out.ctypes.data,
            samples.ctypes.data if asked.samples else None,
            self.tables.ctypes.data,
            self.stop.ctypes.data,
            stride,
            stride // width,
            max(asked.samples - 1, 1),
        )
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        self.out[:, part] = out.take(place, axis=1)
        self.samples[:, :, part] = samples.take(place, axis=2)

    def ended(self) -> Ended:
        """Return what became of the loops."""
        names = (*self.kernel.layout.left, *TAIL)
        return rows.ended(self.asked, names, self.out, self.samples, self.scheme.name)
