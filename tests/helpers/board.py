"""The committed scoreboard, and how texts state its numbers."""

from __future__ import annotations

import json
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
    tally = group["tally"]
    judged = sum(n for word, n in tally["model"].items() if word != "nothing to judge by")
    skill = {s["null"]: s for s in group["skill"]}
    cells = [
        name,
        str(skill["no answer"]["rows"]),
        f"{inside(tally['model'])} of {judged}" if judged else "-",
        str(inside(tally["no answer"])) if judged else "-",
        within_uncertainty(group["judgements"]),
        skill_text(skill["no answer"]),
        skill_text(skill["fixed split"]) if "fixed split" in skill else "-",
    ]
    return f"| {' | '.join(cells)} |"


def inside(counts: dict[str, int]) -> int:
    """The numbers within one SD or in a band."""
    return sum(n for word, n in counts.items() if word.startswith("inside"))


def within_uncertainty(judgements: dict[str, int]) -> str:
    """The numbers within 95 % of u_val, of those that have one."""
    within = judgements.get("within uncertainty", 0)
    judged = within + judgements.get("model differs", 0)
    return f"{within} of {judged}" if judged else "-"


def skill_text(skill: dict) -> str:
    """A skill with its interval."""
    if skill["low"] is None:
        return f"{skill['skill']:.2g} (one trial)"
    return f"{skill['skill']:.2g} ({skill['low']:.2g} to {skill['high']:.2g})"
