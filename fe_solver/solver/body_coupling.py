"""What a shell and the bodies that hold it do to each other: wrenches, and how they follow."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cosim.port import Array, Ints, skew
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
        out[held.node, :3, held.body] = np.swapaxes(A[held.node], 1, 2) @ _velocity(arm)
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
    and the wrenches by the tensions (6nb, nt).

    Below, a twist is (v, w), r an arm from its body's origin, g a gradient of the energy."""
    nb, size = len(model.bodies), 6 * len(model.bodies)
    S = dependent_motion(model, c, e.bases)
    residual, wrench = _sheet_terms(model, e, S)
    points = e.points.acting()
    G = _velocity(points.arm)
    force = _point_forces(points, G)
    _point_terms(points, G, force, e.bases[0], residual, wrench)
    _led_point_terms(points, G, force, e.bases[0], S.reshape(-1, DOFS, nb, 6), wrench)
    _tie_terms(model, c, e, wrench)
    _guide_terms(model, c, e, tension, residual, wrench)
    _rope_terms(model, c, tension, wrench)
    _director_terms(model, c, e, residual, wrench)
    return residual.reshape(-1, size), wrench.reshape(size, size), *_tension_terms(model, c, e)


def _velocity(arm: Array) -> Array:
    """The matrices G (k, 3, 6) of v + w x r = G (v, w), for arms r (k, 3)."""
    return np.concatenate([np.tile(np.eye(3), (len(arm), 1, 1)), -skew(arm)], axis=2)


def _add_own(block: Array, body: Ints, terms: Array) -> None:
    """Add what twists of bodies (k,) do to their own wrenches, (k, 3, 3) each."""
    add_at(block, (body, slice(None), body), terms)


def _sheet_terms(model: ShellModel, e: Evaluation, S: Array) -> tuple[Array, Array]:
    """The tangent's K S (n, 5, nb, 6) and -S^T K S (nb, 6, nb, 6) of the nodes that follow."""
    assert e.data is not None
    nb, (dofs, slots) = len(model.bodies), model.slaves
    K = sp.csr_array((e.data[slots.data], slots.indices, slots.indptr), slots.shape)
    followed = S[dofs]
    KS = K @ followed
    wrench = -(followed.T @ KS[dofs]).reshape(nb, 6, nb, 6)
    return KS.reshape(-1, DOFS, nb, 6), wrench


def _point_forces(p: PointForces, G: Array) -> Array:
    """The points' gradients by their body's twist (k, 3, 6): dg = -H G (v, w), and + w x g of those
    that turn with the body."""
    force = -p.hessian @ G
    force[p.turns, :, 3:] -= skew(p.gradient[p.turns])
    return force


def _point_terms(
    p: PointForces, G: Array, force: Array, A: Array, residual: Array, wrench: Array
) -> None:
    """Points and their own body (in place), force (k, 3, 6) = dg: the nodes' A^T dg, the body's
    G^T dg + (0, dr x g), where dr = -v of a point that stays and w x r of one that turns."""
    acts = np.flatnonzero(force.any(axis=(1, 2)))
    nodal = p.weights[acts, :, None, None] * force[acts, None]
    nodal = np.swapaxes(A[p.nodes[acts]], 2, 3) @ nodal
    add_at(residual, (p.nodes[acts], slice(0, 3), p.body[acts, None]), nodal)
    of_body, g, stays = np.swapaxes(G, 1, 2) @ force, skew(p.gradient), p.turns
    of_body[stays, 3:, :3] += g[stays]
    of_body[~stays, 3:, 3:] += g[~stays] @ skew(p.arm[~stays])
    nb = len(wrench)
    on_body = (p.body == np.arange(nb)[:, None]).astype(float)
    wrench[range(nb), :, range(nb)] += (on_body @ of_body.reshape(-1, 36)).reshape(nb, 6, 6)


def _led_point_terms(
    p: PointForces, G: Array, force: Array, A: Array, follow: Array, wrench: Array
) -> None:
    """Points on one body whose nodes another one moves by u = A S (v, w) (in place): G^T H u +
    (0, u x g, if it turns) of the first, -(A S)^T dg of the second; follow (n, 5, nb, 6) is S, and
    force (k, 3, 6) = dg."""
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


def _tie_terms(model: ShellModel, c: Configuration, e: Evaluation, wrench: Array) -> None:
    """Arms and directors that turn with the body of a tie (in place):
    -(w x r) x g_x - (w x d) x g_d."""
    t = model.ties
    turn = skew(e.gradient_x[t.node]) @ skew(c.x[t.node] - c.position[t.body])
    turn += skew(e.gradient_d[t.node]) @ skew(c.d[t.node])
    _add_own(wrench[:, 3:, :, 3:], t.body, -turn)


