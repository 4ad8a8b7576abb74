"""How large an exported controller is on small processors, and how long its step takes.

It needs the compilers of those processors (Debian: gcc-arm-none-eabi, libnewlib-arm-none-eabi,
gcc-avr, avr-libc), and simavr for the cycles.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

PROCESSORS: Final[Mapping[str, tuple[str, ...]]] = {
    "Cortex-M4F": (
        "arm-none-eabi-gcc",
        "-mcpu=cortex-m4",
        "-mthumb",
        "-mfpu=fpv4-sp-d16",
        "-mfloat-abi=hard",
    ),
    "Cortex-M0": ("arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb"),
    "AVR": ("avr-gcc", "-mmcu=atmega328p"),
}
"""Processor → its compiler, with the options that name it."""

FUNCTIONS: Final = ("init", "step", "reset", "skip", "change", "status")

_CLOCK: Final = 16_000_000
_KNOWN: Final = 1000
"""Cycles of a delay that the counter is checked with."""

_HOST: Final = """
#define _POSIX_C_SOURCE 199309L
#define {macro}_IMPLEMENTATION
#include "{prefix}.h"
#include <stdio.h>
#include <time.h>

static {real} samples[1024];
static {real} u[{macro}_INPUTS];

int main(void)
{{
    {prefix}_t controller;
    struct timespec begun, ended;
    double sum = 0;
    int k;
    for (k = 0; k < 1024; k++)
        samples[k] = ({real})((k * 997) % 1024) / 1024;
    {prefix}_init(&controller, samples[0]);
    clock_gettime(CLOCK_MONOTONIC, &begun);
    for (k = 0; k < {steps}; k++) {{
        {prefix}_step(&controller, samples[k & 1023], u);
        sum += (double)u[0];
    }}
    clock_gettime(CLOCK_MONOTONIC, &ended);
    printf("%.0f\\n", 1e9 * (double)(ended.tv_sec - begun.tv_sec)
        + (double)(ended.tv_nsec - begun.tv_nsec));
    return sum > 1e300;
}}
"""

_AVR: Final = """
#define {macro}_IMPLEMENTATION
#include "{prefix}.h"
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <string.h>

static void send(uint32_t number)
{{
    char digits[12];
    uint8_t count = 0;
    digits[count++] = '\\n';
    do {{
        digits[count++] = (char)('0' + number % 10);
        number /= 10;
    }} while (number);
    while (count--) {{
        while (!(UCSR0A & (1 << UDRE0))) {{
        }}
        UDR0 = (uint8_t)digits[count];
    }}
}}

int main(void)
{{
    static {prefix}_t controller;
    static {real} u[{macro}_INPUTS];
    uint32_t random = 1, total = 0;
    uint16_t k, begun, idle, spent, worst = 0, overflows = 0;
    UCSR0B = (1 << TXEN0);
    TCCR1A = 0;
    TCCR1B = (1 << CS10);
    begun = TCNT1;
    idle = (uint16_t)(TCNT1 - begun);
    begun = TCNT1;
    __builtin_avr_delay_cycles({known});
    send((uint16_t)(TCNT1 - begun - idle));
    {prefix}_init(&controller, ({real})1);
    for (k = 0; k < {steps}; k++) {{
        {real} sample;
        random = random * 1664525u + 1013904223u;
        sample = ({real})(random >> 8) * ({real})5.96e-8;
        if (k % 8 == 7)
            memcpy(&sample, &random, 4);
        TCNT1 = 0;
        TIFR1 = (1 << TOV1);
        begun = TCNT1;
        {prefix}_step(&controller, sample, u);
        spent = (uint16_t)(TCNT1 - begun - idle);
        if (TIFR1 & (1 << TOV1))
            overflows++;
        if (spent > worst)
            worst = spent;
        total += spent;
    }}
    send(worst);
    send(total / {steps});
    send(overflows);
    cli();
    sleep_enable();
    sleep_cpu();
    return 0;
}}
"""


def code_size(folder: Path, prefix: str, processor: str) -> int:
    """Return the bytes of code and constants of all functions, with what they need of libraries.

    Built with ``-Os``, linked with ``--gc-sections``.

    Parameters
    ----------
    folder, prefix
        Where the header is, and its prefix.
    processor
        A key of `PROCESSORS`.
    """
    compiler, *options = PROCESSORS[processor]
    size = f"{compiler.removesuffix('gcc')}size"
    kept = [f"-Wl,-u,{prefix}_{name}" for name in _present(folder, prefix)]
    with tempfile.TemporaryDirectory() as made:
        source, linked = Path(made, "size.c"), Path(made, "size.elf")
        source.write_text(f'#define {prefix.upper()}_IMPLEMENTATION\n#include "{prefix}.h"\n')
        _run(
            [
                *(compiler, *options, "-std=c99", "-Os", "-ffunction-sections", "-nostartfiles"),
                *("-Wl,--gc-sections", f"-Wl,-e,{prefix}_step", *kept),
                *("-I", str(folder), str(source), "-o", str(linked), "-lm"),
            ]
        )
        text, data = _run([size, str(linked)]).splitlines()[1].split()[:2]
    return int(text) + int(data)


def host_time(folder: Path, prefix: str, steps: int = 10_000_000) -> float:
    """Return the time (s) of a step on this computer, built by gcc with ``-O2``."""
    with tempfile.TemporaryDirectory() as made:
        linked = Path(made, "time")
        _build(["gcc", "-std=c99", "-O2", "-fno-inline"], _HOST, folder, prefix, steps, linked)
        return float(_run([str(linked)])) * 1e-9 / steps


def avr_cycles(folder: Path, prefix: str, steps: int = 10_000) -> tuple[int, int]:
    """Return the most and the mean of cycles that a step takes on an ATmega328P, by simavr.

    Seven samples of eight are random numbers in 0 … 1, the eighth is a random pattern of bits.
    """
    compiler, *options = PROCESSORS["AVR"]
    with tempfile.TemporaryDirectory() as made:
        linked = Path(made, "cycles.elf")
        command = [compiler, *options, "-std=gnu99", "-Os", "-fno-inline"]
        _build(command, _AVR, folder, prefix, steps, linked)
        said = _run(["simavr", "-m", "atmega328p", "-f", str(_CLOCK), str(linked)])
    known, worst, mean, overflows = (int(x) for x in re.findall(r"(\d+)\.", said))
    if known != _KNOWN or overflows:
        raise RuntimeError(f"the cycles were not counted rightly: {said}")
    return worst, mean


def _build(
    command: list[str], program: str, folder: Path, prefix: str, steps: int, linked: Path
) -> None:
    """Compile a program that is a template around a header."""
    header = (folder / f"{prefix}.h").read_text(encoding="utf-8")
    real = "float" if f"{prefix}_t *self, float J" in header else "double"
    names = {"prefix": prefix, "macro": prefix.upper(), "real": real}
    source = linked.with_suffix(".c")
    source.write_text(program.format(**names, steps=steps, known=_KNOWN))
    _run([*command, "-I", str(folder), str(source), "-o", str(linked), "-lm"])


def _present(folder: Path, prefix: str) -> list[str]:
    text = (folder / f"{prefix}.h").read_text(encoding="utf-8")
    return [name for name in FUNCTIONS if f" {prefix}_{name}(" in text]


def _run(command: Sequence[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
    return done.stdout + done.stderr
