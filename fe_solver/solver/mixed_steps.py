"""Whole Newton steps from far away, with forces that are predicted and not strained.

A stiff part that a step turns is strained by the square of its turn.  Newton's next tangent takes
the huge stress of that error for real and is stiff across it, so that only short steps go on, and a
search for less energy takes no others.  With the forces as unknowns beside the displacements, as in
a mixed method, the error never enters the tangent: its geometric part is made of the forces that
the last step predicted, to first order (Magisano, Leonetti and Garcea 2017, Comput Methods Appl
Mech Eng 313:986); residual and equilibrium stay the same.  After each step springs have the length,
and contacts the depth, that it predicted.  Nothing is searched along a step, so that these steps
may go astray: they begin a solution, and `fe_solver.solver.newton` ends it.

Near an equilibrium that is known the first forces are predicted from it (`predict_motion`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError
from cosim.port import Array, Ints
from fe_solver.forces.springs import PointForces
from fe_solver.solver.body_coupling import dependent_motion
from fe_solver.solver.linear_algebra import Factor
from fe_solver.solver.model import Configuration, Evaluation, Forces, ShellModel
from fe_solver.solver.newton_step import (
    approach,
    descent_step,
    displacements,
    limit_step,
    limit_to_contact,
    move_nodes,
)
from fe_solver.solver.residual import is_folded, residual_norm
from fe_solver.vectors import cross

MOST_STEPS, FEW_STEPS = 40, 4
"""From afar, and from the prediction of an equilibrium that is known."""
CLOSE = 1e-4
"""Residual over the largest force at which the steps end at the latest."""
NEAR = 0.1
"""Residual over the largest force below which the next tangent is the consistent one."""
MOST_HALVINGS = 4
"""Of a step that would turn a director into the plane of an element, or crush one."""
SMALLER, MOST_RESTARTS = 0.25, 3
"""Part of the longest step that is allowed from the start on where no halving helps."""
SHORT = 0.1
"""Longest step with the consistent tangent, against the longest one allowed: near a bifurcation,
where it is nearly singular, it would lead far away."""
UNDAMPED = 6
"""Steps from afar after which one that takes back what the last one closed or opened is halved."""


class MixedSteps(NamedTuple):
    """Where the steps led."""

    configuration: Configuration
    """To go on from."""
    iterations: int
    """How many steps there were."""
    solves: int
    """The linear solves that they took."""
    evaluation: Evaluation | None = None
    """There, where it is an equilibrium."""
    factor: Factor | None = None
    """The last tangent's, where it is an equilibrium."""


class Prediction(NamedTuple):
    """Forces after a step, to first order."""

    elements: Array
    """(ne, g, 8), of the elements."""
    points: Array
    """(k,) N, of the points."""
    keys: Ints
    """(k,) of the points (see `_keys`)."""
    acting: Ints
    """Keys of the one-sided ones that acted before the step."""


