"""From a user's shell mesh with its sets to a hood mesh of ours, with what was found on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from meshes.hood import STRINGS, on_bone, strings
from meshes.hood_mesh import ENDS, REGIONS, SPRINGS, Attachment, HoodMesh, has_lateral_fibres
from meshes.hull import Centreline, Level, along
from meshes.imported.checks import (
    UNITS,
    Placing,
    axes_fault,
    count_warped,
    other_origin,
    piece_faults,
    quad_faults,
    scale_fault,
    wind_alike,
)
from meshes.imported.names import (
    END,
    SPRING,
    TIED,
    Named,
    absent_sets,
    list_names,
    map_names,
    missing_sets_fault,
)
from meshes.imported.raw import FIBRE, RawMesh
from meshes.skeleton import BODIES, Skeleton

OFF_PLACE = 15e-3
"""m, of the hood's ends from where our own hood's are: more is another origin."""
BODY_OF = {name: "middle" if name == "central_slip" else "proximal" for name in SPRINGS}
"""What each set of springs holds the hood to."""
REACHED = 0.2e-3
"""m, an anchor further than that from its bone was not found."""


@dataclass(frozen=True)
class ImportedSheet:
    """A user's hood in our unit and axes, wound so that the normals point away from the bones."""

    points: Array
    """(n, 3) m of the raw mesh, those that no quad uses included."""
    quads: Ints
    sets: Named
    thickness: float
    """Thickness in m: the mean of what the file states, or what was given."""
    notes: tuple[str, ...]
    fields: Mapping[str, Array]
    """Unit directions (ne, 3) by name."""


def read_sheet(
    raw: RawMesh,
    mapping: Mapping[str, str],
    placing: Placing,
    chain: Centreline,
    thickness: float,
) -> ImportedSheet:
    """The checked sheet over a finger's chain of joints in the posture in which it was laid.

    Raises InputError that lists all its faults."""
    sets = map_names(raw, mapping)
    faults = missing_sets_fault(raw, sets) + quad_faults(raw.points, raw.quads)
    points, used = placing.of(raw.points), np.unique(raw.quads)
    extent = float(np.ptp(raw.points[used] @ placing.axes.T, axis=0).max())
    reach = float(chain.skeleton.length[1:].sum())
    if wrong := scale_fault(extent, placing.unit, reach):
        raise InputError(_faults_text([*faults, wrong]))
    faults += piece_faults(points, raw.quads, reach)
    faults += _loose(raw, sets, used)
    if faults:
        raise InputError(_faults_text(faults))
    stated = raw.quads[:, ::-1] if placing.mirrors else raw.quads
    quads, flipped = wind_alike(stated)
    ends = {name: points[nodes].mean(axis=0) for name, nodes in sets.nodes.items()}
    wrong, shift = axes_fault(ends, chain, placing.axes)
    if wrong or np.linalg.norm(shift) > OFF_PLACE:
        raise InputError(_faults_text([wrong or other_origin(placing, shift)]))
    notes = [*absent_sets(sets), *_dropped_notes(raw, sets, used)]
    if len(flipped) and len(flipped) < len(quads):
        less = min(len(flipped), len(quads) - len(flipped))
        notes.append(f"{less} quads were wound against the others and are turned over")
    if _faces_the_bones(points, quads, chain):
        quads = quads[:, ::-1]
    if (quads != stated).all():
        notes.append("all normals pointed at the bones; the sheet is turned over")
    if count := count_warped(points, quads):
        notes.append(f"{count} quads are warped by more than 30 deg; a finer mesh would do better")
    fields = {name: _directions(values, placing) for name, values in raw.fields.items()}
    upright = [name for name, values in fields.items() if _stands(values, points, quads)]
    notes += [f"dropped: the vectors {name!r}, which do not lie in the sheet" for name in upright]
    fields = {name: values for name, values in fields.items() if name not in upright}
    thick = _thickness(raw, placing, thickness, notes)
    return ImportedSheet(points, quads, sets, thick, tuple(notes), fields)


def _directions(vectors: Array, placing: Placing) -> Array:
    """The unit vectors (ne, 3) in our axes of vectors (ne, 3) in the file's."""
    turned = vectors @ placing.axes.T
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def _stands(directions: Array, points: Array, quads: Ints) -> bool:
    """Whether one of the directions (ne, 3) is nearer to its quad's normal than to its plane."""
    p = points[quads]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    size = np.linalg.norm(normal, axis=1)
    return bool((2 * np.einsum("nk,nk->n", directions, normal) ** 2 > size**2).any())


