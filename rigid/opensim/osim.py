"""An .osim as MJCF, with what MJCF cannot hold beside it and a list of all that was lost."""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from cosim.errors import InputError, nearest_names
from cosim.files import output_file
from rigid.chain.joint_torques import JointLaw
from rigid.mjcf.read import NamedJoint, PartNames
from rigid.opensim.components import Components, components
from rigid.opensim.forces import (
    PATH,
    CoordinateLimit,
    Property,
    Spring,
    law_of,
    muscle_properties,
    read_limit,
    read_spring,
)
from rigid.opensim.functions import quartic, read_function
from rigid.opensim.layout import read_model
from rigid.opensim.losses import Loss, change_of, drop, report, unasked, unread
from rigid.opensim.mjcf import Coupling, MjcfSite, mjcf_xml
from rigid.opensim.paths import Tendon, UnaskedPathError, UnusablePathError, Way, read_way
from rigid.opensim.skeleton import UNASKED, OsimSkeleton, read_skeleton
from rigid.opensim.tendons import Postures, coupling_of, made_tendon, off
from rigid.opensim.xml import OsimTag

OTHER_PATHS = ("FunctionBasedPath", "Scholz2015GeometryPath")
"""OpenSim's kinds of paths that are not imported."""
STRETCHED = ("Ligament", "Blankevoort1991Ligament", "PathSpring", "ExpressionBasedPathForce")
"""Forces along a path that nothing controls."""
LENGTH_TOLERANCE = 1e-4
"""m, by which the length of a muscle may be off."""
EXACT = 1e-6
"""m, up to which a length is taken to be OpenSim's."""
GRAVITY = (0.0, -9.80665, 0.0)
"""m/s2, OpenSim's default."""


@dataclass(frozen=True)
class Muscle:
    """An imported actuator along a path: OpenSim's kind and the numbers that its file states."""

    kind: str
    properties: dict[str, Property]


@dataclass(frozen=True)
class CoordinateDefault:
    """A coordinate's default value and range, rad or m."""

    default: float
    range: tuple[float, float]
    clamped: bool
    locked: bool


@dataclass(frozen=True)
class Imported:
    """An imported model; tendons and actuators of the MJCF have the muscles' names, its joints the
    coordinates'."""

    source: str
    version: int
    xml: str
    coordinates: Mapping[str, CoordinateDefault]
    muscles: Mapping[str, Muscle]
    limits: Mapping[str, CoordinateLimit]
    springs: Mapping[str, Spring]
    couplings: Mapping[str, Coupling]
    """By joint of the MJCF that is no coordinate, or a coordinate that follows another."""
    losses: tuple[Loss, ...]
    path_actuators: int = 0
    """Muscles and actuators along a path in the file that were asked for and apply a force,
    imported or not."""
    beyond: Mapping[str, float] = field(default_factory=dict)
    """By how much (m) the length is off, of each muscle left out for more than the tolerance."""

    def law(self, joints: tuple[str, ...]) -> JointLaw:
        """The limits and springs as our own joint law; see `law_of`."""
        return law_of(joints, self.limits, self.springs)


