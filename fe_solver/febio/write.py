"""Writing a Job as a FEBio 4 file, laid out as FEBio 4.11 reads it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.files import output_file
from cosim.port import Array, Ints
from fe_solver.elements.mitc9 import IN_TURN
from fe_solver.febio.laws import InSitu, law_tag, needs_fibre
from fe_solver.febio.mesh import Units
from fe_solver.febio.write_conditions import SAME_POINT, Conditions, controller_tag
from fe_solver.febio.xml import Element, comment, tag, write_xml
from fe_solver.job.curves import LoadCurve
from fe_solver.job.job import Job
from fe_solver.job.phases import phases
from fe_solver.materials.linear import Law

PLOTTED = ("displacement", "stress", "shell thickness", "contact gap", "discrete element force")
RIGID_THICKNESS = 0.01
"""Thickness of rigid shells, which FEBio wants but does not use."""


def write_feb(
    job: Job,
    path: Path | str,
    points: Array | None = None,
    length_unit: float = 1e-3,
    force_unit: float = 1.0,
    remarks: Sequence[str] = (),
    in_middle: bool = False,
) -> None:
    """Write a job, with `points` (n, 3) m in place of its own where they are given, and `remarks`
    as comments at its head.

    FEBio's shell nodes lie on the face that the normal points to: a job whose nodes lie elsewhere
    is written with its nodes moved there.  The file appears whole or not at all.  Raises InputError
    where the job holds what FEBio's format cannot say, and where the file cannot be written.
    `in_middle`: what holds and loads the sheet, on its nodes, is written as acting in its middle
    over them (`fe_solver.febio.middle`)."""
    path = Path(path)
    nodes = job.sheet.points if points is None else np.asarray(points, dtype=float)
    if nodes.shape != job.sheet.points.shape:
        raise InputError(f"points have shape {nodes.shape}, expected {job.sheet.points.shape}")
    _check_names(job)
    w = Conditions(job, face_points(job, nodes), Units(length_unit, force_unit))
    if in_middle:
        w.middle = replace(job.sheet, points=nodes).moved(job.sheet.height)
        if job.held_directors or not all(t.clamped for t in job.ties):
            raise InputError(f"{job.name}: hinges and held directors are not written in the middle")
    root = _document(w)
    for i, words in enumerate(remarks):
        root.insert(i, comment(words))
    with output_file(path) as part:
        write_xml(part, root)


def _check_names(job: Job) -> None:
    names = [p.name for p in job.sheet.parts] + [b.name for b in job.bodies]
    twice = [n for i, n in enumerate(names) if n in names[:i]]
    if twice:
        raise InputError(f"{job.name}: two parts or bodies are called {twice[0]!r}")
    shapes = [b.name for b in job.bodies if b.surface is not None]
    if shapes:
        raise InputError(
            f"{job.name}: the body {shapes[0]!r} has a surface that is not of triangles, which "
            "FEBio's format has no word for; give it vertices and triangles"
        )
    if job.body_forces:
        raise InputError(f"{job.name}: a force on the mass of elements is not written for FEBio")
    if not job.steps:
        raise InputError(f"{job.name}: it has no time steps to write")
    if job.rigid_loads or any(any(b.free) for b in job.bodies):
        raise InputError(f"{job.name}: free bodies and loads on bodies are not written for FEBio")
    if len(phases(job)) > 1:
        raise InputError(f"{job.name}: conditions of some of several steps are not written")


def face_points(job: Job, points: Array) -> Array:
    """The points (n, 3) m on the normal's face: half a thickness from the mid-surface."""
    off = job.sheet.height + job.sheet.thickness / 2
    if not (np.abs(off) > SAME_POINT).any():
        return points
    return replace(job.sheet, points=points).moved(off)


def _document(w: Conditions) -> Element:
    """The whole file.  The mesh comes after the conditions that name its sets and its nodes."""
    conditions, blocks = w.sections(), list(_blocks(w.job))
    none = [tag(name, 0) for name in ("T", "R", "Fc")]
    controls, steps = _controls(w), []
    if len(controls) > 1:
        names = [step.name for step in w.job.steps]
        steps = [tag("step", c, id=i + 1, name=names[i]) for i, c in enumerate(controls)]
        controls, steps = [], [tag("Step", *steps)]
    variables = [tag("var", type=variable) for variable in PLOTTED]
    curves = [controller_tag(c, number) for c, number in w.curves.items()]
    return tag(
        "febio_spec",
        tag("Module", type="solid"),
        tag("Globals", tag("Constants", *none)),
        *controls,
        tag("Material", *_materials(w)),
        tag("Mesh", _nodes(w), *_elements(w, blocks), *w.sets),
        tag("MeshDomains", *_domains(w, blocks)),
        tag("MeshData", *[data for block in blocks for data in _mesh_data(w, block)]),
        *conditions,
        *steps,
        tag("LoadData", *curves),
        tag("Output", tag("plotfile", *variables, type="febio")),
        version="4.0",
    )


class _Block(NamedTuple):
    """Elements of one part and one kind."""

    name: str
    part: str
    law: Law
    elements: Ints
    nodes: list[int]
    """Which of an element's, in FEBio's order."""

    @property
    def kind(self) -> str:
        """FEBio's word."""
        return {3: "tri3", 4: "q4ans", 9: "quad9"}[len(self.nodes)]


