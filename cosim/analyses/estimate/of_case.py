"""Estimates of a case: one target in its posture, or a motion, with an audit that runs forward."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from cosim.analyses.estimate.capacity import Capacity, Weights, capacity
from cosim.analyses.estimate.demand import Demand, force_demand, torque_demand
from cosim.analyses.estimate.held_finger import HeldFinger, Torques
from cosim.analyses.estimate.joint_motion import JointMotion
from cosim.analyses.estimate.tensions import (
    MOST_ROUNDS,
    Bounds,
    Cost,
    Estimate,
    estimate,
    format_components,
)
from cosim.case.schema import Case
from cosim.errors import ConvergenceError, CosimError, InputError, Progress, span
from cosim.fingers.kinds import with_mass
from cosim.models.build import Models, build
from cosim.port import AXES, Array, PairState, State, Tensions
from cosim.schema import units
from cosim.solve.session import solve_equilibrium
from cosim.solve.solvers import limit_patience
from rigid.mujoco.finger import MujocoFinger, needed_torque
from rigid.muscle.least_cost import Power

STAGES = (0.25, 0.5, 0.75, 1.0)
"""Parts of a force by which it is raised where it was not reached at once."""
FIRST = (0.0, 0.02, 0.1)
"""Parts of the greatest tensions from which tensions are looked for in turn, where the last ones
lead nowhere: slack tendons of a net do not say what they would do if they were taut."""
OPEN = "free"
"""In place of a component of a force that nothing is asked of."""
COMPONENT = re.compile(rf"\s*({OPEN}|[-+]?[\d.]+(?:e[-+]?\d+)?\s*[a-zA-Z]+)\s*,?", re.I)


@dataclass(frozen=True)
class Setup:
    """What all estimates of a case share."""

    case: Case
    models: Models
    capacity: Capacity
    cost: Cost

    @property
    def bounds(self) -> Bounds:
        """Least and greatest force (n,) N of every tendon."""
        return Bounds(self.capacity.least, self.capacity.most)

    def hold_finger(self, posture: Mapping[str, float]) -> HeldFinger:
        """The finger in a posture (rad).  Raises InputError for one outside its ranges."""
        return HeldFinger(self.models, self.models.finger.start(posture))


@dataclass(frozen=True)
class EstimateAudit:
    """The case run forward under the estimated tensions, from its own start."""

    components: Array
    """(d,) the demand's components there."""
    joint_change: Array
    """(nq,) rad, by how much the joints left the posture; zero where they are held."""


@dataclass(frozen=True)
class EstimateAnswer:
    """An estimate of one target."""

    demand: Demand
    target: Array
    """(d,) the demand's components that were asked for."""
    estimate: Estimate
    audit: EstimateAudit


def setup(
    case: Case,
    weights: Weights,
    power: Power,
    areas: Mapping[str, float],
    most: Mapping[str, float],
) -> Setup:
    """Models and costs.  Raises InputError."""
    return with_costs(case, build(case), weights, power, areas, most)


def with_costs(
    case: Case,
    models: Models,
    weights: Weights,
    power: Power,
    areas: Mapping[str, float],
    most: Mapping[str, float],
) -> Setup:
    """The same of models that are built.  Raises InputError."""
    names = (*models.hood.tendons, *models.finger.tendons)
    bear = capacity(case, names, areas, most, weights)
    return Setup(case, models, bear, Cost(bear.weight(weights), power))


def parse_force(text: str) -> tuple[float | None, float | None, float | None]:
    """Read a force (N) along distal, radial and dorsal; None where a component is left open.

    Raises InputError for anything but three of them."""
    parts, rest = COMPONENT.findall(text), COMPONENT.sub("", text).strip()
    if len(parts) != 3 or rest:
        raise InputError(
            f'--force "{text}": expected the fingertip\'s force on the world along distal, radial '
            'and dorsal, for example "-1 N 0 N -2 N"; "free" leaves a component open'
        )
    try:
        x, y, z = (None if p.lower() == OPEN else units.parse(p, units.FORCE) for p in parts)
    except ValueError as error:
        raise InputError(f'--force "{text}": {error}') from error
    if x is None and y is None and z is None:
        raise InputError(f'--force "{text}": every component is left open; ask for one at least')
    return x, y, z


