"""The components of a model by their paths, and the frames among them as fixed transforms.

OpenSim names a component by the names on the way to it (`/jointset/mcp/ground_offset`).  A socket
holds such a path, absolute or relative to the component that owns the socket.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cosim.port import Array
from rigid.opensim.xml import OsimTag

GROUND = "/ground"
OFFSET_FRAMES = ("PhysicalOffsetFrame",)
SETS = (
    *("BodySet", "JointSet", "ForceSet", "ConstraintSet", "ControllerSet", "MarkerSet"),
    *("ContactGeometrySet", "ProbeSet", "ComponentSet", "WrapObjectSet"),
)
"""Sets whose objects are components of the set's owner."""


@dataclass(frozen=True)
class Transform:
    """x in the outer frame = rotation @ x in the inner frame + position (m)."""

    rotation: Array
    position: Array

    def __matmul__(self, inner: Transform) -> Transform:
        return Transform(self.rotation @ inner.rotation, self.at(inner.position))

    def at(self, point: Array) -> Array:
        """The place (3,) in the outer frame of a point of the inner one."""
        return self.rotation @ point + self.position

    def inverse(self) -> Transform:
        """The inverse transform."""
        return Transform(self.rotation.T, -self.rotation.T @ self.position)


IDENTITY = Transform(np.eye(3), np.zeros(3))


def rotate_xyz(orientation: Sequence[float], position: Sequence[float]) -> Transform:
    """Rotations by three angles (rad) about the frame's own x, y, z, in this order."""
    from scipy.spatial.transform import Rotation

    matrix = Rotation.from_euler("XYZ", list(orientation)).as_matrix()
    return Transform(matrix, np.asarray(position, dtype=float))


@dataclass(frozen=True)
class OsimFrame:
    """A frame fixed in a body: the body's path and the frame's place in it."""

    body: str
    transform: Transform


@dataclass
class Components:
    """All components of a model: tag by path, path by the tag's identity, tags by name."""

    by_path: dict[str, OsimTag]
    path_of: dict[int, str] = field(default_factory=dict)
    by_name: dict[str, list[OsimTag]] = field(default_factory=dict)
    made_up: list[tuple[OsimTag, str]] = field(default_factory=list)
    """What OpenSim does without, and what it is here."""

    def path(self, tag: OsimTag) -> str:
        """The path of a component; of what is within one but none itself (a path point), below that
        component."""
        if id(tag) in self.path_of or tag.parent is None:
            return self.path_of.get(id(tag), "")
        above = self.path(tag.parent)
        return f"{above}/{tag.name}" if tag.name and not tag.kind.endswith("Set") else above

    def of_kind(self, *kinds: str) -> list[OsimTag]:
        """In the file's order; they count as read."""
        found = [tag for tag in self.by_path.values() if tag.kind in kinds]
        for tag in found:
            tag.used = True
        return found

    def resolve_socket(self, owner: OsimTag, socket: str, default: str = "") -> OsimTag:
        """The component that a socket of `owner` names.

        Raises InputError where the socket is missing or leads nowhere, or to several."""
        child = owner.one(f"socket_{socket}")
        said = child.text.strip() if child else default
        if not said:
            raise owner.fault(f"<socket_{socket}> is missing; expected the path of a component")
        path = posixpath.normpath(posixpath.join(self.path(owner), said))
        if path in self.by_path:
            return self.by_path[path]
        named = self.by_name.get(said, [])
        if len(named) != 1:
            what = "no component" if not named else f"{len(named)} components"
            raise (child or owner).fault(f"{what} of the model is meant by {said!r}")
        return named[0]

    def frame(self, owner: OsimTag, socket: str) -> OsimFrame:
        """The frame that a socket names, as its place in a body.

        Raises InputError for a frame of another kind and for frames that hang on each other."""
        place = IDENTITY
        tag, seen = self.resolve_socket(owner, socket), set[int]()
        while tag.kind in OFFSET_FRAMES:
            if id(tag) in seen:
                raise tag.fault("this frame is offset from itself")
            seen.add(id(tag))
            place = offset(tag) @ place
            tag = self.resolve_socket(tag, "parent")
        if tag.kind not in ("Body", "Ground"):
            raise owner.fault(
                f"<socket_{socket}> leads to a {tag.kind}, expected a body or a frame"
            )
        return OsimFrame(self.path(tag), place)


def offset(tag: OsimTag) -> Transform:
    """Place of a PhysicalOffsetFrame in its parent frame."""
    tag.used = True
    return rotate_xyz(tag.values("orientation", (0.0,) * 3), tag.values("translation", (0.0,) * 3))


def components(model: OsimTag) -> Components:
    """The components by path.  Raises InputError where two components have one path."""
    out = Components({})
    if not any(child.kind == "Ground" for child in model.children):
        ground = type(model)("Ground", {"name": "ground"}, model.file, model, model.line)
        out.by_path[GROUND], out.path_of[id(ground)] = ground, GROUND
        out.by_name["ground"] = [ground]
        out.made_up.append((model, "it has no <Ground>: OpenSim's own is taken"))
    for path, tag in _walk(model, ""):
        if path in out.by_path:
            first = out.by_path[path].line
            raise tag.fault(f"the name is taken by the one in line {first}; names must be unique")
        if not tag.name:
            tag.attributes["name"] = path.rpartition("/")[2]
            out.made_up.append((tag, f"it has no name: it is called {tag.name} here"))
        out.by_path[path] = tag
        out.path_of[id(tag)] = path
        out.by_name.setdefault(tag.name, []).append(tag)
    return out


def _walk(tag: OsimTag, path: str) -> Iterator[tuple[str, OsimTag]]:
    """Yield (path, component) of all below a component."""
    for child in tag.children:
        if child.kind == "Ground":
            yield GROUND, child
            yield from _walk(child, GROUND)
        elif child.kind in ("components", "frames", "coordinates"):
            yield from _members(child, path)
        elif child.kind in SETS:
            child.used = True
            for objects in child.all("objects"):
                yield from _members(objects, f"{path}/{child.name or child.kind.lower()}")


def _members(container: OsimTag, path: str) -> Iterator[tuple[str, OsimTag]]:
    container.used = True
    for child in container.children:
        inner = f"{path}/{child.name or f'{child.kind.lower()}_in_line_{child.line}'}"
        yield inner, child
        yield from _walk(child, inner)
