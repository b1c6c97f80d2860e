"""Rigid bodies of a FEBio 4 file, and what each node of it belongs to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cosim.port import Array, Ints
from fe_solver.febio.materials import Material, find_material
from fe_solver.febio.mesh import SHELLS, FebMesh, Units, rows_of
from fe_solver.febio.parts import Parts
from fe_solver.febio.xml import FebTag
from fe_solver.job.curves import (
    Curve,
    Drive,
    Extension,
    FormulaCurve,
    Interpolation,
    LoadCurve,
    Outside,
    product_of,
    sum_of,
)
from fe_solver.job.job import RigidLoad
from fe_solver.supports import Body, Given

AXES = "xyz"
GROUND = "ground"


class Dof(NamedTuple):
    """A degree of freedom of a rigid body."""

    fixed: str
    """The tag that fixes it."""
    name: str
    kind: str
    """The condition that prescribes it."""

    def unit(self, units: Units) -> float:
        """One m or rad, whichever it is measured in, in the file's unit."""
        return 1.0 if self.kind == "rigid_rotation" else units.length


DOFS = (
    *(Dof(f"R{axis}_dof", axis, "rigid_displacement") for axis in AXES),
    *(Dof(f"R{turn}_dof", f"R{turn}", "rigid_rotation") for turn in "uvw"),
)
"""Displacements along x, y, z, then the components of the rotation vector."""
RIGID_LOADS = ("rigid_force", "rigid_moment")
FORCES, MOMENTS = ("Rx", "Ry", "Rz"), ("Ru", "Rv", "Rw")
RIGID_CONDITIONS = ("rigid_fixed", "rigid_displacement", "rigid_rotation")


@dataclass(frozen=True)
class Model:
    """What conditions of a file refer to."""

    mesh: FebMesh
    units: Units
    materials: list[Material]
    rigid: tuple[str, ...]
    """Names of the rigid materials in the order of the bodies."""
    shell: Ints
    """For each mesh node its index in the sheet, or -1."""
    body: Ints
    """For each mesh node its body, or -1."""
    curves: dict[str, Curve | FebTag]
    """The load curves by number; controllers of other kinds as their tags."""
    notes: list[str]
    windows: tuple[LoadCurve, ...] = ()
    """What is 1 while a step lasts, for each of several steps."""
    step: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    """By the `id` of a condition's tag in some of several steps, the numbers of these."""

    def drive(self, tag: FebTag, unit: float) -> Drive:
        """A number or a formula of the time, times a load curve."""
        return self.drives(tag, unit, 1)[0]

    def drives(self, tag: FebTag, unit: float, count: int, lasts: bool = True) -> list[Drive]:
        """So many numbers or formulas of the time, each times the load curve, while the step that
        the tag belongs to `lasts`, or at all times.  Raises InputError for any other kind of
        value."""
        out = []
        step = self.step_of(tag) if lasts else None
        window = None if step is None else self.windows[step]
        curve = product_of(self._controller(tag), window)
        for f in tag.formulas(count, ("t",)):
            if f.used:
                out.append(Drive(unit, product_of(FormulaCurve(f.text), curve)))
            else:
                out.append(Drive(float(f.value({})) * unit, curve))
        return out

    def steps_of(self, tag: FebTag) -> tuple[int, ...] | None:
        """The numbers of the steps that the condition which the tag is of lasts; None where it
        lasts at all times."""
        condition: FebTag | None = tag
        while condition is not None and id(condition) not in self.step:
            condition = condition.parent
        return None if condition is None else self.step[id(condition)]

    def step_of(self, tag: FebTag) -> int | None:
        """The number of the only step of a load or a motion; None where it lasts at all times."""
        steps = self.steps_of(tag)
        return None if steps is None else steps[0]

    def points(self, tag: FebTag) -> LoadCurve | None:
        """The points of the load curve that a tag's `lc` names.  Raises InputError for a
        controller by a formula."""
        curve = self._controller(tag)
        match curve:
            case LoadCurve() | None:
                return curve
        raise tag.fault("only a load curve with points is read here, not a formula")

    def _controller(self, tag: FebTag) -> Curve | None:
        """What the tag's `lc` names."""
        number = tag.attributes.get("lc", "").strip()
        if number in ("", "0"):
            return None
        curve = self.curves.get(number)
        if isinstance(curve, FebTag):
            raise curve.fault(
                f"a load controller of type {curve.attributes.get('type')!r} is not read, only "
                "loadcurve, math and math-interval"
            )
        if curve is None:
            raise tag.fault(f"there is no load controller {number}")
        return curve

    def body_of(self, tag: FebTag, name: str) -> int:
        """The body of a rigid material.  Raises InputError where there is none such."""
        m = find_material(tag, self.materials, name)
        if not m.rigid:
            raise tag.fault(f"the material {name!r} is not rigid")
        return self.rigid.index(m.name)

    def local(self, body: int, nodes: Ints) -> Array:
        """The places (k, 3) m of mesh nodes from the body's origin."""
        return self.mesh.points[nodes] * self.units.length - self.origin(body)

    def origin(self, body: int) -> Array:
        """The body's origin (3,) m."""
        if body == len(self.rigid):
            return np.zeros(3)
        centre = next(m.centre for m in self.materials if m.name == self.rigid[body])
        return np.zeros(3) if centre is None else centre * self.units.length


