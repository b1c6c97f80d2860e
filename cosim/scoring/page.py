"""The page of scores, which needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.report.templates import html_page
from cosim.results.compare import number
from cosim.results.picture import picture_address
from cosim.results.table import Cell, ReportTable
from cosim.scoring.groups import row_words
from cosim.scoring.names import Matched
from cosim.scoring.plots import draw_rows, draw_skills
from cosim.scoring.run import GroupScore, HandScore, groups_of, score_of

DPI = 110


def score_page(hands: Sequence[HandScore], refused: Mapping[str, str]) -> str:
    """The text of the page."""
    return html_page(
        "page.html.j2",
        "cosim.scoring",
        models=[_model(hand) for hand in hands],
        refused=refused,
        answers=[answer(hand) for hand in hands],
        picture=picture_address(draw_skills(hands), DPI),
        table=skill_table(hands),
        no_doubts=[h.model.name for h in hands if not (h.doubts or h.failures)],
        groups=[_group(hands, g) for g in groups_of(hands)],
    )


def answer(hand: HandScore) -> str:
    """A model's score in one sentence."""
    overall = hand.overall
    model = hand.model
    if overall is None:
        return f"{model.name}: nothing that was measured judges it."
    ranked = [g for g in hand.groups if g.group.counts and g.rank is not None]
    best = [g for g in ranked if g.rank is not None and g.rank.place == 1 and g.rank.of > 1]
    worst = [g for g in ranked if g.skill is not None and g.skill.value <= 0]
    parts = [f"skill {overall} over no answer, of {overall.rows} measured numbers"]
    if best:
        parts.append(f"nearest of all in {', '.join(g.group.name for g in best)}")
    if worst:
        parts.append(f"no better than no answer in {', '.join(g.group.name for g in worst)}")
    if hand.doubts:
        count = len(hand.doubts)
        parts.append(f"{count} doubt{'s' * (count > 1)}, see below")
    return f"{model.name}: {'; '.join(parts)}."


def skill_table(hands: Sequence[HandScore], of: str = " of ") -> ReportTable:
    """The skills, with places like 1`of`7: a row for each model, a column for each group of numbers
    that judges one."""
    groups = [
        g
        for g in groups_of(hands)
        if any((s := score_of(hand, g)) is not None and s.skill for hand in hands)
    ]
    heads = ["model", *(g.group.short + ("" if g.group.counts else "*") for g in groups)]
    rows = [[hand.model.name, *(_cell(score_of(hand, g), of) for g in groups)] for hand in hands]
    return ReportTable("scores", "skill over no answer (place among models):", heads, rows)


def _cell(score: GroupScore | None, of: str) -> str:
    """A skill with its rank; a dash where there is none."""
    if score is None or score.skill is None:
        return "–"
    rank = score.rank
    place = "" if rank is None or rank.of < 2 else f" ({rank.place}{of}{rank.of})"
    return f"{number(score.skill.value, 2)}{place}"


def _model(hand: HandScore) -> dict[str, Any]:
    model = hand.model
    matched = model.matched
    of_finger = set(model.losses_of_finger)
    return {
        "name": model.name,
        "what": f"{model.source}, {model.finger} finger",
        "origin": model.origin,
        "case": model.case.title if matched is None else "",
        "lost": model.losses_of_finger,
        "others": [line for line in model.lost if line not in of_finger],
        "is_read": matched is not None,
        "missing": model.missing,
        "doubts": hand.doubts,
        "failures": hand.failures,
        "names": None if matched is None else _names(model.name, matched),
    }


def _names(model: str, matched: Matched) -> ReportTable:
    rows = [(ours, theirs, matched.how[ours]) for ours, theirs in matched.names.items()]
    return ReportTable(f"names-{model}", model, ("Here", "In the model", "Found"), rows)


def _group(hands: Sequence[HandScore], g: GroupScore) -> dict[str, Any]:
    judged = [(hand, s) for hand in hands if (s := score_of(hand, g)) is not None]
    scored = [(hand, s) for hand, s in judged if s.rows]
    names = list(dict.fromkeys(row.target.name for _, s in scored for row in s.rows))
    heads = ("What", "Measured", *(hand.model.name for hand, _ in scored))
    rows = [_row(name, [s for _, s in scored]) for name in names]
    columns = ("Model", "Skill [95 %]", "Place", "Numbers", "Remarks")
    models = [_of_group(hand, s) for hand, s in judged]
    return {
        "group": g.group,
        "floor": next((s.floor for _, s in judged if s.floor), g.group.floor),
        "models": ReportTable(f"models-{g.group.name}", g.group.name, columns, models),
        "ranks": next((s.rank.words for _, s in judged if s.rank is not None), ""),
        "picture": picture_address(draw_rows(hands, g.group.finger, g.group.name), DPI),
        "numbers": ReportTable(f"numbers-{g.group.name}", g.group.name, heads, rows, 3),
    }


def _of_group(hand: HandScore, s: GroupScore) -> list[Cell]:
    left_out = ", ".join(dict.fromkeys(s.unjudged.values()))
    same = [] if s.rank is None else [n for n in s.rank.same_words if n != hand.model.name]
    remarks = [
        s.why_not,
        f"{len(s.unjudged)} left out: {left_out}" if left_out and not s.why_not else "",
        f"the same numbers as {', '.join(same)}" if same else "",
        f"nearer: {', '.join(s.rank.better_words)}" if s.rank is not None and s.rank.better else "",
    ]
    found = (None if x is None else str(x) for x in (s.skill, s.rank))
    return [hand.model.name, *found, len(s.judged) or None, "; ".join(filter(None, remarks))]


def _row(name: str, scored: list[GroupScore]) -> list[Cell]:
    found = [next((r for r in s.rows if r.target.name == name), None) for s in scored]
    first, group = next((r, s.group) for r, s in zip(found, scored, strict=True) if r is not None)
    t = first.target
    if t.reference is None:
        stated = f"{number(t.low, 3)} to {number(t.high, 3)}"
    else:
        stated = number(t.reference, 3) + (f" ± {number(t.sd, 2)}" if t.sd else "")
    unit = t.unit if t.unit != "1" else ""
    values = (None if r is None else r.model for r in found)
    return [row_words(group, first), f"{stated} {unit}".strip(), *values]
