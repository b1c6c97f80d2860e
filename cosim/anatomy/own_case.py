"""A case of a user's own bones: joints found, tendons carried over, the generator's hood laid on
them, the slips' lengths found again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from cosim.anatomy.carry import Carrier
from cosim.anatomy.case_folder import REPORT, check_case, check_name, obj_text, write_schema
from cosim.anatomy.joints import HEADS, MOST_ANGLE, MOST_SHIFT, Head, Joints, fit_head, joints_of
from cosim.anatomy.landmarks import AXES, read_landmarks, stated_axes
from cosim.anatomy.scan import in_posture, scan_words
from cosim.anatomy.slip_lengths import SlipLengths, find_lengths
from cosim.anatomy.user_bones import LaidBones, Sizes, Template, lay_bones, template_of
from cosim.case.file import load_case
from cosim.errors import InputError, Progress, quiet
from cosim.files import check_folder, output_folder
from cosim.fingers.common import EQUAL_SHARES, Extensor
from cosim.fingers.kinds import FINGERS
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.port import Hand, mirror
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from cosim.text_tables import notes, toml_text
from meshes.skeleton import BODIES, JOINTS
from rigid.mjcf.write import mjcf_xml
from rigid.model import FingerModel, Vector, Via


@dataclass(frozen=True)
class OwnBones:
    """What a user gives for a hood to be laid on."""

    kind: str
    bones: Mapping[str, Path]
    """Surfaces by body."""
    hand: Hand = "right"
    unit: str | None = None
    """The files' unit; from the lengths where it is not stated."""
    landmarks: Path | None = None
    posture: Mapping[str, float] | None = None
    """rad, of one scan in which the bones lie as in the hand; else our zero begins each joint."""
    sizes: Sizes = field(default_factory=dict)
    """Sizes of bones that no file holds.  A finger without any file has its soft tissue stretched
    too."""


@dataclass(frozen=True)
class OwnFinger:
    """A user's finger, ready to be written."""

    template: Template
    laid: LaidBones
    heads: Mapping[str, Head]
    joints: Joints
    model: FingerModel
    eyelets: Mapping[str, tuple[float, float, float]]
    breadth: float
    size: float
    """The phalanges' length together, over the packaged finger's."""
    report: tuple[str, ...] = field(default=())
    hand: Hand = "right"
    """The side; of a left one all this is its mirror image, and what is written is its own."""

    def tendon_points(self) -> dict[str, list[tuple[str, Vector]]]:
        """By tendon the bodies and points (3,) m that it passes, its muscle's end left out."""
        out: dict[str, list[tuple[str, Vector]]] = {}
        for tendon in self.model.tendons:
            passed = out.setdefault(tendon.name, [])
            for element in (e for strand in tendon.strands for e in strand.path[1:]):
                match element:
                    case Via(body, point):
                        passed.append((body, point))
        return out


def own_finger(given: OwnBones, progress: Progress = quiet) -> OwnFinger:
    """Joints, tendons and bones of a user's finger.  Raises InputError that lists all faults."""
    template = template_of(given.kind)
    if not (given.bones or given.sizes):
        raise InputError("--bones: give one of the four at least, as --bone proximal=p1.stl")
    points = {} if given.landmarks is None else read_landmarks(given.landmarks)
    if wrong := [bone for bone, _ in points if bone not in given.bones]:
        raise InputError(f"--landmarks: has points of the {wrong[0]}, which is not given (--bones)")
    laid = lay_bones(given.bones, template, given.unit, given.hand, points, progress, given.sizes)
    stated = stated_axes(laid.stated)
    ours = template.skeleton
    heads = {
        body: fit_head(body, template.bones[body], laid.fits[body], ours)
        for body in HEADS
        if body in laid.given
    }
    _check_heads(heads, stated)
    joints = joints_of(ours, laid.fits, heads, stated)
    said = scan_words(joints, laid.given)
    if given.posture is not None:
        by_landmarks = {HEADS[bone] for bone, name in stated if name == "flexion"}
        by_landmarks |= {"MCP_abduction" for _, name in stated if name == "abduction"}
        joints = in_posture(joints, laid.given, given.posture, by_landmarks)
    carrier = Carrier(ours, laid.fits, joints, with_tissue=not laid.given)
    kind = FINGERS[given.kind]
    assert kind.model is not None
    models = [
        kind.model(template.config, extensor)
        for extensor in (Extensor(lies_on_bones=True), Extensor(EQUAL_SHARES))
    ]
    model = carrier.model(models[0].with_tendons_of(models[1]))
    width = float(np.mean(laid.fits["proximal"].stretch[1:]))
    size = float(joints.skeleton.length[1:].sum() / ours.length[1:].sum())
    return OwnFinger(
        template,
        laid,
        heads,
        joints,
        model,
        carrier.eyelets(kind.eyelets(template.config)),
        width * kind.width(template.config),
        size,
        (
            *laid.report,
            *_joint_words(template, heads, joints, stated),
            *said,
            *_carried(model, carrier),
        ),
        given.hand,
    )


