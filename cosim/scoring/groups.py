"""What a model is judged by: groups of measured numbers, and the runs that each asks for.

The targets are those of the validations (`cosim.validation`), whose trials are run with the model's
own finger and hood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from cosim.analyses.moment_arms import compare_published
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.fingers.common import HeldTipConfig
from cosim.measured import RANGE, measured_of_kind
from cosim.models.build import build
from cosim.results.compare import Comparison, Target
from cosim.scoring.model import HEADS, HandModel, pulling, without_loads
from cosim.scoring.names import FingerName
from cosim.tendons.table import TendonConfig
from cosim.validation.clamped import ABDUCTION, QIU, cadaver_arm_group, qiu_groups
from cosim.validation.clamped import DIFFERENCES as DIFFERENCE_QUANTITIES
from cosim.validation.plan import LEE_LOAD, cadaver_groups, lee_groups, rows_of
from cosim.validation.ratios import BUFORD, COHN, cohn_groups, share_group, share_rows
from cosim.validation.trial import Summaries, Trial, TrialGroup, angles_of, posture_settings

ARMS, DIFFERENCES, SIZES, ANGLES, FORCES, SHARES, EXCURSIONS, SLIPS, STRAINS, CADAVER = (
    "moment arms",
    "differences of moment arms",
    "fingertip forces: size",
    "fingertip forces: angle",
    "fingertip forces: components",
    "shares of the flexion moment",
    "tendon excursions",
    "slips: terminal over central",
    "strains of the hood",
    "fingertip forces of cadavers",
)
ARMS_ABOUT = (
    "Flexors' moment arms by tendon excursion, means over the range of each joint, as other texts "
    "quote them."
)
AT_REST = (30.0, 45.0, 15.0)
"""deg, in which the shares of the flexion moment are taken."""
LOAD = 0.1
"""The part of its greatest force that a muscle pulls with."""
UNKNOWN_STRENGTH = 3.277
"""N, with which a muscle pulls whose greatest force the model does not state; the load of Synek et
al. 2019.  Forces are taken over the tension."""
MARKED = "strain_lee2008_average_ti"
"""The packaged case with Lee's markers on its hood."""
WITH_SLIPS = ("shell", "network", "cable", "two_band")
"""Kinds of hoods that tell the forces in their slips."""


@dataclass(frozen=True)
class ScoreGroup:
    """Measured numbers of one kind, of one finger."""

    name: str
    short: str
    """The name as the head of a column."""
    finger: FingerName
    about: str
    """What was measured, how, on how many hands."""
    source: str
    groups: tuple[TrialGroup, ...] = ()
    counts: bool = True
    """Whether its numbers are measured ones of their own, and not another group's once more."""
    needs_tip: bool = False
    floor: str = "not known: no spread is printed"
    """What is known of the noise where the hands themselves are not."""
    only: str = ""
    """Why only some models can be judged by it; empty where all can."""


def score_groups(finger: FingerName) -> tuple[ScoreGroup, ...]:
    """All groups of a finger, in the order in which they are told."""
    match finger:
        case "index":
            return _index_groups()
        case "middle":
            return _middle_groups()
    return (ScoreGroup(ARMS, f"arms, {finger}", finger, ARMS_ABOUT, "Ketchum et al. 1978"),)


def _index_groups() -> tuple[ScoreGroup, ...]:
    hood, flexor, _, as_forces = qiu_groups()
    cohn, past, _, angles = cohn_groups()
    straight, slips, *_ = lee_groups()
    forces = replace(as_forces, variant=False)
    return (
        ScoreGroup(ARMS, "arms", "index", ARMS_ABOUT, "An et al. 1983; Ketchum et al. 1978"),
        ScoreGroup(
            DIFFERENCES,
            "differences",
            "index",
            "Joint torque over tension with the fingertip clamped: the arm at a joint less that at "
            "the next one, which is what such a force says whatever moment the clamp bears. EDC, "
            "FPI and FDP in three to six postures, means of five hands.",
            QIU,
            (hood, flexor),
            floor="not known: no SD by posture is printed (n 5); read to 0.15 mm",
        ),
        ScoreGroup(
            SIZES,
            "force size",
            "index",
            "Size of the clamped fingertip's force over the tension, seven muscles at 45/45/10 "
            "deg, one hand.",
            COHN,
            (cohn, past),
            needs_tip=True,
            floor="not known: one hand",
        ),
        ScoreGroup(
            ANGLES,
            "force angle",
            "index",
            "Angle between each of these forces and EDC's; the force's axes are not known.",
            COHN,
            (angles,),
            counts=False,
            needs_tip=True,
            floor="not known: one hand",
        ),
        ScoreGroup(
            FORCES,
            "components",
            "index",
            "The differences of arms once more, as distal and dorsal forces that they make in a "
            "finger with the lengths of the measured hands.",
            QIU,
            (forces,),
            counts=False,
            floor="not known: no SD by posture is printed (n 5)",
        ),
        ScoreGroup(
            SHARES,
            "MCP shares",
            "index",
            "What intrinsics and lumbrical make of the flexion moment at the MCP with all muscles "
            "at their greatest force.",
            BUFORD,
            (share_group(),),
        ),
        ScoreGroup(
            EXCURSIONS,
            "excursions",
            "index",
            "How far a tendon's end moves as a joint passes its range.",
            "none",
            only="cannot be judged: the collection has no measured excursion over a joint's range; "
            "the arms above are their slopes",
        ),
        ScoreGroup(
            SLIPS,
            "slip ratio",
            "index",
            "Force in the terminal slip over that in the central one, EDC with 11.8 N in nine "
            "postures; five specimens, known from the abstract.",
            "Lee et al. 2008, J Biomech Eng 130:051014",
            (replace(slips, derived=None),),
            only="cannot be judged: the model has no slips of its own",
        ),
        ScoreGroup(
            STRAINS,
            "strains",
            "index",
            "Strains between markers on the hood, EDC with 11.8 N at 0/0/0 deg; as a thesis quotes "
            "them.",
            "Lee et al. 2008, J Biomech Eng 130:051014",
            (straight,),
            only="cannot be judged: the model has no sheet",
        ),
    )


