"""Tendon lengths by closed forms, apart from MuJoCo: the check of its paths and moment arms.

Across one cylinder, seen along its axis, with the ends at distances p and d from it and the angle D
between them on the way that the tendon takes,

    phi = D - acos(r / p) - acos(r / d),    l = sqrt(p^2 - r^2) + r phi + sqrt(d^2 - r^2)

where phi > 0, else the straight distance; rolled out, the way is a straight line, so that with h
along the axis L = sqrt(l^2 + h^2).  The moment arm of a planar tendon that touches is r itself.
Across a sphere the same l, in the plane of both ends and the centre; the arm's magnitude is r about
any axis normal to that plane.  D is at most pi, or, where the ray from the centre away from the
side runs between the ends, the angle on the side; MuJoCo goes round there too.

With a side within the surface the tendon runs through a ring: straight where it passes within r,
else by the point of the circle nearest to both ends,

    l = min over a of sqrt(p^2 + r^2 - 2 p r cos(a)) + sqrt(d^2 + r^2 - 2 d r cos(D - a)).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cosim.port import Array
from rigid.model import FingerModel, Strand, Via, WrapCylinder, WrapSphere

Pose = tuple[Array, Array]
"""Rotation (3, 3) and origin (3,) m of a body in the world."""


def tendon_lengths(finger: FingerModel, angles: Array) -> Array:
    """The tendons' lengths (nt,) m at joint angles (nq,) rad, strands counted by their shares."""
    pose = poses(finger, angles)
    return np.array(
        [sum(s.share * _strand_length(s, pose) for s in t.strands) for t in finger.tendons]
    )


def lengthening(finger: FingerModel, angles: Array, step: float = 1e-5) -> Array:
    """The tendons' lengthening (nt, nq) m/rad, dL/dq by central differences of the closed forms."""
    return np.column_stack(
        [
            (tendon_lengths(finger, angles + e) - tendon_lengths(finger, angles - e)) / (2 * step)
            for e in step * np.eye(len(angles))
        ]
    )


def poses(finger: FingerModel, angles: Array) -> dict[str, Pose]:
    """Poses of all bodies, in the first one's frame."""
    turn, origin = np.eye(3), np.zeros(3)
    out: dict[str, Pose] = {}
    angle = iter(angles)
    for segment in finger.segments:
        origin = origin + turn @ np.array(segment.position)
        turn = turn @ np.array(segment.rotation)
        for hinge in segment.hinges:
            axis = np.array(hinge.axis) / np.linalg.norm(hinge.axis)
            turn = turn @ Rotation.from_rotvec(next(angle) * axis).as_matrix()
        out[segment.name] = turn, origin
    return out


def _strand_length(strand: Strand, pose: dict[str, Pose]) -> float:
    total, around = 0.0, None
    first = strand.path[0]
    assert isinstance(first, Via)
    last = _place(pose[first.body], first.point)
    for element in strand.path[1:]:
        if not isinstance(element, Via):
            around = element
            continue
        point = _place(pose[element.body], element.point)
        if around is None:
            total += float(np.linalg.norm(point - last))
        else:
            total += wrap_length(last, point, around, pose[around.body])
        last, around = point, None
    return total


def _place(pose: Pose, point: tuple[float, float, float]) -> Array:
    turn, origin = pose
    out: Array = origin + turn @ np.array(point)
    return out


def wrap_length(start: Array, end: Array, surface: WrapCylinder | WrapSphere, pose: Pose) -> float:
    """The length, m, of the way from `start` to `end` (3,) past a surface of a body in a pose."""
    turn, origin = pose
    centre = np.array(surface.centre)
    p, d = ((x - origin) @ turn - centre for x in (start, end))
    normal = np.cross(p, d) if isinstance(surface, WrapSphere) else np.array(surface.axis)
    across = np.linalg.svd(normal[None])[2]  # the normal of the plane, then its axes
    if not normal.any():  # a line through the centre lies in many planes
        across = np.linalg.svd(d[None])[2][::-1]
    height, p, d = across[0] @ (d - p), across[1:] @ p, across[1:] @ d
    side = None if surface.side is None else np.array(surface.side) - centre
    if side is not None and np.linalg.norm(side) < surface.radius:
        flat = _through_ring(p, d, surface.radius)
    else:
        flat = _around(p, d, surface.radius, None if side is None else across[1:] @ side)
    return float(np.hypot(flat, height))


def _around(p: Array, d: Array, radius: float, side: Array | None) -> float:
    """The length, m, from p to d (2,) around a circle about the origin."""
    far = [float(np.linalg.norm(x)) for x in (p, d)]
    straight, between = float(np.linalg.norm(d - p)), _between(p, d)
    if min(far) < radius:
        return straight
    if side is not None and _is_between(-side, p, d):
        between = 2 * np.pi - between
    phi = between - sum(np.arccos(radius / x) for x in far)
    if phi <= 0:
        return straight
    return float(radius * phi + sum(np.sqrt(x**2 - radius**2) for x in far))


def _through_ring(p: Array, d: Array, radius: float) -> float:
    """The length, m, from p to d (2,) by way of the inside of a circle about the origin."""
    from scipy.optimize import brentq

    far = [float(np.linalg.norm(x)) for x in (p, d)]
    if min(far) <= radius or np.linalg.norm(_nearest(p, d)) <= radius:
        return float(np.linalg.norm(d - p))
    between = _between(p, d)

    def leg(x: float, angle: float) -> float:
        return float(np.sqrt(x**2 + radius**2 - 2 * x * radius * np.cos(angle)))

    def slope(a: float) -> float:
        near, away = (
            x * np.sin(angle) / leg(x, angle)
            for x, angle in zip(far, (a, between - a), strict=True)
        )
        return float(near - away)

    a = brentq(slope, 0.0, between, xtol=1e-15) if between > 0 else 0.0
    return leg(far[0], a) + leg(far[1], between - a)


def _nearest(p: Array, d: Array) -> Array:
    """The point of the segment from p to d (2,) that is nearest to the origin."""
    along = d - p
    share = np.clip(-p @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    return np.asarray(p + share * along)


def _between(p: Array, d: Array) -> float:
    """The angle, rad in [0, pi], between p and d (2,) as seen from the origin."""
    return float(np.arctan2(abs(_cross(p, d)), p @ d))


def _is_between(x: Array, p: Array, d: Array) -> bool:
    """Whether the direction x (2,) lies in the angle between p and d, which is less than pi."""
    sense = _cross(p, d)
    return bool(sense * _cross(p, x) > 0 and sense * _cross(x, d) > 0)


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
