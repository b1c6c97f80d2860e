"""Tendons of a MuJoCo model keep their paths: surfaces with and without side sites, pulleys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cases.papers.models.xu2012.paths import tendon_lengths, wrap_length
from meshes.skeleton import JOINTS
from rigid.mjcf.read import ReadFinger, read_mjcf
from rigid.mjcf.write import mjcf_xml
from rigid.model import WrapCylinder, WrapSphere

OVER = '<site site="e0"/><site site="e1"/><geom geom="drum"{}/><site site="e2"/><site site="e3"/>'


def text(*numbers: float) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def finger(
    drum: str, side: str = "", path: str = "", on: str = "proximal", more: str = "", pull: str = ""
) -> str:
    """A straight finger of 40, 25 and 20 mm; a surface `drum` of the proximal phalanx at the PIP
    and a side site of the body `on`, under the tendon EDC; FDP below."""
    at = {body: side if body == on else "" for body in ("metacarpal", "proximal", "middle")}
    path = path or OVER.format(' sidesite="side"' if side else "")
    inertial = '<inertial pos="0.01 0 0" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/>'
    return f"""<mujoco><compiler angle="radian"/><worldbody>
<body name="metacarpal" pos="0.01 0.02 0.03" euler="0.3 -0.4 1">{at["metacarpal"]}
<site name="f0" pos="-0.02 0.001 -0.008"/><site name="e0" pos="-0.02 0 0.009"/>
<body name="proximal"><joint name="MCP" axis="0 1 0"/>{inertial}
<joint name="MCP_abduction" axis="0.1 0 1"/>{drum}{at["proximal"]}
<site name="f1" pos="0.01 0.001 -0.006"/><site name="e1" pos="0.02 0.001 0.007"/>
<body name="middle" pos="0.04 0 0"><joint name="PIP" axis="0 1 0"/>{inertial}{at["middle"]}
<site name="f2" pos="0.01 0 -0.007"/><site name="e2" pos="0.01 -0.001 0.006"/>
<body name="distal" pos="0.025 0 0"><joint name="DIP" axis="0 1 0"/>{inertial}
<site name="f3" pos="0.005 0 -0.004"/><site name="e3" pos="0.005 0 0.004"/>
<site name="tip" pos="0.02 0 0"/></body></body></body></body></worldbody><tendon>
<spatial name="EDC">{path}</spatial>
<spatial name="FDP"><site site="f0"/><site site="f1"/><site site="f2"/><site site="f3"/></spatial>
{more}</tendon><actuator>{pull}</actuator></mujoco>"""


def surface(kind: str, radius: float, centre: np.ndarray, axis: np.ndarray) -> str:
    ends = f'fromto="{text(*(centre - 0.01 * axis), *(centre + 0.01 * axis))}"'
    place = f'pos="{text(*centre)}"' if kind == "sphere" else ends
    return f'<geom name="drum" type="{kind}" size="{radius}" contype="0" conaffinity="0" {place}/>'


def site(place: np.ndarray) -> str:
    return f'<site name="side" pos="{text(*place)}"/>'


def mujoco_arms(xml: str, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """MuJoCo's lengths and moment arms of the tendons in postures (n, 4): (n, nt) and (n, nt, 4)
    m."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    dofs = [model.joint(name).qposadr[0] for name in JOINTS]
    row = np.repeat(np.arange(model.ntendon), model.ten_J_rownnz)
    lengths, arms = [], np.zeros((len(postures), model.ntendon, model.nv))
    for k, angles in enumerate(postures):
        data.qpos[dofs] = angles
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length.copy())
        arms[k, row, model.ten_J_colind] = -data.ten_J
    return np.array(lengths), arms[..., dofs]


def read(folder: Path, xml: str) -> ReadFinger:
    (folder / "f.xml").write_text(xml)
    return read_mjcf(folder / "f.xml")


def losses_of(made: ReadFinger) -> list[str]:
    return [loss for loss in made.losses if "gravity" not in loss]


