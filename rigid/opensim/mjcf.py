"""An OpenSim model as MJCF: bodies, joints, sites, wraps, tendons, an actuator per tendon."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from lxml import etree

from cosim.port import Array
from rigid.opensim.components import GROUND, Transform
from rigid.opensim.functions import SAMPLES
from rigid.opensim.joints import Screw
from rigid.opensim.paths import SIDE_AT, Tendon, Wrap
from rigid.opensim.skeleton import LEAST_INERTIA, LEAST_MASS, OsimBody, OsimSkeleton

INERTIA = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""MuJoCo's order of `fullinertia`."""
SLIDE_INERTIA = 0.01
"""kg, that resist each slide of a point that moves and weigh nothing: what holds a slide to its
coordinate gives way to a tendon's force by as much less as they are more."""
FIRM = {"solref": "0.004 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
"""MuJoCo's stiffest equality that a step of 2 ms allows."""


@dataclass(frozen=True)
class Coupling:
    """An equality of MuJoCo: a joint follows a coordinate by a polynomial (lowest power first),
    which is off OpenSim's function by at most `error` (rad or m) over the coordinate's range."""

    coordinate: str
    polynomial: tuple[float, ...]
    error: float


@dataclass(frozen=True)
class MjcfSite:
    """A named point in the frame of a body (path), m; where `slides` move it, along the columns of
    `rotation`, it is on a light body of its own."""

    name: str
    body: str
    position: Array
    rotation: Array = field(default_factory=lambda: np.eye(3))
    slides: Sequence[Screw] = ()


def mjcf_xml(
    name: str,
    gravity: Sequence[float],
    skeleton: OsimSkeleton,
    tendons: Mapping[str, Tendon],
    markers: Iterable[MjcfSite],
    couplings: Mapping[str, Coupling] = MappingProxyType({}),
) -> str:
    """MJCF text, numbers in full precision.  The world is OpenSim's ground; a joint's position is
    OpenSim's coordinate, or follows one as `couplings` say, by joint; the control of a tendon's
    actuator is its tension in N; the keyframe "default" holds the coordinates' default values."""
    root = etree.Element("mujoco", model=name)
    etree.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    option = etree.SubElement(root, "option", gravity=_text(gravity))
    etree.SubElement(option, "flag", contact="disable")
    fixed: dict[str, list[MjcfSite | Wrap]] = defaultdict(list)
    surfaces = {wrap.name: wrap for tendon in tendons.values() for wrap in tendon.wraps if wrap}
    sites = [*markers, *_path_sites(tendons), *_side_sites(surfaces)]
    parts: list[MjcfSite | Wrap] = [*sites, *surfaces.values()]
    for part in parts:
        fixed[part.body].append(part)
    order: list[Screw] = []
    world = etree.SubElement(root, "worldbody")
    _fill(world, GROUND, skeleton, fixed, order)
    order += [_bear(world, name, skeleton) for name in skeleton.unborne]
    _add_couplings(root, couplings)
    _add_tendons(root, tendons)
    _add_keyframe(root, [value_of(screw, skeleton) for screw in order])
    etree.indent(root)
    return str(etree.tostring(root, encoding="unicode")) + "\n"


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _path_sites(tendons: Mapping[str, Tendon]) -> list[MjcfSite]:
    return [
        MjcfSite(at, point.body, point.rest.position, point.rest.rotation, point.slides(at))
        for name, tendon in tendons.items()
        for k, point in enumerate(tendon.points)
        for at in [f"{name}-{k}"]
    ]


def _side_sites(wraps: Mapping[str, Wrap]) -> list[MjcfSite]:
    return [
        MjcfSite(f"{name}-side", wrap.body, wrap.place.at(SIDE_AT * wrap.radius * wrap.side))
        for name, wrap in wraps.items()
        if wrap.side is not None
    ]


def _fill(
    element: etree._Element,
    path: str,
    skeleton: OsimSkeleton,
    fixed: Mapping[str, list[MjcfSite | Wrap]],
    order: list[Screw],
) -> None:
    """The sites, wraps and bodies within a body; `order` gains the joints as they come."""
    for part in fixed.get(path, ()):
        if isinstance(part, MjcfSite):
            _add_site(element, part, skeleton)
            order += part.slides
        else:
            _add_wrap(element, part)
    for child in skeleton.branches[path]:
        inner = etree.SubElement(element, "body", name=skeleton.bodies[child].tag.name)
        _place(inner, skeleton.joints[child].place)
        _add_inertial(inner, skeleton.bodies[child])
        for screw in skeleton.joints[child].screws:
            _add_joint(inner, screw, skeleton.coordinates[screw.coordinate].range)
            order.append(screw)
        _fill(inner, child, skeleton, fixed, order)


def _add_site(element: etree._Element, site: MjcfSite, skeleton: OsimSkeleton) -> None:
    position = site.position
    if site.slides:
        element = etree.SubElement(element, "body", name=site.name)
        _place(element, Transform(site.rotation, position))
        _add_light(element)
        for slide in site.slides:
            _add_joint(element, slide, skeleton.coordinates[slide.coordinate].range)
            element[-1].set("armature", repr(SLIDE_INERTIA))
        position = np.zeros(3)
    etree.SubElement(element, "site", name=site.name, pos=_text(position), size="0.0005")


def _add_light(element: etree._Element) -> None:
    tiny = {"mass": repr(LEAST_MASS), "diaginertia": _text([LEAST_INERTIA] * 3)}
    etree.SubElement(element, "inertial", pos="0 0 0", **tiny)


def value_of(screw: Screw, skeleton: OsimSkeleton) -> float:
    """The default value of a joint: that of its coordinate, or what follows from it."""
    default = skeleton.coordinates[screw.coordinate].default
    return default if screw.curve is None else screw.curve(default)


def _bear(world: etree._Element, name: str, skeleton: OsimSkeleton) -> Screw:
    """A body beside the others whose one hinge is a coordinate that only followers show."""
    body = etree.SubElement(world, "body", name=f"coordinate {name}")
    _add_light(body)
    screw = Screw(name, name, False, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    _add_joint(body, screw, skeleton.coordinates[name].range)
    return screw


def _add_couplings(root: etree._Element, couplings: Mapping[str, Coupling]) -> None:
    if couplings:
        equality = etree.SubElement(root, "equality")
        for joint, coupling in couplings.items():
            of = {"joint1": joint, "joint2": coupling.coordinate}
            polynomial = _text(coupling.polynomial)
            etree.SubElement(equality, "joint", polycoef=polynomial, **of, **FIRM)


def _add_joint(element: etree._Element, screw: Screw, span: tuple[float, float]) -> None:
    if screw.curve is not None:
        values = screw.curve.at(np.linspace(*span, SAMPLES))
        span = float(values.min()), float(values.max())
    joint = etree.SubElement(element, "joint", name=screw.name)
    joint.set("type", "slide" if screw.slide else "hinge")
    joint.set("axis", _text(screw.direction))
    joint.set("pos", _text(screw.point))
    joint.set("range", _text(span))
    joint.set("limited", "false")


def _place(element: etree._Element, place: Transform) -> None:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(place.rotation).as_quat()
    element.set("pos", _text(place.position))
    element.set("quat", _text((w, x, y, z)))


def _add_inertial(element: etree._Element, body: OsimBody) -> None:
    if body.mass > 0:
        full = _text([body.inertia[i, j] for i, j in INERTIA])
        pos, mass = _text(body.centre), repr(body.mass)
        etree.SubElement(element, "inertial", pos=pos, mass=mass, fullinertia=full)


def _add_wrap(element: etree._Element, wrap: Wrap) -> None:
    size = [wrap.radius] if wrap.half_length is None else [wrap.radius, wrap.half_length]
    kind = "sphere" if wrap.half_length is None else "cylinder"
    geom = etree.SubElement(element, "geom", name=wrap.name, type=kind, size=_text(size), mass="0")
    _place(geom, wrap.place)
    for key in ("contype", "conaffinity"):
        geom.set(key, "0")
    geom.set("rgba", ".5 .6 .8 .4")


def _add_tendons(root: etree._Element, paths: Mapping[str, Tendon]) -> None:
    tendons, actuators = etree.SubElement(root, "tendon"), etree.SubElement(root, "actuator")
    for name, path in paths.items():
        spatial = etree.SubElement(tendons, "spatial", name=name, width="0.0004", rgba=".8 .2 .2 1")
        for k, wrap in enumerate((*path.wraps, None)):
            etree.SubElement(spatial, "site", site=f"{name}-{k}")
            if wrap is not None:
                geom = etree.SubElement(spatial, "geom", geom=wrap.name)
                if wrap.side is not None:
                    geom.set("sidesite", f"{wrap.name}-side")
        pull = {"gaintype": "fixed", "gainprm": "-1", "biastype": "none"}
        etree.SubElement(actuators, "general", name=name, tendon=name, **pull)


def _add_keyframe(root: etree._Element, values: Sequence[float]) -> None:
    if values:
        frame = etree.SubElement(root, "keyframe")
        etree.SubElement(frame, "key", name="default", qpos=_text(np.asarray(values)))
