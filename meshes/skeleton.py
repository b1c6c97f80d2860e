"""Joint centres, axes and body frames of the fingers.

Source of the numbers: the joint frames of MyoHand (github MyoHub/myo_sim at 2cef885, Apache-2.0),
which trace back to published OpenSim upper-limb and hand models.  They are facts transcribed from
it; the frames below are ours.

A body frame has its origin at the bone's proximal joint centre (the metacarpal: at its distal one,
the MCP centre), x along the bone to the next joint centre, y radial (the MCP flexion axis made
normal to x; of the middle finger's phalanges the axes of PIP and DIP), z dorsal; right-handed for a
right hand.  Flexion turns about an axis near +y, radial abduction about one near +z.  At zero
angles the bones' x axes lie in one line as seen along each joint's axis.  The world frame is the
metacarpal's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.port import Array

BODIES = ("metacarpal", "proximal", "middle", "distal")
JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")

Direction = tuple[float, float, float]


@dataclass(frozen=True)
class JointFrames:
    """A finger in MyoHand's frames, m: x radial, -y distal, z dorsal."""

    mcp: Direction
    """Each joint's centre in the frame of the bone before it."""
    pip: Direction
    dip: Direction
    tip: float
    """From the DIP's centre to MyoHand's tip site."""
    long_axis: Direction
    """The distal phalanx's: the first principal axis of its surface's vertices (measured on the
    STL)."""
    axes: tuple[Direction, Direction, Direction, Direction]
    """The joints' axes, in the order of JOINTS, in the frame of the bone after each."""
    sideways: tuple[int, int, int] = (0, 0, 0)
    """By phalanx the joint of JOINTS along whose axis its y lies."""


MYOHAND: Mapping[str, JointFrames] = {
    "index": JointFrames(
        (0.003501, -0.028243, 0.00362),
        (0.00751, -0.041273, 0.007326),
        (0.003333, -0.024888, 0.00122),
        0.01811,
        (0.14186086, -0.98663876, 0.08012154),
        (
            (0.995013, 0.09975, 0.0),
            (-0.054999, 0.085899, 0.994785),
            (0.97517, 0.0998334, -0.197677),
            (0.995004, 0.0998334, 0.0),
        ),
    ),
    # The model that takes these bones has parallel flexion axes (`rigid.fingers.middle`); here the
    # MCP's is turned by 11 deg about the finger.  A cylinder through the head of the proximal
    # phalanx lies along the PIP's within 1 deg, so that the phalanges are laid by PIP and DIP.
    "middle": JointFrames(
        (0.00024, -0.02629, 0.001778),
        (0.00165, -0.044211, 0.00623),
        (0.001365, -0.029047, 0.001954),
        0.01913,
        (0.05316038, -0.99708301, 0.05476722),
        (
            (0.980067, 0.0, 0.198669),
            (-0.198669, 0.0, 0.980067),
            (1.0, 0.0, 0.0),
            (1.0, 0.0, 0.0),
        ),
        sideways=(2, 3, 3),
    ),
    "ring": JointFrames(
        (-0.00183, -0.023689, -0.000173),
        (-0.003528, -0.040255, 0.001345),
        (-0.002317, -0.024789, 0.000563),
        0.01806,
        (-0.10856145, -0.98662271, 0.12161431),
        (
            (0.900447, 0.0, 0.434966),
            (-0.434966, 0.0, 0.900447),
            (0.921061, 0.0, 0.389418),
            (0.825336, 0.0, 0.564642),
        ),
    ),
    "little": JointFrames(
        (-0.001597, -0.021431, -0.001496),
        (-0.005279, -0.035563, -0.002879),
        (-0.002871, -0.020677, -0.002243),
        0.01729,
        (-0.17094549, -0.98165631, -0.08443061),
        (
            (0.825336, 0.0, 0.564642),
            (-0.564642, 0.0, 0.825336),
            (0.825336, 0.0, 0.564642),
            (0.643112, -0.226804, 0.731414),
        ),
    ),
}


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
    return myohand_finger("index")


def myohand_finger(name: str) -> Skeleton:
    """Return a finger of `MYOHAND` in our frames.

    >>> from meshes.skeleton import myohand_finger
    >>> (1e3 * myohand_finger("little").length).round(1)  # mm, joint to joint and to the tip
    array([ 0. , 36.1, 21. , 17.3])
    """
    of = MYOHAND[name]
    mcp, pip, dip, long_axis = map(np.array, (of.mcp, of.pip, of.dip, of.long_axis))
    flexion, abduction, at_pip, at_dip = map(np.array, of.axes)
    ways = zip((pip, dip, long_axis), of.sideways, strict=True)
    proximal, middle, distal = (_frame(x, np.array(of.axes[joint])) for x, joint in ways)
    metacarpal, turn_mcp = proximal, np.eye(3)
    if of.sideways[0] != 0:
        metacarpal = _frame(pip, flexion)
        turn_mcp = metacarpal.T @ proximal
    turn_pip = _straightening(at_pip, pip, dip)
    turn_dip = _straightening(at_dip, dip, long_axis)
    zero = np.stack([turn_mcp, proximal.T @ turn_pip @ middle, middle.T @ turn_dip @ distal])
    axis = np.stack(
        [
            proximal.T @ _unit(flexion),
            proximal.T @ _unit(abduction),
            middle.T @ _unit(at_pip),
            distal.T @ _unit(at_dip),
        ]
    )
    norms = [float(np.linalg.norm(c)) for c in (pip, dip)]
    origin = np.zeros(3)
    source = {
        "metacarpal": (metacarpal, mcp),
        "proximal": (proximal, origin),
        "middle": (middle, origin),
        "distal": (distal, origin),
    }
    return Skeleton(np.array([0.0, *norms, of.tip]), zero, axis, source)
