"""Flexion of the interphalangeal joints on the coupling curve, and the torques that it takes.

Buchner, Hines and Hemami 1988: from straight to PIP 110 and DIP 73 deg in 1 s, MCP at rest, the
finger horizontal and palm down.  The paper's course over time and its controller are not stated;
here the PIP follows a polynomial of fifth order that starts and ends at rest without acceleration.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cosim.port import Array
from rigid.chain.planar_chain import PlanarChain
from rigid.hoods.two_band import coupled_dip

Course = Callable[[Array], tuple[Array, Array, Array]]
DURATION = 1.0
FULL = float(np.radians(110.0))


def quintic(time: Array) -> tuple[Array, Array, Array]:
    """PIP angle (rad), rate and acceleration at times (...) s."""
    s = np.clip(time / DURATION, 0.0, 1.0)
    return (
        FULL * s**3 * (10 - 15 * s + 6 * s**2),
        FULL / DURATION * 30 * s**2 * (1 - s) ** 2,
        FULL / DURATION**2 * 60 * s * (1 - s) * (1 - 2 * s),
    )


def cosine(time: Array) -> tuple[Array, Array, Array]:
    """The same with half a cosine, whose acceleration begins and ends with a jump."""
    s, rate = np.pi * np.clip(time / DURATION, 0.0, 1.0), np.pi / DURATION
    half = FULL / 2
    return half * (1 - np.cos(s)), half * rate * np.sin(s), half * rate**2 * np.cos(s)


def curve_motion(time: Array, course: Course = quintic) -> tuple[Array, Array, Array]:
    """Joint angles, rates and accelerations (..., 3) of MCP, PIP, DIP, with the DIP on the
    parabola (6)."""
    q, v, a = course(time)
    bend = float(coupled_dip(np.array(1.0)))
    dip = bend * q**2, 2 * bend * q * v, 2 * bend * (v**2 + q * a)
    still = np.zeros_like(q)
    angle, rate, acceleration = (
        np.stack([still, x, y], axis=-1) for x, y in zip((q, v, a), dip, strict=True)
    )
    return angle, rate, acceleration


def torques(chain: PlanarChain, angle: Array, rate: Array, acceleration: Array) -> Array:
    """The joint torques (n,) N m of a motion of the chain (n,) rad, rad/s, rad/s2: equation 7 the
    other way round."""
    theta, speed = np.pi / 2 + np.cumsum(angle), np.cumsum(rate)
    apart = theta[:, None] - theta
    inertia, centrifugal = chain.coupling * np.cos(apart), chain.coupling * np.sin(apart)
    weight = -chain.gravity * np.sin(theta) * chain.first_moment
    on_links = inertia @ np.cumsum(acceleration) + centrifugal @ speed**2 + weight
    return np.cumsum(on_links[::-1])[::-1]
