"""A finger in motion: M(q) dv/dt = torques + J^T w, in joint space, by implicit steps.

A step from (q, v) to (q + h v+, v+) solves

    M (v+ - v) = h [ A^T t + gravity - c(q, v) + joints(q + h v+, v+) + J^T w(p + h J v+, J v+) ]

by Newton's method in v+: backward Euler in the springs, limits and damping of the joints and in the
device about the fingertip, which alone are stiff; M, A, J and the inertial torques c are taken at
the start, and the tensions t follow the tendons' change of length with the stiffness that the
muscles tell.  Where the tip is held its constraint B J v+ = -gap / h is solved with it, exactly,
and takes the drift of one step out in the next.  First order in h (Hairer and Wanner, Solving
Ordinary Differential Equations II); what it damps is in the audit.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError
from cosim.port import Array, State
from rigid.chain.joint_torques import JointLaw
from rigid.chain.statics import FingerState
from rigid.chain.support import turn_gap
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.implicit_step import advance_step
from rigid.mujoco.step_data import Joints, Readings
from rigid.mujoco.tendon_friction import NO_WORK, FrictionStep, FrictionWork
from rigid.mujoco.tip_device import Device, Nothing

TORQUE_TOLERANCE = 1e-10
"""N m, of the torques in each step."""
SETTLED_GRIP, MOST_ROUNDS = 1e-10, 40
"""Change of friction's grip in the last round of a step, and how many rounds there are at most."""
MOST_SPLITS = 8
"""A step that does not converge is halved so often."""
UNTURNED = np.eye(3)


class DynamicPull(NamedTuple):
    """What muscles answer, (nt,) each."""

    tension: Array
    """N, at the given lengths."""
    stiffness: Array
    """N/m, at least 0: how the tension follows the path's length within a step."""
    state: State


class Push(NamedTuple):
    """Torques (nq,) from elsewhere, N m at joint angles `at` (nq,) rad, with slope (nq, nq)."""

    torque: Array
    slope: Array
    at: Array


class MuscleModel(Protocol):
    """Anything that pulls on a finger's tendons; its state is an opaque value."""

    def start(self, length: Array) -> State:
        """The state at t = 0 with paths of `length` (nt,) m."""
        ...

    def pull(self, state: State, time: float, length: Array, dt: float) -> DynamicPull:
        """The tension at `time` s, `dt` s after `state` (0: at the start)."""
        ...


@dataclass(frozen=True)
class ConstantTension:
    """Tensions (nt,) N that do not change."""

    tension: Array

    def start(self, length: Array) -> State:
        return None

    def pull(self, state: State, time: float, length: Array, dt: float) -> DynamicPull:
        return DynamicPull(self.tension, np.zeros(len(self.tension)), None)


class Moment(NamedTuple):
    """A finger at one time: the opaque state of `FingerDynamics.advance`, and what it observed."""

    time: float
    angles: Array
    rates: Array
    tip: Array
    """(6,) N, and N m about the fingertip, of it on the world in the world's axes."""
    tension: Array
    """(nt,) N."""
    length: Array
    """(nt,) m, of the tendons at the start of the step that ended here."""
    kinetic: float
    """J, with the mass matrix at the start of that step."""
    slip: float
    """J, that the device dissipated in that step."""
    muscles: State
    held: Array
    """(m,) N and N m, reactions of the support."""
    grip: Array
    """(n,) of friction at the tendons' guides; none where there is no friction."""
    friction: FrictionWork
    """At the guides, in that step."""


