"""Coupled static equilibrium of a finger and a hood, over the port and nothing else.

The hood gives its wrenches in a pose, and their derivatives.  The finger finds its equilibrium
under this affine load, which costs next to nothing.  The hood is solved again in the new pose,
until its load is the one that the finger balanced.  Each round is a Newton step of the whole (the
finger's own nonlinearity, such as a joint limit, is solved out).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.coupling.finger_equilibrium import free_stiffness
from cosim.errors import ConvergenceError, Progress, ResidualText, pulse, quiet
from cosim.port import (
    STATIC,
    Array,
    Balance,
    Hood,
    HoodJacobian,
    Load,
    Motion,
    OpenFinger,
    Pair,
    PairState,
    Response,
    State,
    Tensions,
)
from cosim.static_response import static_response

LOOSE, NEAR = 1e-3, 0.05
"""The hood is solved to LOOSE until no joint turns by more than NEAR (rad) in a round (an inexact
Newton: Dembo, Eisenstat and Steihaug 1982, SIAM J Numer Anal 19:400)."""
AT_REST = 1e-4
"""rad: a finger that would still turn so far is not at rest, however small its residual: it stands
where it would run away."""
STILL = 1e-10
"""rad: a finger that reports no forces is at rest where no joint turns further in a round."""

WHOLE_ROUNDS = 8
"""Rounds after which a step that does not lower the interface's residual is halved: a hood whose
tendons go slack and taut has kinks, between which whole steps can go to and fro for ever."""
LEAST_PART = 2.0**-10


@dataclass(frozen=True)
class CouplingOptions:
    """When Newton's iteration ends: at the `tolerance` of the finger's and of the interface's
    relative residual, or without a result after `max_iterations` rounds."""

    tolerance: float = 1e-8
    max_iterations: int = 25

    @property
    def rounds(self) -> str:
        """The most rounds, in words."""
        return f"{self.max_iterations} round{'s' * (self.max_iterations > 1)}"


@dataclass(frozen=True)
class Equilibrium:
    """A coupled equilibrium with its audit."""

    finger_state: State
    motion: Motion
    response: Response
    balance: Balance | None
    """None of a finger that reports no forces."""
    jacobian: HoodJacobian
    hood_tension: Array
    finger_tension: Array
    finger_residual: float
    """Relative imbalance of the finger against the load that it was solved with."""
    interface_residual: float
    """Relative difference, as joint torques, of that load and the hood's answer at this pose."""
    iterations: int
    """Hood solves."""
    turn: float
    """rad, the most that a joint would have turned further."""

    @property
    def known_balance(self) -> Balance:
        """The balance of a finger that reports its forces."""
        assert self.balance is not None
        return self.balance

    @property
    def load(self) -> Load:
        """The hood's load on the bodies in the equilibrium."""
        return self.response.load

    @property
    def excursion(self) -> Array:
        """The excursions (nt,) m of the hood's tendons in the equilibrium."""
        return self.response.excursion


def equilibrium(
    pair: Pair,
    start: PairState,
    tensions: Tensions,
    options: CouplingOptions,
    progress: Progress = quiet,
    first: Response | None = None,
) -> Equilibrium:
    """Joint angles, tip reaction and hood shape that balance, from a finger and a hood nearby.

    `start`: their states to begin from.  `first`: the hood's `first_answer` there, where it is
    known.  `tensions`: N, of the hood's tendons and of the finger's
    own.  `progress` is called with each round in words.  `cosim.couple` shows an example.

    Raises ConvergenceError when the interface residual stays above its tolerance (of a finger that
    reports no forces: when a joint goes on turning), or when the hood or the finger alone has no
    equilibrium."""
    finger, hood = pair
    finger_state, state = start
    interface, exact, part, turn = np.inf, False, 1.0, np.inf
    way: _CouplingStep | None = None
    for iteration in range(1, options.max_iterations + 1):
        pulse("round {} begins", iteration)
        motion = finger.motion(finger_state)
        solver = hood if exact else hood.with_tolerance(LOOSE)
        response, first = first or static_response(solver, state, motion, tensions.hood), None
        jacobian = solver.jacobian(response.state)
        balance = finger.balance(finger_state, response.load, tensions.finger)
        interface = np.nan if balance is None else balance.relative
        line = f"coupling round {iteration}: {_progress_text(interface, turn)}"
        progress(line if np.isnan(interface) else ResidualText(line, interface))
        is_late = iteration > WHOLE_ROUNDS and part > LEAST_PART
        if is_late and way is not None and interface > max(way.interface, options.tolerance):
            part, state = 0.5 * part, way.state
            finger_state = finger.between(way.finger_state, way.aim, part)
            continue
        aim, finger_residual = finger.settle(
            finger_state,
            response.load,
            jacobian.load_motion,
            tensions.finger,
            options.tolerance,
        )
        turn = float(np.abs(finger.angles(aim) - finger.angles(finger_state)).max())
        if exact and _is_at_rest(interface, turn, options.tolerance):
            return Equilibrium(
                aim if balance is None else finger_state,
                motion,
                response,
                balance,
                jacobian,
                *tensions,
                finger_residual,
                interface,
                iteration,
                turn,
            )
        exact = turn <= NEAR
        way, part = _CouplingStep(finger_state, response.state, aim, interface), 1.0
        finger_state, state = aim, response.state
    allowed = STILL if np.isnan(interface) else options.tolerance
    why = f"{_progress_text(interface, turn)}, allowed {allowed:.1e}"
    if _is_at_rest(interface, turn, options.tolerance):
        why = "they did, with the hood solved loosely, which one more round solves exactly"
    raise ConvergenceError(
        f"hood and finger did not agree in {options.rounds}: in the last one {why}. "
        "Try more rounds (solve.max_iterations), a smaller tension, or a stiffer passive joint."
    )


