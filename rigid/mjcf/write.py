"""A finger as MJCF text, numbers in full precision; the world is the first body's frame.

No MuJoCo joint limit, joint damping or contact: they would add torques that no ledger shows
(`rigid.mjcf.simulation` adds them for a user's own simulation).  Every tendon has an actuator whose
control is its tension, for muscles that are computed outside.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from cosim.port import Array, mirror, mirror_axial
from rigid.model import FingerModel, Segment, Strand, Tendon, Via, WrapCylinder, WrapSphere

VECTORS = {"pos", "fromto", "vertex", "gravity", "axis"}
"""Attributes of places and directions, three numbers each."""
HALF_WIDTH = 0.02
"""m, half the drawn length of a cylinder, which MuJoCo takes as infinite."""


def mjcf_xml(model: FingerModel, gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> str:
    """Return the finger as a MuJoCo model (MJCF text); `gravity` (3,) m/s2 in the world.  Joint
    ranges are there for information only, cylinders and bones do not collide.

    >>> import mujoco
    >>> from meshes.skeleton import index_finger
    >>> from rigid.fingers.index import finger_model
    >>> from rigid.mjcf.write import mjcf_xml
    >>> model = mujoco.MjModel.from_xml_string(mjcf_xml(finger_model(index_finger())))
    >>> [model.joint(i).name for i in range(model.njnt)]
    ['MCP', 'MCP_abduction', 'PIP', 'DIP']
    """
    root = mjcf_tree(model, gravity)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def mjcf_tree(model: FingerModel, gravity: Sequence[float]) -> ET.Element:
    """Return the elements of `mjcf_xml`."""
    root = ET.Element("mujoco", model=model.name)
    ET.SubElement(root, "compiler", angle="radian")
    option = ET.SubElement(root, "option", gravity=_text(gravity))
    ET.SubElement(option, "flag", contact="disable")
    _add_meshes(root, model)
    parent = ET.SubElement(root, "worldbody")
    for segment in model.segments:
        parent = _add_body(parent, segment, moving=segment is not model.segments[0])
        _add_geom(parent, segment, segment.name in model.meshes)
        for tendon in model.tendons:
            _add_guides(parent, tendon, segment.name)
    _add_site(parent, "tip", model.tip)
    _add_tendons(root, model)
    _add_actuators(root, model)
    return root


def mirror_tree(root: ET.Element) -> None:
    """Turn the elements that `mjcf_tree` and `rigid.mjcf.hood` make of a finger into those of its
    mirror image, of the other hand."""
    for element in root.iter():
        for key in VECTORS & element.attrib.keys():
            way = element.tag == "joint" and key == "axis" and element.get("type") != "slide"
            given = np.array(element.attrib[key].split(), dtype=float).reshape(-1, 3)
            element.attrib[key] = _text(np.ravel(mirror_axial(given) if way else mirror(given)))
        if "quat" in element.attrib:
            w, *axis = map(float, element.attrib["quat"].split())
            element.attrib["quat"] = _text([w, *mirror_axial(np.array(axis))])
        if element.tag == "mesh":
            faces = np.array(element.attrib["face"].split()).reshape(-1, 3)
            element.attrib["face"] = " ".join(faces[:, ::-1].ravel())


def _text(numbers: Sequence[float] | Array) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _add_meshes(root: ET.Element, model: FingerModel) -> None:
    asset = ET.SubElement(root, "asset")
    for body, (vertices, faces) in model.meshes.items():
        text = {"vertex": _text(np.ravel(vertices)), "face": " ".join(map(str, np.ravel(faces)))}
        ET.SubElement(asset, "mesh", text | {"name": body, "inertia": "shell"})


def _add_body(parent: ET.Element, segment: Segment, moving: bool) -> ET.Element:
    place = {"pos": _text(segment.position), "quat": _text(_quaternion(segment))}
    out = ET.SubElement(parent, "body", {"name": segment.name} | (place if moving else {}))
    if moving:
        inertial = {
            "pos": _text(segment.centre),
            "mass": repr(float(segment.mass)),
            "diaginertia": _text(segment.inertia),
        }
        ET.SubElement(out, "inertial", inertial)
    for hinge in segment.hinges:
        joint = {"name": hinge.name, "type": "hinge", "axis": _text(hinge.axis)}
        finite = np.isfinite(hinge.range).all()
        limits = {"range": _text(hinge.range), "limited": "false"} if finite else {}
        ET.SubElement(out, "joint", joint | limits)
    return out


def _quaternion(segment: Segment) -> list[float]:
    """MuJoCo's (w, x, y, z) of the body's frame in its parent at zero angles."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(np.array(segment.rotation)).as_quat()
    return [w, x, y, z]


