"""The middle finger: where its radial interosseous comes from, and what becomes of it."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.analyses.moment_arms import native_arms
from cosim.case.file import load_case
from cosim.fingers.kinds import FINGERS
from cosim.models.build import build
from cosim.port import Array
from meshes.skeleton import JOINTS
from rigid.fingers.middle import LENGTHS, O2O3, RADIAL_INTEROSSEOUS, record
from rigid.mujoco.finger import MujocoFinger

# MyoHub/myo_sim at 2cef885, third ray, m: joint centres in their parents, axis and points of RI3.
MCP, PIP = np.array([0.00024, -0.02629, 0.001778]), np.array([0.00165, -0.044211, 0.00623])
FLEXION = np.array([0.980067, 0.0, 0.198669])
ON_METACARPAL = np.array([0.0096, -0.0027, -0.0048])
ON_PHALANX = np.array([0.0076, -0.0117, 0.0005])


def test_the_radial_interosseous_is_myohands_from_joint_to_joint() -> None:
    x = PIP / np.linalg.norm(PIP)
    y = FLEXION - (FLEXION @ x) * x
    y /= np.linalg.norm(y)
    axes = np.column_stack([x, np.cross(x, y), y])  # distal, dorsal, radial
    unit = O2O3 * np.linalg.norm(PIP) / LENGTHS[0]
    offset = np.array([0.37, 0.0, 0.0])
    proximal, distal = RADIAL_INTEROSSEOUS["myohand"]
    assert proximal == pytest.approx((ON_METACARPAL - MCP) @ axes / unit, abs=6e-4)
    assert distal == pytest.approx(ON_PHALANX @ axes / unit - offset, abs=6e-4)


def at_mcp(muscle: str, source: str, degrees: float) -> Array:
    """mm, flexion and radial abduction."""
    middle = record(source)  # type: ignore[arg-type]
    finger = MujocoFinger(middle.scaled_model(middle.strands(0.5), 1.0))
    q = np.radians(degrees) * np.eye(4)[JOINTS.index("MCP")]
    return 1e3 * finger.moment_arms(q)[finger.tendons.index(muscle), :2]


@pytest.mark.parametrize(
    ("degrees", "flexion", "abduction"),
    [(0, 3.36, 7.50), (40, 8.30, 5.90), (55, 9.78, 4.84), (80, 11.45, 2.46)],
)
def test_its_arms_are_myohands_in_the_length_of_the_phalanx(
    degrees: float, flexion: float, abduction: float
) -> None:
    """Of MyoHand's model, computed with MuJoCo.  Its axes are not normal to the bone by 4 deg, ours
    are: 0.4 mm in flexion and 2 mm in abduction at 80 deg."""
    found = at_mcp("RI", "myohand", degrees) * np.linalg.norm(PIP) / LENGTHS[0]
    assert found[0] == pytest.approx(flexion, abs=0.4)
    assert found[1] == pytest.approx(abduction, abs=2.0)


def test_the_normative_table_s_row_is_the_variant_with_more_than_twice_the_arm() -> None:
    assert at_mcp("RI", "an1979", 0)[0] == pytest.approx(8.15, abs=0.02)
    assert at_mcp("RI", "an1979", 0)[0] > 2 * at_mcp("RI", "myohand", 0)[0]
    np.testing.assert_array_equal(at_mcp("UI", "an1979", 30), at_mcp("UI", "myohand", 30))


@pytest.mark.parametrize(("source", "arm"), [("myohand", 3.25), ("an1979", 3.97)])
def test_a_split_hood_s_terminal_slip_takes_its_source_s_path(source: str, arm: float) -> None:
    """The straight finger's arm of the whole extensor, where the terminal slip takes it all."""
    case = load_case("middle_minorflex_edc", [f'finger.terminal="{source}"', "hood.central=0.01"])
    found = native_arms(build(case), {"MCP": 0.0})["EDC"][JOINTS.index("DIP")]
    assert -1e3 * found / 0.99 == pytest.approx(arm, abs=0.05)


@pytest.mark.parametrize("source", ["myohand", "an1979"])
@pytest.mark.parametrize(
    ("name", "muscle", "settings"),
    [("middle_minorflex_ri", "RI", []), ("hood_minorflex_ri", "RIp", ["hood.mesh.quads=600"])],
)
def test_a_case_chooses_its_path_in_split_and_hood(
    name: str, muscle: str, settings: list[str], source: str
) -> None:
    case = load_case(name, [f'finger.interosseous="{source}"', *settings])
    proximal = RADIAL_INTEROSSEOUS[source][0]  # type: ignore[index]
    assert FINGERS["middle"].eyelets(case.finger)["RI"] == pytest.approx(O2O3 * np.array(proximal))
    arm = native_arms(build(case), {"MCP": np.radians(30.0)})[muscle][0]
    assert 1e3 * arm == pytest.approx(at_mcp("RI", source, 30)[0], abs=1e-6)
