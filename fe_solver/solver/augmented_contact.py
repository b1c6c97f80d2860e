"""Contact without penetration: the outer loop of the augmented Lagrangian, and of friction.

Each round solves the smooth problem of `fe_solver.solver.newton` with the multipliers, the limits
of friction and their normals held, then takes from its answer new ones (Uzawa's update; Simo and
Laursen 1992, Comput Struct 42:97).  Whole steps from afar take new ones as they go, once they are
almost there.  No round is solved more exactly than its own update is right.  Where it ends every
pressed node is at its contact level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array
from fe_solver.forces.contact import Contact, Grip, normal_pressure
from fe_solver.forces.ramp import inverse_ramp
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from fe_solver.solver.residual import residual_norm

LOOSE = 1e-3
"""Residual over the largest force to which the first rounds are solved."""
ROUND = 0.1
"""Share of its first residual to which a round is solved, other than the last: the next update
changes about as much."""
NEAR_BALANCE = 0.1
"""Residual over the largest force up to which the second solution searches from where the first one
ended, as all later ones do: whole steps go round in circles where points stick after one and slide
after the next."""
ENOUGH = 0.25
"""What a round should leave of the penetration; a contact that leaves more is made stiffer."""
STIFFER = 10.0
MOST_RAISES = 3
PIN = 2e4
"""Multiple of the largest stiffness of a node that a pressed node has in the tangent, where it
stands for a constraint; the error of a derivative is its inverse, the loss of digits it times
1e-16."""


@dataclass(frozen=True)
class AugmentOptions:
    """When the outer loop, which updates multipliers and friction, is done."""

    penetration: float = 1e-6
    """m, the largest distance of a pressed node from its contact level (either way)."""
    friction: float = 1e-6
    """The largest change of friction's limit in a round, over the largest limit."""
    max_rounds: int = 60
    """Rounds after which it gives up."""

    def __post_init__(self) -> None:
        if not (self.penetration > 0 and self.friction > 0 and self.max_rounds > 0):
            raise InputError(f"expected positive tolerances and rounds, got {self}")


def solve_augmented(
    model: ShellModel,
    start: Configuration,
    tension: Array,
    options: NewtonOptions,
    augment: AugmentOptions | None = None,
) -> Solution:
    """Equilibrium as of `newton.solve`, without penetration and with Coulomb's friction.

    The solution's `model` holds the multipliers and the state of friction.  Solve the next
    increment of load or posture with `next_increment(solution)`, which lets the anchors follow what
    has slid; without friction that only saves rounds.  Its tangent is that of the problem with the
    pressed nodes held on their surfaces (the curvature of which turns the pressure), so that the
    condensed derivatives are those of the constrained problem; friction enters it with its limits
    as they are.

    Raises ConvergenceError where Newton does not converge, or the rounds do not; then with the
    body and the node that penetrates most."""
    augment = augment or AugmentOptions()
    model = model.with_changes(contacts=tuple([_initialise(k, start) for k in model.contacts]))
    tolerance = max(LOOSE, options.tolerance)
    settle = partial(_settle, augment)
    loose = replace(options, tolerance=tolerance)
    solution = solve(model, start, tension, loose, settle=settle)
    iterations, solves, raises, last_error = solution.iterations, solution.solves, 0, np.inf
    for done in range(augment.max_rounds):
        model = solution.model
        looks = [_update_of(k, solution.configuration) for k in model.contacts]
        error = max((look.error.max(initial=0.0) for look in looks), default=0.0)
        left = max(error / augment.penetration, _limit_change(looks) / augment.friction)
        if left <= 1 and tolerance <= options.tolerance:
            return _constrain(replace(solution, iterations=iterations, solves=solves), looks)
        contacts = [look.apply(error > augment.penetration) for look in looks]
        if error > max(ENOUGH * last_error, augment.penetration) and raises < MOST_RAISES:
            contacts, raises = [_stiffer(k) for k in contacts], raises + 1
        last_error = error
        model = model.with_changes(contacts=tuple(contacts))
        e = model.evaluate(solution.configuration, tension, tangent=False)
        missed, force = residual_norm(model, e)
        first = missed / force if force > 0 else 0.0
        share = ROUND * first if left > 1 else 0.0
        tolerance = max(min(LOOSE, share), options.tolerance)
        loose, near = replace(options, tolerance=tolerance), done > 0 or first <= NEAR_BALANCE
        solution = solve(model, solution.configuration, tension, loose, near, settle=settle)
        iterations, solves = iterations + solution.iterations, solves + solution.solves
    raise ConvergenceError(_stall_message(model, solution.configuration, looks, augment))


def next_increment(solution: Solution) -> ShellModel:
    """The model for the increment after a solved one: multipliers and limits as they are, anchors
    moved by what has slid, and the heat of it added to what is dissipated."""
    c = solution.configuration
    contacts = [_move_anchors(replace(k, pin=None), c) for k in solution.model.contacts]
    return solution.model.with_changes(contacts=tuple(contacts))


@dataclass(frozen=True)
class _ContactUpdate:
    """A contact beside the solution of its smooth problem."""

    contact: Contact
    pressure: Array | None
    """(k,) Pa, the multiplier to go on with; a layer has none."""
    normal: Array
    """(k, 3), body frame."""
    limit: Array
    """(k,) N, of friction."""
    error: Array
    """(k,) m, how far the depth at which the multiplier acts is from its place, which is the depth
    where a node is pressed."""

    def apply(self, multipliers: bool) -> Contact:
        """The contact with the limits and normals of the solution, and with its multipliers where
        these are wanted: they go on changing after the gaps have closed, and friction waits."""
        grip = self.contact.grip
        if grip is not None:
            grip = replace(grip, normal=self.normal, limit=self.limit)
        pressure = self.pressure if multipliers else self.contact.pressure
        return replace(self.contact, pressure=pressure, grip=grip)

    @property
    def change(self) -> Array:
        """The change (k,) N of the limits of friction, in size and direction."""
        grip = self.contact.grip
        if grip is None:
            return np.zeros(0)
        turn = np.linalg.norm(self.normal - grip.normal, axis=1)
        return np.abs(self.limit - grip.limit) + grip.limit * turn


