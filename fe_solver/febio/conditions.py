"""What holds and loads the sheet of a FEBio 4 file: the sections Boundary, Loads and Discrete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import NamedTuple

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements.mesh_geometry import element_areas, node_means
from fe_solver.febio.bodies import AXES, Model, read_curve
from fe_solver.febio.mesh import Facets
from fe_solver.febio.middle import CONSTRAINT
from fe_solver.febio.parts import Parts
from fe_solver.febio.xml import FebTag
from fe_solver.job.curves import Curve, Drive, sum_of
from fe_solver.job.job import BodyForce, HeldDirector, NodalForce, PrescribedDisplacement, Pressure
from fe_solver.sheet import Sheet
from fe_solver.supports import SpringLaw, SpringSet, Tied

SIZE_OF_FORCE = 3
NODAL_LOADS = ("nodal_force", "nodal_load")
SUPPORTS = (
    *("rigid", "zero displacement", "prescribed displacement", "zero shell displacement"),
    CONSTRAINT,
)
BODY_LOADS = ("const", "body force", "non-const")
SAME_AREA = 1e-6
"""Share of an element's area: the areas of its faces that differ by less are alike."""
SPRINGS = ("linear spring", "tension-only linear spring", "nonlinear spring")


def _on_sheet(model: Model, tag: FebTag, nodes: Ints, what: str) -> Ints:
    """Indices in the sheet; what lies off it is noted."""
    index = model.shell[nodes]
    if (index < 0).any():
        model.notes.append(
            f"{tag.path} (line {tag.line}): {what} of {(index < 0).sum()} nodes that are not on "
            "the shell, such as those of rigid bodies, makes no difference"
        )
    return index[index >= 0]


def read_ties(model: Model, tags: list[FebTag]) -> tuple[Tied, ...]:
    """Rigid boundary conditions, and shell nodes that are also a rigid element's."""
    out = []
    for t in _conditions(tags, "rigid"):
        body = model.body_of(t, t.word("rb", ""))
        nodes = model.shell[model.mesh.held_nodes_of(t, t.attribute("node_set"))]
        if (nodes >= 0).any():
            clamped = t.value("clamp_shells", 1.0) != 0
            out.append(Tied(nodes[nodes >= 0], body, clamped, _name(t), model.steps_of(t)))
    shared = (model.shell >= 0) & (model.body >= 0)
    for body in np.unique(model.body[shared]):
        out.append(Tied(model.shell[shared & (model.body == body)], int(body)))
    return tuple(out)


def _name(t: FebTag) -> str:
    return t.attributes.get("name", "").strip()


def _conditions(tags: list[FebTag], kind: str) -> list[FebTag]:
    """Boundary conditions of a type."""
    return [t for t in tags if t.attribute("type") == kind]


def nodes_at_rest(model: Model, tags: list[FebTag]) -> Ints:
    """Mesh nodes of which all three displacements are zero."""
    held = np.zeros((3, len(model.shell)), dtype=bool)
    for t in _conditions(tags, "zero displacement"):
        if model.step_of(t) is not None:
            continue
        nodes = model.mesh.held_nodes_of(t, t.attribute("node_set"))
        for i, axis in enumerate(AXES):
            held[i, nodes] |= t.flag(f"{axis}_dof")
    return np.flatnonzero(held.all(axis=0))


def read_displacements(
    model: Model, tags: list[FebTag], tied: tuple[Tied, ...]
) -> tuple[tuple[PrescribedDisplacement, ...], tuple[HeldDirector, ...]]:
    """Given displacements of nodes, and of directors through FEBio's back faces.

    Raises InputError for a condition that is not read."""
    for t in tags:
        t.kind_of("boundary condition", SUPPORTS)
    always = [t.nodes for t in tied if t.steps is None]
    taken = np.concatenate([np.zeros(0, dtype=np.intp), *always])
    held, stepped = [], list[_Stepped]()
    for t in _conditions(tags, "zero displacement"):
        nodes = _free(model, t, taken)
        still = [
            PrescribedDisplacement(nodes, i, name=_name(t))
            for i, axis in enumerate(AXES)
            if t.flag(f"{axis}_dof")
        ]
        held += still if model.step_of(t) is None else []
        stepped += [_Stepped(t, h, Drive()) for h in still if model.step_of(t) is not None]
    for t in _conditions(tags, "prescribed displacement"):
        dof, value = t.word("dof", ""), t.one("value")
        if dof not in tuple(AXES) or value is None:
            raise t.fault("expected <dof> with x, y or z, and <value>")
        t.all("relative")
        drive = model.drive(value, model.units.length)
        moved = PrescribedDisplacement(_free(model, t, taken), AXES.index(dof), drive, _name(t))
        if model.step_of(t) is None:
            held.append(moved)
        else:
            (bare,) = model.drives(value, model.units.length, 1, lasts=False)
            stepped.append(_Stepped(t, moved, bare))
    held = [h for h in [*held, *_join_steps(model, stepped)] if len(h.nodes)]
    return tuple(held), _read_director_supports(model, tags, held, taken)


