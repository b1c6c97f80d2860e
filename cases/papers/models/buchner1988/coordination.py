"""The flexion of Buchner, Hines and Hemami 1988 in closed loop: a finger that is asked for a
straight line between the interphalangeal joints and goes along a parabola.

What the paper states: the reference (straight to PIP 110, DIP 73 deg in 1 s, DIP in proportion to
PIP, MCP at rest), the dynamics (7), the bands (15, 16), the two programmes that share a torque U
among muscles (13, 14, 17, 18).  "The computation of torque u and feedback mechanisms are not
discussed in this paper"; nor is the reference's course in time.  Chosen here:

  - the course in time: a polynomial of fifth order (`flexion.quintic`);
  - U: that of the reference's accelerations with linear feedback, at the finger's actual state,
        U = J(q) [q_r'' + 2 w (q_r' - q') + w^2 (q_r - q)] + J1 q'^2 + G(q),   w = 10 rad/s;
  - a programme shares U with the bands at the lateral band's share a, and the bands then bear what
    they must (16), with the shifts' difference e as it is.

So the joints feel U and the bands' elasticity, a spring of energy K e^2 / 2, whatever the
programme: the spring draws the finger onto the parabola (6), feedback to the line.  Were e known
to the programmes, as (17) read literally says, muscles would make U exactly and the finger would
stay on the line for any K (`bands_answer = False`); the paper's figure 7 shows the parabola.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from cases.papers.models.buchner1988.flexion import DURATION, Course, quintic, torques
from cases.papers.models.buchner1988.force_sharing import Sharing, linear, quadratic
from cosim.errors import ConvergenceError
from cosim.port import Array
from rigid.chain.planar_chain import BUCHNER, PlanarChain
from rigid.hoods.two_band import (
    ELASTICITY,
    MUSCLES,
    TABLE_1,
    Entry,
    coupled_dip,
    shift_difference,
    two_band,
)

Programme = Literal["linear", "quadratic"]
BANDWIDTH = 10.0
"""rad/s, w: an assumption."""
EQUAL = np.ones(len(MUSCLES))
MOTION_TOLERANCE = 1e-9
"""Tolerance of the motion, rad and rad/s."""
SLACK = 1e-9
"""N."""


@dataclass(frozen=True)
class ControlLoop:
    """What is closed, and how: `bandwidth` in rad/s, `elasticity` in N/m."""

    bandwidth: float = BANDWIDTH
    elasticity: float = ELASTICITY
    lateral_share: float = 0.5
    """alpha of the linear programme."""
    bands_answer: bool = True
    course: Course = quintic
    table: Mapping[tuple[str, str], Entry] = field(default_factory=lambda: TABLE_1)
    chain: PlanarChain = field(default_factory=lambda: BUCHNER)


@dataclass(frozen=True)
class CoordinatedMotion:
    """n times (s); joint angles MCP, PIP, DIP (n, 3) rad, their rates, and the angles asked for."""

    time: Array
    angle: Array
    rate: Array
    reference: Array


@dataclass(frozen=True)
class Forces:
    """The tendons' forces, N, along a motion."""

    muscles: Array
    """(n, 5) of `MUSCLES`."""
    bands: Array
    """(n, 2) of the middle and the lateral band, as they are (16)."""
    share: Array
    """(n,) alpha, the lateral band's share where both shifts agree."""


def reference(
    time: Array, course: Course = quintic, table: Mapping[tuple[str, str], Entry] = TABLE_1
) -> tuple[Array, Array, Array]:
    """The angles, rates and accelerations (..., 3) that are asked for: DIP in proportion to PIP."""
    full = course(np.array(DURATION))[0]
    ratio = float(coupled_dip(full, table) / full)
    angle, rate, acceleration = (
        np.stack([np.zeros_like(x), x, ratio * x], axis=-1) for x in course(time)
    )
    return angle, rate, acceleration


def flex(loop: ControlLoop, samples: int = 201) -> CoordinatedMotion:
    """The finger's motion from rest, straight."""
    times = np.linspace(0.0, DURATION, samples)

    def slope(time: float, state: Array) -> Array:
        angle, rate = state[:3], state[3:]
        torque = required_torque(loop, time, angle, rate) + band_torque(loop, angle)
        return np.append(rate, loop.chain.acceleration(angle, rate, torque, np.zeros(2)))

    found = solve_ivp(
        slope,
        (0.0, DURATION),
        np.zeros(6),
        method="DOP853",
        t_eval=times,
        rtol=MOTION_TOLERANCE,
        atol=MOTION_TOLERANCE,
    )
    asked = reference(times, loop.course, loop.table)[0]
    return CoordinatedMotion(times, found.y[:3].T, found.y[3:].T, asked)


