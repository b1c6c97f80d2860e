"""The robotic finger in time, on MuJoCo: tendon forces in, angles out.

The joints bear the silicone sleeve, "similar [in] stiffness and damping" to a human finger's: of
that the MCP's stiffness alone has a source.  Gravity acts palmar (the hand lies palm down).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from cosim.port import Array
from rigid.mjcf.write import mjcf_xml
from rigid.model import FingerModel

STIFFNESS = np.array([0.0391, 0.0391, 0.02, 0.01])
"""N m/rad: MCP the mean of four human index fingers (0.0377, 0.0328, 0.0466, 0.0393; PMC7775510,
table 2); abduction the same, PIP half and DIP a quarter of it are assumptions."""
RELAXATION = 0.05
"""s, assumption: damping over stiffness, which makes the straight finger's MCP nearly critical."""
GRAVITY = (0.0, 0.0, -9.81)
STEP = 1e-3
"""s."""


@dataclass(frozen=True)
class PlantState:
    """The joints' angles and rates (nq,), and the tendons' lengths (nt,) m."""

    angle: Array
    rate: Array
    length: Array


class Plant:
    """The finger with its sleeve, joint limits and weight, in steps of `STEP`."""

    def __init__(self, finger: FingerModel) -> None:
        self.finger = finger
        self.model = mujoco.MjModel.from_xml_string(mjcf_xml(finger, GRAVITY))
        self.model.opt.timestep = STEP
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.jnt_stiffness[:] = STIFFNESS
        self.model.dof_damping[:] = RELAXATION * STIFFNESS
        self.model.jnt_limited[:] = 1
        self._data = mujoco.MjData(self.model)

    def reset(self, angle: Array) -> PlantState:
        """Return the state at rest at the angles (nq,) rad, and go there."""
        mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[:] = angle
        mujoco.mj_forward(self.model, self._data)
        return self.instant()

    def advance(self, force: Array) -> None:
        """One step under tendon forces (nt,) N."""
        self._data.ctrl[:] = force
        mujoco.mj_step(self.model, self._data)

    def instant(self) -> PlantState:
        """Return the present angles, rates and tendon lengths."""
        d = self._data
        return PlantState(d.qpos.copy(), d.qvel.copy(), d.ten_length.copy())

    def holding_torque(self, angle: Array) -> Array:
        """The torques (nq,) N m that the tendons must make at rest at the angles (nq,), within the
        limits."""
        self.reset(angle)
        return np.asarray(self._data.qfrc_bias - self._data.qfrc_passive)
