"""Exported headers compile without a warning, everywhere, and nothing is found wrong in them.

Every pair of precision, practice, compiler and optimisation meets in at least one build.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from platform import machine

import pytest
from building import WARNINGS, compiled, needs, real_of
from controllers import CHOICES, OPTIONS, PLAIN, controller, pairwise

from extremum.deploy.exporting import export_c

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
M0 = ("-mcpu=cortex-m0", "-mthumb")
AVR = ("-mmcu=atmega328p",)
COMPILERS = {
    "host-c": ("gcc", "-std=c99"),
    "host-c++": ("g++", "-std=c++17"),
    "clang-c": ("clang", "-std=c99"),
    "clang-c++": ("clang++", "-std=c++17"),
    "m4f-c": ("arm-none-eabi-gcc", "-std=c99", *M4F),
    "m4f-c++": ("arm-none-eabi-g++", "-std=c++17", *M4F),
    "m0-c": ("arm-none-eabi-gcc", "-std=c99", *M0),
    "m0-c++": ("arm-none-eabi-g++", "-std=c++17", *M0),
    "avr-c": ("avr-gcc", "-std=c99", *AVR),
    "avr-c++": ("avr-g++", "-std=c++17", *AVR),
}
"""avr-g++ 5 knows C++17 as it was in 2015, of which the header needs nothing."""
LEVELS = ("-O0", "-O2", "-O3", "-Os")
PRECISIONS = ("double", "single")
ROWS = pairwise({**OPTIONS, "compiler": COMPILERS, "level": LEVELS, "precision": PRECISIONS})


def program(folder: Path, name: str = "program.c") -> Path:
    """Write a file that includes an exported header twice, as programs do."""
    text = '#include "esc.h"\n#define ESC_IMPLEMENTATION\n#include "esc.h"\n#include "esc.h"\n'
    (folder / name).write_text(text)
    return folder / name


def export(row: dict[str, str], precision: str, folder: Path) -> Path:
    """Write a choice's export into a folder; return the folder."""
    export_c(controller(row), folder, precision=precision)  # pyright: ignore[reportArgumentType]
    return folder


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Return a function from the number of a choice and a precision to the folder of its export."""
    made: dict[tuple[int, str], Path] = {}

    def folder(choice: int, precision: str) -> Path:
        if (choice, precision) not in made:
            here = tmp_path_factory.mktemp("export")
            made[choice, precision] = export(CHOICES[choice], precision, here)
        return made[choice, precision]

    return folder


@pytest.mark.parametrize("compiler", COMPILERS)
def test_it_compiles_without_a_warning(compiler, tmp_path):
    tool, *options = COMPILERS[compiler]
    needs(tool)
    rows = [row for row in ROWS if row["compiler"] == compiler]
    assert {row["level"] for row in rows} == {*LEVELS}
    for row in rows:
        export(row, row["precision"], tmp_path)
        source = program(tmp_path, "program.cpp" if "c++" in options[0] else "program.c")
        compiled([tool, *options, row["level"], *WARNINGS, "-c", source, "-o", tmp_path / "x.o"])


@pytest.mark.parametrize("table", [OPTIONS, {**OPTIONS, "compiler": COMPILERS}], ids=len)
def test_every_pair_of_options_meets(table):
    rows = CHOICES if table is OPTIONS else ROWS
    for a in table:
        for b in table:
            met = {(row[a], row[b]) for row in rows}
            assert len(met) == (len(table[a]) if a == b else len(table[a]) * len(table[b]))


def test_single_precision_calls_no_function_of_double_precision(exported):
    tool, *options = COMPILERS["m0-c"]
    needs(tool)
    nm = needs("arm-none-eabi-nm")
    for choice, _ in enumerate(CHOICES):
        folder = exported(choice, "single")
        compiled([tool, *options, "-O2", "-c", program(folder), "-o", folder / "m0.o"])
        called = set(re.findall(r" U (\S+)", compiled([nm, folder / "m0.o"])))
        assert called & {"__aeabi_fadd", "__aeabi_fmul"}
        assert not {x for x in called if re.search(r"aeabi_(d|[a-z]*2d)|df[23]$", x)}
        assert called <= {"logf", "sqrtf", *(x for x in called if x.startswith("__aeabi_"))}


@pytest.mark.skipif(machine() != "x86_64", reason="looks for instructions of x86-64")
@pytest.mark.parametrize(
    "command",
    [
        ("gcc", "-std=c99"),
        ("g++", "-std=c++17", "-ffp-contract=off"),
        ("clang", "-std=c99"),
        ("clang++", "-std=c++17"),
    ],
    ids=lambda command: command[0],
)
def test_no_operations_are_fused(command, exported):
    needs(command[0])
    folder = exported(1, "double")
    source = program(folder, "program.cpp" if "++" in command[0] else "program.c")
    assembly = [*command, "-O3", "-mfma", "-S", "-o", "-"]
    assert not re.search(r"vfn?m(add|sub)", compiled([*assembly, source]))
    if command[0] == "g++":  # what the flag is for
        assert re.search(r"vfn?m(add|sub)", compiled([*assembly, source, "-ffp-contract=fast"]))


def test_no_memory_but_the_state(exported):
    needs("gcc")
    nm = needs("nm")
    for choice, _ in enumerate(CHOICES):
        folder = exported(choice, "double")
        source = program(folder)
        compiled(["gcc", "-std=c99", "-O0", "-c", source, "-o", folder / "host.o"])
        symbols = compiled([nm, folder / "host.o"]).split("\n")
        kinds = {line.split()[-2:][0]: line for line in symbols if line}
        assert set(kinds) <= {"T", "U", "r"}, symbols
        called = {line.split()[-1] for line in symbols if " U " in line}
        assert called <= {"log", "sqrt"}


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_analyser_of_gcc_finds_nothing(precision, exported):
    needs("gcc")
    for choice in (0, 1, 3):
        folder = exported(choice, precision)
        flags = ("-std=c99", "-O2", "-fanalyzer", "-Wshadow", "-Wstrict-prototypes", "-Wcast-qual")
        more = ("-Wmissing-prototypes", "-Wundef", "-Wfloat-conversion", "-Wsign-conversion")
        compiled(["gcc", *flags, *more, *WARNINGS, "-c", program(folder), "-o", folder / "x.o"])


@pytest.mark.parametrize("precision", PRECISIONS)
def test_cppcheck_finds_nothing(precision, exported):
    tool = needs("cppcheck")
    for choice in (0, 1, 3):
        folder = exported(choice, precision)
        compiled(
            [
                *(tool, "--quiet", "--enable=all", "--inconclusive", "--std=c99"),
                *("--error-exitcode=1", "--max-configs=100"),
                "--suppress=missingIncludeSystem",  # it reads no headers of the system
                program(folder),
            ]
        )


FUZZ = """
#define ESC_IMPLEMENTATION
#include "esc.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

