"""A hood of joint torques as parts of a MuJoCo model: junctions, followers and elastic tendons.

A junction is a slide that a muscle pulls, a tendon a weighted sum of joints and slides (`fixed`).
A band bears only tension, k [L - rest]^+: MuJoCo's limit of a tendon's length, whose constraint is

    f = (k_r r - b v - a) / R,   r = L - rest > 0,   R = (1 - d) / d A,   k = k_r / R,

with A the inverse inertia that MuJoCo computes for the tendon (`tendon_invweight0`) and d its
impedance.  At rest f = k r exactly; in motion b and a damp it, and the solver takes all of it
implicitly, so that it is stable at steps of 2 ms where a spring of that stiffness on so light a
slide would need 0.1 ms.  A slack band bears nothing and brakes nothing.

MuJoCo's tendons are linear in the joints.  What is not is a follower: a slide y with y = p(x), p of
the fourth degree and x a sum of joints, by an equality.  The inertia of slides weighs nothing.
Such a hood acts by joint torques: it presses no bones together, and forces of joints lack its
thrust.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import process_time
from types import MappingProxyType

import mujoco
import numpy as np

from cosim.port import Array
from rigid.hoods.network import Network
from rigid.model import Vector

STEP = 2e-3
"""s: the longest step at which a file is stable."""
RECOVERY = 1 / (2 * STEP) ** 2
"""1/s2, k_r, critically damped: the fastest that MuJoCo takes at STEP."""
JUNCTION = 0.01
"""kg, of a junction: as of a tendon and part of its muscle."""
FOLLOWER = 1e-6
"""kg m2 for each (unit of follower / rad)2: a tenth of what resists a joint."""
DRAG = 0.1
"""N s/m, of a junction that nothing holds."""
LOOSE = -1.0
"""m, a length that no band reaches: it bears only tension."""
FIRM = f"{2 * STEP!r} 1", "0.9999 0.9999 0.001 0.5 2"
"""solref and solimp of MuJoCo's stiffest equality at STEP."""
SOLVER_TOLERANCE = "1e-12"
"""The tolerance of MuJoCo's solver: with its usual 1e-8 a light follower trembles."""
NO_DEFAULTS = {"armature": "0", "stiffness": "0", "frictionloss": "0"}
"""What a model's defaults may say of joints and tendons, which is not of the hood's."""
STILL, CHUNK, CHUNKS = 1e-9, 25, 60
"""m, of junctions that rest over so many steps, and how often that is tried."""
PULL = 1.0
"""N, of every tendon while steps are counted."""
HELD = 1e4
"""kg m2, of joints whose torques are measured."""
PROBE = 1e-5
"""m and rad, of the differences that tell a tendon's arms."""
JOINED = (int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON))
"""Equalities that a follower may be."""


Polynomial = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Follower:
    """A slide that is a polynomial of a weighted sum of joints."""

    weights: Mapping[str, float]
    """By joint."""
    polynomial: Polynomial
    """Lowest power first."""

    def value(self, angles: Mapping[str, float]) -> float:
        """The slide's position at joint angles (rad)."""
        x = sum(weight * angles[joint] for joint, weight in self.weights.items())
        return float(np.polynomial.polynomial.polyval(x, self.polynomial))


@dataclass(frozen=True)
class Band:
    """An elastic tendon that bears tension alone."""

    weights: Mapping[str, float]
    """Its length by joint, follower (m per unit) and junction (1)."""
    rest: float
    """m, beyond which it bears."""
    stiffness: float
    """N/m."""


@dataclass(frozen=True)
class HoodParts:
    """A hood in MuJoCo's words; names are unique among joints and among tendons."""

    muscles: Mapping[str, Mapping[str, float]]
    """The length of each by joint, follower and junction: its excursion with a minus."""
    junctions: tuple[str, ...]
    bands: Mapping[str, Band]
    followers: Mapping[str, Follower] = field(default_factory=dict)


@dataclass(frozen=True)
class Place:
    """Where a junction slides, in the frame of a body of the model."""

    body: str
    position: Vector
    """m, of the junction at zero."""
    axis: Vector


def add_hood(root: ET.Element, parts: HoodParts) -> ET.Element:
    """Add a hood to a model (MJCF elements) whose joints it names, and return the model: what
    `add_parts` adds, and for each muscle a tendon and an actuator whose control is its tension
    (N)."""
    tendons, actuators = section(root, "tendon"), section(root, "actuator")
    for name, weights in parts.muscles.items():
        _add_sum(tendons, name, weights)
        ET.SubElement(actuators, "general", name=name, tendon=name, gainprm="-1")
    return add_parts(root, parts, {})