def _thickness(raw: RawMesh, placing: Placing, wanted: float, notes: list[str]) -> float:
    """m: the file's own where it states one."""
    if raw.thickness is None:
        return wanted
    own = float(raw.thickness.mean()) * UNITS[placing.unit]
    if abs(own - wanted) > 0.01 * wanted:
        notes.append(
            f"the file's sheet is {1e3 * own:.3g} mm thick in the mean and is taken as it is, not "
            f"{1e3 * wanted:.3g} mm; hood.thickness and hood.regions of the case change that"
        )
    return own


def _faults_text(faults: list[str]) -> str:
    count = f"{len(faults)} fault" + ("s" if len(faults) > 1 else "")
    return "\n  ".join([f"the hood's mesh has {count}", *faults])


def _loose(raw: RawMesh, sets: Named, used: Ints) -> list[str]:
    """Ends and ties of nodes that are no part of the sheet."""
    out = []
    for name, nodes in sets.nodes.items():
        lost = np.setdiff1d(nodes, used)
        if len(lost) and not name.startswith(SPRING):
            out.append(f"{name}: {len(lost)} of its {len(nodes)} nodes belong to no quad")
        elif not len(np.intersect1d(nodes, used)):
            out.append(f"{name}: none of its {len(nodes)} nodes belongs to a quad")
    return out


def _dropped_notes(raw: RawMesh, sets: Named, used: Ints) -> list[str]:
    out = [f"dropped: {what}" for what in raw.dropped]
    anchors = np.concatenate(
        [np.zeros(0, dtype=np.intp), *(p.ravel() for p in sets.lines.values())]
    )
    free = np.setdiff1d(np.arange(len(raw.points)), np.concatenate([used, anchors]))
    if len(free):
        out.append(
            f"dropped: {len(free)} nodes that belong to no quad, the first is node {free[0]}"
        )
    if sets.unused:
        out.append(f"dropped: the sets {list_names(sets.unused)}, which have none of our names")
    return out


def _faces_the_bones(points: Array, quads: Ints, chain: Centreline) -> bool:
    p = points[quads]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    middle = p.mean(axis=1)
    away = middle - chain.frames(places(middle, chain))[0]
    return bool(np.einsum("nk,nk->", normal, away) < 0)


def places(points: Array, chain: Centreline) -> Array:
    """The places (n,) m along the chain of joint centres at which its cross-section holds a point
    (n, 3)."""
    total = float(chain.skeleton.length[1:].sum())
    s = np.arange(-0.06, total + 0.03, 0.25e-3)
    centre, axes = chain.frames(s)
    ahead = points @ axes[:, :, 0].T - np.einsum("sk,sk->s", centre, axes[:, :, 0])
    passes = (ahead[:, :-1] >= 0) & (ahead[:, 1:] < 0)
    far = np.linalg.norm(points[:, None] - centre[None, :-1], axis=2)
    k = np.where(passes, far, np.inf).argmin(axis=1)
    row = np.arange(len(points))
    a, b = ahead[row, k], ahead[row, k + 1]
    fraction = np.where(passes.any(axis=1), a / np.where(a == b, 1.0, a - b), 0.0)
    return np.asarray(np.where(passes.any(axis=1), s[k], s[far.argmin(axis=1)])
                      + np.clip(fraction, 0, 1) * (s[1] - s[0]))  # fmt: skip


def stations(skeleton: Skeleton, place: Array) -> Array:
    """The stations (n,) mm of the index finger whose places along a skeleton are `place` (m)."""
    grid = np.arange(-100.0, 160.0, 0.05)
    return np.asarray(np.interp(place, along(skeleton, grid), grid))


def hood_of(
    sheet: ImportedSheet, chain: Centreline, level: Level, posture: Mapping[str, float]
) -> tuple[HoodMesh, tuple[str, ...]]:
    """The hood mesh, and what was assumed: directions of fibres and anchors of springs.

    Raises InputError for springs without anchors on nodes that are far from their bone."""
    used = np.unique(sheet.quads)
    points, quads = sheet.points[used], np.searchsorted(used, sheet.quads)
    sets = {
        name: np.searchsorted(used, nodes[np.isin(nodes, used)])
        for name, nodes in sheet.sets.nodes.items()
    }
    station = stations(chain.skeleton, places(points, chain))
    region = np.zeros(len(quads), dtype=np.intp)
    for name, cells in sheet.sets.cells.items():
        region[cells] = REGIONS.index(name)
    springs, notes = _springs(sheet, sets, points, used, chain, level)
    stated = sheet.fields.get(FIBRE)
    mesh = HoodMesh(
        points,
        quads,
        region,
        _fibres(points, quads, region, chain) if stated is None else stated,
        {end: _across(points, sets[END + end]) for end in ENDS},
        springs,
        {body: sets[TIED + body] for body in BODIES if TIED + body in sets},
        station,
        dict(posture),
        float(chain.skeleton.length[1]),
        sheet.thickness,
        fields=sheet.fields,
    )
    assumed = "along the finger, round it in the sagittal bands (assumed)"
    notes.insert(0, f"fibres: {assumed if stated is None else 'as the file has them'}")
    if sheet.fields:
        notes.insert(
            1,
            f"fields of directions, for hood.regions.REGION.direction: {', '.join(sheet.fields)}",
        )
    free = _drop_weaker_supports(mesh)
    for name, held in springs.items():
        left = len(free.springs[name].nodes) if name in free.springs else 0
        if left < len(held.nodes):
            notes.append(
                f"dropped: {len(held.nodes) - left} of the {len(held.nodes)} nodes of "
                f"{SPRING}{name}, which are tied or in a loaded end"
            )
    return free, tuple(notes)


