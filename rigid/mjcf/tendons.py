"""The spatial tendons of a MuJoCo model as strands over points, cylinders and spheres of bones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from cosim.port import Array
from meshes.skeleton import BODIES
from rigid.model import PathElement, Strand, Tendon, Via, WrapCylinder, WrapSphere, vector

SITE, SPHERE, CYLINDER, PULLEY = (
    int(mujoco.mjtWrap.mjWRAP_SITE),
    int(mujoco.mjtWrap.mjWRAP_SPHERE),
    int(mujoco.mjtWrap.mjWRAP_CYLINDER),
    int(mujoco.mjtWrap.mjWRAP_PULLEY),
)


class Places(Protocol):
    """Frames of the bones in the world."""

    @property
    def turn(self) -> Array:
        """The bones' rotations (nb, 3, 3): each one's axes as columns, in the world."""

    def local(self, i: int, point: Array) -> Array:
        """Return a point (3,) m of the world in the frame of bone i."""


@dataclass(frozen=True)
class ReadTendons:
    tendons: tuple[Tendon, ...]
    max_force: Mapping[str, float]
    losses: tuple[str, ...]


def read_tendons(
    m: mujoco.MjModel,
    data: mujoco.MjData,
    owner: Array,
    frames: Places,
    names: Mapping[str, str],
    wanted: Sequence[str] | None,
) -> ReadTendons:
    """Tendons of a compiled model at zero angles; `owner` (nbody,) is the bone of each body, -1 of
    those that are of none; `names`: from our names to the file's; `wanted`: the names kept."""
    ours = {theirs: name for name, theirs in names.items()}
    out, force, losses = [], {}, []
    unfit: dict[str, list[str]] = {}
    for t in range(m.ntendon):
        label = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_TENDON, t) or f"number {t}"
        name = ours.get(label, label)
        reason = _unfit(m, t, owner) or _why_unwanted(name, wanted)
        if reason:
            unfit.setdefault(reason, []).append(label)
            continue
        out.append(Tendon(name, tuple(_Reader(m, data, owner, frames).strands(t))))
        losses += [f"dropped: {what} of tendon {label}" for what in _own_forces(m, t)]
        if most := greatest_force(m, t):
            force[name] = most
    losses[:0] = [
        f"dropped: tendon{'s' * (len(labels) > 1)} {', '.join(labels)}: {reason}"
        for reason, labels in unfit.items()
    ]
    losses += _other_actuators(m)
    return ReadTendons(tuple(out), force, tuple(losses))


def _wraps(m: mujoco.MjModel, t: int) -> range:
    return range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t])


def _unfit(m: mujoco.MjModel, t: int, owner: Array) -> str:
    kinds = [int(m.wrap_type[w]) for w in _wraps(m, t)]
    if not set(kinds) <= {SITE, SPHERE, CYLINDER, PULLEY}:
        return "it is a sum of joint angles and has no path"
    bodies = [_body(m, w) for w in _wraps(m, t) if int(m.wrap_type[w]) != PULLEY]
    on = owner[bodies]
    if (on < 0).any():
        return f"it runs over the body {m.body(bodies[int(np.argmax(on < 0))]).name!r}, which moves"
    for w in _wraps(m, t):
        side = _side(m, w)
        if side >= 0 and owner[m.site_bodyid[side]] != owner[_body(m, w)]:
            geom, site = m.geom(m.wrap_objid[w]).name, m.site(side).name
            return f"the side site {site!r} is not on the bone of its surface {geom!r}"
    return "" if (on > 0).any() else "it pulls on no phalanx"


def _why_unwanted(name: str, wanted: Sequence[str] | None) -> str:
    if wanted is None or name in wanted:
        return ""
    return f"no tendon of a case is called {name}; the names are {', '.join(wanted)}"


def _body(m: mujoco.MjModel, w: int) -> int:
    part = m.wrap_objid[w]
    return int(m.site_bodyid[part] if int(m.wrap_type[w]) == SITE else m.geom_bodyid[part])


def _side(m: mujoco.MjModel, w: int) -> int:
    """The side site of a surface; -1 where there is none."""
    return int(m.wrap_prm[w]) if int(m.wrap_type[w]) in (SPHERE, CYLINDER) else -1