def target_torques(joints: Sequence[str], given: Mapping[str, float]) -> Array:
    """The wanted torques (nq,) N m; a joint that is not named bears none.  Raises InputError for an
    unknown one."""
    strange = [name for name in given if name.removesuffix("_flexion") not in joints]
    if strange:
        raise InputError(
            f"torque {', '.join(strange)}: unknown joint; the joints are {', '.join(joints)}"
        )
    named = {name.removesuffix("_flexion"): value for name, value in given.items()}
    return np.array([named.get(joint, 0.0) for joint in joints])


def for_force(
    s: Setup,
    force: tuple[float | None, float | None, float | None],
    progress: Progress,
) -> EstimateAnswer:
    """Tensions for a fingertip force in the case's posture, audited by its coupled equilibrium.

    Raises InputError and ConvergenceError."""
    held = s.hold_finger(s.models.posture)
    first = held.at(s.capacity.least, held.begin())
    left = [axis for axis, value in zip(AXES, force, strict=True) if value is None]
    demand = force_demand(held, first, left)
    stated = dict(zip(AXES, force, strict=True))
    across = [a for a in AXES if a not in demand.names and stated[a]]
    if across:
        raise InputError(
            f"force: this finger's tip bears no force along {', '.join(across)}; write 0 N there"
        )
    wanted = np.array([stated[name] or 0.0 for name in demand.names])
    estimated = _approach_demand(s, held, demand, wanted, first, progress)
    progress("running the case forward")
    return EstimateAnswer(demand, wanted, estimated, _forward(s, held, demand, estimated, progress))


def _approach_demand(
    s: Setup,
    held: HeldFinger,
    demand: Demand,
    wanted: Array,
    first: Torques,
    progress: Progress,
) -> Estimate:
    """The estimate at once; or, where a hood whose shares vary stands far from its start and finds
    the wanted out of reach there, in STAGES from what its least tensions make."""
    start = s.capacity.least, first.state
    try:
        return estimate(held, demand, wanted, s.bounds, s.cost, start, progress)
    except InputError as error:
        if s.case.hood.shares_fixed:
            raise
        at_once = error
    begun, reached = demand.component_values(first.torque), 0.0
    for part in STAGES:
        progress(f"out of reach at once; {part:.0%} of the way")
        aim = begun + part * (wanted - begun)
        try:
            estimated = estimate(held, demand, aim, s.bounds, s.cost, start, progress)
        except InputError:
            raise InputError(
                f"{at_once}. The hood's shares vary with tension: this holds where the search "
                f"ended. In stages from the unloaded finger, {reached:.0%} of the way was reached, "
                f"{part:.0%} was not"
            ) from at_once
        start, reached = (estimated.tension, estimated.at.state), part
    return estimated


def _forward(
    s: Setup, held: HeldFinger, demand: Demand, estimated: Estimate, progress: Progress
) -> EstimateAudit:
    finger, hood = s.models.finger, s.models.hood
    split = len(hood.tendons)
    try:
        e = solve_equilibrium(
            s.case,
            s.models,
            PairState(held.finger_state, held.begin()),
            Tensions(estimated.tension[:split], estimated.tension[split:]),
            progress,
        )
    except ConvergenceError as error:
        raise ConvergenceError(
            f"estimate: the tensions balance the target in the posture, but the case run forward "
            f"with them finds no equilibrium: {error} A fingertip held at a point can turn away; "
            'write finger.tip.kind = "clamped"'
        ) from error
    turned = finger.angles(e.finger_state) - finger.angles(held.finger_state)
    return EstimateAudit(
        np.array([e.known_balance.tip_force[AXES.index(a)] for a in demand.names]), turned
    )


def for_torques(s: Setup, given: Mapping[str, float], progress: Progress) -> EstimateAnswer:
    """Tensions of which hood and muscles make joint torques (N m) in the case's posture, audited by
    a hood that is solved anew, from its start, under them."""
    held = s.hold_finger(s.models.posture)
    demand = torque_demand(held)
    wanted = target_torques(s.models.finger.joints, given)
    first = held.at(s.capacity.least, held.begin())
    estimated = _approach_demand(s, held, demand, wanted, first, progress)
    anew = held.at(estimated.tension, held.begin())
    return EstimateAnswer(
        demand,
        wanted,
        estimated,
        EstimateAudit(demand.component_values(anew.torque), np.zeros(len(wanted))),
    )


@dataclass(frozen=True)
class MotionEstimate:
    """Estimates along a motion of n samples."""

    motion: JointMotion
    required_torque: Array
    """(n, nq) N m."""
    torque: Array
    """(n, nq) N m, of hood and muscles; the required one but for a reserve."""
    tension: Array
    """(n, nt) N."""
    worst: float
    """Relative, of the conditions of optimality and of the torques."""
    rounds: int
    stopped: CosimError | KeyboardInterrupt | None = None
    """Why the motion's other times have no estimate; None where all have one."""


