"""Meshes in .vtu: every encoding that VTK writes is one mesh, a broken file one clear fault."""

from __future__ import annotations

import itertools
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista
from hypothesis import given, settings
from hypothesis import strategies as st
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from cosim import mesh_file
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.mesh_file import read_mesh_file
from cosim.models.build import hood_mesh
from meshes.imported.raw import RawMesh, read_raw
from meshes.imported.write import write_vtu
from tests.helpers.own_anatomy import user_hood

COMPRESSORS = ("None", "ZLib", "LZ4", "LZMA")
MODES = ("Ascii", "Binary", "Appended raw", "Appended base64")
ENDS = ("Little", "Big")
QUAD, LINE, PIXEL, POLYGON, TRIANGLE = 9, 3, 8, 7, 5


@pytest.fixture(scope="module")
def own() -> RawMesh:
    return user_hood(hood_mesh(load_case("isometric_edc", ["hood.mesh.quads=120"])))


def grid_of(
    points: np.ndarray, cells: list[tuple[int, list[int]]], **arrays: np.ndarray
) -> pyvista.UnstructuredGrid:
    """Cells as (type, nodes); arrays as long as the cells are theirs, else the points'."""
    stated = np.concatenate([[len(nodes), *nodes] for _, nodes in cells])
    grid = pyvista.UnstructuredGrid(stated, [kind for kind, _ in cells], points)
    for name, values in arrays.items():
        (grid.cell_data if len(values) == len(cells) else grid.point_data)[name] = values
    return grid


def hood(own: RawMesh, quad: int = QUAD, order: tuple[int, ...] = (0, 1, 2, 3)):
    """A grid of a hood with an array of whole numbers for each of its sets."""
    lines = np.concatenate(list(own.lines.values()))
    cells = [(quad, nodes) for nodes in own.quads[:, list(order)].tolist()]
    cells += [(LINE, nodes) for nodes in lines.tolist()]
    owner = np.repeat(np.arange(len(own.lines)), [len(pairs) for pairs in own.lines.values()])
    sets = dict(own.cells)
    sets |= {name: len(own.quads) + np.flatnonzero(owner == i) for i, name in enumerate(own.lines)}
    data = {name: np.isin(np.arange(len(cells)), chosen) for name, chosen in sets.items()}
    at = {name: np.isin(np.arange(len(own.points)), nodes) for name, nodes in own.nodes.items()}
    return grid_of(own.points, cells, **{k: v.astype(np.int32) for k, v in (data | at).items()})


def write_vtk(
    grid: pyvista.UnstructuredGrid,
    path: Path,
    mode: str = "Ascii",
    compressor: str = "None",
    header: int = 32,
    ids: int = 64,
    order: str = "Little",
) -> Path:
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    getattr(writer, f"SetDataModeTo{mode.split()[0]}")()
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    getattr(writer, f"SetHeaderTypeToUInt{header}")()
    getattr(writer, f"SetIdTypeToInt{ids}")()
    getattr(writer, f"SetByteOrderTo{order}Endian")()
    writer.SetEncodeAppendedData("base64" in mode)
    assert writer.Write()
    return path


def assert_is_the_hood(read: RawMesh, own: RawMesh) -> None:
    np.testing.assert_array_equal(read.points, own.points)
    np.testing.assert_array_equal(read.quads, own.quads)
    assert read.dropped == ()
    for found, wanted in ((read.cells, own.cells), (read.lines, own.lines)):
        assert found.keys() == wanted.keys()
        for name, values in wanted.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert read.nodes.keys() == own.nodes.keys() | own.lines.keys()
    for name, values in own.nodes.items():
        np.testing.assert_array_equal(read.nodes[name], np.unique(values), err_msg=name)


LAYOUTS = [
    *[(mode, compressor, 32, 64, "Little") for mode in MODES for compressor in COMPRESSORS],
    *[("Appended raw", "None", *x) for x in itertools.product((32, 64), (32, 64), ENDS)],
]


@pytest.mark.parametrize("layout", LAYOUTS[::3], ids=str)
def test_an_encoding_of_vtk_is_the_same_hood(own: RawMesh, tmp_path: Path, layout: tuple) -> None:
    assert_is_the_hood(read_raw(write_vtk(hood(own), tmp_path / "hood.vtu", *layout)), own)


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_every_encoding_of_vtk_is_the_same_hood(
    own: RawMesh, tmp_path: Path, layout: tuple
) -> None:
    path = write_vtk(hood(own), tmp_path / "hood.vtu", *layout)
    assert_is_the_hood(read_raw(path), own)


