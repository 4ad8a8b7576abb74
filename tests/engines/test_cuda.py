"""The GPU engine: on numba's simulator, as a compiled kernel, and on a GPU where there is one."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lane_cases
import numpy as np
import pytest
from lane_cases import CASES, numbers

import extremum as es
from extremum.engines import cuda, simd
from extremum.engines.cuda import running
from extremum.engines.cuda.kernel import Kernel
from extremum.engines.lanes import choosing
from extremum.engines.lanes.asked import Asked
from extremum.engines.lanes.program import program
from extremum.errors import InvalidDescription

HERE = Path(__file__).parent
FLOORS = {"float64": 1e-12, "float32": 1e-5}
NO_GPU = "no GPU can be used here: the kernels ran on the simulator only"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What became of all cases on the simulator, by case and field."""
    pytest.importorskip("numba_cuda", reason="numba-cuda is not installed")
    file = tmp_path_factory.mktemp("simulated") / "ended.npz"
    python = [sys.executable, str(HERE / "lane_cases.py"), str(file)]
    path = os.pathsep.join([str(HERE), str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": path}
    subprocess.run(python, env=environment, check=True)
    return dict(np.load(file))


def compare(found: dict[str, Any], expected: dict[str, Any], limit: float) -> None:
    """Whole numbers and NaN agree exactly, the others within a limit relative to 1 + |x|."""
    for field, value in expected.items():
        other = np.asarray(found[field])
        if field == "scheme":
            assert str(other) == value
        elif field == "steps":
            assert np.abs(other - value).max() <= 1  # a length may be rounded to just enough
        elif field == "outcome":
            np.testing.assert_array_equal(other, value)
        else:
            assert other.dtype == value.dtype
            scale = 1 + np.abs(np.nan_to_num(value))
            np.testing.assert_allclose(other / scale, value / scale, rtol=0, atol=limit)


@pytest.mark.parametrize("name", CASES)
def test_the_simulated_gpu_does_what_the_cpu_does(name: str, simulated: dict[str, Any]) -> None:
    asked, scheme = CASES[name]()
    expected = numbers(simd.integrate(asked, scheme=scheme))
    found = {field: simulated[f"{name}/{field}"] for field in expected}
    compare(found, expected, FLOORS[asked.dtype])


def test_the_cases_escape_and_complete() -> None:
    """Otherwise the comparison would say less than it seems to."""
    ended = simd.integrate(lane_cases.escaping())
    assert ended.outcome.tolist() == [0, 1, 1]
    assert np.isnan(ended.samples[-1, :, 1:]).all()
    assert (simd.integrate(lane_cases.watched()).beyond > 0).any()


def test_pieces_and_neighbours_change_nothing(simulated: dict[str, Any]) -> None:
    for field in ("states", "steps"):
        whole = simulated[f"quadratic/{field}"][..., :3]
        np.testing.assert_array_equal(simulated[f"in pieces/{field}"], whole)
    np.testing.assert_allclose(simulated["shares"], [2 / 3, 1])


def test_a_gridded_field_stays_on_the_cpu() -> None:
    x = np.linspace(-2, 2, 9)
    field = es.Gridded(es.Grid((x, x), -np.add.outer(x**2, x**2)))
    loop = lane_cases.paper("fig4")
    asked = lane_cases.asked(
        es.Loop(field, loop.vehicle, loop.controller, loop.start), 1.0, {"start.0": np.zeros(1)}
    )
    with pytest.raises(InvalidDescription, match=r"device = 'cuda': .* use device='cpu'"):
        cuda.integrate(asked)


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = lane_cases.force()
    with monkeypatch.context() as patch:
        patch.setattr(running, "find_spec", lambda name: None)
        assert not cuda.available()
        with pytest.raises(InvalidDescription, match=r"pip install 'extremum\[cuda\]'"):
            cuda.integrate(asked)
    numba_cuda = pytest.importorskip("numba.cuda")
    monkeypatch.setattr(numba_cuda, "is_available", lambda: False)
    with pytest.raises(InvalidDescription, match=r"no NVIDIA GPU .* use device='cpu'"):
        cuda.integrate(asked)

    def unlinked(*_: Any) -> Any:
        raise RuntimeError('Failure finding "libnvrtc.so.13"')

    monkeypatch.setattr(numba_cuda, "is_available", lambda: True)
    monkeypatch.setattr(numba_cuda, "jit", unlinked)
    with pytest.raises(InvalidDescription, match=r"pip install 'numba-cuda\[cu13\]'.*libnvrtc"):
        cuda.integrate(asked)


def kernel(asked: Asked) -> Kernel:
    step = program(asked.system, asked.swept, choosing.usual(asked), asked.watch)
    return Kernel(step, asked.swept, 32 if asked.dtype == "float32" else 64)


@pytest.fixture
def assembled(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Kernel → PTX for compute capability 9.0, by NVIDIA's compiler, which needs no GPU."""
    gpu = pytest.importorskip("numba.cuda", reason="numba-cuda is not installed")
    dispatcher = pytest.importorskip("numba.cuda.dispatcher")
    device = SimpleNamespace(compute_capability=(9, 0))
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: device)
    try:
        gpu.compile_ptx(lambda: None, "void()", cc=(9, 0))
    except Exception as error:
        pytest.skip(f"NVIDIA's compiler is not installed: {str(error).splitlines()[0]}")

    def assemble(made: Kernel) -> str:
        return gpu.compile_ptx(running.function(made), running.signature(made), cc=(9, 0))[0]

    return assemble


def test_a_kernel_compiles_and_its_products_are_fused(assembled: Any) -> None:
    text = assembled(kernel(lane_cases.quadratic()))
    assert len(re.findall(r"fma\.rn\.f64", text)) > 100


def test_single_precision_is_not_promoted(assembled: Any) -> None:
    """Only times and angles are doubles."""
    text = assembled(kernel(replace(lane_cases.escaping(), tol=1e-4, dtype="float32")))
    arithmetic = r"\b(?:add|sub|mul|div|fma)\.(?:rn\.)?"
    singles, doubles = (re.findall(rf"{arithmetic}{kind}", text) for kind in ("f32", "f64"))
    assert len(singles) > 200
    assert len(doubles) < 40


@pytest.mark.skipif(not cuda.available(), reason=NO_GPU)
@pytest.mark.parametrize("name", CASES)
def test_a_gpu_does_what_the_cpu_does(name: str) -> None:
    asked, scheme = CASES[name]()
    expected = numbers(simd.integrate(asked, scheme=scheme))
    found = numbers(cuda.integrate(asked, scheme=scheme))
    compare(found, expected, FLOORS[asked.dtype])


@pytest.mark.skipif(not cuda.available(), reason=NO_GPU)
def test_many_loops_on_a_gpu_come_to_what_each_comes_to_alone() -> None:
    few = lane_cases.quadratic()
    many = replace(few, columns=np.tile(few.columns, 2**17))
    alone, together = cuda.integrate(few), cuda.integrate(many)
    np.testing.assert_array_equal(together.states, np.tile(alone.states, 2**17))
