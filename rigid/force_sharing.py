"""Muscles' forces from joint torques: the two programmes of Buchner, Hines and Hemami 1988.

Torques (n,) N m at the joints ask of muscles F (m) and bands B (k) that

    R_m F + R_ct B = tau,    C' B = F of the muscles that part,    F, B >= 0.          (10, 11, 18)

The linear programme minimises sum F_i / w_i (13) with the bands bound to shares fixed beforehand
(17); the quadratic one minimises sum (F_i / w_i)^2 (14) and leaves the shares free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog, minimize

from cosim.port import Array, ConvergenceError
from rigid.network import Network


class Sharing(NamedTuple):
    """N, of the muscles (m,) and of the connecting tendons (k,)."""

    muscles: Array
    bands: Array


def linear(
    network: Network, angle: Array, torque: Array, share: Array, offset: Array, weight: Array
) -> Sharing:
    """The cheapest muscles (m,) for joint torques (n,) at angles (n,), where the bands bear
    B = share F + offset: share (k, m), offset (k,) N, weight (m,) as the areas of (13).

    Raises ConvergenceError where no muscles make the torque."""
    direct, bands = network.direct.at(angle), network.connecting.at(angle)
    found = linprog(
        1.0 / weight,
        A_eq=direct + bands @ share,
        b_eq=torque - bands @ offset,
        A_ub=-share,
        b_ub=offset,
        method="highs",
    )
    if not found.success:
        raise _none(torque, str(found.message))
    return Sharing(found.x, share @ found.x + offset)


def quadratic(network: Network, angle: Array, torque: Array, weight: Array) -> Sharing:
    """The muscles (m,) and bands (k,) of least squared stress for joint torques (n,) at angles
    (n,); weight (m,) as the areas of (14).

    Raises ConvergenceError where no muscles make the torque."""
    m, parts = len(network.muscles), network.connection.any(axis=0)
    through = network.connection.T[parts]
    rows = [
        np.hstack([network.direct.at(angle), network.connecting.at(angle)]),
        np.hstack([-np.eye(m)[parts], through]),
    ]
    A, b = np.vstack(rows), np.append(torque, np.zeros(len(through)))
    scale = np.append(np.linalg.norm(rows[0], axis=1), np.ones(len(through)))
    A, b = A / scale[:, None], b / scale
    cost = np.append(1.0 / weight**2, np.zeros(A.shape[1] - m))
    cost /= cost.max()
    first = linprog(cost, A_eq=A, b_eq=b, method="highs")
    if not first.success:
        raise _none(torque, str(first.message))
    found = minimize(
        lambda f: 0.5 * f @ (cost * f),
        first.x,
        jac=lambda f: cost * f,
        bounds=[(0, None)] * len(cost),
        constraints={"type": "eq", "fun": lambda f: A @ f - b, "jac": lambda f: A},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 200},
    )
    if not found.success:
        raise _none(torque, str(found.message))
    return Sharing(found.x[:m], found.x[m:])


def _none(torque: Array, why: str) -> ConvergenceError:
    return ConvergenceError(
        f"no muscle forces make the joint torques {np.round(1e3 * torque, 3).tolist()} N mm: {why}"
    )
