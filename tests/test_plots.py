"""What the figures show: values in the places where the run has them, and words that fit."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from PIL import Image

import extremum as es
from extremum import plots, s
from extremum.papers import zhang2007
from extremum.plots import films


def simulated(name: str, **changes: Any) -> Any:
    scenario = zhang2007.scenario(name)
    loop = scenario.loop.replace(changes) if changes else scenario.loop
    return es.simulate(loop, min(scenario.run.t_end, 20), samples=800, title=scenario.title)


def of_dimension(count: int, **parts: Any) -> Any:
    ratios = (3, 4, 5, 7, 11)[:count]
    channels = tuple(es.Channel(dither=es.Dither(0.1), gain=5, ratio=ratio) for ratio in ratios)
    source = tuple((-1.0) ** axis * (1 + axis / 3) for axis in range(count))
    given = {
        "field": es.Quadratic(source=source, q=[1.0] * count, peak=1.0),
        "vehicle": es.PointMass(axes=(1 / s,) * count),
        "controller": es.GradientES(frequency=10, washout=1.0, channels=channels),
        "start": (0,) * count,
    }
    return es.simulate(es.Loop(**(given | parts)), 2.0, samples=300, title=f"{count} axes")


@pytest.fixture(scope="module")
def still() -> Any:
    return simulated("fig4")


@pytest.fixture(scope="module")
def moving() -> Any:
    return simulated("fig5")


@pytest.fixture(scope="module")
def escaped() -> Any:
    run = simulated("fig4", **{"field.peak": -4.0})
    assert run.attrs["outcome"] == "escaped"
    return run


def lines(axes: Any, label: str) -> list[Any]:
    return [line for line in axes.lines if line.get_label() == label]


def line(axes: Any, label: str) -> Any:
    (found,) = lines(axes, label)
    return found


def draw(figure: Figure) -> Any:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas.get_renderer()


def opened(path: Path) -> Any:
    return Image.open(path)


def title(figure: Figure) -> str:
    return figure.get_suptitle()


# --- labels -----------------------------------------------------------------------------------


def test_labels_carry_the_units_of_the_run(still: Any) -> None:
    panels = plots.overview(still).axes
    assert [a.get_ylabel() for a in panels] == ["$J$", "$y$ (m)", "$v_{x}$ (m/s)", "$v_{y}$ (m/s)"]
    assert [a.get_xlabel() for a in panels] == ["$t$ (s)", "$x$ (m)", "$t$ (s)", "$t$ (s)"]


def test_powers_in_units_are_raised_and_a_unit_of_the_signal_is_shown() -> None:
    run = simulated("fig6")
    run.J.attrs["units"] = "m"
    panels = plots.overview(run).axes
    assert panels[0].get_ylabel() == "$J$ (m)"
    assert panels[2].get_ylabel() == "$u_{x}$ (m/s²)"
    colour_bar: Any = plots.trajectory(run).axes[0].child_axes[0]
    assert colour_bar.get_title() == "$J$ (m)"


def test_each_input_has_its_own_unit() -> None:
    run = of_dimension(2, vehicle=es.PointMass(axes=(1 / s, 1 / s**2)))
    labels = [axes.get_ylabel() for axes in plots.overview(run).axes[2:]]
    assert labels == ["$v_{x}$ (m/s)", "$u_{y}$ (m/s²)"]


@pytest.mark.parametrize("draws", [plots.overview, plots.trajectory])
def test_title_and_legend_fit_into_the_figure(moving: Any, draws: Any) -> None:
    run = moving.assign_attrs(title="A title as long as this must be wrapped, $5 and $_: " * 4)
    figure = draws(run)
    renderer = draw(figure)
    assert title(figure).replace("\n", " ") == run.attrs["title"].strip()
    for text in (figure.texts[0], figure.legends[0]):
        box = text.get_window_extent(renderer)
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1
        assert all(not box.overlaps(axes.get_tightbbox(renderer)) for axes in figure.axes)


# --- ranges -----------------------------------------------------------------------------------


def test_view_sets_every_range(still: Any) -> None:
    view = es.View(signal=(-12, 2), position=((-5, 2), (-3, 4)), inputs=((-80, 40), (-100, 60)))
    output, path, first, second = plots.overview(still, view).axes
    assert output.get_ylim() == (-12, 2)
    assert (path.get_xlim(), path.get_ylim()) == ((-5, 2), (-3, 4))
    assert (first.get_ylim(), second.get_ylim()) == ((-80, 40), (-100, 60))
    axes = plots.trajectory(still, view).axes[0]
    assert (axes.get_xlim(), axes.get_ylim()) == ((-5, 2), (-3, 4))
    assert axes.get_aspect() == 1


def test_without_view_everything_is_in_range_and_to_scale(moving: Any) -> None:
    axes = plots.overview(moving).axes[1]
    for low, high, axis in ((*axes.get_xlim(), 0), (*axes.get_ylim(), 1)):
        for name in ("position", "source"):
            assert low < moving[name][:, axis].min()
            assert moving[name][:, axis].max() < high
    assert axes.get_aspect() == 1


def test_ranges_too_unequal_are_not_drawn_to_scale(still: Any) -> None:
    view = es.View(position=((-5, 2), (-300, 400)))
    assert plots.trajectory(still, view).axes[0].get_aspect() == "auto"


@pytest.mark.parametrize("name", ["position", "inputs"])
@pytest.mark.parametrize("draws", [plots.overview, plots.trajectory])
def test_view_of_another_dimension_is_refused(still: Any, name: str, draws: Any) -> None:
    with pytest.raises(es.InvalidDescription, match=rf"view\.{name}: has 3 ranges for 2"):
        draws(still, es.View(**{name: ((0, 1),) * 3}))


# --- what stands where --------------------------------------------------------------------------


@pytest.mark.parametrize("draws", [plots.overview, plots.trajectory])
def test_marks_of_a_still_source(still: Any, draws: Any) -> None:
    axes = draws(still).axes[1 if draws is plots.overview else 0]
    assert line(axes, "source").get_xydata().tolist() == [[-1, -1]]
    assert line(axes, "start").get_xydata().tolist() == [[1, 1]]
    assert np.array_equal(line(axes, "end").get_xydata(), still.position[-1:])
    assert np.array_equal(line(axes, "vehicle").get_xydata(), still.position)


def test_moving_source_is_dashed_and_its_ends_are_marked(moving: Any) -> None:
    axes = plots.trajectory(moving).axes[0]
    path = line(axes, "source")
    assert np.array_equal(path.get_xydata(), moving.source)
    assert path.is_dashed()
    assert not line(axes, "vehicle").is_dashed()
    ends = [line(axes, f"source at the {end}").get_xydata()[0] for end in ("start", "end")]
    assert np.array_equal(ends, moving.source[[0, -1]])


def contours(figure: Figure) -> list[QuadContourSet]:
    return [c for c in figure.axes[0].collections if isinstance(c, QuadContourSet) and c.filled]


def test_contours_are_those_of_the_last_moment(moving: Any) -> None:
    (filled,) = contours(plots.trajectory(moving))
    top = [path for path in filled.get_paths() if len(path)][-1].get_extents()
    assert top.contains(*moving.source.values[-1])
    assert not top.contains(*moving.source.values[len(moving.time) // 2])


def test_without_scenario_there_are_no_contours() -> None:
    field = es.Opaque(lambda p, t: float(-p @ p))
    loop = zhang2007.scenario("fig4").loop.replace({"field": field})
    figure = plots.trajectory(es.simulate(loop, 0.5, samples=50))
    draw(figure)
    assert contours(figure) == []


def test_gridded_field_is_not_evaluated_beyond_its_data() -> None:
    x = np.linspace(-1, 1, 9)
    grid = es.Gridded(es.Grid([x, x], np.add.outer(-(x**2), -(x**2))))
    carried = es.Moving(grid, ("t", "0"))
    mesh = np.meshgrid(np.linspace(-2, 4, 25), np.linspace(-2, 2, 17))
    for field, shift in ((grid, 0), (carried, 2)):
        values = field.at(*mesh, time=2.0)
        inside = (abs(mesh[0] - shift) <= 1) & (abs(mesh[1]) <= 1)
        assert np.array_equal(np.isfinite(values), inside)
        law = -((mesh[0] - shift) ** 2) - mesh[1] ** 2
        assert values[inside] == pytest.approx(law[inside], abs=1e-12)


def test_run_that_left_the_data_is_drawn() -> None:
    x = np.linspace(-1, 1, 9)
    field = es.Gridded(es.Grid([x, x], np.add.outer(2 * x, 0 * x)))
    loop = zhang2007.scenario("nondiagonal").loop.replace({"field": field})
    run = es.simulate(loop, 20.0, samples=500)
    figure = plots.trajectory(run)
    draw(figure)
    assert title(figure) == f"left the data at t = {run.attrs['end_time']:.4g} s"
    assert contours(figure)


# --- the averaged path --------------------------------------------------------------------------


def test_averaged_path_lies_over_the_true_one_and_is_named() -> None:
    loop = zhang2007.scenario("fig5").loop
    run, averaged = es.simulate(loop, 2.0, samples=200), es.average(loop).simulate(2.0, samples=50)
    figure = plots.overview(run, averaged=averaged)
    path = line(figure.axes[1], "averaged")
    assert np.array_equal(path.get_xydata(), averaged.position)
    assert path.get_zorder() > line(figure.axes[1], "vehicle").get_zorder()
    styles = [line(figure.axes[1], name).get_linestyle() for name in ("source", "averaged")]
    assert styles == ["--", "-."]
    assert "averaged" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert figure.axes[1].get_xlim() == plots.overview(run).axes[1].get_xlim()


@pytest.mark.parametrize("count", [1, 4])
def test_averaged_positions_over_time_have_their_axis_colour(count: int) -> None:
    run = of_dimension(count)
    averaged = run.isel(time=slice(0, 200, 10))
    axes = plots.overview(run, averaged=averaged).axes[1]
    means = [curve for curve in axes.lines if curve.get_linestyle() == "-."]
    assert len(means) == count
    assert means[0].get_label() == "averaged"
    for index, mean in enumerate(means):
        assert np.array_equal(mean.get_xdata(), averaged.time)
        assert np.array_equal(mean.get_ydata(), averaged.position[:, index])
        if count > 1:
            assert mean.get_color() == line(axes, f"$x_{{{index + 1}}}$").get_color()


def test_averaged_path_in_space() -> None:
    run = of_dimension(3)
    axes: Any = plots.overview(run, averaged=run.isel(time=slice(0, 100))).axes[1]
    assert np.array_equal(np.transpose(line(axes, "averaged").get_data_3d()), run.position[:100])


def test_averaged_path_of_other_axes_is_refused(still: Any) -> None:
    unfinished: Any = es.average(zhang2007.scenario("fig4").loop)
    for wrong in (of_dimension(3), unfinished):
        with pytest.raises(
            es.InvalidDescription, match=r"averaged = \w+: must .* the run's 2 axes"
        ):
            plots.overview(still, averaged=wrong)


# --- runs that ended early ----------------------------------------------------------------------


def test_escape_is_named_and_marked(escaped: Any) -> None:
    figure = plots.overview(escaped)
    draw(figure)
    end = escaped.attrs["end_time"]
    assert title(figure).endswith(f"\nescaped at t = {end:.4g} s")
    for axes in (figure.axes[0], *figure.axes[2:]):
        assert line(axes, "escaped").get_xdata() == [end, end]
        assert axes.get_xlim()[1] > end
    assert line(figure.axes[1], "end (outside)").get_marker() == "X"


def test_completed_run_says_nothing_of_an_end(still: Any) -> None:
    figure = plots.overview(still)
    assert title(figure) == still.attrs["title"]
    assert not lines(figure.axes[0], "completed")


def test_escape_does_not_hide_what_came_before(escaped: Any) -> None:
    far = escaped.copy(deep=True)
    far["J"][-1], far["position"][-1] = -1e30, 1e15
    figure = plots.overview(far)
    draw(figure)
    assert figure.axes[0].get_ylim()[0] > -1e4
    assert figure.axes[1].get_xlim()[1] < 1e4


@pytest.mark.parametrize("draws", [plots.overview, plots.trajectory])
def test_single_sample_is_drawn(still: Any, draws: Any) -> None:
    run = still.isel(time=slice(0, 1)).assign_attrs(outcome="escaped", end_time=0.0)
    figure = draws(run)
    draw(figure)
    assert "escaped at t = 0 s" in title(figure)


# --- other dimensions ---------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (3, 3), (4, 2), (5, 3)])
def test_layout(count: int, columns: int) -> None:
    run = of_dimension(count)
    figure = plots.overview(run)
    draw(figure)
    assert len(figure.axes) == 2 + count
    first_row = {round(axes.get_position().x0, 3) for axes in figure.axes[2:]}
    assert len(first_row) == columns
    assert (figure.axes[1].name == "3d") == (count == 3)
    draw(plots.trajectory(run))


def test_one_axis_shows_position_over_time_and_the_signal_along_it() -> None:
    run = of_dimension(1)
    axes = plots.overview(run).axes[1]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$t$ (s)", "$x$ (m)")
    assert np.array_equal(line(axes, "$x$").get_ydata(), run.position[:, 0])
    assert set(line(axes, "source").get_ydata()) == {1.0}
    axes = plots.trajectory(run).axes[0]
    assert line(axes, "source").get_xydata().tolist() == [[1, 1]]
    x, signal = line(axes, "field").get_xydata().T
    assert signal == pytest.approx(1 - (x - 1) ** 2)


def test_three_axes_are_drawn_in_space() -> None:
    run = of_dimension(3)
    axes: Any = plots.trajectory(run).axes[0]
    assert (axes.get_xlabel(), axes.get_zlabel()) == ("$x$ (m)", "$z$ (m)")
    star = line(axes, "source")
    assert np.ravel(star.get_data_3d()) == pytest.approx(run.source.values[-1])


def test_many_axes_are_told_apart_without_colour() -> None:
    run = of_dimension(5)
    axes = plots.trajectory(run).axes[0]
    tracks = [line(axes, f"$x_{{{i + 1}}}$") for i in range(5)]
    assert len({str(track.get_marker()) for track in tracks}) == 5
    for index, track in enumerate(tracks):
        assert np.array_equal(track.get_ydata(), run.position[:, index])


# --- animation ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["still", "moving"])
def test_animation_has_the_frames_asked_for(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path = tmp_path / "film.gif"
    plots.animate(request.getfixturevalue(name), path, seconds=0.6, frames_per_second=10)
    assert list(tmp_path.iterdir()) == [path]
    with opened(path) as film:
        assert (film.n_frames, film.info["duration"], film.info["loop"]) == (6, 100, 0)
        frames = []
        for index in range(6):
            film.seek(index)
            frames.append(np.asarray(film.convert("RGB"), dtype=int))
    assert (frames[0][0, 0] == 255).all()
    assert all((a != b).any() for a, b in itertools.pairwise(frames))


def test_last_frame_shows_the_end(still: Any, tmp_path: Path) -> None:
    plots.animate(still, tmp_path / "film.gif", seconds=0.2, frames_per_second=10)
    film = films._film(still, es.View(), still.time.values)
    film.show(float(still.time[-1]))
    canvas = FigureCanvasAgg(film.figure)
    canvas.draw()
    wanted = np.asarray(canvas.buffer_rgba(), dtype=int)[..., :3]
    with opened(tmp_path / "film.gif") as shown:
        shown.seek(1)
        assert abs(np.asarray(shown.convert("RGB"), dtype=int) - wanted).mean() < 1


@pytest.mark.parametrize("count", [1, 3, 5])
def test_animation_in_other_dimensions(count: int, tmp_path: Path) -> None:
    plots.animate(of_dimension(count), tmp_path / "film.gif", seconds=0.2, frames_per_second=10)
    with opened(tmp_path / "film.gif") as film:
        assert film.n_frames == 2


@pytest.mark.parametrize("failure", [KeyboardInterrupt, RuntimeError])
def test_failure_leaves_what_was_there(
    still: Any, failure: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "film.gif"
    path.write_bytes(b"earlier")
    quantize, asked = Image.Image.quantize, itertools.count()

    def fails_at_the_third_frame(picture: Image.Image, **options: Any) -> Image.Image:
        if next(asked) == 2:
            raise failure
        return quantize(picture, **options)

    monkeypatch.setattr(Image.Image, "quantize", fails_at_the_third_frame)
    with pytest.raises(failure):
        plots.animate(still, path, seconds=1)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"earlier"


def test_mp4_without_ffmpeg_is_refused(
    still: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
    with pytest.raises(es.InvalidDescription, match="needs the program ffmpeg"):
        plots.animate(still, tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")
def test_mp4(still: Any, tmp_path: Path) -> None:
    plots.animate(still, tmp_path / "film.mp4", seconds=0.4, frames_per_second=10)
    (path,) = tmp_path.iterdir()
    assert path.read_bytes()[4:8] == b"ftyp"


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")
def test_interrupted_mp4_leaves_nothing(
    still: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(writer: FFMpegWriter) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(FFMpegWriter, "grab_frame", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plots.animate(still, tmp_path / "film.mp4", seconds=0.4)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("film.avi", {}, r"path = 'film\.avi': must end in \.gif or \.mp4"),
        ("missing/film.gif", {}, r"path = 'film\.gif': there is no folder .*missing"),
        ("film.gif", {"seconds": 0}, "seconds = 0: must be a finite number greater than 0"),
        ("film.gif", {"frames_per_second": -1}, "frames_per_second = -1: must be"),
        ("film.gif", {"view": es.View(position=((0, 1),))}, r"view\.position: has 1 ranges for 2"),
    ],
)
def test_what_cannot_be_written_is_refused(
    still: Any, tmp_path: Path, name: str, arguments: Any, message: str
) -> None:
    with pytest.raises(es.InvalidDescription, match=message):
        plots.animate(still, tmp_path / name, **arguments)
    assert not list(tmp_path.iterdir())


# --- manners ------------------------------------------------------------------------------------


def test_run_and_settings_are_left_as_they_are(moving: Any, tmp_path: Path) -> None:
    before, settings = moving.copy(deep=True), dict(matplotlib.rcParams)
    plots.overview(moving)
    plots.trajectory(moving)
    plots.animate(moving, tmp_path / "film.gif", seconds=0.1, frames_per_second=10)
    assert moving.identical(before)
    assert dict(matplotlib.rcParams) == settings


def test_matplotlib_is_imported_late_and_pyplot_never(tmp_path: Path) -> None:
    program = f"""
import sys
import extremum as es
from extremum.papers import zhang2007
assert "matplotlib" not in sys.modules
run = es.simulate(zhang2007.scenario("fig4").loop, 0.1, samples=10)
es.plots.overview(run)
es.plots.trajectory(run)
es.plots.animate(run, {str(tmp_path / "film.gif")!r}, seconds=0.1)
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_what_a_sampled_controller_received_is_behind_j() -> None:
    loop = zhang2007.scenario("fig4").loop
    noisy = es.simulate_sampled(loop, 2e-3, 0.5, sensor=es.Sensor(noise=0.3))
    figure = es.plots.overview(noisy)
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "received" in named
    line = figure.axes[0].get_lines()[-1]
    assert np.array_equal(line.get_ydata(), noisy.sensed.values)
    ideal = es.plots.overview(es.simulate_sampled(loop, 2e-3, 0.5))
    assert "received" not in [text.get_text() for text in ideal.legends[0].get_texts()]
