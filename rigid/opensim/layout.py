"""The model of a file in the layout of OpenSim 4; older ones are rewritten, as OpenSim does itself.

In OpenSim 2 and 3 joints stand within their child bodies, the ground is a body, and points name the
body that they are fixed to.  The tags of a file show what to rewrite; those of the versions before
4.0 was released have some of both.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path

from rigid.opensim.losses import Loss, change_of
from rigid.opensim.xml import LIMITS, OsimTag, read_xml

OLDEST, FIRST_OF_4 = 20000, 40000
INERTIA = ("inertia_xx", "inertia_yy", "inertia_zz", "inertia_xy", "inertia_xz", "inertia_yz")
NO_INERTIA = ("1", "1", "1", "0", "0", "0")
"""What OpenSim takes for those that an old body does not state."""
RENAMED = {
    "MusclePointSet": "PathPointSet",
    "MuscleWrapSet": "PathWrapSet",
    "pennation_angle": "pennation_angle_at_optimal",
    "XAttachment": "x_location",
    "YAttachment": "y_location",
    "ZAttachment": "z_location",
}
IS_ON = {"Constraint": "isEnforced", "Controller": "enabled", "": "appliesForce"}
"""What became of `isDisabled`, by how the kind of its owner ends."""
LEFT_OUT = {"Coordinate": "motion_type", "MovingPathPoint": "location"}
"""What an object had that means nothing now, by its kind."""
POINTS = ("PathPoint", "ConditionalPathPoint", "MovingPathPoint", "Marker")
CONNECTEE = re.compile(r"(?:connector|socket)_(\w+)_connectee_name")


def read_model(path: Path) -> tuple[OsimTag, int, list[Loss]]:
    """The <Model> of a file in the layout of OpenSim 4, the version of the file's own layout, and
    what was changed.

    Raises InputError for what is no model of OpenSim, and for versions before 2."""
    root = read_xml(path)
    text = root.attributes.get("Version", "")
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise root.fault(f"the attribute Version is {text[:20]!r}, expected a number such as 40600")
    version, model, losses = int(text), root.one("Model"), list[Loss]()
    if version < OLDEST:
        raise root.fault(
            f"this is the layout of OpenSim 1 (version {text}); open it with OpenSim 4 and save it"
        )
    if model is None:
        raise root.fault("holds no <Model>; expected a model of OpenSim")
    if version < FIRST_OF_4 or any(tag.kind == "location_in_parent" for tag in _walk(model)):
        rewrite(model)
        why = f"the layout of OpenSim {text[0]} (version {text}): read as OpenSim 4 reads it"
        losses.append(change_of(root, why))
    fill_defaults(model)
    return model, version, losses + [change_of(*pair) for pair in _rename_doubles(model)]


def rewrite(model: OsimTag) -> None:
    """Rewrite the tags of a model; they keep their lines.

    Raises InputError where numbers of a joint's place are none."""
    for tag in (model, *list(_walk(model))):
        _rename_children(tag)
        if tag.kind in POINTS and (body := _take(tag, "body")):
            _add(tag, "socket_parent_frame", _path(body.text.strip()), body)
    for name in ("BodySet", "JointSet", "ForceSet", "ConstraintSet", "MarkerSet"):
        for found in model.all(name):
            found.attributes.pop("name", None)  # paths in sockets go by the kinds' names
    held = [o for bodies in model.all("BodySet") for o in bodies.all("objects")]
    joints = model.one("JointSet") or _add(model, "JointSet")
    objects = joints.one("objects") or _add(joints, "objects")
    for holder in held:
        grounds = [b for b in holder.children if b.kind == "Body" and b.name == "ground"]
        holder.children = [b for b in holder.children if b.name != "ground"]
        for ground in grounds:
            ground.kind, ground.parent = "Ground", model
            ground.children = ground.all("WrapObjectSet")
        model.children = [*grounds, *model.children]
        for body in holder.all("Body"):
            _gather_inertia(body)
            for joint in [j for kept in body.all("Joint") for j in kept.children]:
                _move_joint(joint, body, objects)
            body.children = [c for c in body.children if c.kind != "Joint"]


def _walk(tag: OsimTag) -> Iterator[OsimTag]:
    for child in tag.children:
        yield child
        yield from _walk(child)


def _add(parent: OsimTag, kind: str, text: str = "", like: OsimTag | None = None) -> OsimTag:
    """A tag more within `parent`, in the line of another."""
    line = (like or parent).line
    tag = OsimTag(kind, {}, parent.file, parent, line, text)
    parent.children.append(tag)
    return tag


def _take(tag: OsimTag, kind: str) -> OsimTag | None:
    """The only child of that kind, taken out."""
    child = tag.one(kind)
    if child is not None:
        tag.children = [c for c in tag.children if c is not child]
    return child


