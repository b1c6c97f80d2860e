"""Ties: straight strands from one bone to another, which bear tension alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array, Ints
from rigid.chain.joint_torques import limit_energy, limit_torque
from rigid.chain.kinematics import Chain, geometric_stiffness, move_wrench, point_jacobian

TOE = 0.2e-3
"""m, over which a strand that comes taut grows as stiff as it is: the fibres are not all alike."""


class Pull(NamedTuple):
    """What strands (k,) do in a posture."""

    ends: Array
    """(k, 2, 3) m, world frame."""
    unit: Array
    """(k, 3), from the first end to the last."""
    distance: Array
    """(k,) m."""
    tension: Array
    """(k,) N."""
    rate: Array
    """(k,) N/m, by which the tension rises with the distance."""

    @property
    def force(self) -> Array:
        """(k, 2, 3) N, on the body at each end."""
        first = self.tension[:, None] * self.unit
        return np.stack([first, -first], axis=1)


@dataclass(frozen=True)
class Ties:
    """Strands (k,), each between two points of bodies."""

    names: tuple[str, ...]
    body: Ints
    """(k, 2), the bodies' numbers."""
    point: Array
    """(k, 2, 3) m, in the bodies' frames."""
    stiffness: Array
    """(k,) N/m."""
    length: Array
    """(k,) m, beyond which each bears."""

    def ends(self, chain: Chain) -> Array:
        """Where the strands end (k, 2, 3), m, world frame."""
        at = chain.motion
        turned = np.einsum("keij,kej->kei", at.rotation[self.body], self.point)
        return np.asarray(at.position[self.body] + turned)

    def pull(self, chain: Chain) -> Pull:
        """What the strands do."""
        first, last = np.moveaxis(ends := self.ends(chain), 1, 0)
        distance = np.linalg.norm(last - first, axis=1)
        back, slope = limit_torque(distance - self.length, -np.inf, 0.0, self.stiffness, TOE)
        return Pull(ends, (last - first) / distance[:, None], distance, 0.0 - back, -slope)

    def energy(self, chain: Chain) -> float:
        """J that the strands have stored."""
        longer = self.pull(chain).distance - self.length
        return float(limit_energy(longer, -np.inf, 0.0, self.stiffness, TOE).sum())

    def wrenches(self, chain: Chain) -> Array:
        """The wrench (nb, 6) on each body about its origin, world frame."""
        out, pull = np.zeros((len(chain.motion.bodies), 6)), self.pull(chain)
        lever = pull.ends - chain.motion.position[self.body]
        wrench = np.concatenate([pull.force, np.zeros_like(lever)], axis=-1)
        np.add.at(out, self.body, move_wrench(wrench, lever))
        return out

    def torques(self, chain: Chain) -> Array:
        """The torques (nq,) N m about the joints."""
        pull = self.pull(chain)
        return np.asarray(np.einsum("kex,kexq->q", pull.force, self._jacobian(chain, pull)))

    def tangent(self, chain: Chain) -> Array:
        """The derivative (nq, nq) of the torques by the angles, N m/rad."""
        pull = self.pull(chain)
        first, last = np.moveaxis(self._jacobian(chain, pull), 1, 0)
        along = pull.unit[:, :, None] * pull.unit[:, None]
        across = (pull.tension / pull.distance)[:, None, None] * (np.eye(3) - along)
        stiffness = pull.rate[:, None, None] * along + across
        force, ends = pull.force.reshape(-1, 3), pull.ends.reshape(-1, 3)
        wrench = np.hstack([force, np.zeros_like(force)])
        turning = geometric_stiffness(chain, self.body.ravel(), ends, wrench)
        apart = last - first
        return np.asarray(turning - np.einsum("kxq,kxy,kyr->qr", apart, stiffness, apart))

    def lines(self, chain: Chain) -> Mapping[str, Array]:
        """The strands (2, 3) m to draw, world frame, by name."""
        return dict(zip(self.names, self.ends(chain), strict=True))

    def _jacobian(self, chain: Chain, pull: Pull) -> Array:
        """The velocities (k, 2, 3, nq) of the ends per joint rate."""
        each = point_jacobian(chain, self.body.ravel(), pull.ends.reshape(-1, 3))[:, :3]
        return each.reshape(*self.body.shape, 3, -1)
