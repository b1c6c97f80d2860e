"""Fingers, loads and a solve that the tests of the fingers share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.coupling.equilibrium import CouplingOptions, equilibrium
from cosim.coupling.finger_equilibrium import balance_finger
from cosim.port import Array, Balance, Finger, Load, Pair, PairState, Tensions
from meshes.skeleton import JOINTS, Skeleton, index_finger
from rigid.chain import hinge
from rigid.chain.hinge import HingeFinger
from rigid.chain.joint_torques import joint_law
from rigid.chain.statics import ChainFinger, FingerState
from rigid.chain.support import Support
from rigid.fingers.index import finger_model
from rigid.hoods.pulley import Cable, PulleyHood
from rigid.mujoco.finger import MujocoFinger

POSTURE = {"MCP": np.radians(30), "PIP": np.radians(45), "DIP": np.radians(15)}
STIFFNESS = {"MCP": 0.04, "PIP": 0.03, "DIP": 0.02}
REST = {"MCP": 0.6, "PIP": 0.5, "DIP": 0.2}
SOFT = 2.0  # N m/rad, so that the limits do not dwarf the other terms of a tangent
LENGTHS = (0.0426, 0.0251, 0.0181)


def straight_skeleton() -> Skeleton:
    """Parallel flexion axes and abduction normal to them."""
    axis = np.array([[0.0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 1, 0]])
    return Skeleton(np.array([0.0, *LENGTHS]), np.tile(np.eye(3), (3, 1, 1)), axis, {})


def hinge_finger(support: Support) -> HingeFinger:
    law = joint_law(hinge.JOINTS, STIFFNESS, REST, limit_stiffness=SOFT).hold_about(POSTURE, 0.02)
    return HingeFinger(LENGTHS, law=law, support=support)


def mujoco_finger(support: Support, central: float | None = None) -> MujocoFinger:
    stiffness = {**STIFFNESS, "MCP_abduction": 0.05}
    law = joint_law(JOINTS, stiffness, REST, limit_stiffness=SOFT).hold_about(POSTURE, 0.02)
    return MujocoFinger(
        finger_model(index_finger(), central=central),
        law=law,
        support=support,
        gravity=(1.0, -2.0, -9.0),
    )


def at_rest(finger: ChainFinger, state: FingerState, tension: Array) -> tuple[FingerState, Balance]:
    """The stable equilibrium of a finger with its own tendons' tensions (N) and no hood."""
    n = len(finger.bodies)
    none = Load(finger.bodies, ("hood",), np.zeros((n, 1, 6)), np.zeros((0, 6)))
    for _ in range(50):
        state, balance = balance_finger(
            finger, state, none, tension, np.zeros((6 * n, 6 * n)), 1e-9
        )
        if balance.relative <= 1e-9:
            return state, balance
    raise AssertionError(f"no rest: a relative residual of {balance.relative:.1e}")


def random_load(bodies: tuple[str, ...]) -> Load:
    wrench = np.random.default_rng(3).normal(size=(len(bodies), 2, 6)) * [5, 5, 5, 0.1, 0.1, 0.1]
    return Load(bodies, ("insertion", "contact"), wrench, np.zeros((0, 6)))


def loaded_state(finger: ChainFinger) -> tuple[FingerState, Load, Array]:
    """A state past its limits with a reaction and off its target, a load and tensions."""
    state = finger.start(POSTURE)
    n = len(finger.joints)
    step = np.concatenate([np.linspace(0.03, 0.05, n), np.arange(1.0, len(state.basis) + 1)])
    return (
        finger.displace(state, step),
        random_load(finger.bodies),
        np.arange(3.0, 3.0 + len(finger.tendons)),
    )


def cables_over_all_joints(h: float = 0.006, a: float = 0.008) -> PulleyHood:
    """One dorsal cable with eyelets at distance a on both sides of each joint, h above it."""
    points = [("metacarpal", (-a, 0.0, h))]
    for body, length in zip(hinge.BODIES[1:], LENGTHS, strict=True):
        points += [(body, (a, 0.0, h)), (body, (length - a, 0.0, h))]
    cable = Cable(tuple(points[:-1]))
    return PulleyHood({"EDC": cable}, HingeFinger(LENGTHS).motion(HingeFinger(LENGTHS).start({})))


def solve(
    finger: Finger, hood: PulleyHood, tension: Array, own: Array, first: Mapping = POSTURE
) -> tuple[FingerState, Load, Balance]:
    """The coupled equilibrium nearest to the posture `first`."""
    state = finger.start(first)
    start = PairState(state, hood.start(finger.motion(state)))
    tensions = Tensions(tension, own)
    e = equilibrium(Pair(finger, hood), start, tensions, CouplingOptions(1e-12))
    return e.finger_state, e.load, e.known_balance