def add_parts(root: ET.Element, parts: HoodParts, places: Mapping[str, Place]) -> ET.Element:
    """Add junctions (in the world where no place is given, else with a site of their name),
    followers, and for each band a tendon and a sensor of its tension (N), and return the model."""
    section(root, "option").set("tolerance", SOLVER_TOLERANCE)
    world = section(root, "worldbody")
    bodies = {body.get("name"): body for body in root.iter("body")}
    for name in parts.junctions:
        if name not in places:
            _add_slide(world, name, JUNCTION, DRAG)
            continue
        place = places[name]
        made = _add_slide(bodies[place.body], name, JUNCTION, DRAG, place.axis)
        made.set("pos", _text(place.position))
        ET.SubElement(made, "site", name=name, pos="0 0 0", size="0.001")
    for name in parts.followers:
        _add_slide(world, name, FOLLOWER, 0.0)
    for name, follower in parts.followers.items():
        _add_follower(root, name, follower)
    tendons = section(root, "tendon")
    for name, band in parts.bands.items():
        limits = {"limited": "true", "range": f"{LOOSE!r} {band.rest!r}"}
        _add_sum(tendons, name, band.weights, limits)
        ET.SubElement(section(root, "sensor"), "tendonlimitfrc", name=name, tendon=name)
    _set_stiffness(root, parts.bands)
    return root


def section(root: ET.Element, name: str) -> ET.Element:
    """The element of a model that holds its bodies, tendons or the like, made where it lacks."""
    found = root.find(name)
    return ET.SubElement(root, name) if found is None else found


def _add_slide(
    parent: ET.Element, name: str, inertia: float, drag: float, axis: Vector = (1.0, 0.0, 0.0)
) -> ET.Element:
    """A mass and not an armature, which MuJoCo leaves out of `dof_invweight0` here and with it of
    a follower's firmness."""
    body = ET.SubElement(parent, "body", name=name, gravcomp="1")
    turning = _text((inertia,) * 3)
    ET.SubElement(body, "inertial", pos="0 0 0", mass=repr(inertia), diaginertia=turning)
    slide = {"name": name, "type": "slide", "axis": _text(axis), "damping": repr(drag)}
    ET.SubElement(body, "joint", slide | NO_DEFAULTS | {"limited": "false"})
    return body


def _add_follower(root: ET.Element, name: str, follower: Follower) -> None:
    equality = section(root, "equality")
    solref, solimp = FIRM
    facts = {"polycoef": _text(follower.polynomial), "solref": solref, "solimp": solimp}
    (joint, weight), *more = follower.weights.items()
    if not more and weight == 1.0:
        ET.SubElement(equality, "joint", {"joint1": name, "joint2": joint} | facts)
        return
    tendons, of = section(root, "tendon"), f"{name}_of"
    _add_sum(tendons, name, {name: 1.0})
    _add_sum(tendons, of, follower.weights)
    ET.SubElement(equality, "tendon", {"tendon1": name, "tendon2": of} | facts)


def _add_sum(
    tendons: ET.Element,
    name: str,
    weights: Mapping[str, float],
    facts: Mapping[str, str] = MappingProxyType({}),
) -> None:
    out = ET.SubElement(
        tendons, "fixed", {"name": name} | NO_DEFAULTS | {"limited": "false", **facts}
    )
    for joint, weight in weights.items():
        ET.SubElement(out, "joint", joint=joint, coef=repr(float(weight)))


def _text(numbers: tuple[float, ...] | Array) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _set_stiffness(root: ET.Element, bands: Mapping[str, Band]) -> None:
    """Give the bands' limits the impedances that make their stiffnesses."""
    model = compile_model(root)
    elements = {tag.get("name"): tag for tag in root.iter("fixed")}
    for name, band in bands.items():
        inverse = float(model.tendon_invweight0[model.tendon(name).id])
        d = inverse / (inverse + RECOVERY / band.stiffness)
        damping = 2 * RECOVERY**0.5
        elements[name].attrib |= {
            "solreflimit": f"{-RECOVERY * d!r} {-damping * d!r}",
            "solimplimit": f"{d!r} {d!r} 0.001 0.5 2",
        }


