"""Cuts through a hood as laid: what is left of a mesh or a net of cables.

Places, in station (mm along the straight index finger, as `meshes.hood` counts them): the central
and the terminal slip come off their bone, as a closed boutonniere or mallet injury leaves them;
sagittal bands, retinacular ligaments, dorsal capsule and adhesions let go of it, and a sagittal
band's sheet goes with it, from the tendon to where it was held; a lateral band is severed over the
middle phalanx, where it is free of the rest of the sheet, midway between the end of the central
slip and the bands' meeting; the central band, the distal part of the extensor tendon and a lateral
slip at their middles, the sheet beside them left whole.  The thin sheets between tendons
(transverse and oblique fibres, triangular ligament) are taken out whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Ints, Mask
from meshes.cable_net import CableNet
from meshes.hood_lines import HOOD_END, JOIN, MERGE, SAGITTAL_ROWS, SLIP_END, SLIP_START
from meshes.hood_mesh import REGIONS, Attachment, HoodMesh, pairs

SLIPS = ("central_slip", "terminal_slip")
PLACES = {
    "lateral_band_radial": (SLIP_END + MERGE) / 2,
    "lateral_band_ulnar": (SLIP_END + MERGE) / 2,
    "central_band": (JOIN + SLIP_START) / 2,
    "extensor_tendon_distal": JOIN / 2,
    "lateral_slip_radial": (HOOD_END + SLIP_START) / 2,
    "lateral_slip_ulnar": (HOOD_END + SLIP_START) / 2,
}
"""mm, the station at which a region is severed."""
SAME_ROW = 0.2
"""mm, of stations of one row of nodes."""
LEAST_LEFT = 1e-3
"""The part of a quad's width that is left beside a cut at least, or the quad is cut whole."""
STRAND_OF = {"extensor_tendon_distal": "extensor_tendon"}
"""Strands of a net that are not called as the part that is severed in them."""
SPRINGS_OF = {
    f"sagittal_band_{side}": (f"sagittal_{side}", f"sagittal_hold_{side}")
    for side in ("radial", "ulnar")
}
"""Spring sets that are not called as the part that they hold."""


def cut_part(mesh: HoodMesh, part: str) -> HoodMesh:
    """The mesh with a part cut, what then hangs on nothing left out.

    Raises InputError where the mesh has nothing of the part, or the cut leaves a tendon to pull on
    a piece that nothing holds."""
    if part in PLACES:
        return _whole(mesh, ~_row_of_part(mesh, part), part)
    if part in REGIONS and part not in (*SLIPS, *SPRINGS_OF):
        return _whole(mesh, ~_whole_part(mesh, part), part)
    ties = mesh.tied
    if part in SLIPS:
        own = np.unique(mesh.quads[mesh.cells(part)])
        ties = {body: np.setdiff1d(nodes, own) for body, nodes in mesh.tied.items()}
    springs = _without(mesh.springs, SPRINGS_OF.get(part, (part,)))
    if len(springs) == len(mesh.springs) and _count(ties) == _count(mesh.tied):
        raise InputError(f"lesion.cut: nothing in the hood's mesh holds a {part} that could let go")
    released = replace(mesh, springs=springs, tied=ties)
    if part in SPRINGS_OF:
        return _whole(released, ~_band_sheet(mesh, part), part)
    return released


def cut_part_of(mesh: HoodMesh, part: str, share: float) -> HoodMesh:
    """The mesh with a share (0 to 1) of the part's width cut through at its place, from the radial
    side; the quad in which the cut ends keeps what is left of its width.

    Raises InputError where the mesh has nothing of the part there."""
    row = np.flatnonzero(_row_of_part(mesh, part))
    row = row[np.argsort(-mesh.points[mesh.quads[row], 1].mean(axis=1))]
    width = np.array([mesh.areas()[i] / mesh.length(np.arange(len(mesh.quads)) == i) for i in row])
    kept = np.clip((np.cumsum(width) - share * width.sum()) / width, 0.0, 1.0)
    left = np.ones(len(mesh.quads)) if mesh.left is None else mesh.left.copy()
    left[row] *= np.where(kept < LEAST_LEFT, 0.0, kept)
    return _whole(replace(mesh, left=left), left > 0.0, part)


