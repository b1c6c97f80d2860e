"""A hood of a case as a stand-alone Job, for FEBio's files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array, Ints, Motion, Triangles, mirror, mirror_axial
from fe_solver.elements.mesh_geometry import is_triangle, node_means
from fe_solver.forces.contact import Contact
from fe_solver.forces.guides import Guides
from fe_solver.hood.as_febio import bones_lie_below, in_situ, mean_fibre, sheet_of
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.job.job import Job, NodalForce, PrescribedDisplacement, Step
from fe_solver.job.model import move_nodes
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.sheet import Sheet, ShellPart
from fe_solver.solver.model import ShellModel
from fe_solver.supports import Body, ContactPair, SpringLaw, SpringSet, Tied

RAMP = LoadCurve((0.0, 1.0), (0.0, 1.0))
TAUT = LoadCurve((0.0, 0.1, 1.0), (0.0, 1.0, 1.0))
"""A sheet that is taut while its bones move does not fold in the joints."""
INCREMENTS = 10
SAME_VALUE = 1e-9
"""m, or relative: what differs by less is one."""


def job_of_hood(
    hood: ShellHood,
    motion: Motion,
    tension: Array,
    bones: Mapping[str, Triangles],
    name: str = "hood",
    on_face: bool = True,
) -> Job:
    """The hood from its rest pose to `motion`, over t = 0 to 1, under `tension` (nt,) N, which is
    all there from t = 0.1 (that of ropes from the start), in the frame of the body along which its
    tendons slide (the first one where none does).

    `bones` are the surfaces of the bodies that the hood touches, by name: vertices (nv, 3) m in the
    body's frame, triangles (nt, 3).  The file format puts nodes on the face that the normal points
    to: `on_face` turns the quads' normals to the bones and moves the nodes there, half a thickness,
    with ties, springs and pulls; their rest lengths follow.  Else the nodes stay on the
    mid-surface.

    Raises InputError for what a job cannot say: growth but along the fibres of a region, materials
    that vary within a region, springs with tables, tendons that do not slide along an axis of one
    body; and for what `fe_solver.hood.as_febio` would replace."""
    model, sheet = hood.model, _writable_sheet(hood)
    frame = int(model.guides.body[0]) if len(model.guides.node) else 0
    rest, end = _in_frame_of(hood.rest, frame), _in_frame_of(motion, frame)
    turned = on_face and bones_lie_below(model, hood.rest)
    quads, parts, height = sheet.quads, sheet.parts, sheet.height
    thickness = np.array(np.broadcast_to(sheet.thickness.T, quads.T.shape).T)
    if turned:
        quads, thickness, height = (
            _reorder_corners(sheet.quads, values) for values in (quads, thickness, -height)
        )
        parts = tuple(_turn_over(part) for part in parts)
    fibre = mean_fibre(sheet) @ hood.rest.rotation[frame]
    points = (sheet.points - hood.rest.position[frame]) @ hood.rest.rotation[frame]
    sheet = Sheet(
        points,
        quads,
        parts,
        sheet.part,
        thickness,
        fibre,
        height,
        node_ids=np.arange(1, len(points) + 1),
        element_ids=np.arange(1, len(quads) + 1),
    )
    springs = [
        replace(s, anchor=np.einsum("kij,kj->ki", rest.rotation[s.body], s.anchor))
        for s in hood.springs
    ]
    job = Job(
        sheet,
        ties=_ties(model),
        held=_supports(model.guides),
        springs=(*springs, *_ropes(model, rest, points, np.asarray(tension))),
        forces=_pulls(hood, tension),
        bodies=_bodies(rest, end, bones),
        steps=(Step("pose and tension", 1.0, INCREMENTS),),
        name=name,
    )
    if on_face:
        job = move_nodes(job, height + thickness / 2)
        job = replace(job, sheet=replace(job.sheet, height=-thickness / 2))
    side = 1 if turned else -1
    # facets that touch at points of their own, as the format's do, need no lift
    pairs = [_pair(job, k, hood, side, bones) for k in model.contacts]
    if any(k.elastic for k in model.contacts):
        pairs = [replace(p, name=f"{p.name} {i}") for i, p in enumerate(pairs, 1)]
    return replace(job, contacts=tuple(pairs))


def mirrored(job: Job) -> Job:
    """Return the job of a hood as that of the other hand: its mirror image, y turned to -y."""
    sheet = job.sheet
    quads, thickness, height = (
        _reorder_corners(sheet.quads, values)
        for values in (sheet.quads, sheet.thickness, sheet.height)
    )
    sheet = replace(
        sheet,
        points=mirror(sheet.points),
        quads=quads,
        parts=tuple(_turn_over(part) for part in sheet.parts),
        thickness=thickness,
        height=height,
        fibre=mirror(sheet.fibre),
    )
    held = (
        replace(h, displacement=_scaled(h.displacement, mirror(np.ones(3))[h.component]))
        for h in job.held
    )
    bodies = tuple(
        replace(
            b,
            origin=mirror(b.origin),
            vertices=mirror(b.vertices),
            triangles=np.asarray(b.triangles)[:, ::-1],
            displacement=_turned(b.displacement, mirror(np.ones(3))),
            rotation=_turned(b.rotation, mirror_axial(np.ones(3))),
        )
        for b in job.bodies
    )
    return replace(
        job,
        sheet=sheet,
        held=tuple(held),
        springs=tuple(replace(s, anchor=mirror(s.anchor)) for s in job.springs),
        forces=tuple(replace(f, force=mirror(f.force)) for f in job.forces),
        contacts=tuple(
            replace(c, triangles=np.asarray(c.triangles)[:, ::-1]) for c in job.contacts
        ),
        bodies=bodies,
    )


def _turned(drives: Iterable[Drive], signs: Array) -> tuple[Drive, Drive, Drive]:
    x, y, z = (_scaled(d, sign) for d, sign in zip(drives, signs, strict=True))
    return x, y, z


def _scaled(drive: Drive, factor: float) -> Drive:
    return replace(drive, value=factor * drive.value)


def _writable_sheet(hood: ShellHood) -> Sheet:
    """Return the hood's sheet.  Raises InputError where a job cannot say what the hood has."""
    m, sheet = hood.model, sheet_of(hood)
    if any(contact.layer is not None for contact in m.contacts):
        raise InputError(
            "a hood on a layer of tissue that gives is not written: FEBio's contact is a penalty "
            "(fe_solver.hood.as_febio)"
        )
    if any(part.sliding for part in sheet.parts):
        raise InputError(
            "a hood whose fibres slide on each other is not written: in FEBio's format a shell "
            "bends as a solid; set hood.regions.*.sliding_fibres to false"
        )
    if any(part.bending.any() for part in sheet.parts):
        raise InputError(
            "a hood with a bending modulus of its own cannot be written: in FEBio's format a shell "
            "bends as its material does; set hood.bending_stiffness to zero"
        )
    for patch in m.section.patches:
        varies = any(np.ndim(value) for value in vars(patch.law).values())
        if varies or not np.allclose(patch.factor, 1.0):
            name = m.regions[patch.elements[0]]
            raise InputError(f"the region {name!r} has a material that varies within it")
    if m.springs.curves:
        raise InputError("a hood whose springs follow tables is not written")
    if len(set(m.guides.body.tolist())) > 1:
        raise InputError("a hood whose tendons slide along several bodies is not written")
    return in_situ(sheet)