class _Stepped(NamedTuple):
    """A displacement that one step gives."""

    tag: FebTag
    held: PrescribedDisplacement
    """While its step lasts."""
    bare: Drive
    """At all times, m."""


def _join_steps(model: Model, stepped: list[_Stepped]) -> list[PrescribedDisplacement]:
    """Displacements that single steps give: where each does, from one step to the next; otherwise
    as conditions of their steps.  Raises InputError for one that a step gives twice."""
    by_node: dict[tuple[int, int], dict[int, _Stepped]] = {}
    for s in stepped:
        step = model.step_of(s.tag)
        assert step is not None
        for n in s.held.nodes.tolist():
            own = by_node.setdefault((s.held.component, n), {})
            if step in own and own[step].bare != s.bare:
                raise s.tag.fault("it gives a displacement that this step gives otherwise too")
            own[step] = s
    together: dict[tuple[int, Drive, str, tuple[int, ...] | None], list[int]] = {}
    for (component, n), own in by_node.items():
        if len(own) == len(model.windows):
            drive = sum_of([own[i].held.displacement for i in sorted(own)])
            name = _name(own[max(own)].tag)
            together.setdefault((component, drive, name, None), []).append(n)
            continue
        for step, s in own.items():
            key = (component, s.bare, _name(s.tag), (step,))
            together.setdefault(key, []).append(n)
    return [PrescribedDisplacement(np.array(n), *held) for held, n in together.items()]


def _free(model: Model, t: FebTag, taken: Ints) -> Ints:
    """Nodes of a condition on the sheet that are not tied to a body."""
    nodes = _on_sheet(
        model, t, model.mesh.held_nodes_of(t, t.attribute("node_set")), "this condition"
    )
    twice = np.isin(nodes, taken)
    if twice.any():
        model.notes.append(
            f"{t.path} (line {t.line}): {twice.sum()} of its nodes are rigid with a body, which "
            "goes first"
        )
    return nodes[~twice]


def _read_director_supports(
    model: Model, tags: list[FebTag], held: list[PrescribedDisplacement], taken: Ints
) -> tuple[HeldDirector, ...]:
    out = []
    for t in _conditions(tags, "zero shell displacement"):
        nodes, steps = _free(model, t, taken), model.steps_of(t)
        for i, axis in enumerate(AXES):
            if t.flag(f"s{axis}_dof") and len(nodes):
                if not np.isin(nodes, _at_rest(held, i, steps or range(len(model.windows)))).all():
                    raise t.fault(
                        f"the back face is held along {axis} (s{axis}_dof) where the front face is "
                        f"free ({axis}_dof): the solver's shell has a director for its back face, "
                        "so that both are held together or neither; set "
                        f"{axis}_dof to 1 too, or s{axis}_dof to 0"
                    )
                out.append(HeldDirector(nodes, i, _name(t), steps))
    return tuple(out)


def _at_rest(held: list[PrescribedDisplacement], component: int, steps: Sequence[int]) -> Ints:
    """The nodes (k,) whose displacement along an axis is zero in each of some steps; where there is
    but one step, `steps` is empty."""
    still = [h for h in held if h.component == component and h.displacement == Drive()]
    none, out = np.zeros(0, dtype=np.intp), list[Ints]()
    for step in steps or (0,):
        fronts = [h.nodes for h in still if h.steps is None or step in h.steps]
        out.append(np.concatenate([none, *fronts]))
    return reduce(np.intersect1d, out)


def read_forces(model: Model, tags: list[FebTag]) -> tuple[NodalForce, ...]:
    """The dead loads on nodes of the sheet, of either face.  Raises InputError for a load that is
    not read."""
    out = []
    for t in tags:
        kind = t.kind_of("nodal load", NODAL_LOADS)
        nodes = model.mesh.nodes_of(t, t.attribute("node_set"))
        if t.flag("relative"):
            raise t.fault("<relative> other than 0 is not read")
        if kind == "nodal_load":
            dof, scale = t.word("dof", ""), t.needed("scale", "a number")
            if dof not in tuple(AXES):
                raise t.fault("expected <dof> with x, y or z")
            force = model.drive(scale, model.units.force)
            drives = [force if axis == dof else Drive() for axis in AXES]
        else:
            value = t.needed("value", "three components")
            drives = model.drives(value, model.units.force, SIZE_OF_FORCE)
        on_sheet = _on_sheet(model, t, nodes, "the force")
        if len(on_sheet):
            out += [NodalForce(on_sheet, force, curve) for force, curve in _by_curve(drives)]
    return tuple(out)


