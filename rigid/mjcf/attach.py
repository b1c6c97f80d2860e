"""A hood on a finger of somebody's hand model, in place of the fixed paths of its extensors.

A muscle keeps its path up to the metacarpal, its actuator and its tendon's name.  From there it
pulls a junction that slides along the path's last line, where the hood takes over: the junction's
way is the muscle's excursion, so that arms which the hood has before its junctions (at the MCP) go
into the bands.  A hood without arms in abduction gets those of the paths that it takes away.
Ranges of a muscle's length shift by what its tendon is longer or shorter in the reference posture.

A model's `<default>` classes are first stated on its own elements, so that they change nothing
that is added to it.  MuJoCo's writer leaves out of an element what is as its class says, whatever
attributes there are; putting the class's attributes back is its inverse and needs no list of them.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.mjcf.bounds import check_bounds
from rigid.mjcf.hood import (
    FOLLOWER,
    Band,
    Follower,
    HoodParts,
    Place,
    Polynomial,
    add_parts,
    compile_model,
    section,
    slides_at_rest,
)
from rigid.mjcf.tendons import actuators_of, greatest_force
from rigid.model import vector

REACH = 0.045
"""m, from a muscle's last point on the hand to its junction."""
FIRM_BAND = 1e5
"""N/m, of a muscle that the hood leads to the joints without a spring."""
NUDGE, LEAST_ARM = 1e-3, 1e-4
"""rad and m: a tendon extends a joint that it has such an arm at."""
BENT = np.radians(np.linspace(0.0, 90.0, 7))
"""rad, of a joint at which arms are looked at."""
ACROSS = 0.5
"""Cosine between the flexion axes of a finger's joints below which they are no row."""
FOLDERS = ("meshdir", "texturedir", "assetdir")


@dataclass(frozen=True)
class Target:
    """Which parts of a hand model are a finger's."""

    joints: Mapping[str, str]
    """From our joints to the model's, with a minus where it turns the other way; those too that the
    hood does not cross."""
    muscles: Mapping[str, str]
    """From the hood's muscles to the model's tendons."""
    metacarpal: str
    proximal: str
    """Bodies of the model."""
    prefix: str
    """Before all names that are added."""


@dataclass(frozen=True)
class Attached:
    """A hand with a hood."""

    root: ET.Element
    parts: HoodParts
    """By the model's names."""
    target: Target
    told: tuple[str, ...]
    """What was changed and what could not be."""
    strengths: Mapping[str, float]
    """The greatest force (N) of each of the hood's muscles for which the model states one."""


def attach_hood(path: Path, parts: HoodParts, target: Target) -> Attached:
    """The hand model of a file with a hood on one finger.  Raises InputError for what is no model,
    joints that are no row from hand to tip, and where no muscle of the hood is there."""
    check_bounds(path)
    spec = _load(path)
    old = spec.compile()
    _check_row(path, old, target)
    root = _tree(path, spec)
    _set_folders(root, path, spec)
    if any((tag.get("name") or "").startswith(target.prefix) for tag in root.iter("body")):
        raise InputError(f"{path}: has a hood on this finger; take the hand without it")
    there = {m: t for m, t in target.muscles.items() if m in parts.muscles}
    if not there:
        raise InputError(
            f"{path}: has none of the hood's muscles {', '.join(parts.muscles)} by a name that is "
            'known; say which is which: a file of lines like EDC = "EDCI", and --names FILE'
        )
    told = ["written anew by MuJoCo: what the file includes is in it, comments are not"]
    told += [
        f"left out: the hood's {m}, which the model has not by a known name"
        for m in parts.muscles
        if m not in there
    ]
    kept, words = _with_abduction(_only(parts, there), old, there, target)
    told += words
    scaled = _slower(kept, spec.compiler.boundmass)
    ours = _rename(_at_excursions(scaled), target)
    data = mujoco.MjData(old)
    mujoco.mj_forward(old, data)
    places = {}
    for muscle, tendon in there.items():
        junction = f"{target.prefix}{muscle}_junction"
        places[junction], changed = _cut(root, old, data, tendon, junction, target)
        told.append(changed)
    told += _kept(old, set(there.values()), target)
    add_parts(root, ours, places)
    _end(root, old, ours, there, target)
    pulls = [actuators_of(old, t) for t in there.values()]
    told.append(
        f"kept: the actuators {', '.join(name for name in pulls if name)} with their names; they "
        "pull tendons, so that a bridge that asks for an actuator by its joint's name (ROS 2's "
        "mujoco_ros2_control) finds none of them: command them by their own"
    )
    most = {m: greatest_force(old, old.tendon(t).id) for m, t in there.items()}
    return Attached(
        root,
        ours,
        replace(target, muscles=there),
        tuple(told),
        {m: force for m, force in most.items() if force},
    )


