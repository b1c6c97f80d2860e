"""A finger out of a MuJoCo model (MJCF), as the description that ours are made from.

Four bodies (the metacarpal, which is held, and three phalanges), their hinges, and the spatial
tendons that pull on them.  Body frames that are not ours (x to the next joint, y radial, z dorsal,
origin in the joint) are replaced by ones that are: y is the flexion axis made normal to x.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import unescape
from pathlib import Path

import mujoco
import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Hand
from meshes.skeleton import BODIES, JOINTS, Skeleton
from rigid.fingers.anatomy import VIEW_METACARPAL, VIEW_RADIUS
from rigid.mjcf.bounds import check_bounds
from rigid.mjcf.frames import Frames, Where, frames_of
from rigid.mjcf.simulation import ANATOMY
from rigid.mjcf.tendons import read_tendons
from rigid.model import FingerModel, Hinge, Segment, vector

TIP = "tip"
MOVED_BY = {"MCP": 1, "MCP_abduction": 1, "PIP": 2, "DIP": 3}
"""Index of the body that a joint turns."""
MOST_NUMBER = 1e9
NO_NUMBER = f"which is not finite or beyond {MOST_NUMBER:g}; leave it out where nothing is meant"
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
NUMBERS = re.compile(
    r"\b(pos|quat|axis|range|euler|axisangle|xyaxes|zaxis|size|fromto|mass|ref|damping|armature"
    r"|stiffness|frictionloss|diaginertia|fullinertia|gravity|springref|springlength|forcerange"
    r"|ctrlrange|lengthrange|gear|data|qpos|ipos|iquat|density|scale)\s*=\s*(['\"])(.*?)\2",
    re.DOTALL,
)
"""Attributes of numbers in a text of MJCF."""
READ = (
    *("body_pos", "body_quat", "body_mass", "body_inertia", "jnt_axis", "jnt_pos", "jnt_range"),
    *("site_pos", "geom_pos", "geom_size", "jnt_stiffness", "qpos_spring", "dof_damping"),
    *("dof_armature", "dof_frictionloss", "tendon_stiffness", "actuator_gear"),
)
"""Arrays of a compiled model."""


@dataclass(frozen=True)
class ReadFinger:
    """The finger of a file, the greatest force (N) of each tendon that has one, and what is not in
    it or is there as something else."""

    model: FingerModel
    max_force: Mapping[str, float]
    losses: tuple[str, ...]


@dataclass(frozen=True)
class NamedJoint:
    """A hinge of a file: the bodies that it turns and that it is fixed to (the world's name is
    empty), and its range (rad; both zero where it has none)."""

    body: str
    parent: str
    range: tuple[float, float]


@dataclass(frozen=True)
class PartNames:
    """What a file calls its bodies, hinges, sites and tendons; those without a name are left
    out."""

    bodies: tuple[str, ...]
    joints: Mapping[str, NamedJoint]
    sites: tuple[str, ...]
    tendons: tuple[str, ...]


def part_names(path: Path | str) -> PartNames:
    """What a MuJoCo model calls its parts.  Raises InputError where the file is none."""
    m = _compile(Path(path))
    objects = mujoco.mjtObj
    bodies, sites, tendons, joints = (
        [mujoco.mj_id2name(m, kind, i) or "" for i in range(count)]
        for kind, count in (
            (objects.mjOBJ_BODY, m.nbody),
            (objects.mjOBJ_SITE, m.nsite),
            (objects.mjOBJ_TENDON, m.ntendon),
            (objects.mjOBJ_JOINT, m.njnt),
        )
    )
    bodies[0] = ""
    hinges = {}
    for j, name in enumerate(joints):
        if name and m.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE:
            body = m.jnt_bodyid[j]
            low, high = map(float, m.jnt_range[j])
            hinges[name] = NamedJoint(bodies[body], bodies[m.body_parentid[body]], (low, high))
    named = (tuple(filter(None, part)) for part in (bodies, sites, tendons))
    all_bodies, all_sites, all_tendons = named
    return PartNames(all_bodies, hinges, all_sites, all_tendons)


def read_mjcf(
    path: Path | str,
    names: Mapping[str, str] | None = None,
    tendons: Sequence[str] | None = None,
    assumed_tip: float | None = None,
    hand: Hand = "right",
) -> ReadFinger:
    """Read the finger of a MuJoCo model.

    `names`: from our name (of a body, joint, tendon, or "tip") to the file's where they differ,
    "-NAME" for a joint that turns the other way, "A|B" for the first of several that is there;
    `tendons`: the names that a tendon may have, all
    others being dropped (every name if not given); `assumed_tip`: without a site for the fingertip,
    where it is taken to be, straight on from the DIP, over the middle phalanx's length; `hand`: the
    side that the file is of, of which a left one is mirrored.  Returns the finger, of a right hand,
    and what was changed or dropped.

    Raises InputError where the file is no MuJoCo model or holds no such finger.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from meshes.skeleton import index_finger
    >>> from rigid.fingers.index import finger_model
    >>> from rigid.mjcf.read import read_mjcf
    >>> from rigid.mjcf.write import mjcf_xml
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "finger.xml"
    ...     _ = path.write_text(mjcf_xml(finger_model(index_finger())))
    ...     read_mjcf(path).model.muscles
    ('FDP', 'FDS', 'FDIm', 'FDIl')
    """
    m = _compile(Path(path))
    with_minus = {ours: _first_there(m, theirs) for ours, theirs in (names or {}).items()}
    signs = {j: -1.0 if with_minus.get(j, "").startswith("-") else 1.0 for j in JOINTS}
    plain = {ours: theirs.removeprefix("-") for ours, theirs in with_minus.items()}
    where = Where(str(path), m, plain)
    phalanges = [where.find("body", mujoco.mjtObj.mjOBJ_BODY, name) for name in BODIES[1:]]
    losses: list[str] = []
    body = [_metacarpal(where, phalanges[0], losses), *phalanges]
    joint = [where.find("joint", mujoco.mjtObj.mjOBJ_JOINT, name) for name in JOINTS]
    knuckle = _knuckle(m, body, joint)
    _check_tree(where, body, joint, knuckle)
    if knuckle is not None:
        losses.append(_without(m, knuckle))
    sign = np.array([signs[j] for j in JOINTS])
    data = _at_zero(m, joint)
    tip = _tip(where, data, joint, assumed_tip, losses)
    frames = frames_of(where, data, body, joint, sign, tip, losses, hand)
    owner = np.array([_owner(m, b, body) for b in range(m.nbody)])
    read = read_tendons(m, data, owner, frames, plain, tendons)
    ends = frames.local(3, tip)
    segments = tuple(
        _segment(m, data, frames, i, body, joint, sign, ends, losses) for i in range(4)
    )
    model = FingerModel(Path(path).stem, segments, vector(ends), read.tendons)
    if hand == "left":
        model = model.mirrored()
        losses.append("changed: a left hand, mirrored into a right one")
    return ReadFinger(model, read.max_force, (*losses, *read.losses, *_losses(m, joint, body)))


def _tip(
    where: Where,
    data: mujoco.MjData,
    joint: Sequence[int],
    assumed: float | None,
    losses: list[str],
) -> Array:
    """The fingertip (3,) m in the world at zero angles: the site, or where one is `assumed`.
    Raises InputError for neither."""
    kind = mujoco.mjtObj.mjOBJ_SITE
    name = where.names.get(TIP, TIP)
    if assumed is None or mujoco.mj_name2id(where.model, kind, name) >= 0:
        place: Array = data.site_xpos[where.find("site", kind, TIP)]
        return place
    pip, dip = data.xanchor[[joint[2], joint[3]]]
    length = assumed * float(np.linalg.norm(dip - pip))
    losses.append(
        f"assumed: the fingertip, {1e3 * length:.1f} mm straight on from the DIP; the model has no "
        "site there"
    )
    return np.asarray(dip + assumed * (dip - pip))


def _first_there(m: mujoco.MjModel, theirs: str) -> str:
    """The first of names parted by | that the model has, or the first."""
    objects = mujoco.mjtObj
    kinds = (objects.mjOBJ_BODY, objects.mjOBJ_JOINT, objects.mjOBJ_SITE, objects.mjOBJ_TENDON)
    options = theirs.split("|")
    return next(
        (
            name
            for name in options
            if any(mujoco.mj_name2id(m, kind, name.removeprefix("-")) >= 0 for kind in kinds)
        ),
        options[0],
    )


def skeleton_of(model: FingerModel) -> Skeleton:
    """The joints and lengths of a finger of four bodies whose x runs to the next joint.

    Raises InputError where its frames are others or it has other joints."""
    axes = {hinge.name: hinge.axis for s in model.segments for hinge in s.hinges}
    if set(axes) != set(JOINTS) or model.bodies != BODIES:
        raise InputError(
            f"finger {model.name}: a hood lies on the bodies {', '.join(BODIES)} and the joints "
            f"{', '.join(JOINTS)}; this one has {', '.join(model.bodies)} and "
            f"{', '.join(model.joints)}"
        )
    places = np.array([s.position for s in model.segments[1:]])
    length = np.array([*places[:, 0], model.tip[0]])
    beside = max(np.abs(places[:, 1:]).max(), np.abs(places[0]).max())
    if beside > 1e-6 or length[1:].min() <= 0:
        raise InputError(
            f"finger {model.name}: the x axes of its bodies do not run to the next joint "
            f"({1e3 * beside:.3g} mm beside it); `cosim new` makes frames that do"
        )
    zero = np.array([s.rotation for s in model.segments[1:]])
    return Skeleton(length, zero, np.array([axes[j] for j in JOINTS]), {}, model.joints)


def _metacarpal(where: Where, proximal: int, losses: list[str]) -> int:
    """The body that is the metacarpal: the world, told, where none is called so and the proximal
    phalanx hangs on the world, as in what `cosim import` makes of a model with its bone in the
    ground."""
    kind = mujoco.mjtObj.mjOBJ_BODY
    named = "metacarpal" in where.names or "metacarpal" in where.part_names(kind)
    if named or where.model.body_parentid[proximal]:
        return where.find("body", kind, "metacarpal")
    losses.append("changed: no body is the metacarpal; the world is, on which the proximal hangs")
    return 0


def _compile(path: Path) -> mujoco.MjModel:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    check_bounds(path)
    _check_numbers(path)
    try:
        m = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        text = " ".join(str(error).split())
        raise InputError(f"{path}: is no MuJoCo model: {text}") from error
    for name in READ:
        if not (np.abs(getattr(m, name)) < MOST_NUMBER).all():  # of a file that it includes
            raise InputError(f"{path}: a file that it includes states a {name} that is {NO_NUMBER}")
    return m


def _check_numbers(path: Path) -> None:
    """Refuse numbers that are not finite, which MuJoCo takes.  Raises InputError, with the line."""
    text = path.read_bytes().decode("utf-8", "replace")
    text = COMMENT.sub(lambda found: "\n" * found[0].count("\n"), text)
    for found in NUMBERS.finditer(text):
        wrong = next((word for word in unescape(found[3]).split() if _is_no_number(word)), None)
        if wrong is not None:
            line = text.count("\n", 0, found.start()) + 1
            element = text[text.rfind("<", 0, found.start()) + 1 : found.start()].split()[0]
            raise InputError(
                f"{path}, line {line}, <{element}>: {found[1]} has {wrong[:40]!r}, {NO_NUMBER}"
            )


def _is_no_number(word: str) -> bool:
    """Whether a word is a number that no finger has; of what is none MuJoCo tells."""
    try:
        return not abs(float(word)) < MOST_NUMBER
    except ValueError:
        return False


def _knuckle(m: mujoco.MjModel, body: Sequence[int], joint: Sequence[int]) -> int | None:
    """The body between the metacarpal and the proximal phalanx that one of the MCP's two hinges
    turns, if there is one."""
    above = int(m.body_parentid[body[1]])
    own = [j for j in np.flatnonzero(m.jnt_bodyid == above) if above not in (0, body[0])]
    return above if own and set(own) < set(joint[:2]) else None


def _without(m: mujoco.MjModel, knuckle: int) -> str:
    return (
        f"changed: the body {m.body(knuckle).name!r} between the MCP's hinges is left out, with "
        f"its {1e3 * m.body_mass[knuckle]:.3g} g"
    )


def _check_tree(
    where: Where, body: Sequence[int], joint: Sequence[int], knuckle: int | None
) -> None:
    """Each phalanx hangs on the bone before it by its own hinges and no other joint."""
    m = where.model
    for name, j in zip(JOINTS, joint, strict=True):
        if m.jnt_type[j] != mujoco.mjtJoint.mjJNT_HINGE:
            raise where.fault(f"joint {m.joint(j).name!r} ({name}) is no hinge")
        turned = m.jnt_bodyid[j]
        if turned != body[MOVED_BY[name]] and turned != knuckle:
            raise where.fault(
                f"joint {m.joint(j).name!r} ({name}) turns the body {m.body(turned).name!r}, "
                f"expected {m.body(body[MOVED_BY[name]]).name!r} ({BODIES[MOVED_BY[name]]})"
            )
    for i in (1, 2, 3):
        own = np.flatnonzero(m.jnt_bodyid == body[i])
        if extra := [m.joint(j).name for j in own if j not in joint]:
            raise where.fault(
                f"body {m.body(body[i]).name!r} ({BODIES[i]}) has the joint {extra[0]!r} too; a "
                f"finger here has the hinges {', '.join(JOINTS)}"
            )
        above = int(m.body_parentid[body[i]])
        while above not in (body[i - 1], 0) and (m.body_jntnum[above] == 0 or above == knuckle):
            above = int(m.body_parentid[above])
        if above != body[i - 1]:
            raise where.fault(
                f"body {m.body(body[i]).name!r} ({BODIES[i]}) does not hang on "
                f"{m.body(body[i - 1]).name!r} ({BODIES[i - 1]})"
            )


def _at_zero(m: mujoco.MjModel, joint: Sequence[int]) -> mujoco.MjData:
    """The finger's angles zero, the other joints where the model is assembled."""
    data = mujoco.MjData(m)
    data.qpos[:] = m.qpos0
    data.qpos[m.jnt_qposadr[list(joint)]] = 0.0
    mujoco.mj_kinematics(m, data)
    return data


