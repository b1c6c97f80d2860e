"""The greatest force that a fingertip held at a point can bear."""

from __future__ import annotations

import numpy as np

from cosim.models.build import Models
from cosim.port import Array, OpenFinger, State
from cosim.solve.static import States

RESISTING = ("passive", "limit", "fingertip")
DIFFERENCE = 1e-6
"""rad."""


def greatest_tip_force(finger: OpenFinger, at: State, torque: Array) -> float:
    """The most (N) that a fingertip held at a point can bear under joint torques tau (nq,) N m.

    With J the tip's Jacobian (3, nq) and F the force on the world, J^T F = tau + p, where springs
    and limits that are at rest in the posture make p.  The tip leaves one motion n, J n = 0, along
    which each of them opposes its joint's turn: p_j = -c_j n_j s with c_j >= 0, whatever its law.
    So n . (tau + p) = 0 makes F = sum_j w_j F_j with w_j = c_j n_j^2 / sum_k c_k n_k^2, F_j being
    the force while joint j alone resists: a mean of the F_j, no larger than the largest of them."""
    n = len(torque)
    tip = np.zeros((3, n))
    for j in range(n):
        step = np.zeros(len(finger.unknowns(at)))
        step[j] = DIFFERENCE
        ahead, behind = (finger.tip(finger.displace(at, s)) for s in (step, -step))
        tip[:, j] = (ahead - behind) / (2 * DIFFERENCE)
    alone = [np.linalg.solve(np.column_stack([tip.T, e]), torque)[:3] for e in np.eye(n)]
    return float(np.linalg.norm(alone, axis=1).max())


def force_and_bound(models: Models, states: States) -> tuple[float, float]:
    """N: the loaded tip force, and the largest that what pulls in that pose could make: tendons on
    bones, and of the hood its own torque, without what a pass adds."""
    loaded = states.loaded
    torque = {s: t for s, t in loaded.known_balance.torque.items() if s not in RESISTING}
    if states.one_way is not None:
        torque["hood"] = states.one_way.torque["hood"]
    pull = np.sum(list(torque.values()), axis=0)
    bound = greatest_tip_force(models.finger, loaded.finger_state, pull)
    return float(np.linalg.norm(loaded.known_balance.tip_force)), bound
