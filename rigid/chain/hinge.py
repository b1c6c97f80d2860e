"""An analytic planar finger: three hinges, flexion about +y, bones along x, cables over pulleys.

It needs numpy only and serves as the closed-form truth for the other fingers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Motion
from rigid.chain.joint_torques import JointLaw, joint_law
from rigid.chain.kinematics import Chain
from rigid.chain.pulley_cables import PulleyCable
from rigid.chain.statics import ChainFinger, FingerState
from rigid.chain.support import IN_PLANE, Support

BODIES = ("metacarpal", "proximal", "middle", "distal")
JOINTS = ("MCP", "PIP", "DIP")


class HingeFinger(ChainFinger):
    """A finger in the plane: bones of lengths L1, L2, L3 (m) at angles f_i = q_1 + ... + q_i below
    the x axis:

        x_i+1 = x_i + L_i (cos f_i, 0, -sin f_i)

    A support may act in the flexion plane only.

    >>> import numpy as np
    >>> from rigid.chain.hinge import HingeFinger
    >>> finger = HingeFinger((0.04, 0.025, 0.02))
    >>> straight = finger.start({"MCP": 0.0, "PIP": 0.0, "DIP": 0.0})
    >>> finger.tip(straight)  # m
    array([ 0.085,  0.   , -0.   ])
    """

    def __init__(
        self,
        lengths: Sequence[float],
        *,
        law: JointLaw | None = None,
        support: Support = IN_PLANE,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        pulleys: Mapping[str, Mapping[str, float]] | None = None,
    ) -> None:
        """Build the chain.  pulleys: by tendon the radius (m) by joint, positive where the tendon
        flexes it (`rigid.chain.pulley_cables`).

        Raises InputError for lengths that are not three positive numbers or an unknown joint."""
        self.lengths = np.asarray(lengths, dtype=float)
        if self.lengths.shape != (3,) or not (self.lengths > 0).all():
            raise InputError(f"hinge finger: expected three positive lengths (m), got {lengths}")
        law = joint_law(JOINTS) if law is None else law
        if law.joints != JOINTS:
            raise InputError(f"hinge finger: its joints are {JOINTS}, the law has {law.joints}")
        self.cables = {
            name: PulleyCable.over(name, radius, JOINTS, self.lengths)
            for name, radius in (pulleys or {}).items()
        }
        self._arms = np.zeros((len(self.cables), 3))
        for row, cable in zip(self._arms, self.cables.values(), strict=True):
            row[: len(cable.radii)] = cable.radii
        super().__init__(BODIES, tuple(self.cables), law, {} if ranges is None else ranges, support)

    def chain(self, angles: Array) -> Chain:
        flexion = np.cumsum(angles)
        c, s, o, one = np.cos(flexion), np.sin(flexion), np.zeros(3), np.ones(3)
        bone = self.lengths[:, None] * np.column_stack([c, o, -s])
        points = np.vstack([np.zeros((2, 3)), np.cumsum(bone, axis=0)])
        turn = np.stack([c, o, s, o, one, o, -s, o, c], axis=1).reshape(3, 3, 3)
        motion = Motion(BODIES, points[:4], np.concatenate([np.eye(3)[None], turn]))
        axis = np.tile([0.0, 1.0, 0.0], (3, 1))
        return Chain(motion, np.arange(1, 4), points[1:4], axis, points[4])

    def own_torques(self, angles: Array, tension: Array) -> dict[str, Array]:
        """Joint torques (nq,) by source that the finger itself exerts, N m."""
        return dict(zip(self.tendons, np.asarray(tension)[:, None] * self._arms, strict=True))

    def own_tangent(self, angles: Array, tension: Array) -> Array:
        """Derivative (nq, nq) of the finger's own torques by the angles, N m/rad."""
        return np.zeros((3, 3))

    def own_wrenches(self, angles: Array, tension: Array) -> dict[str, Array]:
        motion = self.chain(angles).motion
        pulls = zip(self.cables.items(), tension, strict=True)
        return {name: force * cable.wrenches(motion) for (name, cable), force in pulls}

    def path_lengths(self, state: FingerState) -> Array:
        return np.array([cable.length(state.angles) for cable in self.cables.values()])

    def tendon_paths(self, state: FingerState) -> dict[str, Array]:
        motion = self.motion(state)
        return {name: cable.path(motion) for name, cable in self.cables.items()}
