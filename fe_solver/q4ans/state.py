"""What an equilibrium of `q4ans` elements holds, as a state of a job."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cosim.port import Array
from fe_solver.elements.mesh_geometry import node_areas
from fe_solver.forces.springs import node_spring_state, spring_state
from fe_solver.job.solve import JobState, forces_by_set
from fe_solver.q4ans.balance import Loads, Source, Term
from fe_solver.q4ans.element import solid_strain
from fe_solver.q4ans.laws import solid_stress
from fe_solver.q4ans.model import SolidModel
from fe_solver.solver.continuation import Effort
from fe_solver.solver.fields import Fields
from fe_solver.solver.model import Configuration
from fe_solver.vectors import cross

GROUND = "ground"
"""The body that bears the reactions of held displacements."""
PLANE = [0, 1, 3]
"""E11, E22 and 2 E12 among the six strains."""


class SolidEquilibrium(NamedTuple):
    """A solved time."""

    time: float
    """s."""
    z: Array
    """(2n, 3) m, positions of the nodes."""
    loads: Loads
    terms: tuple[Term, ...]
    residual: float
    """N."""


def solid_state(model: SolidModel, found: SolidEquilibrium, effort: Effort) -> JobState:
    """An equilibrium's fields, forces and balance."""
    job, (z, loads) = model.job, (found.z, found.loads)
    n = len(job.sheet.points)
    wrench = _wrenches(model, found)
    applied = _load_wrench(model, found)
    position = np.concatenate([loads.position, np.zeros((1, 3))])
    total = np.asarray(sum(wrench.values()))
    force = total[:, :3].sum(axis=0) - applied[:3]
    moment = (total[:, 3:] + cross(position, total[:, :3])).sum(axis=0) - applied[3:]
    director = (z[n:] - z[:n]) * np.sign(job.sheet.height[0, 0])
    director /= np.linalg.norm(director, axis=1, keepdims=True)
    rotation = np.concatenate([loads.rotation, np.eye(3)[None]])
    to_bodies = spring_state(model.springs, z, loads.position, loads.rotation).force
    between = node_spring_state(model.links, z).force
    return JobState(
        found.time,
        Configuration(z[:n], director, position, rotation),
        (*(b.name for b in job.bodies), GROUND),
        forces_by_set(job, (model.springs, to_bodies), (model.links, between)),
        wrench,
        applied + _rigid_wrench(model, loads),
        max(model.deepest(z, loads), 0.0),
        found.residual,
        (float(np.linalg.norm(force)), float(np.linalg.norm(moment))),
        effort,
        _fields(model, z),
        _contact_pressure(model, found),
        _reaction(model, found),
    )


def _about(arm: Array, force: Array) -> Array:
    """The wrench (6,) N and N m of forces (k, 3) at arms (k, 3)."""
    return np.concatenate([force.sum(axis=0), cross(arm, force).sum(axis=0)])


def _wrenches(model: SolidModel, equilibrium: SolidEquilibrium) -> dict[str, Array]:
    """The wrenches (nb + 1, 6) N, N m of the sheet on the bodies about their origins, by source."""
    job, z, position = model.job, equilibrium.z, equilibrium.loads.position
    count = len(job.bodies) + 1
    out = {"contact": np.zeros((count, 6))}
    for term in equilibrium.terms:
        if term.body is None:
            continue
        group = np.full(len(term.nodes), -1)
        if term.source == Source.SPRING:
            group = model.springs.group
        for i, body in {*zip(group.tolist(), term.body.tolist(), strict=True)}:
            on_body = (group == i) & (term.body == body)
            arm = (z[term.nodes[on_body]] - position[body]).reshape(-1, 3)
            wrench = out.setdefault(f"spring {i}" if i >= 0 else "contact", np.zeros((count, 6)))
            wrench[body] += _about(arm, term.force[on_body].reshape(-1, 3))
    resisted = model.imbalance(equilibrium.terms, equilibrium.loads)
    tie, guide, left = np.zeros((count, 6)), np.zeros((count, 6)), ~model.free
    n = len(job.sheet.points)
    for t in job.ties:
        nodes = np.concatenate([t.nodes, n + t.nodes]) if t.clamped else t.nodes
        tie[t.body] -= _about(z[nodes] - position[t.body], resisted[nodes])
        left[nodes] = False
    guide[-1] = -_about(z, np.where(left, resisted, 0.0))
    return {**out, "tie": tie, "guide": guide}


def _reaction(model: SolidModel, equilibrium: SolidEquilibrium) -> Array:
    """The force and couple (n, 6) N and N m with which what is given acts on each pair of nodes,
    about the first."""
    n, z = len(model.job.sheet.points), equilibrium.z
    force = np.where(model.free, 0.0, model.imbalance(equilibrium.terms, equilibrium.loads))
    couple = cross(z[n:] - z[:n], force[n:])
    return np.concatenate([force[:n] + force[n:], couple], axis=1)


def _load_wrench(model: SolidModel, equilibrium: SolidEquilibrium) -> Array:
    """The wrench (6,) N and N m of the loads about the world's origin."""
    out = _about(equilibrium.z, equilibrium.loads.dead)
    if equilibrium.loads.pressure is not None:
        (term,) = (t for t in equilibrium.terms if t.source == Source.PRESSURE)
        out -= _about(equilibrium.z[term.nodes].reshape(-1, 3), term.force.reshape(-1, 3))
    return out


def _rigid_wrench(model: SolidModel, loads: Loads) -> Array:
    """The wrench (6,) N and N m of the loads on bodies about the world's origin."""
    wrench = model.wrench(loads)[0]
    moment = wrench[:, 3:] + cross(loads.position, wrench[:, :3])
    return np.concatenate([wrench[:, :3].sum(axis=0), moment.sum(axis=0)])


def _fields(model: SolidModel, z: Array) -> Fields:
    """Means over each element, from the stress-free sheet; its faces' strains by what the Gauss
    points on either side of the middle say."""
    count = len(model.job.sheet.quads)
    strain, stress, faces = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 2))
    for part in model.parts:
        e = part.elements
        points = solid_strain(part.tables, part.rest + (z - model.rest)[model.pairs[e]])
        weight = part.tables.volume / part.tables.volume.sum(axis=1, keepdims=True)
        strain[e] = np.einsum("ng,ngc->nc", weight, points[..., PLANE])
        stress[e] = np.einsum("ng,ngc->nc", weight, solid_stress(part.law, points)[0][..., PLANE])
        low, high = (points[:, i::2, 0].mean(axis=1) for i in (0, 1))
        bend = np.sqrt(3) * (high - low) / 2 * np.sign(model.job.sheet.height[0, 0])
        faces[e] = np.stack([strain[e, 0] - bend, strain[e, 0] + bend], axis=1)
    return Fields(strain, stress, faces, np.full(count, -1, dtype=np.int8))


def _contact_pressure(model: SolidModel, equilibrium: SolidEquilibrium) -> Array:
    """The contact pressure (n,) N/m2 on each pair of nodes, over its area."""
    n = len(model.job.sheet.points)
    force = np.zeros((2 * n, 3))
    for f, p in zip(model.facets, model.contacts(equilibrium.z, equilibrium.loads), strict=True):
        np.add.at(force, f.quads, p.gradient.reshape(-1, 4, 3))
    size = np.linalg.norm(force[:n] + force[n:], axis=1)
    return np.asarray(size / node_areas(model.job.sheet.points, model.job.sheet.quads))
