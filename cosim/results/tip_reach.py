"""The fingertip force that tendons, gravity and passive joints make on a finger without its hood:
what the force of a run is held against.

A hood passes on what its tendons pull with; it is no motor.  What a run has beyond that comes from
stress that the hood has of itself, such as that of a stiff sheet in another posture than the one in
which it was laid.

The force at a clamped fingertip says something of moment arms, whatever moment the clamp bears.
In the plane of flexion two equations are left where the distal phalanx is held, with flexion
positive, F the change of the tip's force on the world and T that of the tension:

    T (r_MCP - r_PIP) = (x_PIP - x_MCP) x F,    T (r_PIP - r_DIP) = (x_DIP - x_PIP) x F,

about the axis of flexion, which is radial (Qiu et al. 2017, J Biomech 65:82).  Across the plane
T r_abd = F_radial * reach, the reach from the MCP along the proximal phalanx to the tip, is a
convention only: a clamp bears a moment there as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import moment_arms
from cosim.errors import InputError
from cosim.fingers.common import HeldTipConfig
from cosim.models.build import Models, case_finger
from cosim.port import AXES, Array, Load, OpenFinger, State
from cosim.results.load_and_rest import LEAST_TENSION
from cosim.solve.motion import SolvedMotion
from cosim.solve.static import States
from cosim.tendons.friction import without_friction

NOT_ACTIVE = ("hood", "fingertip", "holder")
"""Sources of torque that are not counted: the hood's tendons are, by their arms."""
PASSIVE = ("passive", "limit", "tie")
LEAST_STIFFNESS = 1e-6
"""N m/rad of a joint, so that one without passive stiffness has an answer."""
LITTLE_PULL = f"the tendons bear less than {LEAST_TENSION:g} N together"
NO_TIP = "nothing holds the fingertip, or every joint is held"
NO_FORCES = "a finger in an FMU does not tell what resists"
MOVING = "the finger still moves at the end"
NO_TORQUE = "no joint torque balances a force along a straight finger"
COUNTED_TWICE = (
    "what a one-way pass hands over in another place, or with the joints' forces, is no tendon's; "
    "see double_counted and one_way"
)


def tip_force_over_reach(case: Case, models: Models, states: States) -> float | str:
    """The loaded fingertip force over the reach, which the tensions of all tendons make with their
    arms, each alone and without friction, with gravity and what passive joints bear in the posture;
    or why that is not judged.

    Arms are the larger of those at rest and under load; of a hood with friction, whose arms at a
    fixed state are of what sticks, the change of its torques stands for them."""
    loaded, unloaded, finger = states.loaded, states.unloaded, models.finger
    if loaded.balance is None:
        return NO_FORCES
    one_way = case.coupling.one_way
    if states.one_way and (one_way.lumping, one_way.joint_contact) != ("bodies", "none"):
        return COUNTED_TWICE
    if loaded.hood_tension.sum() + loaded.finger_tension.sum() < LEAST_TENSION:
        return LITTLE_PULL
    if case.hood.has_friction:
        change = loaded.known_balance.torque["hood"] - unloaded.known_balance.torque["hood"]
        pulls = np.array([[change]])
    else:
        arms = np.array([moment_arms(finger, e).T for e in (loaded, unloaded)])
        pulls = arms * loaded.hood_tension[:, None]
    reach = _reach(finger, models.posture, pulls, loaded.finger_tension)
    force = float(np.linalg.norm(finger.tip_force(loaded.finger_state)))
    return force / reach if reach > 0 else NO_TIP


def motion_over_reach(case: Case, moved: SolvedMotion) -> float | str:
    """`tip_force_over_reach` at the end of a motion that has come to rest: on the finger held where
    its tip is, with the arms of the end."""
    t, history = moved.models, moved.history
    first, last = history.frames[0], history.frames[-1]
    if not case.finger.is_native:
        return NO_FORCES
    stated = case.native_finger()
    if stated.tip.kind in ("free", "posture"):
        return NO_TIP
    if not moved.rest.is_reached:
        return MOVING
    if last.tension.sum() < LEAST_TENSION:
        return LITTLE_PULL
    held = stated.model_copy(update={"tip": HeldTipConfig(kind="point")})
    try:
        finger = case_finger(case.model_copy(update={"finger": held}))
    except InputError:
        return NO_TORQUE
    n = len(t.hood.tendons)
    turns = [t.finger.jacobian(frame.angles) for frame in (first, last)]
    if case.hood.has_friction:
        torques = [j.T @ f.total.ravel() for j, f in zip(turns, (first, last), strict=True)]
        pulls = np.array([[torques[1] - torques[0]]])
    else:
        arms = turns[1].T @ t.hood.jacobian(history.moment.coupled.hood).load_tension
        pulls = (arms * last.tension[:n]).T[None]
    reach = _reach(finger, t.posture, pulls, last.tension[n:])
    return float(np.linalg.norm(history.tips[-1][:3])) / reach if reach > 0 else NO_TIP