@settings(max_examples=6, deadline=None)
@given(st.data())
def test_arrays_of_any_type_and_length_are_read_as_vtk_reads_them(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    n = data.draw(st.integers(1, 30))
    points = np.array([[i, j, 0.0] for i in range(n + 1) for j in range(2)])
    kinds = data.draw(st.lists(st.sampled_from([QUAD, TRIANGLE, LINE]), min_size=n, max_size=n))
    size = {QUAD: 4, TRIANGLE: 3, LINE: 2}
    ring = [[2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1] for i in range(n)]
    cells = [(kind, ring[i][: size[kind]]) for i, kind in enumerate(kinds)]
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    types = data.draw(st.lists(st.sampled_from("bBhHiIqQfd"), max_size=12))
    arrays = {
        f"array {i}": rng.integers(0, 100, (n, i % 3 + 1) if i % 2 else 2 * (n + 1)).astype(kind)
        for i, kind in enumerate(types)
    }
    mode, compressor = data.draw(st.sampled_from(MODES)), data.draw(st.sampled_from(COMPRESSORS))
    options = [data.draw(st.sampled_from(x)) for x in ((32, 64), (32, 64), ("Little", "Big"))]
    path = tmp_path_factory.mktemp("any") / "a.vtu"
    write_vtk(grid_of(points, cells, **arrays), path, mode, compressor, *options)
    read, theirs = read_mesh_file(path), pyvista.read(path)
    np.testing.assert_array_equal(read.points, theirs.points)
    found = [nodes for block in read.cells for nodes in block.data.tolist()]
    assert found == [nodes for _, nodes in cells]
    assert read.point_data.keys() == set(theirs.point_data.keys())
    assert read.cell_data.keys() == set(theirs.cell_data.keys())
    for name, values in read.point_data.items():
        assert values.dtype == theirs.point_data[name].dtype
        np.testing.assert_array_equal(values, theirs.point_data[name])
    for name, parts in read.cell_data.items():
        np.testing.assert_array_equal(np.concatenate(parts), theirs.cell_data[name])
        assert [len(part) for part in parts] == [len(block) for block in read.cells]


def test_a_file_that_meshio_wrote_is_read_without_vtk_and_is_the_same(
    own: RawMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "own.vtu"
    write_vtu(replace(own, fields={"fibre": np.eye(3)[np.arange(len(own.quads)) % 3]}), path)
    theirs = mesh_file._read_vtu(path)
    monkeypatch.setitem(sys.modules, "pyvista", None)
    ours = read_mesh_file(path)
    np.testing.assert_array_equal(ours.points, theirs.points)
    assert [block.type for block in ours.cells] == [block.type for block in theirs.cells]
    pairs = [(a.data, b.data) for a, b in zip(ours.cells, theirs.cells, strict=True)]
    for found, wanted in ((ours.point_data, theirs.point_data), (ours.cell_data, theirs.cell_data)):
        assert found.keys() == wanted.keys()
        pairs += [(a, b) for name in found for a, b in zip(found[name], wanted[name], strict=True)]
    for a, b in pairs:
        assert a.dtype.kind == b.dtype.kind
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("quad", "order"), [(PIXEL, (0, 1, 3, 2)), (POLYGON, (0, 1, 2, 3))])
def test_pixels_and_polygons_are_quads(
    own: RawMesh, tmp_path: Path, quad: int, order: tuple[int, ...]
) -> None:
    path = write_vtk(hood(own, quad, order), tmp_path / "hood.vtu")
    assert_is_the_hood(read_raw(path), own)


SQUARES = np.array([[i, j, 0.0] for j in range(2) for i in range(3)])


def squares() -> pyvista.UnstructuredGrid:
    cells = [(QUAD, [0, 1, 4, 3]), (QUAD, [1, 2, 5, 4]), (LINE, [0, 3])]
    part, end = np.array([7, 8, 0]), np.array([1, 0, 0, 1, 0, 0])
    return grid_of(SQUARES, cells, part=part, end=end)


def test_polygons_of_more_corners_are_told(tmp_path: Path) -> None:
    cells = [(POLYGON, [0, 1, 2, 5, 3]), (POLYGON, [0, 1, 4]), (POLYGON, [1, 2, 5, 4])]
    read = read_raw(write_vtk(grid_of(SQUARES, cells), tmp_path / "a.vtu"))
    assert read.quads.tolist() == [[0, 1, 4, 4], [1, 2, 5, 4]]
    assert read.dropped == ("1 cells of type polygon, which are no shells",)


def test_pieces_are_joined(tmp_path: Path) -> None:
    text = write_vtk(squares(), tmp_path / "a.vtu").read_text()
    piece = re.search(r"<Piece.*</Piece>", text, re.DOTALL)[0]  # type: ignore[index]
    (tmp_path / "b.vtu").write_text(text.replace(piece, piece + piece))
    read = read_raw(tmp_path / "b.vtu")
    np.testing.assert_array_equal(read.points, np.concatenate([SQUARES, SQUARES]))
    assert read.quads.tolist() == [[0, 1, 4, 3], [1, 2, 5, 4], [6, 7, 10, 9], [7, 8, 11, 10]]
    assert read.cells["part:8"].tolist() == [1, 3]
    assert read.nodes["end"].tolist() == [0, 3, 6, 9]


SPOILT = [
    ('NumberOfCells="3"', 'NumberOfCells="99999999999999"'),
    ('NumberOfPoints="6"', 'NumberOfPoints="9"'),
    ("0 1 4 3 1 2", "0 1 6 3 1 2"),
    ("0 1 4 3 1 2", "0 1 -1 3 1 2"),
    ("4 8 10", "8 4 10"),
    ("9 9 3", "9 99 3"),
    ("7 8 0", "7 8"),
    ('Name="types"', 'Name="kinds"'),
    ('"UnstructuredGrid"', '"PolyData"'),
    ("<Cells>", "<Cells"),
]


@pytest.mark.parametrize(("old", "new"), SPOILT)
def test_what_does_not_fit_together_is_one_fault(
    tmp_path: Path, old: str, new: str, capfd: pytest.CaptureFixture[str]
) -> None:
    text = write_vtk(squares(), tmp_path / "a.vtu").read_text()
    assert old in text
    (tmp_path / "a.vtu").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=re.escape(str(tmp_path / "a.vtu"))) as caught:
        read_mesh_file(tmp_path / "a.vtu")
    assert len(str(caught.value).splitlines()) == 1
    assert capfd.readouterr() == ("", "")


