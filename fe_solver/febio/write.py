"""Writing a Job as a FEBio 4 file, laid out as FEBio 4.11 reads it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from cosim.errors import InputError
from cosim.files import output_file
from cosim.port import Array, Ints
from fe_solver.elements.mesh_geometry import node_directors
from fe_solver.febio.bodies import Units
from fe_solver.febio.law_write import law_line, needs_fibre
from fe_solver.febio.write_conditions import SAME_POINT, Conditions, Lines, number, row, whole
from fe_solver.job.job import Job
from fe_solver.materials.linear import Law

HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<febio_spec version="4.0">\n<Module type="solid"/>\n'
    "<Globals><Constants><T>0</T><R>0</R><Fc>0</Fc></Constants></Globals>"
)
PLOTTED = ("displacement", "stress", "shell thickness", "contact gap", "discrete element force")
RIGID_THICKNESS = "0.01"
"""Thickness of rigid shells, which FEBio wants but does not use."""


def write_feb(
    job: Job,
    path: Path | str,
    points: Array | None = None,
    length_unit: float = 1e-3,
    force_unit: float = 1.0,
) -> None:
    """Write a job, with `points` (n, 3) m in place of its own where they are given.

    FEBio's shell nodes lie on the face that the normal points to: a job whose nodes lie elsewhere
    is written with its nodes moved there.  The file appears whole or not at all.  Raises InputError
    where the job holds what FEBio's format cannot say, and where the file cannot be written."""
    path = Path(path)
    own = job.sheet.points if points is None else np.asarray(points, dtype=float)
    if own.shape != job.sheet.points.shape:
        raise InputError(f"points have shape {own.shape}, expected {job.sheet.points.shape}")
    _check_names(job)
    w = Conditions(job, face_points(job, own), Units(length_unit, force_unit))
    with output_file(path) as part:
        part.write_text("\n".join(_lines(w)) + "\n", encoding="utf-8")


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
    if not job.steps:
        raise InputError(f"{job.name}: it has no time steps to write")


def face_points(job: Job, points: Array) -> Array:
    """(n, 3) m on the face that the normal points to: half a thickness from the mid-surface."""
    off = job.sheet.height + job.sheet.thickness / 2
    if not (np.abs(off) > SAME_POINT).any():
        return points
    count = np.bincount(job.sheet.quads.ravel(), minlength=len(points))
    total = np.bincount(job.sheet.quads.ravel(), weights=off.ravel(), minlength=len(points))
    mean = total / np.maximum(count, 1)
    return points + mean[:, None] * node_directors(points, job.sheet.quads)


def _lines(w: Conditions) -> Lines:
    """The whole file.  The mesh comes before the conditions that name its sets, so these are made
    first."""
    conditions = list(w.lines())
    blocks = list(_blocks(w.job))
    yield HEAD
    if len(w.job.steps) == 1:
        yield _control(w.job, 0.0, 0)
    yield "<Material>"
    yield from _materials(w)
    yield "</Material>\n<Mesh>"
    yield from _nodes(w)
    yield from _elements(w, blocks)
    yield from w.sets
    yield "</Mesh>\n<MeshDomains>"
    yield from _domains(w, blocks)
    yield "</MeshDomains>\n<MeshData>"
    for block in blocks:
        yield from _mesh_data(w, block)
    yield "</MeshData>"
    yield from conditions
    yield from _steps(w.job)
    yield from _load_data(w)
    variables = "".join(f'<var type="{v}"/>' for v in PLOTTED)
    yield f'<Output><plotfile type="febio">{variables}</plotfile></Output>\n</febio_spec>'


class _Block(NamedTuple):
    """Elements of one part and one kind: their nodes' numbers (k, 3) or (k, 4)."""

    name: str
    part: str
    law: Law
    elements: Ints
    corners: int


def _blocks(job: Job) -> Iterator[_Block]:
    triangle = job.sheet.quads[:, 2] == job.sheet.quads[:, 3]
    for index, part in enumerate(job.sheet.parts):
        of_part = job.sheet.part == index
        quads, triangles = np.flatnonzero(of_part & ~triangle), np.flatnonzero(of_part & triangle)
        if len(quads):
            yield _Block(part.name, part.name, part.law, quads, 4)
        if len(triangles):
            name = f"{part.name} (triangles)" if len(quads) else part.name
            yield _Block(name, part.name, part.law, triangles, 3)


