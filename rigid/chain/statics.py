"""Static equilibrium of a finger that is a serial chain of hinges, whatever computes its poses.

    residual = [ tau_hood + tau_muscles + tau_gravity + tau_joints + tau_ties + J_tip^T B^T r ]
               [ scale * B (x_tip - target, turn of the tip from the one held)                ]

in the unknowns z = (q, r), where tau_joints are passive torques and limits, and the world acts on
the tip with the wrench B^T r.  Where the joints are held, the torques that hold them are what is
left of the sum, and q - q_held is the residual.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.coupling.finger_equilibrium import balance_finger
from cosim.errors import InputError
from cosim.port import Array, Balance, Load, Motion, check_tensions
from rigid.chain.joint_torques import JointLaw, by_joint
from rigid.chain.kinematics import (
    Chain,
    body_jacobian,
    geometric_stiffness,
    ground_reaction,
    joint_loads,
    joint_reactions,
    joint_wrenches,
    move_wrench,
    tip_jacobian,
)
from rigid.chain.support import Support, turn_gap
from rigid.chain.ties import Ties

GAP_SCALE = 100.0
"""N: a tip 1 um off its target counts as much as 1e-4 N m, about a hundredth of a joint torque."""
TURN_SCALE = 1.0
"""N m: the same for a tip turned by 0.1 mrad."""
TORQUE_FLOOR = 1e-6
"""N m: below this no torque is called large."""


@dataclass(frozen=True)
class FingerState:
    """Joint angles (nq,) rad and those that the finger was put in, the world's wrench on the tip
    (6,) N and N m about it, the pose in which the tip was put, (3,) m and (3, 3), and the support's
    unit wrenches there (m, 6)."""

    angles: Array
    posture: Array
    reaction: Array
    target: Array
    turn: Array
    basis: Array


class ChainFinger(ABC):
    """All of `cosim.port.OpenFinger` from a chain's kinematics and the finger's own torques."""

    def __init__(
        self,
        bodies: tuple[str, ...],
        tendons: tuple[str, ...],
        law: JointLaw,
        ranges: Mapping[str, tuple[float, float]],
        support: Support,
    ) -> None:
        self.bodies, self.tendons, self.joints = bodies, tendons, law.joints
        self.law, self.support, self.ranges = law, support, dict(ranges)
        self.ties: Ties | None = None
        """Strands from bone to bone; None of a finger without."""
        self._low = by_joint({j: r[0] for j, r in ranges.items()}, self.joints, -np.inf, "ranges")
        self._high = by_joint({j: r[1] for j, r in ranges.items()}, self.joints, np.inf, "ranges")

    def with_ties(self, ties: Ties | None) -> ChainFinger:
        """The finger with strands from bone to bone."""
        out = copy(self)
        out.ties = ties
        return out

    def with_friction(self, friction: Mapping[str, Any]) -> ChainFinger:
        """The finger with friction along tendons of its own.  Raises InputError for a finger
        without paths of tendons, along which alone friction acts."""
        if not friction:
            return self
        raise InputError(
            f"friction of {', '.join(friction)}: this finger has no tendons of its own whose paths "
            "it knows; leave friction out, or take a finger with a MuJoCo model"
        )

    @abstractmethod
    def chain(self, angles: Array) -> Chain:
        """Kinematics at the joint angles (nq,) rad."""

    @abstractmethod
    def own_torques(self, angles: Array, tension: Array) -> dict[str, Array]:
        """The torques (nq,) N m of each muscle and of gravity."""

    @abstractmethod
    def own_tangent(self, angles: Array, tension: Array) -> Array:
        """The derivative (nq, nq) of the sum of `own_torques` over the angles."""

    @abstractmethod
    def own_wrenches(self, angles: Array, tension: Array) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin, world frame, by source of
        `own_torques`."""

    def start(self, posture: Mapping[str, float]) -> FingerState:
        """The state at `posture` (rad; a joint not named is at zero) with no tip reaction.

        Raises InputError for an unknown joint or an angle outside the joint's range."""
        q = by_joint(posture, self.joints, 0.0, "posture")
        for joint, angle, low, high in zip(self.joints, q, self._low, self._high, strict=True):
            if not low <= angle <= high:
                raise InputError(
                    f"posture: {joint} at {np.degrees(angle):.4g} deg lies outside its range of "
                    f"{np.degrees(low):.4g} to {np.degrees(high):.4g} deg; choose an angle within"
                )
        chain = self.chain(q)
        basis = self.support.basis(chain.axis[-1])
        return FingerState(q, q, np.zeros(6), chain.tip, chain.motion.rotation[-1], basis)

    def angles(self, state: FingerState) -> Array:
        """Joint angles (nq,) of a state, rad."""
        return state.angles

    def rest(self) -> Motion:
        """The poses with all joints at zero."""
        return self.motion(self.start({}))

    def between(self, state: FingerState, aim: FingerState, part: float) -> FingerState:
        """The state a `part` of the way from one to another."""
        return self.displace(state, part * (self.unknowns(aim) - self.unknowns(state)))

    def with_angles(self, state: FingerState, angles: Array) -> FingerState:
        """The state with its joints at angles (nq,) rad, its reaction kept."""
        step = np.zeros(len(self.unknowns(state)))
        step[: len(angles)] = angles - state.angles
        return self.displace(state, step)

    def settle(
        self, state: FingerState, load: Load, by_motion: Array, tension: Array, tolerance: float
    ) -> tuple[FingerState, float]:
        """See `cosim.port.Finger`; `cosim.coupling.finger_equilibrium.balance_finger`."""
        aim, balance = balance_finger(self, state, load, tension, by_motion, tolerance)
        return aim, balance.relative

    def tip_force(self, state: FingerState) -> Array:
        """The force (3,) N of the fingertip on the world."""
        return -state.reaction[:3]

    def unknowns(self, state: FingerState) -> Array:
        """The unknowns (nq + m,): angles, then the reaction along the support's unit wrenches."""
        return np.concatenate([state.angles, state.basis @ state.reaction])

    def motion(self, state: FingerState) -> Motion:
        return self.chain(state.angles).motion

    def tip(self, state: FingerState) -> Array:
        return self.chain(state.angles).tip

    def jacobian(self, state: FingerState) -> Array:
        return body_jacobian(self.chain(state.angles))

    def displace(self, state: FingerState, step: Array) -> FingerState:
        """The state after a step (nq + m,) of its unknowns."""
        nq, n = len(self.joints), len(self.joints) + len(state.basis)
        if np.shape(step) != (n,):
            raise InputError(f"finger: expected a step of shape {(n,)}, got {np.shape(step)}")
        reaction = state.reaction + state.basis.T @ step[nq:]
        return replace(state, angles=state.angles + step[:nq], reaction=reaction)

    def balance(self, state: FingerState, load: Load, tension: Array) -> Balance:
        """The residual of equilibrium and what bears it.  Raises InputError if the load's bodies or
        the tensions' shape are not the finger's."""
        self._check(load, tension)
        chain = self.chain(state.angles)
        torque = {
            "hood": body_jacobian(chain).T @ load.total().ravel(),
            **self.own_torques(state.angles, tension),
            "passive": self.law.passive(state.angles)[0],
            "limit": self.law.limit(state.angles)[0],
            **({} if self.ties is None else {"tie": self.ties.torques(chain)}),
            "fingertip": tip_jacobian(chain).T @ state.reaction,
        }
        every = np.array(list(torque.values()))
        residual = np.concatenate([every.sum(axis=0), self._gap(state, chain)[0]])
        scale = max(TORQUE_FLOOR, float(np.abs(every).max()))
        if self.support.holds_joints:
            torque["holder"] = -residual
            residual = TURN_SCALE * (state.posture - state.angles)
        return Balance(residual, scale, torque, -state.reaction[:3])

    def _gap(self, state: FingerState, chain: Chain) -> tuple[Array, Array]:
        """The scaled gaps (m,) N m of the support and their derivative (m, nq) by the angles."""
        jacobian = tip_jacobian(chain)
        if not self.support.clamps_turn:
            directions = GAP_SCALE * state.basis[:, :3]
            return directions @ (chain.tip - state.target), directions @ jacobian[:3]
        turn, by_turn = turn_gap(state.turn, chain.motion.rotation[-1])
        gap = np.concatenate([GAP_SCALE * (chain.tip - state.target), TURN_SCALE * turn])
        scaled = np.vstack([GAP_SCALE * jacobian[:3], TURN_SCALE * by_turn @ jacobian[3:]])
        return state.basis @ gap, state.basis @ scaled

    def tangent(self, state: FingerState, load: Load, tension: Array, load_motion: Array) -> Array:
        """Exact derivative of the residual over z = (q, support r)."""
        self._check(load, tension)
        if self.support.holds_joints:
            return -TURN_SCALE * np.eye(len(self.joints))
        chain = self.chain(state.angles)
        n, nq, jac = len(self.bodies), len(self.joints), body_jacobian(chain)
        stiffness = jac.T @ load_motion @ jac + self.own_tangent(state.angles, tension)
        joints = self.law.passive(state.angles)[1] + self.law.limit(state.angles)[1]
        stiffness.flat[:: nq + 1] += joints
        if self.ties is not None:
            stiffness += self.ties.tangent(chain)
        stiffness += geometric_stiffness(
            chain,
            np.append(np.arange(n), n - 1),
            np.vstack([chain.motion.position, chain.tip]),
            np.vstack([load.total(), state.reaction]),
        )
        out = np.zeros((nq + len(state.basis), nq + len(state.basis)))
        out[:nq, :nq] = stiffness
        out[:nq, nq:] = (state.basis @ tip_jacobian(chain)).T
        out[nq:, :nq] = self._gap(state, chain)[1]
        return out

    def ledger(self, state: FingerState, load: Load, tension: Array) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin (world frame) by source: each muscle,
        gravity, passive, limit, ties, fingertip, joint, what holds the joints, and the ground,
        which holds the fixed body.  They close to zero on every body with the hood's load."""
        ledger = self._applied_loads(state, load, tension)
        reaction = self._reactions(state, load, ledger)
        ledger["joint"] = joint_loads(self.chain(state.angles), reaction)
        whole = load.total() + np.sum(list(ledger.values()), axis=0)
        return {**ledger, "ground": ground_reaction(whole)}

    def support_arm(self, state: FingerState) -> float:
        """The smallest lever, m, with which the joints act on the tip's support: the least singular
        value of the tip's Jacobian along the held directions.  It vanishes where the finger is
        straight, held at a point that it can only push or pull against; infinite for a free tip."""
        support = self.support.directions @ tip_jacobian(self.chain(state.angles))[:3]
        return float(np.linalg.svd(support, compute_uv=False).min(initial=np.inf))

    def path_lengths(self, state: FingerState) -> Array:
        """The tendons' lengths (nt,) m; a finger that has tendons says how long they are."""
        return np.zeros(len(self.tendons))

    def tendon_paths(self, state: FingerState) -> dict[str, Array]:
        """No tendons of its own to draw; a finger that has some says where they run."""
        return {}

    def joint_reactions(self, state: FingerState, load: Load, tension: Array) -> Array:
        """The wrench (nb, 6) that each body receives through its proximal joint, about the body's
        origin; its moment about the joint's own axes vanishes at equilibrium."""
        return self._reactions(state, load, self._applied_loads(state, load, tension))

    def _applied_loads(self, state: FingerState, load: Load, tension: Array) -> dict[str, Array]:
        self._check(load, tension)
        chain = self.chain(state.angles)
        fingertip = np.zeros((len(self.bodies), 6))
        fingertip[-1] = move_wrench(state.reaction, chain.tip - chain.motion.position[-1])
        out = {
            **self.own_wrenches(state.angles, tension),
            "passive": joint_wrenches(chain, self.law.passive(state.angles)[0]),
            "limit": joint_wrenches(chain, self.law.limit(state.angles)[0]),
            **({} if self.ties is None else {"tie": self.ties.wrenches(chain)}),
            "fingertip": fingertip,
        }
        if self.support.holds_joints:
            held = self.balance(state, load, tension).torque["holder"]
            out["holder"] = joint_wrenches(chain, held)
        return out

    def _reactions(self, state: FingerState, load: Load, ledger: dict[str, Array]) -> Array:
        applied = load.total() + np.sum(list(ledger.values()), axis=0)
        return joint_reactions(self.chain(state.angles), applied)

    def _check(self, load: Load, tension: Array) -> None:
        if load.bodies != self.bodies:
            raise InputError(
                f"load on bodies {load.bodies}: the finger's are {self.bodies}, in this order"
            )
        check_tensions("finger", self.tendons, tension)
