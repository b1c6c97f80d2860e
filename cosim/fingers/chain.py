"""What our fingers share when built: the fingertip's support and the joints' torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from cosim.fingers.common import LimitConfig, PassiveConfig, PlanarPostureConfig, TipConfig

if TYPE_CHECKING:
    from rigid.chain.joint_torques import JointLaw
    from rigid.chain.statics import ChainFinger
    from rigid.chain.support import Support
    from rigid.model import FingerModel


class ChainFingerConfig(Protocol):
    """What every table of a finger of ours states."""

    @property
    def posture(self) -> PlanarPostureConfig:
        """The joint angles (rad) in which the finger starts."""
        ...

    @property
    def tip(self) -> TipConfig:
        """What holds the fingertip."""
        ...

    @property
    def limit(self) -> LimitConfig | None:
        """The joints' limits; None where they are free."""
        ...

    @property
    def passive(self) -> Mapping[str, PassiveConfig]:
        """Passive torques by joint."""
        ...


class ChainFingerConfigWithMass(ChainFingerConfig, Protocol):
    """What the table of a finger of ours with mass states."""

    @property
    def gravity(self) -> tuple[float, float, float]:
        """The acceleration of gravity (3,) m/s2, world frame."""
        ...


def on_mujoco(
    finger: ChainFingerConfigWithMass, model: FingerModel, in_plane: bool = False
) -> ChainFinger:
    """The live finger of a MuJoCo model."""
    from rigid.mujoco.finger import MujocoFinger

    law = joint_torques(finger, model.joints)
    support = tip_support(finger.tip, in_plane)
    return MujocoFinger(model, law=law, support=support, gravity=finger.gravity)


def tip_support(tip: TipConfig, in_plane: bool) -> Support:
    """What holds the fingertip at rest."""
    from rigid.chain.support import CLAMPED, CLAMPED_IN_PLANE, FREE, HELD, IN_PLANE, JOINTS_HELD

    point, clamped = (IN_PLANE, CLAMPED_IN_PLANE) if in_plane else (HELD, CLAMPED)
    return {"point": point, "clamped": clamped, "posture": JOINTS_HELD}.get(tip.kind, FREE)


def joint_torques(finger: ChainFingerConfig, joints: tuple[str, ...]) -> JointLaw:
    """Passive torques and limits."""
    from rigid.chain.joint_torques import TorqueCurve, joint_law

    posture = finger.posture.angles()
    springs = {j: p for j, p in finger.passive.items() if p.stiffness is not None}
    curves = {
        j: TorqueCurve(*zip(*p.curve, strict=True)) for j, p in finger.passive.items() if p.curve
    }
    law = joint_law(
        joints,
        stiffness={j: p.stiffness for j, p in springs.items() if p.stiffness is not None},
        rest={j: posture[j] if p.rest == "posture" else p.rest or 0.0 for j, p in springs.items()},
        damping={j: p.damping for j, p in finger.passive.items()},
        curves=curves,
    )
    if finger.limit is None:
        return law
    law = replace(
        law,
        limit_stiffness=finger.limit.stiffness,
        transition=finger.limit.transition,
        limit_damping=finger.limit.damping,
    )
    return law.hold_about(posture, margin=finger.limit.half_range)
