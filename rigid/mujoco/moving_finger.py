"""A MuJoCo finger in motion behind the port: what `cosim.coupling.schemes` steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import AffineLoad, Array, Motion, Relaxation
from rigid.chain.joint_torques import JointLaw
from rigid.chain.kinematics import (
    Chain,
    body_jacobian,
    geometric_stiffness,
    ground_reaction,
    joint_loads,
    joint_reactions,
    joint_wrenches,
    move_wrench,
)
from rigid.chain.statics import FingerState
from rigid.mujoco.dynamics import ConstantTension, FingerDynamics, Moment, Push
from rigid.mujoco.finger import MujocoFinger
from rigid.mujoco.tip_device import Device

TIME_ROUNDING = 1e-12
"""s, by which times that are the same may differ."""
SETTLED = 1e-12
"""rad, the change of the angles in the last iteration of a step."""
MOST_ITERATIONS = 30


class Moving(NamedTuple):
    """A finger in motion at one time, and the state that it was begun in."""

    start: FingerState
    moment: Moment
    acceleration: Array
    """(nq,) rad/s2, mean over the last step: the next one begins its iteration with it."""
    passive: Relaxed | None = None
    """What joints that relax bear; None of those that do not."""
    worn: Array | None = None
    """(3, nq) rad, rad, N m/rad: from where to where splints let the joints turn, and how stiff
    they are beyond; nan of joints without.  None of a finger that wears none in time."""


class Splint(NamedTuple):
    """What keeps a joint within a range while it is worn."""

    joint: str
    range: tuple[float, float] | None
    """rad; None: where the joint stands when the splint is put on."""
    stiffness: float
    """N m/rad, beyond the range."""
    begins: float
    """s, when it is put on."""
    ends: float
    """s, when it is taken off."""


class Relaxed(NamedTuple):
    """Passive joints that relax, at the end of a step."""

    torque: Array
    """(nq,) N m."""
    memory: Any
    """What they have borne."""
    loss: float
    """W, over the step: lost, or still held by what relaxes."""


@dataclass(frozen=True)
class MovingMujoco:
    """`cosim.port.MovingFinger` on MuJoCo: held by the finger's own support, or by a `device`.

    A step is that of `rigid.mujoco.dynamics`, implicit in the load: J^T w at the new poses, by
    iteration with its slope.  First order in dt."""

    finger: MujocoFinger
    device: Device | None = None
    relaxation: Relaxation | None = None
    """By which the passive torques of the joints relax, where they do."""
    splints: tuple[Splint, ...] = ()
    """Those that are put on or taken off in the motion, one a joint at most."""
    _made: dict[bytes, FingerDynamics] = field(default_factory=dict, compare=False, repr=False)
    """By the posture that a motion was begun in."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that are shared with the other side."""
        return self.finger.bodies

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the angles."""
        return self.finger.joints

    @property
    def tendons(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of the tensions."""
        return self.finger.tendons

    def begin(self, posture: Mapping[str, float]) -> Moving:
        """At rest; raises InputError for a posture that the finger does not take."""
        start = self.finger.start(posture)
        at_rest = self._dynamics(start).start()
        worn = np.full((3, len(self.joints)), np.nan) if self.splints else None
        begun = Moving(start, at_rest, np.zeros_like(at_rest.rates), worn=worn)
        if self.relaxation is None:
            return begun
        torque = self.finger.law.passive(at_rest.angles)[0]
        return begun._replace(passive=Relaxed(torque, self.relaxation.start(torque), 0.0))

    def fastest_rate(self, state: Moving, stiffness: Array) -> float:
        """The fastest rate (rad/s) at which the finger would swing from its beginning on tendons of
        `stiffness` (nt,) N/m."""
        return self._dynamics(state.start).fastest_rate(stiffness)

    def angles(self, state: Moving) -> Array:
        """Joint angles (nq,) of a state, rad."""
        return state.moment.angles

    def rates(self, state: Moving) -> Array:
        """Joint rates (nq,) of a state, rad/s."""
        return state.moment.rates

    def tip_wrench(self, state: Moving) -> Array:
        """The wrench (6,) of the fingertip on the world, N, and N m about it, world frame."""
        return state.moment.tip

    def motion(self, angles: Array) -> Motion:
        return self.finger.chain(angles).motion

    def jacobian(self, angles: Array) -> Array:
        return body_jacobian(self.finger.chain(angles))

    def path_lengths(self, angles: Array) -> Array:
        return self.finger.tendon_lengths(angles)

    def step(self, state: Moving, load: AffineLoad, tension: Array, dt: float) -> Moving:
        """Advance the finger by a step in time.  Raises InputError for a load on other bodies,
        ConvergenceError."""
        if load.at.bodies != self.bodies:
            raise InputError(f"load on bodies {load.at.bodies}: the finger's are {self.bodies}")
        dynamics, before = self._dynamics(state.start), state.moment
        law = self._law_after(state, dt)
        if law is not None:
            dynamics = dynamics.under(law)
        if not (load.wrench.any() or load.by_motion.any()):
            after = dynamics.pull(before, tension, None, dt)
            return self._moved(state, after, law, dt)
        angles = before.angles + dt * (before.rates + dt * state.acceleration)
        for _ in range(MOST_ITERATIONS):
            after = dynamics.pull(before, tension, self._push(load, angles), dt)
            turn = float(np.abs(after.angles - angles).max())
            if turn <= SETTLED:
                return self._moved(state, after, law, dt)
            angles = after.angles
        raise ConvergenceError(
            f"moving finger: the step to t = {before.time + dt:.6g} s still turns a joint by "
            f"{turn:.1e} rad after {MOST_ITERATIONS} iterations. Try a smaller step than {dt:g} s."
        )

    def _law_after(self, state: Moving, dt: float) -> JointLaw | None:
        """The joints in the `dt` s after a state; None of those that are as the finger has them."""
        law = self.finger.law
        if self.relaxation is not None and state.passive is not None:
            law = law.relaxed(*self.relaxation.law(state.passive.memory, dt))
        law = _splinted(law, state)
        return None if law is self.finger.law else law

    def _moved(self, state: Moving, after: Moment, law: JointLaw | None, dt: float) -> Moving:
        """The state with the finger `after` a step of `dt` s from it, its joints under `law`."""
        rate = (after.rates - state.moment.rates) / dt
        moved = Moving(state.start, after, rate, worn=state.worn)
        if law is None or self.relaxation is None or state.passive is None:
            return moved
        torque, last = law.passive(after.angles)[0], state.passive
        memory = self.relaxation.after(last.memory, torque, dt)
        done = -0.5 * float((last.torque + torque) @ (after.angles - state.moment.angles))
        moved = moved._replace(passive=Relaxed(torque, memory, 0.0))
        loss = (done - self._in_joints(moved) + self._in_joints(state)) / dt
        return moved._replace(passive=Relaxed(torque, memory, loss))

    def _in_joints(self, state: Moving) -> float:
        """J stored in joints, limits and ties; of joints that relax for good."""
        law, angles = self.finger.law, state.moment.angles
        if self.relaxation is not None and state.passive is not None:
            left = self.relaxation.left
            law = law.relaxed(left, (1 - left) * state.passive.memory.rest)
        law = _splinted(law, state)
        ties = self.finger.ties
        tied = 0.0 if ties is None else ties.energy(self.finger.chain(angles))
        return law.energy(angles) + tied

    def joint_torques(self, state: Moving) -> Array:
        """The torques (3, nq) N m of the passive joints, of their limits (or splints in the place
        of these) and of the damping of both."""
        law, angles = _splinted(self.finger.law, state), state.moment.angles
        passive = law.passive(angles)[0] if state.passive is None else state.passive.torque
        return np.array([passive, law.limit(angles)[0], law.viscous(angles, state.moment.rates)[0]])

    @property
    def switches(self) -> tuple[Array, Array]:
        """When each splint (k,) is put on, and when it is taken off, s."""
        times = [(s.begins, s.ends) for s in self.splints]
        begins, ends = np.array(times).reshape(-1, 2).T
        return begins, ends

    def splinted(self, state: Moving) -> Moving:
        """The state with those splints put on and taken off that are due; one that is on stays
        where it was put on."""
        if state.worn is None:
            return state
        worn, now = np.full_like(state.worn, np.nan), state.moment.time + TIME_ROUNDING
        for splint in self.splints:
            i = self.joints.index(splint.joint)
            if splint.begins <= now < splint.ends:
                worn[:, i] = state.worn[:, i]
                if np.isnan(worn[0, i]):
                    low, high = splint.range or (state.moment.angles[i],) * 2
                    worn[:, i] = low, high, splint.stiffness
        return state._replace(worn=worn)

    def splint_torques(self, state: Moving) -> Array:
        """The torques (k,) N m of the splints; 0 of those that are not on."""
        assert state.worn is not None
        index = [self.joints.index(s.joint) for s in self.splints]
        on = np.isfinite(state.worn[0, index])
        return np.where(on, self.joint_torques(state)[1, index], 0.0)

    def energy(self, state: Moving) -> float:
        return sum(self.stored_energy(state).values())

    def stored_energy(self, state: Moving) -> dict[str, float]:
        """J: kinetic, of height, in joints and limits, in the device."""
        dynamics, at = self._dynamics(state.start), state.moment
        kinetic, height = dynamics.energies(at)
        return {
            "kinetic": kinetic,
            "height": height,
            "joints": self._in_joints(state),
            "device": 0.0 if self.device is None else self.device.energy(dynamics.place(at)),
        }

    def device_loss(self, state: Moving) -> float:
        """The energy, J, that the device dissipated in the step that ended in the state."""
        return state.moment.slip

    def with_tension(self, state: Moving, tension: Array) -> Moving:
        """The state with its tendons under tensions (nt,) N already, which stretch them no more."""
        return state._replace(moment=state.moment._replace(tension=tension))

    def friction_work(self, state: Moving) -> Array:
        """The work (3,) J at the tendons' guides in the step that ended in the state: made heat,
        held before a tendon slides, and of both what came from the tendons' stretch."""
        return np.array(state.moment.friction)

    def grip(self, state: Moving) -> Array:
        """The grip (n,) of friction at the tendons' guides."""
        return state.moment.grip

    def at_insertions(self, angles: Array, tension: Array, grip: Array) -> Array:
        """The tensions (nt,) N that friction leaves at the tendons' insertions."""
        out = tension.copy()
        for name, (left, _) in self.finger.beyond_guides(angles, tension, grip).items():
            out[self.tendons.index(name)] = left
        return out

    def dissipation(self, state: Moving) -> float:
        """W, of the viscous torques of joints and limits, and of what relaxes in joints."""
        viscous = -float(self.joint_torques(state)[2] @ state.moment.rates)
        return viscous if state.passive is None else viscous + state.passive.loss

    def tip(self, angles: Array) -> Array:
        """The fingertip's point (3,) m, world frame."""
        return self.finger.chain(angles).tip

    def lines(self, angles: Array) -> dict[str, Array]:
        """Polylines (k, 3) m of the tendons, world frame, by name."""
        return self.finger.paths_at(angles)

    def ledger(
        self,
        before: tuple[Array, Array],
        now: tuple[Array, Array],
        dt: float,
        hood: Array,
        tension: Array,
        tip: Array,
        grip: Array,
        joints: Array,
    ) -> dict[str, Array]:
        """The wrench (nb, 6) on each body about its origin (world frame) by source at the end of a
        step of `dt` s from angles and rates `before` to `now`: each muscle, gravity, passive,
        limit, damping, fingertip, inertia (minus the change of momentum over the step), joint, and
        the ground, which holds the fixed body; with the hood's (nb, 6) they close to zero on each
        body.

        tension: (nt,) N, of the finger's own tendons; tip: (6,) of the fingertip on the world;
        grip: (n,) of friction at the tendons' guides; joints: (3, nq) N m, as of
        `joint_torques`."""
        finger, angles = self.finger, now[0]
        chain, (passive, limit, damping) = finger.chain(angles), joints
        fingertip = np.zeros_like(hood)
        fingertip[-1] = move_wrench(-tip, chain.tip - chain.motion.position[-1])
        momentum = [finger.momentum(*state) for state in (before, now)]
        change = (momentum[0] - momentum[1]) / dt
        centre = finger.mass_centres(angles) - chain.motion.position
        books = {
            **finger.own_wrenches(angles, tension, grip),
            "passive": joint_wrenches(chain, passive),
            "limit": joint_wrenches(chain, limit),
            **({} if finger.ties is None else {"tie": finger.ties.wrenches(chain)}),
            "damping": joint_wrenches(chain, damping),
            "fingertip": fingertip,
            "inertia": move_wrench(change, centre),
        }
        applied = hood + np.sum(list(books.values()), axis=0)
        joint = joint_loads(chain, joint_reactions(chain, applied))
        return {**books, "joint": joint, "ground": ground_reaction(applied + joint)}

    def _push(self, load: AffineLoad, angles: Array) -> Push:
        """The load's torques at joint angles, with their slope."""
        chain: Chain = self.finger.chain(angles)
        jacobian = body_jacobian(chain)
        change = load.by_motion @ load.at.twist_to(chain.motion).ravel()
        wrench = load.wrench + change.reshape(-1, 6)
        slope = jacobian.T @ load.by_motion @ jacobian
        bodies = np.arange(len(self.bodies))
        slope += geometric_stiffness(chain, bodies, chain.motion.position, wrench)
        return Push(jacobian.T @ wrench.ravel(), slope, angles)

    def _dynamics(self, start: FingerState) -> FingerDynamics:
        key = start.angles.tobytes()
        if key not in self._made:
            idle = ConstantTension(np.zeros(len(self.tendons)))
            self._made[key] = FingerDynamics(self.finger, start, idle, self.device)
        return self._made[key]


def _splinted(law: JointLaw, state: Moving) -> JointLaw:
    """The joints of a law with the splints that are worn in a state."""
    return law if state.worn is None else law.splinted(*state.worn)