def _in_frame_of(motion: Motion, frame: int) -> Motion:
    """The poses as one of the bodies sees them."""
    back = motion.rotation[frame].T
    return motion.transform(back, -back @ motion.position[frame])


def _reorder_corners(quads: Ints, values: Array | Ints) -> NDArray:
    """What the corners (ne, 4) hold, in the order of the elements wound the other way."""
    triangle = is_triangle(quads)[:, None]
    return np.where(triangle, values[:, [1, 0, 2, 3]], values[:, [0, 3, 2, 1]])


def _turn_over(part: ShellPart) -> ShellPart:
    """The material of elements wound the other way: an angle is about the other normal."""
    law = part.law
    if isinstance(law, CrossedLinear | CrossedFibres):
        law = replace(law, angle=-np.asarray(law.angle).item())
    return replace(part, law=law)


def _bodies(rest: Motion, end: Motion, bones: Mapping[str, Triangles]) -> tuple[Body, ...]:
    out = []
    for i, twist in enumerate(rest.twist_to(end)):
        name = rest.bodies[i]
        none = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp))
        vertices, triangles = bones.get(name, none)
        moves = map(float, twist)
        x, y, z, u, v, w = (Drive() if abs(t) < 1e-14 else Drive(t, RAMP) for t in moves)
        turned = np.asarray(vertices) @ rest.rotation[i].T
        out.append(Body(name, rest.position[i], turned, triangles, (x, y, z), (u, v, w)))
    return tuple(out)


