"""What the inner loop of `rigid.mujoco.implicit_step` is given: plain numbers and arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array

Indices = NDArray[np.intp]
FREE, CAGE, SHELL = 0, 1, 2


class DeviceData(NamedTuple):
    """A device in plain numbers."""

    kind: int
    stiffness: float
    """Cage: N/m^1.5 of Hertz's law; shell: Pa/m."""
    gap: float
    """m."""
    radius: float
    dissipation: float
    static_friction: float
    dynamic_friction: float
    viscous_friction: float
    transition_velocity: float


class Joints(NamedTuple):
    """Springs, limits and damping of the joints, (nq,) each but for what all share."""

    stiffness: Array
    rest: Array
    damping: Array
    lower: Array
    upper: Array
    limit_stiffness: Array
    transition: Array
    limit_damping: float


class Readings(NamedTuple):
    """MuJoCo's buffers at the start of a step, and what does not change with it."""

    mass: Array
    """Entries of the mass matrix, which stand where `mass_at` (nq, nq) says."""
    mass_at: Indices
    bias: Array
    """(nq,) N m, inertial torques less gravity's."""
    path: Array
    """Derivatives of the tendons' lengths, in `path_row` and `path_column`."""
    path_row: Indices
    path_column: Indices
    jacobian: Array
    """(6, nq) of the tip, in the world."""
    tip: Array
    """(3,) m, in the world."""
    target: Array
    """(3,) m, where the tip is held, or the device's centre."""
    frame: Array
    """(3, 3) the device's axes as columns."""
    basis: Array
    """(m, 6) unit wrenches of the support."""


class StepStart(NamedTuple):
    """What is known at the start of a step."""

    angles: Array
    rates: Array
    mass: Array
    """(nq, nq)."""
    torque: Array
    """(nq,) N m, of tendons, curves and gravity less inertial ones, at zero rates at the end."""
    by_rate: Array
    """(nq, nq) N m s, derivative of these torques by the rates at the end of the step."""
    tip: Array
    """(6, nq) the tip's Jacobian, in the device's axes."""
    position: Array
    """(3,) m, of the tip from the device's centre, in its axes."""
    held: Array
    """(m, nq) rows of the constraint."""
    drift: Array
    """(m,) m and rad, how far the constraint is off at the start."""