def _reach(finger: OpenFinger, posture: Mapping[str, float], pulls: Array, tension: Array) -> float:
    """The sum (N) of the fingertip forces of all torques: of `pulls` (k, n, nq) N m the largest of
    each k, of the finger's own tendons under `tension` (N) without friction, of gravity, and of
    passive joints in the posture."""
    finger = without_friction(finger)
    start = finger.start(posture)
    torques = finger.balance(start, _no_load(finger), tension).torque
    active = {source: t for source, t in torques.items() if source not in NOT_ACTIVE}
    passive = sum((active.pop(s) for s in PASSIVE if s in active), np.zeros(len(finger.joints)))
    others = tip_forces(finger, start, np.array([*active.values(), passive]))
    largest = np.max([tip_forces(finger, start, each) for each in pulls], axis=0)
    return float(largest.sum() + others.sum())


def tip_forces(finger: OpenFinger, at: State, torques: Array) -> Array:
    """The sizes (n,) N of the fingertip forces that torques (n, nq) N m about its joints make each,
    to first order, on a finger without a hood at rest in `at`; zero where nothing holds the tip."""
    nq, load = len(finger.joints), _no_load(finger)
    twists = 6 * len(finger.bodies)
    slope = finger.tangent(at, load, np.zeros(len(finger.tendons)), np.zeros((twists, twists)))
    m = len(slope) - nq
    if not m or not len(torques):
        return np.zeros(len(torques))
    slope[:nq, :nq] -= LEAST_STIFFNESS * np.eye(nq)
    right = np.zeros((nq + m, len(torques)))
    right[:nq] = -torques.T
    steps = np.linalg.solve(slope, right)
    held, before = np.eye(nq + m)[nq:], finger.tip_force(at)
    by_reaction = [finger.tip_force(finger.displace(at, unit)) - before for unit in held]
    return np.asarray(np.linalg.norm(steps[nq:].T @ np.array(by_reaction), axis=1))


def _no_load(finger: OpenFinger) -> Load:
    wrench = np.zeros((len(finger.bodies), 1, 6))
    return Load(finger.bodies, ("none",), wrench, np.zeros((0, 6)))


RADIAL = AXES.index("radial")
STRAIGHT = np.sin(np.radians(1.0))
"""Sine of the PIP angle below which both equations are one."""


def arm_differences(points: Array, force: Array, tension: float) -> dict[str, Any]:
    """Differences of moment arms (mm) that a clamped fingertip's force tells, by the keys of a
    summary, flexion and radial abduction positive.

    points: (4, 3) m, the centres of MCP, PIP and DIP and the tip; force: (3,) N, of the tip on the
    world, loaded less unloaded; tension: N, the loaded tendon's change, or the sum of several,
    whose arms then count by their tensions.  Empty with a straight PIP, where the two differences
    are one number."""
    bones = np.diff(points[:3], axis=0)
    lengths = np.linalg.norm(bones, axis=1)
    if np.linalg.norm(np.cross(*bones)) < STRAIGHT * lengths.prod():
        return {}
    first, second = 1e3 * np.cross(bones, force)[:, RADIAL] / tension
    reach = (points[3] - points[0]) @ bones[0] / lengths[0]
    return {
        "arm_difference_mm": {"MCP_PIP": float(first), "PIP_DIP": float(second)},
        "abduction_arm_mm": float(1e3 * force[RADIAL] * reach / tension),
    }


def chain_points(lengths: Sequence[float] | Array, posture: Sequence[float]) -> Array:
    """The centres of MCP, PIP and DIP and the tip (4, 3), world frame, of a finger of three
    phalanges (unit as given) that flexes by `posture`, deg, in a plane."""
    bend = np.radians(np.cumsum(posture))
    along = np.stack([np.cos(bend), np.zeros(3), -np.sin(bend)], axis=1)
    steps = np.asarray(lengths)[:, None] * along
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def to_world(force: Array, posture: Sequence[float]) -> Array:
    """Turn a force (3,) along the distal phalanx's axes (distal, radial, dorsal) to the world's."""
    bend = np.radians(np.sum(posture))
    c, s = np.cos(bend), np.sin(bend)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ force


def force_over_tension(points: Array, first: float, second: float) -> Array:
    """The distal and dorsal force over tension (2,), world, that differences of arms make: the
    inverse of `arm_differences`, in the unit of both."""
    distal, dorsal = np.diff(points[:3], axis=0)[:, [0, 2]].T
    return np.linalg.solve(np.stack([dorsal, -distal], axis=1), [first, second])
