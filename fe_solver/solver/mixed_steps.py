"""Whole Newton steps from far away, with forces that are predicted and not strained.

A stiff part that a step turns is strained by the square of its turn.  Newton's next tangent takes
the huge stress of that error for real and is stiff across it, so that only short steps go on, and a
search for less energy takes no others.  With the forces as unknowns beside the displacements, as in
a mixed method, the error never enters the tangent: its geometric part is made of the forces that
the last step predicted, to first order (Magisano, Leonetti and Garcea 2017, Comput Methods Appl
Mech Eng 313:986); residual and equilibrium stay the same.  After each step springs have the length,
and contacts the depth, that it predicted.  Nothing is searched along a step, so that these steps
may go astray: they begin a solution, and `fe_solver.solver.newton` ends it.

Near an equilibrium that is known the first forces are predicted from it (`predict_motion`).  What
an outer loop holds, as the multipliers of contacts and the limits of friction, follows the steps
once they are almost there (`Settle`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError, pulse
from cosim.port import Array, Ints
from fe_solver.forces.springs import PointForces
from fe_solver.solver.body_coupling import dependent_motion
from fe_solver.solver.linear_algebra import Factor
from fe_solver.solver.model import Configuration, Evaluation, Forces, ShellModel
from fe_solver.solver.newton_step import (
    approach,
    descent_step,
    displacements,
    last_factorised,
    limit_depth,
    limit_step,
    limit_to_contact,
    move_nodes,
)
from fe_solver.solver.residual import ITERATION, is_folded, residual_norm
from fe_solver.vectors import cross

MOST_STEPS, FEW_STEPS = 40, 4
"""From afar, and from the prediction of an equilibrium that is known."""
END_RESIDUAL = 1e-4
"""Residual over the largest force at which the steps end at the latest."""
CONSISTENT_BELOW = 0.1
"""Residual over the largest force below which the next tangent is the consistent one."""
MOST_HALVINGS = 4
"""How often a step is halved that would turn a director into the plane of an element, or crush
one."""
SMALLER, MOST_RESTARTS = 0.25, 3
"""Part of the longest step that is allowed from the start on where no halving helps."""
SHORT = 0.1
"""Longest step with the consistent tangent, against the longest one allowed: near a bifurcation,
where it is nearly singular, it would lead far away."""
UNDAMPED = 6
"""Steps from afar after which one that takes back what the last one closed or opened is halved."""
ALMOST = 0.03
"""Residual over the largest force: where the consistent tangent's step leads from below that to
above CONSISTENT_BELOW, what it meets is too crooked for whole steps, and the search goes on from
below.  Below it the model settles."""
PERIOD, AGAIN, CIRCLES = 4, 1e-2, 6
"""So many steps in turn that come back to the potential of one of the PERIOD before, but for that
share of it, from another, and do not halve the least residual, go round in a circle: one slackens
what the next but one draws taut again."""


Settle = Callable[[ShellModel, Configuration], ShellModel]
"""The model with what an outer loop holds as the configuration has it."""


class MixedSteps(NamedTuple):
    """Where the steps led."""

    model: ShellModel
    """As it has settled."""
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
    settle: Settle | None = None,
) -> MixedSteps:
    """Take up to `most` steps (MOST_STEPS) from `start` under `tension` (nt,) N, none longer than
    `max_step` (m) or turning a director by more than `max_turn` (rad), to a residual of `tolerance`
    (at least END_RESIDUAL) of the largest force.  `before`: the forces that a known equilibrium
    nearby predicts at the start.  Where the steps do not lead there, the configuration is the one
    of least energy that they met, the start included, with no element folded or crushed; with
    `settle`, met since the model settled last."""
    walk = _Walk(model, tension, start, (max_step, max_turn), before)
    most, tolerance = (
        min(most, FEW_STEPS if walk.near else MOST_STEPS),
        max(tolerance, END_RESIDUAL),
    )
    for taken in range(most + 1):
        walk.note_place()
        pulse(ITERATION, taken, walk.residual, walk.force)
        if settle is not None and walk.is_almost_there():
            walk.settle(settle)
        if walk.has_arrived(tolerance):
            return MixedSteps(walk.model, walk.c, taken, walk.solves, walk.e, walk.factor)
        if taken == most or walk.is_over(tolerance):
            break
        try:
            step = walk.solve_step()
        except ConvergenceError:
            break
        if not (walk.go_along(walk.shorten(step)) or walk.start_anew() or walk.pass_through()):
            break
    return MixedSteps(walk.model, walk.best, taken, walk.solves)


class _Walk:
    """Where whole steps stand, what they know there, and the moves that they can make."""

    def __init__(
        self,
        model: ShellModel,
        tension: Array,
        start: Configuration,
        longest: tuple[float, float],
        predicted: Prediction | None,
    ) -> None:
        self.model, self.tension, self.longest = model, tension, longest
        self.near = predicted is not None
        """Whether it follows an equilibrium that is known."""
        self.start = self.c = self.best = start
        self.predicted = predicted
        """The forces at `c` to first order; None where no step has led there."""
        self.e = self._evaluate(start, convex=not self.near)
        self.factor: Factor | None = None
        """The last tangent of a walk near by that was factorised: it serves the next ones."""
        self.solves = self.restarts = self.taken = 0
        self._forget()

    def _forget(self) -> None:
        """Begin anew with what is known of the places that were met."""
        self.circling, self.was_almost = 0, False
        self.least = self.least_residual = np.inf
        self.met: list[float] = []
        """J, the potentials of all places."""

    def is_almost_there(self) -> bool:
        """Whether the model is to settle here."""
        return self.taken > 0 and self.upright and self.residual <= ALMOST * self.force

    def settle(self, settle: Settle) -> None:
        """Settle the model, which changes the energy."""
        self.model = settle(self.model, self.c)
        self.e = self._evaluate(self.c, self.e.convex)
        self._forget()
        self.note_place()

    def _evaluate(self, c: Configuration, convex: bool) -> Evaluation:
        return self.model.evaluate(c, self.tension, tangent=False, convex=convex)

    def note_place(self) -> None:
        """Measure the place, and keep it where its energy is the least that was met."""
        self.residual, self.force = residual_norm(self.model, self.e)
        self.potential = self.model.potential(self.c, self.e.energy, self.tension)
        self.upright = not is_folded(self.model, self.c)
        nearer = self.residual < self.least_residual / 2
        self.leaves = self.was_almost and self.residual > CONSISTENT_BELOW * self.force
        self.was_almost = not self.near and self.residual <= ALMOST * self.force
        self.circling = 0 if nearer or not self._returns() else self.circling + 1
        self.least_residual = min(self.least_residual, self.residual)
        self.met.append(self.potential)
        if self.potential < self.least and (self.upright or not self.taken):
            self.least, self.best = self.potential, self.c

    def _returns(self) -> bool:
        """Whether the potential left that of one of the last steps and is back there."""
        if not np.isfinite(self.potential):
            return False
        away = np.abs(np.array(self.met[-PERIOD:]) - self.potential) > AGAIN * abs(self.potential)
        return bool(away.any() and not away[: away.nonzero()[0][-1]].all())

    def has_arrived(self, tolerance: float) -> bool:
        """Whether this is an equilibrium that a sheet can have."""
        return self._is_close(tolerance) and self.upright and bool(np.isfinite(self.potential))

    def is_over(self, tolerance: float) -> bool:
        """Whether no step from here is worth while: it is an equilibrium that no sheet has, the
        start is crushed, or the steps leave where they almost arrived or go round in a circle."""
        crushed = not np.isfinite(self.residual) or (not self.taken and self.potential == np.inf)
        return crushed or self._is_close(tolerance) or self.circling >= CIRCLES or self.leaves

    def _is_close(self, tolerance: float) -> bool:
        return self.residual <= tolerance * self.force

    def solve_step(self) -> Array:
        """The step by the tangent with the predicted forces: the consistent one where that is
        positive definite.  Raises ConvergenceError for a singular tangent."""
        step, factor = self._solve(self.factor)
        if not self.e.convex and (factor is None or factor.negative):
            self.e = self._evaluate(self.c, convex=True)
            step, factor = self._solve()
        if self.near:
            self.factor = last_factorised(factor, self.factor)
        return step

    def _solve(self, near: Factor | None = None) -> tuple[Array, Factor | None]:
        model, e, predicted, forces = self.model, self.e, self.predicted, None
        if predicted is not None:
            points, keys = e.points.force.copy(), _keys(model, e.points)
            _, new, old = np.intersect1d(keys, predicted.keys, return_indices=True)
            points[new] = predicted.points[old]
            forces = Forces(predicted.elements, points)
        tangent = model.tangent(self.c, e, forces)
        out = descent_step(model, tangent, e.reduced, *self.longest, near)
        self.solves += 1
        return out

    def shorten(self, step: Array) -> Array:
        """The step no longer than allowed, and half of one that takes back what the last one opened
        or closed."""
        part = 1.0 if self.e.convex or self.near else SHORT
        max_step, max_turn = self.longest
        step = limit_to_contact(self.model, self.e, step)
        step = limit_step(step, part * max_step, part * max_turn)[0]
        step = limit_depth(self.model, self.e, step)
        before, undamped = self.predicted, 0 if self.near else UNDAMPED
        if before is not None and self.taken >= undamped:
            return step / 2 if _reverses(self.model, self.e, step, before) else step
        return step

    def go_along(self, step: Array) -> bool:
        """Take the step, or the first of its halves that folds and crushes no element; where there
        is none, False."""
        model, convex = self.model, self.residual > CONSISTENT_BELOW * self.force and not self.near
        for _ in range(1 + MOST_HALVINGS):
            trial = model.take_step(self.c, self.e.bases, _follow_springs(model, self.e, step))
            e = self._evaluate(trial, convex)
            self.crushed = not np.isfinite(e.energy)
            # it may be passed through once, but not when it went wrong before
            lost = self.crushed and bool(
                self.near or self.restarts or not np.isfinite(self.e.energy)
            )
            self.trial = step, trial, e
            if not lost and not (self.upright and is_folded(model, trial)):
                return self._move()
            step = step / 2
        return False

    def start_anew(self) -> bool:
        """Go back to the start with shorter steps, where that may help."""
        if self.near or self.restarts >= (MOST_RESTARTS if self.crushed else 1):
            return False
        self.c, self.e, self.predicted = self.start, self._evaluate(self.start, True), None
        self.longest = SMALLER * self.longest[0], SMALLER * self.longest[1]
        self.restarts, self.taken, self.circling = self.restarts + 1, self.taken + 1, 0
        return True

    def pass_through(self) -> bool:
        """Go where the last trial stands, folded as it may be, unless it is crushed for good."""
        return not self.crushed and self._move()

    def _move(self) -> bool:
        step, trial, e = self.trial
        self.predicted = _predict(self.model, self.c, self.e, step, _travel(self.e, step))
        self.c, self.e, self.taken = trial, e, self.taken + 1
        return True


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
