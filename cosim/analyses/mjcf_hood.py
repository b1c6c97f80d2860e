"""A case's hood in a file for plain MuJoCo, and how far that is off the hood itself.

Postures and loads are drawn at random in a box; in each the file's joints are held and its
junctions come to rest, and its joint torques, slips and excursions are compared with those of the
hood behind the port.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import mujoco
import numpy as np

from cosim.analyses.reduction.reduce import state_in_words, tip_maps
from cosim.analyses.reduction.walks import ALONE_PARTS, MIXTURE_PARTS
from cosim.case.schema import Case
from cosim.errors import InputError, Progress, quiet
from cosim.fingers.kinds import joint_ranges
from cosim.hoods.kind import MujocoHood
from cosim.hoods.kinds import KINDS
from cosim.models.build import Models, build, mjcf_of
from cosim.port import Array
from meshes.skeleton import JOINTS
from rigid.hoods.joint_hood import JointState
from rigid.mjcf.attach import BENT, Attached, Target, add_note, attach_hood, hand_arms, note_of
from rigid.mjcf.hood import PULL, HeldHand, HeldModel, HoodParts, steps_per_second

HoodName = Literal["network", "reduced"]
MARK = 0.02
"""What a file's hood should keep of the hood that it was written from."""
STATES, FITTED = 60, 1200
"""States that are compared, and those to which parts are fitted."""
SEED, FIT_SEED = 1, 2
MOST_LOAD, USUAL_LOAD = 0.5, 20.0
"""Loads where the hood states none: of a muscle's greatest force; N where that is not stated."""
REDUCTION_ERRORS = "Error, relative to the hood that it was reduced from"
BEARS = 0.01
"""A slip that bears less of a state's greatest tension counts as slack."""


NOTE = "cosim_hood_"
"""Before a finger's name: the text of a model that keeps the hood's table."""
ULNAR = ("FPI", "UI", "ADM")
"""What the ulnar intrinsic is called at the index, at the middle and ring, and at the little
finger."""


class Error(NamedTuple):
    """Relative errors of a quantity over the states."""

    quantity: str
    median: float
    most: float
    where: str
    """The state that is off most; empty of a quantity without one."""


@dataclass(frozen=True)
class HoodFile:
    """A finger with its hood for plain MuJoCo."""

    xml: str
    """The model, without the notes of this record."""
    parts: HoodParts
    errors: tuple[Error, ...]
    notes: tuple[str, ...]
    """What was written and what it leaves out."""
    rate: float
    """Steps of 2 ms (`STEP`, whatever the file states) in a second of one core."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """Where the file is further off than MARK, in words."""
        return tuple(
            f"more than {100 * MARK:g} % off: {e.quantity}, most at {e.where}"
            for e in self.errors
            if e.most > MARK and e.where
        )

    @property
    def text(self) -> str:
        """The model with the notes and errors as its first lines."""
        said = [
            *self.notes,
            "error of this hood in MuJoCo, relative to the case's own, median and most: "
            + "; ".join(
                f"{e.quantity} {100 * e.median:.2g} %, {100 * e.most:.2g} %" for e in self.errors
            ),
            *self.doubts,
        ]
        head, tag, rest = self.xml.partition(">")
        comments = (f"\n  <!-- {line.replace('--', '- -')} -->" for line in said)
        return head + tag + "".join(comments) + rest


def hood_in_mujoco(case: Case, which: HoodName) -> MujocoHood:
    """A case's hood as plain MuJoCo can have it.  Raises InputError where the hood is of another
    kind than `which`."""
    found = KINDS[case.hood.kind].builder.in_mujoco
    made = None if found is None else found(case.hood, case.lesion)
    if made is not None and made.word == which:
        return made
    raise InputError(f"--hood {which}: {case.name} has another hood: {_advice(case, made)}")


def _advice(case: Case, made: MujocoHood | None) -> str:
    if made is not None:
        return f"write --hood {made.word}"
    if case.hood.lies_on_bones:
        return (
            f"{case.hood.title}. MuJoCo has no such sheet or net with contact: fit a potential to "
            f"it first, cosim export {case.name} -o reduced.toml, then "
            "cosim export reduced.toml --hood reduced -o finger.xml"
        )
    return f"{case.hood.title}. A network, two bands and a reduced hood can be written"


def hood_file(
    case: Case, which: HoodName, tell: Progress = quiet, states: int = STATES
) -> HoodFile:
    """A case's finger with its hood, compared with the case's in so many states; with none its
    errors are empty.  Raises InputError where the hood is of another kind."""
    hood, models = hood_in_mujoco(case, which), build(case)
    parts = _parts(case, models, hood, tell)
    xml = mjcf_of(case, parts)
    errors = tuple[Error, ...]()
    if states:
        tell("comparing the file with the hood")
        held = HeldModel.of(xml, models.finger.joints, parts)
        errors = tuple(compare(case, models, hood, held, states))
    return HoodFile(xml, parts, errors, tuple(_notes(case, hood, parts)), steps_per_second(xml))


def _parts(case: Case, models: Models, hood: MujocoHood, tell: Progress) -> HoodParts:
    """The hood's parts, fitted in its box where it has one."""
    count = 0 if hood.box is None else FITTED
    if count:
        tell("fitting MuJoCo's parts to the hood")
    angles, loads = sample_states(case, models, hood, count, FIT_SEED)
    return hood.parts(angles, loads, tip_maps(case, angles))


