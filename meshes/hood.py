"""The extensor hood: a generator that lays a quadrilateral shell over the bones.

`cosim export CASE --set hood.mesh.quads=600 -o hood.json` writes one; `meshes/hoods` holds
the default.

The sheet is a structured grid of rows (stations s, mm along the straight chain of the index
finger's joint centres, MCP at 0, PIP at 42.6, DIP at 67.7; on another finger each phalanx takes its
own part of them: `meshes.hull.along`) and columns (angle phi about the chain, 0 dorsal, positive
radial).  The inner columns are extensor tendon, central band and central slip, and, from the MCP
on, the wings beside them: sagittal bands over the MCP, then transverse fibres, then the lateral
slips that run from the central tendon to the lateral bands, then the oblique fibres beside the
central slip.  The outer columns are the intrinsic tendons, which run palmar of the MCP axis, from
the join on the lateral bands, which meet over the middle phalanx to end in the terminal slip.
Between them lies the triangular ligament, which ends short of where they meet.  Beside the central
slip's insertion the sheet is open, so that the bands can glide past it as the PIP flexes.

Sources of the proportions.  [mi29]: measured on the published finger hood `Verify/mi29.feb` of
FEBio's test suite: central tendon end 20 mm proximal of the MCP, hood 18 mm wide at the MCP, 12 to
13 mm over the proximal phalanx and at the PIP, 7 mm at the terminal slip, whose edge is 6 mm wide;
central-slip patch 4.6 mm wide; lateral slips leave the tendon at 13 to 16 mm and are one with the
bands from 31 mm on; triangular ligament 6 mm wide, narrowing to 2.  [El-Gammal]: El-Gammal et al.
1993, J Hand Surg 18:717, twenty index fingers: the oblique retinacular ligament runs from the
middle third of the proximal phalanx and fans into the lateral band 4 to 6 mm distal to the PIP.
[An]: An et al. 1979, J Biomech 12:775, normative points of the index finger, in units of 20 mm.
[trial]: an assumption that held in a trial of this sheet on these bones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Ints
from meshes.hood_lines import (
    CAPSULE_ROWS,
    CENTRAL_END,
    HOOD_END,
    INTRINSIC_END,
    JOIN,
    LATERAL_END,
    LIGAMENT_ROWS,
    MERGE,
    OBLIQUE_END,
    OBLIQUE_ROWS,
    RETINACULAR_ROWS,
    SAGITTAL_ROWS,
    SLIP_END,
    SLIP_START,
    TENDON,
    TRIANGLE_END,
    TRIANGLE_START,
    columns,
    even_shares,
    rows,
)
from meshes.hood_mesh import REGIONS, Attachment, HoodMesh, has_lateral_fibres
from meshes.hull import CLEARANCE, PIP, Centreline, Hull, Level, SmoothSurface, along
from meshes.skeleton import BODIES, Skeleton

INSERTED = {True: 0.75, False: TENDON}
"""Share of the inner columns' half-angle that the central slip's insertion holds, by whether the
wings reach it."""
# Half-angle of the inner columns and outer angle of the lateral bands, deg, against station.
# [trial], widened to what [mi29] measures at the PIP (here 11 mm of 13) and the terminal slip.
INNER = np.array(
    [[-20, 44], [-8, 48], [-3, 60], [4, 76], [15, 78], [24, 54], [42.59, 40], [49, 40], [56, 22],
     [63, 0], [73, 0]]
)  # fmt: skip
OUTER = np.array(
    [[-8, 110], [15, 110], [24, 88], [42.59, 74], [49, 70], [56, 56], [63, 46], [73, 57]]
)
# Where the index finger's lumbrical and palmar interosseous run to the sheet from: distal of the
# MCP, dorsal, radial, mm.  [An] LU and UI at the MCP.
INTRINSIC = {
    "radial": (-8.0, -8.08, 8.82),
    "ulnar": (-8.0, -5.58, -8.84),
}
BAND_WIDTH = 3.0  # mm, of the intrinsic tendons; [mi29] lateral tendon ends

PALMAR_PLATE = (-3.0, 7.0)  # dorsal, radial mm, on the base of the proximal phalanx [trial]
RETINACULAR_ANCHOR = (-3.0, 5.0)  # dorsal, radial mm, on the head of the proximal phalanx [trial]
OBLIQUE_ORIGIN = 28.0  # mm, station [El-Gammal]
OBLIQUE_ANCHOR = (-2.0, 6.0)  # dorsal, radial mm, beside the proximal phalanx (assumption)
SHAFT_ROWS = (JOIN, 30.0)  # of the interosseous hood, short of where the bands sink (assumption)
STRINGS = {
    "sagittal_hold": 300e-3 * np.array([0.0, 1.0, -1.0]) / np.sqrt(2),
    "interosseous_hood": 300e-3 * np.array([0.0, 0.0, 1.0]),
}
"""What guides the sheet and lets it glide: strings so long against what they let through that they
hold along themselves alone; m from the sheet to their far ends, distal, sideways (away from the
finger) and dorsal (assumption)."""
CAPSULE_REACH = 5.0  # mm from the dorsal capsule's rows to its origin, proximally (assumption)
LOOSE_REACH = (
    8.0  # mm from the tendon over the MCP to where its loose tissue ends, distally (assumption)
)
SLIP_REACH = 2.5  # mm from the central slip's last row to its insertion, distally (assumption)


def _interpolate(table: Array, station: Array) -> Array:
    """Monotone cubic through (station mm, degrees) rows; rad."""
    from scipy.interpolate import PchipInterpolator

    return np.deg2rad(PchipInterpolator(*table.T)(np.clip(station, table[0, 0], table[-1, 0])))


@dataclass(frozen=True)
class _Lines:
    """Rows and columns on which nodes are laid."""

    stations: Array
    """mm, of the rows from proximal."""
    across: Array
    """-1 to 1, of the inner columns."""
    over_band: Array
    """0 to 1, of the columns of a lateral band, from its inner edge."""
    over_triangle: Array
    """-1 to 1, of the columns of the triangular ligament."""
    quadratic: bool

    @property
    def stride(self) -> int:
        """Lines to an element."""
        return 2 if self.quadratic else 1

    def bearing(self, line: Ints, place: Array, ends: tuple[float, float]) -> tuple[Ints, Array]:
        """Where a line of nodes (-1 for none) at ascending places bears something of what holds it
        evenly between `ends`; and how much there."""
        on = np.flatnonzero(line >= 0)
        shares = even_shares(place[on], ends, self.quadratic)
        borne = shares > 1e-9
        return on[borne], np.round(shares[borne], 7)

    def over_width(self, band: Ints, ends: tuple[float, float]) -> tuple[Ints, Array]:
        """Nodes of a lateral band that bear what holds it between two stations evenly over its
        width; and their shares."""
        rows, along_it = self.bearing(band[:, 0], self.stations, ends)
        shares = along_it[:, None] * even_shares(self.over_band, (0.0, 1.0), self.quadratic)
        return band[rows].ravel(), np.round(shares.ravel(), 7)


@dataclass(frozen=True)
class _Grid:
    """Node numbers of rows by columns, -1 where there is no node."""

    lines: _Lines
    inner: Ints
    band: Mapping[str, Ints]
    """Per side, columns from the inner edge to the outer edge; the rows proximal of the join are
    the intrinsic tendon's."""
    triangle: Ints
    """Columns of the triangular ligament from the ulnar to the radial band."""