static uint64_t seed = 1;

static uint64_t bits(void)
{{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return seed;
}}

static {real} any(void)
{{
    const uint64_t drawn = bits();
    const int kind = (int)(bits() % 4);
    {real} number;
    memcpy(&number, &drawn, sizeof number);
    if (kind == 0)
        return number;
    if (kind == 1)
        return ({real})NAN;
    return ({real})(drawn >> 40) / ({real})(1 << 24);
}}

int main(void)
{{
    static {real} u[ESC_INPUTS];
    static esc_t controller;
    long wrong = 0;
    int i, k;
    esc_init(&controller, any());
    for (k = 0; k < 200000; k++) {{
        esc_step(&controller, any(), u);
        for (i = 0; i < ESC_INPUTS; i++)
            wrong += !isfinite(u[i]);
        switch (bits() % 2048) {{
        case 0:
            esc_reset(&controller, any());
            break;
        case 1:
            esc_init(&controller, any());
            break;
        case 2:
            esc_skip(&controller, (uint32_t)bits());
            break;
        case 3:
            {change}
            break;
        case 4:
            {status}
            break;
        }}
    }}
    printf("%ld\\n", wrong);
    return 0;
}}
"""


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("choice", [1, 2, 3])
def test_sanitizers_find_nothing_under_random_input(choice, precision, exported):
    needs("gcc")
    folder = exported(choice, precision)
    header = (folder / "esc.h").read_text()
    calls = {
        "change": "esc_change(&controller, any(), any());" if "esc_change(" in header else "",
        "status": "wrong += esc_status(&controller) > 2;" if "esc_status(" in header else "",
    }
    (folder / "fuzz.c").write_text(FUZZ.format(real=real_of(precision), **calls))
    sanitizers = "-fsanitize=undefined,address,float-cast-overflow"
    compiled(
        [
            *("gcc", "-std=c99", "-O1", "-g", "-Wall", sanitizers, "-fno-sanitize-recover=all"),
            *(folder / "fuzz.c", "-o", folder / "fuzz", "-lm"),
        ]
    )
    done = subprocess.run([folder / "fuzz"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "0\n"


def test_the_page_shows_the_example_of_the_readme(tmp_path):
    export_c(controller(PLAIN), tmp_path, precision="single")
    page = Path(__file__).parents[2] / "docs" / "c_export.md"
    assert _example(page) == _example(tmp_path / "README.md")


def _example(page: Path) -> str:
    (found,) = re.findall(r"```c\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    return found


def test_the_example_of_the_readme_compiles(exported):
    for precision in PRECISIONS:
        folder = exported(1, precision)
        example = _example(folder / "README.md")
        body = example.split("int main(void)\n{\n")[1].split("}\n}")[0]
        assert len(body.splitlines()) <= 10
        for tool, *options in COMPILERS.values():
            if shutil.which(tool):
                source = folder / ("example.cpp" if "c++" in options[0] else "example.c")
                source.write_text(example)
                compiled([tool, *options, *WARNINGS, "-c", source, "-o", folder / "x.o"])