def import_osim(
    path: Path, tolerance: float = LENGTH_TOLERANCE, only: Sequence[str] = ()
) -> Imported:
    """Import an OpenSim model: MJCF text, muscles, limits, and a list of all that was dropped or
    changed.  A muscle whose length would be off by more than `tolerance` (m) is dropped.

    `only` names bodies and muscles, with * and ? for letters: of the muscles those, where one is
    named, and of the bodies those and what carries them, where one is named.

    Raises InputError (naming file, line and element) for what cannot be read or imported, and for a
    name that the model does not hold.

    >>> from importlib.resources import as_file, files
    >>> from rigid.opensim.osim import import_osim
    >>> with as_file(files("cases") / "data" / "finger.osim") as path:
    ...     finger = import_osim(path)
    >>> list(finger.coordinates)
    ['MCP_abduction', 'MCP', 'PIP', 'DIP']
    """
    model, version, rewritten = read_model(path)
    parts = components(model)
    parts.of_kind("Ground")
    bodies, chosen = _asked(parts, only)
    skeleton = read_skeleton(parts, bodies)
    taken, count, losses = _muscles(parts, skeleton, chosen)
    couplings, tied = _couplings(parts, skeleton)
    tendons, beyond, changed = _tendons(taken, skeleton, couplings, tolerance)
    losses += changed
    couplings |= {
        slide.name: coupling_of(slide, skeleton)
        for name, tendon in tendons.items()
        for slide in tendon.slides(name)
    }
    numbers = {name: muscle_properties(taken[name].tag) for name in tendons}
    muscles = {name: Muscle(taken[name].tag.kind, of) for name, (of, _) in numbers.items()}
    losses += [loss for _, made_up in numbers.values() for loss in made_up]
    limits, springs, more = _passive(parts, skeleton)
    markers, lost = _markers(parts, skeleton)
    made_up = [change_of(*pair) for pair in parts.made_up]
    losses = [*rewritten, *made_up, *skeleton.losses, *losses, *more, *tied, *lost]
    gravity = model.values("gravity", GRAVITY)
    xml = mjcf_xml(model.name or "model", gravity, skeleton, tendons, markers, couplings)
    _check_compiles(xml, str(path))
    coordinates = {
        c.name: CoordinateDefault(c.default, c.range, c.clamped, c.locked)
        for c in skeleton.coordinates.values()
    }
    all_losses = (*losses, *unread(model))
    return Imported(
        path.name,
        version,
        xml,
        coordinates,
        muscles,
        limits,
        springs,
        couplings,
        all_losses,
        count,
        beyond,
    )


def part_names(path: Path) -> PartNames:
    """What an OpenSim model calls its bodies, coordinates, markers and actuators along a path, the
    coordinates as hinges of no body.  Raises InputError for what cannot be read."""
    model, _, _ = read_model(path)
    tags = components(model).by_path.values()
    bodies, markers = (tuple(t.name for t in tags if t.kind == kind) for kind in ("Body", "Marker"))
    ranges = {t.name: t.values("range", (0.0, 0.0)) for t in tags if t.kind == "Coordinate"}
    joints = {name: NamedJoint("", "", (low, high)) for name, (low, high) in ranges.items()}
    return PartNames(bodies, joints, markers, tuple(t.name for t in tags if _has_path(t)))


def _asked(model: Components, only: Sequence[str]) -> tuple[frozenset[str], frozenset[str]]:
    """The paths of the bodies and of the muscles that names with * and ? stand for."""
    bodies = {p: t.name for p, t in model.by_path.items() if t.kind == "Body"}
    muscles = {p: t.name for p, t in model.by_path.items() if _has_path(t)}
    for pattern in only:
        if not fnmatch.filter([*bodies.values(), *muscles.values()], pattern):
            near = nearest_names(pattern, [*bodies.values(), *muscles.values()], 3)
            hint = f"; near it are {', '.join(near)}" if near else ""
            raise InputError(f"no body or muscle of the model is named {pattern!r}{hint}")
    asked = [
        frozenset(p for p, name in named.items() for o in only if fnmatch.fnmatchcase(name, o))
        for named in (bodies, muscles)
    ]
    return asked[0], asked[1]


def _paths(tag: OsimTag) -> list[OsimTag]:
    """The paths that a force holds, of any kind."""
    holders = (tag, *(child for child in tag.children if child.kind == "path"))
    return [c for h in holders for c in h.children if c.kind in (PATH, *OTHER_PATHS)]


def _has_path(tag: OsimTag) -> bool:
    """Whether it is a muscle or an actuator along a path."""
    return tag.kind not in STRETCHED and bool(_paths(tag))


@dataclass(frozen=True)
class _Taken:
    """A muscle or actuator along a path that was asked for and can be read."""

    tag: OsimTag
    path: OsimTag
    way: Way