def add_note(root: ET.Element, name: str, text: str) -> None:
    """Keep a text in a model, by a name."""
    ET.SubElement(section(root, "custom"), "text", name=name, data=text)


def note_of(path: Path, name: str) -> str | None:
    """The text that a model keeps by a name; None where there is none."""
    spec = _load(path)
    return next((text.data for text in spec.texts if text.name == name), None)


def write_attached(root: ET.Element, out: Path) -> str:
    """The text of an attached model for a file at `out`, whose folders of meshes are stated from
    there."""
    compiler = root.find("compiler")
    assert compiler is not None
    for name in FOLDERS:
        if name in compiler.attrib:
            there = os.path.relpath(compiler.attrib[name], out.resolve().parent)
            compiler.set(name, there)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _load(path: Path) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, FileNotFoundError, mujoco.FatalError) as error:
        raise InputError(f"{path}: is no MuJoCo model that can be read: {error}") from error


def _tree(path: Path, spec: mujoco.MjSpec) -> ET.Element:
    """The model's elements, without classes of defaults, which would speak of what is added; texts
    with quotation marks, which MuJoCo writes as it does not read them, as attributes."""
    try:
        root = ET.fromstring(spec.to_xml())
    except ET.ParseError as error:
        raise InputError(
            f"{path}: MuJoCo writes it as no XML ({error}): a name or text of it has a character "
            "that none may have, such as a control character; take it out"
        ) from error
    state_defaults(root)
    for tag in root.iter("text"):
        if "data" not in tag.attrib:
            tag.set("data", tag.text or " ")
            tag.text = None
    return root


def _set_folders(root: ET.Element, path: Path, spec: mujoco.MjSpec) -> None:
    """State the folders of meshes and textures from the root of the disk."""
    compiler = root.find("compiler")
    if compiler is None:
        compiler = ET.SubElement(root, "compiler")
    here = path.resolve().parent
    for name, stated in (("meshdir", spec.meshdir), ("texturedir", spec.texturedir)):
        compiler.set(name, str((here / stated).resolve()))


def _only(parts: HoodParts, muscles: Mapping[str, str]) -> HoodParts:
    """The parts without muscles that are not there, their junctions and what hangs on them."""
    gone = {
        j for m, w in parts.muscles.items() if m not in muscles for j in w if j in parts.junctions
    }
    return replace(
        parts,
        muscles={m: w for m, w in parts.muscles.items() if m in muscles},
        junctions=tuple(j for j in parts.junctions if j not in gone),
        bands={n: b for n, b in parts.bands.items() if not gone & set(b.weights)},
    )


def _slower(parts: HoodParts, mass: float) -> HoodParts:
    """The parts with followers that move so much less that they resist the joints no more, of a
    model whose compiler lets no body weigh less than `mass` kg."""
    if mass <= FOLLOWER:
        return parts
    less = (FOLLOWER / mass) ** 0.5
    followers = {
        name: Follower(f.weights, _times(f.polynomial, less)) for name, f in parts.followers.items()
    }

    def more(weights: Mapping[str, float]) -> dict[str, float]:
        return {name: w / less if name in followers else w for name, w in weights.items()}

    return replace(
        parts,
        muscles={muscle: more(weights) for muscle, weights in parts.muscles.items()},
        bands={name: replace(b, weights=more(b.weights)) for name, b in parts.bands.items()},
        followers=followers,
    )


def _times(polynomial: Polynomial, factor: float) -> Polynomial:
    a, b, c, d, e = polynomial
    return a * factor, b * factor, c * factor, d * factor, e * factor


def _at_excursions(parts: HoodParts) -> HoodParts:
    """The same parts with junctions `MUSCLE_junction` whose places are the muscles' excursions."""
    by_junction, firm = {}, {}
    for muscle, weights in parts.muscles.items():
        junction = f"{muscle}_junction"
        rest = {name: w for name, w in weights.items() if name not in parts.junctions}
        if set(weights) & set(parts.junctions):
            by_junction[junction] = rest
        else:
            firm[f"{muscle}_firm"] = Band({junction: 1.0} | rest, 0.0, FIRM_BAND)
    bands = {
        name: replace(b, weights=_with_direct(b.weights, by_junction))
        for name, b in parts.bands.items()
    }
    muscles = {muscle: {f"{muscle}_junction": -1.0} for muscle in parts.muscles}
    return replace(
        parts,
        muscles=muscles,
        junctions=tuple(f"{muscle}_junction" for muscle in muscles),
        bands=bands | firm,
    )