def _rename_children(tag: OsimTag) -> None:
    """Give what is in a tag the names of OpenSim 4, and take out what has none there."""
    left_out = LEFT_OUT.get(tag.kind)
    tag.children = [c for c in tag.children if c.kind != left_out]
    for child in tag.children:
        child.kind = RENAMED.get(child.kind, child.kind)
        if connectee := CONNECTEE.fullmatch(child.kind):
            child.kind = f"socket_{connectee[1]}"
        if child.kind == "isDisabled":
            child.kind = next(on for kind, on in IS_ON.items() if tag.kind.endswith(kind))
            child.text = str(child.text.strip().lower() != "true").lower()
    for holder in [c for c in tag.children if c.kind == "connectors"]:
        for connector in holder.children:
            name = connector.word("connectee_name", "")
            _add(tag, f"socket_{connector.name}", name, connector)
    tag.children = [c for c in tag.children if c.kind != "connectors"]
    parts = [c for c in tag.children if c.kind in ("PathPointSet", "PathWrapSet")]
    if parts and tag.kind != "GeometryPath":
        tag.children = [c for c in tag.children if c.kind not in ("PathPointSet", "PathWrapSet")]
        path = _add(tag, "GeometryPath", like=parts[0])
        path.children = parts
        for part in parts:
            part.parent = path


def _path(body: str) -> str:
    return "/ground" if body == "ground" else f"/bodyset/{body}"


def _gather_inertia(body: OsimTag) -> None:
    parts = [_take(body, kind) for kind in INERTIA]
    stated = [part for part in parts if part is not None]
    if stated:
        pairs = zip(parts, NO_INERTIA, strict=True)
        text = " ".join(part.text.strip() if part else default for part, default in pairs)
        _add(body, "inertia", text, stated[0])


def _move_joint(joint: OsimTag, body: OsimTag, objects: OsimTag) -> None:
    """Move a joint from its child body to the objects of the set of joints."""
    objects.children.append(joint)
    joint.parent = objects
    parent = _take(joint, "parent_body")
    above = parent.text.strip() if parent else "ground"
    _place(joint, "parent_frame", _path(above), ("location_in_parent", "orientation_in_parent"))
    _place(joint, "child_frame", _path(body.name), ("location", "orientation"))
    coordinates = _take(joint, "CoordinateSet")
    for held in coordinates.all("objects") if coordinates else ():
        held.kind, held.parent = "coordinates", joint
        joint.children.append(held)
    reverse = _take(joint, "reverse")
    if reverse is not None and reverse.text.strip().lower() == "true":
        joint.kind = f"reversed {joint.kind}"


def _place(joint: OsimTag, socket: str, body: str, places: tuple[str, str]) -> None:
    """Join a joint to a body by a frame that is fixed in it."""
    found = [_take(joint, kind) for kind in places]
    if not any(any(part.numbers(3)) for part in found if part):
        _add(joint, f"socket_{socket}", body)
        return
    frames = joint.one("frames") or _add(joint, "frames")
    frame = _add(frames, "PhysicalOffsetFrame")
    frame.attributes["name"] = f"{socket}_offset"
    _add(frame, "socket_parent", body)
    for part, kind in zip(found, ("translation", "orientation"), strict=True):
        if part is not None:
            _add(frame, kind, part.text, part)
    _add(joint, f"socket_{socket}", frame.name)


def _rename_doubles(model: OsimTag) -> Iterator[tuple[OsimTag, str]]:
    """Rename what has the name of another of its set, but for bodies, to which sockets lead: yield
    the tag and what was done."""
    for objects in [o for s in model.children if s.kind.endswith("Set") for o in s.children]:
        names = {tag.name for tag in objects.children}
        numbers: dict[str, itertools.count[int]] = {}
        for tag in objects.children:
            if tag.name in numbers and tag.name and tag.kind != "Body":
                free = (f"{tag.name}_{k}" for k in numbers[tag.name])
                name = next(name for name in free if name not in names)
                names.add(name)
                yield tag, f"another has this name: it is called {name} here, as OpenSim calls it"
                tag.attributes["name"] = name
            numbers.setdefault(tag.name, itertools.count())


def fill_defaults(model: OsimTag) -> None:
    """Give objects what the model's <defaults> state for their kind and they do not.

    Raises InputError where this adds more tags than are read of a file."""
    held = {tag.kind: tag for holder in model.all("defaults") for tag in holder.children}
    for holder in model.all("defaults"):
        holder.pass_over()
    left = LIMITS.tags
    for tag in list(_walk(model)):
        default = held.get(tag.kind)
        if default is None or default.parent is tag.parent:
            continue
        there = {child.kind for child in tag.children}
        for child in default.children:
            if child.kind not in there and not child.children and child.text.strip():
                _add(tag, child.kind, child.text, child)
        left -= len(default.children)
        if left < 0:
            raise default.fault(f"it would add more than {LIMITS.tags} tags to the model")
