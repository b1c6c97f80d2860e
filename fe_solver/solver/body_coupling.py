"""What a shell and the bodies that hold it do to each other: wrenches, and how they follow."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cosim.port import Array, skew
from fe_solver.forces.springs import ROPE, PointForces
from fe_solver.solver.assembly import DOFS
from fe_solver.solver.model import Configuration, Evaluation, ShellModel
from fe_solver.vectors import add_at, cross


def wrenches(
    model: ShellModel, c: Configuration, e: Evaluation, tension: Array
) -> dict[str, Array]:
    """The forces (N) and moments (N m) (nb, 6) about each body's origin of the hood on the bodies,
    world frame, by source: springs per group, contact, tie, guide."""
    nb, p, t, g = len(model.bodies), e.points, model.ties, model.guides
    groups = int(model.springs.group.max(initial=-1)) + 1
    points = np.zeros((groups + 2, nb, 6))
    # contact is the last, -1, and ropes are before it
    np.add.at(points, (p.group, p.body), _about(p.arm, p.gradient))
    out = {"contact": points[-1]} | {f"spring {i}": points[i] for i in range(groups)}
    on, ropes = g.steady, model.ropes
    for name, held, force, turned in (
        ("tie", t, e.gradient_x[t.node], slice(None)),
        ("guide", g, e.gradient_x[g.node] - model.pulls(c, tension), on),
    ):
        out[name] = np.zeros((nb, 6))
        np.add.at(out[name], held.body, -_about(c.x[held.node] - c.position[held.body], force))
        node = held.node[turned]
        couple = -cross(c.d[node], e.gradient_d[node])
        np.add.at(out[name][:, 3:], held.body[turned], couple)
    if len(ropes.node):
        pull = (tension @ ropes.share)[:, None] * ropes.along(c.rotation)
        out["guide"] += points[ROPE]
        np.add.at(out["guide"], ropes.body, _about(ropes.arm(c.rotation), pull))
    return out


def _about(arm: Array, force: Array) -> Array:
    """The forces (k, 3) and their moments at arms (k, 3), together (k, 6)."""
    return np.concatenate([force, cross(arm, force)], axis=1)


def dependent_motion(model: ShellModel, c: Configuration, bases: tuple[Array, Array]) -> Array:
    """The motion (5n, 6nb) by which tied and guided nodes follow twists of the bodies."""
    A, T = bases
    out = np.zeros((len(c.x), DOFS, len(model.bodies), 6))
    for held in (model.ties, model.guides):
        arm = c.x[held.node] - c.position[held.body]
        G = np.concatenate([np.tile(np.eye(3), (len(arm), 1, 1)), -skew(arm)], axis=2)
        out[held.node, :3, held.body] = np.swapaxes(A[held.node], 1, 2) @ G
    on = model.guides.steady
    for node, body in (
        (model.ties.node, model.ties.body),
        (model.guides.node[on], model.guides.body[on]),
    ):
        out[node, 3:, body, 3:] = -np.swapaxes(T[node], 1, 2) @ skew(c.d[node])
    return out.reshape(-1, 6 * len(model.bodies))


def common_twist(c: Configuration) -> Array:
    """The bodies' twists (6nb, 6) when all move as one, by that of the first."""
    out = np.tile(np.eye(6), (len(c.position), 1, 1))
    out[:, :3, 3:] = -skew(c.position - c.position[0])
    return out.reshape(-1, 6)


def rigid_motion(model: ShellModel, c: Configuration, bases: tuple[Array, Array]) -> Array:
    """The motion (5n, 6), by a twist of all the bodies as one about the first body's origin, of the
    degrees of freedom that do not follow a body by themselves."""
    first, second = np.moveaxis(bases[1], 2, 0)  # with the director right-handed
    out = np.zeros((len(c.x), DOFS, 6))
    out[:, range(3), range(3)] = 1.0  # but guided nodes have the world's axes
    out[:, :3, 3:] = -skew(c.x - c.position[0])
    out[:, 3, 3:], out[:, 4, 3:] = second, -first
    guides = model.guides
    out[guides.node, :3] = 0.0
    out[guides.node[guides.steady], 3:] = 0.0
    return out.reshape(-1, 6)


