"""Files of meshes that lie about their size, or are of other kinds: refused in one message."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cosim.anatomy.bones import read_bones
from cosim.errors import InputError
from cosim.mesh_file import SURFACES, read_mesh_file, read_triangles
from meshes.hull import Centreline
from meshes.imported.checks import Placing
from meshes.skeleton import index_finger
from tests.fuzz.test_readers import an_stl, mutate

COUNTS = (2_000_000_000, 10**12, 10**25)
ARCHIVES = (".3mf", ".zip", ".dae", ".stp", ".step", ".gltf", ".glb", ".amf", ".xyz", ".svg", "")
SHEET = "1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n"


def msh_2(nodes: int, elements: int) -> str:
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes}\n{SHEET}$EndNodes\n"
    return f"{head}$Elements\n{elements}\n1 3 2 1 1 1 2 3 4\n$EndElements\n"


def msh_4(nodes: int, elements: int) -> str:
    places = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    return (
        f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 {nodes} 1 4\n2 1 0 4\n1\n2\n3\n4\n"
        f"{places}$EndNodes\n$Elements\n1 {elements} 1 1\n2 1 3 1\n1 1 2 3 4\n$EndElements\n"
    )


@pytest.mark.parametrize("text", [msh_2, msh_4])
def test_counts_of_gmsh_that_lie_are_refused(text, tmp_path: Path) -> None:
    path = tmp_path / "hood.msh"
    path.write_text(text(4, 1))
    assert len(read_mesh_file(path).points) == 4
    for count in COUNTS:
        for nodes, elements in ((count, 1), (4, count)):
            path.write_text(text(nodes, elements))
            with pytest.raises(InputError, match=r"hood\.msh: \$\w+ states \d+ of them, more than"):
                read_mesh_file(path)


def test_counts_of_binary_gmsh_that_lie_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "hood.msh"
    head = b"$MeshFormat\n4.1 1 8\n" + struct.pack("i", 1) + b"\n$EndMeshFormat\n$Nodes\n"
    path.write_bytes(head + struct.pack("QQQQ", 2**40, 2**40, 1, 4) + b"\n$EndNodes\n")
    with pytest.raises(InputError, match="more than a file"):
        read_mesh_file(path)


@pytest.mark.parametrize("ending", ARCHIVES)
def test_bones_of_other_kinds_are_refused(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"bone{ending}"
    for content in (b"", b"garbage \x00\xff\n" * 20, an_stl(tmp_path)):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"bone.* is not one of \.stl"):
            read_triangles(path, "bone")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("bone.stl", an_stl(tmp_path))
    with pytest.raises(InputError, match="is not one of"):
        read_triangles(path, "bone")


@pytest.mark.parametrize("ending", SURFACES)
def test_mutated_bones_are_read_or_refused(ending: str, tmp_path: Path) -> None:
    import trimesh

    path, rng = tmp_path / f"bone{ending}", np.random.default_rng(63)
    trimesh.creation.box().export(path)
    content = path.read_bytes()
    mutants = [mutate(content, rng) for _ in range(40)]
    for spoilt in (b"", b"garbage \x00\xff\n" * 20, content[:90], *mutants):
        path.write_bytes(spoilt)
        try:
            read_triangles(path, "bone")
        except InputError as error:
            assert str(error).startswith(f"bone: {path}")


def test_bones_without_area_are_refused(tmp_path: Path) -> None:
    line = "facet normal 0 0 0\nouter loop\n" + "vertex 0 0 0\nvertex 1 0 0\nvertex 2 0 0\n"
    path = tmp_path / "line.stl"
    path.write_text("solid a\n" + 4 * f"{line}endloop\nendfacet\n" + "endsolid a\n")
    finger = index_finger()
    chain = Centreline(finger, np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    hood = Placing()
    with pytest.raises(InputError, match=r"none of its triangles has an area|no triangles"):
        read_bones([path] * 4, "body", "mm", hood, chain)