def read_curves(section: FebTag | None) -> dict[str, Curve | FebTag]:
    """Load curves by number; controllers of other kinds as their tags."""
    out: dict[str, Curve | FebTag] = {}
    for t in section.all("load_controller") if section is not None else []:
        number = t.attribute("id")
        if number in out:
            raise t.fault(f"two load controllers have the number {number}")
        if t.attribute("type") == "loadcurve":
            out[number] = read_curve(t)
        elif t.attribute("type") in ("math", "math-interval"):
            out[number] = _formula_curve(t)
        else:
            t.pass_over()
            out[number] = t
    return out


def read_curve(t: FebTag, across: float = 1.0, along: float = 1.0) -> LoadCurve:
    """The points of a tag, times scaled by `across` and values by `along`."""
    points = t.needed("points", "<pt>time,value</pt>...")
    _, line, values = rows_of(points, 2)
    back = np.flatnonzero(np.diff(values[:, 0]) < 0)
    if len(back):
        before, after = values[back[0] : back[0] + 2, 0]
        raise points.fault(
            f"a curve's points must ascend, but {after:g} follows {before:g}",
            int(line[back[0] + 1]),
        )
    between = t.known("interpolation", t.word("interpolate", "LINEAR").upper(), list(Interpolation))
    beyond = t.known("extension", t.word("extend", "CONSTANT").upper(), list(Extension))
    times, height = (values * (across, along)).T.tolist() if len(line) else ([], [])
    with t.naming_place():
        return LoadCurve(tuple(times), tuple(height), Interpolation(between), Extension(beyond))


def _formula_curve(t: FebTag) -> FormulaCurve:
    """A controller by a formula of t, over an interval of time if it is one."""
    formula = t.needed("math", "a formula of t")
    interval, ends = None, [Outside.CONSTANT, Outside.CONSTANT]
    if t.attribute("type") == "math-interval":
        low, high = t.needed("interval", "two times").numbers(2)
        interval = (low, high)
        for i, name in enumerate(("left_extend", "right_extend")):
            word = t.word(name, "constant").lower()
            word = list(Outside)[int(word)] if word in ("0", "1", "2") else word
            ends[i] = Outside(t.known(name, word, list(Outside)))
    with formula.naming_place():
        return FormulaCurve(" ".join(formula.text.split()), interval, *ends)


def owners(
    mesh: FebMesh,
    parts: Parts,
    boundary: list[FebTag],
    model_rigid: tuple[str, ...],
    materials: list[Material],
) -> Ints:
    """The body (n,) that each mesh node belongs to, by its rigid elements or, off the sheet, by a
    rigid boundary condition; -1 elsewhere.

    Raises InputError where two bodies claim a node."""
    out = np.full(len(mesh.points), -1)
    for i, name in enumerate(model_rigid):
        for block in parts.rigid[name]:
            nodes = np.unique(block.nodes)
            other = nodes[(out[nodes] >= 0) & (out[nodes] != i)]
            if len(other):
                raise block.tag.fault(
                    f"node {mesh.node_ids[other[0]]} belongs to {model_rigid[out[other[0]]]!r} "
                    f"and {name!r}: rigid bodies that share nodes are not read"
                )
            out[nodes] = i
    shell = np.zeros(len(out), dtype=bool)
    shell[parts.nodes] = True
    for t in boundary:
        if t.attribute("type") == "rigid":
            m = find_material(t, materials, t.word("rb", ""))
            nodes = mesh.held_nodes_of(t, t.attribute("node_set"))
            if m.name in model_rigid:
                out[nodes[~shell[nodes] & (out[nodes] < 0)]] = model_rigid.index(m.name)
    return out


