"""FEBio 4 files (`.feb`): shells, rigid bodies and what joins and loads them, as a Job.

FEBio's shell nodes lie on the face that the element's normal (right-handed about its nodes) points
away from the material at: a point at depth e in [-1, 1] is x - D (1 - e) / 2 with D the thickness
times the normal (FEBioMech/FESSIShellDomain.cpp), so that the mid-surface lies half a thickness
against the normal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cosim.port import Ints
from fe_solver.febio.bodies import (
    GROUND,
    Model,
    owners,
    read_bodies,
    read_curves,
    read_rigid_loads,
    triangles_of,
)
from fe_solver.febio.conditions import (
    match_facets,
    nodes_at_rest,
    read_body_forces,
    read_displacements,
    read_forces,
    read_pressures,
    read_springs,
    read_ties,
)
from fe_solver.febio.materials import read_materials
from fe_solver.febio.mesh import FebMesh, Units, read_mesh_section
from fe_solver.febio.middle import is_in_middle, read_middle
from fe_solver.febio.notes import collect_notes
from fe_solver.febio.parts import Parts, read_parts
from fe_solver.febio.xml import FebTag, read_xml
from fe_solver.job.checks import check_mesh, within
from fe_solver.job.curves import Curve, LoadCurve
from fe_solver.job.job import Job, Step
from fe_solver.job.model import move_to_mid_surface
from fe_solver.supports import Body, ContactPair

CONTACTS = ("sliding-elastic", "sliding-facet-on-facet", "sliding-node-on-facet")
SECTIONS = (
    "Module Control Globals Material Mesh MeshDomains MeshData MeshAdaptor Initial Boundary Rigid "
    "Loads Contact Constraints Discrete LoadData Step Output Include Code"
).split()
LOADING = ("Loads", "Initial")
"""Sections whose conditions may belong to one of several steps."""
MOTIONS = (
    *("zero displacement", "prescribed displacement"),
    *("rigid_fixed", "rigid_displacement", "rigid_rotation", "rigid_force", "rigid_moment"),
)
"""Conditions of which each step may have another, of the same nodes or body."""
REFUSED = ("Constraints", "MeshAdaptor", "Include", "Code")


def read_feb(path: Path | str, length_unit: float = 1e-3, force_unit: float = 1.0) -> Job:
    """Read a FEBio 4 file as a Job; `length_unit` m and `force_unit` N are the file's units.

    Raises InputError, naming file and line, where the file is not safe or well-formed, where
    something is missing, and where it holds what would change the answer and is not read; what else
    is left out is listed in the job's notes.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from fe_solver.febio.read import read_feb
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "old.feb"
    ...     _ = path.write_text('<febio_spec version="2.5"></febio_spec>')
    ...     read_feb(path)  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    ...
    cosim.errors.InputError: old.feb: another version
    """
    path = Path(path)
    root = read_xml(path, "febio_spec")
    _check_header(root)
    sections = _Sections(root)
    notes: list[str] = []
    units = Units(length_unit, force_unit)
    mesh = read_mesh_section(sections.one("Mesh"))
    materials = read_materials(sections.one("Material"))
    data = root.one("MeshData")
    parts = read_parts(sections.one("MeshDomains"), data, mesh, materials, units, notes)
    sheet = parts.sheet
    with within(str(path)):
        check_mesh(sheet.points, sheet.quads, sheet.node, sheet.element)
    _check_initial(sections, notes)
    rigid = tuple(m.name for m in materials if m.rigid)
    shell = np.full(len(mesh.points), -1)
    shell[parts.nodes] = np.arange(len(parts.nodes))
    body = owners(mesh, parts, sections.all("Boundary", "bc"), rigid, materials)
    curves = read_curves(root.one("LoadData"))
    steps = _steps(sections, curves)
    windows = sections.windows(steps)
    model = Model(mesh, units, materials, rigid, shell, body, curves, notes, windows, sections.step)
    job = _job(path.stem, model, parts, sections, steps)
    if sections.step:
        notes.append(
            "Step: conditions of a step come in, and those of the one before go, over its first "
            "increment; FEBio changes them at once, which is the same at the ends of increments"
        )
    return replace(job, notes=collect_notes(root, notes))


class _Sections:
    """Top-level sections; those of a single step count as its file's, those of several last as
    long as their step."""

    def __init__(self, root: FebTag) -> None:
        self.root = root
        holder = root.one("Step")
        self.steps = holder.all("step") if holder is not None else []
        self.step: dict[int, tuple[int, ...]] = {}
        """By the `id` of a condition's tag in some of several steps, the numbers of these."""

    def all(self, section: str, kind: str) -> list[FebTag]:
        """The tags of one kind in a section, those that several steps have alike once; but of loads
        and motions, of which each step may have another, only where all have them.

        Raises InputError for springs of some of several steps, and for a relative condition."""
        top = _within(self.root, section, kind)
        by_step = [_within(step, section, kind) for step in self.steps]
        if len(by_step) < 2:
            return [*top, *(t for tags in by_step for t in tags)]
        signs = [[_signature(t) for t in tags] for tags in by_step]
        out = []
        for i, (tags, own) in enumerate(zip(by_step, signs, strict=True)):
            for t, sign in zip(tags, own, strict=True):
                if t.flag("relative"):
                    raise t.fault("<relative> other than 0 is not read in one of several steps")
                steps = tuple(k for k, other in enumerate(signs) if sign in other)
                alike = section not in LOADING and len(steps) == len(signs)
                if section == "Discrete" and not alike:
                    raise t.fault(
                        "springs of some of several steps are not read, nor does FEBio's manual "
                        "(4.1) name them among what a step may have: give them at the top level"
                    )
                if not alike and (section in LOADING or t.attributes.get("type") in MOTIONS):
                    steps = (i,)
                if not alike:
                    self.step[id(t)] = steps
                if i == steps[0]:
                    out.append(t)
                else:
                    t.pass_over()
        return [*top, *out]

    def windows(self, steps: tuple[Step, ...]) -> tuple[LoadCurve, ...]:
        """What is 1 while a step lasts, for each of several steps.  It rises and falls over the
        first increment of a step, so that at the ends of increments it is as in FEBio, which
        changes conditions at once."""
        if len(steps) < 2:
            return ()
        begins = [0.0, *(s.end for s in steps)]
        risen = [b + (s.end - b) / s.increments for b, s in zip(begins, steps, strict=False)]
        out = []
        for i in range(len(steps)):
            points = [(begins[i], 0.0), (risen[i], 1.0)] if i else []
            points += [(begins[i + 1], 1.0)] if not points or risen[i] < begins[i + 1] else []
            points += [(risen[i + 1], 0.0)] if i + 1 < len(steps) else []
            times, values = zip(*points, strict=True)
            out.append(LoadCurve(times, values))
        return tuple(out)

    def one(self, name: str) -> FebTag:
        return self.root.needed(name, "a section of every FEBio 4 file")


