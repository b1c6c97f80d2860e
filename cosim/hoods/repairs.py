"""What a surgeon joins: sutures and grafts of a sheet, as springs that bear tension alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.errors import InputError
from cosim.hoods.lesion import SLIPS, GraftConfig, LesionConfig, SutureConfig
from cosim.port import Array, Ints, Motion
from fe_solver.supports import SpringLaw, SpringSet
from fe_solver.surfaces.spline_distance import SplineDistance
from meshes.hood_mesh import HoodMesh
from meshes.severed import cut_ends, kept_nodes, part_nodes
from meshes.skeleton import BODIES

REACH = 5e-3
"""m, how far along the fibres a slip's suture is anchored that had been tied to its bone."""
THROUGH = 0.5e-3
"""m, how deep the way of a graft may run in a bone, whose surface is known to some tenths of it."""
OFF_BONE = 4.5e-3
"""m from the bone at which the end of a graft may lie; less than its distance is known for."""
WAY = np.linspace(0.1, 0.9, 17)
"""Where between its ends a graft's way is looked at."""


def repairs(
    lesion: LesionConfig,
    mesh: HoodMesh,
    points: Array,
    rest: Motion,
    surfaces: Mapping[str, SplineDistance],
) -> list[SpringSet]:
    """Return all that a lesion joins again, at points (n, 3) m in the poses `rest` over the bones'
    `surfaces`.  Raises InputError."""
    return [
        *(suture(part, stated, mesh, points, rest) for part, stated in lesion.suture.items()),
        *(
            graft(name, stated, mesh, points, rest, surfaces)
            for name, stated in lesion.graft.items()
        ),
    ]


def suture(
    part: str, stated: SutureConfig, mesh: HoodMesh, points: Array, rest: Motion
) -> SpringSet:
    """Return what joins the ends of a severed part, or a slip and the bone that it came off, at
    points (n, 3) m in the poses `rest`.  Raises InputError where an end is gone."""
    name, law = f"suture_{part}", lambda k: SpringLaw(stated.stiffness / k, tension_only=True)
    if part not in SLIPS:
        first, last = cut_ends(mesh, part).T
        return _between(name, law(len(first)), first, last, points, stated.gap)
    whole, now = mesh.whole or mesh, kept_nodes(mesh)
    if part in whole.springs:
        held = whole.springs[part]
        body, nodes, anchors = BODIES.index(held.body), now[held.nodes], held.anchors
    else:
        own = np.unique(whole.part_cells(part))
        body, old = next(
            (BODIES.index(b), tied)
            for b, nodes in whole.tied.items()
            if len(tied := np.intersect1d(nodes, own))
        )
        nodes, distal = now[old], rest.rotation[body, :, 0]
        fibre = whole.fibre[np.isin(whole.quads, old).any(axis=1)].mean(axis=0)
        along = np.sign(fibre @ distal) * fibre / np.linalg.norm(fibre)
        reached = points[nodes] + REACH * along - rest.position[body]
        anchors = reached @ rest.rotation[body]
    on = nodes >= 0
    reach = rest.position[body] + anchors[on] @ rest.rotation[body].T - points[nodes[on]]
    length = np.linalg.norm(reach, axis=1) + stated.gap
    return SpringSet.to_body(name, law(int(on.sum())), nodes[on], body, anchors[on], length)


def graft(
    name: str,
    stated: GraftConfig,
    mesh: HoodMesh,
    points: Array,
    rest: Motion,
    surfaces: Mapping[str, SplineDistance],
) -> SpringSet:
    """Return a strand that is laid in, at points (n, 3) m in the poses `rest` over the bones'
    `surfaces`.  Raises InputError for a way through a bone, and for an end that lies on none."""
    start = part_nodes(mesh, stated.start)
    each = SpringLaw(stated.stiffness / len(start), tension_only=True)
    where, own = f"lesion.graft.{name}", f"graft_{name}"
    if stated.end is not None:
        others = part_nodes(mesh, stated.end)
        gap = points[start][:, None] - points[others]
        last = others[np.linalg.norm(gap, axis=2).argmin(axis=1)]
        if (last == start).any():
            raise InputError(f"{where}: {stated.start} and {stated.end} lie at one place")
        end = points[last].mean(axis=0)
        made = _between(own, each, start, last, points, stated.slack)
    else:
        assert stated.bone is not None  # by the schema
        body, anchor = BODIES.index(stated.bone), np.array(stated.at)
        off = float(surfaces[stated.bone].distance(anchor[None]).value[0])
        if off > OFF_BONE:
            raise InputError(
                f"{where}: its end lies {1e3 * OFF_BONE:g} mm or more off the {stated.bone} bone, "
                "on which it is to hold"
            )
        end = rest.position[body] + rest.rotation[body] @ anchor
        length = np.linalg.norm(end - points[start], axis=1) + stated.slack
        anchors = np.tile(anchor, (len(start), 1))
        made = SpringSet.to_body(own, each, start, body, anchors, length)
    if (made.length <= 0).any():
        raise InputError(f"{where}: is shorter than nothing; give it more slack")
    _check_way(where, points[start].mean(axis=0), end, rest, surfaces)
    return made


def _between(
    name: str, law: SpringLaw, first: Ints, last: Ints, points: Array, slack: float
) -> SpringSet:
    length = np.linalg.norm(points[last] - points[first], axis=1) + slack
    none = np.full(len(first), -1)
    return SpringSet(name, law, first, none, np.zeros((len(first), 3)), last, length)


def _check_way(
    where: str, start: Array, end: Array, rest: Motion, surfaces: Mapping[str, SplineDistance]
) -> None:
    """Check that the straight way from `start` to `end` (3,) m runs through no bone.  Raises
    InputError."""
    way = start + WAY[:, None] * (end - start)
    for body, surface in surfaces.items():
        position, rotation = rest.of(body)
        depth = -float(surface.distance((way - position) @ rotation).value.min())
        if depth > THROUGH:
            raise InputError(
                f"{where}: its straight way runs {1e3 * depth:.1f} mm deep through the {body} "
                "bone, in the posture in which the hood is laid; a graft bends round none: give "
                "it another end, or lay it by way of a part of the hood"
            )
