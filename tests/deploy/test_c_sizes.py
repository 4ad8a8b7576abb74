"""How large the paper's controller is on small processors, and how long a step takes there."""

from __future__ import annotations

import pytest
from building import needs

import extremum as es
from extremum.deploy import measuring
from extremum.deploy.exporting import export_c
from extremum.papers import zhang2007

pytestmark = pytest.mark.filterwarnings("ignore:practice.limits")  # which cut the probe on purpose


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    loop = zhang2007.scenario("fig4").loop
    ctrl = es.discretize(loop.controller, 1e-3, vehicle=loop.vehicle)
    made = tmp_path_factory.mktemp("sizes")
    export_c(ctrl, made, precision="single")
    return made


def test_a_cortex_m4f_holds_it_in_a_kilobyte(folder):
    needs("arm-none-eabi-gcc")
    assert 300 < measuring.code_size(folder, "esc", "Cortex-M4F") <= 1024


def test_small_processors_need_software_for_numbers(folder):
    needs("arm-none-eabi-gcc")
    needs("avr-gcc")
    assert 2_000 < measuring.code_size(folder, "esc", "Cortex-M0") < 5_000
    assert 1_500 < measuring.code_size(folder, "esc", "AVR") < 4_000


def test_an_avr_at_16_mhz_steps_within_a_millisecond(folder):
    needs("avr-gcc")
    needs("simavr")
    worst, mean = measuring.avr_cycles(folder, "esc")
    assert 2_000 < mean < worst <= 16_000


def test_this_computer_steps_within_60_ns(folder, tmp_path):
    needs("gcc")
    loop = zhang2007.scenario("fig4").loop
    export_c(es.discretize(loop.controller, 1e-3, vehicle=loop.vehicle), tmp_path)
    times = [measuring.host_time(tmp_path, "esc", steps=1_000_000) for _ in range(5)]
    assert 1e-9 < min(times) < 60e-9


def test_a_size_counts_what_libraries_add(folder, tmp_path):
    needs("arm-none-eabi-gcc")
    loop = zhang2007.scenario("fig4").loop
    practice = es.Practice(scale=es.LogScale(floor=0.01))
    ctrl = es.discretize(loop.controller, 1e-3, vehicle=loop.vehicle, practice=practice)
    export_c(ctrl, tmp_path, precision="single")
    logarithm = measuring.code_size(tmp_path, "esc", "Cortex-M4F")
    assert logarithm - measuring.code_size(folder, "esc", "Cortex-M4F") > 150


def test_what_cannot_be_built_is_told(tmp_path):
    needs("gcc")
    (tmp_path / "esc.h").write_text("#error no controller\n")
    with pytest.raises(RuntimeError, match="no controller"):
        measuring.host_time(tmp_path, "esc")
