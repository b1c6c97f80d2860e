"""What a held fingertip makes of a hood's joint torques."""

from __future__ import annotations

import numpy as np

from cosim.case.schema import Case
from cosim.fingers.kinds import live_finger
from cosim.port import Array, Load, OpenFinger


def tip_maps(case: Case, angles: Array) -> Array:
    """(s, 3, n) the maps of the case's finger with its tip clamped, at angles (s, n) rad."""
    finger = live_finger(clamp_tip(case).native_finger(), case.hood.left_to_finger)
    return np.array([tip_map(finger, angle) for angle in angles])


def clamp_tip(case: Case) -> Case:
    """The case with its fingertip clamped."""
    finger = case.native_finger()
    tip = finger.tip.model_copy(update={"kind": "clamped"})
    return case.model_copy(update={"finger": finger.model_copy(update={"tip": tip})})


def tip_map(finger: OpenFinger, angle: Array) -> Array:
    """(3, n) the force of a held fingertip on the world by torques about the joints, N/(N m)."""
    state = finger.start(dict(zip(finger.joints, map(float, angle), strict=True)))
    bodies, none = finger.bodies, np.zeros(len(finger.tendons))
    idle = Load(bodies, ("none",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
    n, width = len(finger.joints), 6 * len(bodies)
    slope = finger.tangent(state, idle, none, np.zeros((width, width)))[:n, n:]
    steps = np.eye(n + slope.shape[1])[n:]
    force = np.array(
        [finger.balance(finger.displace(state, step), idle, none).tip_force for step in steps]
    ).T
    out: Array = -force @ np.linalg.pinv(slope)
    return out
