"""The picture of a run: what it draws is in its frame, in its legend, and to one scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text

from cosim.face import load, run
from cosim.hoods.kinds import COLOURS, colours_of
from cosim.results.looks import BONE, INKS, colour_limits, colour_map
from cosim.results.result import Result
from cosim.results.scene_plot import VIEWS, draw, stage_of

# Machado et al. 2009: what the colours look like to readers without one kind of cones.
VISION = {
    "all": np.eye(3),
    "protanopia": np.array(
        [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]]
    ),
    "deuteranopia": np.array(
        [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]]
    ),
    "tritanopia": np.array(
        [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]]
    ),
}


def lab(colours, vision: np.ndarray) -> np.ndarray:
    """CIELAB (n, 3) of colours as such a reader sees them."""
    rgb = np.array([to_rgb(c) for c in colours])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ vision.T
    to_xyz = np.array(
        [[0.4125, 0.3576, 0.1804], [0.2127, 0.7152, 0.0722], [0.0193, 0.1192, 0.9503]]
    )
    x = np.clip(linear, 0, 1) @ to_xyz.T / [0.9505, 1.0, 1.0888]
    f = np.where(x > 216 / 24389, np.cbrt(x), (24389 / 27 * x + 16) / 116)
    return np.stack(
        [116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1
    )


@pytest.mark.parametrize("vision", VISION)
def test_fibres_are_seen_on_every_colour_of_the_hood_by_every_reader(vision):
    for i, ink in enumerate(INKS):
        others = [*INKS[:i], *INKS[i + 1 :], BONE, *colour_map(True), *colour_map(False)]
        apart = lab([ink], VISION[vision]) - lab(others, VISION[vision])
        assert np.linalg.norm(apart, axis=1).min() > 20  # a difference of 2 is just seen


def test_the_middle_of_a_signed_scale_is_seen_on_white():
    middle = colour_map(True)[128]
    assert lab(["#ffffff"], VISION["all"])[0, 0] - lab([middle], VISION["all"])[0, 0] > 10
    low, high = colour_limits(np.array([-1.0, 4.0]), is_signed=True)
    assert low == -high < 0
    assert len(colour_map(True)) == len(colour_map(False)) == 256
    assert [c.is_signed for c in COLOURS if "strain along" in c.label] == [True]


@pytest.fixture(scope="module")
def result() -> Result:
    points = 'hood.points={a=["0 mm","0 mm","10.5 mm"],b=["0 mm","5 mm","9 mm"]}'
    gauge = 'hood.gauges={ab=["a","b"]}'
    small = ("hood.mesh.quads=120", "output.picture=false")
    return run(load("isometric_edc", [*small, points, gauge]))


def test_all_that_is_drawn_lies_within_the_frame_and_to_one_scale(result):
    figure = draw(result.scene, "x")
    figure.draw_without_rendering()
    scene, scales = result.scene, []
    for axes, view in zip(figure.axes, VIEWS, strict=False):
        low, high = (np.sort(ends) for ends in (axes.get_xlim(), axes.get_ylim()))
        every = [v for _, v, _ in scene.bones] + [p for _, p in scene.tendons]
        places = view.place(np.concatenate([*every, scene.hood.points]))
        assert np.all((places[:, 0] > low[0]) & (places[:, 0] < low[1]))
        assert np.all((places[:, 1] > high[0]) & (places[:, 1] < high[1]))
        box = axes.get_window_extent()
        scales += [box.width / np.ptp(low), box.height / np.ptp(high)]
        for text in axes.texts:
            shown = text.get_window_extent()
            assert figure.bbox.x0 <= shown.x0 < shown.x1 <= figure.bbox.x1, text.get_text()
    np.testing.assert_allclose(scales, scales[0], rtol=1e-6)
    for text in [*figure.texts, *figure.legends[0].get_texts()]:
        shown = text.get_window_extent()
        assert 0 <= shown.x0 < shown.x1 <= figure.bbox.x1, text.get_text()


def test_ticks_tell_distal_radial_and_dorsal_coordinates(result):
    side, top = VIEWS
    point = np.array([0.03, 0.01, -0.02])
    np.testing.assert_allclose(side.place(point), [30, -20])
    np.testing.assert_allclose(top.place(point), [30, 10])
    figure = draw(result.scene, "x")
    labels = [figure.axes[1].get_xlabel(), *(a.get_ylabel() for a in figure.axes[:2])]
    assert labels == ["distal, mm", "dorsal, mm", "radial, mm"]
    (low, high), (bottom, top_) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    assert low > high  # distal to the left, as from the radial side
    assert bottom < top_


def test_the_legend_has_all_that_is_drawn_and_nothing_else(result):
    def words(scene) -> str:
        return "; ".join(text.get_text() for text in draw(scene, "x").legends[0].get_texts())

    whole = {
        "bones": {"bones": ()},
        "tendons at rest": {"tendons": ()},
        "hood: a sheet": {"hood": None},
        "second fibre family": {"hood": None},
        "points of the experiment": {"points": {}, "gauges": {}},
        "gauges": {"gauges": {}},
        "centres of the joints": {"joints": ()},
        "force of the fingertip": {"tip": None},
        "tendons that pull": {"pulled": {}},
    }
    assert all(name in words(result.scene) for name in whole)
    for name, without in whole.items():
        assert name not in words(replace(result.scene, **without)), name


def test_names_are_those_of_bones_joints_and_the_tendons_that_pull(result):
    names = {text.get_text() for text in draw(result.scene, "x").axes[0].texts}
    assert {"metacarpal", "proximal", "middle", "distal", "MCP", "PIP", "DIP"} <= names
    assert {name for name in names if name.endswith(" N")} == {"EDC 3.47 N"}


@pytest.mark.parametrize("hand", ["right", "left"])
def test_the_line_of_a_label_starts_beside_it_and_crosses_no_other(result, hand):
    pulled = {name: 1.0 for name, _ in result.scene.tendons} | {"EDC": 1.0, "EI": 2.0}
    figure = draw(replace(result.scene, pulled=pulled, hand=hand), "x")
    figure.draw_without_rendering()
    labels = [text for text in figure.axes[0].texts if text.get_text().endswith(" N")]
    boxes = [Text.get_window_extent(text) for text in labels]
    assert len(labels) > 6
    for text, box in zip(labels, boxes, strict=True):
        line = text.arrow_patch.get_transform().transform(text.arrow_patch.get_path().vertices)
        beside = box.x0 - line[0, 0] if hand == "right" else line[0, 0] - box.x1
        assert 0 < beside < box.height
        assert box.y0 < line[0, 1] < box.y1
        along = line[0] + np.linspace(0, 1, 50)[:, None] * (line[-1] - line[0])
        assert not any(other.count_contains(along) for other in boxes)


def test_the_colour_bar_says_which_strain_in_the_words_of_the_report(result):
    bar = draw(result.scene, "x").axes[-1]
    shown = colours_of(result.scene.hood)[0]
    assert bar.get_ylabel().replace("\n", " ") == "Green-Lagrange strain along the fibres, %"
    assert bar.get_ylim() == pytest.approx(stage_of([result.scene]).limits)
    assert shown.is_signed
