"""Exported headers built back into Python, and the tools that build them."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from extremum.deploy.discrete import DiscreteController
from extremum.deploy.exporting import export_c

WARNINGS = ("-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror")
REALS = {"double": np.float64, "single": np.float32}

_DRIVER = """
#define ESC_IMPLEMENTATION
#include "esc.h"
#include <stddef.h>
#include <string.h>

#define REAL {real}

size_t size(void);
void run(esc_t *self, const REAL *samples, REAL *commands, unsigned char *states, size_t steps);

size_t size(void)
{{
    return sizeof(esc_t);
}}

void run(esc_t *self, const REAL *samples, REAL *commands, unsigned char *states, size_t steps)
{{
    size_t k;
    for (k = 0; k < steps; k++) {{
        esc_step(self, samples[k], commands + k * ESC_INPUTS);
        memcpy(states + k * sizeof(esc_t), self, sizeof(esc_t));
    }}
}}
"""


def real_of(precision: str) -> str:
    """Return the type of C."""
    return "float" if precision == "single" else "double"


def needs(tool: str) -> str:
    """Return a compiler's path; skip the test, with the reason, where there is none."""
    found = shutil.which(tool)
    if found is None:
        pytest.skip(f"{tool} is not installed")
    return found


def compiled(command: Sequence[str | Path]) -> str:
    """Run a command that must succeed silently; return what it printed."""
    done = subprocess.run([str(x) for x in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stderr[-4000:]}"
    assert done.stderr == ""
    return done.stdout


class Built:
    """A controller's header as a shared library.

    Parameters
    ----------
    flags
        Of the compiler, beside those of the driver.
    """

    def __init__(
        self,
        ctrl: DiscreteController,
        folder: Path,
        precision: str = "double",
        flags: Sequence[str] = ("-O2",),
    ) -> None:
        self.ctrl, self.real = ctrl, REALS[precision]
        export_c(ctrl, folder, precision=precision)  # pyright: ignore[reportArgumentType]
        (folder / "driver.c").write_text(
            _DRIVER.format(real="float" if precision == "single" else "double")
        )
        library = folder / "driver.so"
        compiled(
            [
                *(needs("gcc"), "-std=c99", *WARNINGS, *flags, "-shared", "-fPIC"),
                *(folder / "driver.c", "-o", library, "-lm"),
            ]
        )
        self.shared_object = ctypes.CDLL(str(library))
        self.shared_object.size.restype = ctypes.c_size_t
        names = [*(o.name for o in ctrl.machine.oscillators), *ctrl.machine.states]
        kinds = [np.int64] * len(ctrl.machine.oscillators) + [self.real] * len(ctrl.machine.states)
        self.layout = np.dtype(list(zip(names, kinds, strict=True)), align=True)
        assert self.layout.itemsize == self.shared_object.size()
        self.state = np.zeros(1, self.layout)

    def call(self, name: str, *arguments: float) -> None:
        """Call a function of the header that returns nothing: numbers of its type, or steps."""
        real = ctypes.c_float if self.real is np.float32 else ctypes.c_double
        given = [ctypes.c_uint32(int(x)) if name == "skip" else real(x) for x in arguments]
        getattr(self.shared_object, f"esc_{name}")(self._pointer(), *given)

    def status(self) -> int:
        """Return the header's status."""
        return self.shared_object.esc_status(self._pointer())

    def run(self, samples: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Return the commands, (steps, inputs), and the states after every step, as records."""
        with np.errstate(over="ignore"):
            given = np.ascontiguousarray(samples, self.real)
        commands = np.empty((len(given), len(self.ctrl.inputs)), self.real)
        states = np.empty(len(given), self.layout)
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (given, commands, states)]
        self.shared_object.run(self._pointer(), *pointers, ctypes.c_size_t(len(given)))
        return commands, states

    def _pointer(self) -> ctypes.c_void_p:
        return ctypes.c_void_p(self.state.ctypes.data)


def stepped(
    ctrl: DiscreteController, state: object, samples: Sequence[float]
) -> tuple[NDArray, NDArray, object]:
    """Return the commands and the states after every step of the Python controller; its state."""
    step, commands, states = ctrl.step, [], []
    for sample in samples:
        sent, state = step(state, sample)
        commands.append(sent)
        states.append(state)
    names = ctrl.state_names
    phases = {o.name for o in ctrl.machine.oscillators}
    layout = np.dtype([(x, np.int64 if x in phases else np.float64) for x in names])
    return np.array(commands), np.array([tuple(x) for x in states], layout), state


def same(a: NDArray, b: NDArray) -> bool:
    """Return whether two arrays are equal to the last bit, a sign of zero included; NaN is NaN."""
    return np.array_equal(a, b, equal_nan=True) and np.array_equal(np.signbit(a), np.signbit(b))