def _with_direct(
    weights: Mapping[str, float], direct: Mapping[str, Mapping[str, float]]
) -> dict[str, float]:
    out = dict(weights)
    for junction, arms in direct.items():
        for name, weight in arms.items():
            out[name] = out.get(name, 0.0) + weights.get(junction, 0.0) * weight
    return {name: weight for name, weight in out.items() if weight}


def _rename(parts: HoodParts, target: Target) -> HoodParts:
    """The parts by the model's joints, and names of their own with the prefix."""

    def with_names(weights: Mapping[str, float]) -> dict[str, float]:
        out = {}
        for name, weight in weights.items():
            theirs = target.joints.get(name)
            if theirs is None:
                out[target.prefix + name] = weight
            else:
                out[theirs.removeprefix("-")] = -weight if theirs.startswith("-") else weight
        return out

    return HoodParts(
        {muscle: with_names(w) for muscle, w in parts.muscles.items()},
        tuple(target.prefix + name for name in parts.junctions),
        {
            target.prefix + n: replace(b, weights=with_names(b.weights))
            for n, b in parts.bands.items()
        },
        {
            target.prefix + name: Follower(with_names(f.weights), f.polynomial)
            for name, f in parts.followers.items()
        },
    )


def _check_row(path: Path, model: mujoco.MjModel, target: Target) -> None:
    """Check that the joints follow each other from the hand to the tip and bend one way.  Raises
    InputError."""
    data, joints = mujoco.MjData(model), target.joints
    mujoco.mj_kinematics(model, data)
    plain = {ours: model.joint(theirs.removeprefix("-")) for ours, theirs in joints.items()}
    body = {ours: int(joint.bodyid[0]) for ours, joint in plain.items()}
    body |= {"metacarpal": model.body(target.metacarpal).id}
    body |= {"proximal": model.body(target.proximal).id}
    called = {ours: f"{ours} ({joint.name})" for ours, joint in plain.items()}
    called |= {"metacarpal": f"metacarpal ({target.metacarpal})"}
    called |= {"proximal": f"proximal ({target.proximal})"}
    row = [("metacarpal", "MCP"), ("metacarpal", "MCP_abduction"), ("MCP", "PIP"), ("PIP", "DIP")]
    row += [("MCP_abduction", "PIP"), ("metacarpal", "proximal"), ("proximal", "PIP")]
    for near, far in row:
        if {near, far} <= set(body) and body[near] not in _carrying(model, body[far]):
            raise InputError(
                f"{path}: {called[far]} does not lie beyond {called[near]}, from the hand to the "
                "fingertip; say which part is which: --names FILE"
            )
    sign = {ours: -1.0 if theirs.startswith("-") else 1.0 for ours, theirs in joints.items()}
    axis = {ours: sign[ours] * data.xaxis[joint.id] for ours, joint in plain.items()}
    for far in ("PIP", "DIP"):
        if {"MCP", far} <= set(axis) and (alike := float(axis["MCP"] @ axis[far])) < ACROSS:
            how = "the other way than" if alike < -ACROSS else "across"
            raise InputError(
                f"{path}: {called[far]} turns {how} {called['MCP']}; all flex where they are "
                f'positive: write {far} = "-NAME" of one that does not, with --names FILE'
            )


def _carrying(model: mujoco.MjModel, body: int) -> list[int]:
    """The bodies that a body hangs on, the world last."""
    out = []
    while body:
        body = int(model.body_parentid[body])
        out.append(body)
    return out


def hand_arms(
    model: mujoco.MjModel,
    joints: Mapping[str, str],
    tendons: Mapping[str, str],
    posture: Mapping[str, float],
    joint: str,
) -> dict[str, float]:
    """The arms (m) of tendons about one of our joints, positive as they turn it to its positive
    side, at angles (rad) of a finger's joints, the others in the reference posture.  `joints` and
    `tendons`: from our names to the model's."""
    data, length = mujoco.MjData(model), []
    for step in (-NUDGE, NUDGE):
        for ours, theirs in joints.items():
            angle = posture.get(ours, 0.0) + (step if ours == joint else 0.0)
            sign = -1.0 if theirs.startswith("-") else 1.0
            data.joint(theirs.removeprefix("-")).qpos[0] = sign * angle
        mujoco.mj_forward(model, data)
        length.append({ours: float(data.tendon(t).length[0]) for ours, t in tendons.items()})
    return {ours: (length[0][ours] - length[1][ours]) / (2 * NUDGE) for ours in tendons}