def _is_tendon(across: Array) -> NDArray[np.bool_]:
    return np.abs(across) < TENDON + 1e-6


def generate(
    skeleton: Skeleton,
    surfaces: Mapping[str, SmoothSurface],
    offset: Mapping[str, float],
    thickness: float,
    rest_posture: Mapping[str, float],
    quads: int,
    width: float = 1.0,
    intrinsic: Mapping[str, Sequence[float]] | None = None,
    quadratic: bool = False,
    one_sheet: bool = False,
) -> HoodMesh:
    """Generate a hood of about `quads` elements laid over bones at `rest_posture` (rad).

    `offset` (m) by body is the distance of the sheet's face from the bare bone, `thickness` (m) the
    sheet's; `surfaces` are those of the scaled bones; `width` scales the hand-measured points
    across the finger, and the skeleton's lengths those along it.  `intrinsic`: where the tendons at
    the radial and the ulnar side run to the sheet from, m distal of the MCP, dorsal and radial;
    otherwise the index finger's, scaled.  `quadratic`: quadratic elements, of nine nodes.
    `one_sheet`: the wings reach the central slip's insertion, and nothing lies between the lateral
    bands distal of it.

    >>> import numpy as np
    >>> from fe_solver.surfaces.shapes import Capsule
    >>> from meshes.hood import generate
    >>> from meshes.skeleton import BODIES, JOINTS, index_finger
    >>> skeleton = index_finger()
    >>> ends = zip(BODIES, (-0.04, 0.0, 0.0, 0.0), (0.0, *skeleton.length[1:]), strict=True)
    >>> bones = {
    ...     body: Capsule(np.array([start, 0, 0]), np.array([end, 0, 0]), 0.006)
    ...     for body, start, end in ends
    ... }
    >>> offset = dict.fromkeys(BODIES, 0.3e-3)
    >>> mesh = generate(skeleton, bones, offset, 0.4e-3, dict.fromkeys(JOINTS, 0.0), 150)
    >>> mesh.quads.shape[1], sorted(mesh.ends)
    (4, ['central', 'radial', 'ulnar'])
    """
    # the bones at rest, and the level of the sheet's middle over them
    chain = Centreline(skeleton, *skeleton.pose(rest_posture))
    middle = {body: height + thickness / 2 for body, height in offset.items()}
    level = Level(surfaces, middle, chain.position, chain.rotation)
    scale = skeleton.length[1] / (PIP * 1e-3)
    guides = intrinsic or {
        side: (1e-3 * scale * s, 1e-3 * width * dorsal, 1e-3 * width * radial)
        for side, (s, dorsal, radial) in INTRINSIC.items()
    }
    # the grid's lines, laid on the hull of the bones
    lines = _Lines(rows(quads, quadratic), *columns(quads, quadratic), quadratic)
    if one_sheet:
        lines = replace(lines, over_triangle=lines.over_triangle[:0])
    wings_end = SLIP_END if one_sheet else lines.stations[lines.stations <= OBLIQUE_END][-1]
    grid, points, station = _lay(Hull(chain, level), lines, guides, wings_end)
    # cells, and nodes raised so that the chords between them clear the bones
    fixed = _end_nodes(grid)
    cells, region, along = _cells(grid)
    free = np.setdiff1d(np.arange(len(points)), fixed["central"])
    lift = np.zeros(len(points))
    if not quadratic:
        lift, outward = _lift(points, cells, level)
        lifted = np.union1d(free, fixed["central"])
        points[lifted] += (lift[:, None] * outward)[lifted]
    clear_guides(points, station, level, lift)
    points[free] = level.push_out(points[free], CLEARANCE * 1e-3 + lift[free])
    fibre = _fibres(points, cells, along)
    return HoodMesh(
        np.round(points, 7),
        cells,
        region,
        np.round(fibre, 5),
        fixed,
        _attachments(grid, chain, level, points, scale, width),
        {"distal": np.unique(np.concatenate([b[-1] for b in grid.band.values()]))},
        np.round(station, 4),
        dict(rest_posture),
        float(skeleton.length[1]),
        thickness,
        np.round(lift, 7),
    )