def _middle_groups() -> tuple[ScoreGroup, ...]:
    hood, past, _ = cadaver_groups()
    arms = tuple(replace(cadaver_arm_group(g), variant=False) for g in (hood, past))
    source = "Synek et al. 2019, PeerJ 7:e7470, raw data"
    return (
        ScoreGroup(ARMS, "arms, middle", "middle", ARMS_ABOUT, "Ketchum et al. 1978"),
        ScoreGroup(
            CADAVER,
            "forces, middle",
            "middle",
            "Components of the clamped fingertip's force, one tendon at a time, in two postures, "
            "three hands.",
            source,
            (hood, past),
            needs_tip=True,
        ),
        ScoreGroup(
            DIFFERENCES,
            "differences, middle",
            "middle",
            "The differences of arms that these forces say, by statics.",
            source,
            arms,
            counts=False,
            floor="between three hands, as the grey bars show",
        ),
    )


# What each trial runs ----------------------------------------------------------------------------


def trials_of(model: HandModel, groups: Sequence[ScoreGroup]) -> dict[str, Case]:
    """The runs that the groups ask of a model, by the trials' names."""
    cases: dict[str, Case] = {}
    for group in groups:
        if why_not(model, group):
            continue
        for trial in (t for g in group.groups for t in g.trials):
            muscles, tension = _load(model, group, trial)
            if muscles and trial.name not in cases:
                cases[trial.name] = _case(model, group, trial, muscles, tension)
    return cases


def _load(
    model: HandModel, group: ScoreGroup, trial: Trial
) -> tuple[tuple[str, ...], float | None]:
    """The model's tendons that a trial loads, and their tension (N), None for a part of their
    greatest force."""
    muscle = trial.muscle
    if group.name == SHARES and muscle not in model.tendons:
        return model.tendons[:1], None
    muscles = tuple(m for m in HEADS.get(muscle, (muscle,)) if m in model.tendons)
    if group.name in (SLIPS, STRAINS):
        return muscles, LEE_LOAD
    if group.finger == "middle":
        stated = load_case(trial.case).tendons
        return muscles, next((t.tension for t in stated.values() if t.tension), None)
    return muscles, None


def _case(
    model: HandModel, group: ScoreGroup, trial: Trial, muscles: Sequence[str], tension: float | None
) -> Case:
    """The model's own case in the trial's posture, with these tendons loaded."""
    holds = "posture" if group.name in (SLIPS, STRAINS) else "clamped"
    case = _with_tip(_with_markers(without_loads(model.case)), holds)
    angles = AT_REST if group.name == SHARES else angles_of(trial.posture)
    texts = (text.partition("=") for text in posture_settings(*angles))
    case = case.replace({key: value.strip('"') for key, _, value in texts})
    loads = {}
    for name in muscles:
        tendon = case.tendons.get(name, TendonConfig())
        most = tendon.max_force
        pull = tension or (LOAD * most if most else UNKNOWN_STRENGTH)
        loads[name] = pulling(tendon, pull / len(muscles))
    tendons = {**case.tendons, **loads}
    text = "".join(c if c.isalnum() else "_" for c in trial.name)
    return case.model_copy(update={"tendons": tendons, "name": text})


def _with_markers(case: Case) -> Case:
    """The case with Lee's markers on a shell that has none, which changes nothing but what is read
    off."""
    if case.hood.kind != "shell" or case.hood.grids or case.finger.kind != "index":
        return case
    markers = load_case(MARKED).hood
    assert markers.kind == "shell"
    hood = case.hood.model_copy(update={"grids": markers.grids})
    return case.model_copy(update={"hood": hood})