def _with_abduction(
    parts: HoodParts, old: mujoco.MjModel, tendons: Mapping[str, str], target: Target
) -> tuple[HoodParts, list[str]]:
    """The parts with the arms in abduction that the muscles' paths had, the mean over the MCP's
    flexion, where the hood has none; and what became of them, in words."""
    bands = (band.weights for band in parts.bands.values())
    followers = (follower.weights for follower in parts.followers.values())
    sums = (*parts.muscles.values(), *bands, *followers)
    crossed = {name for weights in sums for name in weights}
    if "MCP_abduction" in crossed or "MCP_abduction" not in target.joints:
        return parts, []
    found = [
        hand_arms(old, target.joints, tendons, {"MCP": float(bend)}, "MCP_abduction")
        for bend in BENT
    ]
    arms = {m: np.array([at[m] for at in found]) for m in tendons}
    muscles = {
        m: {**weights, "MCP_abduction": -float(arms[m].mean())}
        for m, weights in parts.muscles.items()
    }
    words = ", ".join(
        f"{m} {1e3 * a.mean():+.1f} mm ({1e3 * a.min():+.1f} to {1e3 * a.max():+.1f})"
        for m, a in arms.items()
    )
    return replace(parts, muscles=muscles), [
        "kept: arms in abduction, which the hood has not: the mean of those that the paths had "
        f"over 90 degrees of MCP flexion (their range), radial positive: {words}"
    ]


def _cut(
    root: ET.Element,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    tendon: str,
    junction: str,
    target: Target,
) -> tuple[Place, str]:
    """End a tendon at its junction, which lies in line with its path: the junction's place, and
    what was done in words.  Raises InputError for a path that cannot be cut."""
    element = next((t for t in root.iter("spatial") if t.get("name") == tendon), None)
    if element is None:
        raise InputError(f"tendon {tendon}: is no path over bones, which a hood could take over")
    kept, left = list[ET.Element](), list(element)
    while left and not _on_finger(model, left[0], target.proximal):
        kept.append(left.pop(0))
    for tag in [
        tag for tag in kept if tag.tag == "pulley"
    ]:  # strands that the hood brings together
        element.remove(tag)
        kept.remove(tag)
    beyond = next((tag for tag in left if tag.tag == "site"), None)
    while kept and kept[-1].tag != "site":
        left.insert(0, kept.pop())
    if not kept or beyond is None:
        raise InputError(f"tendon {tendon}: does not run from the hand onto the finger")
    first, second = (data.site(tag.get("site")).xpos for tag in (kept[-1], beyond))
    axis = (second - first) / np.linalg.norm(second - first)
    bone = data.body(target.metacarpal)
    turn = bone.xmat.reshape(3, 3)
    for tag in left:
        element.remove(tag)
    ET.SubElement(element, "site", site=junction)
    place = Place(
        target.metacarpal,
        vector((first + REACH * axis - bone.xpos) @ turn),
        vector(-axis @ turn),
    )
    points = sum(tag.tag == "site" for tag in left)
    words = f"ends at a junction on {target.metacarpal}; its {points} points beyond are the hood's"
    return place, f"changed: {tendon} {words}"


def _on_finger(model: mujoco.MjModel, tag: ET.Element, proximal: str) -> bool:
    """Whether a point or surface of a path is on the finger."""
    if tag.tag == "site":
        body = int(model.site(tag.get("site")).bodyid[0])
    elif tag.tag == "geom":
        body = int(model.geom(tag.get("geom")).bodyid[0])
    else:
        return False
    while body:
        if model.body(body).name == proximal:
            return True
        body = int(model.body_parentid[body])
    return False


def _kept(model: mujoco.MjModel, replaced: set[str], target: Target) -> Iterator[str]:
    """Tendons of the model over the back of the finger that stay as they are."""
    data, extends = mujoco.MjData(model), np.zeros(model.ntendon, dtype=bool)
    for theirs in (target.joints[joint] for joint in ("PIP", "DIP") if joint in target.joints):
        way = -NUDGE if theirs.startswith("-") else NUDGE
        lengths = []
        for step in (0.0, way):
            mujoco.mj_resetData(model, data)
            data.joint(theirs.removeprefix("-")).qpos[0] += step
            mujoco.mj_forward(model, data)
            lengths.append(data.ten_length.copy())
        extends |= lengths[1] - lengths[0] > LEAST_ARM * NUDGE
    for t in np.flatnonzero(extends):
        if (name := model.tendon(int(t)).name) not in replaced:
            yield f"kept: {name} with its fixed path over the finger; the hood has no such muscle"


