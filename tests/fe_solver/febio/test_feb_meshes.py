"""FEBio's quadratic shells, parts, part lists, and what is given element by element."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive
from fe_solver.job.job import HeldDirector, Job, PrescribedDisplacement, Pressure
from fe_solver.job.model import sheet_stiffness
from fe_solver.job.results import write_job
from fe_solver.job.solve import solve_job
from fe_solver.materials.linear import Isotropic
from fe_solver.q4ans.model import obstacles
from fe_solver.sheet import even_sheet, grid
from tests.helpers.feb_strips import LENGTH, THICK, WIDTH, E, end_nodes, read_strip, strip_text
from tests.helpers.febio_schema import faults
from tests.proofs.fe.sheets import with_nine_nodes

PRESSED = '<surface_load surface="{}" type="pressure"><pressure lc="1">{}</pressure></surface_load>'
SIZE = 1e-5
"""MPa, which bends the strip little."""


def deflection(job: Job) -> float:
    (state,) = solve_job(job).states
    return float(state.configuration.x[end_nodes(job), 2].mean() - job.sheet.points[:, 2].max())


def own_nine_node_strip(cells: int) -> Job:
    """The solver's own: nine-node elements, clamped and held as the file's are."""
    points, quads = grid(cells, 2)
    points = np.column_stack([points * [LENGTH, WIDTH], np.zeros(len(points))]) * 1e-3
    points, quads = with_nine_nodes(points, quads)
    sheet = even_sheet(points, quads, Isotropic(E * 1e6, 0.0), THICK * 1e-3)
    sheet = replace(sheet, height=-sheet.thickness / 2)
    left = sheet.edge("x0")
    held = [PrescribedDisplacement(left, i) for i in range(3)]
    directors = [HeldDirector(left, i) for i in range(3)]
    load = Pressure(np.arange(len(quads)), np.ones(len(quads), dtype=int), Drive(SIZE * 1e6))
    return Job(sheet, held=held, held_directors=directors, pressures=[load])


def test_quad9_is_the_solvers_own_nine_node_element(tmp_path: Path) -> None:
    job = read_strip(tmp_path, "quad9", 4, PRESSED.format("@part_list:strip", SIZE))
    assert job.sheet.quads.shape == (8, 9)
    own = own_nine_node_strip(4)
    (a,), (b,) = solve_job(job).states, solve_job(own).states
    order, own_order = (np.lexsort(np.round(j.sheet.points, 9).T) for j in (job, own))
    moved, own_moved = (
        (s.configuration.x - j.sheet.points)[o]
        for s, j, o in ((a, job, order), (b, own, own_order))
    )
    np.testing.assert_allclose(moved, own_moved, atol=1e-9 * np.abs(own_moved).max())
    assert obstacles(job) == ["its elements have nine nodes"]
    assert any("nine-node shell" in note for note in job.notes)


def beam() -> float:
    """The deflection (m) of a cantilever under an even pressure, q L^4 / 8 E I."""
    load, second = SIZE * 1e6 * WIDTH * 1e-3, WIDTH * THICK**3 / 12 * 1e-12
    return -load * (LENGTH * 1e-3) ** 4 / (8 * E * 1e6 * second)


@pytest.mark.parametrize(
    ("kind", "tolerance"),
    [("quad4", 0.02), ("quad8", 3e-3), ("quad9", 3e-3), ("tri3", 0.05), ("tri6", 0.02)],
)
def test_a_strip_of_every_kind_bends_as_a_beam(tmp_path: Path, kind: str, tolerance: float) -> None:
    """Positive pressure pushes against the normal, which is z."""
    job = read_strip(tmp_path, kind, 8, PRESSED.format("@part_list:strip", SIZE))
    assert deflection(job) == pytest.approx(beam(), rel=tolerance)


def test_quad8_gets_the_middle_node_that_its_shape_functions_put_there(tmp_path: Path) -> None:
    eight, nine = (read_strip(tmp_path, kind, 2, bow=0.5) for kind in ("quad8", "quad9"))
    assert len(eight.sheet.points) == len(nine.sheet.points)
    new = np.setdiff1d(np.arange(len(eight.sheet.points)), eight.sheet.quads[:, :8])
    assert eight.sheet.node_ids[new].min() > 21
    eights = eight.sheet.points[eight.sheet.quads[:, :8]]
    middle = eights @ np.eye(3)
    expected = (middle[:, 4:].sum(axis=1) * 2 - middle[:, :4].sum(axis=1)) / 4
    np.testing.assert_allclose(eight.sheet.points[eight.sheet.quads[:, 8]], expected)
    assert any("with a middle node" in note for note in eight.notes)


def test_a_set_of_all_of_a_quad8_holds_its_middle_too(tmp_path: Path) -> None:
    flat = '<bc name="f" node_set="all" type="zero displacement"><y_dof>1</y_dof></bc>'
    job = read_strip(tmp_path, "quad8", 2, boundary=flat)
    assert len(job.held[0].nodes) == len(job.sheet.points)
    loaded = '<nodal_load node_set="all" type="nodal_force"><value>0,0,1</value></nodal_load>'
    assert len(read_strip(tmp_path, "quad8", 2, loaded).forces[0].nodes) == 21


def test_tri6_is_four_triangles_through_all_its_nodes_and_says_how_far_off(tmp_path: Path) -> None:
    flat, bowed = (read_strip(tmp_path, "tri6", 2, bow=bow) for bow in (0.0, 0.4))
    assert flat.sheet.quads.shape == (32, 4)
    assert len(flat.sheet.points) == 25
    assert flat.sheet.element_ids.tolist() == np.repeat(np.arange(1, 9), 4).tolist()
    assert any("curved sides lie up to 0 mm off" in note for note in flat.notes)
    # a cell's side of the parabola 4 h u (1 - u) rises h / 4 over its chord, a quarter of that off
    assert any("curved sides lie up to 0.025 mm off" in note for note in bowed.notes)


def test_quadratic_quads_beside_triangles_become_flat_ones(tmp_path: Path) -> None:
    text = strip_text("quad9", 2, PRESSED.format("face", SIZE))
    parts = '<Elements type="tri3" name="tip"><elem id="90">{},{},{}</elem></Elements>'
    text = text.replace("</Elements>", "</Elements>" + parts.format(20, 99, 22), 1)
    text = text.replace("</Nodes>", '<node id="99">9,1,0</node></Nodes>')
    text = text.replace(
        "</MeshDomains>",
        '<ShellDomain name="tip" mat="skin"><shell_thickness>0.3</shell_thickness></ShellDomain>'
        "</MeshDomains>",
    )
    face = '<Surface name="face"><quad9 id="1">1,2,3,4,5,6,7,8,9</quad9></Surface>'
    path = tmp_path / "strip.feb"
    first = text.index('<elem id="1">') + len('<elem id="1">')
    nodes = text[first : text.index("</elem>", first)]
    path.write_text(text.replace("</Mesh>", face.replace("1,2,3,4,5,6,7,8,9", nodes) + "</Mesh>"))
    job = read_feb(path)
    assert job.sheet.quads.shape == (4 * 4 + 1, 4)
    assert job.pressures[0].quads.tolist() == [0, 1, 2, 3]


def test_surfaces_and_sets_of_parts(tmp_path: Path) -> None:
    sets = (
        '<ElementSet name="few">1,2</ElementSet><PartList name="both">strip</PartList>'
        '<Edge name="rim"><line2 id="1">1,2</line2><line2 id="2">2,3</line2></Edge>'
        '<Surface name="one"><quad4 id="1">1,2,3,4</quad4></Surface>'
    )
    names = ("@part_list:both", "@elem_set:few", "@edge:rim", "@surface:one", "@elem_set:strip")
    held = "".join(
        f'<bc name="{i}" node_set="{name}" type="zero displacement"><{axis}_dof>1</{axis}_dof></bc>'
        for i, (name, axis) in enumerate(zip(names, "xyzxy", strict=True))
    )
    loads = "".join(PRESSED.format(name, SIZE) for name in ("@part_list:both", "@part_list:strip"))
    job = read_strip(tmp_path, "quad4", 2, loads, sets=sets, boundary=held)
    assert [len(h.nodes) for h in job.held] == [9, 6, 3, 4, 9]
    assert [p.quads.tolist() for p in job.pressures] == [[0, 1, 2, 3]] * 2
    for name, words in (("@part_list:none", "no part or part list 'none'"), ("few", "no surface")):
        with pytest.raises(InputError, match=words):
            read_strip(tmp_path, "quad4", 2, PRESSED.format(name, 1), sets=sets)
    with pytest.raises(InputError, match="no part 'other'"):
        read_strip(tmp_path, sets='<PartList name="both">strip,other</PartList>')


def rows(values: list[float]) -> str:
    return "".join(f'<e lid="{i}">{v}</e>' for i, v in enumerate(values, 1))


HALVES = [100.0] * 8 + [50.0] * 8
MAP = '<ElementData name="map_E" elem_set="{}">{}</ElementData>'


@pytest.mark.parametrize("name", ["strip", "@part_list:both", "@elem_set:strip", "both"])
def test_a_map_gives_a_modulus_to_each_element(tmp_path: Path, name: str) -> None:
    """The deflection is that of a cantilever whose outer half is half as stiff."""
    job = read_strip(
        tmp_path,
        "quad4",
        8,
        PRESSED.format("@part_list:strip", SIZE),
        modulus='<E type="map">map_E</E>',
        sets='<PartList name="both">strip</PartList>',
        data=MAP.format(name, rows(HALVES)),
    )
    law = job.sheet.parts[0].law
    assert isinstance(law, Isotropic)
    np.testing.assert_allclose(law.E, 1e6 * np.array(HALVES)[:, None])
    # q L^4 / 8 E I, and that of the outer half's own curvature once more: 1/16
    assert deflection(job) == pytest.approx(beam() * (1 + 1 / 16), rel=0.02)


def test_formulas_of_the_place_and_of_maps(tmp_path: Path) -> None:
    job = read_strip(
        tmp_path,
        modulus='<E type="math">map_E*(1 + X/8)</E>',
        data=MAP.format("strip", rows(HALVES)),
    )
    law = job.sheet.parts[0].law
    assert isinstance(law, Isotropic)
    assert np.shape(law.E) == (16, 4)
    middle = job.sheet.points[job.sheet.quads].mean(axis=1)[:, 0]
    expected = 1e6 * np.array(HALVES) * (1 + middle / 8e-3)
    np.testing.assert_allclose(np.mean(law.E, axis=1), expected)


def test_a_map_of_equal_values_is_one_number_that_febios_element_takes(tmp_path: Path) -> None:
    data = MAP.format("strip", rows([70.0] * 16))
    job = read_strip(tmp_path, modulus='<E type="map">map_E</E>', data=data)
    assert job.sheet.parts[0].law == Isotropic(70e6, 0.0)
    assert obstacles(job) == []


@pytest.mark.parametrize(
    ("kind", "inner"),
    [
        ("neo-Hookean", '<E type="map">m</E><v type="math">0.3 + X/100</v>'),
        (
            "trans iso Mooney-Rivlin",
            '<c1 type="map">m</c1><c2>0</c2><c3>1</c3><c4>5</c4><c5 type="math">10*m</c5>'
            '<lam_max>1.05</lam_max><k type="math">100 + X</k><fiber type="vector">1,0,0</fiber>',
        ),
        (
            "Holzapfel-Gasser-Ogden",
            '<c type="map">m</c><k1>1</k1><k2>2</k2><kappa>0.1</kappa><gamma>30</gamma><k>100</k>',
        ),
    ],
)
def test_every_law_takes_values_by_element(tmp_path: Path, kind: str, inner: str) -> None:
    text = strip_text(
        "quad4", 2, data=MAP.replace("map_E", "m").format("strip", rows([9, 8, 7, 6]))
    )
    first, last = text.index('type="isotropic elastic">'), text.index("</material>")
    path = tmp_path / "strip.feb"
    path.write_text(f'{text[:first]}type="{kind}">{inner}{text[last:]}')
    sheet = read_feb(path).sheet
    assert np.isfinite(sheet.section.response(np.full((4, 4, 8), 1e-3)).energy).all()
    stiffness = [sheet_stiffness(sheet, np.array([i])) for i in range(4)]
    assert (np.diff(stiffness) < 0).all()


@pytest.mark.parametrize(
    ("data", "thickness"),
    [
        (
            '<ElementData type="shell thickness" elem_set="few">'
            + rows([0.5, 0.6])
            + "</ElementData>",
            "",
        ),
        (
            '<ElementData name="h" elem_set="few">' + rows([0.5, 0.6]) + "</ElementData>"
            '<ElementData type="shell thickness" elem_set="@elem_set:rest">'
            + rows([0.3] * 14)
            + "</ElementData>",
            '<shell_thickness type="map">h</shell_thickness>',
        ),
    ],
)
def test_thickness_of_a_set(tmp_path: Path, data: str, thickness: str) -> None:
    """The rows count in the set's order, which is not the part's."""
    rest = ",".join(str(i) for i in range(1, 17) if i not in (3, 7))
    sets = f'<ElementSet name="few">7,3</ElementSet><ElementSet name="rest">{rest}</ElementSet>'
    thickness = thickness or f"<shell_thickness>{THICK}</shell_thickness>"
    job = read_strip(tmp_path, sets=sets, data=data, thickness=thickness)
    assert job.sheet.thickness[[6, 2], 0].tolist() == pytest.approx([0.5e-3, 0.6e-3])
    assert job.sheet.thickness[[0, 15], 3].tolist() == pytest.approx([0.3e-3] * 2)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"modulus": '<E type="map">none</E>'}, "no ElementData called 'none'"),
        (
            {"modulus": '<E type="map">map_E</E>', "data": MAP.format("strip", rows([1.0]))},
            "element 2 has no value",
        ),
        (
            {"modulus": '<E type="map">map_E</E>', "data": MAP.format("strip", rows([1.0] * 17))},
            "elements 1 to 16, not 17",
        ),
        (
            {"modulus": '<E type="map">map_E</E>', "data": MAP.format("strip", rows([-1.0] * 16))},
            "E",
        ),
        ({"modulus": '<E type="math">X - 100</E>'}, "E"),
        ({"modulus": '<E type="math">W</E>'}, "'W' is not known; known here: X, Y, Z"),
        ({"modulus": '<E type="user">1</E>'}, "of type 'user' is not read"),
        ({"thickness": '<shell_thickness type="map">h</shell_thickness>'}, "called 'h'"),
        ({"thickness": ""}, "thickness of element 1 is missing"),
        ({"data": MAP.format("nothing", "")}, "no element set or part 'nothing'"),
    ],
)
def test_maps_are_refused_by_their_place(tmp_path: Path, more: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_strip(tmp_path, **more)


def test_a_nine_node_job_is_written_for_febio_and_paraview(tmp_path: Path) -> None:
    job = replace(
        read_strip(tmp_path, "quad9", 2, PRESSED.format("@part_list:strip", SIZE), bow=0.3)
    )
    write_feb(job, tmp_path / "again.feb")
    assert faults(tmp_path / "again.feb") == []
    again = read_feb(tmp_path / "again.feb")
    np.testing.assert_allclose(again.sheet.points, job.sheet.points, atol=1e-15)
    assert (again.sheet.quads == job.sheet.quads).all()
    assert again.pressures[0].quads.tolist() == job.pressures[0].quads.tolist()
    turned = replace(job, pressures=[replace(job.pressures[0], sign=-job.pressures[0].sign)])
    write_feb(turned, tmp_path / "again.feb")
    text = (tmp_path / "again.feb").read_text()
    assert '<quad9 id="1">4,3,2,1,7,6,5,8,9</quad9>' in text
    assert read_feb(tmp_path / "again.feb").pressures[0].sign.tolist() == [-1] * 4
    folder = write_job(tmp_path / "out", solve_job(job))
    import meshio

    (cells,) = meshio.read(folder / "state_000.vtu").cells
    assert cells.type == "quad9"
    rest = job.sheet.points[cells.data]
    np.testing.assert_allclose(rest[:, 4, :2], rest[:, [0, 1], :2].mean(axis=1), atol=1e-12)