class FingerDynamics:
    """A MuJoCo finger whose tip is held by its own support, or by a device about it.

    MuJoCo gives mass matrix, inertial torques, tendons and tip from the angles and rates of each
    call alone, so that a state always gives the same bits."""

    def __init__(
        self,
        finger: MujocoFinger,
        state: FingerState,
        muscles: MuscleModel,
        device: Device | None = None,
        frame: Array = UNTURNED,
    ) -> None:
        """state: as from `finger.start`: the posture to begin in; its target is the support's and
        the centre of the device.  device: in place of the finger's support.  frame (3, 3): the
        device's axes as columns in the world; the world's if not given."""
        self._finger, self._state, self._muscles, self._frame = finger, state, muscles, frame
        # the support's directions, or the device in plain numbers
        held = state.basis if device is None else np.zeros((0, 6))
        self._turns = bool(held[:, 3:].any())
        self.device: Device = Nothing() if device is None else device
        self._surface, self._law, self._joints = (
            self.device.surface,
            finger.law,
            _joints(finger.law),
        )
        self._model = m = finger.model
        self._data = d = mujoco.MjData(m)
        self._site, self._last = m.site("tip").id, m.nbody - 1
        self._position, self._velocity = d.qpos, d.qvel
        # views of MuJoCo's arrays, filled by each call of `_at`
        self._readings = Readings(
            d.M,
            _dense_mass(m),
            np.zeros(m.nv),
            d.ten_J,
            np.repeat(np.arange(m.ntendon), m.ten_J_rownnz),
            m.ten_J_colind.astype(np.intp),
            np.zeros((6, m.nv)),
            d.site_xpos[self._site],
            state.target,
            np.ascontiguousarray(frame, dtype=float),
            held,
        )
        self._nothing = (np.zeros(3), np.zeros(m.nv), np.zeros((m.nv, m.nv)))

    def start(self) -> Moment:
        """Return the state at rest in the posture."""
        q, nq = self._state.angles, len(self._state.angles)
        self._at(q, np.zeros(nq))
        length = self._data.ten_length.copy()
        muscles = self._muscles.start(length)
        tension = self._muscles.pull(muscles, 0.0, length, 0.0).tension
        held = np.zeros(len(self._readings.basis))
        guides = self._finger.guides
        return Moment(
            time=0.0,
            angles=q,
            rates=np.zeros(nq),
            tip=np.zeros(6),
            tension=tension,
            length=length,
            kinetic=0.0,
            slip=0.0,
            muscles=muscles,
            held=held,
            grip=np.zeros(0) if guides is None else guides.grip,
            friction=NO_WORK,
        )

    def advance(self, at: Moment, dt: float) -> Moment:
        """Return the state `dt` s later.  A step that does not converge is taken in two halves:
        while the device's friction falls with the speed of slip, only a short one has a single
        solution.

        Raises ConvergenceError."""
        return self._advance(at, dt, MOST_SPLITS, None, None)

    def pull(self, at: Moment, tension: Array, push: Push | None, dt: float) -> Moment:
        """Return the state `dt` s later as `advance` does, under tensions (nt,) N in place of the
        muscles', and torques from elsewhere where there are any.  Raises ConvergenceError."""
        pull = DynamicPull(tension, np.zeros(len(tension)), None)
        return self._advance(at, dt, MOST_SPLITS, pull, push)

    def _advance(
        self, at: Moment, dt: float, splits: int, given: DynamicPull | None, push: Push | None
    ) -> Moment:
        # what is known at the start: MuJoCo's arrays, and the muscles' tensions at the end
        self._at(at.angles, at.rates)
        length, time = self._data.ten_length.copy(), at.time + dt
        pull = self._muscles.pull(at.muscles, time, length, dt) if given is None else given
        rub = self._friction(at, pull)
        more, grip = self._more(at.angles, push), at.grip
        turned = dt * at.rates
        for _ in range(MOST_ROUNDS):
            # the implicit step, with friction linear about the last round's
            outside = more
            if rub is not None:
                grip = rub.grip_after(turned)
                torque, slope = rub.torque(grip, turned)
                outside = more[0], more[1] + torque, more[2] + slope
            done, angles, rates, held, wrench, tension, kinetic, slip = advance_step(
                self._surface,
                self._joints,
                self._readings,
                (at.angles, at.rates, at.held),
                (pull.tension, pull.stiffness),
                outside,
                dt,
                TORQUE_TOLERANCE,
            )
            turned = dt * rates
            if rub is None or not done:
                break
            if np.abs(rub.grip_after(turned) - grip).max() <= SETTLED_GRIP:
                break
        else:
            done = False
        if done:
            return Moment(
                time=time,
                angles=angles,
                rates=rates,
                tip=-wrench,
                tension=tension,
                length=length,
                kinetic=kinetic,
                slip=slip,
                muscles=pull.state,
                held=held,
                grip=grip,
                friction=NO_WORK if rub is None else rub.work(grip, turned, tension),
            )
        if splits == 0:
            raise ConvergenceError(
                f"finger in motion: the step to t = {time:.6g} s did not converge, down to "
                f"{dt:.1e} s. Try a smaller step, a softer contact or smaller tensions."
            )
        # it did not converge: two halves
        half = self._advance(at, dt / 2, splits - 1, given, push)
        end = self._advance(half, dt / 2, splits - 1, given, push)
        both = FrictionWork(*np.add(half.friction, end.friction).tolist())
        return end._replace(length=half.length, slip=half.slip + end.slip, friction=both)

    def _friction(self, at: Moment, pull: DynamicPull) -> FrictionStep | None:
        """Friction over the step from `at`; None where there is none."""
        guides = self._finger.guides
        if guides is None:
            return None
        return FrictionStep(
            guides.read(self._data),
            guides.presliding,
            self._finger.arms_of(self._data),
            at.grip,
            pull.tension,
            pull.stiffness,
            pull.tension - at.tension,
        )

    @property
    def law(self) -> JointLaw:
        """The joints' springs, limits and damping."""
        return self._law

    def under(self, law: JointLaw) -> FingerDynamics:
        """The same finger with other springs of its joints, limits and damping."""
        other = copy(self)
        other._law, other._joints = law, _joints(law)
        return other

    def tendon_lengths(self, at: Moment) -> Array:
        """The tendons' lengths (nt,) m in the angles of a state."""
        return self._finger.tendon_lengths(at.angles)

    def place(self, at: Moment) -> Array:
        """The fingertip's place (3,) m from the device's centre in its axes."""
        gap: Array = self._finger.chain(at.angles).tip - self._state.target
        return gap @ self._frame

    def energies(self, at: Moment) -> tuple[float, float]:
        """The energies, J, in the angles of a state: kinetic, and of height in gravity."""
        self._at(at.angles, at.rates)
        product = np.zeros(len(at.rates))
        mujoco.mj_mulM(self._model, self._data, product, at.rates)
        weight = self._model.body_mass[:, None] * self._model.opt.gravity
        return 0.5 * float(at.rates @ product), -float((weight * self._data.xipos).sum())

    def fastest_rate(self, stiffness: Array) -> float:
        """The fastest rate (rad/s) at which the finger at the start would swing on tendons of
        `stiffness` (nt,) N/m: the root of the largest eigenvalue of M^-1 A^T k A."""
        self._at(self._state.angles, np.zeros(len(self._state.angles)))
        mass = np.array(self._readings.mass)[self._readings.mass_at]
        arms = self._finger.arms_of(self._data)
        hold = arms.T @ (stiffness[:, None] * arms)
        return float(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, hold)).real.max(initial=0.0)))

    def _at(self, angles: Array, rates: Array) -> None:
        m, d, jacobian = self._model, self._data, self._readings.jacobian
        self._position[:] = angles
        self._velocity[:] = rates
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_tendon(m, d)
        mujoco.mj_makeM(m, d)
        mujoco.mj_comVel(m, d)
        mujoco.mj_rne(m, d, 0, self._readings.bias)
        mujoco.mj_jacSite(m, d, jacobian[:3], jacobian[3:], self._site)

    def _more(self, angles: Array, push: Push | None) -> tuple[Array, Array, Array]:
        """The tip's turn from the one held, where it is; torques of curves and from elsewhere at
        these angles, and their slopes."""
        turned, torque, slope = self._nothing
        if self._turns:
            now = self._data.xmat[self._last].reshape(3, 3)
            turned = turn_gap(self._state.turn, now)[0]
        if self.law.curves or np.any(self.law.held):
            torque, slope = _curves(self.law, angles)
        if (ties := self._finger.ties) is not None:
            chain = self._finger.chain(angles)
            torque, slope = torque + ties.torques(chain), slope + ties.tangent(chain)
        if push is not None:
            torque = torque + push.torque + push.slope @ (angles - push.at)
            slope = slope + push.slope
        return turned, torque, slope


