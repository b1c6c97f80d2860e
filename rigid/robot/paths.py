"""Tendon lengths by closed forms, apart from MuJoCo: the check of its paths and moment arms.

Across one cylinder, seen along its axis, with the ends at distances p and d from it and the angle D
between them on the tendon's side,

    phi = D - acos(r / p) - acos(r / d),    l = sqrt(p^2 - r^2) + r phi + sqrt(d^2 - r^2)

where phi > 0, else the straight distance; rolled out, the way is a straight line, so that with h
along the axis L = sqrt(l^2 + h^2).  The moment arm of a planar tendon that touches is r itself.
Across a sphere the same l, in the plane of both ends and the centre, with D the angle between them
there, at most pi; the arm's magnitude is r about any axis normal to that plane.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cosim.port import Array
from rigid.model import Cylinder, FingerModel, Sphere, Strand, Via

Pose = tuple[Array, Array]
"""Rotation (3, 3) and origin (3,) m of a body in the world."""


def tendon_lengths(finger: FingerModel, angles: Array) -> Array:
    """(nt,) m at the joint angles (nq,) rad, strands counted by their shares."""
    pose = poses(finger, angles)
    return np.array(
        [sum(s.share * _strand_length(s, pose) for s in t.strands) for t in finger.tendons]
    )


def lengthening(finger: FingerModel, angles: Array, step: float = 1e-5) -> Array:
    """(nt, nq) m/rad, dL/dq by central differences of the closed forms."""
    return np.column_stack(
        [
            (tendon_lengths(finger, angles + e) - tendon_lengths(finger, angles - e)) / (2 * step)
            for e in step * np.eye(len(angles))
        ]
    )


def poses(finger: FingerModel, angles: Array) -> dict[str, Pose]:
    """Of every body, in the first one's frame."""
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
    last = _placed(pose[first.body], first.point)
    for element in strand.path[1:]:
        if not isinstance(element, Via):
            around = element
            continue
        point = _placed(pose[element.body], element.point)
        if around is None:
            total += float(np.linalg.norm(point - last))
        else:
            total += wrapped_length(last, point, around, pose[around.body])
        last, around = point, None
    return total


def _placed(pose: Pose, point: tuple[float, float, float]) -> Array:
    turn, origin = pose
    out: Array = origin + turn @ np.array(point)
    return out


def wrapped_length(start: Array, end: Array, surface: Cylinder | Sphere, pose: Pose) -> float:
    """m, of the shortest way from `start` to `end` (3,) past a cylinder on its side or a sphere."""
    turn, origin = pose
    p, d = ((x - origin) @ turn - np.array(surface.centre) for x in (start, end))
    if isinstance(surface, Sphere):
        past = float(np.arctan2(np.linalg.norm(np.cross(p, d)), p @ d))
        length = _flat_length(past, p, d, surface.radius)
        return float(np.linalg.norm(d - p)) if length is None else length
    side = np.array(surface.side) - np.array(surface.centre)
    axis = np.array(surface.axis) / np.linalg.norm(surface.axis)
    across = np.linalg.svd(axis[None])[2][1:]
    covered = _angle_past(across @ p, across @ d, across @ side)
    flat = _flat_length(covered, across @ p, across @ d, surface.radius)
    return float(np.linalg.norm(d - p) if flat is None else np.hypot(flat, axis @ (d - p)))


def _flat_length(between: float, p: Array, d: Array, radius: float) -> float | None:
    """m, tangents and arc about a circle from p to d, `between` rad apart as seen from its centre;
    None where the straight way clears it."""
    far = [float(np.linalg.norm(x)) for x in (p, d)]
    phi = between - sum(np.arccos(min(1.0, radius / x)) for x in far)
    if phi <= 0:
        return None
    return float(radius * phi + sum(np.sqrt(x**2 - radius**2) for x in far))


def _angle_past(p: Array, d: Array, side: Array) -> float:
    """rad in [0, 2 pi), from p to d (2,), turning from p towards the side."""
    at, to, past = (np.arctan2(x[1], x[0]) for x in (p, d, side))
    sense = np.sign(np.sin(past - at))
    return float(sense * (to - at) % (2 * np.pi))