def _across(points: Array, nodes: Ints) -> Ints:
    """Nodes of an end from edge to edge."""
    p = points[nodes] - points[nodes].mean(axis=0)
    return nodes[np.argsort(p @ np.linalg.svd(p, full_matrices=False)[2][0])]


def _fibres(points: Array, quads: Ints, region: Ints, chain: Centreline) -> Array:
    p = points[quads]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ahead = chain.frames(places(p.mean(axis=1), chain))[1][:, :, 0]
    ahead = ahead - np.einsum("nk,nk->n", ahead, normal)[:, None] * normal
    around = np.array([has_lateral_fibres(REGIONS[i]) for i in region])
    fibre = np.where(around[:, None], np.cross(normal, ahead), ahead)
    return fibre / np.linalg.norm(fibre, axis=1, keepdims=True)


def _springs(
    sheet: ImportedSheet,
    sets: Mapping[str, Ints],
    points: Array,
    used: Ints,
    chain: Centreline,
    level: Level,
) -> tuple[dict[str, Attachment], list[str]]:
    out, notes = {}, []
    for name in SPRINGS:
        full, body = SPRING + name, BODY_OF[name]
        if full not in sets:
            continue
        lines = sheet.sets.lines.get(full)
        pairs = None if lines is None else _orient_lines(full, lines, used)
        if pairs is not None:
            i = BODIES.index(body)
            local = (sheet.points[pairs[:, 1]] - chain.position[i]) @ chain.rotation[i]
            out[name] = Attachment(body, np.searchsorted(used, pairs[:, 0]), local)
            continue
        if name.rsplit("_", 1)[0] in STRINGS:
            out[name] = strings(name, sets[full], points[sets[full]], chain)
            notes.append(f"{full}: strings as our own hood's (assumed)")
            continue
        out[name] = on_bone(body, sets[full], points[sets[full]], level)
        far = level.surfaces[body].distance(out[name].anchors)[0]
        if np.abs(far).max() > REACHED:
            raise InputError(
                f"{full}: some of its nodes are too far from the {body} bone for an anchor to be "
                "found there; give the springs as two-node lines from the hood to their anchors"
            )
        notes.append(f"{full}: anchored at the nearest points of the {body} bone (assumed)")
    return out, notes


def _orient_lines(name: str, lines: Ints, used: Ints) -> Ints | None:
    """The lines (k, 2) from the hood's node to the anchor; None of lines that run in the hood.

    Raises InputError for lines of both kinds, or off the hood."""
    on = np.isin(lines, used)
    if on.all():
        return None
    if (on.sum(axis=1) != 1).any():
        i = int(np.argmax(on.sum(axis=1) != 1))
        raise InputError(
            f"{name}: its line {i} (nodes {lines[i].tolist()}) does not run from a node of the "
            "hood to an anchor off it"
        )
    return np.where(on[:, :1], lines, lines[:, ::-1])


def _drop_weaker_supports(mesh: HoodMesh) -> HoodMesh:
    """Nodes held in two ways stay with the stronger one: ties before ends before springs."""
    tied = np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *mesh.tied.values()]))
    ends = np.unique(np.concatenate(list(mesh.ends.values())))
    both = np.intersect1d(tied, ends)
    if len(both):
        raise InputError(
            f"{len(both)} nodes of the hood are in a tied_ and in an end_ set; leave them in one"
        )
    springs = {}
    for name, held in mesh.springs.items():
        keep = ~np.isin(held.nodes, np.concatenate([tied, ends]))
        if keep.any():
            springs[name] = held.of(keep, np.arange(len(mesh.points)))
    return replace(mesh, springs=springs)
