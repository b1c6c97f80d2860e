"""FEBio's files: what is read, and what is refused with its line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.job.checks import check_job
from fe_solver.job.curves import LoadCurve
from fe_solver.job.job import Step
from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law, Orthotropic
from fe_solver.supports import SpringLaw
from tests.helpers.feb_files import SECTIONS, Sections, change_section, feb_text, read, same, write


def test_everything_in_the_file_arrives_in_si_units(tmp_path: Path) -> None:
    job = read(tmp_path)
    np.testing.assert_allclose(job.sheet.points[-1], [3e-3, 0.5e-3, 0])
    assert job.sheet.node_ids.tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert job.sheet.quads.tolist() == [[0, 1, 4, 3], [1, 2, 5, 4], [2, 6, 5, 5]]
    assert job.sheet.element_ids.tolist() == [1, 2, 3]
    assert job.sheet.part.tolist() == [0, 0, 1]
    law = job.sheet.parts[0].law
    assert isinstance(law, Isotropic)
    assert pytest.approx(100e6) == law.E
    np.testing.assert_allclose(job.sheet.thickness[1], [1e-4, 2e-4, 3e-4, 4e-4])
    np.testing.assert_allclose(job.sheet.thickness[[0, 2]], [[5e-4] * 4, [2.5e-4] * 4])
    body = job.bodies[0]
    np.testing.assert_allclose(body.origin, [1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose(body.vertices[0], [-1e-3, -2e-3, -1e-3])
    assert body.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert [(h.nodes.tolist(), h.component) for h in job.held] == [([0, 3], 0), ([0, 3], 2)]
    (force,) = job.forces
    np.testing.assert_allclose(force.force, [0, 0, -3.0])
    assert force.curve == LoadCurve((0.0, 1.0), (0.0, 1.0))
    (pressure,) = job.pressures
    assert pressure.pressure.at(0.5) == pytest.approx(0.01e6)
    assert pressure.quads.tolist() == [0, 2]
    assert pressure.sign.tolist() == [1, -1]
    (springs,) = job.springs
    assert springs.law == SpringLaw(springs.law.stiffness, True)
    assert springs.law.stiffness == pytest.approx(7000.0)
    assert springs.body.tolist() == [0, -1]
    assert springs.other.tolist() == [-1, 1]
    np.testing.assert_allclose(springs.length, [5**0.5 * 1e-3, 1e-3])
    (contact,) = job.contacts
    assert (contact.penalty, contact.automatic, contact.friction) == (2.0, True, 0.3)
    assert contact.quads.tolist() == [0, 2]
    assert job.steps == (Step("step 1", 1.0, 4),)
    check_job(job)


def test_the_mid_surface_lies_against_the_normal(tmp_path: Path) -> None:
    """FEBio's nodes are the face that the normal points to."""
    job = read(tmp_path)
    np.testing.assert_allclose(job.sheet.height, -job.sheet.thickness / 2)


def test_units_scale_as_their_dimensions_say(tmp_path: Path) -> None:
    text = {**change_section("Contact", "<auto_penalty>1", "<auto_penalty>0")}
    a, b = read(tmp_path, text), read(tmp_path, text, length_unit=2e-3, force_unit=3.0)
    np.testing.assert_allclose(b.sheet.points, 2 * a.sheet.points)
    assert isinstance(a.sheet.parts[0].law, Isotropic)
    assert isinstance(b.sheet.parts[0].law, Isotropic)
    assert pytest.approx(a.sheet.parts[0].law.E * 3 / 4) == b.sheet.parts[0].law.E
    assert b.springs[0].law.stiffness == pytest.approx(a.springs[0].law.stiffness * 3 / 2)
    assert b.contacts[0].penalty == pytest.approx(a.contacts[0].penalty * 3 / 8)
    assert b.pressures[0].pressure.value == pytest.approx(a.pressures[0].pressure.value * 3 / 4)
    np.testing.assert_allclose(b.forces[0].force, 3 * a.forces[0].force)


def test_a_body_turns_about_its_centre(tmp_path: Path) -> None:
    body = read(tmp_path).bodies[0]
    place, rotation = body.pose(0.5)  # a step curve: the next point's value
    np.testing.assert_allclose(place, body.origin)
    c, s = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(rotation, [[c, 0, s], [0, 1, 0], [-s, 0, c]], atol=1e-15)
    np.testing.assert_allclose(body.pose(0.0)[1], np.eye(3))


def test_steps_follow_one_another(tmp_path: Path) -> None:
    control = SECTIONS["Control"]
    steps = f'<Step><step id="1" name="a">{control}</step><step id="2">{control}</step></Step>'
    job = read(tmp_path, {"Control": None, "Step": steps})
    assert job.steps == (Step("a", 1.0, 4), Step("step 2", 2.0, 4))


