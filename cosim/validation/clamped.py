"""Validations by forces at a clamped fingertip, and by the differences of arms in them.

Force and differences are one datum (`cosim.results.tip_reach`) and count once: Qiu's hands by the
differences, with the forces beside them in a variant; Synek's by the forces, whose third component
no difference has, with the differences beside them.  Groups that restate are variants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from cosim.case.file import load_case
from cosim.fingers.kinds import skeleton_of
from cosim.measured import read_measured, sources, values_of
from cosim.port import Array
from cosim.results.compare import Comparison, Kind, Target, numbers_of, value_of
from cosim.results.tip_reach import (
    arm_differences,
    chain_points,
    force_over_tension,
    to_world,
)
from cosim.validation.force import CLAMPED
from cosim.validation.trial import (
    Summaries,
    Trial,
    TrialGroup,
    angles_of,
    posture_settings,
)

DIFFERENCES = {
    "MCP less PIP arm": "difference.arm_difference_mm.MCP_PIP",
    "PIP less DIP arm": "difference.arm_difference_mm.PIP_DIP",
}
ABDUCTION = {"abduction arm": "difference.abduction_arm_mm"}
FORCE = "difference.fingertip_force_N"
SIDES = ("distal", "dorsal")
CASES = {"hood": "fingertip_fibres", "split": "split"}


def clamped_trial(source: str, model: str, muscle: str, posture: str) -> Trial:
    """A case of the index finger, its fingertip clamped, in a posture."""
    settings = (CLAMPED, *posture_settings(*angles_of(posture)))
    case, name = f"{CASES[model]}_{muscle.lower()}", f"{source} {model} {muscle} {posture}"
    return Trial(name, case, settings, muscle=muscle, posture=posture)


def split_partners(hood: Sequence[Trial], split: Sequence[Trial]) -> dict[str, str]:
    """The partners of trials, in the same order."""
    return {one.name: other.name for one, other in zip(hood, split, strict=True)}


# The index fingers of Qiu et al. 2017 -------------------------------------------------------------

QIU = sources()["qiu2017"].cited
SEEN = "looked at while other hoods were tried, nothing was fitted to it"
"""What is noted at the rows that pass through the hood."""


def qiu_groups() -> tuple[TrialGroup, ...]:
    """The hood, FDP, which no hood touches; and as variants the fixed split, and all forces that
    the differences make with the lengths of Qiu's hands."""
    hood, split = (
        [clamped_trial("qiu", model, m, p) for m in ("EDC", "FPI") for p in _qiu_postures(m)]
        for model in ("hood", "split")
    )
    past = [clamped_trial("qiu", "split", "FDP", p) for p in _qiu_postures("FDP")]
    shown = (*hood, *past)
    return (
        _qiu("Qiu 2017: hood", hood, partners=split_partners(hood, split)),
        _qiu("Qiu 2017: flexor", past),
        _qiu("Qiu 2017: fixed split", split, variant=True),
        TrialGroup(
            *("Qiu 2017: as forces", "inferred", shown, ()),
            variant=True,
            derived=partial(qiu_forces, shown),
        ),
    )


def _qiu(name: str, trials: Sequence[Trial], **more: Any) -> TrialGroup:
    targets = tuple(t for trial in trials for t in _qiu_targets(trial))
    return TrialGroup(name, "experiment", tuple(trials), targets, **more)


def _qiu_postures(muscle: str) -> list[str]:
    """Those in which a muscle's arms, or else its force, were measured."""
    rows = [m for m in read_measured("qiu2017") if f".{muscle}." in m.quantity]
    arms = [m for m in rows if m.kind == "effective_arm"]
    return list(dict.fromkeys(m.posture for m in arms or rows))


def _qiu_targets(trial: Trial) -> Iterator[Target]:
    muscle, posture = trial.muscle, trial.posture
    how = "force read from a figure" if muscle == "FPI" else "arms read from a figure to 0.15 mm"
    seen = "" if muscle == "FDP" else f"; {SEEN}"
    note = f"n 5; clamped; {how}; no SD by posture is printed{seen}"
    both = zip(DIFFERENCES.items(), measured_differences(muscle, posture), strict=True)
    for (words, quantity), value in both:
        name = f"{muscle} {posture}: {words}"
        yield target(trial, name, quantity, "mm", (value, None), QIU, "experiment", note)


def measured_differences(muscle: str, posture: str) -> tuple[float, float]:
    """Differences of moment arms (mm), flexion positive: of Qiu's arms, or of his forces."""
    values = values_of("qiu2017", posture)
    if f"effective_arm.{muscle}.MCP" in values:
        mcp, pip, dip = (values[f"effective_arm.{muscle}.{j}"] for j in ("MCP", "PIP", "DIP"))
        return mcp - pip, pip - dip
    distal, dorsal = (values[f"force_over_tension.{muscle}.{a}"] for a in SIDES)
    force = to_world(np.array([distal, 0.0, dorsal]), angles_of(posture))
    arms = arm_differences(_qiu_points(posture), force, 100.0)["arm_difference_mm"]
    return arms["MCP_PIP"], arms["PIP_DIP"]


def _qiu_points(posture: str) -> Array:
    lengths = [1e-3 * values_of("qiu2017")[f"length.{b}"] for b in ("proximal", "middle", "distal")]
    return chain_points(lengths, angles_of(posture))


def qiu_force(posture: str, differences: Sequence[float]) -> Array:
    """The distal and dorsal force (2,), % of the tension, metacarpal's axes, which differences of
    arms (mm) make in a finger with the lengths of Qiu's hands."""
    return 0.1 * force_over_tension(_qiu_points(posture), *differences)