def share_forces(loop: ControlLoop, motion: CoordinatedMotion, programme: Programme) -> Forces:
    """The muscles' and bands' forces that make a motion of the loop.

    Raises ConvergenceError where no muscles make a torque, or a band would have to push: then the
    motion would not be this one."""
    found = [share_forces_at(loop, motion, k, programme) for k in range(len(motion.time))]
    shift = loop.elasticity * differences(loop, motion)[:, None] * np.array([1.0, -1.0])
    muscles = np.array([f.muscles for f in found])
    bands = np.array([f.bands for f in found]) + (shift if loop.bands_answer else 0.0)
    if bands.min() < -SLACK:
        raise ConvergenceError(
            f"flexion: a band would have to push with {-bands.min():.3g} N. Take a smaller "
            f"bandwidth than {loop.bandwidth:g} rad/s, or a smaller elasticity"
        )
    share = np.full(len(muscles), loop.lateral_share)
    if programme == "quadratic":
        np.divide(bands[:, 1] - shift[:, 1], muscles[:, 0], out=share, where=muscles[:, 0] > 0)
    return Forces(muscles, bands, share)


def share_forces_at(
    loop: ControlLoop, motion: CoordinatedMotion, k: int, programme: Programme
) -> Sharing:
    """What a programme makes of U at the sample k.  Raises ConvergenceError where nothing does."""
    network, angle = two_band(loop.elasticity, table=loop.table), motion.angle[k]
    torque = required_torque(loop, float(motion.time[k]), angle, motion.rate[k])
    if programme == "quadratic":
        return quadratic(network, angle, torque, EQUAL)
    share = np.zeros((2, len(MUSCLES)))
    share[:, 0] = 1.0 - loop.lateral_share, loop.lateral_share
    known = 0.0 if loop.bands_answer else loop.elasticity * float(differences(loop, motion)[k])
    return linear(network, angle, torque, share, known * np.array([1.0, -1.0]), EQUAL)


def required_torque(loop: ControlLoop, time: float, angle: Array, rate: Array) -> Array:
    """The torque U, (3,) N m, that the controller asks for."""
    q, v, a = reference(np.array(time), loop.course, loop.table)
    w = loop.bandwidth
    return torques(loop.chain, angle, rate, a + 2 * w * (v - rate) + w**2 * (q - angle))


def band_torque(loop: ControlLoop, angle: Array) -> Array:
    """The bands' torque (3,) N m, -d(K e^2 / 2)/dq, beyond what the programme foresaw."""
    pip, dip = loop.table["ED", "PIP"], loop.table["ED", "DIP"]
    tension = loop.elasticity * float(shift_difference(angle[1], angle[2], loop.table))
    answer = np.array([0.0, -2 * pip.slope * angle[1], dip.radius])
    return tension * answer if loop.bands_answer else np.zeros(3)


def differences(loop: ControlLoop, motion: CoordinatedMotion) -> Array:
    """The differences of the bands' shifts along a motion, (n,) m: e (15)."""
    return shift_difference(motion.angle[:, 1], motion.angle[:, 2], loop.table)


def curve_deviation(loop: ControlLoop, motion: CoordinatedMotion) -> Array:
    """The deviation (n,) rad of the DIP angle from the parabola (6) at its PIP angle."""
    return motion.angle[:, 2] - coupled_dip(motion.angle[:, 1], loop.table)


def line_deviation(motion: CoordinatedMotion) -> Array:
    """The deviation (n,) rad of the DIP angle from the line that the reference follows, at its PIP
    angle."""
    end = motion.reference[-1]
    return motion.angle[:, 2] - motion.angle[:, 1] * end[2] / end[1]


def crossing(time: Array, difference: Array) -> float:
    """The time, s, when a difference (n,) first comes to zero from above, by straight lines between
    samples; NaN where it never does."""
    at = np.flatnonzero((difference[:-1] > 0) & (difference[1:] <= 0))
    if not len(at):
        return float("nan")
    k = int(at[0])
    part = difference[k] / (difference[k] - difference[k + 1])
    return float(time[k] + part * (time[k + 1] - time[k]))


class Deviation(NamedTuple):
    """How far a motion's DIP goes from the parabola and from the line, at most, deg."""

    curve: float
    line: float


def deviation(loop: ControlLoop, motion: CoordinatedMotion) -> Deviation:
    """Return the largest deviations of a motion's DIP angle (deg)."""
    beside = curve_deviation(loop, motion), line_deviation(motion)
    return Deviation(*(float(np.degrees(np.abs(b).max())) for b in beside))
