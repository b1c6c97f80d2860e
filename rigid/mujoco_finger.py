"""The index finger on MuJoCo, behind the port: oblique axes, flexor and FDI tendons, gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from cosim.port import Array, InputError, Motion
from meshes.skeleton import BODIES, JOINTS, Skeleton
from rigid.chain import Chain, geometric_stiffness, moved_to, point_jacobian
from rigid.index_finger import MUSCLES, O2O3, RANGES, Surface, mjcf_xml
from rigid.joint_torques import JointLaw, joint_law
from rigid.statics import ChainFinger, FingerState

ANGLE_STEP = 1e-5
"""rad, for differences of the tendon Jacobian: truncation and rounding both near 1e-11 of it."""


class MujocoFinger(ChainFinger):
    """The finger of `index_finger.mjcf_xml`; `model` is its compiled MuJoCo model.

    MuJoCo gives the poses, the joints' axes and the tendons' Jacobian.  Its buffers are private
    and filled anew from the joint angles in every call, so that a state always gives the same bits.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        *,
        law: JointLaw | None = None,
        held: bool = True,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        ranges: Mapping[str, tuple[float, float]] = RANGES,
        o2o3: float = O2O3,
        bones: Mapping[str, Surface] | None = None,
    ) -> None:
        """law: passive springs and limits of the joints (none if not given); held: the tip cannot
        leave the point where `start` put it; the rest as in `mjcf_xml`.

        Raises InputError for an unknown joint or body."""
        law = joint_law(JOINTS) if law is None else law
        if law.joints != JOINTS:
            raise InputError(f"MuJoCo finger: its joints are {JOINTS}, the law has {law.joints}")
        super().__init__(BODIES, MUSCLES, law, ranges, np.eye(3) if held else np.zeros((0, 3)))
        self.xml = mjcf_xml(skeleton, gravity=gravity, o2o3=o2o3, ranges=ranges, bones=bones)
        self.model = mujoco.MjModel.from_xml_string(self.xml)
        self._data = mujoco.MjData(self.model)
        self._body = np.array([self.model.body(name).id for name in BODIES])
        self._sites = {name: _tendon_sites(self.model, name) for name in MUSCLES}
        self._weight = np.outer(self.model.body_mass[self._body], self.model.opt.gravity)
        self._weight[0] = 0.0  # the metacarpal is the ground

    def chain(self, angles: Array) -> Chain:
        data = self._forward(angles)
        motion = Motion(BODIES, data.xpos[self._body], data.xmat[self._body].reshape(-1, 3, 3))
        child = self.model.jnt_bodyid - self._body[0]
        tip = data.site("tip").xpos.copy()
        return Chain(motion, child, data.xanchor.copy(), data.xaxis.copy(), tip)

    def moment_arms(self, angles: Array) -> Array:
        """(nt, nq) m: shortening of each tendon per rad, positive where its pull turns the joint
        in its positive sense."""
        data, m = self._forward(angles), self.model
        out = np.zeros((m.ntendon, m.nv))
        mujoco.mju_sparse2dense(out, data.ten_J, m.ten_J_rownnz, m.ten_J_rowadr, m.ten_J_colind)
        return -out

    def own_torques(self, angles: Array, tension: Array) -> dict[str, Array]:
        muscles = np.asarray(tension)[:, None] * self.moment_arms(angles)
        arms = point_jacobian(
            self.chain(angles), np.arange(len(BODIES)), self._mass_centres(angles)
        )
        gravity = np.einsum("bxj,bx->j", arms[:, :3], self._weight)
        return {**dict(zip(MUSCLES, muscles, strict=True)), "gravity": gravity}

    def own_tangent(self, angles: Array, tension: Array) -> Array:
        columns = [
            tension @ (self.moment_arms(angles + step) - self.moment_arms(angles - step))
            for step in ANGLE_STEP * np.eye(len(angles))
        ]
        out = np.column_stack(columns) / (2 * ANGLE_STEP)
        weight = np.hstack([self._weight, np.zeros_like(self._weight)])
        return out + geometric_stiffness(
            self.chain(angles), np.arange(len(BODIES)), self._mass_centres(angles), weight
        )

    def own_wrenches(self, angles: Array, tension: Array) -> dict[str, Array]:
        out = {n: self._pull(n, t, angles) for n, t in zip(MUSCLES, tension, strict=True)}
        data = self._forward(angles)
        force = np.hstack([self._weight, np.zeros_like(self._weight)])
        out["gravity"] = moved_to(force, (data.xipos - data.xpos)[self._body])
        return out

    def tendon_paths(self, state: FingerState) -> dict[str, Array]:
        """(k, 3) world points of each muscle's path from origin to insertion, m."""
        points = self._forward(state.angles).site_xpos
        return {name: points[sites] for name, sites in self._sites.items()}

    def _pull(self, name: str, tension: float, angles: Array) -> Array:
        """(nb, 6): at each path point the tension times the directions to its neighbours; the
        origin, where the muscle begins, receives the pull of its one neighbour."""
        data, sites = self._forward(angles), self._sites[name]
        points = data.site_xpos[sites]
        segment = np.diff(points, axis=0)
        pull = tension * segment / np.linalg.norm(segment, axis=1, keepdims=True)
        none = np.zeros((1, 3))
        force = np.vstack([pull, none]) - np.vstack([none, pull])
        body = self.model.site_bodyid[sites]
        wrench = np.hstack([force, np.cross(points - data.xpos[body], force)])
        out = np.zeros((len(BODIES), 6))
        np.add.at(out, body - self._body[0], wrench)
        return out

    def _mass_centres(self, angles: Array) -> Array:
        return self._forward(angles).xipos[self._body]

    def _forward(self, angles: Array) -> mujoco.MjData:
        self._data.qpos[:] = angles
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        mujoco.mj_tendon(self.model, self._data)
        return self._data


def _tendon_sites(model: mujoco.MjModel, name: str) -> Array:
    tendon = model.tendon(name).id
    first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    return model.wrap_objid[first : first + count]
