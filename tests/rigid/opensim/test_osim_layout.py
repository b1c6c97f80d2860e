"""The layouts of OpenSim 2 and 3, and what OpenSim mends as it loads a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from rigid.opensim.losses import report
from rigid.opensim.osim import Imported, import_osim
from tests.helpers.osim_files import (
    OLD_MODEL,
    PIN,
    TWO_POINTS,
    body,
    import_text,
    model,
    muscle,
    reasons,
)


def test_a_file_of_opensim_3_is_read_as_opensim_4_reads_it(tmp_path: Path) -> None:
    made = import_text(tmp_path, OLD_MODEL)
    built = mujoco.MjModel.from_xml_string(made.xml)
    assert [built.body(i).name for i in range(built.nbody)] == ["world", "b", "c"]
    assert [built.joint(i).name for i in range(built.njnt)] == ["j_translation1", "q", "r"]
    assert made.version == 30000
    assert list(made.muscles) == ["over"]
    assert made.muscles["over"].properties["Af"] == 0.4
    assert made.muscles["over"].properties["max_isometric_force"] == 546
    assert "applies no force" in reasons(made, '"off"')
    assert list(made.limits) == ["l"]
    assert built.site("mark").pos == pytest.approx([0, 1, 0])
    told = report(made.losses)
    assert sum("layout of OpenSim 3 (version 30000)" in line for line in told) == 1
    assert not [line for line in told if "no counterpart" in line and "length_units" not in line]
    line = 1 + OLD_MODEL[: OLD_MODEL.index('name="off"')].count("\n")
    assert f"line {line}: " in reasons(made, '"off"')


@pytest.mark.opensim
def test_opensim_s_own_rewriting_gives_the_same_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    opensim = pytest.importorskip("opensim")
    made = import_text(tmp_path, OLD_MODEL)
    written = opensim.Model("model.osim")
    written.initSystem()
    written.printToXML("new.osim")
    anew = import_osim(Path("new.osim"))
    assert anew.xml == made.xml
    assert (anew.coordinates, anew.limits) == (made.coordinates, made.limits)


def without(made: Imported) -> Imported:
    return replace(made, losses=(), version=0)


def test_a_path_of_opensim_2_and_connectors_before_4_are_read(tmp_path: Path) -> None:
    now = import_text(tmp_path, model(forces=muscle("mus", TWO_POINTS)))
    old = model(forces=muscle("mus", TWO_POINTS), version="20100")
    for new, before in (
        ('<GeometryPath name="path">', ""),
        ("</GeometryPath>", ""),
        ("PathPointSet>", "MusclePointSet>"),
        ("PathWrapSet>", "MuscleWrapSet>"),
    ):
        old = old.replace(new, before)
    assert without(import_text(tmp_path, old)) == without(now)
    sockets = {
        "parent": "<Connector_PhysicalFrame_ name='{}_frame'><connectee_name>{}</connectee_name>"
        "</Connector_PhysicalFrame_>"
    }
    pin = (
        '<PinJoint name="pin"><connectors>'
        + sockets["parent"].format("parent", "ground")
        + sockets["parent"].format("child", "b")
        + '</connectors><coordinates><Coordinate name="q"/></coordinates></PinJoint>'
    )
    between = model(joints=pin, forces=muscle("mus", TWO_POINTS), version="30503")
    between = between.replace("socket_parent_frame>", "connector_parent_frame_connectee_name>")
    assert without(import_text(tmp_path, between)) == without(now)


def test_a_reversed_joint_is_left_out_with_what_hangs_on_it(tmp_path: Path) -> None:
    text = OLD_MODEL.replace('<PinJoint name="k">', '<PinJoint name="k"><reverse>true</reverse>')
    made = import_text(tmp_path, text)
    assert "a reversed PinJoint cannot be imported" in reasons(made, '"k"')
    assert "left out with it: c" in reasons(made, '"k"')


def test_what_has_the_name_of_another_is_renamed_as_opensim_does(tmp_path: Path) -> None:
    second = PIN.replace("/bodyset/b", "/bodyset/c").replace("/ground", "/bodyset/b")
    joints = PIN + second.replace('"q"', '"r"')
    forces = muscle("mus", TWO_POINTS) * 2 + muscle("mus_0", TWO_POINTS)
    made = import_text(tmp_path, model(body("b") + body("c"), joints, forces))
    assert list(made.muscles) == ["mus", "mus_1", "mus_0"]
    assert list(made.coordinates) == ["q", "r"]
    assert "it is called pin_0" in reasons(made, '"pin')