def _with_tip(case: Case, kind: str) -> Case:
    tip = HeldTipConfig.model_validate({"kind": kind})
    return case.model_copy(update={"finger": case.finger.model_copy(update={"tip": tip})})


# The rows ---------------------------------------------------------------------------------------


def why_not(model: HandModel, group: ScoreGroup) -> str:
    """Why a group cannot judge a model; empty where it can."""
    if group.needs_tip and not model.has_tip:
        return "cannot be judged: the model does not say where the fingertip is (a site or marker)"
    hood = model.case.hood.kind
    if group.name == SLIPS and hood in WITH_SLIPS:
        return ""
    if group.name == STRAINS and hood == "shell":
        return ""
    if group.name == SHARES:
        needed = ("FPI", "LUM", "FDP", "FDS", "FDI")
        lacking = [m for m in needed if m in model.missing] or [
            m for m in needed if not any(h in model.strengths for h in HEADS.get(m, (m,)))
        ]
        if lacking:
            return f"cannot be judged: no muscle, or no greatest force, of {', '.join(lacking)}"
    return group.only


def rows_of_group(
    model: HandModel, group: ScoreGroup, summaries: Summaries
) -> tuple[list[Comparison], dict[str, str]]:
    """The rows of a group by a model's runs, and why of those without a value that are its muscles'
    lack and not a solve that failed."""
    if group.name == ARMS:
        return _arm_rows(model)
    if group.name == SHARES:
        (trial,) = group.groups[0].trials
        at_rest = summaries.get(trial.name)
        arms = {} if at_rest is None else at_rest["unloaded"]["moment_arm_mm"]
        return list(share_rows(trial, arms, _strengths(model))), {}
    rows = [row for g in group.groups for row in rows_of(g, summaries)]
    lacking = {}
    trials = {t.name: t for g in group.groups for t in g.trials}
    for row in rows:
        muscle = trials[row.target.case].muscle
        needed = (muscle, "EDC") if group.name == ANGLES else (muscle,)
        missing = [m for m in needed if m in model.missing]
        if row.model is None and missing:
            lacking[row.target.name] = f"the model has no {' and '.join(missing)}"
    return rows, lacking


def _strengths(model: HandModel) -> dict[str, float]:
    """The greatest forces; a head of the first dorsal interosseous without one makes no moment."""
    return {name: model.strengths.get(name, 0.0) for name in model.tendons}


def _arm_rows(model: HandModel) -> tuple[list[Comparison], dict[str, str]]:
    """Arms over a joint's range beside those measured; of muscles that run through the hood none is
    measured over a range."""
    import pandas

    measured = measured_of_kind("arm", finger=model.finger)
    known = pandas.DataFrame(
        [(m.muscle, m.joint, m.posture, m.address) for m in measured],
        columns=["tendon", "joint", "posture_deg", "source"],
    )
    case = model.case
    if case.hood.kind != "split":
        case = case.replace({"hood": {"kind": "split"}})
    compared = compare_published(build(without_loads(case)), known)
    ours = dict(zip(compared.source, compared.model_mm, strict=True))
    rows, lacking = [], {}
    for m in measured:
        name = f"{m.muscle}: arm at the {m.joint.replace('_', ' ')}, {m.cited.cited.split(',')[0]}"
        where = "mean over the joint's range" if m.posture == RANGE else f"at {m.posture} deg"
        place = (name, f"moment_arm_mm.{m.muscle}.{m.joint}", m.unit, m.number(), m.sd)
        row = Target(*place, None, None, m.cited.text, m.evidence, m.muscle, note=where)
        value = ours.get(m.address)
        rows.append(Comparison(row, None if value is None else float(value)))
        if value is None:
            own = m.muscle in model.tendons
            lacking[name] = (
                "runs through the hood, whose arms are judged by forces"
                if own
                else f"the model has no {m.muscle}"
            )
    return rows, lacking


def row_words(group: ScoreGroup, row: Comparison) -> str:
    """A row in words that need no trial's name."""
    trials = {t.name: t for g in group.groups for t in g.trials}
    trial, quantity = trials.get(row.target.case), row.target.quantity
    if trial is None or not (group.finger == "middle" or group.name in (SLIPS, STRAINS)):
        return row.target.name
    what = row.target.name.removeprefix(f"{trial.name}: ")
    if group.name == CADAVER:
        what = f"{quantity.rpartition('.')[2]} force, axes of the distal phalanx"
    elif group.name == DIFFERENCES:
        what = next(w for w, q in (DIFFERENCE_QUANTITIES | ABDUCTION).items() if q == quantity)
    return f"{trial.muscle} {trial.posture}: {what}"