def _check_heads(heads: Mapping[str, Head], stated: Mapping[tuple[str, str], Any]) -> None:
    """Refuse a head that contradicts the carried joint, where no landmark decides."""
    axis = ", and flexion_radial and flexion_ulnar on its axis"
    wrong = [
        f"{body}: {head}; name the joint by landmarks (--landmarks FILE): distal_joint"
        + ("" if body == "metacarpal" else axis)
        for body, head in heads.items()
        if (head.odd_angle and body != "middle" and (body, "flexion") not in stated)
        or (head.odd_shift and (body, "distal_joint") not in stated)
    ]
    if wrong:
        limit = f"{MOST_ANGLE:g} deg or {MOST_SHIFT:g} mm"
        raise InputError(
            "\n  ".join([f"heads of bones contradict the joints carried over by {limit}", *wrong])
        )


def _joint_words(
    template: Template,
    heads: Mapping[str, Head],
    joints: Joints,
    stated: Mapping[tuple[str, str], Any],
) -> list[str]:
    out = [f"joint {head}" for head in heads.values()]
    if "middle" in heads:
        out.append("joint DIP: its axis keeps to the PIP's what ours keeps; its own is not used")
    out += [
        f"landmark: {name} of the {bone} as stated"
        for bone, name in stated
        if name not in ("dorsal", "radial", *AXES)
    ]
    user, ours = joints.skeleton, template.skeleton
    lengths = ", ".join(f"{1e3 * part:.2f}" for part in user.length[1:])
    packaged = ", ".join(f"{1e3 * part:.2f}" for part in ours.length[1:])
    out.append(f"joints: phalanges {lengths} mm from joint to joint (ours: {packaged})")
    for joint, axis in zip(JOINTS, user.axis, strict=True):
        x, y, z = axis
        out.append(f"axis {joint}: {x:+.4f} distal, {y:+.4f} radial, {z:+.4f} dorsal")
    return out


def _carried(model: FingerModel, carrier: Carrier) -> list[str]:
    off = "stretched with it" if carrier.with_tissue else "that ours has"
    return [
        f"tendons: {', '.join(model.muscles)}: each point goes with its bone, at the height off it "
        f"{off} (assumed: no bone tells soft tissue)"
    ]


@dataclass(frozen=True)
class OwnCase:
    """A case that was written, and what there is to tell."""

    case: Path
    finger: OwnFinger
    slips: SlipLengths
    report: tuple[str, ...]


def new_own_case(name: str, given: OwnBones, out: Path, progress: Progress = quiet) -> OwnCase:
    """Write the folder `out` of a case whose hood is laid on the user's bones, whole or not at all.
    Raises InputError."""
    check_name(name)
    check_folder(out, REPORT)
    finger = own_finger(given, progress)
    with output_folder(out, REPORT) as part:
        written = write_own_case(name, finger, part, progress)
    return replace(written, case=out / f"{name}.toml")