def coupling(
    model: ShellModel, c: Configuration, e: Evaluation, tension: Array
) -> tuple[Array, Array, Array, Array]:
    """At an evaluation with its tangent: the residual by the bodies' twists (5n, 6nb) and the
    wrenches by twists at fixed free dofs (6nb, 6nb); then the residual by the tensions (5n, nt)
    and the wrenches by the tensions (6nb, nt)."""
    assert e.data is not None
    nb, n = len(model.bodies), len(c.x)
    A, _ = e.bases
    S, (dofs, slots) = dependent_motion(model, c, e.bases), model.slaves
    K = sp.csr_array((e.data[slots.data], slots.indices, slots.indptr), slots.shape)
    followed = S[dofs]
    KS = K @ followed
    residual = KS.reshape(n, DOFS, nb, 6)
    wrench = -(followed.T @ KS[dofs]).reshape(nb, 6, nb, 6)
    p = e.points
    G = np.concatenate([np.tile(np.eye(3), (len(p.arm), 1, 1)), -skew(p.arm)], axis=2)
    force = -p.hessian @ G
    arm_cross = skew(p.gradient)
    force[p.turns, :, 3:] -= arm_cross[p.turns]
    acts = np.flatnonzero(force.any(axis=(1, 2)))
    local = p.weights[acts, :, None, None] * force[acts, None]
    local = np.swapaxes(A[p.nodes[acts]], 2, 3) @ local
    add_at(residual, (p.nodes[acts], slice(0, 3), p.body[acts, None]), local)
    own = np.swapaxes(G, 1, 2) @ force
    own[p.turns, 3:, :3] += arm_cross[p.turns]
    follow = ~p.turns
    own[follow, 3:, 3:] += arm_cross[follow] @ skew(p.arm[follow])
    on_body = (p.body == np.arange(nb)[:, None]).astype(float)
    wrench[range(nb), :, range(nb)] += (on_body @ own.reshape(-1, 36)).reshape(nb, 6, 6)
    _point_terms(p, G, force, A, S.reshape(n, DOFS, nb, 6), wrench)
    _support_terms(model, c, e, tension, residual, wrench)
    by_tension, wrench_tension = _tension_terms(model, c, A)
    size = 6 * nb
    return residual.reshape(-1, size), wrench.reshape(size, size), by_tension, wrench_tension


def _point_terms(
    p: PointForces, G: Array, force: Array, A: Array, follow: Array, wrench: Array
) -> None:
    """Points that act on one body and whose nodes another body moves (in place); follow (n, 5, nb,
    6) the nodes' motion in their bases A by the bodies' twists, force (k, 3, 6) the points' force
    by their own body's."""
    led = np.asarray(follow[:, :3].any(axis=(1, 2, 3)))
    on = led[p.nodes].any(axis=1) & force.any(axis=(1, 2))
    if not on.any():
        return
    follows = np.einsum("nij,njbk->nibk", A, follow[:, :3])
    moved = np.einsum("km,kmibl->kibl", p.weights[on], follows[p.nodes[on]])
    by_node = np.swapaxes(G[on], 1, 2) @ p.hessian[on]
    by_node[:, 3:] -= np.where(p.turns[on, None, None], skew(p.gradient[on]), 0.0)
    add_at(wrench, p.body[on], np.einsum("kij,kjbl->kibl", by_node, moved))
    back = np.einsum("kjbl,kji->kbli", moved, force[on])
    for body in np.unique(p.body[on]):
        wrench[:, :, body] -= back[p.body[on] == body].sum(axis=0)


