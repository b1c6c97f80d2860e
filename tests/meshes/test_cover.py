"""What covers the bones: by place, and what a hood feels of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cosim.case.file import load_case
from cosim.fingers.kinds import anatomy_of
from cosim.hoods.fe_supports import contact_levels, pose_surfaces
from fe_solver.surfaces.spline_distance import SplineDistance
from meshes.cover import FLEXION, Joint, blend, shares
from meshes.skeleton import index_finger

COVER = (2.0, 0.6, 1.2)
"""mm over back, face and sides."""
SQUARE = Joint(np.array([0.04, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def cover(*from_centre: tuple[float, float, float]) -> np.ndarray:
    """mm over a head whose axis lies square to its bone, at places in mm from its middle."""
    points = SQUARE.centre + 1e-3 * np.array(from_centre)
    return blend(shares(points, SQUARE), *COVER)


def test_back_face_and_sides_have_what_is_stated_for_them():
    assert cover((0, 0, 4), (-20, 0, 5)) == pytest.approx([2.0, 2.0])
    assert cover((4, 0, 4), (4, 0, 0), (3, 1, -1)) == pytest.approx([0.6, 0.6, 0.6])
    assert cover((0, 5, 0), (-2, -5, 2)) == pytest.approx([1.2, 1.2])
    assert cover((-12, 5, 0)) == pytest.approx([2.0]), "the shaft has no condyles"


def test_the_tissue_of_the_back_goes_over_into_cartilage_as_the_joint_turns():
    angle = np.deg2rad(np.arange(0, 91, 5))
    over = cover(*np.column_stack([4 * np.sin(angle), 0 * angle, 4 * np.cos(angle)]))
    assert (np.diff(over) <= 1e-12).all()
    assert over[9:] == pytest.approx(0.6)


def test_the_cover_has_no_kink():
    rng = np.random.default_rng(3)
    x = SQUARE.centre + 5e-3 * rng.normal(size=(200, 3))
    x = x[np.hypot(x[:, 0] - 0.04, x[:, 2]) > 3e-3]
    way, h = rng.normal(size=x.shape), 1e-6

    def slope(at: np.ndarray) -> np.ndarray:
        ahead, behind = (blend(shares(at + s * h * way, SQUARE), *COVER) for s in (1, -1))
        return 1e-3 * (ahead - behind) / (2 * h)

    assert np.abs(slope(x + 3 * h * way) - slope(x)).max() < 0.02


@pytest.mark.parametrize("body", FLEXION)
def test_the_joint_of_a_head_is_where_the_skeleton_turns(body):
    skeleton, joint, i = index_finger(), Joint.of(index_finger(), body), list(FLEXION).index(body)
    (p0, r0), (p1, r1) = skeleton.pose({}), skeleton.pose({FLEXION[body]: 0.7})
    for p, r in ((p0, r0), (p1, r1)):
        assert p[i] + r[i] @ joint.centre == pytest.approx(p[i + 1], abs=1e-15)
    turn = r1[i].T @ r1[i + 1] @ (r0[i].T @ r0[i + 1]).T
    assert Rotation.from_matrix(turn).as_rotvec() == pytest.approx(0.7 * joint.axis, abs=1e-12)


def test_a_distance_and_a_level_over_it_add_up():
    grid = np.linspace(-0.01, 0.01, 21)
    z = np.meshgrid(grid, grid, grid, indexing="ij")[2]
    plane = SplineDistance.from_grid(np.full(3, -0.01), 1e-3, z, 5e-3)
    (level,) = plane.fields(lambda points: [0.1 * points[:, 0] - 0.2 * points[:, 1]])
    raised = replace(plane, coefficients=plane.coefficients + level.coefficients)
    value, gradient, hessian = raised.distance(np.array([[1e-3, 2e-3, 3.3e-3]]))
    assert value == pytest.approx([3.3e-3 + 0.1e-3 - 0.4e-3])
    assert gradient == pytest.approx(np.array([[0.1, -0.2, 1.0]]))
    assert hessian == pytest.approx(np.zeros((1, 3, 3)), abs=1e-6)


def test_a_case_lays_its_heads_under_the_hood():
    case = load_case("base/index_finger.toml", [])
    anatomy = anatomy_of(case.finger, case.hood.left_to_finger)
    covered, offset = contact_levels(case.hood.contact, anatomy.bones, anatomy.skeleton)
    flat = case.hood.contact.model_copy(update={"heads": type(case.hood.contact.heads)()})
    bare, _ = contact_levels(flat, anatomy.bones, anatomy.skeleton)
    joint = Joint.of(index_finger(), "proximal")
    face = joint.centre + 1e-3 * np.array([[7.0, 0, 0], [0, 0, 5.0]])
    less = covered["proximal"].distance(face).value - bare["proximal"].distance(face).value
    assert 1e3 * less == pytest.approx([1e3 * offset["proximal"] - 0.6, 0.0], abs=2e-3)
    for body in ("metacarpal", "middle", "distal"):
        assert covered[body] is bare[body]


def test_a_head_is_covered_by_no_more_than_its_bone_s_back():
    case = load_case("base/index_finger.toml", ["hood.contact.offset.proximal=0.3 mm"])
    anatomy = anatomy_of(case.finger, case.hood.left_to_finger)
    covered, _ = contact_levels(case.hood.contact, anatomy.bones, anatomy.skeleton)
    bare = pose_surfaces(anatomy.bones, case.hood.contact.offset.model_dump())
    face = Joint.of(index_finger(), "proximal").centre[None] + np.array([7e-3, 0, 0])
    both = [surfaces["proximal"].distance(face).value for surfaces in (covered, bare)]
    assert both[0] == pytest.approx(both[1], abs=1e-12)
