"""The hood of a motion over time: when a shape is kept, its files, and a resumed run."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.coupling import motion
from cosim.errors import StoppedError
from cosim.hoods.view import HoodField, arrays_of, field_of
from cosim.pipeline import run_case
from cosim.results.result import Result
from cosim.solve.motion import ShapeRecorder
from cosim.solve.session import Session
from tests.helpers.motions import FREE, PLAIN, Stopper, identical

QUADS = np.array([[0, 1, 2, 3]])


class Square:
    """The view of a hood of one quad."""

    points = np.zeros((4, 3))
    plot_cells = QUADS

    def fields(self) -> tuple:
        return ()

    def lines(self) -> dict:
        return {}

    def audit(self) -> dict[str, float]:
        return {}


def at(time: float) -> SimpleNamespace:
    return SimpleNamespace(coupled=SimpleNamespace(time=time, hood=None))


def times_kept(times: np.ndarray, count: int, view: object = lambda state: Square()) -> list[float]:
    recorder = ShapeRecorder(view, float(times[-1]), count)
    shapes = recorder.begin(at(0.0))
    for time in times[1:]:
        shapes += recorder.next(at(time), shapes)
    return [float(shape["time"]) for shape in shapes]


def test_shapes_are_spaced_evenly_and_end_with_the_motion():
    steps = np.cumsum([0.0] + [1e-3] * 1000)  # with the rounding of a motion's clock
    assert times_kept(steps, 4) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    assert len(times_kept(steps, 50)) == 51
    assert times_kept(np.array([0.0, 0.1, 0.3, 0.35, 1.0]), 4) == [0.0, 0.3, 1.0]
    assert times_kept(np.array([0.0, 0.5, 1.0]), 50) == [0.0, 0.5, 1.0]  # no more than steps
    assert times_kept(steps, 0) == []
    assert times_kept(steps, 4, None) == []


def test_a_shape_is_the_same_after_it_was_arrays():
    rng = np.random.default_rng(5)
    field = HoodField(rng.random((4, 3)), QUADS, {"u": rng.random((4, 3))}, {"e": rng.random(1)})
    found = field_of(arrays_of(field), QUADS)
    np.testing.assert_array_equal(found.points, field.points)
    assert list(found.point_data) == ["u"]
    np.testing.assert_array_equal(found.cell_data["e"], field.cell_data["e"])


def moving(*settings: str) -> Case:
    forward = 'forward={duration="0.006 s",must_rest=false}'
    name = "isometric_edc_transversely_isotropic"
    return load_case(name, [PLAIN, *FREE, forward, "hood.mesh.quads=120", *settings])


@pytest.fixture(scope="module")
def whole() -> Result:
    return run_case(moving("output.frames=3"))


def test_a_motion_leaves_files_that_paraview_plays(whole: Result, tmp_path: Path) -> None:
    folder = whole.save(tmp_path)
    reader = pyvista.PVDReader(str(folder / "hood.pvd"))
    assert reader.time_values == pytest.approx([0.0, 0.002, 0.004, 0.006])
    shown = []
    for time in reader.time_values:
        reader.set_active_time_value(time)
        shown.append(reader.read()[0])
    end = pyvista.read(folder / "hood.vtu")
    np.testing.assert_array_equal(shown[-1].points, end.points)
    for name in ("longitudinal_strain", "contact_pressure", "strain_energy_density"):
        np.testing.assert_array_equal(shown[-1][name], end[name])
        assert name in shown[0].array_names
    moved = [np.abs(one.points - shown[0].points).max() for one in shown]
    assert moved[0] == 0 < moved[1] < moved[-1]
    finger = pyvista.PVDReader(str(folder / "finger.pvd"))
    assert finger.time_values == reader.time_values
    for time, scene in zip(finger.time_values, whole.scenes, strict=True):
        finger.set_active_time_value(time)
        mesh = finger.read()[0]
        lines = mesh.extract_cells(mesh.celltypes == pyvista.CellType.LINE)
        places = np.concatenate([points for _, points in scene.tendons])
        np.testing.assert_allclose(lines.points, places, atol=1e-6)
        bones = mesh.extract_cells(mesh.celltypes == pyvista.CellType.TRIANGLE)
        assert set(bones["number"]) == set(range(len(scene.bones)))
        for i, (_, vertices, _) in enumerate(scene.bones):
            shown = bones.extract_cells(bones["number"] == i).points
            np.testing.assert_allclose(np.ptp(shown, axis=0), np.ptp(vertices, axis=0), atol=2e-3)
        drawn = {scene.pulled.get(name, 0.0) for name, _ in scene.tendons}
        assert set(mesh["pull_N"]) == {0.0, *drawn}
    again = whole.save(tmp_path)  # a run may be written over
    assert len(list((again / "hood_frames").iterdir())) == 4


def test_a_resumed_motion_has_the_frames_of_one_that_was_not_stopped(
    whole: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = moving("output.frames=3")
    monkeypatch.setattr(motion, "EVERY", 3)  # steps from word to word
    with pytest.raises(StoppedError, match=r"there is kept\. Go on with: cosim run --resume"):
        run_case(case, Session(checkpoints=tmp_path), Stopper(1))
    resumed = run_case(case, Session(checkpoints=tmp_path))
    assert identical(whole, resumed)
    assert len(resumed.scene.frames) == 4
    for (t, one), (u, other) in zip(whole.scene.frames, resumed.scene.frames, strict=True):
        assert t == u
        a, b = arrays_of(one), arrays_of(other)
        assert a.keys() == b.keys()
        assert all(a[name].tobytes() == b[name].tobytes() for name in a)
