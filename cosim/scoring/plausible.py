"""What to doubt about a model before any score: muscles that act against the published sign,
lengths and fibres that are far off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from cosim.analyses.moment_arms import native_arms, published_arms
from cosim.case.file import load_case
from cosim.fingers.kinds import joint_ranges, skeleton_of
from cosim.measured import read_measured
from cosim.models.build import build
from cosim.port import Array
from cosim.scoring.model import HandModel, without_loads

LEAST_ARM = 1.0
"""mm, that an arm has at least whose sign is told."""
ANGLES = 7
"""Angles of each joint at which the sign is looked at."""
MODEL_SOURCES = ("MyoHand", "ARMS hand model")
"""Sources of `cases/data/moment_arms.csv` that are such models themselves, and no witness."""
FAR_SD = 3.0
"""SD of the measured hands, beyond which a phalanx is told."""
MUSCLES = "base/muscles.toml"
"""The case that states the muscles of a published model."""
FAR_FACTOR = 2.0
"""How many times longer or shorter an optimal fibre must be to be told."""


def doubts(model: HandModel, summaries: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """A sentence for each."""
    for doubt in against_published(model.finger, _arms(model, summaries)):
        yield doubt.words
    yield from _lengths(model)
    yield from _fibres(model)


class SignDoubt(NamedTuple):
    """A muscle that acts against the published sign about a joint."""

    joint: str
    always: bool
    """In every posture looked at."""
    words: str


def against_published(
    finger: str, arms: Mapping[tuple[str, str], list[tuple[float, float]]]
) -> Iterator[SignDoubt]:
    """Where arms, by tendon and joint the joint's angle (deg) and the arm (mm) there, are against
    the published signs."""
    for (tendon, joint), (sign, sources) in published_signs(finger).items():
        seen = arms.get((tendon, joint), [])
        against = [(angle, arm) for angle, arm in seen if sign * arm < -LEAST_ARM]
        if not against:
            continue
        angle, arm = max(against, key=lambda pair: abs(pair[1]))
        always = len(against) == len(seen)
        where = "" if always else f" at {joint.replace('_', ' ')} {angle:.0f} deg"
        yield SignDoubt(
            joint,
            always,
            f"{tendon} {_does(joint, arm > 0)}{where} (arm {arm:+.1f} mm); published: it "
            f"{_does(joint, sign > 0)} ({'; '.join(sources)})",
        )


def _does(joint: str, positive: bool) -> str:
    if joint == "MCP_abduction":
        return f"turns the MCP to the {'radial' if positive else 'ulnar'} side"
    return f"{'flexes' if positive else 'extends'} the {joint}"


def published_signs(finger: str) -> dict[tuple[str, str], tuple[int, tuple[str, ...]]]:
    """By tendon and joint the sign on which all sources agree in every posture, with arms of at
    least a millimetre, and the sources; models' sources left out."""
    known = published_arms(finger)
    known = known[~known.source.isin(MODEL_SOURCES)]
    signs: dict[tuple[str, str], tuple[int, tuple[str, ...]]] = {}
    for (tendon, joint), rows in known.groupby(["tendon", "joint"], sort=False):
        low, high = rows.arm_mm.min(), rows.arm_mm.max()
        if low > LEAST_ARM or high < -LEAST_ARM:
            sources = tuple(dict.fromkeys(rows.source))
            signs[str(tendon), str(joint)] = (1 if low > 0 else -1, sources)
    return signs


def _arms(
    model: HandModel, summaries: Mapping[str, Mapping[str, Any]]
) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """By tendon and joint the joint's angle (deg) and the arm (mm) there: of the finger's own
    tendons as each joint bends with the others straight, of the hood's in the postures that were
    run."""
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for summary in summaries.values():
        for tendon, by_joint in summary["unloaded"]["moment_arm_mm"].items():
            for joint, arm in by_joint.items():
                angle = float(summary["unloaded"]["posture_deg"][joint])
                found.setdefault((tendon, joint), []).append((angle, float(arm)))
    case = without_loads(model.case)
    if case.hood.kind != "split":
        return found
    models = build(case)
    for joint, (_, most) in joint_ranges(models.finger).items():
        j = models.finger.joints.index(joint)
        end = 0.0 if joint == "MCP_abduction" else min(most, np.pi / 2)
        for angle in np.linspace(0.0, end, 1 if end == 0 else ANGLES):
            own: dict[str, Array] = native_arms(models, {joint: float(angle)})
            for tendon, arms in own.items():
                place = found.setdefault((tendon, joint), [])
                place.append((float(np.degrees(angle)), 1e3 * float(arms[j])))
    return found


def _lengths(model: HandModel) -> Iterator[str]:
    """Phalanges beside those of measured index fingers."""
    if model.finger != "index":
        return
    lengths = dict(
        zip(
            ("proximal", "middle", "distal"),
            1e3 * skeleton_of(model.case.native_finger()).length[1:],
            strict=True,
        )
    )
    if not model.has_tip:
        lengths.pop("distal")
    for row in read_measured("qiu2017"):
        bone = row.quantity.removeprefix("length.")
        if bone == row.quantity or bone not in lengths or not row.sd or row.value is None:
            continue
        off = (lengths[bone] - row.value) / row.sd
        if abs(off) > FAR_SD:
            yield (
                f"the {bone} phalanx is {lengths[bone]:.1f} mm long, {abs(off):.0f} SD "
                f"{'above' if off > 0 else 'below'} that of {row.n} measured hands "
                f"({row.value:g} +- {row.sd:g} mm); arms and forces go with it"
            )


def _fibres(model: HandModel) -> Iterator[str]:
    """Optimal fibre lengths beside those of a published model."""
    published = load_case(MUSCLES).tendons if model.finger == "index" else {}
    for name, length in model.fibres.items():
        tendon = published.get(name)
        if tendon is None or tendon.muscle is None:
            continue
        known = tendon.muscle.optimal_fibre_length
        factor = max(length / known, known / length) if length > 0 else np.inf
        if factor > FAR_FACTOR:
            yield (
                f"{name}: optimal fibre length {1e3 * length:.3g} mm, a published model has "
                f"{1e3 * known:.3g} mm (Jadelis, thesis, table 2): a factor of {factor:.2g}"
            )
