"""Ties: straight strands from one bone to another, which bear tension alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from rigid.chain.joint_torques import limit_energy, limit_torque
from rigid.chain.kinematics import Chain, geometric_stiffness, move_wrench, point_jacobian

TOE = 0.2e-3
"""m, over which a strand that comes taut grows as stiff as it is: the fibres are not all alike."""
SIGN = np.array([-1.0, 1.0])


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

    def tension(self, chain: Chain) -> Array:
        """Tension (k,) N."""
        return self._pull(chain)[0]

    def energy(self, chain: Chain) -> float:
        """J that the strands have stored."""
        longer = self._ways(chain)[1] - self.length
        return float(limit_energy(longer, -np.inf, 0.0, self.stiffness, TOE).sum())

    def wrenches(self, chain: Chain) -> Array:
        """The wrench (nb, 6) on each body about its origin, world frame."""
        out = np.zeros((len(chain.motion.bodies), 6))
        force = self._forces(chain).reshape(-1, 3)
        lever = (self.ends(chain) - chain.motion.position[self.body]).reshape(-1, 3)
        np.add.at(out, self.body.ravel(), move_wrench(np.hstack([force, 0 * force]), lever))
        return out

    def torques(self, chain: Chain) -> Array:
        """The torques (nq,) N m about the joints."""
        force = self._forces(chain).reshape(-1, 3)
        return np.asarray(np.einsum("ex,exq->q", force, self._jacobian(chain)))

    def tangent(self, chain: Chain) -> Array:
        """The derivative (nq, nq) of the torques by the angles, N m/rad."""
        (tension, rate), (unit, distance) = self._pull(chain), self._ways(chain)
        jacobian = self._jacobian(chain).reshape(len(self.names), 2, 3, -1)
        apart = jacobian[:, 1] - jacobian[:, 0]
        along = unit[:, :, None] * unit[:, None]
        across = (tension / distance)[:, None, None] * (np.eye(3) - along)
        stiffness = rate[:, None, None] * along + across
        force = self._forces(chain).reshape(-1, 3)
        turning = geometric_stiffness(
            chain, self.body.ravel(), self.ends(chain).reshape(-1, 3), np.hstack([force, 0 * force])
        )
        return np.asarray(turning - np.einsum("kxq,kxy,kyr->qr", apart, stiffness, apart))

    def lines(self, chain: Chain) -> Mapping[str, Array]:
        """The strands (2, 3) m to draw, world frame, by name."""
        return dict(zip(self.names, self.ends(chain), strict=True))

    def _ways(self, chain: Chain) -> tuple[Array, Array]:
        """Unit vectors (k, 3) from end to end, and the distance (k,) m."""
        first, last = np.moveaxis(self.ends(chain), 1, 0)
        distance = np.linalg.norm(last - first, axis=1)
        return (last - first) / distance[:, None], distance

    def _pull(self, chain: Chain) -> tuple[Array, Array]:
        """Tension (k,) N, and by how much it rises with the distance, N/m."""
        longer = self._ways(chain)[1] - self.length
        back, slope = limit_torque(longer, -np.inf, 0.0, self.stiffness, TOE)
        return 0.0 - back, -slope

    def _forces(self, chain: Chain) -> Array:
        """The force (k, 2, 3) N on the body at each end."""
        pull = self.tension(chain)[:, None] * self._ways(chain)[0]
        return -SIGN[:, None] * pull[:, None]

    def _jacobian(self, chain: Chain) -> Array:
        """The velocities (2 k, 3, nq) of the ends per joint rate."""
        ends = self.ends(chain).reshape(-1, 3)
        return point_jacobian(chain, self.body.ravel(), ends)[:, :3]
