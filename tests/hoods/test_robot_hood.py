"""The robotic finger under a hood of cables in its pulley's place."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.fingers.kinds import finger_model, skeleton_of
from cosim.hoods.cable.table import ENDS
from cosim.models.build import bone_surfaces
from cosim.solve.solvers import solve
from fe_solver.surfaces.shapes import Capsule
from meshes.cable_net import CableNet, cable_of, lay
from meshes.robot_net import OTHERS, keep_extensor, wider
from meshes.skeleton import BODIES, Skeleton
from rigid.fingers.robot import robot_finger
from rigid.fingers.robot_tables import JOINTS, LENGTHS
from rigid.mujoco.finger import MujocoFinger

ROBOT_ENDS = ENDS["robot"]
CABLES, PULLEYS = "robot_cable_extensor", "robot_pulleys_extensor"


def robot_skeleton() -> Skeleton:
    return skeleton_of(load_case(CABLES).native_finger())


@pytest.fixture(scope="module")
def whole() -> CableNet:
    """The net of all muscles over round bones of the robotic finger's lengths."""
    skeleton = robot_skeleton()
    ends = [(-0.03, 0.0), *((0.0, length) for length in LENGTHS)]
    bones = {
        body: Capsule(np.array([a, 0, 0]), np.array([b, 0, 0]), radius)
        for body, (a, b), radius in zip(BODIES, ends, (6e-3, 5e-3, 4e-3, 3e-3), strict=True)
    }
    straight = dict.fromkeys(("MCP", "PIP", "DIP"), 0.0)
    return lay(skeleton, bones, dict.fromkeys(BODIES, 1.5e-3), straight, 1.5e-3, wider(skeleton))


def test_bodies_stand_where_the_fingers_do() -> None:
    angle = np.radians([30.0, -12.0, 50.0, 25.0])
    position, rotation = robot_skeleton().pose(dict(zip(JOINTS, angle, strict=True)))
    motion = MujocoFinger(robot_finger()).chain(angle).motion
    np.testing.assert_allclose(position, motion.position, atol=1e-12)
    np.testing.assert_allclose(rotation, motion.rotation, atol=1e-12)


def test_bones_reach_from_joint_to_joint() -> None:
    bones = bone_surfaces(load_case(CABLES))
    human = bone_surfaces(load_case("cable_edc"))
    for body, length, own in zip(BODIES[1:], LENGTHS, robot_skeleton().length[1:], strict=True):
        assert own == length
        scale = np.ptp(bones[body][0][:, 0]) / np.ptp(human[body][0][:, 0])
        assert scale * _human_length(body) == pytest.approx(length, rel=5e-3)


def _human_length(body: str) -> float:
    from meshes.skeleton import index_finger

    return float(index_finger().length[BODIES.index(body)])


def test_the_extensor_alone_pulls_the_net(whole: CableNet) -> None:
    net = keep_extensor(whole)
    assert set(net.ends) == set(ROBOT_ENDS.values())
    gone = {name for name in whole.strands if cable_of(name) in OTHERS}
    assert set(net.strands) == set(whole.strands) - gone
    assert len(gone) == 3
    for name in net.strands:
        assert net.strand_lengths()[name] == pytest.approx(whole.strand_lengths()[name])


def test_what_is_left_is_where_it_was_and_hangs_together(whole: CableNet) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    net = keep_extensor(whole)
    n = len(net.points)
    assert sorted(np.unique(net.cells)) == list(range(n))
    graph = coo_array((np.ones(len(net.cells)), tuple(net.cells.T)), shape=(n, n))
    assert connected_components(graph, directed=False)[0] == 1
    for name, held in net.springs.items():
        before = whole.springs[name]
        np.testing.assert_array_equal(net.points[held.nodes], whole.points[before.nodes])
    np.testing.assert_array_equal(
        net.points[net.tied["distal"]], whole.points[whole.tied["distal"]]
    )
    np.testing.assert_array_equal(
        net.points[net.ends["central"]], whole.points[whole.ends["central"]]
    )


def test_the_hood_takes_the_fingers_own_extensors_place() -> None:
    case = load_case(CABLES)
    assert "extensor" not in finger_model(case.finger, case.hood.left_to_finger).muscles
    pulleys = load_case(PULLEYS)
    assert case.tension("extensor") == pulleys.tension("extensor") == pytest.approx(4.0)
    assert case.finger.passive == pulleys.finger.passive
    assert case.finger.limit == pulleys.finger.limit
    assert case.finger.posture == pulleys.finger.posture
    assert case.finger.tip == pulleys.finger.tip


@pytest.mark.slow
def test_the_extensor_lifts_the_fingertip_through_slips_that_share() -> None:
    """Some 20 s, the bones' distances baked anew."""
    models, states = solve(load_case(CABLES))
    before, now = (np.asarray(e.balance.tip_force) for e in (states.unloaded, states.loaded))
    assert (now - before)[2] > 0.2
    assert models.finger.tendons == ("dip_flexor", "pip_flexor", "abduction", "adduction")