def _lay(
    hull: Hull, lines: _Lines, guides: Mapping[str, Sequence[float]], wings_end: float
) -> tuple[_Grid, Array, Array]:
    """Number the nodes and place them: the grid, points (n, 3) m, stations (n,) mm."""
    stations, across, over_band = lines.stations, lines.across, lines.over_band
    nr = len(stations)
    inner = np.full((nr, len(across)), -1)
    s_list: list[float] = []
    phi_list: list[float] = []

    def node(s: float, phi: float) -> int:
        s_list.append(s)
        phi_list.append(phi)
        return len(s_list) - 1

    # the central slip and the inner columns of the wings
    half, out = _interpolate(INNER, stations), _interpolate(OUTER, stations)
    eps = 1e-6
    for i, s in enumerate(stations):
        if s <= SLIP_END + eps:
            here = _is_tendon(across) | (LATERAL_END - eps <= s <= wings_end + eps)
            inner[i, here] = [node(s, f * half[i]) for f in across[here]]
    # the lateral bands, which share nodes with the wings and merge distally
    ends = stations[:: lines.stride]
    begins = ends[ends >= INTRINSIC_END - eps][0]
    band: dict[str, Ints] = {}
    for side, sign in (("radial", 1), ("ulnar", -1)):
        nodes = np.full((nr, len(over_band)), -1)
        for i, s in enumerate(stations):
            if s < begins - eps:
                continue
            fractions = half[i] + over_band * (out[i] - half[i])
            for k, phi in enumerate(fractions):
                shared = k == 0 and JOIN - eps <= s <= wings_end + eps
                merged = k == 0 and s >= MERGE - eps and side == "ulnar"
                if shared:
                    nodes[i, k] = inner[i, -1 if sign > 0 else 0]
                elif merged:
                    nodes[i, k] = band["radial"][i, 0]
                else:
                    nodes[i, k] = node(s, sign * phi)
        band[side] = nodes
    # the triangular ligament between the merging bands
    over_triangle = lines.over_triangle
    triangle = np.full((nr, len(over_triangle)), -1)
    last = ends[ends <= TRIANGLE_END + eps][-1]
    of_triangle = (stations >= TRIANGLE_START - eps) & (stations <= last + eps)
    for row in np.flatnonzero(of_triangle & (last > TRIANGLE_START + eps)):
        between = [node(stations[row], f * half[row]) for f in over_triangle[1:-1]]
        if len(over_triangle):
            triangle[row] = [band["ulnar"][row, 0], *between, band["radial"][row, 0]]
    # places: on the hull, then the intrinsic tendons towards their guides
    station = np.array(s_list)
    points = hull.points(station, np.array(phi_list))
    grid = _Grid(lines, inner, band, triangle)
    for side in band:
        _lay_intrinsic(grid, hull, points, side, guides[side])
    return grid, points, station


