"""A case's hood in a file for plain MuJoCo, and how far that is off the hood itself.

Postures and loads are drawn at random in a box; in each the file's joints are held and its
junctions come to rest, and its joint torques, bands and excursions are compared with those of the
hood behind the port.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from cosim.analyses.reduction.reduce import state_in_words, tip_maps
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.kinds import joint_ranges
from cosim.hoods.lumped.build import (
    apply_lesion_to_network,
    as_network,
    parts_in_mujoco,
    potential,
    slips_of,
)
from cosim.hoods.lumped.table import JOINTS, NetworkHoodConfig, TwoBandHoodConfig
from cosim.models.build import Models, build, mjcf_of
from cosim.port import Array
from rigid.hoods.joint_hood import JointState
from rigid.mjcf.hood import HeldModel, HoodParts

HoodName = Literal["network", "reduced", "cable"]
MARK = 0.02
"""What a file's hood should keep of the hood that it was written from."""
STATES, SEED = 60, 1
MOST_LOAD = 0.5
"""Of a muscle's greatest force: loads of the box where the hood states none."""
USUAL_LOAD = 20.0
"""N, where no greatest force is stated."""
BEARS = 0.01
"""Of a state's greatest tension: a slip that bears less counts as slack."""


class Error(NamedTuple):
    """Relative errors of a quantity over the states."""

    quantity: str
    median: float
    most: float
    where: str
    """The state that is off most."""


@dataclass(frozen=True)
class HoodFile:
    """A finger with its hood for plain MuJoCo."""

    xml: str
    """The model, without the notes of this record."""
    parts: HoodParts
    errors: tuple[Error, ...]
    notes: tuple[str, ...]
    """What was written and what it leaves out."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """Where the file is further off than MARK, in words."""
        return tuple(
            f"{e.quantity}: more than {100 * MARK:g} % off, most at {e.where}"
            for e in self.errors
            if e.most > MARK and e.where
        )

    @property
    def text(self) -> str:
        """The model with the notes and errors as its first lines."""
        said = [
            *self.notes,
            "error of this hood in MuJoCo, relative to the case's own, median and most: "
            + "; ".join(f"{e.quantity} {e.median:.1e}, {e.most:.1e}" for e in self.errors),
            *self.doubts,
        ]
        head, tag, rest = self.xml.partition(">")
        return head + tag + "".join(f"\n  <!-- {_as_comment(line)} -->" for line in said) + rest


def _as_comment(text: str) -> str:
    return text.replace("--", "- -")


def hood_file(case: Case, which: HoodName, states: int = STATES) -> HoodFile:
    """A case's finger with its hood.  Raises InputError where the hood is of another kind."""
    parts = _parts(case, which)
    xml = mjcf_of(case, parts)
    return HoodFile(xml, parts, tuple(compare(case, xml, parts, states)), tuple(_notes(parts)))


def _parts(case: Case, which: HoodName) -> HoodParts:
    hood = case.hood
    if not isinstance(hood, NetworkHoodConfig | TwoBandHoodConfig) or which != _kind(hood):
        raise InputError(f"--hood {which}: {case.name} has another hood: {_advice(case)}")
    return parts_in_mujoco(hood, case.lesion)


def _kind(hood: NetworkHoodConfig | TwoBandHoodConfig) -> str:
    return "reduced" if isinstance(hood, NetworkHoodConfig) and hood.reduced else "network"


def _advice(case: Case) -> str:
    hood = case.hood
    if isinstance(hood, NetworkHoodConfig | TwoBandHoodConfig):
        return f"write --hood {_kind(hood)}"
    if hood.lies_on_bones:
        return (
            f"{hood.title}. MuJoCo has no such sheet or contact: fit a potential to it first, "
            f"cosim reduce {case.name} -o reduced.toml, then cosim mjcf reduced.toml --hood reduced"
        )
    return f"{hood.title}. A network, two bands or a hood that `cosim reduce` wrote can be written"


def _notes(parts: HoodParts) -> Iterator[str]:
    yield (
        f"hood: {len(parts.junctions)} junctions on slides and {len(parts.bands)} tendons from "
        "them, which are limits of tendons' lengths and bear only tension, with a sensor of each "
        "one's tension (N)"
    )
    for name, follower in parts.followers.items():
        of = " + ".join(f"{w:g} {j}" for j, w in follower.weights.items())
        yield f"{name} follows {of} by a polynomial (equality): what no sum of joint angles is"
    yield (
        "the hood acts by joint torques: it presses no bones together, and forces of joints lack "
        "its thrust"
    )


