"""A planar finger with its tip at a point, free to turn there, under an interconnected network.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, sections III-B and IV-C: with the tip held, one motion n of the joints is left, along
which the finger creeps until the network balances it,

    c q' = n (n . tau(q)),   J_tip n = 0,

with a viscosity c that only sets the pace.  Where the posture is known and the shares are not, they
are found the other way round: the share of the slip that leaves no torque on the distal phalanx.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.hoods.network import Network

VISCOSITY = 0.01
"""N m s/rad."""
SETTLED = 1e-10
"""N m: the torque along n that is left."""


def tip_jacobian(length: Array, angle: Array) -> Array:
    """The tip's Jacobian (3, 3): distal and dorsal motion of the tip (m) and the last link's turn
    (rad) per joint."""
    flexion = np.cumsum(angle)
    links = length * np.stack([-np.sin(flexion), -np.cos(flexion)])
    beyond = np.cumsum(links[:, ::-1], axis=1)[:, ::-1]
    return np.vstack([beyond, np.ones_like(flexion)])


def settle(length: Array, network: Network, force: Array, start: Array, time: float) -> Array:
    """The angles (3,) rad where the joints come to rest from `start` within `time` s under forces
    (m,) N.

    Raises ConvergenceError where they do not."""

    def along(angle: Array) -> Array:
        across = tip_jacobian(length, angle)[:2]
        n = np.cross(*across)
        return n / np.linalg.norm(n)

    def rate(_: float, angle: Array) -> Array:
        n = along(angle)
        return n * (n @ network.torque(angle, force)) / VISCOSITY

    course = solve_ivp(rate, (0.0, time), start, method="Radau", rtol=1e-10, atol=1e-13)
    angle = np.array(course.y[:, -1])
    left = abs(float(along(angle) @ network.torque(angle, force)))
    if not course.success or left > SETTLED:
        raise ConvergenceError(
            f"the finger on its tip did not settle within {time} s: {left:.1e} N m are left; "
            "allow more time, or start nearer to the coupling curve"
        )
    return angle


def distal_torque(length: Array, angle: Array, torque: Array) -> float:
    """The torque, N m, on the distal phalanx that joint torques (3,) leave to the contact beside
    its force (12)."""
    return float(np.linalg.solve(tip_jacobian(length, angle).T, torque)[2])


def best_share(without: float, wholly: float) -> float:
    """The share in [0, 1] at which a torque that is `without` at 0 and `wholly` at 1 is least."""
    return float(np.clip(without / (without - wholly), 0.0, 1.0)) if without != wholly else 0.0