def _blocks(job: Job) -> Iterator[_Block]:
    triangle = job.sheet.quads[:, 2] == job.sheet.quads[:, 3]
    full = IN_TURN if job.sheet.quads.shape[1] == 9 else [0, 1, 2, 3]
    for index, part in enumerate(job.sheet.parts):
        of_part = job.sheet.part == index
        quads, triangles = np.flatnonzero(of_part & ~triangle), np.flatnonzero(of_part & triangle)
        if len(quads):
            yield _Block(part.name, part.name, part.law, quads, full)
        if len(triangles):
            name = f"{part.name} (triangles)" if len(quads) else part.name
            yield _Block(name, part.name, part.law, triangles, [0, 1, 2])


def _materials(w: Conditions) -> Iterator[Element]:
    for number, part in enumerate(w.job.sheet.parts, 1):
        in_situ = InSitu(part.in_situ_stretch, part.isochoric)
        yield law_tag(number, part.name, part.law, w.units.stress, in_situ)
    for number, body in enumerate(w.job.bodies, len(w.job.sheet.parts) + 1):
        inner = {"density": 1, "E": 1, "v": 0, "center_of_mass": body.origin / w.units.length}
        tags = [tag(name, value) for name, value in inner.items()]
        yield tag("material", *tags, id=number, name=body.name, type="rigid body")


def _nodes(w: Conditions) -> Element:
    rest = [b.origin + v for b in w.job.bodies for v in b.vertices] + [x for _, x in w.extra]
    places = np.concatenate([w.points, np.reshape(rest, (-1, 3))]) / w.units.length
    ids = [*w.job.sheet.node_ids, *range(w.first_vertex(0), w.first_vertex(0) + len(rest))]
    return nodes_tag(places, ids, name="all nodes")


def nodes_tag(points: Array, ids: Iterable[int], **attributes: object) -> Element:
    """Nodes with their points (n, 3) and numbers (n,)."""
    rows = (tag("node", x, id=i) for i, x in zip(ids, points, strict=True))
    return tag("Nodes", *rows, **attributes)


def elements_tag(kind: str, name: str, nodes: Ints, ids: Iterable[int]) -> Element:
    """Elements of one kind with their nodes' numbers (k, m) and their own (k,)."""
    rows = (tag("elem", corners, id=i) for i, corners in zip(ids, nodes, strict=True))
    return tag("Elements", *rows, type=kind, name=name)


def domain_tag(name: str, material: str, thickness: float) -> Element:
    """What a part of shells is made of, and how thick."""
    return tag("ShellDomain", tag("shell_thickness", thickness), name=name, mat=material)


def axes_tag(name: str, corners: Array, fibre: Array) -> Element:
    """The axes of a part's elements with corners (k, 4, 3): axis 1 along the fibre (k, 3), axis 2
    across it in the element's plane."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    across = np.cross(normal, fibre)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    rows = [
        tag("elem", tag("a", a), tag("d", d), lid=i)
        for i, (a, d) in enumerate(zip(fibre, across, strict=True), 1)
    ]
    return tag("ElementData", *rows, type="mat_axis", elem_set=name)


def _elements(w: Conditions, blocks: list[_Block]) -> Iterator[Element]:
    job = w.job
    for b in blocks:
        nodes = job.sheet.node_ids[job.sheet.quads[b.elements][:, b.nodes]]
        yield elements_tag(b.kind, b.name, nodes, job.sheet.element_ids[b.elements])
    following = int(job.sheet.element_ids.max()) + 1
    for index, body in enumerate(job.bodies):
        count = len(body.triangles)
        if count:
            nodes, ids = body.triangles + w.first_vertex(index), range(following, following + count)
            yield elements_tag("tri3", body.name, nodes, ids)
        following += count


def _domains(w: Conditions, blocks: list[_Block]) -> Iterator[Element]:
    for b in blocks:
        yield domain_tag(b.name, b.part, w.job.sheet.thickness[b.elements[0], 0] / w.units.length)
    for body in w.job.bodies:
        if len(body.triangles):
            yield domain_tag(body.name, body.name, RIGID_THICKNESS)


def _mesh_data(w: Conditions, b: _Block) -> Iterator[Element]:
    thickness = w.job.sheet.thickness[b.elements][:, b.nodes] / w.units.length
    if np.ptp(thickness):
        rows = [tag("e", values, lid=i) for i, values in enumerate(thickness, 1)]
        yield tag("ElementData", *rows, type="shell thickness", elem_set=b.name)
    if needs_fibre(b.law):
        yield axes_tag(
            b.name, w.points[w.job.sheet.quads[b.elements]], w.job.sheet.fibre[b.elements]
        )


def _controls(w: Conditions) -> list[Element]:
    """The settings of each step; must-points are a load curve of the longest increment."""
    symmetric, out = ("symmetric_stiffness", "symmetric"), []
    starts = [0.0, *(step.end for step in w.job.steps)]
    for start, step in zip(starts, w.job.steps, strict=False):
        size, stepper = (step.end - start) / step.increments, []
        if step.must:
            longest = w.scaled("dtmax", size, LoadCurve(step.must, (1.0,) * len(step.must)))
            stepper = [tag("time_stepper", longest, type="default")]
        out.append(
            tag(
                "Control",
                tag("analysis", "STATIC"),
                tag("time_steps", step.increments),
                tag("step_size", size),
                tag("solver", tag(*symmetric), type="solid"),
                *stepper,
            )
        )
    return out