def _within(place: FebTag, section: str, kind: str) -> list[FebTag]:
    return [t for s in place.all(section) for t in s.all(kind)]


def _signature(t: FebTag) -> tuple[object, ...]:
    """What a condition says, but for its name."""
    said = sorted((k, v) for k, v in t.attributes.items() if k not in ("name", "id"))
    return t.name, tuple(said), " ".join(t.text.split()), *map(_signature, t.children)


def _check_header(root: FebTag) -> None:
    root.used = True
    version = root.attributes.get("version", "")
    if version != "4.0":
        raise root.fault(
            f"version {version!r} is not read, only 4.0; FEBio Studio exports older files as 4.0"
        )
    module = root.one("Module")
    if module is not None and module.attribute("type") != "solid":
        raise module.fault(f"the module {module.attribute('type')!r} is not read, only solid")
    for t in root.children:
        if t.name not in SECTIONS:
            raise t.fault(f"is no section of a FEBio 4 file; those are {', '.join(SECTIONS)}")
        if t.name in REFUSED and (t.children or t.rows or t.text.strip()):
            raise t.fault(f"<{t.name}> is not read, and without it the answer would be wrong")
        if "from" in t.attributes:
            raise t.fault("sections from other files are not followed; put them into this one")


def _check_initial(sections: _Sections, notes: list[str]) -> None:
    for t in sections.all("Initial", "ic"):
        if "velocity" not in t.attribute("type"):
            raise t.fault(f"the initial condition {t.attribute('type')!r} is not read")
        notes.append(f"{t.path} (line {t.line}): a static solve has no velocities")
        t.pass_over()


def _job(
    name: str, model: Model, parts: Parts, sections: _Sections, steps: tuple[Step, ...]
) -> Job:
    boundary, discrete = sections.all("Boundary", "bc"), sections.all("Discrete", "discrete")
    tied = read_ties(model, boundary)
    in_middle, middle_held = read_middle(model, parts.sheet, boundary)
    held, directors = read_displacements(model, boundary, tied)
    springs = read_springs(
        model,
        sections.all("Discrete", "discrete_material"),
        discrete,
        nodes_at_rest(model, boundary),
    )
    pairs = _contact_tags(model.mesh, sections.all("Contact", "contact"))
    sides = [_sides(model, parts, t, pair) for t, pair in pairs]
    touched: dict[int, list[Ints]] = {}
    for _, _, body, facets in sides:
        touched.setdefault(body, []).append(facets)
    bodies, vertices = read_bodies(model, parts, sections.all("Rigid", "rigid_bc"), touched)
    if any((s.body == len(bodies)).any() for s in springs):
        bodies += (Body(GROUND),)
    contacts = tuple(
        _contact(model, t, touching, np.searchsorted(vertices[body], triangles_of(facets)), body)
        for (t, _), (touching, _, body, facets) in zip(pairs, sides, strict=True)
    )
    loads = sections.all("Loads", "nodal_load")
    moves = is_in_middle(model, in_middle, boundary, discrete, loads)
    job = Job(
        parts.sheet,
        ties=tied,
        held=(*held, *middle_held),
        held_directors=directors,
        springs=springs,
        forces=read_forces(model, loads),
        pressures=read_pressures(model, parts, sections.all("Loads", "surface_load")),
        body_forces=read_body_forces(model, parts, sections.all("Loads", "body_load")),
        rigid_loads=read_rigid_loads(model, sections.all("Rigid", "rigid_load")),
        contacts=contacts,
        bodies=bodies,
        steps=steps,
        name=name,
    )
    # springs are as long as in the middle already
    return replace(move_to_mid_surface(job), springs=springs) if moves else job


