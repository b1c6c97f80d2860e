"""What holds a hood of finite elements on the bones, and the surfaces that it lies on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from cosim.array_cache import user_cache
from cosim.errors import InputError
from cosim.hoods.cable.table import CableHoodConfig
from cosim.hoods.kind import Site
from cosim.hoods.lesion import LesionConfig
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.hoods.supports import ContactConfig, LayerConfig
from cosim.port import Array, Motion, Triangles
from fe_solver.forces.contact import needed_distance
from fe_solver.forces.layer import Layer
from fe_solver.hood.build import ContactLaw, HoodSupports, TendonEnd
from fe_solver.solver.newton import NewtonOptions
from fe_solver.supports import SpringLaw, SpringSet, Tied
from fe_solver.surfaces.spline_distance import SplineDistance
from meshes.cable_net import CableNet
from meshes.coarseness import Arc, arcs
from meshes.cover import FLEXION, Head, Joint, blend, shares
from meshes.hood_mesh import Attachment, HoodMesh
from meshes.hull import DIP, PIP, along, carriers
from meshes.skeleton import BODIES, Skeleton

STRUT = 5e-3
"""m, of the three springs at right angles by which a bone holds a node in every direction; long
against what the node gives way."""
NO_SMOOTHING = 1e-6
"""m, of a penalty that a layer stands for."""
LEAST, STEP = 5e-3, 2e-3
"""m, how far beyond a bone its baked distance reaches at least, and in what steps further: so that
a study or a slider of the contact's height does not bake anew for each value."""


def supports_of(
    hood: ShellHoodConfig | CableHoodConfig,
    site: Site,
    laid: HoodMesh | CableNet,
    points: Array,
    tendons: Mapping[str, TendonEnd],
    highest: float = 0.0,
) -> HoodSupports:
    """What holds, touches and pulls a hood as a case describes it, its nodes at points (n, 3) m;
    `highest` as in `contact_levels`.  Raises InputError."""
    skeleton, contact = site.skeleton, hood.contact
    rest = Motion(BODIES, *skeleton.pose(laid.rest_posture))
    springs = [
        _attach(
            name,
            laid.springs[name],
            SpringLaw(s.stiffness, s.tension_only, toe=s.toe),
            points,
            rest,
            s.slack,
        )
        for name, s in hood.springs.items()
        if name in laid.springs
    ]
    return HoodSupports(
        rest,
        carriers(skeleton, along(skeleton, laid.station)),
        [*springs, *adhesions(site.lesion, laid, points, rest)],
        [Tied(nodes, BODIES.index(body)) for body, nodes in laid.tied.items()],
        "metacarpal",
        np.array([-1.0, 0.0, 0.0]),
        tendons,
        _contact_law(contact, site, highest),
        NewtonOptions(tolerance=site.tolerance),
    )


def _contact_law(contact: ContactConfig, site: Site, highest: float) -> ContactLaw:
    """Return how a hood touches the bones; on a layer a node sticks as stiffly as the thickest part
    of it, incompressible, bears shear (a third of its modulus over its thickness)."""
    bones, skeleton = site.anatomy.bones, site.skeleton
    levels = contact_levels(contact, bones, skeleton, highest)
    if contact.layer is None:
        assert contact.stiffness is not None  # by the schema, as the smoothing
        assert contact.smoothing is not None
        return ContactLaw(
            contact.stiffness, contact.smoothing, *levels, contact.penetration, contact.friction
        )
    stick = contact.layer.shafts / 3 / max(over for _, over in contact.offset)
    return ContactLaw(
        stick,
        NO_SMOOTHING,
        *levels,
        friction=contact.friction,
        layers=layers_of(contact, contact.layer, _bare(contact, bones, highest), skeleton),
    )