def _by_curve(drives: list[Drive]) -> list[tuple[Array, Curve | None]]:
    """The components (3,) that share a curve, with it; components that are zero go with any."""
    curves = list(dict.fromkeys(d.curve for d in drives if d.value)) or [drives[0].curve]
    return [(np.array([d.value * (d.curve == c) for d in drives]), c) for c in curves]


def match_facets(model: Model, parts: Parts, tag: FebTag, facets: Facets) -> tuple[Ints, Ints]:
    """The elements (k,) of the sheet that the facets are; and 1 where the facet is wound alike,
    else -1.  Raises InputError for a facet that is none."""
    quads, wanted = parts.corners, facets.corners
    both = np.concatenate([quads, wanted])
    both[both[:, 2] == both[:, 3], 3] = -1
    both.sort(axis=1)
    _, number = np.unique(both, axis=0, return_inverse=True)
    number = number.reshape(-1)
    order = np.argsort(number[: len(quads)], kind="stable")
    sought = number[len(quads) :]
    at = np.searchsorted(number[: len(quads)], sought, sorter=order)
    quad = order[np.minimum(at, len(order) - 1)]
    wrong = np.flatnonzero(number[quad] != sought)
    if len(wrong):
        ids = model.mesh.node_ids[wanted[wrong[0]]]
        raise tag.fault(f"the facet with nodes {ids.tolist()} is no element of the shell")
    sign = np.where(_turn(model, wanted, quads[quad]) > 0, 1, -1)
    elements, which = parts.elements_of(quad)
    return elements, sign[which]


def _turn(model: Model, a: Ints, b: Ints) -> Array:
    """The scalar product (k,) of the normals of two facets."""
    p, q = model.mesh.points[a], model.mesh.points[b]
    normals = [np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) for x in (p, q)]
    return np.asarray(np.einsum("ki,ki->k", *normals))


def read_pressures(model: Model, parts: Parts, tags: list[FebTag]) -> tuple[Pressure, ...]:
    """FEBio's positive pressure pushes against the normal of the facets.

    Raises InputError for a load that is not read."""
    out = []
    for t in tags:
        kind, value = t.attribute("type"), t.one("pressure")
        if kind != "pressure" or value is None:
            raise t.fault(f"the surface load {kind!r} is not read, only pressure with <pressure>")
        t.all("symmetric_stiffness")
        facets = model.mesh.surface_of(t, t.attribute("surface"))
        quads, sign = match_facets(model, parts, t, facets)
        drive = model.drive(value, model.units.stress)
        if t.flag("shell_bottom"):
            sign = -sign
            _tell_back_face(model, parts.sheet, quads, t)
        out.append(Pressure(quads, sign, drive, t.flag("linear")))
    return tuple(out)


def _tell_back_face(model: Model, sheet: Sheet, quads: Ints, t: FebTag) -> None:
    """Note by how much the area of the back faces of quads (k,) differs from that of the nodes,
    where it does."""
    back = (
        sheet.points
        + 2 * node_means(sheet.height, sheet.quads, len(sheet.points))[:, None] * sheet.directors
    )
    front, behind = (element_areas(x, sheet.quads[quads]) for x in (sheet.points, back))
    off = float(np.abs(behind / front - 1).max(initial=0.0))
    if off > SAME_AREA:
        model.notes.append(
            f"{t.path} (line {t.line}): the pressure on the back face acts on the nodes' face, "
            f"whose area differs by up to {100 * off:.2g} %"
        )