def _muscles(
    model: Components, skeleton: OsimSkeleton, asked: frozenset[str]
) -> tuple[dict[str, _Taken], int, list[Loss]]:
    """The muscles and actuators along a path, how many the file has of those asked for (all, where
    none is named) and that apply a force, and what is lost of them."""
    taken: dict[str, _Taken] = {}
    losses: list[Loss] = []
    count = 0
    for place, tag in model.by_path.items():
        paths = _paths(tag)
        if not paths:
            continue
        if tag.kind in STRETCHED:
            losses.append(drop(tag, "its stretch alone makes it pull; the force is not applied"))
            continue
        if asked and place not in asked:
            losses.append(unasked(tag))
            continue
        count += 1
        if len(paths) > 1:
            raise paths[1].fault(f"a second path; the first is in line {paths[0].line}")
        (path,) = paths
        if path.kind != PATH:
            losses.append(drop(tag, f"its path is a {path.kind}; only a {PATH} is imported"))
            continue
        if tag.name in taken:
            raise tag.fault("another muscle has this name; rename one")
        if not tag.flag("appliesForce", True):
            losses.append(drop(tag, "it applies no force (appliesForce is false)"))
            count -= 1
            continue
        try:
            taken[tag.name] = _Taken(tag, path, read_way(path, model, skeleton))
        except UnaskedPathError:
            losses.append(unasked(tag))
            count -= 1
        except UnusablePathError as reason:
            losses.append(drop(tag, f"{reason}; a tendon here would have another length"))
    return taken, count, losses


def _tendons(
    taken: Mapping[str, _Taken],
    skeleton: OsimSkeleton,
    couplings: Mapping[str, Coupling],
    tolerance: float,
) -> tuple[dict[str, Tendon], dict[str, float], list[Loss]]:
    """The tendons of the muscles, by how much (m) the length of each that is left out is off, and
    what is lost or changed."""
    unlike = {name: each.way for name, each in taken.items() if not each.way.is_plain}
    postures = Postures(skeleton, couplings, unlike.values()) if unlike else None
    made = {name: made_tendon(name, way, postures) for name, way in unlike.items() if postures}
    errors = off(made, postures) if postures else {}
    tendons: dict[str, Tendon] = {}
    beyond: dict[str, float] = {}
    losses: list[Loss] = []
    for name, each in taken.items():
        if name in made:
            size = f"its length is at most {1e3 * errors[name]:.2g} mm off OpenSim's path"
            why = "; ".join(
                [f"{size}, pulled tight, over the ranges of motion", *made[name].changes]
            )
            if errors[name] > tolerance:
                beyond[name] = errors[name]
                losses.append(
                    drop(each.tag, f"{why}: more than the {1e3 * tolerance:g} mm allowed")
                )
                continue
            if errors[name] > EXACT or made[name].changes:
                losses.append(change_of(each.tag, why))
        tendons[name] = made[name].tendon if name in made else Tendon.straight(each.way)
        each.tag.used = each.path.used = True
        for use in each.way.uses:
            use.surface.tag.used = True
        losses += [change_of(*change) for change in each.way.changes]
    return tendons, beyond, losses


def _passive(
    model: Components, skeleton: OsimSkeleton
) -> tuple[dict[str, CoordinateLimit], dict[str, Spring], list[Loss]]:
    limits: dict[str, CoordinateLimit] = {}
    springs: dict[str, Spring] = {}
    losses: list[Loss] = []
    for tag in model.of_kind("CoordinateLimitForce", "SpringGeneralizedForce"):
        coordinate = tag.word("coordinate", "")
        if coordinate in skeleton.unasked:
            losses.append(unasked(tag))
            continue
        if coordinate not in skeleton.coordinates:
            if skeleton.left_out and coordinate in {c.name for c in model.of_kind("Coordinate")}:
                losses.append(drop(tag, "its coordinate is of a joint that is left out"))
                continue
            raise tag.fault(f"<coordinate>: no coordinate is named {coordinate!r}")
        if coordinate not in skeleton.moving or not tag.flag("appliesForce", True):
            losses.append(drop(tag, "its coordinate is locked, or it applies no force"))
        elif tag.kind == "CoordinateLimitForce":
            limits[tag.name] = read_limit(tag, skeleton.moving[coordinate])
            losses.append(change_of(tag, "no force in the MJCF; its numbers are in the JSON file"))
        else:
            springs[tag.name] = read_spring(tag)
            losses.append(change_of(tag, "no force in the MJCF; its numbers are in the JSON file"))
    return limits, springs, losses


