"""Tendon forces for joint torques: tendons pull alone, and no harder than the cylinders can.

    minimise |tau - R f|^2 + w |f|^2,     0 <= f <= F

with R (nq, nt) the moment arms of the moment: section VII's problem with a small weight, since more
tendons than joints leave a choice, and with an upper bound, the cylinders' 40 N.
"""

from __future__ import annotations

import daqp
import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.fingers.robot_tables import MOST_FORCE

ARM = 0.01
"""m: torques are taken in units of this arm times 1 N."""
WEIGHT = 1e-4
"""Weight of the forces beside the torques' miss, in those units."""


def tensions(torque: Array, arms: Array, most: float = MOST_FORCE, least: float = 0.0) -> Array:
    """(nt,) N for torques (nq,) N m at moment arms (nt, nq) m, positive where a pull turns a joint
    in its positive sense.  Raises ConvergenceError where DAQP finds none."""
    scaled = arms / ARM
    n = len(scaled)
    found, _, flag, _ = daqp.solve(
        scaled @ scaled.T + WEIGHT * np.eye(n),
        scaled @ (torque / -ARM),
        np.zeros((0, n)),
        np.full(n, most),
        np.full(n, least),
        np.zeros(n, dtype=np.int32),
    )
    if flag < 1:
        raise ConvergenceError(f"tendon forces: the quadratic programme found none (flag {flag})")
    return np.clip(found, least, most)
