"""What our fingers share when built: the fingertip's support, the joints' torques, and rods that
stand for bones in pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import InputError
from cosim.fingers.common import ChainFingerConfig, MassiveFingerConfig, TipConfig
from cosim.port import Triangles
from meshes.skeleton import BODIES

if TYPE_CHECKING:
    from rigid.chain.joint_torques import JointLaw
    from rigid.chain.statics import ChainFinger
    from rigid.chain.support import Support
    from rigid.chain.ties import Ties
    from rigid.model import FingerModel

THROUGH = 0.5e-3
"""m, how deep the way of a tie may run in a bone, whose surface is known to some tenths of it."""
WAY = np.linspace(0.1, 0.9, 17)
"""Where between its ends a tie's way is looked at."""


def build_on_mujoco(
    finger: MassiveFingerConfig, model: FingerModel, in_plane: bool = False
) -> ChainFinger:
    """The live finger of a MuJoCo model."""
    from rigid.mujoco.finger import MujocoFinger

    law = joint_torques(finger, model.joints)
    support = tip_support(finger.tip, in_plane)
    made = MujocoFinger(model, law=law, support=support, gravity=finger.gravity)
    return made.with_ties(_ties(finger, made)) if finger.tie else made


def _ties(finger: MassiveFingerConfig, made: ChainFinger) -> Ties:
    """The strands from bone to bone, as long as the case says.  Raises InputError."""
    from rigid.chain.joint_torques import by_joint
    from rigid.chain.ties import Ties

    stated, posture = finger.tie, finger.posture.angles()
    free = Ties(
        tuple(stated),
        np.array([[made.bodies.index(bone) for bone in t.bones] for t in stated.values()]),
        np.array([t.at for t in stated.values()]),
        np.array([t.stiffness for t in stated.values()]),
        np.zeros(len(stated)),
    )
    length = np.zeros(len(stated))
    for i, (name, tie) in enumerate(stated.items()):
        taut = by_joint({**posture, **tie.taut}, made.joints, 0.0, f"finger.tie.{name}.taut")
        first, last = free.ends(made.chain(taut))[i]
        length[i] = np.linalg.norm(last - first) + tie.slack
        if length[i] <= 0:
            raise InputError(f"finger.tie.{name}: is shorter than nothing; give it more slack")
    return replace(free, length=length)


def check_ways(
    finger: MassiveFingerConfig, made: ChainFinger, bones: Mapping[str, Triangles]
) -> None:
    """Check that no tie runs through a bone where it comes taut.  Raises InputError."""
    from pyvista import PolyData

    from rigid.chain.joint_torques import by_joint

    assert made.ties is not None
    posture = finger.posture.angles()
    for i, (name, tie) in enumerate(finger.tie.items()):
        chain = made.chain(by_joint({**posture, **tie.taut}, made.joints, 0.0, "taut"))
        first, last = made.ties.ends(chain)[i]
        way = first + WAY[:, None] * (last - first)
        for body, (points, faces) in bones.items():
            position, rotation = chain.motion.of(body)
            bone = PolyData.from_regular_faces(np.asarray(points), np.asarray(faces))
            seen = PolyData((way - position) @ rotation).compute_implicit_distance(bone)
            depth = -float(seen["implicit_distance"].min())
            if depth > THROUGH:
                raise InputError(
                    f"finger.tie.{name}: its straight way runs {1e3 * depth:.1f} mm deep through "
                    f"the {body} bone where it comes taut; a tie bends round none: give it other "
                    "ends"
                )


def tip_support(tip: TipConfig, in_plane: bool) -> Support:
    """What holds the fingertip at rest."""
    from rigid.chain.support import CLAMPED, CLAMPED_IN_PLANE, FREE, HELD, IN_PLANE, JOINTS_HELD

    point, clamped = (IN_PLANE, CLAMPED_IN_PLANE) if in_plane else (HELD, CLAMPED)
    return {"point": point, "clamped": clamped, "posture": JOINTS_HELD}.get(tip.kind, FREE)


def joint_torques(finger: ChainFingerConfig, joints: tuple[str, ...]) -> JointLaw:
    """Passive torques, limits, and splints that are worn all the time."""
    from rigid.chain.joint_torques import TorqueCurve, by_joint, joint_law

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
    if finger.limit is not None:
        law = replace(
            law,
            limit_stiffness=finger.limit.stiffness,
            transition=finger.limit.transition,
            limit_damping=finger.limit.damping,
        ).hold_about(posture, margin=finger.limit.half_range)
    worn = {j: s for j, s in finger.splint.items() if not s.has_times}
    if not worn:
        return law
    ranges = {j: s.range or (posture[j], posture[j]) for j, s in worn.items()}
    return law.splinted(
        by_joint({j: low for j, (low, _) in ranges.items()}, joints, np.nan, "splints"),
        by_joint({j: high for j, (_, high) in ranges.items()}, joints, np.nan, "splints"),
        by_joint({j: s.stiffness for j, s in worn.items()}, joints, np.nan, "splints"),
    )


def rods(lengths: tuple[float, float, float], radius: Mapping[str, float]) -> dict[str, Triangles]:
    """Rods for bones: a capsule from joint to joint, of the first bone as much as MuJoCo's model
    shows; lengths of the phalanges and `radius` by body in m."""
    from trimesh.creation import capsule

    from rigid.fingers.anatomy import VIEW_METACARPAL

    out = {}
    for body, length in zip(BODIES, (VIEW_METACARPAL, *lengths), strict=True):
        rod = capsule(abs(length), radius[body], count=[16, 16])
        points = np.array(rod.vertices - rod.bounds.mean(axis=0))[:, [2, 0, 1]]
        points[:, 0] += length / 2
        out[body] = points, np.array(rod.faces)
    return out


def thick_rods(lengths: tuple[float, float, float]) -> dict[str, Triangles]:
    """Rods for bones, as thick as MuJoCo's model shows them: surfaces in the bodies' frames, m."""
    from rigid.fingers.anatomy import VIEW_RADIUS

    return rods(lengths, VIEW_RADIUS)