def read_body_forces(model: Model, parts: Parts, tags: list[FebTag]) -> tuple[BodyForce, ...]:
    """The forces on the mass of the sheet's elements: FEBio's is the material's density times the
    body load, *against* it (FEBioMech/FEElasticShellDomain.cpp takes it off the residual as it
    does the internal forces, NIKE3D's convention), although its user manual (3.13, Body Loads)
    writes the balance with the opposite sign.

    Raises InputError for a load that is not read, and where a density is not told."""
    out = []
    for t in tags:
        kind = t.kind_of("body load", BODY_LOADS)
        if kind == "body force":
            drives = model.drives(t.needed("force", "three components"), model.units.length, 3)
        else:
            children = [t.one(axis) for axis in AXES]
            drives = [
                Drive() if c is None else model.drive(c, model.units.length) for c in children
            ]
        quads = np.arange(len(parts.density))
        if "elem_set" in t.attributes:
            chosen = model.mesh.elements_of(t, t.attributes["elem_set"])
            quads = np.flatnonzero(np.isin(parts.sheet.element_ids, chosen))
        density = parts.density[quads] * model.units.density
        if not (np.isfinite(density) & (density >= 0)).all():
            raise t.fault(
                "a mixture of several densities, or a negative one, has no weight that is read; "
                "give one density to the material"
            )
        x, y, z = (replace(d, value=-d.value) for d in drives)
        model.notes.append(
            f"{t.path} (line {t.line}): the force on a mass is against the load's vector, as in "
            "FEBio: a positive z pulls along -z"
        )
        out.append(BodyForce(quads, density, (x, y, z)))
    return tuple(out)


def read_springs(
    model: Model, materials: list[FebTag], sets: list[FebTag], fixed: Ints
) -> tuple[SpringSet, ...]:
    """Discrete sets with their materials; ends on rigid bodies become points of those, ends on the
    mesh nodes `fixed` off the sheet points of the ground (the body after the last).

    Raises InputError for a law that is not read and for an end that nothing holds."""
    laws: dict[str, SpringLaw] = {}
    for t in materials:
        spring_law = _spring_law(model, t)
        laws[t.attribute("id")] = laws[t.attributes.get("name", "")] = spring_law
    out = []
    for t in sets:
        name, law = t.attribute("discrete_set"), laws.get(t.attribute("dmat"))
        if law is None:
            raise t.fault(f"there is no discrete_material {t.attribute('dmat')!r}")
        if name not in model.mesh.discrete:
            raise t.fault(f"there is no DiscreteSet {name!r}")
        springs = _spring_set(model, t, name, law, fixed)
        if len(springs.nodes):
            out.append(springs)
    return tuple(out)


def _spring_law(model: Model, t: FebTag) -> SpringLaw:
    kind, units = t.kind_of("spring", SPRINGS), model.units
    if kind != SPRINGS[-1]:
        stiffness = t.needed("E").number() * units.force / units.length
        if stiffness < 0:
            raise t.fault("the stiffness E must not be negative")
        return SpringLaw(stiffness, kind.startswith("tension-only"))
    if t.word("measure", "elongation") != "elongation":
        raise t.fault("a nonlinear spring's <measure> is read as elongation only")
    force, scale = t.needed("force"), t.value("scale", 1.0) * units.force
    if force.attributes.get("type") == "point":
        return SpringLaw(0.0, False, read_curve(force, units.length, scale))
    curve = model.points(force)
    if curve is None:
        raise force.fault("expected a force of type point, or a load curve lc")
    scale *= force.numbers(1)[0]
    times = tuple(x * units.length for x in curve.times)
    values = tuple(x * scale for x in curve.values)
    return SpringLaw(0.0, False, type(curve)(times, values, curve.interpolation, curve.extension))


def _spring_set(model: Model, t: FebTag, name: str, law: SpringLaw, fixed: Ints) -> SpringSet:
    pairs = model.mesh.discrete[name]
    pairs = np.where((model.shell[pairs[:, :1]] >= 0), pairs, pairs[:, ::-1])
    off = model.shell[pairs[:, 0]] < 0
    if off.any():
        model.notes.append(
            f"{t.path} {name!r} (line {t.line}): {off.sum()} springs that do not reach the shell "
            "are left out"
        )
    near, far = pairs[~off].T
    on_sheet = model.shell[far] >= 0
    body = np.where(on_sheet, -1, model.body[far])
    body[~on_sheet & (body < 0) & np.isin(far, fixed)] = len(model.rigid)
    alone = near[near == far]
    if len(alone):
        raise t.fault(
            f"the spring set {name!r} joins node {model.mesh.node_ids[alone[0]]} to itself"
        )
    loose = far[~on_sheet & (body < 0)]
    if len(loose):
        raise t.fault(
            f"the spring set {name!r} ends at node {model.mesh.node_ids[loose[0]]}, which belongs "
            "to no shell and no rigid body and is not held in x, y and z"
        )
    points = model.mesh.points * model.units.length
    origin = np.array([model.origin(b) if b >= 0 else np.zeros(3) for b in body]).reshape(-1, 3)
    return SpringSet(
        name,
        law,
        model.shell[near],
        body,
        np.where(on_sheet[:, None], 0.0, points[far] - origin),
        model.shell[far],
        np.linalg.norm(points[far] - points[near], axis=1),
    )