def _lay_intrinsic(
    grid: _Grid, hull: Hull, points: Array, side: str, guide: Sequence[float]
) -> None:
    """Place the intrinsic tendon's nodes on straight lines from the guide to the lateral band."""
    s0, d0, r0 = guide
    laid, stations = grid.band[side][:, 0] >= 0, grid.lines.stations
    rows = np.flatnonzero(laid & (stations <= JOIN + 1e-6))
    join = points[grid.band[side][rows[-1]]]
    sign = np.sign(r0)
    across = np.array([sign * np.cos(np.arctan2(abs(r0), d0)), -np.sin(np.arctan2(abs(r0), d0))])
    t = (grid.lines.over_band - 0.5) * BAND_WIDTH * 1e-3
    start = hull.chain.at(np.full(len(t), s0), d0 + t * across[1], r0 + t * across[0])
    for i in rows[:-1]:
        f = (stations[i] - LATERAL_END) / (JOIN - LATERAL_END)
        points[grid.band[side][i]] = (1 - f) * start + f * join


def _end_nodes(grid: _Grid) -> dict[str, Ints]:
    first = int(np.flatnonzero(grid.band["radial"][:, 0] >= 0)[0])
    return {
        "central": grid.inner[0, grid.inner[0] >= 0],
        "radial": grid.band["radial"][first],
        "ulnar": grid.band["ulnar"][first],
    }