def _couplings(model: Components, skeleton: OsimSkeleton) -> tuple[dict[str, Coupling], list[Loss]]:
    """What follows a coordinate, by joint of MuJoCo: axes of joints, and coordinates that OpenSim's
    couplers tie to others."""
    out: dict[str, Coupling] = {}
    losses: list[Loss] = []
    for screw in skeleton.followers:
        out[screw.name] = coupling_of(screw, skeleton)
        tag = skeleton.coordinates[screw.coordinate].tag
        losses.append(change_of(tag, _follows(screw.name, screw.slide, out[screw.name].error)))
    for tag in model.of_kind("CoordinateCouplerConstraint"):
        if not tag.flag("isEnforced", True):
            losses.append(drop(tag, "it is not enforced"))
            continue
        by = tag.word("independent_coordinate_names", "").split()
        name, function = tag.word("dependent_coordinate_name", ""), _inner_function(tag)
        if {*by, name} & skeleton.unasked:
            losses.append(unasked(tag))
            continue
        if len(by) != 1 or not {*by, name} <= set(skeleton.moving) or function is None:
            why = "a coordinate is locked or left out, or follows several"
            losses.append(drop(tag, f"{why}: the coordinates that it ties together are free here"))
            continue
        low, high = skeleton.coordinates[by[0]].range
        curve = read_function(function).times(tag.value("scale_factor", 1.0))
        found = quartic(curve, low, high)
        out[name] = Coupling(by[0], found.coefficients, found.error)
        losses.append(change_of(tag, _follows(name, skeleton.moving[name], found.error)))
    return out, losses


def _inner_function(tag: OsimTag) -> OsimTag | None:
    holder = tag.one("coupled_coordinates_function")
    if holder is None or len(holder.children) != 1:
        return None
    holder.used = True
    return holder.children[0]


def _follows(joint: str, slide: bool, error: float) -> str:
    size = f"{1e3 * error:.2g} mm" if slide else f"{np.degrees(error):.2g} deg"
    return f"MuJoCo's joint {joint} follows by a quartic, at most {size} off over the range"


def _markers(model: Components, skeleton: OsimSkeleton) -> tuple[list[MjcfSite], list[Loss]]:
    out, losses = [], []
    for tag in model.of_kind("Marker"):
        frame = model.frame(tag, "parent_frame")
        position = frame.transform.at(np.array(tag.values("location", (0.0,) * 3)))
        tag.flag("fixed", False)
        if skeleton.left_out.get(frame.body) == UNASKED:
            losses.append(unasked(tag))
        elif frame.body in skeleton.left_out:
            losses.append(drop(tag, "its body is left out"))
        else:
            out.append(MjcfSite(tag.name, frame.body, position))
    return out, losses


def _check_compiles(xml: str, file: str) -> None:
    try:
        mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise InputError(f"{file}: MuJoCo does not take the model that results: {error}") from error


def write_import(imported: Imported, out: Path) -> tuple[Path, Path, Path]:
    """Writes the MJCF, and beside it the numbers that it cannot hold (.json) and the list of what
    was dropped and changed (.losses.txt); their paths.

    Raises InputError where they cannot be written."""
    beside, losses = out.with_suffix(".json"), out.with_suffix(".losses.txt")
    if out.suffix != ".xml":
        raise InputError(f"{out}: the MJCF's name must end in .xml")
    data = asdict(imported)
    del data["xml"]
    texts = (
        imported.xml,
        json.dumps(data, indent=1, allow_nan=False) + "\n",
        "\n".join(report(imported.losses)) + "\n",
    )
    with output_file(out) as xml, output_file(beside) as numbers, output_file(losses) as lost:
        for path, text in zip((xml, numbers, lost), texts, strict=True):
            path.write_text(text, encoding="utf-8")
    return out, beside, losses