def triangles_of(facets: Ints) -> Ints:
    """The triangles (nt, 3) of quads (k, 4), cut along the diagonal from the first corner; those
    that repeat their last node are one triangle each."""
    first, second = facets[:, [0, 1, 2]], facets[facets[:, 2] != facets[:, 3]][:, [0, 2, 3]]
    return np.concatenate([first, second])


def read_bodies(
    model: Model, parts: Parts, tags: list[FebTag], touched: dict[int, list[Ints]]
) -> tuple[tuple[Body, ...], list[Ints]]:
    """The bodies, and the mesh nodes of each one's vertices.  `touched` holds the facets (k, 4) of
    contact surfaces by body."""
    motion = _motions(model, tags)
    bodies, vertices = [], []
    for i, name in enumerate(model.rigid):
        shells = [b.pieces for b in parts.rigid[name] if b.kind in SHELLS]
        facets = np.concatenate([np.zeros((0, 4), dtype=np.intp), *shells, *touched.get(i, [])])
        nodes = np.unique(facets)
        own_facets = np.concatenate([np.zeros((0, 4), dtype=np.intp), *shells])
        triangles = np.searchsorted(nodes, triangles_of(own_facets))
        bodies.append(
            Body(
                name,
                model.origin(i),
                model.local(i, nodes),
                triangles,
                (motion[i].always[0], motion[i].always[1], motion[i].always[2]),
                (motion[i].always[3], motion[i].always[4], motion[i].always[5]),
                free=motion[i].free,
                motions=motion[i].by_step,
            )
        )
        vertices.append(nodes)
    return tuple(bodies), vertices


class _Motions(NamedTuple):
    """What gives the six motions of a body."""

    always: tuple[Drive, ...]
    """In all steps, where `by_step` is empty."""
    free: tuple[bool, ...]
    """Which equilibrium finds, likewise."""
    by_step: tuple[tuple[Drive | Given, ...], ...]
    """The drives of each of several steps, where some fix or free what others do not."""


def _motions(model: Model, tags: list[FebTag]) -> list[_Motions]:
    """Each body's displacement along x, y, z and the components of its rotation vector."""
    count = max(len(model.windows), 1)
    # by body, motion and step: what gives it there, and as one of several that follow each other
    given: dict[tuple[int, int], dict[int, tuple[Drive | Given, Drive]]] = {}
    for t in tags:
        body, step = model.body_of(t, t.word("rb", "")), model.step_of(t)
        motions: list[tuple[int, Drive | Given, Drive]] = []
        if t.kind_of("rigid condition", RIGID_CONDITIONS) == RIGID_CONDITIONS[0]:
            still = [i for i, d in enumerate(DOFS) if t.flag(d.fixed)]
            motions = [(i, Given.STAYS, Drive()) for i in still]
        else:
            motions = [_read_motion(model, t)]
        for i, own, joined in motions:
            by_step = given.setdefault((body, i), {})
            for s in range(count) if step is None else (step,):
                before = by_step.get(s, (Given.STAYS, Drive()))[0]
                if before is not Given.STAYS and own is not Given.STAYS:
                    raise t.fault(f"this motion of {model.rigid[body]!r} is prescribed twice")
                if own is not Given.STAYS or s not in by_step:
                    by_step[s] = own, joined
    return [_motions_of(model, body, given, count) for body in range(len(model.rigid))]