def first_answer(pair: Pair, start: PairState, tension: Array) -> Response:
    """The hood's answer with which an `equilibrium` from `start` begins, which depends on nothing
    but the hood, the pose and the hood's tensions (nt,) N."""
    hood, motion = pair.hood.with_tolerance(LOOSE), pair.finger.motion(start.finger)
    return static_response(hood, start.hood, motion, tension)


def _is_at_rest(interface: float, turn: float, tolerance: float) -> bool:
    if np.isnan(interface):
        return turn <= STILL
    return interface <= tolerance and turn <= AT_REST


def _progress_text(interface: float, turn: float) -> str:
    if np.isnan(interface):
        return f"a joint turned by {turn:.1e} rad"
    return f"relative residual {interface:.1e}"


class _CouplingStep(NamedTuple):
    """A step that was taken: from where, where the finger aimed, and the interface's residual at
    its beginning."""

    finger_state: State
    state: State
    aim: State
    interface: float


def moment_arms(finger: OpenFinger, e: Equilibrium) -> Array:
    """Moment arms (nq, nt) m by force: the derivative of the joint torques by each hood tendon's
    tension, d tau/d T at fixed pose (for a prestressed hood not the same as tau/T)."""
    return finger.jacobian(e.finger_state).T @ e.jacobian.load_tension


def coupled_stiffness(finger: OpenFinger, e: Equilibrium) -> Array:
    """The stiffness (k,) N m/rad, least first, of hood and finger together at their equilibrium
    with the bones free: in the motions of the joints that the tip's support allows, the hood at
    rest in each (its own degrees of freedom condensed).  The ways in which the whole leaves its
    equilibrium are the negative ones here and those of the hood with bones held, since inertia is
    additive (Haynsworth 1968, Linear Algebra Appl 1:73)."""
    slope = finger.tangent(e.finger_state, e.load, e.finger_tension, e.jacobian.load_motion)
    return free_stiffness(slope, len(finger.joints))


NO_ARM = 1e-9
"""m: a shorter moment arm is none."""


def reciprocity(
    finger: OpenFinger, hood: Hood, e: Equilibrium, tendon: int, step: float
) -> float | None:
    """Relative difference of the moment arms by force and by excursion; None for a tendon without
    moment arms.

    By force: `moment_arms`.  By excursion: the slope of all tendons' excursions over two hood
    solves with the joints moved by +-`step` (rad) along the moment arms of `tendon` (Maxwell's
    reciprocity; the slope is what excursion experiments measure)."""
    by_force = moment_arms(finger, e)
    size = np.linalg.norm(by_force[:, tendon])
    if size < NO_ARM:
        return None
    way = by_force[:, tendon] / size
    excursion = []
    for sign in (1.0, -1.0):
        move = np.zeros(len(finger.unknowns(e.finger_state)))
        move[: len(way)] = sign * step * way
        motion = finger.motion(finger.displace(e.finger_state, move))
        turned = hood.advance(e.response.state, motion, e.hood_tension, STATIC)
        excursion.append(turned.excursion)
    by_excursion = (excursion[0] - excursion[1]) / (2 * step)
    along = way @ by_force
    return float(np.abs(by_excursion - along).max() / np.abs(along).max())