def take_mixed_steps(
    model: ShellModel,
    start: Configuration,
    tension: Array,
    most: int,
    tolerance: float,
    max_step: float,
    max_turn: float,
    before: Prediction | None = None,
) -> MixedSteps:
    """Take up to `most` steps (MOST_STEPS) from `start` under `tension` (nt,) N, none longer than
    `max_step` (m) or turning a director by more than `max_turn` (rad), to a residual of `tolerance`
    (at least CLOSE) of the largest force.  `before`: the forces that a known equilibrium nearby
    predicts at the start.  Where the steps do not lead there, the configuration is the one of least
    energy that they met, the start included, with no element folded or crushed."""
    near = before is not None
    undamped = 0 if near else UNDAMPED
    c, convex, factor, kept = start, not near, None, None
    e = model.evaluate(c, tension, tangent=False, convex=convex)
    most, tolerance = min(most, FEW_STEPS if near else MOST_STEPS), max(tolerance, CLOSE)
    least, best, solves, restarts = np.inf, start, 0, 0
    for iteration in range(most + 1):
        residual, force = residual_norm(model, e)
        potential, upright = model.potential(c, e.energy, tension), not is_folded(model, c)
        if not np.isfinite(residual) or (iteration == 0 and potential == np.inf):
            break
        if potential < least and (upright or iteration == 0):
            least, best = potential, c
        close = residual <= tolerance * force
        if close and upright and np.isfinite(potential):
            return MixedSteps(c, iteration, solves, e, kept)
        if close or iteration == most:
            break
        # the consistent tangent serves where it is positive definite
        try:
            step, factor = _solve_step(model, c, e, before, max_step, max_turn, kept)
            kept = kept or factor if near else None
            solves += 1
            if not convex and (factor is None or factor.negative):
                e = model.evaluate(c, tension, tangent=False, convex=True)
                step, factor = _solve_step(model, c, e, before, max_step, max_turn)
                solves += 1
        except ConvergenceError:
            break
        part = 1.0 if e.convex or near else SHORT
        step = limit_step(limit_to_contact(model, e, step), part * max_step, part * max_turn)[0]
        if before is not None and iteration >= undamped and _reverses(model, e, step, before):
            step = step / 2
        convex = residual > NEAR * force and not near
        # a single crushed configuration may be passed through, but not when it went wrong before
        for halvings in range(1 + MOST_HALVINGS):
            step = step / 2 if halvings else step
            trial = model.take_step(c, e.bases, _follow_springs(model, e, step))
            trial_balance = model.evaluate(trial, tension, tangent=False, convex=convex)
            crushed = not np.isfinite(trial_balance.energy)
            lost = crushed and (near or restarts > 0 or not np.isfinite(e.energy))
            lost |= upright and is_folded(model, trial)
            if not lost:
                break
        if lost and not near and restarts < (MOST_RESTARTS if crushed else 1):
            c, before, convex, restarts = start, None, True, restarts + 1
            e = model.evaluate(c, tension, tangent=False, convex=convex)
            max_step, max_turn = SMALLER * max_step, SMALLER * max_turn
            continue
        if lost and crushed:
            break
        before, c, e = _predict(model, c, e, step, _travel(e, step)), trial, trial_balance
    return MixedSteps(best, iteration, solves)


def _solve_step(
    model: ShellModel,
    c: Configuration,
    e: Evaluation,
    prediction: Prediction | None,
    max_step: float,
    max_turn: float,
    near: Factor | None = None,
) -> tuple[Array, Factor | None]:
    """The step by the tangent with the predicted forces, and that tangent's factor."""
    forces = None
    if prediction is not None:
        points = e.points.force.copy()
        _, new, old = np.intersect1d(_keys(model, e.points), prediction.keys, return_indices=True)
        points[new] = prediction.points[old]
        forces = Forces(prediction.elements, points)
    return descent_step(model, model.tangent(c, e, forces), e.reduced, max_step, max_turn, near)


def predict_motion(
    model: ShellModel,
    c: Configuration,
    e: Evaluation,
    step: Array,
    twists: Array,
    moved: Configuration,
) -> tuple[Configuration, Prediction]:
    """What a step (5n,) from an equilibrium with its bodies' twists (nb, 6) makes of the forces, to
    first order; and the configuration `moved` by both with each node that a single spring holds
    where the spring has the length of its force.  A stiff spring is short against the second-order
    part of a turn, which would change its force by any amount."""
    full = step + dependent_motion(model, c, e.bases) @ twists.ravel()
    p = e.points
    shift = twists[p.body, :3] + cross(twists[p.body, 3:], p.arm)
    travel = _travel(e, full) - shift
    on, reach = _predicted_reach(p, travel)
    held = np.concatenate([model.ties.node, model.guides.node])
    loose = ~np.isin(p.node[on], held)
    on, springs = on[loose], model.springs
    body, x = springs.body[on], moved.x.copy()
    anchor = np.einsum("kij,kj->ki", moved.rotation[body], springs.anchor[on])
    x[springs.node[on]] = moved.position[body] + anchor + reach[loose]
    return replace(moved, x=x), _predict(model, c, e, full, travel)