def _materials(w: Conditions) -> Lines:
    for index, part in enumerate(w.job.sheet.parts, 1):
        yield law_line(index, part.name, part.law, w.units.stress, part.in_situ_stretch)
    for index, body in enumerate(w.job.bodies, len(w.job.sheet.parts) + 1):
        yield (
            f'<material id="{index}" name={quoteattr(body.name)} type="rigid body"><density>1'
            "</density><E>1</E><v>0</v><center_of_mass>"
            f"{row(body.origin / w.units.length)}</center_of_mass></material>"
        )


def _nodes(w: Conditions) -> Lines:
    yield '<Nodes name="all nodes">'
    for i, x in zip(w.job.sheet.node_ids, w.points / w.units.length, strict=True):
        yield f'<node id="{i}">{row(x)}</node>'
    rest = [b.origin + v for b in w.job.bodies for v in b.vertices] + [x for _, x in w.extra]
    for i, x in enumerate(rest, w.first_vertex(0)):
        yield f'<node id="{i}">{row(x / w.units.length)}</node>'
    yield "</Nodes>"


def _elements(w: Conditions, blocks: list[_Block]) -> Lines:
    job = w.job
    for b in blocks:
        kind = "tri3" if b.corners == 3 else "q4ans"
        yield f'<Elements type="{kind}" name={quoteattr(b.name)}>'
        for i in b.elements:
            nodes = job.sheet.node_ids[job.sheet.quads[i, : b.corners]]
            yield f'<elem id="{job.sheet.element_ids[i]}">{whole(nodes)}</elem>'
        yield "</Elements>"
    following = int(job.sheet.element_ids.max()) + 1
    for index, body in enumerate(job.bodies):
        if len(body.triangles):
            yield f'<Elements type="tri3" name={quoteattr(body.name)}>'
            for i, t in enumerate(body.triangles + w.first_vertex(index), following):
                yield f'<elem id="{i}">{whole(t)}</elem>'
            yield "</Elements>"
        following += len(body.triangles)


def _domains(w: Conditions, blocks: list[_Block]) -> Lines:
    parts = [
        (b.name, b.part, number(w.job.sheet.thickness[b.elements[0], 0] / w.units.length))
        for b in blocks
    ]
    parts += [(b.name, b.name, RIGID_THICKNESS) for b in w.job.bodies if len(b.triangles)]
    for name, material, thickness in parts:
        yield (
            f"<ShellDomain name={quoteattr(name)} mat={quoteattr(material)}>"
            f"<shell_thickness>{thickness}</shell_thickness></ShellDomain>"
        )


def _mesh_data(w: Conditions, b: _Block) -> Lines:
    thickness = w.job.sheet.thickness[b.elements, : b.corners] / w.units.length
    if np.ptp(thickness):
        yield f'<ElementData type="shell thickness" elem_set={quoteattr(b.name)}>'
        for i, values in enumerate(thickness, 1):
            yield f'<e lid="{i}">{row(values)}</e>'
        yield "</ElementData>"
    if needs_fibre(b.law):
        yield from _axes(w, b)


def _axes(w: Conditions, b: _Block) -> Lines:
    """Axis 1 along the fibre, axis 2 across it in the element's plane."""
    x, fibre = w.points[w.job.sheet.quads[b.elements]], w.job.sheet.fibre[b.elements]
    across = np.cross(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), fibre)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    yield f'<ElementData type="mat_axis" elem_set={quoteattr(b.name)}>'
    for i, (a, d) in enumerate(zip(fibre, across, strict=True), 1):
        yield f'<elem lid="{i}"><a>{row(a)}</a><d>{row(d)}</d></elem>'
    yield "</ElementData>"


def _control(job: Job, start: float, index: int) -> str:
    step = job.steps[index]
    size = number((step.end - start) / step.increments)
    return (
        f"<Control><analysis>STATIC</analysis><time_steps>{step.increments}</time_steps>"
        f'<step_size>{size}</step_size><solver type="solid"><symmetric_stiffness>symmetric'
        "</symmetric_stiffness></solver></Control>"
    )


def _steps(job: Job) -> Lines:
    if len(job.steps) > 1:
        yield "<Step>"
        start = 0.0
        for i, step in enumerate(job.steps):
            control = _control(job, start, i)
            yield f'<step id="{i + 1}" name={quoteattr(step.name)}>{control}</step>'
            start = step.end
        yield "</Step>"


def _load_data(w: Conditions) -> Lines:
    yield "<LoadData>"
    for c, index in w.curves.items():
        points = "".join(f"<pt>{row(p)}</pt>" for p in zip(c.times, c.values, strict=True))
        yield (
            f'<load_controller id="{index}" type="loadcurve">'
            f"<interpolate>{c.interpolation}</interpolate><extend>{c.extension}</extend>"
            f"<points>{points}</points></load_controller>"
        )
    yield "</LoadData>"
