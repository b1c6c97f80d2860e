"""The committed scoreboard, and how texts state its numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from tests.helpers.folders import ROOT

TRUST = {
    "cadaver forces: hood": "fingertip force through the hood, three cadaver hands (Synek 2019)",
    "cadaver forces: flexors": "the same of the flexors, which no hood touches",
    "Qiu 2017: hood": "differences of arms through the hood, five hands (Qiu 2017)",
    "Qiu 2017: flexor": "the same of FDP",
    "Cohn 2017: hood": "force over tension through the hood (Cohn 2017)",
    "Cohn 2017: flexors and FDI": "the same of tendons past it",
    "Buford 2005: shares of the MCP's moment": "shares of the moment at the MCP (Buford 2005)",
    "Lee 2008: slip forces": "forces of the slips (Lee 2008)",
    "Lee 2008: strains": "strains of the hood (Lee 2008)",
    "free finger: hood": "postures of a free finger (Nimbarte 2008)",
    "lengths and cuts": "lengths and cuts (Schweitzer and Rayan 2004, others)",
    "two models: hood": "two published models, clamped fingertip, hood",
    "two models: flexors": "the same, flexors",
    "Dogadov 2025: attachments": "forces of the slips, a published network (Dogadov 2025)",
}
"""A group of the board, and what our texts call it."""
EVERYTHING = "all experiments at first hand"


def read_board() -> dict[str, Any]:
    board: dict[str, Any] = json.loads(
        (ROOT / "cases" / "scoreboard.json").read_text(encoding="utf-8")
    )
    return board


def trust_rows() -> dict[str, str]:
    """The rows of a table of figures, by what our texts call a group."""
    board = read_board()
    rows = {name: trust_row(name, board["judged"][group]) for group, name in TRUST.items()}
    return rows | {EVERYTHING: trust_row(EVERYTHING, board["kinds"]["experiment"])}


def trust_row(name: str, group: dict) -> str:
    """A row of the README's table, of a group of the board or one of its kinds."""
    skill = {s["null"]: s for s in group["skill"]}
    cells = [
        name,
        str(skill["no answer"]["rows"]),
        of_answers(group["tally"], inside, not_judged="nothing to judge by"),
        of_answers(group["judgements"], within, not_judged="no u_val"),
        *(skill_text(skill[null]) if null in skill else "-" for null in ANSWERS[1:]),
        in_each_hand(group["by_hand"]),
    ]
    return f"| {' | '.join(cells)} |"


ANSWERS = ("model", "no answer", "halved", "fixed split")
"""Hood, zero, half of the hood and the fixed split, in the order of the table's cells."""


def of_answers(
    tally: dict[str, dict[str, int]], count: Callable[[dict[str, int]], int], not_judged: str
) -> str:
    """How many of its numbers each answer has in, of those that can be judged."""
    judged = {
        answer: sum(n for word, n in counts.items() if word != not_judged)
        for answer, counts in tally.items()
    }
    whole = judged["model"]

    def cell(answer: str) -> str:
        few = f" (of {judged[answer]})" if judged[answer] != whole else ""
        return f"{count(tally[answer])}{few}"

    cells = (cell(answer) if answer in tally else "-" for answer in ANSWERS)
    return f"{', '.join(cells)} of {whole}" if whole else "-"


def inside(counts: dict[str, int]) -> int:
    """The numbers within one SD or in a band."""
    return sum(n for word, n in counts.items() if word.startswith("inside"))


def within(counts: dict[str, int]) -> int:
    """The numbers within 95 % of u_val."""
    return counts.get("within uncertainty", 0)


def skill_text(skill: dict) -> str:
    """A skill with its interval."""
    if skill["low"] is None:
        return f"{skill['skill']:.2g} (one trial)"
    return f"{skill['skill']:.2g} ({skill['low']:.2g} to {skill['high']:.2g})"


def in_each_hand(every: list[dict]) -> str:
    """The skill over zero beside each hand, and a perfect model's beside their mean."""
    over_zero = next((one for one in every if one["null"] == "no answer"), None)
    if over_zero is None:
        return "-"
    low, high = over_zero["perfect_spread"]
    each = ", ".join(f"{skill:.2f}" for skill in over_zero["skill"].values())
    return f"{each}; {over_zero['perfect_skill']:.2f} ({low:.2f} to {high:.3g})"