def nearly_cut(mesh: HoodMesh, part: str) -> HoodMesh:
    """The mesh with all but LEAST_LEFT of a part's width cut through at its place, all nodes kept.
    Raises InputError where the mesh has nothing of the part there."""
    left = np.ones(len(mesh.quads)) if mesh.left is None else mesh.left.copy()
    left[_row_of_part(mesh, part)] *= LEAST_LEFT
    return replace(mesh, left=left)


def cut_ends(mesh: HoodMesh, part: str) -> Ints:
    """Return the pairs (k, 2) of nodes on either side of where a part of the mesh, or of what it
    was before its cuts, is severed: proximal, distal.

    Raises InputError where either side is left out."""
    whole = mesh.whole or mesh
    corners = whole.quads[_row_of_part(whole, part), :4]
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    edges = np.take_along_axis(edges, np.argsort(whole.station[edges], axis=1), axis=1)
    first, last = whole.station[edges].T
    crossed = np.unique(edges[(first <= PLACES[part]) & (last > PLACES[part])], axis=0)
    pairs_now = kept_nodes(mesh)[crossed]
    pairs_now = pairs_now[(pairs_now >= 0).all(axis=1)]
    if not len(pairs_now):
        raise InputError(f"lesion.suture: of {part} only one end is left; cut less")
    return np.asarray(pairs_now)


def kept_nodes(mesh: HoodMesh) -> Ints:
    """Return the number (n,) in a mesh of each node of what it was before its cuts, -1 of those
    that went with them."""
    whole = mesh.whole or mesh
    place = {tuple(point): i for i, point in enumerate(mesh.points.tolist())}
    return np.array([place.get(tuple(point), -1) for point in whole.points.tolist()])


def part_nodes(mesh: HoodMesh, part: str) -> Ints:
    """Return the nodes (k,) in the row at which a part is severed, or in its middle.  Raises
    InputError where a cut has taken them."""
    if part in PLACES and mesh.whole is not None:
        with suppress(InputError):
            return np.unique(mesh.quads[_row_of_part(mesh, part)])
    own = np.unique(mesh.part_cells(part))
    if not len(own):
        raise InputError(f"lesion.graft: no {part} is left in the hood to hold it")
    station = mesh.station[own]
    middle = station[np.abs(station - station.mean()).argmin()]
    return np.asarray(own[np.abs(station - middle) < SAME_ROW])


def _whole_part(mesh: HoodMesh, part: str) -> Mask:
    """Which quads (ne,) belong to the part: all of it."""
    out = mesh.cells(part)
    if not out.any():
        raise InputError(f"lesion.cut: the mesh has no {part} to take out")
    return np.asarray(out)


def _band_sheet(mesh: HoodMesh, part: str) -> Mask:
    """Which quads (ne,) belong to the band: the part's over the MCP, up to the last row that is
    held: a mesh may call all of the sheet from there to the PIP a sagittal band."""
    middle = mesh.station[mesh.quads].mean(axis=1)
    return np.asarray(mesh.cells(part) & (middle < SAGITTAL_ROWS[1]))


def _without(springs: Mapping[str, Attachment], names: Sequence[str]) -> dict[str, Attachment]:
    return {key: held for key, held in springs.items() if key not in names}


def _count(tied: Mapping[str, Ints]) -> int:
    return sum(len(nodes) for nodes in tied.values())


def _row_of_part(mesh: HoodMesh, part: str) -> Mask:
    """Which quads (ne,) of the part its place runs through: of a structured mesh one row."""
    station = mesh.station[mesh.quads]
    place = PLACES[part]
    out = mesh.cells(part) & (station.min(axis=1) <= place) & (station.max(axis=1) > place)
    if not out.any():
        raise InputError(f"lesion.cut: the mesh has no {part} at station {place:g} mm to sever")
    return np.asarray(out)


