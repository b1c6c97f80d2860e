"""Frictionless contact of shell nodes with rigid bodies through smooth signed distances.

A node presses on every body that it penetrates (no owner is chosen, so no force jumps from bone to
bone).  The gap is g = distance(x) - offset, and the pressure times the node's area is k a m(-g)
with the smoothed ramp m, quadratic over |g| < smoothing, so that the energy has a continuous
Hessian.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .springs import PointForces
from .surfaces import Surface

Array = NDArray[np.float64]

REACH = 1.5e-3
"""m of gap within which a node is watched for contact."""


@dataclass(frozen=True)
class Contact:
    """Contact of nodes with one body's surface.

    body index; nodes (k,); offset (k,) m of the mid-surface from the bone's surface at which
    contact begins (cartilage, capsule and half the shell); area (k,) m2; stiffness N/m3; smoothing
    m."""

    body: int
    surface: Surface
    nodes: NDArray[np.intp]
    offset: Array
    area: Array
    stiffness: float
    smoothing: float

    def gap(self, x: Array, position: Array, rotation: Array) -> Array:
        """(k,) m, negative where a node penetrates."""
        local = (x[self.nodes] - position[self.body]) @ rotation[self.body]
        return self.surface.distance(local)[0] - self.offset


def ramp(depth: Array, smoothing: float) -> tuple[Array, Array, Array]:
    """Integral, value and slope of the smoothed ramp max(depth, 0)."""
    blend = (depth + smoothing) / 2
    inside = np.abs(depth) < smoothing
    value = np.where(inside, blend**2 / smoothing, np.maximum(depth, 0.0))
    slope = np.where(inside, blend / smoothing, (depth > 0).astype(float))
    deep = depth**2 / 2 + smoothing**2 / 6
    integral = np.where(inside, 2 * blend**3 / (3 * smoothing), np.where(depth > 0, deep, 0.0))
    return integral, value, slope


def contact_forces(
    contact: Contact, x: Array, position: Array, rotation: Array, curvature: bool
) -> PointForces:
    """Contact energy at node positions x (n, 3); `curvature` keeps the (negative) term of the
    Hessian that the surface's curvature makes."""
    p, R = position[contact.body], rotation[contact.body]
    value, gradient, bend = contact.surface.distance((x[contact.nodes] - p) @ R)
    near = value - contact.offset < REACH
    node, arm = contact.nodes[near], x[contact.nodes[near]] - p
    scale = contact.stiffness * contact.area[near]
    energy, force, slope = ramp(contact.offset[near] - value[near], contact.smoothing)
    normal = gradient[near] @ R.T
    hessian = (scale * slope)[:, None, None] * normal[:, :, None] * normal[:, None, :]
    if curvature:
        hessian -= (scale * force)[:, None, None] * (R @ bend[near] @ R.T)
    return PointForces(
        node,
        np.full(len(node), contact.body, dtype=np.intp),
        float(scale @ energy),
        -(scale * force)[:, None] * normal,
        hessian,
        arm,
        np.ones(len(node), dtype=bool),
        np.full(len(node), -1, dtype=np.intp),
        contact.offset[near] - value[near],
        -normal,
        scale,
        np.full(len(node), contact.smoothing),
    )


def joined(parts: list[PointForces]) -> PointForces:
    """All point forces as one."""
    names = [f.name for f in fields(PointForces) if f.name != "energy"]
    columns = {n: np.concatenate([getattr(p, n) for p in parts]) for n in names}
    return PointForces(energy=sum(p.energy for p in parts), **columns)
