"""Meshes in VTK's XML format for unstructured grids (.vtu), in every encoding that VTK writes.

Every array must be exactly as long as the file's counts say.  VTK's own reader ignores what is too
long, and some broken files end its process; meshio's mixes up arrays of appended raw data.
The format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim.port import InputError

if TYPE_CHECKING:
    from lxml.etree import _Element as Element
    from meshio import Mesh

Values = NDArray[Any]
NUMBERS = {
    **{f"Int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)},
    **{f"UInt{8 * size}": f"u{size}" for size in (1, 2, 4, 8)},
    **{f"Float{8 * size}": f"f{size}" for size in (4, 8)},
}
"""NumPy's names of VTK's types of numbers."""
CELLS = {
    1: ("vertex", 1),
    3: ("line", 2),
    5: ("triangle", 3),
    8: ("quad", 4),
    9: ("quad", 4),
    10: ("tetra", 4),
    11: ("hexahedron", 8),
    12: ("hexahedron", 8),
    13: ("wedge", 6),
    14: ("pyramid", 5),
    21: ("line3", 3),
    22: ("triangle6", 6),
    23: ("quad8", 8),
    24: ("tetra10", 10),
    25: ("hexahedron20", 20),
    28: ("quad9", 9),
    29: ("hexahedron27", 27),
    32: ("wedge18", 18),
}
"""meshio's name and the number of nodes of VTK's types of cells."""
POLYGON, PIXEL = 7, 8
SECTIONS = ("PointData", "CellData", "Points", "Cells")
FAULTS = (OSError, ArithmeticError, MemoryError, zlib.error, lzma.LZMAError)
"""How decoding ends on broken numbers, beside ValueError."""


def read_vtu(path: Path) -> Mesh:
    """The mesh of a .vtu file, its pieces joined; cells of one type that follow each other are one
    block.  Pixels, and polygons of three or four corners, are quads and triangles.

    Raises InputError that names the array at fault where the file cannot be read."""
    import meshio

    try:
        root, encoding = _opened(path.read_bytes())
        pieces = [_Piece.read(piece, encoding) for piece in root.iterfind("*/Piece")]
        pieces = [piece for piece in pieces if len(piece.points)] or pieces[:1]
        if not pieces:
            raise ValueError("it holds no <Piece>")
        before = np.cumsum([0] + [len(piece.points) for piece in pieces])
        nodes = [piece.nodes + count for piece, count in zip(pieces, before, strict=False)]
        blocks, starts = _blocks(
            np.concatenate([piece.types for piece in pieces]),
            np.concatenate([piece.sizes for piece in pieces]),
            np.concatenate(nodes),
        )
        cell_data = _joined([piece.cell_data for piece in pieces])
        return meshio.Mesh(
            np.concatenate([piece.points for piece in pieces]),
            blocks,
            _joined([piece.point_data for piece in pieces]),
            {name: np.split(values, starts[1:]) for name, values in cell_data.items()},
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path}: is no .vtu file that can be read: {error}") from error


def _opened(content: bytes) -> tuple[Element, _Encoding]:
    """The tree of a file and the encoding of its arrays."""
    from lxml import etree

    appended = b""
    tag = re.search(rb"<AppendedData\b[^>]*>\s*_", content)
    if tag:
        end = content.rfind(b"</AppendedData>")
        if end < tag.end():
            raise ValueError("it is cut off: its appended data have no end")
        appended = content[tag.end() : end]
        content = content[: tag.end()] + content[end:]
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, remove_comments=True, huge_tree=True
    )
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise ValueError(f"its XML is broken: {' '.join(str(error.msg).split())}") from error
    kind = root.get("type")
    if root.tag != "VTKFile" or kind != "UnstructuredGrid":
        raise ValueError(f"expected a <VTKFile> of the type UnstructuredGrid, got {kind}")
    return root, _Encoding.read(root, appended)


@dataclass(frozen=True)
class _Encoding:
    """How the numbers of a file are stored."""

    order: str
    """`<` or `>`, of the bytes."""
    header: np.dtype[Any]
    """Type of the sizes before each block of numbers."""
    compressor: str
    appended: memoryview
    appended_is_base64: bool
    offsets: list[int]
    """Where the appended blocks begin, and the end of the last one."""

    @classmethod
    def read(cls, root: Element, appended: bytes) -> _Encoding:
        order = {"LittleEndian": "<", "BigEndian": ">"}.get(root.get("byte_order", "LittleEndian"))
        header = NUMBERS.get(root.get("header_type", "UInt32"))
        compressor = root.get("compressor", "")
        if order is None or header not in ("u4", "u8") or compressor not in ("", *UNPACK):
            raise ValueError(
                f"byte_order {root.get('byte_order')}, header_type {root.get('header_type')} or "
                f"compressor {compressor} is none of VTK's"
            )
        tag = root.find("AppendedData")
        offsets = [_whole(array, "offset") for array in root.iterfind(".//DataArray[@offset]")]
        return cls(
            order,
            np.dtype(order + header),
            compressor,
            memoryview(appended),
            tag is not None and tag.get("encoding") != "raw",
            sorted({*offsets, len(appended)}),
        )

    def values(self, array: Element, count: int) -> Values:
        """The numbers of an array, a row for each of `count` points or cells."""
        width = _whole(array, "NumberOfComponents", "1")
        kind = NUMBERS.get(array.get("type", ""))
        name = array.get("Name", "")
        try:
            if kind is None:
                raise ValueError(f"its type is {array.get('type')}, expected {', '.join(NUMBERS)}")
            dtype = np.dtype(self.order + kind)
            if array.get("format", "ascii") == "ascii":
                out = np.array(_text(array).split()).astype(dtype)
                _check_length(out.nbytes, count * width, dtype.itemsize)
            else:
                out = np.frombuffer(self._bytes(array, count * width, dtype.itemsize), dtype)
        except (*FAULTS, ValueError) as error:
            raise ValueError(f"the array {name!r}: {error}") from error
        out = out.astype(dtype.newbyteorder("="))
        return out if width == 1 else out.reshape(count, width)

    def _bytes(self, array: Element, count: int, each: int) -> bytes:
        """The bytes of `count` numbers of `each` bytes."""
        data = self._stored(array)
        if not self.compressor:
            (size,) = self._sizes(data, 1)
            _check_length(size, count, each)
            data = data[self.header.itemsize :][:size]
            if len(data) < size:
                raise ValueError("it is cut off")
            return bytes(data)
        (blocks,) = self._sizes(data, 1)
        _, whole, last, *packed = self._sizes(data, 3 + blocks)
        sizes = [whole] * (blocks - 1) + [last or whole] * (blocks > 0)
        _check_length(sum(sizes), count, each)
        data = data[self.header.itemsize * (3 + blocks) :]
        out = []
        for length, size in zip(packed, sizes, strict=True):
            out.append(UNPACK[self.compressor](bytes(data[:length]), size) if size else b"")
            if len(out[-1]) != size:
                raise ValueError("it is cut off")
            data = data[length:]
        return b"".join(out)

    def _sizes(self, data: memoryview, count: int) -> list[int]:
        if len(data) < count * self.header.itemsize:
            raise ValueError("it is cut off")
        return [int(size) for size in np.frombuffer(data, self.header, count)]

    def _stored(self, array: Element) -> memoryview:
        """The block of an array with the sizes before it."""
        if array.get("format") == "binary":
            return _from_base64(_text(array).encode())
        if array.get("format") != "appended":
            raise ValueError(
                f"its format is {array.get('format')!r}, expected ascii, binary or appended"
            )
        start = _whole(array, "offset")
        if start >= len(self.appended):
            raise ValueError(f"its offset {start} lies behind the appended data")
        if not self.appended_is_base64:
            return self.appended[start:]
        end = self.offsets[bisect_right(self.offsets, start)]
        return _from_base64(bytes(self.appended[start:end]))


def _check_length(size: int, count: int, each: int) -> None:
    if size != count * each:
        raise ValueError(f"it holds {size / each:.12g} numbers, expected {count}")


def _whole(tag: Element, attribute: str, default: str = "") -> int:
    text = tag.get(attribute, default).strip()
    if not (text.isascii() and text.isdecimal()):
        raise ValueError(f"{attribute} of <{tag.tag}> is {text!r}, expected a whole number")
    return int(text)


def _text(array: Element) -> str:
    """The text of an array without that of the keys within it."""
    return "".join([array.text or "", *(key.tail or "" for key in array)])


def _from_base64(text: bytes) -> memoryview:
    """The bytes of one or several texts in base64, one behind the other."""
    parts = re.findall(rb"[^=]+=*", b"".join(text.split()))
    return memoryview(b"".join(base64.b64decode(part, validate=True) for part in parts))


def _unpack_lz4(data: bytes, size: int) -> bytes:
    import pyarrow

    return bytes(pyarrow.decompress(data, size, codec="lz4_raw", asbytes=True))


UNPACK: Mapping[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": lambda data, size: zlib.decompressobj().decompress(data, size),
    "vtkLZMADataCompressor": lambda data, size: lzma.LZMADecompressor().decompress(data, size),
    "vtkLZ4DataCompressor": _unpack_lz4,
}
"""A block's bytes from what it is packed to and its size."""