def _update_of(contact: Contact, c: Configuration) -> _ContactUpdate:
    local = contact.local(c.x, c.position, c.rotation)
    value, normal, _ = contact.surface.distance(local)
    length = np.linalg.norm(normal, axis=1, keepdims=True)  # a spline's gradient is about a unit
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    depth, shift = contact.offset - value, contact.shift
    pressure = normal_pressure(contact, local, depth + shift)
    limit = contact.friction * pressure * contact.weight
    if contact.gives:  # only friction's limits are to be found
        return _ContactUpdate(contact, None, normal, limit, np.zeros_like(depth))
    error = np.abs(np.maximum(depth, -(shift + contact.smoothing)))
    if contact.pressure is None:
        error = np.where(pressure > 0, np.inf, 0.0)
    error = np.where(contact.weight > 0, error, 0.0)
    return _ContactUpdate(contact, pressure, normal, limit, error)


def _limit_change(looks: Sequence[_ContactUpdate]) -> float:
    """Largest change of a limit of friction over the largest limit."""
    largest = max((look.limit.max(initial=0.0) for look in looks), default=0.0)
    change = max((look.change.max(initial=0.0) for look in looks), default=0.0)
    return float(change / largest) if change > 0 else 0.0


def _settle(augment: AugmentOptions, model: ShellModel, c: Configuration) -> ShellModel:
    """The model with the multipliers and limits of a configuration that is almost balanced."""
    looks = [_update_of(k, c) for k in model.contacts]
    error = max((look.error.max(initial=0.0) for look in looks), default=0.0)
    contacts = [look.apply(error > augment.penetration) for look in looks]
    return model.with_changes(contacts=tuple(contacts))


def _initialise(contact: Contact, start: Configuration) -> Contact:
    """The contact without pins; with friction, anchored where its nodes are at the start."""
    if contact.friction == 0 or contact.grip is not None:
        return replace(contact, pin=None)
    local = contact.local(start.x, start.position, start.rotation)
    none = np.zeros(len(local))
    grip = Grip(local, contact.surface.distance(local).gradient, none, none)
    return replace(contact, pin=None, grip=grip)


def _stiffer(contact: Contact) -> Contact:
    """A stiffer contact, its multipliers and its friction as they were."""
    if contact.gives:
        return contact
    shear = contact.stiffness if contact.shear is None else contact.shear
    return replace(contact, stiffness=STIFFER * contact.stiffness, shear=shear)


def _constrain(solution: Solution, looks: Sequence[_ContactUpdate]) -> Solution:
    """The solution with the tangent of the constrained problem; held are the nodes whose multiplier
    outweighs their gap, both as lengths."""
    model = solution.model
    assert solution.evaluation.data is not None
    pin = PIN * np.abs(solution.evaluation.data[model.pattern.diagonal[:, :3, :3]]).max()
    contacts = []
    for look in looks:
        k = look.contact
        if look.pressure is None:
            contacts.append(k)
            continue
        presses = inverse_ramp(look.pressure / k.stiffness, k.smoothing) + k.smoothing > look.error
        contacts.append(replace(k, pin=np.where((k.weight > 0) & presses, pin, 0.0)))
    model = model.with_changes(contacts=tuple(contacts))
    evaluation = model.evaluate(solution.configuration, solution.tension, tangent=True)
    return replace(solution, model=model, evaluation=evaluation)


def _move_anchors(contact: Contact, c: Configuration) -> Contact:
    grip = contact.grip
    if grip is None:
        return contact
    away = contact.local(c.x, c.position, c.rotation) - grip.anchor
    slip = away - np.einsum("ki,ki->k", away, grip.normal)[:, None] * grip.normal
    size, stick = np.linalg.norm(slip, axis=1), contact.stick
    elastic = np.divide(grip.limit, stick, out=np.zeros_like(size), where=stick > 0)
    excess = np.maximum(size - elastic, 0.0)
    part = np.divide(excess, size, out=np.zeros_like(size), where=size > 0)
    anchor = grip.anchor + part[:, None] * slip
    heat = grip.dissipated + grip.limit * excess
    return replace(contact, grip=replace(grip, anchor=anchor, dissipated=heat))


def _stall_message(
    model: ShellModel, c: Configuration, looks: Sequence[_ContactUpdate], augment: AugmentOptions
) -> str:
    worst = max(looks, key=lambda look: look.error.max(initial=0.0))
    i = int(np.argmax(worst.error))
    node, body = worst.contact.nodes[i], model.bodies[worst.contact.body]
    place = ", ".join(f"{v * 1e3:.2f}" for v in c.x[node])
    return (
        f"contact did not settle in {augment.max_rounds} rounds: node {node} at ({place}) mm is "
        f"{worst.error[i] * 1e6:.3g} um from its contact level on the body {body}, expected at "
        f"most {augment.penetration * 1e6:.3g} um; the limits of friction still change by "
        f"{_limit_change(looks):.1e}, expected {augment.friction:.1e}. Take a stiffer contact, "
        "smaller steps or more rounds."
    )