def test_the_sections_of_a_single_step_are_the_files(tmp_path: Path) -> None:
    inner = SECTIONS["Control"] + SECTIONS["Loads"]
    step = f'<Step><step id="1" name="step 1">{inner}</step></Step>'
    a, b = read(tmp_path), read(tmp_path, {"Control": None, "Loads": None, "Step": step})
    same(a.forces, b.forces)
    same(a.steps, b.steps)


def test_what_is_left_out_is_listed_with_its_line(tmp_path: Path) -> None:
    extra = {
        **change_section("Contact", "<penalty>", "<search_tol>0.01</search_tol><penalty>"),
        **change_section("Mesh", "<Surface name", '<Loop name="rim"/><Surface name'),
        **change_section(
            "MeshDomains",
            "<shell_thickness>",
            "<shell_normal_nodal>0</shell_normal_nodal><shell_thickness>",
        ),
        "Initial": '<Initial><ic type="velocity"/></Initial>',
    }
    notes = "\n".join(read(tmp_path, extra).notes)
    for part in (
        "mean normals",
        "search_tol",
        "Loop 'rim'",
        "Initial",
        "Output",
        "locking-free",
        "line ",
    ):
        assert part in notes


def test_a_file_that_is_read_whole_has_no_notes(tmp_path: Path) -> None:
    plain = {"Output": None, **change_section("Mesh", 'type="tri3"', 'type="tri3"')}
    notes = read(tmp_path, plain).notes
    assert [n for n in notes if "tri3" not in n] == []


def test_rigid_nodes_tie_and_go_before_held_ones(tmp_path: Path) -> None:
    more = '<bc node_set="edge" type="rigid"><rb>bone</rb></bc></Boundary>'
    job = read(tmp_path, change_section("Boundary", "</Boundary>", more))
    assert [(t.nodes.tolist(), t.body, t.clamped) for t in job.ties] == [([0, 3], 0, True)]
    assert job.held == ()
    assert any("goes first" in n for n in job.notes)


def test_nodes_shared_with_a_rigid_part_are_tied(tmp_path: Path) -> None:
    mesh = SECTIONS["Mesh"].replace("20,21,22,23</elem>", "3,21,22,6</elem>")
    job = read(tmp_path, {"Mesh": mesh.replace("2,20</delem>", "2,21</delem>"), "Contact": None})
    assert [(t.nodes.tolist(), t.body) for t in job.ties] == [([2, 5], 0)]


def test_the_back_face_held_with_the_front_holds_the_director(tmp_path: Path) -> None:
    more = '<bc node_set="edge" type="zero shell displacement"><sx_dof>1</sx_dof></bc></Boundary>'
    job = read(tmp_path, change_section("Boundary", "</Boundary>", more))
    assert [(d.nodes.tolist(), d.component) for d in job.held_directors] == [([0, 3], 0)]
    with pytest.raises(InputError, match="back face"):
        read(tmp_path, change_section("Boundary", "</Boundary>", more.replace("sx", "sy")))


def test_a_node_held_in_all_directions_is_ground_for_springs(tmp_path: Path) -> None:
    nodes = '<node id="30">1,1,5</node></Nodes>'
    mesh = SECTIONS["Mesh"].replace("</Nodes>", nodes).replace("2,20</delem>", "2,30</delem>")
    mesh = mesh.replace("</NodeSet>", '</NodeSet><NodeSet name="post">30</NodeSet>', 1)
    with pytest.raises(InputError, match="node 30"):
        read(tmp_path, {"Mesh": mesh})
    post = (
        '<bc node_set="post" type="zero displacement"><x_dof>1</x_dof><y_dof>1</y_dof>'
        "<z_dof>1</z_dof></bc></Boundary>"
    )
    job = read(tmp_path, {"Mesh": mesh, **change_section("Boundary", "</Boundary>", post)})
    assert job.bodies[-1].name == "ground"
    np.testing.assert_allclose(job.springs[0].anchor[0], [1e-3, 1e-3, 5e-3])


NONLINEAR = (
    '<discrete_material id="1" type="nonlinear spring"><scale>2</scale>'
    "<measure>elongation</measure>{}</discrete_material>"
)


@pytest.mark.parametrize(
    "force",
    [
        '<force type="point"><points><pt>0,0</pt><pt>1,3</pt></points></force>',
        '<force lc="1">3</force>',
    ],
)
def test_a_nonlinear_spring_is_a_table(tmp_path: Path, force: str) -> None:
    text = SECTIONS["Discrete"]
    start, end = text.index("<discrete_material"), text.index("<discrete dmat")
    law = read(tmp_path, {"Discrete": text[:start] + NONLINEAR.format(force) + text[end:]})
    assert law.springs[0].law.force(0.5e-3) == pytest.approx(3.0)
    assert law.springs[0].law.force(2e-3) == pytest.approx(6.0)


