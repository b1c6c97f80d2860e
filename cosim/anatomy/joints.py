"""Joint centres and axes of a user's bones: from their heads, and as the packaged bones carry them.

A head is fitted twice, on the packaged bone and, by the same points, on the user's: a sphere at the
MCP, cylinders at the PIP and DIP.  What the user's fit differs by from the carried packaged one
corrects the packaged joint; so a bone like ours keeps our axes, though no cylinder's axis is one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.anatomy.register import Fit
from cosim.errors import InputError
from cosim.port import Array, Triangles
from meshes.skeleton import BODIES, JOINTS, Skeleton

HEADS = {"metacarpal": "MCP", "proximal": "PIP", "middle": "DIP"}
"""Joint at the distal end of each bone."""
REACH = 1.6
"""Times a head's radius, within which points about the joint's centre are fitted."""
FACING = 60.0
"""deg, of a point's normal to the sagittal plane: what is steeper is no part of a cylinder."""
MOST_ANGLE, MOST_SHIFT = 10.0, 1.0
"""deg and mm between an axis that a head shows and the carried one: beyond, landmarks decide."""
MOST_TURNED = 45.0
"""deg between a landmark's axis and the carried one: beyond, it is another."""


@dataclass(frozen=True)
class Head:
    """What the head of a bone shows of a joint."""

    joint: str
    radius: float
    """m, of the sphere or cylinder."""
    rms: float
    """m, of the points about it."""
    angle: float
    """deg, between the axis that it shows and the carried one; 0 of a sphere."""
    shift: float
    """m, of the centre across the axis."""
    centre: Array
    """(3,) m, of the joint in the user's file."""
    turn: Array
    """(3, 3) from the carried axis to the one that the head shows, in the file's axes."""

    @property
    def odd_angle(self) -> bool:
        """Whether head and carried axis contradict each other."""
        return self.angle > MOST_ANGLE

    @property
    def odd_shift(self) -> bool:
        """Whether head and carried centre contradict each other."""
        return 1e3 * self.shift > MOST_SHIFT

    def __str__(self) -> str:
        shape = "sphere" if self.joint == "MCP" else "cylinder"
        turned = "" if self.joint == "MCP" else f"{self.angle:.1f} deg and "
        return (
            f"{self.joint}: {shape} of {1e3 * self.radius:.2f} mm (rms {1e3 * self.rms:.2f}) at "
            f"the head, {turned}{1e3 * self.shift:.2f} mm off the carried joint"
        )


def fit_head(body: str, bone: Triangles, fit: Fit, skeleton: Skeleton) -> Head:
    """The joint at the distal end of a user's bone, on which the packaged `bone` is laid by
    `fit`; `skeleton`: the packaged bone's."""
    joint, i = HEADS[body], BODIES.index(body)
    centre = np.array([skeleton.length[i] if i else 0.0, 0.0, 0.0])
    axis = parent_axis(skeleton, joint)
    ours = _face(bone, centre, axis, is_sphere=joint == "MCP")
    theirs = fit.carry(ours)
    # what the affine map explains is taken out: an ellipsoid has no sphere's centre
    alike = (theirs - fit.offset) @ np.linalg.inv(fit.matrix).T
    turn, angle, carried = np.eye(3), 0.0, fit.carry(centre)[0]
    if joint == "MCP":
        _, radius, rms = fit_sphere(theirs)
        shift = fit_sphere(alike)[0] - fit_sphere(ours)[0]
    else:
        _, _, radius, rms = fit_cylinder(theirs, fit.carry_axis(axis), carried)
        (a, c, _, _), (b, d, _, _) = (
            fit_cylinder(points, axis, centre) for points in (ours, alike)
        )
        turn, angle = _between(fit.carry_axis(a), fit.carry_axis(b))
        shift = d - c - ((d - c) @ a) * a  # along its axis nothing tells a cylinder's centre
    at = fit.matrix @ (centre + shift) + fit.offset
    across = at - carried
    if joint != "MCP":
        along = fit.carry_axis(axis)
        at = at - (across @ along) * along
        across = at - carried
    return Head(joint, radius, rms, angle, float(np.linalg.norm(across)), at, turn)