def _whole(mesh: HoodMesh, left: Mask, part: str) -> HoodMesh:
    """The mesh of the quads `left`, pieces that bear nothing left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined, n = pairs(mesh.quads[left]), len(mesh.points)
    graph = coo_array((np.ones(len(joined)), tuple(joined.T)), shape=(n, n))
    piece = connected_components(graph, directed=False)[1]
    tied = _pieces(piece, mesh.tied.values())
    held = tied | _pieces(piece, [s.nodes for s in mesh.springs.values()])
    pulled = _pieces(piece, mesh.ends.values())
    if loose := pulled - held:
        node = int(np.argmax(np.isin(piece, list(loose))))
        raise InputError(
            f"lesion.cut: {part}: leaves a piece (node {node}) that tendons pull and nothing "
            "holds; cut less"
        )
    kept = left & np.isin(piece[mesh.quads[:, 0]], list(tied | pulled))
    return _of_quads(mesh, kept)


def _pieces(piece: Ints, sets: Iterable[Ints]) -> set[int]:
    return {int(i) for nodes in sets for i in np.unique(piece[nodes])}


def _of_quads(mesh: HoodMesh, kept: Mask) -> HoodMesh:
    """The mesh of some quads, its nodes numbered anew."""
    nodes = np.unique(mesh.quads[kept])
    new = np.full(len(mesh.points), -1)
    new[nodes] = np.arange(len(nodes))

    def renumber(old: Ints) -> Ints:
        return new[old][new[old] >= 0]

    springs = {}
    for name, held in mesh.springs.items():
        on = new[held.nodes] >= 0
        springs[name] = held.of(on, new)
    return replace(
        mesh,
        points=mesh.points[nodes],
        quads=new[mesh.quads[kept]],
        region=mesh.region[kept],
        fibre=mesh.fibre[kept],
        fields={name: values[kept] for name, values in mesh.fields.items()},
        left=None if mesh.left is None else mesh.left[kept],
        ends={end: renumber(old) for end, old in mesh.ends.items()},
        springs=springs,
        tied={body: renumber(old) for body, old in mesh.tied.items()},
        station=mesh.station[nodes],
        lift=None if mesh.lift is None else mesh.lift[nodes],
    )


def cut_net(net: CableNet, part: str) -> CableNet:
    """The net with a part cut: slips and springs let go as of a sheet, a cable loses the cell at
    its place (of no place of its own: its middle one), a triangular ligament all of them.  Cables
    with an end that nothing holds bear nothing and are left out.

    Raises InputError where the net has nothing of the part."""
    springs, tied = net.springs, net.tied
    kept = np.ones(len(net.cells), dtype=bool)
    if part == "terminal_slip":
        tied = {}
    elif part == "triangular_ligament":
        kept = np.array([name != part for name in net.strands])[net.strand]
    elif STRAND_OF.get(part, part) in net.strands and part not in (*SPRINGS_OF, "central_slip"):
        kept[_cell_at(net, part)] = False
    else:
        springs = _without(springs, SPRINGS_OF.get(part, (part,)))
    if kept.all() and len(springs) == len(net.springs) and _count(tied) == _count(net.tied):
        raise InputError(f"lesion.cut: the net of cables has no {part} left to cut")
    return _prune(replace(net, springs=springs, tied=tied), kept)


def _cell_at(net: CableNet, part: str) -> int:
    own = np.flatnonzero(net.strand == net.strands.index(STRAND_OF.get(part, part)))
    if part not in PLACES:
        return int(own[len(own) // 2])
    middle = net.station[net.cells[own]].mean(axis=1)
    return int(own[np.abs(middle - PLACES[part]).argmin()])


def _prune(net: CableNet, kept: Mask) -> CableNet:
    """The net of the cells `kept`, less those that end where nothing holds them."""
    sets = [*net.ends.values(), *net.tied.values(), *(s.nodes for s in net.springs.values())]
    held = np.zeros(len(net.points), dtype=bool)
    held[np.concatenate(sets)] = True
    while True:
        joined = np.bincount(net.cells[kept].ravel(), minlength=len(held))
        bare = kept & ((joined == 1) & ~held)[net.cells].any(axis=1)
        if not bare.any():
            return _of_cells(net, kept)
        kept = kept & ~bare


def _of_cells(net: CableNet, kept: Mask) -> CableNet:
    """The net of some cells, nodes and strands numbered anew."""
    nodes = np.unique(net.cells[kept])
    new = np.full(len(net.points), -1)
    new[nodes] = np.arange(len(nodes))
    for end, old in net.ends.items():
        if (new[old] < 0).any():
            raise InputError(f"lesion.cut: leaves the {end} end of the net without a cable")
    strands, strand = np.unique(net.strand[kept], return_inverse=True)
    springs = {}
    for name, held in net.springs.items():
        on = new[held.nodes] >= 0
        if on.any():
            springs[name] = held.of(on, new)
    return replace(
        net,
        points=net.points[nodes],
        cells=new[net.cells[kept]],
        strand=strand,
        strands=tuple(net.strands[i] for i in strands),
        ends={end: new[old] for end, old in net.ends.items()},
        springs=springs,
        tied={body: new[old][new[old] >= 0] for body, old in net.tied.items()},
        station=net.station[nodes],
    )