def _steps(sections: _Sections, curves: Mapping[str, Curve | FebTag]) -> tuple[Step, ...]:
    controls = [
        (f"step {i + 1}", t, c) for i, t in enumerate(sections.steps) for c in t.all("Control")
    ]
    top = sections.root.one("Control")
    if top is not None and controls:
        raise top.fault("<Control> stands at the top level and in a step; keep one of them")
    if top is not None:
        controls = [("step 1", sections.root, top)]
    if not controls:
        raise sections.root.fault("<Control> is missing: the number and size of the time steps")
    out: list[Step] = []
    for name, holder, t in controls:
        if t.word("analysis", "STATIC").upper() not in ("STATIC", "STEADY-STATE"):
            raise t.fault("only a STATIC analysis is read")
        count, size = t.value("time_steps", 0.0), t.value("step_size", 0.0)
        if not (count >= 1 and count == round(count) and size > 0):
            raise t.fault("expected <time_steps> of at least 1 and a positive <step_size>")
        start = out[-1].end if out else 0.0
        end = start + count * size
        must = tuple(m for m in _must_points(t, curves) if start < m <= end)
        with t.naming_place():
            out.append(Step(holder.attributes.get("name", name), end, int(count), must))
    return tuple(out)


def _must_points(control: FebTag, curves: Mapping[str, Curve | FebTag]) -> list[float]:
    """The times of the load curve of the largest step, at which FEBio keeps a state."""
    for stepper in (c for c in control.children if c.name == "time_stepper"):
        for longest in (c for c in stepper.children if c.name == "dtmax"):
            curve = curves.get(longest.attributes.get("lc", "").strip())
            match curve:
                case LoadCurve():
                    longest.used = stepper.used = True
                    return sorted({*curve.times})
    return []


def _contact_tags(mesh: FebMesh, tags: list[FebTag]) -> list[tuple[FebTag, tuple[str, str]]]:
    out = []
    for t in tags:
        name = t.attribute("surface_pair")
        t.kind_of("contact", CONTACTS)
        if name not in mesh.pairs:
            raise t.fault(f"there is no SurfacePair {name!r}")
        out.append((t, mesh.pairs[name]))
    return out


def _sides(
    model: Model, parts: Parts, t: FebTag, pair: tuple[str, str]
) -> tuple[Ints, Ints, int, Ints]:
    """The elements (k,) of the sheet on one side of a pair, and how their facets are wound; the
    body, and the facets (nt, 4) on its side."""
    first, second = (model.mesh.surface_of(t, name) for name in pair)
    if (model.body[first.nodes] >= 0).all():
        first, second = second, first
    owner = np.unique(np.where(model.shell[second.nodes] >= 0, -1, model.body[second.nodes]))
    if len(owner) != 1 or owner[0] < 0:
        raise t.fault("contact is read between the shell and one rigid body only")
    return *match_facets(model, parts, t, first), int(owner[0]), second.pieces


def _contact(model: Model, t: FebTag, quads: Ints, triangles: Ints, body: int) -> ContactPair:
    if t.flag("tension"):
        raise t.fault("contact that also pulls (<tension>) is not read")
    for flipped in ("flip_primary", "flip_secondary"):
        if t.flag(flipped):
            raise t.fault(f"<{flipped}> other than 0 is not read; turn the surface's facets over")
    friction = t.value("fric_coeff", 0.0)
    if friction < 0:
        raise t.fault(f"the friction coefficient must be 0 or positive, got {friction:g}")
    back = t.flag("shell_bottom_primary") or t.flag("shell_bottom_secondary")
    automatic = t.flag("auto_penalty")
    units = model.units
    return ContactPair(
        t.attributes.get("name", t.attribute("surface_pair")),
        quads,
        np.full(len(quads), -1 if back else 1),
        body,
        triangles,
        t.value("penalty", 1.0) * (1.0 if automatic else units.force / units.length**3),
        automatic,
        friction,
        t.value("offset", 0.0) * units.length,
        model.steps_of(t),
        t.word("laugon", "PENALTY").upper() not in ("0", "PENALTY"),
    )