def _owner(m: mujoco.MjModel, b: int, body: Sequence[int]) -> int:
    """Index of the bone that a body moves with; -1 of one that moves on its own.  What carries the
    metacarpal is held with it."""
    carrying, above = set(), body[0]
    while above:
        carrying.add(above)
        above = int(m.body_parentid[above])
    while b:
        if b in body:
            return list(body).index(b)
        if b in carrying:
            return 0
        if m.body_jntnum[b]:
            return -1
        b = int(m.body_parentid[b])
    return 0


def _segment(
    m: mujoco.MjModel,
    data: mujoco.MjData,
    frames: Frames,
    i: int,
    body: Sequence[int],
    joint: Sequence[int],
    sign: Array,
    tip: Array,
    losses: list[str],
) -> Segment:
    name = BODIES[i]
    if i == 0:
        return Segment(name, VIEW_METACARPAL, radius=VIEW_RADIUS[name])
    turn = frames.turn[i - 1].T @ frames.turn[i]
    place = np.where(np.abs(at := frames.local(i - 1, frames.origin[i])) < 1e-12, 0.0, at)
    order = sorted((j, k) for k, j in enumerate(joint) if MOVED_BY[JOINTS[k]] == i)
    hinges = tuple(
        Hinge(
            JOINTS[k],
            vector(sign[k] * data.xaxis[j] @ frames.turn[i]),
            _range(_stated_range(m, j, JOINTS[k]), sign[k]),
        )
        for j, k in order
    )
    ahead = tip if i == 3 else frames.local(i, frames.origin[i + 1])
    return Segment(
        name,
        float(np.linalg.norm(ahead)),
        vector(place),
        (vector(turn[0]), vector(turn[1]), vector(turn[2])),
        hinges,
        float(m.body_mass[body[i]]),
        _inertia(m, data, frames, i, body[i], losses),
        vector(frames.local(i, data.xipos[body[i]])),
        VIEW_RADIUS[name],
    )