def attach(
    case: Case, finger: str, path: Path, names: Mapping[str, str], made: HoodFile
) -> Attached:
    """A hand model with the hood of a case's file `made` on one finger; names: from ours to the
    model's.  Raises InputError where no muscle of the hood is there."""
    ours = dict(zip(made.parts.muscles, hood_muscles(made, names), strict=True))
    of = {muscle: names[known] for muscle, known in ours.items() if known in names}
    joints = {joint: names[joint] for joint in JOINTS if joint in names}
    target = Target(joints, of, names["metacarpal"], names["proximal"], f"{finger}_hood_")
    attached = attach_hood(path, made.parts, target)
    table = json.dumps(case.hood.model_dump(mode="json", exclude_none=True))
    for muscle, known in ours.items():
        table = table.replace(f'"{muscle}"', f'"{known}"')
    strengths = {ours[muscle]: force for muscle, force in attached.strengths.items()}
    note = {"hood": json.loads(table), "strengths": strengths, "case": case.name}
    add_note(attached.root, f"{NOTE}{finger}", json.dumps(note))
    told = (f"hood of {case.name} on the {finger} finger, its lengths as they are there",)
    return replace(attached, told=told + attached.told)


def path_arms(
    hand: Path, names: Mapping[str, str], muscles: Iterable[str]
) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """The arms of muscles of a hand model on their own paths, by muscle and joint: the joint's
    angle (deg) as it bends with the others straight, and the arm (mm) there.  `names`: from ours to
    the model's."""
    model = mujoco.MjModel.from_xml_path(str(hand))
    joints = {joint: names[joint] for joint in JOINTS if joint in names}
    tendons = {m: names[m] for m in muscles if m in names}
    out: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for joint in joints:
        for bend in (0.0,) if joint == "MCP_abduction" else BENT:
            for muscle, arm in hand_arms(
                model, joints, tendons, {joint: float(bend)}, joint
            ).items():
                out.setdefault((muscle, joint), []).append((float(np.degrees(bend)), 1e3 * arm))
    return out


class Arm(NamedTuple):
    """A muscle's arm (m) about a joint on a hand, on its own path and through the hood."""

    muscle: str
    joint: str
    path: float
    hood: float


def judge_attached(
    case: Case, which: HoodName, hand: Path, out: Path, attached: Attached
) -> tuple[tuple[Error, ...], tuple[Arm, ...]]:
    """How far the hood in the file `out` that was written, run in MuJoCo, is off the case's; and
    the arms of its muscles in the case's posture, each alone at PULL, before (`hand`) and now."""
    hood, models, at = hood_in_mujoco(case, which), build(case), attached.target
    tendons = {m: at.muscles[m] for m in models.hood.tendons if m in at.muscles}

    def held(joints: tuple[str, ...]) -> HeldHand:
        model, names = mujoco.MjModel.from_xml_path(str(out)), tuple(at.joints[j] for j in joints)
        return HeldHand(model, names, attached.parts, tendons, at.prefix)

    errors = tuple(compare(case, models, hood, held(hood.joints)))
    posture = {joint: models.posture.get(joint, 0.0) for joint in JOINTS if joint in at.joints}
    old, now, arms = mujoco.MjModel.from_xml_path(str(hand)), held(tuple(posture)), list[Arm]()
    for muscle in tendons:
        now.settle(np.array(list(posture.values())), {m: PULL * (m == muscle) for m in tendons})
        for joint, torque in zip(posture, now.torque(), strict=True):
            path = hand_arms(old, at.joints, {muscle: tendons[muscle]}, posture, joint)
            arms.append(Arm(muscle, joint, path[muscle], float(torque) / PULL))
    return errors, tuple(arms)


