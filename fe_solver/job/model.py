"""A Job as the shell model of the solver: what holds, loads and touches the sheet at a time.

Contact is our own: a node of a pair presses on the signed distance of the body's surface, closed
where it is open, with a stiffness taken from the sheet; or, where the pair states its penalty, with
that, at points within its elements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.array_cache import user_cache
from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.elements.kinds import kind_of
from fe_solver.elements.mesh_geometry import node_areas, node_means
from fe_solver.forces.contact import Contact, needed_distance
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.guides import Guides
from fe_solver.forces.loads import pressure_forces
from fe_solver.job.checks import check_job
from fe_solver.job.curves import Curve, Drive
from fe_solver.job.free_bodies import load_wrenches
from fe_solver.job.job import Job
from fe_solver.job.phases import Phase
from fe_solver.sheet import Sheet
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions
from fe_solver.solver.newton_step import displacements
from fe_solver.supports import (
    STILL,
    ZERO,
    Body,
    ContactPair,
    SpringSet,
    links_of,
    springs_of,
    ties_of,
)
from fe_solver.surfaces.closing import close_surface
from fe_solver.surfaces.spline_distance import SplineDistance, Surface

NO_TENDON = np.zeros(0)
SAME_DIRECTOR = 1e-6
"""By which a component of a director may differ and be the same."""
BEYOND = 1e-3
"""m past what contact needs that a baked distance reaches."""


@dataclass(frozen=True)
class JobOptions:
    """How a job is solved."""

    penetration: float | None = 2e-6
    """m, the largest that a solved state may have (by the augmented Lagrangian); None leaves it to
    the contact's stiffness."""
    contact_factor: float = 1.0
    """The contact's stiffness over the sheet's membrane modulus over its thickness, N/m3: about one
    keeps the tangent well conditioned, and the penetration is the sheet's own compression."""
    smoothing: float = 2e-6
    """m within which contact begins."""
    spacing: float = 0.25e-3
    """m, of the grids that bodies' distances are baked on."""
    cached: bool = True
    """Whether those grids are kept in the user's cache folder."""
    turn: float = 0.1
    """rad that a body turns at most in a step in time."""
    shortest: float = 1e-3
    """Least length of a step in time, of the time that the step of the job takes."""
    increments: bool = False
    """Whether each step takes at least the increments that it names; one with friction does."""
    newton: NewtonOptions = field(
        default_factory=lambda: NewtonOptions(tolerance=1e-8, max_iterations=100)
    )

    def __post_init__(self) -> None:
        for name in ("penetration", "contact_factor", "smoothing", "spacing", "turn", "shortest"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} = {value:g}: expected more than zero, and finite")


@dataclass(frozen=True)
class Coming:
    """What the begin of a phase changes, which comes in over its first increment."""

    fade: Curve
    """What is left of it."""
    off: Array
    """(k, 3) m by which guided nodes are off their places, in the bodies' frames."""
    force: Array
    """(n, 3) N with which released conditions still act on the nodes."""
    couple: Array
    """(n, 3) N m, on the directors."""
    wrench: Array
    """(nb, 6) N and N m, on the bodies."""


