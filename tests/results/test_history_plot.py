"""The plot of a motion names what it shows in words with units, and shows nothing that is not."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.face import load, run
from cosim.results.history_plot import draw_history
from tests.helpers.motions import FREE, PLAIN

MOVING = (PLAIN, 'forward={duration="0.004 s",must_rest=false}')


def panels(figure) -> dict[str, list[str]]:
    """By label of the axis the names of the curves."""
    return {
        axes.get_ylabel().replace("\n", " "): [line.get_label() for line in axes.get_lines()]
        for axes in figure.axes
    }


def test_joints_tensions_and_slips_are_named_in_words():
    case = load("isometric_edc_transversely_isotropic", [*MOVING, *FREE, "hood.mesh.quads=120"])
    data = run(case).data
    shown = panels(draw_history(data, "x"))
    assert list(shown) == [
        "joints turned by, deg",
        "tension of the tendons that are pulled, N",
        "force in the slips, N",
    ]  # a free finger has no force
    joints, tendons, slips = shown.values()
    assert joints[:2] == ["MCP flexion (from 30°)", "MCP abduction (from 0°)"]
    assert tendons == ["EDC"]
    assert slips == ["central slip", "terminal slip"]
    assert "_" not in str(shown)


def test_a_finger_that_pushes_has_a_panel_of_its_force():
    result = run(load("forward_edc", ['forward.duration="0.01 s"', "forward.must_rest=false"]))
    figure = draw_history(result.data, "x")
    name = "fingertip on the world, N"
    assert panels(figure)[name] == ["distal", "radial", "dorsal", "magnitude"]
    lines = figure.axes[1].get_lines()
    size = np.linalg.norm([line.get_ydata() for line in lines[:3]], axis=0)
    np.testing.assert_allclose(lines[3].get_ydata(), size)


def test_a_load_that_is_held_has_a_history_over_the_logarithm_of_its_time():
    law = 'relaxation={tendons={weights=[0.5],times=["10 s"]},held="40 s"}'
    drawn = 'tendons.FDP={excursion="2 mm",elastic={stiffness="20 N/mm"}}'
    result = run(load("pulley_edc", ['finger.tip.kind="posture"', drawn, law]))
    figure = draw_history(result.data, "x")
    assert {axes.get_xscale() for axes in figure.axes} == {"log"}
    assert panels(figure)["tension of the tendons that are pulled, N"] == ["EDC", "FDP"]
    times = figure.axes[0].get_lines()[0].get_xdata()
    assert 0 < times[0] < times[1]
    assert times[-1] == pytest.approx(40)
    assert result.plot(kind="history") is not None