@dataclass(frozen=True)
class _Reader:
    model: mujoco.MjModel
    data: mujoco.MjData
    owner: Array
    frames: Places

    def strands(self, t: int) -> Iterator[Strand]:
        """Parts between MuJoCo's pulleys, whose divisors are one over the shares."""
        share, part = 1.0, list[int]()
        for w in _wraps(self.model, t):
            if int(self.model.wrap_type[w]) != PULLEY:
                part.append(w)
                continue
            if part:
                yield self.strand(part, share)
            share, part = 1.0 / float(self.model.wrap_prm[w]), []
        if part:
            yield self.strand(part, share)

    def strand(self, part: Sequence[int], share: float) -> Strand:
        return Strand(tuple(self.element(w) for w in part), share)

    def element(self, w: int) -> PathElement:
        i, at = int(self.owner[_body(self.model, w)]), int(self.model.wrap_objid[w])
        kind = int(self.model.wrap_type[w])
        if kind == SITE:
            return Via(BODIES[i], vector(self.frames.local(i, self.data.site_xpos[at])))
        centre = vector(self.frames.local(i, self.data.geom_xpos[at]))
        radius, site = float(self.model.geom_size[at, 0]), _side(self.model, w)
        side = vector(self.frames.local(i, self.data.site_xpos[site])) if site >= 0 else None
        if kind == SPHERE:
            return WrapSphere(BODIES[i], centre, radius, side)
        axis = self.data.geom_xmat[at].reshape(3, 3)[:, 2]
        return WrapCylinder(BODIES[i], centre, vector(axis @ self.frames.turn[i]), radius, side)


def _own_forces(m: mujoco.MjModel, t: int) -> list[str]:
    told = (
        (m.tendon_stiffness[t] or m.tendon_stiffnesspoly[t].any(), "the stiffness"),
        (m.tendon_damping[t] or m.tendon_dampingpoly[t].any(), "the damping"),
        (m.tendon_frictionloss[t], "the friction"),
        (m.tendon_armature[t], "the armature"),
        (m.tendon_limited[t], "the limit of length"),
    )
    return [what for there, what in told if there]


def _pullers(m: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which actuators pull a tendon, (nu,) bool."""
    return np.asarray(m.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON))


def actuators_of(m: mujoco.MjModel, tendon: str) -> str:
    """The names of the actuators that pull a tendon."""
    pulls = np.flatnonzero(_pullers(m) & (m.actuator_trnid[:, 0] == m.tendon(tendon).id))
    return ", ".join(m.actuator(int(a)).name or f"number {a}" for a in pulls)


def greatest_force(m: mujoco.MjModel, t: int) -> float:
    """The greatest force, N, that the tendon's actuators can pull with; 0 where they do not say."""
    most = 0.0
    for a in np.flatnonzero(_pullers(m) & (m.actuator_trnid[:, 0] == t)):
        gear = abs(float(m.actuator_gear[a, 0]))
        if m.actuator_gaintype[a] == int(mujoco.mjtGain.mjGAIN_MUSCLE):
            most += gear * _muscle_force(m, int(a))
        elif m.actuator_forcelimited[a]:
            most += gear * float(np.abs(m.actuator_forcerange[a]).max())
    return most


def _muscle_force(m: mujoco.MjModel, a: int) -> float:
    """The greatest force, N, of a muscle: where none is stated (a negative number) MuJoCo's own,
    its scale over the acceleration that a unit force makes."""
    force, scale = (float(x) for x in m.actuator_gainprm[a, 2:4])
    return force if force >= 0 else scale / max(float(m.actuator_acc0[a]), mujoco.mjMINVAL)


def _other_actuators(m: mujoco.MjModel) -> list[str]:
    pulls = _pullers(m)
    muscle = pulls & (m.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_MUSCLE))
    told = (
        ((~pulls).sum(), "actuators that pull no tendon"),
        (muscle.sum(), "muscles' curves and dynamics; their greatest forces are kept"),
    )
    return [f"dropped: {count} {what}" for count, what in told if count]
