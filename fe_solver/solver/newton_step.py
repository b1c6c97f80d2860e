"""One Newton step of the shell: the factorised tangent, contacts predicted, steps kept short."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError
from cosim.port import Array, Ints
from fe_solver.forces.friction import Sliding
from fe_solver.forces.layer import TOE
from fe_solver.forces.ramp import inverse_ramp, ramp
from fe_solver.forces.springs import PointForces
from fe_solver.solver.assembly import DOFS
from fe_solver.solver.linear_algebra import Analysis, Factor, Nearby, NotPositiveDefiniteError
from fe_solver.solver.model import Evaluation, ShellModel

MOST_FLIPS = 2
"""Rounds of the active set in one step; more cost factorisations and saved no iterations."""
MOST_SHIFTS = 10
"""Tenfold raises of the diagonal, from a millionth."""
LONG = 50.0
"""Times the longest step allowed: beyond it the tangent is damped, where a part may be slack."""
DAMPING = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Shares of the diagonal's mean."""
SMOOTH = 0.2
"""Share of a smoothed force's ramp: within it the tangent knows both sides, so that a contact is
not worth predicting."""
FAR = 0.2
"""Share of a node's way into a smoothed ramp: a step beyond it is far."""
DEEPER = 0.25
"""Share of a layer's thickness by which a step presses a point further into it at most: the layer
stiffens on the way, of which the tangent knows nothing."""


def factorise(model: ShellModel, data: Array) -> Factor:
    """Factor of the free part of the tangent, definite or not."""
    return _analysis(model).factor(data)


def newton_step(
    model: ShellModel, data: Array, gradient: Array, near: Factor | None = None
) -> tuple[Array, Factor | None]:
    """The Newton step (5n,), the tangent's diagonal raised (Levenberg) until it descends, and the
    factor that gave it.  The factor of a tangent `near` serves where a factorisation is dear, and
    then a factor is a `Nearby`.

    Raises ConvergenceError where the tangent stays singular all the same."""
    pattern, free = model.pattern, model.free
    step = np.zeros(pattern.size)
    if near is not None and _analysis(model).dear:
        nearby = Nearby(pattern.free_part(data), near)
        try:
            step[free] = -nearby.solve(gradient[free])
            return step, nearby
        except NotPositiveDefiniteError:
            pass
    diagonal = pattern.diagonal[:, range(DOFS), range(DOFS)].ravel()[free]
    shift, singular, factor = 0.0, None, None
    for _ in range(MOST_SHIFTS):
        try:
            factor = _analysis(model).factor(data)
            step[free] = -factor.solve(gradient[free])
            if step[free] @ gradient[free] <= 0:
                return step, factor
        except ConvergenceError as error:
            singular = error
        data = data.copy() if shift == 0.0 else data
        more = max(10 * shift, 1e-6) - shift
        shift += more
        data[diagonal] += more * np.abs(data[diagonal])
    if singular is not None:
        raise singular
    return step, factor


def descent_step(
    model: ShellModel,
    data: Array,
    gradient: Array,
    max_step: float,
    max_turn: float,
    near: Factor | None = None,
) -> tuple[Array, Factor | None]:
    """`newton_step`, damped for a model that may have slack parts (a tension field), which have
    next to no stiffness: the diagonal is raised by ever more of its mean until no step is LONG
    times the longest allowed.  Shortened as a whole instead, the step would move the slack parts
    alone.  A damped tangent's factor is None."""
    step, factor = newton_step(model, data, gradient, near)
    if model.section.smoothing is None:
        return step, factor
    pattern, turns = model.pattern, model.free % DOFS > 2
    diagonal = pattern.diagonal[:, range(DOFS), range(DOFS)].ravel()[model.free]
    size = np.abs(data[diagonal])
    mean = np.where(turns, size[turns].mean(), size[~turns].mean())
    for share in DAMPING:
        if limit_step(step, max_step, max_turn)[1] <= LONG:
            break
        damped, factor = data.copy(), None
        damped[diagonal] += share * mean
        step = newton_step(model, damped, gradient)[0]
    return step, factor


def last_factorised(factor: Factor | None, kept: Factor | None) -> Factor | None:
    """The factor that was made last, of a step's and the one that was kept for steps near by: a
    damped tangent's is no use again, and a `Nearby` one is the kept one."""
    return kept if factor is None or isinstance(factor, Nearby) else factor


def _analysis(model: ShellModel) -> Analysis:
    return model.pattern.analysis if model.pressure is None else model.pattern.general


def active_set_step(
    model: ShellModel, e: Evaluation, step: Array, near: Factor | None = None
) -> tuple[Array, int]:
    """The Newton step once more, with the one-sided springs that `step` would close or open closed
    or opened beforehand (a primal-dual active set: Hintermueller, Ito and Kunisch 2002, SIAM J
    Optim 13:865), or the line search would stop at the first node that meets a bone; so, too, with
    the points that it would make slide or stick.  Also the linear solves it took; `near` as in
    `newton_step`."""
    p, friction = e.points, e.points.friction
    flipped = np.zeros(len(p.depth), dtype=bool)
    sliding = None if friction is None else friction.sliding()
    for solves in range(MOST_FLIPS):
        travel = p.at_points(displacements(e.bases, step)[0])
        moved = p.depth + np.einsum("kj,kj->k", p.direction, travel)
        now = ((moved > 0) != (p.depth > 0)) & (np.abs(p.depth) > SMOOTH * p.ramp)
        same = np.array_equal(now, flipped)
        flipped = now
        if friction is not None and sliding is not None:
            before, sliding = sliding, friction.after(sliding, travel)
            same = same and np.array_equal(before.slides, sliding.slides)
        if same:
            return step, solves
        step = newton_step(model, *_with_flips(model, e, flipped, sliding), near)[0]
    return step, MOST_FLIPS


