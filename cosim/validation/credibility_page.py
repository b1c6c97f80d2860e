"""The page of the model's credibility: context, coverage, factors, rules, and how to repeat it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim.files import output_file, relative_path
from cosim.report.templates import template
from cosim.results.compare import VERDICT_SHAPES, number
from cosim.validation.credibility import (
    CHECKOUT,
    SHAPES,
    Covered,
    Evidence,
    Numbers,
    board_words,
    committed_numbers,
    counted,
    coverage,
    follow,
    injuries,
    is_checkout,
    read_credibility,
    uncertainty_words,
)

MUSCLES = ("EDC", "EI", "LUM", "FPI", "FDI", "RI", "UI", "FDP", "FDS")
"""The order of the columns; others follow."""


def write_credibility_page(path: Path, linked: bool = True) -> None:
    """The page; `linked` to the files of the checkout from where it lies.  Raises InputError where
    the claims or the board are at fault, or the file cannot be written."""
    claims, numbers = read_credibility(), committed_numbers()
    start = path if linked else None
    covered = coverage(numbers)
    rows, unmeasured = injuries(numbers)
    judged = numbers.board["judged"]
    factors = [_graded(f, f.grade, f.evidence, numbers, start) for f in claims.factors]
    rules = [_graded(r, r.grade, r.evidence, numbers, start) for r in claims.rules.list]
    page = template("cosim.validation", "credibility.html.j2").render(
        claims=claims,
        factors=factors,
        activities=list(dict.fromkeys(f.activity for f in claims.factors)),
        reached=sum(f["counted"] >= f["of"].goal for f in factors),
        rules=rules,
        score=sum(r["counted"] for r in rules),
        most=(len(claims.rules.scale) - 1) * len(rules),
        kinds=[_graded(k, 0, k.evidence, numbers, start) for k in claims.fda.kinds],
        fingers={finger: _matrix(covered, finger) for finger in _names(c.finger for c in covered)},
        shapes=SHAPES,
        largest=number(max(t for c in covered if c.verdicts for t in c.tensions), 3),
        groups=[
            {"name": group, "kind": of["kind"], "words": board_words(group, numbers.board)}
            for group, of in judged.items()
            if not of["variant"] and of["kind"].startswith("experiment")
        ],
        uncertainty=_uncertainty(numbers),
        injuries=[_injury(row) for row in rows],
        unmeasured=unmeasured,
        checked=is_checkout(),
    )
    with output_file(path) as part:
        part.write_text(page, encoding="utf-8")


def credibility_rows() -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """A header, and a line for each factor and rule: the grade that counts, of how many, the goal,
    and what evidence is lacking.  Raises InputError."""
    claims, numbers = read_credibility(), committed_numbers()
    rows: list[tuple[str, ...]] = []
    for f in claims.factors:
        found = follow(f.evidence, numbers)
        grade = f"{counted(f.grade, found)} of {len(f.grades) - 1}"
        rows.append((f.name, f.activity, grade, str(f.goal), _lacking(found)))
    for r in claims.rules.list:
        found = follow(r.evidence, numbers)
        grade = f"{counted(r.grade, found)} of {len(claims.rules.scale) - 1}"
        rows.append((r.name, "Ten Rules", grade, "", _lacking(found)))
    return ("factor or rule", "of", "grade", "goal", "evidence that is lacking"), rows


def _graded(
    of: Any, grade: int, addresses: Sequence[str], numbers: Numbers, page: Path | None
) -> dict[str, Any]:
    """A factor, rule or kind of evidence with the grade that counts and its evidence."""
    found = follow(addresses, numbers)
    return {"of": of, "counted": counted(grade, found), "evidence": _evidence(found, page)}


def _lacking(found: Sequence[Evidence]) -> str:
    if not found:
        return "there is none"
    return "; ".join(f"{e.kind} {e.what}: {e.fault}" for e in found if e.fault)


def _evidence(found: Sequence[Evidence], page: Path | None) -> list[dict[str, Any]]:
    return [
        {"e": e, "link": _link(e, page), "words": WORDS.get((e.kind, e.what), e.what)}
        for e in found
    ]


WORDS = {
    ("uncertainty", "meshes"): "meshes",
    ("uncertainty", "inputs"): "inputs",
    ("uncertainty", "forms"): "other hoods",
    ("uncertainty", "judged"): "errors beside their uncertainty",
}
"""Parts of the uncertainties in words."""


def _link(e: Evidence, page: Path | None) -> str:
    """Where a file lies from the page, in a checkout."""
    place = CHECKOUT / e.what.partition("::")[0]
    if page is None or e.kind not in ("file", "test"):
        return ""
    if not place.is_file() or not is_checkout():
        return ""
    return relative_path(place, page.absolute().parent)


def _injury(row: Mapping[str, Any]) -> dict[str, str]:
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    measured, low, high = row["reference"], row["low"], row["high"]
    words = number(measured, 3)
    if measured is None:
        words = f"at least {number(low, 3)}" if low is not None else f"at most {number(high, 3)}"
    return {
        "name": row["name"],
        "shape": VERDICT_SHAPES[row["verdict"]],
        "verdict": row["verdict"],
        "model": "–" if row["model"] is None else f"{number(row['model'], 3)}{unit}",
        "measured": f"{words}{unit}",
        "source": row["source"],
    }


def _names(words: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(words))


def _matrix(covered: Sequence[Covered], finger: str) -> dict[str, Any]:
    """A line for each posture and fixture, a column for each muscle."""
    mine = [c for c in covered if c.finger == finger]
    found = _names(c.muscle for c in mine)
    muscles = [m for m in MUSCLES if m in found] + [m for m in found if m not in MUSCLES]
    lines = []
    for posture, tip in dict.fromkeys((c.posture, c.tip) for c in mine):
        at = {c.muscle: _cell(c) for c in mine if (c.posture, c.tip) == (posture, tip)}
        words = "/".join(f"{angle:g}" for angle in posture)
        lines.append({"posture": words, "tip": tip, "cells": [at.get(m) for m in muscles]})
    return {"muscles": muscles, "lines": lines}


def _cell(c: Covered) -> dict[str, str]:
    tensions = " and ".join(number(t, 3) for t in c.tensions)
    hands = " and ".join(map(str, c.hands)) or "?"
    verdicts = ", ".join(f"{n} {word}" for word, n in c.verdicts.items())
    return {
        "shape": c.shape,
        "words": f"{tensions} N" if tensions else "",
        "hands": f"n {hands}",
        "title": "; ".join(filter(None, (", ".join(c.groups), verdicts))),
    }


def _uncertainty(numbers: Numbers) -> list[tuple[str, str]]:
    """What is known of the compared numbers' uncertainty, a line for each part."""
    parts = [words for kind, words in WORDS if kind == "uncertainty"]
    return [
        (WORDS["uncertainty", part], uncertainty_words(part, numbers) or "nothing yet")
        for part in parts
    ]
