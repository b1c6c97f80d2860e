"""A window in space shows every frame of a run, and its slider, timer and key play them."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.face import load, run
from cosim.results.result import Result
from cosim.results.scene_view import Player, _add_controls, player_of
from tests.helpers.motions import FREE, PLAIN

pyvista = pytest.importorskip("pyvista")


@pytest.fixture(autouse=True)
def _off_screen(monkeypatch):
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)


@pytest.fixture(scope="module")
def moved() -> Result:
    forward = 'forward={duration="0.006 s",must_rest=false}'
    name = "isometric_edc_transversely_isotropic"
    settings = (PLAIN, *FREE, forward, "hood.mesh.quads=120", "output.frames=3")
    return run(load(name, settings))


def player(result: Result) -> Player:
    return player_of(result.scenes, [frame.label for frame in result.frames], result.title)


def test_each_frame_shows_its_own_hood_bones_and_tendons(moved):
    shown = player(moved)
    for k in (0, 3, 1):
        shown.show(k)
        scene = moved.scenes[k]
        np.testing.assert_allclose(shown.meshes["hood"].points, scene.hood.points, atol=1e-7)
        strain = 100 * scene.hood.cell_data["longitudinal_strain"]
        np.testing.assert_allclose(shown.meshes["hood"]["shown"], strain, atol=1e-9)
        for name, vertices, _ in scene.bones:
            mesh = shown.meshes[f"bone {name}"]
            np.testing.assert_allclose(mesh.points, vertices, atol=1e-7)
        visible = {n for n in shown.meshes if shown.plotter.actors[n].GetVisibility()}
        assert ("tendons True" in visible) == any(n in scene.pulled for n, _ in scene.tendons)
        assert "force" not in visible  # the fingertip is free
    shown.plotter.close()


def test_the_controls_play_stop_and_choose(moved):
    shown = player(moved)
    _add_controls(shown.plotter, shown)
    assert shown.is_playing
    assert shown.k == 3
    shown.step()
    assert (shown.k, shown.slider.GetRepresentation().GetValue()) == (0, 0)
    shown.step()
    assert shown.k == 1
    shown.toggle()
    shown.step()
    assert shown.k == 1
    shown.toggle()
    shown.choose(2.2)
    assert (shown.k, shown.is_playing) == (2, False)
    shown.plotter.close()


def test_a_run_without_a_hood_is_shown_with_its_force():
    result = run(load("pulley_edc", ["output.picture=false"]))
    shown = player(result)
    assert "hood" not in shown.meshes
    arrow = shown.meshes["force"].points
    tip, force = result.scene.tip
    np.testing.assert_allclose(
        np.sort(((arrow - tip) @ force) / np.linalg.norm(force))[[0, -1]], [0, 0.015], atol=1e-4
    )
    before = shown.plotter.screenshot(return_img=True)
    shown.show(0)
    assert np.any(before != shown.plotter.screenshot(return_img=True))
    shown.plotter.close()
