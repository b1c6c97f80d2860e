"""A film has the frames that it should have, to one scale, and plays as long as asked for."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import InputError
from cosim.face import load, run
from cosim.results.film import HOLD, STATE, Film, _paced, film_of
from cosim.results.result import Result
from cosim.results.scene_plot import ARROW_LENGTH, arrow_of, draw
from tests.helpers.motions import FREE, PLAIN

MOVING = (PLAIN, *FREE, 'forward={duration="0.02 s",must_rest=false}', "output.frames=4")


@pytest.fixture(scope="module")
def moved() -> Result:
    """A motion of a hood without a shape, whose frames are spread over its steps."""
    return run(load("pulley_edc", MOVING))


@pytest.fixture(scope="module")
def rested() -> Result:
    return run(load("pulley_edc", ["output.picture=false"]))


def read_gif(path: Path) -> tuple[list[np.ndarray], list[float]]:
    """The pictures of a film and how long each is shown, s."""
    with Image.open(path) as file:
        shown = []
        for k in range(file.n_frames):
            file.seek(k)
            shown.append((np.array(file.convert("RGB")), file.info["duration"] / 1000))
    return [a for a, _ in shown], [b for _, b in shown]


def test_a_gif_has_the_frames_of_the_motion_at_the_speed_asked_for(moved, tmp_path):
    path = tmp_path / "a.gif"
    film = moved.animate(path, fps=10, speed=0.05, width=300)
    pictures, seconds = read_gif(path)
    assert len(pictures) == len(film.shown) == 5  # 0.02 s in 0.4 s: at 0, 0.1, ... 0.4 s
    assert {a.shape for a in pictures} == {pictures[0].shape}
    assert pictures[0].shape[1] == 300
    assert seconds == pytest.approx([0.1] * 4 + [0.1 + HOLD], abs=0.011)
    assert film.seconds == pytest.approx(sum(seconds), abs=0.05)
    assert all(np.any(a != b) for a, b in pairwise(pictures))


def test_a_run_at_rest_shows_its_states_in_turn(rested, tmp_path):
    film = rested.animate(tmp_path / "a.gif", width=300)
    pictures, seconds = read_gif(tmp_path / "a.gif")
    assert [moment.partition(",")[0] for _, moment, _ in film.shown] == ["unloaded", "loaded"]
    assert len(pictures) == 2
    assert seconds == [STATE, STATE]
    assert "data:image/gif" in film._repr_html_()


@pytest.mark.parametrize(
    ("speed", "frames"), [(None, 11), (1.0, 11), (2.0, 6), (20.0, 2), (0.5, 11)]
)
def test_a_film_lasts_as_long_as_the_motion_over_the_speed(speed, frames):
    order = _paced(np.linspace(0, 1, 11), 10.0, speed)
    assert len(order) == frames
    assert [k for k, _ in order] == sorted({k for k, _ in order})
    assert (order[0][0], order[-1][0]) == (0, 10)
    if speed is not None and speed <= 2:
        assert sum(s for _, s in order) == pytest.approx(1 / speed + 0.1 + HOLD)


def bounds(film: Film) -> set[tuple]:
    figures = [draw(scene, film.title, film.stage, moment) for scene, moment, _ in film.shown]
    return {
        (tuple(f.get_size_inches()), *((a.get_xlim(), a.get_ylim()) for a in f.axes))
        for f in figures
    }


def test_bounds_legend_and_the_scale_of_the_force_are_those_of_all_frames(rested):
    film = rested.animate(width=300)
    assert len(bounds(film)) == 1
    lengths = [arrow_of(scene, film.stage.newtons) for scene, _, _ in film.shown]
    sizes = [1e3 * np.linalg.norm(np.diff(ends, axis=0)) for ends in lengths]
    forces = [np.linalg.norm(scene.tip[1]) for scene, _, _ in film.shown]
    assert max(sizes) == pytest.approx(ARROW_LENGTH)
    np.testing.assert_allclose(np.array(sizes) / sizes[-1], np.array(forces) / forces[-1])
    legends = [
        [t.get_text() for t in draw(s, "x", film.stage, m).legends[0].get_texts()]
        for s, m, _ in film.shown
    ]
    assert legends[0] == legends[1]


def test_what_makes_no_film_says_why(rested, tmp_path):
    with pytest.raises(InputError, match="one frame only"):
        film_of("x", rested.frames[:1], rested.scenes[:1])
    with pytest.raises(InputError, match=r"fps = 0: lies between 0\.5 and 50"):
        rested.animate(fps=0)
    with pytest.raises(InputError, match="width = 5: lies between"):
        rested.animate(width=5)
    folder = rested.save(tmp_path)
    done = CliRunner().invoke(app, ["show", str(folder), "-o", str(tmp_path / "a.avi")])
    assert done.exit_code == 2
    assert ".gif, .mp4" in done.stderr


def test_a_film_draws_each_frame_as_a_picture_of_it_alone(rested):
    """What is drawn once for all frames is under each; nothing of one is left in the next."""
    film = rested.animate(width=400)
    both = list(film.images())
    for k in (0, 1):
        (alone,) = replace(film, shown=film.shown[k : k + 1]).images()
        np.testing.assert_array_equal(np.array(alone), np.array(both[k]))
    scene, moment, _ = film.shown[1]
    figure = draw(scene, film.title, film.stage, moment)
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(400 / figure.get_figwidth())
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    wide, tall = both[1].size
    apart = np.abs(drawn[:tall, :wide] - np.array(both[1]))
    assert (apart.max(axis=2) > 60).mean() < 0.002  # lines over the axes in place of below them


def test_a_run_with_nothing_to_show_says_so(rested, monkeypatch):
    def fail(*_: object) -> None:
        raise InputError("its finger is in an FMU")

    monkeypatch.setattr("cosim.results.result.scenes_of", fail)
    bare = replace(rested)
    with (
        pytest.warns(UserWarning, match="bones and tendons are not shown"),
        pytest.raises(InputError, match="nothing to show over time"),
    ):
        bare.animate()


def test_the_command_writes_a_film(rested, tmp_path):
    folder, out = rested.save(tmp_path), tmp_path / "b.gif"
    done = CliRunner().invoke(app, ["show", str(folder), "-o", str(out), "--width", "300"])
    assert done.exit_code == 0, done.stderr
    assert "2 pictures in 3.0 s" in done.stdout
    assert len(read_gif(out)[0]) == 2


def test_a_film_is_an_mp4_where_its_extra_is_installed(rested, tmp_path):
    reader = pytest.importorskip("imageio_ffmpeg")
    rested.animate(tmp_path / "a.mp4", fps=4, width=300)
    about = next(reader.read_frames(str(tmp_path / "a.mp4")))
    assert about["duration"] == pytest.approx(2 * STATE, abs=0.3)
    assert about["size"][0] == 300