@st.composite
def surfaces(draw: st.DrawFn) -> tuple[str, str]:
    """A sphere or cylinder near the PIP, and a side site outside or inside of it, or none."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    radius = rng.uniform(0.002, 0.006)
    centre = np.array([0.04, 0, 0]) + rng.uniform(-0.002, 0.002, 3)
    axis = np.array([0, 1.0, 0]) + rng.uniform(-0.5, 0.5, 3)
    drum = surface(draw(st.sampled_from(["sphere", "cylinder"])), radius, centre, axis)
    where = draw(st.sampled_from(["none", "outside", "inside"]))
    if where == "none":
        return drum, ""
    away = rng.normal(size=3)
    far = rng.uniform(1.01, 3.0) if where == "outside" else rng.uniform(0.0, 0.99)
    return drum, site(centre + far * radius * away / np.linalg.norm(away))


@settings(max_examples=100, deadline=None)
@given(surfaces(), st.integers(0, 2**32))
def test_a_surface_read_and_written_again_guides_as_it_did(
    tmp_path_factory: pytest.TempPathFactory, drawn: tuple[str, str], seed: int
) -> None:
    xml = finger(*drawn)
    made = read(tmp_path_factory.mktemp("mjcf"), xml)
    assert made.model.muscles == ("EDC", "FDP")
    assert losses_of(made) == []
    again = mjcf_xml(made.model)
    twice = read(tmp_path_factory.mktemp("mjcf"), again)
    postures = np.random.default_rng(seed).uniform(-0.3, 1, (8, 4)) * [1.5, 0.4, 1.8, 1.2]
    length, arms = mujoco_arms(xml, postures)
    # MuJoCo's own iteration through rings stops at 1e-6, which an arm shows
    for ours in (again, mjcf_xml(twice.model)):
        assert_allclose(mujoco_arms(ours, postures)[0], length, rtol=0, atol=1e-9)
        assert_allclose(mujoco_arms(ours, postures)[1], arms, rtol=0, atol=1e-7)
    closed = [tendon_lengths(made.model, angles) for angles in postures]
    assert_allclose(closed, length, rtol=0, atol=1e-9)


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([WrapSphere, WrapCylinder]), st.sampled_from("noi"))
def test_the_closed_form_is_mujocos_length(
    seed: int, kind: type[WrapSphere] | type[WrapCylinder], where: str
) -> None:
    rng = np.random.default_rng(seed)
    radius, centre, axis = rng.uniform(0.2, 1.2), rng.normal(size=3), rng.normal(size=3)
    start, end = centre + rng.normal(size=(2, 3)) * rng.uniform(0.5, 2.5, (2, 1))
    far = {"n": 0.0, "o": rng.uniform(1.01, 3), "i": rng.uniform(0, 0.99)}[where]
    away = rng.normal(size=3)
    place = centre + far * radius * away / np.linalg.norm(away)
    over = WrapSphere("", tuple(centre), radius)
    if kind is WrapCylinder:
        over = WrapCylinder("", tuple(centre), tuple(axis), radius)  # type: ignore[assignment]
    if where != "n":
        over = replace(over, side=tuple(place))
    sites = "".join(
        f'<site name="{name}" pos="{text(*x)}"/>' for name, x in (("a", start), ("b", end))
    )
    side = ' sidesite="side"' if where != "n" else ""
    shape = "sphere" if kind is WrapSphere else "cylinder"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{surface(shape, radius, centre, axis)}{sites}"
        f'{site(place)}</worldbody><tendon><spatial><site site="a"/><geom geom="drum"{side}/>'
        '<site site="b"/></spatial></tendon></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pose = np.eye(3), np.zeros(3)
    assert wrap_length(start, end, over, pose) == pytest.approx(data.ten_length[0], abs=1e-11)


def test_a_side_site_keeps_an_extensor_an_extensor(tmp_path: Path) -> None:
    """Bent by 60 deg the straight way would pass the PIP on its palmar side."""
    drum = surface("sphere", 0.006, np.array([0.04, 0, 0]), np.array([0, 1.0, 0]))
    made = read(tmp_path, finger(drum, site(np.array([0.04, 0, 0.02]))).replace("0.001", "0"))
    _, arms = mujoco_arms(mjcf_xml(made.model), np.radians([[0, 0, 60, 0]]))
    assert arms[0, 0, 2] == pytest.approx(-6.0e-3, abs=1e-9)


def test_a_side_site_on_another_bone_drops_its_tendon(tmp_path: Path) -> None:
    drum = surface("cylinder", 0.005, np.array([0.04, 0, 0]), np.array([0, 1.0, 0]))
    made = read(tmp_path, finger(drum, site(np.array([0.0, 0, 0.02])), on="middle"))
    assert made.model.muscles == ("FDP",)
    assert losses_of(made) == [
        "dropped: tendon EDC: the side site 'side' is not on the bone of its surface 'drum'"
    ]


@pytest.mark.parametrize("first", ["", '<pulley divisor="4"/>'])
def test_branches_behind_pulleys_keep_their_shares(tmp_path: Path, first: str) -> None:
    drum = surface("sphere", 0.005, np.array([0.04, 0, 0]), np.array([0, 1.0, 0]))
    path = first + '<site site="e0"/><site site="e1"/><pulley divisor="2"/><site site="e1"/>'
    path += '<geom geom="drum" sidesite="side"/><site site="e2"/><pulley divisor="3"/>'
    path += '<site site="e1"/><geom geom="drum"/><site site="f2"/>'
    xml = finger(drum, site(np.array([0.04, 0, 0.02])), path)
    made = read(tmp_path, xml)
    assert [s.share for s in made.model.tendons[0].strands] == [1 / 4 if first else 1, 1 / 2, 1 / 3]
    postures = np.random.default_rng(3).uniform(0, 1, (10, 4))
    for ours, theirs in zip(
        mujoco_arms(mjcf_xml(made.model), postures), mujoco_arms(xml, postures), strict=True
    ):
        assert_allclose(ours, theirs, rtol=0, atol=1e-12)


def test_forces_of_tendons_and_other_actuators_are_told(tmp_path: Path) -> None:
    more = '<spatial name="t" stiffness="0 5" armature="1" springlength="0.01" range="0 1" '
    more += 'limited="true"><site site="e0"/><site site="e2"/></spatial>'
    pull = '<muscle name="m" tendon="FDP" force="79" gear="2"/>'
    pull += '<general site="tip" gear="1 0 0 0 0 0"/>'
    drum = surface("sphere", 0.005, np.array([0.04, 0, 0]), np.array([0, 1.0, 0]))
    made = read(tmp_path, finger(drum, more=more, pull=pull))
    for what in ("the stiffness", "the armature", "the limit of length"):
        assert f"dropped: {what} of tendon t" in made.losses
    assert "dropped: 1 actuators that pull no tendon" in made.losses
    assert made.max_force == {"FDP": 158.0}