def _support_terms(
    model: ShellModel,
    c: Configuration,
    e: Evaluation,
    tension: Array,
    residual: Array,
    wrench: Array,
) -> None:
    """The turning of lines, arms and pulls with their bodies (in place)."""
    t, g = model.ties, model.guides
    arm = c.x[t.node] - c.position[t.body]
    turn = skew(e.gradient_x[t.node]) @ skew(arm)
    turn += skew(e.gradient_d[t.node]) @ skew(c.d[t.node])
    add_at(wrench[:, 3:, :, 3:], (t.body, slice(None), t.body), -turn)
    pull = model.pulls(c, tension)
    total = e.gradient_x[g.node] - pull
    A, T = e.bases
    gx = e.gradient_x[g.node]
    residual[g.node, :3, g.body, 3:] += cross(np.swapaxes(A[g.node], 1, 2), gx[:, None])
    arm = c.x[g.node] - c.position[g.body]
    moment = -skew(total) @ skew(arm) - skew(arm) @ skew(pull)
    add_at(wrench[:, 3:, :, 3:], (g.body, slice(None), g.body), moment)
    add_at(wrench[:, :3, :, 3:], (g.body, slice(None), g.body), -skew(pull))
    ropes = model.ropes
    if len(ropes.node):
        pull, arm = (
            (tension @ ropes.share)[:, None] * ropes.along(c.rotation),
            ropes.arm(c.rotation),
        )
        add_at(wrench[:, :3, :, 3:], (ropes.body, slice(None), ropes.body), -skew(pull))
        turned = -skew(cross(arm, pull))
        add_at(wrench[:, 3:, :, 3:], (ropes.body, slice(None), ropes.body), turned)
    if not g.steady.any():
        return
    on = g.steady
    node, body, d = g.node[on], g.body[on], c.d[g.node[on]]
    gd = e.gradient_d[node]
    bend = np.einsum("ki,ki->k", gd, d)[:, None]
    spin = cross(np.swapaxes(T[node], 1, 2), (gd - bend * d)[:, None])
    residual[node, 3:, body, 3:] += spin
    turn = skew(gd) @ skew(d) - bend[:, None] * skew(d) @ skew(d)
    add_at(wrench[:, 3:, :, 3:], (body, slice(None), body), -turn)


def rope_travel(model: ShellModel, c: Configuration) -> Array:
    """The change of the tendons' excursions (nt, 6nb), m by m and rad, by the twists of the bodies
    of their eyelets where the nodes stay."""
    ropes, nb = model.ropes, len(model.bodies)
    _, line = ropes.lines(c.x, c.position, c.rotation)
    moved = _about(ropes.arm(c.rotation), line)
    out = np.zeros((nb, 6, len(ropes.share)))
    add_at(out, ropes.body, moved[:, :, None] * ropes.share.T[:, None, :])
    return np.asarray(out.reshape(6 * nb, -1).T)


def _tension_terms(model: ShellModel, c: Configuration, A: Array) -> tuple[Array, Array]:
    g, ropes, nb, nt = model.guides, model.ropes, len(model.bodies), len(model.share)
    residual = np.zeros((len(c.x), DOFS, nt))
    residual[g.node, 0] = -model.share.T
    wrench = np.zeros((nb, 6, nt))
    along = A[g.node, :, 0]
    arm = c.x[g.node] - c.position[g.body]
    unit = np.concatenate([along, cross(arm, along)], axis=1)
    add_at(wrench, g.body, unit[:, :, None] * model.share.T[:, None, :])
    if len(ropes.node):
        _, line = ropes.lines(c.x, c.position, c.rotation)
        own = np.einsum("kji,kj->ki", A[ropes.node], line)
        add_at(residual[:, :3], ropes.node, own[:, :, None] * ropes.share.T[:, None, :])
        unit = _about(ropes.arm(c.rotation), line + ropes.along(c.rotation))
        add_at(wrench, ropes.body, unit[:, :, None] * ropes.share.T[:, None, :])
    return residual.reshape(len(c.x) * DOFS, nt), wrench.reshape(6 * nb, nt)