def qiu_forces(trials: Sequence[Trial], summaries: Summaries) -> Iterator[Comparison]:
    """The forces that measured and our own differences make in a finger with the lengths of Qiu's
    hands, % of the tension, along the metacarpal's axes."""
    for trial in trials:
        muscle, posture = trial.muscle, trial.posture
        measured = qiu_force(posture, measured_differences(muscle, posture))
        summary = summaries.get(trial.name, {})
        differences = [v for q in DIFFERENCES.values() if (v := value_of(summary, q)) is not None]
        ours = qiu_force(posture, differences) if differences else None
        for i, side in enumerate(SIDES):
            name = f"{muscle} {posture}: {side} force over tension, lengths of Qiu's hands"
            quantity = f"force_over_tension_percent.{side}"
            row = target(trial, name, quantity, "%", (measured[i], None), QIU, "inferred", "n 5")
            yield Comparison(row, None if ours is None else float(ours[i]))


def target(
    trial: Trial,
    name: str,
    quantity: str,
    unit: str,
    value: tuple[float, float | None],
    source: str,
    kind: Kind,
    note: str,
    n: int | None = None,
) -> Target:
    """A row of a trial without a band; value: the reference and its SD between `n` specimens."""
    mean, sd = value
    place = (name, quantity, unit, float(mean), sd, None, None, source, kind, trial.name)
    return Target(*place, note=note, n=n)


# The middle fingers of Synek et al. 2019 ----------------------------------------------------------

SYNEK = f"{sources()['synek2019'].cited}, raw data"


def cadaver_arm_group(forces: TrialGroup) -> TrialGroup:
    """The arms that the forces of a group say, hand by hand and their means, told beside."""
    arms = {hand: _arms_of_hand(forces.trials, each) for hand, each in forces.hands.items()}
    hands = {
        hand: tuple(_arm_targets(forces.trials, {k: (v, None) for k, v in of_hand.items()}, hand))
        for hand, of_hand in arms.items()
    }
    every = {key: [of_hand[key] for of_hand in arms.values()] for key in next(iter(arms.values()))}
    means = {k: (float(np.mean(v)), float(np.std(v, ddof=1))) for k, v in every.items()}
    of_means = _arm_targets(forces.trials, means, "mean of three hands")
    return replace(
        forces,
        name=forces.name.replace("forces", "arms"),
        kind="inferred",
        targets=tuple(replace(t, n=len(arms)) for t in of_means),
        variant=True,
        hands=hands,
    )


def _arms_of_hand(
    trials: Sequence[Trial], forces: Sequence[Target]
) -> dict[tuple[str, str], float]:
    """Differences of arms (mm) by trial and quantity; forces: the components of one hand, distal
    phalanx's axes."""
    differences: dict[tuple[str, str], float] = {}
    for trial in trials:
        points, posture, tension = _chain_of(trial.case)
        mine = [t for t in forces if t.case == trial.name]
        parts = {t.quantity.rpartition(".")[2]: t.reference or 0.0 for t in mine}
        distal, radial, palmar = (parts[a] for a in ("distal", "radial", "palmar"))
        on_phalanx = np.array([distal, radial, -palmar])
        arms = arm_differences(points, to_world(on_phalanx, posture), tension)
        differences |= {(trial.name, q): v for q, v in numbers_of({"difference": arms}).items()}
    return differences


@cache
def _chain_of(name: str) -> tuple[Array, list[float], float]:
    """The joints' points, the posture (deg) and the tension (N) of a packaged case."""
    case = load_case(name)
    finger = case.native_finger()
    posture = [np.degrees(finger.posture.angles()[j]) for j in ("MCP", "PIP", "DIP")]
    points = chain_points(skeleton_of(finger).length[1:], posture)
    return points, posture, sum(t.tension for t in case.tendons.values() if t.tension)


def _arm_targets(
    trials: Sequence[Trial],
    values: Mapping[tuple[str, str], tuple[float, float | None]],
    whose: str,
) -> Iterator[Target]:
    for trial in trials:
        for words, quantity in (DIFFERENCES | ABDUCTION).items():
            note = "from the force by statics; counted as a force"
            if words in ABDUCTION:
                note += "; a convention: the clamp bears a moment there"
            name = f"{trial.name}, {trial.muscle}, {words}, {whose}"
            value = values[trial.name, quantity]
            yield target(trial, name, quantity, "mm", value, SYNEK, "inferred", note)


def metacarpal_group() -> TrialGroup:
    """What the metacarpal bears under both flexors, told: tendons that run on along it pull it with
    all their tension, so that the load less that is what the fingertip bears, whose force under
    each tendon alone is judged already."""
    trials: dict[str, Trial] = {}
    rows = []
    for m in read_measured("synek2019"):
        if m.kind != "metacarpal_load":
            continue
        tension = m.tension or 0.0
        name = f"metacarpal {m.posture} {tension:g} N"
        case = {"40/55/35": "middle_minorflex_fdp", "55/57/25": "middle_majorflex_fdp"}[m.posture]
        pulls = tuple(f'tendons.{t}.tension="{tension} N"' for t in ("FDP", "FDS"))
        trial = trials.setdefault(name, Trial(name, case, pulls))
        side = m.axis
        at_tip = (2 * tension if side == "proximal" else 0.0) - m.number()
        words = f"{name}: {side} fingertip force, from the metacarpal's load"
        note = f"n {m.n}; the tendons are taken to leave along the metacarpal"
        quantity = f"{FORCE}.{side}"
        value = (at_tip, m.sd)
        rows.append(target(trial, words, quantity, "N", value, SYNEK, "inferred", note, m.n))
    return TrialGroup(
        "metacarpal loads", "inferred", tuple(trials.values()), tuple(rows), variant=True
    )
