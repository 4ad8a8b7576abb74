"""Studies against theory and an independent integrator, at small sizes."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

import extremum as es
from extremum.errors import InvalidDescription
from extremum.papers import zhang2007
from extremum.studies import NAMES, basin, gain_frequency, ready, unknown_curvature
from extremum.theory import periodic_orbit

# --- the basin --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def starts():
    return basin.study(1600)


def test_each_start_does_what_a_single_run_does(starts):
    loop = zhang2007.scenario("fig4").loop
    rng = np.random.default_rng(1)
    converged = np.argwhere(starts.fate.values == basin.CONVERGED)
    anywhere = rng.integers(0, 40, (8, 2))
    for row, column in np.concatenate([rng.choice(converged, 8), anywhere]):
        one = starts.isel(start_x=column, start_y=row)
        begin = float(one.start_x), float(one.start_y)
        run = es.simulate(loop.replace({"start": begin}), basin.T_END)
        escaped = run.attrs["outcome"] == "escaped"
        assert one.fate == (basin.ESCAPED if escaped else basin.CONVERGED)
        if escaped:
            assert float(one.end_time) == pytest.approx(run.attrs["end_time"], rel=1e-3)
        else:
            away = np.linalg.norm(run.position.values - (-1, -1), axis=1)
            last = run.time.values[away > basin.RADIUS].max()
            assert float(one.settling_time) == pytest.approx(last, abs=run.time.values[1] * 1.01)


def test_the_basin_is_mirrored_at_the_source_where_the_dither_is_half_a_turn_later(
    starts, monkeypatch
):
    turned = {
        "controller.channels.0.dither.phase": pi,
        "controller.channels.1.dither.phase": pi / 2,
    }
    scenario = zhang2007.scenario("fig4").replace(
        {f"loop.{path}": value for path, value in turned.items()}
    )
    monkeypatch.setattr(basin.zhang2007, "scenario", lambda name: scenario)
    mirrored = tuple((-2 - high, -2 - low) for low, high in basin.RANGES)
    monkeypatch.setattr(basin, "RANGES", mirrored)
    np.testing.assert_array_equal(basin.study(1600).fate, starts.fate[::-1, ::-1])


def test_the_whole_boundary_of_the_basin_is_seen_but_where_it_leaves_below(starts):
    fate = starts.fate.values
    edges = fate[-1], fate[:, 0], fate[:, -1]
    assert all((edge == basin.ESCAPED).all() for edge in edges)
    assert 0.1 < (fate == basin.CONVERGED).mean() < 0.3


# --- gain and frequency -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def maps():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gain_frequency, "NODES", 6)
        patch.setattr(gain_frequency, "GAINS", (0.7, 100.0))
        yield gain_frequency.study(6 * 16**2)


def test_simulation_converges_where_the_multipliers_are_inside_the_unit_circle(maps):
    sure = abs(maps.exponent) * gain_frequency.T_END > gain_frequency.SLOW
    agree = maps.converged.isel(offset=0) == (maps.exponent < 0)
    for scheme in gain_frequency.SCHEMES:
        assert agree.where(sure, drop=True).sel(scheme=scheme).mean() >= 0.99
        assert sure.sel(scheme=scheme).mean() > 0.85
    for scheme in ("force", "unstable"):
        stable = (maps.exponent < 0).sel(scheme=scheme).where(sure.sel(scheme=scheme))
        assert 0.1 < stable.mean() < 0.9
    wrong = (maps.converged.isel(offset=0) != (maps.exponent < 0)).mean(("frequency", "gain"))
    np.testing.assert_allclose(maps.disagreement.sum("reason"), wrong, atol=1e-6)


def test_the_interpolated_exponents_are_those_of_the_orbit(maps):
    rng = np.random.default_rng(5)
    for scheme, name in gain_frequency.SCHEMES.items():
        loop = gain_frequency.centred(name)
        for row, column in rng.integers(0, maps.sizes["gain"], (6, 2)):
            one = maps.sel(scheme=scheme).isel(frequency=row, gain=column)
            gain = float(one.gain)
            changed = loop.replace(
                {
                    "controller.frequency": float(one.frequency),
                    "controller.channels.0.gain": gain,
                    "controller.channels.1.gain": gain,
                }
            )
            exact = periodic_orbit(changed).exponents[0].real
            assert float(one.exponent) == pytest.approx(exact, rel=0.25, abs=0.03)


def test_the_averaged_condition_is_the_closed_form(maps):
    averaged, gain = maps.averaged.sel(scheme="unstable"), maps.gain
    limit = 0.05 / (0.05 * 0.5)
    clear = abs(gain / limit - 1) > 0.2
    assert ((averaged < 0) == (gain > limit)).where(clear, True).all()
    assert (maps.averaged.sel(scheme=["velocity", "force"]) < 0).all()


def test_a_start_farther_off_converges_on_less_of_the_map(maps):
    near, far = (maps.converged.isel(offset=k) for k in (0, 1))
    assert far.mean() < near.mean()
    assert (near | ~far).mean() > 0.99


# --- unknown curvature ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def draws():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(unknown_curvature, "NODES", 13)
        yield unknown_curvature.study(2000)


def test_loops_that_do_not_escape_converge_where_the_orbit_is_stable(draws):
    stable = unknown_curvature.predicted(draws, draws.q_x.values, draws.q_y.values)
    smaller = np.minimum(draws.q_x, draws.q_y).values
    clear = abs(np.log(smaller / (0.5 / 3))) > 0.15
    asked = clear & (draws.fate.values != unknown_curvature.ESCAPED)
    agree = (draws.fate.values == unknown_curvature.CONVERGED) == stable
    assert asked.sum() > 1200
    assert agree[asked].mean() >= 0.99
    assert 0.3 < stable[asked].mean() < 0.9


def test_the_exponents_on_the_grid_are_those_of_its_orbits(draws):
    loop = zhang2007.scenario("unstable").loop
    for one in (draws.isel(grid_x=12, grid_y=5), draws.isel(grid_x=4, grid_y=9)):
        q = {"field.q.0": float(one.grid_x), "field.q.1": float(one.grid_y)}
        exact = periodic_orbit(loop.replace(q)).exponents[0].real
        assert float(one.exponent) == pytest.approx(exact, rel=1e-5)


def test_the_averaged_limits_are_the_closed_form(draws):
    expected = np.minimum(draws.grid_x, draws.grid_y) * 0.2 * 15 > 0.5
    assert ((draws.averaged < 0) == expected.transpose(*draws.averaged.dims)).all()


def test_curvatures_are_log_uniform_about_the_scenarios(draws):
    for q, nominal in ((draws.q_x, 1.0), (draws.q_y, 0.5)):
        turns = np.sort(np.log10(q.values / nominal))
        even = np.linspace(-1, 1, len(turns))
        assert abs(turns - even).max() < 0.1


# --- all of them ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["starts", "maps", "draws"])
def test_figures_say_how_many_loops_they_show(name, request, tmp_path):
    found = request.getfixturevalue(name)
    module = {"starts": basin, "maps": gain_frequency, "draws": unknown_curvature}[name]
    figure = module.figure(found)
    figure.savefig(tmp_path / "figure.png")
    assert f"{found.attrs['loops']:,}" in figure.get_suptitle()
    assert found.attrs["finding"]


@pytest.mark.parametrize("name", NAMES)
def test_too_few_loops_are_refused(name):
    one = ready(name)
    for loops in (one.least - 1, 0, -5, 1.5, True):
        with pytest.raises(InvalidDescription, match=f"at least {one.least}"):
            one.study(loops)


def test_an_unknown_study_is_refused():
    with pytest.raises(InvalidDescription, match="did you mean 'cloud'"):
        ready("clouds")
