"""Reading a mesh file: VTK's by VTK where meshio did not write it, Abaqus' by a reader of our own,
others by meshio; a bone's triangles by trimesh."""

from __future__ import annotations

import zlib
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from itertools import pairwise
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.abaqus_file import read_inp
from cosim.errors import InputError
from cosim.extras import require
from cosim.files import MB, check_file_size
from cosim.processes import ForeignError, ForeignProcess

if TYPE_CHECKING:
    from meshio import Mesh

Ints = NDArray[np.int64]
CELLS = {
    **{1: "vertex", 3: "line", 5: "triangle", 7: "polygon", 9: "quad", 10: "tetra"},
    **{12: "hexahedron", 13: "wedge", 14: "pyramid", 21: "line3", 22: "triangle6"},
    **{23: "quad8", 24: "tetra10", 25: "hexahedron20", 28: "quad9", 29: "hexahedron27"},
}
"""meshio's names of VTK's types of cells."""
TRIANGLE, POLYGON, PIXEL, QUAD = 5, 7, 8, 9
BY_VTK = (".vtu", ".vtp", ".vtk")
BY_MESHIO = b"<!--This file was created by meshio v"
"""What meshio writes into the head of a .vtu."""
HEAD = 500
"""Bytes of a file in which that stands."""
SURFACES = (".stl", ".obj", ".ply", ".off")
"""Files of triangles and no more: others are archives, or call for further libraries."""
IN_GMSH = "in gmsh put every surface and curve into one, or set Mesh.SaveAll = 0, and save it again"
MOST_BYTES = 256 * MB
READER = "cosim.vtu_child:read_arrays"
VTK_LIMIT = 120.0
"""s that VTK may take for a file."""


def read_mesh_file(path: Path) -> Mesh:
    """The mesh of a file: points (n, 3) in the file's unit, blocks of cells, and their arrays.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "triangle.obj"
    ...     _ = path.write_text("v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n")
    ...     mesh = read_mesh_file(path)
    >>> len(mesh.points), mesh.cells[0].type
    (3, 'triangle')

    Raises InputError where it cannot be read."""
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    check_file_size(path, MOST_BYTES)
    if path.suffix.lower() == ".inp":
        return read_inp(path)
    if path.suffix.lower() in BY_VTK and not _is_by_meshio(path):
        return _read_vtu(path)
    mesh = _read_by_meshio(path)
    for block in mesh.cells:
        if not _are_nodes(block.data, len(mesh.points)):
            raise InputError(f"{path}: a cell names nodes that are not there")
    return mesh


def read_triangles(path: Path, place: str) -> Any:
    """The surface of a bone as trimesh has it; `place` begins an error.

    Raises InputError where the file is of another kind than SURFACES or cannot be read."""
    import trimesh

    advice = "give a closed surface as STL or OBJ"
    if path.suffix.lower() not in SURFACES:
        raise InputError(f"{place}: {path} is not one of {', '.join(SURFACES)}; {advice}")
    try:
        with np.errstate(all="ignore"):
            mesh = trimesh.load_mesh(path)
        _ = mesh.vertices, mesh.faces  # a cloud of points has none
        return mesh
    except MemoryError:
        raise
    except Exception as error:  # readers of surfaces raise anything of a spoilt file
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        raise InputError(
            f"{place}: {path} cannot be read as a triangle surface ({reason}); {advice}"
        ) from error


def _is_by_meshio(path: Path) -> bool:
    """Whether meshio wrote a .vtu, as all that the program writes."""
    with path.open("rb") as file:
        return BY_MESHIO in file.read(HEAD)


def _are_nodes(nodes: Ints, count: int) -> bool:
    return bool(((nodes >= 0) & (nodes < count)).all())


