"""A finger held in a posture, its hood in equilibrium on it: joint torques from tensions.

What muscles must bear in a posture follows from torques about its joints, and for those the bones
need not move: the hood is solved on held bones, whose poses are known, so that one solve and the
tangent of that state say all.  Over the port and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.models.build import Models
from cosim.port import STATIC, Array, Load, State

NOT_MUSCLES = ("fingertip", "holder")
"""Torques that answer the others."""


class Torques(NamedTuple):
    """The torques of hood and muscles about the joints at given tensions."""

    torque: Array
    """(nq,) N m."""
    by_tension: Array
    """(nq, nt) m, its derivative."""
    state: State
    """The hood's state."""
    load: Load
    by_motion: Array
    """(6 nb, 6 nb) of the load."""


@dataclass(frozen=True)
class HeldFinger:
    """Models with the bones where the finger's state says."""

    models: Models
    finger_state: State

    @property
    def names(self) -> tuple[str, ...]:
        """All tendons, the hood's first."""
        return (*self.models.hood.tendons, *self.models.finger.tendons)

    def begin(self) -> State:
        """A state of the hood to begin from."""
        return self.models.hood.start(self.models.finger.motion(self.finger_state))

    def at(self, tension: Array, state: State) -> Torques:
        """Torques of muscles under tensions (nt,) N, from a state of the hood.  Raises
        ConvergenceError."""
        finger, hood = self.models.finger, self.models.hood
        split, at = len(hood.tendons), self.finger_state
        response = hood.advance(state, finger.motion(at), tension[:split], STATIC)
        tangent, twist = hood.jacobian(response.state), finger.jacobian(at)
        ones = np.ones(len(finger.tendons))
        each = finger.balance(at, response.load, ones).torque
        own = (
            np.array([each[name] for name in finger.tendons])
            .reshape(len(ones), len(finger.joints))
            .T
        )
        torque = twist.T @ response.load.total().ravel() + own @ tension[split:]
        by_tension = np.hstack([twist.T @ tangent.load_tension, own])
        return Torques(torque, by_tension, response.state, response.load, tangent.load_motion)

    def beside(self) -> Array:
        """The torques (nq,) N m of all that pulls without muscles: passive joints, limits,
        weight."""
        finger, bodies = self.models.finger, self.models.finger.bodies
        none = Load(bodies, ("none",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
        torque = finger.balance(self.finger_state, none, np.zeros(len(finger.tendons))).torque
        found = [t for source, t in torque.items() if source not in NOT_MUSCLES]
        total: Array = np.sum(found, axis=0)
        return total

    def support(self, at: Torques) -> tuple[Array, Array]:
        """Torques about the joints by the support's unknowns (nq, m) N m each, and the fingertip's
        force on the world by them (3, m).

        Raises InputError for a finger whose tip nothing holds."""
        finger, state = self.models.finger, self.finger_state
        nq, n = len(finger.joints), len(finger.unknowns(state))
        if n == nq:
            raise InputError(
                "force: nothing holds this case's fingertip, so it bears no force; write "
                'finger.tip.kind = "point" (free to turn there) or "clamped"'
            )
        none = np.zeros(len(finger.tendons))
        slope = finger.tangent(state, at.load, none, at.by_motion)[:nq, nq:]
        forces = [
            finger.balance(finger.displace(state, step), at.load, none).tip_force
            for step in np.eye(n)[nq:]
        ]
        return slope, np.array(forces).T