def _inner_region(s: float, f: float) -> str:
    """Region of an inner quad at station s (mm) and position f in -1..1 across."""
    if s < LATERAL_END:
        return "extensor_tendon_proximal"
    if abs(f) > TENDON:
        return f"{_wing(s)}_{'radial' if f > 0 else 'ulnar'}"
    if s < 0:
        return "extensor_tendon_proximal"
    if s < JOIN:
        return "extensor_tendon_distal"
    return "central_band" if s < SLIP_START else "central_slip"


def _wing(s: float) -> str:
    """Region, without its side, of the sheet beside the tendon at station s (mm)."""
    parts = {"sagittal_band": SAGITTAL_ROWS[1], "transverse_fibres": HOOD_END}
    parts |= {"lateral_slip": SLIP_START, "oblique_fibres": SLIP_END}
    return next(name for name, end in parts.items() if s < end)


def _band(s: float, side: str) -> str:
    """Region of a quad of a side's outer columns at station s (mm)."""
    if s > MERGE:
        return "terminal_slip"
    return f"{'intrinsic_tendon' if s < JOIN else 'lateral_band'}_{side}"


def _cells(grid: _Grid) -> tuple[Ints, Ints, NDArray[np.bool_]]:
    """Quads (ne, 4) or (ne, 9), their regions (ne,), and whether fibres run along the rows'
    direction."""
    cells, names = [], []
    stations, across, n = grid.lines.stations, grid.lines.across, grid.lines.stride

    def quad(lines: Ints, k: int, back: bool) -> list[int]:
        first, *between, last = lines[:, k : k + n + 1][:, :: -1 if back else 1]
        corners = [first[0], last[0], last[n], first[n]]
        return [*corners, first[1], last[1], *between[0][[0, 2, 1]]] if n == 2 else corners

    # row by row from proximal: the middle, the bands at either side, the triangular ligament
    for i in range(0, len(stations) - n, n):
        s = (stations[i] + stations[i + n]) / 2
        if s < SLIP_END:
            lines = grid.inner[i : i + n + 1]
            for k in range(0, len(across) - n, n):
                if (lines[[0, 0, n, n], [k, k + n, k, k + n]] >= 0).all():
                    cells.append(quad(lines, k, False))
                    names.append(_inner_region(s, (across[k] + across[k + n]) / 2))
        for side, nodes in grid.band.items():
            if nodes[i, 0] >= 0:
                for k in range(0, nodes.shape[1] - n, n):
                    cells.append(quad(nodes[i : i + n + 1], k, side == "ulnar"))
                    names.append(_band(s, side))
        lines = grid.triangle[i : i + n + 1]
        for k in range(0, lines.shape[1] - n, n):
            if (lines[[0, n], k] >= 0).all():
                cells.append(quad(lines, k, False))
                names.append("triangular_ligament")
    region = np.array([REGIONS.index(n) for n in names])
    along = np.array([not has_lateral_fibres(n) for n in names])
    return np.array(cells), region, along


def _fibres(points: Array, cells: Ints, along: NDArray[np.bool_]) -> Array:
    """Unit fibre directions, along the finger or round it."""
    p = points[cells]
    if cells.shape[1] == 9:
        distal, across = p[:, 5] - p[:, 4], p[:, 7] - p[:, 6]
    else:
        distal = p[:, 1] + p[:, 2] - p[:, 0] - p[:, 3]
        across = p[:, 2] + p[:, 3] - p[:, 0] - p[:, 1]
    fibre = np.where(along[:, None], distal, across)
    return fibre / np.linalg.norm(fibre, axis=1, keepdims=True)


