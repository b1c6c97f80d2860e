"""Scores of models: their rows, skill over no answer, rank beside reference models, doubts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cosim.errors import Progress, quiet
from cosim.outcome import Outcome
from cosim.pipeline import plain_summary, run_each
from cosim.results.compare import Comparison, number
from cosim.scoring.groups import (
    CADAVER,
    ScoreGroup,
    rows_of_group,
    score_groups,
    trials_of,
    why_not,
)
from cosim.scoring.model import HandModel
from cosim.scoring.plausible import doubts
from cosim.scoring.references import Rank, rank_of
from cosim.validation.run import compare_by_hand
from cosim.validation.skill import Skill, judging_rows, skill

NOTHING = "no answer"
"""The null model: all numbers zero."""
TOLD = 10
"""How often the progress of the runs is told."""
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class GroupScore:
    """A model beside one group of measured numbers."""

    group: ScoreGroup
    rows: tuple[Comparison, ...] = ()
    """Those that a value or a failed solve stands for, and after them those that cannot be
    judged."""
    unjudged: Mapping[str, str] = field(default_factory=dict)
    """Why, of each row that cannot be judged."""
    why_not: str = ""
    """Why none can; empty where some can."""
    skill: Skill | None = None
    """Over no answer; what a solve that failed lacks costs the most that a number can."""
    rank: Rank | None = None
    floor: str = ""
    """What is known of the noise of the measured numbers."""

    @property
    def judged(self) -> list[Comparison]:
        """The rows that count."""
        return judging_rows([r for r in self.rows if r.target.name not in self.unjudged])


@dataclass(frozen=True)
class HandScore:
    """A model's scores, and what to doubt about it."""

    model: HandModel
    groups: tuple[GroupScore, ...]
    doubts: tuple[str, ...]
    """Signs against the published ones, lengths and fibres far off."""
    failures: Mapping[str, str]
    """Why a run failed, by its trial."""

    @property
    def overall(self) -> Skill | None:
        """The skill over no answer of all rows that count, groups told once."""
        rows = [row for g in self.groups if g.group.counts for row in g.judged]
        return skill(rows, NOTHING)


def judge(
    models: Sequence[HandModel],
    workers: int = 2,
    progress: Progress = quiet,
    references: bool = True,
) -> list[HandScore]:
    """The scores of models, whose runs are solved side by side in so many processes.  Without
    `references` no model is ranked."""
    trials = [trials_of(m, score_groups(m.finger)) for m in models]
    asked = [(i, name, case) for i, of_one in enumerate(trials) for name, case in of_one.items()]

    def ended(done: int, *_: object) -> None:
        if done == len(asked) or done % max(1, len(asked) // TOLD) == 0:
            progress(f"{done} of {len(asked)} runs")

    results: list[dict[str, Outcome[Summary]]] = [{} for _ in models]
    outcomes = run_each([case for *_, case in asked], plain_summary, workers, ended)
    for (i, name, _), outcome in zip(asked, outcomes, strict=True):
        results[i][name] = outcome
    return [_score(m, r, references) for m, r in zip(models, results, strict=True)]


def _score(
    model: HandModel, outcomes: Mapping[str, Outcome[Summary]], references: bool
) -> HandScore:
    summaries = {name: o.value for name, o in outcomes.items() if o.value is not None}
    failures = {name: o.reason for name, o in outcomes.items() if o.error is not None}
    groups = tuple(
        _score_group(model, group, summaries, references) for group in score_groups(model.finger)
    )
    return HandScore(model, groups, tuple(doubts(model, summaries)), failures)


def _score_group(
    model: HandModel, group: ScoreGroup, summaries: Mapping[str, Summary], references: bool
) -> GroupScore:
    if reason := why_not(model, group):
        return GroupScore(group, why_not=reason)
    rows, unjudged = rows_of_group(model, group, summaries)
    of_group = GroupScore(group, tuple(rows), unjudged, floor=group.floor)
    judged = of_group.judged
    if not judged:
        reasons = ", ".join(dict.fromkeys(unjudged.values())) or "no row has a value"
        return replace(of_group, why_not=f"cannot be judged: {reasons}")
    return replace(
        of_group,
        skill=skill(judged, NOTHING),
        rank=rank_of(group.name, group.finger, judged) if references else None,
        floor=_floor(group, judged, summaries),
    )


def _floor(group: ScoreGroup, rows: Sequence[Comparison], summaries: Mapping[str, Summary]) -> str:
    """The noise of the measured numbers, where hands are known one by one."""
    if group.name != CADAVER:
        return group.floor
    texts = []
    for part in group.groups:
        gains, noise = compare_by_hand(part, summaries)
        texts += [
            f"{number(n.single, 2)} {unit} on a hand, {number(n.mean, 2)} {unit} on the mean"
            for unit, n in noise.items()
        ]
        for g in (g for g in gains if g.null == NOTHING):
            low, high = (number(end, 2) for end in g.spread)
            expected = f"{number(g.perfect, 2)}, nine times of ten {low} to {high}"
            texts[-1] += f" (a perfect model expects a skill of {expected})"
    return "; ".join(dict.fromkeys(texts)) or group.floor


def groups_of(hands: Sequence[HandScore]) -> list[GroupScore]:
    """The first model's score of each group, in their order, those of both fingers."""
    seen: dict[tuple[str, str], GroupScore] = {}
    for hand in hands:
        for g in hand.groups:
            seen.setdefault((g.group.finger, g.group.name), g)
    return list(seen.values())


def score_of(hand: HandScore, group: GroupScore) -> GroupScore | None:
    """A model's score of a group; None of another finger's."""
    place = group.group.finger, group.group.name
    same = (g for g in hand.groups if (g.group.finger, g.group.name) == place)
    return next(same, None)
