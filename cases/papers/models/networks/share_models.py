"""Muscle forces to fingertip force and back, with shares of tension in place of joint angles.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, section IV: the share alpha of every extensor's force goes to the slip, 1 - alpha to
the lateral band, and

    tau = J' f_x = R(theta, alpha) f_m,    f_x = (distal, dorsal, tau_dist).              (12)

Near the coupling curve theta says little of alpha.  The interconnected model takes the alpha that
leaves the least |tau_dist| (`forward`), or the muscle forces nearest to an estimate

    min |f - f_est|^2,   f_x = J^-T R(theta, alpha) f,   f >= 0,   0 <= alpha <= 1        (13)

(`inverse`); the static model has one alpha for each extensor once and for all.  N, m, rad; all
functions take any leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from cosim.port import Array
from rigid.hoods.network import Arms

MOMENT_ARM = 10e-3
"""m, over which tau_dist counts beside forces, where (13) has no solution."""
EXACT = 1e7
"""Weight of a miss of the constraint in (13) over a miss of the estimate."""
GRID, ZOOMS = 13, 6


@dataclass(frozen=True)
class ShareFinger:
    """What a model knows of a finger of m muscles."""

    length: Array
    """(3,) m, of the links."""
    direct: Arms
    """(3, m), of the muscles themselves."""
    slip: Arms
    """(3, 1), of the slip."""
    lateral: Arms
    """(3, 1), of the lateral and terminal band."""
    parts: Array
    """(m,) 1 for the muscles that part into both, 0 for the others."""

    def transfer(self, angle: Array, share: Array) -> Array:
        """The transfer matrix (..., 3, m), J^-T R(theta, alpha): fingertip force and torque by the
        muscles' forces, at angles (..., 3) and the muscles' shares (..., m)."""
        way = self.slip.at(angle) * share[..., None, :]
        way = way + self.lateral.at(angle) * (1.0 - share[..., None, :])
        arms = self.direct.at(angle) + way * self.parts
        across = np.swapaxes(tip_jacobians(self.length, angle), -1, -2)
        return np.asarray(np.linalg.solve(across, arms), dtype=float)


class ForcePrediction(NamedTuple):
    """The prediction of a fingertip force."""

    force: Array
    """(..., 2) N on the world, distal and dorsal."""
    torque: Array
    """(...) N m, tau_dist, that the point contact cannot bear."""
    share: Array
    """(..., m)."""


class Inverse(NamedTuple):
    """The prediction of muscle forces."""

    muscles: Array
    """(..., m) N."""
    share: Array
    """(..., m)."""
    miss: Array
    """(...) N by which the constraint is missed, where no muscle forces meet it."""


def tip_jacobians(length: Array, angle: Array) -> Array:
    """The tip's Jacobians (..., 3, 3): distal and dorsal motion of the tip (m) and the last link's
    turn (rad) per joint, as `point_contact.tip_jacobian`."""
    flexion = np.cumsum(angle, axis=-1)
    links = -length * np.stack([np.sin(flexion), np.cos(flexion)], axis=-2)
    beyond = np.cumsum(links[..., ::-1], axis=-1)[..., ::-1]
    return np.concatenate([beyond, np.ones_like(flexion)[..., None, :]], axis=-2)


def forward(finger: ShareFinger, angle: Array, force: Array) -> ForcePrediction:
    """The interconnected model: the share with the least |tau_dist| for forces (..., m)."""
    ends = [_distal(finger, angle, force, share) for share in (0.0, 1.0)]
    span = ends[0] - ends[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip(np.where(span == 0.0, 0.0, ends[0] / span), 0.0, 1.0)
    return with_shares(finger, angle, force, share[..., None] * np.ones_like(force))


def with_shares(finger: ShareFinger, angle: Array, force: Array, share: Array) -> ForcePrediction:
    """The static model: given shares (..., m) or (m,)."""
    share = np.broadcast_to(share, force.shape)
    found = np.einsum("...im,...m->...i", finger.transfer(angle, share), force)
    return ForcePrediction(found[..., :2], found[..., 2], share)


def best_share(finger: ShareFinger, angle: Array, force: Array, tip_force: Array) -> float:
    """The one share with which the model comes nearest to measured fingertip forces (n, 2), least
    squares: the static model's, from a single extensor's force."""
    ends = [with_shares(finger, angle, force, np.full(force.shape, s)).force for s in (0.0, 1.0)]
    change, missing = (ends[1] - ends[0]).ravel(), (tip_force - ends[0]).ravel()
    return float(np.clip(change @ missing / (change @ change), 0.0, 1.0))


def inverse(
    finger: ShareFinger,
    angle: Array,
    tip_force: Array,
    estimate: Array,
    share: Array | None = None,
    least: float = 0.0,
) -> Inverse:
    """Equation 13 for fingertip forces (..., 2) without torque: muscle forces of at least `least` N
    nearest to the estimates (..., m), with one share to be found, or the given ones (m,).

    Where no forces meet the constraint the nearest are taken, torque over MOMENT_ARM."""
    if share is not None:
        fixed = np.broadcast_to(share, estimate.shape)
        return _nearest(finger, angle, tip_force, estimate, fixed, least)[1]
    low, high = np.zeros(angle.shape[:-1]), np.ones(angle.shape[:-1])
    for _ in range(ZOOMS):
        grid = low + np.linspace(0.0, 1.0, GRID).reshape(-1, *[1] * low.ndim) * (high - low)
        shares = grid[..., None] * np.ones(estimate.shape[-1])
        cost, _ = _nearest(finger, angle, tip_force, estimate, shares, least)
        best = np.take_along_axis(grid, cost.argmin(axis=0)[None], axis=0)[0]
        step = (high - low) / (GRID - 1)
        low, high = np.maximum(best - step, 0.0), np.minimum(best + step, 1.0)
    found = best[..., None] * np.ones(estimate.shape[-1])
    return _nearest(finger, angle, tip_force, estimate, found, least)[1]


def _distal(finger: ShareFinger, angle: Array, force: Array, share: float) -> Array:
    return with_shares(finger, angle, force, np.full(force.shape, share)).torque


def _nearest(
    finger: ShareFinger, angle: Array, tip_force: Array, estimate: Array, share: Array, least: float
) -> tuple[Array, Inverse]:
    """Cost (...) and solution of (13) with the shares (..., m) given: every set of muscles that
    pull above `least` is tried, of those that do the cheapest is the solution."""
    scale = np.array([1.0, 1.0, 1.0 / MOMENT_ARM])
    asked = np.concatenate([tip_force, np.zeros_like(tip_force[..., :1])], axis=-1)
    matrix = finger.transfer(angle, share) * scale[:, None]
    base = np.full(estimate.shape[-1], least)
    missing, wanted = asked - matrix @ base, np.broadcast_to(estimate - base, share.shape)
    turned = np.swapaxes(matrix, -1, -2)
    hessian = np.eye(len(base)) + EXACT * turned @ matrix
    right = wanted + EXACT * np.einsum("...mi,...i->...m", turned, missing)
    cheapest, best = np.full(share.shape[:-1], np.inf), np.zeros(share.shape)
    for pulls in product((0.0, 1.0), repeat=len(base)):
        on, f = np.flatnonzero(pulls), np.zeros(share.shape)
        kept = hessian[..., on[:, None], on]
        f[..., on] = np.linalg.solve(kept, right[..., on, None])[..., 0]
        off = np.einsum("...im,...m->...i", matrix, f) - missing
        cost = ((f - wanted) ** 2).sum(axis=-1) + EXACT * (off**2).sum(axis=-1)
        better = (f >= 0.0).all(axis=-1) & (cost < cheapest)
        cheapest, best = np.where(better, cost, cheapest), np.where(better[..., None], f, best)
    off = np.einsum("...im,...m->...i", matrix, best) - missing
    return cheapest, Inverse(best + base, share, np.linalg.norm(off, axis=-1))
