"""What `export_c` writes, and what it refuses."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from building import WARNINGS, compiled, needs
from controllers import CHOICES, PLAIN, controller

import extremum as es
from extremum.deploy import exporting
from extremum.deploy.exporting import export_c

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose


@pytest.fixture(scope="module")
def ctrl():
    return controller(PLAIN)


def test_three_files_in_a_folder_that_is_made(ctrl, tmp_path):
    folder = tmp_path / "made" / "here"
    paths = export_c(ctrl, folder, prefix="seek_2")
    assert paths == (folder / "seek_2.h", folder / "seek_2.py", folder / "README.md")
    assert sorted(folder.iterdir()) == sorted(paths)
    umask = os.umask(0)
    os.umask(umask)
    assert all(path.stat().st_mode & 0o777 == 0o666 & ~umask for path in paths)
    export_c(ctrl, folder, prefix="seek_2")  # its own files are replaced
    assert sorted(folder.iterdir()) == sorted(paths)


def test_the_header_states_version_equations_numbers_and_units(ctrl, tmp_path):
    export_c(ctrl, tmp_path)
    text = (tmp_path / "esc.h").read_text()
    assert text.isascii()
    comment = text.split("*/", 1)[0]
    assert f"Written by extremum {es.__version__};" in comment
    for symbol, expression in ctrl.system.signals:
        assert re.search(rf"^ \*   {re.escape(str(symbol))} += ", comment, re.MULTILINE)
        assert str(expression) in comment
    for parameter, number in zip(ctrl.system.parameters, ctrl.values, strict=True):
        row = rf"^ \*   {parameter.symbol} += {re.escape(repr(float(number)))} .*{parameter.path}$"
        assert re.search(row, comment, re.MULTILINE), row
    for name in ctrl.machine.states:
        unit = re.escape(ctrl.machine.units[name])
        assert re.search(rf"^    double {name}; +/\* {unit} \*/$", text, re.MULTILINE)
    assert re.search(r"^    uint64_t phase; +/\* 2\^-64 turns \*/$", text, re.MULTILINE)


def test_only_what_it_needs_is_included(tmp_path):
    export_c(controller({**PLAIN, "scale": "log"}), tmp_path / "log")
    assert _included(tmp_path / "log") == ["<stdint.h>", "<math.h>"]
    assert "and the library behind it" in (tmp_path / "log" / "README.md").read_text()


def test_two_controllers_live_in_one_program(ctrl, tmp_path):
    export_c(ctrl, tmp_path, prefix="one")
    export_c(controller(CHOICES[1]), tmp_path, prefix="two", precision="single")
    for name in ("one", "two"):
        text = f'#define {name.upper()}_IMPLEMENTATION\n#include "one.h"\n#include "two.h"\n'
        (tmp_path / f"{name}.c").write_text(text)
    (tmp_path / "main.c").write_text(
        '#include "one.h"\n#include "two.h"\n'
        "int main(void)\n{\n    one_t one;\n    two_t two;\n    double u[ONE_INPUTS] = ONE_SAFE;\n"
        "    float w[TWO_INPUTS] = TWO_SAFE;\n"
        "    one_init(&one, u[0]);\n    two_init(&two, w[0]);\n"
        "    one_step(&one, 1.0, u);\n    two_step(&two, 1.0f, w);\n"
        "    return !(u[0] > 2.3 && u[0] < 2.5);\n}\n"
    )
    sources = [tmp_path / f"{name}.c" for name in ("one", "two", "main")]
    program = tmp_path / "program"
    compiled([needs("gcc"), "-std=c99", *WARNINGS, *sources, "-o", program, "-lm"])
    compiled([program])


def _included(folder: Path) -> list[str]:
    return re.findall(r"^#include (.*)$", (folder / "esc.h").read_text(), re.MULTILINE)


@pytest.mark.parametrize(
    ("prefix", "reason"),
    [
        ("", "is no identifier of C"),
        ("1st", "is no identifier of C"),
        ("my-esc", "is no identifier of C"),
        ("a b", "is no identifier of C"),
        ("esc\n", "is no identifier of C"),
        ("ésc", "is no identifier of C"),
        ("../esc", "is no identifier of C"),
        ("_esc", "begins with an underscore"),
        ("a__b", "has two underscores in a row"),
        ("while", "is a keyword of C or C++"),
        ("double", "is a keyword of C or C++"),
        ("template", "is a keyword of C or C++"),
        ("restrict", "is a keyword of C or C++"),
        ("lambda", "is a keyword of Python"),
        ("math", "would hide the standard header <math.h>"),
        ("stdint", "would hide the standard header"),
        ("size", "size_t is a standard type"),
        ("uint_fast16", "uint_fast16_t is a standard type"),
        (7, "must be text"),
    ],
)
def test_a_prefix_that_makes_no_names_is_refused(ctrl, prefix, reason, tmp_path):
    with pytest.raises(es.InvalidDescription, match=re.escape(reason)) as caught:
        export_c(ctrl, tmp_path, prefix=prefix)
    assert caught.value.path == "prefix"
    assert caught.value.value == repr(prefix)
    assert not any(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_refused(ctrl, tmp_path):
    (tmp_path / "file").write_text("mine")
    for folder, reason in (("file", "File exists"), ("file/sub", "Not a directory")):
        with pytest.raises(es.InvalidDescription, match=f"cannot be written: {reason}") as caught:
            export_c(ctrl, tmp_path / folder)
        assert caught.value.path == "folder"
    with pytest.raises(es.InvalidDescription, match="cannot be written: File name too long"):
        export_c(ctrl, tmp_path, prefix="a" * 300)
    with pytest.raises(es.InvalidDescription, match=r"cannot be written: .*null"):
        export_c(ctrl, "a\0b")
    with pytest.raises(es.InvalidDescription, match=r"cannot be written: .*not int"):
        export_c(ctrl, 7)  # pyright: ignore[reportArgumentType]
    assert os.listdir(tmp_path) == ["file"]


def test_all_files_or_none(ctrl, tmp_path, monkeypatch):
    export_c(ctrl, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    begin = exporting.tempfile.mkstemp

    def full(suffix: str, prefix: str, folder: Path) -> tuple[int, str]:
        if prefix.startswith(".README"):
            raise OSError(28, "No space left on device")
        return begin(suffix, prefix, folder)

    monkeypatch.setattr(exporting.tempfile, "mkstemp", full)
    with pytest.raises(es.InvalidDescription, match="No space left on device"):
        export_c(controller(CHOICES[2]), tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_files_of_others_are_kept(ctrl, tmp_path):
    (tmp_path / "README.md").write_text("my project")
    with pytest.raises(es.InvalidDescription, match=r"README\.md is there and not of an earlier"):
        export_c(ctrl, tmp_path)
    assert os.listdir(tmp_path) == ["README.md"]
    (tmp_path / "esc.h").mkdir()
    with pytest.raises(es.InvalidDescription, match=r"esc\.h is there"):
        export_c(ctrl, tmp_path)


def test_what_is_no_controller_and_no_precision_is_refused(ctrl, tmp_path):
    with pytest.raises(es.InvalidDescription, match="must be a DiscreteController, as discretize"):
        export_c(ctrl.controller, tmp_path)
    with pytest.raises(es.InvalidDescription, match="did you mean 'single'"):
        export_c(ctrl, tmp_path, precision="singel")  # pyright: ignore[reportArgumentType]
    assert not any(tmp_path.iterdir())


def test_the_readme_tells_what_is_in_the_header(tmp_path):
    for row in CHOICES[:4]:
        made = controller(row)
        export_c(made, tmp_path, precision="single")
        readme, header = ((tmp_path / name).read_text() for name in ("README.md", "esc.h"))
        functions = set(re.findall(r"^(?:void|int) (esc_\w+)\(", header, re.MULTILINE))
        assert set(re.findall(r"^\| `(esc_\w+)\(", readme, re.MULTILINE)) == functions
        assert ("esc_change" in functions) == (row["changes"] != "none")
        assert ("esc_status" in functions) == (row["detector"] != "none")
        for name in made.state_names:
            assert f"| `{name}` | " in readme
        for name in made.inputs:
            assert name in readme
        assert ("After 0.05 s" in readme) == (row["validity"] == "full")