def _lift(points: Array, cells: Ints, level: Level) -> tuple[Array, Array]:
    """How far nodes must stand over the level of contact (n,), m, for the sheet to lie on it in the
    mean across the fibres, and which way that is (n, 3).

    Between two lines of nodes the sheet runs on a chord: w wide, over a bone of curvature k, it is
    k w^2 / 12 too low in the mean.  In hollows no node is lowered."""
    ulnar, radial = np.vstack([cells[:, [0, 3]], cells[:, [1, 2]]]).T
    before, after = np.arange(len(points)), np.arange(len(points))
    before[radial], after[ulnar] = ulnar, radial
    p, q = points - points[before], points[after] - points
    w, v = np.linalg.norm(p, axis=1), np.linalg.norm(q, axis=1)
    inside = (w > 0) & (v > 0)
    _, outward = level.value(points)
    turn = p / np.where(w > 0, w, 1)[:, None] - q / np.where(v > 0, v, 1)[:, None]
    curvature = np.where(inside, 2 * np.einsum("nk,nk->n", turn, outward) / (w + v), 0.0)
    edge = np.where(w > 0, before, after)
    curvature = np.maximum(np.where(inside, curvature, curvature[edge]), 0.0)
    return curvature * (w**3 + v**3) / (12 * (w + v)), outward


def clear_guides(points: Array, station: Array, level: Level, lift: Array | float = 0.0) -> None:
    """Raise the proximal end of the extensor tendon until the straight lines on which its nodes
    slide pass over the metacarpal's head, and what leads there by less and less; points (n, 3) m
    laid at stations (n,) mm, in place; they touch the bones by `lift` (n,) or one for all, m, over
    the level.

    A line that runs into the bone would pinch the hood between guide and contact, with a force that
    grows as the mesh gets finer."""
    nodes = np.flatnonzero(station < LATERAL_END - 1e-6)
    share = (LATERAL_END - station[nodes]) / (LATERAL_END - CENTRAL_END)
    dorsal = level.rotation[0][:, 2]
    above = np.broadcast_to(lift, len(points))[nodes]
    points[nodes] += (share * level.rise_over_head(points[nodes], above))[:, None] * dorsal


def _attachments(
    grid: _Grid, chain: Centreline, level: Level, points: Array, scale: float, width: float
) -> dict[str, Attachment]:
    # the central slip, by short strings to the middle phalanx
    lines, s, eps = grid.lines, grid.lines.stations, 1e-6
    last = int(np.flatnonzero(s <= SLIP_END + eps)[-1])
    inserted = INSERTED[bool(grid.inner[last, 0] >= 0)]
    columns, shares = lines.bearing(grid.inner[last], lines.across, (-inserted, inserted))
    middle = grid.inner[last, columns]
    distal = chain.rotation[2][:, 0]
    slip = points[middle] + SLIP_REACH * 1e-3 * scale * distal
    # at the sheet's own height: strings down to the bare bone would press the last row into the
    # contact, the deeper the finer the rows
    on_middle = on_bone("middle", middle, slip, level, level.offset["middle"])
    out = {"central_slip": replace(on_middle, shares=shares)}
    out["dorsal_capsule"] = _capsule(grid, chain, level, points, scale)
    out["loose_tissue"] = _loose_tissue(grid, chain, level, points, scale)
    # at either side: adhesion of the band, then ligaments to the proximal phalanx
    for side, sign, edge in (("radial", 1, -1), ("ulnar", -1, 0)):
        band = grid.band[side]
        nodes, shares = lines.over_width(band, LIGAMENT_ROWS)
        grown = on_bone("proximal", nodes, points[nodes], level)
        out[f"ligament_{side}"] = replace(grown, shares=shares)
        rows, shares = lines.bearing(grid.inner[:, edge], s, SAGITTAL_ROWS)
        over_shaft = lines.over_width(band, SHAFT_ROWS)
        for name, nodes, borne in (
            (f"sagittal_hold_{side}", grid.inner[rows, edge], shares),
            (f"interosseous_hood_{side}", *over_shaft),
        ):
            out[name] = replace(strings(name, nodes, points[nodes], chain), shares=borne)
        for name, line, ends, origin, (dorsal, radial) in (
            ("sagittal", grid.inner[:, edge], SAGITTAL_ROWS, None, PALMAR_PLATE),
            ("retinacular", band[:, -1], RETINACULAR_ROWS, None, RETINACULAR_ANCHOR),
            ("oblique_retinacular", band[:, -1], OBLIQUE_ROWS, OBLIQUE_ORIGIN, OBLIQUE_ANCHOR),
        ):
            rows, shares = lines.bearing(line, s, ends)
            local = np.empty((len(rows), 3))
            local[:, 0] = along(chain.skeleton, s[rows] if origin is None else np.array([origin]))
            local[:, 1:] = 1e-3 * width * np.array([sign * radial, dorsal])
            out[f"{name}_{side}"] = Attachment("proximal", line[rows], np.round(local, 7), shares)
    return out