def _read_by_meshio(path: Path) -> Mesh:
    """meshio's readers end in many ways on a broken file, some by leaving the program."""
    import meshio

    if path.suffix.lower() == ".msh":
        _check_counts(path)
    try:
        readers = {".vtu": meshio.vtu.read}
        # it prints empty lines and warnings
        with np.errstate(all="ignore"), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            return readers.get(path.suffix.lower(), meshio.read)(path)
    except SystemExit as end:
        raise InputError(f"{path}: meshio knows no format for it, or finds it broken") from end
    except MemoryError as error:
        raise InputError(f"{path}: says it holds more than there is room for: {error}") from error
    except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError) as error:
        raise InputError(f"{path}: meshio cannot read it: {error!r}") from error
    except (OSError, RuntimeError, SyntaxError, ValueError, meshio.ReadError, zlib.error) as error:
        text = str(error) or type(error).__name__
        if path.suffix.lower() == ".msh" and "gmsh:physical" in text:
            text = f"some of its elements are in no physical group ({text}); {IN_GMSH}"
        raise InputError(f"{path}: meshio cannot read it: {text}") from error


def _check_counts(path: Path) -> None:
    """Refuse a file of gmsh that says it holds more than it does, which meshio makes room for.
    Raises InputError."""
    size = path.stat().st_size
    if not size:
        return
    for name in (b"$Nodes", b"$Elements"):
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
            start = content.find(name) + len(name)
            head = content[start : start + 34].lstrip() if start >= len(name) else b""
        stated = [int(word[:20]) for word in head.split(b"\n")[0].split() if word.isdigit()][:2]
        if not stated:  # of version 4, binary
            stated = np.frombuffer(head[: len(head) // 8 * 8], dtype=np.uint64)[:2].tolist()
        if max(stated, default=0) > size:
            raise InputError(
                f"{path}: {name.decode()} states {max(stated)} of them, more than a file of {size} "
                "bytes holds; save it again"
            )


def _read_vtu(path: Path) -> Mesh:
    """meshio mixes up arrays of appended raw data.  Pixels, and polygons of three or four corners,
    are quads and triangles; cells of one type that follow each other are one block."""
    require(f"{path}: reading a file of VTK that another program wrote", "pyvista")
    import meshio

    arrays = _arrays_of_vtu(path)
    types, ends, nodes = (arrays[key].astype(np.int64) for key in ("types", "ends", "nodes"))
    sizes = np.diff(ends, prepend=0)
    if not _is_whole(types, sizes, nodes, len(arrays["points"])):
        raise InputError(f"{path}: a cell names nodes that are not there")
    first = ends - sizes
    at = first[types == PIXEL]
    nodes[at + 2], nodes[at + 3] = nodes[at + 3], nodes[at + 2]
    types[types == PIXEL] = QUAD
    types[(types == POLYGON) & (sizes == 4)] = QUAD
    types[(types == POLYGON) & (sizes == 3)] = TRIANGLE
    same = (np.diff(types, prepend=-1) == 0) & (np.diff(sizes, prepend=-1) == 0)
    starts = np.flatnonzero(~same)
    blocks = [
        (_name(path, int(types[a])), nodes[first[a] : ends[b - 1]].reshape(b - a, -1))
        for a, b in pairwise([*starts, len(types)])
    ]
    data: dict[str, dict[str, Any]] = {"point": {}, "cell": {}}
    for key, values in arrays.items():
        kind, slash, name = key.partition("/")
        if slash:
            data[kind][name] = values
    cell_data = {name: np.split(values, starts[1:]) for name, values in data["cell"].items()}
    return meshio.Mesh(arrays["points"], blocks, data["point"], cell_data if blocks else {})


def _is_whole(types: Ints, sizes: Ints, nodes: Ints, count: int) -> bool:
    """Whether the nodes of all cells are among the points and as many as the cells say."""
    return bool(
        (sizes >= 0).all()
        and sizes.sum() == len(nodes)
        and _are_nodes(nodes, count)
        and (sizes[types == PIXEL] == 4).all()
    )


def _name(path: Path, kind: int) -> str:
    if kind not in CELLS:
        raise InputError(f"{path}: holds cells of VTK's type {kind}; a shell is made of quads")
    return CELLS[kind]


def _arrays_of_vtu(path: Path) -> dict[str, Any]:
    """What `cosim.vtu_child` makes of a file."""
    process = ForeignProcess()
    try:
        arrays: dict[str, Any] = process.call(READER, str(path.resolve()), limit=VTK_LIMIT)
    except ForeignError as error:
        raise InputError(f"{path}: VTK cannot read it: {error}") from error
    finally:
        process.kill()
    return arrays
