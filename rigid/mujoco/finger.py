"""A finger on MuJoCo, behind the port: oblique axes, tendons with shares and wrapping, gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import mujoco
import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Motion
from rigid.chain.joint_torques import JointLaw, joint_law
from rigid.chain.kinematics import Chain, geometric_stiffness, move_wrench, point_jacobian
from rigid.chain.statics import ChainFinger, FingerState
from rigid.chain.support import HELD, Support
from rigid.mjcf.write import mjcf_xml
from rigid.model import FingerModel
from rigid.mujoco.tendon_friction import TendonFriction, TendonGuides
from rigid.mujoco.tendon_paths import TendonWays

ANGLE_STEP = 1e-5
"""rad, for differences of the tendon Jacobian: truncation and rounding both near 1e-11 of it."""


class MujocoFinger(ChainFinger):
    """A finger model as MuJoCo sees it; `model` is the compiled one.

    MuJoCo gives the poses, the joints' axes and the tendons' Jacobian.  Its buffers are private and
    depend on nothing but the joint angles of the call, so that a state always gives the same bits.

    >>> import numpy as np
    >>> from meshes.skeleton import index_finger
    >>> from rigid.fingers.index import finger_model
    >>> from rigid.mujoco.finger import MujocoFinger
    >>> finger = MujocoFinger(finger_model(index_finger()))
    >>> arms = finger.moment_arms(np.radians([30.0, 0.0, 45.0, 15.0]))
    >>> fdp, pip = finger.tendons.index("FDP"), finger.joints.index("PIP")
    >>> f"{1e3 * arms[fdp, pip]:.1f} mm"
    '9.9 mm'
    """

    def __init__(
        self,
        finger: FingerModel,
        *,
        law: JointLaw | None = None,
        support: Support = HELD,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """law: passive springs and limits of the joints (none if not given); support: what holds
        the tip; gravity: (3,) m/s2 in the world.

        Raises InputError for a law of other joints."""
        law = joint_law(finger.joints) if law is None else law
        if law.joints != finger.joints:
            raise InputError(
                f"MuJoCo finger: its joints are {finger.joints}, the law has {law.joints}"
            )
        super().__init__(finger.bodies, finger.muscles, law, finger.ranges, support)
        self.xml = mjcf_xml(finger, gravity)
        self.model = mujoco.MjModel.from_xml_string(self.xml)
        self._data = mujoco.MjData(self.model)
        self._qpos, self._path_jacobian = self._data.qpos, self._data.ten_J
        self._at = np.full(self.model.nq, np.nan)
        self._seen: tuple[Array, Chain, Array] | None = None
        self._body = np.array([self.model.body(name).id for name in finger.bodies])
        self._child = self.model.jnt_bodyid - self._body[0]
        self._tip = self.model.site("tip").id
        self._arm_row = np.repeat(np.arange(self.model.ntendon), self.model.ten_J_rownnz)
        self._arm_at = np.arange(len(self._arm_row))
        self._ways = TendonWays(self.model)
        self._weight = np.outer(self.model.body_mass[self._body], self.model.opt.gravity)
        self._weight[0] = 0.0  # the first body is the ground
        self.guides: TendonGuides | None = None
        self._rubbed: tuple[Array, Array] | None = None

    def with_friction(self, friction: Mapping[str, TendonFriction]) -> MujocoFinger:
        """The finger with friction along tendons of its own, at rest as they slide.

        Raises InputError for a tendon that it lacks."""
        out = copy(self)
        out.guides = TendonGuides(self.model, self.tendons, friction) if friction else None
        out._rubbed = None
        return out

    def chain(self, angles: Array) -> Chain:
        return self._posture(angles)[0]

    def tendon_lengths(self, angles: Array) -> Array:
        """The tendons' path lengths (nt,) m, strands counted by their shares."""
        return self.at_angles(angles).ten_length.copy()

    def moment_arms(self, angles: Array) -> Array:
        """The moment arms (nt, nq) m: the shortening of each tendon per rad, positive where its
        pull turns the joint in its positive sense."""
        return self._posture(angles)[1].copy()

    def _posture(self, angles: Array) -> tuple[Chain, Array]:
        """Kinematics and moment arms, those of the last posture asked for kept: an equilibrium and
        its tangent ask for the same again and again."""
        if self._seen is None or not np.array_equal(self._seen[0], angles):
            d = self.at_angles(angles)
            turn = d.xmat[self._body].reshape(-1, 3, 3)
            motion = Motion(self.bodies, d.xpos[self._body], turn)
            tip = d.site_xpos[self._tip].copy()
            chain = Chain(motion, self._child, d.xanchor.copy(), d.xaxis.copy(), tip)
            self._seen = np.array(angles, dtype=float), chain, self.arms_of(d)
        return self._seen[1], self._seen[2]

    def torques_per_tension(self, angles: Array) -> Array:
        """The torques (nt, nq) m per N of each muscle: the moment arms, or with friction what it
        leaves of them as the tendon slides."""
        arms = self._posture(angles)[1]
        if self.guides is None:
            return arms
        if self._rubbed is None or not np.array_equal(self._rubbed[0], angles):
            readings = self.guides.read(self.at_angles(angles))
            self._rubbed = (
                np.array(angles, dtype=float),
                readings.arms(self.guides.grip, arms),
            )
        return self._rubbed[1]

    def arms_of(self, data: mujoco.MjData) -> Array:
        """The moment arms (nt, nq) m in the posture of `data`."""
        m = self.model
        out = np.zeros((m.ntendon, m.nv))
        out[self._arm_row, m.ten_J_colind] = -data.ten_J
        return out

    def own_torques(self, angles: Array, tension: Array) -> dict[str, Array]:
        """Joint torques (nq,) by source that the finger itself exerts, N m."""
        muscles = np.asarray(tension)[:, None] * self.torques_per_tension(angles)
        out = dict(zip(self.tendons, muscles, strict=True))
        out["gravity"] = np.zeros(len(angles))
        if self._weight.any():
            index = np.arange(len(self.bodies))
            arms = point_jacobian(self.chain(angles), index, self.mass_centres(angles))
            out["gravity"] = np.einsum("bxj,bx->j", arms[:, :3], self._weight)
        return out

    def own_tangent(self, angles: Array, tension: Array) -> Array:
        """Derivative (nq, nq) of the finger's own torques by the angles, N m/rad."""
        out = np.zeros((len(angles), len(angles)))
        if np.any(tension) and self.guides is not None:
            for i, step in enumerate(ANGLE_STEP * np.eye(len(angles))):
                out[:, i] = np.asarray(tension) @ self._rub_at(angles + step)
                out[:, i] -= np.asarray(tension) @ self._rub_at(angles - step)
            out /= 2 * ANGLE_STEP
        elif np.any(tension):
            share = np.zeros((len(self._arm_row), len(angles)))
            share[self._arm_at, self.model.ten_J_colind] = -np.asarray(tension)[self._arm_row]
            for i, step in enumerate(ANGLE_STEP * np.eye(len(angles))):
                self._place(angles + step)
                out[:, i] = self._path_jacobian @ share
                self._place(angles - step)
                out[:, i] -= self._path_jacobian @ share
            out /= 2 * ANGLE_STEP
        if not self._weight.any():
            return out
        weight = np.hstack([self._weight, np.zeros_like(self._weight)])
        return out + geometric_stiffness(
            self.chain(angles), np.arange(len(self.bodies)), self.mass_centres(angles), weight
        )

    def beyond_guides(
        self, angles: Array, tension: Array, grip: Array | None = None
    ) -> dict[str, tuple[float, float]]:
        """The tension (N) that is left at the insertions of each tendon with friction together,
        under tensions (nt,) N, and the angle (rad) by which its longest strand turns at guides."""
        if self.guides is None:
            return {}
        left, turn = self.guides.read(self.at_angles(angles)).beyond(
            self.guides.grip if grip is None else grip
        )
        return {
            self.tendons[t]: (float(tension[t] * left[t]), float(turn[t] / mu if mu else 0.0))
            for t, mu in zip(self.guides.tendons, self.guides.coefficients, strict=True)
        }

    def _rub_at(self, angles: Array) -> Array:
        """`torques_per_tension` of a posture that is not kept."""
        data = self._place(angles)
        assert self.guides is not None
        return self.guides.read(data).arms(self.guides.grip, self.arms_of(data))

    def own_wrenches(
        self, angles: Array, tension: Array, grip: Array | None = None
    ) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin by muscle, and of gravity; `grip`: of
        friction at each guide, that of the tendons as they slide if not given."""
        data, guides = self.at_angles(angles), self.guides
        pulls = self._ways.wrenches(data, tension)
        if guides is not None:
            rubbed = guides.wrenches(data, tension, guides.grip if grip is None else grip)
            pulls[guides.tendons] = rubbed[guides.tendons]
        pulls = pulls[:, self._body]
        out = dict(zip(self.tendons, pulls, strict=True))
        force = np.hstack([self._weight, np.zeros_like(self._weight)])
        out["gravity"] = move_wrench(force, (data.xipos - data.xpos)[self._body])
        return out

    def path_lengths(self, state: FingerState) -> Array:
        return self.tendon_lengths(state.angles)

    def tendon_paths(self, state: FingerState) -> dict[str, Array]:
        return self.paths_at(state.angles)

    def paths_at(self, angles: Array) -> dict[str, Array]:
        """The world points (k, 3) of each strand from origin to insertion, m, at joint angles
        (nq,); the strands of a tendon that parts are named NAME, NAME 2, ..."""
        data = self.at_angles(angles)
        out = {
            name if n == 0 else f"{name} {n + 1}": points
            for name, strands in zip(self.tendons, self._ways.points(data), strict=True)
            for n, points in enumerate(strands)
        }
        return out if self.ties is None else {**out, **self.ties.lines(self.chain(angles))}

    def momentum(self, angles: Array, rates: Array) -> Array:
        """Each body's momentum (nb, 6) about its centre of mass, N s and N m s, world frame."""
        data, m = self.at_angles(angles), self.model
        index = np.arange(len(self.bodies))
        twist = point_jacobian(self.chain(angles), index, self.mass_centres(angles)) @ rates
        axes = data.ximat[self._body].reshape(-1, 3, 3)
        spin = np.einsum("bji,bj->bi", axes, twist[:, 3:]) * m.body_inertia[self._body]
        mass = m.body_mass[self._body][:, None]
        return np.hstack([mass * twist[:, :3], np.einsum("bij,bj->bi", axes, spin)])

    def mass_centres(self, angles: Array) -> Array:
        """The bodies' centres of mass (nb, 3) m, world frame."""
        return self.at_angles(angles).xipos[self._body]

    def at_angles(self, angles: Array) -> mujoco.MjData:
        """MuJoCo's kinematics and tendons at joint angles (nq,), until another posture is asked
        for."""
        return self._data if np.array_equal(self._at, angles) else self._place(angles)

    def _place(self, angles: Array) -> mujoco.MjData:
        m, d = self.model, self._data
        self._at[:] = angles
        self._qpos[:] = angles
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_tendon(m, d)
        return d


def needed_torque(finger: MujocoFinger, angle: Array, rate: Array, acceleration: Array) -> Array:
    """The torques (nq,) N m that muscles and hood must make for a motion in rad, rad/s and rad/s2,
    (nq,) each:

        M q'' + c(q, q') - weight - passive springs - ties - damping.

    Coordinate limits are left out: they stand for what holds a finger in a posture."""
    model = finger.model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = angle, rate, acceleration
    mujoco.mj_inverse(model, data)
    damping = np.zeros(len(angle)) if finger.law.damping is None else finger.law.damping
    needed: Array = data.qfrc_inverse - finger.law.passive(angle)[0] + damping * rate
    return needed if finger.ties is None else needed - finger.ties.torques(finger.chain(angle))
