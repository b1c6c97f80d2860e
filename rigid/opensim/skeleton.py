"""The tree of bodies and joints of an OpenSim model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.opensim.components import GROUND, Components
from rigid.opensim.joints import KINDS, Coordinate, Joint, Screw, read_joint
from rigid.opensim.losses import Loss, change_of, drop, unasked
from rigid.opensim.xml import OsimTag

MOST_BODIES = 5000
MOST_IN_CHAIN = 100
LEAST_MASS = 1e-9
"""kg, of a moving body that has less: MuJoCo takes none without mass."""
LEAST_INERTIA = 1e-12
"""kg m2, added about every axis of a body that has mass but less about one."""
MOST_SHORT = 0.5
"""Share of the largest moment of inertia by which the others may fall short of it."""
SLACK = 1e-9
"""Relative, by which two principal moments may fall short of the third (rounding in the file)."""

UNASKED = ""
"""Among the bodies that are left out, the mark of those that were not asked for."""


@dataclass(frozen=True)
class OsimBody:
    """Mass (kg), its centre (3,) m and the inertia (3, 3) kg m2 about it, in the body's axes."""

    tag: OsimTag
    mass: float
    centre: Array
    inertia: Array


@dataclass(frozen=True)
class OsimSkeleton:
    """Bodies and the joint that carries each, by path; `branches` lists a body's children."""

    bodies: Mapping[str, OsimBody]
    joints: Mapping[str, Joint]
    branches: Mapping[str, tuple[str, ...]]
    losses: tuple[Loss, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    """By the path of a body that is left out, the name of the joint that cannot be read; or
    UNASKED."""
    unasked: frozenset[str] = frozenset()
    """The coordinates of the joints that were not asked for."""

    @cached_property
    def followers(self) -> tuple[Screw, ...]:
        """The joints of MuJoCo that follow a coordinate by a function."""
        return tuple(s for j in self.joints.values() for s in j.screws if s.curve is not None)

    @cached_property
    def unborne(self) -> tuple[str, ...]:
        """The coordinates that only followers show: each is a joint of a body of its own."""
        return tuple(name for joint in self.joints.values() for name in joint.unborne)

    @cached_property
    def coordinates(self) -> dict[str, Coordinate]:
        """Names of the skeleton's coordinates."""
        return {c.name: c for joint in self.joints.values() for c in joint.coordinates}

    def named(self, said: str) -> str | None:
        """The coordinate that a name or path means: of several of one name that of the joint in the
        path, else the first."""
        *_, joint, name = "", "", *said.strip().split("/")
        found = {
            j.tag.name: c.name
            for j in reversed(list(self.joints.values()))
            for c in j.coordinates
            if c.tag.name == name
        }
        return found.get(joint, next(reversed(found.values()), None))

    @cached_property
    def moving(self) -> dict[str, bool]:
        """Whether it is a slide, for each coordinate that a joint of MuJoCo stands for."""
        carried = {
            s.coordinate: s.slide for j in self.joints.values() for s in j.screws if s.curve is None
        }
        return carried | dict.fromkeys(self.unborne, False)


def read_skeleton(model: Components, asked: frozenset[str] = frozenset()) -> OsimSkeleton:
    """Read bodies and joints from the ground on; where the paths of some bodies are `asked` for,
    those and what carries them.  Raises InputError for closed loops, bodies that
    nothing carries, joints or inertias that MuJoCo cannot have, and names that come twice."""
    tags = [t for t in model.by_path.values() if t.kind.endswith("Joint")]
    read_joints, refused = [], dict[str, tuple[OsimTag, InputError]]()
    losses: list[Loss] = []
    unasked_names = set[str]()
    left_out = _unasked_bodies(tags, model, asked) if asked else {}
    for tag in tags:
        tag.used = True
        if left_out and model.frame(tag, "child_frame").body in left_out:
            unasked_names |= {c.name for c in tag.within("coordinates")}
            losses.append(unasked(tag))
            continue
        try:
            if tag.kind not in KINDS:
                known = ", ".join(KINDS)
                raise tag.fault(f"a {tag.kind} cannot be imported; expected one of {known}")
            read_joints.append(read_joint(tag, model))
        except InputError as error:
            refused[model.frame(tag, "child_frame").body] = tag, error
    read_joints, renamed = _with_names_of_their_own(read_joints)
    losses += renamed
    all_joints = _by_child(read_joints, model)
    bodies = {model.path(tag): tag for tag in model.of_kind("Body")}
    if len(bodies) > MOST_BODIES:
        file = next(iter(bodies.values())).file
        raise InputError(f"{file}: more than {MOST_BODIES} bodies")
    losses += [unasked(bodies[path]) for path in left_out]
    left_out |= _left_out(bodies, all_joints, refused)
    joints = {path: joint for path, joint in all_joints.items() if path not in left_out}
    if refused and not joints:
        raise next(iter(refused.values()))[1]
    for path in left_out:
        bodies.pop(path).pass_over()
    branches = _branches(bodies, joints)
    losses += [loss for joint in joints.values() for loss in _coordinate_losses(joint)]
    losses += [_refusal(tag, error, left_out) for tag, error in refused.values()]
    read = {}
    for path, tag in bodies.items():
        read[path], more = _body(tag, bool(joints[path].screws))
        losses += more
    _unique([*bodies.values()])
    unasked_names -= {c.tag.name for joint in joints.values() for c in joint.coordinates}
    not_asked = frozenset(unasked_names)
    return OsimSkeleton(read, joints, branches, tuple(losses), left_out, not_asked)


def _with_names_of_their_own(joints: list[Joint]) -> tuple[list[Joint], list[Loss]]:
    """The joints, with a coordinate whose name another has called "joint/coordinate"; what was
    renamed."""
    out, losses, seen = list[Joint](), list[Loss](), set[str]()
    for joint in joints:
        new = {c.name: f"{joint.tag.name}/{c.name}" for c in joint.coordinates if c.name in seen}
        for c in joint.coordinates:
            if c.name in new:
                why = f"another joint has a coordinate of this name: it is called {new[c.name]}"
                losses.append(change_of(c.tag, why))
        seen |= {c.name for c in joint.coordinates}
        out.append(joint.renamed(new) if new else joint)
    return out, losses


def _unasked_bodies(
    tags: list[OsimTag], model: Components, asked: frozenset[str]
) -> dict[str, str]:
    """The bodies that are neither asked for nor carry one that is."""
    parents = {
        model.frame(tag, "child_frame").body: model.frame(tag, "parent_frame").body for tag in tags
    }
    kept = set[str]()
    for path in asked:
        while path in parents and path not in kept:
            kept.add(path)
            path = parents[path]
    return dict.fromkeys((path for path in parents if path not in kept), UNASKED)


def _left_out(
    bodies: Mapping[str, OsimTag],
    joints: Mapping[str, Joint],
    refused: Mapping[str, tuple[OsimTag, InputError]],
) -> dict[str, str]:
    """The bodies whose joint was refused, and all that hang on them."""
    out = {path: tag.name for path, (tag, _) in refused.items() if path in bodies}
    grown = True
    while grown:
        more = {
            path: out[joint.parent]
            for path, joint in joints.items()
            if joint.parent in out and path not in out
        }
        out |= more
        grown = bool(more)
    return out


def _refusal(tag: OsimTag, error: InputError, left_out: Mapping[str, str]) -> Loss:
    reason = str(error).rpartition(": ")[2]
    bodies = [path.rpartition("/")[2] for path, joint in left_out.items() if joint == tag.name]
    return drop(tag, f"{reason}; left out with it: {', '.join(bodies)}, and what is fixed to them")


def _by_child(joints: list[Joint], model: Components) -> dict[str, Joint]:
    out: dict[str, Joint] = {}
    for joint in joints:
        if joint.child == GROUND:
            raise joint.tag.fault("its child is the ground; swap parent and child")
        if joint.child in out:
            first, body = out[joint.child].tag, model.by_path[joint.child]
            raise joint.tag.fault(
                f"the body {body.name!r} is the child of {first.name!r} (line {first.line}) "
                "already: a closed loop cannot be imported"
            )
        out[joint.child] = joint
    return out


def _branches(
    bodies: Mapping[str, OsimTag], joints: Mapping[str, Joint]
) -> dict[str, tuple[str, ...]]:
    branches: dict[str, list[str]] = {above: [] for above in (GROUND, *bodies)}
    for path, tag in bodies.items():
        if path not in joints:
            raise tag.fault("no joint has this body as its child; join it to another or the ground")
        branches[joints[path].parent].append(path)
    depth, reached = {GROUND: 0}, [GROUND]
    for path in reached:
        reached += branches[path]
        depth |= dict.fromkeys(branches[path], depth[path] + 1)
        if depth[path] > MOST_IN_CHAIN:
            raise bodies[path].fault(f"more than {MOST_IN_CHAIN} bodies hang from one another")
    for path, tag in bodies.items():
        if path not in depth:
            raise tag.fault("its joints lead in a circle and never to the ground")
    return {path: tuple(below) for path, below in branches.items()}


def _coordinate_losses(joint: Joint) -> list[Loss]:
    out = []
    for c in joint.coordinates:
        if c.locked:
            out.append(change_of(c.tag, f"locked: rigid at {c.default:.6g}, no joint of MuJoCo"))
        elif c.clamped:
            why = "clamped: its range is written for information; MuJoCo does not keep it"
            out.append(change_of(c.tag, why))
        if c.tag.flag("prescribed", False):
            out.append(change_of(c.tag, "prescribed: it moves freely here"))
    return out


def _body(tag: OsimTag, moving: bool) -> tuple[OsimBody, list[Loss]]:
    mass, centre = tag.value("mass"), np.array(tag.values("mass_center", (0.0,) * 3))
    xx, yy, zz, xy, xz, yz = tag.values("inertia", (0.0,) * 6)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    principal = np.linalg.eigvalsh(inertia)
    least = -SLACK * max(abs(principal[-1]), abs(principal[0]))
    losses = []
    short = principal[2] - principal[0] - principal[1]
    if mass >= 0 and principal[0] > 0 and -least < short <= MOST_SHORT * principal[2]:
        inertia = inertia + short * np.eye(3)
        losses.append(
            change_of(
                tag,
                f"its moments of inertia are those of no solid ({principal[2]:g} of more than "
                f"{principal[0]:g} + {principal[1]:g}): {short:g} kg m2 more about each axis",
            )
        )
    elif mass < 0 or principal[0] < least or short > -least:
        raise tag.fault(
            f"no solid has the mass {mass:g} and the principal moments of inertia "
            f"{principal[0]:g}, {principal[1]:g}, {principal[2]:g}"
        )
    if moving and mass < LEAST_MASS:
        losses.append(
            change_of(tag, f"mass {mass:g} kg: {LEAST_MASS:g} kg here; MuJoCo needs some")
        )
        mass = LEAST_MASS
    if mass > 0 and principal[0] < LEAST_INERTIA:
        why = f"least moment of inertia {principal[0]:g} kg m2: {LEAST_INERTIA:g} more about each"
        losses.append(change_of(tag, f"{why} axis; MuJoCo needs some"))
        inertia = inertia + LEAST_INERTIA * np.eye(3)
    return OsimBody(tag, mass, centre, inertia), losses


def _unique(tags: list[OsimTag]) -> None:
    first: dict[str, OsimTag] = {}
    for tag in tags:
        other = first.setdefault(tag.name, tag)
        if other is not tag:
            raise tag.fault(f"the name is taken by the {tag.kind} in line {other.line}; rename one")