def _guide_terms(
    model: ShellModel,
    c: Configuration,
    e: Evaluation,
    tension: Array,
    residual: Array,
    wrench: Array,
) -> None:
    """Axes A, arms and pulls p that turn with the body of a guide (in place): (w x A)^T g of the
    nodes; w x p and -(w x r) x (g - p) + r x (w x p) of the body."""
    guides, g = model.guides, e.gradient_x[model.guides.node]
    axes = np.swapaxes(e.bases[0][guides.node], 1, 2)
    residual[guides.node, :3, guides.body, 3:] += cross(axes, g[:, None])
    arm, pull = c.x[guides.node] - c.position[guides.body], model.pulls(c, tension)
    moment = -skew(g - pull) @ skew(arm) - skew(arm) @ skew(pull)
    _add_own(wrench[:, 3:, :, 3:], guides.body, moment)
    _add_own(wrench[:, :3, :, 3:], guides.body, -skew(pull))


def _rope_terms(model: ShellModel, c: Configuration, tension: Array, wrench: Array) -> None:
    """Pulls p of the muscles that turn with the eyelet's body (in place): w x p, w x (r x p)."""
    ropes = model.ropes
    if not len(ropes.node):
        return
    pull = (tension @ ropes.share)[:, None] * ropes.along(c.rotation)
    _add_own(wrench[:, :3, :, 3:], ropes.body, -skew(pull))
    _add_own(wrench[:, 3:, :, 3:], ropes.body, -skew(cross(ropes.arm(c.rotation), pull)))


def _director_terms(
    model: ShellModel, c: Configuration, e: Evaluation, residual: Array, wrench: Array
) -> None:
    """Tangents T and directors d that turn with the body of a guide (in place), with b = g . d:
    (w x T)^T (g - b d) of the nodes, -(w x d) x g + b (w x d) x d of the body."""
    on = model.guides.steady
    if not on.any():
        return
    node, body = model.guides.node[on], model.guides.body[on]
    d, g = c.d[node], e.gradient_d[node]
    b = np.einsum("ki,ki->k", g, d)[:, None]
    axes = np.swapaxes(e.bases[1][node], 1, 2)
    residual[node, 3:, body, 3:] += cross(axes, (g - b * d)[:, None])
    turn = skew(g) @ skew(d) - b[:, None] * skew(d) @ skew(d)
    _add_own(wrench[:, 3:, :, 3:], body, -turn)


def rope_travel(model: ShellModel, c: Configuration) -> Array:
    """The change of the tendons' excursions (nt, 6nb), m by m and rad, by the twists of the bodies
    of their eyelets where the nodes stay."""
    ropes, nb = model.ropes, len(model.bodies)
    _, line = ropes.lines(c.x, c.position, c.rotation)
    moved = _about(ropes.arm(c.rotation), line)
    out = np.zeros((nb, 6, len(ropes.share)))
    add_at(out, ropes.body, moved[:, :, None] * ropes.share.T[:, None, :])
    return np.asarray(out.reshape(6 * nb, -1).T)


def _tension_terms(model: ShellModel, c: Configuration, e: Evaluation) -> tuple[Array, Array]:
    """The residual (5n, nt) and the wrenches (6nb, nt) by the tensions, by their shares s: -s and
    (a, r x a) s at guides of first axis a; A^T l s and (l + p, r x (l + p)) s at ropes of line l
    that the muscle pulls along p."""
    g, ropes, nb, nt = model.guides, model.ropes, len(model.bodies), len(model.share)
    A = e.bases[0]
    residual, wrench = np.zeros((len(c.x), DOFS, nt)), np.zeros((nb, 6, nt))
    residual[g.node, 0] = -model.share.T
    unit = _about(c.x[g.node] - c.position[g.body], A[g.node, :, 0])
    add_at(wrench, g.body, unit[:, :, None] * model.share.T[:, None, :])
    if len(ropes.node):
        _, line = ropes.lines(c.x, c.position, c.rotation)
        nodal = np.einsum("kji,kj->ki", A[ropes.node], line)
        add_at(residual[:, :3], ropes.node, nodal[:, :, None] * ropes.share.T[:, None, :])
        unit = _about(ropes.arm(c.rotation), line + ropes.along(c.rotation))
        add_at(wrench, ropes.body, unit[:, :, None] * ropes.share.T[:, None, :])
    return residual.reshape(len(c.x) * DOFS, nt), wrench.reshape(6 * nb, nt)