@dataclass(frozen=True)
class _Piece:
    """A part of a grid: the cells' types (ne,), numbers of nodes (ne,), and nodes one cell behind
    the other."""

    points: Values
    types: Values
    sizes: Values
    nodes: Values
    point_data: dict[str, Values]
    cell_data: dict[str, Values]

    @classmethod
    def read(cls, piece: Element, encoding: _Encoding) -> _Piece:
        count, cells = _whole(piece, "NumberOfPoints"), _whole(piece, "NumberOfCells")
        if odd := [str(section.tag) for section in piece if section.tag not in SECTIONS]:
            raise ValueError(f"a <Piece> holds <{odd[0]}>, expected {', '.join(SECTIONS)}")
        points = [encoding.values(a, count) for a in piece.iterfind("Points/DataArray")]
        stored = _arrays(piece, "Cells")
        if len(points) != 1 or not {"connectivity", "offsets", "types"} <= set(stored):
            raise ValueError(
                "a <Piece> lacks its points or the arrays connectivity, offsets and types of cells"
            )
        ends = encoding.values(stored["offsets"], cells).astype(np.int64)
        sizes = np.diff(ends, prepend=0)
        if (sizes < 0).any():
            raise ValueError("the array 'offsets': its numbers must not fall")
        nodes = encoding.values(stored["connectivity"], int(ends[-1]) if cells else 0)
        if not ((nodes >= 0) & (nodes < count)).all():
            raise ValueError(f"the array 'connectivity': a node is not in 0 to {count - 1}")
        return cls(
            points[0],
            encoding.values(stored["types"], cells),
            sizes,
            nodes.astype(np.int64),
            {k: encoding.values(a, count) for k, a in _arrays(piece, "PointData").items()},
            {k: encoding.values(a, cells) for k, a in _arrays(piece, "CellData").items()},
        )