def material(kind: str, inner: str) -> Sections:
    skin = f'<material id="1" name="skin" type="{kind}"><density>1</density>{inner}</material>'
    start = SECTIONS["Material"].index('<material id="2"')
    return {"Material": "<Material>" + skin + SECTIONS["Material"][start:]}


TIMR = "<c1>2</c1><c2>0</c2><c3>0.5</c3><c4>60</c4><c5>900</c5><lam_max>1.03</lam_max><k>200</k>"
HGO = "<c>1</c><k1>2</k1><k2>3</k2><kappa>0.1</kappa><gamma>30</gamma><k>40</k>"
ORTHO = (
    "<E1>4</E1><E2>2</E2><E3>1</E3><v12>0.3</v12><v23>0.1</v23><v31>0.1</v31><G12>0.5</G12>"
    "<G23>0.6</G23><G31>0.7</G31>"
)
X = '<fiber type="vector"><vector>2,0,0</vector></fiber>'


@pytest.mark.parametrize(
    ("kind", "inner", "law"),
    [
        ("neo-Hookean", "<E>2</E><v>0.3</v>", NeoHookean(2e6, 0.3)),
        (
            "trans iso Mooney-Rivlin",
            TIMR + X,
            TransIsoMooneyRivlin(2e6, 0.0, 0.5e6, 60.0, 900e6, 1.03, 200e6),
        ),
        (
            "Holzapfel-Gasser-Ogden",
            HGO,
            HolzapfelGasserOgden(1e6, 2e6, 3.0, 0.1, np.pi / 6, 40e6),
        ),
        (
            "orthotropic elastic",
            ORTHO,
            Orthotropic(4e6, 2e6, 0.3, 0.5e6, 0.7e6, 0.6e6, 1e6, 0.1, 0.1),
        ),
    ],
)
def test_materials_become_our_laws(tmp_path: Path, kind: str, inner: str, law: Law) -> None:
    same(read(tmp_path, material(kind, inner)).sheet.parts[0].law, law)


def test_mooney_rivlin_is_the_fibred_law_without_fibres(tmp_path: Path) -> None:
    law = (
        read(tmp_path, material("Mooney-Rivlin", "<c1>1</c1><c2>2</c2><k>9</k>")).sheet.parts[0].law
    )
    assert isinstance(law, TransIsoMooneyRivlin)
    assert (law.c3, law.c5) == (0.0, 0.0)


FIBRE = '<ElementData type="fiber" elem_set="{}">{}</ElementData>'


@pytest.mark.parametrize(
    ("fiber", "data", "direction"),
    [
        (X, "", (1, 0, 0)),
        ('<fiber type="local"><local>2,3</local></fiber>', "", (0, 1, 0)),
        ('<fiber type="local">1,4</fiber>', "", (0, 1, 0)),
        ('<fiber type="angles"><theta>60</theta><phi>90</phi></fiber>', "", (0.5, 0.75**0.5, 0)),
        (
            '<fiber type="user"/>',
            FIBRE.format("strip", '<e lid="1">0,3,0</e><e lid="2">0,4,0</e>')
            + FIBRE.format("tip", '<e lid="1">0,2,0</e>'),
            (0, 1, 0),
        ),
        (
            X + '<mat_axis type="vector"><a>0,1,0</a><d>1,0,0</d></mat_axis>',
            "",
            (0, 1, 0),
        ),
        (X + '<mat_axis type="local">2,3,1</mat_axis>', "", (0, 1, 0)),
    ],
)
def test_fibres_in_all_spellings(tmp_path: Path, fiber: str, data: str, direction: Any) -> None:
    text = material("trans iso Mooney-Rivlin", TIMR + fiber)
    text["MeshData"] = SECTIONS["MeshData"].replace("</MeshData>", data + "</MeshData>")
    np.testing.assert_allclose(read(tmp_path, text).sheet.fibre[0], direction, atol=1e-12)


def test_axes_out_of_the_sheet_are_refused_where_they_matter(tmp_path: Path) -> None:
    axes = '<mat_axis type="vector"><a>1,0,0</a><d>0,0,1</d></mat_axis>'
    with pytest.raises(InputError, match="must lie in the sheet"):
        read(tmp_path, material("Holzapfel-Gasser-Ogden", HGO + axes))


# --- what is refused ------------------------------------------------------------------------