def write_own_case(name: str, finger: OwnFinger, folder: Path, progress: Progress) -> OwnCase:
    """Write the case NAME.toml of a finger with its files into an empty folder, the slips' lengths
    found again.  Raises InputError."""
    hood = cast(ShellHoodConfig, load_case(finger.template.base).hood)
    central = finger.size * hood.extra_length.central_slip
    report = [*finger.report, *_hood_words(finger)]
    case = folder / f"{name}.toml"
    write_files(folder, finger)
    case.write_text(case_text(name, finger, hood, central), encoding="utf-8")
    check_case(case)
    slips = find_lengths(case, finger.template.base, central, finger.size, progress)
    report += slips.report
    case.write_text(case_text(name, finger, hood, slips.central), encoding="utf-8")
    (folder / REPORT).write_text("\n".join(report) + "\n", encoding="utf-8")
    return OwnCase(case, finger, slips, tuple(report))


def _hood_words(finger: OwnFinger) -> list[str]:
    tissue = "and what lies between hood and bone are its own"
    if not finger.laid.given:
        tissue = "are its own, what lies between hood and bone is as much higher as bones are wider"
    return [
        "hood: the generator's, on your bones; slack, toes and extra lengths "
        f"{finger.size:.4f} times the packaged hood's, anchors {finger.breadth:.4f} times as far "
        f"to the sides as the index finger's; sections, moduli {tissue} (assumed)"
    ]


def write_files(part: Path, finger: OwnFinger) -> None:
    """Write the finger's model, bones and the schema of its case into the folder `part`."""
    is_left = finger.hand == "left"
    model = finger.model.mirrored() if is_left else finger.model
    (part / "finger.xml").write_text(mjcf_xml(model) + "\n", encoding="utf-8")
    for body, (points, faces) in finger.laid.surfaces.items():
        local = mirror(finger.joints.local(body, points), finger.hand)
        text = obj_text(local, faces[:, ::-1] if is_left else faces)
        (part / f"{body}.obj").write_text(text, encoding="utf-8")
    write_schema(part)


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.12g} mm"


def case_text(name: str, finger: OwnFinger, hood: ShellHoodConfig, central: float) -> str:
    """Return the case of a finger, whose hood is as a packaged `hood` at its size, its central slip
    `central` m longer than laid."""
    remarks = [
        f"Written by `cosim new`; {REPORT} says what was measured, carried over and assumed.",
        "Materials, contact, passive joints, posture: the base case's until you state yours.",
        "Tendons pull by a tension, or by an activation of the greatest force: "
        "EDC = { activation = 0.1 }.",
    ]
    bones = {body: {"surface": f"{body}.obj", "unit": "m", "frame": "ours"} for body in BODIES}
    springs = {
        key: {
            at: _mm(finger.size * value)
            for at, value in (("slack", spring.slack), ("toe", spring.toe))
            if value
        }
        for key, spring in hood.springs.items()
    }
    values: dict[str, Any] = {
        "extends": finger.template.base,
        "title": f"{name}: hood on own bones",
        "finger": {
            "hand": finger.hand,
            "path": "finger.xml",
            "breadth": float(f"{finger.breadth:.12g}"),
            "eyelets": {t: [_mm(value) for value in at] for t, at in finger.eyelets.items()},
            "bones": bones,
        },
        "hood": {
            "extra_length": {
                "central_slip": _mm(central),
                "terminal_slip": _mm(finger.size * hood.extra_length.terminal_slip),
            },
            "springs": {key: lengths for key, lengths in springs.items() if lengths},
        },
    }
    if not finger.laid.given:
        wider = {body: float(finger.laid.fits[body].stretch[1]) for body in BODIES}
        heights = {body: _mm(wider[body] * m) for body, m in hood.contact.offset if body in wider}
        values["hood"]["contact"] = {"offset": heights}
    return f"{schema_line(CASE_SCHEMA)}\n{notes(remarks)}{toml_text(values)}"
