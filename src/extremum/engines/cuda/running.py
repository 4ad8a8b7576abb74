"""Many loops on an NVIDIA GPU."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from ...errors import InvalidDescription
from ...system import System
from ..lanes import choosing, rows
from ..lanes.asked import Asked, Ended
from ..lanes.evaluation import evaluated
from ..lanes.kernels import Kernels
from ..lanes.program import Scheme, program
from ..lanes.watch import Watch
from .kernel import Kernel

COMPILER: Final = "pip install 'numba-cuda[cu13]', or [cu12] for drivers before 580"

THREADS: Final = 64
"""Of a block."""

BUDGET: Final = 2**28
"""Bytes of the GPU's memory that a piece of the loops may take."""

MOST: Final = 2**18
"""Loops of a piece, enough to fill the largest GPU; between two Ctrl-C is noticed."""


@dataclass(frozen=True)
class Ready:
    """A compiled kernel and what it needs to know."""

    kernel: Kernel
    run: Any


def available() -> bool:
    """Return whether numba-cuda is installed and finds a GPU."""
    return _missing() is None


def _missing() -> str | None:
    """Return what is missing to run on a GPU, and what to do about it."""
    if find_spec("numba") is None or find_spec("numba_cuda") is None:
        return "needs numba-cuda; pip install 'extremum[cuda]', or use device='cpu'"
    from numba import cuda

    if not cuda.is_available():
        return f"no NVIDIA GPU can be used here; use device='cpu' ({_cause(cuda)})"
    return None


def _cause(cuda: Any) -> str:
    error = cuda.cuda_error()
    return f"NVIDIA's compiler was not found; {COMPILER}" if error is None else _line(error)


def _line(error: object) -> str:
    return " ".join(str(error).split())


def _made(
    system: System, swept: tuple[int, ...], scheme: Scheme, watch: Watch, dtype: str
) -> Ready:
    from numba import cuda

    bits = 32 if dtype == "float32" else 64
    kernel = Kernel(program(system, swept, scheme, watch), swept, bits)
    try:
        return Ready(kernel, cuda.jit(signature(kernel))(function(kernel)))
    except (RuntimeError, ImportError, OSError) as error:
        reason = (
            f"NVIDIA's compiler cannot be used; {COMPILER}, or use device='cpu' ({_line(error)})"
        )
        raise InvalidDescription("device", reason, "'cuda'") from error


KERNELS: Final = Kernels(_made)


def signature(kernel: Kernel) -> Any:
    """Return the types of a kernel's arguments."""
    from numba import types

    whole, double = types.int64, types.float64
    number = types.float32 if kernel.bits == 32 else double
    wide = types.UniTuple(double, max(len(kernel.wide), 1))
    given = types.UniTuple(number, max(len(kernel.given), 1))
    table, kept = double[:, ::1], number[:, :, ::1]
    return types.void(double, whole, wide, given, table, table, kept)


def function(kernel: Kernel) -> Callable[..., None]:
    """Return a kernel's text as a function that numba-cuda can compile."""
    from numba import cuda

    space: dict[str, Any] = {"cuda": cuda, "math": math, "nan": math.nan, "inf": math.inf}
    space |= {name: getattr(np, name) for name in ("float64", "float32", "int64", "int32")}
    exec(compile(kernel.text, "<kernel>", "exec"), space)
    return space["run"]


def integrate(
    asked: Asked,
    *,
    threads: int = 1,
    progress: Callable[[float], object] | None = None,
    scheme: Scheme | None = None,
) -> Ended:
    """Run loops, a column of numbers each, and return what became of them.

    Parameters
    ----------
    asked
        The loops; they pass through the GPU in pieces of bounded size.
    threads
        Of the processor: none is used.
    progress
        Called with the share of the loops that are done.
    scheme
        Taylor's method of an order that fits the tolerance if left out.
    """
    _check(asked)
    scheme = choosing.usual(asked) if scheme is None else scheme
    made = KERNELS.get(asked.system, asked.swept, scheme, asked.watch, asked.dtype)
    work = _Work(made, asked, scheme)
    for begin, end in work.pieces():
        work.run(begin, end)
        if progress is not None:
            progress(end / asked.count)
    return rows.ended(asked, made.kernel.names, work.out, work.samples, scheme.name)


def _check(asked: Asked) -> None:
    if asked.system.dt is not None:
        reason = "a sampled loop does not run on a GPU yet; use device='cpu'"
        raise InvalidDescription("device", reason, "'cuda'")
    if asked.system.oracles:
        reason = "a gridded field does not run on a GPU yet; use device='cpu'"
        raise InvalidDescription("device", reason, "'cuda'")
    missing = _missing()
    if missing is not None:
        raise InvalidDescription("device", missing, "'cuda'")


class _Work:
    """The arrays that the kernel reads and writes, on the processor's side."""

    def __init__(self, ready: Ready, asked: Asked, scheme: Scheme) -> None:
        self.ready, self.asked = ready, asked
        kernel, count = ready.kernel, asked.count
        given = rows.given(asked, kernel.frame.columns)
        self.columns = given if len(given) else np.empty((1, count))
        self.out = np.empty((len(kernel.names), count))
        states = len(asked.system.states)
        self.samples = np.empty((asked.samples, states, count), dtype=asked.dtype)
        leaves: dict[tuple[str, int], Any] = {("tol", 0): choosing.tolerance(asked, scheme)}
        leaves |= {("value", i): value for i, value in enumerate(asked.values)}
        found = evaluated(kernel.tape, [*kernel.wide, *kernel.given], leaves)
        self.wide = tuple(found[value] for value in kernel.wide) or (np.float64(0),)
        number = np.dtype(asked.dtype).type
        with np.errstate(over="ignore"):
            self.given = tuple(number(found[value]) for value in kernel.given) or (number(0),)

    def pieces(self) -> Iterator[tuple[int, int]]:
        """Return where the pieces begin and end."""
        count = self.asked.count
        held = (self.columns.nbytes + self.out.nbytes + self.samples.nbytes) // max(count, 1)
        size = max(THREADS, min(MOST, BUDGET // held))
        return ((begin, min(begin + size, count)) for begin in range(0, count, size))

    def run(self, begin: int, end: int) -> None:
        """Run the loops of a piece."""
        from numba import cuda

        asked, part = self.asked, slice(begin, end)
        columns = cuda.to_device(np.ascontiguousarray(self.columns[:, part]))
        shape = (*self.samples.shape[:2], end - begin) if asked.samples else (1, 1, 1)
        out = cuda.device_array((len(self.out), end - begin))
        number: Any = self.samples.dtype
        kept = cuda.device_array(shape, number)
        blocks = -(-(end - begin) // THREADS)
        segments = max(asked.samples - 1, 1)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Grid size")  # few loops leave a GPU idle
            launched = self.ready.run[blocks, THREADS]
        launched(float(asked.t_end), segments, self.wide, self.given, columns, out, kept)
        self.out[:, part] = out.copy_to_host()
        if asked.samples:
            self.samples[:, :, part] = kept.copy_to_host()