@dataclass(frozen=True)
class JobModel:
    """The model of a job's shell and of its bodies."""

    job: Job
    base: ShellModel
    """The model at time 0 without loads."""
    bodies: tuple[Body, ...]
    """The job's own, then those that carry nodes whose displacement is given."""
    coming: Coming | None = None
    """What a phase that others go before sets and releases at its begin."""

    def start(self) -> Configuration:
        """The sheet as the job has it, its bodies where they are at time 0."""
        origins = np.array([b.origin for b in self.bodies]).reshape(-1, 3)
        upright = np.tile(np.eye(3), (len(origins), 1, 1))
        bare = Configuration(self.base.reference, self.base.directors, origins, upright)
        return self.base.move_bodies(bare, *self.poses(0.0))

    def poses(self, time: float) -> tuple[Array, Array]:
        """Positions (nb, 3) m and rotations (nb, 3, 3) of the bodies."""
        return body_poses(self.bodies, time)

    @property
    def motions(self) -> NDArray[np.bool_]:
        """Which of the six motions (nb, 6) of each body equilibrium finds."""
        return np.array([b.free for b in self.bodies], dtype=bool).reshape(-1, 6)

    def body_loads(self, time: float, rotation: Array) -> tuple[Array, Array]:
        """See `load_wrenches`; with what released motions still bear."""
        wrench, follower = load_wrenches(self.job.rigid_loads, time, rotation)
        if self.coming is not None:
            wrench += self.coming.fade.at(time) * self.coming.wrench
        return wrench, follower

    def at(self, time: float, contacts: tuple[Contact, ...] | None = None) -> ShellModel:
        """The model under the loads of a time, with the contacts in another state if given; it
        shares its sparsity with all others."""
        kept = self.base.contacts if contacts is None else contacts
        dead, pressure = dead_loads(self.job, time), follower_pressure(self.job, time)
        couples, weight = None, body_loads(self.job, time)
        if weight is not None:
            tables, quads = self.base.tables, self.job.sheet.quads
            np.add.at(dead, quads, weight)
            couples = np.zeros_like(dead)
            np.add.at(couples, quads, (tables.height * tables.mitre)[:, :, None] * weight)
        if self.coming is None:
            return self.base.with_changes(
                dead=dead, couples=couples, pressure=pressure, contacts=kept
            )
        left, guides = self.coming.fade.at(time), self.base.guides
        dead += left * self.coming.force
        more = left * self.coming.couple
        return self.base.with_changes(
            dead=dead,
            couples=more if couples is None else couples + more,
            pressure=pressure,
            contacts=kept,
            guides=replace(guides, origin=guides.origin + left * self.coming.off),
        )


def body_poses(bodies: Sequence[Body], time: float) -> tuple[Array, Array]:
    """Positions (nb, 3) m and rotations (nb, 3, 3) of bodies at a time."""
    poses = [b.pose(time) for b in bodies]
    if not poses:
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    return np.stack([p for p, _ in poses]), np.stack([r for _, r in poses])


def body_loads(job: Job, time: float) -> Array | None:
    """Return the forces on the mass of the elements at a time, (ne, k, 3) N, which act on the
    mid-surface below or above each node; None where there are none."""
    if not job.body_forces:
        return None
    out = np.zeros((*job.sheet.quads.shape, 3))
    for b in job.body_forces:
        size = np.array([d.at(time) for d in b.acceleration])
        out[b.quads] += (b.density[:, None] * job.sheet.volumes[b.quads])[:, :, None] * size
    return out


def dead_loads(job: Job, time: float) -> Array:
    """Return the loads on the nodes at a time that keep their direction, (n, 3) N, but for those on
    the elements' mass."""
    out = np.zeros_like(job.sheet.points)
    for load in job.forces:
        scale = 1.0 if load.curve is None else load.curve.at(time)
        np.add.at(out, load.nodes, scale * load.force)
    for p in (p for p in job.pressures if p.dead):
        size = p.pressure.at(time) * p.sign.astype(float)
        force = pressure_forces(job.sheet.points[job.sheet.quads[p.quads]], size)
        np.add.at(out, job.sheet.quads[p.quads], force)
    return out


def follower_pressure(job: Job, time: float) -> Array | None:
    """Return the pressures at a time that follow the quads, against their normals, (ne,) Pa; None
    where none do."""
    live = [p for p in job.pressures if not p.dead]
    out = np.zeros(len(job.sheet.quads))
    for p in live:
        np.add.at(out, p.quads, p.sign * p.pressure.at(time))
    return out if live else None


def job_model(job: Job, options: JobOptions) -> JobModel:
    """Make the solver's model of a job.

    Raises InputError for what `check_job` finds, for conditions that contradict each other, and
    for surfaces that have no inside."""
    check_job(job)
    check_supports(job)
    origins = np.array([b.origin for b in job.bodies]).reshape(-1, 3)
    upright = np.tile(np.eye(3), (len(origins), 1, 1))
    rest = Configuration(job.sheet.points, job.sheet.directors, origins, upright)
    return _model_from(job, rest, options, {})


