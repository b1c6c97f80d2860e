"""A potential of joint angles and tensions behind the port: joint torques become moments on bodies.

Torques tau and excursions x derive from one potential psi of joint angles theta and tensions T.
With theta a function of the bodies' poses (`joint_angles`), virtual work makes of each torque two
moments, tau dtheta/domega on the body beyond the joint and its opposite on the one before; the
muscles pull along `direction` at the first body's origin, and the hood hands that on to the first
body there.  So pulls and wrenches balance, and

    load = T d on the first body + sum_j tau_j(theta, T) dtheta_j,    x = dpsi/dT

are conjugate whatever the poses, whether or not the bodies move as hinges allow.  A model of moment
arms knows no lines of action: tendons press no bones together here, and a joint's force lacks
their thrust.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, HoodJacobian, Load, Motion, Response, check_step, skew
from rigid.hoods.joint_angles import Angles, Joint, JointChain
from rigid.model import Vector

PROXIMAL: Vector = (-1.0, 0.0, 0.0)


class Derived(NamedTuple):
    """First and second derivatives of a potential, n joints and m muscles."""

    torque: Array
    """(..., n) N m; in a hood of several sources (sources, n)."""
    excursion: Array
    """(..., m) m."""
    stiffness: Array
    """(..., n, n) N m/rad."""
    arms: Array
    """(..., n, m) m."""
    compliance: Array
    """(..., m, m) m/N."""


@dataclass(frozen=True)
class JointState:
    """A posture and a load, and what the potential makes of them."""

    motion: Motion
    tension: Array
    angles: Angles
    derived: Derived


class JointHood:
    """What hoods of joint torques have in common: tension-only, without mass, friction or history.

    hinges: as many as there are `joints`, in their order; direction: of all muscles' pull, in the
    first body's frame.  Raises InputError for hinges that do not fit."""

    sources: tuple[str, ...]
    name: str
    """What errors call it."""

    def __init__(
        self,
        joints: tuple[str, ...],
        muscles: tuple[str, ...],
        hinges: Sequence[Joint],
        bodies: tuple[str, ...],
        direction: Vector,
    ) -> None:
        named = tuple(name for hinge in hinges for name in hinge.names)
        strange = {b for h in hinges for b in (h.parent, h.child)} - set(bodies)
        if named != joints or strange:
            raise InputError(
                f"{self.name}: its joints are {joints}, the hinges {named}, between bodies of "
                f"{bodies}; unknown are {sorted(strange) or 'none'}"
            )
        self.bodies, self.tendons = bodies, muscles
        self._chain = JointChain(hinges, bodies)
        self._direction = np.array(direction) / np.linalg.norm(direction)

    def derived(self, angle: Array, tension: Array) -> Derived:
        """The potential's derivatives at angles (n,) rad and tensions (m,) N."""
        raise NotImplementedError

    def start(self, motion: Motion) -> JointState:
        unloaded = np.zeros(len(self.tendons))
        check_step(self.name, self, motion, unloaded, np.inf)
        return self._state(motion, unloaded)

    def advance(self, state: JointState, motion: Motion, tension: Array, dt: float) -> Response:
        """Response at `motion` under `tension` (nt,) N; it depends on no rate and no history, so
        that any `dt` > 0 gives the same.  Raises InputError."""
        check_step(self.name, self, motion, tension, dt, none_negative=True)
        reached = self._state(motion, np.array(tension, dtype=float))
        torque = np.atleast_2d(reached.derived.torque)
        wrench = (torque @ reached.angles.rate).reshape(len(self.sources), len(self.bodies), 6)
        pull = reached.tension[:, None] * (motion.rotation[0] @ self._direction)
        wrench[0, 0, :3] += pull.sum(axis=0)
        whole = np.hstack([pull, np.cross(motion.position[0], pull)])
        load = Load(self.bodies, self.sources, np.swapaxes(wrench, 0, 1).copy(), whole)
        return Response(reached, load, reached.derived.excursion)

    def jacobian(self, state: JointState) -> HoodJacobian:
        at, derived = state.angles, state.derived
        guide = state.motion.rotation[0] @ self._direction
        by_motion = at.rate.T @ derived.stiffness @ at.rate
        by_motion += np.tensordot(np.atleast_2d(derived.torque).sum(axis=0), at.moment_rate, 1)
        by_motion[:3, 3:6] -= state.tension.sum() * skew(guide)
        by_tension = at.rate.T @ derived.arms
        by_tension[:3] += guide[:, None]
        return HoodJacobian(by_motion, by_tension, derived.arms.T @ at.rate, derived.compliance)

    def with_tolerance(self, tolerance: float) -> Self:
        """Itself: closed forms leave no residual."""
        return self

    def _state(self, motion: Motion, tension: Array) -> JointState:
        at = self._chain.angles(motion)
        return JointState(motion, tension, at, self.derived(at.value, tension))