def displacements(bases: tuple[Array, Array], step: Array) -> tuple[Array, Array]:
    """The displacements (n, 3) m of the nodes and changes (n, 3) of the directors, to first order,
    in a step (5n,) in the nodes' bases."""
    u = step.reshape(-1, DOFS)
    parts = zip(bases, (u[:, :3], u[:, 3:]), strict=True)
    x, d = (np.einsum("nij,nj->ni", basis, moved) for basis, moved in parts)
    return x, d


def approach(p: PointForces, bases: tuple[Array, Array], step: Array) -> Array:
    """The depth (k,) m that a step (5n,) in the nodes' bases adds at the points."""
    moved = displacements(bases, step)[0]
    return np.asarray(np.einsum("kj,kj->k", p.direction, p.at_points(moved)))


def _with_flips(
    model: ShellModel, e: Evaluation, flipped: NDArray[np.bool_], sliding: Sliding | None
) -> tuple[Array, Array]:
    """Tangent data and gradient with the flipped one-sided springs closed or opened, and with
    points `sliding`."""
    assert e.data is not None
    p, A, gradient = e.points, e.bases[0], e.reduced.copy()
    stiffness = np.where(flipped, np.where(p.depth > 0, -1.0, 1.0) * p.stiffness, 0.0)
    hessian = stiffness[:, None, None] * p.direction[:, :, None] * p.direction[:, None, :]
    depth = np.where(flipped, p.depth, 0.0)
    force = (stiffness * depth)[:, None] * p.direction
    if p.friction is not None and sliding is not None:
        pull, slope = p.friction.linear(sliding)
        pull_now, slope_now = p.friction.linear(p.friction.sliding())
        force, hessian = force + pull - pull_now, hessian + slope - slope_now
    size = DOFS * model.quads.shape[1]
    blocks, nodal = np.zeros((len(model.quads), size, size)), np.zeros((len(A), DOFS, DOFS))
    model.add_points(blocks, nodal, p, hessian, A)
    data = e.data + model.pattern.assemble(blocks, nodal, np.zeros((len(model.pairs), 3, 3)))
    more = p.on_nodes(force, len(A))
    gradient.reshape(-1, DOFS)[:, :3] += np.einsum("nij,ni->nj", A, more)
    return data, gradient


def limit_to_contact(model: ShellModel, e: Evaluation, step: Array) -> Array:
    """The step with nodes that move far in a smoothed ramp put where they feel the force that the
    tangent predicts: towards the foot of a ramp that grows with the square of the depth, Newton's
    own steps go but half the way.  A node that two bodies press is left alone, as are the points
    within elements."""
    p, A = e.points, e.bases[0]
    more = approach(p, e.bases, step)
    far = np.abs(more) > FAR * np.abs(p.depth + p.ramp)
    on = np.flatnonzero((p.ramp > 0) & (p.cell < 0) & far)
    on = on[np.bincount(p.node[on])[p.node[on]] == 1]
    if not on.size:
        return step
    node = p.node[on]
    depth, more, width, normal = p.depth[on], more[on], p.ramp[on], p.direction[on]
    _, value, slope = ramp(depth, width)
    force = value + slope * more
    away = np.where(force > 0, inverse_ramp(force, width) - (depth + more), 0.0)
    return move_nodes(model, A, step, node, away[:, None] * normal)


def limit_depth(model: ShellModel, e: Evaluation, step: Array) -> Array:
    """The step, shortened as a whole where it presses points within elements more than DEEPER into
    a layer: unlike a node alone, such a point cannot be put where it feels what is predicted."""
    p, layered = e.points, [k.body for k in model.contacts if k.layer is not None]
    more = approach(p, e.bases, step)
    on = (p.cell >= 0) & np.isin(p.body, layered) & (more > 0)
    most = DEEPER * 4 / TOE * p.ramp[on] - np.minimum(p.depth[on] + p.ramp[on], 0.0)
    return step * float((most / more[on]).min(initial=1.0))


def move_nodes(model: ShellModel, A: Array, step: Array, node: Ints, by: Array) -> Array:
    """The step (5n,) in the nodes' bases A (n, 3, 3) with some nodes (k,) moved further by (k, 3)
    m, as far as they are free."""
    moved = np.zeros_like(step)
    moved.reshape(-1, DOFS)[node, :3] = np.einsum("kij,ki->kj", A[node], by)
    out = step.copy()
    out[model.free] += moved[model.free]
    return out


def limit_step(step: Array, max_step: float, max_turn: float) -> tuple[Array, float]:
    """The step, shortened if it is too long, and its size against the longest one."""
    u = np.abs(step.reshape(-1, DOFS))
    size = max(u[:, :3].max() / max_step, u[:, 3:].max() / max_turn)
    return step / max(1.0, size), float(size)