def _predict(
    model: ShellModel, c: Configuration, e: Evaluation, step: Array, travel: Array
) -> Prediction:
    """The forces after a step (5n,) that moves the points by `travel` (k, 3) m as their bodies see
    them."""
    x, d = displacements(e.bases, step)
    at = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
    by = np.concatenate([x[model.quads], d[model.quads]], axis=1)
    change = np.einsum("ngij,ngj->ngi", e.elements.stiffness, model.tables.strain_change(at, by))
    elements = e.elements.force + change * model.tables.weight[:, :, None]
    p, keys = e.points, _keys(model, e.points)
    along = np.einsum("ki,kij,kj->k", p.direction, p.hessian, p.direction)
    points = p.force + along * np.einsum("kj,kj->k", p.direction, travel)
    points = np.where(np.isfinite(p.depth), np.maximum(points, 0.0), points)
    return Prediction(elements, points, keys, keys[_acts(p.depth)])


def _travel(e: Evaluation, step: Array) -> Array:
    """The displacement (k, 3) m of the points in a step (5n,)."""
    return e.points.at_points(displacements(e.bases, step)[0])


def _keys(model: ShellModel, p: PointForces) -> Ints:
    """One number (k,) for each force that stays the same while its spring or contact is listed."""
    kind = (p.group + 1) * len(model.bodies) + p.body
    place = (p.cell + 1) * len(model.reference) + p.node
    return np.asarray(kind * (len(model.quads) + 1) * len(model.reference) + place)


def _acts(depth: Array) -> NDArray[np.bool_]:
    return (depth > 0) & np.isfinite(depth)


def _reverses(model: ShellModel, e: Evaluation, step: Array, prediction: Prediction) -> bool:
    """Whether the step opens or closes what the step before it closed or opened."""
    p, keys = e.points, _keys(model, e.points)
    now = keys[_acts(p.depth)]
    after = keys[_acts(p.depth + approach(p, e.bases, step))]
    last, next_ = np.setxor1d(prediction.acting, now), np.setxor1d(now, after)
    return bool(np.intersect1d(last, next_).size)


def _follow_springs(model: ShellModel, e: Evaluation, step: Array) -> Array:
    """The step with each node that a single spring holds brought to the spring's predicted length:
    a taut one's changes as to first order, down to its slack length; a slack one grows up to it."""
    p, travel = e.points, _travel(e, step)
    on, reach = _predicted_reach(p, travel)
    back = reach - (p.length[on, None] * p.direction[on] + travel[on])
    return move_nodes(model, e.bases[0], step, p.node[on], back)


def _predicted_reach(p: PointForces, travel: Array) -> tuple[Ints, Array]:
    """The springs (j,) that hold a node alone, and vectors (j, 3) m from their anchors to it, of
    the length that they have to first order, once the points moved by `travel` (k, 3) m as their
    bodies see them."""
    more = np.einsum("kj,kj->k", p.direction, travel)
    slack = np.subtract(p.length, p.depth, out=np.zeros(len(p.depth)), where=np.isfinite(p.depth))
    on = np.flatnonzero(np.isfinite(p.length) & (p.length + more > 0) & (p.length > 0))
    on = on[np.bincount(p.node[on])[p.node[on]] == 1] if on.size else on
    reach = p.length[on, None] * p.direction[on] + travel[on]
    length = np.linalg.norm(reach, axis=1)
    taut = np.maximum(p.length[on] + more[on], slack[on])
    wanted = np.where(p.depth[on] > 0, taut, np.minimum(length, slack[on]))
    return on, (wanted / np.maximum(length, np.finfo(float).tiny))[:, None] * reach