def parent_axis(skeleton: Skeleton, joint: str) -> Array:
    """A joint's axis (3,) in the frame of the bone before it, at zero angles."""
    child = {"MCP": 0, "MCP_abduction": 0, "PIP": 1, "DIP": 2}[joint]
    return np.asarray(skeleton.zero[child] @ skeleton.axis[JOINTS.index(joint)])


def _face(bone: Triangles, centre: Array, axis: Array, is_sphere: bool) -> Array:
    """The points (n, 3) of the packaged bone's joint face, about its centre."""
    from cosim.anatomy.register import cloud_of

    cloud = cloud_of(bone, 4000)
    arm = cloud.points - centre
    across = arm if is_sphere else arm - (arm @ axis)[:, None] * axis
    radial = across / np.linalg.norm(across, axis=1, keepdims=True)
    ahead = arm[:, 0] > -1e-3
    outward = np.einsum("nk,nk->n", radial, cloud.normals) > 0.7
    flat = np.abs(cloud.normals @ axis) < np.sin(np.deg2rad(FACING))
    size = np.median(np.linalg.norm(across[ahead & outward], axis=1))
    near = np.linalg.norm(across, axis=1) < REACH * size
    return np.asarray(cloud.points[ahead & outward & near & (flat | is_sphere)])


def fit_sphere(points: Array) -> tuple[Array, float, float]:
    """Centre (3,), radius and rms of the sphere nearest to points (n, 3), m."""
    from scipy.optimize import least_squares

    def gaps(p: Array) -> Array:
        return np.asarray(np.linalg.norm(1e3 * points - p[:3], axis=1) - p[3])

    middle = 1e3 * points.mean(axis=0)
    start = [*middle, np.linalg.norm(1e3 * points - middle, axis=1).mean()]
    found = least_squares(gaps, start, loss="soft_l1", f_scale=0.2).x
    return 1e-3 * found[:3], 1e-3 * abs(found[3]), 1e-3 * float(np.sqrt(np.mean(gaps(found) ** 2)))


def fit_cylinder(points: Array, axis: Array, centre: Array) -> tuple[Array, Array, float, float]:
    """Axis (3,), a point on it, radius and rms of the cylinder nearest to points (n, 3) m, from an
    axis and a centre to begin with."""
    from scipy.optimize import least_squares

    across = np.linalg.svd(axis[None])[2][1:]
    local = 1e3 * (points - centre)

    def place(p: Array) -> tuple[Array, Array]:
        way = axis + p[0] * across[0] + p[1] * across[1]
        return way / np.linalg.norm(way), p[2] * across[0] + p[3] * across[1]

    def gaps(p: Array) -> Array:
        way, middle = place(p)
        return np.asarray(np.linalg.norm(np.cross(local - middle, way), axis=1) - p[4])

    start = [0.0, 0.0, 0.0, 0.0, float(np.median(np.linalg.norm(np.cross(local, axis), axis=1)))]
    found = least_squares(gaps, start, loss="soft_l1", f_scale=0.2).x
    way, middle = place(found)
    rms = 1e-3 * float(np.sqrt(np.mean(gaps(found) ** 2)))
    return way, centre + 1e-3 * middle, 1e-3 * abs(float(found[4])), rms


def _between(a: Array, b: Array) -> tuple[Array, float]:
    """The least rotation (3, 3) that takes one unit vector to another, and its angle, deg."""
    from scipy.spatial.transform import Rotation

    normal = np.cross(a, b)
    sine = float(np.linalg.norm(normal))
    angle = float(np.arctan2(sine, a @ b))
    turn = Rotation.from_rotvec(normal * (angle / sine if sine > 1e-12 else 1.0))
    return turn.as_matrix(), float(np.degrees(angle))


@dataclass(frozen=True)
class Joints:
    """A user's finger: its skeleton, and each body's frame in its file."""

    skeleton: Skeleton
    origin: Mapping[str, Array]
    """(3,) m, by body."""
    axes: Mapping[str, Array]
    """(3, 3), columns distal, radial, dorsal, by body."""

    def local(self, body: str, points: Array) -> Array:
        """Points (n, 3) m of a bone's file in its body's frame."""
        return np.asarray((points - self.origin[body]) @ self.axes[body])