def test_a_process_that_ends_or_hangs_is_one_fault(tmp_path: Path, monkeypatch) -> None:
    path = write_vtk(squares(), tmp_path / "a.vtu")
    monkeypatch.setattr(mesh_file, "READER", "tests.helpers.faults:abort")
    with pytest.raises(InputError, match=r"a\.vtu: VTK cannot read it: its process ended by SIGAB"):
        read_mesh_file(path)
    monkeypatch.setattr(mesh_file, "VTK_LIMIT", 0.2)
    monkeypatch.setattr(mesh_file, "READER", "tests.helpers.faults:hang")
    with pytest.raises(InputError, match=r"a\.vtu: VTK cannot .*: it did not answer within 0\.2 s"):
        read_mesh_file(path)


def test_a_grid_without_cells_or_points_holds_no_shell(tmp_path: Path) -> None:
    bare = pyvista.UnstructuredGrid(np.zeros(0, dtype=int), np.zeros(0, dtype=np.uint8), SQUARES)
    assert (bare.n_points, bare.n_cells) == (6, 0)
    for grid in (bare, pyvista.UnstructuredGrid()):
        with pytest.raises(InputError, match="holds no shell cells"):
            read_raw(write_vtk(grid, tmp_path / "a.vtu"))


def test_an_array_of_text_is_refused_by_name(tmp_path: Path) -> None:
    grid = squares()
    grid.cell_data["who"] = np.array(["one", "two", "three"])
    with pytest.raises(InputError, match="its array 'who' holds no numbers; leave it out"):
        read_mesh_file(write_vtk(grid, tmp_path / "a.vtu"))


CUTS = [(mode, compressor) for mode in MODES for compressor in COMPRESSORS]


@pytest.mark.parametrize(("mode", "compressor"), [CUTS[0], CUTS[5], CUTS[8]])
def test_a_file_that_is_cut_off_is_one_fault(tmp_path: Path, mode: str, compressor: str) -> None:
    path = write_vtk(squares(), tmp_path / "a.vtu", mode, compressor)
    content = path.read_bytes()
    for part in (0, 0.3, 0.6, 0.9):
        path.write_bytes(content[: int(part * len(content))])
        with pytest.raises(InputError):
            read_mesh_file(path)