def _stated_range(m: mujoco.MjModel, j: int, name: str) -> Array:
    """The joint's range, or that of the anatomy where ours was written with narrower limits."""
    if mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_NUMERIC, ANATOMY + name) < 0:
        stated: Array = m.jnt_range[j]
        return stated
    return np.array(m.numeric(ANATOMY + name).data)


def _range(stated: Array, sign: float) -> tuple[float, float]:
    if not stated.any():
        return (-np.inf, np.inf)
    low, high = sorted(sign * stated)
    return float(low), float(high)


def _inertia(
    m: mujoco.MjModel, data: mujoco.MjData, frames: Frames, i: int, b: int, losses: list[str]
) -> tuple[float, float, float]:
    """About our axes; the products of inertia, which the description lacks, are left out."""
    axes = frames.turn[i].T @ data.ximat[b].reshape(3, 3)
    tensor = axes @ np.diag(m.body_inertia[b]) @ axes.T
    beside = np.abs(tensor - np.diag(np.diag(tensor))).max()
    if beside > 1e-6 * np.abs(tensor).max():
        share = 100 * beside / np.abs(tensor).max()
        losses.append(
            f"dropped: products of inertia of {BODIES[i]}, {share:.2g} % of its greatest moment "
            "(they matter in a motion only)"
        )
    return vector(np.diag(tensor))


