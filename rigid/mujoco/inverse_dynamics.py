"""The torques that a motion takes, of a finger on MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np

from cosim.port import Array
from rigid.mujoco.finger import MujocoFinger


def needed_torque(finger: MujocoFinger, angle: Array, rate: Array, acceleration: Array) -> Array:
    """(nq,) N m that muscles and hood must make for a motion in rad, rad/s and rad/s2, (nq,) each:

        M q'' + c(q, q') - weight - passive springs - damping.

    Coordinate limits are left out: they stand for what holds a finger in a posture."""
    model = finger.model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = angle, rate, acceleration
    mujoco.mj_inverse(model, data)
    damping = np.zeros(len(angle)) if finger.law.damping is None else finger.law.damping
    needed: Array = data.qfrc_inverse - finger.law.passive(angle)[0] + damping * rate
    return needed
