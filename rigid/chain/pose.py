"""Joint angles from markers: Gauss-Newton with a cubic line search (Xu et al. 2012, section VI).

With residuals r(q), Jacobian J and the value f = |r|^2 / 2, a step solves (J'J + w I) d = -J' r;
the cubic through f and its slope at both ends of the step gives how far to go along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.chain.kinematics import Indices, point_jacobian
from rigid.chain.statics import ChainFinger

WEIGHT = 0.3
"""Weight of |r|^2: bounds a step where markers do not tell two joints apart (a fingertip at the end
of its reach), and leaves Gauss-Newton alone where they fit (Fan and Yuan 2005, Computing 74:23)."""
LEAST_WEIGHT = 1e-9
"""m2."""
MOST_STEPS = 200
LITTLE = 1e-6
"""Share of the value that a step must promise to gain, or the search ends."""
FIT_ROUNDING = 1e-16
"""m2, the same where the markers fit."""
HALVINGS = 12
NEARLY = 0.9
"""Share of a full step: where the cubic's minimum lies beyond, the full step is taken as it is."""


@dataclass(frozen=True)
class BodyMarkers:
    """Points glued to bodies: indices (nm,) into the finger's bodies, places (nm, 3) m in them."""

    body: Indices
    place: Array

    def at(self, finger: ChainFinger, angle: Array) -> tuple[Array, Array]:
        """World points (nm, 3) and their Jacobian (nm, 3, nq)."""
        chain = finger.chain(angle)
        turn = chain.motion.rotation[self.body]
        point = chain.motion.position[self.body] + np.einsum("mij,mj->mi", turn, self.place)
        return point, point_jacobian(chain, self.body, point)[:, :3]


@dataclass(frozen=True)
class PoseFit:
    """Angles (nq,) and what the markers are off by, m: root of the mean square distance."""

    angle: Array
    residual: float


def cubic_minimum(f0: float, slope0: float, f1: float, slope1: float) -> float:
    """Where in (0, 1] the cubic with these values and slopes at 0 and 1 is least; 1 where it has
    no minimum between (Nocedal and Wright, Numerical Optimization, 2006, equation 3.59)."""
    a = slope0 + slope1 - 3 * (f1 - f0)
    inside = a * a - slope0 * slope1
    if inside < 0:
        return 1.0
    b = np.sqrt(inside)
    if slope1 - slope0 + 2 * b == 0:
        return 1.0
    at = 1.0 - (slope1 + b - a) / (slope1 - slope0 + 2 * b)
    return float(at) if 0 < at < 1 else 1.0


def estimate(finger: ChainFinger, markers: BodyMarkers, seen: Array, start: Array) -> PoseFit:
    """The pose whose markers come nearest to those seen (nm, 3) m, in the world.

    Raises ConvergenceError where the search does not end."""
    angle = np.array(start, dtype=float)
    off, jacobian = _off(finger, markers, seen, angle)
    for _ in range(MOST_STEPS):
        slope = jacobian.T @ off
        weight = WEIGHT * (off @ off) + LEAST_WEIGHT
        normal = jacobian.T @ jacobian + weight * np.eye(len(angle))
        step = np.asarray(np.linalg.solve(normal, -slope), dtype=np.float64)
        if -(slope @ step) <= LITTLE * (off @ off) + FIT_ROUNDING:
            break
        part, off, jacobian = _search(finger, markers, seen, angle, step, (off, jacobian))
        angle = angle + part * step
        if part == 0.0:
            break
    else:
        raise ConvergenceError(
            f"pose from markers: no end after {MOST_STEPS} steps; they are still "
            f"{1e3 * np.linalg.norm(off) / np.sqrt(len(seen)):.2f} mm off. Start nearer, or see "
            "whether the markers fit the finger"
        )
    return PoseFit(angle, float(np.linalg.norm(off) / np.sqrt(len(seen))))


def _off(
    finger: ChainFinger, markers: BodyMarkers, seen: Array, angle: Array
) -> tuple[Array, Array]:
    point, jacobian = markers.at(finger, angle)
    return (point - seen).ravel(), jacobian.reshape(-1, len(angle))


def _search(
    finger: ChainFinger,
    markers: BodyMarkers,
    seen: Array,
    angle: Array,
    step: Array,
    here: tuple[Array, Array],
) -> tuple[float, Array, Array]:
    """How far along the step, and residuals and Jacobian there: the full step where the cubic says
    that it is nearly the best, its minimum else, the half of that until the value falls."""
    off, jacobian = here
    value, slope = float(off @ off / 2), float((jacobian.T @ off) @ step)
    end, there = _off(finger, markers, seen, angle + step)
    part = cubic_minimum(value, slope, float(end @ end / 2), float((there.T @ end) @ step))
    if part > NEARLY and end @ end <= off @ off:
        return 1.0, end, there
    for _ in range(HALVINGS):
        end, there = _off(finger, markers, seen, angle + part * step)
        if end @ end <= off @ off:
            return part, end, there
        part /= 2
    return 0.0, off, jacobian
