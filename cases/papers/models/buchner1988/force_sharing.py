"""Muscles' forces from joint torques: the two programmes of Buchner, Hines and Hemami 1988.

Torques (n,) N m at the joints ask of muscles F (m) and bands B (k) that

    R_m F + R_ct B = tau,    C' B = F of the muscles that part,    F, B >= 0.          (10, 11, 18)

The linear programme minimises sum F_i / w_i (13) with the bands bound to shares fixed beforehand
(17); the quadratic one minimises sum (F_i / w_i)^2 (14) and leaves the shares free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.hoods.network import Network
from rigid.muscle.least_cost import Power, Programme, least


class Sharing(NamedTuple):
    """The forces, N, of the muscles (m,) and of the connecting tendons (k,)."""

    muscles: Array
    bands: Array


def linear(
    network: Network, angle: Array, torque: Array, share: Array, offset: Array, weight: Array
) -> Sharing:
    """The cheapest muscles (m,) for joint torques (n,) at angles (n,), where the bands bear
    B = share F + offset: share (k, m), offset (k,) N, weight (m,) as the areas of (13).

    Raises ConvergenceError where no muscles make the torque."""
    bound = np.hstack([-share, np.eye(len(share))])
    return _cheapest(network, angle, torque, bound, offset, weight, 1)


def quadratic(network: Network, angle: Array, torque: Array, weight: Array) -> Sharing:
    """The muscles (m,) and bands (k,) of least squared stress for joint torques (n,) at angles
    (n,); weight (m,) as the areas of (14).

    Raises ConvergenceError where no muscles make the torque."""
    m, parts = len(network.muscles), network.connection.any(axis=0)
    bound = np.hstack([-np.eye(m)[parts], network.connection.T[parts]])
    return _cheapest(network, angle, torque, bound, np.zeros(len(bound)), weight, 2)


def _cheapest(
    network: Network,
    angle: Array,
    torque: Array,
    bound: Array,
    offset: Array,
    weight: Array,
    power: Power,
) -> Sharing:
    """Least sum (F_i / w_i)^power where the torques are made and `bound` (F, B) = offset."""
    n = bound.shape[1]
    arms = np.hstack([network.direct.at(angle), network.connecting.at(angle)])
    programme = Programme(
        np.vstack([arms, bound]), np.append(torque, offset), np.zeros(n), np.full(n, np.inf)
    )
    cost = np.append((1.0 / weight) ** power, np.zeros(n - len(weight)))
    found = least(programme, cost, power)
    if found is None:
        raise ConvergenceError(
            f"no muscle forces make the joint torques {np.round(1e3 * torque, 3).tolist()} N mm "
            f"with tendons that only pull, {', '.join(network.muscles)}"
        )
    return Sharing(found.x[: len(weight)], found.x[len(weight) :])
