"""Validations by sizes, angles and shares: of forces published without axes, and of arms published
without lengths."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from cosim.case.file import load_case
from cosim.measured import SECOND_HAND, sources, values_of
from cosim.port import Array
from cosim.results.compare import Comparison
from cosim.results.conventions import vector_of
from cosim.validation.clamped import clamped_trial, split_partners, target
from cosim.validation.force import CLAMPED, PAST_THE_HOOD, THROUGH_THE_HOOD
from cosim.validation.trial import Summaries, Trial, TrialGroup

POSTURE, HAND = "45/45/10", "3"
COHN = sources()["cohn2017"].cited
BUFORD = f"{sources()['buford2005'].cited}, abstract"
NOTE = "one hand; clamped; linear fit to the data"
INTRINSICS, FLEXORS = ("FDIm", "FDIl", "FPI", "LUM"), ("FDP", "FDS")


def cohn_groups() -> tuple[TrialGroup, ...]:
    """Sizes of forces over tension through the hood and past it; and as variants the fixed split,
    and the angles to EDC's force, which say nothing against null models by factors: no force has no
    angle, and a force that is doubled the same."""
    hood, split = (
        [clamped_trial("cohn", model, m, POSTURE) for m in THROUGH_THE_HOOD]
        for model in ("hood", "split")
    )
    past = [clamped_trial("cohn", "split", m, POSTURE) for m in PAST_THE_HOOD]
    every = (*hood, *past)
    partners = split_partners(hood, split)
    return (
        _cohn("Cohn 2017: hood", hood, sizes, partners=partners),
        _cohn("Cohn 2017: flexors and FDI", past, sizes),
        _cohn("Cohn 2017: fixed split", split, sizes, variant=True),
        _cohn(
            "Cohn 2017: angles to EDC",
            every,
            angles,
            partners={**partners, **split_partners(past, past)},
            variant=True,
        ),
    )


def _cohn(name: str, trials: Sequence[Trial], derived: Any, **more: Any) -> TrialGroup:
    derived_rows = partial(derived, trials)
    return TrialGroup(name, "experiment", tuple(trials), (), derived=derived_rows, **more)


def sizes(trials: Sequence[Trial], summaries: Summaries) -> Iterator[Comparison]:
    """Magnitude of the tip's force over the rise of the muscle's tension."""
    for trial, summary in _with_summaries(trials, summaries):
        size = None if summary is None else float(np.linalg.norm(_force(summary)) / _rise(summary))
        name = f"{trial.muscle} {POSTURE}: force over tension"
        value = values_of("cohn2017", POSTURE, HAND)[f"size.{trial.muscle}"], None
        row = target(trial, name, "size_over_tension", "1", value, COHN, "experiment", NOTE)
        yield Comparison(row, size)


def angles(trials: Sequence[Trial], summaries: Summaries) -> Iterator[Comparison]:
    """Angles (deg) between each muscle's force and EDC's, the first trial's."""
    (_, edc), *others = _with_summaries(trials, summaries)
    for trial, summary in others:
        angle = None if summary is None or edc is None else _angle(_force(summary), _force(edc))
        name = f"{trial.muscle} {POSTURE}: angle to EDC's force"
        value = values_of("cohn2017", POSTURE, HAND)[f"angle_to_EDC.{trial.muscle}"], None
        row = target(trial, name, "angle_to_EDC_deg", "deg", value, COHN, "experiment", NOTE)
        yield Comparison(row, angle)


def _with_summaries(
    trials: Sequence[Trial], summaries: Summaries
) -> list[tuple[Trial, Mapping[str, Any] | None]]:
    return [(t, summaries.get(t.name)) for t in trials]


def _force(summary: Mapping[str, Any]) -> Array:
    return vector_of(summary["difference"]["fingertip_force_N"])


def _rise(summary: Mapping[str, Any]) -> float:
    """The rise of all tensions together (N)."""
    return float(
        sum(summary["tension_N"].values()) - sum(summary["unloaded"]["tension_N"].values())
    )


def _angle(one: Array, other: Array) -> float:
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


# The shares of Buford et al. 2005 -----------------------------------------------------------------


def share_group() -> TrialGroup:
    """Shares of the index finger's flexion moment at the MCP, with the hood at rest at 30/45/15."""
    trial = Trial("force ti EDC", "fingertip_fibres_edc", (CLAMPED,), muscle="EDC")
    return TrialGroup(
        "Buford 2005: shares of the MCP's moment",
        SECOND_HAND,
        (trial,),
        (),
        partners={trial.name: "force split EDC"},
        derived=partial(shares, trial),
    )


def shares(trial: Trial, summaries: Summaries) -> Iterator[Comparison]:
    """%, of intrinsics and lumbrical, by a run's arms at rest and the strengths of its case."""
    arms = summaries.get(trial.name, {}).get("unloaded", {}).get("moment_arm_mm", {})
    if not arms.keys() >= {*INTRINSICS, *FLEXORS}:  # without one of them there is no share
        yield from share_rows(trial, {}, {})
        return
    tendons = load_case(trial.case).tendons
    yield from share_rows(trial, arms, {name: t.max_force or 0.0 for name, t in tendons.items()})


def share_rows(
    trial: Trial, arms: Mapping[str, Mapping[str, float]], strengths: Mapping[str, float]
) -> Iterator[Comparison]:
    """The same of arms (mm) by muscle and joint, and of strengths (N) by muscle; no value without
    arms.  A muscle that is not there makes no moment."""
    muscles = [m for m in (*INTRINSICS, *FLEXORS) if m in arms]
    moment = {m: arms[m]["MCP"] * strengths[m] for m in muscles}
    for what, of in (("intrinsics", INTRINSICS), ("LUM", ("LUM",))):
        value = values_of("buford2005")[f"flexion_moment_share.{what}"]
        name = f"{what}: share of the flexion moment at the MCP"
        note = "at the greatest strengths; posture and spread unknown, ours at 30/45/15 deg"
        key = f"flexion_moment_share_percent.{what}"
        row = target(trial, name, key, "%", (value, None), BUFORD, SECOND_HAND, note)
        part = sum(moment.get(m, 0.0) for m in of)
        yield Comparison(row, 100 * part / sum(moment.values()) if moment else None)
