"""What differs between two boards: an earlier scoreboard's file and the one found now."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, StringConstraints

from cosim.results.compare import number
from cosim.text_tables import read_json_file
from cosim.validation.records import check_record
from cosim.validation.versions import Key

SAME, LEAST = 1e-3, 1e-2
"""Numbers are the same that differ by less of themselves, or of this much of their unit."""
SAME_UNCERTAINTY = 0.05
"""The same of a part of the uncertainty."""
Text = Annotated[str, StringConstraints(max_length=500)]


class Row(BaseModel):
    """A row of a scoreboard, as far as it is compared."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)
    case: Text
    name: Text
    quantity: Text
    unit: Text
    model: float | None
    verdict: Text
    u_num: float | None = None
    u_input: float | None = None


class Rows(BaseModel):
    """The rows of a scoreboard by group."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    groups: dict[Text, list[Row]]

    def by_key(self) -> dict[Key, Row]:
        """The rows by group, case, name and quantity."""
        return {(g, r.case, r.name, r.quantity): r for g, rows in self.groups.items() for r in rows}


def read_rows(path: Path) -> Rows:
    """The rows of a scoreboard that `cosim validate` wrote.  Raises InputError."""
    place = f"{path}: is no scoreboard.json of cosim validate"
    return check_record(Rows, read_json_file(path), place)


def differences(before: Rows, now: Rows, part: bool = False) -> list[str]:
    """What differs, a line each; where only `part` of the trials
    were run, what the earlier board has alone is left out."""
    theirs, ours = before.by_key(), now.by_key()
    alone = [("now", ours.keys() - theirs)]
    if not part:
        alone.insert(0, ("before", theirs.keys() - ours))
    missing = [
        f"{group}: {name}: there is such a number {where} alone"
        for where, keys in alone
        for group, _, name, _ in sorted(keys)
    ]
    return [*missing, *_numbers(theirs, ours)]


def _numbers(theirs: Mapping[Key, Row], ours: Mapping[Key, Row]) -> Iterator[str]:
    """The numbers and parts of the uncertainty that differ; a part that one board has not is none
    that differs."""
    for key in (k for k in theirs if k in ours):
        a, b = theirs[key], ours[key]
        words = [_unlike("", a.model, b.model, SAME)]
        if a.verdict != b.verdict:
            words.append(f"{a.verdict} before, {b.verdict} now")
        for part in ("u_num", "u_input"):
            pair = getattr(a, part), getattr(b, part)
            if None not in pair:
                words.append(_unlike(f"{part} ", *pair, SAME_UNCERTAINTY))
        if said := "; ".join(filter(None, words)):
            yield f"{key[0]}: {a.name}, {a.unit}: {said}"


def _unlike(what: str, theirs: float | None, ours: float | None, same: float) -> str:
    """How two numbers differ; empty where they do not."""
    if theirs is None or ours is None:
        is_same = theirs is ours
    else:
        is_same = abs(theirs - ours) <= same * max(abs(theirs), LEAST)
    return "" if is_same else f"{what}{number(theirs, 6)} before, {number(ours, 6)} now"