def check_names(
    case: Case, which: HoodName, path: Path, finger: str, names: Mapping[str, str]
) -> None:
    """Check that the joints and bodies of a finger are known in a model, by names from ours to
    the model's.  Raises InputError."""
    needed = (*hood_in_mujoco(case, which).joints, "metacarpal", "proximal")
    if lacking := [part for part in needed if part not in names]:
        raise InputError(
            f"{path}: no part is named like {lacking[0]} of the {finger} finger. Say which is "
            'which: a file of lines like PIP = "2pm_flexion", and --names FILE'
        )


def hood_muscles(made: HoodFile, names: Mapping[str, str]) -> tuple[str, ...]:
    """What a finger with these names, from ours to the model's, calls a hood's muscles."""
    return tuple(_known(muscle, names) for muscle in made.parts.muscles)


def _known(muscle: str, names: Mapping[str, str]) -> str:
    """What this finger's muscle of that name is called."""
    others = [name for name in ULNAR if name in names] if muscle in ULNAR else []
    return muscle if muscle in names or not others else others[0]


def attached_hood(path: Path, finger: str) -> Mapping[str, Any] | None:
    """What `attach` noted of the hood on a finger of a model: its table "hood", the greatest forces
    (N) "strengths" of its muscles, and its "case"; None where there is none.  Raises InputError for
    another text of this name."""
    text = note_of(path, f"{NOTE}{finger}")
    if text is None:
        return None
    try:
        note = json.loads(text)
        return {
            "hood": dict(note["hood"]),
            "strengths": dict(note["strengths"]),
            "case": str(note["case"]),
        }
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: its text {NOTE}{finger} is none of cosim export") from error


def _notes(case: Case, hood: MujocoHood, parts: HoodParts) -> Iterator[str]:
    yield (
        f"hood: {hood.word}; junctions on slides: {len(parts.junctions)}, elastic tendons from "
        f"them: {len(parts.bands)}, which are limits of tendons' lengths, solved implicitly, and "
        "bear only tension; a sensor reads each one's tension (N)"
    )
    if parts.followers:
        yield (
            "what no sum of joint angles is, follows such a sum by a polynomial (equality): "
            + ", ".join(parts.followers)
        )
    if hood.box is not None:
        yield (
            f"fitted to the reduced hood in the box {_box(hood)}; outside of it the file says "
            "nothing; its tendons are no slips, whose forces the case has as functions of the "
            "joint torques"
        )
        yield from _errors_of_reduction(case)
    if hood.held:
        yield f"{', '.join(hood.held)}: fitted in mid-box, where alone the sheet was sampled"
    yield (
        "the hood acts by joint torques: it presses no bones together, and forces of joints lack "
        "its thrust"
    )


def _errors_of_reduction(case: Case) -> Iterator[str]:
    """What the case file says, as `cosim export` wrote it, of the reduced hood's own errors."""
    lines = case.source.read_text(encoding="utf-8").splitlines() if case.source.is_file() else []
    words = [line.removeprefix("#").strip() for line in lines if line.startswith("#")]
    first = next((i for i, line in enumerate(words) if line.startswith(REDUCTION_ERRORS)), None)
    if first is not None:
        told = " ".join(takewhile(bool, words[first + 1 :]))
        yield f"the reduced hood itself, of the sheet or net that it was fitted to: {told}"


def _box(hood: MujocoHood) -> str:
    assert hood.box is not None
    angles = (
        f"{j} {np.degrees(a):.0f} to {np.degrees(b):.0f} deg" for j, (a, b) in hood.box[0].items()
    )
    loads = (f"{m} to {force:.3g} N" for m, force in hood.box[1].items())
    return ", ".join((*angles, *loads))


