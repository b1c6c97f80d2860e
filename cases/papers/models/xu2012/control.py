"""Two controllers of section VII, sampled: PID in tendon space, and PID in joint space mapped to
tendon forces by the quadratic programme at the moment arms of the moment.

Either is a pure step: (memory, what was measured, reference) -> (memory, wanted tendon forces).
Integrators stop while their action is at a bound; rates are differences through a first-order
filter.

The programme: tendons pull alone, and no harder than the cylinders can,

    minimise |tau - R f|^2 + w |f|^2,     0 <= f <= F

with R (nq, nt) the moment arms of the moment: section VII's problem with a small weight, since more
tendons than joints leave a choice, and with an upper bound, the cylinders' 40 N.
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np

from cases.papers.models.xu2012.actuators import MOST_FORCE, PERIOD
from cases.papers.models.xu2012.plant import RELAXATION, STIFFNESS
from cosim.errors import ConvergenceError
from cosim.port import Array

ARM = 0.01
"""m: torques are taken in units of this arm times 1 N."""
WEIGHT = 1e-4
"""Weight of the forces beside the torques' miss, in those units."""
FILTER = 0.01
"""s, of the rates."""
PRELOAD = 0.3
"""N, on every tendon, "pressurized lightly (to avoid tendon slack)"; the size is ours."""


MISSED = 0.02
"""rad: a joint whose torque is missed by more than the sleeve makes at this angle counts as at a
bound.  A little is always missed, to the programme's small weight and the preload."""


def forces_for_torques(
    torque: Array, arms: Array, most: float = MOST_FORCE, least: float = 0.0
) -> Array:
    """Tendon forces (nt,) N for torques (nq,) N m at moment arms (nt, nq) m, positive where a pull
    turns a joint in its positive sense.  Raises ConvergenceError where DAQP finds none."""
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


@dataclass(frozen=True)
class Gains:
    """Proportional, integral (1/s) and differential (s) gains, one for each of what is controlled
    or for all: N m/rad in joint space, N/m in tendon space."""

    p: Array | float
    i: Array | float
    d: Array | float


@dataclass(frozen=True)
class Memory:
    """Integral of the error, the last measurement and its filtered rate, all (n,)."""

    integral: Array
    last: Array
    rate: Array


def remember(measured: Array) -> Memory:
    """At rest."""
    return Memory(np.zeros(len(measured)), np.array(measured), np.zeros(len(measured)))


def pid(gains: Gains, memory: Memory, measured: Array, reference: Array) -> tuple[Array, Memory]:
    """The action of one sample, and what to remember."""
    error = reference - measured
    fresh = PERIOD / (PERIOD + FILTER)
    rate = memory.rate + fresh * ((measured - memory.last) / PERIOD - memory.rate)
    integral = memory.integral + PERIOD * error
    action = gains.p * error + gains.i * integral - gains.d * rate
    return np.asarray(action), Memory(integral, np.array(measured), rate)


JOINT_GAINS = Gains(0.4 * STIFFNESS, 0.4 * STIFFNESS / RELAXATION, 0.0 * STIFFNESS)
"""Gains as shares of the sleeve's stiffness: the zero of proportional and integral part lies on the
pole of sleeve and damping, so that the loop crosses at 0.4 / RELAXATION = 8 rad/s, where air and
sampling cost little phase. One set for the whole space, on the stand-in of first order."""

AIR_GAINS = Gains(
    np.array([0.2, 0.0, 0.2, 0.2]) * STIFFNESS,
    np.array([4.0, 2.5, 4.0, 4.0]) * STIFFNESS,
    np.array([0.01, 0.04, 0.01, 0.01]) * STIFFNESS,
)
"""The same on the air, whose force comes some T = 70 ms after the command: dead time 30, pressure
loop 30, sampling and averages 10.  Flexion crosses at 0.2 / RELAXATION = 4 rad/s, where that takes
16 of 90 deg.  Abduction differs: what the moment arms of the moment take out of the tendons' own
stiffness, up to G = 0.07 N m/rad against the sleeve's 0.04, they take out T late, a damping of
-G T, larger than the sleeve's.  A proportional part would add to it, so that there is none: the
differential part gives damping back and the integral finds the torque.  Linearised at 50 poses this
is stable in all, and with 6 ms of delay more in all but one."""


def joint_forces(
    gains: Gains, memory: Memory, angle: Array, reference: Array, arms: Array
) -> tuple[Array, Memory]:
    """Tendon forces (nt,) N for the torques of PID in joint space; arms (nt, nq) m at `angle`."""
    torque, new = pid(gains, memory, angle, reference)
    force = forces_for_torques(torque, arms, least=PRELOAD)
    missed = np.abs(torque - force @ arms) > MISSED * STIFFNESS
    held = np.where(missed, memory.integral, new.integral)
    return force, Memory(held, new.last, new.rate)


def tendon_forces(
    gains: Gains, memory: Memory, length: Array, reference: Array
) -> tuple[Array, Memory]:
    """Tendon forces (nt,) N of PID on lengths (nt,) m: a tendon longer than wanted is pulled.

    Where the action leaves what a cylinder can do, its integral stays as it was."""
    action, new = pid(gains, memory, length, reference)
    wanted = PRELOAD - action
    force = np.clip(wanted, PRELOAD, MOST_FORCE)
    held = np.where(force == wanted, new.integral, memory.integral)
    return force, Memory(held, new.last, new.rate)
