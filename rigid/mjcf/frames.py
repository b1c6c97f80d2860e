"""Our body frames in a MuJoCo model, and finding its parts by name."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Hand
from meshes.skeleton import BODIES, JOINTS

ALIKE = 0.7
"""Least cosine between axes that should run one way."""
TOGETHER = 2e-3
"""m, the two axes of the MCP pass each other within that; a hinge here passes through the origin of
its body."""
OURS = 1e-9
"""m and rad, a frame nearer than that to ours is kept as it is."""


@dataclass(frozen=True)
class Where:
    """A model and what its parts are called."""

    path: str
    model: mujoco.MjModel
    names: Mapping[str, str]

    def find(self, what: str, kind: mujoco.mjtObj, ours: str) -> int:
        """Number of the part that is our `ours`.  Raises InputError naming what there is."""
        name = self.names.get(ours, ours)
        found = mujoco.mj_name2id(self.model, kind, name)
        if found >= 0:
            return int(found)
        known = self.part_names(kind)
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.3)
        hint = f"; the nearest names are {', '.join(near)}" if near else ""
        raise InputError(
            f"{self.path}: has no {what} {name!r}, which would be our {ours}{hint}. Say which it "
            f"is (cosim new --set-name {ours}=NAME); it has {first_names(known)}"
        )

    def part_names(self, kind: mujoco.mjtObj) -> list[str]:
        """Names of all bodies, joints or sites of the model; those without a name are left out."""
        count = {
            mujoco.mjtObj.mjOBJ_BODY: self.model.nbody,
            mujoco.mjtObj.mjOBJ_JOINT: self.model.njnt,
            mujoco.mjtObj.mjOBJ_SITE: self.model.nsite,
        }[kind]
        every = (mujoco.mj_id2name(self.model, kind, i) for i in range(count))
        return [name for name in every if name]

    def fault(self, text: str) -> InputError:
        """Return an error whose message begins with the model's path."""
        return InputError(f"{self.path}: {text}")


def first_names(names: Sequence[str], most: int = 12) -> str:
    """The first of names, for a message, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none with a name") + more


class UlnarAbductionError(InputError):
    """The joint of the abduction turns to the other side than a right hand's."""


@dataclass(frozen=True)
class Frames:
    """Our frames of the four bodies in the model's world at zero angles."""

    origin: Array
    """(4, 3) m."""
    turn: Array
    """(4, 3, 3), columns x distal, y radial, z dorsal."""

    def local(self, i: int, point: Array) -> Array:
        """The point (3,) in the frame of body i."""
        return np.asarray((point - self.origin[i]) @ self.turn[i])


def frames_of(
    where: Where,
    data: mujoco.MjData,
    body: Sequence[int],
    joint: Sequence[int],
    sign: Array,
    tip: Array,
    losses: list[str],
    hand: Hand = "right",
) -> Frames:
    """Return our frames of the four bodies, from the axes (`joint`, times `sign`), bodies and `tip`
    (3,) m of a model at zero angles, whose y are ulnar of a left `hand`; what had to be changed is
    added to `losses`.

    Raises InputError where the MCP's two axes do not meet, two joints lie in one place, or an axis
    is not where a finger has it."""
    axis, anchor = sign[:, None] * data.xaxis[list(joint)], data.xanchor[list(joint)]
    apart = float(np.linalg.norm(anchor[1] - anchor[0]))
    if apart > TOGETHER:
        raise where.fault(
            f"the two axes of the MCP lie {1e3 * apart:.1f} mm apart; a finger here has both "
            f"through one point (at most {1e3 * TOGETHER:g} mm are made one)"
        )
    if apart > OURS:
        losses.append(
            f"changed: the MCP's abduction axis, moved by {1e3 * apart:.3g} mm into its centre"
        )
    centre = anchor[[0, 0, 2, 3]]
    ahead = np.array([anchor[2], anchor[3], tip]) - centre[1:]
    if np.linalg.norm(ahead, axis=1).min() < 1e-3:
        raise where.fault(
            "two joints, or the last joint and the tip, lie within 1 mm of each other"
        )
    built = np.array([_frame(x, y) for x, y in zip(ahead, axis[[0, 2, 3]], strict=True)])
    _check_senses(where, joint, built, axis, hand)
    turn, theirs = [], data.xmat[list(body)].reshape(-1, 3, 3)
    for i in (1, 2, 3):
        kept = _is_ours(theirs[i], built[i - 1]) and _at(data.xpos[body[i]], centre[i])
        turn.append(theirs[i] if kept else built[i - 1])
        if not kept:
            losses.append(f"changed: the frame of {BODIES[i]}: origin in the joint, x to the next")
    alike = np.einsum("ki,ki->i", theirs[0], turn[0]).min() > ALIKE
    fixed = theirs[0] if alike and _at(data.xpos[body[0]], centre[0]) else turn[0]
    return Frames(centre, np.array([fixed, *turn]))


def _at(point: Array, place: Array) -> bool:
    return bool(np.linalg.norm(point - place) < OURS)


def _is_ours(frame: Array, built: Array) -> bool:
    """Whether x is that of the built frame and the others roughly are."""
    same = np.linalg.norm(frame[:, 0] - built[:, 0]) < 1e-7
    return bool(same and frame[:, 2] @ built[:, 2] > ALIKE)


def _frame(x: Array, y: Array) -> Array:
    x = x / np.linalg.norm(x)
    y = y - (y @ x) * x
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _check_senses(
    where: Where, joint: Sequence[int], built: Array, axis: Array, hand: Hand
) -> None:
    """Positive in flexion and in radial abduction."""
    theirs = [where.model.joint(j).name for j in joint]
    for k in (2, 3):
        if axis[k] @ axis[0] < 0:
            raise where.fault(
                f"the joints {theirs[0]!r} (MCP) and {theirs[k]!r} ({JOINTS[k]}) turn in opposite "
                f"senses; flexion is positive here: --set-name {JOINTS[k]}=-{theirs[k]}, or the "
                "same of the MCP"
            )
    if (axis[1] @ built[0][:, 2] < 0) == (hand == "right"):
        raise UlnarAbductionError(
            f"{where.path}: the joint {theirs[1]!r} (MCP_abduction) turns to the ulnar side of a "
            f"{hand} hand when MCP, PIP and DIP flex: write --set-name MCP_abduction=-{theirs[1]}, "
            "or, if those three extend where they are positive, a minus before each of them, or, "
            f"if it is a {'left' if hand == 'right' else 'right'} hand, say so (finger.hand)"
        )