def layers_of(
    contact: ContactConfig,
    moduli: LayerConfig,
    surfaces: Mapping[str, SplineDistance],
    skeleton: Skeleton,
) -> dict[str, Layer]:
    """Return what covers the bones of bare `surfaces`, by body: its thickness and its modulus as
    fields on their grids."""
    tissue = (moduli.shafts, moduli.faces, moduli.sides)
    return {
        body: Layer(
            _thickness(contact, body, surface, skeleton),
            _over(surface, body, skeleton, *tissue),
            (getattr(contact.offset, body), moduli.shafts),
        )
        for body, surface in surfaces.items()
    }


def _thickness(
    contact: ContactConfig, body: str, surface: SplineDistance, skeleton: Skeleton
) -> SplineDistance:
    """Return the thickness, m, of what covers a bone, as a field on its surface's grid."""
    back = getattr(contact.offset, body)
    return _over(surface, body, skeleton, back, *(_head(contact, body) or Head(back, back)))


def _over(
    surface: SplineDistance, body: str, skeleton: Skeleton, shaft: float, face: float, sides: float
) -> SplineDistance:
    """Return a number of what covers a bone as a field on its surface's grid, from its values over
    shaft, face and sides."""
    if body not in FLEXION:
        return replace(surface, coefficients=np.full_like(surface.coefficients, shaft))
    joint = Joint.of(skeleton, body)
    on = _splined_shares(surface, tuple(joint.centre), tuple(joint.axis))
    return replace(surface, coefficients=blend(on, shaft, face, sides))


@lru_cache(maxsize=16)
def _splined_shares(
    surface: SplineDistance, centre: tuple[float, ...], axis: tuple[float, ...]
) -> tuple[Array, Array]:
    """Return the coefficients of `meshes.cover.shares` on a surface's grid."""
    joint = Joint(np.array(centre), np.array(axis))
    face, sides = surface.fields(partial(shares, joint=joint))
    return face.coefficients, sides.coefficients


def headed(contact: ContactConfig) -> set[str]:
    """The bodies whose heads are covered by less than their backs."""
    return {
        body
        for body in FLEXION
        if (head := _head(contact, body)) and min(head) < getattr(contact.offset, body)
    }


def _head(contact: ContactConfig, body: str) -> Head | None:
    """What covers a bone's head, m, at most what covers its back; None where that is the same."""
    stated, back = getattr(contact.heads, body, None), getattr(contact.offset, body)
    if stated is None:
        return None
    return Head(min(stated.face, back), min(stated.sides, back))


def _attach(
    name: str, held: Attachment, law: SpringLaw, points: Array, rest: Motion, slack: float = 0.0
) -> SpringSet:
    """Springs that share the stiffness of `law`, at rest when they are longer by `slack` (m) than
    at points (n, 3) m in the pose `rest`."""
    position, rotation = rest.of(held.body)
    reach = points[held.nodes] - position - held.anchors @ rotation.T
    length = np.linalg.norm(reach, axis=1) + slack
    shares = np.ones(len(held.nodes)) if held.shares is None else held.shares
    each = replace(law, stiffness=law.stiffness * shares / shares.sum())
    body = rest.bodies.index(held.body)
    return SpringSet.to_body(name, each, held.nodes, body, held.anchors, length)


def adhesions(
    lesion: LesionConfig | None, hood: HoodMesh | CableNet, points: Array, rest: Motion
) -> list[SpringSet]:
    """What holds the parts of a mesh or net that have grown onto bones, by part and bone: three
    springs at each node; its nodes lie at `points` (n, 3) m in the poses `rest`.  Raises
    InputError."""
    out = []
    for part in lesion.adhere if lesion else ():
        nodes = _nodes(hood, part)
        beneath = _bone_beneath(hood.station[nodes])
        for i in np.unique(beneath):
            body, on_bone = rest.bodies[i], nodes[beneath == i]
            local = (points[on_bone] - rest.position[i]) @ rest.rotation[i]
            anchors = (local[:, None] + STRUT * np.eye(3)).reshape(-1, 3)
            stiffness = 3 * lesion.adhesion * len(on_bone) / len(nodes) if lesion else 0.0
            held = Attachment(body, np.repeat(on_bone, 3), anchors)
            name = f"adhesion_{part}_{body}"
            out.append(_attach(name, held, SpringLaw(stiffness), points, rest))
    return out


