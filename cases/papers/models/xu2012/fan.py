"""What the tendons can do at the fingertip and at the joints: section V's near-planar fan.

One newton in tendon k accelerates the resting fingertip by a_k = J M^-1 r_k (m/s2 per N; J (3, nq)
the tip's Jacobian, M the joints' mass matrix, r_k (nq,) the moment arms).  Their third singular
value over the first says how far the fan leaves a plane.  Since tendons only pull, all directions
can be made only if the a_k (at the joints: the r_k) span them positively: the largest least tension
t of f >= t, sum f = 1, sum f_k r_k = 0 must exceed zero (Davis 1954, Am J Math 76:733).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import linprog

from cases.papers.models.xu2012.control import forces_for_torques
from cases.papers.models.xu2012.plant import Plant
from cosim.port import Array
from rigid.chain.kinematics import tip_jacobian
from rigid.model import FingerModel
from rigid.mujoco.finger import MujocoFinger

UNBOUNDED = 1e3
"""N."""


@dataclass(frozen=True)
class Fan:
    """At one pose: accelerations (nt, 3) m/s2 per N, in the world, and the fingertip (3,) m."""

    acceleration: Array
    tip: Array

    @property
    def flatness(self) -> float:
        """The accelerations' third singular value over the first: 0 for a fan in a plane."""
        return _third(self.acceleration)

    @property
    def spread(self) -> float:
        """The third singular value over the first of the accelerations' directions alone."""
        length = np.linalg.norm(self.acceleration, axis=1, keepdims=True)
        return _third(self.acceleration / length)

    @property
    def spans(self) -> bool:
        """Whether pulls accelerate the fingertip in every direction."""
        return least_share(self.acceleration) > 0.0


def _third(vectors: Array) -> float:
    value = np.linalg.svd(vectors, compute_uv=False)
    return float(value[2] / value[0])


def fan(finger: MujocoFinger, angle: Array) -> Fan:
    """At the angles (nq,) rad, joints at rest, without springs and weight."""
    chain = finger.chain(angle)
    arms = finger.moment_arms(angle)
    mass = _mass(finger.model, angle)
    return Fan(arms @ np.linalg.solve(mass, tip_jacobian(chain)[:3].T), chain.tip)


def _mass(model: mujoco.MjModel, angle: Array) -> Array:
    """The joints' mass matrix (nq, nq) kg m2."""
    data = mujoco.MjData(model)
    data.qpos[:] = angle
    mujoco.mj_forward(model, data)
    out = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, out)
    return out


def least_share(pulls: Array) -> float:
    """The largest share t that every one of the vectors (n, k) can bear of tensions that cancel, 0
    where they cancel only with some of them slack, or not at all, or lie in fewer dimensions: the
    vectors span their space by pulls alone exactly where it exceeds 0."""
    n, k = pulls.shape
    scaled = pulls / np.linalg.norm(pulls, axis=1, keepdims=True)
    if np.linalg.matrix_rank(scaled, tol=1e-9) < k:
        return 0.0
    rows = np.vstack([np.hstack([scaled.T, np.zeros((k, 1))]), np.append(np.ones(n), 0.0)])
    found = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.hstack([-np.eye(n), np.ones((n, 1))]),
        b_ub=np.zeros(n),
        A_eq=rows,
        b_eq=np.append(np.zeros(k), 1.0),
        bounds=[(0, None)] * (n + 1),
        method="highs",
    )
    return float(found.x[-1]) if found.success and found.x[-1] > 1e-9 else 0.0


@dataclass(frozen=True)
class Reach:
    """Over poses (n, nq): flatness and spread of the fan (n,), whether pulls make every
    acceleration of the fingertip and every torque of the joints, (n,) each, and the largest tendon
    force that holds the pose against sleeve and weight, (n,) N."""

    pose: Array
    flatness: Array
    spread: Array
    tip: Array
    joints: Array
    hold: Array


def reach(model: FingerModel, pose: Array) -> Reach:
    """At the poses (n, nq) rad."""
    finger, plant = MujocoFinger(model), Plant(model)
    fans = [fan(finger, q) for q in pose]
    arms = [finger.moment_arms(q) for q in pose]
    forces = [
        forces_for_torques(plant.holding_torque(q), r, most=UNBOUNDED)
        for q, r in zip(pose, arms, strict=True)
    ]
    return Reach(
        pose,
        np.array([f.flatness for f in fans]),
        np.array([f.spread for f in fans]),
        np.array([f.spans for f in fans]),
        np.array([least_share(r) > 0.0 for r in arms]),
        np.array([f.max() for f in forces]),
    )
