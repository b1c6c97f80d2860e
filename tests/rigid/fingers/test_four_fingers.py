"""The four fingers as records: what is true of each, and how the new ones lie beside the old."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.analyses.moment_arms import compare_published, published_arms
from cosim.anatomy.joints import fit_cylinder
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.models.build import build
from cosim.pipeline import run_case
from cosim.port import Array
from meshes.bones import bone_surface
from meshes.skeleton import JOINTS, MYOHAND, myohand_finger
from rigid.fingers.index import INDEX
from rigid.fingers.little import LITTLE
from rigid.fingers.middle import MIDDLE
from rigid.fingers.normative import NormativeFinger
from rigid.fingers.ring import RING
from rigid.mujoco.finger import MujocoFinger

FINGERS = {"index": INDEX, "middle": MIDDLE, "ring": RING, "little": LITTLE}


def live(finger: NormativeFinger) -> MujocoFinger:
    return MujocoFinger(finger.scaled_model(finger.strands(0.5), 1.0))


def arms(finger: MujocoFinger, muscle: str, joint: str, degrees: Array) -> Array:
    j, row = JOINTS.index(joint), finger.tendons.index(muscle)
    turns = np.radians(degrees)[:, None] * np.eye(4)[j]
    return 1e3 * np.array([finger.moment_arms(q)[row, j] for q in turns])


@pytest.mark.parametrize("name", ["middle", "ring", "little"])
def test_axes_turn_against_each_other_as_myohands_do(name: str) -> None:
    """The turns that straighten the finger leave the axes that they turn about where they are."""
    of, skeleton = MYOHAND[name], myohand_finger(name)
    source = [np.array(axis) / np.linalg.norm(axis) for axis in of.axes]
    flexion, abduction, pip, dip = skeleton.axis
    in_proximal = skeleton.zero[1] @ pip
    assert flexion @ in_proximal == pytest.approx(source[0] @ source[2], abs=1e-9)
    assert pip @ (skeleton.zero[2] @ dip) == pytest.approx(source[2] @ source[3], abs=1e-9)
    assert flexion @ abduction == pytest.approx(source[0] @ source[1], abs=1e-9)
    assert min(flexion[1], pip[1], dip[1], abduction[2]) > 0.96  # about +y, and +z
    lengths = [np.linalg.norm(of.pip), np.linalg.norm(of.dip), of.tip]
    assert skeleton.length[1:] == pytest.approx(lengths, abs=1e-12)


def test_the_middle_fingers_phalanges_lie_with_their_condyles_across_its_parallel_axes() -> None:
    """A cylinder through the back of a head has its axis; MyoHand's MCP stands 11 deg off."""
    skeleton, flat = myohand_finger("middle"), MIDDLE.skeleton()
    flexion, _, pip, dip = skeleton.axis
    turn = skeleton.zero[0]
    assert (turn @ flexion)[1:] == pytest.approx([0.998, 0.0], abs=1e-3)
    assert np.degrees(np.arcsin(turn[2, 1])) == pytest.approx(-11.4, abs=0.1)
    assert (pip[2], dip[2]) == pytest.approx((0.0, 0.0), abs=1e-12)
    for body, at, most in (("proximal", 1, 1.0), ("middle", 2, 4.0)):
        points, centre = bone_surface(body, finger="middle")[0], skeleton.length[at] * np.eye(3)[0]
        beyond = points - centre
        head = points[(beyond[:, 0] > 0.0) & (beyond[:, 2] > -1e-3) & (np.abs(beyond[:, 1]) < 3e-3)]
        way, _, _, _ = fit_cylinder(head, flat.axis[at + 1], centre)
        assert abs(np.degrees(np.arctan2(way[2], way[1]))) < most


@pytest.mark.parametrize("finger", FINGERS.values(), ids=FINGERS)
def test_points_lie_equally_far_from_the_joint_in_every_finger(finger: NormativeFinger) -> None:
    """By which the offsets of the ring and the little finger were found; TE and, of the index
    finger, LE at the MCP are apart by what the source rounds."""
    far = {"LE": 0.45, "FDP": 0.55, "FDS": 0.55, "LU": 0.75, "UI": 0.75}
    for row, distance in far.items():
        beyond = finger.rows["MCP"][row][1][0] + finger.offset["MCP"]
        assert beyond == pytest.approx(distance, abs=1e-9)
    for row, distance in {"ES": 0.25, "RB": 0.4, "UB": 0.4, "FDP": 0.5, "FDS": 0.5}.items():
        beyond = finger.rows["PIP"][row][1][0] + finger.offset["PIP"]
        assert beyond == pytest.approx(distance, abs=0.08 if row == "ES" else 1e-9)
    assert finger.rows["DIP"]["FDP"][1][0] + finger.offset["DIP"] == pytest.approx(0.22, abs=1e-9)