def for_motion(
    s: Setup, motion: JointMotion, progress: Progress, reserve: float = 0.0
) -> MotionEstimate:
    """Tensions along a motion, of which hood and muscles make its torques by inverse dynamics, each
    sample from the one before; a torque may lack `reserve` N m where tensions make no better.  A
    time is looked for no longer than the case's `solve.patience`, and by `most_solves` hood solves.

    Raises InputError (a finger without mass, angles out of range, torques out of reach), naming the
    time, and ConvergenceError, where the first time has none; after it what was reached is
    returned, with the error."""
    needed = _required_torque(s, motion)
    joints = s.models.finger.joints
    tensions: list[Array] = []
    start, torque, worst, rounds = None, [], 0.0, 0
    stopped: CosimError | KeyboardInterrupt | None = None
    each = f"at most {most_solves(s)} hood solves each"
    if s.case.solve.patience is not None:
        each += f", and {span(s.case.solve.patience)} (solve.patience)"
    progress(f"{len(motion.time)} times, {each}")
    for k, time in enumerate(motion.time):
        try:
            held = s.hold_finger(dict(zip(joints, motion.angle[k], strict=True)))
            with limit_patience(s.case, progress):
                estimated = cheapest(s, held, torque_demand(held), needed[k], start, reserve)
        except (InputError, ConvergenceError) as error:
            stopped = type(error)(
                f"at {time:.4g} s of the motion: {str(error).rstrip('.')}. Of a motion, --reserve "
                "says how much torque may lack"
            )
            stopped.__cause__ = error
        except KeyboardInterrupt as interrupt:
            stopped = interrupt
        if stopped is not None:
            if not tensions:
                raise stopped
            break
        progress(f"{k + 1}/{len(motion.time)}, {time:.3g} s: {estimated.rounds} rounds")
        start = estimated.tension, estimated.at.state
        tensions.append(estimated.tension)
        torque.append(estimated.components)
        worst = max(worst, estimated.optimum.miss, estimated.gap)
        rounds += estimated.rounds
    n = len(tensions)
    return MotionEstimate(
        motion.first(n), needed[:n], np.array(torque), np.array(tensions), worst, rounds, stopped
    )


def most_solves(s: Setup) -> int:
    """The most hood solves that `cheapest` takes, but for those of steps that are halved."""
    return MOST_ROUNDS * (1 if s.case.hood.shares_fixed else 1 + len(FIRST))


def cheapest(
    s: Setup,
    held: HeldFinger,
    demand: Demand,
    wanted: Array,
    start: tuple[Array, State] | None,
    reserve: float,
) -> Estimate:
    """The cheapest tensions that make the components `wanted` (d,) but for a `reserve`, looked for
    from `start`, then from FIRST parts of the greatest tensions.  Raises as `estimate`."""
    parts = FIRST[:1] if s.case.hood.shares_fixed else FIRST
    starts = [(np.maximum(part * s.capacity.most, s.capacity.least), None) for part in parts]
    failure = None
    for tension, state in starts if start is None else [start, *starts]:
        begin = tension, held.begin() if state is None else state
        try:
            return estimate(held, demand, wanted, s.bounds, s.cost, begin, reserve=reserve)
        except (InputError, ConvergenceError) as error:
            failure = failure or error
    assert failure is not None
    raise failure


def _required_torque(s: Setup, motion: JointMotion) -> Array:
    finger = cast(MujocoFinger, s.models.finger)
    if not s.case.finger.has_mass:
        raise InputError(f"--motion takes a finger with mass: {with_mass()}")
    rows = zip(motion.angle, motion.rate, motion.acceleration, strict=True)
    return np.array([needed_torque(finger, *row) for row in rows])


def force_basis(s: Setup) -> tuple[Demand, Torques]:
    """The demand of any fingertip force, and the torques at the least tensions, for a set of
    forces without a target."""
    held = s.hold_finger(s.models.posture)
    first = held.at(s.capacity.least, held.begin())
    return force_demand(held, first), first


def forward_run_text(answer: EstimateAnswer) -> str:
    """What was asked for and what the forward run made, in words."""
    return (
        f"asked for {format_components(answer.demand, answer.target)}; made, run forward: "
        + format_components(answer.demand, answer.audit.components)
    )