def joints_of(
    ours: Skeleton,
    fits: Mapping[str, Fit],
    heads: Mapping[str, Head],
    stated: Mapping[tuple[str, str], Array],
) -> Joints:
    """The joints of bones that lie anywhere.  `heads`: by bone, of those whose own head counts;
    `stated`: what landmarks say, by bone and name (`distal_joint`, `proximal_joint`, `tip`: (3,) m;
    `flexion`, `abduction`: (3,) unit), in the bone's file.

    The PIP's axis is its head's; the DIP's keeps to the PIP's what ours keeps (its condyles are too
    short to tell), the MCP's go with the proximal phalanx, unless a landmark says otherwise.

    Raises InputError for a landmark's axis that is another than its joint's."""
    origin, axes, length = {}, {}, np.zeros(4)
    for i, body in enumerate(BODIES):
        fit = fits[body]
        start = stated.get((body, "proximal_joint"), fit.carry_near(np.zeros(3))[0])
        last = np.array([ours.length[i], 0.0, 0.0])
        reach = fit.carry_near(last)[0] if body == "distal" else fit.carry(last)[0]
        end = stated.get((body, "distal_joint"), heads[body].centre if body in heads else reach)
        end = stated.get((body, "tip"), end)
        if i == 0:
            origin[body], axes[body] = end, fit.rotation
            continue
        length[i] = np.linalg.norm(end - start)
        x = (end - start) / length[i]
        y = fit.rotation[:, 1] - (fit.rotation[:, 1] @ x) * x
        y /= np.linalg.norm(y)
        origin[body], axes[body] = start, np.column_stack([x, y, np.cross(x, y)])
    zero, axis = ours.zero.copy(), ours.axis.copy()
    # the MCP's axes go with the proximal phalanx, whose frame has its flexion axis as ours has
    turned = axes["proximal"].T @ fits["proximal"].rotation
    axis[0], axis[1] = turned @ axis[0], turned @ axis[1]
    flexion, abduction = zero[0] @ axis[0], zero[0] @ axis[1]  # in the metacarpal
    if (to := _stated(stated, "metacarpal", "flexion", flexion, axes)) is not None:
        abduction = _between(flexion, to)[0] @ abduction
        zero[0], flexion = _straight(to, zero[0]), to
    if (to := _stated(stated, "metacarpal", "abduction", abduction, axes)) is not None:
        abduction = to
    axis[0], axis[1] = zero[0].T @ flexion, zero[0].T @ abduction
    follow = np.eye(3)
    for body, joint, k in (("proximal", "PIP", 1), ("middle", "DIP", 2)):
        carried = axes[body].T @ fits[body].carry_axis(parent_axis(ours, joint))
        new = follow @ carried
        if joint == "PIP" and body in heads:
            new = axes[body].T @ heads[body].turn @ axes[body] @ carried
        if (to := _stated(stated, body, "flexion", carried, axes)) is not None:
            new = to
        zero[k] = _straight(new, zero[k])
        axis[JOINTS.index(joint)] = zero[k].T @ new
        follow = zero[k].T @ _between(carried, new)[0] @ zero[k]
    return Joints(replace(ours, length=length, zero=zero, axis=axis, source={}), origin, axes)


def _stated(
    stated: Mapping[tuple[str, str], Array],
    body: str,
    name: str,
    carried: Array,
    axes: Mapping[str, Array],
) -> Array | None:
    """The axis (3,) that landmarks state at a bone's head, in its frame, the way of the `carried`
    one.  Raises InputError for one that is nearer to another axis."""
    if (body, name) not in stated:
        return None
    way = axes[body].T @ stated[body, name]
    way *= np.sign(way @ carried) or 1.0
    angle = _between(way, carried)[1]
    if angle > MOST_TURNED:
        raise InputError(
            f"--landmarks: the {name} axis of the {HEADS[body]} is {angle:.0f} deg off the one "
            f"carried over, at most {MOST_TURNED:g}; do the {body}'s two points lie on this axis?"
        )
    return np.asarray(way)


def _straight(axis: Array, zero: Array) -> Array:
    """The child's rotation (3, 3) in its parent, turned about `axis` (in the parent) until both
    bones' x lie in one line as seen along it."""
    from scipy.spatial.transform import Rotation

    a, b = (v - (v @ axis) * axis for v in (np.array([1.0, 0, 0]), zero[:, 0]))
    angle = np.arctan2(np.cross(b, a) @ axis, a @ b)
    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix() @ zero)