def next_model(
    phase: Phase, last: Configuration, kept: Mapping[int, Contact], options: JobOptions
) -> tuple[JobModel, ShellModel, Configuration]:
    """The model of a phase that goes on from the last configuration of another, whose contacts
    `kept` are by the number of their pair; its shell at the begin, and the configuration, which is
    an equilibrium of it.

    Raises InputError for a director that is to be held where it is not, and for friction whose
    memory of the way does not fit the phase."""
    job, count, time = phase.job, len(phase.job.bodies), phase.begin
    _check_directors(job, last.d)
    bodies = phase.bodies(last.position[:count], last.rotation[:count])
    job = replace(job, bodies=bodies)
    at = Configuration(last.x, last.d, *body_poses(bodies, time))
    own = {i: kept[k] for i, k in enumerate(phase.pairs) if k in kept}
    model = _model_from(job, at, options, own)
    c, g = Configuration(last.x, last.d, *model.poses(time)), model.base.guides
    placed = model.base.move_bodies(c, c.position, c.rotation)
    off = np.einsum("kji,kj->ki", c.rotation[g.body], (c.x - placed.x)[g.node])
    nothing, still = np.zeros_like(c.x), np.zeros((len(c.position), 6))
    model = replace(model, coming=Coming(phase.fade, off, nothing, nothing, still))
    shell = model.at(time)
    left = shell.evaluate(c, NO_TENDON, tangent=False)
    borne = np.asarray(sum(wrenches(shell, c, left, NO_TENDON).values()))
    unborne = -borne - model.body_loads(time, c.rotation)[0]
    loose = np.zeros(shell.pattern.size)
    loose[shell.free] = left.reduced[shell.free]
    force, couple = displacements(left.bases, loose)
    wrench = np.where(model.motions, unborne, 0.0)
    model = replace(model, coming=Coming(phase.fade, off, force, couple, wrench))
    return model, model.at(time), c


def _check_directors(job: Job, d: Array) -> None:
    """Check that held directors (n, 3) have the components that they keep.  Raises InputError."""
    tied = [np.zeros(0, dtype=np.intp), *[t.nodes for t in job.ties]]
    for h in job.held_directors:
        nodes = np.setdiff1d(h.nodes, np.concatenate(tied))
        off = np.abs((d - job.sheet.directors)[nodes, h.component])
        if (off > SAME_DIRECTOR).any():
            raise InputError(
                f"{job.name}: the director of {job.sheet.node(nodes[off.argmax()])} is held from a "
                "step on before which it has turned, and our own shell cannot turn it back; hold "
                "it in all steps, or solve with --element q4ans"
            )


def _model_from(
    job: Job, at: Configuration, options: JobOptions, kept: Mapping[int, Contact]
) -> JobModel:
    """The model of a job whose sheet is tied to its bodies where it is `at`, with the contacts
    `kept` by number where their nodes are the same."""
    sheet = job.sheet
    ties = ties_of(job.ties, at.x, at.d, at.position, at.rotation)
    guides, carriers = _guides(job, at, ties.node)
    bodies = (*job.bodies, *carriers)
    given = np.union1d(ties.node, guides.node[guides.held.all(axis=1)])
    base = sheet.model(
        springs=springs_of(job.springs),
        ties=ties,
        guides=guides,
        share=np.zeros((0, len(guides.node))),
        contacts=_contacts(job, given, options, kept),
        bodies=tuple(b.name for b in bodies),
        links=links_of(job.springs),
        groups=tuple(s.name for s in job.springs),
    )
    return JobModel(job, base, bodies)


def check_supports(job: Job) -> None:
    """Check what holds the nodes.  Raises InputError where one is tied twice, or a displacement is
    given twice and not alike."""
    tied = [np.zeros(0, dtype=np.intp), *[t.nodes for t in job.ties]]
    unique, times = np.unique(np.concatenate(tied), return_counts=True)
    if (times > 1).any():
        raise InputError(
            f"{job.name}: {job.sheet.node(unique[times > 1][0])} is tied twice; tie each node to "
            "one body"
        )
    _drives(job, unique)


