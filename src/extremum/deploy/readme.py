"""The README that stands beside an exported controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .c99 import REALS, changes, mathematics

if TYPE_CHECKING:
    from .discrete import DiscreteController
    from .machine import Machine


def readme(ctrl: DiscreteController, machine: Machine, prefix: str, made: str) -> str:
    """Return the README.

    Parameters
    ----------
    ctrl
        The controller.
    machine
        As the header has it.
    prefix
        What every name begins with.
    made
        The sentence that says where it comes from.
    """
    real, macro = REALS[machine.precision].name, prefix.upper()
    commands = ", ".join(
        f"`u[{i}]` = {name} ({machine.units[name]})" for i, name in enumerate(machine.output_names)
    )
    return f"""# {prefix}: an extremum seeking controller

{made}

It steers towards the maximum of a signal J that a vehicle measures on its way: a sample in, the
commands out, every {ctrl.dt!r} s, {commands}. It never learns where the vehicle is. Equations and
numbers are in the comment at the top of `{prefix}.h`.

- `{prefix}.h`: C99 and C++17, `{real}`, for any processor; needs <stdint.h>{_needs(machine)}
- `{prefix}.py`: the same for MicroPython and Python, without other files

## Example

```c
{_example(prefix, real)}```

`read_sensor`, `drive` and `wait_until_next_instant` are yours. Include the header wherever you call
it; define `{macro}_IMPLEMENTATION` in exactly one file. Nothing is allocated, nothing is global: a
program may run as many controllers as it has `{prefix}_t`, each in one thread at a time.

## Functions

| function | what it does |
|---|---|
{_functions(machine, prefix)}
`{macro}_SAFE` is the safe output, to be sent when the program ends:
`const {real} safe[{macro}_INPUTS] = {macro}_SAFE; drive(safe);`

## Missing samples

Give `NAN` or any infinite number where there is no sample. {_missing(ctrl)}

## The state

`{prefix}_t` may be copied and kept: it is all that the controller remembers. Do not change it by
hand. Phases are in 2^-64 turns of the dither and wrap by themselves.

| field | unit |
|---|---|
{_state(machine)}
## Compilers

It compiles without warnings under `-std=c99 -pedantic -Wall -Wextra -Wconversion
-Wdouble-promotion`, and as C++17. {_precision(machine)}

- Never `-ffast-math`, nor `-ffinite-math-only`, which is part of it: samples that are NAN would
  then be believed.
- `-ffp-contract=off`, or the same bits as in Python are not promised: a fused multiply-add rounds
  once instead of twice. GCC fuses by default in C++ and with `-std=gnu99` where the processor can.
- On 32-bit x86 also `-msse2 -mfpmath=sse`.
- Conversions of unsigned to signed numbers wrap, as every compiler does and C++20 demands.
- `-Os -ffunction-sections -Wl,--gc-sections` makes it smallest.

## Python and MicroPython

```python
from {prefix} import Controller

controller = Controller(1.0)                    # a first sample, or nothing
u = controller.step(1.0)                        # None where a sample is missing
```

It computes in the port's floats: with 64 bits what the header in double precision does, to the last
bit; with 32 bits (most MicroPython ports) about what the header in single precision does.
"""


def _example(prefix: str, real: str) -> str:
    macro = prefix.upper()
    return f"""#define {macro}_IMPLEMENTATION
#include "{prefix}.h"

extern {real} read_sensor(void);
extern void drive(const {real} u[{macro}_INPUTS]);
extern void wait_until_next_instant(void);

int main(void)
{{
    {prefix}_t controller;
    {real} u[{macro}_INPUTS];
    {prefix}_init(&controller, read_sensor());
    for (;;) {{
        {prefix}_step(&controller, read_sensor(), u);
        drive(u);
        wait_until_next_instant();
    }}
}}
"""


def _functions(machine: Machine, prefix: str) -> str:
    rows = [
        ("init(self, J)", "begin with a first sample"),
        ("step(self, J, u)", "one step: a sample in, the commands out"),
        ("reset(self, J)", "begin again; gain and amplitude stay as they were changed"),
        ("skip(self, steps)", "so many instants passed without a step: the dither's phase goes on"),
    ]
    if changes(machine):
        says = "let the factors of all gains and amplitudes go over to others; NAN: no change"
        rows.append(("change(self, gain, amplitude)", says))
    if "status" in machine.states:
        verdicts = ", ".join(f"`{prefix.upper()}_{x}`" for x in ("SEEKING", "ARRIVED", "LOST"))
        rows.append(("status(self)", f"as of the last step: {verdicts}"))
    return "".join(f"| `{prefix}_{head}` | {says} |\n" for head, says in rows)


def _missing(ctrl: DiscreteController) -> str:
    validity = ctrl.practice.validity
    said = "The last good sample is held then, and the dither goes on."
    if validity.timeout is not None:
        said += (
            f" After {validity.timeout:g} s without a good sample the output goes over to the safe"
            f" one within {validity.fade:g} s, and comes back the same way."
        )
    told = [
        f"{text} {getattr(validity, name):g}{unit}"
        for name, text, unit in (
            ("low", "below", ""),
            ("high", "above", ""),
            ("stuck", "unchanged for", " s"),
        )
        if getattr(validity, name) is not None
    ]
    return said + (f" Samples {', '.join(told)} count as missing too." if told else "")


def _state(machine: Machine) -> str:
    rows = [(o.name, "2^-64 turn") for o in machine.oscillators]
    rows += [(name, machine.units[name]) for name in machine.states]
    return "".join(f"| `{name}` | {unit} |\n" for name, unit in rows)


def _needs(machine: Machine) -> str:
    return ", <math.h> and the library behind it" if mathematics(machine) else ""


def _precision(machine: Machine) -> str:
    if machine.precision == 32:
        return "No operation is in double precision."
    return (
        "Where `double` has 32 bits, as on AVR, it computes in those; export in single precision "
        "for such processors."
    )