def _bone_beneath(station: Array) -> np.ndarray:
    """The index (n,) of the bone that a place (mm along the finger) lies over, from joint to
    joint."""
    return np.searchsorted([0.0, PIP, DIP], station, side="right")


def _nodes(hood: HoodMesh | CableNet, part: str) -> np.ndarray:
    """The free nodes of a part.  Raises InputError where it has none."""
    fixed = np.concatenate([*hood.ends.values(), *hood.tied.values()])
    nodes = np.setdiff1d(hood.part_cells(part), fixed)
    if not len(nodes):
        raise InputError(f"lesion.adhere: the hood has no {part} that could grow onto a bone")
    return nodes


def pose_surfaces(
    bones: Mapping[str, Triangles], level: Mapping[str, float] | None = None
) -> dict[str, SplineDistance]:
    """Surfaces of bones with a distance baked round each, by body and in its frame; `level` (m) by
    body is how high over the bone a hood touches it at most, zero where it is not stated."""
    heights = level or {}
    return {
        body: _pose_surface(body, *map(_frozen, triangles), _margin(heights.get(body, 0.0)))
        for body, triangles in bones.items()
    }


def contact_levels(
    contact: ContactConfig,
    bones: Mapping[str, Triangles],
    skeleton: Skeleton,
    highest: float = 0.0,
) -> tuple[dict[str, SplineDistance], dict[str, float]]:
    """By body the surface over which a hood touches a bone and the offset (m) from it at which its
    face does, as a case states them: where a head is covered by less than the bone's back, the
    surface lies as much deeper.  `highest`: m that the hood touches above its face at most."""
    offset = {body: getattr(contact.offset, body) for body in bones}
    surfaces = _bare(contact, bones, highest)
    for body, bare in surfaces.items():
        if _head(contact, body) is not None:
            less = offset[body] - _thickness(contact, body, bare, skeleton).coefficients
            surfaces[body] = replace(bare, coefficients=bare.coefficients + less)
    return surfaces, offset


def _bare(
    contact: ContactConfig, bones: Mapping[str, Triangles], highest: float
) -> dict[str, SplineDistance]:
    """Return the surfaces of the bones, their distances known as far as a hood touches them."""
    return pose_surfaces(bones, {body: getattr(contact.offset, body) + highest for body in bones})


def head_arcs(
    contact: ContactConfig, bones: Mapping[str, Triangles], skeleton: Skeleton, highest: float
) -> list[Arc]:
    """The arcs that a hood slides over on the heads of bones; `highest` as in `contact_levels`."""
    surfaces, offset = contact_levels(contact, bones, skeleton, highest)
    heads = {body: _head(contact, body) for body in offset}
    face = {body: offset[body] if head is None else head.face for body, head in heads.items()}
    return arcs(skeleton, surfaces, offset, face)


def _margin(level: float) -> float:
    """How far (m) to bake beyond a bone that is touched at `level` m."""
    steps = np.ceil((needed_distance(level, 0.0) - LEAST) / STEP - 1e-9)
    return LEAST + STEP * max(float(steps), 0.0)


class _frozen:
    """An array that can be a cache's key."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array
        self.key = hash((array.shape, array.tobytes()))

    def __hash__(self) -> int:
        return self.key

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _frozen) and np.array_equal(self.array, other.array)


@lru_cache(maxsize=32)
def _pose_surface(body: str, vertices: _frozen, faces: _frozen, margin: float) -> SplineDistance:
    try:
        return SplineDistance.bake(vertices.array, faces.array, margin=margin, cache=user_cache())
    except InputError as error:
        raise InputError(f"finger.bones.{body}.surface: {error}") from error
