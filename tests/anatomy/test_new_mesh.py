"""A user's hood mesh: read from four formats, its faults told, its axes and unit found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.anatomy.read import read_hood
from cosim.anatomy.write import FORMATS, write_hood
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.models.build import hood_mesh
from meshes.hood_mesh import HoodMesh, display_quads
from meshes.hull import Centreline, along
from meshes.imported.checks import (
    Placing,
    axes_fault,
    axes_text,
    landmarks,
    parse_axes,
    wind_alike,
)
from meshes.imported.hood import ImportedSheet, places, read_sheet, stations
from meshes.imported.names import map_names, missing_sets_fault
from meshes.imported.raw import RawMesh, read_raw
from meshes.imported.write import write_vtu
from meshes.skeleton import index_finger
from tests.helpers.own_anatomy import user_hood

THICKNESS = 0.65e-3
FAR = np.array([30.0, -40, 50])
"""mm, of another origin."""


@pytest.fixture(scope="module")
def ours() -> HoodMesh:
    return hood_mesh(load_case("isometric_edc", ["hood.mesh.quads=120"]))


@pytest.fixture(scope="module")
def raw(ours: HoodMesh) -> RawMesh:
    own = user_hood(ours)
    nodes = dict(own.nodes) | {name: np.unique(pairs) for name, pairs in own.lines.items()}
    return replace(own, nodes=nodes, thickness=None, fields={})


@pytest.fixture(scope="module")
def chain(ours: HoodMesh) -> Centreline:
    skeleton = index_finger()
    return Centreline(skeleton, *skeleton.pose(ours.rest_posture))


def sheet(
    raw: RawMesh, chain: Centreline, placing: Placing | None = None, **names: str
) -> ImportedSheet:
    return read_sheet(raw, names, placing or Placing(), chain, THICKNESS)


@pytest.mark.parametrize("ending", sorted(set(FORMATS) - {".stl"}))
def test_every_format_holds_the_same_mesh_and_sets(
    ours: HoodMesh, raw: RawMesh, tmp_path: Path, ending: str
):
    path, own = tmp_path / f"hood{ending}", user_hood(ours)
    FORMATS[ending](own, path)
    read = read_hood(path)
    np.testing.assert_allclose(read.points, raw.points, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(read.quads, raw.quads)
    assert missing_sets_fault(read, map_names(read, {})) == []
    assert {*read.cells, *read.nodes} == {*raw.cells, *raw.nodes}
    for name, cells in raw.cells.items():
        np.testing.assert_array_equal(read.cells[name], cells)
    for name, nodes in raw.nodes.items():
        np.testing.assert_array_equal(np.unique(read.nodes[name]), np.unique(nodes))
    for name, pairs in raw.lines.items():
        np.testing.assert_array_equal(read.lines[name], pairs)
    if ending != ".msh":
        np.testing.assert_allclose(read.thickness, own.thickness, rtol=1e-15)
    if ending in (".feb", ".vtu"):
        np.testing.assert_allclose(read.fields["fibre"], ours.fibre, atol=1e-15)
    stated = ["<Material> (placeholder)"] if ending == ".feb" else []
    assert list(read.dropped) == stated


def test_the_surface_alone_is_written_as_triangles(ours: HoodMesh, tmp_path: Path):
    assert write_hood(ours, index_finger(), tmp_path / "hood.stl").startswith("all but the surface")
    mesh = trimesh.load_mesh(tmp_path / "hood.stl")
    assert len(mesh.faces) == 2 * len(ours.quads)
    assert 1e-6 * mesh.area == pytest.approx(ours.areas().sum(), rel=1e-2)


def test_nine_nodes_go_out_as_four_quads(tmp_path: Path):
    settings = ["hood.mesh.quads=120", 'hood.mesh.elements="quadratic"']
    nine = hood_mesh(load_case("isometric_edc", settings))
    lost = write_hood(nine, index_finger(), tmp_path / "hood.inp")
    assert lost.startswith("elements of nine nodes (four quads each), directions of the fibres")
    read = read_hood(tmp_path / "hood.inp")
    np.testing.assert_array_equal(read.quads, display_quads(nine.quads))
    region = nine.cells("terminal_slip")
    assert len(read.cells["terminal_slip"]) == 4 * region.sum()


@pytest.mark.parametrize("first", ["", ", ELSET=a", ", ELSET=b"])
@pytest.mark.parametrize("last", ["", ", ELSET=b", ", ELSET=c"])
def test_sets_named_at_the_elements_are_of_these(tmp_path: Path, first: str, last: str):
    text = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,2,0,0\n6,2,1,0\n7,3,0,0\n8,3,1,0\n"
    text += f"*ELEMENT, TYPE=S4{first}\n1,1,2,3,4\n*Element, type=S4, elset=b\n2,2,5,6,3\n"
    text += f"*ELEMENT, TYPE=T3D2{last}\n3,7,8\n4,5,7\n5,6,8\n"
    (tmp_path / "a.inp").write_text(text)
    read = read_raw(tmp_path / "a.inp")
    wanted = {"b": [0, 1] if first.endswith("b") else [1]} | (
        {"a": [0]} if "a" in first[-1:] else {}
    )
    assert {name: cells.tolist() for name, cells in read.cells.items()} == wanted
    lines = {name: pairs.tolist() for name, pairs in read.lines.items()}
    assert lines == ({last[-1]: [[6, 7], [4, 6], [5, 7]]} if last else {})


QUADS = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,2,0,0\n6,2,1,0\n*ELEMENT, TYPE=S4\n"
QUADS += "1,1,2,3,4\n2,2,5,6,3\n*ELSET, ELSET=Left\n1\n*ELSET, ELSET=right\n2\n"
BOTH = QUADS + "*Shell Section, elset=LEFT, material=m\n 0.2, 5\n"


@pytest.mark.parametrize(
    ("text", "thickness"),
    [
        (BOTH + '*SHELL SECTION, ELSET="right"\n0.3\n', [0.2, 0.3]),
        (BOTH, None),
        (BOTH + "*SHELL SECTION, ELSET=right, OFFSET=SPOS\n0.3\n", None),
        (BOTH + "*SHELL SECTION, ELSET=right, COMPOSITE\n0.3\n", None),
    ],
)
def test_sections_of_all_quads_are_their_thickness(
    tmp_path: Path, text: str, thickness: list[float] | None
):
    """Others stay among what is dropped."""
    (tmp_path / "a.inp").write_text(text)
    read = read_raw(tmp_path / "a.inp")
    assert (None if read.thickness is None else read.thickness.tolist()) == thickness
    assert any("thickness" in what for what in read.dropped) == (thickness is None)


def test_gmsh_4_and_abaqus_cards_and_other_cells(tmp_path: Path):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 1], [0.5, 0, 0.0]])
    mesh = meshio.Mesh(
        points,
        [("quad", [[0, 1, 2, 3]]), ("tetra", [[0, 1, 2, 4]]), ("triangle6", [[0, 1, 2, 5, 5, 5]])],
        point_data={"height": np.linspace(0, 1, 6), "edge": np.array([1, 1, 0, 0, 0, 0])},
        cell_data={"part": [np.array([3]), np.array([4]), np.array([5])]},
    )
    mesh.write(tmp_path / "a.vtu")
    read = read_raw(tmp_path / "a.vtu")
    assert read.quads.tolist() == [[0, 1, 2, 3], [0, 1, 2, 2]]
    assert {k: v.tolist() for k, v in read.cells.items()} == {"part:3": [0], "part:5": [1]}
    assert read.nodes["edge"].tolist() == [0, 1]
    told = " | ".join(read.dropped)
    for word in (
        "1 cells of type tetra",
        "mid-side nodes of 1 cells of type triangle6",
        "'height'",
    ):
        assert word in told
    text = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n*ELEMENT, TYPE=S4\n1,1,2,3,4\n"
    text += "*MATERIAL, NAME=a\n*ELASTIC\n1.0,0.4\n** a remark\n*CLOAD\n1,1,1.0\n"
    (tmp_path / "a.inp").write_text(text)
    assert read_raw(tmp_path / "a.inp").dropped == ("1 x *CLOAD", "1 x *ELASTIC", "1 x *MATERIAL")


def test_our_own_hood_is_in_order_as_it_is(ours: HoodMesh, raw: RawMesh, chain: Centreline):
    read = sheet(raw, chain)
    np.testing.assert_array_equal(read.quads, ours.quads)
    assert [note for note in read.notes if "warped" not in note] == []


def test_places_along_the_chain_undo_laying_out(chain: Centreline):
    s = np.linspace(-0.02, 0.08, 60)
    at = chain.at(s, np.full(60, 6e-3), np.linspace(-5e-3, 5e-3, 60))
    np.testing.assert_allclose(places(at, chain), s, atol=2e-5)
    station = np.linspace(-20, 75, 40)
    np.testing.assert_allclose(
        stations(chain.skeleton, along(chain.skeleton, station)), station, atol=1e-6
    )


def faults(raw: RawMesh, chain: Centreline, placing: Placing | None = None, **names: str) -> str:
    with pytest.raises(InputError) as caught:
        sheet(raw, chain, placing, **names)
    return str(caught.value)


def test_missing_sets_are_named_with_the_nearest_and_can_be_mapped(raw: RawMesh, chain: Centreline):
    nodes = {k.replace("end_central", "central_end_1"): v for k, v in raw.nodes.items()}
    nodes |= {"half": raw.nodes["tied_distal"][:1], "other": raw.nodes["tied_distal"][1:]}
    del nodes["tied_distal"]
    cells = {k.replace("central_slip", "SLIP"): v for k, v in raw.cells.items()}
    told = faults(replace(raw, cells=cells, nodes=nodes), chain)
    assert "in no region, the first is quad" in told
    assert "(it is in SLIP)" in told
    assert "no set end_central: " in told
    assert "nearest names in the mesh are central_end_1" in told
    assert "no set tied_distal: " in told
    assert "end_radial:" not in told
    names = {"end_central": "central_end_1", "tied_distal": "half+other", "central_slip": "SLIP"}
    read = sheet(replace(raw, cells=cells, nodes=nodes), chain, **names)
    np.testing.assert_array_equal(read.sets.nodes["tied_distal"], raw.nodes["tied_distal"])
    wrong = faults(raw, chain, end_centrl="end_central")
    assert "end_centrl is none of our names; did you mean end_central" in wrong
    assert "the nearest are end_radial" in faults(raw, chain, end_radial="end_radia")


def test_a_name_may_differ_in_case_and_dashes(raw: RawMesh):
    other = {name.upper().replace("_", "-"): cells for name, cells in raw.cells.items()}
    assert missing_sets_fault(raw, map_names(replace(raw, cells=other), {})) == []


def test_a_quad_in_two_regions_or_a_loose_end_is_a_fault(raw: RawMesh, chain: Centreline):
    cells = dict(raw.cells) | {"terminal_slip": np.append(raw.cells["terminal_slip"], 0)}
    assert "1 quads are in two regions: quad 0" in faults(replace(raw, cells=cells), chain)
    nodes = dict(raw.nodes) | {
        "end_radial": np.append(raw.nodes["end_radial"], len(raw.points) - 1)
    }
    assert "end_radial: 1 of its" in faults(replace(raw, nodes=nodes), chain)


def with_triangle(quads: np.ndarray) -> np.ndarray:
    return np.vstack([[quads[0, 0], quads[0, 1], quads[0, 2], quads[0, 2]], quads[1:]])


def with_bow_tie(quads: np.ndarray) -> np.ndarray:
    return np.vstack([quads[:1, [0, 2, 1, 3]], quads[1:]])


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (with_triangle, "1 of 144 cells are triangles, the first is cell 0"),
        (with_bow_tie, "1 quads have a reflex corner, cross themselves or have no area: quads 0"),
        (lambda q: np.vstack([q[1:], q[1:2]]), "1 cells are there twice"),
        (lambda q: np.vstack([q[1:], [q[0, 0], q[0, 0], *q[0, 2:]]]), "1 quads name a node twice"),
    ],
)
def test_bad_quads_are_counted_and_named(
    raw: RawMesh, chain: Centreline, spoil: Callable[[np.ndarray], np.ndarray], complaint: str
):
    told = faults(replace(raw, quads=spoil(raw.quads)), chain)
    assert complaint.replace("144", str(len(raw.quads))) in told


def test_pieces_and_double_nodes_are_told(raw: RawMesh, chain: Centreline):
    apart = raw.quads.copy()
    seam = np.unique(apart[raw.cells["extensor_tendon_proximal"]])
    twin = len(raw.points) + np.arange(len(seam))
    cells = raw.cells["extensor_tendon_proximal"]
    apart[cells] = twin[np.searchsorted(seam, apart[cells])]
    points = np.vstack([raw.points, raw.points[seam]])
    assert "pairs of nodes lie at one place" in faults(
        replace(raw, quads=apart, points=points), chain
    )
    points[twin] += [0, 0, 0.2]
    assert "falls into 2 pieces" in faults(replace(raw, quads=apart, points=points), chain)


@settings(max_examples=15, deadline=None)
@given(st.sets(st.integers(0, 89)))
def test_quads_wound_otherwise_are_turned_back(raw: RawMesh, chain: Centreline, wrong: set[int]):
    quads = raw.quads.copy()
    chosen = np.array(sorted(wrong), dtype=int)
    quads[chosen] = quads[chosen][:, ::-1]
    read = sheet(replace(raw, quads=quads), chain)
    normals = [
        np.cross(*(raw.points[q[:, [2, 3]]] - raw.points[q[:, [0, 1]]]).transpose(1, 0, 2))
        for q in (read.quads, raw.quads)
    ]
    assert (np.einsum("nk,nk->n", *normals) > 0).all()
    if chosen.size:
        assert f"{len(chosen)} quads were wound against" in " ".join(read.notes)


def test_a_sheet_turned_inside_out_and_a_third_quad_at_an_edge(raw: RawMesh, chain: Centreline):
    read = sheet(replace(raw, quads=raw.quads[:, ::-1]), chain)
    np.testing.assert_array_equal(read.quads, raw.quads)
    assert "all normals pointed at the bones" in " ".join(read.notes)
    with pytest.raises(InputError, match="3 cells meet at the edge from node 0 to node 1"):
        wind_alike(np.array([[0, 1, 2, 3], [1, 0, 4, 5], [0, 1, 6, 7]]))
    with pytest.raises(InputError, match="one-sided"):
        wind_alike(np.array([[0, 1, 3, 2], [2, 3, 5, 4], [4, 5, 0, 1]]))


@pytest.mark.parametrize(("unit", "factor"), [("m", 1e-3), ("cm", 0.1), ("um", 1e3)])
def test_another_unit_is_found(raw: RawMesh, chain: Centreline, unit: str, factor: float):
    told = faults(replace(raw, points=factor * raw.points), chain)
    assert f"it would fit in {unit}: --unit {unit}" in told
    read = sheet(replace(raw, points=factor * raw.points), chain, Placing(unit))
    np.testing.assert_allclose(read.points, 1e-3 * raw.points, atol=1e-12)


@pytest.mark.parametrize("axes", ["y z x", "z -x y", "-x -y z", "x -z y", "-y x z"])
def test_swapped_axes_are_found_and_the_text_named_mends_them(
    raw: RawMesh, chain: Centreline, axes: str
):
    turned = raw.points @ parse_axes(axes)  # so that `axes` brings them back
    told = faults(replace(raw, points=turned), chain)
    assert f'--axes "{axes}"' in told
    assert ("mirrors it into a right hand" in told) == (np.linalg.det(parse_axes(axes)) < 0)
    read = sheet(replace(raw, points=turned), chain, Placing("mm", parse_axes(axes)))
    np.testing.assert_allclose(read.points, 1e-3 * raw.points, atol=1e-12)


def test_a_left_hand_is_told_and_mirrored(raw: RawMesh, chain: Centreline):
    left = replace(raw, points=raw.points * [1, -1, 1], quads=raw.quads[:, ::-1])
    told = faults(left, chain)
    assert "mirrored" in told
    assert '--axes "x -y z"' in told
    read = sheet(left, chain, Placing("mm", parse_axes("x -y z")))
    np.testing.assert_array_equal(read.points, 1e-3 * raw.points)
    np.testing.assert_array_equal(read.quads, raw.quads)
    assert "turned over" not in " ".join(read.notes)


def test_a_mirrored_hood_is_told_where_its_ends_stand_otherwise_than_ours(chain: Centreline):
    found = landmarks(chain)
    for side, y in (("radial", -2e-3), ("ulnar", 2e-3)):
        found[f"end_{side}"] = found[f"end_{side}"] * [1, 0, 1] + [0, y, 0]
    told, _ = axes_fault(found, chain, np.eye(3))
    assert "mirrored" in told
    assert '--axes "x -y z"' in told
    found = {name: place * [1, -1, 1] for name, place in found.items()}
    assert axes_fault(found, chain, np.eye(3))[0] == ""


def test_a_reflex_corner_is_told(raw: RawMesh, chain: Centreline):
    points, quad = raw.points.copy(), raw.quads[0]
    points[quad[0]] = 0.1 * points[quad[2]] + 0.45 * (points[quad[1]] + points[quad[3]])
    assert "1 quads have a reflex corner" in faults(replace(raw, points=points), chain)


def test_another_origin_is_told_with_its_place(raw: RawMesh, chain: Centreline):
    told = faults(replace(raw, points=raw.points + FAR), chain)
    assert "mm from where it would on this finger" in told
    assert "--origin" in told
    place = [float(x) for x in told.split('--origin "')[1].split('"')[0].split()]
    assert np.linalg.norm(np.array(place) - FAR) < 8
    moved = Placing("mm", np.eye(3), FAR)
    read = sheet(replace(raw, points=raw.points + FAR), chain, moved)
    np.testing.assert_allclose(read.points, 1e-3 * raw.points, atol=1e-12)


def test_free_nodes_and_sets_of_no_use_are_told(raw: RawMesh, chain: Centreline):
    more = replace(
        raw,
        points=np.vstack([raw.points, [[0, 0, 0]]]),
        nodes=dict(raw.nodes) | {"my_set": raw.nodes["end_radial"]},
        dropped=("3 x *CLOAD",),
    )
    told = " | ".join(sheet(more, chain).notes)
    assert "dropped: 1 nodes that belong to no quad" in told
    assert "dropped: the sets my_set" in told
    assert "dropped: 3 x *CLOAD" in told
    fewer = {k: v for k, v in raw.nodes.items() if k != "spring_sagittal_radial"}
    lines = {k: v for k, v in raw.lines.items() if k != "spring_sagittal_radial"}
    told = " | ".join(sheet(replace(raw, nodes=fewer, lines=lines), chain).notes)
    assert "not in the model: spring_sagittal_radial" in told


@pytest.mark.parametrize("text", ["x y", "x y y", "a b c", "x y zz", ""])
def test_axes_that_are_none_are_refused(text: str):
    with pytest.raises(InputError, match="--axes"):
        parse_axes(text)


def test_axes_as_text_and_back():
    assert axes_text(parse_axes("z -x +y")) == "z -x y"
    np.testing.assert_array_equal(parse_axes("z -x y") @ [1, 2, 3], [3, -1, 2])


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=300), st.sampled_from([".vtu", ".msh", ".inp", ".feb", ".stl"]))
def test_any_bytes_are_one_clear_fault(tmp_path_factory, content: bytes, ending: str):
    path = tmp_path_factory.mktemp("any") / f"hood{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_hood(path)


def test_vectors_of_the_quads_become_fields_of_directions(
    tmp_path: Path, ours: HoodMesh, chain: Centreline
):
    """In our axes; those that stand on the sheet are dropped and told."""
    write_vtu(replace(user_hood(ours), fields={}), tmp_path / "hood.vtu")
    mesh = meshio.read(tmp_path / "hood.vtu")
    lines = np.ones((len(mesh.cells[1].data), 3))
    mesh.cell_data["slips"] = [2 * ours.fibre, lines]
    mesh.cell_data["up"] = [np.tile([0.0, 0.0, 1.0], (len(ours.quads), 1)), lines]
    mesh.write(tmp_path / "vectors.vtu")
    found = sheet(read_raw(tmp_path / "vectors.vtu"), chain)
    assert list(found.fields) == ["slips"]
    assert found.fields["slips"] == pytest.approx(ours.fibre, abs=1e-4)
    assert any("'up', which do not lie in the sheet" in note for note in found.notes)
