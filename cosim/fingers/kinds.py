"""From the finger of a case to a live one.  One of the files that know the solvers by name."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.fingers.hinge import HingeFinger
from cosim.fingers.index import IndexFinger
from cosim.fingers.middle import MiddleFinger
from cosim.fingers.planar import PlanarFinger
from cosim.fingers.robot import RobotFinger
from cosim.hoods.shell.table import ShellHood
from cosim.hoods.split import SplitHood
from cosim.port import Finger, InputError
from cosim.schema.types import MUSCLES

if TYPE_CHECKING:
    from meshes.skeleton import Skeleton
    from rigid.chain.joint_torques import JointLaw
    from rigid.chain.planar_chain import PlanarChain
    from rigid.chain.statics import ChainFinger
    from rigid.chain.support import Support
    from rigid.model import FingerModel

LEAST_ARM = 1e-3
"""m, of the joints about a held tip; some 2 deg of flexion in all."""
AnyFinger = IndexFinger | MiddleFinger | HingeFinger | PlanarFinger | RobotFinger
"""Those of our own."""
OnMujoco = IndexFinger | MiddleFinger | PlanarFinger | RobotFinger


def live_finger(finger: AnyFinger, hood: object) -> ChainFinger:
    """The finger, with the extensor's tendons among its own where the hood is a fixed split.

    Raises InputError for one that cannot be held where the case holds it."""
    made = _hinges(finger) if isinstance(finger, HingeFinger) else _on_mujoco(finger, hood)
    if finger.tip.kind not in ("point", "clamped"):
        return made
    if made.support_arm(made.start(finger.posture.angles())) < LEAST_ARM:
        # Its fingertip force would be as large as rounding and the hood's slightest pull make it.
        raise InputError(
            "finger.posture: a straight finger cannot be held at its tip (finger.tip.kind = "
            f'"{finger.tip.kind}"): no joint torque balances a force along it. Bend PIP or DIP by '
            'some degrees, or write finger.tip.kind = "free"'
        )
    return made


def joint_ranges(finger: Finger) -> dict[str, tuple[float, float]]:
    """rad by joint: the finger's own, or where it states none those of a posture in a case."""
    from rigid.fingers.anatomy import RANGES

    stated = {joint: r for joint, r in finger.ranges.items() if np.isfinite(r).all()}
    return {joint: stated.get(joint, RANGES[joint]) for joint in finger.joints}


def skeleton_of(finger: IndexFinger | MiddleFinger) -> Skeleton:
    """The finger's joints and lengths, as its MuJoCo model has them."""
    from meshes.skeleton import index_finger
    from rigid.fingers.middle import skeleton

    if isinstance(finger, IndexFinger) and finger.path is not None:
        from rigid.mjcf.read import skeleton_of as skeleton_in_file

        return skeleton_in_file(_in_file(finger.path))
    made = skeleton() if isinstance(finger, MiddleFinger) else index_finger()
    return made.scaled(finger.length_scale)


def width_of(finger: IndexFinger | MiddleFinger) -> float:
    """How much wider the finger is than our index finger; of the middle finger after O2O3, the unit
    of their tendon paths."""
    from rigid.fingers import index as index_finger
    from rigid.fingers import middle as middle_finger

    if isinstance(finger, MiddleFinger):
        return middle_finger.O2O3 / index_finger.O2O3 * finger.length_scale
    return finger.width_scale


def finger_model(finger: OnMujoco, hood: object) -> FingerModel:
    """Bones, joints and tendons in words."""
    from rigid.fingers import index as index_finger
    from rigid.fingers import middle as middle_finger

    central = hood.central if isinstance(hood, SplitHood) else None
    if isinstance(finger, IndexFinger) and finger.path is not None:
        made = _in_file(finger.path)
        hooded = () if isinstance(hood, SplitHood) else tuple(index_finger.through_the_hood())
        return made.with_only(*(m for m in made.muscles if m not in hooded))
    if isinstance(finger, IndexFinger):
        unit = index_finger.O2O3 * finger.length_scale
        return index_finger.finger_model(skeleton_of(finger), unit, central=central)
    if isinstance(finger, PlanarFinger):
        return planar_chain(finger).model()
    if isinstance(finger, RobotFinger):
        return _robot(finger, pulley=isinstance(hood, SplitHood))
    if isinstance(hood, ShellHood):
        return middle_finger.under_a_hood(finger.length_scale)
    if central is None:
        return middle_finger.finger_model(finger.length_scale).with_only("FDP", "FDS")
    return middle_finger.finger_model(finger.length_scale, central)


def _in_file(path: Path) -> FingerModel:
    """The finger of a MuJoCo model, with the tendons that a case can name."""
    stamp = path.stat()
    return _read(path, stamp.st_mtime_ns, stamp.st_size)


@lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> FingerModel:
    from rigid.mjcf.read import read_mjcf

    return read_mjcf(path, tendons=MUSCLES).model


def _robot(finger: RobotFinger, pulley: bool) -> FingerModel:
    """Without its pulley another hood takes the central extensor's place."""
    from rigid.fingers.robot import robot_finger
    from rigid.fingers.robot_tables import TENDONS

    made = robot_finger(finger.second_extensor)
    return made if pulley else made.with_only(*(m for m in made.muscles if m != TENDONS[0]))


def planar_chain(finger: PlanarFinger) -> PlanarChain:
    """The finger in closed form."""
    from rigid.chain.planar_chain import PlanarChain

    parts = (finger.lengths, finger.centres, finger.masses, finger.inertias)
    length, centre, mass, inertia = (np.array(part) for part in parts)
    return PlanarChain(length, centre, mass, inertia)


def _on_mujoco(finger: OnMujoco, hood: object) -> ChainFinger:
    from rigid.mujoco.finger import MujocoFinger

    model = finger_model(finger, hood)
    support = _support(finger.tip.kind, in_plane=isinstance(finger, PlanarFinger))
    law = _law(finger, model.joints)
    return MujocoFinger(model, law=law, support=support, gravity=finger.gravity)


def _support(kind: str, in_plane: bool) -> Support:
    from rigid.chain.support import CLAMPED, CLAMPED_IN_PLANE, FREE, HELD, IN_PLANE, JOINTS_HELD

    point, clamped = (IN_PLANE, CLAMPED_IN_PLANE) if in_plane else (HELD, CLAMPED)
    return {"point": point, "clamped": clamped, "posture": JOINTS_HELD}.get(kind, FREE)


def _hinges(finger: HingeFinger) -> ChainFinger:
    from rigid.chain.hinge import JOINTS
    from rigid.chain.hinge import HingeFinger as Hinges

    support = _support(finger.tip.kind, in_plane=True)
    return Hinges(finger.lengths, law=_law(finger, JOINTS), support=support)


def _law(finger: AnyFinger, joints: tuple[str, ...]) -> JointLaw:
    from rigid.chain.joint_torques import TorqueCurve, joint_law

    posture = finger.posture.angles()
    springs = {j: p for j, p in finger.passive.items() if p.stiffness is not None}
    curves = {
        j: TorqueCurve(*zip(*p.curve, strict=True)) for j, p in finger.passive.items() if p.curve
    }
    law = joint_law(
        joints,
        stiffness={j: p.stiffness for j, p in springs.items() if p.stiffness is not None},
        rest={
            j: posture[j] if isinstance(p.rest, str) else p.rest or 0.0 for j, p in springs.items()
        },
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
    return law.held_about(posture, margin=finger.limit.half_range)
