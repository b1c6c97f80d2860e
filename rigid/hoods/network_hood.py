"""A tendon network behind the port: moment arms at joints become moments on bodies.

The network's torques tau and excursions x derive from one potential psi of joint angles theta and
tensions T.  With theta a function of the bodies' poses (`hinge_angle`), virtual work makes of each
torque two moments, tau dtheta/domega on the body beyond the joint and its opposite on the one
before; the muscles pull along `direction` at the first body's origin, and the hood hands that on
to the first body there.  So pulls and wrenches balance, and

    load = T d on the first body + sum_j tau_j(theta, T) dtheta_j,    x = dpsi/dT

are conjugate whatever the poses, whether or not the bodies move as hinges allow.  A model of moment
arms knows no lines of action: tendons press no bones together here, and a joint's force lacks
their thrust.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, HoodJacobian, Load, Motion, Response, check_step, skew
from rigid.hoods.hinge_angle import HingeAngle, angles
from rigid.hoods.network import Network
from rigid.model import Vector

SOURCES = ("direct", "network")


@dataclass(frozen=True)
class NetworkState:
    motion: Motion
    tension: Array


@dataclass(frozen=True)
class _Joints:
    """What the network makes of angles (n,) and tensions (m,)."""

    torque: Array
    """(2, n) N m, of the direct arms and of the connecting tendons."""
    excursion: Array
    """(m,) m, from where the arms integrate to zero."""
    torque_by_force: Array
    """(n, m) m, which is d excursion / d angle turned over."""
    torque_by_angle: Array
    """(n, n) N m/rad."""
    excursion_by_force: Array
    """(m,) m/N."""


class NetworkHood:
    """Tension-only and without mass, friction or history.

    hinges: as many as the network has joints, in its order; rest: the motion at which the
    unloaded tendons' excursions are zero; direction: of all muscles' pull, in the first body's
    frame; operating_force: N, for tension shares that depend on posture alone, as they are at this
    force of every muscle (9), instead of on the forces themselves.
    Raises InputError for hinges that do not fit or a force that is not positive."""

    sources = SOURCES

    def __init__(
        self,
        network: Network,
        hinges: Sequence[HingeAngle],
        rest: Motion,
        direction: Vector = (-1.0, 0.0, 0.0),
        operating_force: float | None = None,
    ) -> None:
        named = tuple(h.name for h in hinges)
        strange = {b for h in hinges for b in (h.parent, h.child)} - set(rest.bodies)
        if named != network.joints or strange:
            raise InputError(
                f"network hood: its joints are {network.joints}, the hinges {named}, between "
                f"bodies of {rest.bodies}; unknown are {sorted(strange) or 'none'}"
            )
        if operating_force is not None and not operating_force > 0:
            raise InputError(f"network hood: operating force {operating_force} N is not positive")
        self.bodies, self.tendons = rest.bodies, network.muscles
        self.network, self._hinges = network, tuple(hinges)
        self._direction = np.array(direction) / np.linalg.norm(direction)
        self._operating = operating_force
        unloaded = np.zeros(len(self.tendons))
        self._rest = self._joints(angles(self._hinges, rest).value, unloaded).excursion

    def start(self, motion: Motion) -> NetworkState:
        unloaded = np.zeros(len(self.tendons))
        check_step("network hood", self, motion, unloaded, np.inf)
        return NetworkState(motion, unloaded)

    def advance(self, state: NetworkState, motion: Motion, tension: Array, dt: float) -> Response:
        """Response at `motion` under `tension` (nt,) N; it depends on no rate and no history, so
        that any `dt` > 0 gives the same.  Raises InputError."""
        check_step("network hood", self, motion, tension, dt, none_negative=True)
        tension = np.array(tension, dtype=float)
        at = angles(self._hinges, motion)
        here = self._joints(at.value, tension)
        wrench = (here.torque @ at.rate).reshape(2, len(self.bodies), 6)
        pull = tension[:, None] * (motion.rotation[0] @ self._direction)
        wrench[0, 0, :3] += pull.sum(axis=0)
        whole = np.hstack([pull, np.cross(motion.position[0], pull)])
        load = Load(self.bodies, SOURCES, np.swapaxes(wrench, 0, 1).copy(), whole)
        return Response(NetworkState(motion, tension), load, here.excursion - self._rest)

    def jacobian(self, state: NetworkState) -> HoodJacobian:
        at = angles(self._hinges, state.motion)
        here = self._joints(at.value, state.tension)
        guide = state.motion.rotation[0] @ self._direction
        by_motion = at.rate.T @ here.torque_by_angle @ at.rate
        by_motion += np.einsum("i,iab->ab", here.torque.sum(axis=0), at.moment_rate)
        by_motion[:3, 3:6] -= state.tension.sum() * skew(guide)
        by_tension = at.rate.T @ here.torque_by_force
        by_tension[:3] += guide[:, None]
        by_twist = here.torque_by_force.T @ at.rate
        return HoodJacobian(by_motion, by_tension, by_twist, np.diag(here.excursion_by_force))

    def with_tolerance(self, tolerance: float) -> NetworkHood:
        """Itself: closed forms leave no residual."""
        return self

    def _joints(self, angle: Array, force: Array) -> _Joints:
        if self._operating is None:
            return _at_forces(self.network, angle, force)
        return _at_constant_force(self.network, angle, force, self._operating)


def _at_forces(network: Network, angle: Array, force: Array) -> _Joints:
    """Shares that follow from the forces themselves (8)."""
    _, tension = network.solve(angle, force)
    share = network.sharing(angle, force)
    bearing = network.stiffness[:, None] * (share > 0)
    spring = share @ bearing.T - np.diag(bearing.sum(axis=1))
    stretch = np.divide(1.0, bearing.sum(axis=0), out=np.zeros(len(force)), where=share.any(axis=0))
    excursion = network.excursion(angle, force)
    return _in_joints(network, angle, force, tension, share, spring, excursion, stretch)


def _at_constant_force(network: Network, angle: Array, force: Array, operating: float) -> _Joints:
    """Shares of posture alone (9): what the operating force makes, in proportion to the force."""
    same = np.full(len(force), operating)
    share = network.distribution(angle, same)
    bears = network.sharing(angle, same)
    bearing = network.stiffness[:, None] * (bears > 0) * force / operating
    spring = bears @ bearing.T - np.diag(bearing.sum(axis=1))
    excursion = network.constant_force_excursion(angle, same)
    still = np.zeros(len(force))
    return _in_joints(network, angle, force, share @ force, share, spring, excursion, still)


def _in_joints(
    network: Network,
    angle: Array,
    force: Array,
    tension: Array,
    share: Array,
    spring: Array,
    excursion: Array,
    stretch: Array,
) -> _Joints:
    """Connecting tensions (k,), their derivatives by forces (k, m) and lengths (k, k), and the
    excursions, seen from the joints."""
    direct, connecting = network.direct.at(angle), network.connecting.at(angle)
    turning = network.direct.slope @ force + network.connecting.slope @ tension
    return _Joints(
        np.stack([direct @ force, connecting @ tension]),
        excursion,
        direct + connecting @ share,
        np.diag(turning) + connecting @ spring @ connecting.T,
        stretch,
    )