def _add_geom(body: ET.Element, segment: Segment, has_mesh: bool) -> None:
    common = {
        "name": segment.name,
        "contype": "0",
        "conaffinity": "0",
        "rgba": ".9 .87 .78 1",
    }
    if has_mesh:
        ET.SubElement(body, "geom", common | {"type": "mesh", "mesh": segment.name})
        return
    ends = [0, 0, 0, segment.length, 0, 0]
    capsule = {"type": "capsule", "fromto": _text(ends), "size": repr(segment.radius)}
    ET.SubElement(body, "geom", common | capsule)


def _add_guides(body: ET.Element, tendon: Tendon, name: str) -> None:
    """Sites, cylinders and spheres of a tendon on one body."""
    for s, strand in enumerate(tendon.strands):
        for k, element in enumerate(strand.path):
            if element.body != name:
                continue
            label = _label(tendon, s, k)
            match element:
                case Via():
                    _add_site(body, label, element.point)
                case WrapSphere() | WrapCylinder():
                    _add_surface(body, label, element)


def _label(tendon: Tendon, strand: int, element: int) -> str:
    return f"{tendon.name}_{strand}_{element}"


def _add_site(parent: ET.Element, name: str, point: Sequence[float] | Array) -> None:
    ET.SubElement(parent, "site", name=name, pos=_text(point), size="0.0005")


def _add_surface(body: ET.Element, name: str, surface: WrapCylinder | WrapSphere) -> None:
    drawn = {
        "name": name,
        "size": repr(float(surface.radius)),
        "contype": "0",
        "conaffinity": "0",
        "group": "4",
        "rgba": ".5 .6 .9 .3",
    }
    if surface.side is not None:
        _add_site(body, f"{name}_side", surface.side)
    match surface:
        case WrapSphere():
            ET.SubElement(body, "geom", drawn | {"type": "sphere", "pos": _text(surface.centre)})
        case WrapCylinder():
            centre, axis = np.array(surface.centre), np.array(surface.axis)
            half = HALF_WIDTH * axis / np.linalg.norm(axis)
            ends = _text([*(centre - half), *(centre + half)])
            ET.SubElement(body, "geom", drawn | {"type": "cylinder", "fromto": ends})


def _add_tendons(root: ET.Element, model: FingerModel) -> None:
    out = ET.SubElement(root, "tendon")
    for tendon in model.tendons:
        colour = {"width": "0.0004", "rgba": ".8 .2 .2 1"}
        spatial = ET.SubElement(out, "spatial", {"name": tendon.name} | colour)
        for s, strand in enumerate(tendon.strands):
            if len(tendon.strands) > 1 or strand.share != 1.0:
                ET.SubElement(spatial, "pulley", divisor=repr(1.0 / strand.share))
            _add_strand(spatial, tendon, s, strand)


def _add_actuators(root: ET.Element, model: FingerModel) -> None:
    """One for each tendon; its control is the tension in N."""
    if not model.tendons:
        return
    out = ET.SubElement(root, "actuator")
    for name in model.muscles:
        ET.SubElement(out, "general", name=name, tendon=name, gainprm="-1")


def _add_strand(spatial: ET.Element, tendon: Tendon, s: int, strand: Strand) -> None:
    for k, element in enumerate(strand.path):
        label = _label(tendon, s, k)
        match element:
            case Via():
                ET.SubElement(spatial, "site", site=label)
            case WrapSphere() | WrapCylinder():
                side = {} if element.side is None else {"sidesite": f"{label}_side"}
                ET.SubElement(spatial, "geom", {"geom": label} | side)
