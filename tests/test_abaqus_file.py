"""Abaqus input files: numbers, sets, parts and their places; and meshio's reader beside ours."""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import meshio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.abaqus_file import CORNERS, KINDS, MAKERS, read_inp
from cosim.errors import InputError
from tests.helpers.folders import ROOT

SQUARE = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n5, 2, 0, 0\n6, 2, 1, 0\n"
TWO = "*ELEMENT, TYPE=S4R\n11, 1, 2, 3, 4\n12, 2, 5, 6, 3\n"


def read(folder: Path, text: str) -> meshio.Mesh:
    path = folder / "a.inp"
    path.write_text(text, encoding="utf-8")
    return read_inp(path)


def cells(mesh: meshio.Mesh, name: str) -> list[int]:
    return np.concatenate(mesh.cell_sets[name]).tolist()


@pytest.mark.parametrize(
    ("written", "chosen"),
    [
        ("*ELSET, ELSET=a\n11, 12\n", [0, 1]),
        ("*Elset, elset=a\n 12,\n", [1]),
        ("*ELSET, ELSET=a, GENERATE\n1, 11\n12, 12, 1\n", [0, 1]),
        ("*ELSET, ELSET=a, GENERATE\n2, 1000000000000, 10\n", [1]),
        ("*ELSET, ELSET=b\n12\n*ELSET, ELSET=a\nB\n", [1]),
        ("*ELSET, ELSET=a\nb, 11\n*ELSET, ELSET=b\n12\n", [0, 1]),
        ("*ELSET, ELSET=a\n11\n*NSET, NSET=a\n1\n*ELSET, ELSET=A\n12\n", [0, 1]),
        ("** a comment\n*ELSET,\nELSET=a\n11\n", [0]),
        ('*ELSET, ELSET="a", INTERNAL, UNSORTED\n11\n', [0]),
    ],
)
def test_a_set_is_as_abaqus_means_it(tmp_path: Path, written: str, chosen: list[int]) -> None:
    assert cells(read(tmp_path, SQUARE + TWO + written), "a") == chosen


def test_a_set_at_the_elements_is_of_these_alone_and_of_all_that_name_it(tmp_path: Path) -> None:
    one, other = TWO.splitlines()[1:]
    text = f"*ELEMENT, TYPE=S4, ELSET=a\n{one}\n*ELEMENT, TYPE=S4, ELSET=b\n{other}\n"
    mesh = read(tmp_path, SQUARE + text)
    assert (cells(mesh, "a"), cells(mesh, "b")) == ([0], [1])
    again = read(tmp_path, SQUARE + text.replace("=b", "=a"))
    assert cells(again, "a") == [0, 1]


def test_instances_are_shifted_then_turned(tmp_path: Path) -> None:
    text = (
        f"*HEADING\nany words, even *these\n*PART, NAME=P\n{SQUARE}{TWO}"
        "*ELSET, ELSET=a\n11\n*END PART\n*ASSEMBLY, NAME=A\n"
        "*INSTANCE, NAME=I, PART=p\n0, 0, 5\n0, 0, 0, 0, 0, 2, 90\n*END INSTANCE\n"
        "*NSET, NSET=end, INSTANCE=I\n5, 6\n*END ASSEMBLY\n"
    )
    mesh = read(tmp_path, text)
    assert mesh.points[4] == pytest.approx([0, 2, 5])
    assert mesh.points[2] == pytest.approx([-1, 1, 5])
    assert mesh.point_sets["end"].tolist() == [4, 5]
    assert cells(mesh, "a") == [0]


@given(
    shift=st.tuples(*3 * [st.floats(-9, 9)]),
    written=st.sampled_from(["{0!r}, {1!r}, {2!r}", "{0!r}, {1!r}, {2!r},", "{0!r}", "", ","]),
    axis=st.tuples(*3 * [st.floats(0.1, 2)]),
    angle=st.floats(-180, 180),
)
def test_an_instance_without_a_shift_is_turned_all_the_same(
    shift: tuple[float, ...], written: str, axis: tuple[float, ...], angle: float
) -> None:
    """Rodrigues' formula about an axis that is no axis of the mesh and misses the origin; what is
    blank of the first line is zero."""
    first = written.format(*shift)
    x, about, k = np.array([1.0, 1, 0]), np.array([1.0, 2, 3]), np.array(axis)
    moved = np.array([shift[i] if f"{{{i}" in written else 0.0 for i in range(3)]) + x - about
    k /= np.linalg.norm(k)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    expected = c * moved + s * np.cross(k, moved) + (1 - c) * (k @ moved) * k + about
    line = ", ".join(map(repr, [*about.tolist(), *(about + axis).tolist(), angle]))
    text = f"*PART, NAME=P\n{SQUARE}{TWO}*END PART\n*INSTANCE, NAME=I, PART=P\n{first}\n{line}\n"
    with TemporaryDirectory() as folder:
        assert read(Path(folder), text).points[2] == pytest.approx(expected, abs=1e-9)


