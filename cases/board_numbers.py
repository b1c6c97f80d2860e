"""Numbers of the committed board and of its uncertainty, in words, for the documentation's pages:
`{board GROUP}` and `{uncertainty meshes|inputs|forms|judged}` in a text give way to them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from cosim.errors import InputError
from cosim.results.compare import number
from cosim.text_tables import read_json_file
from cosim.validation.mesh import distinct, tally
from cosim.validation.uncertainty import UncertaintyFile, read_committed

PLACE = re.compile(r"\{(board|uncertainty)\s+([^}]+)\}")


def with_numbers(text: str) -> str:
    """The text with each number in its place.  Raises InputError for one that there is not."""
    return PLACE.sub(lambda found: _words(found[1], " ".join(found[2].split())), text)


def _words(kind: str, name: str) -> str:
    if kind == "uncertainty":
        return uncertainty_words(name, read_committed(), _board())
    if name not in _board()["groups"]:
        raise InputError(f"{{board {name}}}: the board has no such group")
    return board_words(name, _board())


@cache
def _board() -> Mapping[str, Any]:
    return read_json_file(Path(str(resources.files("cases"))) / "scoreboard.json")


def board_words(group: str, board: Mapping[str, Any]) -> str:
    """A group's verdicts, and the skill over no answer."""
    judged = board["judged"][group]
    verdicts = ", ".join(f"{count} {word}" for word, count in judged["tally"]["model"].items())
    skills = [s["skill"] for s in judged["skill"] if s["null"] == "no answer"]
    skill = f"; skill over no answer {number(skills[0], 2)}" if skills and skills[0] else ""
    count = len(board["groups"][group])
    return f"{verdicts or f'{count} numbers, none counts'}{skill}"


def uncertainty_words(part: str, known: UncertaintyFile, board: Mapping[str, Any]) -> str:
    """How many numbers of the shipped models a part of the uncertainty is known of, and what it
    says. Raises InputError for another part."""
    rows = [row for row in known.rows if not board["judged"].get(row.group, {}).get("variant")]
    match part:
        case "meshes":
            series = {row.key: row.meshes for row in rows if row.meshes is not None}
            touched = [one for _, one in distinct(series)]
            observed = sum(one.convergence.order is not None for one in touched)
            return (
                f"{len(series)} numbers on {len(known.meshes)} meshes, {observed} of the "
                f"{len(touched)} that the mesh touches with an order, {tally(series)['beyond']} "
                "that change by more than they may"
            )
        case "inputs":
            count = sum(row.inputs is not None for row in rows)
            return f"{count} numbers at {known.samples} samples of the inputs"
        case "forms":
            return f"{sum(bool(row.forms) for row in rows)} numbers with other hoods"
        case "judged":
            every = [r for g, of in board["groups"].items() if _counts(board, g) for r in of]
            words = Counter(str(r.get("judgement")) for r in every if r["sd"] is not None)
            return ", ".join(f"{n} {w}" for w, n in words.items() if w not in ("no u_val", "None"))
    raise InputError(f"{{uncertainty {part}}}: known: meshes, inputs, forms, judged")


def _counts(board: Mapping[str, Any], group: str) -> bool:
    """Whether a group is of an experiment, and no variant."""
    judged = board["judged"].get(group, {})
    return not judged.get("variant") and str(judged.get("kind")).startswith("experiment")