def _motions_of(
    model: Model,
    body: int,
    given: Mapping[tuple[int, int], Mapping[int, tuple[Drive | Given, Drive]]],
    count: int,
) -> _Motions:
    """What gives the motions of a body in so many steps.  Raises InputError as `_check_motions`."""
    by_dof = [given.get((body, i), {}) for i in range(6)]
    by_step = tuple(
        tuple(by_dof[i][s][0] if s in by_dof[i] else Given.FREE for i in range(6))
        for s in range(count)
    )
    _check_motions(model, model.rigid[body], by_step)
    always, differs = [], False
    for i, own in enumerate(by_dof):
        kinds = {_kind(step[i]) for step in by_step}
        differs = differs or len(kinds) > 1
        joined = list(dict.fromkeys(drive for _, drive in own.values()))
        always.append(sum_of(joined))
    free = tuple(m is Given.FREE for m in by_step[0])
    return _Motions(tuple(always), free, by_step if differs else ())


def _kind(motion: Drive | Given) -> type[Drive] | Given:
    """What a motion is, whatever it is driven by."""
    return Drive if isinstance(motion, Drive) else motion


def read_rigid_loads(model: Model, tags: list[FebTag]) -> tuple[RigidLoad, ...]:
    """Forces and moments on bodies, at their centres of mass, along the world's axes; a force of
    `load_type` 1 turns with its body (FEBioMech/FERigidForce.cpp, FERigidBodyForce).

    Raises InputError for a load that is not read."""
    out = []
    for t in tags:
        is_force = t.kind_of("rigid load", RIGID_LOADS) == RIGID_LOADS[0]
        body, names = model.body_of(t, t.word("rb", "")), FORCES if is_force else MOMENTS
        dof, kind = t.word("dof", ""), t.word("load_type", "0").upper()
        if dof not in names:
            raise t.fault(f"expected <dof> with one of {', '.join(names)}")
        if kind not in ("0", "LOAD", *(("1", "FOLLOW") if is_force else ())):
            raise t.fault(
                f"<load_type> {kind} is not read: a force is 0 (it keeps its direction) or 1 (it "
                "turns with the body), a moment is 0"
            )
        if t.flag("relative"):
            raise t.fault("<relative> other than 0 is not read")
        units = model.units
        unit = units.force if is_force else units.force * units.length
        drive = model.drive(t.needed("value", "a number"), unit)
        x, y, z = (drive if name == dof else Drive() for name in names)
        if is_force:
            out.append(RigidLoad(body, force=(x, y, z), follows=kind in ("1", "FOLLOW")))
        else:
            out.append(RigidLoad(body, moment=(x, y, z)))
    return tuple(out)


def _read_motion(model: Model, t: FebTag) -> tuple[int, Drive, Drive]:
    """Which motion a condition prescribes, at all times and while its step lasts."""
    names = {d.name: i for i, d in enumerate(DOFS) if d.kind == t.attribute("type")}
    dof, value = t.word("dof", ""), t.one("value")
    if dof not in names or value is None:
        raise t.fault(f"expected <dof> with one of {', '.join(names)}, and <value>")
    t.all("relative")
    unit = DOFS[names[dof]].unit(model.units)
    return names[dof], model.drives(value, unit, 1, lasts=False)[0], model.drive(value, unit)


def _check_motions(model: Model, name: str, by_step: tuple[tuple[Drive | Given, ...], ...]) -> None:
    m = next(m for m in model.materials if m.name == name)
    for step, motions in enumerate(by_step, 1):
        where = f" in step {step}" if len(by_step) > 1 else ""
        free = [d.name for d, own in zip(DOFS, motions, strict=True) if own is Given.FREE]
        if free and m.centre is None:
            raise m.tag.fault(
                f"the rigid body {name!r} is free in {', '.join(free)}{where}: <center_of_mass>, "
                "at which its loads act and about which it turns, is missing"
            )
        turns = {_kind(own) for own in motions[3:]}
        if {Drive, Given.FREE} <= turns:
            raise m.tag.fault(
                f"the rotation of the rigid body {name!r} is prescribed in part and free in "
                f"part{where}, which FEBio ends with an error, too: fix or prescribe all of Ru, Rv "
                "and Rw, or prescribe none"
            )
        if m.centre is None and any(isinstance(d, Drive) and d.value for d in motions[3:]):
            raise m.tag.fault(f"the body {name!r} turns: <center_of_mass>, about which, is missing")
