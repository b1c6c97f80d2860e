"""The one-way pass: the hood's answer in one pose handed to the finger once, over the port only.

The pipeline of Jadelis' thesis (North Carolina State University), section 2.1: tendon forces load
the hood, and the bones' net reactions come back as external forces for a forward simulation.  It
handed over (2.1.3, 2.4, 4.3.2), of each phalanx, one force, averaged over time and applied at the
centre of mass, muscles and passive forces being switched off; and the net force of a rigid body
holds "any joint contact forces" too.  Each of these is a choice here.  An average over time of what
is at rest is itself.

A joint passes on the forces of all bones beyond it: with F_k the hood's force on bone k, on bone i
at its distal end sum_{k > i} F_k, at its proximal end -sum_{k >= i} F_k.  With both, on a bone at
rest, nothing is left of F_i: a net reaction with everything in it is zero and says nothing.  With
one of them the finger, which makes the joints' forces itself, bears them twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from cosim.port import Array, HoodJacobian, Load, Motion, Response, State, skew

LUMPING = "lumping"
"""The source that books what lumping takes away: the moments about the centres of mass."""
JOINT_CONTACT = "joint_contact"
"""The source under which the joints' forces are handed over."""
End = Literal["none", "distal", "proximal"]


@dataclass(frozen=True)
class FrozenHood:
    """A hood that answers every pose as it answered one: forces of constant direction on points
    that are fixed to the bodies. It fulfils `cosim.port.Hood`.

    Bodies run from the fixed one to the tip; a joint joins them at each one's origin."""

    tendons: tuple[str, ...]
    response: Response
    """The hood's own, in the pose `at`."""
    at: Motion
    by_tension: Array
    """(6 nb, nt) of the hood's own load by its tendons' tensions."""
    centre: Array | None = None
    """(nb, 3) m, in the bodies' frames, where each phalanx's force is lumped; None: it is not."""
    joint_contact: End = "none"

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of the bodies, as the hood has them."""
        return self.response.load.bodies

    @property
    def sources(self) -> tuple[str, ...]:
        """The hood's sources, then those that the one-way pass adds."""
        lumped = () if self.centre is None else (LUMPING,)
        doubled = () if self.joint_contact == "none" else (JOINT_CONTACT,)
        return (*self.response.load.sources, *lumped, *doubled)

    def start(self, motion: Motion) -> State:
        """The one state that the hood has."""
        return self.response.state

    def with_tolerance(self, tolerance: float) -> FrozenHood:
        """The hood itself: it solves nothing."""
        return self

    def advance(self, state: State, motion: Motion, tension: Array, dt: float) -> Response:
        """The same load whatever the tension, its forces on points that follow the bodies."""
        extra = [
            at_points(force, np.einsum("bij,bj->bi", motion.rotation, point)) - taken
            for force, point, taken in self._extra
        ]
        wrench = np.concatenate([self.response.load.wrench, *(e[:, None] for e in extra)], axis=1)
        load = Load(self.bodies, self.sources, wrench, self.response.load.pull)
        return Response(state, load, self.response.excursion)

    def jacobian(self, state: State) -> HoodJacobian:
        """Derivatives at the pose `at`: the finger turns by a few degrees, and they only guide its
        search."""
        nb, nt = len(self.bodies), len(self.tendons)
        by_motion = np.zeros((nb, 6, nb, 6))
        body = np.arange(nb)
        for force, point, _ in self._extra:
            arm = np.einsum("bij,bj->bi", self.at.rotation, point)
            by_motion[body, 3:, body, 3:] += skew(force) @ skew(arm)
        return HoodJacobian(
            by_motion.reshape(6 * nb, 6 * nb),
            self._by_tension(),
            np.zeros((nt, 6 * nb)),
            np.zeros((nt, nt)),
        )

    @cached_property
    def _extra(self) -> list[tuple[Array, Array, Array]]:
        return self._added_forces(self.response.load.total())

    def _added_forces(self, total: Array) -> list[tuple[Array, Array, Array]]:
        """The sources added to a hood's wrenches (nb, 6), each linear in them: forces (nb, 3),
        points (nb, 3) in the bodies' frames, and the wrenches (nb, 6) that it takes away."""
        whole, nothing = total.copy(), np.zeros_like(total)
        whole[0] = 0.0
        force, out = whole[:, :3], []
        if self.centre is not None:
            out.append((force, self.centre, whole))
        if self.joint_contact != "none":
            contact = joint_forces(force, self.joint_contact)
            point = self._joints if self.centre is None else self.centre
            out.append((contact, point, nothing))
        return out

    @property
    def _joints(self) -> Array:
        """The points (nb, 3) m, in the bodies' frames, where each joint's force acts."""
        if self.joint_contact == "proximal":
            return np.zeros((len(self.bodies), 3))
        away = np.diff(self.at.position, axis=0, append=self.at.position[-1:])
        return np.einsum("bji,bj->bi", self.at.rotation, away)

    def _by_tension(self) -> Array:
        """The derivative (6 nb, nt) by the tensions of the load that is handed over, in the pose
        `at`."""
        out = self.by_tension.copy()
        for column in out.T:
            own = column.reshape(-1, 6).copy()
            for force, point, taken in self._added_forces(own):
                arm = np.einsum("bij,bj->bi", self.at.rotation, point)
                column += (at_points(force, arm) - taken).ravel()
        return out


def at_points(force: Array, arm: Array) -> Array:
    """Wrenches (nb, 6) about the origins of forces (nb, 3) at `arm` (nb, 3) from them."""
    return np.hstack([force, np.cross(arm, force)])


def joint_forces(force: Array, end: End) -> Array:
    """The force (nb, 3) N on each phalanx by the joint at its distal or proximal end, where forces
    (nb, 3) act on the bones of a chain at rest whose first is the ground; none on the ground."""
    beyond = np.cumsum(force[::-1], axis=0)[::-1]
    out = beyond - force if end == "distal" else -beyond
    out[0] = 0.0
    return out if end != "none" else np.zeros_like(force)


@dataclass(frozen=True)
class OneWayPass:
    """The result of a one-way pass: the load that was handed over, and what it leaves open."""

    hood: FrozenHood
    interface_residual: float
    """Relative residual, as joint torques, of the finger against what the hood would have answered
    in the pose that the finger came to."""
    torque: dict[str, Array]
    """(nq,) N m of what was handed over: of the hood, and of each source that was added."""

    @property
    def answer(self) -> Load:
        """The hood's own load, in the pose `at`."""
        return self.hood.response.load

    @property
    def at(self) -> Motion:
        """The pose in which the hood was solved."""
        return self.hood.at


def torques(jacobian: Array, load: Load) -> dict[str, Array]:
    """Joint torques (nq,) N m of a load that was handed over, by what of it is the hood's own and
    what is added; jacobian: (6 nb, nq) of the bodies."""
    out = {"hood": np.zeros(jacobian.shape[1])}
    for i, source in enumerate(load.sources):
        name = f"hood {source}" if source in (LUMPING, JOINT_CONTACT) else "hood"
        out[name] = out.get(name, 0.0) + jacobian.T @ load.wrench[:, i].ravel()
    return out