def _guides(job: Job, at: Configuration, tied: Ints) -> tuple[Guides, tuple[Body, ...]]:
    """Nodes that are held in part, and the bodies that carry them besides the job's own, which are
    where they are `at`."""
    hinges = [t for t in job.ties if not t.clamped]
    pinned = np.concatenate([np.zeros(0, dtype=np.intp), *[t.nodes for t in hinges]])
    drives = _drives(job, np.union1d(tied, pinned))
    moves = list(dict.fromkeys(_whole(by_axis) for by_axis in drives.values()))
    carriers = tuple(
        Body("ground" if m == STILL else f"displacement {i + 1}", displacement=m)
        for i, m in enumerate(moves)
    )
    held = [(int(n), t.body, [True, True, True]) for t in hinges for n in t.nodes]
    held += [
        (n, len(job.bodies) + moves.index(_whole(by_axis)), [d is not None for d in by_axis])
        for n, by_axis in drives.items()
    ]
    node, body = (np.array([h[i] for h in held], dtype=np.intp) for i in (0, 1))
    fixed = np.array([h[2] for h in held], dtype=bool).reshape(-1, 3)
    origin = job.sheet.points[node].copy()
    own = body < len(job.bodies)
    on = body[own]
    arm = at.x[node[own]] - at.position[on]
    origin[own] = np.einsum("kji,kj->ki", at.rotation[on], arm)
    guides = Guides.on_body_axes(node, body, origin, fixed)
    level, still = _levels(job, node)
    return replace(guides, level=level, still=still), carriers


def _whole(by_axis: list[Drive | None]) -> tuple[Drive, Drive, Drive]:
    """The motion of what carries a node; along the components that are free, none."""
    return by_axis[0] or ZERO, by_axis[1] or ZERO, by_axis[2] or ZERO


def _drives(job: Job, taken: Ints) -> dict[int, list[Drive | None]]:
    """By node that no body holds: the drive of each displacement component, None where free."""
    out: dict[int, list[Drive | None]] = {}
    for h in job.held:
        for n in np.setdiff1d(h.nodes, taken).tolist():
            by_axis = out.setdefault(n, [None, None, None])
            if by_axis[h.component] not in (None, h.displacement):
                raise InputError(
                    f"{job.name}: the displacement {'xyz'[h.component]} of {job.sheet.node(n)} is "
                    "given twice, and not alike"
                )
            by_axis[h.component] = h.displacement
    for d in job.held_directors:
        for n in np.setdiff1d(d.nodes, taken).tolist():
            out.setdefault(n, [None, None, None])
    return out


def _levels(job: Job, node: Ints) -> tuple[Array, NDArray[np.bool_]]:
    """For guided nodes, the axis (k, 3) of which the director keeps its component, and which of its
    two turns (k, 2) are held: one component holds the turn towards its axis, two hold both."""
    held = np.zeros((len(job.sheet.points), 3), dtype=bool)
    for d in job.held_directors:
        held[d.nodes, d.component] = True
    held_axes = held[node]
    still = np.stack([held_axes.any(axis=1), held_axes.sum(axis=1) > 1], axis=1)
    return np.eye(3)[np.argmax(held_axes, axis=1)], still


def _contacts(
    job: Job, given: Ints, options: JobOptions, kept: Mapping[int, Contact]
) -> tuple[Contact, ...]:
    """The contacts of the pairs, those `kept` where their nodes are the same; pairs on the same
    triangles share a distance.  Raises InputError."""
    laid = [_offsets(job, pair) for pair in job.contacts]
    keys = [(pair.body, pair.triangles.tobytes()) for pair in job.contacts]
    highest = {
        key: max(float(o.max(initial=0.0)) for k, o in zip(keys, laid, strict=True) if k == key)
        for key in {*keys}
    }
    surfaces: dict[tuple[int, bytes], Surface] = {}
    out = []
    for i, (pair, offset, key) in enumerate(zip(job.contacts, laid, keys, strict=True)):
        before = kept.get(i)
        if before is not None:
            surfaces[key] = before.surface
        elif key not in surfaces:
            surfaces[key] = _surface(job, pair, highest[key], options)
        made = _contact(job, pair, offset, given, surfaces[key], options)
        if before is not None and np.array_equal(before.nodes, made.nodes):
            made = before
        elif before is not None and pair.friction > 0:
            raise InputError(
                f"{job.name}: contact {pair.name!r} has friction, which remembers the way of its "
                "nodes, and a step holds or releases some of them; leave them out of the "
                "contact, or hold them in all steps"
            )
        out.append(made)
    return tuple(out)


def _offsets(job: Job, pair: ContactPair) -> Array:
    """How far over the body each node (n,) of a pair touches it, m; zero at the others."""
    sheet, quads = job.sheet, job.sheet.quads[pair.quads]
    n, nodes = len(sheet.points), np.unique(quads)
    side = node_means(np.broadcast_to(pair.side[:, None], quads.shape), quads, n)
    # how far the face that is meant lies beyond the nodes, towards the body
    thickness = np.broadcast_to(sheet.thickness.T, sheet.quads.T.shape).T
    half, height = (node_means(v, sheet.quads, n) for v in (thickness / 2, sheet.height))
    out = np.zeros(n)
    out[nodes] = pair.gap + (side * height + half)[nodes]
    return out


