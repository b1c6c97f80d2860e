"""The robotic finger: its arms and paths, pose from markers, the excursion experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cases.papers.models.xu2012 import checks, excursions, paths
from cases.papers.models.xu2012.calibration import Seen, Spread, calibrate
from cases.papers.models.xu2012.tracking import MARKERS, poses
from cosim.errors import ConvergenceError, InputError
from rigid.chain.pose import BodyMarkers, cubic_minimum, estimate
from rigid.fingers.anatomy import RANGES
from rigid.fingers.robot import robot_finger
from rigid.fingers.robot_tables import JOINTS, LENGTHS, LONG, MASSES, SHORT, TABLE_III
from rigid.model import Strand, Tendon, Via, WrapCylinder, WrapSphere
from rigid.mujoco.finger import MujocoFinger

POSE = np.radians([30.0, 10.0, 45.0, 20.0])


@pytest.fixture(scope="module")
def five() -> MujocoFinger:
    return MujocoFinger(robot_finger())


def test_arms_are_those_of_table_iii() -> None:
    np.testing.assert_allclose(checks.table_iii(robot_finger()), TABLE_III, atol=1e-6)


def test_finger_has_the_lengths_weights_and_ranges_of_tables_i_and_ii() -> None:
    phalanges = robot_finger().segments[1:]
    assert tuple(s.length for s in phalanges) == LENGTHS == (0.0534, 0.0320, 0.0237)
    assert tuple(s.mass for s in phalanges) == MASSES == (0.0055, 0.0020, 0.0012)
    ranges = np.degrees([robot_finger().ranges[j] for j in JOINTS])
    np.testing.assert_allclose(ranges, [[-30, 90], [-35, 35], [0, 110], [0, 70]])


def test_phalanges_have_the_inertia_of_rods() -> None:
    for s in robot_finger().segments[1:]:
        along = s.mass * s.radius**2 / 2
        across = along / 2 + s.mass * s.length**2 / 12
        np.testing.assert_allclose(s.inertia, (along, across, across))


def test_pulley_weights_are_the_papers() -> None:
    strands = robot_finger().tendons[0].strands
    assert [s.share for s in strands] == [LONG, SHORT, SHORT] == [0.5, 0.25, 0.25]


@pytest.mark.parametrize("six", [False, True])
def test_no_arm_changes_its_sign_and_no_length_jumps(six: bool) -> None:
    model = robot_finger(six)
    assert checks.least_arms(model, checks.workspace((5, 5, 4, 3))).min() > 1.0
    assert checks.jump(model, poses(2, seed=3), samples=200) < 1e-3
    assert checks.difference(model, poses(10, seed=4)) < 1e-6


@pytest.mark.parametrize("six", [False, True])
def test_lengths_and_arms_agree_with_closed_forms(six: bool) -> None:
    corners = checks.workspace((2, 2, 2, 2))
    length, arms = checks.closed_form_errors(robot_finger(six), 0.98 * corners + 0.01 * POSE)
    assert length < 1e-12
    assert arms < 1e-9


def test_way_over_a_cylinder_is_its_tangents_and_arc() -> None:
    pose = np.eye(3), np.zeros(3)
    over = WrapCylinder("", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 3.0, (0.0, 0.0, 9.0))
    start, end = np.array([-5.0, 0.0, 0.0]), np.array([5.0, 2.0, 0.0])
    flat = 2 * 4.0 + 3.0 * (np.pi - 2 * np.arccos(3 / 5))
    assert paths.wrap_length(start, end, over, pose) == pytest.approx(np.hypot(flat, 2.0))
    above = np.array([0.0, 0.0, 4.0])
    far = paths.wrap_length(start + above, end + above, over, pose)
    assert far == pytest.approx(np.hypot(10.0, 2.0))


def test_way_over_a_sphere_is_its_tangents_and_the_great_circle_between() -> None:
    """The ends 5 and 13 from the centre, 150 deg apart, in a plane of no special direction."""
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    pose = turn, np.array([1.0, 2.0, -3.0])
    apart = np.radians(150.0)
    ends = np.array([[5.0, 0.0, 0.0], [13 * np.cos(apart), 13 * np.sin(apart), 0.0]])
    over = WrapSphere("", (0.5, -1.0, 2.0), 3.0)
    start, end = (np.array(over.centre) + ends @ turn) @ turn.T + pose[1]
    arc = 3.0 * (apart - np.arccos(3 / 5) - np.arccos(3 / 13))
    wanted = 4.0 + arc + np.sqrt(13**2 - 3**2)
    assert paths.wrap_length(start, end, over, pose) == pytest.approx(wanted)
    small = WrapSphere("", over.centre, 0.5)
    straight = float(np.linalg.norm(end - start))
    assert paths.wrap_length(start, end, small, pose) == pytest.approx(straight)


def test_arms_over_the_head_are_its_radius_times_the_normal_of_the_plane() -> None:
    """Of the plane of guide, end and centre; in the default posture the way is straight."""
    finger = MujocoFinger(robot_finger())
    k = finger.tendons.index("abduction")
    assert len(finger.paths_at(np.zeros(4))["abduction"]) == 3
    for degrees in ([0.0, -30.0, 0.0, 0.0], [-10.0, -30.0, 20.0, 10.0]):
        at = np.radians(degrees)
        way = finger.paths_at(at)["abduction"]
        assert len(way) == 5
        normal = np.cross(way[1], way[-1])
        axes = finger.chain(at).axis[:2]
        wanted = -0.010 * axes @ normal / np.linalg.norm(normal)
        np.testing.assert_allclose(finger.moment_arms(at)[k, :2], wanted, atol=1e-9)


def test_every_sphere_is_the_metacarpals_head() -> None:
    found = {
        (t.name, e.body, e.radius)
        for t in robot_finger(True).tendons
        for s in t.strands
        for e in s.path
        if isinstance(e, WrapSphere)
    }
    names = ("abduction", "adduction", "dip_flexor", "pip_flexor")
    assert found == {(name, "metacarpal", 0.010) for name in names}


def test_a_strand_does_not_end_on_a_sphere() -> None:
    head = WrapSphere("metacarpal", (0.0, 0.0, 0.0), 0.01)
    path = (Via("metacarpal", (0.0, 0.0, 0.02)), head)
    with pytest.raises(InputError, match="ends at a point"):
        replace(robot_finger(), tendons=(Tendon("t", (Strand(path),)),))


def test_second_extensor_pulls_the_proximal_phalanx_alone() -> None:
    arms = checks.table_iii(robot_finger(True))
    np.testing.assert_allclose(arms[:, 5], [TABLE_III[0, 0], 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(arms[:, 1:5], TABLE_III[:, 1:], atol=1e-6)


def test_cubic_line_search_finds_a_cubics_minimum() -> None:
    f, slope = np.poly1d([1.0, 0.5, -1.0, 2.0]), np.poly1d([3.0, 1.0, -1.0])
    best = max(r for r in np.roots(slope.coeffs))
    assert cubic_minimum(f(0.0), slope(0.0), f(1.0), slope(1.0)) == pytest.approx(best)
    assert cubic_minimum(1.0, -1.0, 0.0, -1.0) == 1.0


def test_markers_give_the_pose_back(five: MujocoFinger) -> None:
    for markers in (MARKERS, excursions.MEANT):
        for angle in poses(10):
            seen = markers.at(five, angle)[0]
            found = estimate(five, markers, seen, excursions.START)
            np.testing.assert_allclose(found.angle, angle, atol=1e-5)
            assert found.residual < 1e-6


def test_markers_that_move_have_their_jacobian(five: MujocoFinger) -> None:
    _, jacobian = MARKERS.at(five, POSE)
    step = 1e-6 * np.eye(4)
    slope = [(MARKERS.at(five, POSE + e)[0] - MARKERS.at(five, POSE - e)[0]) / 2e-6 for e in step]
    np.testing.assert_allclose(jacobian, np.moveaxis(slope, 0, 2), atol=1e-8)


def test_markers_that_lie_elsewhere_are_the_least_off(five: MujocoFinger) -> None:
    rng = np.random.default_rng(1)
    seen = MARKERS.at(five, POSE)[0] + rng.normal(0.0, 0.003, (3, 3))
    found = estimate(five, MARKERS, seen, POSE)
    off = (MARKERS.at(five, found.angle)[0] - seen).ravel()
    gradient = MARKERS.at(five, found.angle)[1].reshape(9, 4).T @ off
    assert np.abs(gradient).max() < 2e-3 * 0.05 * np.linalg.norm(off)
    assert found.residual == pytest.approx(np.linalg.norm(off) / np.sqrt(3))


def test_places_of_markers_come_back_without_noise(five: MujocoFinger) -> None:
    angle = poses(40, seed=5)
    moved = BodyMarkers(excursions.MEANT.body, excursions.MEANT.place + 0.003)
    zero = 0.01 * np.arange(5)
    seen = Seen(
        np.array([moved.at(five, q)[0] for q in angle]),
        np.array([five.tendon_lengths(q) for q in angle]) + zero,
    )
    spread = Spread(1e-3, np.full(5, 1e-3), np.array([True, True, True, True, False]))
    start = np.array(
        [estimate(five, excursions.MEANT, x, excursions.START).angle for x in seen.marker]
    )
    found = calibrate(five, excursions.MEANT, seen, start, spread)
    np.testing.assert_allclose(found.markers.place, moved.place, atol=1e-5)
    np.testing.assert_allclose(found.zero[:4], zero[:4], atol=1e-5)
    assert np.isnan(found.zero[4])
    np.testing.assert_allclose(found.angle, angle, atol=1e-3)


def test_one_pose_alone_does_not_tell_the_places(five: MujocoFinger) -> None:
    angle = np.tile(POSE, (5, 1))
    seen = Seen(
        np.array([excursions.MEANT.at(five, q)[0] + 0.005 for q in angle]),
        np.array([five.tendon_lengths(q) for q in angle]),
    )
    with pytest.raises(ConvergenceError, match="do not tell"):
        calibrate(five, excursions.MEANT, seen, angle, Spread(1e-3, np.ones(5), np.zeros(5, bool)))


def test_stops_tell_the_places_where_excursions_hardly_do() -> None:
    """This world's fingertip marker was 1.6 mm off without them."""
    assert checks.excursions(4).marker_error < 0.8e-3


def test_procrustes_undoes_a_turn_and_a_shift() -> None:
    turn = Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix()
    found, shift = excursions.procrustes(excursions.BASE, excursions.BASE @ turn.T + 0.5)
    np.testing.assert_allclose(found, turn.T, atol=1e-12)
    np.testing.assert_allclose(shift, -0.5 * turn.T @ np.ones(3), atol=1e-12)


def test_virtual_experiment_finds_rests_and_markers() -> None:
    e = checks.excursions()
    assert len(e.meant.residual) == 460
    assert 0.004 < e.meant.residual.mean() < 0.005
    assert e.marker_error < 1e-3
    assert (checks.rms(e.found)[:3] < checks.rms(e.meant)[:3]).all()
    slack = e.found.measured_excursions[:, 4] > e.found.measured_excursions[:, 4].max() - 0.001
    assert slack.mean() > 0.3


def test_workspace_reaches_the_corners_of_table_ii() -> None:
    posture = checks.workspace((2, 2, 2, 2))
    np.testing.assert_allclose(posture.min(axis=0), [RANGES[j][0] for j in JOINTS])
    np.testing.assert_allclose(posture.max(axis=0), [RANGES[j][1] for j in JOINTS])
