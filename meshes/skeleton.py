"""Joint centres, axes and body frames of the index finger.

Source of the numbers: the joint frames of MyoHand (github MyoHub/myo_sim at 2cef885, Apache-2.0),
which trace back to published OpenSim upper-limb and hand models.  They are facts transcribed from
it; the frames below are ours.

A body frame has its origin at the bone's proximal joint centre (the metacarpal: at its distal one,
the MCP centre), x along the bone to the next joint centre, y radial (the MCP flexion axis made
normal to x), z dorsal; right-handed for a right hand.  Flexion turns about an axis near +y, radial
abduction about one near +z.  At zero angles the bones' x axes lie
in one line as seen along each joint's axis.  The world frame is the metacarpal's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array

BODIES = ("metacarpal", "proximal", "middle", "distal")
JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")

# MyoHand frames, m: x radial, -y distal, z dorsal.
MCP_CENTRE = np.array([0.003501, -0.028243, 0.00362])
PIP_CENTRE = np.array([0.00751, -0.041273, 0.007326])
DIP_CENTRE = np.array([0.003333, -0.024888, 0.00122])
# Direction of the distal phalanx: first principal axis of its surface (measured on 2distph.stl).
DISTAL_AXIS = np.array([0.14186086, -0.98663876, 0.08012154])
TIP_LENGTH = 0.01811  # m, DIP centre to MyoHand's tip site
MCP_FLEXION = np.array([0.995013, 0.09975, 0.0])
MCP_ABDUCTION = np.array([-0.054999, 0.085899, 0.994785])
PIP_FLEXION = np.array([0.97517, 0.0998334, -0.197677])
DIP_FLEXION = np.array([0.995004, 0.0998334, 0.0])


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def _frame(x: Array, y: Array) -> Array:
    """Columns x, y made normal to x, and z = x x y."""
    x = _unit(x)
    y = _unit(y - (y @ x) * x)
    return np.column_stack([x, y, np.cross(x, y)])


def _straightening(axis: Array, parent: Array, child: Array) -> Array:
    """The turn about `axis` that brings `child` into line with `parent` as seen along the axis."""
    from scipy.spatial.transform import Rotation

    axis = _unit(axis)
    a, b = (v - (v @ axis) * axis for v in (parent, child))
    angle = np.arctan2(np.cross(b, a) @ axis, a @ b)
    return Rotation.from_rotvec(angle * axis).as_matrix()


@dataclass(frozen=True)
class Skeleton:
    """Kinematic constants in our body frames; lengths in m."""

    length: Array
    """(4,) metacarpal (0: its length plays no part), proximal, middle, distal (to the tip)."""
    zero: Array
    """(3, 3, 3) rotation of proximal, middle, distal in their parents at zero angles."""
    axis: Array
    """(4, 3) unit joint axes in the child's frame, in the order of JOINTS."""
    source: Mapping[str, tuple[Array, Array]]
    """MyoHand's frame of each bone: rotation (3, 3) whose columns are our axes, our origin (m)."""
    order: tuple[str, ...] = JOINTS
    """The joints from the metacarpal on: which axis of the MCP the other one is carried by."""

    def scale(self, factor: float) -> Skeleton:
        """Return the finger with all lengths times `factor`."""
        return replace(self, length=self.length * factor)

    def from_source(self, body: str, points: Array) -> Array:
        """Points (n, 3) in m of MyoHand's frame of `body` in ours (unscaled)."""
        rotation, origin = self.source[body]
        return (points - origin) @ rotation

    def pose(self, angles: Mapping[str, float]) -> tuple[Array, Array]:
        """Origins (4, 3) and rotations (4, 3, 3) of BODIES in the world for joint angles in rad."""
        from scipy.spatial.transform import Rotation

        q = np.array([angles.get(j, 0.0) for j in JOINTS])
        turn = Rotation.from_rotvec(q[:, None] * self.axis).as_matrix()
        first, second = (turn[JOINTS.index(joint)] for joint in self.order[:2])
        turns = (first @ second, turn[2], turn[3])
        position, rotation = [np.zeros(3)], [np.eye(3)]
        for i in range(3):
            reach = np.array([self.length[i] if i else 0.0, 0.0, 0.0])
            position.append(position[-1] + rotation[-1] @ reach)
            rotation.append(rotation[-1] @ self.zero[i] @ turns[i])
        return np.array(position), np.array(rotation)

    def tip(self, angles: Mapping[str, float]) -> Array:
        """The fingertip's point (3,) in the world, m."""
        position, rotation = self.pose(angles)
        return position[3] + rotation[3] @ [self.length[3], 0.0, 0.0]


def index_finger() -> Skeleton:
    """Return the index finger of MyoHand in our frames.

    >>> from meshes.skeleton import index_finger
    >>> finger = index_finger()
    >>> finger.tip({"PIP": 0.5}).round(4)  # m, in the metacarpal's frame
    array([ 0.0806, -0.0045, -0.0202])
    """
    proximal = _frame(PIP_CENTRE, MCP_FLEXION)
    middle = _frame(DIP_CENTRE, MCP_FLEXION)
    distal = _frame(DISTAL_AXIS, MCP_FLEXION)
    pip = _straightening(PIP_FLEXION, PIP_CENTRE, DIP_CENTRE)
    dip = _straightening(DIP_FLEXION, DIP_CENTRE, DISTAL_AXIS)
    zero = np.stack([np.eye(3), proximal.T @ pip @ middle, middle.T @ dip @ distal])
    axis = np.stack(
        [
            proximal.T @ _unit(MCP_FLEXION),
            proximal.T @ _unit(MCP_ABDUCTION),
            middle.T @ _unit(PIP_FLEXION),
            distal.T @ _unit(DIP_FLEXION),
        ]
    )
    norms = [float(np.linalg.norm(c)) for c in (PIP_CENTRE, DIP_CENTRE)]
    origin = np.zeros(3)
    source = {
        "metacarpal": (proximal, MCP_CENTRE),
        "proximal": (proximal, origin),
        "middle": (middle, origin),
        "distal": (distal, origin),
    }
    return Skeleton(np.array([0.0, *norms, TIP_LENGTH]), zero, axis, source)