def _end(
    root: ET.Element,
    old: mujoco.MjModel,
    parts: HoodParts,
    muscles: Mapping[str, str],
    target: Target,
) -> None:
    """Shift the ranges of the muscles' lengths, and give keyframes the slides."""
    frames = root.find("keyframe")
    if frames is not None:
        root.remove(frames)
    model = compile_model(root)
    before, after = mujoco.MjData(old), mujoco.MjData(model)
    after.qpos[:] = _with_slides(old, model, parts, old.qpos0)
    mujoco.mj_forward(old, before)
    mujoco.mj_forward(model, after)
    actuators = root.find("actuator")
    for tag in () if actuators is None else actuators:
        tendon = tag.get("tendon")
        if tendon in muscles.values() and "lengthrange" in tag.attrib:
            more = float(after.tendon(tendon).length[0] - before.tendon(tendon).length[0])
            low, high = map(float, tag.attrib["lengthrange"].split())
            tag.set("lengthrange", f"{low + more!r} {high + more!r}")
    if frames is not None:
        root.append(frames)
        for tag in frames:
            stated = tag.get("qpos")
            at = old.qpos0 if stated is None else np.array(stated.split(), dtype=float)
            tag.set("qpos", " ".join(repr(float(x)) for x in _with_slides(old, model, parts, at)))
            tag.attrib.pop("qvel", None)


def _with_slides(
    old: mujoco.MjModel, model: mujoco.MjModel, parts: HoodParts, stated: Array
) -> Array:
    """The positions (nq,) of the model with a hood: those of the one without, and followers and
    junctions where the hood is about to bear."""
    position = model.qpos0.copy()
    ours = {*parts.junctions, *parts.followers}
    theirs = [j for j in range(model.njnt) if model.joint(j).name not in ours]
    for j, to in enumerate(theirs):  # joints keep their order
        start, place, width = old.jnt_qposadr[j], model.jnt_qposadr[to], len(old.joint(j).qpos0)
        position[place : place + width] = stated[start : start + width]
    named = {model.joint(j).name: float(position[model.jnt_qposadr[j]]) for j in theirs}
    for name, value in slides_at_rest(parts, named).items():
        position[model.joint(name).qposadr[0]] = value
    return position


MAIN = "main"
OF_SECTION = {"equality": "equality", "tendon": "tendon", "actuator": "general"}
"""The kind under which a class speaks of all elements of a section; else it is the element's."""
SECTIONS = ("asset", "contact", "deformable", *OF_SECTION)
Facts = dict[str, dict[str, str]]
"""Attributes by kind."""


def state_defaults(root: ET.Element) -> None:
    """Put the attributes of all classes onto the elements of a model that MuJoCo wrote, and take
    the classes away."""
    classes: dict[str, Facts] = {}
    for tag in root.findall("default"):
        _read(tag, {}, classes)
        root.remove(tag)
    for part in root:
        if part.tag == "worldbody":
            _state_body(part, MAIN, classes)
        elif part.tag in SECTIONS:
            for tag in part:
                _state(tag, OF_SECTION.get(part.tag, tag.tag), MAIN, classes)


def _read(default: ET.Element, above: Facts, classes: dict[str, Facts]) -> None:
    facts = {kind: dict(of_kind) for kind, of_kind in above.items()}
    for tag in default:
        if tag.tag != "default":
            facts.setdefault(tag.tag, {}).update(tag.attrib)
    classes[default.get("class", MAIN)] = facts
    for tag in default.findall("default"):
        _read(tag, facts, classes)


def _state_body(body: ET.Element, name: str, classes: Mapping[str, Facts]) -> None:
    name = body.attrib.pop("childclass", name)
    for tag in body:
        if tag.tag in ("body", "frame"):
            _state_body(tag, name, classes)
        else:
            _state(tag, tag.tag, name, classes)


def _state(tag: ET.Element, kind: str, name: str, classes: Mapping[str, Facts]) -> None:
    facts = dict(classes.get(tag.attrib.pop("class", name), {}).get(kind, {}))
    if "cranksite" not in tag.attrib:
        facts.pop("cranklength", None)  # which MuJoCo takes of a class, but of no other actuator
    tag.attrib = {**facts, **tag.attrib}