def _losses(m: mujoco.MjModel, joint: Sequence[int], body: Sequence[int]) -> list[str]:
    """What a finger here has no place for."""
    own = list(joint)
    dof = m.jnt_dofadr[own]
    others = m.njnt - len(own)
    damped = m.dof_damping[dof].any() or m.dof_frictionloss[dof].any() or m.dof_armature[dof].any()
    welded = sum(1 for b in range(1, m.nbody) if b not in body and _owner(m, b, body) > 0)
    collide = ((m.geom_contype != 0) | (m.geom_conaffinity != 0)).any()
    told = (
        (others, f"{others} other joints, held where the model is assembled"),
        (m.jnt_stiffness[own].any(), "stiffness of the joints; give finger.passive in the case"),
        (damped, "damping, friction or armature of the joints; give finger.passive in the case"),
        (m.jnt_limited[own].any(), "limits of the joints as forces; give finger.limit in the case"),
        (m.neq, f"{m.neq} equality constraints"),
        (welded, f"mass of {welded} bodies that are fixed to a phalanx"),
        (collide, "contacts of the geoms"),
        (m.nsensor, f"{m.nsensor} sensors"),
        (m.nkey, f"{m.nkey} keyframes"),
        (m.opt.gravity.any(), "gravity; give finger.gravity in the case"),
    )
    return [f"dropped: {what}" for there, what in told if there]