def compile_model(root: ET.Element) -> mujoco.MjModel:
    """The model of MJCF elements."""
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def slides_at_rest(parts: HoodParts, angles: Mapping[str, float]) -> dict[str, float]:
    """Followers at joint angles (rad), and junctions (m) where the first band begins to bear."""
    out = {name: follower.value(angles) for name, follower in parts.followers.items()}
    at = {**angles, **out}
    for junction in parts.junctions:
        own = [
            b for b in parts.bands.values() if set(b.weights) & set(parts.junctions) == {junction}
        ]
        begins = [
            b.rest - sum(w * at[name] for name, w in b.weights.items() if name != junction)
            for b in own
        ]
        out[junction] = min(begins, default=0.0)
    return out


def steps_per_second(xml: str, count: int = 4000) -> float:
    """How many steps of STEP a model makes in a second of one core, from its first keyframe under
    tensions of PULL."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    model.opt.timestep = STEP
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = PULL
    mujoco.mj_step(model, data, nstep=count // 4)
    started = process_time()
    mujoco.mj_step(model, data, nstep=count)
    return count / (process_time() - started)


class HeldModel:
    """A model on whose joints a hood acts, held at angles, to see what the hood does there."""

    def __init__(self, model: mujoco.MjModel, joints: tuple[str, ...], parts: HoodParts) -> None:
        """`joints`: those whose torques are asked for, with a minus where a joint turns the other
        way; all that are not the hood's are held."""
        self.model, self.joints, self.parts = model, joints, parts
        self.data = mujoco.MjData(model)
        asked = [model.joint(j.removeprefix("-")).id for j in joints]
        self._sign = np.array([-1.0 if j.startswith("-") else 1.0 for j in joints])
        self._dofs, self._places = model.jnt_dofadr[asked], model.jnt_qposadr[asked]
        slides = {model.joint(name).id for name in (*parts.junctions, *parts.followers)}
        self._held = np.array([d for d in range(model.nv) if model.dof_jntid[d] not in slides])
        self._leave_the_hood(slides)
        self._slides = model.jnt_qposadr[sorted(slides)]
        self._junctions = np.array([model.joint(n).qposadr[0] for n in parts.junctions], dtype=int)

    def _leave_the_hood(self, slides: set[int]) -> None:
        """Take away what else acts on the joints: weight, contacts, limits, friction, couplings."""
        model = self.model
        model.opt.gravity[:], model.opt.timestep = 0.0, STEP
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.dof_armature[self._held], model.dof_frictionloss[self._held] = HELD, 0.0
        model.jnt_limited[[j for j in range(model.njnt) if j not in slides]] = 0
        for t in range(model.ntendon):
            if model.tendon(t).name not in (*self.parts.bands, *self.parts.followers):
                model.tendon_limited[t], model.tendon_frictionloss[t] = 0, 0.0
        of_tendon = int(mujoco.mjtEq.mjEQ_TENDON)
        for e, kind in enumerate(model.eq_type):
            named = model.tendon if kind == of_tendon else model.joint
            first = named(int(model.eq_obj1id[e])).name if kind in JOINED else ""
            self.data.eq_active[e] = first in self.parts.followers

    @classmethod
    def of(cls, xml: str, joints: tuple[str, ...], parts: HoodParts) -> HeldModel:
        """The model that a text makes."""
        return cls(mujoco.MjModel.from_xml_string(xml), joints, parts)

    def settle(self, angle: Array, tension: Mapping[str, float]) -> None:
        """Move to angles (n,) rad and tensions (N) by muscle, and step until the junctions rest."""
        data, theirs = self.data, self._sign * angle
        names = (joint.removeprefix("-") for joint in self.joints)
        named = dict(zip(names, map(float, theirs), strict=True))
        data.qvel[:] = 0.0
        for name, follower in self.parts.followers.items():
            data.joint(name).qpos[0] = follower.value(named)
        data.qpos[self._places] = theirs
        self._pull(tension)
        held, before = data.qpos.copy(), np.full(len(self._junctions), np.inf)
        for _ in range(CHUNKS):
            for _ in range(CHUNK):
                self._hold(held)
                mujoco.mj_step(self.model, data)
            now = data.qpos[self._junctions]
            if np.abs(now - before).max(initial=0.0) < STILL:
                break
            before = now.copy()
        self._hold(held)
        mujoco.mj_forward(self.model, data)

    def _pull(self, tension: Mapping[str, float]) -> None:
        for name, force in tension.items():
            self.data.actuator(name).ctrl[0] = force

    def _hold(self, position: Array) -> None:
        """Put all but the hood's slides at a position (nq,), at rest."""
        slides = self.data.qpos[self._slides]
        self.data.qpos[:], self.data.qvel[self._held] = position, 0.0
        self.data.qpos[self._slides] = slides

    def slides(self) -> dict[str, float]:
        """Where junctions (m) and followers are."""
        names = (*self.parts.junctions, *self.parts.followers)
        return {name: float(self.data.joint(name).qpos[0]) for name in names}

    def torque(self) -> Array:
        """The joint torques (n,) N m that hold the hood's pull."""
        data = self.data
        out: Array = self._sign * (data.qfrc_actuator + data.qfrc_constraint)[self._dofs]
        return out

    def tensions(self) -> dict[str, float]:
        """What the bands bear, N."""
        return {name: float(self.data.sensor(name).data[0]) for name in self.parts.bands}

    def excursion(self) -> Array:
        """How far each muscle has moved (m,) m."""
        out: Array = -np.array([self.data.tendon(m).length[0] for m in self.parts.muscles])
        return out