def _capsule(
    grid: _Grid, chain: Centreline, level: Level, points: Array, scale: float
) -> Attachment:
    """The dorsal capsule of the PIP: what binds the central slip over the joint to the head of the
    proximal phalanx."""
    nodes, shares = _under_tendon(grid, CAPSULE_ROWS)
    origin = points[nodes] - CAPSULE_REACH * 1e-3 * scale * chain.rotation[1][:, 0]
    return replace(on_bone("proximal", nodes, origin, level), shares=shares)


def _loose_tissue(
    grid: _Grid, chain: Centreline, level: Level, points: Array, scale: float
) -> Attachment:
    """The loose tissue from the extensor tendon's underside over the MCP to the capsule and the
    base of the proximal phalanx (Arvind et al.), in one."""
    nodes, shares = _under_tendon(grid, SAGITTAL_ROWS)
    end = points[nodes] + LOOSE_REACH * 1e-3 * scale * chain.rotation[1][:, 0]
    return replace(on_bone("proximal", nodes, end, level), shares=shares)


def _under_tendon(grid: _Grid, ends: tuple[float, float]) -> tuple[Ints, Array]:
    """The nodes (k,) of the tendon's rows between two stations (mm) and their shares (k,)."""
    lines = grid.lines
    columns = np.flatnonzero(_is_tendon(lines.across))
    rows, along_it = lines.bearing(grid.inner[:, columns[0]], lines.stations, ends)
    over_it = even_shares(lines.across[columns], (-TENDON, TENDON), lines.quadratic)
    shares = (along_it[:, None] * over_it).ravel()
    return grid.inner[np.ix_(rows, columns)].ravel(), np.round(shares, 7)


def on_bone(body: str, nodes: Ints, near: Array, level: Level, height: float = 0.0) -> Attachment:
    """Anchors at `height` (m) over the bare bone, at the points `near` (world)."""
    i = BODIES.index(body)
    local = (near - level.position[i]) @ level.rotation[i]
    for _ in range(20):
        value, gradient, _ = level.surfaces[body].distance(local)
        local = local - (value - height)[:, None] * gradient
    return Attachment(body, nodes, np.round(local, 7))


def strings(name: str, nodes: Ints, points: Array, chain: Centreline) -> Attachment:
    """The strings of a set, such as "sagittal_hold_radial", from nodes at `points` (k, 3) m; their
    far ends go with the proximal phalanx."""
    kind, side = name.rsplit("_", 1)
    way = STRINGS[kind] * [1, 1 if side == "radial" else -1, 1]
    here = (points - chain.position[1]) @ chain.rotation[1]
    return Attachment("proximal", nodes, np.round(here + way, 7))