def check_spoilt(path: Path, content: bytes) -> None:
    """A spoilt file is one fault, or a mesh whose cells name nodes that are there."""
    path.write_bytes(content)
    try:
        mesh = read_mesh_file(path)
    except InputError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)
    else:
        assert all(((b.data >= 0) & (b.data < len(mesh.points))).all() for b in mesh.cells)


def test_a_file_of_meshio_that_is_spoilt_anywhere(
    own: RawMesh, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "own.vtu"
    write_vtu(own, path)
    content, rng = path.read_bytes(), np.random.default_rng(1)
    for end in range(0, len(content), len(content) // 15):
        check_spoilt(path, content[:end])
    for _ in range(100):
        spoilt = bytearray(content)
        for at in rng.integers(0, len(content), 3):
            spoilt[at] = rng.integers(0, 256)
        check_spoilt(path, bytes(spoilt))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("wrong", [-1, 10**6])
def test_a_file_of_meshio_whose_cells_name_no_nodes_is_one_fault(
    own: RawMesh, tmp_path: Path, wrong: int
) -> None:
    path, quads = tmp_path / "own.vtu", own.quads.copy()
    quads[7, 2] = wrong
    write_vtu(replace(own, quads=quads), path)
    with pytest.raises(InputError, match=r"own\.vtu: a cell names nodes that are not there"):
        read_mesh_file(path)


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "compressor"), CUTS)
def test_files_that_are_spoilt_anywhere(tmp_path: Path, mode: str, compressor: str) -> None:
    path = write_vtk(squares(), tmp_path / "a.vtu", mode, compressor)
    content, rng = path.read_bytes(), np.random.default_rng(1)
    for end in range(0, len(content), len(content) // 15):
        check_spoilt(path, content[:end])
    for _ in range(15):
        spoilt = bytearray(content)
        for at in rng.integers(0, len(content), 3):
            spoilt[at] = rng.integers(0, 256)
        check_spoilt(path, bytes(spoilt))


@pytest.mark.parametrize("name", ["a.vtu", "a.msh", "a.stl", "a.inp", "a.xyz", "a.vtk", "a.obj"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff garbage \x80" * 9, b"<VTKFile>", b"1 2\n3"])
def test_a_broken_file_of_any_format_gives_one_message(
    tmp_path: Path, name: str, content: bytes
) -> None:
    (tmp_path / name).write_bytes(content)
    try:
        mesh = read_mesh_file(tmp_path / name)
    except InputError as error:
        assert name in str(error)
    else:
        assert not mesh.cells


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("ending", [".vtk", ".vtp"])
def test_legacy_files_and_surfaces_hold_the_same_mesh_and_sets(
    own: RawMesh, tmp_path: Path, ending: str, binary: bool
) -> None:
    grid = hood(own)
    whole = (
        grid
        if ending == ".vtk"
        else pyvista.PolyData(
            np.asarray(grid.points),
            faces=np.concatenate([np.full((len(own.quads), 1), 4), own.quads], axis=1).ravel(),
        )
    )
    if ending == ".vtp":
        for name in own.cells:
            whole.cell_data[name] = np.asarray(grid.cell_data[name])[: len(own.quads)]
        for name in grid.point_data:
            whole.point_data[name] = grid.point_data[name]
    path = tmp_path / f"hood{ending}"
    whole.save(path, binary=binary)
    found = read_raw(path)
    assert found.points == pytest.approx(own.points, abs=1e-5)
    assert np.array_equal(found.quads, own.quads)
    for name, quads in own.cells.items():
        assert np.array_equal(found.cells[name], quads)
    ends = [name for name in own.nodes if name.startswith(("end_", "tied_"))]
    assert ends
    assert all(np.array_equal(found.nodes[name], own.nodes[name]) for name in ends)


@pytest.mark.parametrize("ending", [".vtk", ".vtp"])
def test_another_dataset_of_vtk_is_named(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"image{ending}"
    if ending == ".vtk":
        pyvista.ImageData(dimensions=(2, 2, 2)).save(path)
    else:
        hood_like = pyvista.UnstructuredGrid({9: np.array([[0, 1, 2, 3]])}, np.eye(4, 3))
        hood_like.save(tmp_path / "grid.vtu")
        (tmp_path / "grid.vtu").rename(path)
    with pytest.raises(InputError, match=r"which is no mesh|no XML file of VTK's type PolyData"):
        read_mesh_file(path)
