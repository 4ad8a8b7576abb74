"""The cloud: it climbs to summits of the landscape that it averages over its dither's disc."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from extremum.studies import cloud


@pytest.fixture(scope="module")
def found():
    return cloud.study(400)


def averaged(places: np.ndarray) -> np.ndarray:
    """Return the mean altitude over the dither's disc (m), by Gauss's rule and equal angles.

    A circle with radius α demodulated at its own frequency measures
    (2/α) ⟨J(p + α e(θ)) e(θ)⟩, by Gauss's theorem the gradient of the mean of J over the disc.
    """
    loop, _ = cloud.landscape()
    nodes, weights = np.polynomial.legendre.leggauss(6)
    radii = 150.0 * np.sqrt((nodes + 1) / 2)
    angles = 2 * np.pi * np.arange(24) / 24
    offsets = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    heights = loop.field.at(*np.moveaxis(places[..., None, None, :] + offsets, -1, 0))
    return (heights.mean(axis=-1) * weights / 2).sum(axis=-1)


def inside(places: np.ndarray, margin: float) -> np.ndarray:
    _, grid = cloud.landscape()
    low, high = (np.array([line[end] for line in grid.axes]) for end in (0, -1))
    return np.all((places > low + margin) & (places < high - margin), axis=1)


def test_vehicles_come_to_rest_on_summits_of_the_landscape_averaged_over_the_dither(found):
    tops = found.position.values[found.summit.values >= 0]
    tops = tops[inside(tops, 400)]
    angles = 2 * np.pi * np.arange(16) / 16
    around = tops[:, None] + 60.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    lower = averaged(around).max(axis=1) < averaged(tops)
    assert len(tops) > 300
    assert lower.mean() >= 0.99


def test_no_vehicle_ends_lower_than_it_began(found):
    arrived = found.summit.values >= 0
    begun, ended = (v.values[arrived] for v in (found.start, found.position))
    there = inside(begun, 160) & inside(ended, 160)
    assert (averaged(ended[there]) >= averaged(begun[there]) - 1.0).mean() >= 0.99


def test_every_vehicle_on_the_map_is_in_the_picture(found):
    counts = found.vehicles.sum(("y", "x")).values
    assert counts[0] == 400
    assert counts[-1] == (found.outcome == 0).sum()
    assert (np.diff(counts) <= 0).all()
    row, column = np.argwhere(found.vehicles.values[0] > 0)[0]
    near = abs(found.start.values - (found.x[column].item(), found.y[row].item()))
    assert (near <= cloud.CELL / 2).all(axis=1).any()


def test_each_vehicle_counts_for_its_own_summit(found):
    which = found.summit.values
    sizes = found.summit_vehicles.values
    np.testing.assert_array_equal(np.bincount(which[which >= 0]), sizes)
    assert (np.diff(sizes) <= 0).all()
    away = found.position.values - found.summit_position.values[which]
    assert np.linalg.norm(away[which >= 0], axis=1).max() < 3 * cloud.APART


def test_vehicles_gather_where_their_cells_touch():
    places = np.array([[0.5, 0.5], [1.5, 1.5], [5.5, 5.5], [2.5, 1.5], [9.5, 0.5], [5.6, 5.4]])
    arrived = np.array([True, True, True, True, False, True])
    which, tops, sizes = cloud.gathered(places, arrived, [np.arange(11.0), np.arange(11.0)])
    np.testing.assert_array_equal(which, [0, 0, 1, 0, -1, 1])
    np.testing.assert_allclose(tops, [[1.5, 3.5 / 3], [5.55, 5.45]])
    np.testing.assert_array_equal(sizes, [3, 2])
    none = cloud.gathered(places, np.zeros(6, dtype=bool), [np.arange(11.0), np.arange(11.0)])
    assert [len(part) for part in none] == [6, 0, 0]


def test_the_figure_and_the_animation_are_written(found, tmp_path):
    figure = cloud.figure(found)
    figure.savefig(tmp_path / "cloud.png")
    assert "400 loops" in figure.get_suptitle()
    done = []
    cloud.animate(found.isel(time=slice(0, 4)), tmp_path / "cloud.gif", progress=done.append)
    with Image.open(tmp_path / "cloud.gif") as film:
        film.seek(3)
        with pytest.raises(EOFError):
            film.seek(4)
        assert film.size == (640, 620)
    assert done[-1] == 1.0
