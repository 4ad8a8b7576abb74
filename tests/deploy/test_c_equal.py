"""The exported header computes what `ctrl.step` does: to the last bit in double precision."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from building import Built, same, stepped
from controllers import CHOICES, LOOPS, controller, named, samples
from numpy.typing import NDArray

import extremum as es
from extremum.deploy.exporting import export_c

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose

FLAGS = (
    ("-O0",),
    ("-O2",),
    ("-O3", "-march=native", "-ffp-contract=off"),
    ("-Os",),
)
EVERYTHING = {
    "loop": "force",
    "scale": "log-shrinking",
    "limits": "rate",
    "validity": "full",
    "detector": "detector",
    "changes": "changes",
    "late": "late",
}

choices = pytest.mark.parametrize("row", CHOICES, ids=named)


@choices
def test_double_precision_is_the_python_step_to_the_last_bit(row, tmp_path):
    ctrl = controller(row)
    built = Built(ctrl, tmp_path, flags=FLAGS[CHOICES.index(row) % len(FLAGS)])
    given = samples(4_000, seed=CHOICES.index(row))
    built.call("init", given[0])
    _equal(built, ctrl, ctrl.init(given[0]), given, row["changes"] != "none")


@pytest.mark.parametrize("first", [np.nan, np.inf, -np.inf, 1e300, 0.0, -0.0, 2.5])
def test_the_first_sample_may_be_missing(first, tmp_path):
    for name in ("velocity", "three"):
        ctrl = controller({**EVERYTHING, "loop": name})
        built = Built(ctrl, tmp_path / name)
        built.call("init", first)
        _equal(built, ctrl, ctrl.init(first), samples(100, seed=3), False)


def test_a_hundred_thousand_samples(tmp_path):
    loop = LOOPS["velocity"]()
    ctrl = es.discretize(loop.controller, 1e-3, vehicle=loop.vehicle)
    _long(ctrl, tmp_path, 100_000)


def test_a_million_samples(tmp_path):
    _long(controller(EVERYTHING), tmp_path, 1_000_000)


def _long(ctrl: es.DiscreteController, folder: Path, count: int) -> None:
    built = Built(ctrl, folder, flags=("-O3",))
    given = samples(count, seed=11)
    assert np.isnan(given).sum() > count / 100
    assert np.isinf(given).any()
    built.call("init", given[0])
    state = ctrl.init(given[0])
    for part in np.split(given, count // 50_000):
        commands, states = built.run(part)
        expected, kept, state = stepped(ctrl, state, part.tolist())
        assert np.isfinite(commands).all()
        assert np.ptp(commands, axis=0).min() > 0.1
        assert same(commands, expected)
        assert all(same(states[name], kept[name]) for name in ctrl.state_names)


def _equal(built: Built, ctrl, state, given: NDArray, changing: bool) -> None:
    """Compare run by run, with what else can be called in between."""
    for k, part in enumerate(np.array_split(given, 4)):
        commands, states = built.run(part)
        expected, kept, state = stepped(ctrl, state, part.tolist())
        assert same(commands, expected)
        for name in ctrl.state_names:
            assert same(states[name], kept[name]), name
        if ctrl.practice.detector is not None:
            verdicts = ("seeking", "arrived", "lost")
            assert ctrl.status(state) == verdicts[built.status()]
        if changing:
            built.call("change", 1 + 0.3 * k, np.nan if k == 1 else 1 - 0.1 * k)
            amplitude = None if k == 1 else 1 - 0.1 * k
            state = ctrl.change(state, gain=1 + 0.3 * k, amplitude=amplitude)
        built.call("skip", 12_345 * k)
        state = ctrl.skip(state, 12_345 * k)


@choices
def test_single_precision_is_near_and_has_no_double(row, tmp_path):
    ctrl = controller(row)
    built = Built(ctrl, tmp_path, "single", ("-O2",))
    assert "double" not in (tmp_path / "esc.h").read_text().split("*/", 1)[1]
    given = samples(20_000, seed=CHOICES.index(row), wild=False)
    built.call("init", given[0])
    state, sent, expected = ctrl.init(given[0]), [], []
    for part in np.split(given, 4):
        sent.append(built.run(part)[0])
        wanted, _, state = stepped(ctrl, state, part.tolist())
        expected.append(wanted)
        built.call("skip", 777)
        state = ctrl.skip(state, 777)
        if row["changes"] != "none":
            built.call("change", 1.6, 0.8)
            state = ctrl.change(state, gain=1.6, amplitude=0.8)
    difference = np.abs(np.concatenate(sent) - np.concatenate(expected)).max()
    assert difference <= 1e-5 * np.abs(expected).max()


def test_reset_begins_again_but_keeps_what_was_changed(tmp_path):
    ctrl = controller(EVERYTHING)
    built = Built(ctrl, tmp_path)
    built.call("init", 1.0)
    built.run(samples(500, seed=5))
    built.call("change", 2.0, 0.5)
    built.run(samples(5_000, seed=6))
    before = built.state.copy()
    built.call("reset", 1.25)
    begun, kept = ctrl.init(1.25), 0
    for name in ctrl.state_names:
        changed = name.startswith(("gain", "amplitude"))
        assert built.state[name] == (before[name] if changed else getattr(begun, name)), name
        kept += changed and before[name] != getattr(begun, name)
    assert kept >= 4
    assert built.state["gain_wanted"] == 2
    assert built.state["amplitude_wanted"] == 0.5


def test_what_is_no_factor_changes_nothing(tmp_path):
    ctrl = controller(EVERYTHING)
    built = Built(ctrl, tmp_path)
    built.call("init", 1.0)
    for wrong in (np.nan, np.inf, -np.inf, -1.0):
        built.call("change", wrong, wrong)
    built.call("change", 0.0, 0.0)
    assert built.state["gain_wanted"] == 0
    assert built.state["amplitude_wanted"] == 1


@choices
def test_the_python_file_is_the_python_step_to_the_last_bit(row, tmp_path):
    ctrl = controller(row)
    export_c(ctrl, tmp_path, precision="single")
    made = _imported(tmp_path / "esc.py")
    given = samples(2_000, seed=CHOICES.index(row))
    theirs, ours = made.Controller(given[0]), ctrl.init(given[0])
    assert ctrl.inputs == theirs.INPUTS
    assert ctrl.safe == theirs.SAFE
    assert ctrl.dt == theirs.DT
    for k, sample in enumerate(given.tolist()):
        if np.isnan(sample) and k % 2:
            sample = None
        expected, ours = ctrl.step(ours, sample)
        assert theirs.step(sample) == expected
        if k == 700:
            theirs.skip(10**7)
            ours = ctrl.skip(ours, 10**7)
            if row["changes"] != "none":
                theirs.change(gain=1.5)
                ours = ctrl.change(ours, gain=1.5)
    fields = {name.rstrip("_"): value for name, value in vars(theirs).items()}
    assert fields == ours._asdict()
    if row["detector"] != "none":
        assert theirs.status() == int(ours.status)
    theirs.reset(given[1])
    expected, _ = ctrl.step(ctrl.init(given[1]), given[2])
    if row["changes"] == "none":
        assert theirs.step(given[2]) == expected


def _imported(path: Path):
    spec = importlib.util.spec_from_file_location("exported", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
