"""The index finger: bones, joints, masses and the flexor and FDI tendon paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cosim.port import Array
from meshes.skeleton import BODIES, JOINTS, Skeleton
from rigid.model import FingerModel, Hinge, Segment, Strand, Surface, Tendon, Via, vector

MUSCLES = ("FDP", "FDS", "FDI")
O2O3 = 0.020
"""m, the unit of length of the tendon paths: the middle phalanx between its two joint frames."""

# Normative tendon paths of the index finger: An, Chao, Cooney and Linscheid 1979, J Biomech
# 12:775-788, in the form used by AnyBody's AMMR (index finger after Wu 2008).  Units of O2O3;
# x distal, y dorsal, z radial.  Per joint: the point on the proximal body from the joint centre,
# and the one on the distal body from its frame O, which lies OFFSET distal of the joint centre.
NORMATIVE_PATHS = {
    "FDP": {
        "MCP": ((-0.400, -0.559, 0.004), (0.118, -0.386, 0.031)),
        "PIP": ((-0.400, -0.409, 0.027), (0.212, -0.308, 0.009)),
        "DIP": ((-0.300, -0.245, 0.054), (-0.004, -0.184, 0.026)),
    },
    "FDS": {
        "MCP": ((-0.400, -0.589, -0.114), (0.118, -0.477, -0.074)),
        "PIP": ((-0.400, -0.311, 0.028), (0.212, -0.249, 0.015)),
    },
    "FDI": {"MCP": ((-0.400, -0.262, 0.450), (0.318, -0.033, 0.443))},
}
OFFSET = {"DIP": 0.224, "PIP": 0.288, "MCP": 0.432}
CROSSES = {"MCP": (0, 1), "PIP": (1, 2), "DIP": (2, 3)}
ORIGIN_REACH = 0.040
"""m, assumption: the muscles pull parallel to the metacarpal from this far proximal of their
first point."""

# kg and kg m2 about x, y, z: AMMR index finger after Wu 2008.  Assumptions: the centre of mass is
# at mid-length and the published axes are ours.
SEGMENTS = {
    "proximal": (0.0155, (0.648e-6, 2.86e-6, 2.83e-6)),
    "middle": (0.00679, (2.32e-7, 4.84e-7, 4.51e-7)),
    "distal": (0.00391, (1.04e-7, 1.90e-7, 1.70e-7)),
}
# rad: range of motion in table II of "Design of an Anthropomorphic Robotic Finger System with
# Biomimetic Artificial Joints".
RANGES = {
    "MCP": (np.radians(-30.0), np.radians(90.0)),
    "MCP_abduction": (np.radians(-35.0), np.radians(35.0)),
    "PIP": (0.0, np.radians(110.0)),
    "DIP": (0.0, np.radians(70.0)),
}
VIEW_RADIUS = {"metacarpal": 0.0041, "proximal": 0.0039, "middle": 0.0028, "distal": 0.0020}
VIEW_METACARPAL = -0.040  # m, how much of the metacarpal is drawn


def finger_model(
    skeleton: Skeleton, o2o3: float = O2O3, bones: Mapping[str, Surface] | None = None
) -> FingerModel:
    """The finger over a skeleton with its flexors and FDI.

    o2o3: m, the unit of the tendon paths; bones: surfaces by body, drawn instead of capsules."""
    tendons = tuple(
        Tendon(name, (Strand(_path(joints, skeleton, o2o3)),))
        for name, joints in NORMATIVE_PATHS.items()
    )
    segments = tuple(_segment(skeleton, i) for i in range(len(BODIES)))
    tip = (float(skeleton.length[3]), 0.0, 0.0)
    return FingerModel("index finger", segments, tip, tendons, bones or {})


def _segment(skeleton: Skeleton, i: int) -> Segment:
    name = BODIES[i]
    if i == 0:
        return Segment(name, VIEW_METACARPAL, radius=VIEW_RADIUS[name])
    mass, inertia = SEGMENTS[name]
    hinges = tuple(
        Hinge(joint, vector(axis), RANGES[joint])
        for joint, axis in zip(JOINTS, skeleton.axis, strict=True)
        if CROSSES[joint.removesuffix("_abduction")][1] == i
    )
    length = float(skeleton.length[i])
    before = float(skeleton.length[i - 1]) if i > 1 else 0.0
    turn = skeleton.zero[i - 1]
    return Segment(
        name,
        length,
        (before, 0.0, 0.0),
        (vector(turn[0]), vector(turn[1]), vector(turn[2])),
        hinges,
        mass,
        inertia,
        (length / 2, 0.0, 0.0),
        VIEW_RADIUS[name],
    )


def _path(joints: Mapping[str, tuple], skeleton: Skeleton, o2o3: float) -> tuple[Via, ...]:
    path: list[Via] = []
    for joint, (before, after) in joints.items():
        i, k = CROSSES[joint]
        centre = np.array([skeleton.length[i] if i else 0.0, 0.0, 0.0])
        path.append(Via(BODIES[i], vector(centre + _in_our_axes(before, 0.0, o2o3))))
        path.append(Via(BODIES[k], vector(_in_our_axes(after, OFFSET[joint], o2o3))))
    origin = np.array(path[0].point) - [ORIGIN_REACH, 0.0, 0.0]
    return (Via(path[0].body, vector(origin)), *path)


def _in_our_axes(point: Sequence[float], offset: float, o2o3: float) -> Array:
    x, dorsal, radial = point
    return o2o3 * np.array([x + offset, radial, dorsal])