def _arrays(piece: Element, section: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for array in piece.iterfind(f"{section}/DataArray"):
        name = array.get("Name", "")
        if name in found:
            raise ValueError(f"two arrays of {section} are called {name!r}")
        found[name] = array
    return found


def _joined(pieces: Sequence[dict[str, Values]]) -> dict[str, Values]:
    if odd := {name for piece in pieces for name in set(piece) ^ set(pieces[0])}:
        raise ValueError(f"not every <Piece> has the arrays {', '.join(sorted(odd))}")
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def _blocks(types: Values, sizes: Values, nodes: Values) -> tuple[list[tuple[str, Values]], Values]:
    """Runs of cells of one name, and the first cell of each."""
    first = np.cumsum(sizes) - sizes
    at = first[types == PIXEL]
    kinds, which = np.unique(np.column_stack([types, sizes]), axis=0, return_inverse=True)
    names = [_name(*kind) for kind in kinds.tolist()]
    nodes[at + 2], nodes[at + 3] = nodes[at + 3], nodes[at + 2]
    label = np.array([names.index(name) for name in names])[which.ravel()]
    starts = np.flatnonzero(np.diff(label, prepend=-1))
    return [
        (names[label[a]][0], nodes[first[a] : first[a] + (b - a) * sizes[a]].reshape(b - a, -1))
        for a, b in zip(starts, [*starts[1:], len(types)], strict=True)
    ], starts


def _name(number: int, size: int) -> tuple[str, int]:
    """meshio's name of a type of cells with `size` nodes, and that number."""
    if number == POLYGON:
        return {3: "triangle", 4: "quad"}.get(size, "polygon"), size
    if number not in CELLS:
        raise ValueError(f"it holds cells of VTK's type {number}; a shell is made of quads")
    name, expected = CELLS[number]
    if size != expected:
        raise ValueError(f"a cell of type {name} has {size} nodes, expected {expected}")
    return name, size