class HeldHand(HeldModel):
    """A hand with a hood on one finger, held, whose muscles pull by their tendons in place of the
    hand's actuators."""

    def __init__(
        self,
        model: mujoco.MjModel,
        joints: tuple[str, ...],
        parts: HoodParts,
        tendons: Mapping[str, str],
        prefix: str,
    ) -> None:
        """`tendons`: from the hood's muscles to the model's tendons; `prefix`: before the names of
        the hood's parts."""
        super().__init__(model, joints, parts)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        self.tendons, self.prefix = tendons, prefix

    def _pull(self, tension: Mapping[str, float]) -> None:
        data, ids = self.data, [self.model.tendon(t).id for t in self.tendons.values()]
        force = np.array([tension[muscle] for muscle in self.tendons])
        junctions = [self.model.joint(name).dofadr[0] for name in self.parts.junctions]
        places = [*zip(self._places, self._dofs, strict=True)]
        places += zip(self._junctions, junctions, strict=True)
        data.qfrc_applied[:] = 0.0
        for place, dof in places:
            at, length = data.qpos[place], []
            for step in (-PROBE, PROBE):
                data.qpos[place] = at + step
                mujoco.mj_fwdPosition(self.model, data)
                length.append(data.ten_length[ids].copy())
            data.qpos[place] = at
            data.qfrc_applied[dof] = -force @ (length[1] - length[0]) / (2 * PROBE)

    def torque(self) -> Array:
        out: Array = super().torque() + self._sign * self.data.qfrc_applied[self._dofs]
        return out

    def tensions(self) -> dict[str, float]:
        """What the bands bear, N; nothing in those of muscles that the hand has not."""
        there = {name.removeprefix(self.prefix): t for name, t in super().tensions().items()}
        return defaultdict(float, there)

    def excursion(self) -> Array:
        out: Array = -np.array([self.data.tendon(t).length[0] for t in self.tendons.values()])
        return out


SQUARE = (0.0, 0.0, 1.0, 0.0, 0.0)


def network_parts(network: Network, tendons: Sequence[str]) -> HoodParts:
    """A network's parts, with the names (k,) of its connecting tendons.  Where an arm is linear in
    its joint's angle, lengths have that angle's square, which is a follower of that joint."""
    slopes = abs(network.direct.slope).sum(axis=1) + abs(network.connecting.slope).sum(axis=1)
    bent = [joint for joint, slope in zip(network.joints, slopes, strict=True) if slope]
    owner = [network.muscles[i] for i in network.connection.argmax(axis=1)]
    muscles = {
        name: ({_junction(name): -1.0} if name in owner else {}) | _lengths(network, "direct", i)
        for i, name in enumerate(network.muscles)
    }
    bands = {
        name: Band(
            {_junction(owner[k]): 1.0} | _lengths(network, "connecting", k),
            float(network.rest[k]),
            float(network.stiffness[k]),
        )
        for k, name in enumerate(tendons)
    }
    junctions = tuple(_junction(name) for name in network.muscles if name in owner)
    return HoodParts(
        muscles, junctions, bands, {_square(j): Follower({j: 1.0}, SQUARE) for j in bent}
    )


def _lengths(network: Network, which: str, column: int) -> dict[str, float]:
    """What shortens a tendon, with a minus, by joint and square."""
    arms = getattr(network, which)
    out = {}
    for i, joint in enumerate(network.joints):
        if arms.constant[i, column]:
            out[joint] = -float(arms.constant[i, column])
        if arms.slope[i, column]:
            out[_square(joint)] = -float(arms.slope[i, column]) / 2
    return out


def _junction(muscle: str) -> str:
    return f"{muscle}_junction"


def _square(joint: str) -> str:
    return f"{joint}_square"
