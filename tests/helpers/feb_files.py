"""Small FEBio files of our own, for tests: a strip of quads over a rigid roof."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fe_solver.febio.read import read_feb
from fe_solver.job.job import Job

Sections = dict[str, str | None]
ISOTROPIC = (
    '<material id="1" name="skin" type="isotropic elastic"><density>1</density><E>100</E><v>0.4</v>'
    "</material>"
)
BONE = (
    '<material id="2" name="bone" type="rigid body"><density>1</density><E>1</E><v>0</v>'
    "<center_of_mass>1,2,3</center_of_mass></material>"
)
NODES = """<Nodes name="all">
<node id="1">0,0,0</node><node id="2">1,0,0</node><node id="3">2,0,0</node>
<node id="4">0,1,0</node><node id="5">1,1,0</node><!-- a remark --><node id="6">2,1,0</node>
<node id="7">3,0.5,0</node>
<node id="20">0,0,2</node><node id="21">2,0,2</node><node id="22">2,1,2</node>
<node id="23">0,1,2</node></Nodes>
"""
ELEMENTS = """<Elements type="q4ans" name="strip"><elem id="1">1,2,5,4</elem>
<elem id="2">2,3,6,5</elem></Elements>
<Elements type="tri3" name="tip"><elem id="3">3,7,6</elem></Elements>
<Elements type="quad4" name="roof"><elem id="9">20,21,22,23</elem></Elements>
"""
SETS = """<NodeSet name="edge">1, 4</NodeSet><NodeSet name="end"><n id="7"/></NodeSet>
<Surface name="top"><quad4 id="1">1,2,5,4</quad4><tri3 id="2">6,7,3</tri3></Surface>
<Surface name="under"><quad4 id="1">20,21,22,23</quad4></Surface>
<SurfacePair name="pair"><primary>top</primary><secondary>under</secondary></SurfacePair>
<DiscreteSet name="strings"><delem>2,20</delem><delem>5,2</delem></DiscreteSet>
"""
SECTIONS: dict[str, str] = {
    "Module": '<Module type="solid"/>',
    "Control": "<Control><analysis>STATIC</analysis><time_steps>4</time_steps>"
    "<step_size>0.25</step_size></Control>",
    "Material": f"<Material>{ISOTROPIC}{BONE}</Material>",
    "Mesh": f"<Mesh>{NODES}{ELEMENTS}{SETS}</Mesh>",
    "MeshDomains": "<MeshDomains>"
    '<ShellDomain name="strip" mat="skin"><shell_thickness>0.5</shell_thickness></ShellDomain>'
    '<ShellDomain name="tip" mat="skin"><shell_thickness>0.25</shell_thickness></ShellDomain>'
    '<ShellDomain name="roof" mat="bone"/></MeshDomains>',
    "MeshData": '<MeshData><ElementData type="shell thickness" elem_set="strip">'
    '<e lid="2">0.1,0.2,0.3,0.4</e></ElementData></MeshData>',
    "Boundary": '<Boundary><bc name="a" node_set="edge" type="zero displacement"><x_dof>1</x_dof>'
    "<y_dof>0</y_dof><z_dof>1</z_dof></bc></Boundary>",
    "Rigid": '<Rigid><rigid_bc type="rigid_fixed"><rb>bone</rb><Rx_dof>1</Rx_dof><Ry_dof>1</Ry_dof>'
    "<Rz_dof>1</Rz_dof><Ru_dof>1</Ru_dof><Rv_dof>0</Rv_dof><Rw_dof>1</Rw_dof></rigid_bc>"
    '<rigid_bc type="rigid_rotation"><rb>2</rb><dof>Rv</dof><value lc="2">0.5</value></rigid_bc>'
    "</Rigid>",
    "Loads": '<Loads><nodal_load node_set="end" type="nodal_force"><value lc="1">0,0,-3</value>'
    '</nodal_load><surface_load surface="top" type="pressure"><pressure lc="1">0.02</pressure>'
    "</surface_load></Loads>",
    "Contact": '<Contact><contact name="c" surface_pair="pair" type="sliding-elastic">'
    "<penalty>2</penalty><auto_penalty>1</auto_penalty><fric_coeff>0.3</fric_coeff>"
    "</contact></Contact>",
    "Discrete": '<Discrete><discrete_material id="1" name="s" type="tension-only linear spring">'
    '<E>7</E></discrete_material><discrete dmat="1" discrete_set="strings"/></Discrete>',
    "LoadData": '<LoadData><load_controller id="1" type="loadcurve"><points><pt>0,0</pt><pt>1,1'
    '</pt></points></load_controller><load_controller id="2" type="loadcurve"><interpolate>STEP'
    "</interpolate><extend>REPEAT</extend><points><pt>0,0</pt><pt>1,1</pt></points>"
    "</load_controller></LoadData>",
    "Output": '<Output><plotfile type="febio"><var type="displacement"/></plotfile></Output>',
}


def feb_text(replaced: Mapping[str, str | None] | None = None, version: str = "4.0") -> str:
    """The file with some of its sections replaced, added, or (None) left out."""
    sections = {**SECTIONS, **(replaced or {})}
    body = "\n".join(s for s in sections.values() if s is not None)
    head = '<?xml version="1.0" encoding="ISO-8859-1"?>\n<!-- ours -->\n'
    return f'{head}<febio_spec version="{version}">\n{body}\n</febio_spec>\n'


def change_section(section: str, old: str, new: str) -> dict[str, str | None]:
    """A section with one place changed."""
    assert old in SECTIONS[section], old
    return {section: SECTIONS[section].replace(old, new, 1)}


def write(folder: Path, text: str | bytes, name: str = "model.feb") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return path


def read(folder: Path, replaced: Sections | None = None, **units: float) -> Job:
    return read_feb(write(folder, feb_text(replaced)), **units)


def same(a: Any, b: Any, place: str = "job") -> None:
    """Equal but for rounding, all the way down."""
    assert type(a) is type(b), place
    if dataclasses.is_dataclass(a):
        for f in (f for f in dataclasses.fields(a) if f.compare):
            same(getattr(a, f.name), getattr(b, f.name), f"{place}.{f.name}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), place
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{place}[{i}]")
    elif isinstance(a, np.ndarray | float):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-14, err_msg=place)
    else:
        assert a == b, place
