"""The page of scores, which needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cosim.report.templates import template
from cosim.results.compare import number
from cosim.results.picture import picture_address
from cosim.scoring.groups import row_words
from cosim.scoring.plots import draw_rows, draw_skills
from cosim.scoring.run import GroupScore, HandScore, groups_of, score_of

if TYPE_CHECKING:
    pass

DPI = 110


def score_page(hands: Sequence[HandScore], refused: Mapping[str, str]) -> str:
    """The text of the page."""
    return template("cosim.scoring").render(
        models=[_model(hand) for hand in hands],
        refused=refused,
        answers=[answer(hand) for hand in hands],
        picture=picture_address(draw_skills(hands), DPI),
        table=skill_table(hands, " of "),
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


def skill_table(hands: Sequence[HandScore], of: str) -> dict[str, list[Any]]:
    """Heads and rows of the table of skills, with places like 1`of`7: a row for each model, a
    column for each group of numbers that judges one."""
    groups = [
        g
        for g in groups_of(hands)
        if any((s := score_of(hand, g)) is not None and s.skill for hand in hands)
    ]
    heads = ["model", *(g.group.short + ("" if g.group.counts else "*") for g in groups)]
    rows = [[hand.model.name, *(_cell(score_of(hand, g), of) for g in groups)] for hand in hands]
    return {"heads": heads, "rows": rows}


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
        "names": []
        if matched is None
        else [(ours, theirs, matched.how[ours]) for ours, theirs in matched.names.items()],
    }


def _group(hands: Sequence[HandScore], g: GroupScore) -> dict[str, Any]:
    mine = [(hand, score_of(hand, g)) for hand in hands]
    judged = [(hand, s) for hand, s in mine if s is not None]
    picture = draw_rows(hands, g.group.finger, g.group.name)
    names = list(dict.fromkeys(row.target.name for _, s in judged for row in s.rows))
    return {
        "name": g.group.name,
        "finger": g.group.finger,
        "about": g.group.about,
        "source": g.group.source,
        "counts": g.group.counts,
        "floor": next((s.floor for _, s in judged if s.floor), g.group.floor),
        "models": [_of_group(hand, s) for hand, s in judged],
        "ranks": next((s.rank.words for _, s in judged if s.rank is not None), ""),
        "picture": picture_address(picture, DPI),
        "heads": [hand.model.name for hand, s in judged if s.rows],
        "rows": [_row(name, [s for _, s in judged if s.rows]) for name in names],
        "none": picture is None,
    }


def _of_group(hand: HandScore, s: GroupScore) -> dict[str, Any]:
    left_out = ", ".join(dict.fromkeys(s.unjudged.values()))
    same = [] if s.rank is None else [n for n in s.rank.same_words if n != hand.model.name]
    remarks = [
        s.why_not,
        f"{len(s.unjudged)} left out: {left_out}" if left_out and not s.why_not else "",
        f"the same numbers as {', '.join(same)}" if same else "",
        f"nearer: {', '.join(s.rank.better_words)}" if s.rank is not None and s.rank.better else "",
    ]
    return {
        "name": hand.model.name,
        "remarks": "; ".join(filter(None, remarks)),
        "skill": "" if s.skill is None else str(s.skill),
        "rank": "" if s.rank is None else str(s.rank),
        "numbers": len(s.judged),
    }


def _row(name: str, scored: list[GroupScore]) -> dict[str, Any]:
    found = [next((r for r in s.rows if r.target.name == name), None) for s in scored]
    first, group = next((r, s.group) for r, s in zip(found, scored, strict=True) if r is not None)
    t = first.target
    if t.reference is None:
        stated = f"{number(t.low, 3)} to {number(t.high, 3)}"
    else:
        stated = number(t.reference, 3) + (f" ± {number(t.sd, 2)}" if t.sd else "")
    return {
        "words": row_words(group, first),
        "stated": f"{stated} {t.unit if t.unit != '1' else ''}".strip(),
        "values": [number(r.model, 3) if r is not None else "–" for r in found],
        "note": t.note,
    }