def _dense_mass(model: mujoco.MjModel) -> NDArray[np.intp]:
    """The places (nq, nq) where MuJoCo keeps each entry of the mass matrix, of which it has the
    lower half."""
    out = np.zeros((model.nv, model.nv), dtype=np.intp)
    rows = np.repeat(np.arange(model.nv), model.M_rownnz)
    out[rows, model.M_colind] = out[model.M_colind, rows] = np.arange(len(rows))
    return out


def _curves(law: JointLaw, angles: Array) -> tuple[Array, Array]:
    """The torques (nq,) N m and slopes (nq, nq) N m/rad of torque curves, and what is held."""
    torque, slope = np.zeros(len(angles)) + law.held, np.zeros((len(angles), len(angles)))
    for joint, curve in law.curves.items():
        i = law.joints.index(joint)
        torque[i], slope[i, i] = curve(float(angles[i]))
    return torque, slope


def _joints(law: JointLaw) -> Joints:
    damping = np.zeros(len(law.joints)) if law.damping is None else law.damping
    return Joints(
        law.stiffness,
        law.rest,
        damping,
        law.lower,
        law.upper,
        law.limit_stiffness + np.zeros(len(law.joints)),
        law.transition + np.zeros(len(law.joints)),
        law.limit_damping,
    )
