"""Bones that lie as in the hand, in one scan: how far its joints are bent, and where they begin."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from cosim.anatomy.joints import Joints, parent_axis
from cosim.errors import InputError
from cosim.port import Array
from meshes.skeleton import BODIES, JOINTS

TOGETHER = 5e-3
"""m, at most, between the centres that two bones of one joint have for it."""
FLEXION = ("MCP", "PIP", "DIP")


def centres_apart(joints: Joints, given: tuple[str, ...]) -> dict[str, float]:
    """How far (m) the centres of each joint lie from each other in the files, where both its bones
    are given."""
    out = {}
    for k, joint in enumerate(FLEXION):
        before, after = BODIES[k], BODIES[k + 1]
        if before in given and after in given:
            reach = np.array([joints.skeleton.length[k] if k else 0.0, 0.0, 0.0])
            end = joints.origin[before] + joints.axes[before] @ reach
            out[joint] = float(np.linalg.norm(end - joints.origin[after]))
    return out


def scan_words(joints: Joints, given: tuple[str, ...]) -> list[str]:
    """The posture of a scan in which the bones lie together, by our zero; empty where they do
    not."""
    apart = centres_apart(joints, given)
    if not apart or max(apart.values()) > TOGETHER:
        return []
    angles = ", ".join(f"{joint} {np.degrees(_flexion(joints, joint)):.0f}" for joint in apart)
    most = 1e3 * max(apart.values())
    return [
        f"scan: the bones lie together (joints' centres within {most:.1f} mm), flexed by "
        f"{angles} deg from ours straight; --posture states where yours begins"
    ]


def in_posture(
    joints: Joints,
    given: tuple[str, ...],
    posture: Mapping[str, float],
    stated: Collection[str] = (),
) -> Joints:
    """The joints, which stand at the angles `posture` (rad) as the bones lie in their files; the
    MCP's abduction is none there.  Axes of joints that are `stated` stay where they are in the bone
    before, others in the bone after.  Raises InputError where the bones do not lie together."""
    apart = centres_apart(joints, given)
    wide = {joint: gap for joint, gap in apart.items() if gap > TOGETHER}
    if wide or not apart:
        what = ", ".join(f"{joint} {1e3 * gap:.0f} mm" for joint, gap in wide.items())
        raise InputError(
            "--posture: is of bones that lie as in the hand, in one scan; here "
            + (f"their joints' centres are apart: {what}" if wide else "no two bones share a joint")
            + "; leave it out"
        )
    zero, axis = joints.skeleton.zero.copy(), joints.skeleton.axis.copy()
    for joint in apart:
        k, bent = FLEXION.index(joint), _relative(joints, joint)
        own = [name for name in JOINTS if name.startswith(joint) and name in stated]
        before = {name: parent_axis(joints.skeleton, name) for name in own}
        about = bent.T @ before[joint] if joint in own else axis[JOINTS.index(joint)]
        zero[k] = bent @ _turn(about, posture.get(joint, 0.0)).T
        for name, way in before.items():
            axis[JOINTS.index(name)] = zero[k].T @ way
    return replace(joints, skeleton=replace(joints.skeleton, zero=zero, axis=axis))


def _relative(joints: Joints, joint: str) -> Array:
    """The rotation (3, 3) of the bone after a joint in the one before, as they lie."""
    k = FLEXION.index(joint)
    return np.asarray(joints.axes[BODIES[k]].T @ joints.axes[BODIES[k + 1]])


def _turn(axis: Array, angle: float) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def _flexion(joints: Joints, joint: str) -> float:
    """How far (rad) a joint is turned about its axis from our zero, as the bones lie."""
    from scipy.spatial.transform import Rotation

    k = FLEXION.index(joint)
    turned = joints.skeleton.zero[k].T @ _relative(joints, joint)
    vector = Rotation.from_matrix(turned).as_rotvec()
    return float(vector @ joints.skeleton.axis[JOINTS.index(joint)])
