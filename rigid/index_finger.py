"""The index finger as MJCF text: bones, joints, masses and the flexor and FDI tendon paths.

No MuJoCo joint limit, joint damping or contact: they would add torques that no ledger shows.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from cosim.port import Array, InputError
from meshes.skeleton import BODIES, JOINTS, Skeleton

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
VIEW_METACARPAL = 0.040  # m, how much of the metacarpal is drawn

Path = list[tuple[str, Array]]
Surface = tuple[Array, Array]


def tendon_paths(skeleton: Skeleton, o2o3: float = O2O3) -> dict[str, Path]:
    """The muscles' path points from origin to insertion: (body, (3,) m in that body's frame)."""
    return {name: _path(joints, skeleton, o2o3) for name, joints in NORMATIVE_PATHS.items()}


def _path(joints: Mapping[str, tuple], skeleton: Skeleton, o2o3: float) -> Path:
    path: Path = []
    for joint, (before, after) in joints.items():
        i, k = CROSSES[joint]
        centre = np.array([skeleton.length[i] if i else 0.0, 0.0, 0.0])
        path.append((BODIES[i], centre + _in_our_axes(before, 0.0, o2o3)))
        path.append((BODIES[k], _in_our_axes(after, OFFSET[joint], o2o3)))
    body, first = path[0]
    return [(body, first - [ORIGIN_REACH, 0.0, 0.0]), *path]


def _in_our_axes(point: Sequence[float], offset: float, o2o3: float) -> Array:
    x, dorsal, radial = point
    return o2o3 * np.array([x + offset, radial, dorsal])


def mjcf_xml(
    skeleton: Skeleton,
    *,
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    o2o3: float = O2O3,
    ranges: Mapping[str, tuple[float, float]] = RANGES,
    bones: Mapping[str, Surface] | None = None,
) -> str:
    """The finger as MJCF text, numbers in full precision; the world is the metacarpal's frame.

    gravity: (3,) m/s2 in the world; o2o3: m, the unit of the tendon paths; ranges: rad by joint,
    for information only; bones: triangle surfaces (vertices (n, 3) m in the body's frame, faces
    (m, 3)) by body, drawn instead of capsules.  Raises InputError for an unknown body or joint.
    """
    bones = {} if bones is None else bones
    _known(bones, BODIES, "bones")
    _known(ranges, JOINTS, "ranges")
    root = ET.Element("mujoco", model="index finger")
    ET.SubElement(root, "compiler", angle="radian")
    option = ET.SubElement(root, "option", gravity=_text(gravity))
    ET.SubElement(option, "flag", contact="disable")
    paths = tendon_paths(skeleton, o2o3)
    _add_meshes(root, bones)
    parent = ET.SubElement(root, "worldbody")
    for i in range(len(BODIES)):
        parent = _add_body(parent, skeleton, i, ranges)
        _add_geom(parent, skeleton, i, BODIES[i] in bones)
        _add_sites(parent, paths, BODIES[i])
    _add_site(parent, "tip", [skeleton.length[3], 0.0, 0.0])
    _add_tendons(root, paths)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _known(names: Mapping[str, object], among: Sequence[str], what: str) -> None:
    unknown = [name for name in names if name not in among]
    if unknown:
        raise InputError(f"{what}: unknown name {', '.join(unknown)}; expected some of {among}")


def _text(numbers: Sequence[float] | Array) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _add_meshes(root: ET.Element, bones: Mapping[str, Surface]) -> None:
    asset = ET.SubElement(root, "asset")
    for body, (vertices, faces) in bones.items():
        text = {"vertex": _text(np.ravel(vertices)), "face": " ".join(map(str, np.ravel(faces)))}
        ET.SubElement(asset, "mesh", text | {"name": body, "inertia": "shell"})


def _add_sites(parent: ET.Element, paths: Mapping[str, Path], body: str) -> None:
    for name, path in paths.items():
        for k, (where, point) in enumerate(path):
            if where == body:
                _add_site(parent, f"{name}_{k}", point)


def _add_site(parent: ET.Element, name: str, point: Sequence[float] | Array) -> None:
    ET.SubElement(parent, "site", name=name, pos=_text(point), size="0.0005")


def _add_tendons(root: ET.Element, paths: Mapping[str, Path]) -> None:
    tendon = ET.SubElement(root, "tendon")
    for name, path in paths.items():
        spatial = ET.SubElement(tendon, "spatial", name=name, width="0.0004", rgba=".8 .2 .2 1")
        for k in range(len(path)):
            ET.SubElement(spatial, "site", site=f"{name}_{k}")


def _add_body(
    parent: ET.Element, skeleton: Skeleton, i: int, ranges: Mapping[str, tuple[float, float]]
) -> ET.Element:
    if i == 0:
        return ET.SubElement(parent, "body", name=BODIES[0])
    pos, quat = [skeleton.length[i - 1] if i > 1 else 0.0, 0.0, 0.0], _quaternion(skeleton, i)
    out = ET.SubElement(parent, "body", name=BODIES[i], pos=_text(pos), quat=_text(quat))
    mass, inertia = SEGMENTS[BODIES[i]]
    centre = _text([skeleton.length[i] / 2, 0.0, 0.0])
    ET.SubElement(out, "inertial", pos=centre, mass=repr(mass), diaginertia=_text(inertia))
    for name, axis in zip(JOINTS, skeleton.axis, strict=True):
        if CROSSES[name.removesuffix("_abduction")][1] == i:
            hinge = {"name": name, "type": "hinge", "axis": _text(axis)}
            limits = {"range": _text(ranges[name]), "limited": "false"} if name in ranges else {}
            ET.SubElement(out, "joint", hinge | limits)
    return out


def _quaternion(skeleton: Skeleton, i: int) -> list[float]:
    """MuJoCo's (w, x, y, z) of the body's frame in its parent at zero angles."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(skeleton.zero[i - 1]).as_quat()
    return [w, x, y, z]


def _add_geom(body: ET.Element, skeleton: Skeleton, i: int, has_mesh: bool) -> None:
    name = BODIES[i]
    common = {"name": name, "contype": "0", "conaffinity": "0", "rgba": ".9 .87 .78 1"}
    if has_mesh:
        ET.SubElement(body, "geom", common | {"type": "mesh", "mesh": name})
        return
    ends = [0, 0, 0, skeleton.length[i], 0, 0] if i else [-VIEW_METACARPAL, 0, 0, 0, 0, 0]
    capsule = {"type": "capsule", "fromto": _text(ends), "size": repr(VIEW_RADIUS[name])}
    ET.SubElement(body, "geom", common | capsule)
