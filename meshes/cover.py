"""What lies between the bare bones and a hood: thick over their backs, thin over the heads' joint
faces, where there is cartilage alone.

The thickness is stated over a bone's back.  Towards the head that ends it, it falls to that of the
articular face over the first FACE of turning round the joint's axis from the back, and to that of
the condyles' sides over SIDE of turning round the phalanx.  In a straight finger the joint line
lies where the fall begins, so that nothing of it shows over an extended joint; in a flexed one the
hood lies on the face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array
from meshes.skeleton import BODIES, JOINTS, Skeleton

FACE = np.deg2rad([15.0, 45.0])
"""rad about the joint's axis from the bone's back to its distal end, between which the tissue that
the back has goes over into the cartilage of the face (assumption)."""
SIDE = np.deg2rad([25.0, 55.0])
"""rad about the phalanx's long axis from its back, the same to the condyles' sides: from the edge
of a slip 4.6 mm wide [mi29] to the middle of the lateral bands as they are laid."""
SHAFT = (10e-3, 4e-3)
"""m proximal of the joint's axis, between which the sides of shaft and head go over into each other
(assumption; the heads are 8 to 10 mm long)."""
FLEXION = {"metacarpal": "MCP", "proximal": "PIP", "middle": "DIP"}
"""The joint whose head ends a bone."""


class Head(NamedTuple):
    """What covers a head, m: on its articular face, and at its condyles' sides."""

    face: float
    sides: float


@dataclass(frozen=True)
class Joint:
    """The joint of a head in its bone's frame: its middle (3,) m and the unit axis (3,) of
    flexion."""

    centre: Array
    axis: Array

    @classmethod
    def of(cls, skeleton: Skeleton, body: str) -> Joint:
        """That at the distal end of a body; raises KeyError for one that has none."""
        joint, child = JOINTS.index(FLEXION[body]), BODIES.index(body)
        reach = skeleton.length[child] if child else 0.0
        return cls(np.array([reach, 0.0, 0.0]), skeleton.zero[child] @ skeleton.axis[joint])

    def directions(self) -> tuple[Array, Array]:
        """Return distal and dorsal (3,), normal to the axis and equally long."""
        dorsal = np.cross([1.0, 0.0, 0.0], self.axis)
        return np.cross(self.axis, dorsal), dorsal


def shares(points: Array, joint: Joint) -> tuple[Array, Array]:
    """Return how far (n,), 0 to 1, points (n, 3) m in a bone's frame lie on the joint's face, and
    on the condyles' sides; what is left to 1 lies over the shaft."""
    from_centre = points - joint.centre
    distal, dorsal = joint.directions()
    ahead, above, beside = (from_centre @ axis for axis in (distal, dorsal, joint.axis))
    turned = np.arctan2(ahead, above)
    on_face = _ease(turned, *FACE) * _ease(np.pi - turned, *FACE)
    beside_head = _ease(np.arctan2(np.abs(beside), above), *SIDE) * _ease(-ahead, *SHAFT)
    return on_face, (1.0 - on_face) * beside_head


def blend(on: tuple[Array, Array], shaft: float, face: float, sides: float) -> Array:
    """Return a number of what covers a bone, from its values over shaft, face and sides, by the
    `shares` of face and sides; of these or, since it is linear in them, of their splines.

    >>> import numpy as np
    >>> from meshes.cover import Joint, blend, shares
    >>> joint = Joint(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    >>> over_back_face_side = np.array([[0, 0, 4e-3], [4e-3, 0, 0], [0, 5e-3, 0]])
    >>> blend(shares(over_back_face_side, joint), 2.0, 0.6, 1.2)  # mm thick
    array([2. , 0.6, 1.2])
    """
    on_face, on_sides = on
    out: Array = shaft + (face - shaft) * on_face + (sides - shaft) * on_sides
    return out


def _ease(value: Array, start: float, end: float) -> Array:
    """0 before `start` to 1 from `end` on, with no kink of the first two derivatives."""
    u = np.clip((value - start) / (end - start), 0.0, 1.0)
    out: Array = u**3 * (10 - 15 * u + 6 * u * u)
    return out