def compare(
    case: Case, models: Models, hood: MujocoHood, held: HeldModel, states: int = STATES
) -> Iterator[Error]:
    """The errors of arms (each muscle alone), joint torques, the force of a clamped fingertip, the
    slips and excursions, in states at random.  On a hand: about the hood's joints, without what the
    hand has not; its bones, and with them the fingertip, are others."""
    angles, loads = sample_states(case, models, hood, states, SEED)
    alone, asked, there = _alone(states), models.finger.joints, models.hood.tendons
    hand = held if isinstance(held, HeldHand) else None
    if hand is not None:
        asked, there = hood.joints, tuple(hand.tendons)
        loads = loads * np.array([muscle in there for muscle in models.hood.tendons])
        angles = angles * np.array([joint in asked for joint in models.finger.joints])
        pulled = loads.any(axis=1)
        angles, loads, alone = angles[pulled], loads[pulled], alone[pulled]
    columns = [models.finger.joints.index(joint) for joint in asked]
    muscles = [models.hood.tendons.index(muscle) for muscle in there]
    rows = [_both(models, hood, held, a, t, columns) for a, t in zip(angles, loads, strict=True)]
    torque, slip, moved, ours, our_slip, we_moved = (np.array(x) for x in zip(*rows, strict=True))
    we_moved = we_moved[:, muscles]
    moved = moved - (moved - we_moved).mean(axis=0)  # each counts from a place of its own
    of_torque = np.linalg.norm(torque - ours, axis=1) / np.linalg.norm(ours, axis=1)
    found = {
        "arms of a muscle alone": np.where(alone, of_torque, np.nan),
        "joint torques": of_torque,
    }
    if hand is None:
        maps = tip_maps(case, angles)
        tip, our_tip = (np.einsum("sij,sj->si", maps, x) for x in (torque, ours))
        size, off = np.linalg.norm(our_tip, axis=1), np.linalg.norm(tip - our_tip, axis=1)
        found |= {
            "tip force": off / size,
            "tip force, of the mean": off / np.sqrt((size**2).mean()),
            "tip force, of all tensions": off / loads.sum(axis=1),
        }
    found |= {
        "slip forces": np.abs(slip - our_slip).max(axis=1) / our_slip.max(axis=1),
        "excursion, of its range": np.abs(moved - we_moved).max(axis=1)
        / np.ptp(we_moved, axis=0).max(),
    }
    for name, values in found.items():
        k = int(np.nanargmax(values))
        where = state_in_words(angles[k], loads[k], models.hood.tendons)
        yield Error(name, float(np.nanmedian(values)), float(values[k]), where)
    least = BEARS * loads.sum(axis=1, keepdims=True)
    other = ((slip > least) != (our_slip > least)).any(axis=1)
    yield Error("states in which another slip is slack", 0.0, float(other.mean()), "")


def sample_states(
    case: Case, models: Models, hood: MujocoHood, states: int, seed: int
) -> tuple[Array, Array]:
    """Angles (s, n) rad and tensions (s, m) N at random: in a third of the states one muscle alone,
    the others at rest; joints that the hood's box holds in its middle."""
    random, joints = np.random.default_rng(seed), models.finger.joints
    ranges: Mapping[str, tuple[float, float]] = joint_ranges(models.finger)
    most = {muscle: _greatest(case, muscle) for muscle in models.hood.tendons}
    if hood.box is not None:
        ranges, most = hood.box[0], dict(hood.box[1])
    low, high = np.array([ranges[joint] for joint in joints]).T
    angles = random.uniform(low, high, (states, len(joints)))
    held = [joints.index(joint) for joint in hood.held]
    angles[:, held] = (low + high)[held] / 2
    greatest, rest = np.array(list(most.values())), case.solve.resting_tension
    loads = greatest * random.uniform(*MIXTURE_PARTS, (states, len(greatest)))
    whose = np.arange(states) // 3 % len(greatest)
    single = np.full_like(loads, rest)
    pulls = greatest[whose] * random.uniform(*ALONE_PARTS, states)
    single[np.arange(states), whose] = pulls
    return angles, np.where(_alone(states)[:, None], single, np.maximum(loads, rest))


def _alone(states: int) -> Array:
    """In which states one muscle pulls alone, (s,) bool."""
    return cast(Array, np.arange(states) % 3 == 0)


def _greatest(case: Case, muscle: str) -> float:
    table = case.tendons.get(muscle)
    force = None if table is None else table.max_force
    return USUAL_LOAD if force is None else MOST_LOAD * force


def _both(
    models: Models,
    hood: MujocoHood,
    held: HeldModel,
    angle: Array,
    load: Array,
    columns: list[int],
) -> list[Array]:
    """Torques (k,) N m about the joints of these columns, slips (2,) N and excursions (m,) m of the
    file, and those of the hood."""
    joints, live = models.finger.joints, models.hood
    held.settle(angle[columns], dict(zip(live.tendons, map(float, load), strict=True)))
    posture = dict(zip(joints, map(float, angle), strict=True))
    motion = models.finger.motion(models.finger.start(posture))
    state = cast(JointState, live.advance(live.start(motion), motion, load, np.inf).state)
    assert models.built.slips is not None
    ours = np.zeros(len(joints))
    ours[[joints.index(j) for j in hood.joints]] = np.atleast_2d(state.derived.torque).sum(axis=0)
    torque = held.torque()
    slips = _pair(hood.slips(held.tensions(), angle, torque))
    theirs = [torque, slips, held.excursion()]
    return [*theirs, ours[columns], _pair(models.built.slips(state)), state.derived.excursion]


def _pair(slips: Mapping[str, float]) -> Array:
    return np.array([slips["central"], slips["terminal"]])