BAD: dict[str, tuple[str, str, str, str]] = {
    "unknown material": ("Material", "isotropic elastic", "Ogden", "'Ogden' is not known"),
    "material parameter": (
        "Material",
        "<E>100",
        "<prestrain>1</prestrain><E>100",
        "prestrain.*may change the answer",
    ),
    "modulus over time": ("Material", "<E>100", '<E lc="1">100', "with time"),
    "missing modulus": ("Material", "<E>100</E>", "", "<E> is missing"),
    "impossible nu": ("Material", "<v>0.4", "<v>0.6", "nu"),
    "solid element": (
        "Mesh",
        '<Elements type="tri3" name="tip"><elem id="3">3,7,6',
        '<Elements type="tet4" name="tip"><elem id="3">3,7,6,1',
        "tet4",
    ),
    "unknown element": ("Mesh", 'type="tri3"', 'type="tri7"', "tri7"),
    "unknown node": ("Mesh", "1,2,5,4</elem>", "1,2,5,400</elem>", "no node 400"),
    "doubled node": ("Mesh", '<node id="2">', '<node id="1">', "node 1 is given twice"),
    "doubled element": ("Mesh", '<elem id="2">', '<elem id="1">', "element 1 is given"),
    "short element": ("Mesh", "1,2,5,4</elem>", "1,2,5</elem>", "expected 4 numbers"),
    "half a node": ("Mesh", "1,2,5,4</elem>", "1,2,5,4.5</elem>", "numbers of nodes"),
    "not a number": ("Mesh", "1,0,0</node>", "1,0,nan</node>", "expected numbers"),
    "missing set": ("Boundary", "edge", "rim", "no node set 'rim'"),
    "missing surface": ("Loads", 'surface="top"', 'surface="lid"', "no surface 'lid'"),
    "missing pair": ("Contact", '"pair"', '"twins"', "'twins'"),
    "missing curve": ("Loads", 'lc="1"', 'lc="8"', "no load controller 8"),
    "missing body": ("Rigid", "<rb>2", "<rb>7", "no material '7'"),
    "missing domain": ("MeshDomains", '<ShellDomain name="roof" mat="bone"/>', "", "roof"),
    "unknown condition": (
        "Boundary",
        "zero displacement",
        "normal displacement",
        "normal displacement",
    ),
    "unknown load": ("Loads", "nodal_force", "nodal_moment", "nodal_moment"),
    "body load": ("Loads", "</Loads>", '<body_load type="x"/></Loads>', "body_load"),
    "unknown contact": ("Contact", "sliding-elastic", "tied-elastic", "tied-elastic"),
    "unknown spring": ("Discrete", "tension-only linear spring", "Hill", "Hill"),
    "unknown motion": ("Rigid", "rigid_rotation", "rigid_force", "rigid_force"),
    "free body": ("Rigid", "<Rw_dof>1", "<Rw_dof>0", "free in part"),
    "no centre": ("Material", "<center_of_mass>1,2,3</center_of_mass>", "", "about which"),
    "dynamics": ("Control", "STATIC", "DYNAMIC", "STATIC"),
    "no step size": ("Control", "0.25", "0", "step_size"),
    "curve back in time": (
        "LoadData",
        "<pt>0,0</pt><pt>1,1",
        "<pt>0,0,0</pt><pt>1,1",
        "expected 2 numbers",
    ),
    "stray text": ("Loads", "<Loads>", "<Loads>oops", "text among tags"),
    "shell bottom": ("Loads", "</value>", "</value><shell_bottom>1</shell_bottom>", "shell_bottom"),
    "old formulation": (
        "MeshDomains",
        'mat="skin"',
        'mat="skin" type="elastic-shell-old"',
        "elastic-shell-old",
    ),
}
LACKING: dict[str, tuple[Sections, str]] = {
    "missing section": ({"Mesh": None}, "<Mesh> is missing"),
    "missing control": ({"Control": None}, "<Control> is missing"),
    "constraints": ({"Constraints": '<Constraints><c type="joint"/></Constraints>'}, "Constraints"),
    "other file": ({"Mesh": '<Mesh from="mesh.feb"/>'}, "not followed"),
    "module": ({"Module": '<Module type="fluid"/>'}, "'fluid'"),
}


@pytest.mark.parametrize("name", [*BAD, *LACKING])
def test_what_would_change_the_answer_is_refused_with_its_line(tmp_path: Path, name: str) -> None:
    if name in LACKING:
        replaced, words = LACKING[name]
    else:
        *place, words = BAD[name]
        replaced = change_section(*place)
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path, replaced)
    assert "model.feb, line " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_line_is_the_right_one(tmp_path: Path) -> None:
    text = feb_text(change_section("Mesh", "2,3,6,5</elem>", "2,3,6,55</elem>"))
    line = text[: text.index("2,3,6,55")].count("\n") + 1
    with pytest.raises(InputError, match=f"line {line},"):
        read_feb(write(tmp_path, text))