def test_a_beam_may_name_the_node_that_turns_its_section(tmp_path: Path) -> None:
    mesh = read(tmp_path, SQUARE + TWO + "*ELEMENT, TYPE=B31\n1, 1, 2, 6\n")
    assert mesh.cells_dict["line"].tolist() == [[0, 1]]
    with pytest.raises(InputError, match="has 2 nodes, found 3"):
        read(tmp_path, SQUARE + TWO + "*ELEMENT, TYPE=T3D2\n1, 1, 2, 6\n")


def test_sets_of_two_instances_have_their_names_before_them(tmp_path: Path) -> None:
    places = ("*INSTANCE, NAME=L, PART=P\n", "*INSTANCE, NAME=R, PART=P\n10, 0, 0\n")
    text = f"*PART, NAME=P\n{SQUARE}{TWO}*ELSET, ELSET=a\n11\n*END PART\n"
    mesh = read(tmp_path, text + "*END INSTANCE\n".join(places) + "*END INSTANCE\n")
    assert (cells(mesh, "L.a"), cells(mesh, "R.a")) == ([0], [2])
    assert mesh.points[6:] - mesh.points[:6] == pytest.approx(np.tile([10, 0, 0], (6, 1)))


@pytest.mark.parametrize("order", [1, -1])
def test_a_part_whose_shells_are_in_no_set_is_left_out_and_told(tmp_path: Path, order: int) -> None:
    hood = f"*PART, NAME=HOOD\n{SQUARE}{TWO}*ELSET, ELSET=a\n11, 12\n*END PART\n"
    bone = f"*PART, NAME=BONE\n{SQUARE}{TWO}*END PART\n"
    mesh = read(tmp_path, "".join([hood, bone][::order]))
    assert len(mesh.cells[0].data) == 2
    assert mesh.info["dropped"] == ["2 shells of BONE, which are in no set"]
    at = mesh.points[mesh.cells[0].data[0]]
    assert at == pytest.approx(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))


def test_what_lies_beside_is_included_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "nodes.inc").write_text(SQUARE)
    mesh = read(tmp_path, "*INCLUDE, INPUT=nodes.inc\n" + TWO)
    assert len(mesh.points) == 6
    for name in ("../nodes.inc", "/etc/hosts", "none.inc", "a.inp", ""):
        with pytest.raises(InputError, match=r"a\.inp: line 1"):
            read(tmp_path, f"*INCLUDE, INPUT={name}\n" + TWO)