def compare(
    case: Case, xml: str, parts: HoodParts, states: int = STATES, seed: int = SEED
) -> Iterator[Error]:
    """The errors of arms (each muscle alone), joint torques, the force of a clamped fingertip, the
    slips and excursions, in states at random."""
    models = build(case)
    joints = models.finger.joints
    held = HeldModel(mujoco.MjModel.from_xml_string(xml), joints, parts)
    angles, loads = sample_states(case, models, states, seed)
    rows = [_both(case, models, held, a, t) for a, t in zip(angles, loads, strict=True)]
    torque, slip, moved, ours, our_slip, we_moved = (np.array(x) for x in zip(*rows, strict=True))
    moved = moved - (moved - we_moved).mean(axis=0)  # each counts from a place of its own
    maps = tip_maps(case, angles)
    tip, our_tip = (np.einsum("sij,sj->si", maps, x) for x in (torque, ours))
    size = np.linalg.norm(our_tip, axis=1)
    off = np.linalg.norm(tip - our_tip, axis=1)
    alone = (loads > 0.1 * loads.max(axis=1, keepdims=True)).sum(axis=1) == 1
    of_torque = np.linalg.norm(torque - ours, axis=1) / np.linalg.norm(ours, axis=1)
    found = {
        "arms of a muscle alone": np.where(alone, of_torque, np.nan),
        "joint torques": of_torque,
        "tip force": off / size,
        "tip force, of the mean": off / np.sqrt((size**2).mean()),
        "slip forces": np.abs(slip - our_slip).max(axis=1) / our_slip.max(axis=1),
        "excursion, of its range": np.abs(moved - we_moved).max(axis=1)
        / np.ptp(we_moved, axis=0).max(),
    }
    for name, values in found.items():
        if np.isfinite(values).any():
            k = int(np.nanargmax(values))
            where = state_in_words(angles[k], loads[k], models.hood.tendons)
            yield Error(name, float(np.nanmedian(values)), float(values[k]), where)
    least = BEARS * loads.sum(axis=1, keepdims=True)
    other = ((slip > least) != (our_slip > least)).any(axis=1)
    yield Error("states in which another slip is slack", 0.0, float(other.mean()), "")


def sample_states(case: Case, models: Models, states: int, seed: int) -> tuple[Array, Array]:
    """Angles (s, n) rad and tensions (s, m) N at random: a third with one muscle alone, the others
    at rest."""
    random, hood = np.random.default_rng(seed), case.hood
    ranges = joint_ranges(models.finger)
    low, high = np.array([ranges[joint] for joint in models.finger.joints]).T
    rest = case.solve.resting_tension
    most = np.array([_greatest(case, muscle) for muscle in models.hood.tendons])
    if isinstance(hood, NetworkHoodConfig) and hood.reduced is not None:
        low, high = np.array([hood.reduced.angles[j] for j in models.finger.joints]).T
        most = np.array(list(hood.reduced.tensions.values()))
    angles = random.uniform(low, high, (states, len(low)))
    loads = random.uniform(np.minimum(rest, most), most, (states, len(most)))
    for k in range(0, states, 3):
        alone = np.arange(len(most)) != (k // 3) % len(most)
        loads[k, alone] = rest
    return angles, loads


def _greatest(case: Case, muscle: str) -> float:
    table = case.tendons.get(muscle)
    force = None if table is None else table.max_force
    return USUAL_LOAD if force is None else MOST_LOAD * force


def _both(case: Case, models: Models, held: HeldModel, angle: Array, load: Array) -> list[Array]:
    """Torques (n,) N m, slips (2,) N and excursions (m,) m of the file, and those of the hood."""
    joints, hood = models.finger.joints, models.hood
    held.settle(angle, dict(zip(hood.tendons, map(float, load), strict=True)))
    posture = dict(zip(joints, map(float, angle), strict=True))
    motion = models.finger.motion(models.finger.start(posture))
    state = hood.advance(hood.start(motion), motion, load, np.inf).state
    assert isinstance(state, JointState) and models.slips is not None
    torque = np.zeros(len(joints))
    torque[[joints.index(j) for j in _joints(case)]] = np.atleast_2d(state.derived.torque).sum(0)
    theirs = (held.torque(), _pair(_slips(case, held, angle)), held.excursion())
    return [*theirs, torque, _pair(models.slips(state)), state.derived.excursion]


def _joints(case: Case) -> tuple[str, ...]:
    """The joints that the hood acts on."""
    reduced = isinstance(case.hood, NetworkHoodConfig) and case.hood.reduced
    return tuple(reduced.angles) if reduced else JOINTS


def _slips(case: Case, held: HeldModel, angle: Array) -> Mapping[str, float]:
    """What bears in the slips of the file, N: its tendons; of a reduced hood what its formula makes
    of the file's torques."""
    hood = as_network(case.hood) if isinstance(case.hood, TwoBandHoodConfig) else case.hood
    assert isinstance(hood, NetworkHoodConfig)
    if hood.reduced is not None:
        return potential(hood.reduced).slip_forces(angle, held.torque())
    return slips_of(apply_lesion_to_network(hood, case.lesion), held.tensions())


def _pair(slips: Mapping[str, float]) -> Array:
    return np.array([slips["central"], slips["terminal"]])
