from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import heyoka
import numpy as np
import pytest
from loops import velocity_actuated

import extremum as es
from extremum.engines import taylor
from extremum.symbols import FUNCTIONS


def final(gain: float) -> np.ndarray:
    loop = velocity_actuated(**{"controller.channels.0.gain": gain})
    return es.simulate(loop, 3.0, samples=200).position.values[-1]


def test_two_threads_do_not_share_an_integrator() -> None:
    """A shared one gives wrong results in half of the runs."""
    gains = np.linspace(5, 15, 150)
    expected = [final(float(gain)) for gain in gains]
    together = Barrier(2)

    def sweep(order: np.ndarray) -> dict[int, np.ndarray]:
        together.wait()
        return {int(i): final(float(gains[i])) for i in order}

    forwards = np.arange(len(gains))
    with ThreadPoolExecutor(2) as pool:
        for found in pool.map(sweep, (forwards, forwards[::-1])):
            for i, position in found.items():
                assert np.array_equal(position, expected[i])


def test_a_changed_number_compiles_nothing_and_a_changed_structure_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compiled: list[Any] = []
    make = heyoka.taylor_adaptive

    def counted(*arguments: Any, **options: Any) -> Any:
        compiled.append(arguments)
        return make(*arguments, **options)

    loop = velocity_actuated()
    es.simulate(loop, 0.1)
    monkeypatch.setattr(heyoka, "taylor_adaptive", counted)
    for changes in (
        {"field.q.0": 0.0},
        {"controller.channels.1.gain": 0},
        {"controller.frequency": 31, "start": (2, 3)},
    ):
        es.simulate(loop.replace(changes), 0.1)
    assert len(compiled) == 0
    es.simulate(loop.replace({"field": es.Expression("-x**2 - y**2/1234567")}), 0.1)
    assert len(compiled) == 1


@pytest.mark.parametrize("name", list(FUNCTIONS))
def test_every_function_allowed_in_a_field_runs_on_both_engines(name: str) -> None:
    argument = {"acosh": "2 + x**2", "log": "2 + x", "sqrt": "2 + x"}.get(name, "x/3 + 1/7")
    call = f"{name}({argument}, 1.7)" if name == "atan2" else f"{name}({argument})"
    loop = velocity_actuated(
        field=es.Expression(f"{call} - (y/3)**2 + x**(2/3*3)/11"), start=(0.3, 0.2)
    )
    ours, theirs = (es.simulate(loop, 0.5, engine=e) for e in ("taylor", "reference"))
    assert ours.attrs["outcome"] == "completed"
    assert np.abs(ours.position.values - theirs.position.values).max() < 1e-10


def test_chunks_for_progress_change_nothing() -> None:
    loop = velocity_actuated()
    reached: list[float] = []
    shown = es.simulate(loop, 3.0, progress=reached.append)
    plain = es.simulate(loop, 3.0)
    assert len(reached) == taylor.CHUNKS
    assert reached == sorted(reached)
    assert np.abs(shown.position.values - plain.position.values).max() < 1e-10


def test_a_run_inside_a_progress_callback_disturbs_nothing() -> None:
    loop = velocity_actuated()
    plain = es.simulate(loop, 3.0)
    other = loop.replace({"controller.channels.0.gain": 3.0})
    nested = es.simulate(loop, 3.0, progress=lambda _: es.simulate(other, 0.1))
    assert np.abs(nested.position.values - plain.position.values).max() < 1e-10


def test_a_stiff_run_can_be_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    """heyoka gives the control back between steps, so that Ctrl-C is seen inside one chunk."""
    calls = []

    def interrupt(_: object) -> bool:
        calls.append(1)
        if len(calls) > 50:
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr(taylor, "_always", interrupt)
    with pytest.raises(KeyboardInterrupt):
        es.simulate(velocity_actuated(), 100.0)