def _contact(
    job: Job, pair: ContactPair, offset: Array, given: Ints, surface: Surface, options: JobOptions
) -> Contact:
    """The contact of a pair's nodes; where it states a penalty, that of points within its elements,
    with no multipliers, as FEBio's is."""
    sheet, quads = job.sheet, job.sheet.quads[pair.quads]
    if not (pair.automatic or pair.augmented):
        free = pair.quads[~np.isin(quads, given).all(axis=1)]
        points = ElementPoints.of(sheet.quads, free)
        return Contact(
            pair.body,
            surface,
            points.nearest,
            points.mean(offset),
            points.areas(sheet.points),
            pair.penalty,
            options.smoothing,
            friction=pair.friction,
            within=points,
            elastic=True,
        )
    nodes = np.setdiff1d(quads, given)
    return Contact(
        pair.body,
        surface,
        nodes,
        offset[nodes],
        node_areas(sheet.points, quads)[nodes],
        options.contact_factor * sheet_stiffness(sheet, pair.quads),
        options.smoothing,
        friction=pair.friction,
    )


def sheet_stiffness(sheet: Sheet, quads: Ints) -> float:
    """Return the modulus over the thickness, N/m3, the mean over quads (k,); of a law that is not
    isotropic the larger of its two initial plane-stress moduli."""
    moduli, points = np.zeros(len(sheet.quads)), len(kind_of(sheet.quads).gauss)
    for i, part in enumerate(sheet.parts):
        own = sheet.part == i
        tangent = part.law.response(np.zeros((int(own.sum()), points, 3))).tangent
        moduli[own] = tangent[..., range(2), range(2)].max(axis=-1).mean(axis=1)
    return float(np.mean(moduli[quads] / sheet.thickness[quads].mean(axis=1)))


def _surface(job: Job, pair: ContactPair, offset: float, options: JobOptions) -> Surface:
    """The body's own signed distance, or that of the pair's triangles."""
    body = job.bodies[pair.body]
    if body.surface is not None:
        return body.surface
    try:
        vertices, triangles = close_surface(body.vertices, pair.triangles)
        return SplineDistance.bake(
            vertices,
            triangles,
            options.spacing,
            needed_distance(offset, options.smoothing) + BEYOND,
            user_cache() if options.cached else None,
        )
    except InputError as error:
        raise InputError(
            f"{job.name}: contact {pair.name!r} with the body {body.name!r}: {error}"
        ) from error


def move_to_mid_surface(job: Job) -> Job:
    """The same sheet in the same place, with what holds and loads it acting on its mid-surface;
    springs keep their slack.

    A force F along a face of a sheet of thickness t is a couple F t / 2 on it.  Where that is many
    times the sheet's bending stiffness E t^3 / 12, as a point spring's on a thin sheet, the sheet
    turns about the point until the couple is gone, which no mesh of elements longer than thick can
    follow."""
    return move_nodes(job, job.sheet.height)


def move_nodes(job: Job, over: Array) -> Job:
    """The same sheet in the same place, its nodes moved along their directors by the mean at each
    of `over` (ne, 4) m, with what holds and loads them; springs keep their slack."""
    sheet = job.sheet
    points, moved = sheet.moved(over), node_means(over, sheet.quads, len(sheet.points))
    springs = [
        replace(s, length=s.length + _lengths(job, s, points) - _lengths(job, s, sheet.points))
        for s in job.springs
    ]
    sheet = replace(sheet, points=points, height=sheet.height - moved[sheet.quads])
    return replace(job, sheet=sheet, springs=springs)


def _lengths(job: Job, s: SpringSet, points: Array) -> Array:
    """Return the lengths (k,) m of springs while the sheet is at rest at points (n, 3) m."""
    origin = np.array([b.origin for b in job.bodies] or [np.zeros(3)])
    end = np.where((s.body >= 0)[:, None], origin[s.body] + s.anchor, points[s.other])
    return np.asarray(np.linalg.norm(points[s.nodes] - end, axis=1))