@pytest.mark.parametrize("kind", sorted(CORNERS))
def test_every_kind_has_its_nodes_over_several_lines_too(tmp_path: Path, kind: str) -> None:
    count = CORNERS[kind]
    name = next(name for name, of in KINDS.items() if of == kind)
    nodes = "*NODE\n" + "".join(f"{i}, {i}., 1.5D0,\n" for i in range(1, count + 1))
    words = [str(i) for i in range(1, count + 1)]
    flat = read(tmp_path, f"{nodes}*ELEMENT, TYPE={name}\n7, {', '.join(words)}\n")
    (block,) = flat.cells
    assert (block.type, block.data.tolist()) == (kind, [list(range(count))])
    assert flat.points[0] == pytest.approx([1, 1.5, 0])
    split = read(tmp_path, f"{nodes}*ELEMENT, TYPE={name}\n7,\n{', '.join(words)}\n")
    assert np.array_equal(split.cells[0].data, block.data)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("*NODE\n1, a, 0\n", 2, "expected numbers"),
        ("*NODE\n1, nan, 0\n", 2, "finite, at most"),
        ("*NODE\n1.5, 0, 0\n", 2, "the node's number, found '1.5'"),
        ("*NODE\n\u00b2, 0, 0\n", 2, "the node's number"),
        ("*NODE\n1, 0, 0, 0, 0, 0, 1, 9\n", 2, "at most 6 numbers, found 7"),
        ("*NODE\n1, 0, 0\n*NODE\n1, 1, 0\n", 4, "node 1 is stated twice"),
        (SQUARE + "*ELEMENT, TYPE=S4\n1, 1, 2, 3\n", 9, "has 4 nodes, found 3"),
        (SQUARE + "*ELEMENT, TYPE=S4\n1, 1, 2, 3, 99\n", 9, "names node 99"),
        (SQUARE + "*ELEMENT, TYPE=S4\n1, 1, 2, 3, 4, 5\n", 9, "has 4 nodes, found 5"),
        (SQUARE + "*ELEMENT, TYPE=S4\n1, 1, 2,\n3, 4, 5\n", 10, "has 4 nodes, found 5"),
        (SQUARE + "*ELEMENT, TYPE=S4\n1, 1, 2, 3,\n", 9, "has 4 nodes, found 3"),
        (SQUARE + TWO + "*ELSET, ELSET=a, GENERATE\n1.5, 2\n", 12, "whole numbers"),
        (SQUARE + TWO + "*ELSET, ELSET=a, GENERATE\n11\n", 12, "a first, a last"),
        ("*INSTANCE, NAME=I, PART=P\n0, 0, 0, 0, 0, 1, 90\n", 2, "write 0, 0, 0 before"),
        ("*INSTANCE, NAME=I, PART=P\n\n0, 0, 0, 0, 0, 1\n", 3, "two points of an axis"),
        ("*INSTANCE, NAME=I, PART=P\n\n0, 0, 0, 0, 0, 1, 9\n1\n", 4, "has two lines"),
        (SQUARE + TWO + "*ELEMENT, TYPE=S4\n11, 2, 5, 6, 3\n", 12, "element 11 is stated twice"),
        (SQUARE + "*ELEMENT, TYPE=S4\nx, 1, 2, 3, 4\n", 9, "the element's number"),
        ("1, 2, 3\n", 1, "before any keyword"),
        ("*INSTANCE, NAME=I\n", 1, "without PART="),
        ("*NSET\n1\n", 1, "without a name"),
        ("*NODE, SYSTEM=C\n1, 1, 90, 0\n", 1, "SYSTEM="),
        *((f"*{word}\n1\n", 1, f"{word} makes or moves nodes") for word in sorted(MAKERS)),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path: Path, text: str, line: int, words: str) -> None:
    with pytest.raises(InputError) as raised:
        read(tmp_path, text)
    assert f"a.inp: line {line}: " in str(raised.value)
    assert words in str(raised.value)


@pytest.mark.parametrize("text", ["*ELSET, ELSET=a\na\n", "*ELSET, ELSET=a\nb\n"])
def test_a_set_of_itself_or_of_none_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="which is not there"):
        read(tmp_path, SQUARE + TWO + text)


def test_what_is_not_read_is_counted(tmp_path: Path) -> None:
    solid = "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 1, 2\n"
    mesh = read(tmp_path, SQUARE + TWO + solid + "*STEP\n*CLOAD\n1, 2, 3\n*END STEP\n")
    assert mesh.info["dropped"][0].startswith("1 elements of type C3D8")
    assert mesh.info["dropped"][1:] == ["1 x *CLOAD", "1 x *END STEP", "1 x *STEP"]
    absent = read(tmp_path, SQUARE + TWO + "*NSET, NSET=a\n1, 98, 99\n").info["dropped"]
    assert absent == ["2 numbers of a set (a.inp: line 12) that are no nodes"]


def test_our_reader_and_meshio_s_read_a_plain_file_alike() -> None:
    path = ROOT / "cases" / "own" / "hood.inp"
    ours = read_inp(path)
    theirs = meshio.abaqus.read(StringIO(path.read_text(encoding="utf-8")))
    assert np.array_equal(ours.points, theirs.points)
    assert np.array_equal(ours.cells_dict["quad"], theirs.cells_dict["quad"])
    assert set(ours.point_sets) == set(theirs.point_sets)
    for name, nodes in theirs.point_sets.items():
        assert set(ours.point_sets[name]) == set(np.asarray(nodes).tolist())