@pytest.mark.parametrize("finger", FINGERS.values(), ids=FINGERS)
def test_radial_is_plus_y_and_every_tendon_acts_on_its_side(finger: NormativeFinger) -> None:
    """At the MCP from -15 deg on: further back the interossei pass dorsal of the axis."""
    made = live(finger)
    over = {"MCP": np.linspace(-15, 90, 22), "PIP": np.linspace(0, 110, 23)}
    over["DIP"] = np.linspace(0, 70, 15)
    for muscle in ("FDP", "FDS"):
        for joint in ("MCP", "PIP", *(("DIP",) if muscle == "FDP" else ())):
            arm = arms(made, muscle, joint, over[joint])
            assert arm.min() > 0.3 * arm.max() > 0.0
    for muscle, (row, _) in finger.hooded.items():
        beside = finger.rows["MCP"][row][0][2]
        abduction = arms(made, muscle, "MCP_abduction", np.zeros(1))[0]
        assert row == "LE" or np.sign(abduction) == np.sign(beside)
        flexes = arms(made, muscle, "MCP", over["MCP"])
        assert flexes.max() < 0.0 if row == "LE" else flexes.min() > 0.0
        for joint in ("PIP", "DIP"):
            assert arms(made, muscle, joint, over[joint]).max() < 0.0


@pytest.mark.parametrize(
    ("kind", "ketchum", "myohand"),
    [("index", 1.43, 2.77), ("middle", 1.82, 3.23), ("ring", 2.45, 3.04), ("little", 1.80, 3.10)],
)
def test_arms_are_as_far_from_published_ones_as_the_readme_says(
    kind: str, ketchum: float, myohand: float
) -> None:
    """Root mean square, mm."""
    models = build(load_case("split_edc", [f"finger.kind={kind}"]))
    table = compare_published(models, published_arms(kind))
    miss = (table.model_mm - table.arm_mm) ** 2
    found = np.sqrt(miss.groupby(table.source).mean())
    assert found["Ketchum et al. 1978"] == pytest.approx(ketchum, abs=0.01)
    assert found["MyoHand"] == pytest.approx(myohand, abs=0.01)


@pytest.mark.parametrize("kind", FINGERS)
def test_a_case_that_changes_the_kind_alone_runs(kind: str) -> None:
    case = load_case("split_edc", [f"finger.kind={kind}", "output.picture=false"])
    result = run_case(case)
    assert result.audit.passed
    assert result.summary["tension_N"]["EDC"] == pytest.approx(3.469)
    assert result.summary["posture_deg"]["PIP"] == pytest.approx(45.0, abs=0.5)
    for joint in ("MCP", "PIP", "DIP"):
        assert result.summary["moment_arm_mm"]["EDC"][joint] < 0


def test_or_says_which_muscles_the_finger_has() -> None:
    case = load_case("split_fpi", ["finger.kind=little", "output.picture=false"])
    with pytest.raises(InputError, match="they have EDC, EDM, LUM, RI, ADM, FDP, FDS"):
        run_case(case)


def test_muscles_and_their_areas() -> None:
    """Half of the abductor ends on the bone, and with it half of its section."""
    little = load_case("split_edc", ["finger.kind=little"]).finger
    whole, source = little.muscle_areas(("EDC", "ADM"))
    halves, _ = little.muscle_areas(("ADM", "ADMp"))
    assert source.startswith("assumption")
    assert set(LITTLE.strands(0.5)) == set(whole) == {*LITTLE.hooded, "FDP", "FDS"}
    assert halves["ADM"] == halves["ADMp"] == whole["ADM"] / 2
    assert tuple(LITTLE.bone_strands()) == ("ADMp", "FDP", "FDS")
    assert RING.intrinsic == {"LUM": "LU", "RI": "RI", "UI": "UI"}