def _ties(model: ShellModel) -> tuple[Tied, ...]:
    t = model.ties
    return tuple(Tied(t.node[t.body == b], int(b)) for b in np.unique(t.body))


def _supports(guides: Guides) -> tuple[PrescribedDisplacement, ...]:
    """Hold the guided nodes along the world's axes.  Raises InputError where a node slides along no
    axis of its body."""
    out = []
    for i in range(3):
        along = np.abs(guides.axes[:, i])
        if not (np.abs(np.sort(along, axis=1) - [0, 0, 1]) < SAME_VALUE).all():
            raise InputError("a tendon's end slides along no axis of its body; turn that body")
    which = np.abs(guides.axes).argmax(axis=1)  # (k, 3) the component of each axis
    for component in range(3):
        held = (guides.held & (which == component)).any(axis=1)
        if held.any():
            out.append(PrescribedDisplacement(guides.node[held], component))
    return tuple(out)


def _ropes(model: ShellModel, rest: Motion, points: Array, tension: Array) -> Iterator[SpringSet]:
    """The ropes that bear something, as springs of constant force."""
    r = model.ropes
    for i, force in enumerate(tension @ r.share if len(r.node) else ()):
        if force:
            eyelet = rest.position[r.body[i]] + r.arm(rest.rotation)[i]
            length = np.array([np.linalg.norm(points[r.node[i]] - eyelet)])
            law = SpringLaw(0.0, table=LoadCurve((-1.0, 1.0), (float(force), float(force))))
            at = r.node[i : i + 1], r.body[i : i + 1], r.arm(rest.rotation)[i : i + 1]
            yield SpringSet(f"rope {i + 1}", law, *at, np.array([-1]), length)


def _pulls(hood: ShellHood, tension: Array) -> tuple[NodalForce, ...]:
    g = hood.model.guides
    size = np.asarray(tension, dtype=float) @ hood.model.share
    return tuple(
        NodalForce(np.array([n]), f * d, TAUT)
        for n, f, d in zip(g.node, size, g.direction, strict=True)
        if f
    )


def _pair(
    job: Job, contact: Contact, hood: ShellHood, side: int, bones: Mapping[str, Triangles]
) -> ContactPair:
    """The pair of a contact; one that is elastic keeps its stiffness, and its elements."""
    name, sheet = hood.bodies[contact.body], job.sheet
    if name not in bones:
        raise InputError(f"the hood touches the body {name!r}, whose surface is not given")
    half = node_means(sheet.thickness, sheet.quads, len(sheet.points)) / 2
    if contact.within is not None:
        gap, quads = contact.offset - contact.within.mean(half), contact.within.cells
    else:
        gap = contact.offset - half[contact.nodes] - hood.lift[contact.nodes]
        quads = np.flatnonzero(np.isin(sheet.quads, contact.nodes).all(axis=1))
    if np.ptp(gap) > SAME_VALUE:
        raise InputError(f"the contact level over the body {name!r} varies from node to node")
    return ContactPair(
        f"{job.name} on {name}",
        quads,
        np.full(len(quads), side),
        contact.body,
        np.asarray(bones[name][1]),
        penalty=contact.stiffness if contact.elastic else 1.0,
        automatic=not contact.elastic,
        friction=contact.friction,
        gap=float(gap.mean()),
    )
