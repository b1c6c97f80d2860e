"""The import of models beside OpenSim itself; skipped where the package `opensim` is not there."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigid.opensim.osim import import_osim
from tests.proofs.fingers.osim_rows import at_postures, shipped_models

F_PLACE, F_TURN = (0.1, -0.2, 0.3), (0.4, -0.3, 0.2)
M_PLACE, M_TURN = (-0.05, 0.02, 0.07), (0.3, 0.5, -0.2)
KINDS = (
    *("PinJoint", "SliderJoint", "UniversalJoint", "BallJoint"),
    *("GimbalJoint", "PlanarJoint", "FreeJoint", "WeldJoint"),
)


@pytest.mark.opensim
def test_the_finger_written_and_measured_by_opensim_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    pytest.importorskip("opensim")
    from tests.helpers import make_osim

    make_osim.main(tmp_path)
    made = import_osim(tmp_path / "finger.osim")
    told = json.loads((tmp_path / "finger_opensim.json").read_text())
    ours = at_postures(
        made.xml, tuple(told["coordinates"]), tuple(told["paths"]), np.array(told["postures"])
    )
    free = [k for k, name in enumerate(told["paths"]) if name != "EDC"]
    arms = np.array(told["moment_arms"])
    assert_allclose(ours.lengths[:, free], np.array(told["lengths"])[:, free], atol=1e-9, rtol=0)
    assert_allclose(ours.arms[:, free], arms[:, free], atol=1e-9, rtol=0)
    assert_allclose(ours.masses, told["mass_matrices"], rtol=1e-9, atol=1e-15)
    _, committed = shipped_models()
    assert_allclose(arms, committed.arms, atol=1e-9, rtol=0)


@pytest.mark.opensim
def test_opensims_joints_stand_where_opensim_has_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    opensim = pytest.importorskip("opensim")
    written = opensim.Model()
    above = written.getGround()
    for kind in KINDS:
        below = opensim.Body(kind, 1.0, opensim.Vec3(0), opensim.Inertia(1, 1, 1))
        written.addBody(below)
        places = [opensim.Vec3(*v) for v in (F_PLACE, F_TURN, M_PLACE, M_TURN)]
        made = getattr(opensim, kind)(f"{kind}_", above, *places[:2], below, *places[2:])
        written.addJoint(made)
        above = below
    written.initSystem()
    for k, coordinate_ in enumerate(written.getCoordinateSet()):
        coordinate_.setDefaultValue(0.3 * np.sin(1 + k))
    written.printToXML("joints.osim")
    state = written.initSystem()
    written.realizePosition(state)
    built = mujoco.MjModel.from_xml_string(import_osim(Path("joints.osim")).xml)
    data = mujoco.MjData(built)
    mujoco.mj_resetDataKeyframe(built, data, 0)
    mujoco.mj_forward(built, data)
    for kind in KINDS:
        there = written.getBodySet().get(kind).getTransformInGround(state)
        assert_allclose(data.body(kind).xpos, there.p().to_numpy(), atol=1e-13)
